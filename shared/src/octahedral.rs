//! Unit vectors in 32 bits: the octahedral map with 16 bits a coordinate.

use glam::Vec3;

use crate::numerics::{abs, max, sqrt};

/// Packs a unit vector; the angular error is at most 0.004 degrees.
///
/// Source: Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors".
pub fn pack(n: Vec3) -> u32 {
    let sum = abs(n.x) + abs(n.y) + abs(n.z);
    let scale = 1.0 / max(sum, 1e-30);
    let (mut u, mut v) = (n.x * scale, n.y * scale);
    if n.z < 0.0 {
        let (old_u, old_v) = (u, v);
        u = (1.0 - abs(old_v)) * sign(old_u);
        v = (1.0 - abs(old_u)) * sign(old_v);
    }
    snorm16(u) | (snorm16(v) << 16)
}

/// Inverse of [`pack`]; of length 1 to rounding for every input.
pub fn unpack(bits: u32) -> Vec3 {
    let n = unpack_direction(bits);
    n * (1.0 / sqrt(n.length_squared()))
}

/// The direction of [`unpack`] in a length between 0.57 and 1, without square root and division.
#[inline(always)]
pub fn unpack_direction(bits: u32) -> Vec3 {
    let u = coordinate(bits & 0xffff);
    let v = coordinate(bits >> 16);
    let z = 1.0 - abs(u) - abs(v);
    let fold = max(-z, 0.0);
    Vec3::new(u - fold * sign(u), v - fold * sign(v), z)
}

#[inline(always)]
fn sign(x: f32) -> f32 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

/// -1..=1 to 0..=65534, so that 0 has a code of its own.
#[inline(always)]
fn snorm16(x: f32) -> u32 {
    (x * 32_767.0 + 32_767.5) as u32
}

#[inline(always)]
fn coordinate(code: u32) -> f32 {
    (code as f32 - 32_767.0) * (1.0 / 32_767.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angular_error_is_within_its_bound_and_the_axes_are_exact() {
        let mut worst: f32 = 0.0;
        for i in 0..200_000u32 {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 200_000.0;
            let angle = i as f32 * 2.399_963;
            let r = (1.0 - z * z).sqrt();
            let n = Vec3::new(r * angle.cos(), r * angle.sin(), z).normalize();
            worst = worst.max(n.cross(unpack(pack(n))).length());
        }
        assert!(worst < 0.004f32.to_radians(), "{} degrees", worst.to_degrees());
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert_eq!(unpack(pack(axis)), axis);
        }
    }

    #[test]
    fn any_bits_give_a_unit_vector() {
        for bits in [0, 0xffff_ffff, 0xffff, 0xffff_0000, 0x8000_8000, 0x7fff_7fff] {
            assert!((unpack(bits).length() - 1.0).abs() < 1e-6, "{bits:08x}");
        }
    }
}
