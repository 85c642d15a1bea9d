//! Compiles the shaders and writes, or checks, the files in `assets/shaders`.

use std::{fs, path::Path, process::ExitCode};

use anyhow::Context;
use clap::Parser;
use weir::shaders::{compile, digest};

/// Compile the shaders of weir with rust-gpu.
#[derive(Parser)]
struct Arguments {
    /// Write nothing; fail if a byte differs from the committed files.
    #[arg(long)]
    check: bool,
}

fn main() -> anyhow::Result<ExitCode> {
    let arguments = Arguments::parse();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("the package is in a workspace")?;
    let folder = root.join(digest::FOLDER);
    // A check starts from nothing, so that it cannot find what an earlier build has left.
    let fresh = tempfile::tempdir().context("cannot create a temporary folder")?;
    let target = if arguments.check { fresh.path() } else { Path::new("spirv-builder") };
    let modules = compile::build(root, target)?;
    let mut differ = false;
    for (name, compiled) in modules.files() {
        let path = folder.join(name);
        if arguments.check {
            let committed = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
            if committed != compiled {
                differ = true;
                eprintln!(
                    "the committed `{name}` is not what the sources compile to ({} bytes, compiled {}); run this \
                     command without --check and commit the result: {}",
                    committed.len(),
                    compiled.len(),
                    path.display()
                );
            }
        } else {
            fs::write(&path, compiled).with_context(|| format!("cannot write {}", path.display()))?;
            println!("{} bytes: {}", compiled.len(), path.display());
        }
    }
    if differ {
        return Ok(ExitCode::FAILURE);
    }
    if arguments.check {
        println!("the committed shaders are what the sources compile to");
    }
    Ok(ExitCode::SUCCESS)
}
