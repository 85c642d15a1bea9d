//! Rays by the BSDF: candidates that a table of lights would rarely draw, such as what a glossy surface mirrors.

use glam::UVec2;
use weir_shared::{
    environment,
    frame::{Frame, skip},
    light::{self, ENVIRONMENT_BIT, NO_LIGHT},
    numerics::{load, pack_cell},
    ray::{FAR, Ray, offset_origin},
    reservoir::Reservoir,
    rng::{Rng, Stage},
    scene::Scene,
    surface::Surface,
    target::Domain,
    trace::Tracer,
    triangle::triangle_to_square,
};

/// The light that a direction drawn from the BSDF finds, with weight 1; the zero reservoir if there is none. One ray.
pub fn bsdf_rays<const MASKS: bool, const ENVIRONMENT: bool, const INSTANCES: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    tracer: impl Tracer,
    surfaces: &[Surface],
) -> Reservoir {
    let surface = load(surfaces, frame.index_of(px));
    if surface.is_settled() || (surface.is_black() && frame.skips(skip::BLACK)) {
        return Reservoir::EMPTY;
    }
    let bsdf = Domain::new(frame.camera_origin, &surface).bsdf;
    let mut rng = Rng::for_reservoir(px, reservoir, frame, Stage::BsdfRay);
    let direction = bsdf.sample(rng.next_float(), rng.next_float(), rng.next_float());
    if !(bsdf.normal_geometric.dot(direction) > 0.0) {
        return Reservoir::EMPTY;
    }
    let origin = offset_origin(surface.position(), bsdf.normal_geometric, surface.error, direction);
    let hit = tracer.closest_hit::<MASKS, INSTANCES>(frame, scene, &Ray { origin, direction, t_max: FAR });
    if hit.is_miss() {
        if !ENVIRONMENT || frame.environment_width == 0 {
            return Reservoir::EMPTY;
        }
        let (texel, uv) = environment::locate(frame, direction);
        return Reservoir::new(texel | ENVIRONMENT_BIT, uv, 1.0, 0);
    }
    let light = light::of_hit(frame, scene, &hit);
    if light == NO_LIGHT {
        return Reservoir::EMPTY;
    }
    let (u, v) = triangle_to_square(hit.u, hit.v);
    Reservoir::new(light, pack_cell(u, v), 1.0, 0)
}
