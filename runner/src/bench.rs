//! Run time against error: scenes, methods and times, in one run.
//!
//! Stills are judged along their way: all methods take turns, frame by frame, until each has had the same time. Chains of
//! frames that reuse each other are judged frame by frame. `docs/metrics.md` says what each number means.

mod chains;
mod html;
mod judge;
pub mod lights;
pub mod methods;
mod plots;
pub mod regress;
pub mod results;
pub mod statistics;
mod stills;
mod timing;

use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use thiserror::Error;

use crate::{
    exit::{Exit, HasExit},
    output::{Destination, OutputError, atomic},
    packed::{Moment, PackError, PackOptions, PackedScene},
    render::{Backend, RenderError, Request},
    scene::{Camera, Scene},
    technique::Technique,
};
use judge::Judge;
use methods::{ABLATION, Method, MethodError, UNIT};
use results::{Ablation, LightCost, Results, RunOptions, SCHEMA, SceneResults};
use stills::Shown;

pub use judge::JudgeError;

/// How many triangles of the park emit, at least, unless it has fewer.
const LIGHT_COUNTS: &[u64] = &[100, 1000, 10_000, 100_000, 1_000_000, u64::MAX];

/// What to measure.
pub struct Plan {
    /// Scenes.
    pub scenes: Vec<Target>,
    /// Methods.
    pub methods: Vec<Method>,
    /// Pixels, times, seeds and frames.
    pub options: RunOptions,
    /// Time for each reference.
    pub reference_time: Duration,
    /// The reference of the only scene, instead of a cached one.
    pub reference: Option<PathBuf>,
    /// Frames for the cost of lights and for the ablation; neither of 0.
    pub extra_frames: u32,
    /// When to stop, with what there is.
    pub deadline: Option<Instant>,
    /// Where results go.
    pub folder: PathBuf,
}

/// A scene to measure.
pub struct Target {
    /// Its name in the report.
    pub name: String,
    /// The scene.
    pub scene: Scene,
    /// Ready for the passes.
    pub packed: PackedScene,
    /// View.
    pub camera: Camera,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Target {
    fn request(&self, method: &Method) -> Request {
        Request::new(self.camera, [self.width, self.height], method.technique, method.settings.clone())
    }

    /// A copy for a chain, which moves it.
    fn copy(&self) -> Result<PackedScene, PackError> {
        Self::pack(&self.scene)
    }

    /// A scene, packed for any method. What is measured is sampling, even where light has a closed form.
    ///
    /// # Errors
    /// As [`PackedScene::new`].
    pub fn pack(scene: &Scene) -> Result<PackedScene, PackError> {
        PackedScene::with(scene, &Moment::default(), PackOptions { light_cuts: true, ..PackOptions::default() })
    }
}

/// Why a run came to nothing.
#[derive(Debug, Error)]
pub enum BenchError {
    /// A method.
    #[error(transparent)]
    Method(#[from] MethodError),
    /// A reference.
    #[error(transparent)]
    Judge(#[from] JudgeError),
    /// A picture.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The results.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The folder of the results.
    #[error("cannot create the folder of the results ({source}); choose another with -o: {}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl HasExit for BenchError {
    fn exit(&self) -> Exit {
        match self {
            Self::Method(error) => error.exit(),
            Self::Judge(error) => error.exit(),
            Self::Render(error) => error.exit(),
            Self::Output(error) => error.exit(),
            Self::Folder { .. } => Exit::CannotCreate,
        }
    }
}

/// Whether to end before all is measured.
pub struct Halt<'a> {
    deadline: Option<Instant>,
    is_interrupted: &'a dyn Fn() -> bool,
}

impl Halt<'_> {
    /// Why, if so.
    pub fn reason(&self) -> Option<&'static str> {
        if (self.is_interrupted)() {
            return Some("interrupted");
        }
        self.deadline.filter(|deadline| Instant::now() >= *deadline).map(|_| "out of time")
    }
}

/// Pictures of a scene, for the report.
struct Gallery {
    scene: String,
    reference: crate::output::Picture,
    shown: Vec<Shown>,
}

/// Measures; writes `results.json`, `results.csv` and `report.html` after each scene, so that nothing that was measured is
/// lost. `is_interrupted` ends it early, and `tell` is told what it is about to do.
///
/// # Errors
/// If a reference can't be used, a picture can't be made or a file can't be written.
pub fn run(
    plan: &Plan,
    machine: results::Machine,
    backend: &Backend<'_>,
    is_interrupted: &dyn Fn() -> bool,
    tell: &dyn Fn(&str),
) -> Result<Results, BenchError> {
    std::fs::create_dir_all(&plan.folder).map_err(|source| BenchError::Folder { path: plan.folder.clone(), source })?;
    let file = |name: &str| Destination::File(plan.folder.join(name));
    for name in FILES {
        atomic::check(&file(name))?;
    }
    let halt = Halt { deadline: plan.deadline, is_interrupted };
    let (independent, chained): (Vec<Method>, Vec<Method>) =
        plan.methods.iter().cloned().partition(Method::is_independent);
    let mut results =
        Results { schema: SCHEMA.to_owned(), machine, options: plan.options.clone(), ..Results::default() };
    let (mut galleries, mut first_judge) = (Vec::new(), None);
    let write = |results: &Results, galleries: &[Gallery]| -> Result<(), OutputError> {
        let failed = |reason: String| OutputError::Encode { format: "JSON", reason };
        let json = serde_json::to_vec_pretty(results).map_err(|error| failed(error.to_string()))?;
        atomic::write(&file(FILES[0]), &json)?;
        atomic::write(&file(FILES[1]), &results.to_csv().map_err(|error| failed(error.to_string()))?)?;
        atomic::write(&file(FILES[2]), html::page(results, galleries).as_bytes())
    };
    let RunOptions { times_s, seeds, chain_frames, .. } = &plan.options;
    for target in &plan.scenes {
        if let Some(reason) = halt.reason() {
            results.left_out.push(format!("scene {}: {reason}", target.name));
            continue;
        }
        tell(&format!("{}: reference", target.name));
        let judge = Judge::get(target, plan.reference.as_deref(), plan.reference_time, backend, &halt)?;
        tell(&format!("{}: {} independent methods", target.name, independent.len()));
        let (mut found, mut shown) = stills::measure(target, &independent, &judge, times_s, *seeds, backend, &halt)?;
        tell(&format!("{}: {} chains", target.name, chained.len()));
        let (chains, more) = chains::measure(target, &chained, &judge, *chain_frames, *seeds, backend, &halt)?;
        found.extend(chains);
        shown.extend(more);
        let unit = found.iter().find(|m| m.name == UNIT).map_or(f64::NAN, |m| m.relative_variance.value);
        found.iter_mut().for_each(|m| m.n_eff = unit / m.relative_variance.value);
        results.scenes.push(SceneResults {
            name: target.name.clone(),
            triangles: target.scene.triangle_count(),
            lights: target.scene.emissive_triangle_count(),
            reference: judge.facts.clone(),
            methods: found,
            peak_bytes: peak_bytes(),
        });
        galleries.push(Gallery { scene: target.name.clone(), reference: judge.picture.clone(), shown });
        first_judge.get_or_insert(judge);
        if let Some(reason) = halt.reason() {
            results.left_out.push(format!("a part of scene {}: {reason}", target.name));
        }
        write(&results, &galleries)?;
    }
    if let Some(judge) = first_judge.filter(|_| plan.extra_frames > 0) {
        extras(plan, &judge, backend, &halt, tell, &mut results)?;
        write(&results, &galleries)?;
    }
    Ok(results)
}

/// Names of the files that a run leaves.
pub const FILES: [&str; 3] = ["results.json", "results.csv", "report.html"];

/// Cost against the number of lights, and one knob at a time.
fn extras(
    plan: &Plan,
    judge: &Judge,
    backend: &Backend<'_>,
    halt: &Halt<'_>,
    tell: &dyn Fn(&str),
    results: &mut Results,
) -> Result<(), BenchError> {
    if let Some(target) = plan.scenes.first() {
        tell(&format!("{}: one knob at a time", target.name));
        let mut turned = Vec::new();
        for (key, values) in ABLATION {
            for value in *values {
                turned.push((
                    *key,
                    *value,
                    Method::new(key, Technique::RealTime, [format!("{key}={value}").as_str()])?,
                ));
            }
        }
        let default = Method::new("default", Technique::RealTime, [])?;
        // One knob after the other, the default among its values: turns are short, and all values of a knob meet alike.
        for (key, _) in ABLATION {
            let of_knob: Vec<_> = turned.iter().filter(|turn| turn.0 == *key).collect();
            let methods: Vec<Method> = of_knob.iter().map(|turn| turn.2.clone()).collect();
            if let Some(reason) = halt.reason() {
                results.left_out.push(format!("ablation of {key}: {reason}"));
                continue;
            }
            let (found, _) = chains::measure(target, &methods, judge, plan.extra_frames, 1, backend, halt)?;
            for ((key, value, method), found) in of_knob.into_iter().zip(found) {
                results.ablation.push(Ablation {
                    scene: target.name.clone(),
                    knob: (*key).to_owned(),
                    value: (*value).to_owned(),
                    is_default: method.settings == default.settings,
                    frame_ms: found.frame_ms,
                    rel_mse: found.relative_variance,
                });
            }
        }
    }
    if let Some(reason) = halt.reason() {
        results.left_out.push(format!("cost against lights: {reason}"));
        return Ok(());
    }
    tell("park: cost against lights");
    let park = crate::scene::builtin::find("park").map(|park| (park.build)());
    let Some((park, camera)) = park.and_then(|park| park.camera.map(|camera| (park, camera))) else { return Ok(()) };
    let mut targets = Vec::new();
    for wanted in LIGHT_COUNTS {
        let scene = lights::with_lights(&park, *wanted);
        let packed = Target::pack(&scene).map_err(RenderError::from)?;
        let (width, height) = (plan.options.width, plan.options.height);
        targets.push(Target { name: format!("park, {wanted}"), scene, packed, camera, width, height });
    }
    let moving = ["scene.time_step=0.016666668"];
    for technique in [Technique::Still, Technique::RealTime] {
        let mut method = Method::new("balanced", technique, [])?;
        for knob in moving {
            method.settings.apply(knob).expect("a knob and its range");
        }
        let pairs: Vec<(&Target, &Method)> = targets.iter().map(|target| (target, &method)).collect();
        let times = chains::time_in_turns(&pairs, plan.extra_frames, backend, halt)?;
        for (index, (target, time)) in targets.iter().zip(times).enumerate() {
            if results.lights.len() <= index {
                let lights = target.scene.emissive_triangle_count();
                results.lights.push(LightCost { lights, ..LightCost::default() });
            }
            let row = &mut results.lights[index];
            if technique == Technique::Still { row.still_ms = time } else { row.chain_ms = time }
        }
    }
    if let Some(reason) = halt.reason() {
        results.left_out.push(format!("a part of cost against lights: {reason}"));
    }
    Ok(())
}

/// Most memory that this process has had, in bytes; 0 where the system doesn't say.
fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().split(' ').next()?.parse::<u64>().ok()).map_or(0, |kib| kib << 10)
}
