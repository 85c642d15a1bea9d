//! Where light has a closed form: which parts of which triangles see each light whole, or not at all.
//!
//! A part of a triangle and a light span a shaft, the hull of both. Nothing stands between them if every other triangle is
//! on the other side of some plane. The light is hidden from all of the part if one convex polygon cuts the whole shaft: if
//! it cuts the lines between their corners, it cuts all, because what they cut of its plane is a convex combination of that.
//! Parts of which neither is known of some light are split in four, down to an edge of a share of the scene's size, unless
//! it is known that every point sees some of the light and not all of it.
//!
//! Everything is conservative in the arithmetic of the passes: planes keep half the margin by which rays start off their
//! surfaces, see [`weir_shared::ray::position_error`].

use glam::DVec3;
use rayon::prelude::*;
use weir_shared::{
    closed_form::{MOST_LIGHTS, node},
    frame::Frame,
    light,
    scene::{NO_TEXTURE, Scene, instance_record, material_record},
};

/// Most triangles of a scene that is looked into: every part of each is held against every other.
const MOST_TRIANGLES: usize = 256;

/// How often a corner of a light may be tested for being hidden from a part by a triangle. All triangles share it by their
/// areas, so that what is found does not depend on the order of threads. To hold a shaft against a triangle costs as much as
/// [`SHAFT`] such tests.
const MOST_TESTS: f64 = 1.2e7;
const SHAFT: usize = 8;

/// Most splits of a triangle, and the edge of parts that are not split, as a share of the scene's diagonal.
const MOST_SPLITS: u32 = 7;
const SMALLEST_EDGE: f64 = 1.0 / 256.0;

/// Steps of the search for a plane between a shaft and a triangle.
const MOST_STEPS: u32 = 16;

/// Cosines below it do not tell on which side something is, as the normals of the passes are rounded.
const GRAZING: f64 = 1e-3;

/// Most radiance of a light: so much less than the largest float that what a surface emits is lost in the rounding of that.
const MOST_EMISSION: f32 = 1e30;

/// Area of a light over its longest edge and its distance; of smaller ones the closed form has too few digits.
const SMALLEST_LIGHT: f64 = 0.01;

/// A triangle of the scene.
struct Face {
    instance: u32,
    corners: [DVec3; 3],
    /// Of length 1, before the front face; zero without area.
    normal: DVec3,
    /// By how far rays start off it.
    margin: f64,
    /// What hides lights for certain: itself without an alpha mask, and what it is half of.
    hides: Vec<Polygon>,
    /// Its material has no specular lobe.
    lambertian: bool,
}

/// A convex polygon of triangles that rays don't slip between.
struct Polygon {
    /// In order about `normal`.
    corners: Vec<DVec3>,
    normal: DVec3,
    margin: f64,
}

/// An emissive triangle.
struct Lamp {
    corners: [DVec3; 3],
    normal: DVec3,
    margin: f64,
    two_sided: bool,
    /// The largest channel of its radiance.
    emission: f32,
    /// The longest edge, and the area over that.
    longest: f64,
    width: f64,
}

/// What is known of a light from a part of a triangle.
#[derive(Clone)]
enum Sight {
    /// Every point sees it whole.
    Whole,
    /// No point receives anything of it.
    Nothing,
    /// It is to be sampled wherever in the part: every point sees it, but not whole, or it is too small or in the same plane.
    Sampled,
    /// None of these, as far as is known, and what may be in the way.
    Unknown(Vec<u32>),
}

/// Trees over the triangles of each instance, as words of `records` from `start` on.
pub(super) struct Trees {
    pub(super) words: Vec<u32>,
    /// Where those of each instance that is drawn start.
    pub(super) starts: Vec<u32>,
}

/// Looks into a scene that stands still and has only emissive triangles for lights. Nothing if it has too many triangles or
/// lights, or if light has a closed form nowhere.
pub(super) fn build(frame: &Frame, scene: &Scene, triangles_of: &[u32], start: u32) -> Option<Trees> {
    let count = triangles_of.iter().map(|&count| count as usize).sum::<usize>();
    if count > MOST_TRIANGLES || frame.light_count == 0 || frame.light_count > MOST_LIGHTS {
        return None;
    }
    let mut faces: Vec<Face> = (0..)
        .zip(triangles_of)
        .flat_map(|(instance, &count)| {
            let first = scene.instance_word(frame, instance, instance_record::FIRST_TRIANGLE);
            (first..first + count).map(move |triangle| Face::new(frame, scene, instance, triangle))
        })
        .collect();
    join_halves(&mut faces);
    let lamps: Vec<Lamp> = (0..frame.light_count).map(|id| Lamp::new(frame, scene, id)).collect();
    let corners = || faces.iter().flat_map(|face| face.corners);
    let low = corners().fold(DVec3::MAX, DVec3::min);
    let diagonal = low.distance(corners().fold(DVec3::MIN, DVec3::max));
    // Where squares of lengths lose no digits in the passes, and sums of light stay finite.
    let is_dim = lamps.iter().all(|lamp| lamp.emission <= MOST_EMISSION);
    if !(1e-6..1e6).contains(&diagonal) || !is_dim {
        return None;
    }
    let area = faces.iter().filter(|face| face.lambertian).map(Face::area).sum();
    let world = World { faces, lamps, smallest: diagonal * SMALLEST_EDGE, area };
    let trees: Vec<Part> = (0..world.faces.len()).into_par_iter().map(|face| world.tree(face)).collect();
    if trees.iter().all(|tree| matches!(tree, Part::Leaf(0))) {
        return None;
    }
    // The roots in the order of the triangles, then what is below them.
    let mut words = vec![0; trees.len()];
    for (root, tree) in trees.iter().enumerate() {
        tree.write(root, start, &mut words);
    }
    let starts = triangles_of.iter().scan(start, |next, count| {
        let at = *next;
        *next += count;
        Some(at)
    });
    Some(Trees { words, starts: starts.collect() })
}

/// A part of a triangle.
enum Part {
    /// The bits of [`node`], without that of a leaf.
    Leaf(u32),
    Split(Box<[Part; 4]>),
}

impl Part {
    /// Into word `at`, and behind all words what is below.
    fn write(&self, at: usize, start: u32, words: &mut Vec<u32>) {
        match self {
            Self::Leaf(bits) => words[at] = node::LEAF | bits,
            Self::Split(children) => {
                let first = words.len();
                words[at] = start + first as u32;
                words.resize(first + 4, 0);
                children.iter().enumerate().for_each(|(i, child)| child.write(first + i, start, words));
            }
        }
    }
}

impl Face {
    fn new(frame: &Frame, scene: &Scene, instance: u32, triangle: u32) -> Self {
        let at = scene.world_triangle(frame, instance, triangle);
        let material = scene.material_of(frame, instance, triangle);
        let is_zero = |field| scene.material_rgb(material, field) == glam::Vec3::ZERO;
        let corners = [at.a, at.b, at.c].map(|corner| corner.as_dvec3());
        let (normal, margin) = (normal_of(&at), f64::from(at.error()));
        let in_order = if at.facing > 0.0 { corners.to_vec() } else { corners.into_iter().rev().collect() };
        let is_masked = scene.material_word(material, material_record::ALPHA_TEXTURE) != NO_TEXTURE;
        Self {
            instance,
            corners,
            normal,
            margin,
            hides: if is_masked { Vec::new() } else { vec![Polygon { corners: in_order, normal, margin }] },
            lambertian: is_zero(material_record::SPECULAR)
                && scene.material_float(material, material_record::METALLIC) == 0.0,
        }
    }

    fn area(&self) -> f64 {
        let [a, b, c] = self.corners;
        0.5 * (b - a).cross(c - a).length()
    }

    /// The point with weights `u` and `v` of the second and third corner.
    fn point(&self, u: f64, v: f64) -> DVec3 {
        let [a, b, c] = self.corners;
        a + (b - a) * u + (c - a) * v
    }
}

/// To each triangle the convex polygons that it makes with another one which shares an edge and its plane.
fn join_halves(faces: &mut [Face]) {
    for i in 0..faces.len() {
        for k in i + 1..faces.len() {
            if let Some(whole) = joined(&faces[i], &faces[k]) {
                faces[i].hides.push(whole);
            }
        }
    }
}

/// The quadrilateral of two triangles.
fn joined(one: &Face, other: &Face) -> Option<Polygon> {
    let (a, b) = (one.hides.first()?, other.hides.first()?);
    // Rays are tested in the space of an instance, where the triangles share their corners.
    let is_alike = one.instance == other.instance && one.normal.dot(other.normal) > 1.0 - 1e-12;
    let is_in_plane = |p: &DVec3| one.normal.dot(*p - one.corners[0]).abs() < 0.01 * one.margin;
    if !is_alike || !other.corners.iter().all(is_in_plane) {
        return None;
    }
    // An edge from p to q of one is from q to p of the other.
    let (i, k) = (0..9)
        .map(|i| (i / 3, i % 3))
        .find(|&(i, k)| a.corners[i] == b.corners[(k + 1) % 3] && a.corners[(i + 1) % 3] == b.corners[k])?;
    let corners = [a.corners[i], b.corners[(k + 2) % 3], a.corners[(i + 1) % 3], a.corners[(i + 2) % 3]];
    let turns_left = |i: usize| {
        let [p, q, r] = [0, 1, 2].map(|step| corners[(i + step) % 4]);
        one.normal.dot((q - p).cross(r - q)) >= 0.0
    };
    let margin = one.margin.max(other.margin);
    (0..4).all(turns_left).then(|| Polygon { corners: corners.to_vec(), normal: one.normal, margin })
}

impl Polygon {
    /// Whether the line between two points on either side cuts it, clear of its edges.
    fn cuts(&self, from: DVec3, to: DVec3) -> bool {
        let distance = |p: DVec3| self.normal.dot(p - self.corners[0]);
        let (before, behind) = (distance(from), distance(to));
        if before * behind >= 0.0 || before.abs().min(behind.abs()) < 4.0 * self.margin {
            return false;
        }
        let cut = from + (to - from) * (before / (before - behind));
        let count = self.corners.len();
        (0..count).all(|i| {
            let (start, end) = (self.corners[i], self.corners[(i + 1) % count]);
            let inward = self.normal.cross(end - start).normalize_or_zero();
            inward.dot(cut - start) > 4.0 * self.margin
        })
    }
}

fn normal_of(triangle: &weir_shared::scene::WorldTriangle) -> DVec3 {
    let (a, b, c) = (triangle.a.as_dvec3(), triangle.b.as_dvec3(), triangle.c.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero() * f64::from(triangle.facing)
}

impl Lamp {
    fn new(frame: &Frame, scene: &Scene, id: u32) -> Self {
        let place = light::find(frame, scene, id);
        let at = scene.world_triangle(frame, place.instance, place.triangle);
        let material = scene.material_of(frame, place.instance, place.triangle);
        let corners = [at.a, at.b, at.c].map(|corner| corner.as_dvec3());
        let longest = (0..3).map(|i| corners[i].distance(corners[(i + 1) % 3])).fold(0.0, f64::max);
        let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        Self {
            corners,
            normal: normal_of(&at),
            margin: f64::from(at.error()),
            two_sided: scene.material_word(material, material_record::TWO_SIDED) != 0,
            emission: scene.emission(frame, place.instance, material).max_element(),
            longest,
            width: if longest > 0.0 { area / longest } else { 0.0 },
        }
    }
}

/// The scene, as it is looked into.
struct World {
    faces: Vec<Face>,
    lamps: Vec<Lamp>,
    /// Edge of parts that are not split.
    smallest: f64,
    /// Of all triangles without a specular lobe.
    area: f64,
}

/// One side of a triangle, or of a part of it.
struct Side<'a> {
    face: &'a Face,
    /// Toward the side.
    normal: DVec3,
    /// Corners of a parallelogram around the part.
    corners: [DVec3; 4],
}

impl World {
    /// The tree over a triangle, both its sides.
    fn tree(&self, number: usize) -> Part {
        let face = &self.faces[number];
        if !face.lambertian || face.normal == DVec3::ZERO {
            return Part::Leaf(0);
        }
        let all: Vec<u32> = (0..self.faces.len() as u32).collect();
        let unknown = || vec![Sight::Unknown(all.clone()); self.lamps.len()];
        let [a, b, c] = face.corners;
        let longest = a.distance(b).max(a.distance(c));
        let splits = (longest / self.smallest).log2().ceil().clamp(0.0, f64::from(MOST_SPLITS)) as u32;
        let mut tests = (MOST_TESTS * face.area() / self.area) as usize;
        self.part(face, [0.0, 0.0], 1.0, splits, [unknown(), unknown()], &mut tests)
    }

    /// The part that starts at weights `at` and reaches over `size` of both; `tests`: how many are left.
    fn part(
        &self,
        face: &Face,
        at: [f64; 2],
        size: f64,
        splits: u32,
        mut sights: [Vec<Sight>; 2],
        tests: &mut usize,
    ) -> Part {
        let [u, v] = at;
        if u + v >= 1.0 {
            return Part::Leaf(0);
        }
        let corners = [[u, v], [u + size, v], [u, v + size], [u + size, v + size]].map(|[u, v]| face.point(u, v));
        let (mut bits, mut may_become_known) = (0, false);
        for (back, sights) in sights.iter_mut().enumerate() {
            let normal = if back == 0 { face.normal } else { -face.normal };
            let side = Side { face, normal, corners };
            for (sight, lamp) in sights.iter_mut().zip(&self.lamps) {
                if let Sight::Unknown(between) = sight {
                    if *tests == 0 {
                        return Part::Leaf(bits);
                    }
                    *sight = self.look(&side, lamp, between, tests);
                }
            }
            if sights.iter().any(|sight| matches!(sight, Sight::Sampled)) {
                continue;
            }
            if sights.iter().any(|sight| matches!(sight, Sight::Unknown(_))) {
                may_become_known = true;
                continue;
            }
            bits |= node::KNOWN << back;
            for (i, _) in sights.iter().enumerate().filter(|(_, sight)| matches!(sight, Sight::Whole)) {
                bits |= 1 << (i as u32 + back as u32 * node::BACK_SHIFT);
            }
        }
        if !may_become_known || splits == 0 {
            return Part::Leaf(bits);
        }
        let half = size * 0.5;
        let children = [[u, v], [u + half, v], [u, v + half], [u + half, v + half]]
            .map(|at| self.part(face, at, half, splits - 1, sights.clone(), tests));
        match &children {
            [Part::Leaf(a), Part::Leaf(b), Part::Leaf(c), Part::Leaf(d)] if a == b && a == c && a == d => {
                Part::Leaf(*a)
            }
            _ => Part::Split(Box::new(children)),
        }
    }

    /// What is known of a light from a part, of which only `between` may be in the way; takes what it does off `tests`.
    fn look(&self, side: &Side, lamp: &Lamp, between: &[u32], tests: &mut usize) -> Sight {
        let mut spend = |count: usize| *tests = tests.saturating_sub(count);
        spend(1);
        let pairs = || side.corners.into_iter().flat_map(|from| lamp.corners.map(|to| to - from));
        // Cosines, as what grazes is on either side.
        let all = |test: &dyn Fn(DVec3) -> bool| pairs().all(|toward| test(toward.normalize_or_zero()));
        let is_behind_lamp = all(&|d| lamp.normal.dot(d) > GRAZING);
        let is_behind_part = all(&|d| side.normal.dot(d) < -GRAZING);
        if is_behind_part || (is_behind_lamp && !lamp.two_sided) || lamp.width == 0.0 {
            return Sight::Nothing;
        }
        let [a, b, c, _] = side.corners;
        let nearest =
            pairs().map(DVec3::length).fold(f64::INFINITY, f64::min) - b.distance(c).max(a.distance(b)) - lamp.longest;
        let is_level = all(&|d| side.normal.dot(d).abs() < GRAZING);
        if is_level || lamp.width < SMALLEST_LIGHT * nearest {
            return Sight::Sampled;
        }
        if !is_behind_lamp && !all(&|d| lamp.normal.dot(d) < -GRAZING) {
            return Sight::Unknown(between.to_vec());
        }
        let from = side.corners.map(|corner| corner + side.normal * side.face.margin);
        let off = lamp.normal * if is_behind_lamp { -lamp.margin } else { lamp.margin };
        // What of it is above the horizon; the rest lights nothing.
        let to: Vec<DVec3> =
            clipped(&lamp.corners, from[0], side.normal).into_iter().map(|corner| corner + off).collect();
        if to.is_empty() {
            return Sight::Sampled;
        }
        spend(between.len() * SHAFT);
        let clear = 0.5 * side.face.margin.min(lamp.margin);
        let shaft = Shaft { from, to: &to, clear, axes: [side.normal, lamp.normal] };
        let is_between = |i: &u32| !shaft.is_clear_of(&self.faces[*i as usize]);
        let between: Vec<u32> = between.iter().copied().filter(is_between).collect();
        let is_small = lamp.width < SMALLEST_LIGHT * pairs().map(DVec3::length).fold(0.0, f64::max);
        if between.is_empty() {
            return if is_small { Sight::Unknown(between) } else { Sight::Whole };
        }
        spend(between.len() * (2 * to.len() + SHAFT));
        let polygons = || between.iter().flat_map(|&i| &self.faces[i as usize].hides);
        let hides = |polygon: &Polygon, to: DVec3| from.into_iter().all(|from| polygon.cuts(from, to));
        if polygons().any(|polygon| to.iter().all(|to| hides(polygon, *to))) {
            return Sight::Nothing;
        }
        // A corner that no point sees, and one that every point does.
        let is_hidden: Vec<bool> = to.iter().map(|to| polygons().any(|polygon| hides(polygon, *to))).collect();
        let is_seen = |to: &DVec3| {
            let shaft = Shaft { to: std::slice::from_ref(to), ..shaft };
            between.iter().all(|&i| shaft.is_clear_of(&self.faces[i as usize]))
        };
        if is_hidden.contains(&true) && to.iter().zip(&is_hidden).any(|(to, is_hidden)| !is_hidden && is_seen(to)) {
            return Sight::Sampled;
        }
        Sight::Unknown(between)
    }
}

/// What of a convex polygon lies beyond the plane through `from` with that normal.
fn clipped(corners: &[DVec3], from: DVec3, normal: DVec3) -> Vec<DVec3> {
    let height = |p: DVec3| normal.dot(p - from);
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (i, &p) in corners.iter().enumerate() {
        let q = corners[(i + 1) % corners.len()];
        let (at_p, at_q) = (height(p), height(q));
        if at_p >= 0.0 {
            kept.push(p);
        }
        if (at_p >= 0.0) != (at_q >= 0.0) {
            kept.push(p + (q - p) * (at_p / (at_p - at_q)));
        }
    }
    kept
}

/// The hull of a part of a triangle and a light, both as far off their planes as rays start and end.
#[derive(Clone, Copy)]
struct Shaft<'a> {
    from: [DVec3; 4],
    to: &'a [DVec3],
    /// How far from it everything else has to be.
    clear: f64,
    /// Directions that are tried first.
    axes: [DVec3; 2],
}

impl Shaft<'_> {
    /// Whether some plane is found that has the triangle on its other side.
    fn is_clear_of(&self, face: &Face) -> bool {
        let [first, second] = self.axes;
        // Rays lose digits at the ends of the shaft and at the triangle.
        let clear = self.clear.max(0.5 * face.margin);
        let is_apart = |axis| self.gap(axis, face.corners).0 > clear * clear * axis.length_squared();
        // Planes in parallel to the triangle, to both ends, to the axes of space; then any.
        [face.normal, first, second, DVec3::X, DVec3::Y, DVec3::Z].into_iter().any(is_apart)
            || (!self.is_cut_by(face) && self.is_apart_from(face.corners, clear))
    }

    /// Whether a triangle cuts a line between corners, within rounding: then there is no plane to look for.
    fn is_cut_by(&self, face: &Face) -> bool {
        let [a, b, c] = face.corners;
        self.from.iter().any(|&from| {
            self.to.iter().any(|&to| {
                let along = to - from;
                let volume = |p: DVec3, q: DVec3| along.dot((p - from).cross(q - from));
                let (ab, bc, ca) = (volume(a, b), volume(b, c), volume(c, a));
                let is_through = (ab > 0.0 && bc > 0.0 && ca > 0.0) || (ab < 0.0 && bc < 0.0 && ca < 0.0);
                is_through && face.normal.dot(from - a) * face.normal.dot(to - a) < 0.0
            })
        })
    }

    /// Looks for the point of the hull of all differences between both that is nearest to zero: the plane through it, if
    /// any, separates them. Source: Frank and Wolfe 1956, with exact steps.
    fn is_apart_from(&self, corners: [DVec3; 3], clear: f64) -> bool {
        let mut nearest = self.from[0] - corners[0];
        for _ in 0..MOST_STEPS {
            let (gap, vertex) = self.gap(nearest, corners);
            if gap > clear * clear * nearest.length_squared() {
                return true;
            }
            let step = vertex - nearest;
            let share = -nearest.dot(step) / step.length_squared();
            if share <= 1e-9 || share.is_nan() {
                return false;
            }
            nearest += step * share.min(1.0);
        }
        false
    }

    /// How far it lies beyond the triangle along an axis that need not have length 1, on either side, squared and with the
    /// sign of a gap; and the difference of the two corners that are nearest, where it lies toward the axis.
    fn gap(&self, axis: DVec3, corners: [DVec3; 3]) -> (f64, DVec3) {
        let (mut low, mut high, mut lowest) = (f64::INFINITY, f64::NEG_INFINITY, self.from[0]);
        for &p in self.from.iter().chain(self.to) {
            let x = axis.dot(p);
            if x < low {
                (low, lowest) = (x, p);
            }
            high = high.max(x);
        }
        let (mut other_low, mut other_high, mut highest) = (f64::INFINITY, f64::NEG_INFINITY, corners[0]);
        for p in corners {
            let x = axis.dot(p);
            if x > other_high {
                (other_high, highest) = (x, p);
            }
            other_low = other_low.min(x);
        }
        let gap = (low - other_high).max(other_low - high);
        (gap * gap.abs(), lowest - highest)
    }
}

#[cfg(test)]
mod tests;
