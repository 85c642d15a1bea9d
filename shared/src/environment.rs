//! Light from infinitely far away: an equirectangular map, looked up bilinearly and sampled by an alias table over
//! its texels; directional lights, which stand behind the texels in that table.

use core::f32::consts::{FRAC_1_PI, PI, TAU};
use glam::Vec3;

use crate::{
    alias,
    frame::Frame,
    numerics::{atan2, floor, load, max, min, pack_cell, sin_cos, sqrt},
    scene::{Scene, distant_record},
};

/// World direction of the point (x, y) of the map, in texels, and the solid angle of a texel there.
#[inline(always)]
fn direction_at(frame: &Frame, x: f32, y: f32) -> (Vec3, f32) {
    let (width, height) = (frame.environment_width as f32, frame.environment_height as f32);
    let (sin_phi, cos_phi) = sin_cos((x / width - 0.5) * TAU);
    let (sin_theta, cos_theta) = sin_cos(y / height * PI);
    // Map space: the middle column is -z, the right half +x.
    let (mx, mz) = (sin_theta * sin_phi, -sin_theta * cos_phi);
    let direction = Vec3::new(
        frame.environment_cos * mx + frame.environment_sin * mz,
        cos_theta,
        frame.environment_cos * mz - frame.environment_sin * mx,
    );
    (direction, (TAU / width) * (PI / height) * sin_theta)
}

#[inline(always)]
fn texel(frame: &Frame, scene: &Scene, x: u32, y: u32) -> Vec3 {
    let at = frame.environment_texels_at + (y * frame.environment_width + x) * 3;
    // Not a closure: it would hold a pointer, which naga does not take in a struct.
    Vec3::new(
        f32::from_bits(load(scene.texels, at)),
        f32::from_bits(load(scene.texels, at + 1)),
        f32::from_bits(load(scene.texels, at + 2)),
    )
}

/// Radiance at the point (x, y) of the map, in texels; repeats in x, clamps in y.
#[inline(always)]
fn radiance_at(frame: &Frame, scene: &Scene, x: f32, y: f32) -> Vec3 {
    let (width, height) = (frame.environment_width, frame.environment_height);
    let (px, py) = (x - 0.5, y - 0.5);
    let (wx, wy) = (floor(px), floor(py));
    let (fx, fy) = (px - wx, py - wy);
    let x0 = if wx < 0.0 { width - 1 } else { (wx as u32).min(width - 1) };
    let x1 = if x0 + 1 == width { 0 } else { x0 + 1 };
    let y0 = if wy < 0.0 { 0 } else { (wy as u32).min(height - 1) };
    let y1 = if wy < 0.0 { 0 } else { (y0 + 1).min(height - 1) };
    let top = texel(frame, scene, x0, y0) * (1.0 - fx) + texel(frame, scene, x1, y0) * fx;
    let bottom = texel(frame, scene, x0, y1) * (1.0 - fx) + texel(frame, scene, x1, y1) * fx;
    (top * (1.0 - fy) + bottom * fy) * frame.environment_scale
}

/// Where on the map a direction (of length 1) is, in texels.
#[inline(always)]
fn coordinates(frame: &Frame, direction: Vec3) -> (f32, f32) {
    let mx = frame.environment_cos * direction.x - frame.environment_sin * direction.z;
    let mz = frame.environment_cos * direction.z + frame.environment_sin * direction.x;
    let horizontal = sqrt(mx * mx + mz * mz);
    let x = (atan2(mx, -mz) * (0.5 * FRAC_1_PI) + 0.5) * frame.environment_width as f32;
    let y = atan2(horizontal, direction.y) * FRAC_1_PI * frame.environment_height as f32;
    (min(x, frame.environment_width as f32), y)
}

/// Texels of the map; none without one.
#[inline(always)]
pub fn texel_count(frame: &Frame) -> u32 {
    frame.environment_width * frame.environment_height
}

/// Entries of the table: texels of the map, then directional lights.
#[inline(always)]
pub fn count(frame: &Frame) -> u32 {
    texel_count(frame) + (frame.materials_at - frame.distant_at) / distant_record::WORDS
}

/// Radiance from `direction` (of length 1), in W sr^-1 m^-2; directional lights are too small to be seen.
#[inline(always)]
pub fn radiance(frame: &Frame, scene: &Scene, direction: Vec3) -> Vec3 {
    if frame.environment_width == 0 {
        return Vec3::ZERO;
    }
    let (x, y) = coordinates(frame, direction);
    radiance_at(frame, scene, x, y)
}

/// The texel that a direction (of length 1) lies in, and where in it: two 16-bit coordinates. There must be a map.
#[inline(always)]
pub fn locate(frame: &Frame, direction: Vec3) -> (u32, u32) {
    let (x, y) = coordinates(frame, direction);
    let column = (max(x, 0.0) as u32).min(frame.environment_width - 1);
    let row = (max(y, 0.0) as u32).min(frame.environment_height - 1);
    (row * frame.environment_width + column, pack_cell(x - column as f32, y - row as f32))
}

/// A point of the environment.
#[derive(Clone, Copy)]
pub struct EnvironmentSample {
    /// Toward the light, of length 1.
    pub direction: Vec3,
    /// In W sr^-1 m^-2.
    pub radiance: Vec3,
    /// Solid angle for the texel's unit square, in sr: the Jacobian of (u, v).
    pub solid_angle: f32,
}

/// The directional light that stands `number` entries into the table's part for them.
#[inline(always)]
fn distant(frame: &Frame, scene: &Scene, number: u32) -> EnvironmentSample {
    let at = frame.distant_at + number * distant_record::WORDS;
    EnvironmentSample {
        direction: scene.record_vector(at + distant_record::DIRECTION),
        radiance: scene.record_vector(at + distant_record::IRRADIANCE),
        solid_angle: 1.0,
    }
}

/// The point (u, v), both in 0..1, of entry number `index`: of a texel, or a directional light as a whole, whose
/// irradiance stands for radiance over one sr.
#[inline(always)]
pub fn evaluate(frame: &Frame, scene: &Scene, index: u32, u: f32, v: f32) -> EnvironmentSample {
    let texels = texel_count(frame);
    if index >= texels {
        return distant(frame, scene, index - texels);
    }
    let row = index / frame.environment_width;
    let x = (index - row * frame.environment_width) as f32 + u;
    let y = row as f32 + v;
    let (direction, solid_angle) = direction_at(frame, x, y);
    EnvironmentSample { direction, radiance: radiance_at(frame, scene, x, y), solid_angle }
}

/// Probability with which [`pick`] draws an entry.
#[inline(always)]
pub fn pmf(frame: &Frame, lights: &[u32], index: u32) -> f32 {
    alias::pmf(lights, frame.environment_table_at, index)
}

/// A texel or directional light by its power, with its probability.
#[inline(always)]
pub fn pick(frame: &Frame, lights: &[u32], first: u32, second: u32) -> alias::Pick {
    alias::pick(lights, frame.environment_table_at, count(frame), first, second)
}

/// Weight of each texel in the alias table: luminance-like mean of the bilinear lookup over the texel, times the
/// solid angle. Positive wherever the lookup is positive anywhere in the texel.
#[cfg(not(target_arch = "spirv"))]
pub fn texel_weights(width: u32, height: u32, texels: &[[f32; 3]]) -> std::vec::Vec<f64> {
    let value = |x: i64, y: i64| {
        let x = x.rem_euclid(i64::from(width)) as usize;
        let y = y.clamp(0, i64::from(height) - 1) as usize;
        let t = texels[y * width as usize + x];
        f64::from(t[0]) + f64::from(t[1]) + f64::from(t[2])
    };
    let mut weights = std::vec::Vec::with_capacity(texels.len());
    for y in 0..i64::from(height) {
        let theta = |row: i64| row as f64 / f64::from(height) * core::f64::consts::PI;
        let solid_angle = theta(y).cos() - theta(y + 1).cos();
        for x in 0..i64::from(width) {
            // The integral of the bilinear interpolation over one texel.
            let row = |y: i64| (value(x - 1, y) + 6.0 * value(x, y) + value(x + 1, y)) / 8.0;
            weights.push((row(y - 1) + 6.0 * row(y) + row(y + 1)) / 8.0 * solid_angle);
        }
    }
    weights
}
