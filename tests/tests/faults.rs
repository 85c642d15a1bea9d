//! Weights that can't be used are dropped where they appear, counted, and spread nowhere.

use weir::{
    executor::cpu::Order,
    faults::Faults,
    packed::PackedScene,
    render::{Backend, Rendered, Stop, render, render_real_time},
    scene::{Scene, builtin},
    technique::Technique,
};
use weir_tests::{
    gpu_or_skip, request,
    scenes::{cornell, variety},
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
                render_real_time(&mut packed, &request, backend, |_| true)
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

/// Radiance times area and BSDF is beyond what a float holds.
#[test]
fn light_beyond_measure_is_dropped_and_counted_where_it_appears() {
    let mut scene = cornell();
    for material in scene.materials.iter_mut().filter(|m| m.emission.max_element() > 0.0) {
        material.emission *= 3e38 / material.emission.max_element();
    }
    for tier in TIERS {
        on_each_executor(&scene, &[tier], |what, rendered| {
            assert!(is_usable(rendered), "{what}");
            assert!(rendered.faults.samples > 0, "{what}: nothing was counted");
            let stages: Vec<_> = rendered.faults.pixels.keys().map(|[stage, _]| *stage).collect();
            assert!(stages.contains(&"candidates"), "{what}: {}", rendered.faults);
        });
    }
}

/// The rest of the picture is what it would be without the light that is beyond measure.
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
