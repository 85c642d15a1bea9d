//! Display: exposure, a tone curve, the sRGB encoding, eight bits.

use glam::{Vec3, Vec4};

use crate::numerics::{clamp, log2_of_each, max, pow, pow_of_each};

/// Tone curves, by the number that selects a variant of the pass.
pub mod curve {
    /// Only clips to 0..=1.
    pub const CLIP: u32 = 0;
    /// Reinhard et al. 2002 on each channel: x / (1 + x).
    pub const REINHARD: u32 = 1;
    /// The fit of the ACES reference by Narkowicz 2015.
    pub const ACES: u32 = 2;
    /// AgX of Sobotka, in the polynomial form of Wrensch 2023.
    pub const AGX: u32 = 3;
}

/// Radiance times exposure through a tone curve, as 8-bit sRGB: red in the low byte, opaque.
#[inline(always)]
pub fn display<const CURVE: u32>(radiance: Vec3) -> u32 {
    let x = Vec3::new(max(radiance.x, 0.0), max(radiance.y, 0.0), max(radiance.z, 0.0));
    if x.x + x.y + x.z == 0.0 {
        // What is black is so through every curve.
        0xff00_0000
    } else if CURVE == curve::REINHARD {
        pack_srgb(x / (x + Vec3::ONE))
    } else if CURVE == curve::ACES {
        // Large numbers first go to the plateau, so that the squares below stay finite.
        let channel = |x: f32| {
            let x = clamp(x, 0.0, 1e4) * 0.6;
            (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
        };
        pack_srgb(Vec3::new(channel(x.x), channel(x.y), channel(x.z)))
    } else if CURVE == curve::AGX {
        let x = agx(x);
        pack(encode_power(x))
    } else {
        pack_srgb(x)
    }
}

/// AgX: a change of primaries, a logarithm, a sigmoid, and back, to values for a display whose light is their power of 2.2.
/// Source: Wrensch 2023, "Minimal AgX Implementation".
#[inline(always)]
fn agx(x: Vec3) -> Vec3 {
    const MIN_EV: f32 = -12.473_93;
    const MAX_EV: f32 = 4.026_069;
    let inset = Vec3::new(0.842_479_06, 0.042_328_24, 0.042_375_654) * x.x
        + Vec3::new(0.078_433_59, 0.878_468_64, 0.078_433_6) * x.y
        + Vec3::new(0.079_223_745, 0.079_166_12, 0.879_142_97) * x.z;
    let logarithm = log2_of_each(inset.extend(1.0).max(Vec4::splat(1e-10)));
    let t =
        (logarithm.max(Vec4::splat(MIN_EV)).min(Vec4::splat(MAX_EV)) - Vec4::splat(MIN_EV)) * (1.0 / (MAX_EV - MIN_EV));
    let t2 = t * t;
    let t4 = t2 * t2;
    let s = t4 * t2 * 15.5 - t4 * t * 40.14 + t4 * 31.96 - t2 * t * 6.868 + t2 * 0.4298 + t * 0.1191
        - Vec4::splat(0.002_32);
    Vec3::new(1.196_879, -0.052_896_85, -0.052_971_635) * s.x
        + Vec3::new(-0.098_020_88, 1.151_903_1, -0.098_043_45) * s.y
        + Vec3::new(-0.099_029_74, -0.098_961_17, 1.151_073_7) * s.z
}

/// Linear to sRGB, both in 0..=1, for each channel. Source: IEC 61966-2-1.
#[inline(always)]
fn encode_srgb(linear: Vec3) -> Vec4 {
    let x = limited(linear);
    let power = pow_of_each(x, Vec4::splat(1.0 / 2.4));
    Vec4::select(x.cmple(Vec4::splat(0.003_130_8)), x * 12.92, power * 1.055 - Vec4::splat(0.055))
}

/// The sRGB encoding of `x` to the power of 2.2, for each channel: by one power instead of two.
#[inline(always)]
fn encode_power(x: Vec3) -> Vec4 {
    let x = limited(x);
    // Where the power is 0.0031308, but for a millionth.
    let is_dark = x.cmple(Vec4::splat(0.072_75));
    let power = pow_of_each(x, Vec4::select(is_dark, Vec4::splat(2.2), Vec4::splat(2.2 / 2.4)));
    Vec4::select(is_dark, power * 12.92, power * 1.055 - Vec4::splat(0.055))
}

#[inline(always)]
fn limited(color: Vec3) -> Vec4 {
    color.extend(0.0).max(Vec4::ZERO).min(Vec4::ONE)
}

/// sRGB-encoded to linear, both in 0..=1. Source: IEC 61966-2-1.
#[inline(always)]
pub fn decode_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { pow((encoded + 0.055) / 1.055, 2.4) }
}

/// A display-referred linear colour as 8-bit sRGB, red in the low byte, opaque.
#[inline(always)]
pub fn pack_srgb(linear: Vec3) -> u32 {
    pack(encode_srgb(linear))
}

/// Encoded channels in 0..=1 as bytes, red in the low one, opaque.
#[inline(always)]
fn pack(encoded: Vec4) -> u32 {
    let byte = |x: f32| (x * 255.0 + 0.5) as u32;
    byte(encoded.x) | (byte(encoded.y) << 8) | (byte(encoded.z) << 16) | 0xff00_0000
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_is_monotonic_and_stays_within_the_display() {
        fn check<const CURVE: u32>() {
            let mut last = 0;
            for i in 0..=400 {
                let x = (f64::from(i) / 10.0 - 20.0).exp2() as f32;
                let packed = display::<CURVE>(Vec3::splat(x));
                assert!((packed & 0xff) >= last, "curve {CURVE} at {x}");
                last = packed & 0xff;
            }
            assert!(last >= 250, "curve {CURVE} must reach white");
            // Tiny, so that the curve is asked; and nothing.
            for black in [1e-30, 0.0, -1.0] {
                assert_eq!(display::<CURVE>(Vec3::splat(black)), 0xff00_0000, "curve {CURVE}");
            }
            for bad in [-1.0, 0.0, 1e30] {
                assert_eq!(display::<CURVE>(Vec3::splat(bad)) >> 24, 0xff);
            }
        }
        check::<{ curve::CLIP }>();
        check::<{ curve::REINHARD }>();
        check::<{ curve::ACES }>();
        check::<{ curve::AGX }>();
    }

    #[test]
    fn the_encoding_matches_the_standard_to_the_nearest_byte() {
        for i in 0..=4096 {
            let x = f64::from(i) / 4096.0;
            let exact = if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            let byte = pack_srgb(Vec3::splat(x as f32)) & 0xff;
            assert!((f64::from(byte) - exact * 255.0).abs() < 0.501, "{x}");
        }
    }

    #[test]
    fn the_encoding_of_a_power_is_that_of_its_value() {
        for i in 0..=65_536 {
            let x = i as f32 / 65_536.0;
            let encoded = encode_power(Vec3::splat(x)).x;
            let power = f64::from(x).powf(2.2);
            let exact = if power <= 0.003_130_8 { power * 12.92 } else { 1.055 * power.powf(1.0 / 2.4) - 0.055 };
            assert!((f64::from(encoded) - exact).abs() < 2e-5, "{x}");
        }
    }

    #[test]
    fn the_decoding_matches_the_standard() {
        let expected = |b: u32| {
            let e = f64::from(b) / 255.0;
            if e <= 0.040_45 { e / 12.92 } else { ((e + 0.055) / 1.055).powf(2.4) }
        };
        for byte in 0..=255u32 {
            assert!((f64::from(decode_srgb(byte as f32 / 255.0)) - expected(byte)).abs() < 2e-6, "{byte}");
        }
    }
}
