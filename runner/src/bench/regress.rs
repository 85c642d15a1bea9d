//! Two runs: what has become slower or worse beyond the noise.
//!
//! Compared are, for each scene and method that both runs have,
//!
//! - the time of a frame: on the CPU in units of the yardstick that was measured beside each frame, so that a machine that
//!   is busier than last time is no regression;
//! - the variance of one frame (of a chain, its relMSE), which does not depend on how many frames there was time for;
//! - the bias.
//!
//! Each is a two-sample test at a level that is divided by the number of comparisons (Bonferroni), so that all of them
//! together raise a false alarm in one pair of runs out of twenty; and beyond it, a change has to be large enough to matter.

use std::fmt;

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::{results::Results, statistics::Quantity};

/// Chance of a false alarm in a pair of runs.
const FALSE_ALARM: f64 = 0.05;
/// Changes of time below this share do not matter: nor can they be told from the order of pages in memory.
const SLOWER: f64 = 0.10;
/// The same of the variance of a frame.
const NOISIER: f64 = 0.05;
/// The same of the bias, as a share of the mean.
const MORE_BIASED: f64 = 0.005;

/// Something that became worse.
#[derive(Clone, Debug, PartialEq)]
pub struct Regression {
    /// Scene and method.
    pub place: String,
    /// What.
    pub what: &'static str,
    /// Before.
    pub old: f64,
    /// Now.
    pub new: f64,
    /// By how much it differs, as a share of the noise that is allowed for.
    pub strength: f64,
}

impl fmt::Display for Regression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, what, old, new, strength } = self;
        write!(f, "{place}: {what} from {old:.4} to {new:.4}, {strength:.1} times what noise explains")
    }
}

/// What two runs say of each other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// What became worse.
    pub worse: Vec<Regression>,
    /// Quantities compared.
    pub compared: usize,
    /// Why the runs are less comparable than they could be.
    pub remarks: Vec<String>,
}

/// A quantity in both runs.
struct Pair<'a> {
    place: String,
    what: &'static str,
    old: &'a Quantity,
    new: &'a Quantity,
    /// Largest change that does not matter.
    slack: f64,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Positive, compared by ratio.
    Ratio,
    /// Of either sign; further from zero is worse.
    Signed,
}

/// Mean and squared standard error of samples, after `f`.
fn moments(samples: &[f64], f: impl Fn(f64) -> f64) -> (f64, f64, f64) {
    let values: Vec<f64> = samples.iter().map(|x| f(*x)).filter(|x| x.is_finite()).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)), n)
}

impl Pair<'_> {
    /// How far apart the runs are, and how far noise explains, with its degrees of freedom (Welch 1947); none if either
    /// run has fewer than two samples.
    fn difference(&self) -> Option<(f64, f64, f64)> {
        let f: fn(f64) -> f64 = if self.kind == Kind::Ratio { f64::ln } else { |x| x };
        let ((a, va, na), (b, vb, nb)) = (moments(&self.old.samples, f), moments(&self.new.samples, f));
        if na < 2.0 || nb < 2.0 {
            return None;
        }
        let variance = va + vb;
        let freedom = variance * variance / (va * va / (na - 1.0) + vb * vb / (nb - 1.0)).max(f64::MIN_POSITIVE);
        let freedom = if variance > 0.0 { freedom } else { na + nb - 2.0 };
        // Bias is worse in either direction, if it is further from zero than it was.
        let worse = match self.kind {
            Kind::Ratio => b - a,
            Kind::Signed if self.new.value.abs() > self.old.value.abs() => (self.new.value - self.old.value).abs(),
            Kind::Signed => 0.0,
        };
        Some((worse, variance.sqrt(), freedom))
    }

    fn judged(&self, comparisons: usize) -> Option<Regression> {
        let (worse, error, freedom) = self.difference()?;
        // Bias has two directions.
        let sides = if self.kind == Kind::Signed { 2.0 } else { 1.0 };
        let level = FALSE_ALARM / (comparisons as f64 * sides);
        let quantile = StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - level));
        let allowed = quantile * error + self.slack;
        (worse > allowed).then(|| Regression {
            place: self.place.clone(),
            what: self.what,
            old: self.old.value,
            new: self.new.value,
            strength: worse / allowed,
        })
    }
}

/// What has become worse from `old` to `new`.
pub fn compare(old: &Results, new: &Results) -> Verdict {
    let mut verdict = Verdict::default();
    if old.machine != new.machine {
        verdict.remarks.push(String::from("the machine, its adapter or the version of weir is another"));
    }
    let size = |results: &Results| (results.options.width, results.options.height);
    if size(old) != size(new) {
        verdict.remarks.push(String::from("the size is another, so nothing is compared; measure at the same size"));
        return verdict;
    }
    let by_yardstick = old.machine.adapter == "CPU" && new.machine.adapter == "CPU";
    let mut pairs = Vec::new();
    for new_scene in &new.scenes {
        let Some(old_scene) = old.scenes.iter().find(|scene| scene.name == new_scene.name) else { continue };
        for m in &new_scene.methods {
            let Some(before) = old_scene.methods.iter().find(|old| old.name == m.name) else { continue };
            let time = if by_yardstick {
                ("frame time in yardsticks", &before.frame_yardsticks, &m.frame_yardsticks)
            } else {
                ("milliseconds of a frame", &before.frame_ms, &m.frame_ms)
            };
            let place = format!("{}, {}", new_scene.name, m.name);
            let mut add = |what, old, new, slack, kind| {
                pairs.push(Pair { place: place.clone(), what, old, new, slack, kind });
            };
            add(time.0, time.1, time.2, (1.0 + SLOWER).ln(), Kind::Ratio);
            let slack = (1.0 + NOISIER).ln();
            add("variance of a frame", &before.relative_variance, &m.relative_variance, slack, Kind::Ratio);
            add("bias", &before.bias, &m.bias, MORE_BIASED, Kind::Signed);
        }
    }
    verdict.compared = pairs.iter().filter(|pair| pair.difference().is_some()).count();
    verdict.worse = pairs.iter().filter_map(|pair| pair.judged(verdict.compared)).collect();
    verdict.worse.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    verdict
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::results::{MethodResults, SceneResults};

    /// A run of ten methods whose samples scatter by some per cent, with a machine of its own pace.
    fn run(seed: u64, change: impl Fn(&mut MethodResults)) -> Results {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut noise = move || {
            // Sum of twelve uniform numbers less six: deviation 1.
            (0..12)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 40) as f64 / (1u64 << 24) as f64
                })
                .sum::<f64>()
                - 6.0
        };
        let methods = (0..10).map(|i| {
            let mut around =
                |mean: f64, deviation: f64| -> Vec<f64> { (0..8).map(|_| mean + deviation * noise()).collect() };
            let mut method = MethodResults {
                name: format!("m{i}"),
                frame_yardsticks: Quantity::median(around(20.0, 1.0)),
                relative_variance: Quantity::median(around(0.5, 0.02)),
                bias: Quantity::mean(around(0.0, 0.01)),
                ..MethodResults::default()
            };
            if i == 3 {
                change(&mut method);
            }
            method
        });
        let machine = super::super::results::Machine { adapter: String::from("CPU"), ..Default::default() };
        let scene = SceneResults { name: String::from("rooms"), methods: methods.collect(), ..SceneResults::default() };
        Results { machine, scenes: vec![scene], ..Results::default() }
    }

    fn scaled(q: &Quantity, by: f64) -> Quantity {
        Quantity::median(q.samples.iter().map(|x| x * by).collect())
    }

    #[test]
    fn two_runs_of_the_same_raise_no_alarm() {
        let alarms =
            (0..200).filter(|seed| !compare(&run(2 * seed, |_| {}), &run(2 * seed + 1, |_| {})).worse.is_empty());
        let count = alarms.count();
        assert!(count <= 10, "{count} of 200 pairs");
    }

    #[test]
    fn a_slower_frame_a_noisier_one_and_a_bias_are_seen_each_where_it_is() {
        let old = run(1, |_| {});
        type Change = fn(&mut MethodResults);
        let changes: [(&str, Change); 3] = [
            ("frame time in yardsticks", |m| m.frame_yardsticks = scaled(&m.frame_yardsticks, 1.4)),
            ("variance of a frame", |m| m.relative_variance = scaled(&m.relative_variance, 1.3)),
            ("bias", |m| m.bias = Quantity::mean(m.bias.samples.iter().map(|b| b - 0.05).collect())),
        ];
        for (what, change) in changes {
            let verdict = compare(&old, &run(2, change));
            assert_eq!(verdict.compared, 30);
            assert_eq!(verdict.worse.len(), 1, "{what}: {:?}", verdict.worse);
            assert_eq!((verdict.worse[0].place.as_str(), verdict.worse[0].what), ("rooms, m3", what));
            // What became better is no regression.
            assert!(compare(&run(2, change), &old).worse.is_empty(), "{what}");
        }
    }

    #[test]
    fn runs_of_other_sizes_or_with_one_sample_are_not_compared() {
        let mut small = run(1, |_| {});
        small.options.width = 32;
        let verdict = compare(&small, &run(2, |_| {}));
        assert!(verdict.compared == 0 && verdict.remarks.iter().any(|r| r.contains("size")));
        let single = run(1, |m| m.frame_yardsticks.samples.truncate(1));
        assert_eq!(compare(&single, &run(2, |_| {})).compared, 29);
    }
}
