//! The engine on the host, without a window.

use glam::Vec3;

use super::*;
use crate::{scene::builtin, settings::Preset, view::lights::Edit};

fn cornell() -> Engine {
    Engine::new((builtin::find("cornell").expect("built in").build)(), None).expect("it fits")
}

fn want(engine: &Engine) -> Want {
    Want { accumulate: true, ..Want::plain(engine.home(), [24, 18]) }
}

fn frame(engine: &mut Engine, want: &Want) -> Frames {
    engine.frame(want).expect("a frame").expect("not at rest")
}

fn pixels(shown: &Shown) -> Vec<u32> {
    match &shown.pixels {
        Pixels::Host(pixels) => pixels.to_vec(),
        Pixels::Gpu(_) => panic!("there is no GPU"),
    }
}

/// Mean radiance of the picture after so many frames of what stands still.
fn mean(engine: &mut Engine, want: &Want, frames: u32) -> Vec3 {
    for _ in 0..frames {
        engine.frame(want).expect("a frame");
    }
    let moments = engine.moments().expect("readable").expect("a picture");
    moments.iter().map(Moments::mean).sum::<Vec3>() / moments.len() as f32
}

#[test]
fn what_stands_still_is_averaged_until_its_margin_is_good_and_motion_starts_anew() {
    let mut engine = cornell();
    let mut want = Want { goal_percent: 8.0, ..want(&engine) };
    assert_eq!(frame(&mut engine, &want).technique, Technique::RealTime);
    let mut last = 0;
    let rested = (0..2000).any(|_| match engine.frame(&want).expect("a frame") {
        Some(frames) => {
            assert_eq!((frames.technique, frames.samples), (Technique::Still, last + 1));
            last = frames.samples;
            false
        }
        None => true,
    });
    assert!(rested && last >= 16, "{last} samples");
    // Exposure is how it is shown, not what it is.
    want.exposure = 2.0;
    assert!(engine.frame(&want).expect("a frame").is_none());
    want.camera.origin.x += 0.1;
    assert_eq!(frame(&mut engine, &want).technique, Technique::RealTime);
    assert_eq!(frame(&mut engine, &want).samples, 1);
}

#[test]
fn a_light_that_is_switched_off_and_on_again_is_as_it_was() {
    let mut engine = cornell();
    let still = want(&engine);
    let before = mean(&mut engine, &still, 60);
    // The lamp is at the ceiling: the light of the built-in scene is the only thing that emits.
    let px = (0..24 * 18)
        .map(|i| UVec2::new(i % 24, i / 24))
        .find(|px| engine.pick(&still, *px).is_some_and(|picked| picked.emits));
    let picked = engine.pick(&still, px.expect("the lamp is in sight")).expect("something");
    let light = engine.take_light(&picked, &still).expect("it fits").expect("a light");
    let same = mean(&mut engine, &still, 60);
    assert!((before - same).abs().max_element() < 0.05 * before.max_element(), "{before} {same}");

    let off = Want { edits: vec![Edit { on: false, ..Edit::new(light) }], ..still.clone() };
    assert_eq!(mean(&mut engine, &off, 8), Vec3::ZERO);
    let twice = Want { edits: vec![Edit { gain: 2.0, ..Edit::new(light) }], ..still.clone() };
    let doubled = mean(&mut engine, &twice, 60);
    assert!((doubled - 2.0 * before).abs().max_element() < 0.1 * before.max_element(), "{before} {doubled}");
    let moved = Want { edits: vec![Edit { offset: Vec3::new(0.0, -0.5, 0.0), ..Edit::new(light) }], ..still.clone() };
    let elsewhere = mean(&mut engine, &moved, 60);
    assert!((elsewhere - before).abs().max_element() > 0.05 * before.max_element(), "{before} {elsewhere}");
    let back = mean(&mut engine, &still, 60);
    assert!((before - back).abs().max_element() < 0.05 * before.max_element(), "{before} {back}");
}

#[test]
fn the_same_preset_beside_the_picture_is_the_same_picture() {
    let mut engine = cornell();
    let mut want = Want { compare: Compare::With(Preset::Balanced), ..want(&engine) };
    for step in 0..6 {
        // In real time with its history, then as a still.
        want.camera.origin.x += if step < 4 { 0.01 } else { 0.0 };
        let frames = frame(&mut engine, &want);
        let other = frames.other.as_ref().expect("a second picture");
        assert_eq!(pixels(&frames.shown), pixels(other), "step {step}");
    }
    want.compare = Compare::With(Preset::Fast);
    let frames = frame(&mut engine, &want);
    assert_ne!(pixels(&frames.shown), pixels(frames.other.as_ref().expect("a second picture")));
}

#[test]
fn the_reference_comes_close_to_the_still() {
    let mut engine = cornell();
    let want = Want { compare: Compare::Reference, accumulate: true, ..want(&engine) };
    let mut last = frame(&mut engine, &want);
    for _ in 0..150 {
        last = frame(&mut engine, &want);
    }
    assert!(last.reference_samples >= 150);
    let (a, b) = (pixels(&last.shown), pixels(last.other.as_ref().expect("the reference")));
    let apart: u32 = a.iter().zip(&b).map(|(a, b)| (a & 0xff).abs_diff(b & 0xff)).sum();
    assert!(apart / (a.len() as u32) < 12, "{} of 255 apart", apart / a.len() as u32);
}

#[test]
fn every_view_shows_something_in_both_techniques() {
    let mut engine = cornell();
    for view in View::ALL {
        let mut want = Want { view, ..want(&engine) };
        for accumulate in [false, true] {
            want.accumulate = accumulate;
            frame(&mut engine, &want);
            let frames = (0..3).map(|_| frame(&mut engine, &want)).last().expect("three frames");
            let shown = pixels(&frames.shown);
            let distinct: std::collections::HashSet<_> = shown.iter().collect();
            // Motion and candidates are the same all over a picture that stands still; a margin needs a still.
            let least = match view {
                View::Motion | View::Candidates => 1,
                View::Margin if !accumulate => 1,
                _ => 2,
            };
            assert!(distinct.len() >= least, "{}, accumulate {accumulate}", view.name());
            assert!(shown.iter().all(|pixel| pixel >> 24 == 0xff));
        }
    }
}

#[test]
fn a_light_is_found_and_taken_far_from_the_origin_too() {
    let mut scene = (builtin::find("cornell").expect("built in").build)();
    let size = scene.bounds().expect("it has triangles").size().max_element();
    let far = Vec3::new(1000.3, 0.1, -333.3) * size;
    scene.meshes.iter_mut().flat_map(|mesh| &mut mesh.positions).for_each(|position| *position += far);
    let camera = scene.camera.as_mut().expect("it has one");
    camera.origin += far;
    camera.target += far;
    let mut engine = Engine::new(scene, None).expect("it fits");
    let want = want(&engine);
    let mut pixels = (0..18 * 24).map(|i| UVec2::new(i % 24, i / 24));
    let lamp =
        pixels.find_map(|px| engine.pick(&want, px).filter(|picked| picked.emits)).expect("the lamp is in sight");
    assert!(engine.take_light(&lamp, &want).expect("it fits").is_some());
}

#[test]
fn added_lights_shine_and_go_away_again() {
    let mut engine = cornell();
    let lights = engine.facts().lights;
    let many = Want { scattered: 5000, ..want(&engine) };
    frame(&mut engine, &many);
    assert_eq!(engine.facts().lights, lights + 5000);
    let none = want(&engine);
    frame(&mut engine, &none);
    assert_eq!(engine.facts().lights, lights);
}

#[test]
fn a_time_budget_moves_knobs_in_real_time_and_leaves_stills_alone() {
    let mut engine = cornell();
    let mut want = Want { budget_ms: Some(0.01), ..want(&engine) };
    let mut last = None;
    for _ in 0..40 {
        want.camera.origin.x += 0.001;
        last = frame(&mut engine, &want).budget;
    }
    let facts = last.expect("a budget");
    assert!(facts.level == 0 && facts.out_of_reach, "{facts:?}");
    assert_eq!(facts.counts.frames, 40);
    assert_eq!(frame(&mut engine, &want).budget, None);
}

#[test]
fn dropped_weights_are_counted_while_the_picture_is_averaged() {
    let mut engine = cornell();
    let want = Want { goal_percent: 0.0, ..want(&engine) };
    let first = frame(&mut engine, &want);
    assert_eq!((first.technique, first.faults), (Technique::RealTime, None));
    let counted = (0..20).find_map(|_| frame(&mut engine, &want).faults);
    assert_eq!(counted, Some(Faults::default()));
}

#[test]
fn an_inspected_pixel_holds_what_its_frame_has_left_there() {
    let mut engine = cornell();
    let mut want = Want { inspect: Some(UVec2::new(12, 14)), accumulate: false, ..want(&engine) };
    want.settings.apply("skip.closed_form=off").expect("a knob");
    for _ in 0..3 {
        frame(&mut engine, &want);
    }
    let inspected = frame(&mut engine, &want).inspected.expect("a pixel");
    assert_eq!(inspected.px, UVec2::new(12, 14));
    let picked = engine.pick(&want, inspected.px).expect("a wall");
    let apart = picked.position.distance(inspected.surface.position());
    assert!(apart < 0.3, "the ray of the pixel's middle ends {apart} from its surface");
    assert!(inspected.reservoir.confidence() > 1, "three frames have been reused");
    assert_eq!(inspected.motion, Some(glam::Vec2::ZERO));
}

#[test]
fn a_scene_that_is_not_there_is_an_error() {
    let error = Engine::open(&Choice::new("no/such.obj"), None).map(|_| ()).expect_err("no scene");
    assert!(error.to_string().contains("no/such.obj"), "{error}");
}

#[test]
fn what_leaving_work_out_saves_can_be_measured_and_stopped() {
    let mut engine = cornell();
    let want = want(&engine);
    let costs = engine.costs(&want, || true).expect("frames").expect("nobody stops it");
    assert_eq!(costs.len(), crate::skips::Rule::ALL.len() + 3);
    assert!(costs.iter().all(|cost| cost.frame_ms > 0.0 && cost.frame_bytes > 0));
    let mut asked = 0;
    let stopped = engine.costs(&want, || {
        asked += 1;
        asked < 3
    });
    assert_eq!((stopped.expect("frames"), asked), (None, 3));
}
