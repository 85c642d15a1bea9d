//! `weir view`, and `weir` alone where there is a display.

use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, Parser};
use weir::{
    exit::{Exit, Usage},
    view::{
        app::{self, Options, Processor},
        script,
        state::State,
        stored,
    },
};

use super::{Arguments, BackendArguments, BackendChoice, Command, SceneArguments, Size, open};

#[derive(Debug, Args)]
pub struct ViewArguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    backend: BackendArguments,
    /// Size of the window, in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: Size,
    /// Pixels of the picture to one of the window, in each direction; 1 on a GPU, 0.25 on the CPU
    #[arg(long, value_name = "FACTOR")]
    scale: Option<f32>,
    /// Small lights at random places, up to a million
    #[arg(long, value_name = "N", default_value_t = 0,
          value_parser = clap::value_parser!(u32).range(0..=i64::from(weir::view::lights::MOST)))]
    added_lights: u32,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
    /// End after so many pictures, or when the picture is good enough
    #[arg(long, value_name = "N")]
    frames: Option<u32>,
    /// What the window shows at the end of `--frames`, as PNG
    #[arg(long, value_name = "FILE", requires = "frames")]
    screenshot: Option<PathBuf>,
    /// Every picture as PNG into this folder; the animation takes a thirtieth of a second from one to the next
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Events from a file in place of a person's: `key F1`, `drag left 40 -10`, `press NAME`, `resize 640 480`,
    /// `drop FILE`, `wait FRAMES`, `message TEXT` (waits for one), `screenshot FILE`, `quit`
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
}

/// The default scene in a window.
pub fn default_scene() -> anyhow::Result<Exit> {
    match &Arguments::parse_from(["weir", "view", "rooms"]).command {
        Some(Command::View(arguments)) => run(arguments),
        _ => unreachable!("the words above are a view command"),
    }
}

/// Runs `weir view`.
pub fn run(arguments: &ViewArguments) -> anyhow::Result<Exit> {
    let script = match &arguments.script {
        Some(path) => script::parse(&read(path)?)?,
        None => Vec::new(),
    };
    if arguments.scale.is_some_and(|scale| !(0.1..=2.0).contains(&scale)) {
        return Err(Usage(String::from("--scale takes 0.1 to 2")).into());
    }
    arguments.backend.use_threads()?;
    let mut state = State::new(open::choice_of(&arguments.scene), weir::settings::Settings::default());
    // What was saved, then what the command line says.
    if let Ok(path) = stored::path()
        && path.is_file()
    {
        match stored::load(&mut state, &path) {
            Ok(refused) => refused.into_iter().for_each(|reason| state.fail(reason)),
            Err(error) => state.fail(error.to_string()),
        }
    }
    for assignment in &arguments.scene.set {
        state.settings.apply(assignment)?;
    }
    state.settings.check()?;
    state.time_s = state.settings.time_s;
    (state.seed, state.scattered) = (arguments.seed, arguments.added_lights);
    let camera = arguments.scene.camera.as_deref().map(open::load_camera).transpose()?;
    app::run(Options {
        state,
        camera,
        adapter: match &arguments.backend.adapter {
            Some(text) => text.parse()?,
            None => weir::executor::gpu::AdapterChoice::Best,
        },
        processor: match arguments.backend.backend {
            BackendChoice::Auto => Processor::Auto,
            BackendChoice::Gpu => Processor::Gpu,
            BackendChoice::Cpu => Processor::Cpu,
        },
        scale: arguments.scale,
        size: [arguments.size.width, arguments.size.height],
        frames: arguments.frames,
        screenshot: arguments.screenshot.clone(),
        record: arguments.record.clone(),
        script,
    })?;
    Ok(Exit::Ok)
}

fn read(path: &PathBuf) -> anyhow::Result<String> {
    std::fs::read_to_string(path).with_context(|| format!("cannot read the script: {}", path.display()))
}
