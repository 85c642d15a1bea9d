//! A pixel, as the buffers have it.

use egui::{Grid, Ui};

use crate::view::{
    engine::Inspected,
    state::{Order, State},
};

/// What the inspected pixel sees and holds.
pub fn inspector(ui: &mut Ui, state: &mut State) {
    if !state.inspecting {
        ui.label("I: inspect a pixel with a click.");
        return;
    }
    let Some(inspected) = state.frames.as_ref().and_then(|frames| frames.inspected.clone()) else {
        ui.label("Click into the picture.");
        return;
    };
    Grid::new("pixel").striped(true).num_columns(2).show(ui, |ui| {
        for (name, value) in lines(&inspected) {
            ui.label(name);
            ui.label(value);
            ui.end_row();
        }
    });
    if ui.button("Copy replay").on_hover_text("the command that runs this pixel on the CPU").clicked() {
        let replay = state.replay_command(inspected.px);
        state.orders.push(Order::Copy(replay));
    }
}

/// Names and values.
fn lines(inspected: &Inspected) -> Vec<(&'static str, String)> {
    let Inspected { px, surface, reservoir, moments, motion, light, frame } = inspected;
    let vector = |v: glam::Vec3| format!("{:.4}, {:.4}, {:.4}", v.x, v.y, v.z);
    let mut lines = vec![("pixel", format!("{}, {}", px.x, px.y)), ("frame", frame.to_string())];
    if surface.is_sky() {
        lines.push(("sees", "sky".to_owned()));
    } else {
        lines.extend([
            ("sees", format!("instance {}", surface.instance())),
            ("position", vector(surface.position())),
            ("normal", vector(surface.normal_shading())),
            ("albedo", vector(surface.diffuse())),
            ("specular", vector(surface.specular())),
            ("roughness", format!("{:.3}", surface.roughness())),
        ]);
        if surface.is_settled() {
            lines.push(("light", "in closed form, not sampled".to_owned()));
        }
    }
    lines.push(("holds", light.clone()));
    if reservoir.has_sample() {
        let (u, v) = (reservoir.uv & 0xffff, reservoir.uv >> 16);
        lines.extend([
            ("at", format!("{:.4}, {:.4}", f64::from(u) / 65_536.0, f64::from(v) / 65_536.0)),
            ("weight W", format!("{:.6}", reservoir.ucw)),
            ("visible", if reservoir.is_known_visible() { "known" } else { "not known" }.to_owned()),
        ]);
    }
    lines.push(("confidence", reservoir.confidence().to_string()));
    lines.push((
        "since the frame before",
        motion.map_or_else(|| "not seen then".to_owned(), |step| format!("{:.2}, {:.2} pixels", step.x, step.y)),
    ));
    lines.push(("radiance", vector(moments.mean())));
    if moments.count > 1 {
        let error = moments.variance_of_mean().max(glam::Vec3::ZERO);
        lines.push(("standard error", vector(glam::Vec3::new(error.x.sqrt(), error.y.sqrt(), error.z.sqrt()))));
    }
    lines.push(("samples", moments.count.to_string()));
    lines
}
