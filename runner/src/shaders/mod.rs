//! The passes as SPIR-V: modules compiled by rust-gpu from the same sources as the host's kernels.
//!
//! They are kept in `assets/shaders`, so that building weir needs no more than the stable toolchain. The build script
//! fails where they were not compiled from the sources at hand; the feature `compile-shaders` compiles them anew.

use std::borrow::Cow;

#[cfg(feature = "compile-shaders")]
pub mod compile;
pub mod digest;
pub mod part;
#[cfg(feature = "compile-shaders")]
pub mod strict;

/// The optimised module: for rendering. naga takes it too.
pub fn plain() -> Cow<'static, [u32]> {
    words(include_bytes!("../../../assets/shaders/weir.spv"))
}

/// The module that is not optimised and rounds every float operation for itself, as the host does: for comparing the
/// two. Only for passthrough, because naga would drop what forbids contraction.
pub fn strict() -> Cow<'static, [u32]> {
    words(include_bytes!("../../../assets/shaders/weir-strict.spv"))
}

/// The passes that trace rays, which ask the driver's ray queries in place of traversing nodes; else as [`strict`].
pub fn ray_query() -> Cow<'static, [u32]> {
    words(include_bytes!("../../../assets/shaders/weir-ray-query.spv"))
}

fn words(module: &[u8]) -> Cow<'static, [u32]> {
    module.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}
