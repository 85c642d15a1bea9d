//! Scalar functions.

use rayon::prelude::*;
use weir_shared::{
    numerics::{
        atan2, exp2, log2, pack_cell, pack_unorm16, pow, safe_sqrt, sin_cos, unit_float, unorm16_center, unpack_unorm16,
    },
    rng::pcg4d,
    tonemap::pack_srgb,
};

use crate::{Worst, assert_stated};

/// Every `step`-th float from `low` to `high`, both positive.
fn floats(low: f32, high: f32, step: u32) -> impl ParallelIterator<Item = f32> {
    (0..(high.to_bits() - low.to_bits()) / step).into_par_iter().map(move |i| f32::from_bits(low.to_bits() + i * step))
}

fn worst_of(values: impl ParallelIterator<Item = f32>, function: fn(f32) -> f32, exact: fn(f64) -> f64) -> Worst {
    let of = |mut worst: Worst, x: f32| {
        worst.add(f64::from(x), function(x), exact(f64::from(x)));
        worst
    };
    values.fold(Worst::default, of).reduce(Worst::default, Worst::merged)
}

#[test]
fn sine_and_cosine() {
    let small = || floats(1e-6, core::f32::consts::FRAC_PI_4, 61);
    assert_stated("sine up to pi/4", worst_of(small(), |x| sin_cos(x).0, f64::sin), 1.0);
    assert_stated("cosine up to pi/4", worst_of(small(), |x| sin_cos(x).1, f64::cos), 1.5);
    // Near the zeros, an ulp of the result is next to nothing: the absolute error counts.
    for (limit, stated) in [(core::f32::consts::TAU, 1e-7), (8192.0, 1e-7)] {
        let values = || floats(1e-6, limit, 61).flat_map(|x| [x, -x]);
        let sine = worst_of(values(), |x| sin_cos(x).0, f64::sin).absolute;
        let cosine = worst_of(values(), |x| sin_cos(x).1, f64::cos).absolute;
        println!("sine {sine:.2e} and cosine {cosine:.2e} absolute up to {limit}");
        assert!(sine.max(cosine) < stated, "{sine:e} {cosine:e}");
    }
}

#[test]
fn logarithm_and_powers() {
    let normal = || floats(f32::MIN_POSITIVE, f32::MAX, 997);
    let far = |x: &f32| !(0.5..2.0).contains(x);
    assert_stated("logarithm outside 0.5..2", worst_of(normal().filter(far), log2, f64::log2), 1.0);
    let near = worst_of(floats(0.5, 2.0, 7), log2, f64::log2);
    println!("logarithm in 0.5..2: {:.2e} absolute, {:.2} ulp at {}", near.absolute, near.ulps, near.at);
    assert!(near.absolute < 1e-7);
    let both = || floats(1e-6, 126.0, 97).flat_map(|x| [x, -x]);
    assert_stated("power of two", worst_of(both(), exp2, f64::exp2), 1.5);
    for (exponent, stated) in [(1.0 / 2.4, 6.0), (2.2, 26.0), (0.5, 4.0), (8.0, 56.0)] {
        let worst = floats(1e-3, 1.0, 41)
            .fold(Worst::default, |mut worst, x| {
                worst.add(f64::from(x), pow(x, exponent), f64::from(x).powf(f64::from(exponent)));
                worst
            })
            .reduce(Worst::default, Worst::merged);
        assert_stated(&format!("power {exponent}"), worst, stated);
    }
    let root = worst_of(floats(f32::MIN_POSITIVE, f32::MAX, 997), safe_sqrt, f64::sqrt);
    assert!(root.ulps <= 0.5, "square roots are exact: {root:?}");
}

#[test]
fn arc_tangent() {
    let worst = (0..4_000_000u32)
        .into_par_iter()
        .fold(Worst::default, |mut worst, i| {
            let [a, b, c, d] = pcg4d(i, 3, 1, 4);
            let magnitude = |bits: u32, sign: u32| {
                let x = f32::from_bits(0x2000_0000 + (bits >> 2));
                if sign & 1 == 0 { x } else { -x }
            };
            // Of any magnitudes, and of like ones.
            let (y, x) = (magnitude(a, c), magnitude(b, d));
            let (y, x) = if i % 2 == 0 { (y, x) } else { (y, y * (unit_float(b) * 4.0 - 2.0)) };
            if (y / x).abs() > 1e-30 && (y / x).is_finite() {
                worst.add(f64::from(y / x), atan2(y, x), f64::from(y).atan2(f64::from(x)));
            }
            worst
        })
        .reduce(Worst::default, Worst::merged);
    assert_stated("arc tangent", worst, 3.0);
    assert!(worst.absolute < 3e-7);
}

#[test]
fn codes() {
    let mut worst = 0.0f64;
    for code in 0..=0xffff {
        let exact = f64::from(code) / 65_535.0;
        worst = worst.max((f64::from(unpack_unorm16(code)) - exact).abs() / crate::ulp(exact));
        assert_eq!(f64::from(unorm16_center(code)), (f64::from(code) + 0.5) / 65_536.0, "a center is exact");
    }
    assert!(worst <= 0.5, "a quotient is correctly rounded: {worst}");
    let halves: Vec<f32> = (0..=1_000_000).map(|i| i as f32 / 1e6).collect();
    let off = |x: f32| (f64::from(unpack_unorm16(pack_unorm16(x))) - f64::from(x)).abs() * 131_070.0;
    let of_code = halves.iter().map(|&x| off(x)).fold(0.0, f64::max);
    println!("16-bit code: {of_code:.4} of 1/131070");
    assert!(of_code < 1.01);
    for &x in &halves {
        let cell = pack_cell(x, 1.0 - x) & 0xffff;
        assert!((f64::from(unorm16_center(cell)) - f64::from(x)).abs() <= 0.5 / 65_536.0 + 1e-9, "{x}");
    }
    let exact = |x: f64| if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    let of_byte = halves.iter().map(|&x| {
        let byte = f64::from(pack_srgb(glam::Vec3::splat(x)) & 0xff);
        (byte - exact(f64::from(x)) * 255.0).abs()
    });
    let of_byte = of_byte.fold(0.0, f64::max);
    println!("sRGB: {of_byte:.5} bytes");
    assert!(of_byte < 0.5005);
}
