//! Random small worlds, each enumerated; and what the passes run in `f32` against the same in `f64`.

use rayon::prelude::*;
use weir_shared::{
    merge::{form, merge},
    resample::{Choose, Chooser},
    rng::{Rng, pcg4d},
};

use super::world::{Case, Domain, Float, Held, Keeper, LIGHTS, Law, Probe, Rule, merged_means};

/// Forms of weights that are unbiased.
pub const UNBIASED: [u32; 5] =
    [form::PAIRWISE_DEFENSIVE, form::PAIRWISE, form::BALANCE, form::CONTRIBUTION, form::ONE_OVER_Z];

/// Ways to merge that ought to be unbiased.
pub fn rules() -> Vec<Rule> {
    let mut rules: Vec<Rule> = UNBIASED.iter().map(|&form| Rule { form, partner: false, probe: Probe::None }).collect();
    for form in [form::PAIRWISE_DEFENSIVE, form::PAIRWISE] {
        rules.push(Rule { form, partner: true, probe: Probe::None });
        for probe in [Probe::One, Probe::All] {
            rules.extend([false, true].map(|partner| Rule { form, partner, probe }));
        }
    }
    rules
}

/// The random world with the largest relative error of an expectation, and that error.
pub fn worst_of(worlds: u32) -> (f64, u32) {
    let rules = rules();
    let larger = |a: (f64, u32), b: (f64, u32)| if b.0 > a.0 { b } else { a };
    (0..worlds).into_par_iter().map(|case| (error(case, &rules), case)).reduce(|| (0.0, 0), larger)
}

/// Numbers to make worlds of.
struct Numbers {
    case: u32,
    seed: u32,
    count: u32,
}

impl Numbers {
    fn below(&mut self, limit: u32) -> u32 {
        self.count += 1;
        pcg4d(self.case, self.seed, self.count, 0)[0] % limit
    }

    fn unit(&mut self) -> f64 {
        (f64::from(self.below(1 << 30)) + 0.5) / f64::from(1 << 30)
    }

    /// Over 2 `decades` around 1.
    fn magnitude(&mut self, decades: f64) -> f64 {
        10f64.powf((2.0 * self.unit() - 1.0) * decades)
    }

    fn confidence(&mut self) -> f64 {
        match self.below(8) {
            0 => 0.0,
            1 | 2 => 1.0,
            3 => 5.0,
            4 => 20.0,
            5 => 65_535.0,
            _ => f64::from(self.below(100)),
        }
    }

    fn domain(&mut self, decades: f64) -> Domain {
        Domain {
            target: std::array::from_fn(|_| if self.below(2) == 0 { 0.0 } else { self.magnitude(decades) }),
            visible: std::array::from_fn(|_| self.below(4) > 0),
        }
    }

    /// Any law that is right: W is 1 on average for each light that the domain can have. Several weights for one
    /// light, as merges leave them; and nothing at all.
    fn law(&mut self, domain: &Domain, confidence: f64, probe: Probe) -> Law {
        let mut law = Law::new();
        let wanted: [f64; LIGHTS] = std::array::from_fn(|light| {
            let exists = domain.target[light] > 0.0 && (probe == Probe::None || domain.visible[light]);
            let share = self.magnitude(3.0);
            if exists { share } else { 0.0 }
        });
        let nothing = if self.below(2) == 0 { self.magnitude(2.0) } else { 0.0 };
        let sum = wanted.iter().sum::<f64>() + nothing;
        for (light, share) in wanted.into_iter().enumerate().filter(|(_, share)| *share > 0.0) {
            let chance = share / sum;
            let mut state = |chance: f64, ucw: f64| law.push((chance, Held { light, ucw, confidence }));
            if self.below(4) == 0 {
                let (part, weight) = (self.unit(), self.unit());
                state(chance * part, weight / (chance * part));
                state(chance * (1.0 - part), (1.0 - weight) / (chance * (1.0 - part)));
            } else {
                state(chance, 1.0 / chance);
            }
        }
        if nothing > 0.0 || law.is_empty() {
            let chance = if law.is_empty() { 1.0 } else { nothing / sum };
            law.push((chance, Held { light: 0, ucw: 0.0, confidence }));
        }
        law
    }
}

/// Error of one random world.
fn error(case: u32, rules: &[Rule]) -> f64 {
    let mut numbers = Numbers { case, seed: 1, count: 0 };
    let rule = rules[numbers.below(rules.len() as u32) as usize];
    let count = [1, 2, 2, 2, 3, 3, 3, 4][numbers.below(8) as usize];
    let domains: Vec<Domain> = (0..count).map(|_| numbers.domain(30.0)).collect();
    let mut confidences: Vec<f64> = (0..count).map(|_| numbers.confidence()).collect();
    if rule.form <= form::PAIRWISE {
        confidences[0] = confidences[0].max(1.0);
    }
    let laws: Vec<Law> = (0..count).map(|i| numbers.law(&domains[i], confidences[i], rule.probe)).collect();
    let found = std::array::from_fn(|light| (0..count).any(|i| confidences[i] > 0.0 && domains[i].target[light] > 0.0));
    merged_means(&domains, &laws, &rule).error(&domains[0], &rule, found)
}

/// Writes down what a chooser decides.
struct Recording<'a>(Chooser, &'a mut Vec<bool>);

impl Choose<f32> for Recording<'_> {
    fn accept(&mut self, weight: f32, weight_sum: f32) -> bool {
        self.1.push(self.0.accept(weight, weight_sum));
        self.1[self.1.len() - 1]
    }
}

/// Decides as is written down.
struct Replaying<'a>(std::slice::Iter<'a, bool>);

impl<R> Choose<R> for Replaying<'_> {
    fn accept(&mut self, _weight: R, _weight_sum: R) -> bool {
        *self.0.next().expect("as many decisions")
    }
}

/// The random merge for which `f32` is furthest from `f64` where both decide alike: the largest relative difference, and
/// its number; infinite where they end with different samples.
pub fn furthest_from_double(cases: u32) -> (f64, u32) {
    let larger = |a: (f64, u32), b: (f64, u32)| if b.0 > a.0 { b } else { a };
    (0..cases).into_par_iter().map(|case| (distance_to_double(case), case)).reduce(|| (0.0, 0), larger)
}

fn distance_to_double(case: u32) -> f64 {
    let forms = UNBIASED.into_iter().chain([form::ONE_OVER_M]).collect::<Vec<_>>();
    let mut numbers = Numbers { case, seed: 2, count: 0 };
    let (form, way) = (forms[numbers.below(6) as usize], numbers.below(3));
    let count = 1 + numbers.below(14) as usize;
    let probe = [Probe::None, Probe::One, Probe::All][numbers.below(3) as usize];
    let domains: Vec<Domain> = (0..count).map(|_| numbers.domain(5.0)).collect();
    let held: Vec<Held> = (0..count)
        .map(|i| {
            let light = numbers.below(LIGHTS as u32) as usize;
            let ucw = if domains[i].target[light] > 0.0 { numbers.magnitude(4.0) } else { 0.0 };
            Held { light, ucw, confidence: numbers.confidence() }
        })
        .collect();
    let partner = if numbers.below(2) == 0 { 0 } else { numbers.below(count as u32) };
    let inputs = Case { domains: &domains, held: &held, probe, partner };
    let mut decisions = Vec::new();
    let rng = Rng::from_words(case, 3, 0, 0);
    let mut single = Keeper::<f32, _>::new(Recording(Chooser::new(rng, way), &mut decisions));
    let merged = merge(&inputs, form, &mut single);
    let (kept, sums) = (single.held(&merged), single.sums);
    let mut double = Keeper::<f64, _>::new(Replaying(decisions.iter()));
    let merged_double = merge(&inputs, form, &mut double);
    let exact = double.held(&merged_double);
    if (kept.light, kept.confidence, merged.kept) != (exact.light, exact.confidence, merged_double.kept) {
        return f64::INFINITY;
    }
    let apart = |x: f64, exact: f64| if x == exact { 0.0 } else { ((x - exact) / exact).abs() };
    let of_sums = sums.into_iter().zip(double.sums).map(|(sum, exact)| apart(f64::from(sum), exact));
    let others = [apart(kept.ucw, exact.ucw), apart(merged.factor.to_f64(), merged_double.factor)];
    let distances = of_sums.chain(others).map(|d| if d.is_nan() { f64::INFINITY } else { d });
    distances.fold(0.0, f64::max)
}
