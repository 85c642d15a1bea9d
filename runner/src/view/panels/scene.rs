//! Scene, camera, animation, environment.

use egui::{DragValue, Slider, Ui};

use crate::view::{
    keys::Action,
    navigation::camera_json,
    state::{Order, State},
    worker::Job,
};

/// Files and built-in scenes.
pub fn files(ui: &mut Ui, state: &mut State) {
    ui.horizontal(|ui| {
        if ui.button("Open ...").on_hover_text("Ctrl + O, or drop a file").clicked() {
            state.act(Action::Open);
        }
        if ui.button("Reload").on_hover_text("F5; a file that changes is read again by itself").clicked() {
            state.act(Action::Reload);
        }
    });
    let facts = &state.facts;
    if state.is_open {
        ui.label(format!("{}: {} triangles in {} instances", facts.name, facts.triangles, facts.instances));
        ui.label(format!("{} emissive; {:.0} MiB", facts.lights, facts.bytes as f64 / f64::from(1 << 20)));
    }
    ui.label("Built-in scenes");
    for (name, description) in State::gallery() {
        let shown = state.choice.scene == name;
        ui.horizontal(|ui| {
            super::super::gallery::preview(ui, name);
            if ui.selectable_label(shown, name).on_hover_text(description).clicked() {
                state.open(name);
            }
        });
    }
}

/// View, speed, bookmarks.
pub fn camera(ui: &mut Ui, state: &mut State) {
    ui.add(Slider::new(&mut state.rig.camera.vfov_deg, 5.0..=120.0).text("field of view, degrees"));
    ui.horizontal(|ui| {
        let label = ui.label("flight, units a second");
        let speed = DragValue::new(&mut state.rig.speed).range(1e-4..=1e6).speed(0.1);
        ui.add(speed).labelled_by(label.id);
    });
    ui.horizontal(|ui| {
        if ui.button("Frame all").clicked() {
            state.act(Action::FrameAll);
        }
        if ui.button("Reset").clicked() {
            state.act(Action::ResetCamera);
        }
        if ui.button("Save JSON").on_hover_text("what --camera reads").clicked() {
            state.save_camera();
        }
        if ui.button("Copy JSON").on_hover_text("what --camera reads").clicked() {
            state.orders.push(Order::Copy(camera_json(state.rig.camera)));
        }
    });
    ui.horizontal(|ui| {
        ui.label("bookmarks");
        for number in 1..=9_u8 {
            let stored = state.bookmarks[usize::from(number) - 1].is_some();
            let button = ui.selectable_label(stored, number.to_string());
            if button.on_hover_text("click: go there; Shift + click: store").clicked() {
                let store = ui.input(|input| input.modifiers.shift) || !stored;
                state.act(if store { Action::Store(number) } else { Action::GoTo(number) });
            }
        }
    });
}

/// The clock.
pub fn animation(ui: &mut Ui, state: &mut State) {
    if !state.facts.moves {
        ui.label("Nothing moves in this scene.");
    }
    ui.horizontal(|ui| {
        if ui.button(if state.playing { "Pause" } else { "Play" }).clicked() {
            state.act(Action::Pause);
        }
        if ui.button("Step").clicked() {
            state.act(Action::Step);
        }
    });
    ui.add(Slider::new(&mut state.speed, 0.015..=64.0).logarithmic(true).text("speed"));
    ui.horizontal(|ui| {
        let label = ui.label("time, seconds");
        ui.add(DragValue::new(&mut state.time_s).range(-1e6..=1e6).speed(0.05)).labelled_by(label.id);
    });
}

/// Light from far away.
pub fn environment(ui: &mut Ui, state: &mut State) {
    if !state.facts.environment {
        ui.label("No environment map; drop an .hdr or .exr file.");
        return;
    }
    ui.checkbox(&mut state.environment, "shines");
    ui.add(Slider::new(&mut state.environment_rotation_deg, -180.0..=180.0).text("rotation, degrees"));
    ui.add(Slider::new(&mut state.environment_scale, 0.001..=1000.0).logarithmic(true).text("scale"));
    if ui.button("Another map ...").clicked() {
        state.orders.push(Order::OpenDialog);
    }
    if state.choice.environment.is_some() && ui.button("Reload map").clicked() {
        state.jobs.extend(state.choice.environment.clone().map(Job::Environment));
    }
}
