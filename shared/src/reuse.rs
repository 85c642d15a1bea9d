//! Whom a pixel reuses samples from: a matter of geometry alone. What a reservoir holds must have no say in it, or the
//! picture would be biased.

use core::f32::consts::TAU;
use glam::{UVec2, Vec3};

use crate::{
    frame::Frame,
    numerics::{abs, exp2, floor, load, log2, max, multiply_high, sin_cos, sqrt},
    reservoir::{MAX_INPUTS, Reservoir},
    rng::{Rng, Stage},
    scene::{NO_INSTANCE, Scene, instance_record},
    surface::Surface,
    target::project,
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

/// Points of the plane that fill a square evenly, whatever their number. Source: Roberts 2018, "The Unreasonable
/// Effectiveness of Quasirandom Sequences".
const R2: [f32; 2] = [0.754_877_7, 0.569_840_3];

/// Pixels to take reservoirs from, none of them twice in the same role; at most one less than [`MAX_INPUTS`].
#[derive(Clone, Copy)]
pub struct Neighbors {
    /// How many.
    pub count: u32,
    pixels: [u32; MAX_INPUTS as usize],
}

impl Neighbors {
    /// None yet.
    #[inline(always)]
    pub fn new() -> Self {
        Self { count: 0, pixels: [0; MAX_INPUTS as usize] }
    }

    /// Neighbour number `i`.
    #[inline(always)]
    pub fn get(&self, i: u32) -> UVec2 {
        let packed = self.pixels[(i % MAX_INPUTS) as usize];
        UVec2::new(packed & 0xffff, packed >> 16)
    }

    /// One more.
    #[inline(always)]
    pub fn push(&mut self, px: UVec2) {
        self.pixels[(self.count % MAX_INPUTS) as usize] = px.x | (px.y << 16);
        self.count += 1;
    }
}

impl Default for Neighbors {
    fn default() -> Self {
        Self::new()
    }
}

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
        !surface.is_sky()
            && self.normal.dot(surface.normal_geometric()) >= frame.normal_cosine
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

/// Point number `i` of a sequence that fills the disk of `frame.radius_px` around `center` evenly; outside the image,
/// no pixel.
#[inline(always)]
fn disk_point(frame: &Frame, center: [f32; 2], start: [f32; 2], i: u32) -> (bool, UVec2) {
    let fraction = |x: f32| x - floor(x);
    let radius = frame.radius_px * sqrt(fraction(start[0] + R2[0] * i as f32));
    let (sine, cosine) = sin_cos(fraction(start[1] + R2[1] * i as f32) * TAU);
    let (x, y) = (center[0] + radius * cosine, center[1] + radius * sine);
    let inside = x >= 0.0 && y >= 0.0 && x < frame.width as f32 && y < frame.height as f32;
    let px = if inside { onto_lattice(frame, UVec2::new(x as u32, y as u32)) } else { UVec2::ZERO };
    (inside, px)
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
    let start = [rng.next_float(), rng.next_float()];
    let limit = (neighbors.count + wanted).min(MAX_INPUTS - 1);
    // Three times as many tries: edges and corners have fewer similar pixels.
    let mut i = 0;
    while i < 3 * wanted && neighbors.count < limit {
        let (inside, px) = disk_point(frame, center, start, i);
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
    // A cone of 0.05 sr at the camera: the size at the surface beyond which the lights differ.
    const SPREAD: f32 = 0.126;
    let start = [rng.next_float(), rng.next_float()];
    let wanted = wanted.min(MAX_INPUTS - 1 - neighbors.count);
    let mut keys = [0.0f32; MAX_INPUTS as usize];
    let mut found = Neighbors::new();
    let mut i = 0;
    while i < TRIES {
        let (inside, px) = disk_point(frame, center, start, i);
        if inside && px != own {
            let surface = load(surfaces, frame.index_of(px));
            if site.is_similar(frame, &surface) {
                let apart = sqrt((surface.position() - site.position).length_squared());
                let cosine = max(site.normal.dot(surface.normal_geometric()), 1e-4);
                // Logarithm of exp(-apart / spread) * cosine^8.
                let score =
                    exp2(-apart / (SPREAD * site.distance + 1e-30) * core::f32::consts::LOG2_E + 8.0 * log2(cosine));
                let key = -log2(rng.next_positive_float()) / max(score, 1e-8);
                // The smallest keys stay: replace the largest once the list is full.
                if found.count < wanted {
                    keys[found.count as usize] = key;
                    found.push(px);
                } else {
                    let mut worst = 0;
                    let mut j = 1;
                    while j < found.count {
                        if keys[j as usize] > keys[worst as usize] {
                            worst = j;
                        }
                        j += 1;
                    }
                    if key < keys[worst as usize] {
                        keys[worst as usize] = key;
                        found.pixels[worst as usize] = px.x | (px.y << 16);
                    }
                }
            }
        }
        i += 1;
    }
    let mut i = 0;
    while i < found.count {
        neighbors.push(found.get(i));
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

/// Where a surface was in the frame before, in world space; false if its instance was not there.
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

/// The past of a pixel: the pixel where its surface was, if what was seen there is similar, and neighbours of it.
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
    let mut past = Neighbors::new();
    if frame.has_history == 0 || surface.is_sky() {
        return past;
    }
    let (existed, position) = previous_position(frame, prev_frame, scene, surface);
    let offset = position - prev_frame.camera_origin;
    if !existed || !(offset.dot(prev_frame.camera_forward) > 0.0) {
        return past;
    }
    let center = project(prev_frame, offset);
    let (width, height) = (frame.width as f32, frame.height as f32);
    if !(center[0] >= 0.0 && center[1] >= 0.0 && center[0] < width && center[1] < height) {
        return past;
    }
    let site = Site::new(surface, position, prev_frame.camera_origin);
    let same = onto_lattice(frame, UVec2::new(center[0] as u32, center[1] as u32));
    let seen = site.is_similar(frame, &load(prev_surfaces, frame.index_of(same)));
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
    let mut neighbors = Neighbors::new();
    if surface.is_sky() {
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

/// Confidence with which a reservoir of the frame before is trusted: at most `frame.confidence_cap` times that of the
/// pixel's own.
#[inline(always)]
pub fn capped_confidence(frame: &Frame, own: &Reservoir, prev: &Reservoir) -> u32 {
    prev.confidence().min(frame.confidence_cap.wrapping_mul(own.confidence()))
}

/// The inputs of a merge: the pixel's own reservoir is number 0, neighbour i is number i + 1.
#[derive(Clone, Copy)]
pub struct Chosen {
    /// Where the others are.
    pub neighbors: Neighbors,
    /// How much each is trusted.
    pub confidences: [u32; MAX_INPUTS as usize],
    /// The input whose domain judges the pixel's own sample for all of them; 0: each does.
    pub partner: u32,
}

impl Chosen {
    /// Looks up the confidences of the neighbours in `reservoirs`, `capped` or not, and draws a partner where shadow
    /// rays have a part.
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
        let mut confidences = [0; MAX_INPUTS as usize];
        confidences[0] = own.confidence();
        let mut total = 0;
        let mut i = 0;
        while i < neighbors.count {
            let there = load(reservoirs, frame.index_of_reservoir(neighbors.get(i), reservoir));
            let confidence = if past { capped_confidence(frame, own, &there) } else { there.confidence() };
            confidences[(i + 1) as usize] = confidence;
            total += confidence;
            i += 1;
        }
        let mut partner = 0;
        if frame.probe != probe::NONE && total > 0 {
            let stage = if past { Stage::TemporalPartner } else { Stage::SpatialPartner };
            let mut rest = multiply_high(Rng::for_reservoir(px, reservoir, frame, stage).next_word(), total);
            let mut i = 1;
            while i <= neighbors.count && partner == 0 {
                let confidence = confidences[i as usize];
                if rest < confidence {
                    partner = i;
                } else {
                    rest -= confidence;
                }
                i += 1;
            }
        }
        Self { neighbors, confidences, partner }
    }

    /// Number of inputs.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.neighbors.count + 1
    }

    /// Confidence of an input.
    #[inline(always)]
    pub fn confidence(&self, input: u32) -> u32 {
        self.confidences[(input % MAX_INPUTS) as usize]
    }

    /// Pixel of an input other than the first.
    #[inline(always)]
    pub fn pixel(&self, input: u32) -> UVec2 {
        self.neighbors.get(input - 1)
    }
}
