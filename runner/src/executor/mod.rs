//! Executors: they run the same plan, on the host's threads or on a GPU.

pub mod cpu;
mod either;
pub mod gpu;

pub use either::{Backend, Executor};

use bytemuck::Pod;
use weir_shared::frame::{Frame, FramePair};

/// What the camera of an executor's frames has seen.
#[derive(Clone, Copy, Debug, Default)]
pub struct View {
    last: Option<Frame>,
    /// How many frames before the last have seen the same as it.
    same: u32,
}

impl View {
    /// Takes note of the next frame; whether it sees what both frames before it have seen, so that both halves of a doubled
    /// buffer hold what its camera rays would find.
    pub fn is_kept(&mut self, now: &Frame) -> bool {
        let is_same = self.last.is_some_and(|last| sees_the_same(&last, now));
        self.same = if is_same { self.same.saturating_add(1) } else { 0 };
        self.last = Some(*now);
        self.same >= 2
    }
}

/// Whether camera rays find the same in two frames of one scene: those through the centers of pixels, from the same place,
/// of what has not moved since.
fn sees_the_same(a: &Frame, b: &Frame) -> bool {
    if a.is_jittered() || b.is_jittered() {
        return false;
    }
    let seen = |frame: &Frame| Frame {
        width: frame.width,
        height: frame.height,
        camera_origin: frame.camera_origin,
        camera_right: frame.camera_right,
        camera_up: frame.camera_up,
        camera_forward: frame.camera_forward,
        found_moment: frame.found_moment,
        environment_cos: frame.environment_cos,
        environment_sin: frame.environment_sin,
        environment_scale: frame.environment_scale,
        ..Frame::default()
    };
    bytemuck::bytes_of(&seen(a)) == bytemuck::bytes_of(&seen(b))
}

/// The buffers of a scene, by the names of the resource table.
#[derive(Clone, Copy)]
pub struct SceneBuffers<'a> {
    /// Vertices.
    pub triangles: &'a [f32],
    /// Instances, attributes, materials, texture headers, emitters.
    pub records: &'a [u32],
    /// Images and the environment's radiance.
    pub texels: &'a [u32],
    /// Nodes.
    pub bvh: &'a [glam::UVec4],
    /// Alias tables.
    pub lights: &'a [u32],
    /// Where meshes and instances are in them.
    pub placement: Placement<'a>,
}

/// Where meshes and instances are in a scene's buffers: what a driver's acceleration structures are made of.
#[derive(Clone, Copy)]
pub struct Placement<'a> {
    /// Meshes; those that no ray finds have no triangles here.
    pub meshes: &'a [MeshRange],
    /// Of each block: where its instances start in `records`, and how many there are.
    pub blocks: [[u32; 2]; 2],
    /// Most instances that a block has at any moment.
    pub capacity: u32,
}

/// The triangles of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshRange {
    /// Number of the first.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Whether some have alpha masks.
    pub has_masks: bool,
}

impl Placement<'_> {
    /// The blocks as a frame and the one before it show them.
    pub fn blocks_of(frames: &FramePair) -> [[u32; 2]; 2] {
        let mut blocks = [[0; 2]; 2];
        for frame in [&frames.prev, &frames.now] {
            blocks[frame.block as usize & 1] = [frame.instances_at, frame.instance_count];
        }
        blocks
    }
}

impl<'a> SceneBuffers<'a> {
    /// The bytes of the buffer called `name`.
    ///
    /// # Panics
    /// If there is none of that name: the resource table lists those there are.
    pub fn bytes(&self, name: &str) -> &'a [u8] {
        match name {
            "triangles" => bytemuck::cast_slice(self.triangles),
            "records" => bytemuck::cast_slice(self.records),
            "texels" => bytemuck::cast_slice(self.texels),
            "bvh" => bytemuck::cast_slice(self.bvh),
            "lights" => bytemuck::cast_slice(self.lights),
            _ => panic!("`{name}` is not a buffer of the scene"),
        }
    }

    /// Names of the buffers.
    pub const NAMES: [&'static str; 5] = ["triangles", "records", "texels", "bvh", "lights"];
}

/// A buffer that is aligned for every element type.
#[derive(Clone, Default)]
pub struct AlignedBytes {
    rows: Vec<glam::UVec4>,
    len: usize,
}

impl AlignedBytes {
    /// `len` zero bytes.
    pub fn zeroed(len: usize) -> Self {
        Self { rows: vec![glam::UVec4::ZERO; len.div_ceil(16)], len }
    }

    /// A copy of `bytes`.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut copy = Self::zeroed(bytes.len());
        copy.bytes_mut().copy_from_slice(bytes);
        copy
    }

    /// Cuts off what is beyond `len` bytes.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
        self.rows.truncate(self.len.div_ceil(16));
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.rows)[..self.len]
    }

    /// All bytes.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.rows)[..self.len]
    }

    /// As elements.
    pub fn elements<T: Pod>(&self) -> &[T] {
        bytemuck::cast_slice(self.bytes())
    }
}
