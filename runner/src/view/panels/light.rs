//! Lights: the one that was picked, and the many that can be added.

use egui::{DragValue, Slider, Ui};
use glam::Vec3;

use crate::view::{lights, lights::Edit, state::State};

/// The picked light and the added ones.
pub fn lights(ui: &mut Ui, state: &mut State) {
    let size = state.facts.bounds.map_or(1.0, |bounds| bounds.size().length());
    match state.light.and_then(|at| state.edits.get_mut(at)) {
        None => {
            ui.label("Click a light to change it.");
        }
        Some(edit) => picked(ui, edit, size),
    }
    if !state.edits.is_empty() && ui.button("Undo all changes of lights").clicked() {
        (state.edits, state.light) = (Vec::new(), None);
    }
    ui.separator();
    // The thread adds them when the slider is let go: a million take a moment to pack.
    let id = ui.scope_id().with("added lights");
    let mut count = ui.data(|data| data.get_temp::<u32>(id)).unwrap_or(state.scattered);
    let slider = Slider::new(&mut count, 0..=lights::MOST).logarithmic(true).text("added lights");
    let response = ui.add(slider).on_hover_text("small triangles at random places; together always equally bright");
    if response.dragged() {
        ui.data_mut(|data| data.insert_temp(id, count));
    } else {
        ui.data_mut(|data| data.remove::<u32>(id));
        state.scattered = count;
    }
}

fn picked(ui: &mut Ui, edit: &mut Edit, size: f32) {
    ui.label(format!("Light of instance {}", edit.instance));
    ui.checkbox(&mut edit.on, "on");
    ui.horizontal(|ui| {
        let label = ui.label("moved by");
        for coordinate in [&mut edit.offset.x, &mut edit.offset.y, &mut edit.offset.z] {
            ui.add(DragValue::new(coordinate).speed(size * 0.002)).labelled_by(label.id);
        }
    });
    ui.add(Slider::new(&mut edit.scale, 0.05..=20.0).logarithmic(true).text("size"));
    ui.add(Slider::new(&mut edit.gain, 0.01..=100.0).logarithmic(true).text("brightness"));
    ui.horizontal(|ui| {
        let mut color = edit.color.to_array();
        let label = ui.label("colour");
        if ui.color_edit_button_rgb(&mut color).labelled_by(label.id).changed() {
            edit.color = Vec3::from(color);
        }
        if ui.button("Undo").clicked() {
            *edit = Edit::new(edit.instance);
        }
    });
}
