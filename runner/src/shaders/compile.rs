//! Compiles the passes to SPIR-V with rust-gpu. The same sources give the same bytes in every folder.

use std::{fs, io, path::Path};

use cargo_gpu_install::install::{Install, InstalledBackend};
use spirv_builder::{ModuleResult, SpirvBuilderError, SpirvMetadata};
use thiserror::Error;

use super::{
    digest::{self, TOOLCHAIN},
    strict,
};

/// SPIR-V 1.3 with the simple memory model: wgpu does not enable the Vulkan memory model.
const TARGET: &str = "spirv-unknown-spv1.3";

/// Why there are no modules.
#[derive(Debug, Error)]
pub enum CompileError {
    /// The compiler is not there and could not be built.
    #[error(
        "cannot install the compiler of the shaders: {0}; it takes rustup, a C++ compiler and a network connection"
    )]
    Install(String),
    /// rust-gpu was updated.
    #[error(
        "rust-gpu wants `{0}`, but the digest names `{TOOLCHAIN}`; change TOOLCHAIN in runner/src/shaders/digest.rs"
    )]
    Toolchain(String),
    /// rust-gpu refused the sources; it has said why.
    #[error("the shaders do not compile: {0}")]
    Compile(#[from] SpirvBuilderError),
    /// A surprise from rust-gpu.
    #[error("rust-gpu has not given one valid module: {0}")]
    Module(String),
    /// A source or a result.
    #[error("cannot read the shaders: {0}")]
    Io(#[from] io::Error),
}

/// Compiled shaders, as they are committed.
#[derive(Debug)]
pub struct Modules {
    /// For [`digest::PLAIN_FILE`].
    pub plain: Vec<u8>,
    /// For [`digest::STRICT_FILE`].
    pub strict: Vec<u8>,
    /// For [`digest::DIGEST_FILE`].
    pub digest: String,
}

impl Modules {
    /// Names and contents of the committed files.
    pub fn files(&self) -> [(&'static str, &[u8]); 3] {
        [
            (digest::PLAIN_FILE, &self.plain),
            (digest::STRICT_FILE, &self.strict),
            (digest::DIGEST_FILE, self.digest.as_bytes()),
        ]
    }
}

/// Compiles the shaders of the workspace at `root`, with `target` for intermediate files
/// (relative: within the folder of the host's).
///
/// The first time on a machine this builds rust-gpu (some ten minutes) into the user's cache folder.
///
/// # Errors
///
/// See [`CompileError`]; messages of the compiler itself go to the standard error output.
pub fn build(root: &Path, target: &Path) -> Result<Modules, CompileError> {
    let shader = root.join("shader");
    let backend =
        Install::from_shader_crate(shader.clone()).run().map_err(|e| CompileError::Install(format!("{e:#}")))?;
    if backend.toolchain_channel != TOOLCHAIN {
        return Err(CompileError::Toolchain(backend.toolchain_channel));
    }
    let plain = compile(&backend, &shader, target, &[])?;
    let plain = strict::stripped(&plain).map_err(CompileError::Module)?;
    let strict = compile(&backend, &shader, target, &["--no-spirv-opt"])?;
    let strict = strict::pinned(&strict).map_err(CompileError::Module)?;
    let strict = strict::optimized(&strict).map_err(CompileError::Module)?;
    let digest = digest::digest(root, &plain, &strict)?;
    Ok(Modules { plain, strict, digest })
}

fn compile(
    backend: &InstalledBackend,
    shader: &Path,
    target: &Path,
    arguments: &[&str],
) -> Result<Vec<u8>, CompileError> {
    let mut builder = backend.to_spirv_builder(shader, TARGET);
    builder.spirv_metadata = SpirvMetadata::None;
    builder.target_dir_path = Some(target.to_path_buf());
    builder.extra_args = arguments.iter().map(ToString::to_string).collect();
    match builder.build()?.module {
        ModuleResult::SingleModule(path) => Ok(read(&path)?),
        ModuleResult::MultiModule(_) => Err(CompileError::Module("several modules".into())),
    }
}

fn read(path: &Path) -> io::Result<Vec<u8>> {
    fs::read(path).map_err(|e| io::Error::new(e.kind(), format!("{e}: {}", path.display())))
}
