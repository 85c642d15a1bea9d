//! The uniform of a frame: what is the same for every element of every pass.

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};
use glam::{UVec2, Vec3};

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
    /// 1: camera rays are uniform over the pixel; 0: through its center.
    pub jitter: u32,
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
    /// Emissive triangles over all instances.
    pub light_count: u32,

    /// Light samples drawn for a pixel and frame; environment included.
    pub candidates: u32,
    /// 1: lights are picked by power; 0: uniformly.
    pub pick_by_power: u32,
    /// Where the environment's alias table starts in `lights`.
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
    /// Not used.
    pub padding_y: u32,
    /// Not used.
    pub padding_z: u32,
    /// Not used.
    pub padding_w: u32,
}

const _: () = assert!(size_of::<Frame>() == 160 && offset_of!(Frame, environment_scale) == 144);

impl Frame {
    /// Row-major index of a pixel.
    #[inline(always)]
    pub fn index_of(&self, px: UVec2) -> u32 {
        px.y.wrapping_mul(self.width).wrapping_add(px.x)
    }
}
