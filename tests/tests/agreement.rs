//! The GPU against the host: pass by pass, as whole pictures, and when the GPU fails.
//!
//! Without an adapter these tests are skipped, visibly; `REQUIRE_GPU=1` makes that a failure.

use glam::{Vec3, Vec4};
use weir::{
    crosscheck::{Check, Report, Row, check},
    executor::{
        cpu::CpuExecutor,
        gpu::{AdapterChoice, Gpu, GpuError, GpuExecutor, Loader, Module, Traced, adapters},
    },
    graph::{Facts, Plan},
    packed::{Changed, Moment, PackOptions, PackedScene},
    render::{Request, facts_of, frame_of},
    scene::{Camera, Scene},
    sequence::{Sequence, Shot},
    settings::KNOBS,
    technique::{RESOURCES, Technique, ToneCurve, direct_light, passes_with_one},
};
use weir_shader::{
    PASSES,
    wiring::{Band, Buffers, Extent, Pass},
};
use weir_shared::{
    frame::{Frame, FramePair},
    moments::Moments,
};
use weir_tests::{gpu_or_skip, own_gpu_or_skip, request, scenes, skipped};

const WIDTH: u32 = 61;
const HEIGHT: u32 = 43;

/// A packed scene, what is drawn of it, and three frames.
struct Case {
    packed: PackedScene,
    request: Request,
    facts: Facts,
    frames: Vec<FramePair>,
}

impl Case {
    fn new(scene: &Scene, technique: Technique, knobs: &[&str]) -> Self {
        let camera = scene.camera.expect("the scene has a camera");
        // Sizes that no tile divides: the guard of the entry points counts.
        let request = request(&camera, [WIDTH, HEIGHT], technique, knobs);
        let options = PackOptions::of(&request.settings);
        let mut packed = PackedScene::with(scene, &Moment::default(), options).expect("the scene fits");
        let facts = facts_of(&packed, WIDTH, HEIGHT, &request.settings);
        let mut sequence = Sequence::new(&mut packed, request.clone());
        // The scene stands still: its buffers are the same for all frames.
        let shot = sequence.shot(0);
        let frame = |i: u32| {
            let mut frames = sequence.next(&shot).expect("the first moment again").0;
            frames.now.accumulated = i;
            frames
        };
        let frames = (0..3).map(frame).collect();
        Self { packed, request, facts, frames }
    }

    fn plan(&self, outputs: &[&'static str]) -> Plan {
        let Request { technique, settings, .. } = &self.request;
        direct_light(*technique, settings, &self.facts, ToneCurve::Agx, outputs).expect("the frame has a plan")
    }

    /// Three frames, in which the camera and what can move do.
    fn check(&mut self, gpu: &Gpu, passes: &'static [Pass], loader: Loader, module: Module) -> Report {
        let Request { technique, settings, camera, .. } = self.request.clone();
        let curve = ToneCurve::Agx;
        let what = Check { passes, technique, settings: &settings, facts: &self.facts, curve, loader, module };
        let mut sequence = Sequence::new(&mut self.packed, self.request.clone());
        let shots: Vec<Shot> = (0..3u32)
            .map(|i| {
                let origin = camera.origin + camera.up * 0.02 * i as f32;
                Shot {
                    moment: Moment { time_s: 0.1 * i as f32, ..Moment::default() },
                    camera: Camera { origin, ..camera },
                }
            })
            .collect();
        let report = check(gpu, &what, &mut sequence, &shots).expect("the GPU works");
        println!("{knobs:?}\n{report}", knobs = settings.describe());
        assert_eq!(report.frames, 3);
        let [columns, rows] = settings.records(WIDTH, HEIGHT);
        let whole = |row: &Row| {
            let resource = RESOURCES.iter().find(|resource| resource.name == row.buffer).expect("it is in the table");
            row.pixels > 0 && row.pixels.is_multiple_of(3 * self.facts.elements(resource.extent))
        };
        assert!(report.rows.iter().all(whole), "{report}");
        let draws_ahead = report.rows.iter().any(|row| row.buffer == "presampled");
        assert_eq!(draws_ahead, columns * rows > 1, "{report}");
        report
    }

    fn on_gpu(&self, gpu: &Gpu, plan: &Plan, loader: Loader, module: Module) -> GpuExecutor {
        let mut executor =
            GpuExecutor::new(gpu, plan, self.packed.buffers(), loader, module).expect("the plan fits the GPU");
        for frame in &self.frames {
            executor.run(frame).expect("the GPU works");
        }
        executor
    }
}

/// The box without reuse.
fn plain_case() -> Case {
    Case::new(&scenes::cornell(), Technique::Candidates, &["candidates.count=4", "skip.closed_form=off"])
}

/// Every pass, and every knob that changes what one computes, at least once.
fn cases() -> Vec<Case> {
    let variety = scenes::variety();
    let of_variety = |technique, knobs: &[&str]| Case::new(&variety, technique, knobs);
    vec![
        plain_case(),
        Case::new(
            &scenes::cornell(),
            Technique::RealTime,
            &["rays=quality", "shade.sum=off", "rays.traversal=software"],
        ),
        Case::new(&scenes::cornell(), Technique::RealTime, &["rays=quality", "skip.closed_form=off"]),
        Case::new(&scenes::studio(), Technique::RealTime, &["rays=quality", "rays.traversal=hardware"]),
        Case::new(&scenes::studio(), Technique::Still, &["candidates.source=tiles", "skip.presampling=off"]),
        Case::new(&scenes::studio(), Technique::RealTime, &["candidates.source=cells", "candidates.count=2"]),
        Case::new(&scenes::studio(), Technique::Candidates, &["candidates.source=tree", "candidates.count=2"]),
        of_variety(Technique::Candidates, &["candidates.source=uniform", "candidates.count=2", "candidates.bsdf=0"]),
        of_variety(
            Technique::Still,
            &["rays=quality", "candidates.bsdf=1", "reuse.radius=6", "reuse.mis=pairwise", "reuse.resolution=half"],
        ),
        of_variety(Technique::RealTime, &["candidates.bsdf=1", "candidates.count=2", "target.occlusion=screen"]),
        of_variety(
            Technique::RealTime,
            &[
                "rays=quality",
                "reservoirs.count=2",
                "spatial.rounds=2",
                "reuse.rule=compatible",
                "reservoirs.choice=keys",
            ],
        ),
        of_variety(
            Technique::RealTime,
            &[
                "rays=speed",
                "reuse.mis=1/z",
                "spatial.rounds=1",
                "reuse.rule=paired",
                // One for the sky and two by the tree leave three for the table: two groups.
                "candidates.count=6",
                "candidates.tree=2",
                "candidates.full=2",
            ],
        ),
        of_variety(
            Technique::RealTime,
            &["rays=both", "reuse.mis=balance", "reuse.resolution=checkerboard", "reservoirs.choice=plain"],
        ),
        of_variety(
            Technique::Candidates,
            &[
                "candidates.source=tiles",
                "candidates.count=3",
                "candidates.tree=1",
                "tiles.count=3",
                "tiles.size=16",
                "skip.presampling=off",
            ],
        ),
        of_variety(
            Technique::Candidates,
            &[
                "candidates.source=cells",
                "candidates.count=4",
                "candidates.tree=0",
                "candidates.full=2",
                "cells.slots=3",
            ],
        ),
        of_variety(
            Technique::Candidates,
            &["candidates.source=tree", "candidates.count=2", "candidates.tree_update=refit"],
        ),
        Case::new(
            &scenes::cornell(),
            Technique::RealTime,
            &[
                "skip.absent=off",
                "skip.unread=off",
                "skip.textures=off",
                "skip.environment=off",
                "skip.instances=off",
                "skip.specular=off",
                "skip.updates=off",
                "skip.masks=off",
                "skip.emission_images=off",
                "skip.few=off",
                "skip.known=off",
                "skip.black=off",
                "skip.unlit=off",
                "skip.trees=off",
                "skip.still=off",
                "skip.primary=off",
                "skip.tiles=off",
            ],
        ),
        of_variety(
            Technique::Candidates,
            &[
                "candidates.source=cuts",
                "candidates.count=4",
                "candidates.tree=1",
                "reservoirs.choice=inversion",
                "skip.horizon=off",
            ],
        ),
        of_variety(Technique::Still, &["candidates.source=cuts", "candidates.tree=0", "cuts.size=3"]),
        of_variety(Technique::Still, &["rays=none", "reuse.mis=1/m", "still.rounds=1", "camera.jitter=off"]),
        of_variety(
            Technique::RealTime,
            &["rays=before", "reuse.mis=contribution", "reuse.resolution=half", "spatial.rounds=1"],
        ),
    ]
}

#[test]
fn every_value_of_every_named_knob_is_in_a_case() {
    let described: Vec<_> = cases().iter().map(|case| case.request.settings.describe()).collect();
    // A preset sets other knobs.
    for knob in KNOBS.iter().filter(|k| k.values.contains(" or ") && k.key != "preset") {
        // Another name for `speed`.
        for value in knob.values.split([',', ' ']).filter(|value| !["", "or", "after"].contains(value)) {
            let has_it = |set: &Vec<(&str, String)>| set.iter().any(|(k, v)| *k == knob.key && v == value);
            assert!(described.iter().any(has_it), "no case has {}={value}", knob.key);
        }
    }
}

#[test]
fn every_pass_of_the_strict_module_equals_the_host_bit_by_bit() {
    let Some(gpu) = gpu_or_skip("every_pass_of_the_strict_module_equals_the_host_bit_by_bit") else { return };
    for mut case in cases() {
        let report = case.check(&gpu, PASSES, Loader::Passthrough, Module::Strict);
        // Ray queries may find another one of equally near triangles.
        if gpu.rounds_exactly() && report.traced != Traced::Hardware {
            assert!(report.is_equal(), "{report}");
        } else {
            assert_close(&report);
        }
    }
}

/// The last bits of floats may differ, and so may choices that hang on them.
fn assert_close(report: &Report) {
    assert!(report.is_close(), "{report}");
}

#[test]
fn every_pass_of_the_plain_module_is_close_to_the_host_on_either_loader() {
    let Some(gpu) = gpu_or_skip("every_pass_of_the_plain_module_is_close_to_the_host_on_either_loader") else { return };
    for mut case in cases().into_iter().step_by(3) {
        assert_close(&case.check(&gpu, PASSES, Loader::Naga, Module::Plain));
        if gpu.has_passthrough() {
            assert_close(&case.check(&gpu, PASSES, Loader::Passthrough, Module::Plain));
        }
    }
}

const PLANTED: [u32; 2] = [5, 9];

/// `accumulate`, with the last bit of one word of one pixel turned.
fn wrong_accumulate(frames: &FramePair, band: Band, mut buffers: Buffers) {
    let frame = &frames.now;
    let color: &[Vec4] = buffers.read();
    let prev_moments: &[Moments] = buffers.read();
    let moments: &mut [Moments] = buffers.write();
    band.for_each(Extent::Pixels, frame, &[], |i, px, _| {
        moments[i] = weir_shader::accumulate::accumulate(px, frame, color, prev_moments);
        if px.to_array() == PLANTED {
            moments[i].mean[1] = f32::from_bits(moments[i].mean[1].to_bits() ^ 1);
        }
    });
}

#[test]
fn a_bit_turned_in_one_pixel_of_one_host_kernel_is_found_and_blamed_on_that_pass_alone() {
    let name = "a_bit_turned_in_one_pixel_of_one_host_kernel_is_found_and_blamed_on_that_pass_alone";
    let Some(gpu) = gpu_or_skip(name) else { return };
    let module = if gpu.rounds_exactly() { Module::Strict } else { Module::Plain };
    let report = plain_case().check(&gpu, passes_with_one("accumulate", wrong_accumulate), Loader::Auto, module);
    assert!(!report.is_equal());
    let row = report.rows.iter().find(|row| row.pass == "accumulate").expect("the pass is in the report");
    if gpu.rounds_exactly() {
        let first = row.first.expect("the difference has a place");
        assert_eq!((first.pixel, first.gpu ^ first.host, first.float), (PLANTED, 1, true));
        assert_eq!((row.differing_words, row.differing_pixels), (3, 3), "one word in each of three frames");
        assert!(report.rows.iter().all(|row| row.pass == "accumulate" || row.differing_words == 0), "{report}");
        assert!(report.to_string().contains("pass `accumulate`, `moments`: first at pixel (5, 9), frame 0, word 1"));
    } else {
        assert!(row.differing_pixels >= 3, "{report}");
    }
}

#[test]
fn pictures_of_both_executors_are_the_same_after_three_frames() {
    let Some(gpu) = gpu_or_skip("pictures_of_both_executors_are_the_same_after_three_frames") else { return };
    if !gpu.rounds_exactly() {
        skipped("pictures_of_both_executors_are_the_same_after_three_frames", &format!("`{}` rounds", gpu.facts.name));
        return;
    }
    for case in cases() {
        let plan = case.plan(&["display", "moments"]);
        let mut on_gpu = case.on_gpu(&gpu, &plan, Loader::Passthrough, Module::Strict);
        let mut on_host = CpuExecutor::new(&plan);
        for frame in &case.frames {
            on_host.run(&plan, case.packed.buffers(), frame);
        }
        for output in ["display", "moments"] {
            let picture = on_gpu.read(output).expect("the GPU works");
            assert!(picture.bytes().iter().any(|&byte| byte != 0));
            let host = on_host.output(&plan, output).expect("it is an output");
            assert!(picture.bytes() == &host[..picture.bytes().len()], "`{output}` differs");
        }
    }
}

#[test]
fn both_loaders_draw_the_same_picture() {
    let Some(gpu) = gpu_or_skip("both_loaders_draw_the_same_picture") else { return };
    if !gpu.has_passthrough() {
        skipped("both_loaders_draw_the_same_picture", &format!("no passthrough on {}", gpu.facts.backend));
        return;
    }
    for case in cases() {
        let plan = case.plan(&["moments"]);
        let [naga, direct] = [Loader::Naga, Loader::Passthrough].map(|loader| {
            let mut executor = case.on_gpu(&gpu, &plan, loader, Module::Plain);
            assert_eq!(executor.loader(), loader);
            executor.read("moments").expect("the GPU works").elements::<Moments>().to_vec()
        });
        let far = naga.iter().zip(&direct).filter(|(a, b)| {
            let [a, b] = [a.mean, b.mean];
            a.iter().zip(b).any(|(&a, b)| (a - b).abs() > 1e-3 * a.abs().max(b.abs()))
        });
        // A last bit can change which candidate is kept, or whether a ray hits.
        let far = far.count();
        assert!(far * 100 <= naga.len(), "{far} of {} pixels", naga.len());
    }
}

#[test]
fn a_moved_scene_draws_the_same_whether_it_is_updated_or_uploaded_anew() {
    let name = "a_moved_scene_draws_the_same_whether_it_is_updated_or_uploaded_anew";
    let Some(gpu) = gpu_or_skip(name) else { return };
    let mut case = Case::new(&scenes::variety(), Technique::Candidates, &[]);
    let plan = case.plan(&["display"]);
    let mut updated = case.on_gpu(&gpu, &plan, Loader::Auto, Module::Plain);
    let before = updated.read("display").expect("the GPU works");
    let changes = case.packed.set_time(1.0).expect("the transforms have inverses");
    assert!(!changes.is_empty());
    updated.update(case.packed.buffers(), &changes).expect("the ranges are in the buffers");
    for frames in &mut case.frames {
        let Frame { index, accumulated, .. } = frames.now;
        let now = Frame { index, accumulated, ..frame_of(&case.packed, &case.request) };
        *frames = FramePair { now, prev: now };
    }
    for frame in &case.frames {
        updated.run(frame).expect("the GPU works");
    }
    let after = updated.read("display").expect("the GPU works");
    let anew = case.on_gpu(&gpu, &plan, Loader::Auto, Module::Plain).read("display").expect("the GPU works");
    assert!(after.bytes() == anew.bytes());
    assert!(after.bytes() != before.bytes(), "the light has moved");

    // A word more than was uploaded.
    let beyond = case.packed.records.len() * 4;
    case.packed.records.push(0);
    let beyond = Changed { buffer: "records", range: beyond..beyond + 4 };
    let refused = updated.update(case.packed.buffers(), &[beyond]);
    assert!(matches!(refused, Err(GpuError::OutOfRange { .. })), "{refused:?}");
}

/// Copies of buffers on a GPU follow those of the host by the parts that are said to have changed, frame after frame.
#[test]
fn a_scene_in_which_some_of_it_moves_draws_the_same_whether_the_rest_is_uploaded_or_not() {
    let name = "a_scene_in_which_some_of_it_moves_draws_the_same_whether_the_rest_is_uploaded_or_not";
    let Some(gpu) = gpu_or_skip(name) else { return };
    let pictures = ["on", "off"].map(|rule| {
        let knobs = [&format!("skip.still={rule}"), "candidates.tree_update=refit"];
        let mut case = Case::new(&scenes::variety(), Technique::RealTime, &knobs);
        let plan = case.plan(&["moments"]);
        let mut executor =
            GpuExecutor::new(&gpu, &plan, case.packed.buffers(), Loader::Auto, Module::Plain).expect("the plan fits");
        let mut sequence = Sequence::new(&mut case.packed, case.request.clone());
        let mut uploaded = 0;
        let mut seen = Vec::new();
        for (time_s, emission) in [(0.0, 1.0), (0.0, 0.5), (0.1, 0.5), (0.1, 1.0), (0.1, 1.0), (0.0, 1.0), (0.3, 2.0)] {
            let emission = vec![(0, Vec3::splat(emission)), (1, Vec3::splat(emission))];
            let moment = Moment { time_s, emission, ..Moment::default() };
            let shot = Shot { moment, camera: case.request.camera };
            let (frames, changed) = sequence.next(&shot).expect("shown");
            uploaded += changed.iter().map(|part| part.range.len()).sum::<usize>();
            executor.update(sequence.packed().buffers(), &changed).expect("the ranges are in the buffers");
            executor.run(&frames).expect("the GPU works");
            seen.push(executor.read("moments").expect("an output").bytes().to_vec());
        }
        (seen, uploaded)
    });
    let [(with, fewer), (without, all)] = pictures;
    assert!(with == without);
    assert!(with[0] != with[1] && with[1] != with[2] && fewer < all, "{fewer} of {all} bytes");
}

#[test]
fn losing_the_gpu_between_frames_is_an_error_and_a_new_one_can_be_opened() {
    let name = "losing_the_gpu_between_frames_is_an_error_and_a_new_one_can_be_opened";
    let Some(gpu) = own_gpu_or_skip(name) else { return };
    let case = plain_case();
    let plan = case.plan(&["display"]);
    let mut executor = case.on_gpu(&gpu, &plan, Loader::Auto, Module::Plain);
    executor.run(&case.frames[0]).expect("the GPU still works");
    gpu.lose();
    let lost = |result: Result<(), GpuError>| matches!(result, Err(GpuError::Lost(_)));
    // The loss is known once the frames in flight are done: a frame or two later at most.
    let seen = (0..3).find_map(|_| executor.run(&case.frames[1]).err());
    assert!(matches!(seen, Some(GpuError::Lost(_))), "{seen:?}");
    assert!(lost(executor.run(&case.frames[2])), "it stays lost");
    assert!(lost(executor.read("display").map(drop)));
    let some = Changed { buffer: "records", range: 0..4 };
    assert!(lost(executor.update(case.packed.buffers(), &[some])));
    let again = GpuExecutor::new(&gpu, &plan, case.packed.buffers(), Loader::Auto, Module::Plain);
    assert!(lost(again.map(drop)));

    let fresh = Gpu::open(&AdapterChoice::Best).expect("the adapter is still there");
    case.on_gpu(&fresh, &plan, Loader::Auto, Module::Plain).read("display").expect("the new device works");
}

#[test]
fn a_buffer_that_the_gpu_cannot_bind_is_named_with_its_size_and_the_way_out() {
    let name = "a_buffer_that_the_gpu_cannot_bind_is_named_with_its_size_and_the_way_out";
    let Some(gpu) = gpu_or_skip(name) else { return };
    let case = plain_case();
    let huge = Facts { width: 32_768, height: 32_768, ..case.facts.clone() };
    let huge = Case { facts: huge, ..case };
    let plan = huge.plan(&["display"]);
    let case = huge;
    let refused = GpuExecutor::new(&gpu, &plan, case.packed.buffers(), Loader::Auto, Module::Plain);
    let message = refused.map(drop).expect_err("no GPU has so much").to_string();
    assert!(message.starts_with("`surfaces` of 32768x32768 pixels needs 51540 MB in one buffer, `"), "{message}");
    assert!(message.ends_with("; render at a smaller size or use --backend cpu"), "{message}");
}

#[test]
fn frames_of_another_size_and_outputs_nobody_asked_for_are_refused() {
    let Some(gpu) = gpu_or_skip("frames_of_another_size_and_outputs_nobody_asked_for_are_refused") else { return };
    let case = plain_case();
    let plan = case.plan(&["display"]);
    let buffers = case.packed.buffers();
    let mut executor =
        GpuExecutor::new(&gpu, &plan, buffers, Loader::Auto, Module::Plain).expect("the plan fits the GPU");
    let early = executor.read("display").map(drop);
    assert!(matches!(early, Err(GpuError::NoOutput(_))), "{early:?}");
    let mut wider = case.frames[0];
    wider.now.width += 1;
    let wider = executor.run(&wider);
    assert!(matches!(wider, Err(GpuError::FrameSize { .. })), "{wider:?}");
    executor.run(&case.frames[0]).expect("the GPU works");
    let unasked = executor.read("color").map(drop);
    assert!(matches!(unasked, Err(GpuError::NoOutput(_))), "{unasked:?}");
}

#[test]
fn every_pass_has_a_time_where_the_gpu_has_a_clock() {
    let Some(gpu) = gpu_or_skip("every_pass_has_a_time_where_the_gpu_has_a_clock") else { return };
    if !gpu.facts.timestamps {
        skipped("every_pass_has_a_time_where_the_gpu_has_a_clock", &format!("`{}` has none", gpu.facts.name));
        return;
    }
    let case = plain_case();
    let plan = case.plan(&["display"]);
    let mut executor = case.on_gpu(&gpu, &plan, Loader::Auto, Module::Plain);
    executor.finish().expect("the GPU works");
    let names: Vec<_> = executor.last_times().iter().map(|(name, _)| *name).collect();
    assert_eq!(names, plan.pass_names());
    assert!(executor.last_times().iter().any(|(_, time)| !time.is_zero()));
}

#[test]
fn an_adapter_that_is_not_there_is_named_beside_those_that_are() {
    let Some(gpu) = gpu_or_skip("an_adapter_that_is_not_there_is_named_beside_those_that_are") else { return };
    let absent = Gpu::open(&AdapterChoice::Name("no such adapter".into())).map(drop);
    let message = absent.expect_err("nobody calls it that").to_string();
    assert!(message.starts_with("no adapter matches `no such adapter`; there is "), "{message}");
    assert!(message.contains(&gpu.facts.name), "{message}");
    let first = Gpu::open(&AdapterChoice::Name(gpu.facts.name.to_uppercase())).expect("names match in any case");
    assert_eq!(first.facts, gpu.facts);
    assert!(adapters().contains(&gpu.facts), "the list of adapters holds it");
}
