//! The time budget, and what it has come to.

use egui::{Slider, Ui};
use egui_plot::{HLine, Line, PlotPoints};

use crate::{budget::FRONT, view::state::State};

/// The budget, the times of frames against it, and the rungs that held it.
pub fn budget(ui: &mut Ui, state: &mut State) {
    ui.checkbox(&mut state.budgeted, "hold a time budget")
        .on_hover_text("in real time, knobs give way along a front of quality against cost");
    ui.add(Slider::new(&mut state.budget_ms, 1.0..=2000.0).logarithmic(true).text("milliseconds a frame"));
    if !state.budgeted {
        return;
    }
    let Some(facts) = state.frames.as_ref().and_then(|frames| frames.budget) else {
        ui.label("No frame in real time yet; what stands still has no budget.");
        return;
    };
    let counts = facts.counts;
    ui.label(format!(
        "{} of {} frames within the budget; rung {} of {}",
        counts.within,
        counts.frames,
        facts.level + 1,
        FRONT.len()
    ));
    if facts.out_of_reach {
        ui.label("Even the cheapest settings take longer: lower the render scale.");
    }
    ui.label(FRONT[facts.level].knobs.join(" "));
    let history = &state.stats.budget;
    let times: PlotPoints<'_> = history.iter().enumerate().map(|(i, (ms, _))| [i as f64, *ms]).collect();
    // On the same axis: the highest rung is the budget.
    let unit = f64::from(state.budget_ms) / FRONT.len() as f64;
    let rungs: PlotPoints<'_> =
        history.iter().enumerate().map(|(i, (_, level))| [i as f64, (*level + 1) as f64 * unit]).collect();
    let limit = f64::from(state.budget_ms);
    super::frames_plot("time budget", 110.0).legend(egui_plot::Legend::default()).show(ui, |plot| {
        plot.hline(HLine::new("budget", limit));
        plot.line(Line::new("ms a frame", times));
        plot.line(Line::new("rung", rungs));
    });
}
