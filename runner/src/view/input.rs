//! Keys and the pointer on the picture.

use egui::{Event, Key, PointerButton, Sense, Ui, vec2};
use glam::{UVec2, Vec3};

use super::{
    keys::{self, Action},
    state::State,
    worker::{Job, Purpose},
};

/// Keys, dropped files and flight, unless a text field has the keyboard.
pub fn keys(ui: &Ui, state: &mut State) {
    let dropped = ui.input(|input| input.raw.dropped_files.clone());
    dropped.iter().for_each(|file| state.take_file(file.path().to_owned()));
    if ui.ctx().egui_wants_keyboard_input() {
        return;
    }
    let events = ui.input(|input| input.events.clone());
    let shift = ui.input(|input| input.modifiers.shift);
    for event in events {
        match event {
            Event::Key { key, physical_key, pressed: true, repeat: false, modifiers } => {
                if let Some(action) = keys::action(key, physical_key, modifiers) {
                    state.act(action);
                }
            }
            // What Ctrl + C arrives as.
            Event::Copy => state.act(if shift { Action::CopyCamera } else { Action::CopyCommand }),
            _ => {}
        }
    }
    fly(ui, state);
}

fn fly(ui: &Ui, state: &mut State) {
    let (flight, seconds, factor) = ui.input(|input| {
        let axis = |plus: Key, minus: Key| f32::from(input.key_down(plus)) - f32::from(input.key_down(minus));
        let flight = Vec3::new(axis(Key::D, Key::A), axis(Key::E, Key::Q), axis(Key::W, Key::S));
        let factor = match input.modifiers {
            modifiers if modifiers.command => 0.0,
            modifiers if modifiers.shift => 5.0,
            modifiers if modifiers.alt => 0.2,
            _ => 1.0,
        };
        // After a pause there is no telling how long the key was down.
        (flight, input.stable_dt.min(0.1), factor)
    });
    if flight != Vec3::ZERO && factor > 0.0 {
        state.rig.fly(flight, seconds, factor);
        ui.ctx().request_repaint();
    }
}

/// The pointer on the picture, which fills what is left of the window.
pub fn picture(ui: &mut Ui, state: &mut State) {
    let rect = ui.max_rect();
    state.place = [rect.left(), rect.top(), rect.width(), rect.height()];
    let response = ui.interact(rect, ui.scope_id().with("picture"), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Canvas, true, "picture"));
    let size = state.picture_size();
    let pixel = |position: egui::Pos2| {
        let share = (position - rect.min) / rect.size();
        UVec2::new((share.x * size[0] as f32) as u32, (share.y * size[1] as f32) as u32)
            .min(UVec2::new(size[0] - 1, size[1] - 1))
    };
    state.pointer = response.hover_pos().map(pixel);

    // A drag across the height of the picture counts as 1.
    let drag = response.drag_delta() / rect.height().max(1.0);
    let (shift, scroll) = ui.input(|input| (input.modifiers.shift, input.smooth_scroll_delta.y));
    let near_divider = |position: egui::Pos2| {
        let x = rect.left() + state.divider * rect.width();
        (position.x - x).abs() < 8.0
    };
    if response.drag_started_by(PointerButton::Primary) {
        let compares = state.compare != super::want::Compare::Off;
        let grabbed = compares && ui.input(|input| input.pointer.press_origin()).is_some_and(near_divider);
        ui.data_mut(|data| data.insert_temp(response.id, grabbed));
    } else if response.drag_stopped() {
        ui.data_mut(|data| data.insert_temp(response.id, false));
    }
    let grabs = ui.data(|data| data.get_temp::<bool>(response.id)).unwrap_or(false);
    if drag != vec2(0.0, 0.0) {
        if response.dragged_by(PointerButton::Middle) || (response.dragged_by(PointerButton::Primary) && shift) {
            state.rig.pan(drag.x, drag.y);
        } else if response.dragged_by(PointerButton::Primary) && grabs {
            let x = response.interact_pointer_pos().map_or(0.5, |p| (p.x - rect.left()) / rect.width().max(1.0));
            state.divider = x.clamp(0.0, 1.0);
        } else if response.dragged_by(PointerButton::Primary) {
            state.rig.orbit(drag.x, drag.y);
        } else if response.dragged_by(PointerButton::Secondary) {
            state.rig.look(drag.x, drag.y);
        }
    }
    if response.contains_pointer() && scroll != 0.0 {
        state.rig.dolly(scroll / 50.0);
    }
    let clicked = response.interact_pointer_pos().map(pixel);
    if let Some(px) = clicked.filter(|_| response.double_clicked()) {
        state.jobs.push(Job::Pick(px, Purpose::Focus));
    } else if let Some(px) = clicked.filter(|_| response.clicked_by(PointerButton::Primary)) {
        if state.inspecting {
            state.inspect = Some(px);
        } else {
            state.jobs.push(Job::Pick(px, Purpose::Light));
        }
    }
}
