//! Where time and memory go.

use egui::{Grid, Ui};
use egui_plot::{Line, PlotPoints};

use crate::view::state::State;

/// The time of frames and of each pass, as curves and as numbers.
pub fn times(ui: &mut Ui, state: &mut State) {
    let stats = &state.stats;
    let ms = stats.smoothed_ms();
    ui.label(format!("{ms:.1} ms a frame, {:.1} frames a second", 1e3 / ms.max(1e-3)));
    let points: PlotPoints<'_> = stats.frame_ms.iter().enumerate().map(|(i, ms)| [i as f64, *ms]).collect();
    super::frames_plot("frame times", 90.0).show(ui, |plot| {
        plot.line(Line::new("ms a frame", points));
        for ((pass, _), history) in stats.passes.iter().zip(&stats.pass_ms) {
            let points: PlotPoints<'_> = history.iter().enumerate().map(|(i, ms)| [i as f64, *ms]).collect();
            plot.line(Line::new(*pass, points));
        }
    });
    if let Some(frames) = &state.frames {
        let [width, height] = frames.shown.size;
        let rays = f64::from(frames.rays) * f64::from(width) * f64::from(height);
        ui.label(format!(
            "at most {} rays a pixel, edges apart: {:.1} million a second",
            frames.rays,
            rays / (ms.max(1e-3) / 1e3) / 1e6
        ));
        let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        ui.label(format!(
            "memory: scene {:.0} MiB, frame {:.0} MiB",
            mebibytes(state.facts.bytes),
            mebibytes(frames.schedule.frame_bytes)
        ));
        ui.label(format!("exposure {:.3}, time {:.2} s", frames.exposure, frames.time_s));
        match &frames.faults {
            Some(faults) if faults.samples > 0 => ui.colored_label(ui.visuals().warn_fg_color, faults.to_string()),
            Some(_) => ui.label("no weight was dropped"),
            None => ui.label("dropped weights are counted while the picture is averaged"),
        };
    }
    if stats.passes.is_empty() {
        ui.label("This GPU has no clock for passes.");
        return;
    }
    Grid::new("times of passes").striped(true).num_columns(2).show(ui, |ui| {
        for (pass, ms) in &stats.passes {
            ui.label(*pass);
            ui.label(format!("{ms:.2} ms"));
            ui.end_row();
        }
        ui.strong("all passes");
        ui.strong(format!("{:.2} ms", stats.passes.iter().map(|(_, ms)| ms).sum::<f64>()));
        ui.end_row();
    });
}
