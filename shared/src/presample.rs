//! Lights drawn ahead: records of lights, evaluated, that many pixels draw their candidates from. Their buffer is small and
//! lies close together, however many lights the scene has.
//!
//! Two kinds. Tiles: rows of the buffer, drawn by power; each block of the screen has one of them for a frame. Cells: rows
//! that stand for a part of space around the camera, each record resampled by what its light may matter there.
//!
//! Sources: tiles: Wyman and Panteleev 2021, "Rearchitecting Spatiotemporal Resampling for Production"; cells: Boksansky,
//! Jukarainen and Wyman 2021, "Rendering Many Lights with Grid-Based Reservoirs".

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};
use glam::{UVec2, Vec3};

use crate::{
    frame::Frame,
    light::{self, Address, LightPoint},
    numerics::{clamp, floor, max, multiply_high, safe_sqrt, sqrt},
    ray::max_abs,
    resample::{Chooser, Stream, candidate_scale},
    rng::{Rng, Stage},
    scene::Scene,
    target::mean,
};

/// A point of a light, evaluated, with what a candidate needs to know of how it was drawn. One line of a cache.
///
/// Zeros stand for no light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LightRecord {
    /// World space.
    pub position: Vec3,
    /// Light id, see [`crate::light`].
    pub light: u32,
    /// Unit normal of the front face times the area, in square scene units.
    pub area: Vec3,
    /// Point on the light, two 16-bit coordinates.
    pub uv: u32,
    /// Emitted radiance, in W sr^-1 m^-2.
    pub radiance: Vec3,
    /// Probability with which the scene's tables draw the light.
    pub pmf: f32,
    /// `pmf` times the contribution weight of the record: 1 where it was drawn by `pmf` alone.
    pub scale: f32,
    /// Bits: both faces emit; no ray finds it; it is a single point. Above them: the kind of the first [`crate::fault`] in
    /// making the record.
    pub state: u32,
    /// Emitter of the light, see [`Address`].
    pub emitter: u32,
    /// Number of the light within its emitter.
    pub local: u32,
}

const _: () = assert!(size_of::<LightRecord>() == 64 && offset_of!(LightRecord, scale) == 48);

/// Bits of a record's state.
mod state {
    /// Both faces emit.
    pub const TWO_SIDED: u32 = 1;
    /// No ray finds the light.
    pub const ANALYTIC: u32 = 2;
    /// The light is a single point, and a record has no room for its falloff.
    pub const PUNCTUAL: u32 = 4;
    /// From this bit on: the kind of the first [`crate::fault`] in making the record.
    pub const FAULT_SHIFT: u32 = 3;
}

impl LightRecord {
    /// No light.
    pub const EMPTY: Self = Self {
        position: Vec3::ZERO,
        light: 0,
        area: Vec3::ZERO,
        uv: 0,
        radiance: Vec3::ZERO,
        pmf: 0.0,
        scale: 0.0,
        state: 0,
        emitter: 0,
        local: 0,
    };

    fn new(light: u32, uv: u32, address: Address, pmf: f32, scale: f32, point: &LightPoint) -> Self {
        Self {
            position: point.position,
            light,
            area: point.normal * point.jacobian,
            uv,
            radiance: point.radiance,
            pmf,
            scale,
            state: (if point.two_sided { state::TWO_SIDED } else { 0 })
                | (if point.analytic { state::ANALYTIC } else { 0 })
                | (if point.punctual { state::PUNCTUAL } else { 0 }),
            emitter: address.emitter,
            local: address.local,
        }
    }

    /// Whether there is a light.
    #[inline(always)]
    pub fn has_light(&self) -> bool {
        self.pmf > 0.0
    }

    /// The light.
    #[inline(always)]
    pub fn address(&self) -> Address {
        Address { emitter: self.emitter, local: self.local }
    }

    /// Whether the light has to be evaluated again, by its address, because [`LightRecord::point`] is not all of it.
    #[inline(always)]
    pub fn is_punctual(&self) -> bool {
        (self.state & state::PUNCTUAL) != 0
    }

    /// The point, good for targets: its normal has the length of its area, so its Jacobian is 1.
    #[inline(always)]
    pub fn point(&self) -> LightPoint {
        LightPoint {
            position: self.position,
            normal: self.area,
            radiance: self.radiance,
            jacobian: 1.0,
            two_sided: (self.state & state::TWO_SIDED) != 0,
            analytic: (self.state & state::ANALYTIC) != 0,
            ..LightPoint::NONE
        }
    }

    /// The kind of the first [`crate::fault`] in making it.
    #[inline(always)]
    pub fn fault(&self) -> u32 {
        self.state >> state::FAULT_SHIFT
    }

    fn with_fault(self, fault: u32) -> Self {
        Self { state: self.state | (fault << state::FAULT_SHIFT), ..self }
    }
}

/// A light by power or uniformly, and a point on it.
#[inline(always)]
fn draw<const IMAGES: bool, const SHAPES: bool>(
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    uv: u32,
    bits: [u32; 4],
) -> LightRecord {
    let picked = light::pick(frame, scene, lights, bits);
    let place = light::place_of(frame, scene, picked.address);
    let point = light::evaluate_at::<IMAGES, SHAPES>(frame, scene, place, uv);
    let light = light::light_at(frame, scene, picked.address);
    LightRecord::new(light, uv, picked.address, picked.pmf, 1.0, &point)
}

/// Record `at.x` of tile `at.y`. The records of a tile are stratified: each has its part of the table over emitters (or
/// over its triangles, if there is but one emitter), so that one of them that is chosen uniformly has the law of the table.
/// `frame.presampled_columns` must be a power of two for the parts to be equal.
#[inline(always)]
pub fn tile_record<const IMAGES: bool, const SHAPES: bool>(
    at: UVec2,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
) -> LightRecord {
    if frame.light_count == 0 {
        return LightRecord::EMPTY;
    }
    let mut rng = Rng::for_pixel(at, frame, Stage::Presample);
    let [first, second, third, fourth] = rng.next_four();
    // 2^32 / columns; one column is all of it.
    let part = (0xffff_ffff / frame.presampled_columns).wrapping_add(1);
    let start = at.x.wrapping_mul(part);
    let bits = if part == 0 {
        [first, second, third, fourth]
    } else if frame.emitter_count > 1 {
        [start + multiply_high(first, part), second, third, fourth]
    } else {
        [first, second, start + multiply_high(third, part), fourth]
    };
    draw::<IMAGES, SHAPES>(frame, scene, lights, rng.next_word(), bits)
}

/// The tile of a block of 8x8 pixels.
#[inline(always)]
pub fn tile_of(frame: &Frame, px: UVec2) -> u32 {
    let mut rng = Rng::for_pixel(UVec2::new(px.x >> 3, px.y >> 3), frame, Stage::TileChoice);
    multiply_high(rng.next_word(), frame.presampled_rows)
}

/// Cells along each edge of a level, as a power of two.
const CELL_BITS: u32 = 3;

/// Cells of a level.
pub const LEVEL_CELLS: u32 = 1 << (3 * CELL_BITS);

/// Levels of cells around the camera; each has edges twice as long as the one before it.
pub const LEVELS: u32 = 6;

/// Stands for no cell.
pub const NO_ROW: u32 = 0xffff_ffff;

/// The row of the cell of a point; [`NO_ROW`] beyond the last level.
#[inline(always)]
pub fn cell_of(frame: &Frame, position: Vec3) -> u32 {
    let half = (1 << (CELL_BITS - 1)) as f32;
    let mut place = (position - frame.camera_origin) * (1.0 / frame.cell_size);
    let mut row = NO_ROW;
    let mut level = 0;
    while level < LEVELS && row == NO_ROW {
        if is_within(place.x, half) && is_within(place.y, half) && is_within(place.z, half) {
            let most = (1 << CELL_BITS) as f32 - 1.0;
            let x = clamp(floor(place.x + half), 0.0, most) as u32;
            let y = clamp(floor(place.y + half), 0.0, most) as u32;
            let z = clamp(floor(place.z + half), 0.0, most) as u32;
            row = level * LEVEL_CELLS + (((z << CELL_BITS) + y) << CELL_BITS) + x;
        }
        place *= 0.5;
        level += 1;
    }
    row
}

/// As cells are: with their lower bound, without their upper.
#[inline(always)]
fn is_within(x: f32, half: f32) -> bool {
    x >= -half && x < half
}

/// A sphere around a cell: center and radius. The radius is 0 for cells in the middle of a level, where finer levels are.
#[inline(always)]
fn sphere_of(frame: &Frame, row: u32) -> (Vec3, f32) {
    let most = (1 << CELL_BITS) - 1;
    let (x, y, z) = (row & most, (row >> CELL_BITS) & most, (row >> (2 * CELL_BITS)) & most);
    let level = row / LEVEL_CELLS;
    let is_middle = |i: u32| i.wrapping_sub(2) < 4;
    if level > 0 && is_middle(x) && is_middle(y) && is_middle(z) {
        return (Vec3::ZERO, 0.0);
    }
    let edge = frame.cell_size * (1 << level) as f32;
    let half = most as f32 * 0.5;
    let from_camera = Vec3::new(x as f32 - half, y as f32 - half, z as f32 - half) * edge;
    // Half the diagonal, and a little more for rounding.
    (frame.camera_origin + from_camera, edge * 0.8661 + max_abs(frame.camera_origin) * 1e-6)
}

/// The largest cosine with a direction of length 1 that directions to points of a sphere have: `along` is the cosine of
/// that to its center, `across` the sine of the angle that its radius takes up.
#[inline(always)]
fn largest_cosine(along: f32, across: f32) -> f32 {
    let reach = safe_sqrt(1.0 - across * across);
    if along >= reach { 1.0 } else { along * reach + safe_sqrt(1.0 - along * along) * across }
}

/// What a point of a light may matter to a surface within a sphere: power / distance², with the largest cosine at the light
/// (or the largest falloff) that any point of the sphere has. Positive wherever any of them is reached.
#[inline(always)]
fn importance<const SHAPES: bool>(point: &LightPoint, center: Vec3, radius: f32) -> f32 {
    let away = center - point.position;
    let distance2 = max(away.length_squared(), radius * radius);
    let above = point.normal.dot(away) + radius;
    // A little more, for rounding.
    let inverse = 1.0 / sqrt(distance2);
    let mut cosine = if point.two_sided { 1.0 } else { clamp(above * inverse + 1e-6, 0.0, 1.0) };
    if SHAPES && point.punctual {
        cosine = point.falloff(largest_cosine(point.normal.dot(away) * inverse, radius * inverse) + 1e-5);
    }
    mean(point.radiance) * point.jacobian * (cosine / distance2)
}

/// Record `at.x` of cell `at.y`: one of `frame.cell_candidates` lights, drawn by power, in proportion to what they may
/// matter in the cell.
#[inline(always)]
pub fn cell_record<const IMAGES: bool, const SHAPES: bool>(
    at: UVec2,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
) -> LightRecord {
    let (center, radius) = sphere_of(frame, at.y);
    if !(radius > 0.0) || frame.light_count == 0 {
        return LightRecord::EMPTY;
    }
    let mut rng = Rng::for_pixel(at, frame, Stage::Presample);
    let choice = Rng::for_pixel(at, frame, Stage::PresampleChoice);
    let mut stream: Stream<f32, (u32, u32, f32), Chooser> =
        Stream::new((0, 0, 0.0), Chooser::new(choice, frame.choice));
    let mut i = 0;
    while i < frame.cell_candidates {
        let uv = rng.next_word();
        let picked = light::pick(frame, scene, lights, rng.next_four());
        let place = light::place_of(frame, scene, picked.address);
        let point = light::evaluate_at::<IMAGES, SHAPES>(frame, scene, place, uv);
        let target = importance::<SHAPES>(&point, center, radius);
        let light = light::light_at(frame, scene, picked.address);
        let density = picked.pmf * frame.cell_candidates as f32;
        stream.offer((light, uv, picked.pmf), target, target * candidate_scale(density));
        i += 1;
    }
    let (light, uv, pmf) = stream.kept();
    let scale = pmf * stream.contribution_weight();
    let fault = stream.fault();
    if !(scale > 0.0) {
        return LightRecord::EMPTY.with_fault(fault);
    }
    let address = light::address_of(frame, scene, light);
    let point = light::evaluate_at::<IMAGES, SHAPES>(frame, scene, light::place_of(frame, scene, address), uv);
    LightRecord::new(light, uv, address, pmf, scale, &point).with_fault(fault)
}

/// The record that candidate `number` of `count` takes from a row of `columns`: `count` of them evenly apart, from a place on that
/// 32 random bits decide, so that each is any record with the same probability.
#[inline(always)]
pub fn column_of(columns: u32, start: u32, number: u32, count: u32) -> u32 {
    let step = number * columns / count.max(1);
    (multiply_high(start, columns) + step) % columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{numerics::unit_float, rng::pcg4d};

    fn frame() -> Frame {
        Frame { camera_origin: Vec3::new(3.0, -2.0, 1.0), cell_size: 0.25, presampled_columns: 24, ..Frame::default() }
    }

    /// Numbers in -1..1.
    fn signed(i: u32, j: u32) -> [f32; 4] {
        pcg4d(i, j, 3, 1).map(|bits| unit_float(bits) * 2.0 - 1.0)
    }

    #[test]
    fn every_point_is_in_the_sphere_of_its_cell_and_far_points_have_none() {
        let frame = frame();
        let mut levels = [0; LEVELS as usize];
        for i in 0..100_000 {
            let [x, y, z, magnitude] = signed(i, 0);
            let offset = Vec3::new(x, y, z) * (magnitude * 6.0).exp2();
            let position = frame.camera_origin + offset;
            let row = cell_of(&frame, position);
            // Eight cells of 2^5 times the edge reach four of them in each direction.
            let place = position - frame.camera_origin;
            assert_eq!(row == NO_ROW, place.min_element() < -32.0 || place.max_element() >= 32.0, "{position}");
            if row == NO_ROW {
                continue;
            }
            levels[(row / LEVEL_CELLS) as usize] += 1;
            let (center, radius) = sphere_of(&frame, row);
            assert!(radius > 0.0 && position.distance(center) <= radius, "{position} in cell {row}");
        }
        assert!(levels.iter().all(|&count| count > 100), "{levels:?}");
        // Where levels meet.
        for (axis, level) in (0..3).flat_map(|axis| (0..LEVELS).map(move |level| (axis, level))) {
            for side in [-1.0, 1.0] {
                let mut offset = Vec3::new(0.1, 0.2, -0.1);
                offset[axis] = side * (1 << level) as f32;
                let row = cell_of(&Frame { camera_origin: Vec3::ZERO, ..frame }, offset);
                let is_beyond = side > 0.0 && level + 1 == LEVELS;
                assert_eq!(row == NO_ROW, is_beyond, "{offset}");
                assert!(is_beyond || sphere_of(&frame, row).1 > 0.0, "{offset} in a cell without lights");
            }
        }
        for bad in [f32::NAN, f32::INFINITY] {
            assert_eq!(cell_of(&frame, Vec3::new(0.0, bad, 0.0)), NO_ROW);
        }
        for bad in [f32::NAN, 0.0] {
            assert_eq!(cell_of(&Frame { cell_size: bad, ..frame }, Vec3::ONE), NO_ROW);
        }
    }

    #[test]
    fn a_light_that_reaches_any_point_of_a_sphere_matters_there() {
        let mut reached = 0;
        for i in 0..100_000 {
            let ([x, y, z, size], [a, b, c, side]) = (signed(i, 1), signed(i, 2));
            let [dx, dy, dz, _] = signed(i, 3);
            let point = LightPoint {
                position: Vec3::new(x, y, z) * 10.0,
                normal: Vec3::new(a, b, c).normalize(),
                radiance: Vec3::new(0.0, 1e-3, 0.0),
                jacobian: 0.01,
                two_sided: side > 0.8,
                ..LightPoint::NONE
            };
            let radius = size.abs() * 3.0;
            let within = Vec3::new(dx, dy, dz).normalize() * radius;
            if light::arriving::<false>(within, &point).solid_angle > 0.0 {
                reached += 1;
                assert!(importance::<false>(&point, Vec3::ZERO, radius) > 0.0, "{i}");
            }
        }
        assert!(reached > 50_000);
        let below =
            LightPoint { position: Vec3::Y, normal: Vec3::Y, radiance: Vec3::ONE, jacobian: 1.0, ..LightPoint::NONE };
        assert_eq!(importance::<false>(&below, Vec3::NEG_Y, 0.5), 0.0, "nothing comes back");
    }

    #[test]
    fn columns_are_evenly_apart_and_each_is_as_likely() {
        let mut counts = [0; 24];
        for i in 0..48_000 {
            let start = pcg4d(i, 0, 0, 0)[0];
            let columns = [0, 1, 2, 3].map(|number| column_of(24, start, number, 4));
            columns.iter().for_each(|&column| counts[column as usize] += 1);
            assert!(columns.iter().all(|&column| (column + 24 - columns[0]).is_multiple_of(6)), "{columns:?}");
        }
        // 8,000 each, and five standard deviations.
        assert!(counts.iter().all(|count| (7_560..8_440).contains(count)), "{counts:?}");
        assert_eq!(column_of(1, u32::MAX, 7, 9), 0);
    }

    #[test]
    fn a_record_keeps_its_light_and_its_fault() {
        let point = LightPoint {
            position: Vec3::new(1.0, 2.0, 3.0),
            normal: Vec3::NEG_Y,
            radiance: Vec3::new(4.0, 5.0, 6.0),
            jacobian: 0.5,
            two_sided: true,
            ..LightPoint::NONE
        };
        let address = Address { emitter: 7, local: 9 };
        let record = LightRecord::new(11, 12, address, 0.25, 1.0, &point).with_fault(crate::fault::OVERFLOW);
        assert!(record.has_light() && record.address() == address && record.fault() == crate::fault::OVERFLOW);
        for position in [Vec3::ZERO, Vec3::new(1.0, 9.0, -2.0)] {
            let (a, b) =
                (light::arriving::<false>(position, &point), light::arriving::<false>(position, &record.point()));
            assert!((a.solid_angle - b.solid_angle).abs() <= 1e-6 * a.solid_angle && a.direction == b.direction);
        }
        let zero: LightRecord = bytemuck::Zeroable::zeroed();
        assert!(zero == LightRecord::EMPTY && !zero.has_light() && zero.fault() == crate::fault::NONE);
    }
}
