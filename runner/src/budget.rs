//! A budget of time for each frame of the real-time chain, held by moving knobs along a front of quality against cost.
//!
//! [`TimeBudget`] is told how long each frame took, everything included, and says with which settings to make the next.
//! It moves among the rungs of [`FRONT`] only. What a rung changes stands in the frame uniform, so the plan, its memory
//! and the history stay. Nor is the chain biased: reservoirs carry their own confidence, and a merge weighs them by it,
//! whatever made them. (That holds for settings that do not depend on what the reservoirs hold. The time of a frame
//! depends on them only as a sum over all pixels.)
//!
//! How it decides, all in logarithms of milliseconds, where the noise of times is about the same at all loads:
//!
//! - The time of a frame is typical until shown otherwise: the median over the frames since the last change. One that is
//!   far off is a spike and changes nothing; the second in a row is a new load, and the frames before it are forgotten.
//!   So are they when five in a row lie on one side, as on a ramp.
//! - It goes down at once when more than one frame in twenty is to be expected above the budget, and as far as it must.
//! - It goes up only when the rung above, by the learnt cost of the step, leaves room for the noise and some more: between
//!   the two conditions lies a band in which nothing moves.
//! - The cost of a step is learnt each time it is taken. A step up that had to be taken back is not tried again until
//!   twice as many frames have passed, up to 256, or the load has changed.

mod front;

use std::{collections::VecDeque, time::Duration};

use crate::settings::Settings;

pub use front::{FRONT, Rung};

/// Frames that the typical time is the median of.
const WINDOW: usize = 31;
/// Frames at least between a change and a step up.
const SHORTEST_WAIT: u32 = 4;
/// The same after many steps up that had to be taken back.
const LONGEST_WAIT: u32 = 256;
/// Frames in a row on one side of the median that make a drift.
const DRIFT: usize = 5;
/// Deviations from the median that make a spike.
const SPIKE_SIGMAS: f64 = 4.0;
/// The least that a spike is off, as a logarithm.
const SPIKE_LEAST: f64 = 0.1;
/// One frame in twenty is that many deviations late.
const DOWN_SIGMAS: f64 = 1.645;
/// Room for noise that a rung must leave to be taken.
const UP_SIGMAS: f64 = 2.5;
/// The rest of the band in which nothing moves, as a logarithm.
const HYSTERESIS: f64 = 0.04;
/// Deviation of a logarithm of time before any is known, and the range of what is believed.
const NOISE: f64 = 0.03;
const NOISE_RANGE: [f64; 2] = [0.01, 0.3];

/// Holds a time budget. Feed it with [`TimeBudget::observe`] after each frame.
#[derive(Clone, Debug)]
pub struct TimeBudget {
    base: Settings,
    settings: Settings,
    /// Logarithm of the budget in milliseconds.
    limit: f64,
    level: usize,
    /// Logarithm of the cost of rung i + 1 over that of rung i.
    steps: Vec<f64>,
    /// Logarithms of the times since the last change of rung or load, the latest last.
    recent: VecDeque<f64>,
    /// The last frame, if it was far off.
    spike: Option<f64>,
    /// Rung and typical time before the last move, while the load is the same.
    moved_from: Option<(usize, f64)>,
    /// Deviation of the logarithms.
    noise: f64,
    /// Frames until the next step up may be taken.
    wait: u32,
    /// What `wait` starts from.
    patience: u32,
    /// Frames since the last step up.
    since_rise: u32,
    counts: Counts,
}

/// What has become of the budget so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames observed.
    pub frames: u32,
    /// Frames that took no longer than the budget.
    pub within: u32,
    /// Changes of rung.
    pub moves: u32,
}

impl TimeBudget {
    /// Holds `budget` by changing in `base` what the rungs of [`FRONT`] name; starts at the default settings' rung.
    pub fn new(budget: Duration, base: &Settings) -> Self {
        let level = FRONT.iter().position(|rung| rung.is_default).expect("the default is on the front");
        Self {
            settings: FRONT[level].applied_to(base),
            base: base.clone(),
            limit: log_ms(budget),
            level,
            steps: FRONT.windows(2).map(|pair| (pair[1].cost / pair[0].cost).ln()).collect(),
            recent: VecDeque::new(),
            spike: None,
            moved_from: None,
            noise: NOISE,
            wait: SHORTEST_WAIT,
            patience: SHORTEST_WAIT,
            since_rise: u32::MAX,
            counts: Counts::default(),
        }
    }

    /// Settings of the next frame.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The rung of the next frame, a place in [`FRONT`].
    pub fn level(&self) -> usize {
        self.level
    }

    /// The budget.
    pub fn budget(&self) -> Duration {
        Duration::from_secs_f64(self.limit.exp() * 1e-3)
    }

    /// Another budget from the next frame on; what was learnt stays.
    pub fn set_budget(&mut self, budget: Duration) {
        self.limit = log_ms(budget);
        (self.wait, self.patience) = (0, SHORTEST_WAIT);
    }

    /// Other knobs under those that the rungs name.
    pub fn set_base(&mut self, base: &Settings) {
        self.base = base.clone();
        self.settings = FRONT[self.level].applied_to(base);
        self.forget_load();
    }

    /// What has become of it so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Whether even the lowest rung takes longer than the budget.
    pub fn is_out_of_reach(&self) -> bool {
        self.level == 0 && self.recent.len() > 1 && self.typical() > self.limit
    }

    /// A frame was made with [`TimeBudget::settings`] and took this long from start to end, building and uploading what
    /// has moved included. The first one does not count: caches fill and pipelines are made.
    pub fn observe(&mut self, frame: Duration) {
        let time = log_ms(frame);
        self.counts.frames += 1;
        self.counts.within += u32::from(time <= self.limit);
        if self.counts.frames == 1 {
            return;
        }
        self.wait = self.wait.saturating_sub(1);
        self.since_rise = self.since_rise.saturating_add(1);
        if self.is_spike(time) {
            return;
        }
        self.recent.push_back(time);
        if self.recent.len() > WINDOW {
            self.recent.pop_front();
        }
        self.follow_drift();
        self.learn_step();
        self.learn_noise();
        self.decide();
    }

    /// Whether to leave this frame out. If the one before it was as far off, both are a new load.
    fn is_spike(&mut self, time: f64) -> bool {
        let off = time - self.typical();
        if self.recent.len() < 3 || off.abs() < f64::max(SPIKE_SIGMAS * self.noise, SPIKE_LEAST) {
            self.spike = None;
            return false;
        }
        match self.spike.take() {
            Some(before) if (before - self.typical()).signum() == off.signum() => {
                self.forget_load();
                self.recent.push_back(before);
                false
            }
            _ => {
                self.spike = Some(time);
                true
            }
        }
    }

    /// The load is another: what is known of times is void, and what was learnt about steps is half believed.
    fn forget_load(&mut self) {
        self.recent.clear();
        self.spike = None;
        self.moved_from = None;
        (self.wait, self.patience) = (0, SHORTEST_WAIT);
        self.since_rise = u32::MAX;
        for (step, pair) in self.steps.iter_mut().zip(FRONT.windows(2)) {
            *step = 0.5 * (*step + (pair[1].cost / pair[0].cost).ln());
        }
    }

    fn follow_drift(&mut self) {
        let Some(first) = self.recent.len().checked_sub(DRIFT).filter(|&first| first > 2) else { return };
        let typical = self.typical();
        let last = self.recent.range(first..);
        if last.clone().all(|t| *t > typical + self.noise) || last.clone().all(|t| *t < typical - self.noise) {
            self.recent.drain(..first);
            self.moved_from = None;
            self.patience = SHORTEST_WAIT;
        }
    }

    /// The third frame on a rung tells what the steps to it have cost.
    fn learn_step(&mut self) {
        if self.recent.len() != 3 {
            return;
        }
        let Some((from, before)) = self.moved_from.take() else { return };
        let [low, high] = [from.min(self.level), from.max(self.level)];
        let believed: f64 = self.steps[low..high].iter().sum();
        let found = if self.level > from { self.typical() - before } else { before - self.typical() };
        let factor = (found / believed).clamp(0.25, 4.0);
        self.steps[low..high].iter_mut().for_each(|step| *step *= factor);
    }

    fn learn_noise(&mut self) {
        if self.recent.len() < 5 {
            return;
        }
        let typical = self.typical();
        // 1.4826 times the median absolute deviation is the deviation of a normal law; means of few frames wander.
        let found = 1.4826 * median(self.recent.iter().map(|t| (t - typical).abs()));
        let [low, high] = NOISE_RANGE;
        self.noise += 0.2 * (found.clamp(low, high) - self.noise);
    }

    fn decide(&mut self) {
        if self.recent.len() < 2 {
            return;
        }
        let typical = self.typical();
        let room_at = |level: usize| {
            let [low, high] = [level.min(self.level), level.max(self.level)];
            let steps: f64 = self.steps[low..high].iter().sum();
            self.limit - typical - if level > self.level { steps } else { -steps }
        };
        if room_at(self.level) < DOWN_SIGMAS * self.noise {
            let fits = |level: &usize| room_at(*level) >= 0.5 * (DOWN_SIGMAS + UP_SIGMAS) * self.noise;
            let level = (0..self.level).rev().find(fits).unwrap_or(0);
            if level < self.level {
                let taken_back = self.since_rise <= 2 * SHORTEST_WAIT + self.patience;
                self.patience = if taken_back { (2 * self.patience).min(LONGEST_WAIT) } else { SHORTEST_WAIT };
                self.move_to(level);
            }
        } else if self.wait == 0 && self.recent.len() > 2 {
            let fits = |level: &usize| room_at(*level) >= UP_SIGMAS * self.noise + HYSTERESIS;
            if let Some(level) = (self.level + 1..FRONT.len()).rev().find(fits) {
                self.move_to(level);
                self.since_rise = 0;
            }
        }
    }

    fn move_to(&mut self, level: usize) {
        self.moved_from = Some((self.level, self.typical()));
        self.level = level;
        self.settings = FRONT[level].applied_to(&self.base);
        self.recent.clear();
        self.spike = None;
        self.wait = self.patience;
        self.counts.moves += 1;
    }

    /// The median of what is known, of two the lower one: the other may be a spike. Beyond any budget's reach if there
    /// is nothing.
    fn typical(&self) -> f64 {
        median(self.recent.iter().copied())
    }
}

/// Of an even number the lower one; minus infinity of none.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied().unwrap_or(f64::NEG_INFINITY)
}

/// No frame is faster than the clock can tell.
fn log_ms(time: Duration) -> f64 {
    (time.as_secs_f64() * 1e3).max(1e-3).ln()
}

#[cfg(test)]
mod tests;
