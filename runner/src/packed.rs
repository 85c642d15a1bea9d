//! Scenes packed for the passes: a few flat buffers, by the layouts of [`weir_shared::scene`].

mod changed;
mod closed_form;
mod content;
mod dynamics;
mod geometry;
mod light_cuts;
mod light_tree;
mod moment;
mod origin;
mod shape;
mod top_level;
mod tree;

use std::time::Duration;

use glam::{UVec4, Vec3};
use rayon::prelude::*;
use thiserror::Error;
use weir_shared::{
    alias, environment,
    frame::Frame,
    light::source,
    light_tree::NO_TREE,
    scene::{NO_TEXTURE, distant_record, material_record, texture_record},
};

use crate::{
    executor::{MeshRange, Placement, SceneBuffers},
    exit::{Exit, HasExit},
    scene::{DistantLight, Environment, Material, Scene},
    settings::Settings,
    skips::Rule,
};
pub use changed::Changed;
pub use content::Content;
use dynamics::{Capacity, Dynamics, MeshStart};
use geometry::PackedMesh;
pub use moment::{Moment, TreeUpdate};
use origin::Origin;
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
    #[error("the scene has {0} lights over all instances; light ids reach to 2147483647")]
    TooManyLights(u64),
    /// An instance that the scene does not have.
    #[error("a moment draws instance {0}, which the scene does not have, or with nothing to see, or draws it twice")]
    NoInstance(u32),
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
    /// Instances, attributes, directional lights, materials, texture headers, emitters.
    pub records: Vec<u32>,
    /// Images and the environment's radiance.
    pub texels: Vec<u32>,
    /// Nodes of all meshes, then of the top level.
    pub bvh: Vec<UVec4>,
    /// Alias tables, light trees, and trees for cuts if the scene is packed for them.
    pub lights: Vec<u32>,
    /// Everything of the frame uniform that the scene decides, at the present moment.
    pub frame: Frame,
    /// What the scene has.
    pub content: Content,
    /// World-space bounds at the packed moment: lower and upper corner.
    pub bounds: [Vec3; 2],
    /// Origin of the world space of buffers and passes in that of the scene: zero unless the scene is far from its own.
    pub origin: Vec3,
    /// What it has cost to build what lights are chosen by.
    pub light_costs: LightCosts,
    /// What becomes of the light tree at the next moment; `None`: nothing, as no candidate comes down it.
    pub tree_update: Option<TreeUpdate>,
    /// Whether what stands still is left as it is from one moment to the next.
    pub keeps_still: bool,
    origins: Origin,
    dynamics: Dynamics,
    meshes: Vec<MeshRange>,
}

/// What a scene is packed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PackOptions {
    /// Any instance may come, go, move and change, see [`PackedScene::advance`].
    pub dynamic: bool,
    /// Candidates may come down the light tree, see [`weir_shared::light_tree`].
    pub light_tree: bool,
    /// Candidates may come from cuts, see [`weir_shared::light_cuts`].
    pub light_cuts: bool,
    /// Where light has a closed form, it is not sampled, see [`weir_shared::closed_form`].
    pub closed_form: bool,
}

impl Default for PackOptions {
    /// All that sampling with the default settings may need, and no motion but the scene's own. Light is sampled everywhere.
    fn default() -> Self {
        Self { dynamic: false, light_tree: true, light_cuts: false, closed_form: false }
    }
}

impl PackOptions {
    /// What frames with these settings need.
    pub fn of(settings: &Settings) -> Self {
        Self {
            dynamic: false,
            light_tree: settings.needs_tree(),
            light_cuts: settings.source == source::CUTS,
            closed_form: settings.skips.is_on(Rule::ClosedForm),
        }
    }
}

/// What each structure to choose lights by has cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LightCosts {
    /// Alias tables.
    pub table: LightCost,
    /// Light trees.
    pub tree: LightCost,
    /// Trees for cuts.
    pub cuts: LightCost,
}

/// What a structure to choose lights by has cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LightCost {
    /// Time to build it for all meshes, as if one after the other.
    pub build: Duration,
    /// Time to build it over emitters for the present moment.
    pub update: Duration,
    /// Its memory.
    pub bytes: u64,
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

    fn distant(&mut self, light: &DistantLight) {
        let start = self.0.len();
        self.vector(-light.direction.normalize());
        self.vector(light.irradiance);
        debug_assert_eq!(self.0.len() - start, distant_record::WORDS as usize);
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
        Self::with(scene, &Moment { time_s, ..Moment::default() }, PackOptions::default())
    }

    /// Packs a scene of which any instance may come, go, move and change, see [`PackedScene::advance`].
    ///
    /// # Errors
    /// As [`PackedScene::new`].
    pub fn dynamic(scene: &Scene, moment: &Moment) -> Result<Self, PackError> {
        Self::with(scene, moment, PackOptions { dynamic: true, ..PackOptions::default() })
    }

    /// Packs a scene with these options.
    ///
    /// # Errors
    /// As [`PackedScene::new`].
    pub fn with(scene: &Scene, moment: &Moment, options: PackOptions) -> Result<Self, PackError> {
        let most = if options.light_cuts { light_tree::MOST_IN_TREES / 2 } else { light_tree::MOST_IN_TREES };
        Self::pack(scene, moment, options, most)
    }

    /// `most_in_trees`: emissive triangles that trees of meshes hold together at most.
    fn pack(scene: &Scene, moment: &Moment, options: PackOptions, most_in_trees: usize) -> Result<Self, PackError> {
        let (scene, origins) = Origin::moved(scene);
        let scene = scene.as_ref();
        let materials = &scene.materials;
        let emissive: Vec<usize> =
            scene.meshes.par_iter().map(|mesh| geometry::emissive_triangles(mesh, materials)).collect();
        let has_tree = light_tree::which_have_trees(&emissive, most_in_trees);
        let meshes: Vec<PackedMesh> = scene
            .meshes
            .par_iter()
            .zip(has_tree)
            .map(|(mesh, has)| PackedMesh::new(mesh, materials, has && options.light_tree, has && options.light_cuts))
            .collect();
        fit("records", meshes.iter().map(|m| m.attributes.len() as u64 + m.lights.len() as u64).sum())?;
        fit("triangles", meshes.iter().map(|m| m.triangles.len() as u64).sum())?;

        // What changes comes first, twice: for this frame and the one before.
        let capacity = Capacity::of(scene, &meshes, options)?;
        let mut records = Records(vec![0; 2 * capacity.record_words()]);
        let mut lights = vec![0; capacity.light_words()];
        let mut frame = Frame::default();

        // Meshes, one after the other in every buffer.
        let mut triangles = Vec::with_capacity(meshes.iter().map(|m| m.triangles.len()).sum());
        let mut bvh = Vec::with_capacity(meshes.iter().map(|m| m.nodes.len()).sum());
        let mut starts = Vec::with_capacity(meshes.len());
        let mut ranges = Vec::with_capacity(meshes.len());
        for mesh in &meshes {
            let table_at = lights.len() as u32;
            lights.extend_from_slice(&mesh.light_table);
            let mut append = |words: &Option<Vec<u32>>| {
                let at = lights.len() as u32;
                lights.extend(words.iter().flatten());
                if words.is_some() { at } else { NO_TREE }
            };
            let (light_tree_at, light_cuts_at) = (append(&mesh.light_tree), append(&mesh.light_cuts));
            starts.push(MeshStart {
                root: (bvh.len() / 5) as u32,
                first_triangle: (triangles.len() / 9) as u32,
                attributes_at: records.at(),
                flags: mesh.flags,
                light_list_at: records.at() + mesh.attributes.len() as u32,
                light_table_at: table_at,
                light_count: mesh.lights.len() as u32,
                light_tree_at,
                light_cuts_at,
                light_bounds: mesh.light_bounds,
                has_powers: has_powers(&mesh.light_table),
                shape: mesh.shape,
            });
            ranges.push(MeshRange {
                first: (triangles.len() / 9) as u32,
                count: if mesh.is_found { (mesh.triangles.len() / 9) as u32 } else { 0 },
                has_masks: mesh.has_masks,
            });
            bvh.extend_from_slice(&mesh.nodes);
            triangles.extend_from_slice(&mesh.triangles);
            records.0.extend_from_slice(&mesh.attributes);
            records.0.extend_from_slice(&mesh.lights);
        }

        frame.distant_at = records.at();
        scene.distant.iter().for_each(|light| records.distant(light));
        frame.materials_at = records.at();
        scene.materials.iter().for_each(|m| records.material(m));
        frame.textures_at = records.at();
        let mut texels: Vec<u32> = Vec::with_capacity(scene.textures.iter().map(|t| t.texels.len()).sum());
        for texture in &scene.textures {
            records.0.extend([texels.len() as u32, texture.width, texture.height, u32::from(texture.srgb)]);
            texels.extend_from_slice(&texture.texels);
        }
        debug_assert_eq!(texture_record::WORDS, 4);
        pack_environment(scene, &mut frame, &mut lights, &mut texels);
        fit("texels", texels.len() as u64)?;
        fit("lights", lights.len() as u64)?;
        fit("bvh", bvh.len() as u64 * 4)?;

        let bounds = meshes.iter().map(|m| m.bounds).collect::<Vec<_>>();
        let are_found = meshes.iter().map(|m| m.is_found).collect();
        let top = TopLevel::new(scene.instances.clone(), bounds, are_found, bvh.len());
        bvh.resize(bvh.len() + 2 * top.capacity_rows(), UVec4::ZERO);
        let has_lights = meshes.iter().any(|m| !m.lights.is_empty());
        let cost = |over_emitters: usize, of_mesh: fn(&PackedMesh) -> (Duration, usize)| LightCost {
            build: meshes.iter().map(|m| of_mesh(m).0).sum(),
            update: Duration::ZERO,
            bytes: 4 * (over_emitters + meshes.iter().map(|m| of_mesh(m).1).sum::<usize>()) as u64,
        };
        let light_costs = LightCosts {
            table: cost(capacity.table_words(), |m| (m.light_times.table, m.light_table.len())),
            tree: cost(capacity.tree_words(), |m| (m.light_times.tree, m.light_tree.as_ref().map_or(0, Vec::len))),
            cuts: cost(capacity.cuts_words(), |m| (m.light_times.cuts, m.light_cuts.as_ref().map_or(0, Vec::len))),
        };
        let mut packed = Self {
            triangles,
            records: records.0,
            texels,
            bvh,
            lights,
            frame,
            content: Content::default(),
            bounds: [Vec3::ZERO; 2],
            origin: origins.of_scene,
            light_costs,
            tree_update: Some(TreeUpdate::default()),
            keeps_still: true,
            origins,
            dynamics: Dynamics::new(top, starts, capacity, options.dynamic, has_lights),
            meshes: ranges,
        };
        packed.show(moment)?;
        packed.content = packed.content_of(scene);
        if options.closed_form && packed.content.may_have_closed_form() {
            packed.find_closed_forms(moment);
        }
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
        self.advance(&Moment { time_s, ..Moment::default() })
    }

    /// Turns the environment about the vertical, and multiplies its radiance; 0 switches it off. From the next frame on.
    pub fn turn_environment(&mut self, rotation_deg: f32, scale: f32) {
        (self.frame.environment_sin, self.frame.environment_cos) = rotation_deg.to_radians().sin_cos();
        self.frame.environment_scale = scale;
    }

    /// Length of the diagonal of the scene at the present moment, in scene units; 1 without any.
    pub fn diagonal(&self) -> f32 {
        let length = self.bounds[0].distance(self.bounds[1]);
        if length > 0.0 && length.is_finite() { length } else { 1.0 }
    }

    /// Whether anything moves over time.
    pub fn moves(&self) -> bool {
        self.dynamics.top.moves()
    }

    fn content_of(&self, scene: &Scene) -> Content {
        let Dynamics { top, capacity, is_dynamic, has_lights, .. } = &self.dynamics;
        Content {
            emitters: *has_lights,
            distant: environment::count(&self.frame) > 0,
            shapes: top.has_unfound(),
            powers: self.content.powers,
            instances: *is_dynamic || !top.is_trivial(),
            motion: *is_dynamic || top.moves(),
            light_tree: capacity.has_tree,
            light_cuts: capacity.has_cuts,
            lights: capacity.lights,
            ..Content::default()
        }
        .with_materials(scene)
    }

    /// The buffers, for an executor.
    pub fn buffers(&self) -> SceneBuffers<'_> {
        SceneBuffers {
            triangles: &self.triangles,
            records: &self.records,
            texels: &self.texels,
            bvh: &self.bvh,
            lights: &self.lights,
            placement: Placement {
                meshes: &self.meshes,
                blocks: self.dynamics.blocks,
                capacity: self.dynamics.capacity.instances as u32,
            },
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        SceneBuffers::NAMES.iter().map(|name| self.buffers().bytes(name).len() as u64).sum()
    }
}

/// Whether the items of an alias table differ in probability by more than rounding.
fn has_powers(table: &[u32]) -> bool {
    let entries = table.as_chunks::<{ alias::ENTRY_WORDS as usize }>().0;
    let probabilities = || entries.iter().map(|entry| f32::from_bits(entry[2]));
    let (low, high) = (probabilities().fold(f32::INFINITY, f32::min), probabilities().fold(0.0, f32::max));
    high > low * 1.001
}

fn fit(buffer: &'static str, words: u64) -> Result<(), PackError> {
    if words < 1 << 31 { Ok(()) } else { Err(PackError::TooLarge { buffer, words }) }
}

/// Radiance to `texels`, the table over texels and directional lights to `lights`. A black map is no environment.
fn pack_environment(scene: &Scene, frame: &mut Frame, lights: &mut Vec<u32>, texels: &mut Vec<u32>) {
    let shines = |map: &&Environment| map.scale > 0.0 && map.texels.as_flattened().iter().any(|&x| x > 0.0);
    let map = scene.environment.as_ref().filter(shines);
    let mut weights = map.map_or(Vec::new(), |map| environment::texel_weights(map.width, map.height, &map.texels));
    // Weights of texels are radiance times solid angle but for these factors; of directional lights, irradiance.
    let unit = map.map_or(1.0, |map| f64::from(map.width) / (std::f64::consts::TAU * f64::from(map.scale)));
    weights.extend(scene.distant.iter().map(|light| {
        let irradiance = light.irradiance.to_array().map(f64::from).iter().sum::<f64>();
        // Scales reach down to denormal numbers, and tables take finite weights.
        (irradiance * unit).min(1e60)
    }));
    let Some(table) = alias::build(&weights) else {
        frame.distant_at = frame.materials_at;
        return;
    };
    frame.environment_table_at = lights.len() as u32;
    lights.extend(table);
    let Some(map) = map else { return };
    frame.environment_texels_at = texels.len() as u32;
    texels.extend(map.texels.iter().flatten().map(|x| x.to_bits()));
    frame.environment_width = map.width;
    frame.environment_height = map.height;
    (frame.environment_sin, frame.environment_cos) = map.rotation_deg.to_radians().sin_cos();
    frame.environment_scale = map.scale;
}

#[cfg(test)]
mod tests;
