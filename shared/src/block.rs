//! What the surfaces of a block of 8x8 pixels have in common: bounds that prove of a light that it lights none of them.

use bytemuck::{Pod, Zeroable};
use glam::{UVec2, Vec3, Vec4};

use crate::{
    frame::{Frame, skip},
    numerics::{abs, load, max, min},
    rng::{Rng, Stage},
    surface::Surface,
    tiles::BLOCK,
};

/// Farther than anything in a scene.
const FAR: f32 = 1e30;

/// What the pixels of a block that have light to sample see, in world space; positions and normals have no w but the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Block {
    /// Position of one of the surfaces, drawn anew in every frame; w is 1, or 0 if there is none.
    pub position: Vec4,
    /// Its shading normal.
    pub normal: Vec4,
    /// Least coordinates of all positions.
    pub low: Vec4,
    /// Greatest coordinates of all positions.
    pub high: Vec4,
    /// Least coordinates of all shading normals.
    pub normal_low: Vec4,
    /// Greatest coordinates of all shading normals.
    pub normal_high: Vec4,
}

impl Block {
    /// That of the picture's block in column `block.x` and row `block.y`. Its bounds are those of everything unless the frame
    /// leaves out what no surface of a block sees.
    #[inline(always)]
    pub fn of(block: UVec2, frame: &Frame, surfaces: &[Surface]) -> Self {
        let first = block * BLOCK;
        let turn = Rng::for_pixel(block, frame, Stage::CutPixel).next_word();
        let (mut position, mut normal, mut count) = (Vec3::ZERO, Vec3::ZERO, 0);
        let (mut low, mut high) = (Vec3::splat(FAR), Vec3::splat(-FAR));
        let (mut normal_low, mut normal_high) = (Vec3::splat(1.0), Vec3::splat(-1.0));
        let mut i = 0;
        while i < BLOCK * BLOCK {
            let place = turn.wrapping_add(i) % (BLOCK * BLOCK);
            let px = first + UVec2::new(place % BLOCK, place / BLOCK);
            if px.x < frame.width && px.y < frame.height {
                let surface = load(surfaces, frame.index_of(px));
                if !surface.is_settled() {
                    let (p, n) = (surface.position(), surface.normal_shading());
                    if count == 0 {
                        (position, normal) = (p, n);
                    }
                    count += 1;
                    (low, high) = (least(low, p), greatest(high, p));
                    (normal_low, normal_high) = (least(normal_low, n), greatest(normal_high, n));
                }
            }
            i += 1;
        }
        if !frame.skips(skip::HORIZON) {
            (low, high) = (Vec3::splat(-FAR), Vec3::splat(FAR));
            (normal_low, normal_high) = (Vec3::splat(-1.0), Vec3::splat(1.0));
        }
        Self {
            position: position.extend(if count > 0 { 1.0 } else { 0.0 }),
            normal: normal.extend(0.0),
            low: low.extend(0.0),
            high: high.extend(0.0),
            normal_low: normal_low.extend(0.0),
            normal_high: normal_high.extend(0.0),
        }
    }

    /// Whether some pixel has light to sample.
    #[inline(always)]
    pub fn has_surface(&self) -> bool {
        self.position.w > 0.0
    }

    /// Whether some point of a box, in world space, may be above the horizon of some of the surfaces. If not, nothing in the
    /// box lights any of them; the margin is for the rounding of points on lights and of their transforms.
    ///
    /// Bounds of a product of two numbers are among the products of their bounds.
    #[inline(always)]
    pub fn may_see(&self, low: Vec3, high: Vec3) -> bool {
        let (near, far) = (low - self.high.truncate(), high - self.low.truncate());
        let height = largest_product(near.x, far.x, self.normal_low.x, self.normal_high.x)
            + largest_product(near.y, far.y, self.normal_low.y, self.normal_high.y)
            + largest_product(near.z, far.z, self.normal_low.z, self.normal_high.z);
        let offsets = greatest(absolute(near), absolute(far));
        let coordinates = greatest(absolute(low), absolute(high));
        let margin = sum(offsets) * 1e-5 + sum(coordinates) * 1e-6;
        !(height < -margin)
    }
}

/// Largest product of a number between `a0` and `a1` and one between `b0` and `b1`.
#[inline(always)]
fn largest_product(a0: f32, a1: f32, b0: f32, b1: f32) -> f32 {
    max(max(a0 * b0, a0 * b1), max(a1 * b0, a1 * b1))
}

#[inline(always)]
fn least(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(min(a.x, b.x), min(a.y, b.y), min(a.z, b.z))
}

#[inline(always)]
fn greatest(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(max(a.x, b.x), max(a.y, b.y), max(a.z, b.z))
}

#[inline(always)]
fn absolute(v: Vec3) -> Vec3 {
    Vec3::new(abs(v.x), abs(v.y), abs(v.z))
}

#[inline(always)]
fn sum(v: Vec3) -> f32 {
    v.x + v.y + v.z
}
