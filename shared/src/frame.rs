//! The uniform of a frame: what is the same for every element of every pass.

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};
use glam::{UVec2, Vec3};

use crate::tiles;

/// Rules by which passes leave out work that cannot change what they compute or, by [`skip::FEW_LIGHTS`] and
/// [`skip::HORIZON`], its mean; bits of [`Frame::not_skipped`].
pub mod skip {
    /// Lights are drawn even where each could be a candidate.
    pub const FEW_LIGHTS: u32 = 1;
    /// A shadow ray is traced again for a sample that is known to be visible.
    pub const KNOWN_VISIBLE: u32 = 2;
    /// Candidates are evaluated at surfaces that reflect nothing.
    pub const BLACK: u32 = 4;
    /// Shadow rays ask for lights that cannot light the surface that they start from.
    pub const UNLIT: u32 = 8;
    /// Cuts hold lights that no surface of their block sees above its horizon.
    pub const HORIZON: u32 = 16;
}

/// Binding 0 of every pass.
///
/// Offsets into `records`, `lights` and `texels` count words from the start of the buffer. Vectors start at multiples
/// of 16 bytes and there are no arrays: what Vulkan asks of a uniform.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frame number, the key of the random numbers.
    pub index: u32,
    /// The user's seed.
    pub seed: u32,

    /// Camera position, in scene units.
    pub camera_origin: Vec3,
    /// Frames accumulated before this one; 0 restarts the running mean.
    pub accumulated: u32,
    /// To the right edge of the image plane at distance 1.
    pub camera_right: Vec3,
    /// Camera rays of a pixel: 0, one through its center; else such that are uniform over it. The lower 16 bits say how many
    /// where what needs no sampling differs between neighbours, the upper 16 bits how many where nothing is known of that.
    pub camera_rays: u32,
    /// To the upper edge of the image plane at distance 1.
    pub camera_up: Vec3,
    /// Multiplies radiance before tone mapping.
    pub exposure: f32,
    /// View direction, of length 1.
    pub camera_forward: Vec3,
    /// Node of the top level's root in `bvh`.
    pub top_root: u32,

    /// Instances in the scene.
    pub instance_count: u32,
    /// Where the top level's order of instances starts in `records`.
    pub top_order_at: u32,
    /// Where the instances start in `records`.
    pub instances_at: u32,
    /// Where the materials start in `records`.
    pub materials_at: u32,

    /// Where the texture headers start in `records`.
    pub textures_at: u32,
    /// Where the list of emitters (instances that emit) starts in `records`.
    pub emitters_at: u32,
    /// Instances that emit.
    pub emitter_count: u32,
    /// Lights over all instances: emissive triangles, and one of each shape that emits.
    pub light_count: u32,

    /// Light samples drawn for a pixel and frame; environment and directional lights included.
    pub candidates: u32,
    /// Where light samples on emissive triangles and shapes are drawn from, see [`crate::light::source`].
    pub source: u32,
    /// Where the alias table over the environment's texels and the directional lights behind them starts in `lights`.
    pub environment_table_at: u32,
    /// Where the environment's radiance starts in `texels`.
    pub environment_texels_at: u32,

    /// Texels in a row of the environment; 0 without one.
    pub environment_width: u32,
    /// Rows of the environment.
    pub environment_height: u32,
    /// Cosine of the environment's turn about +y.
    pub environment_cos: f32,
    /// Sine of the environment's turn about +y.
    pub environment_sin: f32,

    /// Multiplies the environment's radiance.
    pub environment_scale: f32,
    /// Reservoirs of each pixel.
    pub reservoirs: u32,
    /// Which round of spatial reuse this is, from 0.
    pub round: u32,
    /// How an item of a stream is chosen, see [`crate::resample::choice`].
    pub choice: u32,

    /// Directions drawn from the BSDF, beside [`Frame::candidates`].
    pub candidates_bsdf: u32,
    /// Groups that candidates are ranked in by a cheap target before one of each meets the full target; 0: all do.
    pub candidates_full: u32,
    /// Weights of merging, see [`crate::merge::form`].
    pub mis_form: u32,
    /// 1: the frame before this one may be reused.
    pub has_history: u32,

    /// Neighbours of the pixel in the frame before, beside the pixel itself.
    pub temporal_neighbors: u32,
    /// The same where the pixel itself was not seen in the frame before.
    pub temporal_neighbors_unseen: u32,
    /// Neighbours in a round of spatial reuse.
    pub spatial_neighbors: u32,
    /// The same where the pixel was not seen in the frame before.
    pub spatial_neighbors_unseen: u32,

    /// Largest confidence that the frame before is trusted with, in units of the pixel's own.
    pub confidence_cap: u32,
    /// How neighbours are found, see [`crate::reuse::rule`].
    pub neighbor_rule: u32,
    /// How far away neighbours may be.
    pub radius_px: f32,
    /// Smallest cosine between the normals of neighbours.
    pub normal_cosine: f32,

    /// How far a neighbour may lie off the tangent plane, as a share of the distance to the camera.
    pub plane_tolerance: f32,
    /// How much the roughness of neighbours may differ.
    pub roughness_tolerance: f32,
    /// What part shadow rays have in reuse, see [`crate::reuse::probe`].
    pub probe: u32,
    /// Which pixels have reservoirs of full quality, see [`crate::reuse::lattice`].
    pub lattice: u32,

    /// Reach of occlusion in the target: pixels on the screen for `SCREEN`, see [`crate::target::occlusion`].
    pub occlusion_reach: f32,
    /// Approximate occlusion in the target, see [`crate::target::occlusion`].
    pub occlusion: u32,
    /// Candidates of pixels that are not on the lattice.
    pub candidates_off_lattice: u32,
    /// Candidates among [`Frame::candidates`] that come down the light tree; one at least is left to
    /// [`Frame::source`], which may be the tree as well.
    pub candidates_tree: u32,

    /// Where the guide to emitters starts in `records`, see [`crate::light::address_of`].
    pub light_guide_at: u32,
    /// Lights of a bucket of that guide, as a power of two.
    pub light_guide_shift: u32,
    /// Where the directional lights start in `records`; they end where the materials start.
    pub distant_at: u32,
    /// Where the light tree over emitters starts in `lights`.
    pub light_tree_at: u32,

    /// Records in a row of lights drawn ahead, see [`crate::presample`]; for tiles a power of two.
    pub presampled_columns: u32,
    /// Rows of such records: tiles or cells.
    pub presampled_rows: u32,
    /// Edge of the smallest cells, in scene units.
    pub cell_size: f32,
    /// Lights that are drawn for each record of a cell.
    pub cell_candidates: u32,

    /// Where the tree for cuts over emitters starts in `lights`.
    pub light_cuts_at: u32,
    /// Rules that leave work out and are off, as bits, see [`skip`].
    pub not_skipped: u32,
    /// Changes whenever something that rays find may have moved, or emit otherwise, since the frame before.
    pub found_moment: u32,
    /// Which of the two blocks of the scene's buffers holds what the frame shows: 0 or 1.
    pub block: u32,
}

const _: () = assert!(size_of::<Frame>() == 288 && offset_of!(Frame, environment_scale) == 144);

/// The uniform of a step: the frame, and the one before it.
///
/// Whatever is asked of the frame before (its camera, its instances, its lights, its acceleration structure) is asked
/// of [`FramePair::prev`] by the same functions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FramePair {
    /// The frame that is computed.
    pub now: Frame,
    /// The frame before it; the same as `now` where there is none.
    pub prev: Frame,
}

const _: () = assert!(size_of::<FramePair>() == 576 && offset_of!(FramePair, prev) == 288);

impl FramePair {
    /// What the scene is asked by (instances, lights, acceleration structure, environment) in this frame or in that
    /// before it; nothing else of the frame is there. By value, so that one body of code can serve both.
    #[inline(always)]
    pub fn moment(now: &Frame, prev: &Frame, past: bool) -> Frame {
        Frame {
            block: if past { prev.block } else { now.block },
            top_root: if past { prev.top_root } else { now.top_root },
            instance_count: if past { prev.instance_count } else { now.instance_count },
            top_order_at: if past { prev.top_order_at } else { now.top_order_at },
            instances_at: if past { prev.instances_at } else { now.instances_at },
            emitters_at: if past { prev.emitters_at } else { now.emitters_at },
            emitter_count: if past { prev.emitter_count } else { now.emitter_count },
            light_count: if past { prev.light_count } else { now.light_count },
            light_guide_at: if past { prev.light_guide_at } else { now.light_guide_at },
            light_guide_shift: if past { prev.light_guide_shift } else { now.light_guide_shift },
            environment_cos: if past { prev.environment_cos } else { now.environment_cos },
            environment_sin: if past { prev.environment_sin } else { now.environment_sin },
            environment_scale: if past { prev.environment_scale } else { now.environment_scale },
            materials_at: now.materials_at,
            distant_at: now.distant_at,
            textures_at: now.textures_at,
            environment_texels_at: now.environment_texels_at,
            environment_width: now.environment_width,
            environment_height: now.environment_height,
            ..Frame::default()
        }
    }
}

impl Frame {
    /// Whether a rule of [`skip`] leaves work out.
    #[inline(always)]
    pub fn skips(&self, rule: u32) -> bool {
        self.not_skipped & rule == 0
    }

    /// Whether camera rays are uniform over the pixel.
    #[inline(always)]
    pub fn is_jittered(&self) -> bool {
        self.camera_rays != 0
    }

    /// Row-major index of a pixel.
    #[inline(always)]
    pub fn index_of(&self, px: UVec2) -> u32 {
        px.y.wrapping_mul(self.width).wrapping_add(px.x)
    }

    /// Row-major index of a block of 8x8 pixels: its column and its row.
    #[inline(always)]
    pub fn index_of_block(&self, block: UVec2) -> u32 {
        block.y.wrapping_mul(tiles::blocks(self.width)).wrapping_add(block.x)
    }

    /// Row-major index of a record of lights drawn ahead: its column and its row.
    #[inline(always)]
    pub fn index_of_record(&self, at: UVec2) -> u32 {
        at.y.wrapping_mul(self.presampled_columns).wrapping_add(at.x)
    }

    /// Most candidates that a reservoir can have; so many places it has where candidates stay in memory.
    #[inline(always)]
    pub fn candidates_in_memory(&self) -> u32 {
        // One for triangles and one for the environment at least.
        self.candidates.max(self.candidates_off_lattice).max(2) + self.candidates_bsdf
    }

    /// Index of one of the candidates of a pixel: as of its reservoirs.
    #[inline(always)]
    pub fn index_of_candidate(&self, px: UVec2, number: u32) -> u32 {
        let of_pixel = self.reservoirs.wrapping_mul(self.candidates_in_memory());
        px.y.wrapping_mul(of_pixel).wrapping_add(number).wrapping_mul(self.width).wrapping_add(px.x)
    }

    /// Index of one of the reservoirs of a pixel: rows of pixels stay together.
    #[inline(always)]
    pub fn index_of_reservoir(&self, px: UVec2, reservoir: u32) -> u32 {
        px.y.wrapping_mul(self.reservoirs).wrapping_add(reservoir).wrapping_mul(self.width).wrapping_add(px.x)
    }
}
