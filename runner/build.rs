//! Fails the build where the committed shaders were compiled from other sources.

use std::{env, fs, path::Path, process::ExitCode};

// The library writes the digest with what this reads it by.
#[path = "src/shaders/digest.rs"]
mod digest;

const REMEDY: &str = "compile them anew: cargo run --release --features compile-shaders --bin weir-shaders";

fn main() -> ExitCode {
    let Some(manifest) = env::var_os("CARGO_MANIFEST_DIR") else {
        println!("cargo::error=CARGO_MANIFEST_DIR is not set; build with cargo");
        return ExitCode::FAILURE;
    };
    let root = Path::new(&manifest).join("..");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/shaders/digest.rs");
    for watched in digest::SOURCES.iter().chain(&["Cargo.lock", digest::FOLDER]) {
        println!("cargo::rerun-if-changed=../{watched}");
    }
    // With this feature on, the build is the way to the remedy.
    if env::var_os("CARGO_FEATURE_COMPILE_SHADERS").is_some() {
        return ExitCode::SUCCESS;
    }
    if let Err(message) = check(&root) {
        println!("cargo::error={message}");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

fn check(root: &Path) -> Result<(), String> {
    let folder = root.join(digest::FOLDER);
    let read = |name: &str| {
        let path = folder.join(name);
        fs::read(&path)
            .map_err(|e| format!("cannot read the compiled shaders; restore them from git: {e}: {}", path.display()))
    };
    let committed = String::from_utf8_lossy(&read(digest::DIGEST_FILE)?).replace("\r\n", "\n");
    let [plain, strict, ray_query] = digest::MODULES.map(read);
    let current = digest::digest(root, [&plain?, &strict?, &ray_query?])
        .map_err(|e| format!("cannot read the sources of the shaders: {e}"))?;
    if committed == current {
        return Ok(());
    }
    let stale: Vec<&str> = current
        .lines()
        .filter(|line| !committed.lines().any(|c| c == *line))
        .filter_map(|line| line.split_whitespace().last())
        .collect();
    Err(format!("the compiled shaders in assets/shaders are stale (changed since: {}); {REMEDY}", stale.join(", ")))
}
