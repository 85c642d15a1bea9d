//! Every knob of `--set`, by the table that the command line has.

use egui::{ComboBox, DragValue, Ui};

use crate::{
    settings::{KNOBS, Knob, Settings},
    view::state::State,
};

/// What a knob takes.
#[derive(Debug, PartialEq)]
enum Values {
    Range(f64, f64),
    Names(Vec<&'static str>),
}

/// What stands in the table in words.
fn values(knob: &Knob) -> Values {
    if let Some((low, high)) = knob.values.split_once(" to ")
        && let (Ok(low), Ok(high)) = (low.parse(), high.parse())
    {
        return Values::Range(low, high);
    }
    let names = knob.values.split([',', ' ']).filter(|word| !word.is_empty() && *word != "or");
    Values::Names(names.collect())
}

/// What knobs of one prefix are about.
fn title(prefix: &str) -> &'static str {
    match prefix {
        "candidates" => "Candidates",
        "tiles" | "cells" | "cuts" => "Lights drawn ahead",
        "reservoirs" => "Reservoirs",
        "reuse" => "Reuse",
        "temporal" => "Reuse in time",
        "spatial" => "Reuse in space, in real time",
        "still" => "Reuse in space, in stills",
        "target" => "Target",
        "rays" | "shade" => "Rays and shading",
        "skip" => "What is left out",
        "camera" | "path" | "scene" => "Camera, reference and scene",
        _ => "",
    }
}

/// All knobs, in groups.
pub fn knobs(ui: &mut Ui, state: &mut State) {
    let default = Settings::default();
    let mut last = "";
    for knob in KNOBS {
        let title = title(knob.key.split('.').next().unwrap_or(""));
        if title != last {
            ui.separator();
            ui.strong(title);
            last = title;
        }
        let value = knob.get(&state.settings);
        if let Some(wanted) = row(ui, knob, &value, &knob.get(&default)) {
            state.set_knob(knob.key, &wanted);
        }
    }
    ui.separator();
    if ui.button("Reset all knobs").clicked() {
        state.settings = default;
    }
}

/// One knob; what it is to be, if it was changed.
fn row(ui: &mut Ui, knob: &Knob, value: &str, default: &str) -> Option<String> {
    let mut wanted = None;
    ui.horizontal(|ui| {
        let help = format!("{} = {}\n{}", knob.key, knob.values, knob.shown_help());
        match values(knob) {
            Values::Range(low, high) => {
                let whole = !value.contains('.') && (high - low) > 2.5 || high - low == 1.0 && !knob.key.contains('.');
                let mut number: f64 = value.parse().unwrap_or(low);
                let drag = DragValue::new(&mut number).range(low..=high).speed(((high - low) / 400.0).max(0.005));
                let label = ui.label(knob.key).on_hover_text(&help);
                let response = ui.add(if whole { drag } else { drag.max_decimals(4) });
                if response.labelled_by(label.id).on_hover_text(&help).changed() {
                    wanted = Some(number).map(|number| fitting(knob, number));
                }
            }
            Values::Names(names) => {
                let shown = if value.is_empty() { "(changed)" } else { value };
                let mut chosen = value.to_owned();
                let combo = ComboBox::from_label(knob.key).selected_text(shown);
                combo.show_ui(ui, |ui| {
                    for name in names {
                        ui.selectable_value(&mut chosen, name.to_owned(), name);
                    }
                });
                if chosen != value {
                    wanted = Some(chosen);
                }
                ui.label("(?)").on_hover_text(&help);
            }
        }
        if value != default && knob.key != "preset" {
            let reset = ui.small_button("reset").on_hover_text(format!("{} = {default}", knob.key));
            if reset.clicked() {
                wanted = Some(default.to_owned());
            }
        }
    });
    wanted
}

/// The number as the knob takes it: whole, where it takes nothing else.
fn fitting(knob: &Knob, number: f64) -> String {
    let exact = format!("{number:.4}");
    let exact = exact.trim_end_matches('0').trim_end_matches('.').to_owned();
    if knob.set(&mut Settings::default(), &exact) { exact } else { format!("{}", number.round()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_knob_has_a_group_and_values_that_it_takes() {
        for knob in KNOBS {
            let prefix = knob.key.split('.').next().expect("a prefix");
            assert!(knob.key == "preset" || !title(prefix).is_empty(), "{} is in no group", knob.key);
            let takes = |value: &str| knob.set(&mut Settings::default(), value);
            match values(knob) {
                Values::Range(low, high) => {
                    for number in [low, (low + high) / 2.0, high] {
                        assert!(takes(&fitting(knob, number)), "{} refuses {number}", knob.key);
                    }
                }
                Values::Names(names) => {
                    assert!(names.len() > 1, "{}: {names:?}", knob.key);
                    assert!(names.iter().all(|name| takes(name)), "{}: {names:?}", knob.key);
                }
            }
        }
    }
}
