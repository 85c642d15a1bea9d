//! Helpers shared by the integration tests.

pub mod scenes;

use weir::{
    executor::gpu::{AdapterChoice, Gpu},
    packed::PackedScene,
    render::{Request, Stop, frame_of},
    scene::Camera,
    settings::Settings,
    technique::ToneCurve,
};

pub use weir::render::facts_of as facts;

use weir_shared::frame::Frame;

/// The GPU that tests run on; without one, says so and returns nothing.
///
/// # Panics
/// If `REQUIRE_GPU=1` and no adapter answers: a skipped test must not pass for a run one there.
pub fn gpu_or_skip(test: &str) -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::Best) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var("REQUIRE_GPU").is_ok_and(|v| v == "1") => panic!("{test}: {error}"),
        Err(error) => {
            eprintln!("SKIPPED: {test}: no adapter: {error}");
            None
        }
    }
}

/// The first `count` frames of an accumulation, with jitter and four candidates.
pub fn frames(packed: &PackedScene, camera: &Camera, width: u32, height: u32, count: u32) -> Vec<Frame> {
    let request = Request {
        width,
        height,
        camera: *camera,
        seed: 7,
        stop: Stop::Samples(count),
        curve: ToneCurve::default(),
        exposure: 1.0,
        settings: Settings { candidates: 4, ..Settings::default() },
    };
    let first = frame_of(packed, &request);
    (0..count).map(|i| Frame { index: i, accumulated: i, ..first }).collect()
}
