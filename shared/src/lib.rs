//! What both processors share: buffer layouts and the mathematics of every pass.
//!
//! Everything here compiles for the host and, through rust-gpu, for SPIR-V, from the same source. Buffers are
//! slices of `u32`, `f32` and 16-byte vectors; there are no pointers into them, only indices.
#![cfg_attr(target_arch = "spirv", no_std)]
#![cfg_attr(target_arch = "spirv", feature(asm_experimental_arch))]
#![expect(clippy::too_many_arguments, reason = "a function that runs on the GPU names every buffer that it reads")]
#![expect(clippy::neg_cmp_op_on_partial_ord, reason = "not-a-number must take the branch of what is out of range")]

pub mod alias;
pub mod block;
pub mod bsdf;
pub mod bvh;
pub mod camera;
pub mod closed_form;
pub mod environment;
pub mod fault;
pub mod frame;
pub mod light;
pub mod light_cuts;
pub mod light_tree;
pub mod merge;
pub mod moments;
pub mod numerics;
pub mod octahedral;
pub mod presample;
pub mod ray;
#[cfg(target_arch = "spirv")]
pub mod ray_query;
pub mod resample;
pub mod reservoir;
pub mod reuse;
pub mod rng;
pub mod scene;
pub mod surface;
pub mod target;
pub mod texture;
pub mod tiles;
pub mod tonemap;
pub mod trace;
pub mod triangle;
pub mod window;
mod words;
