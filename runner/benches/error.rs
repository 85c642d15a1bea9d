//! Error against time: `cargo bench --bench error -- SCENE [CAMERA.json] [seconds] [knobs ...]`, SCENE a file or a built-in
//! name. Knobs such as `preset=fast,candidates.count=8` are measured in place of the presets.
//!
//! Stills first: a reference picture by the quality preset, for eight times the seconds and from another seed; then each
//! method for the given time, one after the other. Then the real-time chain at its steady state, against one frame of
//! candidates without reuse. All on the CPU, at 320x180, with camera rays through pixel centers, so that what differs is
//! light alone.
//!
//! relMSE is the mean over pixels and channels of (x - r)^2 / (r^2 + 0.01 m^2), m the mean of r; the reference's own
//! variance, as it reports it, is taken off. MAPE is the mean of |x - r| / (r + 0.01 m). N_eff is how many frames of one
//! candidate by power have the variance of one frame of the method.

use std::{path::Path, time::Duration};

use weir::{
    executor::cpu::Order,
    output::Picture,
    packed::PackedScene,
    render::{Backend, Rendered, Request, Stop, render, render_real_time},
    scene::{Camera, builtin, camera, load},
    settings::Settings,
    technique::{Technique, ToneCurve},
};

/// Without reuse: name, knobs.
const WITHOUT: &[(&str, &str)] = &[
    ("power, one candidate", "candidates.count=1,candidates.tree=0,candidates.bsdf=0"),
    ("uniform, one candidate", "candidates.count=1,candidates.tree=0,candidates.bsdf=0,candidates.source=uniform"),
    ("32 candidates, no reuse", "candidates.count=32,candidates.tree=0,candidates.bsdf=0"),
];

const PRESETS: &[&str] = &["preset=fast", "preset=balanced", "preset=quality", "preset=paper"];

/// Frames until the chain has forgotten its beginning.
const CHAIN_FRAMES: u32 = 48;

struct Errors {
    rel_mse: f64,
    mape: f64,
}

fn errors(rendered: &Rendered, reference: &Rendered) -> Errors {
    let (x, r): (&Picture, &Picture) = (&rendered.picture, &reference.picture);
    let channels = || r.rgb.iter().flatten().map(|&v| f64::from(v));
    let n = r.rgb.len() as f64 * 3.0;
    let mean = channels().sum::<f64>() / n;
    let variance = reference.variance.iter().flatten().map(|&v| f64::from(v));
    let (mut rel_mse, mut mape) = (0.0, 0.0);
    for ((x, r), v) in x.rgb.iter().flatten().map(|&v| f64::from(v)).zip(channels()).zip(variance) {
        rel_mse += ((x - r) * (x - r) - v) / (r * r + 0.01 * mean * mean);
        mape += (x - r).abs() / (r + 0.01 * mean);
    }
    Errors { rel_mse: rel_mse / n, mape: mape / n }
}

fn settings(knobs: &str) -> Result<Settings, Box<dyn std::error::Error>> {
    let mut settings = Settings::default();
    for knob in knobs.split(',') {
        settings.apply(knob)?;
    }
    settings.apply("camera.jitter=off")?;
    settings.apply("scene.time_step=0")?;
    Ok(settings)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let name = arguments.first().map_or("rooms", String::as_str);
    let seconds: f64 = arguments.iter().find_map(|a| a.parse().ok()).unwrap_or(10.0);
    let scene = match builtin::find(name) {
        Some(scene) => (scene.build)(),
        None => load::load(Path::new(name), &load::LoadOptions::default())?.scene,
    };
    let view = match (arguments.iter().find(|a| a.ends_with(".json")), scene.camera) {
        (Some(path), _) => camera::load(Path::new(path))?,
        (None, Some(camera)) => camera,
        (None, None) => Camera::framing(scene.bounds().ok_or("the scene is empty")?),
    };
    let given: Vec<&str> = arguments.iter().filter(|a| a.contains('=')).map(String::as_str).collect();
    let methods = if given.is_empty() { PRESETS } else { &given };
    let mut packed = PackedScene::new(&scene, 0.0)?;
    let backend = Backend::Cpu(Order::default());
    let request = |technique, knobs: &str, seed, stop| -> Result<Request, Box<dyn std::error::Error>> {
        Ok(Request {
            width: 320,
            height: 180,
            camera: view,
            seed,
            stop,
            curve: ToneCurve::default(),
            exposure: 1.0,
            technique,
            settings: settings(knobs)?,
        })
    };
    let limit = |seconds| Stop::Time(Duration::from_secs_f64(seconds));

    let reference = request(Technique::Still, "preset=quality", 99, limit(8.0 * seconds))?;
    let reference = render(&packed, &reference, &backend, |_| true)?;
    println!("{name}, 320x180, {} threads; reference of {} frames", rayon::current_num_threads(), reference.samples);
    println!("{:<26} {:>8} {:>10} {:>10} {:>9} {:>12}", "stills", "frames", "ms/frame", "relMSE", "MAPE", "N_eff");
    let mut one_candidate = None;
    let mut best_without = f64::INFINITY;
    let without = WITHOUT.iter().map(|(name, knobs)| (*name, Technique::Candidates, *knobs));
    for (method, technique, knobs) in without.chain(methods.iter().map(|m| (*m, Technique::Still, *m))) {
        let rendered = render(&packed, &request(technique, knobs, 1, limit(seconds))?, &backend, |_| true)?;
        let Errors { rel_mse, mape } = errors(&rendered, &reference);
        let per_frame = rel_mse * f64::from(rendered.samples);
        let baseline = *one_candidate.get_or_insert(per_frame);
        let gain = if technique == Technique::Candidates {
            best_without = rel_mse.min(best_without);
            String::new()
        } else {
            format!("  {:.1} times below the best without reuse", best_without / rel_mse)
        };
        println!(
            "{method:<26} {:>8} {:>10.1} {rel_mse:>10.5} {:>7.2} % {:>12.0}{gain}",
            rendered.samples,
            rendered.elapsed.as_secs_f64() * 1e3 / f64::from(rendered.samples),
            mape * 100.0,
            baseline / per_frame
        );
    }

    println!("{:<26} {:>8} {:>10} {:>10} {:>9}", "one frame, real time", "frame", "ms/frame", "relMSE", "MAPE");
    let alone = request(Technique::Candidates, WITHOUT[2].1, 2, Stop::Samples(1))?;
    let alone = render(&packed, &alone, &backend, |_| true)?;
    let show = |label: &str, frames: u32, rendered: &Rendered| {
        let Errors { rel_mse, mape } = errors(rendered, &reference);
        let ms = rendered.elapsed.as_secs_f64() * 1e3 / f64::from(frames);
        println!("{label:<26} {frames:>8} {ms:>10.1} {rel_mse:>10.4} {:>7.2} %", mape * 100.0);
    };
    show("32 candidates, no reuse", 1, &alone);
    for method in methods {
        let request = request(Technique::RealTime, method, 3, Stop::Samples(CHAIN_FRAMES))?;
        let rendered = render_real_time(&mut packed, &request, &backend, |_| true)?;
        show(method, CHAIN_FRAMES, &rendered);
    }
    Ok(())
}
