//! When a picture is done.

use std::time::{Duration, Instant};

/// When a picture is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// After so many samples of each pixel.
    Samples(u32),
    /// After so much time, in whole frames.
    Time(Duration),
    /// When the relative error, see [`crate::margin`], is expected to be this or less; 0.02 is 2 %.
    Error(f64),
}

/// Frames whose times tell that of the next.
const REMEMBERED: usize = 9;

/// The clock of a picture: time since its first frame began, and that of the latest frames.
pub(super) struct Clock {
    start: Instant,
    last: Instant,
    times: Vec<Duration>,
}

impl Clock {
    pub(super) fn start() -> Self {
        let now = Instant::now();
        Self { start: now, last: now, times: Vec::new() }
    }

    pub(super) fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// A frame is done.
    pub(super) fn tick(&mut self) {
        let now = Instant::now();
        // The first frame waits for caches: it tells nothing once there is another.
        if self.times.len() == 1 && self.last == self.start + self.times[0] {
            self.times.clear();
        }
        self.times.push(now - self.last);
        if self.times.len() > REMEMBERED {
            self.times.remove(0);
        }
        self.last = now;
    }

    /// Whether to stop after `frames` frames. With a limit of time that is where one frame more, of the length that the
    /// latest had, would end further beyond the limit than this one falls short of it.
    pub(super) fn is_done(&self, stop: Stop, frames: u32) -> bool {
        match stop {
            Stop::Samples(n) => frames >= n,
            Stop::Time(limit) => self.last - self.start + self.typical() / 2 >= limit,
            Stop::Error(_) => false,
        }
    }

    /// The median of the latest frames.
    fn typical(&self) -> Duration {
        let mut times = self.times.clone();
        times.sort_unstable();
        times.get(times.len() / 2).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of the given lengths, without waiting for them.
    fn after(lengths_ms: &[u64]) -> Clock {
        let mut clock = Clock::start();
        clock.times = lengths_ms.iter().map(|ms| Duration::from_millis(*ms)).collect();
        clock.last = clock.start + clock.times.iter().sum::<Duration>();
        clock
    }

    #[test]
    fn a_picture_ends_with_the_frame_that_ends_nearest_to_its_time() {
        let stop = Stop::Time(Duration::from_millis(1000));
        assert!(!after(&[100; 9]).is_done(stop, 9));
        // 940 ms: another 100 would miss by 40, this one misses by 60.
        assert!(!after(&[140, 100, 100, 100, 100, 100, 100, 100, 100]).is_done(stop, 9));
        assert!(after(&[160, 100, 100, 100, 100, 100, 100, 100, 100]).is_done(stop, 9));
        assert!(after(&[700]).is_done(stop, 1));
        assert!(!after(&[600]).is_done(stop, 1));
    }

    #[test]
    fn a_slow_first_frame_does_not_count_for_the_length_of_the_next() {
        let mut clock = Clock::start();
        std::thread::sleep(Duration::from_millis(60));
        clock.tick();
        assert!(clock.typical() >= Duration::from_millis(60));
        for _ in 0..3 {
            std::thread::sleep(Duration::from_millis(1));
            clock.tick();
        }
        assert!(clock.typical() < Duration::from_millis(60), "{:?}", clock.typical());
        assert!(clock.elapsed() >= Duration::from_millis(63));
    }
}
