//! Plots of the report, as SVG.

use plotters::prelude::*;

use super::results::{Ablation, LightCost, MethodResults, SceneResults};

/// Pixels of a plot.
const SIZE: (u32, u32) = (900, 440);
/// Those of them that names take.
const LEGEND: u32 = 180;
/// Font of labels; the browser finds it.
const FONT: (&str, i32) = ("sans-serif", 14);

/// A line with points, and an interval at each.
struct Series {
    name: String,
    /// x, y, low, high.
    points: Vec<[f64; 4]>,
    /// Points alone, or joined.
    joined: bool,
}

/// What a plot shows.
struct Axes<'a> {
    title: &'a str,
    x: &'a str,
    y: &'a str,
}

/// Colour of the series of a number; the same in all plots of a scene.
fn color(index: usize) -> RGBColor {
    // Okabe and Ito 2008: eight colours that the colour-blind tell apart, black last; then lighter ones.
    const COLORS: [(u8, u8, u8); 12] = [
        (0, 114, 178),
        (230, 159, 0),
        (0, 158, 115),
        (204, 121, 167),
        (86, 180, 233),
        (213, 94, 0),
        (120, 120, 120),
        (0, 0, 0),
        (90, 60, 160),
        (150, 120, 40),
        (200, 60, 90),
        (60, 160, 160),
    ];
    let (r, g, b) = COLORS[index % COLORS.len()];
    RGBColor(r, g, b)
}

/// A logarithmic axis that shows at least `low` to `high`. Only powers of ten have labels there, so one has to be on it.
fn axis(low: f64, high: f64) -> std::ops::Range<f64> {
    let (below, above) = (low.log10().floor(), high.log10().ceil());
    let has_label = above - below > 1.0 || low.log10() == below || high.log10() == above;
    if has_label { low..high } else { 10f64.powf(below)..10f64.powf(above) }
}

/// A plot with logarithmic axes; an empty text if there is nothing that it can show.
fn log_log(axes: &Axes<'_>, series: &[Series]) -> String {
    let usable = |p: &[f64; 4]| p[0] > 0.0 && p[1] > 0.0 && p[0].is_finite() && p[1].is_finite();
    let all: Vec<[f64; 4]> = series.iter().flat_map(|s| &s.points).copied().filter(usable).collect();
    if all.is_empty() {
        return String::new();
    }
    let range = |i: usize| {
        let low = all.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min);
        let high = all.iter().map(|p| p[i]).fold(0.0, f64::max);
        axis(low / 1.4, high * 1.4)
    };
    let mut svg = String::new();
    let drawn = (|| -> Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let (left, right) = area.split_horizontally(SIZE.0 - LEGEND);
        let mut chart = ChartBuilder::on(&left)
            .caption(axes.title, ("sans-serif", 17))
            .margin(8)
            .x_label_area_size(42)
            .y_label_area_size(70)
            .build_cartesian_2d(range(0).log_scale(), range(1).log_scale())?;
        chart
            .configure_mesh()
            .x_desc(axes.x)
            .y_desc(axes.y)
            .label_style(FONT)
            .axis_desc_style(FONT)
            .light_line_style(WHITE)
            .x_label_formatter(&|x| number(*x))
            .y_label_formatter(&|y| number(*y))
            .draw()?;
        let mut ends = Vec::new();
        for (index, s) in series.iter().enumerate() {
            let color = color(index);
            let points: Vec<[f64; 4]> = s.points.iter().copied().filter(usable).collect();
            if s.joined {
                chart.draw_series(LineSeries::new(points.iter().map(|p| (p[0], p[1])), color.stroke_width(2)))?;
            }
            chart.draw_series(points.iter().map(|p| Circle::new((p[0], p[1]), 4, color.filled())))?;
            let bars = points.iter().filter(|p| p[2] > 0.0 && p[3].is_finite());
            chart
                .draw_series(bars.map(|p| PathElement::new(vec![(p[0], p[2]), (p[0], p[3])], color.stroke_width(1))))?;
            ends.extend(points.last().map(|p| (p[1], s.name.clone(), color)));
        }
        // Names stand at the right, in the order of the ends of their lines.
        ends.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (place, (_, name, color)) in (0..).zip(ends) {
            let y = 40 + 20 * place;
            right.draw(&Circle::new((8, y + 7), 4, color.filled()))?;
            right.draw(&Text::new(name, (18, y), FONT.into_font().color(&BLACK)))?;
        }
        Ok(area.present()?)
    })();
    if drawn.is_err() { String::new() } else { svg }
}

/// A number as an axis shows it.
pub(super) fn number(x: f64) -> String {
    match x.abs() {
        a if !a.is_finite() => String::from("unknown"),
        0.0 => String::from("0"),
        a if !(1e-3..1e5).contains(&a) => format!("{x:.1e}"),
        a => {
            let digits = (2.0 - a.log10().floor()).clamp(0.0, 5.0) as usize;
            let text = format!("{x:.digits$}");
            if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
        }
    }
}

/// relMSE against time, of one scene; a frame of a chain is a point of its own.
pub(super) fn error_against_time(scene: &SceneResults) -> String {
    let series = |m: &MethodResults| Series {
        name: m.name.clone(),
        points: m.points.iter().map(|p| [p.time_s, p.rel_mse.value, p.rel_mse.low, p.rel_mse.high]).collect(),
        joined: !m.is_chain,
    };
    let title = format!("{}: error against time", scene.name);
    let axes = Axes { title: &title, x: "seconds", y: "relMSE" };
    log_log(&axes, &scene.methods.iter().map(series).collect::<Vec<_>>())
}

/// relMSE of each frame after a cut.
pub(super) fn recovery(scene: &SceneResults) -> String {
    let chains = scene.methods.iter().filter(|m| m.is_chain);
    let point = |(i, e): (usize, &f64)| [i as f64 + 1.0, *e, f64::NAN, f64::NAN];
    let series = chains.map(|m| Series {
        name: m.name.clone(),
        points: m.recovery.iter().enumerate().map(point).collect(),
        joined: true,
    });
    let title = format!("{}: frames after a cut", scene.name);
    log_log(&Axes { title: &title, x: "frame", y: "relMSE" }, &series.collect::<Vec<_>>())
}

/// Time of a frame against the number of lights.
pub(super) fn cost_of_lights(lights: &[LightCost]) -> String {
    let series = |name: &str, of: fn(&LightCost) -> &super::statistics::Quantity| Series {
        name: name.to_owned(),
        points: lights.iter().map(|l| (l.lights as f64, of(l))).map(|(x, q)| [x, q.value, q.low, q.high]).collect(),
        joined: true,
    };
    let axes = Axes { title: "park: time of a frame of balanced", x: "emissive triangles", y: "ms" };
    log_log(&axes, &[series("still", |l| &l.still_ms), series("real time", |l| &l.chain_ms)])
}

/// Error against time of a frame, a line for each knob.
pub(super) fn ablation(rows: &[Ablation]) -> String {
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let point = [row.frame_ms.value, row.rel_mse.value, f64::NAN, f64::NAN];
        match series.iter_mut().find(|s| s.name == row.knob) {
            Some(s) => s.points.push(point),
            None => series.push(Series { name: row.knob.clone(), points: vec![point], joined: true }),
        }
    }
    let title = rows.first().map_or_else(String::new, |row| format!("{}: one knob of balanced at a time", row.scene));
    log_log(&Axes { title: &title, x: "ms a frame", y: "relMSE of a frame" }, &series)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::statistics::Quantity;

    #[test]
    fn numbers_have_three_digits() {
        let shown = [0.0, 0.012345, 1.0, 1234.6, 3.4e6, 1e-5, f64::NAN].map(number);
        assert_eq!(shown, ["0", "0.0123", "1", "1235", "3.4e6", "1.0e-5", "unknown"]);
    }

    #[test]
    fn a_plot_has_a_line_for_each_series_and_leaves_out_what_has_no_logarithm() {
        let cost = |lights, ms| {
            let q = Quantity { value: ms, low: ms, high: ms, samples: vec![ms] };
            LightCost { lights, still_ms: q.clone(), chain_ms: q }
        };
        let svg = cost_of_lights(&[cost(10, 1.0), cost(1000, 2.0), cost(100_000, f64::NAN), cost(7, 0.0)]);
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{svg}");
        assert!(svg.contains("real time") && !svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(cost_of_lights(&[]), "");
    }

    #[test]
    fn an_axis_has_a_power_of_ten_on_it() {
        assert_eq!(axis(118.0, 980.0), 100.0..1000.0);
        assert_eq!(axis(0.021, 0.09), 0.01..0.1);
        assert_eq!(axis(0.5, 6.0), 0.5..6.0);
        assert_eq!(axis(100.0, 980.0), 100.0..980.0);
    }
}
