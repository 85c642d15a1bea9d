//! The passes of weir, one file each, and the table that declares them.
//!
//! A pass is a plain function of a pixel and of read-only buffers that returns its own element of each output. One
//! row of the table gives its GPU entry points, its host kernels and the list of its bindings; see [`wiring`] for
//! what a row expands to.
#![cfg_attr(target_arch = "spirv", no_std)]
#![expect(clippy::too_many_arguments, reason = "a pass names every buffer that it reads")]

#[macro_use]
pub mod wiring;

pub mod accumulate;
pub mod candidates;
pub mod display;
pub mod primary;
pub mod shade;
pub mod visibility;

passes! {
    primary[TEXTURES ENVIRONMENT INSTANCES](scene, bvh: [UVec4]) -> (surfaces: [Surface], emitted: [Vec4])
        = primary::primary;
    candidates[TEXTURES ENVIRONMENT SPECULAR](scene, lights: [u32], surfaces: [Surface]) -> (reservoirs: [Reservoir])
        = candidates::candidates;
    visibility[TEXTURES ENVIRONMENT INSTANCES](scene, bvh: [UVec4], surfaces: [Surface], reservoirs: [Reservoir])
        -> (visible: [Reservoir]) = visibility::visibility;
    shade[TEXTURES ENVIRONMENT SPECULAR](scene, surfaces: [Surface], emitted: [Vec4], visible: [Reservoir])
        -> (color: [Vec4]) = shade::shade;
    accumulate[](color: [Vec4], prev_moments: [Moments]) -> (moments: [Moments]) = accumulate::accumulate;
    display_clip[](moments: [Moments]) -> (display: [u32]) = display::clip;
    display_reinhard[](moments: [Moments]) -> (display: [u32]) = display::reinhard;
    display_aces[](moments: [Moments]) -> (display: [u32]) = display::aces;
    display_agx[](moments: [Moments]) -> (display: [u32]) = display::agx;
}
