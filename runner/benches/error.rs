//! Error against time: `cargo bench --bench error -- SCENE [CAMERA.json] [SECONDS] [reference=FILE.exr] [knobs ...]`, SCENE
//! a file or a built-in name. Knobs such as `preset=fast,candidates.count=8` are measured in place of the presets.
//!
//! Stills first: each method for the given time, one after the other. Then the real-time chain at its steady state, against
//! frames without reuse. All on the CPU, at 320x180, with camera rays through pixel centers, so that what differs is light
//! alone.
//!
//! The judge is the reference integrator, which shares neither light sampling nor random numbers with the passes. It is
//! read from FILE.exr; if there is no such file, it is rendered for eight times the seconds and written there. A longer one
//! is made by
//!
//!     weir render SCENE -o FILE.exr --size 320x180 --set camera.jitter=off --integrator reference --time 3600
//!
//! Where that integrator is too noisy, as with millions of lights, `--integrator ris` and many candidates make a judge that
//! is independent of reuse at least.
//!
//! relMSE is the mean over pixels and channels of (x - r)^2 / (r^2 + 0.01 m^2), m the mean of r; the reference's own
//! variance, as it reports it, is taken off, and printed as a relMSE of its own. MAPE is the mean of |x - r| / (r + 0.01 m),
//! over channels and, in the column beside, of the mean over channels: the target of resampling is that mean, so what a
//! pixel's few samples leave is noise of colour above all.
//! N_eff is how many frames of one candidate by power have the variance of one frame of the method. The nominal count is
//! how many candidates have had a say in one frame: those of a reservoir, times the inputs of each merge, one after the
//! other; what they share is counted again and again.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use weir::{
    executor::cpu::Order,
    output::{Destination, Picture, exr},
    packed::PackedScene,
    render::{Backend, Rendered, Request, Stop, layers, render, render_real_time, render_reference},
    scene::{Camera, builtin, camera, load},
    settings::Settings,
    technique::{Technique, ToneCurve},
};

type Failure = Box<dyn std::error::Error>;

/// Without reuse: name, knobs. The times below are against the best of these.
const WITHOUT: &[(&str, &str)] = &[
    ("power, one candidate", "candidates.count=1,candidates.tree=0,candidates.bsdf=0"),
    ("uniform, one candidate", "candidates.count=1,candidates.tree=0,candidates.bsdf=0,candidates.source=uniform"),
    ("32 candidates, no reuse", "candidates.count=32,candidates.tree=0,candidates.bsdf=0"),
];

/// What reuse starts from.
const OWN_CANDIDATES: (&str, &str) = ("balanced's, no reuse", "preset=balanced");

const PRESETS: &[&str] = &["preset=fast", "preset=balanced", "preset=quality", "preset=paper"];

/// Frames until the chain has forgotten its beginning.
const CHAIN_FRAMES: u32 = 48;

/// The judge.
struct Reference {
    picture: Picture,
    /// Of the mean.
    variance: Vec<[f32; 3]>,
    samples: u32,
}

struct Errors {
    rel_mse: f64,
    /// In per cent, over all channels.
    mape: f64,
    /// In per cent, of the mean over channels.
    mape_of_gray: f64,
}

impl Reference {
    /// Mean over all values, the unit of the relative measures.
    fn mean(&self) -> f64 {
        self.values().sum::<f64>() / self.values().count() as f64
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.picture.rgb.iter().flatten().map(|&v| f64::from(v))
    }

    fn variances(&self) -> impl Iterator<Item = f64> {
        self.variance.iter().flatten().map(|&v| f64::from(v))
    }

    /// How far it is from itself: what its variance is as a relMSE.
    fn rel_mse(&self) -> f64 {
        let floor = 0.01 * self.mean().powi(2);
        let sum: f64 = self.values().zip(self.variances()).map(|(r, v)| v / (r * r + floor)).sum();
        sum / self.values().count() as f64
    }

    fn errors(&self, rendered: &Rendered) -> Errors {
        let mean = self.mean();
        let (mut rel_mse, mut mape, mut n) = (0.0, 0.0, 0.0);
        let pictures = rendered.picture.rgb.iter().flatten().map(|&v| f64::from(v)).zip(self.values());
        for ((x, r), v) in pictures.zip(self.variances()) {
            rel_mse += ((x - r) * (x - r) - v) / (r * r + 0.01 * mean * mean);
            mape += (x - r).abs() / (r + 0.01 * mean);
            n += 1.0;
        }
        let gray = |rgb: &[f32; 3]| rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
        let grays = rendered.picture.rgb.iter().map(gray).zip(self.picture.rgb.iter().map(gray));
        let of_gray: f64 = grays.map(|(x, r)| (x - r).abs() / (r + 0.01 * mean)).sum();
        Errors { rel_mse: rel_mse / n, mape: 100.0 * mape / n, mape_of_gray: 300.0 * of_gray / n }
    }

    fn read(path: &Path) -> Result<Self, Failure> {
        let (picture, channels) = exr::read(path)?;
        let lacks = |name: &str| format!("the reference has no channel `{name}`; make it by weir: {}", path.display());
        let channel = |name: &str| {
            let found = channels.iter().find(|c| c.name == name).ok_or_else(|| lacks(name))?;
            Ok::<_, String>(&found.samples)
        };
        let float = |name: &str| match channel(name)? {
            exr::Samples::Float(values) => Ok(values),
            exr::Samples::Uint(_) => Err(lacks(name)),
        };
        let (r, g, b) = (float("Variance.R")?, float("Variance.G")?, float("Variance.B")?);
        let samples = match channel("samples")? {
            exr::Samples::Uint(values) => values.first().copied().unwrap_or(0),
            exr::Samples::Float(_) => return Err(lacks("samples").into()),
        };
        let variance = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect();
        Ok(Self { picture, variance, samples })
    }

    /// Read where there is one, else rendered, and written if it has a place.
    fn get(file: Option<&Path>, packed: &PackedScene, request: &Request) -> Result<Self, Failure> {
        if let Some(path) = file.filter(|path| path.exists()) {
            let found = Self::read(path)?;
            let size = [found.picture.width, found.picture.height];
            if size != [request.width, request.height] {
                let [width, height] = size;
                return Err(format!("the reference is {width}x{height}, not 320x180: {}", path.display()).into());
            }
            return Ok(found);
        }
        let rendered = render_reference(packed, request, |_| true)?;
        if let Some(path) = file {
            let metadata = exr::Metadata {
                render_time_s: Some(rendered.elapsed.as_secs_f32()),
                samples_per_pixel: Some(rendered.samples),
                seed: Some(u64::from(request.seed)),
                ..exr::Metadata::default()
            };
            let destination = Destination::File(path.to_owned());
            exr::write(&destination, &rendered.picture, &layers(packed, request, &rendered)?, &metadata)?;
        }
        Ok(Self { picture: rendered.picture, variance: rendered.variance, samples: rendered.samples })
    }
}

fn settings(knobs: &str) -> Result<Settings, Failure> {
    let mut settings = Settings::default();
    for knob in knobs.split(',') {
        settings.apply(knob)?;
    }
    settings.apply("camera.jitter=off")?;
    settings.apply("scene.time_step=0")?;
    Ok(settings)
}

/// The nominal count of a frame, as text.
fn nominal(settings: &Settings, technique: Technique) -> String {
    let candidates = u64::from(settings.candidates + technique.bsdf_rays(settings));
    let neighbors = match technique {
        Technique::RealTime => settings.spatial_neighbors,
        Technique::Still | Technique::Candidates => settings.still_neighbors,
    };
    let past = match technique {
        Technique::RealTime => 1 + u64::from(settings.confidence_cap) * u64::from(1 + settings.temporal_neighbors),
        Technique::Still | Technique::Candidates => 1,
    };
    let inputs = past * u64::from(1 + neighbors).pow(technique.rounds(settings));
    format!("{candidates} x {inputs} = {}", candidates * inputs)
}

fn main() -> Result<(), Failure> {
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
    let file: Option<PathBuf> = arguments.iter().find_map(|a| a.strip_prefix("reference=")).map(PathBuf::from);
    let is_knobs = |a: &&String| a.contains('=') && !a.starts_with("reference=");
    let given: Vec<&str> = arguments.iter().filter(is_knobs).map(String::as_str).collect();
    let methods = if given.is_empty() { PRESETS } else { &given };
    let mut packed = PackedScene::new(&scene, 0.0)?;
    let backend = Backend::Cpu(Order::default());
    let request = |technique, knobs: &str, seed, stop| -> Result<Request, Failure> {
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

    let judge = request(Technique::Candidates, OWN_CANDIDATES.1, 99, limit(8.0 * seconds))?;
    let judge = Reference::get(file.as_deref(), &packed, &judge)?;
    println!(
        "{name}, 320x180, {} threads; reference of {} samples a pixel, its own relMSE {:.5}",
        rayon::current_num_threads(),
        judge.samples,
        judge.rel_mse()
    );
    let head = |kind: &str, frames: &str| {
        println!(
            "{kind:<26} {frames:>8} {:>10} {:>10} {:>9} {:>9} {:>8}",
            "ms/frame", "relMSE", "MAPE", "of gray", "N_eff"
        );
    };
    head("stills", "frames");
    let mut one_candidate = None;
    let (mut best_without, mut own_candidates) = (f64::INFINITY, f64::INFINITY);
    let mut still_n_eff = Vec::new();
    let alone = WITHOUT.iter().chain([&OWN_CANDIDATES]).map(|(name, knobs)| (*name, Technique::Candidates, *knobs));
    for (method, technique, knobs) in alone.chain(methods.iter().map(|m| (*m, Technique::Still, *m))) {
        let rendered = render(&packed, &request(technique, knobs, 1, limit(seconds))?, &backend, |_| true)?;
        let Errors { rel_mse, mape, mape_of_gray } = judge.errors(&rendered);
        let per_frame = rel_mse * f64::from(rendered.samples);
        let n_eff = *one_candidate.get_or_insert(per_frame) / per_frame;
        let mut gain = String::new();
        if technique == Technique::Still {
            let (best, own) = (best_without / rel_mse, own_candidates / rel_mse);
            gain = format!("  {best:.1} times below the best without reuse, {own:.1} below {}", OWN_CANDIDATES.0);
            still_n_eff.push(n_eff);
        } else if method == OWN_CANDIDATES.0 {
            own_candidates = rel_mse;
        } else {
            best_without = rel_mse.min(best_without);
        }
        println!(
            "{method:<26} {:>8} {:>10.1} {rel_mse:>10.5} {mape:>7.2} % {mape_of_gray:>7.2} % {n_eff:>8.0}{gain}",
            rendered.samples,
            rendered.elapsed.as_secs_f64() * 1e3 / f64::from(rendered.samples),
        );
    }
    let one_candidate = one_candidate.unwrap_or(f64::NAN);

    head("real time", "frame");
    let show = |label: &str, frames: u32, rendered: &Rendered| {
        let Errors { rel_mse, mape, mape_of_gray } = judge.errors(rendered);
        let ms = rendered.elapsed.as_secs_f64() * 1e3 / f64::from(frames);
        let n_eff = one_candidate / rel_mse;
        println!("{label:<26} {frames:>8} {ms:>10.1} {rel_mse:>10.4} {mape:>7.2} % {mape_of_gray:>7.2} % {n_eff:>8.0}");
        n_eff
    };
    for (label, knobs) in [WITHOUT[2], OWN_CANDIDATES] {
        let alone = request(Technique::Candidates, knobs, 2, Stop::Samples(1))?;
        show(label, 1, &render(&packed, &alone, &backend, |_| true)?);
    }
    let mut chain_n_eff = Vec::new();
    for method in methods {
        let request = request(Technique::RealTime, method, 3, Stop::Samples(CHAIN_FRAMES))?;
        let rendered = render_real_time(&mut packed, &request, &backend, None, |_| true)?;
        chain_n_eff.push(show(method, CHAIN_FRAMES, &rendered));
    }

    println!("N_eff of one frame, of the nominal count (candidates x inputs; the keynote's is some 20,000)");
    for ((method, still), chain) in methods.iter().zip(still_n_eff).zip(chain_n_eff) {
        let settings = settings(method)?;
        let [still_count, chain_count] = [Technique::Still, Technique::RealTime].map(|t| nominal(&settings, t));
        println!("{method:<26} still {still:.0} of {still_count}; real time {chain:.0} of {chain_count}");
    }
    Ok(())
}
