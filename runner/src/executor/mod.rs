//! Executors: they run the same plan, on the host's threads or on a GPU.

pub mod cpu;
mod either;
pub mod gpu;

pub use either::{Backend, Executor};

use bytemuck::Pod;

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
