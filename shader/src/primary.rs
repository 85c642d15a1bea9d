//! Primary visibility: what the rays of each pixel find.

use glam::{UVec2, Vec3, Vec4};
use weir_shared::{
    camera::{first_point, next_point, ray_through},
    closed_form, environment,
    frame::Frame,
    numerics::{load, max, min},
    scene::Scene,
    surface::{Surface, surface_at},
    trace::Tracer,
};

/// By what factor the radiance of neighbours differs at an edge.
const EDGE: f32 = 1.25;

/// A surface of a pixel, and the radiance toward the camera that needs no sampling, as its mean over the pixel; in w which
/// share of the pixel shows surfaces with light to sample.
///
/// One ray, or several at edges, where most of the noise would be that of what is emitted: a lamp is thousands of times as
/// bright as the wall beside it. What needs no sampling is what surfaces emit, the sky, and what they reflect where that has a
/// closed form. Of the surfaces with light to sample that the rays find, each is the pixel's with the same probability, and it
/// stands for the share of the pixel that is theirs, so that the mean is that of one ray. Which pixels have several rays is
/// told by the frame before, so it is independent of what they find.
///
/// Without a surface, the zero surface; a surface whose light has a closed form is settled: the passes that follow sample no
/// light for it.
pub fn primary<const TEXTURES: bool, const ENVIRONMENT: bool, const INSTANCES: bool, const CLOSED_FORM: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    tracer: impl Tracer,
    prev_emitted: &[Vec4],
) -> (Surface, Vec4) {
    let first = first_point(px, frame);
    let (mut point, mut choose) = (first.truncate(), first.z);
    let rays = rays_of(px, frame, prev_emitted);
    let (mut chosen, mut emitted, mut sampled) = (Surface::default(), Vec3::ZERO, 0.0);
    let mut i = 0;
    while i < rays {
        let ray = ray_through(frame, px.x as f32 + point.x, px.y as f32 + point.y);
        let hit = tracer.closest_hit::<TEXTURES, INSTANCES>(frame, scene, &ray);
        let (mut surface, mut seen, mut is_sampled) = (Surface::default(), Vec3::ZERO, false);
        if !hit.is_miss() {
            let found = surface_at::<TEXTURES>(frame, scene, &hit, ray.direction);
            surface = found.surface;
            seen = found.emitted;
            is_sampled = true;
            if CLOSED_FORM {
                let reflected = closed_form::reflected(frame, scene, &hit, &found);
                if reflected.is_known {
                    surface = surface.settled();
                    seen += reflected.radiance;
                    is_sampled = false;
                }
            }
        } else if ENVIRONMENT {
            seen = environment::radiance(frame, scene, ray.direction);
        }
        // A running mean: a sum could overflow.
        emitted += (seen - emitted) * (1.0 / (i + 1) as f32);
        let mut is_chosen = i == 0;
        if is_sampled {
            sampled += 1.0;
            // What is left of the number is uniform again.
            let scaled = choose * sampled;
            is_chosen = scaled < 1.0;
            choose = if is_chosen { scaled } else { (scaled - 1.0) / (sampled - 1.0) };
        }
        if is_chosen {
            chosen = surface;
        }
        point = next_point(point);
        i += 1;
    }
    (chosen, emitted.extend(sampled / rays as f32))
}

/// Camera rays of a pixel: several if what needs no sampling differs between it and its neighbours in the frame before.
#[inline(always)]
fn rays_of(px: UVec2, frame: &Frame, prev_emitted: &[Vec4]) -> u32 {
    let (at_edges, at_first) = (frame.camera_rays & 0xffff, frame.camera_rays >> 16);
    let is_known = frame.has_history != 0 || frame.accumulated != 0;
    if at_edges < 2 || !is_known {
        return at_first.max(1);
    }
    let own = load(prev_emitted, frame.index_of(px));
    let (mut darkest, mut brightest) = (radiance(own), radiance(own));
    let (mut least, mut most) = (own.w, own.w);
    let mut i = 0;
    while i < 9 {
        let x = (px.x + i % 3).max(1) - 1;
        let y = (px.y + i / 3).max(1) - 1;
        let there = load(prev_emitted, frame.index_of(UVec2::new(x.min(frame.width - 1), y.min(frame.height - 1))));
        darkest = min(darkest, radiance(there));
        brightest = max(brightest, radiance(there));
        least = min(least, there.w);
        most = max(most, there.w);
        i += 1;
    }
    if brightest > darkest * EDGE || most > least { at_edges } else { 1 }
}

/// The sum of the channels.
#[inline(always)]
fn radiance(emitted: Vec4) -> f32 {
    emitted.x + emitted.y + emitted.z
}
