//! One mesh: its acceleration structure, and everything else in the order of its leaves.

use std::time::{Duration, Instant};

use glam::{UVec4, Vec3};
use obvhs::aabb::Aabb;
use weir_shared::{
    alias, octahedral,
    scene::{NO_NORMAL, attribute_flags, shape},
};

use super::{
    light_cuts,
    light_tree::{self, LightBounds},
    shape::ShapeLight,
    tree,
};
use crate::scene::{Material, Mesh};

/// A mesh in the form of the scene buffers, with indices counted from its own start.
pub(super) struct PackedMesh {
    pub(super) nodes: Vec<UVec4>,
    pub(super) triangles: Vec<f32>,
    pub(super) attributes: Vec<u32>,
    pub(super) flags: u32,
    /// Triangles that emit.
    pub(super) lights: Vec<u32>,
    /// Alias table over them.
    pub(super) light_table: Vec<u32>,
    /// Light tree over them, if the mesh has one.
    pub(super) light_tree: Option<Vec<u32>>,
    /// Tree for cuts over them, if the mesh has one.
    pub(super) light_cuts: Option<Vec<u32>>,
    /// How long each took to build.
    pub(super) light_times: LightTimes,
    /// What is known of all of them; their power is the sum of the weights of the table.
    pub(super) light_bounds: LightBounds,
    /// Lower and upper corner, object space.
    pub(super) bounds: [Vec3; 2],
    /// What it is, if it has no triangles but is a shape.
    pub(super) shape: Option<ShapeLight>,
    /// Whether some of its triangles have alpha masks.
    pub(super) has_masks: bool,
    /// Whether rays find it.
    pub(super) is_found: bool,
}

/// How long it takes to build what lights are chosen by.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LightTimes {
    pub(super) table: Duration,
    pub(super) tree: Duration,
    pub(super) cuts: Duration,
}

impl PackedMesh {
    /// Packs a mesh, with a light tree if `has_light_tree`, with a tree for cuts if `has_light_cuts`.
    pub(super) fn new(mesh: &Mesh, materials: &[Material], has_light_tree: bool, has_light_cuts: bool) -> Self {
        if let Some(shape) = ShapeLight::new(mesh, materials) {
            return Self::of_shape(mesh.materials[0], shape);
        }
        let corners = |t: u32| mesh.triangles[t as usize].map(|v| mesh.positions[v as usize]);
        let boxes: Vec<Aabb> = (0..mesh.triangles.len() as u32)
            .map(|t| {
                let [a, b, c] = corners(t);
                Aabb::new(a.min(b).min(c).into(), a.max(b).max(c).into())
            })
            .collect();
        let tree = tree::build(&boxes, !mesh.unseen);
        let order = &tree.primitive_indices;

        let textured =
            |m: &Material| m.base_color_texture.is_some() || m.emission_texture.is_some() || m.alpha_texture.is_some();
        let mut flags = 0;
        if mesh.normals.iter().any(|&n| n != Vec3::ZERO) {
            flags |= attribute_flags::NORMALS;
        }
        if !mesh.uvs.is_empty() && mesh.materials.iter().any(|&m| textured(&materials[m as usize])) {
            flags |= attribute_flags::UVS;
        }
        if mesh.unseen {
            flags |= shape::UNSEEN << attribute_flags::SHAPE_SHIFT;
        }

        let is_masked = |m: &u32| materials[*m as usize].alpha_texture.is_some();
        let has_masks = flags & attribute_flags::UVS != 0 && mesh.materials.iter().any(is_masked);

        let mut triangles = Vec::with_capacity(order.len() * 9);
        let mut attributes = Vec::new();
        let (mut lights, mut weights, mut light_bounds) = (Vec::new(), Vec::new(), Vec::new());
        let mut bounds = [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)];
        for (local, &t) in order.iter().enumerate() {
            let [a, b, c] = corners(t);
            for p in [a, b, c] {
                triangles.extend(p.to_array());
                bounds = [bounds[0].min(p), bounds[1].max(p)];
            }
            let vertices = mesh.triangles[t as usize];
            attributes.push(mesh.materials[t as usize]);
            if flags & attribute_flags::NORMALS != 0 {
                attributes.extend(vertices.map(|v| {
                    let normal = mesh.normals[v as usize].normalize_or_zero();
                    if normal == Vec3::ZERO { NO_NORMAL } else { octahedral::pack(normal) }
                }));
            }
            if flags & attribute_flags::UVS != 0 {
                attributes.extend(vertices.iter().flat_map(|&v| mesh.uvs[v as usize].to_array().map(f32::to_bits)));
            }
            let material = &materials[mesh.materials[t as usize] as usize];
            let weight = emitted_weight(material, a, b, c);
            if weight > 0.0 {
                lights.push(local as u32);
                weights.push(weight);
                light_bounds.push(LightBounds::triangle([a, b, c], material.two_sided_emission, weight));
            }
        }
        let start = Instant::now();
        let light_table = alias::build(&weights).unwrap_or_default();
        let table = start.elapsed();
        let light_cuts = has_light_cuts.then(|| light_cuts::build(&light_bounds));
        let cuts = start.elapsed() - table;
        let (light_tree, light_bounds) = if has_light_tree {
            let (words, bounds) = light_tree::build(&light_bounds);
            (Some(words), bounds)
        } else {
            (None, light_tree::bounds_of(&light_bounds))
        };
        let light_times = LightTimes { table, tree: start.elapsed() - table - cuts, cuts };
        Self {
            // What no ray finds has only its order from the tree: what is near in space is near in memory.
            nodes: if mesh.unseen { Vec::new() } else { tree.nodes.iter().flat_map(tree::rows).collect() },
            triangles,
            attributes,
            flags,
            lights,
            light_table,
            light_tree,
            light_cuts,
            light_times,
            light_bounds,
            bounds,
            shape: None,
            has_masks,
            is_found: !mesh.unseen,
        }
    }

    /// A shape: one light if it emits, with its material and falloff for attributes.
    fn of_shape(material: u32, shape: ShapeLight) -> Self {
        let lights = if shape.emits() { vec![0] } else { Vec::new() };
        let [scale, offset] = shape.falloff().map(f32::to_bits);
        Self {
            nodes: Vec::new(),
            triangles: Vec::new(),
            attributes: vec![material, scale, offset],
            flags: shape.kind() << attribute_flags::SHAPE_SHIFT,
            light_table: if lights.is_empty() { Vec::new() } else { alias::build(&[1.0]).unwrap_or_default() },
            lights,
            light_tree: None,
            light_cuts: None,
            light_times: LightTimes::default(),
            light_bounds: LightBounds::NONE,
            bounds: [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)],
            shape: Some(shape),
            has_masks: false,
            is_found: false,
        }
    }
}

/// How many triangles of a mesh emit, those without area counted too.
pub(super) fn emissive_triangles(mesh: &Mesh, materials: &[Material]) -> usize {
    mesh.materials.iter().filter(|&&m| materials[m as usize].emission.max_element() > 0.0).count()
}

/// Area times the sum of the radiance's channels. In f64: areas and radiances both range over twenty decades.
fn emitted_weight(material: &Material, a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let radiance = material.emission.to_array().map(f64::from).iter().sum::<f64>();
    if radiance <= 0.0 {
        return 0.0;
    }
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    let sides = if material.two_sided_emission { 2.0 } else { 1.0 };
    sides * radiance * 0.5 * (b - a).cross(c - a).length()
}
