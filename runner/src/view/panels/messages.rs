//! Messages, and the list of keys.

use egui::{Align2, Color32, Frame, Grid, RichText, ScrollArea, Ui, Window};

use crate::view::{keys, state::State};

/// Seconds that a message stays which says that something went well.
const SHORT_S: f64 = 6.0;

/// Messages above the picture, the newest last.
pub fn list(ui: &mut Ui, state: &mut State) {
    let now = ui.input(|input| input.time);
    for message in &mut state.messages {
        message.since_s.get_or_insert(now);
    }
    let age = |message: &crate::view::state::Message| now - message.since_s.unwrap_or(now);
    state.messages.retain(|message| message.is_error || age(message) < SHORT_S);
    if state.messages.is_empty() {
        return;
    }
    let mut closed = None;
    egui::Area::new(egui::Id::unique("messages")).fade_in(false).anchor(Align2::CENTER_TOP, [0.0, 36.0]).show(
        ui.ctx(),
        |ui| {
            for (i, message) in state.messages.iter().enumerate() {
                let (fill, title) = match message.is_error {
                    true => (Color32::from_rgb(110, 30, 30), "error"),
                    false => (Color32::from_rgb(30, 60, 40), "message"),
                };
                Frame::popup(ui.style()).fill(fill).show(ui, |ui| {
                    ui.set_max_width(560.0);
                    ui.label(RichText::new(&message.text).color(Color32::WHITE));
                    let close = ui.small_button("close").on_hover_text(format!("close this {title}"));
                    if close.clicked() {
                        closed = Some(i);
                    }
                });
            }
        },
    );
    if let Some(i) = closed {
        state.messages.remove(i);
    }
    if state.messages.iter().any(|message| !message.is_error) {
        // To take it away in time, without a frame of the picture.
        ui.ctx().request_repaint_after_secs(SHORT_S as f32);
    }
}

/// The list of keys.
pub fn keys(ui: &mut Ui, state: &mut State) {
    let mut open = true;
    Window::new("Keys").open(&mut open).anchor(Align2::CENTER_CENTER, [0.0, 0.0]).show(ui.ctx(), |ui| {
        ScrollArea::vertical().max_height(480.0).show(ui, |ui| {
            Grid::new("keys").striped(true).num_columns(2).show(ui, |ui| {
                for (keys, text) in keys::help() {
                    ui.strong(keys);
                    ui.label(text);
                    ui.end_row();
                }
            });
        });
    });
    state.help &= open;
}
