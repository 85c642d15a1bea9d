//! The picture: scale, exposure, accumulation; views, comparison; files.

use egui::{ComboBox, Slider, Ui};

use crate::{
    settings::Preset,
    technique::ToneCurve,
    view::{
        buffers::View,
        keys::Action,
        state::{Order, State},
        want::Compare,
    },
};

const CURVES: [(ToneCurve, &str); 4] =
    [(ToneCurve::Agx, "AgX"), (ToneCurve::Aces, "ACES"), (ToneCurve::Reinhard, "Reinhard"), (ToneCurve::Clip, "clip")];

/// How the picture is made and shown.
pub fn picture(ui: &mut Ui, state: &mut State) {
    ui.add(Slider::new(&mut state.render_scale, 0.1..=2.0).logarithmic(true).text("render scale"))
        .on_hover_text("pixels of the picture to one of the window, in each direction");
    ui.checkbox(&mut state.smooth, "blend between pixels");
    ui.checkbox(&mut state.vsync, "wait for the screen");
    ui.separator();
    let named = |curve: ToneCurve| CURVES.iter().find(|(c, _)| *c == curve).map_or("", |(_, name)| *name);
    ComboBox::from_label("tone curve").selected_text(named(state.curve)).show_ui(ui, |ui| {
        for (curve, name) in CURVES {
            ui.selectable_value(&mut state.curve, curve, name);
        }
    });
    ui.checkbox(&mut state.auto_exposure, "exposure by the picture");
    ui.add(Slider::new(&mut state.exposure_ev, -20.0..=20.0).text("exposure, stops"));
    ui.separator();
    ui.checkbox(&mut state.accumulate, "average while nothing moves")
        .on_hover_text("independent frames, without reuse over time, until the error is small enough");
    ui.add(Slider::new(&mut state.goal_percent, 0.05..=20.0).logarithmic(true).text("error to stop at, %"));
}

/// Which buffer, and with what the picture is compared.
pub fn views(ui: &mut Ui, state: &mut State) {
    ComboBox::from_label("view").selected_text(state.view.name()).height(320.0).show_ui(ui, |ui| {
        for view in View::ALL {
            ui.selectable_value(&mut state.view, view, view.name()).on_hover_text(view.legend());
        }
    });
    if state.view != View::Picture {
        ui.label(state.view.legend());
    }
    let name = |compare: Compare| match compare {
        Compare::Off => "nothing".to_owned(),
        Compare::With(preset) => format!("preset {}", preset.name()),
        Compare::Reference => "the reference".to_owned(),
    };
    ComboBox::from_label("compare with").selected_text(name(state.compare)).show_ui(ui, |ui| {
        let presets = Preset::ALL.into_iter().map(Compare::With);
        for compare in std::iter::once(Compare::Off).chain(presets).chain([Compare::Reference]) {
            ui.selectable_value(&mut state.compare, compare, name(compare));
        }
    });
    if state.compare != Compare::Off {
        ui.add(Slider::new(&mut state.divider, 0.0..=1.0).text("divider"));
    }
    if state.compare == Compare::Reference || state.view == View::Error {
        let samples = state.frames.as_ref().map_or(0, |frames| frames.reference_samples);
        ui.label(format!("reference: {samples} samples of a path tracer on the CPU"));
    }
    ui.checkbox(&mut state.inspecting, "inspect a pixel with a click");
}

/// Pictures, settings, the command line.
pub fn output(ui: &mut Ui, state: &mut State) {
    ui.horizontal(|ui| {
        if ui.button("Save PNG").clicked() {
            state.act(Action::ScreenshotPng);
        }
        if ui.button("Save EXR").clicked() {
            state.act(Action::ScreenshotExr);
        }
        let recording = state.recording.is_some();
        if ui.button(if recording { "End recording" } else { "Record" }).clicked() {
            state.act(Action::Record);
        }
    });
    ui.horizontal(|ui| {
        if ui.button("Save settings").clicked() {
            state.orders.push(Order::SaveSettings);
        }
        if ui.button("Copy command line").clicked() {
            state.act(Action::CopyCommand);
        }
    });
}
