//! Cases in which something moves from frame to frame.

use glam::{Mat4, Vec3};

use super::{
    Finding, Found,
    clip::{Clip, Take},
    scenarios::{self, Scenario},
    stage::{Stage, shining},
};
use crate::{
    packed::Moment,
    render::Backend,
    scene::{Camera, Material},
    sequence::Shot,
    technique::Technique,
};

/// Chains of each frame that is judged, and samples of the reference.
const CHAINS: u32 = 160;
/// Chains where a small light is found by few of them.
const MANY_CHAINS: u32 = 1200;
const SAMPLES: u32 = 2048;

/// Judges frames of a chain by the reference, each for what it shows.
fn judged(backend: &Backend<'_>, take: &Take<'_>, frames: &[usize]) -> Found {
    judged_by(CHAINS, backend, take, frames)
}

fn judged_by(chains: u32, backend: &Backend<'_>, take: &Take<'_>, frames: &[usize]) -> Found {
    let mut clip = Clip::new(backend, take)?;
    let mut findings = Vec::new();
    for &frame in frames {
        let seen = clip.chains(frame, chains)?;
        findings.push(seen.finding(&take.judged(frame, SAMPLES)?, 0.06).of(format!("frame {frame}")));
    }
    Ok(Finding::all(findings))
}

fn take<'a>(scenario: &'a Scenario, knobs: &[&'a str]) -> Take<'a> {
    let knobs = [&scenario.knobs[..], knobs].concat();
    let size = [scenario.size[0] / 2, scenario.size[1] / 2];
    Take { shots: scenario.shots.clone(), size, ..Take::still(&scenario.scene, Technique::RealTime, &knobs) }
}

pub fn changing_lights(backend: &Backend<'_>) -> Found {
    judged(backend, &take(&scenarios::changing_lights(), &[]), &[1, 4, 7])
}

pub fn flickering(backend: &Backend<'_>) -> Found {
    judged(backend, &take(&scenarios::flickering(), &[]), &[1, 4, 7])
}

pub fn moving_occluder(backend: &Backend<'_>) -> Found {
    let scenario = scenarios::moving_occluder();
    let mut findings = Vec::new();
    for tier in ["rays=quality", "rays=speed"] {
        findings.push(judged(backend, &take(&scenario, &[tier]), &[2, 7])?.of(tier));
    }
    Ok(Finding::all(findings))
}

/// Two lamps above the floor, of which one is large in every other frame.
pub fn scaled_light(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    // Around the origin, so that scaling leaves them where they are; facing down.
    let mesh = stage.panel(Vec3::new(-0.5, 0.0, -0.5), Vec3::X, Vec3::Z, shining(2.0));
    let other = stage.place(mesh, Mat4::IDENTITY);
    let at = |x: f32, size: f32| Mat4::from_translation(Vec3::new(x, 1.5, 0.0)) * Mat4::from_scale(Vec3::splat(size));
    let camera = stage.scene.camera.expect("it has one");
    let shots = (0..6).map(|i| {
        let size = if i % 2 == 0 { 1.0 } else { 1.0 / 1000f32.sqrt() };
        let placed = vec![(mesh, at(-0.6, size)), (other, at(0.7, 0.3))];
        Shot { moment: Moment { placed, ..Moment::default() }, camera }
    });
    let take =
        Take { shots: shots.collect(), ..Take::still(&stage.scene, Technique::RealTime, &["candidates.count=2"]) };
    judged_by(MANY_CHAINS, backend, &take, &[4, 5])
}

/// The camera turns to another view from one frame to the next.
pub fn camera_cut(backend: &Backend<'_>) -> Found {
    let scenario = scenarios::standing();
    let mut take = take(&scenario, &[]);
    let there =
        Camera { origin: Vec3::new(-2.0, 2.0, 1.0), target: Vec3::new(0.5, 0.2, -1.5), up: Vec3::Y, vfov_deg: 40.0 };
    take.shots.iter_mut().skip(4).for_each(|shot| shot.camera = there);
    judged(backend, &take, &[4, 6])
}

/// The camera trembles by parts of a pixel.
pub fn trembling_camera(backend: &Backend<'_>) -> Found {
    let scenario = scenarios::standing();
    let mut take = take(&scenario, &["camera.jitter=off"]);
    for (i, shot) in take.shots.iter_mut().enumerate() {
        let angle = 2.4 * i as f32;
        let offset = Vec3::new(angle.cos(), angle.sin(), 0.0) * 0.02;
        (shot.camera.origin, shot.camera.target) = (shot.camera.origin + offset, shot.camera.target + offset);
    }
    judged(backend, &take, &[3, 7])
}

/// A box comes from behind the camera, and a camera that goes through it.
pub fn from_behind(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    stage.panel(Vec3::new(-0.4, 1.6, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8, shining(6.0));
    let gray = Material::default();
    let slab = stage.panel(Vec3::new(-0.3, 0.0, 0.3), Vec3::X * 0.6, Vec3::NEG_Z * 0.6, gray);
    let camera = stage.scene.camera.expect("it has one");
    let shots = (0..6).map(|i| {
        // Above the camera, at its very place, and below it.
        let y = [3.0, 1.4, 1.0, 0.6, 2.0, 0.3][i];
        let placed = vec![(slab, Mat4::from_translation(Vec3::Y * y))];
        let down = Vec3::Y * [0.0, 0.0, 0.0, 0.0, 0.2, 0.3][i];
        let camera = Camera { origin: camera.origin - down, target: camera.target - down, ..camera };
        Shot { moment: Moment { placed, ..Moment::default() }, camera }
    });
    let take =
        Take { shots: shots.collect(), ..Take::still(&stage.scene, Technique::RealTime, &["candidates.count=2"]) };
    judged(backend, &take, &[3, 5])
}
