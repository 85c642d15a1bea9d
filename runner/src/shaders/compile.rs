//! Compiles the passes to SPIR-V with rust-gpu. The same sources give the same bytes in every folder.

use std::{fs, io, panic::resume_unwind, path::Path, thread};

use cargo_gpu_install::install::Install;
use spirv_builder::{Capability, ModuleResult, SpirvBuilder, SpirvBuilderError, SpirvMetadata};
use thiserror::Error;

use super::{
    digest::{self, TOOLCHAIN},
    strict,
};

/// SPIR-V 1.3 with the simple memory model: wgpu does not enable the Vulkan memory model.
const TARGET: &str = "spirv-unknown-spv1.3";

/// Ray queries need SPIR-V 1.4, which Vulkan 1.2 takes, as it takes 1.5.
const TARGET_RAY_QUERY: &str = "spirv-unknown-spv1.5";

/// Of `weir-shader`: the entry points that ask ray queries, and no others.
const FEATURE_RAY_QUERY: &str = "ray-query";

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
    /// For [`digest::RAY_QUERY_FILE`].
    pub ray_query: Vec<u8>,
    /// For [`digest::DIGEST_FILE`].
    pub digest: String,
}

impl Modules {
    /// Names and contents of the committed files.
    pub fn files(&self) -> [(&'static str, &[u8]); 4] {
        [
            (digest::PLAIN_FILE, &self.plain),
            (digest::STRICT_FILE, &self.strict),
            (digest::RAY_QUERY_FILE, &self.ray_query),
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
    let with_queries = backend
        .to_spirv_builder(&shader, TARGET_RAY_QUERY)
        .capability(Capability::RayQueryKHR)
        .extension("SPV_KHR_ray_query")
        .shader_crate_features([FEATURE_RAY_QUERY.to_owned()]);
    let without = backend.to_spirv_builder(&shader, TARGET);
    // Side by side: rust-gpu links a module on one thread. Each has a folder, or cargo would wait for the others.
    let [plain, strict, ray_query] = thread::scope(|scope| {
        let plain = scope.spawn(|| {
            let module = compile(&without, &target.join("plain"), &[])?;
            strict::stripped(&module).map_err(CompileError::Module)
        });
        let strict = scope.spawn(|| compile_strict(&without, &target.join("strict")));
        let ray_query = scope.spawn(|| compile_strict(&with_queries, &target.join("ray_query")));
        [plain, strict, ray_query].map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
    });
    let (plain, strict, ray_query) = (plain?, strict?, ray_query?);
    let digest = digest::digest(root, [&plain, &strict, &ray_query])?;
    Ok(Modules { plain, strict, ray_query, digest })
}

/// A module in which every float operation is rounded for itself.
fn compile_strict(builder: &SpirvBuilder, target: &Path) -> Result<Vec<u8>, CompileError> {
    let module = compile(builder, target, &["--no-spirv-opt"])?;
    let pinned = strict::pinned(&module).map_err(CompileError::Module)?;
    strict::optimized(&pinned).map_err(CompileError::Module)
}

fn compile(builder: &SpirvBuilder, target: &Path, arguments: &[&str]) -> Result<Vec<u8>, CompileError> {
    let mut builder = builder.clone();
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
