//! Why the last of a few frames is enough to judge a chain by: confidence is as large there as it gets, and no frame,
//! the first or a later one, has another mean.

use rayon::prelude::*;
use weir::{settings::Settings, technique::Technique};
use weir_shader::PASSES;
use weir_shared::reservoir::Reservoir;

use crate::{
    Bench, CHAIN_VARIANTS, TIERS,
    chains::Clip,
    scenarios::{self, FRAMES},
    statistics::{Ensemble, TOTALS, Verdict},
};

/// The verdict on every frame of a chain, from the first to the last.
fn verdicts(bench: &Bench, chains: u32, knobs: &[&str]) -> Vec<Verdict> {
    let clip = bench.clip(Technique::RealTime, knobs);
    let of_chain = |seed| {
        let mut frames = Vec::new();
        clip.chain(seed, |shown| frames.push(shown.totals()));
        frames
    };
    let chains: Vec<Vec<[f64; TOTALS]>> = (0..chains).into_par_iter().map(of_chain).collect();
    let of_frame = |i: usize| chains.iter().map(|chain| chain[i]).collect::<Vec<_>>();
    let verdict = |i| Verdict::new(&Ensemble::new(&of_frame(i)), &bench.judge, 0.01, None);
    let verdicts: Vec<_> = (0..FRAMES as usize).map(verdict).collect();
    for (i, verdict) in verdicts.iter().enumerate() {
        println!("frame {i} | {} | {verdict}", knobs.join(" "));
    }
    verdicts
}

/// A bias of reuse builds up from frame to frame, so a biased chain shows that the comparison tells frames apart.
#[test]
fn every_frame_of_a_chain_has_the_mean_of_the_reference_unless_reuse_is_biased() {
    let bench = Bench::new(scenarios::half_shadowed());
    for (i, verdict) in verdicts(&bench, 256, &["rays=balanced"]).iter().enumerate() {
        assert!(verdict.is_unbiased(), "frame {i}: {verdict}");
    }
    let biased = verdicts(&bench, 64, &["rays=before"]);
    assert!(!biased[0].differs(), "nothing was reused yet: {}", biased[0]);
    for (i, verdict) in biased.iter().enumerate().skip(3) {
        assert!(verdict.differs(), "frame {i}: {verdict}");
    }
}

/// For all settings that are tested with the default.
#[test]
fn before_the_last_frame_of_a_chain_history_has_reached_its_default_cap() {
    let cap = Settings::default().confidence_cap;
    let scenario = scenarios::half_shadowed();
    let capped = CHAIN_VARIANTS.iter().copied().filter(|knobs| !knobs.iter().any(|k| k.starts_with("temporal.cap")));
    for knobs in TIERS.iter().map(std::slice::from_ref).chain(capped) {
        let clip = Clip::showing(&["reservoirs"], &scenario, PASSES, Technique::RealTime, knobs);
        let mut confidences: Vec<Vec<u32>> = Vec::new();
        clip.chain(1, |shown| {
            confidences.push(shown.output::<Reservoir>("reservoirs").iter().map(Reservoir::confidence).collect());
        });
        let at_cap = |frame: &Vec<u32>| {
            let seen = frame.iter().filter(|&&c| c > 0);
            seen.clone().filter(|&&c| c >= cap).count() as f64 / seen.count() as f64
        };
        let shares: Vec<f64> = confidences.iter().map(at_cap).collect();
        println!("{} | share of reservoirs at the cap, frame by frame: {shares:.2?}", knobs.join(" "));
        assert!(shares[FRAMES as usize - 2] > 0.95, "{knobs:?}: {shares:?}");
        // Where no rounds within a frame add up too, it takes some frames.
        assert!(shares[1] < 0.05 || knobs.len() > 1, "{knobs:?}: {shares:?}");
    }
}
