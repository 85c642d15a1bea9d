//! `weir bench`.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use anyhow::Context as _;
use clap::Args;
use weir::{
    bench::{
        FILES, Plan, Target,
        methods::Method,
        regress::{self, Verdict},
        results::{Machine, Results, RunOptions, SCHEMA},
        run as measure,
    },
    executor::{cpu::Order, gpu::Gpu},
    exit::{Exit, Usage},
    render::Backend,
    scene::error::{Place, SceneError},
};

use super::{BackendArguments, SceneArguments, Size, open, render::Interruption, render::choose_gpu};

#[derive(Debug, Args)]
pub struct BenchArguments {
    /// A scene, with its camera file after a comma if it needs one; again for each. Built-in ones if not given
    #[arg(long = "scene", value_name = "SCENE[,CAMERA.json]")]
    scenes: Vec<String>,
    /// Methods, set apart by blanks: those that `--list` shows, `sources` (each source of candidates alone, as candidates
    /// of resampling, and as those of reuse), or `ris:`, `still:` or `chain:` and knobs. All that have a name if not given
    #[arg(long = "method", value_name = "NAME", num_args = 1..)]
    methods: Vec<String>,
    /// List the methods
    #[arg(long)]
    list: bool,
    /// Every surface Lambertian with Kd
    #[arg(long)]
    lambert: bool,
    /// Geometric normals only
    #[arg(long)]
    flat: bool,
    #[command(flatten)]
    backend: BackendArguments,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "320x180", default_value_if("quick", "true", "160x90"))]
    size: Size,
    /// Times at which stills are judged, in seconds, ascending
    #[arg(long, value_name = "SECONDS", num_args = 1.., default_values_t = [0.5, 1.0, 2.0, 4.0, 8.0])]
    #[arg(default_value_if("quick", "true", "0.25"))]
    times: Vec<f64>,
    /// Seeds of each method: more give closer intervals
    #[arg(long, value_name = "N", default_value_t = 5, default_value_if("quick", "true", "2"))]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1000))]
    seeds: u32,
    /// Frames of each chain
    #[arg(long, value_name = "N", default_value_t = 64, default_value_if("quick", "true", "16"))]
    #[arg(value_parser = clap::value_parser!(u32).range(2..=10_000))]
    chain_frames: u32,
    /// Seconds for each reference; one that is cached and had as many is used again
    #[arg(long, value_name = "SECONDS", default_value_t = 120.0, default_value_if("quick", "true", "12"))]
    reference_time: f64,
    /// Reference of the only scene: an .exr of `weir render` with camera.jitter=off
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Without cost against lights, and without one knob at a time
    #[arg(long)]
    no_extras: bool,
    /// Small pictures and short times: done within five minutes, with wide intervals
    #[arg(long)]
    quick: bool,
    /// Folder for results.json, results.csv and report.html
    #[arg(short, long, value_name = "DIR", default_value = "bench")]
    output: PathBuf,
    /// The results.json of another run: says what has become slower or worse beyond the noise; exit code 1 then
    #[arg(long, value_name = "OLD.json")]
    compare: Option<PathBuf>,
    /// With --compare: these results against it, and nothing is measured
    #[arg(long, value_name = "NEW.json", requires = "compare")]
    with: Option<PathBuf>,
}

/// `--quick` ends by then; what is under way is finished first.
const QUICK_SECONDS: u64 = 270;
/// Times of `--quick`.
const QUICK_TIMES_S: [f64; 4] = [0.1, 0.2, 0.4, 0.8];

/// Runs `weir bench`.
pub fn run(arguments: &BenchArguments) -> anyhow::Result<Exit> {
    if arguments.list {
        let line = |m: Method| format!("{:<16} {} {}\n", m.name, m.technique, m.knobs.join(" "));
        super::print(&Method::all().into_iter().map(line).collect::<String>())?;
        return Ok(Exit::Ok);
    }
    // Before anything takes time.
    let old = arguments.compare.as_deref().map(read).transpose()?;
    if let (Some(old), Some(new)) = (&old, &arguments.with) {
        return tell(&regress::compare(old, &read(new)?));
    }
    let deadline = arguments.quick.then(|| Instant::now() + Duration::from_secs(QUICK_SECONDS));
    let plan = plan_of(arguments, deadline)?;
    let gpu = choose_gpu(&arguments.backend)?;
    let backend = gpu.as_ref().map_or(Backend::Cpu(Order::default()), Backend::Gpu);
    let interruption = Interruption::listen()?;
    let started = Instant::now();
    let say = |what: &str| tracing::info!("{:>5.0} s  {what}", started.elapsed().as_secs_f64());
    let results = measure(&plan, machine(gpu.as_ref()), &backend, &|| interruption.of().is_some(), &say)?;
    for left_out in &results.left_out {
        tracing::warn!("left out: {left_out}");
    }
    super::print(&table(&results))?;
    for name in FILES {
        super::print(&format!("{}\n", std::path::absolute(plan.folder.join(name))?.display()))?;
    }
    if let Some(exit) = interruption.of() {
        return Ok(exit);
    }
    old.map_or(Ok(Exit::Ok), |old| tell(&regress::compare(&old, &results)))
}

fn plan_of(arguments: &BenchArguments, deadline: Option<Instant>) -> anyhow::Result<Plan> {
    let times_s =
        if arguments.quick && arguments.times == [0.25] { QUICK_TIMES_S.to_vec() } else { arguments.times.clone() };
    let ascending = times_s.windows(2).all(|pair| pair[0] < pair[1]) && times_s.iter().all(|t| *t > 0.0 && *t <= 1e6);
    if !ascending {
        return Err(Usage(format!("--times takes seconds above 0 in ascending order, not {times_s:?}")).into());
    }
    if !(arguments.reference_time > 0.0 && arguments.reference_time <= 1e7) {
        let text = format!("--reference-time takes seconds above 0, not {}", arguments.reference_time);
        return Err(Usage(text).into());
    }
    let methods: Vec<Method> = if arguments.methods.is_empty() {
        Method::all()
    } else {
        let named = arguments.methods.iter().map(|name| match name.as_str() {
            "sources" => Ok(Method::sources()),
            name => Ok(vec![Method::named(name)?]),
        });
        named.collect::<anyhow::Result<Vec<_>>>()?.concat()
    };
    let built_in = ["rooms", "park", "cornell"].map(String::from).to_vec();
    let names = if arguments.scenes.is_empty() { &built_in } else { &arguments.scenes };
    if arguments.reference.is_some() && names.len() != 1 {
        return Err(
            Usage(format!("--reference is of one scene, and there are {}; name it with --scene", names.len())).into()
        );
    }
    arguments.backend.use_threads()?;
    let scenes = names.iter().map(|name| target_of(name, arguments)).collect::<anyhow::Result<_>>()?;
    let Size { width, height } = arguments.size;
    Ok(Plan {
        scenes,
        methods,
        options: RunOptions { width, height, times_s, seeds: arguments.seeds, chain_frames: arguments.chain_frames },
        reference_time: Duration::from_secs_f64(arguments.reference_time),
        reference: arguments.reference.clone(),
        extra_frames: if arguments.no_extras { 0 } else { arguments.chain_frames / 2 },
        deadline,
        folder: arguments.output.clone(),
    })
}

fn target_of(name: &str, arguments: &BenchArguments) -> anyhow::Result<Target> {
    let (scene, camera) = match name.split_once(',') {
        Some((scene, camera)) => (scene, Some(PathBuf::from(camera))),
        None => (name, None),
    };
    let of_scene =
        SceneArguments { camera, lambert: arguments.lambert, flat: arguments.flat, ..SceneArguments::of(scene) };
    let (read, _) = open::read(&of_scene)?;
    let camera = open::camera_of(&of_scene, &read)?;
    if read.emissive_triangle_count() == 0 && read.shape_count() == 0 && read.environment.is_none() {
        let (problem, help) = ("nothing emits light, so there is nothing to measure", "name a scene with lights");
        return Err(SceneError::bad_data(Place::new(&read.name, 0), problem, help).into());
    }
    let packed = Target::pack(&read)?;
    let Size { width, height } = arguments.size;
    Ok(Target { name: read.name.clone(), scene: read, packed, camera, width, height })
}

fn read(path: &Path) -> anyhow::Result<Results> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let value: serde_json::Value =
        serde_json::from_slice(&bytes).map_err(|error| not_results(path, &error.to_string()))?;
    let schema = value.get("schema").and_then(|schema| schema.as_str()).unwrap_or_default();
    if schema != SCHEMA {
        return Err(not_results(path, &format!("its schema is `{schema}`, not `{SCHEMA}`")).into());
    }
    Ok(serde_json::from_value(value).map_err(|error| not_results(path, &error.to_string()))?)
}

fn not_results(path: &Path, reason: &str) -> SceneError {
    SceneError::bad_data(
        Place::new(path.display().to_string(), 0),
        format!("no results of `weir bench`: {reason}"),
        "name a results.json",
    )
}

fn tell(verdict: &Verdict) -> anyhow::Result<Exit> {
    for remark in &verdict.remarks {
        tracing::warn!("{remark}");
    }
    for worse in &verdict.worse {
        super::print(&format!("worse: {worse}\n"))?;
    }
    super::print(&format!(
        "{} of {} quantities became worse beyond the noise\n",
        verdict.worse.len(),
        verdict.compared
    ))?;
    Ok(if verdict.worse.is_empty() { Exit::Ok } else { Exit::CheckFailed })
}

fn machine(gpu: Option<&Gpu>) -> Machine {
    let cpu_info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu_info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    Machine {
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        cpu: model.map_or_else(|| String::from("unknown processor"), |(_, name)| name.to_owned()),
        threads: rayon::current_num_threads(),
        adapter: gpu.map_or_else(|| String::from("CPU"), |gpu| format!("{}, {}", gpu.facts.name, gpu.facts.driver)),
        weir: env!("CARGO_PKG_VERSION").to_owned(),
    }
}

/// The results in short.
fn table(results: &Results) -> String {
    let mut text = String::new();
    for scene in &results.scenes {
        let r = &scene.reference;
        text += &format!(
            "{}: reference {} with {} samples, its own relMSE {:.2e}\n",
            scene.name, r.integrator, r.samples, r.rel_mse
        );
        text += &format!(
            "{:<16} {:>9} {:>8} {:>10} {:>8} {:>8} {:>18} {:>8}\n",
            "method", "ms/frame", "frames", "relMSE", "MAPE", "SMAPE", "bias", "N_eff"
        );
        for m in &scene.methods {
            let Some(p) = m.points.last() else { continue };
            let bias = format!("{:+.2} +- {:.2} %", 100.0 * m.bias.value, 50.0 * (m.bias.high - m.bias.low));
            text += &format!(
                "{:<16} {:>9.2} {:>8.0} {:>10.5} {:>6.1} % {:>6.1} % {bias:>18} {:>8.1}\n",
                m.name,
                m.frame_ms.value,
                p.frames,
                p.rel_mse.value,
                100.0 * p.mape.value,
                100.0 * p.smape.value,
                m.n_eff
            );
        }
    }
    text
}
