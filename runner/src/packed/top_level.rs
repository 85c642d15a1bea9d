//! The top level: where the instances are at a moment, and an acceleration structure over them.

use std::collections::HashMap;

use glam::{Mat4, UVec4, Vec3};
use obvhs::aabb::Aabb;

use super::{PackError, moment::Moment, tree};
use crate::scene::{Instance, Motion};

/// The instances of a scene, and the bounds of its meshes in object space.
pub(super) struct TopLevel {
    instances: Vec<Instance>,
    bounds: Vec<[Vec3; 2]>,
    /// Whether rays find each mesh: not a shape, nor triangles that are unseen.
    are_found: Vec<bool>,
    /// Row of `bvh` where the nodes of the first block start.
    pub(super) first_row: usize,
}

/// The instances at one moment.
pub(super) struct Placed {
    /// To world space, and back.
    pub(super) transforms: Vec<(Mat4, Mat4)>,
    /// Instance of each leaf.
    pub(super) order: Vec<u32>,
    pub(super) nodes: Vec<UVec4>,
    pub(super) bounds: [Vec3; 2],
}

impl TopLevel {
    pub(super) fn new(
        instances: Vec<Instance>,
        bounds: Vec<[Vec3; 2]>,
        are_found: Vec<bool>,
        first_row: usize,
    ) -> Self {
        Self { instances, bounds, are_found, first_row }
    }

    /// Number of instances, also of those with nothing to see.
    pub(super) fn len(&self) -> usize {
        self.instances.len()
    }

    /// The mesh of an instance.
    pub(super) fn mesh(&self, instance: u32) -> u32 {
        self.instances[instance as usize].mesh
    }

    /// Whether rays find an instance.
    pub(super) fn is_found(&self, instance: u32) -> bool {
        self.are_found[self.mesh(instance) as usize]
    }

    /// Whether there is such an instance, and triangles or a shape of it.
    pub(super) fn has_any(&self, instance: u32) -> bool {
        let mesh = self.instances.get(instance as usize).map(|i| i.mesh as usize);
        // The bounds of nothing are inside out.
        mesh.is_some_and(|mesh| !self.are_found[mesh] || self.bounds[mesh][0].x <= self.bounds[mesh][1].x)
    }

    /// Whether any instance is a light that rays don't find.
    pub(super) fn has_unfound(&self) -> bool {
        self.instances.iter().any(|i| !self.are_found[i.mesh as usize])
    }

    fn present(&self) -> impl Iterator<Item = &Instance> {
        (0..self.len() as u32).filter(|&i| self.has_any(i)).map(|i| &self.instances[i as usize])
    }

    /// Whether any instance moves.
    pub(super) fn moves(&self) -> bool {
        self.present().any(|i| i.motion != Motion::Still)
    }

    /// Whether the only instance is a mesh in place, so that it is the world.
    pub(super) fn is_trivial(&self) -> bool {
        let mut present = self.present();
        match (present.next(), present.next()) {
            (Some(only), None) if !self.are_found[only.mesh as usize] => false,
            (Some(only), None) => only.motion == Motion::Still && only.world_from_object == Mat4::IDENTITY,
            (first, _) => first.is_none(),
        }
    }

    /// Rows that the nodes of one moment never exceed: a tree over n leaves has at most n inner nodes.
    pub(super) fn capacity_rows(&self) -> usize {
        self.instances.len().max(1) * 5
    }

    /// Places the instances `drawn`, by the moment's transform where it has one.
    pub(super) fn place(&self, moment: &Moment, drawn: &[u32]) -> Result<Placed, PackError> {
        let time_s = moment.time_s;
        let placed_at: HashMap<u32, Mat4> = moment.placed.iter().copied().collect();
        let mut transforms = Vec::with_capacity(drawn.len());
        let (mut boxes, mut slots) = (Vec::with_capacity(drawn.len()), Vec::with_capacity(drawn.len()));
        let mut bounds = [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)];
        for (slot, &i) in (0..).zip(drawn) {
            let instance = &self.instances[i as usize];
            let [lower, upper] = self.bounds[instance.mesh as usize];
            let own = || instance.world_from_object_at(time_s);
            let world_from_object = placed_at.get(&i).copied().unwrap_or_else(own);
            let object_from_world = world_from_object.inverse();
            if !object_from_world.is_finite() || world_from_object.determinant() == 0.0 {
                return Err(PackError::Singular { instance: i as usize, time_s });
            }
            transforms.push((world_from_object, object_from_world));
            if !self.are_found[instance.mesh as usize] {
                continue;
            }
            slots.push(slot);
            let corners = (0..8).map(|corner| {
                let pick = |bit: usize, axis: usize| if corner >> bit & 1 == 0 { lower[axis] } else { upper[axis] };
                world_from_object.transform_point3(Vec3::new(pick(0, 0), pick(1, 1), pick(2, 2)))
            });
            let mut extent = [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)];
            for corner in corners {
                extent = [extent[0].min(corner), extent[1].max(corner)];
            }
            // A ray is transformed with rounding errors: the box must hold what it can still hit.
            let margin = (extent[0].abs().max(extent[1].abs()).max_element()
                + world_from_object.w_axis.truncate().abs().max_element())
                * 1e-6;
            extent = [extent[0] - margin, extent[1] + margin];
            bounds = [bounds[0].min(extent[0]), bounds[1].max(extent[1])];
            boxes.push(Aabb::new(extent[0].into(), extent[1].into()));
        }
        if boxes.is_empty() {
            // No children at all: every ray misses.
            return Ok(Placed { transforms, order: Vec::new(), nodes: vec![UVec4::ZERO; 5], bounds: [Vec3::ZERO; 2] });
        }
        let tree = tree::build(&boxes, false);
        let nodes = tree.nodes.iter().flat_map(tree::rows).collect();
        let order = tree.primitive_indices.iter().map(|&leaf| slots[leaf as usize]).collect();
        Ok(Placed { transforms, order, nodes, bounds })
    }
}
