//! Times of passes over the last frames, smoothed.

use std::{collections::VecDeque, time::Duration};

/// Frames that are remembered.
const FRAMES: usize = 240;
/// Share of a new frame in a smoothed time.
const SHARE: f64 = 0.1;

/// What frames have taken.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    /// Milliseconds of the last frames, the newest last.
    pub frame_ms: VecDeque<f64>,
    /// Milliseconds of each pass, smoothed, in the order of the frame.
    pub passes: Vec<(&'static str, f64)>,
    /// The same over the last frames, the newest last; one list for each pass.
    pub pass_ms: Vec<VecDeque<f64>>,
    /// Milliseconds and rung of the last frames under a time budget, the newest last.
    pub budget: VecDeque<(f64, usize)>,
    smoothed_ms: Option<f64>,
}

impl Stats {
    /// One more frame, with the times of its passes where they are known.
    pub fn add(&mut self, frame: Duration, times: &[(&'static str, Duration)]) {
        let frame_ms = frame.as_secs_f64() * 1e3;
        if self.frame_ms.len() == FRAMES {
            self.frame_ms.pop_front();
        }
        self.frame_ms.push_back(frame_ms);
        self.smoothed_ms = Some(blended(self.smoothed_ms, frame_ms));
        if times.is_empty() {
            return;
        }
        let is_same = self.passes.iter().map(|(pass, _)| *pass).eq(times.iter().map(|(pass, _)| *pass));
        if !is_same {
            self.passes = times.iter().map(|(pass, time)| (*pass, time.as_secs_f64() * 1e3)).collect();
            self.pass_ms = vec![VecDeque::new(); times.len()];
        }
        for (((_, smoothed), history), (_, time)) in self.passes.iter_mut().zip(&mut self.pass_ms).zip(times) {
            *smoothed = blended(Some(*smoothed), time.as_secs_f64() * 1e3);
            if history.len() == FRAMES {
                history.pop_front();
            }
            history.push_back(*smoothed);
        }
    }

    /// One more frame under a time budget.
    pub fn add_budget(&mut self, frame: Duration, level: usize) {
        if self.budget.len() == FRAMES {
            self.budget.pop_front();
        }
        self.budget.push_back((frame.as_secs_f64() * 1e3, level));
    }

    /// Milliseconds of a frame, smoothed; 0 before the first.
    pub fn smoothed_ms(&self) -> f64 {
        self.smoothed_ms.unwrap_or(0.0)
    }
}

fn blended(old: Option<f64>, new: f64) -> f64 {
    old.map_or(new, |old| old + (new - old) * SHARE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_smoothed_and_start_anew_with_other_passes() {
        let ms = Duration::from_millis;
        let mut stats = Stats::default();
        stats.add(ms(10), &[("primary", ms(4))]);
        stats.add(ms(20), &[("primary", ms(8))]);
        assert!((stats.smoothed_ms() - 11.0).abs() < 1e-9);
        assert!((stats.passes[0].1 - 4.4).abs() < 1e-9);
        stats.add(ms(20), &[("primary", ms(8)), ("shade", ms(2))]);
        assert_eq!(stats.passes, [("primary", 8.0), ("shade", 2.0)]);
        assert_eq!(stats.pass_ms, [[8.0], [2.0]]);
        for _ in 0..2 * FRAMES {
            stats.add(ms(1), &[]);
        }
        assert_eq!(stats.frame_ms.len(), FRAMES);
        assert_eq!(stats.passes.len(), 2, "where times are not known, the last ones stay");
    }
}
