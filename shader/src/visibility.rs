//! Visibility: one shadow ray to the sample that each pixel kept.

use glam::{UVec2, UVec4};
use weir_shared::{
    bvh::unoccluded, frame::Frame, light, numerics::load, reservoir::Reservoir, scene::Scene, surface::Surface,
};

/// The reservoir, its contribution weight set to zero where something stands between surface and light. At most one
/// ray; none for sky and for reservoirs without a sample.
pub fn visibility<const TEXTURES: bool, const ENVIRONMENT: bool, const INSTANCES: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    surfaces: &[Surface],
    reservoirs: &[Reservoir],
) -> Reservoir {
    let index = frame.index_of(px);
    let mut reservoir = load(reservoirs, index);
    if !reservoir.has_sample() {
        return reservoir;
    }
    let surface = load(surfaces, index);
    // Only where the light is matters here, not its texture.
    let point = light::evaluate::<false, ENVIRONMENT>(frame, scene, reservoir.light, reservoir.uv);
    let ray = light::shadow_ray::<ENVIRONMENT>(&surface, &point);
    if !unoccluded::<TEXTURES, INSTANCES>(frame, scene, bvh, &ray) {
        reservoir.ucw = 0.0;
    }
    reservoir
}
