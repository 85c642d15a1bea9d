//! The frame graph as a picture: passes from top to bottom, lines from what is written to what reads it.

use egui::{Align2, Color32, FontId, Pos2, Rect, Sense, Shape, Stroke, Ui, epaint::CubicBezierShape, pos2, vec2};

use crate::{
    skips::Cost,
    view::{engine::Schedule, state::State, worker::Job},
};

const ROW: f32 = 22.0;
const LANES: f32 = 70.0;

/// An edge: the pass that writes, the pass that reads, and what.
fn edges(schedule: &Schedule) -> Vec<(usize, usize, &'static str)> {
    let mut edges = Vec::new();
    for (reader, step) in schedule.steps.iter().enumerate() {
        for name in &step.reads {
            let writer = schedule.steps[..reader].iter().rposition(|earlier| earlier.writes.contains(name));
            edges.extend(writer.map(|writer| (writer, reader, *name)));
        }
    }
    edges
}

/// The passes of the frame with their times, and what was left out and why.
pub fn graph(ui: &mut Ui, state: &mut State) {
    let Some(frames) = &state.frames else {
        ui.label("no picture yet");
        return;
    };
    let schedule = &frames.schedule;
    let (width, height) = (ui.available_width(), ROW * schedule.steps.len() as f32);
    let (rect, response) = ui.allocate_exact_size(vec2(width, height), Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "frame graph"));
    let longest = state.stats.passes.iter().map(|(_, ms)| *ms).fold(1e-9, f64::max);
    let bar = |i: usize| {
        let top = rect.top() + ROW * i as f32;
        Rect::from_min_max(pos2(rect.left() + LANES, top + 1.0), pos2(rect.right(), top + ROW - 2.0))
    };
    let hovered = response.hover_pos().map(|position| ((position.y - rect.top()) / ROW) as usize);
    let visuals = ui.visuals().clone();
    let painter = ui.painter_at(rect);
    for (writer, reader, _) in edges(schedule) {
        let (from, to) = (bar(writer).left_center(), bar(reader).left_center());
        let reach = LANES * (0.25 + 0.75 * ((reader - writer) as f32 / schedule.steps.len() as f32).min(1.0));
        let touched = hovered.is_some_and(|row| row == writer || row == reader);
        let color = if touched { visuals.strong_text_color() } else { visuals.weak_text_color() };
        let points: [Pos2; 4] = [from, from - vec2(reach, 0.0), to - vec2(reach, 0.0), to];
        let stroke = Stroke::new(if touched { 2.0 } else { 1.0 }, color);
        painter.add(Shape::CubicBezier(CubicBezierShape::from_points_stroke(
            points,
            false,
            Color32::TRANSPARENT,
            stroke,
        )));
    }
    for (i, step) in schedule.steps.iter().enumerate() {
        let rect = bar(i);
        let time = state.stats.passes.get(i).filter(|(pass, _)| *pass == step.pass).map(|(_, ms)| *ms);
        painter.rect_filled(rect, 2.0, visuals.faint_bg_color);
        if let Some(ms) = time {
            let mut part = rect;
            part.set_width(rect.width() * (ms / longest) as f32);
            painter.rect_filled(part, 2.0, visuals.selection.bg_fill);
        }
        let text = |at: Pos2, align: Align2, text: String| {
            painter.text(at, align, text, FontId::proportional(12.0), visuals.text_color())
        };
        text(rect.left_center() + vec2(4.0, 0.0), Align2::LEFT_CENTER, step.pass.to_owned());
        if let Some(ms) = time {
            text(rect.right_center() - vec2(4.0, 0.0), Align2::RIGHT_CENTER, format!("{ms:.2} ms"));
        }
    }
    if let Some(step) = hovered.and_then(|row| schedule.steps.get(row)) {
        response.on_hover_text(format!("reads {}\nwrites {}", step.reads.join(", "), step.writes.join(", ")));
    }
    for (pass, why) in &schedule.left_out {
        ui.weak(format!("{pass}: left out, {why}"));
    }
    let button = ui.button("Measure what that saves").on_hover_text(
        "frames in real time of the scene without changes to its lights: without any rule, with each alone, with all; until done, the picture stands",
    );
    if button.clicked() {
        state.jobs.push(Job::Measure);
    }
    match &state.costs {
        Some((settings, measured)) if *settings == state.settings => costs(ui, measured),
        Some(_) => _ = ui.weak("it was measured with other knobs"),
        None => {}
    }
}

/// What each rule saves: time and memory of a frame with it alone, between those with none and with all.
fn costs(ui: &mut Ui, costs: &[Cost]) {
    egui::Grid::new("costs").striped(true).num_columns(3).show(ui, |ui| {
        for title in ["rules", "ms a frame", "MiB"] {
            ui.strong(title);
        }
        ui.end_row();
        for cost in costs {
            ui.label(cost.name());
            ui.label(format!("{:.2}", cost.frame_ms));
            ui.label(format!("{:.2}", (cost.frame_bytes + cost.scene_bytes) as f64 / f64::from(1 << 20)));
            ui.end_row();
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::engine::Scheduled;

    #[test]
    fn a_line_leads_from_the_last_writer_to_each_reader() {
        let step = |pass, reads: &[&'static str], writes: &[&'static str]| Scheduled {
            pass,
            reads: reads.to_vec(),
            writes: writes.to_vec(),
        };
        let schedule = Schedule {
            steps: vec![step("a", &["prev_x"], &["x"]), step("b", &["x"], &["y"]), step("c", &["x", "y"], &[])],
            left_out: Vec::new(),
            frame_bytes: 0,
        };
        assert_eq!(edges(&schedule), [(0, 1, "x"), (0, 2, "x"), (1, 2, "y")]);
    }
}
