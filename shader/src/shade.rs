//! Shading: emitted light, and the light of the sample that was kept.

use glam::{UVec2, Vec4};
use weir_shared::{
    bsdf::Bsdf,
    frame::Frame,
    light,
    numerics::{load, max, sqrt},
    reservoir::Reservoir,
    scene::Scene,
    surface::Surface,
};

/// Radiance toward the camera, linear Rec. 709, in W sr^-1 m^-2; w is the coverage (0 for sky).
pub fn shade<const TEXTURES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    emitted: &[Vec4],
    visible: &[Reservoir],
) -> Vec4 {
    let index = frame.index_of(px);
    let emitted = load(emitted, index);
    let reservoir = load(visible, index);
    if !reservoir.has_sample() {
        return emitted;
    }
    let surface = load(surfaces, index);
    let toward_camera = frame.camera_origin - surface.position();
    let outgoing = toward_camera * (1.0 / max(sqrt(toward_camera.length_squared()), 1e-30));
    let bsdf = Bsdf::new(&surface, outgoing);
    let point = light::evaluate::<TEXTURES, ENVIRONMENT>(frame, scene, reservoir.light, reservoir.uv);
    let arriving = light::arriving::<ENVIRONMENT>(surface.position(), &point);
    let reflected = bsdf.evaluate::<SPECULAR>(arriving.direction) * arriving.irradiance * reservoir.ucw;
    (emitted.truncate() + reflected).extend(emitted.w)
}
