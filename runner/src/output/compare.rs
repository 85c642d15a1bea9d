//! How far a picture is from its reference, in numbers and as a picture.

use std::fmt;

use thiserror::Error;

use super::Picture;

/// Keeps the relative measures finite in the dark, as a fraction of the reference's mean.
const FLOOR: f64 = 0.01;

/// A picture against its reference.
///
/// Sums are in f64, over the three channels of all pixels that are finite in both pictures. The mean of the reference
/// that appears in the relative measures is over all of these values: one number, not one a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Mean of each channel of the picture.
    pub mean: [f64; 3],
    /// Mean of each channel of the reference.
    pub reference_mean: [f64; 3],
    /// Mean of squared differences.
    pub mse: f64,
    /// Mean of `(x - r)^2 / (r^2 + 0.01 mean(r)^2)`.
    pub rel_mse: f64,
    /// Mean of `|x - r| / (|r| + 0.01 mean(r))`; 0.1 is 10 %.
    pub mape: f64,
    /// Mean of `2 |x - r| / (|x| + |r| + 0.01 mean(r))`, at most 2.
    pub smape: f64,
    /// Largest absolute difference of any value.
    pub max_abs: f64,
    /// Pixels that were compared.
    pub pixels: u64,
    /// Values of the picture that are infinite or not a number.
    pub non_finite: u64,
    /// The same of the reference.
    pub reference_non_finite: u64,
}

impl Comparison {
    /// The difference of the two overall means divided by the reference's: the bias, with its sign. 0.1 is 10 % too bright.
    ///
    /// 0 where both means are 0, infinite where only the reference's is.
    pub fn relative_mean_difference(&self) -> f64 {
        let (mean, reference): (f64, f64) = (self.mean.iter().sum(), self.reference_mean.iter().sum());
        ratio(mean - reference, reference.abs())
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "mean            {:?}", self.mean)?;
        writeln!(f, "reference mean  {:?}", self.reference_mean)?;
        writeln!(f, "difference      {:+.4} % of the mean", 100.0 * self.relative_mean_difference())?;
        writeln!(f, "MSE             {:e}", self.mse)?;
        writeln!(f, "relMSE          {:e}", self.rel_mse)?;
        writeln!(f, "MAPE            {:.4} %", 100.0 * self.mape)?;
        writeln!(f, "SMAPE           {:.4} %", 100.0 * self.smape)?;
        writeln!(f, "largest         {:e}", self.max_abs)?;
        write!(f, "non-finite      {} (reference: {})", self.non_finite, self.reference_non_finite)
    }
}

/// Why two pictures cannot be compared.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum CompareError {
    /// Their sizes differ.
    #[error("the picture is {}x{}, its reference {}x{}; render at the size of the reference", size[0], size[1], reference[0], reference[1])]
    Size {
        /// Width and height of the picture.
        size: [u32; 2],
        /// Width and height of the reference.
        reference: [u32; 2],
    },
    /// No pixel is finite in both.
    #[error("no pixel is finite in both pictures, so there is nothing to compare; see which of the two holds NaN")]
    NothingFinite,
}

/// Compares a picture with its reference.
///
/// # Errors
///
/// The sizes differ, or no pixel is finite in both.
pub fn compare(picture: &Picture, reference: &Picture) -> Result<Comparison, CompareError> {
    check_sizes(picture, reference)?;

    let mut result = Comparison {
        non_finite: count_non_finite(picture),
        reference_non_finite: count_non_finite(reference),
        ..Comparison::default()
    };
    let pairs = || finite_pairs(picture, reference);
    for (x, r) in pairs() {
        result.pixels += 1;
        for channel in 0..3 {
            result.mean[channel] += x[channel];
            result.reference_mean[channel] += r[channel];
        }
    }
    if result.pixels == 0 {
        return Err(CompareError::NothingFinite);
    }
    let pixels = result.pixels as f64;
    result.mean = result.mean.map(|sum| sum / pixels);
    result.reference_mean = result.reference_mean.map(|sum| sum / pixels);

    let mean = result.reference_mean.iter().sum::<f64>() / 3.0;
    for (x, r) in pairs().flat_map(|(x, r)| x.into_iter().zip(r)) {
        let difference = x - r;
        result.mse += difference * difference;
        result.rel_mse += ratio(difference * difference, r * r + FLOOR * mean * mean);
        result.mape += ratio(difference.abs(), r.abs() + FLOOR * mean.abs());
        result.smape += ratio(2.0 * difference.abs(), x.abs() + r.abs() + FLOOR * mean.abs());
        result.max_abs = result.max_abs.max(difference.abs());
    }
    let values = 3.0 * pixels;
    result.mse /= values;
    result.rel_mse /= values;
    result.mape /= values;
    result.smape /= values;
    Ok(result)
}

/// Largest absolute difference of each pixel over its channels; infinite where a value is finite in one picture alone, or
/// where both are infinite or not a number in different ways. Of pictures of one size.
pub fn pixel_errors(picture: &Picture, reference: &Picture) -> Vec<f64> {
    let value = |(x, r): (&f32, &f32)| match (f64::from(*x) - f64::from(*r)).abs() {
        difference if difference.is_finite() => difference,
        _ if x == r || (x.is_nan() && r.is_nan()) => 0.0,
        _ => f64::INFINITY,
    };
    let pairs = picture.rgb.iter().zip(&reference.rgb);
    pairs.map(|(x, r)| x.iter().zip(r).map(value).fold(0.0, f64::max)).collect()
}

/// What noise alone would make the relMSE of a picture with these squared standard errors: what a noisy reference adds to
/// that of others.
pub fn noise_rel_mse(picture: &Picture, variance: &[[f32; 3]]) -> f64 {
    let values = picture.rgb.iter().flatten().zip(variance.iter().flatten());
    let finite = values.map(|(x, v)| (f64::from(*x), f64::from(*v))).filter(|(x, v)| x.is_finite() && v.is_finite());
    let finite: Vec<(f64, f64)> = finite.collect();
    let n = finite.len() as f64;
    let mean = finite.iter().map(|(x, _)| x).sum::<f64>() / n;
    finite.iter().map(|(x, v)| ratio(*v, x * x + FLOOR * mean * mean)).sum::<f64>() / n
}

/// The mean of FLIP over a tone-mapped picture and its reference, 8-bit sRGB with red in the low byte: how different they
/// look when one takes the place of the other on a screen 0.7 m wide, seen from 0.7 m at 3840 pixels. None if it was
/// not built in (feature `flip`).
///
/// Source: Andersson et al. 2020, by NVIDIA's code.
pub fn flip(width: u32, height: u32, display: &[u32], reference: &[u32]) -> Option<f64> {
    #[cfg(feature = "flip")]
    {
        let image = |pixels: &[u32]| {
            let bytes: Vec<u8> = pixels.iter().flat_map(|p| [*p as u8, (p >> 8) as u8, (p >> 16) as u8]).collect();
            nv_flip::FlipImageRgb8::with_data(width, height, &bytes)
        };
        let map = nv_flip::flip(image(reference), image(display), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
        Some(f64::from(nv_flip::FlipPool::from_image(&map).mean()))
    }
    #[cfg(not(feature = "flip"))]
    {
        let _ = (width, height, display, reference);
        None
    }
}

/// Draws where a picture is darker (blue) or brighter (red) than its reference; white is equal, black not finite.
///
/// The color is the sum over channels of `x - r`, divided by that of `r` plus 1 % of its mean; `full_scale` of that
/// (0.1 is 10 %, must be positive) is saturated. Display-encoded RGBA, red in the low byte, as [`super::png::write`]
/// takes it.
///
/// # Errors
///
/// The sizes differ, or no pixel is finite in both.
pub fn difference_picture(picture: &Picture, reference: &Picture, full_scale: f32) -> Result<Vec<u32>, CompareError> {
    let floor = FLOOR * compare(picture, reference)?.reference_mean.iter().sum::<f64>().abs();
    let color = |(x, r): (&[f32; 3], &[f32; 3])| {
        let (x, r) = (widen(x), widen(r));
        if !x.iter().chain(&r).all(|value| value.is_finite()) {
            return 0xff00_0000;
        }
        let (x, r): (f64, f64) = (x.iter().sum(), r.iter().sum());
        let signed = (ratio(x - r, r.abs() + floor) / f64::from(full_scale)).clamp(-1.0, 1.0);
        let faded = (255.0 * (1.0 - signed.abs())).round() as u32;
        let [red, blue] = if signed < 0.0 { [faded, 255] } else { [255, if signed > 0.0 { faded } else { 255 }] };
        0xff00_0000 | blue << 16 | faded << 8 | red
    };
    Ok(picture.rgb.iter().zip(&reference.rgb).map(color).collect())
}

fn check_sizes(picture: &Picture, reference: &Picture) -> Result<(), CompareError> {
    let [size, reference] = [picture, reference].map(|picture| [picture.width, picture.height]);
    if size == reference { Ok(()) } else { Err(CompareError::Size { size, reference }) }
}

fn count_non_finite(picture: &Picture) -> u64 {
    picture.rgb.iter().flatten().filter(|value| !value.is_finite()).count() as u64
}

/// The pixels of which all six values are finite.
fn finite_pairs(picture: &Picture, reference: &Picture) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
    let pairs = picture.rgb.iter().zip(&reference.rgb).map(|(x, r)| (widen(x), widen(r)));
    pairs.filter(|(x, r)| x.iter().chain(r).all(|value| value.is_finite()))
}

fn widen(value: &[f32; 3]) -> [f64; 3] {
    value.map(f64::from)
}

/// `a / b` for `b >= 0`, where nothing over nothing is nothing: black matches black.
fn ratio(a: f64, b: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a / b }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(rgb: &[[f32; 3]]) -> Picture {
        Picture { width: rgb.len() as u32, height: 1, rgb: rgb.to_vec(), alpha: None }
    }

    fn assert_close(found: f64, expected: f64) {
        assert!((found - expected).abs() <= 1e-12 * expected.abs().max(1.0), "{found} is not {expected}");
    }

    #[test]
    fn the_measures_are_those_computed_by_hand() {
        // Reference values 1 1 1 3 3 3: the mean is 2, so the floors are 0.01 * 4 = 0.04 and 0.02.
        let result = compare(&picture(&[[1.5; 3], [2.0; 3]]), &picture(&[[1.0; 3], [3.0; 3]])).expect("compares");
        assert_eq!(result.mean, [1.75; 3]);
        assert_eq!(result.reference_mean, [2.0; 3]);
        assert_close(result.relative_mean_difference(), -0.125);
        assert_close(result.mse, (0.25 + 1.0) / 2.0);
        assert_close(result.rel_mse, (0.25 / 1.04 + 1.0 / 9.04) / 2.0);
        assert_close(result.mape, (0.5 / 1.02 + 1.0 / 3.02) / 2.0);
        assert_close(result.smape, (2.0 * 0.5 / 2.52 + 2.0 / 5.02) / 2.0);
        assert_close(result.max_abs, 1.0);
        assert_eq!((result.pixels, result.non_finite, result.reference_non_finite), (2, 0, 0));
    }

    #[test]
    fn errors_of_pixels_are_their_largest_and_what_is_finite_once_is_infinitely_wrong() {
        let x = picture(&[[1.0, 2.0, 3.0], [f32::NAN, 0.0, 0.0], [f32::NAN; 3], [f32::INFINITY; 3]]);
        let r = picture(&[[1.5, 2.0, 1.0], [0.0; 3], [f32::NAN; 3], [f32::NEG_INFINITY; 3]]);
        assert_eq!(pixel_errors(&x, &r), [2.0, f64::INFINITY, 0.0, f64::INFINITY]);
    }

    #[test]
    fn noise_of_a_reference_is_the_rel_mse_it_would_have_against_itself() {
        // Values 1 and 3 with mean 2: 0.04 is the floor.
        let found = noise_rel_mse(&picture(&[[1.0; 3], [3.0; 3]]), &[[0.25; 3], [1.0; 3]]);
        assert_close(found, (0.25 / 1.04 + 1.0 / 9.04) / 2.0);
    }

    #[cfg(feature = "flip")]
    #[test]
    fn flip_is_zero_for_equal_pictures_and_grows_with_their_difference() {
        let flat = |v: u32| vec![0xff00_0000 | v << 16 | v << 8 | v; 64 * 64];
        let of = |v| flip(64, 64, &flat(v), &flat(100)).expect("built in");
        assert!(of(100) < 1e-6);
        assert!(of(110) > 0.01 && of(160) > of(110), "{} {}", of(110), of(160));
    }

    #[test]
    fn channels_have_their_own_means() {
        let result = compare(&picture(&[[1.0, 2.0, 3.0]]), &picture(&[[1.0, 1.0, 1.0]])).expect("compares");
        assert_eq!(result.mean, [1.0, 2.0, 3.0]);
        assert_close(result.relative_mean_difference(), 1.0);
        assert_close(result.mse, 5.0 / 3.0);
    }

    #[test]
    fn a_pixel_that_is_not_finite_is_counted_and_left_out() {
        let x = picture(&[[1.0; 3], [f32::NAN, f32::INFINITY, 9.0], [9.0; 3]]);
        let r = picture(&[[1.0; 3], [1.0; 3], [1.0, f32::NEG_INFINITY, 1.0]]);
        let result = compare(&x, &r).expect("one pixel is finite");
        assert_eq!((result.pixels, result.non_finite, result.reference_non_finite), (1, 2, 1));
        assert_eq!((result.mean, result.mse), ([1.0; 3], 0.0));
    }

    #[test]
    fn black_matches_black_and_light_against_black_is_infinitely_wrong() {
        let black = picture(&[[0.0; 3]]);
        let same = compare(&black, &black).expect("compares");
        assert_eq!((same.rel_mse, same.mape, same.relative_mean_difference()), (0.0, 0.0, 0.0));
        let lit = compare(&picture(&[[1.0; 3]]), &black).expect("compares");
        assert_eq!(lit.relative_mean_difference(), f64::INFINITY);
        assert_eq!(lit.rel_mse, f64::INFINITY);
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let (one, two) = (picture(&[[1.0; 3]]), picture(&[[1.0; 3]; 2]));
        assert_eq!(compare(&one, &two), Err(CompareError::Size { size: [1, 1], reference: [2, 1] }));
        let nan = picture(&[[f32::NAN; 3]]);
        assert_eq!(compare(&nan, &one), Err(CompareError::NothingFinite));
    }

    #[test]
    fn brighter_is_red_darker_is_blue_and_equal_is_white() {
        // The reference sums to 3, its mean to 3: relative differences are divided by 3.03.
        let r = picture(&[[1.0; 3]; 5]);
        let x = picture(&[[2.0; 3], [0.0; 3], [1.0; 3], [1.101; 3], [1.0 - 0.0505; 3]]);
        let colors = difference_picture(&x, &r, 0.2).expect("compares");
        // 0.303 / 3.03 is half of the scale: 127.5; 0.1515 / 3.03 a quarter: 191.25.
        assert_eq!(colors[..3], [0xff00_00ff, 0xffff_0000, 0xffff_ffff]);
        assert!([0xff7f_7fff, 0xff80_80ff].contains(&colors[3]), "{:x}", colors[3]);
        assert_eq!(colors[4], 0xffff_bfbf);
    }

    #[test]
    fn a_pixel_that_is_not_finite_is_drawn_black() {
        let x = picture(&[[f32::NAN; 3], [1.0; 3]]);
        let colors = difference_picture(&x, &picture(&[[1.0; 3]; 2]), 0.1).expect("compares");
        assert_eq!(colors, [0xff00_0000, 0xffff_ffff]);
    }
}
