//! What no pass would store, stored by accident: it must not go beyond its pixel.

use weir::technique::Technique;
use weir_shared::{light::ENVIRONMENT_BIT, reservoir::Reservoir};

use crate::{
    TIERS,
    chains::{Clip, HEIGHT, WIDTH},
    planted::{Bug, Seen, passes_with},
    scenarios::{self, Scenario},
};

/// Pixel whose reservoir is altered before others read it.
const AT: usize = (HEIGHT / 2 * WIDTH + WIDTH / 2) as usize;

/// Number of things that [`poison`] does.
const POISONS: u32 = 6;

/// A reservoir that makes no sense. 0: one without a sample, which the others must be equivalent to.
fn poison(kind: u32, reservoir: &mut Reservoir) {
    *reservoir = Reservoir { light: 0, uv: 0, ucw: 1.0, ..*reservoir };
    match kind {
        0 => reservoir.ucw = 0.0,
        1 => reservoir.ucw = f32::NAN,
        2 => reservoir.ucw = f32::INFINITY,
        3 => reservoir.ucw = -1.0,
        4 => reservoir.light = !ENVIRONMENT_BIT,
        _ => reservoir.light = u32::MAX - 1,
    }
}

struct Poisoned<const KIND: u32>;

impl<const KIND: u32> Bug for Poisoned<KIND> {
    fn plant(seen: &mut Seen<'_>) {
        poison(KIND, &mut seen.others[AT]);
    }
}

/// Red, green and blue of each pixel of the last frame.
fn picture<const KIND: u32>(scenario: &Scenario, knobs: &[&str]) -> Vec<[f32; 4]> {
    let clip = Clip::new(scenario, passes_with::<Poisoned<KIND>>(), Technique::RealTime, knobs);
    let mut last = Vec::new();
    clip.chain(3, |shown| last = shown.output::<[f32; 4]>("color").to_vec());
    last
}

#[test]
fn a_reservoir_that_makes_no_sense_is_for_others_one_without_a_sample() {
    for scenario in [scenarios::reordered_lights(), scenarios::environment()] {
        for tier in TIERS {
            let knobs = [tier, "spatial.rounds=1"];
            let expected = picture::<0>(&scenario, &knobs);
            assert!(expected.iter().flatten().all(|c| c.is_finite()));
            let pictures: [Vec<[f32; 4]>; POISONS as usize - 1] = [
                picture::<1>(&scenario, &knobs),
                picture::<2>(&scenario, &knobs),
                picture::<3>(&scenario, &knobs),
                picture::<4>(&scenario, &knobs),
                picture::<5>(&scenario, &knobs),
            ];
            for (kind, picture) in (1..).zip(&pictures) {
                let differs = (0..picture.len()).filter(|&i| picture[i] != expected[i]).count();
                assert_eq!(differs, 0, "{}, {tier}: poison {kind} reached that many pixels", scenario.name);
            }
        }
    }
    // The check has teeth: a reservoir with a sample does reach others.
    let scenario = scenarios::reordered_lights();
    let knobs = ["rays=speed", "spatial.rounds=1"];
    let with_sample = {
        let clip = Clip::new(&scenario, passes_with::<Bright>(), Technique::RealTime, &knobs);
        let mut last = Vec::new();
        clip.chain(3, |shown| last = shown.output::<[f32; 4]>("color").to_vec());
        last
    };
    assert_ne!(with_sample, picture::<0>(&scenario, &knobs));
}

/// A sample like any other, at the same pixel.
struct Bright;

impl Bug for Bright {
    fn plant(seen: &mut Seen<'_>) {
        seen.others[AT] = Reservoir { light: 0, uv: 0x8000_8000, ucw: 100.0, ..seen.others[AT] };
    }
}
