//! Primary visibility: what the ray of each pixel finds.

use glam::{UVec2, Vec4};
use weir_shared::{
    camera::camera_ray, closed_form, environment, frame::Frame, scene::Scene, surface::Surface, surface::surface_at,
    trace::Tracer,
};

/// The surface of a pixel, and the radiance that it emits toward the camera (in w: 1 if there is light to sample, else 0).
///
/// One ray. Sky: the zero surface, and the radiance of the environment. Where what the surface reflects has a closed form,
/// the radiance includes it, and the surface is settled: the passes that follow sample no light for it.
pub fn primary<const TEXTURES: bool, const ENVIRONMENT: bool, const INSTANCES: bool, const CLOSED_FORM: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    tracer: impl Tracer,
) -> (Surface, Vec4) {
    let ray = camera_ray(px, frame);
    let hit = tracer.closest_hit::<TEXTURES, INSTANCES>(frame, scene, &ray);
    if hit.is_miss() {
        let sky = if ENVIRONMENT { environment::radiance(frame, scene, ray.direction).extend(0.0) } else { Vec4::ZERO };
        return (Surface::default(), sky);
    }
    let found = surface_at::<TEXTURES>(frame, scene, &hit, ray.direction);
    if CLOSED_FORM {
        let reflected = closed_form::reflected(frame, scene, &hit, &found);
        if reflected.is_known {
            return (found.surface.settled(), (found.emitted + reflected.radiance).extend(0.0));
        }
    }
    (found.surface, found.emitted.extend(1.0))
}
