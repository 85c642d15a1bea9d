//! What finds the intersections of rays: traversal in software, or the driver's ray queries.

use crate::{
    frame::Frame,
    ray::{Hit, Ray},
    scene::Scene,
};

/// Finds what rays meet in the scene as a frame shows it.
///
/// `MASKS`: alpha masks are honoured. `INSTANCES`: the scene has a top level; without it, instance 0 is all there is, in
/// world space.
pub trait Tracer: Copy {
    /// The nearest triangle that a ray meets before `ray.t_max`.
    fn closest_hit<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> Hit;

    /// Whether no triangle lies between the ends of the ray.
    fn unoccluded<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> bool;
}
