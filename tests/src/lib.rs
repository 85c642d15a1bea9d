//! Helpers shared by the integration tests.

use std::{io::Write as _, sync::OnceLock};

pub use weir::stress::{scenes, statistics};
use weir::{
    executor::gpu::{AdapterChoice, Gpu},
    render::Request,
    scene::Camera,
    settings::Settings,
    technique::Technique,
};

/// The GPU that the tests of a program share, with all that it has compiled; without one, says so and returns nothing.
///
/// # Panics
/// If `REQUIRE_GPU=1` and no adapter answers: a skipped test must not pass for a run one there.
pub fn gpu_or_skip(test: &str) -> Option<Gpu> {
    static SHARED: OnceLock<Result<Gpu, String>> = OnceLock::new();
    found(test, SHARED.get_or_init(open).clone())
}

/// As [`gpu_or_skip`], for a test that spoils it.
///
/// # Panics
/// As [`gpu_or_skip`].
pub fn own_gpu_or_skip(test: &str) -> Option<Gpu> {
    found(test, open())
}

fn open() -> Result<Gpu, String> {
    Gpu::open(&AdapterChoice::Best).map_err(|error| error.to_string())
}

fn found(test: &str, opened: Result<Gpu, String>) -> Option<Gpu> {
    match opened {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var("REQUIRE_GPU").is_ok_and(|v| v == "1") => panic!("{test}: {error}"),
        Err(error) => {
            skipped(test, &format!("no adapter: {error}"));
            None
        }
    }
}

/// Says that a test did not run; past the capture of the test harness, which shows nothing of tests that pass.
pub fn skipped(test: &str, why: &str) {
    // A closed stderr is no reason to fail.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {test}: {why}");
}

/// A picture to ask for, by default knobs and then `knobs`.
///
/// # Panics
/// If a knob does not exist or the knobs exclude each other.
pub fn request(camera: &Camera, size: [u32; 2], technique: Technique, knobs: &[&str]) -> Request {
    let mut settings = Settings::default();
    for knob in knobs {
        settings.apply(knob).expect("a knob");
    }
    settings.check().expect("knobs that go together");
    Request { seed: 7, ..Request::new(*camera, size, technique, settings) }
}
