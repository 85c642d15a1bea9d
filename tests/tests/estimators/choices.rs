//! The ways of choosing by random numbers have, through a merge, the law that enumeration gives.

use weir::stress::worlds::random::UNBIASED;
use weir_shared::{
    merge::{form, merge},
    resample::{Chooser, choice},
    rng::Rng,
};

use crate::{
    unbiased::domains,
    walk::{Enumerating, enumerate},
    world::{Case, Domain, Held, Keeper, Probe},
};

const STREAMS: u32 = 100_000;

/// Six inputs with weights over four decades; one has no sample, one no confidence.
fn inputs() -> (Vec<Domain>, Vec<Held>) {
    let domains = [domains(), domains()].concat();
    let held = |light: usize, ucw: f64, confidence: f64| Held { light, ucw, confidence };
    let held = vec![
        held(0, 3.0, 2.0),
        held(0, 0.5, 5.0),
        held(1, 40.0, 1.0),
        held(3, 0.0, 20.0),
        held(3, 0.02, 7.0),
        held(2, 9.0, 0.0),
    ];
    (domains, held)
}

#[test]
fn every_way_of_choosing_has_the_law_of_the_enumeration() {
    let (domains, held) = inputs();
    let case = Case { domains: &domains, held: &held, probe: Probe::None, partner: 0 };
    for form in UNBIASED.into_iter().chain([form::ONE_OVER_M]) {
        let mut law = vec![0.0; held.len()];
        enumerate(|walk| {
            let mut keeper = Keeper::<f64, _>::new(Enumerating::new(walk));
            let kept = merge(&case, form, &mut keeper).kept;
            law[kept as usize] += walk.chance();
        });
        assert!(law[..3].iter().chain([&law[4]]).all(|&chance| chance * f64::from(STREAMS) > 5.0), "{law:?}");
        assert_eq!((law[3], law[5]), (0.0, 0.0));
        for way in [choice::THRESHOLD, choice::PLAIN, choice::KEYS] {
            let mut counts = vec![0.0f64; held.len()];
            for stream in 0..STREAMS {
                let rng = Rng::from_words(stream, 11, form, way << 24);
                let mut keeper = Keeper::<f32, _>::new(Chooser::new(rng, way));
                let merged = merge(&case, form, &mut keeper);
                assert_eq!(keeper.held(&merged).light, held[merged.kept as usize].light);
                counts[merged.kept as usize] += 1.0;
            }
            let statistic: f64 = counts
                .iter()
                .zip(&law)
                .filter(|(_, chance)| **chance > 0.0)
                .map(|(count, chance)| (count / f64::from(STREAMS) - chance).powi(2) * f64::from(STREAMS) / chance)
                .sum();
            assert_eq!((counts[3], counts[5]), (0.0, 0.0));
            // Quantile 1 - 1e-6 of the distribution with 3 degrees of freedom.
            assert!(statistic < 30.7, "form {form}, way {way}: chi-square {statistic}, {counts:?} for {law:?}");
        }
    }
}
