//! Random small worlds, each enumerated; and what the passes run in `f32` against the same in `f64`.

use rayon::prelude::*;
use weir_shared::{
    merge::{form, merge},
    resample::{Choose, Chooser},
    rng::{Rng, pcg4d},
};

use crate::{
    ROUNDING,
    unbiased::{UNBIASED, rules},
    world::{Case, Domain, Float, Held, Keeper, LIGHTS, Law, Probe, Rule, merged_means},
};

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

#[test]
fn no_random_world_is_an_exception() {
    let rules = rules();
    let worlds = 1_000_000;
    let worst = (0..worlds)
        .into_par_iter()
        .map(|case| (error(case, &rules), case))
        .reduce(|| (0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
    assert!(worst.0 < ROUNDING, "world {} of {worlds}: error {}", worst.1, worst.0);
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

fn assert_follows(x: f32, exact: f64, what: &str) {
    assert!((f64::from(x) - exact).abs() <= 1e-5 * exact.abs(), "{what}: {x} for {exact}");
}

#[test]
fn single_precision_follows_double_precision_when_it_decides_alike() {
    let forms = UNBIASED.into_iter().chain([form::ONE_OVER_M]).collect::<Vec<_>>();
    for case in 0..100_000 {
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
        let what = format!("case {case}, form {form}");
        assert_eq!((kept.light, kept.confidence), (exact.light, exact.confidence), "{what}");
        assert_eq!(merged.kept, merged_double.kept, "{what}");
        assert_follows(kept.ucw as f32, exact.ucw, &what);
        for (sum, exact) in sums.into_iter().zip(double.sums) {
            assert_follows(sum, exact, &what);
        }
        assert_follows(merged.factor, f64::from_f64(merged_double.factor), &what);
    }
}
