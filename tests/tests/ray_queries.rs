//! Rays by the driver's ray queries against rays in software: the same hits up to ties, the same pictures, and no bias.
//!
//! Where the adapter has no ray queries these tests are skipped, visibly; `REQUIRE_RAY_QUERIES=1` makes that a failure.

use weir::{
    crosscheck::{Check, Report, check},
    executor::{
        MeshRange, Placement, SceneBuffers,
        gpu::{Gpu, GpuExecutor, Loader, Module, RayLimits, Traced, Traversal},
    },
    packed::{Moment, PackOptions, PackedScene},
    render::{Backend, Rendered, Request, Stop, facts_of, frame_of, render, render_reference},
    scene::{Camera, Scene, builtin},
    sequence::{Sequence, Shot},
    technique::{Technique, ToneCurve, direct_light},
};
use weir_shader::PASSES;
use weir_shared::{frame::FramePair, surface::Surface};
use weir_tests::{gpu_or_skip, request, scenes, skipped};

const HARDWARE: &str = "rays.traversal=hardware";
const SOFTWARE: &str = "rays.traversal=software";

/// Largest share of rays that may find another triangle: one of several at the same distance, or the neighbour at an edge.
const MOST_TIES: f64 = 0.002;

/// A GPU with ray queries; without one, says so and returns nothing.
fn queries_or_skip(test: &str) -> Option<Gpu> {
    let gpu = gpu_or_skip(test)?;
    match gpu.facts.traced(Traversal::Hardware) {
        Traced::Hardware => Some(gpu),
        traced if std::env::var("REQUIRE_RAY_QUERIES").is_ok_and(|v| v == "1") => panic!("{test}: rays {traced}"),
        traced => {
            skipped(test, &format!("rays {traced}"));
            None
        }
    }
}

/// A built-in scene.
fn built_in(name: &str) -> Scene {
    (builtin::find(name).expect("built in").build)()
}

/// A scene whose first mesh no ray finds, so that those after it don't start where the buffer does.
fn first_unseen(mut scene: Scene) -> Scene {
    scene.meshes[0].unseen = true;
    scene
}

/// What camera rays find, in each of three frames of a moving scene.
fn found(gpu: &Gpu, scene: &Scene, size: [u32; 2], traversal: &str) -> Vec<Vec<Surface>> {
    let camera = scene.camera.expect("the scene has a camera");
    let request = request(&camera, size, Technique::RealTime, &[traversal]);
    let mut packed = PackedScene::with(scene, &Moment::default(), PackOptions::of(&request.settings)).expect("packs");
    let facts = facts_of(&packed, size[0], size[1], &request.settings);
    let plan = direct_light(Technique::RealTime, &request.settings, &facts, ToneCurve::Agx, &["surfaces"]);
    let plan = plan.expect("the frame has a plan");
    let mut executor =
        GpuExecutor::new(gpu, &plan, packed.buffers(), Loader::Passthrough, Module::Strict).expect("the plan fits");
    assert_eq!(*executor.traced() == Traced::Hardware, traversal == HARDWARE, "rays {}", executor.traced());
    let mut sequence = Sequence::new(&mut packed, request);
    let shot = |i: u32| Shot { moment: Moment { time_s: 0.4 * i as f32, ..Moment::default() }, camera };
    let of_frame = |i| {
        let (frames, changed) = sequence.next(&shot(i)).expect("the shot can be shown");
        executor.update(sequence.packed().buffers(), &changed).expect("the GPU works");
        executor.run(&frames).expect("the GPU works");
        executor.read("surfaces").expect("the GPU works").elements().to_vec()
    };
    (0..3).map(of_frame).collect()
}

#[test]
fn queries_find_what_software_finds_up_to_ties() {
    let Some(gpu) = queries_or_skip("queries_find_what_software_finds_up_to_ties") else { return };
    for (name, scene) in [
        ("cornell", built_in("cornell")),
        ("rooms", built_in("rooms")),
        ("park", built_in("park")),
        ("studio", built_in("studio")),
        // Masks, instances that move, mirrored ones.
        ("variety", scenes::variety()),
        ("variety, its first mesh unseen", first_unseen(scenes::variety())),
    ] {
        let [by_query, in_software] = [HARDWARE, SOFTWARE].map(|traversal| found(&gpu, &scene, [96, 64], traversal));
        for (frame, (by_query, in_software)) in by_query.iter().zip(&in_software).enumerate() {
            let origin = scene.camera.expect("there is one").origin;
            let (mut ties, mut others) = (0, Vec::new());
            for (i, (a, b)) in by_query.iter().zip(in_software).enumerate() {
                if bytemuck::bytes_of(a) == bytemuck::bytes_of(b) {
                    continue;
                }
                let [near, far] = [a, b].map(|surface| (surface.position() - origin).length());
                ties += 1;
                if a.is_sky() || b.is_sky() || (near - far).abs() > 1e-4 * far {
                    others.push((i, near, far));
                }
            }
            let rays = by_query.len();
            println!("{name}, frame {frame}: {ties} of {rays} rays differ, {} not in distance alone", others.len());
            assert!(f64::from(ties) <= MOST_TIES * rays as f64, "{name}: {ties} of {rays} rays differ");
            assert!(others.len() <= 1, "{name}: pixel, distance by query, distance in software: {others:?}");
            let hits = in_software.iter().filter(|surface| !surface.is_sky()).count();
            assert!(hits * 10 > rays, "{name}: {hits} hits are too few to compare");
        }
    }
}

/// Three frames by queries, in which the camera and what can move do, with every pass against the host's.
fn checked(gpu: &Gpu, scene: &Scene, technique: Technique, knobs: &[&str]) -> Report {
    const SIZE: [u32; 2] = [32, 24];
    let camera = scene.camera.expect("the scene has a camera");
    let request = request(&camera, SIZE, technique, &[knobs, &[HARDWARE]].concat());
    let mut packed = PackedScene::with(scene, &Moment::default(), PackOptions::of(&request.settings)).expect("packs");
    let facts = facts_of(&packed, SIZE[0], SIZE[1], &request.settings);
    let settings = request.settings.clone();
    let what = Check {
        passes: PASSES,
        technique,
        settings: &settings,
        facts: &facts,
        curve: ToneCurve::Agx,
        loader: Loader::Passthrough,
        module: Module::Strict,
    };
    let shot = |i: u32| Shot {
        moment: Moment { time_s: 0.1 * i as f32, ..Moment::default() },
        camera: Camera { origin: camera.origin + camera.up * 0.02 * i as f32, ..camera },
    };
    let shots: Vec<_> = (0..3).map(shot).collect();
    let report = check(gpu, &what, &mut Sequence::new(&mut packed, request), &shots).expect("the GPU works");
    println!("{knobs:?}\n{report}");
    report
}

#[test]
fn every_pass_that_traces_rays_agrees_with_the_host_up_to_ties() {
    let Some(gpu) = queries_or_skip("every_pass_that_traces_rays_agrees_with_the_host_up_to_ties") else { return };
    let traces = |name: &str| {
        let pass = PASSES.iter().find(|pass| pass.name == name).expect("in the table");
        pass.bindings.iter().any(|binding| binding.name == "bvh")
    };
    let mut traced = std::collections::BTreeSet::new();
    for (scene, technique, knobs) in [
        (scenes::variety(), Technique::RealTime, &["rays=quality", "candidates.bsdf=1"] as &[&str]),
        (scenes::variety(), Technique::Still, &["rays=balanced", "candidates.bsdf=1"]),
        (scenes::cornell(), Technique::RealTime, &["rays=quality", "candidates.bsdf=1", "skip.closed_form=off"]),
        (scenes::studio(), Technique::RealTime, &["rays=balanced"]),
        // Rays that start where triangles meet, on llvmpipe at least.
        (scenes::cornell(), Technique::Still, &["rays=balanced", "candidates.bsdf=1", "camera.jitter=off"]),
    ] {
        for row in checked(&gpu, &scene, technique, knobs).rows {
            if traces(row.pass) {
                traced.insert(row.pass);
                let share = row.differing_pixels as f64 / row.pixels as f64;
                assert!(share <= MOST_TIES, "{}: {share} of pixels differ", row.pass);
            } else if gpu.rounds_exactly() {
                assert_eq!(row.differing_words, 0, "{} traces no rays", row.pass);
            }
        }
    }
    let all = PASSES.iter().map(|pass| pass.name).filter(|name| traces(name)).collect();
    assert_eq!(traced, all, "every pass that traces rays is in a case");
}

/// A still through the middle of pixels, so that the noise is that of light alone.
fn still_request(scene: &Scene, seed: u32, samples: u32, traversal: &str) -> Request {
    let camera = scene.camera.expect("the scene has a camera");
    let one = request(&camera, [32, 24], Technique::Still, &["rays=balanced", "camera.jitter=off", traversal]);
    Request { seed, stop: Stop::Samples(samples), curve: ToneCurve::Clip, ..one }
}

fn still(gpu: &Gpu, scene: &Scene, samples: u32, traversal: &str) -> Rendered {
    let request = still_request(scene, 7, samples, traversal);
    let packed = PackedScene::with(scene, &Moment::default(), PackOptions::of(&request.settings)).expect("packs");
    render(&packed, &request, &Backend::Gpu(gpu), |_| true).expect("renders")
}

/// Nothing else than the acceleration structures says what is there: without instances in them, every ray goes to the sky.
#[test]
fn rays_meet_what_the_acceleration_structures_hold() {
    let Some(gpu) = queries_or_skip("rays_meet_what_the_acceleration_structures_hold") else { return };
    let scene = scenes::cornell();
    let request = request(&scene.camera.expect("there is one"), [16, 16], Technique::Candidates, &[HARDWARE]);
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let facts = facts_of(&packed, 16, 16, &request.settings);
    let plan = direct_light(Technique::Candidates, &request.settings, &facts, ToneCurve::Agx, &["surfaces"]);
    let plan = plan.expect("the frame has a plan");
    let frame = frame_of(&packed, &request);
    let hits = |buffers: SceneBuffers<'_>| {
        let mut executor =
            GpuExecutor::new(&gpu, &plan, buffers, Loader::Passthrough, Module::Plain).expect("the plan fits");
        executor.run(&FramePair { now: frame, prev: frame }).expect("the GPU works");
        let surfaces = executor.read("surfaces").expect("the GPU works");
        surfaces.elements::<Surface>().iter().filter(|surface| !surface.is_sky()).count()
    };
    let buffers = packed.buffers();
    assert!(hits(buffers) > 128);
    let bare = Placement { blocks: [[0; 2]; 2], ..buffers.placement };
    assert_eq!(hits(SceneBuffers { placement: bare, ..buffers }), 0);
}

/// Mean and variance of the mean of what independent pictures sum up to. Pixels and channels of one are not independent.
fn mean_of(totals: impl Iterator<Item = Rendered>) -> (f64, f64) {
    let sum = |drawn: Rendered| drawn.picture.rgb.iter().flatten().map(|x| f64::from(*x)).sum::<f64>();
    let totals: Vec<f64> = totals.map(sum).collect();
    let n = totals.len() as f64;
    let mean = totals.iter().sum::<f64>() / n;
    (mean, totals.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / (n - 1.0) / n)
}

/// Against the reference integrator, which traces on the host; and lights brighter by 1 % are seen.
#[test]
fn stills_by_queries_have_the_mean_of_the_reference() {
    /// Student's t with 15 degrees of freedom is beyond it once in 10,000 times.
    const BOUND: f64 = 5.2;
    let Some(gpu) = queries_or_skip("stills_by_queries_have_the_mean_of_the_reference") else { return };
    for (name, scene) in [("cornell", scenes::cornell()), ("variety", scenes::variety())] {
        let packed = PackedScene::new(&scene, 0.0).expect("packs");
        let judged = (0..16).map(|seed| {
            let request = Request { technique: Technique::Candidates, ..still_request(&scene, seed, 512, SOFTWARE) };
            render_reference(&packed, &request, |_| true).expect("renders")
        });
        let judge = mean_of(judged);
        let t_of = |scene: &Scene| {
            let drawn = mean_of((0..16).map(|seed| {
                let request = still_request(scene, seed, 128, HARDWARE);
                let options = PackOptions::of(&request.settings);
                let packed = PackedScene::with(scene, &Moment::default(), options).expect("packs");
                render(&packed, &request, &Backend::Gpu(&gpu), |_| true).expect("renders")
            }));
            (drawn.0 - judge.0) / (drawn.1 + judge.1).sqrt()
        };
        let mut brighter = scene.clone();
        brighter.materials.iter_mut().for_each(|m| m.emission *= 1.01);
        if let Some(map) = &mut brighter.environment {
            map.scale *= 1.01;
        }
        let (t, t_brighter) = (t_of(&scene), t_of(&brighter));
        println!("{name}: t = {t:.2}, brighter by 1 %: {t_brighter:.2}");
        assert!(t.abs() < BOUND, "{name}: t = {t:.1}");
        assert!(t_brighter > BOUND, "{name}: 1 % more light went unnoticed: t = {t_brighter:.1}");
    }
}

/// Where a scene is too large for the adapter, or has no queries, software goes on, and draws what it always draws.
#[test]
fn what_ray_queries_cannot_take_is_traced_in_software() {
    let name = "what_ray_queries_cannot_take_is_traced_in_software";
    let Some(gpu) = gpu_or_skip(name) else { return };
    let scene = scenes::cornell();
    let expected = still(&gpu, &scene, 2, SOFTWARE);
    let roomy = RayLimits { triangles: u32::MAX, instances: u32::MAX };
    for (limits, why) in [
        (Err("none here"), "none here"),
        (Ok(RayLimits { triangles: 5, ..roomy }), "triangles, and the adapter takes 5"),
        (Ok(RayLimits { instances: 0, ..roomy }), "ray queries take 0"),
    ] {
        let mut small = gpu.clone();
        // Without any, there is nothing to exceed.
        small.facts.ray_queries = if gpu.facts.ray_queries.is_err() { Err("none here") } else { limits };
        let camera = scene.camera.expect("there is one");
        let request = request(&camera, [8, 8], Technique::Still, &[HARDWARE]);
        let packed = PackedScene::new(&scene, 0.0).expect("packs");
        let facts = facts_of(&packed, 8, 8, &request.settings);
        let plan = direct_light(Technique::Still, &request.settings, &facts, ToneCurve::Agx, &["display"]);
        let plan = plan.expect("the frame has a plan");
        let executor = GpuExecutor::new(&small, &plan, packed.buffers(), Loader::Auto, Module::Plain).expect("it fits");
        let Traced::Software(reason) = executor.traced() else { panic!("{why}: traced {}", executor.traced()) };
        assert!(gpu.facts.ray_queries.is_err() || reason.contains(why), "{reason}");
        assert_eq!(still(&small, &scene, 2, HARDWARE).display, expected.display, "{why}");
    }
    // And where the driver refuses: here, triangles that are not in the buffer.
    if gpu.facts.traced(Traversal::Hardware) == Traced::Hardware {
        let packed = PackedScene::new(&scene, 0.0).expect("packs");
        let request = request(&scene.camera.expect("there is one"), [8, 8], Technique::Still, &[HARDWARE]);
        let facts = facts_of(&packed, 8, 8, &request.settings);
        let plan = direct_light(Technique::Still, &request.settings, &facts, ToneCurve::Agx, &["display"]);
        let plan = plan.expect("the frame has a plan");
        let buffers = packed.buffers();
        let meshes = buffers.placement.meshes.iter().map(|mesh| MeshRange { first: mesh.first + 10_000, ..*mesh });
        let meshes: Vec<_> = meshes.collect();
        let buffers = SceneBuffers { placement: Placement { meshes: &meshes, ..buffers.placement }, ..buffers };
        let executor = GpuExecutor::new(&gpu, &plan, buffers, Loader::Auto, Module::Plain).expect("software goes on");
        let Traced::Software(reason) = executor.traced() else { panic!("traced {}", executor.traced()) };
        assert!(reason.contains("builds no acceleration structures"), "{reason}");
    }
}
