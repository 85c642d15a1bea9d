//! Scenes packed for the passes: a few flat buffers, by the layouts of [`weir_shared::scene`].

mod geometry;
mod top_level;
mod tree;

use std::ops::Range;

use glam::{Mat4, UVec4, Vec3};
use rayon::prelude::*;
use thiserror::Error;
use weir_shader::wiring::Feature;
use weir_shared::{
    alias, environment,
    frame::Frame,
    scene::{NO_TEXTURE, attribute_flags, emitter_record, instance_record, material_record, texture_record},
};

use crate::{
    executor::SceneBuffers,
    exit::{Exit, HasExit},
    graph::Need,
    scene::{Environment, Material, Scene},
};
use geometry::PackedMesh;
use top_level::TopLevel;

/// A scene that does not fit the buffers.
#[derive(Debug, Error)]
pub enum PackError {
    /// More words than 32-bit indices reach.
    #[error(
        "the scene needs {words} words of `{buffer}`, more than 32-bit indices reach; split it or use fewer triangles"
    )]
    TooLarge {
        /// The buffer.
        buffer: &'static str,
        /// Its words.
        words: u64,
    },
    /// More lights than ids.
    #[error("the scene has {0} emissive triangles over all instances; light ids reach to 2147483647")]
    TooManyLights(u64),
    /// A transform without an inverse.
    #[error(
        "instance {instance} has a transform without an inverse at {time_s} s; give it a scale above zero in every direction"
    )]
    Singular {
        /// The instance.
        instance: usize,
        /// When.
        time_s: f32,
    },
}

impl HasExit for PackError {
    fn exit(&self) -> Exit {
        Exit::BadData
    }
}

/// A scene in the form that both executors read, at one moment.
pub struct PackedScene {
    /// Vertices, nine floats a triangle.
    pub triangles: Vec<f32>,
    /// Instances, attributes, materials, texture headers, emitters.
    pub records: Vec<u32>,
    /// Images and the environment's radiance.
    pub texels: Vec<u32>,
    /// Nodes of all meshes, then of the top level.
    pub bvh: Vec<UVec4>,
    /// Alias tables.
    pub lights: Vec<u32>,
    /// Everything of the frame uniform that the scene decides.
    pub frame: Frame,
    /// Features that choose variants of passes.
    pub features: Vec<Feature>,
    /// World-space bounds at the packed moment: lower and upper corner.
    pub bounds: [Vec3; 2],
    top: TopLevel,
}

/// A part of a scene buffer that has changed, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changed {
    /// The buffer.
    pub buffer: &'static str,
    /// Bytes.
    pub range: Range<usize>,
}

/// The records of the scene while they grow.
struct Records(Vec<u32>);

impl Records {
    fn at(&self) -> u32 {
        self.0.len() as u32
    }

    fn float(&mut self, x: f32) {
        self.0.push(x.to_bits());
    }

    fn vector(&mut self, v: Vec3) {
        v.to_array().into_iter().for_each(|x| self.float(x));
    }

    fn material(&mut self, m: &Material) {
        let start = self.0.len();
        let texture = |t: Option<u32>| t.unwrap_or(NO_TEXTURE);
        self.vector(m.base_color);
        self.float(m.roughness);
        self.vector(m.specular);
        self.float(m.metallic);
        self.vector(m.emission);
        self.0.push(u32::from(m.two_sided_emission));
        self.0.extend([texture(m.base_color_texture), texture(m.emission_texture), texture(m.alpha_texture), 0]);
        debug_assert_eq!(self.0.len() - start, material_record::WORDS as usize);
    }
}

impl PackedScene {
    /// Packs a scene at `time_s` seconds. The scene must satisfy its own validation.
    ///
    /// # Errors
    /// If it does not fit, see [`PackError`].
    pub fn new(scene: &Scene, time_s: f32) -> Result<Self, PackError> {
        let meshes: Vec<PackedMesh> =
            scene.meshes.par_iter().map(|mesh| PackedMesh::new(mesh, &scene.materials)).collect();
        fit("records", meshes.iter().map(|m| m.attributes.len() as u64 + m.lights.len() as u64).sum())?;
        fit("triangles", meshes.iter().map(|m| m.triangles.len() as u64).sum())?;

        // Meshes, one after the other in every buffer.
        let mut records = Records(Vec::new());
        let mut triangles = Vec::with_capacity(meshes.iter().map(|m| m.triangles.len()).sum());
        let mut bvh = Vec::with_capacity(meshes.iter().map(|m| m.nodes.len()).sum());
        let mut starts = Vec::with_capacity(meshes.len());
        let mut frame = Frame { instances_at: 0, ..Frame::default() };

        // Instances come first: they are what changes.
        let drawn: Vec<usize> = (0..scene.instances.len())
            .filter(|&i| !meshes[scene.instances[i].mesh as usize].triangles.is_empty())
            .collect();
        records.0.resize(drawn.len() * instance_record::WORDS as usize, 0);
        frame.instance_count = drawn.len() as u32;
        frame.top_order_at = records.at();
        records.0.extend(0..drawn.len() as u32);

        let emitting: Vec<usize> =
            (0..drawn.len()).filter(|&i| !meshes[scene.instances[drawn[i]].mesh as usize].lights.is_empty()).collect();
        let mut weights: Vec<f64> = emitting
            .iter()
            .map(|&i| {
                let instance = &scene.instances[drawn[i]];
                let volume = f64::from(instance.world_from_object.determinant().abs());
                meshes[instance.mesh as usize].power * volume.powf(2.0 / 3.0)
            })
            .collect();
        if !weights.iter().any(|&w| w > 0.0) {
            weights.fill(1.0);
        }
        let mut lights = alias::build(&weights).unwrap_or_default();
        for mesh in &meshes {
            starts.push(MeshStart {
                root: (bvh.len() / 5) as u32,
                first_triangle: (triangles.len() / 9) as u32,
                attributes_at: records.at(),
                light_list_at: records.at() + mesh.attributes.len() as u32,
                light_table_at: lights.len() as u32,
            });
            bvh.extend_from_slice(&mesh.nodes);
            triangles.extend_from_slice(&mesh.triangles);
            records.0.extend_from_slice(&mesh.attributes);
            records.0.extend_from_slice(&mesh.lights);
            lights.extend_from_slice(&mesh.light_table);
        }

        // Emitters, in the order of their lights.
        frame.emitters_at = records.at();
        frame.emitter_count = emitting.len() as u32;
        let mut first_lights = vec![0; drawn.len()];
        let mut light_count = 0u64;
        for &i in &emitting {
            first_lights[i] = light_count as u32;
            records.0.extend([light_count as u32, i as u32]);
            light_count += meshes[scene.instances[drawn[i]].mesh as usize].lights.len() as u64;
            if light_count > u64::from(weir_shared::light::ENVIRONMENT_BIT - 1) {
                return Err(PackError::TooManyLights(light_count));
            }
        }
        debug_assert_eq!(emitter_record::WORDS, 2);
        frame.light_count = light_count as u32;

        frame.materials_at = records.at();
        scene.materials.iter().for_each(|m| records.material(m));
        frame.textures_at = records.at();
        let mut texels: Vec<u32> = Vec::with_capacity(scene.textures.iter().map(|t| t.texels.len()).sum());
        for texture in &scene.textures {
            records.0.extend([texels.len() as u32, texture.width, texture.height, u32::from(texture.srgb)]);
            texels.extend_from_slice(&texture.texels);
        }
        debug_assert_eq!(texture_record::WORDS, 4);
        if let Some(map) = &scene.environment {
            pack_environment(map, &mut frame, &mut lights, &mut texels);
        }
        fit("texels", texels.len() as u64)?;
        fit("lights", lights.len() as u64)?;
        fit("bvh", bvh.len() as u64 * 4)?;

        for (slot, &i) in drawn.iter().enumerate() {
            let mesh = scene.instances[i].mesh as usize;
            let at = slot * instance_record::WORDS as usize + instance_record::ROOT as usize;
            let start = &starts[mesh];
            records.0[at..at + 8].copy_from_slice(&[
                start.root,
                start.first_triangle,
                start.attributes_at,
                meshes[mesh].flags,
                start.light_list_at,
                start.light_table_at,
                meshes[mesh].lights.len() as u32,
                first_lights[slot],
            ]);
        }

        let top = TopLevel::new(
            drawn
                .iter()
                .map(|&i| (scene.instances[i].clone(), meshes[scene.instances[i].mesh as usize].bounds))
                .collect(),
            bvh.len(),
        );
        let mut packed = Self {
            triangles,
            records: records.0,
            texels,
            bvh,
            lights,
            frame,
            features: Vec::new(),
            bounds: [Vec3::ZERO; 2],
            top,
        };
        packed.place_instances(time_s)?;
        packed.features = packed.find_features(scene);
        // wgpu and the kernels want no empty buffers.
        packed.triangles.resize(packed.triangles.len().max(9), 0.0);
        packed.texels.resize(packed.texels.len().max(4), 0);
        packed.lights.resize(packed.lights.len().max(4), 0);
        Ok(packed)
    }

    /// Moves the scene to `time_s` seconds; returns what has changed, nothing if nothing moves.
    ///
    /// # Errors
    /// If a transform has no inverse then.
    pub fn set_time(&mut self, time_s: f32) -> Result<Vec<Changed>, PackError> {
        if !self.top.moves() {
            return Ok(Vec::new());
        }
        self.place_instances(time_s)?;
        let words = self.frame.instance_count as usize * (instance_record::WORDS as usize + 1);
        let first_node = self.top.first_row * 16;
        Ok(vec![
            Changed { buffer: "records", range: 0..words * 4 },
            Changed { buffer: "bvh", range: first_node..self.bvh.len() * 16 },
        ])
    }

    /// Whether anything moves over time.
    pub fn moves(&self) -> bool {
        self.top.moves()
    }

    fn place_instances(&mut self, time_s: f32) -> Result<(), PackError> {
        let placed = self.top.place(time_s)?;
        for (slot, (world_from_object, object_from_world)) in placed.transforms.iter().enumerate() {
            let at = slot * instance_record::WORDS as usize;
            write_rows(&mut self.records[at..at + 12], world_from_object);
            write_rows(&mut self.records[at + 12..at + 24], object_from_world);
            let flags = &mut self.records[at + instance_record::FLAGS as usize];
            *flags &= !attribute_flags::MIRRORED;
            if world_from_object.determinant() < 0.0 {
                *flags |= attribute_flags::MIRRORED;
            }
        }
        let order_at = self.frame.top_order_at as usize;
        self.records[order_at..order_at + placed.order.len()].copy_from_slice(&placed.order);
        self.frame.top_root = (self.top.first_row / 5) as u32;
        self.bvh.resize(self.top.first_row + self.top.capacity_rows(), UVec4::ZERO);
        self.bvh[self.top.first_row..self.top.first_row + placed.nodes.len()].copy_from_slice(&placed.nodes);
        self.bounds = placed.bounds;
        Ok(())
    }

    fn find_features(&self, scene: &Scene) -> Vec<Feature> {
        let mut features = Vec::new();
        let textured =
            |m: &Material| m.base_color_texture.is_some() || m.emission_texture.is_some() || m.alpha_texture.is_some();
        if scene.materials.iter().any(textured) {
            features.push(Feature::TEXTURES);
        }
        if self.frame.environment_width > 0 {
            features.push(Feature::ENVIRONMENT);
        }
        if !self.top.is_trivial() {
            features.push(Feature::INSTANCES);
        }
        if scene.materials.iter().any(|m| m.metallic > 0.0 || m.specular != Vec3::ZERO) {
            features.push(Feature::SPECULAR);
        }
        features
    }

    /// What the scene has of what steps may need.
    pub fn has(&self) -> Vec<Need> {
        if self.frame.light_count > 0 || self.frame.environment_width > 0 { vec![Need::Lights] } else { Vec::new() }
    }

    /// The buffers, for an executor.
    pub fn buffers(&self) -> SceneBuffers<'_> {
        SceneBuffers {
            triangles: &self.triangles,
            records: &self.records,
            texels: &self.texels,
            bvh: &self.bvh,
            lights: &self.lights,
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        SceneBuffers::NAMES.iter().map(|name| self.buffers().bytes(name).len() as u64).sum()
    }
}

/// Where a mesh starts in each buffer.
struct MeshStart {
    root: u32,
    first_triangle: u32,
    attributes_at: u32,
    light_list_at: u32,
    light_table_at: u32,
}

fn fit(buffer: &'static str, words: u64) -> Result<(), PackError> {
    if words < 1 << 31 { Ok(()) } else { Err(PackError::TooLarge { buffer, words }) }
}

/// The upper three rows of an affine matrix.
fn write_rows(words: &mut [u32], matrix: &Mat4) {
    for (row, words) in words.chunks_exact_mut(4).enumerate() {
        for (word, x) in words.iter_mut().zip(matrix.row(row).to_array()) {
            *word = x.to_bits();
        }
    }
}

/// Radiance to `texels`, the table over texels to `lights`. A black map is no environment.
fn pack_environment(map: &Environment, frame: &mut Frame, lights: &mut Vec<u32>, texels: &mut Vec<u32>) {
    let weights = environment::texel_weights(map.width, map.height, &map.texels);
    let Some(table) = alias::build(&weights).filter(|_| map.scale > 0.0) else { return };
    frame.environment_table_at = lights.len() as u32;
    lights.extend(table);
    frame.environment_texels_at = texels.len() as u32;
    texels.extend(map.texels.iter().flatten().map(|x| x.to_bits()));
    frame.environment_width = map.width;
    frame.environment_height = map.height;
    let (sin, cos) = map.rotation_deg.to_radians().sin_cos();
    (frame.environment_sin, frame.environment_cos) = (sin, cos);
    frame.environment_scale = map.scale;
}

#[cfg(test)]
mod tests;
