//! What an adversary may think of: lights of any magnitude against Lambert's formula in `f64`, and scenes and settings out
//! of random bytes. `WEIR_LONG_TESTS=1` has forty times as many cases.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::{Quat, Vec3};
use proptest::{prelude::*, test_runner::TestRunner};
use rayon::prelude::*;
use weir::{
    executor::cpu::Order,
    render::{Backend, RenderError},
    stress::{
        arbitrary::unusable_pixels,
        stage::{Stage, shining},
    },
    technique::Technique,
};
use weir_shared::rng::pcg4d;

fn times(cases: u32) -> u32 {
    if std::env::var("WEIR_LONG_TESTS").is_ok_and(|v| v == "1") { 40 * cases } else { cases }
}

/// A lamp above the floor: its magnitude, place, size and turn.
#[derive(Clone, Debug)]
struct Lamp {
    decades: f32,
    middle: [f32; 3],
    size: [f32; 2],
    turn: f32,
    tilt: f32,
}

fn lamp() -> impl Strategy<Value = Lamp> {
    let middle = [-0.7f32..0.7, 1.5f32..3.0, -0.7f32..0.7];
    (-20f32..19.5, middle, [0.05f32..1.0, 0.05f32..1.0], 0f32..6.3, -0.25f32..0.25)
        .prop_map(|(decades, middle, size, turn, tilt)| Lamp { decades, middle, size, turn, tilt })
}

/// Without shadow rays lamps don't hide each other, so that the formula is exact.
fn check(lamps: &[Lamp], technique: Technique) -> Result<(), TestCaseError> {
    let mut stage = Stage::floor();
    for Lamp { decades, middle, size, turn, tilt } in lamps {
        let turned = Quat::from_rotation_y(*turn) * Quat::from_rotation_x(*tilt);
        let (a, b) = (turned * (Vec3::X * size[0]), turned * (Vec3::Z * size[1]));
        stage.lamp(Vec3::from(*middle) - 0.5 * (a + b), a, b, shining(10f32.powf(*decades)));
    }
    let knobs = ["rays=none", "candidates.bsdf=0", "candidates.count=24", "candidates.tree=8"];
    let backend = Backend::Cpu(Order::default());
    let (still, formula) = stage.measured(&backend, technique, &knobs, 24).expect("a picture");
    prop_assert_eq!((still.unusable(), still.faults()), (0, 0));
    let (agrees, seen) = still.total().agrees(&formula, 0.1);
    prop_assert!(agrees, "{}", seen);
    Ok(())
}

#[test]
fn one_to_eight_lights_of_forty_decades_have_the_mean_of_the_formula() {
    let mut runner = TestRunner::deterministic();
    let scenes = (prop::collection::vec(lamp(), 1..=8), prop::bool::ANY);
    for _ in 0..times(4) {
        runner
            .run(&scenes, |(lamps, reuses)| {
                check(&lamps, if reuses { Technique::Still } else { Technique::Candidates })
            })
            .expect("no counterexample");
    }
}

/// The inputs in a file of `fuzzed/`: one, or in `corpus` many, each after its length in two bytes, the lower first.
fn inputs(file: &Path) -> Vec<Vec<u8>> {
    let all = fs::read(file).expect("readable");
    if file.file_name().is_some_and(|name| name != "corpus") {
        return vec![all];
    }
    let mut inputs = Vec::new();
    let mut rest = all.as_slice();
    while let [low, high, after @ ..] = rest {
        let (input, after) = after.split_at(usize::from(*low) | usize::from(*high) << 8);
        inputs.push(input.to_vec());
        rest = after;
    }
    inputs
}

/// What the fuzzer has found: bytes that once gave pictures that can't be used, and such as reach different code.
#[test]
fn every_kept_input_of_the_fuzzer_gives_a_usable_picture() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzzed");
    let files = folder.read_dir().expect("a folder").map(|file| file.expect("a file").path());
    let inputs: Vec<(PathBuf, Vec<u8>)> =
        files.flat_map(|file| inputs(&file).into_iter().map(move |input| (file.clone(), input))).collect();
    assert!(inputs.len() > 100);
    let drawn = inputs.par_iter().filter(|(file, bytes)| {
        let backend = Backend::Cpu(Order { band_rows: 16, backwards: false });
        match unusable_pixels(&backend, bytes) {
            Ok(unusable) => {
                assert_eq!(unusable.unwrap_or(0), 0, "{}: {bytes:?}", file.display());
                unusable.is_some()
            }
            Err(RenderError::Pack(_)) => false,
            Err(error) => panic!("{}: {error}", file.display()),
        }
    });
    assert!(drawn.count() > 100);
}

/// Random bytes: as many as a fuzzer that knows nothing.
fn bytes(case: u32) -> Vec<u8> {
    (0..64).flat_map(|i| pcg4d(case, i, 0xb, 7)).flat_map(u32::to_le_bytes).collect()
}

#[test]
fn scenes_and_settings_out_of_random_bytes_give_usable_pictures() {
    let look = |case: u32| {
        let backend = Backend::Cpu(Order { band_rows: 16, backwards: false });
        match unusable_pixels(&backend, &bytes(case)) {
            Ok(Some(pixels)) => {
                assert_eq!(pixels, 0, "case {case}");
                [1, 0]
            }
            Ok(None) => [0, 0],
            // What moves can lose its inverse.
            Err(RenderError::Pack(_)) => [0, 1],
            Err(error) => panic!("case {case}: {error}"),
        }
    };
    let cases = times(4000);
    let add = |a: [u32; 2], b: [u32; 2]| [a[0] + b[0], a[1] + b[1]];
    let [drawn, refused] = (0..cases).into_par_iter().map(look).reduce(|| [0; 2], add);
    println!("{drawn} of {cases} drawn, {refused} refused");
    assert!(drawn > cases / 3, "{drawn} of {cases} were scenes");
}
