//! What keys, files and news do to the state.

use super::*;
use crate::{settings::Preset, view::keys::Action};

fn state() -> State {
    State::new(Choice::new("cornell"), Settings::default())
}

#[test]
fn the_command_line_makes_the_same_settings_again() {
    let mut state = state();
    state.choice.scene = "a scene's file.obj".to_owned();
    for (key, value) in [("preset", "quality"), ("candidates.count", "7"), ("scene.time", "2.5")] {
        state.set_knob(key, value);
    }
    let line = state.command_line();
    assert!(line.starts_with(r"weir view 'a scene'\''s file.obj' --set "), "{line}");
    let mut again = Settings::default();
    for assignment in line.split(" --set ").skip(1) {
        again.apply(assignment).expect("a knob");
    }
    assert_eq!(again, state.settings);
}

#[test]
fn knobs_that_exclude_each_other_are_refused_with_a_message() {
    let mut state = state();
    let before = state.settings.clone();
    state.set_knob("reuse.mis", "balance");
    assert_eq!(state.settings, before);
    assert!(state.messages[0].is_error && state.messages[0].text.contains("rays=speed"));
}

#[test]
fn files_are_taken_by_their_ending_and_others_refused_in_words() {
    let mut state = state();
    state.take_file("a/b.OBJ".into());
    state.take_file("night.hdr".into());
    assert!(matches!(&state.jobs[0], Job::Open(choice) if choice.scene == "a/b.OBJ"));
    assert!(matches!(&state.jobs[1], Job::Environment(path) if path.ends_with("night.hdr")));
    state.take_file("song.mp3".into());
    state.take_file("no/such/camera.json".into());
    assert_eq!((state.jobs.len(), state.messages.len()), (2, 2));
    assert!(state.messages[0].text.contains("song.mp3"));
}

#[test]
fn keys_change_what_they_say() {
    let mut state = state();
    state.facts.moves = true;
    for action in [Action::Pause, Action::Step, Action::Store(3), Action::Help, Action::Brighter] {
        state.act(action);
    }
    assert!(!state.playing && state.time_s > 0.0 && state.help && state.exposure_ev > 0.3);
    assert_eq!(state.bookmarks[2], Some(state.rig.camera));
    state.rig.dolly(2.0);
    state.act(Action::GoTo(3));
    assert_eq!(state.bookmarks[2], Some(state.rig.camera));
    let mut seen = vec![state.compare];
    for _ in 0..6 {
        state.act(Action::Compare);
        seen.push(state.compare);
    }
    assert_eq!(seen[0], seen[6], "six comparisons come round");
    state.act(Action::Leave);
    assert!(!state.help);
}

#[test]
fn presets_go_round() {
    let mut state = state();
    let first = state.preset();
    for _ in Preset::ALL {
        state.act(Action::Preset);
    }
    assert_eq!(state.preset(), first);
}

#[test]
fn the_picture_follows_the_window_and_the_scale() {
    let mut state = state();
    assert_eq!(state.want(), None, "there is nothing to show yet");
    (state.is_open, state.place, state.pixels_per_point) = (true, [10.0, 0.0, 300.0, 200.0], 2.0);
    state.render_scale = 0.25;
    assert_eq!(state.want().map(|want| want.size), Some([150, 100]));
}

#[test]
fn a_picked_wall_is_let_go_and_a_picked_light_is_taken() {
    let mut state = state();
    let wall = Picked { position: glam::Vec3::ONE, instance: 0, corners_object: [glam::Vec3::ZERO; 3], emits: false };
    state.hear(News::Found(Some(wall), Purpose::Light));
    assert!(state.light.is_none() && state.jobs.is_empty());
    state.hear(News::Found(Some(Picked { emits: true, ..wall }), Purpose::Light));
    assert!(matches!(state.jobs[0], Job::TakeLight(_)));
    state.hear(News::LightTaken(4));
    state.hear(News::LightTaken(5));
    state.hear(News::LightTaken(4));
    assert_eq!((state.light, state.edits.len()), (Some(0), 2));
    state.hear(News::Found(Some(wall), Purpose::Focus));
    assert_eq!(state.rig.camera.target, glam::Vec3::ONE);
}
