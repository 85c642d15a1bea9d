//! Panels: functions of the state, each for one group of things.

mod budget;
mod graph;
mod inspector;
mod light;
mod messages;
mod picture;
mod sampling;
mod scene;
mod timing;

use egui::{CentralPanel, CollapsingHeader, Frame, Panel, RichText, ScrollArea, Ui};
use egui_plot::Plot;

use super::{input, state::State};
use crate::technique::Technique;

/// Width of the panel of what can be changed, in points.
const CONTROLS: f32 = 300.0;
/// Width of the panel of what is measured.
const NUMBERS: f32 = 310.0;
/// Least width of the line at the bottom.
const MARGIN: f32 = 60.0;

/// A plot of numbers from zero up over the last frames, which stays as it is whatever the pointer does.
fn frames_plot(name: &str, height: f32) -> Plot<'_> {
    Plot::new(name)
        .height(height)
        .include_y(0.0)
        .show_x(false)
        .allow_zoom(false)
        .allow_drag(false)
        .allow_scroll(false)
        .show_axes([false, true])
}

/// All of the window.
pub fn window(ui: &mut Ui, state: &mut State) {
    input::keys(ui, state);
    // A third of the window at least is for the picture.
    let width = ui.max_rect().width();
    if state.panels && width > 4.0 * MARGIN {
        Panel::bottom("status").show(ui, |ui| status(ui, state));
    }
    // Wide contents are scrolled to: a panel that grew with a number would make the picture start anew.
    if state.panels && width > 1.5 * CONTROLS {
        Panel::left("controls").default_size(CONTROLS).show(ui, |ui| {
            ScrollArea::both().auto_shrink(false).show(ui, |ui| controls(ui, state));
        });
    }
    if state.panels && width > 1.5 * (CONTROLS + NUMBERS) {
        Panel::right("numbers").default_size(NUMBERS).show(ui, |ui| {
            ScrollArea::both().auto_shrink(false).show(ui, |ui| numbers(ui, state));
        });
    }
    CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
        input::picture(ui, state);
        corner(ui, state);
    });
    messages::list(ui, state);
    if state.help {
        messages::keys(ui, state);
    }
}

/// A group that can be folded.
fn group(ui: &mut Ui, title: &str, open: bool, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(RichText::new(title).strong()).default_open(open).show(ui, contents);
}

/// What can be changed.
pub fn controls(ui: &mut Ui, state: &mut State) {
    group(ui, "Scene", true, |ui| scene::files(ui, state));
    group(ui, "Camera", false, |ui| scene::camera(ui, state));
    group(ui, "Picture", true, |ui| picture::picture(ui, state));
    group(ui, "Views and comparison", true, |ui| picture::views(ui, state));
    group(ui, "Animation", false, |ui| scene::animation(ui, state));
    group(ui, "Lights", true, |ui| light::lights(ui, state));
    group(ui, "Environment", false, |ui| scene::environment(ui, state));
    group(ui, "Sampling", true, |ui| sampling::knobs(ui, state));
    group(ui, "Output", false, |ui| picture::output(ui, state));
}

/// What is measured.
pub fn numbers(ui: &mut Ui, state: &mut State) {
    group(ui, "Time", true, |ui| timing::times(ui, state));
    group(ui, "Time budget", state.budgeted, |ui| budget::budget(ui, state));
    group(ui, "Frame graph", true, |ui| graph::graph(ui, state));
    group(ui, "Pixel inspector", state.inspecting, |ui| inspector::inspector(ui, state));
}

/// How the picture was made, in a line.
pub fn technique(state: &State) -> String {
    let Some(frames) = &state.frames else { return "no picture yet".to_owned() };
    match frames.technique {
        Technique::RealTime => "real time".to_owned(),
        Technique::Still | Technique::Candidates => {
            let error = frames.error_percent.map_or_else(String::new, |error| format!(", error {error:.2} %"));
            let rest = if state.resting { ", at rest" } else { "" };
            format!("still: {} samples{error}{rest}", frames.samples)
        }
    }
}

/// The same in the corner of the picture, where it is seen without panels.
fn corner(ui: &mut Ui, state: &State) {
    let text = match &state.busy {
        Some(busy) => format!("{busy} ..."),
        None => technique(state),
    };
    let place = ui.max_rect().left_top() + egui::vec2(8.0, 8.0);
    let font = egui::FontId::proportional(13.0);
    let galley = ui.painter().layout_no_wrap(text, font, egui::Color32::WHITE);
    let back = egui::Rect::from_min_size(place, galley.size()).expand(4.0);
    ui.painter().rect_filled(back, 3.0, egui::Color32::from_black_alpha(140));
    ui.painter().galley(place, galley, egui::Color32::WHITE);
}

fn status(ui: &mut Ui, state: &State) {
    ui.horizontal(|ui| {
        let [width, height] = state.picture_size();
        ui.label(&state.device);
        ui.separator();
        ui.label(format!("{width}x{height}"));
        ui.separator();
        ui.label(technique(state));
        ui.separator();
        ui.label(format!("{:.1} ms", state.stats.smoothed_ms()));
        ui.separator();
        ui.label("F1: keys");
    });
}

#[cfg(test)]
mod tests;
