//! Whom a pixel reuses samples from: a matter of geometry alone. What a reservoir holds must have no say in it, or the
//! picture would be biased.

use core::f32::consts::TAU;
use glam::{UVec2, Vec3};

use crate::{
    frame::Frame,
    numerics::{abs, clamp, exp2, load, log2, max, multiply_high, sin_cos, sqrt},
    octahedral,
    resample::{MAX_KEPT, NOT_KEPT, WithoutReplacement},
    reservoir::{MAX_INPUTS, Reservoir},
    rng::{Rng, Stage},
    scene::{NO_INSTANCE, Scene, instance_record},
    surface::Surface,
    target::project,
    words::Words,
};

/// How neighbours are found.
pub mod rule {
    /// Similar surfaces at low-discrepancy points of a disk.
    pub const DISK: u32 = 0;
    /// The most compatible of sixteen points of the disk, without replacement, in proportion to a score of distance
    /// and normal. Source: Efraimidis and Spirakis 2006 for the choice.
    pub const COMPATIBLE: u32 = 1;
    /// Pairs of pixels that have each other for neighbours.
    pub const PAIRED: u32 = 2;
}

/// What part shadow rays have in reuse.
pub mod probe {
    /// None: the targets are those without visibility.
    pub const NONE: u32 = 0;
    /// One: from the domain of one input, which stands for all, to the pixel's own sample. Enough to be unbiased where
    /// every reservoir lost its sample if that was hidden, and the merged one will.
    pub const ONE: u32 = 1;
    /// That one, and one from the pixel to the sample of every other input.
    pub const ALL: u32 = 2;
}

/// Which pixels have reservoirs of full quality; others offer few candidates of their own and reuse those.
pub mod lattice {
    /// All.
    pub const FULL: u32 = 0;
    /// Every other one, as on a checkerboard.
    pub const CHECKERBOARD: u32 = 1;
    /// One of four.
    pub const HALF: u32 = 2;
}

/// Steps of a sequence that fills a square evenly, the second as an angle: 0.56984 of a turn. Source: Roberts 2018, "The
/// Unreasonable Effectiveness of Quasirandom Sequences".
const R2_AREA: f32 = 0.754_877_7;
const R2_COSINE: f32 = -0.905_205_3;
const R2_SINE: f32 = -0.424_963_1;

/// Pixels to take reservoirs from; at most one less than [`MAX_INPUTS`]. They lie within 127 pixels of the first pixel
/// asked about.
#[derive(Clone, Copy)]
pub struct Neighbors {
    /// How many.
    pub count: u32,
    /// Not a vector: naga would round the size of the struct up.
    center: [u32; 2],
    /// Two offsets from the center each, of two signed bytes.
    offsets: Words,
}

impl Neighbors {
    /// None yet, of those around `center`.
    #[inline(always)]
    pub fn around(center: UVec2) -> Self {
        Self { count: 0, center: [center.x, center.y], offsets: Words::ZERO }
    }

    /// Neighbour number `i`.
    #[inline(always)]
    pub fn get(&self, i: u32) -> UVec2 {
        let offset = self.offsets.get(i >> 1) >> ((i & 1) * 16);
        let (x, y) = (offset & 0xff, (offset >> 8) & 0xff);
        UVec2::new(
            self.center[0].wrapping_add(x).wrapping_sub(OFFSET_BIAS),
            self.center[1].wrapping_add(y).wrapping_sub(OFFSET_BIAS),
        )
    }

    /// One more; nothing if there is no room.
    #[inline(always)]
    pub fn push(&mut self, px: UVec2) {
        if self.count + 1 < MAX_INPUTS {
            self.put(self.count, px);
        }
    }

    /// Neighbour number `i`, in place of the one there or as one more.
    #[inline(always)]
    fn put(&mut self, i: u32, px: UVec2) {
        let x = px.x.wrapping_add(OFFSET_BIAS).wrapping_sub(self.center[0]) & 0xff;
        let y = px.y.wrapping_add(OFFSET_BIAS).wrapping_sub(self.center[1]) & 0xff;
        let shift = (i & 1) * 16;
        let kept = self.offsets.get(i >> 1) & !(0xffff << shift);
        self.offsets.set(i >> 1, kept | ((x | (y << 8)) << shift));
        self.count = self.count.max(i + 1);
    }
}

/// Zero among the offsets.
const OFFSET_BIAS: u32 = 128;

/// Whether a pixel has a reservoir of full quality.
#[inline(always)]
pub fn is_on_lattice(frame: &Frame, px: UVec2) -> bool {
    if frame.lattice == lattice::CHECKERBOARD {
        (px.x ^ px.y) & 1 == 0
    } else if frame.lattice == lattice::HALF {
        (px.x | px.y) & 1 == 0
    } else {
        true
    }
}

/// The nearest pixel on the lattice, up and to the left.
#[inline(always)]
pub fn onto_lattice(frame: &Frame, px: UVec2) -> UVec2 {
    if frame.lattice == lattice::CHECKERBOARD {
        let odd = (px.x ^ px.y) & 1;
        // In the first column, the pixel above.
        if px.x >= odd { UVec2::new(px.x - odd, px.y) } else { UVec2::new(px.x, px.y - odd) }
    } else if frame.lattice == lattice::HALF {
        UVec2::new(px.x & !1, px.y & !1)
    } else {
        px
    }
}

/// What of a surface decides who its neighbours are.
#[derive(Clone, Copy)]
pub struct Site {
    /// World space.
    pub position: Vec3,
    /// Geometric normal.
    pub normal: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
    /// From the camera.
    pub distance: f32,
}

impl Site {
    /// A surface seen from `camera`.
    #[inline(always)]
    pub fn new(surface: &Surface, position: Vec3, camera: Vec3) -> Self {
        Self {
            position,
            normal: surface.normal_geometric(),
            roughness: surface.roughness(),
            distance: sqrt((position - camera).length_squared()),
        }
    }

    /// Whether samples for `surface` are likely to be of use here.
    #[inline(always)]
    pub fn is_similar(&self, frame: &Frame, surface: &Surface) -> bool {
        // Without the lengths' square roots: this runs for every try.
        let normal = octahedral::unpack_direction(surface.normal_geometric);
        let along = self.normal.dot(normal);
        let limit = frame.normal_cosine * abs(frame.normal_cosine) * normal.length_squared();
        !surface.is_settled()
            && along * abs(along) >= limit
            && abs(self.normal.dot(surface.position() - self.position)) <= frame.plane_tolerance * self.distance
            && abs(self.roughness - surface.roughness()) <= frame.roughness_tolerance
    }
}

/// Finds up to `wanted` neighbours of the point `center` (in pixels) among the surfaces of a frame. `own` is the pixel
/// that asks, if it is of the same frame, and is never its own neighbour.
#[inline(always)]
pub fn find_neighbors(
    frame: &Frame,
    surfaces: &[Surface],
    site: &Site,
    center: [f32; 2],
    own: UVec2,
    wanted: u32,
    rng: &mut Rng,
    neighbors: &mut Neighbors,
) {
    if wanted == 0 {
        return;
    }
    if frame.neighbor_rule == rule::PAIRED {
        find_pairs(frame, surfaces, site, own, wanted, rng, neighbors);
    } else if frame.neighbor_rule == rule::COMPATIBLE {
        find_compatible(frame, surfaces, site, center, own, wanted, rng, neighbors);
    } else {
        find_in_disk(frame, surfaces, site, center, own, wanted, rng, neighbors);
    }
}

/// Points of a sequence that fills the disk of `frame.radius_px` around `center` evenly, wherever it is cut off.
#[derive(Clone, Copy)]
struct DiskPoints {
    center: [f32; 2],
    /// Share of the area within.
    area: f32,
    sine: f32,
    cosine: f32,
}

impl DiskPoints {
    #[inline(always)]
    fn new(center: [f32; 2], rng: &mut Rng) -> Self {
        let (sine, cosine) = sin_cos(rng.next_float() * TAU);
        Self { center, area: rng.next_float(), sine, cosine }
    }

    /// The next point; the first number is false outside the image.
    #[inline(always)]
    fn next(&mut self, frame: &Frame) -> (bool, UVec2) {
        let radius = frame.radius_px * sqrt(self.area);
        let (x, y) = (self.center[0] + radius * self.cosine, self.center[1] + radius * self.sine);
        self.area += R2_AREA;
        if self.area >= 1.0 {
            self.area -= 1.0;
        }
        (self.sine, self.cosine) =
            (self.sine * R2_COSINE + self.cosine * R2_SINE, self.cosine * R2_COSINE - self.sine * R2_SINE);
        let inside = x >= 0.0 && y >= 0.0 && x < frame.width as f32 && y < frame.height as f32;
        let px = if inside { onto_lattice(frame, UVec2::new(x as u32, y as u32)) } else { UVec2::ZERO };
        (inside, px)
    }
}

#[inline(always)]
fn find_in_disk(
    frame: &Frame,
    surfaces: &[Surface],
    site: &Site,
    center: [f32; 2],
    own: UVec2,
    wanted: u32,
    rng: &mut Rng,
    neighbors: &mut Neighbors,
) {
    let mut points = DiskPoints::new(center, rng);
    let limit = (neighbors.count + wanted).min(MAX_INPUTS - 1);
    // Three times as many tries: edges and corners have fewer similar pixels.
    let mut i = 0;
    while i < 3 * wanted && neighbors.count < limit {
        let (inside, px) = points.next(frame);
        if inside && px != own && site.is_similar(frame, &load(surfaces, frame.index_of(px))) {
            neighbors.push(px);
        }
        i += 1;
    }
}

#[inline(always)]
fn find_compatible(
    frame: &Frame,
    surfaces: &[Surface],
    site: &Site,
    center: [f32; 2],
    own: UVec2,
    wanted: u32,
    rng: &mut Rng,
    neighbors: &mut Neighbors,
) {
    const TRIES: u32 = 16;
    const _: () =
        assert!(MAX_INPUTS - 1 <= MAX_KEPT && MAX_INPUTS - 1 <= TRIES, "any number of neighbours may be asked for");
    // A cone of 0.05 sr at the camera: the size at the surface beyond which the lights differ.
    const SPREAD: f32 = 0.126;
    let mut points = DiskPoints::new(center, rng);
    let first = neighbors.count;
    let mut keys = WithoutReplacement::new(wanted.min(MAX_INPUTS - 1 - first));
    let mut i = 0;
    while i < TRIES {
        let (inside, px) = points.next(frame);
        if inside && px != own {
            let surface = load(surfaces, frame.index_of(px));
            if site.is_similar(frame, &surface) {
                let apart = sqrt((surface.position() - site.position).length_squared());
                let cosine = max(site.normal.dot(surface.normal_geometric()), 1e-4);
                // exp(-apart / spread) * cosine^8.
                let falloff = -apart / (SPREAD * site.distance + 1e-30) * core::f32::consts::LOG2_E;
                let weight = max(exp2(falloff + 8.0 * log2(cosine)), 1e-8);
                let place = keys.offer(weight, rng.next_positive_float());
                if place != NOT_KEPT {
                    neighbors.put(first + place, px);
                }
            }
        }
        i += 1;
    }
}

/// Partners by an exchange of bits of the shifted coordinates: the partner's partner is the pixel itself. Shift and
/// bits are the same for all pixels of a frame and round, so that what a reservoir holds has no part in it.
#[inline(always)]
fn find_pairs(
    frame: &Frame,
    surfaces: &[Surface],
    site: &Site,
    own: UVec2,
    wanted: u32,
    rng: &mut Rng,
    neighbors: &mut Neighbors,
) {
    // An exchange of the bits below `span` moves a pixel by less than `span`.
    let span = 1u32 << (log2(max(frame.radius_px, 2.0)) as u32);
    let limit = (neighbors.count + wanted).min(MAX_INPUTS - 1);
    let mut i = 0;
    while i < wanted && neighbors.count < limit {
        let bits = rng.next_four();
        let shift = UVec2::new(bits[0] & 0xffff, bits[1] & 0xffff);
        let exchange = UVec2::new(bits[2] & (span - 1), (bits[2] >> 16) & (span - 1));
        let x = ((own.x + shift.x) ^ exchange.x).wrapping_sub(shift.x);
        let y = ((own.y + shift.y) ^ exchange.y).wrapping_sub(shift.y);
        let px = UVec2::new(x, y);
        if x < frame.width && y < frame.height && px != own {
            let surface = load(surfaces, frame.index_of(px));
            if site.is_similar(frame, &surface) {
                neighbors.push(px);
            }
        }
        i += 1;
    }
}

/// Where a surface was in the frame before, in world space; false and where it is now, if its instance was not there.
#[inline(always)]
pub fn previous_position(frame: &Frame, prev_frame: &Frame, scene: &Scene, surface: &Surface) -> (bool, Vec3) {
    let position = surface.position();
    if frame.instances_at == prev_frame.instances_at {
        return (true, position);
    }
    let counterpart = scene.instance_word(frame, surface.instance(), instance_record::COUNTERPART);
    if counterpart == NO_INSTANCE {
        return (false, position);
    }
    let here = scene.instance_at(frame, surface.instance());
    let position_object = scene.transform_point(here + instance_record::OBJECT_FROM_WORLD, position);
    let there = scene.instance_at(prev_frame, counterpart);
    (true, scene.transform_point(there + instance_record::WORLD_FROM_OBJECT, position_object))
}

/// The past of a pixel: the pixel where its surface was, if what was seen there is similar, and neighbours of it. Where
/// the surface was not seen, because it was hidden, off the image or not there at all, neighbours alone, of the place on
/// the image that is nearest to it.
#[inline(always)]
pub fn find_past(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    prev_frame: &Frame,
    scene: &Scene,
    surface: &Surface,
    prev_surfaces: &[Surface],
) -> Neighbors {
    let mut past = Neighbors::around(px);
    if frame.has_history == 0 || surface.is_settled() {
        return past;
    }
    let (_, position) = previous_position(frame, prev_frame, scene, surface);
    let offset = position - prev_frame.camera_origin;
    if !(offset.dot(prev_frame.camera_forward) > 0.0) {
        return past;
    }
    let projected = project(prev_frame, offset);
    let (width, height) = (frame.width as f32, frame.height as f32);
    // Half a pixel from the border at least, so that a whole number of pixels is within.
    let center = [clamp(projected[0], 0.5, width - 0.5), clamp(projected[1], 0.5, height - 0.5)];
    let on_image = projected[0] >= 0.0 && projected[1] >= 0.0 && projected[0] < width && projected[1] < height;
    let site = Site::new(surface, position, prev_frame.camera_origin);
    let same = onto_lattice(frame, UVec2::new(center[0] as u32, center[1] as u32));
    let seen = on_image && site.is_similar(frame, &load(prev_surfaces, frame.index_of(same)));
    past = Neighbors::around(same);
    if seen {
        past.push(same);
    }
    let wanted = if seen { frame.temporal_neighbors } else { frame.temporal_neighbors_unseen };
    if wanted > 0 {
        // In the past, only the pixel that stands for the present one is excluded, as it is an input already.
        let mut rng = input_rng(px, reservoir, frame, Stage::TemporalInputs);
        find_neighbors(frame, prev_surfaces, &site, center, same, wanted, &mut rng, &mut past);
    }
    past
}

/// Neighbours of a pixel in the same frame. `confidence`: of its reservoir; 1 tells that it has no past.
#[inline(always)]
pub fn find_present(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    surface: &Surface,
    surfaces: &[Surface],
    confidence: u32,
) -> Neighbors {
    let mut neighbors = Neighbors::around(px);
    if surface.is_settled() {
        return neighbors;
    }
    let site = Site::new(surface, surface.position(), frame.camera_origin);
    let wanted = if confidence > 1 { frame.spatial_neighbors } else { frame.spatial_neighbors_unseen };
    let mut rng = input_rng(px, reservoir, frame, Stage::SpatialInputs);
    let center = [px.x as f32 + 0.5, px.y as f32 + 0.5];
    find_neighbors(frame, surfaces, &site, center, px, wanted, &mut rng, &mut neighbors);
    neighbors
}

/// Numbers for finding neighbours: pairs need the same for all pixels.
#[inline(always)]
fn input_rng(px: UVec2, reservoir: u32, frame: &Frame, stage: Stage) -> Rng {
    if frame.neighbor_rule == rule::PAIRED {
        Rng::for_frame(frame, stage)
    } else {
        Rng::for_reservoir(px, reservoir, frame, stage)
    }
}

/// The inputs of a merge: the pixel's own reservoir is number 0, neighbour i is number i + 1.
#[derive(Clone, Copy)]
pub struct Chosen {
    /// Where the others are.
    pub neighbors: Neighbors,
    /// The input whose domain judges the pixel's own sample for all of them, drawn in proportion to confidence; 0: each
    /// does.
    pub partner: u32,
}

impl Chosen {
    /// Draws a partner where shadow rays have a part in reuse.
    #[inline(always)]
    pub fn new(
        px: UVec2,
        reservoir: u32,
        frame: &Frame,
        own: &Reservoir,
        neighbors: Neighbors,
        reservoirs: &[Reservoir],
        past: bool,
    ) -> Self {
        let mut chosen = Self { neighbors, partner: 0 };
        if frame.probe == probe::NONE {
            return chosen;
        }
        let stage = if past { Stage::TemporalPartner } else { Stage::SpatialPartner };
        let mut rng = Rng::for_reservoir(px, reservoir, frame, stage);
        // One of a stream, by integers: the last of those that take its place.
        let mut total = 0;
        let mut i = 1;
        while i <= neighbors.count {
            let confidence = chosen.confidence(reservoir, frame, own, reservoirs, past, i);
            total += confidence;
            if confidence > 0 && multiply_high(rng.next_word(), total) < confidence {
                chosen.partner = i;
            }
            i += 1;
        }
        chosen
    }

    /// Number of inputs.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.neighbors.count + 1
    }

    /// Confidence of an input; of the frame before (`past`), at most `frame.confidence_cap` times that of the pixel's
    /// own.
    #[inline(always)]
    pub fn confidence(
        &self,
        reservoir: u32,
        frame: &Frame,
        own: &Reservoir,
        reservoirs: &[Reservoir],
        past: bool,
        input: u32,
    ) -> u32 {
        if input == 0 {
            return own.confidence();
        }
        let there = load(reservoirs, frame.index_of_reservoir(self.pixel(input), reservoir)).confidence();
        if past { there.min(frame.confidence_cap.wrapping_mul(own.confidence())) } else { there }
    }

    /// Pixel of an input other than the first.
    #[inline(always)]
    pub fn pixel(&self, input: u32) -> UVec2 {
        self.neighbors.get(input - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octahedral::pack;

    const WIDTH: u32 = 64;
    const HEIGHT: u32 = 48;

    /// A floor seen from above, one unit a pixel, and a step in its middle.
    fn surfaces() -> Vec<Surface> {
        let surface = |i: u32| Surface {
            position: [(i % WIDTH) as f32, if i % WIDTH < WIDTH / 2 { 0.0 } else { 20.0 }, (i / WIDTH) as f32],
            normal_geometric: pack(Vec3::Y),
            normal_shading: pack(Vec3::Y),
            instance: 0x8000_0000,
            ..Surface::default()
        };
        (0..WIDTH * HEIGHT).map(surface).collect()
    }

    fn frame(rule: u32) -> Frame {
        Frame {
            width: WIDTH,
            height: HEIGHT,
            reservoirs: 1,
            neighbor_rule: rule,
            radius_px: 9.0,
            normal_cosine: 0.9,
            plane_tolerance: 0.02,
            roughness_tolerance: 0.1,
            spatial_neighbors: 6,
            spatial_neighbors_unseen: 6,
            camera_origin: Vec3::new(32.0, 100.0, 24.0),
            ..Frame::default()
        }
    }

    fn neighbors_of(px: UVec2, frame: &Frame, surfaces: &[Surface]) -> Vec<UVec2> {
        let surface = surfaces[frame.index_of(px) as usize];
        let found = find_present(px, 0, frame, &surface, surfaces, 1);
        (0..found.count).map(|i| found.get(i)).collect()
    }

    #[test]
    fn a_list_of_neighbours_gives_back_what_was_put_in() {
        let center = UVec2::new(100, 5);
        let mut list = Neighbors::around(center);
        let pixels: Vec<_> = (0..MAX_INPUTS - 1).map(|i| UVec2::new(i * 17, i * 9 % 50)).collect();
        pixels.iter().for_each(|&px| list.push(px));
        list.push(UVec2::ZERO);
        assert_eq!(list.count, MAX_INPUTS - 1, "no room for one more");
        for (i, px) in pixels.into_iter().enumerate() {
            assert_eq!(list.get(i as u32), px);
        }
    }

    #[test]
    fn neighbours_are_near_similar_inside_and_never_the_pixel_itself() {
        let surfaces = surfaces();
        for rule in [rule::DISK, rule::COMPATIBLE, rule::PAIRED] {
            let mut total = 0;
            for index in 0..40 {
                let frame = Frame { index, ..frame(rule) };
                for px in [UVec2::ZERO, UVec2::new(31, 20), UVec2::new(32, 20), UVec2::new(WIDTH - 1, HEIGHT - 1)] {
                    for there in neighbors_of(px, &frame, &surfaces) {
                        total += 1;
                        assert!(there.x < WIDTH && there.y < HEIGHT && there != px);
                        assert_eq!(there.x < WIDTH / 2, px.x < WIDTH / 2, "across the step");
                        let apart = there.as_vec2().distance(px.as_vec2());
                        assert!(apart < if rule == rule::PAIRED { 12.0 } else { 10.0 }, "{apart} pixels");
                    }
                }
            }
            assert!(total > 300, "rule {rule}: {total}");
        }
    }

    /// Frequencies of partners against confidence, by Pearson's test.
    #[test]
    fn partners_are_drawn_in_proportion_to_confidence() {
        const DRAWS: u32 = 200_000;
        let pixels = [3u32, 5, 4, 6, 1].map(|x| UVec2::new(x, 0));
        let mut neighbors = Neighbors::around(UVec2::ZERO);
        pixels.iter().for_each(|&px| neighbors.push(px));
        let mut reservoirs = vec![Reservoir::EMPTY; 8];
        for (px, confidence) in pixels.iter().zip([7, 0, 1, 15_000, 20]) {
            reservoirs[px.x as usize] = Reservoir::new(0, 0, 0.0, confidence);
        }
        let own = Reservoir::new(0, 0, 0.0, 2);
        for (past, expected) in [(false, [7.0, 0.0, 1.0, 15_000.0, 20.0]), (true, [7.0, 0.0, 1.0, 10.0, 10.0])] {
            let frame = |index| Frame {
                width: 8,
                height: 1,
                reservoirs: 1,
                confidence_cap: 5,
                probe: probe::ONE,
                index,
                ..Frame::default()
            };
            let mut counts = [0.0f64; 5];
            for index in 0..DRAWS {
                let chosen = Chosen::new(UVec2::ZERO, 0, &frame(index), &own, neighbors, &reservoirs, past);
                counts[chosen.partner as usize - 1] += 1.0;
            }
            assert_eq!(counts[1], 0.0, "no confidence");
            let total: f64 = expected.iter().sum();
            let statistic = |expected: [f64; 5]| -> f64 {
                let cells = counts.iter().zip(expected.map(|e| e / total * f64::from(DRAWS)));
                cells.filter(|(_, e)| *e > 0.0).map(|(c, e)| (c - e).powi(2) / e).sum()
            };
            // Quantile 1 - 1e-6 of the distribution with 3 degrees of freedom; and the teeth of the test.
            assert!(statistic(expected) < 30.7, "{counts:?} for {expected:?}");
            let [a, b, c, d, e] = expected;
            assert!(statistic([a, b, c, d + 0.3 * e, 0.7 * e]) > 30.7);
            let alone = Chosen::new(UVec2::ZERO, 0, &frame(0), &own, Neighbors::around(UVec2::ZERO), &reservoirs, past);
            assert_eq!(alone.partner, 0);
        }
    }

    #[test]
    fn as_many_compatible_neighbours_are_found_as_the_knobs_allow() {
        let (surfaces, px) = (surfaces(), UVec2::new(12, 20));
        for wanted in [1, 6, 12] {
            let frame =
                Frame { spatial_neighbors: wanted, spatial_neighbors_unseen: wanted, ..frame(rule::COMPATIBLE) };
            let most = (0..20).map(|index| neighbors_of(px, &Frame { index, ..frame }, &surfaces).len()).max();
            assert_eq!(most, Some(wanted as usize));
        }
    }

    #[test]
    fn pairs_have_each_other() {
        let (surfaces, frame) = (surfaces(), frame(rule::PAIRED));
        for i in 0..WIDTH * HEIGHT {
            let px = UVec2::new(i % WIDTH, i / WIDTH);
            for there in neighbors_of(px, &frame, &surfaces) {
                assert!(neighbors_of(there, &frame, &surfaces).contains(&px), "{px} and {there}");
            }
        }
    }

    #[test]
    fn on_a_lattice_neighbours_are_of_it() {
        let surfaces = surfaces();
        for lattice in [lattice::CHECKERBOARD, lattice::HALF] {
            let frame = Frame { lattice, ..frame(rule::DISK) };
            let share = (0..WIDTH * HEIGHT).filter(|i| is_on_lattice(&frame, UVec2::new(i % WIDTH, i / WIDTH))).count();
            assert_eq!(share * if lattice == lattice::HALF { 4 } else { 2 }, surfaces.len());
            for px in [UVec2::new(0, 3), UVec2::new(11, 20)] {
                let found = neighbors_of(px, &frame, &surfaces);
                assert!(!found.is_empty() && found.iter().all(|&there| is_on_lattice(&frame, there)));
            }
        }
    }

    /// Looking down at the floor, one unit a pixel, from above the point `x` of its middle row.
    fn look(x: f32) -> Frame {
        Frame {
            camera_origin: Vec3::new(x, 100.0, 24.0),
            camera_forward: Vec3::NEG_Y,
            camera_right: Vec3::X * 0.32,
            camera_up: Vec3::NEG_Z * 0.24,
            has_history: 1,
            confidence_cap: 5,
            temporal_neighbors: 1,
            temporal_neighbors_unseen: 4,
            ..frame(rule::DISK)
        }
    }

    const NOTHING: Scene = Scene { triangles: &[], records: &[], texels: &[] };

    #[test]
    fn a_still_surface_is_found_where_the_camera_before_saw_it() {
        let surfaces = surfaces();
        let (prev, now) = (look(32.0), Frame { temporal_neighbors: 0, ..look(33.0) });
        let surface = surfaces[prev.index_of(UVec2::new(10, 20)) as usize];
        let found = find_past(UVec2::new(9, 20), 0, &now, &prev, &NOTHING, &surface, &surfaces);
        assert_eq!((found.count, found.get(0)), (1, UVec2::new(10, 20)));
        let cut = Frame { has_history: 0, ..now };
        assert_eq!(find_past(UVec2::new(9, 20), 0, &cut, &prev, &NOTHING, &surface, &surfaces).count, 0);
    }

    /// Neighbours, and whether the first is the pixel that had the same surface, on average over frames.
    fn past_of(surface: &Surface, edit: impl Fn(Frame) -> Frame) -> Vec<Vec<UVec2>> {
        let surfaces = surfaces();
        let list = |index| {
            let now = edit(Frame { index, ..look(33.0) });
            let found = find_past(UVec2::new(9, 20), 0, &now, &look(32.0), &NOTHING, surface, &surfaces);
            (0..found.count).map(|i| found.get(i)).collect()
        };
        (0..20).map(list).collect()
    }

    #[test]
    fn a_surface_that_was_not_seen_gets_more_neighbours_from_the_past() {
        let floor = surfaces()[look(32.0).index_of(UVec2::new(10, 20)) as usize];
        assert!(past_of(&floor, |f| f).iter().all(|list| list.len() == 2 && list[0] == UVec2::new(10, 20)));
        // Hidden: what was seen there stands far above the floor.
        let hidden = surfaces()[look(32.0).index_of(UVec2::new(31, 20)) as usize];
        let hidden = Surface { position: [33.0, 0.0, 20.0], ..hidden };
        // Off the image, on the left.
        let outside = Surface { position: [-3.0, 0.0, 20.0], ..floor };
        for surface in [hidden, outside] {
            let lists = past_of(&surface, |f| f);
            let most = lists.iter().map(Vec::len).max();
            assert_eq!(most, Some(4), "{:?}", surface.position);
            for px in lists.iter().flatten() {
                assert!(px.x < WIDTH / 2, "{px} is another surface");
                assert!((px.x as f32 - surface.position[0]).abs() < 14.0, "{px} is far away");
            }
            assert!(past_of(&surface, |f| Frame { temporal_neighbors_unseen: 0, ..f }).iter().all(Vec::is_empty));
        }
        // Behind the camera no place on the image is near.
        let behind = Surface { position: [10.0, 200.0, 20.0], ..floor };
        assert!(past_of(&behind, |f| f).iter().all(Vec::is_empty));
    }

    #[test]
    fn a_pixel_without_a_past_gets_more_neighbours_from_its_frame() {
        let (surfaces, px) = (surfaces(), UVec2::new(12, 20));
        let frame = Frame { spatial_neighbors: 2, ..frame(rule::DISK) };
        let surface = surfaces[frame.index_of(px) as usize];
        for (confidence, wanted) in [(1, 6), (2, 2), (9, 2)] {
            let of = |index| find_present(px, 0, &Frame { index, ..frame }, &surface, &surfaces, confidence).count;
            assert_eq!((0..20).map(of).max(), Some(wanted));
        }
    }
}
