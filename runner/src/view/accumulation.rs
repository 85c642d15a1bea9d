//! When to reuse frames, when to average independent ones, and when to rest.

/// What the next frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// One that reuses the frame before.
    RealTime,
    /// One of a still: this many were averaged before.
    Still(u32),
    /// None: the picture is good enough.
    Rest,
}

/// Fewest samples of a pixel before an estimate of the error counts.
const FEWEST: u32 = 16;
/// Most samples: beyond it, a running mean in single precision gains nothing.
pub const MOST: u32 = 1 << 20;

/// Decides frame by frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Accumulation {
    samples: u32,
    error_percent: Option<f32>,
}

impl Accumulation {
    /// What to do next: `moves` tells whether anything has changed since the frame before, `accumulate` whether stills are
    /// wanted at all, `goal_percent` which error is good enough, if any is: a still that is compared goes on.
    pub fn next(&mut self, moves: bool, accumulate: bool, goal_percent: Option<f32>) -> Mode {
        if moves || !accumulate {
            *self = Self::default();
            return Mode::RealTime;
        }
        let is_good = self.error_percent.zip(goal_percent).is_some_and(|(error, goal)| error <= goal);
        let is_good = is_good && self.samples >= FEWEST;
        if is_good || self.samples >= MOST {
            return Mode::Rest;
        }
        let before = self.samples;
        self.samples += 1;
        Mode::Still(before)
    }

    /// The error of the still so far.
    pub fn measured(&mut self, error_percent: f32) {
        self.error_percent = Some(error_percent);
    }

    /// Samples of each pixel so far, 0 in real time.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The error that was measured last.
    pub fn error_percent(&self) -> Option<f32> {
        self.error_percent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_is_real_time_and_what_stands_is_averaged_until_it_is_good() {
        let mut accumulation = Accumulation::default();
        assert_eq!(accumulation.next(true, true, Some(1.0)), Mode::RealTime);
        for sample in 0..40 {
            assert_eq!(accumulation.next(false, true, Some(1.0)), Mode::Still(sample));
            accumulation.measured(2.0);
        }
        accumulation.measured(0.9);
        assert_eq!(accumulation.next(false, true, Some(1.0)), Mode::Rest);
        assert_eq!(accumulation.next(false, true, Some(0.5)), Mode::Still(40), "a lower goal wakes it");
        accumulation.measured(0.0);
        assert_eq!(accumulation.next(false, true, None), Mode::Still(41), "nothing is good enough");
        assert_eq!(accumulation.next(true, true, Some(1.0)), Mode::RealTime);
        assert_eq!(accumulation.next(false, true, Some(1.0)), Mode::Still(0), "motion starts anew");
    }

    #[test]
    fn a_lucky_first_estimate_is_not_believed() {
        let mut accumulation = Accumulation::default();
        for _ in 0..FEWEST {
            assert_ne!(accumulation.next(false, true, Some(1.0)), Mode::Rest);
            accumulation.measured(0.0);
        }
        assert_eq!(accumulation.next(false, true, Some(1.0)), Mode::Rest);
    }

    #[test]
    fn without_accumulation_every_frame_reuses_the_one_before() {
        let mut accumulation = Accumulation::default();
        for _ in 0..3 {
            assert_eq!(accumulation.next(false, false, Some(1.0)), Mode::RealTime);
        }
    }
}
