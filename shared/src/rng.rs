//! Random numbers: a hash of (pixel, seed, frame, stage, dimension), the same integers on every processor.

use glam::UVec2;

use crate::frame::Frame;

/// What the numbers are for. Two stages never share a number.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Stage {
    /// Position within the pixel.
    Primary = 1,
    /// Candidate lights and the choice among them.
    Candidates = 2,
}

/// A counter-based generator: number `i` of a stream is a hash of the stream's key and `i`.
#[derive(Clone, Copy)]
pub struct Rng {
    pixel: u32,
    seed: u32,
    frame: u32,
    dimension: u32,
}

impl Rng {
    /// The stream of one pixel in one stage of one frame. Pixels are told apart up to 65,536 in each direction.
    #[inline]
    pub fn for_pixel(px: UVec2, frame: &Frame, stage: Stage) -> Self {
        Self {
            pixel: (px.x & 0xffff) | (px.y << 16),
            seed: frame.seed,
            frame: frame.index,
            dimension: (stage as u32) << 24,
        }
    }

    /// The next four numbers, 32 uniform bits each.
    #[inline]
    pub fn next_four(&mut self) -> [u32; 4] {
        let bits = pcg4d(self.pixel, self.seed, self.frame, self.dimension);
        self.dimension = self.dimension.wrapping_add(1);
        bits
    }
}

/// A hash from four words to four words.
///
/// Source: Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", pcg4d.
#[inline]
pub fn pcg4d(x: u32, y: u32, z: u32, w: u32) -> [u32; 4] {
    const MULTIPLIER: u32 = 1_664_525;
    const INCREMENT: u32 = 1_013_904_223;
    let mut x = x.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
    let mut y = y.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
    let mut z = z.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
    let mut w = w.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT);
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    x ^= x >> 16;
    y ^= y >> 16;
    z ^= z >> 16;
    w ^= w >> 16;
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    [x, y, z, w]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pearson's statistic of 16-bit-high buckets against uniform.
    fn chi_square(bits: impl Iterator<Item = u32>) -> f64 {
        let mut counts = [0u32; 256];
        let mut n = 0.0;
        for b in bits {
            counts[(b >> 24) as usize] += 1;
            n += 1.0;
        }
        let expected = n / 256.0;
        counts.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum()
    }

    #[test]
    fn every_lane_is_uniform_over_pixels_frames_and_dimensions() {
        for lane in 0..4 {
            let pixels = chi_square((0..65_536u32).map(|i| pcg4d((i & 255) | ((i >> 8) << 16), 0, 0, 1 << 24)[lane]));
            let frames = chi_square((0..65_536u32).map(|i| pcg4d(7, 3, i, 1 << 24)[lane]));
            let dimensions = chi_square((0..65_536u32).map(|i| pcg4d(7, 3, 11, (2 << 24) + i)[lane]));
            for statistic in [pixels, frames, dimensions] {
                // 255 degrees of freedom: the 1e-6 and 1 - 1e-6 quantiles.
                assert!((158.0..375.0).contains(&statistic), "lane {lane}: {statistic}");
            }
        }
    }

    #[test]
    fn neighbouring_pixels_and_frames_are_uncorrelated() {
        let value = |x: u32, frame: u32| f64::from(pcg4d(x, 1, frame, 1 << 24)[0]) / 4_294_967_296.0 - 0.5;
        let n = 100_000;
        let across: f64 = (0..n).map(|i| value(i, 0) * value(i + 1, 0)).sum::<f64>() / f64::from(n) * 12.0;
        let along: f64 = (0..n).map(|i| value(5, i) * value(5, i + 1)).sum::<f64>() / f64::from(n) * 12.0;
        // The standard deviation of a correlation over n pairs is 1/sqrt(n).
        assert!(across.abs() < 5.0 / f64::from(n).sqrt(), "{across}");
        assert!(along.abs() < 5.0 / f64::from(n).sqrt(), "{along}");
    }
}
