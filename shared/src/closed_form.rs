//! Light in closed form: what a Lambertian surface reflects of emissive triangles that it sees whole.
//!
//! Of a scene that stands still and has few lights the host finds out, for parts of its triangles, which lights every point
//! of the part sees whole and which light none of them. Where that is all lights, the integral over them has a closed form,
//! and there is nothing to sample. The parts are leaves of a quadtree over the barycentric weights of each triangle.

use core::f32::consts::FRAC_1_PI;
use glam::Vec3;

use crate::{
    frame::Frame,
    light,
    numerics::{atan2, is_finite, max, sqrt},
    ray::Hit,
    scene::{Scene, WorldTriangle, instance_record},
    surface::Found,
};

/// Most lights of a scene that are told apart.
pub const MOST_LIGHTS: u32 = 8;

/// The start of the trees of an instance without any.
pub const NO_TREES: u32 = 0;

/// Words of a tree. An inner node is where its four children stand in `records`: first by the half of u, then by that of v.
pub mod node {
    /// Bit of a leaf.
    pub const LEAF: u32 = 0x8000_0000;
    /// Bit of a leaf all of whose lights are known, before the front face; the next bit is that before the back face.
    pub const KNOWN: u32 = 1 << 16;
    /// By how far the bits of lights that are seen whole are shifted before the back face; before the front face they
    /// come first.
    pub const BACK_SHIFT: u32 = 8;
}

/// The radiance that a surface reflects, if it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflected {
    /// Whether it is.
    pub is_known: bool,
    /// Toward every direction, in W sr^-1 m^-2.
    pub radiance: Vec3,
}

/// What the surface `found` at `hit` reflects of all lights, where the trees of the scene tell that it sees each whole or
/// not at all.
#[inline(always)]
pub fn reflected(frame: &Frame, scene: &Scene, hit: &Hit, found: &Found) -> Reflected {
    let unknown = Reflected { is_known: false, radiance: Vec3::ZERO };
    let trees_at = scene.instance_word(frame, hit.instance, instance_record::CLOSED_FORM_AT);
    if trees_at == NO_TREES {
        return unknown;
    }
    let first = scene.instance_word(frame, hit.instance, instance_record::FIRST_TRIANGLE);
    let mut word = scene.record(trees_at + hit.triangle - first);
    let (mut u, mut v) = (hit.u, hit.v);
    while (word & node::LEAF) == 0 {
        // Doubled and less 1: without rounding.
        let (right, upper) = (u >= 0.5, v >= 0.5);
        (u, v) = (u * 2.0 - if right { 1.0 } else { 0.0 }, v * 2.0 - if upper { 1.0 } else { 0.0 });
        word = scene.record(word + u32::from(right) + 2 * u32::from(upper));
    }
    let (known, shift) = if found.is_front { (node::KNOWN, 0) } else { (node::KNOWN << 1, node::BACK_SHIFT) };
    if (word & known) == 0 {
        return unknown;
    }
    let (position, normal) = (found.surface.position(), found.normal);
    let is_smooth = found.surface.normal_shading != found.surface.normal_geometric;
    let normal_geometric = if is_smooth { found.surface.normal_geometric() } else { normal };
    let mut irradiance = Vec3::ZERO;
    let mut id = 0;
    while id < frame.light_count {
        if ((word >> (shift + id)) & 1) != 0 {
            let place = light::find(frame, scene, id);
            let triangle = scene.world_triangle(frame, place.instance, place.triangle);
            // Of two horizons no part of the light may lie between.
            if is_smooth
                && !(is_before(position, normal, &triangle) && is_before(position, normal_geometric, &triangle))
            {
                return unknown;
            }
            let material = scene.material_of(frame, place.instance, place.triangle);
            irradiance += scene.emission(frame, place.instance, material) * form_factor(position, normal, &triangle);
        }
        id += 1;
    }
    let radiance = found.surface.diffuse() * irradiance * FRAC_1_PI;
    Reflected { is_known: is_finite(radiance.x + radiance.y + radiance.z), radiance }
}

/// Whether a triangle lies wholly before the plane through `position` with the given normal.
#[inline(always)]
fn is_before(position: Vec3, normal: Vec3, triangle: &WorldTriangle) -> bool {
    normal.dot(triangle.a - position) > 0.0
        && normal.dot(triangle.b - position) > 0.0
        && normal.dot(triangle.c - position) > 0.0
}

/// Irradiance at `position` on a plane of that normal by a triangle of radiance 1, in sr: of as much of it as is before the
/// plane.
///
/// Source: Lambert 1760; the integral over edges as in Arvo 1995, "Analytic Methods for Simulated Light Transport",
/// equation 4.3. The relative error is about the spacing of floats times distance times longest edge over area and cosine.
#[inline(always)]
pub fn form_factor(position: Vec3, normal: Vec3, triangle: &WorldTriangle) -> f32 {
    let (a, b, c) = (triangle.a - position, triangle.b - position, triangle.c - position);
    let mut polygon = Clipped { sum: Vec3::ZERO, leaves_at: Vec3::ZERO, enters_at: Vec3::ZERO, is_clipped: false };
    polygon.add(normal, a, triangle.b - triangle.a, b);
    polygon.add(normal, b, triangle.c - triangle.b, c);
    polygon.add(normal, c, triangle.a - triangle.c, a);
    if polygon.is_clipped {
        polygon.sum += edge(polygon.leaves_at, polygon.enters_at - polygon.leaves_at, polygon.enters_at);
    }
    let doubled = normal.dot(polygon.sum);
    0.5 * max(doubled, -doubled)
}

/// The integral over the edges of a polygon, as far as they are above the horizon.
struct Clipped {
    sum: Vec3,
    /// Where it goes below the horizon, and where it comes up; zero if it does not.
    leaves_at: Vec3,
    enters_at: Vec3,
    is_clipped: bool,
}

impl Clipped {
    /// Adds an edge, whose difference of ends is given with all its digits.
    #[inline(always)]
    fn add(&mut self, normal: Vec3, from: Vec3, along: Vec3, to: Vec3) {
        let (at_from, at_to) = (normal.dot(from), normal.dot(to));
        let (mut start, mut end) = (0.0, 1.0);
        if at_from < 0.0 && at_to < 0.0 {
            return;
        }
        if at_from < 0.0 {
            start = at_from / (at_from - at_to);
            self.is_clipped = true;
            self.enters_at = from + along * start;
        }
        if at_to < 0.0 {
            end = at_from / (at_from - at_to);
            self.is_clipped = true;
            self.leaves_at = from + along * end;
        }
        self.sum += edge(from + along * start, along * (end - start), from + along * end);
    }
}

/// The angle that an edge subtends, along the normal of the plane that it spans with the origin. By the edge itself: the
/// cross product of its ends would leave few digits of a short one.
#[inline(always)]
fn edge(from: Vec3, edge: Vec3, to: Vec3) -> Vec3 {
    let cross = from.cross(edge);
    let (sine2, cosine) = (cross.length_squared(), from.dot(to));
    cross * angle_over_sine(sine2, cosine)
}

/// An angle in `0..=pi` over a multiple of its sine, of which the square is given, and the same multiple of its cosine.
///
/// Source: up to pi / 4, Abramowitz and Stegun 1964, 4.4.49, whose relative error is 2e-8.
#[inline(always)]
fn angle_over_sine(sine2: f32, cosine: f32) -> f32 {
    if cosine > 0.0 && sine2 <= cosine * cosine {
        let over_cosine = 1.0 / cosine;
        let t2 = sine2 * over_cosine * over_cosine;
        let t4 = t2 * t2;
        let first = (1.0 - t2 * 0.333_331_45) + t4 * (0.199_935_51 - t2 * 0.142_089);
        let second =
            (0.106_562_64 - t2 * 0.075_289_64) + t4 * (0.042_909_614 - t2 * (0.016_165_737 - t2 * 0.002_866_225_7));
        return over_cosine * (first + t4 * t4 * second);
    }
    let sine = sqrt(sine2);
    atan2(sine, cosine) / max(sine, 1e-30)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{numerics::unit_float, rng::pcg4d};
    use glam::DVec3;

    /// Irradiance by the midpoints of `n` x `n` parts, in f64.
    fn by_parts(position: Vec3, normal: Vec3, triangle: &WorldTriangle, n: u32) -> f64 {
        let corners = [triangle.a, triangle.b, triangle.c].map(|p| p.as_dvec3());
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let normal = normal.as_dvec3();
        let (facing, area) = (cross.normalize(), 0.5 * cross.length() / f64::from(n * n));
        let at = |u: f64, v: f64| {
            let toward =
                corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v - position.as_dvec3();
            let distance2 = toward.length_squared();
            let direction: DVec3 = toward / distance2.sqrt();
            normal.dot(direction).max(0.0) * facing.dot(direction).abs() / distance2 * area
        };
        let third = 1.0 / 3.0;
        let share = 1.0 / f64::from(n);
        let of_part = |i: u32, k: u32| {
            let (u, v) = (f64::from(i), f64::from(k));
            let lower = at((u + third) * share, (v + third) * share);
            let upper = if i + k + 1 < n { at((u + 2.0 * third) * share, (v + 2.0 * third) * share) } else { 0.0 };
            lower + upper
        };
        (0..n).flat_map(|i| (0..n - i).map(move |k| (i, k))).map(|(i, k)| of_part(i, k)).sum()
    }

    #[test]
    fn the_form_factor_is_the_integral_over_what_is_above_the_horizon() {
        let (mut whole, mut cut, mut below) = (0, 0, 0);
        for number in 0..400 {
            let random =
                |what: u32| Vec3::from_slice(&pcg4d(number, what, 0, 7).map(|bits| unit_float(bits) * 2.0 - 1.0));
            let size = [0.05, 0.3, 1.0][number as usize % 3];
            let center = random(0) * 1.5 + Vec3::Z;
            let corner = |i: u32| center + random(i) * size;
            let triangle = WorldTriangle { a: corner(1), b: corner(2), c: corner(3), facing: 1.0 };
            let normal = if number % 2 == 0 { Vec3::Z } else { random(4).normalize() };
            let position = random(5) * 0.2;
            let toward = [triangle.a, triangle.b, triangle.c].map(|p| p - position);
            let nearest = toward.iter().map(|p| p.length()).fold(f32::MAX, f32::min);
            if nearest < 2.0 * size || triangle.doubled_area_normal().length() < 0.1 * size * size {
                continue;
            }
            let above = toward.iter().filter(|p| normal.dot(**p) > 0.0).count();
            whole += u32::from(above == 3);
            cut += u32::from(above == 1 || above == 2);
            below += u32::from(above == 0);
            let expected = by_parts(position, normal, &triangle, 200);
            let actual = f64::from(form_factor(position, normal, &triangle));
            assert!(
                (actual - expected).abs() <= 2e-4 * expected + 2e-7,
                "{number}, {above} above: {actual}, not {expected}"
            );
        }
        assert!(whole > 60 && cut > 15 && below > 20, "{whole} {cut} {below}");
    }

    #[test]
    fn angles_are_those_of_the_arc_tangent() {
        assert_eq!(angle_over_sine(0.0, 0.0), 0.0);
        for i in 1..100_000u32 {
            let exact = f64::from(i) * core::f64::consts::PI / 100_000.0;
            for size in [1e-12, 1.0, 1e12] {
                let (sine2, cosine) = ((exact.sin() * size).powi(2) as f32, (exact.cos() * size) as f32);
                let sine = f64::from(sine2).sqrt();
                let expected = sine.atan2(f64::from(cosine)) / sine;
                let actual = f64::from(angle_over_sine(sine2, cosine));
                assert!((actual - expected).abs() <= 4e-7 * expected, "{exact}: {actual}, not {expected}");
            }
        }
    }

    /// Half of a sphere of radiance 1 sends pi: here by a pyramid of four triangles so close to the plane that all but a rim
    /// of the sky is behind them.
    #[test]
    fn triangles_all_around_send_pi() {
        let corners = [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y].map(|p| p * 1e3);
        let side = |i: usize| WorldTriangle { a: corners[i], b: corners[(i + 1) % 4], c: Vec3::Z * 0.5, facing: 1.0 };
        let sum: f32 = (0..4).map(|i| form_factor(Vec3::ZERO, Vec3::Z, &side(i))).sum();
        assert!((sum - core::f32::consts::PI).abs() < 1e-5, "{sum}");
    }
}
