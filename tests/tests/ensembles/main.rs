//! Reuse is unbiased: the mean over many independent chains of frames is that of the reference integrator, whatever
//! moves and whichever knobs are turned; and options and bugs that bias it are seen to.
//!
//! A frame of a chain shares samples with the frames before it, so its error is judged over chains and not over frames.
//! `WEIR_LONG_TESTS=1` runs more chains, with closer margins for the picture and with margins for its tiles.

mod chains;
mod convergence;
mod edges;
mod history;
mod options;
mod planted;
mod poison;
mod statistics;
mod stills;

use std::{collections::BTreeMap, sync::Mutex};

use weir::{budget::FRONT, reference::Estimate, stress::scenarios, technique::Technique};
use weir_shader::{PASSES, wiring::Pass};
use weir_shared::surface::Surface;

use chains::{Clip, judge};
use planted::{
    NoBug, NoCanonicalTerm, NullWithoutConfidence, PastUnderPresentLights, RejectedByContent, VisibilityUnknownToMis,
    passes_with,
};
use scenarios::Scenario;
use statistics::{Ensemble, TOTALS, Verdict};

/// How much is computed, and how close the means must be shown to be.
struct Effort {
    /// Fewest and most chains.
    chains: [u32; 2],
    /// Standard error of the picture that is aimed at.
    error: f64,
    reference_samples: u32,
    picture_margin: f64,
    tile_margin: Option<f64>,
}

fn is_long() -> bool {
    std::env::var("WEIR_LONG_TESTS").is_ok_and(|v| v == "1")
}

fn effort() -> Effort {
    if is_long() {
        return Effort {
            chains: [4096, 65_536],
            error: 0.0005,
            reference_samples: 1 << 16,
            picture_margin: 0.002,
            tile_margin: Some(0.01),
        };
    }
    Effort { chains: [256, 1024], error: 0.0014, reference_samples: 1 << 12, picture_margin: 0.005, tile_margin: None }
}

/// Seeds of the chains that only tell how many are needed; none of them is used again.
const PILOT: std::ops::Range<u32> = 0x8000_0000..0x8000_0040;

/// What the reference makes of the last shot of a scenario, computed once for all tests that show it.
fn judged(scenario: &Scenario) -> Ensemble {
    static KNOWN: Mutex<BTreeMap<&str, Ensemble>> = Mutex::new(BTreeMap::new());
    // Locked while one is computed: all processors are at work on it.
    let mut known = KNOWN.lock().expect("no reference has failed");
    let compute = || Ensemble::of_reference(&judge(scenario, effort().reference_samples));
    known.entry(scenario.name).or_insert_with(compute).clone()
}

/// A scenario and what the reference makes of its last shot.
struct Bench {
    scenario: Scenario,
    judge: Ensemble,
}

impl Bench {
    fn new(scenario: Scenario) -> Self {
        let judge = judged(&scenario);
        Self { scenario, judge }
    }

    fn clip(&self, technique: Technique, knobs: &[&str]) -> Clip {
        self.planted(PASSES, technique, knobs)
    }

    fn planted(&self, passes: &'static [Pass], technique: Technique, knobs: &[&str]) -> Clip {
        Clip::new(&self.scenario, passes, technique, knobs)
    }

    fn verdict_of(&self, totals: &[[f64; TOTALS]]) -> Verdict {
        let Effort { picture_margin, tile_margin, .. } = effort();
        Verdict::new(&Ensemble::new(totals), &self.judge, picture_margin, tile_margin)
    }

    /// Compares as many chains as it takes; twice and four times as many where they do not decide.
    fn verdict(&self, clip: &Clip) -> Verdict {
        let Effort { chains: [fewest, most], error, .. } = effort();
        let wanted = (Ensemble::new(&clip.totals(PILOT)).spread() / error).powi(2).ceil() as u32;
        let first = wanted.clamp(fewest, most);
        let mut totals = clip.totals(0..first);
        loop {
            let (verdict, chains) = (self.verdict_of(&totals), totals.len() as u32);
            if verdict.is_unbiased() || verdict.differs() || chains >= 4 * first {
                return verdict;
            }
            totals.extend(clip.totals(chains..2 * chains));
        }
    }

    /// Checks that a bias is seen: few chains will do where it is large.
    fn assert_biased(&self, what: &str, clip: &Clip) {
        let few = self.verdict_of(&clip.totals(0..64));
        let verdict = if few.differs() { few } else { self.verdict(clip) };
        println!("biased: {what} | {verdict}");
        assert!(verdict.differs(), "{what} went unnoticed: {verdict}");
    }

    /// Checks that the means are those of the reference; returns what is wrong.
    fn check(&self, technique: Technique, knobs: &[&str]) -> Option<String> {
        let start = std::time::Instant::now();
        let verdict = self.verdict(&self.clip(technique, knobs));
        let row = format!("{} | {technique} {} | {verdict}", self.scenario.name, knobs.join(" "));
        println!("{row} | {:.1} s", start.elapsed().as_secs_f64());
        (!verdict.is_unbiased()).then_some(row)
    }
}

const TIERS: [&str; 3] = ["rays=speed", "rays=balanced", "rays=quality"];

/// The scenario in each tier.
fn assert_unbiased(scenario: Scenario) {
    let bench = Bench::new(scenario);
    let wrong: Vec<_> = TIERS.iter().filter_map(|tier| bench.check(Technique::RealTime, &[tier])).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_chain_is_unbiased_where_nothing_moves() {
    assert_unbiased(scenarios::standing());
}

#[test]
fn a_chain_is_unbiased_while_the_camera_moves() {
    assert_unbiased(scenarios::moving_camera());
}

#[test]
fn a_chain_is_unbiased_while_lights_move() {
    assert_unbiased(scenarios::moving_light());
}

#[test]
fn a_chain_is_unbiased_while_lights_of_other_shapes_move_and_flicker() {
    assert_unbiased(scenarios::moving_shapes());
}

#[test]
fn a_chain_is_unbiased_while_shadows_come_and_go() {
    assert_unbiased(scenarios::moving_occluder());
}

#[test]
fn a_chain_is_unbiased_while_lights_come_and_go_and_change_places() {
    assert_unbiased(scenarios::changing_lights());
}

#[test]
fn a_chain_is_unbiased_while_lights_change_places() {
    assert_unbiased(scenarios::reordered_lights());
}

#[test]
fn a_chain_is_unbiased_while_lights_flicker_and_shrink_and_grow() {
    assert_unbiased(scenarios::flickering());
}

#[test]
fn a_chain_is_unbiased_under_a_sky() {
    assert_unbiased(scenarios::environment());
}

#[test]
fn a_chain_is_unbiased_on_glossy_surfaces() {
    assert_unbiased(scenarios::glossy());
}

#[test]
fn a_chain_is_unbiased_where_neighbours_see_different_lights() {
    assert_unbiased(scenarios::half_shadowed());
}

/// From the lowest rung to the highest and back, a rung or several a frame: what a time budget does at its worst.
#[test]
fn a_chain_is_unbiased_while_a_time_budget_moves_its_knobs() {
    let rung_of = |frame: usize| (frame * 3) % FRONT.len();
    let mut wrong = Vec::new();
    for bench in [scenarios::half_shadowed(), scenarios::moving_light()].map(Bench::new) {
        for tier in TIERS {
            let chain = Technique::RealTime;
            let clip = Clip::tuned(&["color"], &bench.scenario, PASSES, chain, &[tier], Some(rung_of));
            let verdict = bench.verdict(&clip);
            println!("{} | {tier} | {verdict}", bench.scenario.name);
            if !verdict.is_unbiased() {
                wrong.push(format!("{} {tier}: {verdict}", bench.scenario.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Neighbours share the lights that were drawn ahead, even where a tile holds more than there are.
const TILES: &[&str] = &[
    "rays=balanced",
    "candidates.source=tiles",
    "candidates.tree=0",
    "tiles.count=2",
    "tiles.size=8",
    "skip.presampling=off",
];

/// Knobs of reuse in the chain, each turned.
const CHAIN_VARIANTS: &[&[&str]] = &[
    &["rays=speed", "reuse.mis=pairwise"],
    &["rays=speed", "reuse.mis=balance"],
    &["rays=speed", "reuse.mis=contribution"],
    &["rays=speed", "reuse.mis=1/z"],
    &["rays=balanced", "reuse.mis=pairwise"],
    &["rays=balanced", "reuse.rule=compatible"],
    &["rays=quality", "reuse.rule=paired"],
    &["rays=balanced", "reservoirs.count=2"],
    &["rays=quality", "reservoirs.choice=plain"],
    &["rays=balanced", "reservoirs.choice=keys"],
    &["rays=balanced", "reuse.resolution=checkerboard"],
    &["rays=quality", "reuse.resolution=half"],
    // Groups of those that the light tree leaves.
    &["rays=balanced", "candidates.full=2", "candidates.tree=0"],
    &["rays=balanced", "candidates.source=uniform"],
    TILES,
    &["rays=balanced", "candidates.source=cells", "candidates.tree=0", "cells.slots=2", "cells.candidates=2"],
    &["rays=balanced", "candidates.source=tree", "candidates.tree_update=refit"],
    &["rays=balanced", "candidates.source=cuts", "candidates.tree=1"],
    &["rays=balanced", "reservoirs.choice=inversion"],
    // Each light is a candidate; and drawn, though each could be.
    &["rays=balanced", "candidates.count=16"],
    &["rays=balanced", "candidates.count=16", "skip.few=off"],
    // Spatial reuse after reuse in time. 20,480 chains of the last of these three are within +0.005 % +- 0.057 %.
    &["rays=speed", "spatial.rounds=1"],
    &["rays=balanced", "spatial.rounds=2"],
    &["rays=quality", "spatial.rounds=1", "spatial.neighbors=3"],
    &["rays=quality", "shade.sum=off"],
    &["rays=balanced", "temporal.cap=30"],
    // Of four candidates, two and none down the light tree; three by default.
    &["rays=balanced", "candidates.tree=2"],
    &["rays=speed", "candidates.tree=0"],
    // Presets as they are, but for candidates: few enough that lights are drawn.
    &["preset=fast", "candidates.count=4", "reuse.radius=4"],
    &["preset=balanced", "candidates.count=4", "reuse.radius=4"],
    &["preset=quality", "candidates.count=4", "reuse.radius=4"],
    &["preset=paper", "candidates.count=4", "reuse.radius=4"],
];

#[test]
fn every_unbiased_knob_of_the_chain_is_unbiased_where_neighbours_see_different_lights() {
    let bench = Bench::new(scenarios::half_shadowed());
    let wrong: Vec<_> = CHAIN_VARIANTS.iter().filter_map(|knobs| bench.check(Technique::RealTime, knobs)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Next to pixels that are sampled lie some that are not, as their light has a closed form: neither kind lends to the other.
#[test]
fn pixels_whose_light_has_a_closed_form_bias_nobody() {
    let mut wrong = Vec::new();
    for scenario in [scenarios::standing(), scenarios::moving_camera()] {
        let bench = Bench::new(scenario.with_closed_form());
        let clip = Clip::showing(&["surfaces"], &bench.scenario, PASSES, Technique::RealTime, &[]);
        let mut share = 0.0;
        clip.chain(1, |shown| {
            let seen = || shown.output::<Surface>("surfaces").iter().filter(|surface| !surface.is_sky());
            share = seen().filter(|surface| surface.is_settled()).count() as f64 / seen().count() as f64;
        });
        println!("{}: {:.0} % of the surfaces are settled", bench.scenario.name, share * 100.0);
        assert!((0.1..0.9).contains(&share), "{share}");
        let chain = [&["rays=speed"] as &[&str], &["rays=balanced", "spatial.rounds=1"], &["rays=quality"]];
        wrong.extend(chain.iter().filter_map(|knobs| bench.check(Technique::RealTime, knobs)));
        wrong.extend(bench.check(Technique::Still, &[]));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_bug_planted_in_closed_forms_is_caught() {
    let bench = Bench::new(scenarios::standing().with_closed_form());
    let chain = Technique::RealTime;
    for (what, plant) in [
        ("penumbras pass for lit", planted::take_penumbras_for_lit as fn(&mut Clip)),
        ("a light is forgotten", planted::forget_a_light),
    ] {
        let mut clip = bench.clip(chain, &[]);
        plant(&mut clip);
        bench.assert_biased(what, &clip);
    }
    let settled = bench.planted(planted::sampling_what_is_settled(), chain, &[]);
    bench.assert_biased("what is settled is sampled as well", &settled);
}

/// Cuts without what no surface of their block sees, where nothing else finds a light.
const CUTS_ALONE: &[&str] =
    &["rays=speed", "candidates.source=cuts", "candidates.count=2", "candidates.tree=0", "candidates.bsdf=0"];

#[test]
fn lights_are_left_out_of_cuts_only_where_no_pixel_of_the_block_sees_them() {
    let bench = Bench::new(scenarios::standing());
    let chain = Technique::RealTime;
    assert_eq!(bench.check(chain, CUTS_ALONE), None);
    let of_one = bench.planted(planted::bounding_one_pixel_for_its_block(), chain, CUTS_ALONE);
    bench.assert_biased("what one pixel of a block doesn't see", &of_one);
}

/// Forms of MIS weights, and rounds of spatial reuse after reuse in time, where ids of lights have to be translated.
const REORDERED_VARIANTS: &[&[&str]] = &[
    &["rays=speed", "reuse.mis=pairwise", "spatial.rounds=1"],
    &["rays=speed", "reuse.mis=balance"],
    &["rays=speed", "reuse.mis=contribution"],
    &["rays=speed", "reuse.mis=1/z"],
    &["rays=balanced", "spatial.rounds=1"],
    &["rays=quality", "spatial.rounds=1", "spatial.neighbors=3"],
    &["rays=balanced", "reservoirs.count=2"],
];

#[test]
fn every_form_of_weights_is_unbiased_while_lights_change_places() {
    let bench = Bench::new(scenarios::reordered_lights());
    let wrong: Vec<_> = REORDERED_VARIANTS.iter().filter_map(|knobs| bench.check(Technique::RealTime, knobs)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The comparison has teeth: options that are known to be biased are seen to be.
#[test]
fn options_that_are_called_biased_are() {
    let bench = Bench::new(scenarios::half_shadowed());
    for knobs in [&["rays=speed", "reuse.mis=1/m"] as &[&str], &["rays=before"], &["rays=both"], &["rays=none"]] {
        bench.assert_biased(&knobs.join(" "), &bench.clip(Technique::RealTime, knobs));
    }
}

#[test]
fn every_planted_bug_is_caught() {
    let chain = Technique::RealTime;
    let wall = Bench::new(scenarios::half_shadowed());
    let plain = wall.verdict(&wall.planted(passes_with::<NoBug>(), chain, &["rays=balanced"]));
    println!("planted: nothing | {plain}");
    assert!(plain.is_unbiased(), "{plain}");

    // In `speed`, only light from behind or beside makes reservoirs without a sample, and no ray is known of.
    let bugs: [(&str, &'static [Pass], &[&str]); 4] = [
        ("no canonical term", passes_with::<NoCanonicalTerm>(), &TIERS),
        ("null reservoirs without confidence", passes_with::<NullWithoutConfidence>(), &TIERS[1..]),
        ("rejected by content", passes_with::<RejectedByContent>(), &TIERS),
        ("visibility unknown to the MIS weights", passes_with::<VisibilityUnknownToMis>(), &TIERS[1..]),
    ];
    for (what, passes, tiers) in bugs {
        for tier in tiers {
            wall.assert_biased(&format!("{what}, {tier}"), &wall.planted(passes, chain, &[tier]));
        }
    }
    for tier in TIERS {
        let mut shifted = wall.clip(chain, &[tier]);
        planted::shift_alias_table(&mut shifted);
        wall.assert_biased(&format!("alias table off by one, {tier}"), &shifted);
    }

    let flickering = Bench::new(scenarios::flickering());
    for tier in TIERS {
        let present = flickering.planted(passes_with::<PastUnderPresentLights>(), chain, &[tier]);
        flickering.assert_biased(&format!("the past under present lights, {tier}"), &present);
    }

    let reordered = Bench::new(scenarios::reordered_lights());
    for tier in TIERS {
        let mut kept = reordered.clip(chain, &[tier]);
        planted::keep_own_light_ids(&mut kept);
        reordered.assert_biased(&format!("own light ids not translated, {tier}"), &kept);
    }
}

/// The smallest of the planted bugs, seen with many chains of the tier with the least noise.
#[test]
fn one_light_that_is_one_percent_brighter_is_caught() {
    let mut bench = Bench::new(scenarios::standing());
    let verdict = |bench: &Bench| {
        let clip = bench.clip(Technique::RealTime, &["rays=quality", "candidates.count=8", "temporal.neighbors=3"]);
        Verdict::new(&Ensemble::new(&clip.totals(0..1024)), &bench.judge, 0.005, None)
    };
    let plain = verdict(&bench);
    println!("planted: nothing | {plain}");
    assert!(!plain.differs(), "without any bug: {plain}");
    let brightest = &mut bench.scenario.scene.materials[3];
    brightest.emission *= 1.01;
    let brighter = verdict(&bench);
    println!("planted: a light 1 % brighter | {brighter}");
    assert!(brighter.differs(), "1 % more light went unnoticed: {brighter}");
}

/// Slope of the squared error of a mean of stills against their number, up to 4,096 of them, where neighbours see
/// different lights.
fn slope_of_stills(reference: &[Estimate], seeds: u32, knobs: &[&str]) -> f64 {
    const MOST: u32 = 4096;
    let scenario = scenarios::small_half_shadowed();
    let clip = Clip::new(&scenario, PASSES, Technique::Still, &[&["still.rounds=2"], knobs].concat());
    let errors = convergence::squared_errors(&clip, reference, seeds, MOST);
    let slope = convergence::slope(&errors);
    let flat: Vec<String> = errors.iter().map(|(n, e)| format!("{n}: {:.3e}", e * n)).collect();
    println!("{}: slope {slope:.4}; N MSE at N {}", knobs.join(" "), flat.join(", "));
    slope
}

/// Error of the mean of N independent stills falls as 1 / N: nothing in reuse is left over that averaging does not
/// remove. What is biased does leave something.
#[test]
fn the_squared_error_of_stills_falls_with_their_number_unless_reuse_is_biased() {
    const BOUND: f64 = 0.05;
    let (seeds, samples) = if is_long() { (32, 1 << 20) } else { (4, 1 << 18) };
    let reference = judge(&scenarios::small_half_shadowed(), samples);
    for tier in TIERS {
        let slope = slope_of_stills(&reference, seeds, &[tier]);
        assert!((slope + 1.0).abs() < BOUND, "{tier}: slope {slope}");
    }
    for biased in [&["rays=before"] as &[&str], &["rays=speed", "reuse.mis=1/m"]] {
        let slope = slope_of_stills(&reference, 1, biased);
        assert!(slope + 1.0 > BOUND, "{biased:?} went unnoticed: slope {slope}");
    }
}
