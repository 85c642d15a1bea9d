//! Running mean and variance of a pixel over independent frames.

use bytemuck::{Pod, Zeroable};
use core::mem::size_of;
use glam::Vec3;

use crate::{fault, numerics::min};

/// Mean and sum of squared deviations, 48 bytes. All zero: no frame yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Moments {
    /// Mean radiance, linear Rec. 709.
    pub mean: [f32; 3],
    /// Frames so far.
    pub count: u32,
    /// What rounding has cut off the mean so far: added back with the next frame.
    pub carry: [f32; 3],
    /// Frames for which a weight was dropped.
    pub faults: u32,
    /// Sum of squared deviations from the mean.
    pub deviation: [f32; 3],
    /// The first [`crate::fault`] of them.
    pub fault: u32,
}

const _: () = assert!(size_of::<Moments>() == 48);

/// Where sums of squared deviations stop.
const MOST_DEVIATION: f32 = 3e38;

impl Moments {
    /// With one more frame, and the first [`crate::fault`] on the way to it. The mean is summed with compensation, so that
    /// it stays exact over millions of frames. Squared deviations stay finite, at
    /// 3e38 at most.
    ///
    /// Source: Welford 1962; Kahan 1965.
    #[inline(always)]
    pub fn with(&self, value: Vec3, fault: u32) -> Self {
        let count = self.count.wrapping_add(1);
        let share = 1.0 / count as f32;
        let mean = Vec3::new(self.mean[0], self.mean[1], self.mean[2]);
        let carry = Vec3::new(self.carry[0], self.carry[1], self.carry[2]);
        let deviation = Vec3::new(self.deviation[0], self.deviation[1], self.deviation[2]);
        // The mean is `mean - carry`, to more digits than one float holds.
        let difference = (value - mean) + carry;
        let step = difference * share - carry;
        let new_mean = mean + step;
        let new_carry = (new_mean - mean) - step;
        let square = difference * (value - new_mean);
        // Not-a-number, which stands for an overflow as well, counts as the most.
        let sum = |kept: f32, added: f32| min(kept + added, MOST_DEVIATION);
        let new_deviation =
            Vec3::new(sum(deviation.x, square.x), sum(deviation.y, square.y), sum(deviation.z, square.z));
        Self {
            mean: [new_mean.x, new_mean.y, new_mean.z],
            count,
            carry: [new_carry.x, new_carry.y, new_carry.z],
            faults: self.faults.wrapping_add(u32::from(fault != fault::NONE)),
            deviation: [new_deviation.x, new_deviation.y, new_deviation.z],
            fault: if self.fault == fault::NONE { fault } else { self.fault },
        }
    }

    /// Mean radiance.
    #[inline(always)]
    pub fn mean(&self) -> Vec3 {
        Vec3::new(self.mean[0], self.mean[1], self.mean[2])
    }

    /// Variance of the mean; zero before the second frame.
    #[inline(always)]
    pub fn variance_of_mean(&self) -> Vec3 {
        if self.count < 2 {
            return Vec3::ZERO;
        }
        let n = self.count as f32;
        Vec3::new(self.deviation[0], self.deviation[1], self.deviation[2]) * (1.0 / (n * (n - 1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_million_frames_of_one_value_keep_their_mean() {
        let mut moments = Moments::default();
        for _ in 0..1 << 20 {
            moments = moments.with(Vec3::splat(0.1), fault::NONE);
        }
        assert!((f64::from(moments.mean[0]) - 0.1).abs() < 1e-8, "{:?}", moments.mean);
        assert!(moments.variance_of_mean().x.abs() < 1e-15);
    }

    #[test]
    fn mean_and_variance_equal_those_of_the_textbook() {
        let values: [f64; 6] = [1.0, 4.0, 0.0, 2.5, 100.0, 3.25];
        let mut moments = Moments::default();
        for v in values {
            moments = moments.with(Vec3::splat(v as f32), fault::NONE);
        }
        let mean = values.iter().sum::<f64>() / 6.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 5.0 / 6.0;
        assert!((f64::from(moments.mean().x) - mean).abs() < 1e-5);
        assert!((f64::from(moments.variance_of_mean().x) / variance - 1.0).abs() < 1e-5);
    }

    #[test]
    fn noise_over_many_frames_does_not_drift() {
        let mut moments = Moments::default();
        let mut exact = 0.0;
        let n = 1 << 20;
        for i in 0..n {
            let value = crate::numerics::unit_float(crate::rng::pcg4d(i, 0, 0, 1)[0]);
            exact += f64::from(value);
            moments = moments.with(Vec3::splat(value), fault::NONE);
        }
        exact /= f64::from(n);
        assert!((f64::from(moments.mean[0]) - exact).abs() < 2e-7, "{} {exact}", moments.mean[0]);
    }
}
