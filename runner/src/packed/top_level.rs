//! The top level: where the instances are at a moment, and an acceleration structure over them.

use std::collections::HashMap;

use bytemuck::bytes_of;
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
    /// Where each instance was when it was placed last.
    places: Vec<Option<Place>>,
    /// The structure over those that were drawn last.
    over: Over,
}

/// Where an instance is.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) world_from_object: Mat4,
    pub(super) object_from_world: Mat4,
    /// A box in world space that holds whatever rays can hit of it.
    bounds: [Vec3; 2],
}

/// An acceleration structure over instances.
#[derive(Default)]
struct Over {
    /// What it was built from.
    boxes: Vec<Boxed>,
    /// Instance of each leaf.
    order: Vec<u32>,
    nodes: Vec<UVec4>,
}

/// An instance that rays find.
struct Boxed {
    /// Its number in the order that is drawn.
    slot: u32,
    bounds: [Vec3; 2],
}

/// The instances at one moment.
pub(super) struct Placed {
    /// Of each that is drawn.
    pub(super) places: Vec<Place>,
    /// Around all that rays find.
    pub(super) bounds: [Vec3; 2],
}

impl TopLevel {
    pub(super) fn new(
        instances: Vec<Instance>,
        bounds: Vec<[Vec3; 2]>,
        are_found: Vec<bool>,
        first_row: usize,
    ) -> Self {
        let places = vec![None; instances.len()];
        Self { instances, bounds, are_found, first_row, places, over: Over::default() }
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

    /// Places the instances `drawn`, by the moment's transform where it has one. What has not moved since the last call stays
    /// as it was found out then, if `keeps`; the result is the same.
    pub(super) fn place(&mut self, moment: &Moment, drawn: &[u32], keeps: bool) -> Result<Placed, PackError> {
        let time_s = moment.time_s;
        let placed_at: HashMap<u32, Mat4> = moment.placed.iter().copied().collect();
        let mut places = Vec::with_capacity(drawn.len());
        let mut boxes = Vec::with_capacity(drawn.len());
        let mut bounds = [Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)];
        for (slot, &i) in (0..).zip(drawn) {
            let instance = &self.instances[i as usize];
            let own = || instance.world_from_object_at(time_s);
            let world_from_object = placed_at.get(&i).copied().unwrap_or_else(own);
            let is_there = |known: &&Place| bytes_of(&known.world_from_object) == bytes_of(&world_from_object);
            let place = match self.places[i as usize].as_ref().filter(|_| keeps).filter(is_there) {
                Some(known) => *known,
                None => Place::new(world_from_object, self.bounds[instance.mesh as usize])
                    .ok_or(PackError::Singular { instance: i as usize, time_s })?,
            };
            self.places[i as usize] = Some(place);
            places.push(place);
            if self.are_found[instance.mesh as usize] {
                bounds = [bounds[0].min(place.bounds[0]), bounds[1].max(place.bounds[1])];
                boxes.push(Boxed { slot, bounds: place.bounds });
            }
        }
        if boxes.is_empty() {
            bounds = [Vec3::ZERO; 2];
        }
        if !keeps || !self.over.is_of(&boxes) {
            self.over = Over::new(boxes);
        }
        Ok(Placed { places, bounds })
    }

    /// The instance of each leaf of the structure over those that were placed last, by number in the order that is drawn.
    pub(super) fn order(&self) -> &[u32] {
        &self.over.order
    }

    /// Nodes of that structure.
    pub(super) fn nodes(&self) -> &[UVec4] {
        &self.over.nodes
    }
}

impl Place {
    /// A mesh with the given bounds in object space; nothing if the transform has no inverse.
    fn new(world_from_object: Mat4, [lower, upper]: [Vec3; 2]) -> Option<Self> {
        let object_from_world = world_from_object.inverse();
        if !object_from_world.is_finite() || world_from_object.determinant() == 0.0 {
            return None;
        }
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
        Some(Self { world_from_object, object_from_world, bounds: [extent[0] - margin, extent[1] + margin] })
    }
}

impl Over {
    fn new(boxes: Vec<Boxed>) -> Self {
        if boxes.is_empty() {
            // No children at all: every ray misses.
            return Self { boxes, order: Vec::new(), nodes: vec![UVec4::ZERO; 5] };
        }
        let corners: Vec<Aabb> = boxes.iter().map(|b| Aabb::new(b.bounds[0].into(), b.bounds[1].into())).collect();
        let tree = tree::build(&corners, false);
        let nodes = tree.nodes.iter().flat_map(tree::rows).collect();
        let order = tree.primitive_indices.iter().map(|&leaf| boxes[leaf as usize].slot).collect();
        Self { boxes, order, nodes }
    }

    /// Whether it was built from these, to the bit.
    fn is_of(&self, boxes: &[Boxed]) -> bool {
        let is_same = |(a, b): (&Boxed, &Boxed)| a.slot == b.slot && bytes_of(&a.bounds) == bytes_of(&b.bounds);
        !self.nodes.is_empty() && self.boxes.len() == boxes.len() && self.boxes.iter().zip(boxes).all(is_same)
    }
}
