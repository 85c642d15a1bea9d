//! Shading: emitted light, and the light of the samples that were kept.

use glam::{UVec2, Vec3, Vec4};
use weir_shared::{
    frame::Frame, light, numerics::load, reservoir::Reservoir, scene::Scene, surface::Surface, target::Domain,
};

/// Radiance toward the camera, linear Rec. 709, in W sr^-1 m^-2, by the mean over the pixel's reservoirs; w is the
/// coverage (0 for sky).
pub fn shade<const TEXTURES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    emitted: &[Vec4],
    visible: &[Reservoir],
) -> Vec4 {
    let emitted = load(emitted, frame.index_of(px));
    let mut reflected = Vec3::ZERO;
    let mut i = 0;
    while i < frame.reservoirs {
        let held = load(visible, frame.index_of_reservoir(px, i));
        if held.has_sample() {
            let domain = Domain::new(frame.camera_origin, &load(surfaces, frame.index_of(px)));
            let point = light::evaluate::<TEXTURES, ENVIRONMENT>(frame, scene, held.light, held.uv);
            reflected += domain.reflected::<ENVIRONMENT, SPECULAR>(&point) * held.ucw;
        }
        i += 1;
    }
    (emitted.truncate() + reflected * (1.0 / frame.reservoirs as f32)).extend(emitted.w)
}

/// The same from the sums over all inputs of the last merge, whose visibility is known.
pub fn shade_sum(px: UVec2, frame: &Frame, emitted: &[Vec4], gathered: &[Vec4]) -> Vec4 {
    let emitted = load(emitted, frame.index_of(px));
    let mut reflected = Vec3::ZERO;
    let mut i = 0;
    while i < frame.reservoirs {
        reflected += load(gathered, frame.index_of_reservoir(px, i)).truncate();
        i += 1;
    }
    (emitted.truncate() + reflected * (1.0 / frame.reservoirs as f32)).extend(emitted.w)
}
