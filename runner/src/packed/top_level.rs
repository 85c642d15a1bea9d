//! The top level: where the instances are at a moment, and an acceleration structure over them.

use std::time::Duration;

use glam::{Mat4, UVec4, Vec3};
use obvhs::{BvhBuildParams, aabb::Aabb, cwbvh::builder::build_cwbvh};
use weir_shared::bvh::MAX_DEPTH;

use super::{PackError, geometry};
use crate::scene::{Instance, Motion};

/// Instances with the bounds of their meshes.
pub(super) struct TopLevel {
    instances: Vec<(Instance, [Vec3; 2])>,
    /// Row of `bvh` where the nodes start.
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
    pub(super) fn new(instances: Vec<(Instance, [Vec3; 2])>, first_row: usize) -> Self {
        Self { instances, first_row }
    }

    /// Whether any instance moves.
    pub(super) fn moves(&self) -> bool {
        self.instances.iter().any(|(i, _)| i.motion != Motion::Still)
    }

    /// Whether the only instance is in place, so that its mesh is the world.
    pub(super) fn is_trivial(&self) -> bool {
        match self.instances.as_slice() {
            [(only, _)] => only.motion == Motion::Still && only.world_from_object == Mat4::IDENTITY,
            other => other.is_empty(),
        }
    }

    /// Rows that the nodes never exceed: a tree over n leaves has at most n inner nodes.
    pub(super) fn capacity_rows(&self) -> usize {
        self.instances.len().max(1) * 5
    }

    pub(super) fn place(&self, time_s: f32) -> Result<Placed, PackError> {
        let mut transforms = Vec::with_capacity(self.instances.len());
        let mut boxes = Vec::with_capacity(self.instances.len());
        let mut bounds = [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)];
        for (i, (instance, [lower, upper])) in self.instances.iter().enumerate() {
            let world_from_object = instance.world_from_object_at(time_s);
            let object_from_world = world_from_object.inverse();
            if !object_from_world.is_finite() || world_from_object.determinant() == 0.0 {
                return Err(PackError::Singular { instance: i, time_s });
            }
            transforms.push((world_from_object, object_from_world));
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
        let params = BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::fast_build() };
        let mut tree = build_cwbvh(&boxes, params, &mut Duration::default());
        if geometry::depth(&tree) > MAX_DEPTH {
            tree = build_cwbvh(&boxes, BvhBuildParams::fastest_build(), &mut Duration::default());
        }
        let depth = geometry::depth(&tree);
        if depth > MAX_DEPTH {
            return Err(PackError::TooDeep { mesh: String::from("(top level)"), depth });
        }
        let nodes = tree.nodes.iter().flat_map(geometry::rows).collect();
        Ok(Placed { transforms, order: tree.primitive_indices, nodes, bounds })
    }
}
