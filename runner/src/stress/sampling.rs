//! Sampling and reservoirs.

use glam::UVec2;
use weir_shared::{
    fault, light,
    merge::{form, merge},
    resample::{Chooser, choice},
    reservoir::{MAX_CONFIDENCE, Reservoir},
    reuse::{self, rule},
    rng::Rng,
    scene::Scene as SceneView,
    surface::Surface,
};

use super::{
    Case, Check, Finding, Found,
    clip::{Clip, Take},
    scenes, streams,
    worlds::{
        ROUNDING,
        random::{UNBIASED, rules},
        walk::enumerate,
        world::{self, Domain, Held, Keeper, LIGHTS, Law, Means, Probe, Rule, merged_means},
    },
};
use crate::{render::Backend, settings::Settings, technique::Technique};

pub(super) const CASES: &[Case] = &[
    Case {
        number: 1,
        name: "all weights zero",
        expected: "no sample, W 0, confidence 1, no fault",
        checks: &[Check::Host(streams::all_zero)],
    },
    Case {
        number: 2,
        name: "one positive weight among 32",
        expected: "always kept, W within 2 ulp",
        checks: &[Check::Host(streams::one_positive)],
    },
    Case {
        number: 3,
        name: "an infinite weight",
        expected: "dropped, counted, the others' sum stays",
        checks: &[Check::Host(streams::infinite)],
    },
    Case {
        number: 4,
        name: "a weight that is not a number",
        expected: "dropped, counted, the others' sum stays",
        checks: &[Check::Host(streams::not_a_number)],
    },
    Case {
        number: 5,
        name: "random numbers 0 and 1 - 2^-24",
        expected: "a positive weight is kept",
        checks: &[Check::Host(streams::extreme_random_numbers)],
    },
    Case {
        number: 6,
        name: "weights sixty decades apart, in either order",
        expected: "the large one is kept, the sum is its weight",
        checks: &[Check::Host(streams::sixty_decades)],
    },
    Case {
        number: 7,
        name: "denormal weights alone",
        expected: "kept with a finite W or all taken for zero; a usable picture",
        checks: &[Check::Host(streams::denormals), Check::Frames(denormal_light)],
    },
    Case {
        number: 8,
        name: "W beyond the largest float",
        expected: "finite up to there, beyond it no sample and a fault",
        checks: &[Check::Host(streams::overflowing_weight)],
    },
    Case {
        number: 9,
        name: "a merge of nothing but confidence 0",
        expected: "no sample, confidence 0, all numbers finite",
        checks: &[Check::Host(no_confidence)],
    },
    Case {
        number: 10,
        name: "all neighbours without a sample",
        expected: "W scaled by less than 1, the mean right to 1e-12",
        checks: &[Check::Host(null_neighbors)],
    },
    Case {
        number: 11,
        name: "targets of zero in both domains",
        expected: "weight 0, all numbers finite",
        checks: &[Check::Host(zero_targets)],
    },
    Case {
        number: 12,
        name: "a neighbour that is the pixel itself",
        expected: "never chosen; a copy of the domain leaves the mean right to 1e-12",
        checks: &[Check::Host(copied_domain), Check::Frames(own_neighbor)],
    },
    Case {
        number: 13,
        name: "confidence over a million merges",
        expected: "at most 1 + cap (1 + neighbours), and the largest that is stored",
        checks: &[Check::Host(stored_confidence), Check::Frames(capped_confidence)],
    },
    Case {
        number: 14,
        name: "the order of a stream",
        expected: "the same law in all 24 orders of 4 weights",
        checks: &[Check::Host(streams::orders)],
    },
    Case {
        number: 15,
        name: "one candidate, no neighbours",
        expected: "the bits of the plain estimator: W 1 / p to 2 ulp, and no rounds change nothing",
        checks: &[Check::Frames(one_candidate)],
    },
    Case {
        number: 16,
        name: "4096 equal weights",
        expected: "kept uniformly",
        checks: &[Check::Host(streams::many_equal)],
    },
    Case {
        number: 17,
        name: "keys of weights forty decades apart, random number 0 among them",
        expected: "the heavy ones, keys finite",
        checks: &[Check::Host(streams::keys)],
    },
    Case {
        number: 18,
        name: "one reservoir twice among the inputs",
        expected: "more variance, the mean right to 1e-12",
        checks: &[Check::Host(copied_reservoir)],
    },
];

fn denormal_light(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for scale in [1e-36, 1e-39, 1e-42] {
        let mut scene = scenes::cornell();
        scene.materials.iter_mut().for_each(|m| m.emission *= scale);
        for technique in [Technique::Still, Technique::RealTime] {
            let still = Clip::new(backend, &Take::still(&scene, technique, &[]))?.stills(4)?;
            let most = still.channels().fold(0.0, f32::max);
            findings.push(still.finding(most < 100.0 * scale, format!("{scale:e} {technique}")));
        }
    }
    Ok(Finding::all(findings))
}

/// Merges by the chooser that passes use; what is kept, and whether all numbers on the way are finite.
fn merged(domains: &[Domain], held: &[Held], form: u32) -> (Held, bool) {
    let inputs = world::Case { domains, held, probe: Probe::None, partner: 0 };
    let mut keeper = Keeper::<f32, _>::new(Chooser::new(Rng::from_words(1, 2, 3, 4), choice::THRESHOLD));
    let merged = merge(&inputs, form, &mut keeper);
    let kept = keeper.held(&merged);
    let finite = keeper.sums.iter().chain([&keeper.scaled_ucw]).all(|x| x.is_finite()) && kept.ucw.is_finite();
    (kept, finite && keeper.stream.fault() == fault::NONE)
}

fn domain(target: [f64; LIGHTS]) -> Domain {
    Domain { target, visible: [true; LIGHTS] }
}

const FORMS: [u32; 6] = [UNBIASED[0], UNBIASED[1], UNBIASED[2], UNBIASED[3], UNBIASED[4], form::ONE_OVER_M];

fn no_confidence() -> Finding {
    let held = [Held { light: 0, ucw: 1.0, confidence: 0.0 }; 3];
    let ends = FORMS.map(|form| merged(&[domain([1.0; LIGHTS]); 3], &held, form));
    let holds = ends.iter().all(|(kept, finite)| *finite && kept.ucw == 0.0 && kept.confidence == 0.0);
    Finding::new(holds, format!("{} forms: W = {}, c = {}", ends.len(), ends[0].0.ucw, ends[0].0.confidence))
}

fn null_neighbors() -> Finding {
    let domains = [domain([1.0, 2.0, 0.0, 0.5]), domain([0.5, 1.0, 3.0, 1.0]), domain([2.0, 0.0, 1.0, 1.0])];
    // Right laws that have nothing to show in 19 of 20 cases.
    let law = |domain: &Domain, nothing: f64| -> Law {
        let able = domain.target.iter().filter(|t| **t > 0.0).count() as f64;
        let chance = (1.0 - nothing) / able;
        let lights = (0..LIGHTS).filter(|&light| domain.target[light] > 0.0);
        let held = lights.map(|light| (chance, Held { light, ucw: 1.0 / chance, confidence: 4.0 }));
        let null = Held { light: 0, ucw: 0.0, confidence: 4.0 };
        held.chain((nothing > 0.0).then_some((nothing, null))).collect()
    };
    let laws = [law(&domains[0], 0.0), law(&domains[1], 0.95), law(&domains[2], 0.95)];
    let error_of = |rule: Rule| merged_means(&domains, &laws, &rule).error(&domains[0], &rule, [true; LIGHTS]);
    let error = rules().into_iter().map(error_of).fold(0.0, f64::max);
    let null = Held { light: 0, ucw: 0.0, confidence: 4.0 };
    let own = Held { light: 0, ucw: 4.0, confidence: 4.0 };
    let (kept, finite) = merged(&domains, &[own, null, null], form::PAIRWISE_DEFENSIVE);
    let scale = kept.ucw / own.ucw;
    let holds = error < ROUNDING && finite && scale > 0.0 && scale < 1.0;
    Finding::new(
        holds,
        format!("W times {scale:.3} where all are null; worst mean of {} rules off by {error:.1e}", rules().len()),
    )
}

fn zero_targets() -> Finding {
    let domains = [domain([0.0, 1.0, 0.0, 0.0]), domain([0.0, 1.0, 1.0, 0.0])];
    let own = Held { light: 1, ucw: 2.0, confidence: 1.0 };
    let other = Held { light: 0, ucw: 5.0, confidence: 3.0 };
    let ends = FORMS.map(|form| merged(&domains, &[own, other], form));
    let holds = ends.iter().all(|(kept, finite)| *finite && (kept.light == 1 || kept.ucw == 0.0));
    let finite = ends.iter().filter(|(_, finite)| *finite).count();
    Finding::new(holds, format!("{finite} of {} forms finite, light {} kept", ends.len(), ends[0].0.light))
}

/// Expectation of the merge of `held(walk)` in the given domains: worst relative error of W and of the sums, and the
/// variance of the light that the sum over the inputs has.
fn law_of_merge(domains: &[Domain], rule: &Rule, held: impl Fn(&super::worlds::walk::Walk) -> Vec<Held>) -> (f64, f64) {
    let means = Means::of(|walk| world::merge_held(walk, domains, &held(walk), rule));
    let error = means.error(&domains[0], rule, [true; LIGHTS]);
    let (mut mean, mut square) = (0.0, 0.0);
    enumerate(|walk| {
        let light: f64 = world::merge_held(walk, domains, &held(walk), rule).sums.iter().sum();
        mean += walk.chance() * light;
        square += walk.chance() * light * light;
    });
    (error, square - mean * mean)
}

/// A law that is right, with other chances than the targets.
fn some_law(domain: &Domain) -> Law {
    let able: Vec<usize> = (0..LIGHTS).filter(|&light| domain.target[light] > 0.0).collect();
    let total: f64 = able.iter().map(|light| 1.0 + *light as f64).sum();
    let chance = |light: usize| (1.0 + light as f64) / total;
    able.iter().map(|&light| (chance(light), Held { light, ucw: 1.0 / chance(light), confidence: 2.0 })).collect()
}

fn copied_domain() -> Finding {
    let here = domain([1.0, 2.0, 0.5, 0.0]);
    let laws = some_law(&here);
    let held = |walk: &super::worlds::walk::Walk| vec![world::draw(walk, &laws), world::draw(walk, &laws)];
    let errors = rules().iter().map(|rule| law_of_merge(&[here; 2], rule, held).0).fold(0.0, f64::max);
    Finding::new(errors < ROUNDING, format!("worst mean of {} rules off by {errors:.1e}", rules().len()))
}

fn copied_reservoir() -> Finding {
    let (here, there) = (domain([1.0, 2.0, 0.5, 0.0]), domain([0.5, 1.0, 3.0, 1.0]));
    let (own, other) = (some_law(&here), some_law(&there));
    let (mut worst, mut grows) = (0.0f64, true);
    for rule in rules() {
        let copied = |walk: &super::worlds::walk::Walk| {
            let (own, other) = (world::draw(walk, &own), world::draw(walk, &other));
            vec![own, other, other]
        };
        let apart = |walk: &super::worlds::walk::Walk| {
            vec![world::draw(walk, &own), world::draw(walk, &other), world::draw(walk, &other)]
        };
        let (error, variance) = law_of_merge(&[here, there, there], &rule, copied);
        let (error_apart, variance_apart) = law_of_merge(&[here, there, there], &rule, apart);
        worst = worst.max(error).max(error_apart);
        // What is weighed after the choice has no sum to speak of.
        grows &= world::is_weighed_after(rule.form) || variance > variance_apart;
    }
    let text = format!("worst mean of {} rules off by {worst:.1e}, variance grows: {grows}", rules().len());
    Finding::new(worst < ROUNDING && grows, text)
}

fn own_neighbor(backend: &Backend<'_>) -> Found {
    let scene = scenes::cornell();
    let take = Take { size: [24, 24], outputs: &["surfaces"], ..Take::still(&scene, Technique::RealTime, &[]) };
    let mut clip = Clip::new(backend, &take)?;
    clip.show(0, |_| ())?;
    let surfaces: Vec<Surface> = clip.output("surfaces")?;
    let (mut own, mut found) = (0, 0);
    for rule in [rule::DISK, rule::COMPATIBLE, rule::PAIRED] {
        for index in 0..16 {
            let mut frame = clip.frames(0).now;
            (frame.neighbor_rule, frame.index, frame.spatial_neighbors, frame.radius_px) = (rule, index, 12, 3.0);
            for px in (0..24 * 24).map(|i| UVec2::new(i % 24, i / 24)) {
                let surface = &surfaces[frame.index_of(px) as usize];
                let neighbors = reuse::find_present(px, 0, &frame, surface, &surfaces, 2);
                let all: Vec<UVec2> = (0..neighbors.count).map(|i| neighbors.get(i)).collect();
                own += all.iter().filter(|n| **n == px).count();
                found += all.len();
            }
        }
    }
    Ok(Finding::new(own == 0 && found > 10_000, format!("{own} of {found} neighbours are the pixel itself")))
}

fn stored_confidence() -> Finding {
    let cap = Settings::default().confidence_cap;
    let (mut capped, mut uncapped) = (0u32, 0u32);
    for _ in 0..1_000_000 {
        // A fresh sample and the past, which is trusted up to the cap.
        capped = Reservoir::new(0, 0, 1.0, 1 + capped.min(cap)).confidence();
        uncapped = Reservoir::new(0, 0, 1.0, uncapped + 1).confidence();
    }
    let text = format!("{capped} with the cap {cap}, {uncapped} without");
    Finding::new(capped == cap + 1 && uncapped == MAX_CONFIDENCE, text)
}

fn capped_confidence(backend: &Backend<'_>) -> Found {
    let scene = scenes::cornell();
    let mut findings = Vec::new();
    for knobs in [&[] as &[&str], &["temporal.cap=1000", "temporal.neighbors=6", "temporal.neighbors_unseen=12"]] {
        let take = Take { size: [8, 6], outputs: &["reservoirs"], ..Take::still(&scene, Technique::RealTime, knobs) };
        let mut clip = Clip::new(backend, &take)?;
        let frame = clip.frames(0).now;
        let neighbors = (1 + frame.temporal_neighbors).max(frame.temporal_neighbors_unseen);
        let bound = (1 + frame.confidence_cap * neighbors).min(MAX_CONFIDENCE);
        let mut most = 0;
        for i in 0..300 {
            clip.show(0, |frames| (frames.now.index, frames.now.has_history) = (i, u32::from(i > 0)))?;
            if i % 20 == 19 {
                let reservoirs: Vec<Reservoir> = clip.output("reservoirs")?;
                most = reservoirs.iter().map(Reservoir::confidence).fold(most, u32::max);
            }
        }
        findings.push(Finding::new(
            most <= bound && most > frame.confidence_cap.min(299),
            format!("{most} of at most {bound}"),
        ));
    }
    Ok(Finding::all(findings))
}

fn one_candidate(backend: &Backend<'_>) -> Found {
    let scene = scenes::lamps_over_floor();
    let knobs = ["candidates.count=1", "candidates.tree=0", "candidates.bsdf=0", "still.rounds=0"];
    let take = Take { outputs: &["fresh", "color"], ..Take::still(&scene, Technique::Candidates, &knobs) };
    let mut plain = Clip::new(backend, &take)?;
    let mut still = Clip::new(backend, &Take { technique: Technique::Still, ..take })?;
    plain.show(0, |_| ())?;
    still.show(0, |_| ())?;
    let colors: [Vec<[f32; 4]>; 2] = [plain.output("color")?, still.output("color")?];
    let reservoirs: Vec<Reservoir> = plain.output("fresh")?;
    let (packed, frame) = (plain.packed(), plain.frames(0).now);
    let view = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    let held: Vec<&Reservoir> = reservoirs.iter().filter(|r| r.has_sample()).collect();
    let of = |r: &Reservoir| light::pmf(&frame, &view, &packed.lights, light::address_of(&frame, &view, r.light));
    let worst = held.iter().map(|r| streams::ulps(r.ucw, 1.0 / of(r))).max().unwrap_or(u32::MAX);
    let differ = colors[0].iter().zip(&colors[1]).filter(|(a, b)| a != b).count();
    let text = format!("{} samples, W within {worst} ulp of 1 / p, {differ} pixels differ", held.len());
    Ok(Finding::new(worst <= 2 && differ == 0 && held.len() > 20, text))
}
