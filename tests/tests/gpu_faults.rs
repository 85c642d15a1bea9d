//! When the GPU fails, and what would show if a pass left something unwritten.
//!
//! `.ci/run` runs these and the tests of agreement once more under Vulkan's validation layer.

use std::sync::atomic::{AtomicBool, Ordering};

use bytemuck::cast_slice;
use weir::{
    executor::gpu::{AdapterChoice, Gpu, GpuError, GpuExecutor, Loader, Module},
    packed::{Moment, PackOptions, PackedScene},
    render::{Backend, RenderError, Request, Stop, facts_of, render},
    sequence::Sequence,
    technique::{Technique, ToneCurve, direct_light},
};
use weir_shared::tiles::Tiling;
use weir_tests::{
    gpu_or_skip, request,
    scenes::{cornell, variety},
};

const SIZE: [u32; 2] = [21, 13];

/// Every output of every pass, after three frames; what they write was filled with ones before each frame if `poisoned`.
fn outputs(gpu: &Gpu, technique: Technique, knobs: &[&str], poisoned: bool) -> Vec<(&'static str, Vec<u32>)> {
    let scene = variety();
    let mut packed = PackedScene::new(&scene, 0.0).expect("packs");
    let request: Request = request(&scene.camera.expect("a camera"), SIZE, technique, knobs);
    let facts = facts_of(&packed, SIZE[0], SIZE[1], &request.settings);
    let plan = |outputs: &[&'static str]| {
        direct_light(technique, &request.settings, &facts, ToneCurve::Agx, outputs).expect("a plan")
    };
    let names: Vec<&'static str> =
        plan(&["display"]).steps.iter().flat_map(|s| s.writes().map(|(name, _)| name).collect::<Vec<_>>()).collect();
    // As outputs, all have memory of their own.
    let plan = plan(&names);
    let mut executor =
        GpuExecutor::new(gpu, &plan, packed.buffers(), Loader::Auto, Module::Plain).expect("the plan fits");
    let mut sequence = Sequence::new(&mut packed, request.clone());
    let shot = sequence.shot(0);
    for i in 0..3 {
        let mut frames = sequence.next(&shot).expect("the same moment").0;
        frames.now.accumulated = i;
        if poisoned {
            executor.poison().expect("the GPU works");
        }
        executor.run(&frames).expect("the GPU works");
    }
    let read = |name| (name, cast_slice(executor.read(name).expect("an output").bytes()).to_vec());
    names.into_iter().map(read).collect()
}

#[test]
fn every_pass_writes_every_element_of_its_outputs() {
    let Some(gpu) = gpu_or_skip("every_pass_writes_every_element_of_its_outputs") else { return };
    for (technique, knobs) in [
        (Technique::Still, &["rays=quality", "reservoirs.count=2"] as &[&str]),
        (Technique::RealTime, &["spatial.rounds=1"]),
        (Technique::RealTime, &["rays=quality", "reuse.resolution=checkerboard"]),
        (Technique::RealTime, &["rays=speed", "reuse.mis=balance", "spatial.rounds=1"]),
    ] {
        // With tiles left out, outputs are cleared before.
        let knobs = &[knobs, &["skip.tiles=off"]].concat();
        let clean = outputs(&gpu, technique, knobs, false);
        let poisoned = outputs(&gpu, technique, knobs, true);
        for ((name, clean), (_, poisoned)) in clean.iter().zip(&poisoned) {
            let differ = clean.iter().zip(poisoned).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{technique} {knobs:?}: words of `{name}` that no pass has written");
            // The comparison has teeth: nothing is all ones by nature.
            assert!(clean.iter().any(|word| *word != u32::MAX), "`{name}`");
        }
    }
}

/// Where a tile has no work nothing is written but for outputs, and whatever is there is read by none.
#[test]
fn what_is_left_unwritten_in_tiles_without_work_is_never_read() {
    let Some(gpu) = gpu_or_skip("what_is_left_unwritten_in_tiles_without_work_is_never_read") else { return };
    let scene = cornell();
    let mut camera = scene.camera.expect("a camera");
    // Sky around the box, and walls that are settled.
    camera.origin += (camera.origin - camera.target).normalize() * 1.5;
    for (technique, knobs, size) in [
        (Technique::RealTime, &[] as &[&str], [100, 60]),
        (Technique::RealTime, &["rays=quality", "reservoirs.count=2"], [100, 60]),
        (Technique::Still, &["reservoirs.choice=inversion"], [100, 60]),
        // Tiles of four blocks.
        (Technique::Candidates, &["candidates.count=1"], [1003, 603]),
    ] {
        let tiles = Tiling::new(size[0], size[1]).count();
        let draw = |rule: &str, poisons: bool| {
            let mut request: Request = request(&camera, size, technique, knobs);
            request.settings.apply(&format!("skip.tiles={rule}")).expect("a knob");
            let options = PackOptions::of(&request.settings);
            let mut packed = PackedScene::with(&scene, &Moment::default(), options).expect("packs");
            let facts = facts_of(&packed, size[0], size[1], &request.settings);
            let outputs: &[&str] = if rule == "on" { &["moments", "tiles"] } else { &["moments"] };
            let plan = direct_light(technique, &request.settings, &facts, ToneCurve::Agx, outputs).expect("a plan");
            let mut executor =
                GpuExecutor::new(&gpu, &plan, packed.buffers(), Loader::Auto, Module::Plain).expect("the plan fits");
            let mut sequence = Sequence::new(&mut packed, request.clone());
            for number in 0..3 {
                let mut frames = sequence.next(&sequence.shot(number)).expect("a frame").0;
                if technique != Technique::RealTime {
                    frames.now.accumulated = number;
                }
                if poisons {
                    executor.poison().expect("the GPU works");
                }
                executor.run(&frames).expect("the GPU works");
            }
            let listed = executor.read("tiles").ok().map(|list| cast_slice::<u8, u32>(list.bytes())[0]);
            (executor.read("moments").expect("an output").bytes().to_vec(), listed)
        };
        let (expected, _) = draw("off", false);
        for poisons in [false, true] {
            let (picture, listed) = draw("on", poisons);
            let listed = listed.expect("an output");
            assert!((1..tiles).contains(&listed), "{technique}, {knobs:?}: {listed} tiles of {tiles}");
            assert!(picture == expected, "{technique}, {knobs:?}, {poisons}");
        }
    }
}

#[test]
fn a_device_that_is_lost_on_the_way_is_an_error_and_the_next_one_draws_the_same() {
    let name = "a_device_that_is_lost_on_the_way_is_an_error_and_the_next_one_draws_the_same";
    let Some(whole) = gpu_or_skip(name) else { return };
    let scene = variety();
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let mut request = request(&scene.camera.expect("a camera"), SIZE, Technique::Still, &["still.rounds=1"]);
    request.stop = Stop::Samples(12);
    let expected = render(&packed, &request, &Backend::Gpu(&whole), |_| true).expect("a picture").display;
    for lost_at in [1, 2, 6, 11, 12] {
        let gpu = Gpu::open(&AdapterChoice::Best).expect("the adapter is there");
        let seen = render(&packed, &request, &Backend::Gpu(&gpu), |samples| {
            if samples == lost_at {
                gpu.lose();
            }
            true
        });
        assert!(matches!(seen, Err(RenderError::Gpu(GpuError::Lost(_)))), "lost after {lost_at}: not noticed");
    }
    let fresh = Gpu::open(&AdapterChoice::Best).expect("the adapter is there");
    let again = render(&packed, &request, &Backend::Gpu(&fresh), |_| true).expect("a picture").display;
    assert_eq!(again, expected);
}

/// Whichever thread's wait answers for the other, neither loses its buffers.
#[test]
fn threads_that_share_a_device_do_not_disturb_each_other() {
    let Some(gpu) = gpu_or_skip("threads_that_share_a_device_do_not_disturb_each_other") else { return };
    let scene = variety();
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let mut request = request(&scene.camera.expect("a camera"), [4, 4], Technique::Candidates, &[]);
    request.stop = Stop::Samples(1500);
    let draw = || render(&packed, &request, &Backend::Gpu(&gpu), |_| true).map(|rendered| rendered.display);
    let expected = draw().expect("a picture");
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Answers are taken by whoever asks first.
        for _ in 0..4 {
            scope.spawn(|| {
                while !is_done.load(Ordering::Relaxed) {
                    gpu.device.poll(wgpu::PollType::Poll).expect("the device answers");
                }
            });
        }
        let seen = draw();
        is_done.store(true, Ordering::Relaxed);
        assert_eq!(seen.expect("a picture"), expected);
    });
}

/// A deliberate mistake, by which `.ci/run` knows that the validation layer is at work.
#[test]
#[ignore = "for the validation layer to complain about"]
fn a_module_that_is_no_module() {
    let Some(gpu) = gpu_or_skip("a_module_that_is_no_module") else { return };
    // A header, and OpCapability without a capability.
    let words = [0x0723_0203, 0x0001_0300, 0, 8, 0, 0x0001_0011];
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label: Some("canary"),
        entry_points: Vec::new().into(),
        spirv: Some(words[..].into()),
        ..Default::default()
    };
    // SAFETY: no pipeline is made of it.
    let _module = unsafe { gpu.device.create_shader_module_passthrough(descriptor) };
    let _ = gpu.check();
}
