//! Reuse within a frame: stills have the mean of the reference; and options and bugs that bias them are seen to.

use weir::technique::Technique;
use weir_shader::wiring::Pass;

use crate::{
    Bench, TIERS, TILES, is_long,
    planted::{NoBug, NoCanonicalTerm, NullWithoutConfidence, RejectedByContent, VisibilityUnknownToMis, passes_with},
    scenarios::{self, Scenario},
    statistics::{Ensemble, Verdict},
};

pub const ROUNDS: &str = "still.rounds=2";

/// Knobs of reuse in stills, each turned.
pub const VARIANTS: &[&[&str]] = &[
    &["rays=speed", "reuse.mis=pairwise"],
    &["rays=speed", "reuse.mis=balance"],
    &["rays=speed", "reuse.mis=contribution"],
    &["rays=speed", "reuse.mis=1/z"],
    &["rays=balanced", "reuse.mis=pairwise"],
    &["rays=balanced", "reuse.rule=compatible"],
    &["rays=quality", "reuse.rule=paired"],
    &["rays=balanced", "reservoirs.count=2"],
    &["rays=balanced", "reservoirs.choice=keys"],
    &["rays=balanced", "reuse.resolution=checkerboard"],
    &["rays=quality", "reuse.resolution=half"],
    &["rays=balanced", "candidates.full=2", "candidates.tree=0"],
    &["rays=balanced", "candidates.source=uniform"],
    TILES,
    &["rays=balanced", "candidates.source=cells", "candidates.tree=0", "cells.slots=2", "cells.candidates=2"],
    &["rays=balanced", "candidates.source=tree"],
    &["rays=balanced", "candidates.source=cuts", "candidates.tree=1"],
    &["rays=balanced", "reservoirs.choice=inversion"],
    &["rays=quality", "shade.sum=off"],
    &["rays=balanced", "candidates.tree=2"],
    &["preset=fast", "candidates.count=4", "reuse.radius=4"],
    &["preset=balanced", "candidates.count=4", "reuse.radius=4"],
    &["preset=quality", "candidates.count=4", "reuse.radius=4"],
    &["preset=paper", "candidates.count=4", "reuse.radius=4"],
];

/// The scenario in each tier and, in long tests, with each knob turned.
fn assert_unbiased(scenario: Scenario) {
    let bench = Bench::new(scenario);
    let mut wrong: Vec<_> = TIERS.iter().filter_map(|tier| bench.check(Technique::Still, &[tier, ROUNDS])).collect();
    if is_long() {
        let variants = VARIANTS.iter().map(|knobs| [knobs, &[ROUNDS] as &[&str]].concat());
        wrong.extend(variants.filter_map(|knobs| bench.check(Technique::Still, &knobs)));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn stills_are_unbiased_where_neighbours_see_different_lights() {
    assert_unbiased(scenarios::half_shadowed());
}

#[test]
fn stills_are_unbiased_under_a_sky() {
    assert_unbiased(scenarios::environment());
}

#[test]
fn stills_are_unbiased_on_glossy_surfaces() {
    assert_unbiased(scenarios::glossy());
}

#[test]
fn every_bias_planted_in_stills_is_caught() {
    let wall = Bench::new(scenarios::half_shadowed());
    let planted = |passes: &'static [Pass], tier: &str| wall.planted(passes, Technique::Still, &[tier, ROUNDS]);
    let plain = wall.verdict(&planted(passes_with::<NoBug>(), "rays=balanced"));
    println!("planted in stills: nothing | {plain}");
    assert!(plain.is_unbiased(), "{plain}");

    for tier in TIERS {
        let caught = |what: &str, passes| wall.assert_biased(&format!("{what}, {tier}"), &planted(passes, tier));
        caught("no canonical term", passes_with::<NoCanonicalTerm>());
        caught("rejected by content", passes_with::<RejectedByContent>());
        // Without rays, hardly a reservoir is null, and nothing is hidden.
        if tier != "rays=speed" {
            caught("null reservoirs without confidence", passes_with::<NullWithoutConfidence>());
            caught("visibility unknown to the MIS weights", passes_with::<VisibilityUnknownToMis>());
        }
    }
    for knobs in [&["rays=speed", "reuse.mis=1/m"] as &[&str], &["rays=before"], &["rays=both"], &["rays=none"]] {
        let clip = wall.clip(Technique::Still, &[knobs, &[ROUNDS]].concat());
        wall.assert_biased(&knobs.join(" "), &clip);
    }
}

/// The smallest of the planted bugs, seen with many stills of the tier with the least noise.
#[test]
fn one_light_of_a_still_that_is_one_percent_brighter_is_caught() {
    let mut bench = Bench::new(scenarios::standing());
    let verdict = |bench: &Bench| {
        let clip = bench.clip(Technique::Still, &["rays=quality", "candidates.count=8", ROUNDS]);
        Verdict::new(&Ensemble::new(&clip.totals(0..2048)), &bench.judge, 0.005, None)
    };
    let plain = verdict(&bench);
    println!("planted in stills: nothing | {plain}");
    assert!(plain.is_unbiased(), "{plain}");
    bench.scenario.scene.materials[3].emission *= 1.01;
    let brighter = verdict(&bench);
    println!("planted in stills: a light 1 % brighter | {brighter}");
    assert!(brighter.differs(), "1 % more light went unnoticed: {brighter}");
}
