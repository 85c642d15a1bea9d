//! Random numbers: a hash of (pixel, seed, frame, stage, dimension), the same integers on every processor.

use glam::UVec2;

use crate::{frame::Frame, numerics::unit_float};

/// What the numbers are for. Two stages never share a number.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Stage {
    /// Position within the pixel.
    Primary = 1,
    /// Points on candidate lights.
    Candidates = 2,
    /// Which candidate is kept.
    CandidateChoice = 3,
    /// Which candidate of a group is kept.
    GroupChoice = 6,
    /// Directions from the BSDF.
    BsdfRay = 7,
    /// Ways down the light tree.
    LightTree = 9,
    /// Records of lights drawn ahead.
    Presample = 10,
    /// Which of the lights drawn for a record is kept.
    PresampleChoice = 11,
    /// Which tile of records a block of pixels has.
    TileChoice = 12,
    /// Ways down to a light of a cut's cluster.
    LightCuts = 13,
    /// The pixel that the cut of a block is made for.
    CutPixel = 14,
    /// Candidate lights.
    CandidatePicks = 15,
    /// Which inputs temporal reuse has.
    TemporalInputs = 4,
    /// Which sample temporal reuse keeps.
    TemporalChoice = 5,
    /// Which input of temporal reuse is asked for the pixel's own sample.
    TemporalPartner = 8,
    /// As [`Stage::TemporalInputs`], for the first round of spatial reuse; other rounds follow.
    SpatialInputs = 16,
    /// As [`Stage::TemporalChoice`], for the first round of spatial reuse; other rounds follow.
    SpatialChoice = 32,
    /// As [`Stage::TemporalPartner`], for the first round of spatial reuse; other rounds follow.
    SpatialPartner = 48,
}

/// A counter-based generator: number `i` of a stream is a hash of the stream's key and `i`.
#[derive(Clone, Copy)]
pub struct Rng {
    pixel: u32,
    seed: u32,
    frame: u32,
    dimension: u32,
    // Not a vector: naga would round the size of the struct up.
    spare: [u32; 3],
    spare_count: u32,
}

impl Rng {
    /// The stream of one pixel in one stage of one frame. Pixels are told apart up to 65,536 in each direction.
    #[inline]
    pub fn for_pixel(px: UVec2, frame: &Frame, stage: Stage) -> Self {
        Self::from_words(pack_pixel(px), frame.seed, frame.index, first_dimension(stage as u32, 0))
    }

    /// The stream of one of a pixel's reservoirs; in a stage with rounds, of one round of the frame.
    #[inline]
    pub fn for_reservoir(px: UVec2, reservoir: u32, frame: &Frame, stage: Stage) -> Self {
        let dimension = first_dimension(stage as u32 + frame.round, reservoir);
        Self::from_words(pack_pixel(px), frame.seed, frame.index, dimension)
    }

    /// The stream of a frame's stage and round, the same for all pixels.
    #[inline]
    pub fn for_frame(frame: &Frame, stage: Stage) -> Self {
        // Rows beyond 65,535 do not exist.
        Self::from_words(0xffff_ffff, frame.seed, frame.index, first_dimension(stage as u32 + frame.round, 0))
    }

    /// The stream of a key of four words; the last counts up.
    #[inline]
    pub fn from_words(pixel: u32, seed: u32, frame: u32, dimension: u32) -> Self {
        Self { pixel, seed, frame, dimension, spare: [0; 3], spare_count: 0 }
    }

    /// The stream from number `count` times four on.
    #[inline]
    pub fn skip(self, count: u32) -> Self {
        Self { dimension: self.dimension.wrapping_add(count), ..self }
    }

    /// The next 32 uniform bits.
    #[inline]
    pub fn next_word(&mut self) -> u32 {
        if self.spare_count == 0 {
            let [x, y, z, w] = self.next_four();
            self.spare = [y, z, w];
            self.spare_count = 3;
            return x;
        }
        self.spare_count -= 1;
        let [word, y, z] = self.spare;
        self.spare = [y, z, 0];
        word
    }

    /// The next uniform number in `0..1`.
    #[inline]
    pub fn next_float(&mut self) -> f32 {
        unit_float(self.next_word())
    }

    /// The next uniform number above 0 and up to 1.
    #[inline]
    pub fn next_positive_float(&mut self) -> f32 {
        ((self.next_word() >> 8) + 1) as f32 * (1.0 / 16_777_216.0)
    }

    /// The next four numbers, 32 uniform bits each.
    #[inline]
    pub fn next_four(&mut self) -> [u32; 4] {
        let bits = pcg4d(self.pixel, self.seed, self.frame, self.dimension);
        self.dimension = self.dimension.wrapping_add(1);
        bits
    }
}

/// A pixel in one word, told apart up to 65,536 in each direction.
#[inline]
fn pack_pixel(px: UVec2) -> u32 {
    (px.x & 0xffff) | (px.y << 16)
}

/// Where the numbers of a stage (below 64) and a reservoir begin: some millions apart, by an odd factor, because
/// [`pcg4d`] carries a difference in the upper bits of its last word to few others.
#[inline]
fn first_dimension(stage: u32, reservoir: u32) -> u32 {
    (stage | (reservoir << 6)).wrapping_mul(2_654_435_761)
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
    fn no_two_stages_share_numbers_or_are_correlated() {
        let starts: Vec<u32> = (0..64).flat_map(|s| (0..8).map(move |r| first_dimension(s, r))).collect();
        for (i, a) in starts.iter().enumerate() {
            assert!(starts[..i].iter().all(|b| a.wrapping_sub(*b).min(b.wrapping_sub(*a)) > 1 << 20), "{i}");
        }
        let value = |dimension: u32, i: u32| (pcg4d(i & 255 | i >> 8 << 16, 3, 7, dimension)[0] >> 29) as usize;
        for (i, &a) in starts.iter().enumerate().step_by(8) {
            for &b in starts[..i].iter().step_by(8) {
                let mut table = [0u32; 64];
                (0..16_384).for_each(|n| table[value(a, n) * 8 + value(b, n)] += 1);
                let statistic: f64 = table.iter().map(|&c| (f64::from(c) - 256.0).powi(2) / 256.0).sum();
                // 63 degrees of freedom; 2,016 pairs.
                assert!(statistic < 145.0, "{a:#x} and {b:#x}: {statistic}");
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
