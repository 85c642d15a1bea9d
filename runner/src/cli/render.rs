//! `weir render`, and `weir` alone.

use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Duration,
};

use clap::{Parser, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use signal_hook::{
    consts::{SIGINT, SIGTERM},
    flag,
};
use weir::{
    budget::{Counts, FRONT, TimeBudget},
    executor::{
        cpu::Order,
        gpu::{AdapterChoice, Gpu},
    },
    exit::{Exit, Usage},
    output::{Destination, Layers, atomic, exr, heat::heat_map_picture, png},
    packed::PackOptions,
    render::{
        Backend, RenderError, Rendered, Request, Stop, camera_matrices, layers, render, render_real_time,
        render_reference,
    },
    settings::Settings,
    technique::Technique,
};
use weir_shared::resample::choice;

use super::{Arguments, BackendArguments, BackendChoice, Command, Integrator, RenderArguments, open, stop_of};

/// The default scene to weir.png.
pub fn default_scene() -> anyhow::Result<Exit> {
    let arguments =
        Arguments::parse_from(["weir", "render", "rooms", "-o", "weir.png", "--size", "960x540", "--spp", "4"]);
    match &arguments.command {
        Some(Command::Render(arguments)) => run(arguments),
        _ => unreachable!("the words above are a render command"),
    }
}

enum Format {
    Png,
    Exr,
}

fn format_of(output: &Path) -> Result<Format, Usage> {
    let extension = output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("png") => Ok(Format::Png),
        Some("exr") => Ok(Format::Exr),
        _ if output == Path::new("-") || output.starts_with("/dev") => Ok(Format::Png),
        _ => Err(Usage(format!("pictures are .png or .exr, not {}", output.display()))),
    }
}

/// The GPU to use, or none; says which and why on stderr.
pub fn choose_gpu(arguments: &BackendArguments) -> anyhow::Result<Option<Gpu>> {
    let choice: AdapterChoice = match &arguments.adapter {
        Some(text) => text.parse()?,
        None => AdapterChoice::Best,
    };
    match arguments.backend {
        BackendChoice::Cpu => Ok(None),
        BackendChoice::Gpu => Ok(Some(Gpu::open(&choice)?)),
        BackendChoice::Auto => match Gpu::open(&choice) {
            Ok(gpu) => Ok(Some(gpu)),
            Err(error) if arguments.adapter.is_none() => {
                tracing::warn!("{error}; rendering on the CPU");
                Ok(None)
            }
            Err(error) => Err(error.into()),
        },
    }
}

/// Runs `weir render`.
pub fn run(arguments: &RenderArguments) -> anyhow::Result<Exit> {
    let destination = Destination::from(arguments.output.clone());
    atomic::check(&destination)?;
    let format = format_of(&arguments.output)?;
    let stop = stop_of(arguments)?;
    let heat_map = heat_map_of(arguments)?;
    if !(arguments.exposure > 0.0 && arguments.exposure.is_finite()) {
        return Err(Usage(format!("--exposure takes a number above 0, not {}", arguments.exposure)).into());
    }
    arguments.backend.use_threads()?;
    let mut budget = budget_of(arguments)?;
    let (scene, settings) = open::read(&arguments.scene)?;
    if budget.is_some() && settings.choice == choice::INVERSION {
        let message = "--budget-ms changes the number of candidates, for which `reservoirs.choice=inversion` has a fixed \
                       number of places in memory; choose one of them";
        return Err(Usage(message.to_owned()).into());
    }
    // Whatever the settings are, a budget sends candidates down the light tree.
    let of_settings = PackOptions::of(&settings);
    let options = PackOptions { light_tree: of_settings.light_tree || budget.is_some(), ..of_settings };
    let mut opened = open::pack(&arguments.scene, &scene, settings, options)?;
    drop(scene);
    if let Some(budget) = &mut budget {
        budget.set_base(&opened.settings);
    }
    let request = Request {
        width: arguments.size.width,
        height: arguments.size.height,
        camera: opened.camera,
        seed: arguments.seed,
        stop,
        curve: arguments.tone,
        exposure: arguments.exposure,
        technique: arguments.integrator.technique().unwrap_or(Technique::Candidates),
        settings: opened.settings.clone(),
    };
    let interruption = Interruption::listen()?;
    let bar = progress_bar(stop);
    let tell = |samples: u32| {
        match stop {
            Stop::Samples(_) => bar.set_position(u64::from(samples)),
            Stop::Time(_) => bar.set_position(bar.elapsed().as_millis() as u64),
            Stop::Error(_) => bar.set_position(u64::from(samples)),
        }
        interruption.of().is_none()
    };
    let gpu = if arguments.integrator == Integrator::Reference { None } else { choose_gpu(&arguments.backend)? };
    let adapter = gpu.as_ref().map_or_else(|| String::from("CPU"), |gpu| gpu.facts.name.clone());
    let mut draw = |backend: &Backend<'_>| match arguments.integrator {
        Integrator::Reference => render_reference(&opened.packed, &request, tell),
        Integrator::RestirTemporal => render_real_time(&mut opened.packed, &request, backend, budget.as_mut(), tell),
        Integrator::Restir | Integrator::Ris => render(&opened.packed, &request, backend, tell),
    };
    let on_cpu = Backend::Cpu(Order::default());
    let rendered = match &gpu {
        None => draw(&on_cpu)?,
        Some(gpu) => match (draw(&Backend::Gpu(gpu)), arguments.backend.backend) {
            (Err(weir::render::RenderError::Gpu(error)), BackendChoice::Auto) => {
                tracing::warn!("{error}; rendering on the CPU");
                draw(&on_cpu)?
            }
            (result, _) => result?,
        },
    };
    bar.finish_and_clear();
    if rendered.faults.samples > 0 {
        tracing::warn!("{}", rendered.faults);
    }
    match format {
        Format::Png => png::write(&destination, request.width, request.height, &rendered.display)?,
        Format::Exr => {
            let layers = layers(&opened.packed, &request, &rendered)?;
            write_exr(&destination, arguments, &request, &rendered, &layers, adapter.clone())?;
        }
    }
    if let Some(destination) = &heat_map {
        png::write(destination, request.width, request.height, &heat_map_picture(&rendered))?;
    }
    if arguments.stats {
        print_passes(&rendered);
    }
    if let Some(budget) = &budget {
        tell_budget(budget, arguments.stats);
    }
    let samples = u64::from(rendered.samples) * u64::from(request.width) * u64::from(request.height);
    tracing::info!(
        "{} samples a pixel in {:.2} s on {adapter} ({:.2} million samples a second)",
        rendered.samples,
        rendered.elapsed.as_secs_f64(),
        samples as f64 / rendered.elapsed.as_secs_f64() / 1e6
    );
    if let Some(margin) = &rendered.margin {
        tracing::info!("{margin}");
    }
    if let (Stop::Time(limit), None) = (stop, interruption.of()) {
        let off = rendered.elapsed.as_secs_f64() / limit.as_secs_f64() - 1.0;
        if off.abs() > TIME_TOLERANCE {
            tracing::warn!(
                "{:+.0} % off the time asked for: a frame takes too long; choose a smaller --size",
                100.0 * off
            );
        }
    }
    if arguments.output != Path::new("-") {
        super::print(&format!("{}\n", shown(&arguments.output).display()))?;
    }
    Ok(interruption.of().unwrap_or(Exit::Ok))
}

/// `--time` is kept this well where frames are short enough.
const TIME_TOLERANCE: f64 = 0.03;

/// The budget of each frame, if one is asked for.
fn budget_of(arguments: &RenderArguments) -> Result<Option<TimeBudget>, Usage> {
    let Some(ms) = arguments.budget_ms else { return Ok(None) };
    if !(ms > 0.0 && ms <= 1e6) {
        return Err(Usage(format!("--budget-ms takes milliseconds above 0 and up to a million, not {ms}")));
    }
    if arguments.integrator != Integrator::RestirTemporal {
        let text =
            "--budget-ms holds the time of each frame that reuses the one before; add --integrator restir-temporal";
        return Err(Usage(String::from(text)));
    }
    Ok(Some(TimeBudget::new(Duration::from_secs_f64(ms * 1e-3), &Settings::default())))
}

/// Where the heat map goes.
fn heat_map_of(arguments: &RenderArguments) -> anyhow::Result<Option<Destination>> {
    let Some(path) = &arguments.heat_map else { return Ok(None) };
    if !matches!(format_of(path)?, Format::Png) {
        return Err(Usage(format!("a heat map is a .png, not {}", path.display())).into());
    }
    if arguments.integrator == Integrator::RestirTemporal {
        return Err(RenderError::NoMargin.into());
    }
    let destination = Destination::from(path.clone());
    if matches!(destination, Destination::Stdout) && arguments.output == Path::new("-") {
        return Err(Usage(String::from("only one of --output and --heat-map can be -")).into());
    }
    atomic::check(&destination)?;
    Ok(Some(destination))
}

/// What has become of a budget: a warning where it was out of reach, all of it if `stats` are wanted.
fn tell_budget(budget: &TimeBudget, stats: bool) {
    let Counts { frames, within, moves } = budget.counts();
    let ms = budget.budget().as_secs_f64() * 1e3;
    if budget.is_out_of_reach() {
        tracing::warn!(
            "a frame takes longer than {ms:.1} ms whatever the knobs; choose a smaller --size or `--set rays=speed`"
        );
    }
    if stats {
        let knobs = FRONT[budget.level()].knobs.join(" ");
        eprintln!("{within} of {frames} frames within {ms:.1} ms, {moves} changes of knobs; at the end {knobs}");
    }
}

/// Whether someone wants the picture now: the first SIGINT or SIGTERM ends rendering after the current frame, the second
/// the process.
pub struct Interruption(Arc<AtomicUsize>);

impl Interruption {
    pub fn listen() -> std::io::Result<Self> {
        let (signal, again) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
        for (number, exit) in [(SIGINT, Exit::Interrupted), (SIGTERM, Exit::Terminated)] {
            // In this order: the first signal arms what the second one meets.
            flag::register_conditional_shutdown(number, i32::from(exit.code()), Arc::clone(&again))?;
            flag::register(number, Arc::clone(&again))?;
            flag::register_usize(number, Arc::clone(&signal), usize::from(exit.code()))?;
        }
        Ok(Self(signal))
    }

    /// How the process has to end then, once the picture is saved.
    pub fn of(&self) -> Option<Exit> {
        let code = self.0.load(Ordering::Relaxed);
        [Exit::Interrupted, Exit::Terminated].into_iter().find(|exit| usize::from(exit.code()) == code)
    }
}

/// The path of a result as a person can find it.
fn shown(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

fn progress_bar(stop: Stop) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let (length, template) = match stop {
        Stop::Samples(n) => (u64::from(n), "{bar:40} {pos}/{len} samples a pixel, {eta} left"),
        Stop::Time(limit) => (limit.as_millis() as u64, "{bar:40} {eta} left"),
        Stop::Error(_) => (0, "{pos} samples a pixel, {elapsed}"),
    };
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length).with_style(style)
}

fn print_passes(rendered: &Rendered) {
    let total: Duration = rendered.pass_times.iter().map(|(_, t)| *t).sum();
    for (pass, time) in &rendered.pass_times {
        eprintln!("{pass:<20} {:>9.3} ms", time.as_secs_f64() * 1e3);
    }
    eprintln!("{:<20} {:>9.3} ms (last frame)", "all passes", total.as_secs_f64() * 1e3);
    if rendered.faults.samples == 0 {
        eprintln!("no weight was dropped");
    }
}

/// A value as the command line takes it.
fn word(value: impl ValueEnum) -> Option<String> {
    value.to_possible_value().map(|value| value.get_name().to_owned())
}

fn write_exr(
    destination: &Destination,
    arguments: &RenderArguments,
    request: &Request,
    rendered: &Rendered,
    layers: &Layers,
    adapter: String,
) -> anyhow::Result<()> {
    let (camera_from_world, ndc_from_world) = camera_matrices(&request.camera, request.width, request.height);
    let settings = serde_json::json!({
        "scene": arguments.scene.scene,
        "integrator": word(arguments.integrator),
        "camera": arguments.scene.camera,
        "lights": arguments.scene.lights,
        "environment": arguments.scene.environment,
        "environment_rotation": arguments.scene.environment_rotation,
        "environment_scale": arguments.scene.environment_scale,
        "tone": word(arguments.tone),
        "exposure": request.exposure,
        "lambert": arguments.scene.lambert,
        "flat": arguments.scene.flat,
        "knobs": request.settings.describe().into_iter().collect::<std::collections::BTreeMap<_, _>>(),
    });
    let metadata = exr::Metadata {
        render_time_s: Some(rendered.elapsed.as_secs_f32()),
        samples_per_pixel: Some(rendered.samples),
        camera_from_world: Some(camera_from_world),
        ndc_from_world: Some(ndc_from_world),
        settings: Some(settings.to_string()),
        seed: Some(u64::from(request.seed)),
        adapter: Some(adapter),
        ..exr::Metadata::default()
    };
    exr::write(destination, &rendered.picture, layers, &metadata)?;
    Ok(())
}
