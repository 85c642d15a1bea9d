//! Times of frames, and of a fixed piece of work between them.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::{
    Target,
    methods::Method,
    results::MethodResults,
    statistics::{Quantity, median},
};

/// A fixed piece of work on all threads. What else a shared machine does slows it as it slows frames on the CPU; nothing
/// in weir does.
pub struct Yardstick;

impl Yardstick {
    pub fn new() -> Self {
        Self.measure();
        Self
    }

    /// Does it; returns the seconds it took.
    pub fn measure(&self) -> f64 {
        let start = Instant::now();
        let work = |seed: u64| {
            // xorshift64, Marsaglia 2003.
            (0..200_000u32).fold(seed | 1, |x, _| {
                let x = x ^ (x << 13);
                let x = x ^ (x >> 7);
                x ^ (x << 17)
            })
        };
        let sum: u64 = (0..32u64).into_par_iter().map(work).reduce(|| 0, u64::wrapping_add);
        std::hint::black_box(sum);
        start.elapsed().as_secs_f64()
    }
}

/// The frames of a run, in parts: between points, or of a fixed length.
#[derive(Default)]
pub struct FrameTimes {
    first_s: Vec<f64>,
    /// Of the part that is under way.
    open: Vec<(f64, f64)>,
    /// Median of the frames of a part, and the same over that of the yardstick.
    parts: Vec<(f64, f64)>,
    /// Of each pass, in all frames but the first.
    passes: Vec<(&'static str, Vec<f64>)>,
}

impl FrameTimes {
    /// A frame of so many seconds, next to a yardstick of so many, with the times of its passes.
    pub fn add(&mut self, seconds: f64, yardstick_s: f64, passes: Vec<(&'static str, Duration)>) {
        if self.first_s.is_empty() {
            self.first_s.push(seconds);
            return;
        }
        self.open.push((seconds, yardstick_s));
        // A pass that runs in several rounds is one.
        let mut sums: Vec<(&'static str, f64)> = Vec::new();
        for (name, time) in passes {
            match sums.iter_mut().find(|sum| sum.0 == name) {
                Some(sum) => sum.1 += time.as_secs_f64(),
                None => sums.push((name, time.as_secs_f64())),
            }
        }
        for (name, time) in sums {
            match self.passes.iter_mut().find(|pass| pass.0 == name) {
                Some(pass) => pass.1.push(time),
                None => self.passes.push((name, vec![time])),
            }
        }
    }

    /// Frames so far are a part.
    pub fn end_part(&mut self) {
        if self.open.is_empty() {
            return;
        }
        let of = |f: &dyn Fn(&(f64, f64)) -> f64| median(&self.open.iter().map(f).collect::<Vec<_>>());
        let (seconds, yardstick) = (of(&|t| t.0), of(&|t| t.1));
        self.parts.push((seconds, seconds / yardstick));
        self.open.clear();
    }

    /// With the frames of another run.
    pub fn join(&mut self, mut other: Self) {
        other.end_part();
        self.first_s.append(&mut other.first_s);
        self.parts.append(&mut other.parts);
        for (name, mut times) in other.passes {
            match self.passes.iter_mut().find(|pass| pass.0 == name) {
                Some(pass) => pass.1.append(&mut times),
                None => self.passes.push((name, times)),
            }
        }
    }

    /// Milliseconds of a frame, a sample for each part.
    pub fn frame_ms(&self) -> Quantity {
        Quantity::median(self.parts.iter().map(|part| part.0 * 1e3).collect())
    }

    /// The part of the results that is about time.
    pub fn results(&self, method: &Method, target: &Target) -> MethodResults {
        let passes_ms: Vec<(String, f64)> =
            self.passes.iter().map(|(name, times)| ((*name).to_owned(), median(times) * 1e3)).collect();
        let primary_ms = passes_ms.iter().find(|pass| pass.0 == "primary").map_or(f64::NAN, |pass| pass.1);
        MethodResults {
            name: method.name.clone(),
            knobs: method.knobs.clone(),
            is_chain: !method.is_independent(),
            frame_ms: self.frame_ms(),
            frame_yardsticks: Quantity::median(self.parts.iter().map(|part| part.1).collect()),
            first_frame_ms: median(&self.first_s) * 1e3,
            camera_mrays: f64::from(target.width) * f64::from(target.height) / primary_ms * 1e-3,
            nominal: method.nominal_count(),
            passes_ms,
            ..MethodResults::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_frame_stands_apart_and_rounds_of_a_pass_are_one() {
        let mut times = FrameTimes::default();
        let pass = |ms| ("spatial", Duration::from_millis(ms));
        times.add(9.0, 1.0, vec![pass(900)]);
        times.add(0.4, 0.1, vec![pass(100), pass(50)]);
        times.add(0.2, 0.1, vec![pass(10), pass(40)]);
        times.end_part();
        let mut other = FrameTimes::default();
        other.add(7.0, 1.0, vec![]);
        other.add(0.5, 0.1, vec![pass(100)]);
        times.join(other);
        assert_eq!(times.first_s, [9.0, 7.0]);
        let samples = times.frame_ms().samples;
        assert!((samples[0] - 300.0).abs() < 1e-9 && (samples[1] - 500.0).abs() < 1e-9, "{samples:?}");
        assert!((median(&times.passes[0].1) - 0.1).abs() < 1e-9);
        assert!((times.parts[0].1 - 3.0).abs() < 1e-9);
    }

    #[test]
    fn the_yardstick_takes_time() {
        assert!(Yardstick::new().measure() > 1e-5);
    }
}
