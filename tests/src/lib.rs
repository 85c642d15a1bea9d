//! Helpers shared by the integration tests.

pub mod scenes;

use weir::{
    executor::gpu::{AdapterChoice, Gpu},
    graph::Facts,
    packed::PackedScene,
    scene::Camera,
};
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

/// What a plan of a packed scene depends on.
pub fn facts(packed: &PackedScene, width: u32, height: u32) -> Facts {
    Facts { width, height, has: packed.has(), features: packed.features.clone() }
}

/// The first `count` frames of an accumulation, with jitter and four candidates.
pub fn frames(packed: &PackedScene, camera: &Camera, width: u32, height: u32, count: u32) -> Vec<Frame> {
    let forward = (camera.target - camera.origin).normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let half_height = (camera.vfov_deg.to_radians() * 0.5).tan();
    let half_width = half_height * width as f32 / height as f32;
    let first = Frame {
        width,
        height,
        seed: 7,
        camera_origin: camera.origin,
        camera_right: right * half_width,
        camera_up: up * half_height,
        camera_forward: forward,
        jitter: 1,
        exposure: 1.0,
        candidates: 4,
        pick_by_power: 1,
        ..packed.frame
    };
    (0..count).map(|i| Frame { index: i, accumulated: i, ..first }).collect()
}
