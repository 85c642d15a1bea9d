//! One mesh: its acceleration structure, and everything else in the order of its leaves.

use std::time::Duration;

use glam::{UVec4, Vec3};
use obvhs::{
    BvhBuildParams,
    cwbvh::{CwBvh, builder::build_cwbvh_from_tris, node::CwBvhNode},
    triangle::Triangle,
};
use weir_shared::{
    alias,
    bvh::MAX_DEPTH,
    octahedral,
    scene::{NO_NORMAL, attribute_flags},
};

use super::PackError;
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
    /// Sum of the weights of that table.
    pub(super) power: f64,
    /// Lower and upper corner, object space.
    pub(super) bounds: [Vec3; 2],
}

impl PackedMesh {
    pub(super) fn new(mesh: &Mesh, materials: &[Material]) -> Result<Self, PackError> {
        let corners = |t: u32| mesh.triangles[t as usize].map(|v| mesh.positions[v as usize]);
        let soup: Vec<Triangle> = (0..mesh.triangles.len() as u32)
            .map(|t| {
                let [v0, v1, v2] = corners(t).map(Into::into);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let tree = build(&soup, &mesh.name)?;
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

        let mut triangles = Vec::with_capacity(order.len() * 9);
        let mut attributes = Vec::new();
        let (mut lights, mut weights) = (Vec::new(), Vec::new());
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
            }
        }
        let power = weights.iter().sum();
        Ok(Self {
            nodes: tree.nodes.iter().flat_map(rows).collect(),
            triangles,
            attributes,
            flags,
            lights,
            light_table: alias::build(&weights).unwrap_or_default(),
            power,
            bounds,
        })
    }
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

/// Builds the tree; again by a plainer method should the first be too deep.
fn build(soup: &[Triangle], mesh: &str) -> Result<CwBvh, PackError> {
    if soup.is_empty() {
        return Ok(CwBvh::default());
    }
    let careful = BvhBuildParams { pre_split: false, max_prims_per_leaf: 3, ..BvhBuildParams::medium_build() };
    let plain = BvhBuildParams { pre_split: false, ..BvhBuildParams::fastest_build() };
    let mut deepest = 0;
    for params in [careful, plain] {
        let tree = build_cwbvh_from_tris(soup, params, &mut Duration::default());
        deepest = depth(&tree);
        if deepest <= MAX_DEPTH {
            return Ok(tree);
        }
    }
    Err(PackError::TooDeep { mesh: mesh.to_owned(), depth: deepest })
}

/// Levels of inner nodes.
pub(super) fn depth(tree: &CwBvh) -> u32 {
    let mut deepest = 0;
    let mut stack = vec![(0u32, 1u32)];
    while let Some((node, level)) = stack.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[node as usize];
        let inner = (0..8).filter(|&child| !node.is_leaf(child) && !node.is_child_empty(child));
        stack.extend(inner.map(|child| (node.child_node_index(child), level + 1)));
    }
    deepest
}

/// A node as five rows of words.
pub(super) fn rows(node: &CwBvhNode) -> [UVec4; 5] {
    let words: [u32; 20] = bytemuck::cast(*node);
    core::array::from_fn(|i| UVec4::from_slice(&words[i * 4..]))
}
