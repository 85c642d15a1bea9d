//! Primary visibility: what the rays of each pixel find.

use glam::{UVec2, Vec3, Vec4};
use weir_shared::{
    camera::{first_point, next_point, ray_through},
    closed_form, environment,
    frame::Frame,
    numerics::{load, max, min},
    ray::FAR,
    scene::Scene,
    surface::{Shown, Surface, surface_at},
    trace::Tracer,
};

/// By what factor the radiance of neighbours differs at an edge.
const EDGE: f32 = 1.25;

/// A surface of a pixel, and the radiance toward the camera that needs no sampling, as its mean over the pixel; w tells which
/// share of the pixel shows surfaces with light to sample, see [`Shown`].
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
    let mut is_bright = false;
    let mut i = 0;
    while i < rays {
        let ray = ray_through(frame, px.x as f32 + point.x, px.y as f32 + point.y);
        let hit = tracer.closest_hit::<TEXTURES, INSTANCES>(frame, scene, &ray);
        let (mut surface, mut seen, mut is_sampled) = (Surface::default(), Vec3::ZERO, false);
        if !hit.is_miss() {
            let found = surface_at::<TEXTURES>(frame, scene, &hit, ray.direction);
            surface = found.surface;
            seen = found.emitted;
            is_bright = is_bright || radiance(seen) > 0.0;
            is_sampled = true;
            if CLOSED_FORM {
                let reflected = closed_form::reflected(frame, scene, &hit, &found);
                if reflected.is_known {
                    surface = surface.settled();
                    seen += reflected.radiance;
                    is_sampled = false;
                }
            }
        } else {
            is_bright = true;
            if ENVIRONMENT {
                seen = environment::radiance(frame, scene, ray.direction);
            }
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
    (chosen, emitted.extend(Shown { sampled: sampled / rays as f32, is_bright }.pack()))
}

/// Camera rays of a pixel: several if in the frame before some of it and its neighbours had found what emits or the sky and
/// others had not, or unlike radiance or shares of it; or if what surfaces reflect in closed form differed between the
/// pixels on either side, or from both.
///
/// Where one surface has light in closed form and the next has light to sample, one ray does: as at any edge of surfaces
/// with light to sample, which do not differ as much as from lamps.
#[inline(always)]
fn rays_of(px: UVec2, frame: &Frame, prev_emitted: &[Vec4]) -> u32 {
    let (at_edges, at_first) = (frame.camera_rays & 0xffff, frame.camera_rays >> 16);
    let is_known = frame.has_history != 0 || frame.accumulated != 0;
    if at_edges < 2 || !is_known {
        return at_first.max(1);
    }
    let mut bright = 0;
    let mut i = 0;
    while i < 9 {
        bright += u32::from(Shown::unpack(load(prev_emitted, neighbor(px, frame, i)).w).is_bright);
        i += 1;
    }
    let is_edge = if bright == 0 {
        let own = reflected(load(prev_emitted, neighbor(px, frame, 4)));
        let mut is_edge = false;
        i = 1;
        // Above and below, left and right.
        while i < 4 {
            let before = reflected(load(prev_emitted, neighbor(px, frame, i)));
            let after = reflected(load(prev_emitted, neighbor(px, frame, 8 - i)));
            is_edge = is_edge || is_between(before, own, after);
            i += 2;
        }
        is_edge
    } else {
        bright < 9 || is_uneven(px, frame, prev_emitted)
    };
    if is_edge { at_edges } else { 1 }
}

/// Where neighbour `i` of nine is in memory; those beyond the border are those on it.
#[inline(always)]
fn neighbor(px: UVec2, frame: &Frame, i: u32) -> u32 {
    let (x, y) = ((px.x + i % 3).max(1) - 1, (px.y + i / 3).max(1) - 1);
    frame.index_of(UVec2::new(x.min(frame.width - 1), y.min(frame.height - 1)))
}

/// Whether the radiance of nine bright pixels, or the share of them with light to sample, differs.
fn is_uneven(px: UVec2, frame: &Frame, prev_emitted: &[Vec4]) -> bool {
    let (mut darkest, mut brightest) = (FAR, 0.0);
    let (mut least, mut most) = (1.0, 0.0);
    let mut i = 0;
    while i < 9 {
        let there = load(prev_emitted, neighbor(px, frame, i));
        let (radiance, sampled) = (radiance(there.truncate()), Shown::unpack(there.w).sampled);
        (darkest, brightest) = (min(darkest, radiance), max(brightest, radiance));
        (least, most) = (min(least, sampled), max(most, sampled));
        i += 1;
    }
    brightest > darkest * EDGE || most > least
}

/// What surfaces of a pixel that is not bright reflect in closed form, or [`UNKNOWN`].
#[inline(always)]
fn reflected(emitted: Vec4) -> f32 {
    let sampled = Shown::unpack(emitted.w).sampled;
    let sum = radiance(emitted.truncate());
    if sampled == 0.0 {
        sum
    } else if sampled < 1.0 {
        sum / (1.0 - sampled)
    } else {
        UNKNOWN
    }
}

/// Whether an edge seems to go through a pixel with two others on either side, by what is known of each or [`UNKNOWN`].
#[inline(always)]
fn is_between(before: f32, own: f32, after: f32) -> bool {
    differs(before, after) || (differs(before, own) && differs(own, after))
}

#[inline(always)]
fn differs(a: f32, b: f32) -> bool {
    min(a, b) != UNKNOWN && max(a, b) > min(a, b) * EDGE
}

/// In place of a radiance: nothing is known that needs no sampling.
const UNKNOWN: f32 = -1.0;

/// The sum of the channels.
#[inline(always)]
fn radiance(emitted: Vec3) -> f32 {
    emitted.x + emitted.y + emitted.z
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOME: u32 = 4;

    /// Rays of the middle of nine pixels, given the sum of the channels, the share to sample, and whether bright.
    fn rays(pixels: [(f32, f32, bool); 9]) -> u32 {
        let frame = Frame { width: 3, height: 3, has_history: 1, camera_rays: SOME | (2 << 16), ..Frame::default() };
        let shown = pixels
            .map(|(sum, sampled, is_bright)| Vec3::new(0.0, sum, 0.0).extend(Shown { sampled, is_bright }.pack()));
        rays_of(UVec2::ONE, &frame, &shown)
    }

    #[test]
    fn edges_of_what_emits_have_several_rays() {
        let (wall, lamp, sky) = ((0.0, 1.0, false), (9.0, 1.0, true), (0.0, 0.0, true));
        assert_eq!(rays([wall; 9]), 1);
        assert_eq!(rays([lamp; 9]), 1);
        assert_eq!(rays([sky; 9]), 1);
        for at in 0..9 {
            let with = |pixel, others: (f32, f32, bool)| {
                let mut pixels = [others; 9];
                pixels[at] = pixel;
                rays(pixels)
            };
            assert_eq!(with(lamp, wall), SOME, "{at}");
            assert_eq!(with(sky, wall), SOME, "{at}");
            assert_eq!(with((9.5, 1.0, true), lamp), 1, "{at}");
            assert_eq!(with((18.0, 1.0, true), lamp), SOME, "{at}");
            // Leaves before a black sky.
            assert_eq!(with((0.0, 0.5, true), sky), SOME, "{at}");
        }
    }

    #[test]
    fn edges_of_closed_forms_have_several_rays_where_they_go_through_the_pixel() {
        let (dark, light, unknown) = ((1.0, 0.0, false), (2.0, 0.0, false), (0.0, 1.0, false));
        let columns = |left, own, right| rays([left, own, right, left, own, right, left, own, right]);
        let rows = |above, own, below| rays([above, above, above, own, own, own, below, below, below]);
        for of in [&columns as &dyn Fn(_, _, _) -> u32, &rows] {
            assert_eq!(of(dark, dark, dark), 1);
            assert_eq!(of(dark, (1.1, 0.0, false), (1.2, 0.0, false)), 1);
            assert_eq!(of(dark, dark, light), SOME);
            assert_eq!(of(dark, light, dark), SOME);
            // Light that is to be sampled may be as bright, and half of a pixel of it tells what the other half is.
            assert_eq!(of(dark, unknown, unknown), 1);
            assert_eq!(of(dark, (0.5, 0.5, false), dark), 1);
            assert_eq!(of(dark, (1.0, 0.5, false), dark), SOME);
            assert_eq!(of(dark, unknown, light), SOME);
        }
        // Of a pixel's corners only lamps matter.
        let mut corner = [dark; 9];
        corner[0] = light;
        assert_eq!(rays(corner), 1);
    }

    #[test]
    fn rays_of_a_frame_without_another_before_it_are_those_of_the_first() {
        let mut frame = Frame { width: 1, height: 1, camera_rays: SOME | (2 << 16), ..Frame::default() };
        assert_eq!(rays_of(UVec2::ZERO, &frame, &[]), 2);
        frame.accumulated = 1;
        assert_eq!(rays_of(UVec2::ZERO, &frame, &[Vec4::ZERO]), 1);
    }
}
