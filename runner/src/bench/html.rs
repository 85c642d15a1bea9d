//! The report: one file of HTML that needs nothing else.

use std::fmt::Write as _;

use base64::{Engine as _, engine::general_purpose::STANDARD};

use super::{
    Gallery, Results,
    plots::{self, number},
    results::SceneResults,
    statistics::Quantity,
    stills::{Shown, shown},
};
use crate::{
    margin::FLOOR,
    output::{Picture, heat::color_of, png},
};

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:1500px;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.5em}h2{margin-top:2em;border-bottom:1px solid #ccc}table{border-collapse:collapse;margin:1em 0;font-size:13px}\
th,td{padding:3px 9px;text-align:right;border-bottom:1px solid #e4e4e4;white-space:nowrap}th{border-bottom:1px solid #888}\
th:first-child,td:first-child{text-align:left}small{color:#666}.scroll{overflow-x:auto}\
.grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(340px,1fr));gap:14px}figure{margin:0}\
figure img{width:100%;image-rendering:pixelated;display:block}.row{display:grid;grid-template-columns:1fr 1fr;gap:2px}\
figcaption{font-size:13px}.best{font-weight:600;background:#eef6ee}.warn{background:#fdf0e0;padding:.5em 1em}";

/// Side of a crop, as a share of the picture's.
const CROP: u32 = 4;

/// The page.
pub(super) fn page(results: &Results, galleries: &[Gallery]) -> String {
    let mut html = String::from("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">");
    let _ = write!(html, "<title>weir bench</title><style>{STYLE}</style></head><body><h1>Run time against error</h1>");
    let (m, o) = (&results.machine, &results.options);
    let _ = write!(
        html,
        "<p>{}x{} pixels on {} ({}, {} threads, {}), weir {}. {} seeds; stills at {} s, chains of {} frames. Medians, with \
         95 % intervals of the bootstrap over seeds and parts of the run; methods took turns frame by frame.</p>",
        o.width,
        o.height,
        text(&m.adapter),
        text(&m.cpu),
        m.threads,
        text(&m.system),
        text(&m.weir),
        o.seeds,
        o.times_s.iter().map(|t| number(*t)).collect::<Vec<_>>().join(", "),
        o.chain_frames
    );
    if !results.left_out.is_empty() {
        let _ = write!(html, "<p class=\"warn\">Left out: {}.</p>", text(&results.left_out.join("; ")));
    }
    for scene in &results.scenes {
        scene_section(&mut html, scene, galleries.iter().find(|gallery| gallery.scene == scene.name));
    }
    lights_section(&mut html, results);
    ablation_section(&mut html, results);
    html.push_str("</body></html>\n");
    html
}

fn scene_section(html: &mut String, scene: &SceneResults, gallery: Option<&Gallery>) {
    let r = &scene.reference;
    let _ = write!(
        html,
        "<h2>{}</h2><p>{} triangles, {} of them emissive. Reference: {}, {} samples a pixel, its own relMSE {} (taken off), \
         its mean known to {} %. Peak memory of the process {} MiB.</p>",
        text(&scene.name),
        scene.triangles,
        scene.lights,
        text(&r.integrator),
        r.samples,
        number(r.rel_mse),
        number(100.0 * r.mean_error),
        scene.peak_bytes >> 20
    );
    html.push_str(&plots::error_against_time(scene));
    methods_table(html, scene);
    html.push_str(&plots::recovery(scene));
    passes_table(html, scene);
    if let Some(gallery) = gallery {
        pictures(html, gallery);
    }
}

fn methods_table(html: &mut String, scene: &SceneResults) {
    html.push_str(
        "<div class=\"scroll\"><table><tr><th>method<th>ms a frame<th>first<th>Mray/s<th>s<th>frames<th>relMSE<th>MAPE %<th>SMAPE \
         %<th>FLIP<th>bias %<th>variance<th>N_eff<th>of<th>efficiency<th>flicker<th>MiB</tr>",
    );
    let best = scene.methods.iter().map(|m| m.efficiency).filter(|e| e.is_finite()).fold(0.0, f64::max);
    for m in &scene.methods {
        let Some(p) = m.points.last() else { continue };
        let class = if m.efficiency == best { " class=\"best\"" } else { "" };
        let _ = write!(
            html,
            "<tr{class}><td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            text(&m.name),
            interval(&m.frame_ms, 1.0),
            number(m.first_frame_ms),
            number(m.camera_mrays),
            number(p.time_s),
            number(p.frames),
            interval(&p.rel_mse, 1.0),
            number(100.0 * p.mape.value),
            number(100.0 * p.smape.value),
            p.flip.as_ref().map_or_else(|| String::from("-"), |q| number(q.value)),
            interval(&m.bias, 100.0),
            number(m.relative_variance.value),
            number(m.n_eff),
            m.nominal,
            number(m.efficiency),
            m.flicker.map_or_else(|| String::from("-"), number),
            m.frame_bytes >> 20
        );
    }
    html.push_str(
        "</table></div><p><small>Mray/s: camera rays in <code>primary</code>, making surfaces included. Variance: of one frame, \
         over x² + 0.01 m². N_eff: frames of one candidate by power that one frame is worth, of the candidates that had a say in \
         it. Efficiency: 1 / (relMSE seconds). Flicker: half the mean square of the difference of successive frames, over r² + \
         0.01 m². MiB: buffers of a frame.</small></p>",
    );
}

fn passes_table(html: &mut String, scene: &SceneResults) {
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in scene.methods.iter().flat_map(|m| &m.passes_ms) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    html.push_str(
        "<details><summary>Milliseconds of each pass, medians</summary><div class=\"scroll\"><table><tr><th>method",
    );
    for name in &names {
        let _ = write!(html, "<th>{}", text(name));
    }
    html.push_str("</tr>");
    for m in &scene.methods {
        let _ = write!(html, "<tr><td>{}", text(&m.name));
        for name in &names {
            let time = m.passes_ms.iter().find(|pass| pass.0 == *name);
            html.push_str("<td>");
            html.push_str(&time.map_or_else(String::new, |pass| number(pass.1)));
        }
        html.push_str("</tr>");
    }
    html.push_str("</table></div></details>");
}

/// Each method's picture at the last time, and how far it is off.
fn pictures(html: &mut String, gallery: &Gallery) {
    let reference = &gallery.reference;
    let errors: Vec<Vec<f64>> = gallery.shown.iter().map(|shown| relative_errors(&shown.picture, reference)).collect();
    let crop = worst_part(&errors, reference.width, reference.height);
    html.push_str(
        "<p>Pictures at the last time, with the part where errors are largest; below, the relative error of each pixel, from \
         0.1 % (dark blue) to 100 % (yellow). A chain's picture is its last frame.</p><div class=\"grid\">",
    );
    figure(html, "reference", reference, None, crop);
    for (Shown { method, time_s, picture }, errors) in gallery.shown.iter().zip(&errors) {
        figure(html, &format!("{method}, {} s", number(*time_s)), picture, Some(errors), crop);
    }
    html.push_str("</div>");
}

fn figure(html: &mut String, caption: &str, picture: &Picture, errors: Option<&[f64]>, crop: [u32; 4]) {
    let [w, h] = [picture.width, picture.height];
    let heat = errors.map(|errors| errors.iter().map(|e| color_of(*e)).collect());
    html.push_str("<figure>");
    for colors in [Some(shown(picture)), heat].into_iter().flatten() {
        let (whole, part) = (data_url(w, h, &colors), data_url(crop[2], crop[3], &part_of(&colors, w, crop)));
        let _ = write!(html, "<div class=\"row\"><img alt=\"\" src=\"{whole}\"><img alt=\"\" src=\"{part}\"></div>");
    }
    let _ = write!(html, "<figcaption>{}</figcaption></figure>", text(caption));
}

/// |x - r| / (r + 0.01 m) of each pixel, mean over channels.
fn relative_errors(picture: &Picture, reference: &Picture) -> Vec<f64> {
    let mean = super::stills::mean_of(reference);
    let value =
        |(x, r): (&f32, &f32)| (f64::from(*x) - f64::from(*r)).abs() / (f64::from(*r) + FLOOR * mean).max(1e-300);
    let pixel = |(x, r): (&[f32; 3], &[f32; 3])| x.iter().zip(r).map(value).sum::<f64>() / 3.0;
    picture.rgb.iter().zip(&reference.rgb).map(pixel).collect()
}

/// Left, top, width and height of the part with the largest errors, over all methods.
fn worst_part(errors: &[Vec<f64>], width: u32, height: u32) -> [u32; 4] {
    let [w, h] = [width, height].map(|side| (side / CROP).max(1));
    let sum = |left: u32, top: u32| -> f64 {
        let rows = (top..top + h).map(|y| (y * width + left) as usize);
        rows.flat_map(|start| {
            errors.iter().map(move |e| e[start..start + w as usize].iter().map(|v| v.min(1.0)).sum::<f64>())
        })
        .sum()
    };
    let places = (0..CROP).flat_map(|y| (0..CROP).map(move |x| (x * w, y * h)));
    let worst = places
        .filter(|(x, y)| x + w <= width && y + h <= height)
        .max_by(|a, b| sum(a.0, a.1).total_cmp(&sum(b.0, b.1)));
    let (left, top) = worst.unwrap_or((0, 0));
    [left, top, w, h]
}

fn part_of(colors: &[u32], width: u32, [left, top, w, h]: [u32; 4]) -> Vec<u32> {
    let row = |y: u32| colors[(y * width + left) as usize..][..w as usize].iter().copied();
    (top..top + h).flat_map(row).collect()
}

fn data_url(width: u32, height: u32, colors: &[u32]) -> String {
    // A picture that cannot be encoded is no reason to lose the report.
    let bytes = png::encode(width, height, colors).unwrap_or_default();
    format!("data:image/png;base64,{}", STANDARD.encode(bytes))
}

fn lights_section(html: &mut String, results: &Results) {
    if results.lights.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Cost against the number of lights</h2><p>The park while it moves, its triangles in the same places; \
                   those that do not count are dark. Medians, moving the scene included.</p>",
    );
    html.push_str(&plots::cost_of_lights(&results.lights));
    html.push_str("<table><tr><th>emissive triangles<th>still, ms<th>real time, ms</tr>");
    for row in &results.lights {
        let _ = write!(
            html,
            "<tr><td>{}<td>{}<td>{}</tr>",
            row.lights,
            interval(&row.still_ms, 1.0),
            interval(&row.chain_ms, 1.0)
        );
    }
    html.push_str("</table>");
}

fn ablation_section(html: &mut String, results: &Results) {
    if results.ablation.is_empty() {
        return;
    }
    html.push_str(
        "<h2>One knob at a time</h2><p>The real-time chain of <code>balanced</code>, one frame; the default in bold. \
                   All values of a knob took turns.</p>",
    );
    html.push_str(&plots::ablation(&results.ablation));
    html.push_str("<table><tr><th>knob<th>value<th>ms a frame<th>relMSE<th>1 / (relMSE s)</tr>");
    for row in &results.ablation {
        let class = if row.is_default { " class=\"best\"" } else { "" };
        let _ = write!(
            html,
            "<tr{class}><td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            text(&row.knob),
            text(&row.value),
            interval(&row.frame_ms, 1.0),
            number(row.rel_mse.value),
            number(1e3 / (row.rel_mse.value * row.frame_ms.value))
        );
    }
    html.push_str("</table>");
}

/// A value, and its interval where it is known.
fn interval(q: &Quantity, unit: f64) -> String {
    let value = number(unit * q.value);
    if !(q.low.is_finite() && q.high.is_finite()) || q.samples.len() < 2 {
        return value;
    }
    format!("{value} <small>[{}, {}]</small>", number(unit * q.low), number(unit * q.high))
}

/// As HTML takes it.
fn text(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::results::{MethodResults, Point};

    #[test]
    fn names_cannot_break_the_page() {
        let scene = SceneResults { name: String::from("<b>\"&"), ..SceneResults::default() };
        let results = Results { scenes: vec![scene], ..Results::default() };
        let page = page(&results, &[]);
        assert!(page.contains("<h2>&lt;b&gt;&quot;&amp;</h2>"));
        assert!(!page.contains("src=\"http") && !page.contains("<link") && !page.contains("<script"));
    }

    #[test]
    fn a_crop_is_where_errors_are_largest() {
        let mut errors = vec![0.0; 8 * 8];
        errors[5 * 8 + 6] = 1.0;
        assert_eq!(worst_part(&[errors], 8, 8), [6, 4, 2, 2]);
        let colors: Vec<u32> = (0..64).collect();
        assert_eq!(part_of(&colors, 8, [6, 4, 2, 2]), [38, 39, 46, 47]);
    }

    #[test]
    fn a_method_has_its_row_and_its_interval() {
        let quantity = |value: f64| Quantity { value, low: 0.5 * value, high: 2.0 * value, samples: vec![value; 3] };
        let method = MethodResults {
            name: String::from("still:x"),
            points: vec![Point { rel_mse: quantity(0.25), ..Default::default() }],
            ..MethodResults::default()
        };
        let scene = SceneResults { methods: vec![method], ..SceneResults::default() };
        let page = page(&Results { scenes: vec![scene], ..Results::default() }, &[]);
        assert!(page.contains("still:x") && page.contains("0.25 <small>[0.125, 0.5]</small>"));
    }
}
