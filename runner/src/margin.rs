//! The margin of error of a picture: how far it is from the truth, and how well that is known, from its own frames.
//!
//! Frames are independent of each other; within a frame, pixels are not, because neighbours share samples. So what
//! follows rests on the first and supposes nothing of the second.
//!
//! The error of a picture is the root of its relMSE, L = mean of (x - r)² / D over pixels and channels, with
//! D = r² + 0.01 m², r the true value and m the mean of r (here x and its mean stand for them). With d_f = y_f - r the
//! deviation of frame f, and a·b the mean of a b / D over pixels and channels:
//!
//! - L = |mean of d_f|², and the estimate V = mean of (squared standard error) / D has the same expectation.
//! - L - V = 2 / (N (N - 1)) times the sum of d_f·d_g over all pairs of different frames, exactly. Products of different
//!   frames have mean zero and do not correlate with each other, so that its variance is 2 T / (N (N - 1)), with T the
//!   mean square of such a product.
//!
//! T takes in all that pixels of one frame share. It is measured on batches: frames are gathered in up to 16 batches of
//! n, the mean square of the products of their means is T / n². The interval is V plus or minus a quantile of Student's t
//! times that deviation. It takes L for normal, as a sum of very many terms is; where a few pixels hold most of the
//! error, as fireflies do, it is too narrow.

use std::fmt;

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Chance that an interval holds the true value.
pub const CONFIDENCE: f64 = 0.95;
/// Batches kept at most; each time there are so many, pairs become one.
const MOST_BATCHES: usize = 16;
/// Pixels that products are taken over, at most: evenly spread. Fewer pixels make the interval wider, not wrong.
const MOST_PIXELS: usize = 1 << 16;
/// Keeps relative errors finite in the dark, as a share of the squared mean of the picture.
pub const FLOOR: f64 = 0.01;

/// Mean and sum of squared deviations of each channel of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelMoments {
    /// Mean.
    pub mean: [f64; 3],
    /// Sum of squared deviations from it.
    pub deviation: [f64; 3],
}

impl PixelMoments {
    /// Of two sets of `n` and `other_n` frames together.
    fn merged(&self, n: f64, other: &Self, other_n: f64) -> Self {
        let mut all = Self::default();
        for c in 0..3 {
            let apart = other.mean[c] - self.mean[c];
            all.mean[c] = self.mean[c] + apart * other_n / (n + other_n);
            all.deviation[c] = self.deviation[c] + other.deviation[c] + apart * apart * n * other_n / (n + other_n);
        }
        all
    }

    /// Of the frames that `self` has, `n` in all, beyond those of `before`. Inverse of [`Self::merged`].
    fn since(&self, n: f64, before: &Self, before_n: f64) -> Self {
        let rest = n - before_n;
        let mut new = Self::default();
        for c in 0..3 {
            new.mean[c] = (n * self.mean[c] - before_n * before.mean[c]) / rest;
            let apart = new.mean[c] - before.mean[c];
            let between = apart * apart * before_n * rest / n;
            new.deviation[c] = (self.deviation[c] - before.deviation[c] - between).max(0.0);
        }
        new
    }
}

/// How far a picture is from the truth, as a share of the true values: the root of its relMSE.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margin {
    /// The estimate; 0.02 is 2 %.
    pub error: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
    /// Standard error of the estimated variance of one frame, as a share of it.
    pub variance_spread: f64,
}

impl fmt::Display for Margin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let half = 50.0 * (self.high - self.low);
        let digits = if half > 0.0 { (1.0 - half.log10().floor()).clamp(1.0, 4.0) as usize } else { 1 };
        let confidence = 100.0 * CONFIDENCE;
        let error = 100.0 * self.error;
        write!(f, "mean relative error {error:.digits$} % +- {half:.digits$} %, {confidence} % confidence")
    }
}

/// The quantile of Student's t beyond which lies half of what [`CONFIDENCE`] leaves, on either side.
pub fn student(freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(f64::INFINITY, |t| t.inverse_cdf(0.5 + 0.5 * CONFIDENCE))
}

/// The frames of a picture in batches, of which [`Margin`] is made.
pub struct Batches {
    pixels: Vec<usize>,
    /// Frames of a batch.
    stride: u32,
    /// Frames so far, up to the end of the last batch, and their moments.
    frames: u32,
    so_far: Vec<PixelMoments>,
    batches: Vec<Vec<PixelMoments>>,
}

impl Batches {
    /// For a picture of so many pixels; with the number of frames, if it is known, fewer need to be looked at.
    pub fn new(pixels: usize, frames: Option<u32>) -> Self {
        let chosen = pixels.min(MOST_PIXELS);
        // 2^32 over the golden ratio: multiples of it spread evenly.
        let spread = |i: usize| (((i as u64 * 0x9e37_79b9) & 0xffff_ffff) * pixels as u64 >> 32) as usize;
        let pixels = if chosen < pixels { (0..chosen).map(spread).collect() } else { (0..pixels).collect::<Vec<_>>() };
        let stride = frames.map_or(1, |frames| frames.div_ceil(MOST_BATCHES as u32).max(1));
        Self { so_far: vec![PixelMoments::default(); pixels.len()], pixels, stride, frames: 0, batches: Vec::new() }
    }

    /// How many frames after the first `frames` [`Self::add`] wants to see the moments; none beyond that.
    pub fn due_in(&self, frames: u32) -> u32 {
        (self.frames + self.stride).saturating_sub(frames)
    }

    /// The moments of each pixel after so many frames.
    pub fn add(&mut self, frames: u32, moments_of: impl Fn(usize) -> PixelMoments) {
        if self.batches.len() == MOST_BATCHES {
            let n = f64::from(self.stride);
            let merge = |pair: &[Vec<PixelMoments>]| -> Vec<PixelMoments> {
                pair[0].iter().zip(&pair[1]).map(|(a, b)| a.merged(n, b, n)).collect()
            };
            self.batches = self.batches.chunks_exact(2).map(merge).collect();
            self.stride *= 2;
            if self.due_in(frames) > 0 {
                return;
            }
        }
        let now: Vec<PixelMoments> = self.pixels.iter().map(|&p| moments_of(p)).collect();
        let (n, before) = (f64::from(frames), f64::from(self.frames));
        self.batches.push(now.iter().zip(&self.so_far).map(|(now, past)| now.since(n, past, before)).collect());
        (self.so_far, self.frames) = (now, frames);
    }

    /// The margin after `frames` frames in all, whose moments these are; none before the second batch.
    pub fn margin(&self, frames: u32, all: &[PixelMoments]) -> Option<Margin> {
        let count = self.batches.len();
        if count < 2 || frames < 2 {
            return None;
        }
        let (n, total) = (f64::from(self.stride), f64::from(frames));
        let mean = all.iter().flat_map(|p| p.mean).sum::<f64>() / (3.0 * all.len() as f64);
        let weight_of = |x: f64| 1.0 / (x * x + FLOOR * mean * mean).max(f64::MIN_POSITIVE);
        let squares = all.iter().flat_map(|p| (0..3).map(|c| p.deviation[c] * weight_of(p.mean[c])));
        let estimate = squares.sum::<f64>() / (3.0 * all.len() as f64) / (total * (total - 1.0));

        // Products of the deviations of batches from their mean, and the squares of all frames of each.
        let mut products = vec![0.0; count * count];
        let mut squares = vec![0.0; count];
        let share = 1.0 / (3.0 * self.pixels.len() as f64);
        let mut apart = vec![0.0; count];
        for (place, &pixel) in self.pixels.iter().enumerate() {
            for c in 0..3 {
                let weight = share * weight_of(all[pixel].mean[c]);
                let mean = self.batches.iter().map(|b| b[place].mean[c]).sum::<f64>() / count as f64;
                for (i, batch) in self.batches.iter().enumerate() {
                    apart[i] = batch[place].mean[c] - mean;
                    squares[i] += weight * (batch[place].deviation[c] / n + apart[i] * apart[i]);
                    for j in 0..i {
                        products[i * count + j] += weight * apart[i] * apart[j];
                    }
                }
            }
        }
        let b = count as f64;
        let off_diagonal: Vec<f64> =
            (0..count).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| products[i * count + j]).collect();
        // Deviations from the mean of B are less than those from the truth, and their products are -1/B on average.
        let center = off_diagonal.iter().sum::<f64>() / off_diagonal.len() as f64;
        let mean_square = off_diagonal.iter().map(|p| (p - center).powi(2)).sum::<f64>() / off_diagonal.len() as f64;
        let of_batches = mean_square / ((1.0 - 1.0 / b).powi(2) + 1.0 / (b * b));
        let deviation = (2.0 * n * n * of_batches / (total * (total - 1.0))).sqrt();
        let half = student(b - 1.0) * deviation;

        let of_squares = squares.iter().sum::<f64>() / b;
        let spread = squares.iter().map(|q| (q - of_squares).powi(2)).sum::<f64>() / (b * (b - 1.0));
        Some(Margin {
            error: estimate.sqrt(),
            low: (estimate - half).max(0.0).sqrt(),
            high: (estimate + half).sqrt(),
            variance_spread: if of_squares > 0.0 { spread.sqrt() / of_squares } else { 0.0 },
        })
    }
}

/// Frames that bring the error down to `error`, from the margin of a pilot of `frames`: those of the upper end of a
/// one-sided interval, so that the error is rarely above. At least two.
pub fn frames_for(error: f64, pilot: &Margin, frames: u32) -> f64 {
    // One-sided 95 %, of a pilot with few batches.
    let upper = 1.0 + 1.9 * pilot.variance_spread;
    (pilot.error.powi(2) * f64::from(frames) * upper / (error * error)).ceil().max(2.0)
}

#[cfg(test)]
mod tests;
