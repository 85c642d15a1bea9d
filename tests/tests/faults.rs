//! Weights that can't be used are dropped where they appear, counted, and spread nowhere.

use glam::{Mat4, Vec3};
use weir::{
    executor::cpu::Order,
    faults::Faults,
    packed::PackedScene,
    render::{Backend, Rendered, Stop, render, render_real_time},
    scene::{Camera, Instance, Material, Motion, Scene, builtin},
    technique::Technique,
};
use weir_tests::{
    gpu_or_skip, request,
    scenes::{cornell, quad, variety},
};

const SIZE: [u32; 2] = [16, 12];
const TIERS: [&str; 3] = ["rays=speed", "rays=balanced", "rays=quality"];

/// A still and a picture of the real-time chain of some frames, on every executor; says which it is.
fn on_each_executor(scene: &Scene, knobs: &[&str], mut check: impl FnMut(&str, &Rendered)) {
    let gpu = gpu_or_skip("faults");
    let backends = [Some(Backend::Cpu(Order::default())), gpu.as_ref().map(Backend::Gpu)];
    for backend in backends.iter().flatten() {
        for technique in [Technique::Still, Technique::RealTime] {
            let mut packed = PackedScene::new(scene, 0.0).expect("packs");
            let mut request = request(&scene.camera.expect("a camera"), SIZE, technique, knobs);
            request.stop = Stop::Samples(6);
            let rendered = if technique == Technique::Still {
                render(&packed, &request, backend, |_| true)
            } else {
                render_real_time(&mut packed, &request, backend, None, |_| true)
            };
            let executor = if matches!(backend, Backend::Cpu(_)) { "CPU" } else { "GPU" };
            check(&format!("{executor}, {technique}, {knobs:?}"), &rendered.expect("a picture"));
        }
    }
}

fn is_usable(rendered: &Rendered) -> bool {
    let usable = |channels: &[f32; 3]| channels.iter().all(|c| c.is_finite() && *c >= 0.0);
    rendered.picture.rgb.iter().all(usable) && rendered.variance.iter().all(usable)
}

#[test]
fn ordinary_scenes_drop_no_weight() {
    let rooms = (builtin::find("rooms").expect("built in").build)();
    for scene in [cornell(), variety(), rooms] {
        for tier in TIERS {
            on_each_executor(&scene, &[tier], |what, rendered| {
                assert!(is_usable(rendered), "{} {what}", scene.name);
                assert_eq!(rendered.faults, Faults::default(), "{} {what}", scene.name);
            });
        }
    }
}

/// A floor just below a large lamp: radiance times area over squared distance is beyond what a float holds.
fn under_a_lamp(radiance: f32) -> Scene {
    let lamp = Material { emission: Vec3::splat(radiance), ..Material::default() };
    let instance = |mesh| Instance { mesh, world_from_object: Mat4::IDENTITY, motion: Motion::Still };
    Scene {
        name: "under a lamp".into(),
        meshes: vec![
            quad("floor", Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 0),
            quad("lamp", Vec3::new(-2.0, 0.05, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, 1),
        ],
        instances: vec![instance(0), instance(1)],
        materials: vec![Material::default(), lamp],
        camera: Some(Camera {
            origin: Vec3::new(0.0, 0.03, 1.9),
            target: Vec3::new(0.0, 0.0, 0.5),
            up: Vec3::Y,
            vfov_deg: 20.0,
        }),
        ..Scene::default()
    }
}

#[test]
fn light_beyond_measure_is_dropped_and_counted_where_it_appears() {
    for tier in TIERS {
        on_each_executor(&under_a_lamp(1.0), &[tier], |what, rendered| {
            assert_eq!(rendered.faults, Faults::default(), "{what}");
        });
        on_each_executor(&under_a_lamp(2e38), &[tier], |what, rendered| {
            assert!(is_usable(rendered), "{what}");
            let at = |stage, kind| rendered.faults.pixels.get(&[stage, kind]).copied().unwrap_or_default();
            assert!(at("candidates", "infinite") > 10, "{what}: {}", rendered.faults);
            assert!(rendered.faults.samples >= at("candidates", "infinite"), "{what}: {}", rendered.faults);
        });
    }
}

#[test]
fn light_near_the_limits_gives_a_picture() {
    for scale in [1e-30, 1e-15, 1e15, 1e30] {
        let mut scene = cornell();
        for material in &mut scene.materials {
            material.emission *= scale;
        }
        for tier in TIERS {
            on_each_executor(&scene, &[tier], |what, rendered| {
                assert!(is_usable(rendered), "{scale:e}, {what}");
                let mean: f64 = rendered.picture.rgb.iter().flatten().map(|&c| f64::from(c)).sum();
                let share = mean / f64::from(scale) / rendered.picture.rgb.len() as f64;
                assert!((0.1..100.0).contains(&share), "{scale:e}, {what}: mean {share} times that");
            });
        }
    }
}
