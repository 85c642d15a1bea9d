//! Commands and their options.

mod bench;
mod check;
mod compare;
mod graph;
mod info;
mod open;
mod pixel;
mod render;
mod stress;
#[cfg(feature = "window")]
mod view;

use std::{fmt::Write as _, io::Write as _, path::PathBuf};

use anyhow::Context;
use clap::{Args, Parser, Subcommand, ValueEnum};
use weir::{
    executor::gpu::Traversal,
    exit::{Exit, Usage},
    render::{RenderError, Stop},
    scene::{builtin::BUILTIN, export},
    settings::KNOBS,
    technique::{Technique, ToneCurve},
};

/// Real-time rendering of scenes with one to millions of lights, by reservoir resampling.
///
/// Without a command, shows the default scene in a window; without a display, draws it to weir.png.
#[derive(Debug, Parser)]
#[command(version, after_long_help = knobs())]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Open a window on a scene: fly through it, move its lights, change every knob
    #[cfg(feature = "window")]
    #[command(after_long_help = knobs())]
    View(view::ViewArguments),
    /// Draw a picture: .png (tone-mapped) or .exr (linear, with layers)
    #[command(after_long_help = knobs())]
    Render(RenderArguments),
    /// Compare every pass on the GPU with the same pass on the CPU; exit code 1 if they differ
    ///
    /// With --strict every word must be equal, on adapters that divide exactly. Otherwise at most one pixel in a hundred of
    /// each output may be off by more than a thousandth.
    Check(CheckArguments),
    /// Run the list of numerical cases and print a table of what was expected and seen; exit code 1 on a failure
    Stress(StressArguments),
    /// Compare two pictures: measures of error; exit codes 0 to 4 as of OpenImageIO's idiff
    ///
    /// 0: the same within the limits, 1: a warning, 2: too different, 3: sizes differ, 4: a file cannot be read.
    Compare(compare::CompareArguments),
    /// Measure run time against error: scenes, methods and times; JSON, CSV and a report with plots
    Bench(Box<bench::BenchArguments>),
    /// Compute a frame on the CPU and print all that its passes leave at one pixel
    ///
    /// Frames of stills are computed again exactly. One in real time depends on those before it: it gets a history of
    /// `--history` frames of the same view.
    Pixel(PixelArguments),
    /// Print the schedule of a frame: what runs, on which memory, what is left out and why
    Graph(GraphArguments),
    /// List the built-in scenes
    Scenes,
    /// List adapters, their limits, and versions
    Info,
    /// Write a scene as OBJ + MTL + camera JSON, for other renderers
    Export(ExportArguments),
}

/// Which scene, and how to read it.
#[derive(Debug, Args)]
struct SceneArguments {
    /// An .obj file with its .mtl, or the name of a built-in scene (see `weir scenes`)
    scene: String,
    /// Camera: a file of JSON with origin, target, up, vfov_deg, or such text itself
    #[arg(long, value_name = "FILE|JSON")]
    camera: Option<PathBuf>,
    /// Lights: a file of JSON, {"lights": [...]}, with points, spots, directional lights, spheres and rectangles
    ///
    /// Without it, NAME.lights.json is taken where it lies beside NAME.obj. README.md, "Lights", has the fields.
    #[arg(long, value_name = "FILE")]
    lights: Option<PathBuf>,
    /// Every surface Lambertian with Kd
    #[arg(long)]
    lambert: bool,
    /// Geometric normals only
    #[arg(long)]
    flat: bool,
    /// Environment map, .hdr or .exr, equirectangular
    #[arg(long, value_name = "FILE")]
    environment: Option<PathBuf>,
    /// Turn of the environment about the vertical, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    environment_rotation: f32,
    /// Factor on the environment's radiance
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    environment_scale: f32,
    /// Another folder whose files the scene may use
    #[arg(long, value_name = "DIR")]
    asset_root: Option<PathBuf>,
    /// Largest file accepted, in bytes
    #[arg(long, value_name = "BYTES", default_value_t = MAX_SIZE)]
    max_size: u64,
    /// Textures together are reduced to this many bytes
    #[arg(long, value_name = "BYTES", default_value_t = TEXTURE_BUDGET)]
    texture_budget: u64,
    /// Set a knob; `weir render --help` lists them
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Largest file accepted, in bytes.
const MAX_SIZE: u64 = 4 << 30;
/// Textures together are reduced to this many bytes.
const TEXTURE_BUDGET: u64 = 120 << 20;

impl SceneArguments {
    /// The scene as it is.
    fn of(scene: &str) -> Self {
        Self {
            scene: scene.to_owned(),
            camera: None,
            lights: None,
            lambert: false,
            flat: false,
            environment: None,
            environment_rotation: 0.0,
            environment_scale: 1.0,
            asset_root: None,
            max_size: MAX_SIZE,
            texture_budget: TEXTURE_BUDGET,
            set: Vec::new(),
        }
    }
}

/// Where to compute.
#[derive(Debug, Args)]
struct BackendArguments {
    /// Where to compute; auto takes the GPU if one answers, else the CPU, and says so
    #[arg(long, value_enum, default_value_t = BackendChoice::Auto)]
    backend: BackendChoice,
    /// GPU by a part of its name, or its number in `weir info`
    #[arg(long, value_name = "NAME|NUMBER")]
    adapter: Option<String>,
    /// Threads on the CPU; 0 takes as many as there are cores
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
}

impl BackendArguments {
    /// Has the CPU compute with as many threads as were asked for.
    fn use_threads(&self) -> anyhow::Result<()> {
        if self.threads > 0 {
            rayon::ThreadPoolBuilder::new().num_threads(self.threads.min(1024)).build_global()?;
        }
        Ok(())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum BackendChoice {
    Auto,
    Gpu,
    Cpu,
}

/// An image size, as in 1280x720.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Size {
    width: u32,
    height: u32,
}

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        match parsed {
            Some((width @ 1..=16_384, height @ 1..=16_384)) => Ok(Self { width, height }),
            _ => Err(String::from("a size is WIDTHxHEIGHT with both from 1 to 16384, such as 1280x720")),
        }
    }
}

#[derive(Debug, Args)]
struct RenderArguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    backend: BackendArguments,
    /// Output: .png (tone-mapped sRGB) or .exr (linear, with layers); - writes a PNG to stdout
    #[arg(short, long, value_name = "FILE", default_value = "weir.png")]
    output: PathBuf,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: Size,
    /// Samples of each pixel; 64 if nothing else ends the picture
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16_777_216), group = "stop")]
    spp: Option<u32>,
    /// Render for this long instead, from the beginning of the first frame to the end of the last
    ///
    /// Reading the scene, compiling pipelines and writing files come on top. It ends with the frame that ends nearest to
    /// that time, so that it is off by half a frame at most; a warning says so where that is more than 3 %.
    #[arg(long, value_name = "SECONDS", group = "stop")]
    time: Option<f64>,
    /// Render until the relative error is this, in per cent, instead
    ///
    /// That is the root of relMSE against the true picture, estimated from the variance of frames. A pilot says how many
    /// frames that takes and is thrown away, so that the picture is not biased by looking at it. Nineteen pictures in
    /// twenty get below, few by much.
    #[arg(long, value_name = "PERCENT", group = "stop")]
    error: Option<f64>,
    /// Also draw the relative standard error of each pixel, from 0.1 % (dark) to 100 % (bright): .png
    #[arg(long, value_name = "FILE")]
    heat_map: Option<PathBuf>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
    /// How light is computed
    #[arg(long, value_enum, default_value_t = Integrator::Restir)]
    integrator: Integrator,
    /// Tone curve of PNG files
    #[arg(long, value_enum, default_value_t = ToneCurve::Agx)]
    tone: ToneCurve,
    /// Factor on radiance before the tone curve
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    exposure: f32,
    /// Hold this time for each frame of restir-temporal, by more or fewer candidates, neighbours and pixels of full quality
    ///
    /// The time of a frame includes moving the scene and uploading what has changed. Frames change `candidates.count`,
    /// `candidates.tree`, `candidates.off_lattice`, `temporal.neighbors`, `temporal.neighbors_unseen` and
    /// `reuse.resolution`, none of which costs history or biases the picture.
    #[arg(long, value_name = "MS")]
    budget_ms: Option<f64>,
    /// Print the time of each pass, whether weights were dropped, and what has become of a budget
    #[arg(long)]
    stats: bool,
}

#[derive(Debug, Args)]
struct PixelArguments {
    /// The pixel, from the upper left corner
    #[arg(value_name = "X,Y")]
    pixel: pixel::Pixel,
    #[command(flatten)]
    scene: SceneArguments,
    /// Size of the frame
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: Size,
    /// Number of the frame
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: u32,
    /// Frames before it, in real time
    #[arg(long, value_name = "N", default_value_t = 16)]
    history: u32,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
    /// How light is computed
    #[arg(long, value_enum, default_value_t = Integrator::RestirTemporal)]
    integrator: Integrator,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Integrator {
    /// Independent frames, each with resampled candidates and spatial reuse
    Restir,
    /// Frames that reuse the one before, as a viewer shows them; the last of `--spp` frames is the picture
    RestirTemporal,
    /// Resampled candidates without reuse, one shadow ray
    Ris,
    /// A plain path tracer on the CPU, apart from the passes
    Reference,
}

impl Integrator {
    /// The passes it stands for; none for the reference.
    fn technique(self) -> Option<Technique> {
        match self {
            Self::Restir => Some(Technique::Still),
            Self::RestirTemporal => Some(Technique::RealTime),
            Self::Ris => Some(Technique::Candidates),
            Self::Reference => None,
        }
    }
}

#[derive(Debug, Args)]
struct CheckArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// GPU by a part of its name, or its number in `weir info`
    #[arg(long, value_name = "NAME|NUMBER")]
    adapter: Option<String>,
    /// The module without reassociation or contraction: every value must be equal
    #[arg(long)]
    strict: bool,
    /// Size of the frames
    #[arg(long, value_name = "WxH", default_value = "320x180")]
    size: Size,
    /// Which passes; `restir` and `restir-temporal` both if not given
    #[arg(long, value_enum)]
    integrator: Option<Integrator>,
    /// Frames to compare
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
}

#[derive(Debug, Args)]
struct StressArguments {
    #[command(flatten)]
    backend: BackendArguments,
    /// This case alone; can be given several times
    #[arg(long, value_name = "N")]
    case: Vec<u32>,
    /// The table as JSON
    #[arg(long)]
    json: bool,
    /// How a GPU traces rays
    #[arg(long, value_enum, default_value_t = Traversal::Auto)]
    traversal: Traversal,
    /// Instead of the list: 100,000 frames of a chain that stands still and 10,000 of one that moves
    #[arg(long, conflicts_with_all = ["case", "json"])]
    endurance: bool,
}

#[derive(Debug, Args)]
struct GraphArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Size of the frame
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: Size,
    /// Which passes
    #[arg(long, value_enum, default_value_t = Integrator::Restir)]
    integrator: Integrator,
    /// In the DOT language of Graphviz
    #[arg(long)]
    dot: bool,
    /// Then the time and memory of a frame, and of packing the scene, without any rule of `skip.NAME`, with each alone, and
    /// with all
    #[arg(long, conflicts_with = "dot")]
    costs: bool,
    /// How often `--costs` takes the time of three frames
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    turns: u32,
    #[command(flatten)]
    backend: BackendArguments,
}

#[derive(Debug, Args)]
struct ExportArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Folder to write to
    dir: PathBuf,
}

/// The knobs, for `--help`.
fn knobs() -> String {
    let mut text = String::from("Knobs for --set:\n");
    for knob in KNOBS {
        let _ = write!(text, "  {} = {}\n      {}\n", knob.key, knob.values, knob.shown_help());
    }
    text
}

/// Writes a result to stdout.
fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).context("could not write to stdout")
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    match &arguments.command {
        #[cfg(feature = "window")]
        None if weir::view::app::has_display() => view::default_scene(),
        None => render::default_scene(),
        #[cfg(feature = "window")]
        Some(Command::View(arguments)) => view::run(arguments),
        Some(Command::Pixel(arguments)) => pixel::run(arguments),
        Some(Command::Render(arguments)) => render::run(arguments),
        Some(Command::Check(arguments)) => check::run(arguments),
        Some(Command::Stress(arguments)) => stress::run(arguments),
        Some(Command::Compare(arguments)) => compare::run(arguments),
        Some(Command::Bench(arguments)) => bench::run(arguments),
        Some(Command::Graph(arguments)) => graph::run(arguments),
        Some(Command::Scenes) => {
            print(&BUILTIN.iter().fold(String::new(), |mut text, scene| {
                let _ = writeln!(text, "{:<10} {}", scene.name, scene.description);
                text
            }))?;
            Ok(Exit::Ok)
        }
        Some(Command::Info) => {
            print(&info::text())?;
            Ok(Exit::Ok)
        }
        Some(Command::Export(arguments)) => {
            let (mut scene, settings) = open::read(&arguments.scene)?;
            scene.camera = Some(open::camera_of(&arguments.scene, &scene)?);
            scene.stop_at(settings.time_s);
            let report = export::export(&scene, &arguments.dir)?;
            print(&format!("{report}\n"))?;
            Ok(Exit::Ok)
        }
    }
}

/// The reference is not made of passes.
fn no_passes() -> Usage {
    Usage(String::from("the reference integrator has no passes; name another with --integrator"))
}

/// When to stop: samples, time or error.
fn stop_of(arguments: &RenderArguments) -> anyhow::Result<Stop> {
    if let Some(seconds) = arguments.time {
        if !(seconds > 0.0 && seconds <= 1e7) {
            let text = format!("--time takes a number of seconds above 0 and up to 10 million, not {seconds}");
            return Err(Usage(text).into());
        }
        return Ok(Stop::Time(std::time::Duration::from_secs_f64(seconds)));
    }
    if let Some(percent) = arguments.error {
        if !(1e-3..=1000.0).contains(&percent) {
            return Err(Usage(format!("--error takes per cent from 0.001 to 1000, not {percent}")).into());
        }
        if arguments.integrator == Integrator::RestirTemporal {
            return Err(RenderError::NoMargin.into());
        }
        return Ok(Stop::Error(percent / 100.0));
    }
    Ok(Stop::Samples(arguments.spp.unwrap_or(64)))
}
