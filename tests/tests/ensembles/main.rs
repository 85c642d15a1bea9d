//! Reuse is unbiased: the mean over many independent chains of frames is that of the reference integrator, whatever
//! moves and whichever knobs are turned; and options and bugs that bias it are seen to.
//!
//! A frame of a chain shares samples with the frames before it, so its error is judged over chains and not over frames.
//! `WEIR_LONG_TESTS=1` runs more chains, with closer margins for the picture and with margins for its tiles.

mod chains;
mod scenarios;
mod statistics;

use weir::technique::Technique;
use weir_shader::{PASSES, wiring::Pass};

use chains::{Clip, judge};
use scenarios::Scenario;
use statistics::{Ensemble, Verdict};

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

/// A scenario and what the reference makes of its last shot.
struct Bench {
    scenario: Scenario,
    judge: Ensemble,
}

impl Bench {
    fn new(scenario: Scenario) -> Self {
        let judge = Ensemble::of_reference(&judge(&scenario, effort().reference_samples));
        Self { scenario, judge }
    }

    fn clip(&self, technique: Technique, knobs: &[&str]) -> Clip {
        self.planted(PASSES, technique, knobs)
    }

    fn planted(&self, passes: &'static [Pass], technique: Technique, knobs: &[&str]) -> Clip {
        Clip::new(&self.scenario, passes, technique, knobs)
    }

    /// Compares as many chains as it takes.
    fn verdict(&self, clip: &Clip) -> Verdict {
        let Effort { chains: [fewest, most], error, picture_margin, tile_margin, .. } = effort();
        let wanted = (clip.ensemble(PILOT).spread() / error).powi(2).ceil() as u32;
        let chains = clip.ensemble(0..wanted.clamp(fewest, most));
        Verdict::new(&chains, &self.judge, picture_margin, tile_margin)
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
