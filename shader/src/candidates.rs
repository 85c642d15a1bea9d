//! Initial candidates: one light sample per pixel, by streaming resampled importance sampling.

use glam::UVec2;
use weir_shared::{
    bsdf::Bsdf,
    environment,
    frame::Frame,
    light::{self, ENVIRONMENT_BIT},
    numerics::{max, sqrt, unit_float},
    reservoir::{Reservoir, Stream},
    rng::{Rng, Stage},
    scene::Scene,
    surface::Surface,
};

/// Offers `frame.candidates` light samples to a reservoir and keeps one; the zero reservoir for sky.
///
/// The target p̂ is the mean over the colour channels of the unshadowed reflected radiance, per unit of (u, v). Lights
/// are drawn by the scene's table, or each once if there are no more of them than candidates; with an environment, a
/// quarter of the candidates go to it. The two kinds of light have no point in common, so each candidate's MIS weight
/// is one over the number of candidates of its kind.
///
/// Source: Talbot et al. 2005; Bitterli et al. 2020, algorithm 3.
pub fn candidates<const TEXTURES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    surfaces: &[Surface],
) -> Reservoir {
    let surface = weir_shared::numerics::load(surfaces, frame.index_of(px));
    if surface.is_sky() {
        return Reservoir::EMPTY;
    }
    let toward_camera = frame.camera_origin - surface.position();
    let outgoing = toward_camera * (1.0 / max(sqrt(toward_camera.length_squared()), 1e-30));
    let bsdf = Bsdf::new(&surface, outgoing);

    let mut rng = Rng::for_pixel(px, frame, Stage::Candidates);
    let mut stream = Stream::new();
    let environment_share = if !ENVIRONMENT {
        0
    } else if frame.light_count == 0 {
        frame.candidates
    } else {
        (frame.candidates / 4).max(1)
    };
    // At least one of each kind, or that kind would be missing from the estimate.
    let table_share =
        if frame.light_count == 0 { 0 } else { (frame.candidates - environment_share.min(frame.candidates)).max(1) };

    let enumerate = frame.light_count <= table_share;
    let count = if enumerate { frame.light_count } else { table_share };
    let mut i = 0;
    while i < count {
        let picked = rng.next_four();
        let place = rng.next_four();
        let mut id = i;
        let mut density = 1.0;
        if !enumerate {
            let pick = light::pick(frame, scene, lights, picked);
            id = pick.index;
            density = pick.pmf * count as f32;
        }
        let target = target::<TEXTURES, ENVIRONMENT, SPECULAR>(frame, scene, &surface, &bsdf, id, place[0]);
        stream.offer(id, place[0], target, target / density, unit_float(place[1]));
        i += 1;
    }
    if ENVIRONMENT {
        let mut i = 0;
        while i < environment_share {
            let picked = rng.next_four();
            let texel = environment::pick(frame, lights, picked[0], picked[1]);
            let id = texel.index | ENVIRONMENT_BIT;
            let target = target::<TEXTURES, ENVIRONMENT, SPECULAR>(frame, scene, &surface, &bsdf, id, picked[2]);
            let density = texel.pmf * environment_share as f32;
            stream.offer(id, picked[2], target, target / density, unit_float(picked[3]));
            i += 1;
        }
    }
    stream.finish()
}

/// Target p̂ of a light sample at a surface: see [`candidates`].
#[inline(always)]
pub fn target<const TEXTURES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    frame: &Frame,
    scene: &Scene,
    surface: &Surface,
    bsdf: &Bsdf,
    light: u32,
    uv: u32,
) -> f32 {
    let point = light::evaluate::<TEXTURES, ENVIRONMENT>(frame, scene, light, uv);
    let arriving = light::arriving::<ENVIRONMENT>(surface.position(), &point);
    let reflected = bsdf.evaluate::<SPECULAR>(arriving.direction) * arriving.irradiance;
    (reflected.x + reflected.y + reflected.z) * (1.0 / 3.0)
}
