//! Unbiased forms are, in worlds small enough to see through; the biased one is by as much as it should.

use weir::stress::worlds::random::rules;
use weir_shared::merge::{form, merge};

use crate::{
    ROUNDING,
    walk::{Enumerating, enumerate},
    world::{
        Case, Domain, Held, Keeper, LIGHTS, Law, Means, Probe, Rule, Technique, draw, initial, initial_in_groups,
        law_of, light_of, merge_held, merged_means,
    },
};

pub const ALL: [bool; LIGHTS] = [true; LIGHTS];
/// Supports that overlap in part; each light is hidden from some domain.
pub fn domains() -> [Domain; 3] {
    [
        Domain { target: [0.7, 2.0, 0.0, 0.3], visible: [true, true, true, false] },
        Domain { target: [1.5, 0.0, 4.0, 0.1], visible: [true, true, false, true] },
        Domain { target: [0.0, 0.05, 0.6, 9.0], visible: [false, false, true, true] },
    ]
}

/// One or two candidates from one or two techniques. A draw can meet a target of zero in all of them.
pub fn techniques(domain: usize) -> Vec<Technique> {
    let some = Technique { count: 1, pmf: [0.1, 0.2, 0.3, 0.4] };
    let others = Technique { count: 1, pmf: [0.5, 0.5, 0.0, 0.0] };
    match domain {
        0 => vec![Technique { count: 2, ..some }],
        1 => vec![some, others],
        _ => vec![Technique { pmf: [0.6, 0.1, 0.2, 0.1], ..some }],
    }
}

/// The law of a domain's candidates.
pub fn fresh(domain: usize, confidence: f64, probe: Probe) -> Law {
    law_of(|walk| initial(walk, &domains()[domain], &techniques(domain), confidence, probe))
}

fn assert_unbiased(means: &Means, here: &Domain, rule: &Rule, found: [bool; LIGHTS], what: &str) {
    let error = means.error(here, rule, found);
    assert!(error < ROUNDING, "{rule:?}, {what}: error {error}, {means:?}");
}

#[test]
fn candidates_have_the_reciprocal_of_their_density_for_weight() {
    for (domain, here) in domains().iter().enumerate() {
        for probe in [Probe::None, Probe::One] {
            let mut ucw = [0.0; LIGHTS];
            let law = fresh(domain, 1.0, probe);
            assert!(law.iter().any(|(chance, held)| *chance > 0.0 && held.ucw == 0.0), "a chance to find nothing");
            for (chance, held) in law {
                ucw[held.light] += chance * held.ucw;
            }
            for light in 0..LIGHTS {
                let exists = here.target[light] > 0.0 && (probe == Probe::None || here.visible[light]);
                assert!((ucw[light] - f64::from(u8::from(exists))).abs() < ROUNDING, "domain {domain}: {ucw:?}");
            }
        }
    }
}

/// Two stages are unbiased if the cheap target is positive where the full one is, whatever the sizes of the groups.
#[test]
fn survivors_of_groups_have_the_reciprocal_of_their_density_for_weight() {
    let first = Technique { count: 3, pmf: [0.1, 0.2, 0.3, 0.4] };
    let second = Technique { count: 1, pmf: [0.25, 0.0, 0.25, 0.5] };
    let cheap = [3.0, 0.5, 2.0, 1.0];
    let mean_ucw = |domain: &Domain, cheap: &[f64; LIGHTS], techniques: &[Technique], groups: &[u32]| {
        let mut ucw = [0.0; LIGHTS];
        for (chance, held) in law_of(|walk| initial_in_groups(walk, domain, cheap, techniques, groups, Probe::None)) {
            ucw[held.light] += chance * held.ucw;
        }
        ucw
    };
    for here in domains() {
        for techniques in [&[first] as &[Technique], &[first, second]] {
            for groups in [&[3u32] as &[u32], &[1, 2], &[2, 1], &[1, 1, 1]] {
                let ucw = mean_ucw(&here, &cheap, techniques, groups);
                for (light, ucw) in ucw.into_iter().enumerate() {
                    let expected = f64::from(u8::from(here.target[light] > 0.0));
                    assert!((ucw - expected).abs() < ROUNDING, "{groups:?}, light {light}: {ucw}");
                }
            }
        }
    }
    // And the test sees a cheap target that misses a light.
    let [_, missed, ..] = mean_ucw(&domains()[0], &[3.0, 0.0, 2.0, 1.0], &[first], &[1, 2]);
    assert_eq!(missed, 0.0);
}

#[test]
fn a_merge_is_unbiased_whatever_the_confidences() {
    let (domains, cs) = (domains(), [0.0, 1.0, 5.0, 20.0]);
    for rule in rules() {
        for own in [1.0, 5.0, 20.0] {
            for (a, b) in cs.iter().flat_map(|&a| cs.map(|b| (a, b))) {
                let laws = [fresh(0, own, rule.probe), fresh(1, a, rule.probe), fresh(2, b, rule.probe)];
                let means = merged_means(&domains, &laws, &rule);
                assert_unbiased(&means, &domains[0], &rule, ALL, &format!("confidences {own}, {a}, {b}"));
            }
        }
    }
}

/// The canonical input may have no trial at all in those forms that do not single it out.
#[test]
fn without_a_canonical_trial_others_find_what_they_can() {
    let domains = domains();
    for form in [form::BALANCE, form::CONTRIBUTION, form::ONE_OVER_Z] {
        let rule = Rule { form, partner: false, probe: Probe::None };
        let laws = [fresh(0, 0.0, rule.probe), fresh(1, 5.0, rule.probe), fresh(2, 0.0, rule.probe)];
        let found = [true, false, true, true];
        assert_unbiased(&merged_means(&domains, &laws, &rule), &domains[0], &rule, found, "one neighbour");
    }
}

#[test]
fn reservoirs_that_can_only_be_empty_do_no_harm() {
    let mut domains = domains();
    domains[1].target = [0.0; LIGHTS];
    domains[2].visible = [false; LIGHTS];
    for rule in rules() {
        let null: Law = vec![(1.0, Held { light: 0, ucw: 0.0, confidence: 20.0 })];
        let blind = if rule.probe == Probe::None { fresh(2, 5.0, Probe::None) } else { null.clone() };
        let laws = [fresh(0, 1.0, rule.probe), null, blind];
        assert_unbiased(&merged_means(&domains, &laws, &rule), &domains[0], &rule, ALL, "null neighbours");
    }
}

#[test]
fn confidences_add_up_with_or_without_samples() {
    let domains = domains();
    for rule in rules() {
        let laws = [fresh(0, 1.0, rule.probe), fresh(1, 20.0, rule.probe), fresh(2, 5.0, rule.probe)];
        enumerate(|walk| {
            let held: Vec<Held> = laws.iter().map(|law| draw(walk, law)).collect();
            assert_eq!(merge_held(walk, &domains, &held, &rule).held.confidence, 26.0);
        });
    }
}

/// Temporal reuse with a cap, then spatial reuse of pixels that did the same.
#[test]
fn temporal_reuse_followed_by_spatial_reuse_is_unbiased() {
    let now = domains();
    let before = [
        Domain { target: [0.0, 1.0, 2.0, 0.2], visible: [true, true, true, false] },
        Domain { target: [3.0, 0.0, 1.0, 0.0], visible: [true, false, true, true] },
        now[2],
    ];
    let pmf = [0.2, 0.3, 0.4, 0.1];
    for rule in rules() {
        for cap in [1.0, 5.0, 20.0] {
            let laws: Vec<Law> = (0..3)
                .map(|i| {
                    let own = fresh(i, 1.0, rule.probe);
                    law_of(|walk| {
                        let mut past = initial(walk, &before[i], &[Technique { count: 1, pmf }], 50.0, rule.probe);
                        past.confidence = past.confidence.min(cap * own[0].1.confidence);
                        merge_held(walk, &[now[i], before[i]], &[draw(walk, &own), past], &rule).held
                    })
                })
                .collect();
            assert!(laws.iter().flatten().all(|(_, held)| held.confidence == 1.0 + cap));
            let means = merged_means(&now, &laws, &rule);
            assert_unbiased(&means, &now[0], &rule, ALL, &format!("cap {cap}"));
        }
    }
}

/// Two pixels lend each other their samples, and the next frame reuses both: its inputs may hold the same sample.
#[test]
fn inputs_with_a_common_origin_are_as_good_as_independent_ones() {
    let domains = [
        Domain { target: [0.7, 2.0, 0.0, 0.0], visible: [true, true, true, true] },
        Domain { target: [1.5, 0.1, 4.0, 0.0], visible: [true, false, true, true] },
    ];
    let swapped = [domains[1], domains[0]];
    let pmf = [[0.3, 0.5, 0.2, 0.0], [0.2, 0.3, 0.5, 0.0]];
    for rule in rules() {
        let means = Means::of(|walk| {
            let start = |i: usize, confidence: f64| {
                initial(walk, &domains[i], &[Technique { count: 1, pmf: pmf[i] }], confidence, rule.probe)
            };
            let first = [start(0, 1.0), start(1, 2.0)];
            let past = [
                merge_held(walk, &domains, &first, &rule).held,
                merge_held(walk, &swapped, &[first[1], first[0]], &rule).held,
            ];
            let all = [domains[0], domains[0], domains[1]];
            merge_held(walk, &all, &[start(0, 1.0), past[0], past[1]], &rule)
        });
        assert_unbiased(&means, &domains[0], &rule, ALL, "second frame");
    }
}

/// As seen by a sink, when all inputs that can have a light hold it.
#[test]
fn mis_weights_are_a_partition_of_unity() {
    let domains = domains();
    let confidences = [[1.0, 1.0, 1.0], [1.0, 20.0, 5.0], [20.0, 1.0, 0.0], [3.0, 0.0, 0.0]];
    for rule in rules().into_iter().filter(|r| ![form::CONTRIBUTION, form::ONE_OVER_Z].contains(&r.form)) {
        for (light, c) in (0..LIGHTS).flat_map(|light| confidences.map(|c| (light, c))) {
            let can_have =
                |i: usize| domains[i].target[light] > 0.0 && (rule.probe == Probe::None || domains[i].visible[light]);
            if !can_have(0) {
                continue;
            }
            let held: Vec<Held> =
                (0..3).map(|i| Held { light, ucw: f64::from(u8::from(can_have(i))), confidence: c[i] }).collect();
            let mut total = 0.0f64;
            enumerate(|walk| {
                let partner = crate::world::draw_partner(walk, &held, &rule);
                let mut keeper = Keeper::<f64, _>::new(Enumerating::new(walk));
                merge(&Case { domains: &domains, held: &held, probe: rule.probe, partner }, rule.form, &mut keeper);
                total += walk.chance() * keeper.scaled_ucw;
            });
            assert!((total - 1.0).abs() < 2e-15, "{rule:?}, light {light}, confidences {c:?}: {total}");
        }
    }
}

/// Two inputs, each sure to have a sample: one light that both can have, one that only the canonical one can.
#[test]
fn one_over_m_is_too_dark_by_the_share_of_those_that_could_not_have_the_sample() {
    let domains =
        [Domain { target: [1.0, 1.0, 0.0, 0.0], visible: ALL }, Domain { target: [1.0, 0.0, 0.0, 0.0], visible: ALL }];
    let held = |light: usize, ucw: f64, confidence: f64| Held { light, ucw, confidence };
    let laws = [vec![(0.5, held(0, 2.0, 1.0)), (0.5, held(1, 2.0, 1.0))], vec![(1.0, held(0, 1.0, 3.0))]];
    let rule = Rule { form: form::ONE_OVER_M, partner: false, probe: Probe::None };
    let means = merged_means(&domains, &laws, &rule);
    // Light 0: (1 + 3) / 4. Light 1: 1 / 4, because the other three trials could not have found it.
    for (mean, expected) in means.ucw.into_iter().zip([1.0, 0.25, 0.0, 0.0]) {
        assert!((mean - expected).abs() < ROUNDING, "{means:?}");
    }
    assert!((means.sum[1] / light_of(&domains[0], 1) - 0.25).abs() < ROUNDING, "{means:?}");
}

/// The factor that such a form has after the choice is that of one sample, but multiplies the light of all: for the
/// light that the target measures that makes no difference on average, for the sources one by one it does.
#[test]
fn the_sum_over_inputs_of_a_form_that_weighs_after_the_choice_is_right_for_the_target_only() {
    let domains = domains();
    let laws: Vec<Law> = (0..3).map(|i| fresh(i, [1.0, 5.0, 2.0][i], Probe::None)).collect();
    for form in [form::CONTRIBUTION, form::ONE_OVER_Z] {
        let rule = Rule { form, partner: false, probe: Probe::None };
        let means = merged_means(&domains, &laws, &rule);
        let relative = |light: usize| means.sum[light] / light_of(&domains[0], light);
        let seen = || (0..LIGHTS).filter(|&light| domains[0].target[light] > 0.0);
        let by_target: f64 = seen().map(|light| relative(light) * domains[0].target[light]).sum();
        let expected: f64 = domains[0].target.iter().sum();
        assert!((by_target / expected - 1.0).abs() < ROUNDING, "form {form}: {means:?}");
        let worst = seen().map(|light| (relative(light) - 1.0).abs()).fold(0.0, f64::max);
        assert!(worst > 0.1, "form {form}: {means:?}");
    }
}

/// Pairwise forms lean on the canonical input: without a trial of its own, no one makes up for what some cannot have.
#[test]
fn pairwise_forms_need_a_canonical_trial() {
    let domains = domains();
    let rule = Rule { form: form::PAIRWISE_DEFENSIVE, partner: false, probe: Probe::None };
    let laws = [fresh(0, 0.0, rule.probe), fresh(1, 5.0, rule.probe), fresh(2, 5.0, rule.probe)];
    let means = merged_means(&domains, &laws, &rule);
    assert!((means.ucw[0] - 0.5).abs() < ROUNDING && (means.ucw[3] - 1.0).abs() < ROUNDING, "{means:?}");
}
