//! The passes of weir, one file each, and the table that declares them.
//!
//! A pass is a plain function of a pixel (or of a reservoir, a record of lights, a part of the list of tiles) and of buffers
//! that returns its own element of each output. One row of the table gives its GPU entry points, its host kernels and the
//! list of its bindings; see [`wiring`] for what a row expands to.
#![cfg_attr(target_arch = "spirv", no_std)]
#![expect(clippy::neg_cmp_op_on_partial_ord, reason = "not-a-number must take the branch of what is out of range")]
#![expect(clippy::too_many_arguments, reason = "a pass names every buffer that it reads")]

#[macro_use]
pub mod wiring;

pub mod accumulate;
pub mod bsdf_rays;
pub mod candidates;
mod collect;
pub mod display;
pub mod presample;
pub mod present;
pub mod primary;
pub mod shade;
pub mod spatial;
pub mod temporal;
pub mod tiles;
pub mod visibility;

passes! {
    pixel primary[TEXTURES ENVIRONMENT INSTANCES CLOSED_FORM](scene, rays, prev_emitted: [Vec4])
        -> (surfaces: [Surface], emitted: [Vec4]) = primary::primary;
    block tiles_blocks[](surfaces: [Surface]) -> (busy_blocks: [u32]) = tiles::blocks;
    row tiles_rows[](busy_blocks: [u32]) -> (busy_in_rows: [u32]) = tiles::rows;
    vector tiles_list[](busy_blocks: [u32], busy_in_rows: [u32]) -> (tiles: [UVec4]) = tiles::list;
    reservoir bsdf_rays[MASKS ENVIRONMENT INSTANCES](scene, rays, surfaces: [Surface])
        -> (bsdf_hits: [Reservoir]) = bsdf_rays::bsdf_rays;
    record presample_tiles[EMISSION_IMAGES ENVIRONMENT](scene, lights: [u32]) -> (presampled: [LightRecord])
        = presample::tiles;
    record presample_cells[EMISSION_IMAGES ENVIRONMENT](scene, lights: [u32]) -> (presampled: [LightRecord])
        = presample::cells;
    block light_cuts_blocks[](surfaces: [Surface]) -> (blocks: [Block]) = presample::blocks;
    record light_cuts[](scene, lights: [u32], blocks: [Block]) -> (presampled: [LightRecord]) = presample::cuts;
    reservoir candidates[EMISSION_IMAGES ENVIRONMENT SPECULAR](scene, lights: [u32], surfaces: [Surface],
        bsdf_hits: [Reservoir], presampled: [LightRecord]) -> (fresh: [Reservoir]) = candidates::candidates;
    candidate resident[EMISSION_IMAGES ENVIRONMENT SPECULAR](scene, lights: [u32], surfaces: [Surface],
        bsdf_hits: [Reservoir], presampled: [LightRecord]) -> (resident: [Candidate]) = candidates::resident;
    reservoir candidates_by_inversion[](resident: [Candidate]) -> (fresh: [Reservoir]) = candidates::by_inversion;
    reservoir visibility[MASKS ENVIRONMENT INSTANCES](scene, rays, surfaces: [Surface],
        unseen: [Reservoir]) -> (visible: [Reservoir]) = visibility::visibility;
    reservoir temporal_rays[MASKS ENVIRONMENT INSTANCES](prev_frame, scene, rays, surfaces: [Surface],
        prev_surfaces: [Surface], fresh: [Reservoir], prev_reservoirs: [Reservoir]) -> (marked: [Reservoir])
        = temporal::rays;
    reservoir temporal[EMISSION_IMAGES ENVIRONMENT SPECULAR](prev_frame, scene, surfaces: [Surface],
        prev_surfaces: [Surface], fresh: [Reservoir], prev_reservoirs: [Reservoir])
        -> (merged: [Reservoir], gathered: [Vec4]) = temporal::temporal;
    reservoir temporal_any_form[](prev_frame, scene, surfaces: [Surface], prev_surfaces: [Surface],
        fresh: [Reservoir], prev_reservoirs: [Reservoir]) -> (merged: [Reservoir], gathered: [Vec4])
        = temporal::any_form;
    reservoir spatial_rays[MASKS ENVIRONMENT INSTANCES](scene, rays, surfaces: [Surface],
        merging: [Reservoir]) -> (marked: [Reservoir]) = spatial::rays;
    reservoir spatial[EMISSION_IMAGES ENVIRONMENT SPECULAR](scene, surfaces: [Surface], marked: [Reservoir],
        merging: [Reservoir]) -> (merged: [Reservoir], gathered: [Vec4]) = spatial::spatial;
    reservoir spatial_any_form[](scene, surfaces: [Surface], marked: [Reservoir], merging: [Reservoir])
        -> (merged: [Reservoir], gathered: [Vec4]) = spatial::any_form;
    pixel shade[EMISSION_IMAGES ENVIRONMENT SPECULAR](scene, surfaces: [Surface], emitted: [Vec4], visible: [Reservoir])
        -> (color: [Vec4]) = shade::shade;
    pixel shade_sum[](emitted: [Vec4], gathered: [Vec4]) -> (color: [Vec4]) = shade::shade_sum;
    pixel accumulate[](color: [Vec4], prev_moments: [Moments]) -> (moments: [Moments]) = accumulate::accumulate;
    pixel display_clip[](moments: [Moments]) -> (display: [u32]) = display::clip;
    pixel display_reinhard[](moments: [Moments]) -> (display: [u32]) = display::reinhard;
    pixel display_aces[](moments: [Moments]) -> (display: [u32]) = display::aces;
    pixel display_agx[](moments: [Moments]) -> (display: [u32]) = display::agx;
}

draws! {
    present(left: [u32], right: [u32]) = present::present;
}
