//! Options do what their help says: without that, one that did nothing would pass every test of the mean.

use std::collections::BTreeMap;

use rayon::prelude::*;
use weir::{settings::KNOBS, technique::Technique};
use weir_shader::PASSES;
use weir_shared::reservoir::Reservoir;

use crate::{
    Bench, CHAIN_VARIANTS, TIERS,
    chains::Clip,
    scenarios::{self, Scenario},
    stills,
};

/// [`noise_of`] light alone: camera rays go through the centers of pixels.
fn noise(scenario: &Scenario, technique: Technique, knobs: &[&str]) -> f64 {
    noise_of(scenario, technique, &[knobs, &["camera.jitter=off"]].concat())
}

/// Mean over pixels and channels of the variance of a still, over many of them.
pub fn noise_of(scenario: &Scenario, technique: Technique, knobs: &[&str]) -> f64 {
    const SEEDS: u32 = 4;
    const EACH: u32 = 64;
    let clip = Clip::new(scenario, PASSES, technique, knobs);
    let pixels = (scenario.size[0] * scenario.size[1]) as usize;
    let zero = || vec![[[0.0f64; 2]; 3]; pixels];
    let of_seed = |seed| {
        let mut sums = zero();
        clip.stills(seed, EACH, |color| {
            for (sum, color) in sums.iter_mut().zip(color) {
                for (sum, &value) in sum.iter_mut().zip(color) {
                    (sum[0], sum[1]) = (sum[0] + f64::from(value), sum[1] + f64::from(value).powi(2));
                }
            }
        });
        sums
    };
    let add = |mut a: Vec<[[f64; 2]; 3]>, b: Vec<[[f64; 2]; 3]>| {
        let (all, more) = (a.as_flattened_mut().as_flattened_mut(), b.as_flattened().as_flattened());
        all.iter_mut().zip(more).for_each(|(a, b)| *a += b);
        a
    };
    let sums = (0..SEEDS).into_par_iter().map(of_seed).reduce(zero, add);
    let n = f64::from(SEEDS * EACH);
    let variances = sums.as_flattened().iter().map(|[sum, squares]| (squares - sum * sum / n) / (n - 1.0));
    let noise = variances.sum::<f64>() / (3 * pixels) as f64;
    println!("{} | {technique} {} | variance {noise:.4e}", scenario.name, knobs.join(" "));
    noise
}

/// The bits of the last frame of a chain, or of a still.
fn picture(scenario: &Scenario, technique: Technique, knobs: &[&str]) -> Vec<[u32; 4]> {
    let mut picture = Vec::new();
    let clip = Clip::new(scenario, PASSES, technique, knobs);
    clip.chain(1, |shown| picture = shown.output::<[u32; 4]>("color").to_vec());
    picture
}

/// Reservoirs of one frame of candidates: fresh, and after a shadow ray.
fn candidates(scenario: &Scenario, seed: u32, knobs: &[&str]) -> [Vec<Reservoir>; 2] {
    let clip = Clip::showing(&["fresh", "visible"], scenario, PASSES, Technique::Candidates, knobs);
    let mut found = [Vec::new(), Vec::new()];
    clip.chain(seed, |shown| found = ["fresh", "visible"].map(|name| shown.output(name).to_vec()));
    found
}

/// Whether a knob is to draw the same whatever its value: rules that leave work out, which are compared bit by bit elsewhere,
/// what becomes of the light tree where nothing moves, and how a GPU traces rays.
fn is_idle(key: &str) -> bool {
    key.starts_with("skip.") || ["candidates.tree_update", "rays.traversal"].contains(&key)
}

/// Every value of every other named knob draws a picture of its own.
#[test]
fn no_named_knob_is_without_effect() {
    let (wall, low_wall) = (scenarios::half_shadowed(), scenarios::low_wall());
    let mut tried = 0;
    for knob in KNOBS.iter().filter(|k| k.values.contains(" or ") && k.values != "0 or 1" && !is_idle(k.key)) {
        let beside: &[&str] = match knob.key {
            // Or they would be drawn by power: the wall has fewer lights than a tile has records.
            "candidates.source" => &["skip.presampling=off"],
            "reuse.mis" => &["rays=speed"],
            "shade.sum" => &["rays=quality"],
            _ => &[],
        };
        let scenario = if knob.key == "target.occlusion" { &low_wall } else { &wall };
        // Another name for `speed`.
        let names = knob.values.split([',', ' ']).filter(|name| !["", "or", "after"].contains(name));
        let drawn: Vec<(&str, Vec<[u32; 4]>)> = names
            .map(|name| {
                (
                    name,
                    picture(
                        scenario,
                        Technique::RealTime,
                        &[beside, &[format!("{}={name}", knob.key).as_str()]].concat(),
                    ),
                )
            })
            .collect();
        for (i, (name, picture)) in drawn.iter().enumerate() {
            let same = drawn[..i].iter().find(|(_, other)| other == picture);
            assert!(same.is_none(), "{}: {name} and {} draw the same", knob.key, same.map_or("", |s| s.0));
            tried += 1;
        }
    }
    assert!(tried > 25, "{tried} values");
}

/// An ensemble of what is drawn under another name would prove nothing.
#[test]
fn no_two_variants_of_the_ensembles_draw_the_same() {
    let scenario = scenarios::half_shadowed();
    for (technique, variants, beside) in
        [(Technique::RealTime, CHAIN_VARIANTS, &[] as &[&str]), (Technique::Still, stills::VARIANTS, &[stills::ROUNDS])]
    {
        let mut drawn = BTreeMap::new();
        for &knobs in TIERS.each_ref().map(std::slice::from_ref).iter().chain(variants) {
            let name = knobs.join(" ");
            let same = drawn.insert(picture(&scenario, technique, &[knobs, beside].concat()), name.clone());
            assert_eq!(same, None, "{technique}: {name} draws the same");
        }
        // What has nothing to do is seen: no pixel is off the lattice.
        let idle = picture(&scenario, technique, &[&[TIERS[0], "candidates.off_lattice=3"], beside].concat());
        assert!(drawn.contains_key(&idle));
    }
}

#[test]
fn occlusion_on_the_screen_spares_samples_that_are_hidden_and_keeps_the_mean() {
    let bench = Bench::new(scenarios::low_wall());
    const SCREEN: [&str; 2] = ["target.occlusion=screen", "target.occlusion_reach=32"];
    let hidden = |knobs: &[&str]| {
        let (mut held, mut lost) = (0, 0);
        for seed in 0..16 {
            let [fresh, visible] = candidates(&bench.scenario, seed, knobs);
            for (_, after) in fresh.iter().zip(&visible).filter(|(before, _)| before.has_sample()) {
                held += 1;
                lost += u32::from(!after.has_sample());
            }
        }
        f64::from(lost) / f64::from(held)
    };
    let (plain, screen) = (hidden(&[]), hidden(&SCREEN));
    println!("hidden: {:.1} % without, {:.1} % with", 100.0 * plain, 100.0 * screen);
    assert!(screen < 0.8 * plain, "{screen} of {plain}");
    let [plain, screen] = [&[] as &[&str], &SCREEN].map(|k| noise(&bench.scenario, Technique::Candidates, k));
    assert!(screen < 0.9 * plain, "{screen} of {plain}");
    for technique in [Technique::Candidates, Technique::Still, Technique::RealTime] {
        assert_eq!(bench.check(technique, &SCREEN), None);
    }
}

#[test]
fn four_reservoirs_have_a_quarter_of_the_variance_of_one() {
    let scenario = scenarios::standing();
    for technique in [Technique::Candidates, Technique::Still] {
        let [one, four] = ["reservoirs.count=1", "reservoirs.count=4"].map(|knob| noise(&scenario, technique, &[knob]));
        assert!((one / four / 4.0 - 1.0).abs() < 0.1, "{technique}: a {}th", one / four);
    }
}

/// The same random numbers, so that each pixel has the very sample that it would have with as many candidates.
#[test]
fn pixels_off_the_lattice_have_fewer_candidates_and_those_on_it_all() {
    let scenario = scenarios::standing();
    let fresh = |knobs: &[&str]| candidates(&scenario, 3, knobs)[0].clone();
    let (many, few) = (fresh(&["candidates.count=4"]), fresh(&["candidates.count=2"]));
    let differing = many.iter().zip(&few).filter(|(a, b)| a != b).count();
    assert!(differing * 10 > many.len() * 8, "only {differing} pixels tell");
    let width = scenario.size[0] as usize;
    let is_on = |knob: &str, x: usize, y: usize| match knob {
        "reuse.resolution=full" => true,
        "reuse.resolution=checkerboard" => (x + y).is_multiple_of(2),
        _ => x.is_multiple_of(2) && y.is_multiple_of(2),
    };
    for knob in ["reuse.resolution=full", "reuse.resolution=checkerboard", "reuse.resolution=half"] {
        let thinned = fresh(&["candidates.count=4", "candidates.off_lattice=2", knob]);
        for (i, reservoir) in thinned.iter().enumerate() {
            let expected = if is_on(knob, i % width, i / width) { &many } else { &few };
            assert_eq!(*reservoir, expected[i], "{knob}, pixel ({}, {})", i % width, i / width);
        }
    }
}

#[test]
fn groups_of_candidates_are_between_the_full_target_for_all_and_for_as_few() {
    let mut scenario = scenarios::glossy();
    scenario.knobs.extend(["candidates.tree=0", "candidates.bsdf=0", "candidates.source=uniform"]);
    let of = |knobs: &[&str]| noise(&scenario, Technique::Candidates, knobs);
    let all = of(&["candidates.count=7"]);
    let [four, two, one] = [4, 2, 1].map(|n| of(&["candidates.count=7", &format!("candidates.full={n}")]));
    let few = of(&["candidates.count=2"]);
    assert!(all < four && four < two && two < one, "{all}, {four}, {two}, {one}");
    assert!(two < few, "{two}, {few}");
}

#[test]
fn the_sum_over_inputs_has_less_noise_than_the_sample_that_is_kept() {
    let scenario = scenarios::standing();
    let [sum, kept] =
        ["shade.sum=on", "shade.sum=off"].map(|knob| noise(&scenario, Technique::Still, &["rays=quality", knob]));
    assert!(sum < 0.8 * kept, "{sum} of {kept}");
}

#[test]
fn ways_of_choosing_differ_in_their_samples_and_not_in_their_noise() {
    let scenario = scenarios::standing();
    let ways = ["threshold", "plain", "keys", "inversion"].map(|way| format!("reservoirs.choice={way}"));
    let fresh = ways.each_ref().map(|way| candidates(&scenario, 3, &[way])[0].clone());
    for (i, one) in fresh.iter().enumerate() {
        assert!(fresh[..i].iter().all(|other| one != other), "{}", ways[i]);
    }
    let [threshold, others @ ..] = ways.each_ref().map(|way| noise(&scenario, Technique::Still, &[way]));
    for other in others {
        assert!((other / threshold - 1.0).abs() < 0.1, "{other} and {threshold}");
    }
}
