//! Panels without a window: driven by their accessible names and by the keyboard.

use std::sync::Arc;

use egui::{Key, Modifiers, PointerButton, accesskit::Role, pos2};
use egui_kittest::{
    Harness,
    kittest::{NodeT, Queryable},
};
use glam::{UVec2, Vec3};

use super::*;
use crate::{
    scene::{builtin, choice::Choice},
    settings::Settings,
    skips::{Cost, Skips},
    view::{
        buffers::View,
        engine::Engine,
        lights::Edit,
        want::Compare,
        worker::{Job, Purpose},
    },
};

/// A state with everything in it that panels show.
fn full() -> State {
    let mut state = State::new(Choice::new("cornell"), Settings::default());
    let scene = (builtin::find("cornell").expect("built in").build)();
    let mut engine = Engine::new(scene, None).expect("it fits");
    state.hear(crate::view::worker::News::Opened {
        facts: engine.facts().clone(),
        home: engine.home(),
        warnings: Vec::new(),
        choice: state.choice.clone(),
    });
    state.messages.clear();
    (state.inspecting, state.inspect) = (true, Some(UVec2::new(3, 4)));
    (state.budgeted, state.place) = (true, [0.0, 0.0, 16.0, 9.0]);
    state.facts.moves = true;
    state.facts.environment = true;
    let want = state.want().expect("a place");
    let frames = engine.frame(&want).expect("a frame").expect("not at rest");
    state.stats.add(std::time::Duration::from_millis(20), &frames.times);
    state.frames = Some(Arc::new(frames));
    state.edits = vec![Edit::new(0)];
    state.light = Some(0);
    state
}

fn harness(state: State) -> Harness<'static, State> {
    let builder = Harness::builder().with_size(egui::vec2(1400.0, 900.0)).with_accessibility_check(true);
    let mut harness = builder.build_ui_state(|ui, state: &mut State| window(ui, state), state);
    harness.run_ok();
    harness
}

/// A harness of one column in which every group is open.
fn column(contents: fn(&mut Ui, &mut State)) -> Harness<'static, State> {
    let builder = Harness::builder().with_size(egui::vec2(420.0, 4000.0)).with_accessibility_check(true);
    let mut harness = builder.build_ui_state(
        move |ui, state: &mut State| {
            contents(ui, state);
        },
        full(),
    );
    harness.run_ok();
    // Groups that start folded; the others of this state start open.
    for title in ["Camera", "Animation", "Environment", "Output"] {
        if let Some(header) = harness.query_by_label(title) {
            header.click();
        }
        harness.run_ok();
    }
    harness
}

#[test]
fn every_widget_of_every_panel_has_a_name() {
    for contents in [controls as fn(&mut Ui, &mut State), numbers] {
        let harness = column(contents);
        let roles = [Role::Button, Role::CheckBox, Role::ComboBox, Role::Slider, Role::SpinButton];
        let mut count = 0;
        for role in roles {
            for node in harness.query_all_by_role(role) {
                let node = node.accesskit_node();
                let named = node.label().is_some_and(|label| !label.is_empty()) || node.labelled_by().next().is_some();
                assert!(named, "a widget without a name: {role:?} {:?}", node.value());
                count += 1;
            }
        }
        assert!(count > 3, "{count} widgets");
    }
}

#[test]
fn every_knob_is_in_the_panel_and_a_click_resets_one() {
    let mut harness = column(controls);
    for knob in crate::settings::KNOBS {
        assert!(harness.query_all_by_label(knob.key).next().is_some(), "{} is not there", knob.key);
    }
    harness.state_mut().set_knob("spatial.rounds", "3");
    harness.run_ok();
    harness.get_by_label("reset").click();
    harness.run_ok();
    assert_eq!(harness.state().settings, Settings::default());
}

#[test]
fn buttons_do_what_their_names_say() {
    let mut harness = column(controls);
    harness.get_by_label("Pause").click();
    harness.run_ok();
    assert!(!harness.state().playing);
    harness.get_by_label("rooms").click();
    harness.get_by_label("Copy command line").click();
    harness.run_ok();
    let state = harness.state();
    assert!(matches!(&state.jobs[0], Job::Open(choice) if choice.scene == "rooms"));
    let copies = |order: &crate::view::state::Order| matches!(order, crate::view::state::Order::Copy(text) if text.starts_with("weir view cornell"));
    assert!(state.orders.iter().any(copies), "{:?}", state.orders);
}

#[test]
fn the_numbers_show_the_schedule_what_was_left_out_and_the_inspected_pixel() {
    let harness = column(numbers);
    assert!(harness.query_by_label("frame graph").is_some());
    let frames = harness.state().frames.clone().expect("a frame");
    for (pass, why) in &frames.schedule.left_out {
        assert!(harness.query_by_label(&format!("{pass}: left out, {why}")).is_some(), "{pass}");
    }
    for name in ["position", "confidence", "radiance", "holds"] {
        assert!(harness.query_by_label(name).is_some(), "{name}");
    }
}

#[test]
fn what_leaving_work_out_saves_is_measured_when_asked_and_shown() {
    let mut harness = column(numbers);
    assert!(harness.query_by_label("all off").is_none());
    harness.get_by_label("Measure what that saves").click();
    harness.run_ok();
    assert!(harness.state().jobs.iter().any(|job| matches!(job, Job::Measure)));
    let cost = |skips, frame_ms| Cost {
        skips,
        pack_ms: 1.0,
        frame_ms,
        frame_bytes: 3 << 20,
        scene_bytes: 1 << 19,
        different: None,
    };
    let costs = vec![cost(Skips::none(), 12.5), cost(Skips::default(), 4.25)];
    let settings = Box::new(harness.state().settings.clone());
    harness.state_mut().hear(crate::view::worker::News::Measured { settings, costs });
    harness.run_ok();
    for text in ["all off", "12.50", "all on", "4.25"] {
        assert!(harness.query_by_label(text).is_some(), "{text}");
    }
    harness.state_mut().settings.candidates += 1;
    harness.run_ok();
    assert!(harness.query_by_label("it was measured with other knobs").is_some());
    harness.state_mut().settings.candidates -= 1;
    let facts = harness.state().facts.clone();
    harness.state_mut().hear(crate::view::worker::News::Changed(facts));
    harness.run_ok();
    assert!(harness.query_by_label("all off").is_none(), "they were of another scene");
}

#[test]
fn keys_work_without_a_pointer() {
    let mut harness = harness(full());
    assert!(harness.query_by_label("Keys").is_none());
    harness.key_press(Key::F1);
    harness.run_ok();
    assert!(harness.query_by_label("Keys").is_some() && harness.query_by_label("orbit around the target").is_some());
    harness.key_press(Key::Escape);
    harness.key_press(Key::F2);
    harness.key_press_modifiers(Modifiers::SHIFT, Key::Num4);
    harness.key_press(Key::N);
    harness.run_ok();
    let state = harness.state();
    assert!(!state.help && !state.panels && state.view == View::Normals && state.bookmarks[3].is_some());
}

#[test]
fn the_pointer_on_the_picture_moves_the_camera_and_picks() {
    let mut state = full();
    (state.panels, state.inspecting) = (false, false);
    let mut harness = harness(state);
    let before = harness.state().rig.camera;
    let (start, end) = (pos2(600.0, 400.0), pos2(700.0, 450.0));
    harness.drag_at(start);
    harness.run_ok();
    harness.hover_at(end);
    harness.run_ok();
    harness.drop_at(end);
    harness.run_ok();
    let after = harness.state().rig.camera;
    assert!(after.origin != before.origin && after.target == before.target, "a drag orbits");
    for pressed in [true, false] {
        harness.event(egui::Event::PointerMoved(start));
        harness.event(egui::Event::PointerButton {
            pos: start,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        });
        // A click is short.
        harness.step();
    }
    assert!(harness.state().jobs.iter().any(|job| matches!(job, Job::Pick(_, Purpose::Light))));
}

#[test]
fn the_divider_of_a_comparison_follows_the_pointer_and_the_camera_does_not() {
    let mut state = full();
    (state.panels, state.compare) = (false, Compare::Reference);
    let mut harness = harness(state);
    let before = harness.state().rig.camera;
    harness.drag_at(pos2(700.0, 400.0));
    harness.run_ok();
    harness.hover_at(pos2(350.0, 420.0));
    harness.run_ok();
    harness.drop_at(pos2(350.0, 420.0));
    harness.run_ok();
    let state = harness.state();
    assert!((state.divider - 0.25).abs() < 0.02, "{}", state.divider);
    assert_eq!(state.rig.camera, before);
}

#[test]
fn flight_goes_on_while_a_key_is_down() {
    let mut harness = harness(full());
    let before = harness.state().rig.camera;
    harness.key_down(Key::W);
    harness.run_steps(5);
    harness.key_up(Key::W);
    harness.run_ok();
    let after = harness.state().rig.camera;
    let forward = (before.target - before.origin).normalize();
    assert!((after.origin - before.origin).dot(forward) > 0.0);
    assert!((after.target - before.target - (after.origin - before.origin)).abs().max_element() < 1e-3);
    assert_ne!(after.origin, Vec3::ZERO);
}

#[test]
fn errors_stay_until_they_are_closed() {
    let mut state = full();
    state.fail("something is wrong with a file");
    let mut harness = harness(state);
    assert!(harness.query_by_label("something is wrong with a file").is_some());
    harness.get_by_label("close").click();
    harness.run_ok();
    assert!(harness.state().messages.is_empty());
}
