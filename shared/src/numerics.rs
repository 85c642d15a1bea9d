//! Scalar functions that give the same bits on every processor, as far as each promises.
//!
//! Sine, exponential and the like are polynomials of our own, because the functions of drivers differ from those
//! of the host. Square root and division are correctly rounded on the host and on software Vulkan.

use glam::Vec4;
#[cfg(target_arch = "spirv")]
use spirv_std::{arch::IndexUnchecked, num_traits::Float};

/// Element `index` of `buffer`.
///
/// On the GPU without a bounds check: indices come from tables that the packing on the host has validated.
#[inline(always)]
pub fn load<T: Copy>(buffer: &[T], index: u32) -> T {
    #[cfg(target_arch = "spirv")]
    // SAFETY: the host validates every index it stores in a buffer.
    unsafe {
        *buffer.index_unchecked(index as usize)
    }
    #[cfg(not(target_arch = "spirv"))]
    buffer[index as usize]
}

/// `length` elements of `buffer` from `at` on, as a slice and where they start in it. On the host that is the slice of
/// just these elements, so that one check of bounds serves them all.
#[inline(always)]
pub fn window<T>(buffer: &[T], at: u32, length: u32) -> (&[T], u32) {
    #[cfg(target_arch = "spirv")]
    {
        let _ = length;
        (buffer, at)
    }
    #[cfg(not(target_arch = "spirv"))]
    (&buffer[at as usize..][..length as usize], 0)
}

/// Sets element `index` of `buffer`; as [`load`].
#[inline(always)]
pub fn store<T: Copy>(buffer: &mut [T], index: u32, value: T) {
    #[cfg(target_arch = "spirv")]
    // SAFETY: entry points guard their index by the size of the frame.
    unsafe {
        *buffer.index_unchecked_mut(index as usize) = value;
    }
    #[cfg(not(target_arch = "spirv"))]
    {
        buffer[index as usize] = value;
    }
}

/// Square root.
#[inline(always)]
pub fn sqrt(x: f32) -> f32 {
    x.sqrt()
}

/// Square root of `x`, or 0 where rounding has made `x` negative.
#[inline(always)]
pub fn safe_sqrt(x: f32) -> f32 {
    if x > 0.0 { sqrt(x) } else { 0.0 }
}

/// Largest integer not above `x`.
#[inline(always)]
pub fn floor(x: f32) -> f32 {
    x.floor()
}

/// The smaller of two numbers; `b` if either is not a number or both are equal.
#[inline(always)]
pub fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two numbers; `b` if either is not a number or both are equal.
#[inline(always)]
pub fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// `x` limited to `low..=high`; `low` if `x` is not a number.
#[inline(always)]
pub fn clamp(x: f32, low: f32, high: f32) -> f32 {
    min(max(x, low), high)
}

/// `|x|`, by clearing the sign bit.
#[inline(always)]
pub fn abs(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

/// Magnitude of `x` with the sign bit of `sign`.
#[inline(always)]
pub fn copysign(x: f32, sign: f32) -> f32 {
    f32::from_bits((x.to_bits() & 0x7fff_ffff) | (sign.to_bits() & 0x8000_0000))
}

/// Whether `x` is neither infinite nor not-a-number. Looks at the bits, because shader compilers may assume that
/// such numbers never occur.
#[inline(always)]
pub fn is_finite(x: f32) -> bool {
    (x.to_bits() & 0x7f80_0000) != 0x7f80_0000
}

/// High 32 bits of the 64-bit product. Only 32-bit operations, because 64-bit integers are an optional feature of
/// Vulkan.
#[inline(always)]
pub fn multiply_high(a: u32, b: u32) -> u32 {
    let (a_low, a_high) = (a & 0xffff, a >> 16);
    let (b_low, b_high) = (b & 0xffff, b >> 16);
    let low = a_low.wrapping_mul(b_low);
    let middle = a_high.wrapping_mul(b_low).wrapping_add(low >> 16);
    let carry = a_low.wrapping_mul(b_high).wrapping_add(middle & 0xffff);
    a_high.wrapping_mul(b_high).wrapping_add(middle >> 16).wrapping_add(carry >> 16)
}

/// A float in `0..1` from the high 24 bits.
#[inline(always)]
pub fn unit_float(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Two numbers in `0..=1` as the 16-bit cells that hold them, the first in the low half; see [`unorm16_center`].
#[inline(always)]
pub fn pack_cell(u: f32, v: f32) -> u32 {
    let cell = |x: f32| (clamp(x, 0.0, 1.0) * 65_536.0) as u32;
    cell(u).min(0xffff) | (cell(v).min(0xffff) << 16)
}

/// Center of the cell that a 16-bit number stands for, in `0..1` exclusive.
#[inline(always)]
pub fn unorm16_center(bits: u32) -> f32 {
    ((bits & 0xffff) as f32 + 0.5) * (1.0 / 65_536.0)
}

/// 16-bit code of a number in `0..=1`: error at most 1/131070.
#[inline(always)]
pub fn pack_unorm16(x: f32) -> u32 {
    (clamp(x, 0.0, 1.0) * 65_535.0 + 0.5) as u32
}

/// Inverse of [`pack_unorm16`]; 0 and 1 are exact.
#[inline(always)]
pub fn unpack_unorm16(bits: u32) -> f32 {
    (bits & 0xffff) as f32 / 65_535.0
}

/// Sine and cosine of `x` radians, for `|x|` up to 8192. Absolute error at most 1e-7; for `|x| <= pi / 4`, 1.0 and 1.5 ulp.
///
/// Source: the minimax polynomials of Cephes (`sinf`, `cosf`).
pub fn sin_cos(x: f32) -> (f32, f32) {
    let quadrant = floor(x * core::f32::consts::FRAC_2_PI + 0.5);
    // pi/2 in three parts of few bits, so that the products are exact (Cody and Waite).
    let r = ((x - quadrant * 1.570_312_5) - quadrant * 4.837_512_969_970_703e-4) - quadrant * 7.549_789_954_891_89e-8;
    let r2 = r * r;
    let sine = r + r * r2 * (-1.666_665_5e-1 + r2 * (8.332_161e-3 + r2 * -1.951_529_6e-4));
    let cosine = 1.0 - 0.5 * r2 + r2 * r2 * (4.166_664_6e-2 + r2 * (-1.388_731_6e-3 + r2 * 2.443_315_7e-5));
    let turn = (quadrant as i32) & 3;
    let (s, c) = if (turn & 1) == 0 { (sine, cosine) } else { (cosine, -sine) };
    if turn >= 2 { (-s, -c) } else { (s, c) }
}

/// Angle of the point (x, y), in `-pi..=pi`; 0 at the origin. Error at most 3 ulp, and 3e-7.
///
/// Source: the polynomial of Cephes (`atanf`).
pub fn atan2(y: f32, x: f32) -> f32 {
    use core::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    let (ax, ay) = (abs(x), abs(y));
    let (low, high) = (min(ax, ay), max(ax, ay));
    if !(high > 0.0) {
        return 0.0;
    }
    let ratio = low / high;
    // Above tan(pi/8): atan(r) = pi/4 + atan((r - 1) / (r + 1)).
    let upper = ratio > 0.414_213_57;
    let t = if upper { (low - high) / (low + high) } else { ratio };
    let t2 = t * t;
    let polynomial =
        t + t * t2 * (-3.333_294_9e-1 + t2 * (1.997_771_1e-1 + t2 * (-1.387_768_6e-1 + t2 * 8.053_744_6e-2)));
    let octant = if upper { FRAC_PI_4 + polynomial } else { polynomial };
    let quadrant = if ay > ax { FRAC_PI_2 - octant } else { octant };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    if y < 0.0 { -half } else { half }
}

/// Base-2 logarithm of a positive normal number. Error at most 1 ulp outside 0.5..2, and 1e-7 within;
/// -126 for zero, negative numbers and denormals.
///
/// Source: the polynomial of Cephes (`logf`).
pub fn log2(x: f32) -> f32 {
    if !(x >= f32::MIN_POSITIVE) {
        return -126.0;
    }
    let bits = x.to_bits();
    let mut exponent = ((bits >> 23) as i32 - 127) as f32;
    let mut m = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    if m > core::f32::consts::SQRT_2 {
        m *= 0.5;
        exponent += 1.0;
    }
    let r = m - 1.0;
    let r2 = r * r;
    let tail = r
        * r2
        * (3.333_333_1e-1
            + r * (-2.499_999_4e-1
                + r * (2.000_071_5e-1
                    + r * (-1.666_805_8e-1
                        + r * (1.424_932_3e-1
                            + r * (-1.242_014_1e-1
                                + r * (1.167_699_9e-1 + r * (-1.151_461e-1 + r * 7.037_683_6e-2))))))));
    let natural = (tail - 0.5 * r2) + r;
    natural * core::f32::consts::LOG2_E + exponent
}

/// 2 to the power of `x`, with `x` limited to -126..=127. Error at most 1.5 ulp.
///
/// Source: the polynomial of Cephes (`exp2f`).
pub fn exp2(x: f32) -> f32 {
    let x = clamp(x, -126.0, 127.0);
    let whole = floor(x + 0.5);
    let r = x - whole;
    let polynomial = 1.0
        + r * (6.931_472e-1
            + r * (2.402_265e-1
                + r * (5.550_332_5e-2 + r * (9.618_437e-3 + r * (1.339_887_4e-3 + r * 1.535_336_2e-4)))));
    polynomial * f32::from_bits(((whole as i32 + 127) as u32) << 23)
}

/// `x` to the power of `y` for `x >= 0`; 0 where `x` is 0 or less. For `x` in 0.001..1, error at most 4 ulp with
/// exponent 0.5, 6 with 1 / 2.4, 26 with 2.2 and 56 with 8.
pub fn pow(x: f32, y: f32) -> f32 {
    if x > 0.0 { exp2(y * log2(x)) } else { 0.0 }
}

/// [`log2`] of each coordinate, with its error: in vectors on a CPU.
#[inline(always)]
pub fn log2_of_each(x: Vec4) -> Vec4 {
    let (exponent, fraction) = exponents(x);
    let is_upper = fraction.cmpgt(Vec4::splat(core::f32::consts::SQRT_2));
    let exponent = exponent + Vec4::select(is_upper, Vec4::ONE, Vec4::ZERO);
    let r = fraction * Vec4::select(is_upper, Vec4::splat(0.5), Vec4::ONE) - Vec4::ONE;
    let r2 = r * r;
    // By pairs (Estrin 1960), so that fewer products wait for each other than in a chain.
    let r4 = r2 * r2;
    let first =
        (Vec4::splat(3.333_333_1e-1) - r * 2.499_999_4e-1) + (Vec4::splat(2.000_071_5e-1) - r * 1.666_805_8e-1) * r2;
    let second =
        (Vec4::splat(1.424_932_3e-1) - r * 1.242_014_1e-1) + (Vec4::splat(1.167_699_9e-1) - r * 1.151_461e-1) * r2;
    let tail = first + r4 * (second + r4 * 7.037_683_6e-2);
    let natural = (r * r2 * tail - r2 * 0.5) + r;
    let logarithm = natural * core::f32::consts::LOG2_E + exponent;
    Vec4::select(x.cmpge(Vec4::splat(f32::MIN_POSITIVE)), logarithm, Vec4::splat(-126.0))
}

/// Of positive normal numbers the exponents, and the numbers over 2 to their power.
#[inline(always)]
fn exponents(x: Vec4) -> (Vec4, Vec4) {
    let (a, b, c, d) = (x.x.to_bits(), x.y.to_bits(), x.z.to_bits(), x.w.to_bits());
    let exponent = |bits: u32| ((bits >> 23) as i32 - 127) as f32;
    let fraction = |bits: u32| f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    (
        Vec4::new(exponent(a), exponent(b), exponent(c), exponent(d)),
        Vec4::new(fraction(a), fraction(b), fraction(c), fraction(d)),
    )
}

/// [`exp2`] of each coordinate, with its error: in vectors on a CPU.
#[inline(always)]
pub fn exp2_of_each(x: Vec4) -> Vec4 {
    let x = x.max(Vec4::splat(-126.0)).min(Vec4::splat(127.0));
    let shifted = x + Vec4::splat(127.5);
    let (a, b, c, d) = (shifted.x as i32, shifted.y as i32, shifted.z as i32, shifted.w as i32);
    let whole = Vec4::new((a - 127) as f32, (b - 127) as f32, (c - 127) as f32, (d - 127) as f32);
    let r = x - whole;
    let r2 = r * r;
    let first = (Vec4::ONE + r * 6.931_472e-1) + (Vec4::splat(2.402_265e-1) + r * 5.550_332_5e-2) * r2;
    let polynomial = first + (Vec4::splat(9.618_437e-3) + r * 1.339_887_4e-3 + r2 * 1.535_336_2e-4) * (r2 * r2);
    let power = |exponent: i32| f32::from_bits((exponent as u32) << 23);
    polynomial * Vec4::new(power(a), power(b), power(c), power(d))
}

/// [`pow`] of each coordinate, with its error: in vectors on a CPU.
#[inline(always)]
pub fn pow_of_each(x: Vec4, y: Vec4) -> Vec4 {
    Vec4::select(x.cmpgt(Vec4::ZERO), exp2_of_each(y * log2_of_each(x)), Vec4::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(from: f32, to: f32, steps: u32) -> impl Iterator<Item = f32> {
        (0..=steps).map(move |i| from + (to - from) * (i as f32 / steps as f32))
    }

    #[test]
    fn sine_and_cosine_are_within_their_stated_error() {
        for x in sweep(-core::f32::consts::TAU, core::f32::consts::TAU, 1_000_000) {
            let (s, c) = sin_cos(x);
            assert!((f64::from(s) - f64::from(x).sin()).abs() < 2e-7, "sin {x}");
            assert!((f64::from(c) - f64::from(x).cos()).abs() < 2e-7, "cos {x}");
        }
    }

    #[test]
    fn the_arc_tangent_is_within_its_stated_error_in_every_octant() {
        for angle in sweep(-core::f32::consts::PI, core::f32::consts::PI, 100_000) {
            for radius in [1e-20f32, 1.0, 1e20] {
                let (y, x) = (radius * angle.sin(), radius * angle.cos());
                let expected = f64::from(y).atan2(f64::from(x));
                assert!((f64::from(atan2(y, x)) - expected).abs() < 3e-7, "angle {angle}");
            }
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
        assert_eq!(atan2(0.0, -1.0), core::f32::consts::PI);
    }

    #[test]
    fn logarithm_and_power_of_two_are_within_their_stated_errors() {
        for x in sweep(-30.0, 30.0, 300_000) {
            let exact = f64::from(x).exp2();
            assert!((f64::from(exp2(x)) - exact).abs() < 3e-7 * exact, "exp2 {x}");
            let y = exact as f32;
            let error = (f64::from(log2(y)) - f64::from(y).log2()).abs();
            assert!(error < 2e-7 + f64::from(x.abs()) * 6.1e-8, "log2 {y}: {error}");
        }
        assert_eq!(log2(0.0), -126.0);
        assert_eq!(pow(0.0, 2.4), 0.0);
    }

    #[test]
    fn each_coordinate_has_its_own_logarithm_and_power_within_the_same_errors() {
        for x in sweep(-30.0, 29.0, 100_000) {
            let each = Vec4::new(x, x + 0.25, x + 0.5, x + 1.0);
            let powers = exp2_of_each(each);
            let logarithms = log2_of_each(powers);
            for lane in 0..4 {
                let exact = f64::from(each[lane]).exp2();
                assert!((f64::from(powers[lane]) - exact).abs() < 1.8e-7 * exact, "exp2 {}", each[lane]);
                let error = (f64::from(logarithms[lane]) - f64::from(powers[lane]).log2()).abs();
                assert!(error < 1e-7 + f64::from(each[lane].abs()) * 6.1e-8, "log2 {}: {error}", powers[lane]);
            }
        }
        assert_eq!(log2_of_each(Vec4::new(0.0, -1.0, 1e-40, 1.0)), Vec4::new(-126.0, -126.0, -126.0, 0.0));
        let limits = exp2_of_each(Vec4::new(-1e9, 1e9, -126.0, 127.0));
        assert_eq!(limits.to_array().map(f32::log2), [-126.0, 127.0, -126.0, 127.0]);
        let powers = pow_of_each(Vec4::new(0.0, -2.0, 4.0, 9.0), Vec4::new(2.4, 2.0, 0.5, -0.5));
        assert!((powers - Vec4::new(0.0, 0.0, 2.0, 1.0 / 3.0)).abs().max_element() < 1e-6, "{powers}");
    }

    #[test]
    fn multiply_high_equals_the_64_bit_product() {
        let samples = [0, 1, 2, 0xffff, 0x1_0000, 0x1234_5678, 0x7fff_ffff, 0x8000_0000, 0xffff_fffe, u32::MAX];
        for a in samples {
            for b in samples {
                assert_eq!(multiply_high(a, b), ((u64::from(a) * u64::from(b)) >> 32) as u32, "{a} {b}");
            }
        }
    }

    #[test]
    fn unorm16_codes_survive_a_round_trip_and_unit_floats_stay_below_one() {
        for code in 0..=0xffff {
            assert_eq!(pack_unorm16(unpack_unorm16(code)), code);
        }
        assert!(unit_float(u32::MAX) < 1.0 && unit_float(0) == 0.0);
        assert!(unorm16_center(0xffff) < 1.0 && unorm16_center(0) > 0.0);
    }

    #[test]
    fn non_finite_numbers_are_recognised_by_their_bits() {
        assert!(is_finite(0.0) && is_finite(-1e38) && is_finite(1e-45));
        assert!(!is_finite(f32::NAN) && !is_finite(f32::INFINITY) && !is_finite(f32::NEG_INFINITY));
    }
}
