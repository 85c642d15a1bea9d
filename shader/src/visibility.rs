//! Visibility: one shadow ray to the sample that each reservoir holds.

use glam::UVec2;
use weir_shared::{
    frame::{Frame, skip},
    light,
    numerics::load,
    reservoir::Reservoir,
    scene::Scene,
    surface::Surface,
    trace::Tracer,
};

/// The reservoir, its contribution weight set to zero where something stands between surface and light. At most one
/// ray; none for sky, settled surfaces, reservoirs without a sample, and where visibility is known.
pub fn visibility<const MASKS: bool, const ENVIRONMENT: bool, const INSTANCES: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    tracer: impl Tracer,
    surfaces: &[Surface],
    unseen: &[Reservoir],
) -> Reservoir {
    let mut held = load(unseen, frame.index_of_reservoir(px, reservoir));
    if !held.has_sample() || (held.is_known_visible() && frame.skips(skip::KNOWN_VISIBLE)) {
        return held;
    }
    let surface = load(surfaces, frame.index_of(px));
    // Only where the light is matters here, not its texture.
    let point = light::evaluate::<false, ENVIRONMENT>(frame, scene, held.light, held.uv);
    let ray = light::shadow_ray::<ENVIRONMENT>(&surface, &point);
    if tracer.unoccluded::<MASKS, INSTANCES>(frame, scene, &ray) {
        held = held.known_visible();
    } else {
        held.ucw = 0.0;
    }
    held
}
