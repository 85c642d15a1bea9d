//! The checks have teeth: known mistakes, planted in the inputs or the sink of an otherwise honest merge, fail them.

use std::cell::Cell;

use weir_shared::merge::{Inputs, Merged, Sink, form, merge};

use crate::{
    ROUNDING,
    unbiased::{ALL, domains, fresh},
    walk::{Enumerating, Walk},
    world::{
        Case, Domain, Held, Keeper, Law, Means, Outcome, Probe, Rule, Sample, draw, draw_partner, merge_held, run,
    },
};

/// A mistake.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bug {
    None,
    NullsLoseConfidence,
    HiddenSamplesCountElsewhere,
    WeakSamplesAreRejected,
    CapForgottenInTheSum,
    OtherLightsForTheNeighbors,
}

struct Planted<'a> {
    case: Case<'a>,
    bug: Bug,
    asked: [Cell<u32>; 3],
}

impl Inputs<f64> for Planted<'_> {
    type Sample = Sample;
    type Domain = usize;
    type Light = f64;

    fn count(&self) -> u32 {
        Inputs::<f64>::count(&self.case)
    }

    fn confidence(&self, input: u32) -> f64 {
        let held = self.case.held[input as usize];
        let asked = self.asked[input as usize].replace(self.asked[input as usize].get() + 1);
        let here = self.case.domains[0].target[held.light];
        match self.bug {
            Bug::NullsLoseConfidence if held.ucw == 0.0 => 0.0,
            Bug::WeakSamplesAreRejected if input > 0 && here < 0.5 => 0.0,
            // The sum over all is what the core asks for first.
            Bug::CapForgottenInTheSum if asked > 0 => held.confidence.min(2.0),
            _ => held.confidence,
        }
    }

    fn domain(&self, input: u32) -> usize {
        input as usize
    }

    fn sample(&self, input: u32) -> (f64, Sample) {
        self.case.sample(input)
    }

    fn target_here(&self, here: &usize, sample: &Sample) -> (f64, f64) {
        self.case.target_here(here, sample)
    }

    fn target(&self, there: &usize, sample: &Sample) -> f64 {
        let target: f64 = self.case.target(there, sample);
        // As if the lights had changed, and one side of the comparison had not noticed.
        let changed = self.bug == Bug::OtherLightsForTheNeighbors && sample.owner != 0;
        if changed { target * [0.5, 1.0, 2.0, 1.0][sample.light] } else { target }
    }

    fn is_hidden_here(&self, input: u32) -> bool {
        Inputs::<f64>::is_hidden_here(&self.case, input)
    }

    fn is_hidden_there(&self, input: u32) -> bool {
        self.bug != Bug::HiddenSamplesCountElsewhere && Inputs::<f64>::is_hidden_there(&self.case, input)
    }

    fn partner(&self) -> u32 {
        self.case.partner
    }
}

fn laws(probe: Probe) -> Vec<Law> {
    vec![fresh(0, 1.0, probe), fresh(1, 5.0, probe), fresh(2, 5.0, probe)]
}

/// Error of the check that an honest merge passes.
fn error(bug: Bug, rule: &Rule) -> f64 {
    let (domains, laws) = (domains(), laws(rule.probe));
    let means = Means::of(|walk| {
        let held: Vec<Held> = laws.iter().map(|law| draw(walk, law)).collect();
        let case = Case { domains: &domains, held: &held, probe: rule.probe, partner: draw_partner(walk, &held, rule) };
        run(walk, &Planted { case, bug, asked: Default::default() }, &domains[0], rule)
    });
    means.error(&domains[0], rule, ALL)
}

/// The rule that all mistakes but those of visibility are planted in, and its like.
fn rules(probe: Probe) -> Vec<Rule> {
    let pairwise = [form::PAIRWISE_DEFENSIVE, form::PAIRWISE];
    let partners = [false, true].map(|partner| pairwise.map(|form| Rule { form, partner, probe }));
    let mut rules = partners.as_flattened().to_vec();
    if probe == Probe::None {
        rules.push(Rule { form: form::BALANCE, partner: false, probe });
    }
    rules
}

fn assert_caught(bug: Bug, probe: Probe) {
    for rule in rules(probe) {
        let (honest, planted) = (error(Bug::None, &rule), error(bug, &rule));
        assert!(honest < ROUNDING, "{rule:?}: {honest}");
        assert!(planted > 1e-2, "{bug:?} went unnoticed with {rule:?}: {planted}");
    }
}

/// Error after two rounds of reuse within a frame, the second with the mistake. In the first, two pixels have each
/// other for neighbours, and a third one has none: what a round has left is what the next one weighs.
fn error_of_a_second_round(bug: Bug, rule: &Rule) -> f64 {
    let (domains, laws) = (domains(), laws(rule.probe));
    let (here, there) = ([domains[0], domains[1]], [domains[1], domains[0]]);
    let means = Means::of(|walk| {
        let first = [0, 1, 2].map(|i| draw(walk, &laws[i]));
        let own = merge_held(walk, &here, &first[..2], rule).held;
        let held = [own, merge_held(walk, &there, &[first[1], first[0]], rule).held, first[2]];
        let case = Case { domains: &domains, held: &held, probe: rule.probe, partner: draw_partner(walk, &held, rule) };
        run(walk, &Planted { case, bug, asked: Default::default() }, &domains[0], rule)
    });
    means.error(&domains[0], rule, ALL)
}

#[test]
fn mistakes_in_a_second_round_within_a_frame_are_caught() {
    for (bug, probes) in [
        // With rays to all samples, what a pixel has while a neighbour of this world has nothing is what that neighbour
        // cannot have: its confidence makes no difference.
        (Bug::NullsLoseConfidence, &[Probe::None, Probe::One] as &[Probe]),
        (Bug::HiddenSamplesCountElsewhere, &[Probe::One, Probe::All]),
        (Bug::WeakSamplesAreRejected, &[Probe::None, Probe::One, Probe::All]),
        (Bug::OtherLightsForTheNeighbors, &[Probe::None]),
    ] {
        for rule in probes.iter().flat_map(|&probe| rules(probe)) {
            // Balance weights with altered targets are those of another world, and as good.
            if bug == Bug::OtherLightsForTheNeighbors && rule.form == form::BALANCE {
                continue;
            }
            let (honest, planted) = (error_of_a_second_round(Bug::None, &rule), error_of_a_second_round(bug, &rule));
            assert!(honest < ROUNDING, "{rule:?}: {honest}");
            assert!(planted > 1e-4, "{bug:?} went unnoticed with {rule:?}: {planted}");
        }
    }
    let one_over_m = Rule { form: form::ONE_OVER_M, partner: false, probe: Probe::None };
    assert!(error_of_a_second_round(Bug::None, &one_over_m) > 0.1);
}

#[test]
fn null_reservoirs_that_lose_their_confidence_are_caught() {
    assert_caught(Bug::NullsLoseConfidence, Probe::None);
}

#[test]
fn mis_weights_that_do_not_know_what_visibility_took_are_caught() {
    assert_caught(Bug::HiddenSamplesCountElsewhere, Probe::One);
    assert_caught(Bug::HiddenSamplesCountElsewhere, Probe::All);
}

#[test]
fn neighbours_rejected_for_what_they_hold_are_caught() {
    assert_caught(Bug::WeakSamplesAreRejected, Probe::None);
}

#[test]
fn a_cap_that_the_sum_of_confidences_forgets_is_caught() {
    for rule in rules(Probe::None).into_iter().filter(|r| r.form != form::BALANCE) {
        assert!(error(Bug::CapForgottenInTheSum, &rule) > 1e-2, "{rule:?}");
    }
}

#[test]
fn targets_of_other_lights_on_one_side_of_the_comparison_are_caught() {
    for rule in rules(Probe::None).into_iter().filter(|r| r.form != form::BALANCE) {
        assert!(error(Bug::OtherLightsForTheNeighbors, &rule) > 1e-2, "{rule:?}");
    }
}

#[test]
fn one_over_m_is_caught() {
    let rule = Rule { form: form::ONE_OVER_M, partner: false, probe: Probe::None };
    assert!(error(Bug::None, &rule) > 0.1);
}

/// Refuses what the canonical input offers.
struct WithoutCanonical<'a>(Keeper<f64, Enumerating<'a>>);

impl Sink<f64, Sample, f64> for WithoutCanonical<'_> {
    fn offer(&mut self, sample: &Sample, light: f64, target: f64, scaled_ucw: f64) -> bool {
        sample.owner != 0 && self.0.offer(sample, light, target, scaled_ucw)
    }
}

fn merge_without_canonical(walk: &Walk, domains: &[Domain], held: &[Held], rule: &Rule) -> Outcome {
    let case = Case { domains, held, probe: rule.probe, partner: draw_partner(walk, held, rule) };
    let mut sink = WithoutCanonical(Keeper::new(Enumerating::new(walk)));
    let merged: Merged<f64> = merge(&case, rule.form, &mut sink);
    Outcome { held: sink.0.held(&merged), sums: sink.0.sums }
}

#[test]
fn a_missing_canonical_term_is_caught() {
    let (domains, laws) = (domains(), laws(Probe::None));
    for rule in rules(Probe::None) {
        let means = Means::of(|walk| {
            let held: Vec<Held> = laws.iter().map(|law| draw(walk, law)).collect();
            merge_without_canonical(walk, &domains, &held, &rule)
        });
        assert!(means.error(&domains[0], &rule, ALL) > 0.1, "{rule:?}: {means:?}");
    }
}
