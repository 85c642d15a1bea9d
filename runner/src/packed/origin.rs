//! Scenes far from the origin: floats are coarse there, so they are packed around a point in their middle.
//!
//! World space of the passes is that of the scene less [`Origin::of_scene`]. Near the origin both are the same.

use std::borrow::Cow;

use glam::{DMat4, Mat4, Vec3};

use super::Moment;
use crate::scene::{Motion, Scene, bounds::Bounds};

/// Half-sizes of something that its middle may be away from the origin: margins of rays then stay below a 10,000th of it.
const FAR: f32 = 16.0;

/// Where the origins of the passes' spaces are.
#[derive(Clone, Debug, Default)]
pub(super) struct Origin {
    /// Of world space.
    pub(super) of_scene: Vec3,
    /// Of the object space of each mesh; none if all are where they were.
    of_meshes: Vec<Vec3>,
    /// The mesh of each instance.
    meshes: Vec<u32>,
}

/// The middle of what is far from the origin for its size; zero for other things.
fn middle_if_far(bounds: Option<Bounds>) -> Vec3 {
    let Some(bounds) = bounds else { return Vec3::ZERO };
    let (middle, size) = (bounds.center(), bounds.size().max_element());
    let is_far = middle.abs().max_element() > FAR * 0.5 * size;
    if is_far && middle.is_finite() { middle } else { Vec3::ZERO }
}

impl Origin {
    /// The scene around its own middle if that is far away, or else as it is; and where its origins are then.
    pub(super) fn moved(scene: &Scene) -> (Cow<'_, Scene>, Self) {
        let of_scene = middle_if_far(scene.bounds());
        if of_scene == Vec3::ZERO {
            return (Cow::Borrowed(scene), Self::default());
        }
        let of_mesh = |mesh: &crate::scene::Mesh| middle_if_far(Bounds::of(mesh.positions.iter().copied()));
        let origin = Self {
            of_scene,
            of_meshes: scene.meshes.iter().map(of_mesh).collect(),
            meshes: scene.instances.iter().map(|instance| instance.mesh).collect(),
        };
        let mut moved = scene.clone();
        for (mesh, middle) in moved.meshes.iter_mut().zip(&origin.of_meshes) {
            mesh.positions.iter_mut().for_each(|position| *position -= *middle);
        }
        for (instance, number) in moved.instances.iter_mut().zip(0..) {
            instance.world_from_object = origin.place(number, instance.world_from_object);
            if let Motion::Turn { center, .. } = &mut instance.motion {
                *center -= of_scene;
            }
        }
        (Cow::Owned(moved), origin)
    }

    /// Origin of the packed mesh of an instance in the space of the scene's mesh.
    pub(super) fn of_mesh(&self, instance: u32) -> Vec3 {
        let mesh = self.meshes.get(instance as usize).and_then(|mesh| self.of_meshes.get(*mesh as usize));
        mesh.copied().unwrap_or_default()
    }

    /// A placement of an instance, from object to world space of the passes.
    fn place(&self, instance: u32, world_from_object: Mat4) -> Mat4 {
        if self.of_scene == Vec3::ZERO {
            return world_from_object;
        }
        // In f64: what is left is the difference of large numbers.
        let shift = |v: Vec3| DMat4::from_translation(v.as_dvec3());
        (shift(-self.of_scene) * world_from_object.as_dmat4() * shift(self.of_mesh(instance))).as_mat4()
    }

    /// A moment in world space of the passes.
    pub(super) fn moment<'a>(&self, moment: &'a Moment) -> Cow<'a, Moment> {
        if self.of_scene == Vec3::ZERO || moment.placed.is_empty() {
            return Cow::Borrowed(moment);
        }
        let placed = moment.placed.iter().map(|&(instance, to_world)| (instance, self.place(instance, to_world)));
        Cow::Owned(Moment { placed: placed.collect(), ..moment.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::scenes::variety;

    #[test]
    fn what_is_far_away_is_packed_as_it_would_be_near() {
        let near = variety();
        assert!(matches!(Origin::moved(&near).0, Cow::Borrowed(_)));
        // Whole numbers, and a corner of the scene's box on a grid of 1/8: nothing is rounded.
        let far = Vec3::new(1e6, -2e6, 3e5);
        let mut scene = near.clone();
        for instance in &mut scene.instances {
            instance.world_from_object = Mat4::from_translation(far) * instance.world_from_object;
            if let Motion::Turn { center, .. } = &mut instance.motion {
                *center += far;
            }
        }
        let (moved, origin) = Origin::moved(&scene);
        for (instance, was) in moved.instances.iter().zip(&near.instances) {
            for time_s in [0.0, 1.3] {
                let [moved, was] = [instance, was].map(|i| i.world_from_object_at(time_s));
                let back = Mat4::from_translation(origin.of_scene - far) * moved;
                // A 16th is what floats near a million tell apart.
                assert!(back.abs_diff_eq(was, 0.15), "{back} {was}");
            }
        }
        let placed = vec![(2, Mat4::from_translation(far))];
        let moment = origin.moment(&Moment { placed, ..Moment::default() }).into_owned();
        assert_eq!(moment.placed[0].1, Mat4::from_translation(far - origin.of_scene));
    }
}
