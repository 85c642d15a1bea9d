//! Weighted reservoir sampling: one sample kept of a stream, in proportion to its weight.

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};

use crate::numerics::is_finite;

/// What a pixel remembers between passes: one 16-byte row. All zero: no sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Reservoir {
    /// Light id, see [`crate::light`]; meaningless while `ucw` is 0.
    pub light: u32,
    /// Point on the light, two 16-bit coordinates. Quantised before any use.
    pub uv: u32,
    /// Unbiased contribution weight W: stands for the reciprocal of the sample's density over (light, u, v).
    pub ucw: f32,
    /// Confidence: how many independent trials this sample stands for.
    pub confidence: f32,
}

const _: () = assert!(size_of::<Reservoir>() == 16 && offset_of!(Reservoir, ucw) == 8);

impl Reservoir {
    /// No sample, no trial.
    pub const EMPTY: Self = Self { light: 0, uv: 0, ucw: 0.0, confidence: 0.0 };

    /// Whether there is a sample that contributes.
    #[inline(always)]
    pub fn has_sample(&self) -> bool {
        self.ucw > 0.0
    }
}

/// A stream being resampled: what only streaming needs.
#[derive(Clone, Copy)]
pub struct Stream {
    light: u32,
    uv: u32,
    target: f32,
    weight_sum: f32,
}

impl Stream {
    /// Nothing offered yet.
    #[inline(always)]
    pub fn new() -> Self {
        Self { light: 0, uv: 0, target: 0.0, weight_sum: 0.0 }
    }

    /// Offers a sample with target p̂ and resampling weight w = m p̂ W, and a uniform number in 0..1. Weights that are
    /// not positive and finite are dropped.
    ///
    /// Source: Chao 1982, "A General Purpose Unequal Probability Sampling Plan".
    #[inline(always)]
    pub fn offer(&mut self, light: u32, uv: u32, target: f32, weight: f32, random: f32) {
        if !(weight > 0.0) || !is_finite(weight) {
            return;
        }
        self.weight_sum += weight;
        // Strict: a weight of zero is not kept even where the random number is zero.
        if random * self.weight_sum < weight {
            self.light = light;
            self.uv = uv;
            self.target = target;
        }
    }

    /// The kept sample with W = (sum of weights) / p̂, and the confidence of one trial. Without a sample the
    /// confidence stays: it is part of the estimate that nothing was found.
    #[inline(always)]
    pub fn finish(&self) -> Reservoir {
        let ucw = if self.target > 0.0 { self.weight_sum / self.target } else { 0.0 };
        Reservoir { light: self.light, uv: self.uv, ucw: if is_finite(ucw) { ucw } else { 0.0 }, confidence: 1.0 }
    }
}

impl Default for Stream {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{numerics::unit_float, rng::pcg4d};

    #[test]
    fn samples_are_kept_in_proportion_to_their_weights() {
        let weights = [1.0, 0.0, 3.0, f32::NAN, 4.0, f32::INFINITY, -1.0];
        let mut counts = [0.0f64; 7];
        let n = 160_000;
        for i in 0..n {
            let mut stream = Stream::new();
            for (j, &w) in weights.iter().enumerate() {
                stream.offer(j as u32, 0, 2.0, w, unit_float(pcg4d(i, j as u32, 0, 9)[0]));
            }
            let kept = stream.finish();
            assert_eq!(kept.ucw, 4.0);
            counts[kept.light as usize] += 1.0;
        }
        let statistic: f64 = [(0, 1.0), (2, 3.0), (4, 4.0)]
            .iter()
            .map(|&(i, w)| (counts[i] - f64::from(n) * w / 8.0).powi(2) / (f64::from(n) * w / 8.0))
            .sum();
        assert!(statistic < 27.0, "chi-square with 2 degrees of freedom: {statistic} {counts:?}");
        assert_eq!(counts[1] + counts[3] + counts[5] + counts[6], 0.0);
    }

    /// All ordered pairs from three lights and every acceptance: no sampling noise, only rounding.
    #[test]
    fn streaming_resampling_is_unbiased_by_enumeration() {
        let (target, pmf) = ([0.0f64, 1.0, 3.0], [0.2f64, 0.5, 0.3]);
        let mut mean = 0.0;
        for a in 0..3 {
            for b in 0..3 {
                let w = [target[a] / pmf[a] / 2.0, target[b] / pmf[b] / 2.0];
                let sum = w[0] + w[1];
                for (kept, weight) in [(a, w[0]), (b, w[1])] {
                    if weight > 0.0 {
                        mean += pmf[a] * pmf[b] * (weight / sum) * target[kept] * (sum / target[kept]);
                    }
                }
                // The code keeps either sample and reports the same W.
                let mut stream = Stream::new();
                stream.offer(0, a as u32, target[a] as f32, w[0] as f32, 0.0);
                stream.offer(0, b as u32, target[b] as f32, w[1] as f32, 0.5);
                let kept = stream.finish();
                if sum > 0.0 {
                    let expected = sum / target[kept.uv as usize];
                    assert!((f64::from(kept.ucw) - expected).abs() < 1e-5 * expected);
                } else {
                    assert_eq!(kept.ucw, 0.0);
                }
            }
        }
        assert!((mean - 4.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_but_zero_weights_gives_no_sample_and_keeps_the_confidence() {
        let mut stream = Stream::new();
        stream.offer(1, 2, 0.0, 0.0, 0.0);
        assert_eq!(stream.finish(), Reservoir { confidence: 1.0, ..Reservoir::EMPTY });
    }

    #[test]
    fn an_overflowing_contribution_weight_is_dropped() {
        let mut stream = Stream::new();
        stream.offer(1, 2, 1e-38, 1e10, 0.0);
        assert!(!stream.finish().has_sample());
    }
}
