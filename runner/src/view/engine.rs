//! Frames of the viewer: which kind comes next, on which processor, of which scene.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use glam::{UVec2, Vec3};
use thiserror::Error;
use weir_shader::wiring::Access;
use weir_shared::{
    frame::{Frame, FramePair},
    moments::Moments,
    reservoir::Reservoir,
    surface::Surface,
};

use super::{
    accumulation::{Accumulation, Mode},
    buffers::{self, View},
    exposure, lights,
    pick::{self, Picked},
    want::{Compare, Want},
};
use crate::{
    budget::{Counts, TimeBudget},
    executor::{
        AlignedBytes, Executor, SceneBuffers,
        cpu::CpuExecutor,
        gpu::{Gpu, GpuError, GpuExecutor, GpuScene, Loader, Module},
    },
    graph::{GraphError, Plan},
    margin::Batches,
    packed::{Changed, Moment, PackError, PackedScene},
    reference::{Estimate, Reference},
    render::{Request, Stop, display_of, facts_of, frame_of, pixel_moments},
    scene::{Camera, Scene, bounds::Bounds, choice::Choice, error::SceneError},
    sequence::{Sequence, Shot},
    settings::Settings,
    technique::{Technique, direct_light},
};

/// Why there is no frame.
#[derive(Debug, Error)]
pub enum EngineError {
    /// The scene can't be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The scene can't be packed, or not at this moment.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The frame has no plan.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// Where the pixels of a picture are: 8-bit sRGB, red in the low byte.
#[derive(Clone)]
pub enum Pixels {
    /// In a buffer of the GPU.
    Gpu(wgpu::Buffer),
    /// On the host.
    Host(Arc<Vec<u32>>),
}

/// A picture, ready to be shown.
#[derive(Clone)]
pub struct Shown {
    /// Size.
    pub size: [u32; 2],
    /// Its pixels.
    pub pixels: Pixels,
}

/// What the frame of a technique is made of: a pass or a reason why not.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Passes in order, each with what it reads and writes.
    pub steps: Vec<Scheduled>,
    /// Passes that are left out, and why.
    pub left_out: Vec<(&'static str, String)>,
    /// Bytes of the frame's buffers.
    pub frame_bytes: u64,
}

/// A pass of a schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Scheduled {
    /// Its name.
    pub pass: &'static str,
    /// Resources that it reads; the scene's are left out.
    pub reads: Vec<&'static str>,
    /// Resources that it writes.
    pub writes: Vec<&'static str>,
}

/// A frame, and what is known about it.
#[derive(Clone)]
pub struct Frames {
    /// The picture.
    pub shown: Shown,
    /// What it is compared with.
    pub other: Option<Shown>,
    /// How it was made.
    pub technique: Technique,
    /// Samples of each pixel that were averaged.
    pub samples: u32,
    /// Estimated error of the picture, in percent, while it stands still.
    pub error_percent: Option<f32>,
    /// Time of each pass, where it is known.
    pub times: Vec<(&'static str, Duration)>,
    /// The schedule.
    pub schedule: Arc<Schedule>,
    /// Exposure that it was shown with.
    pub exposure: f32,
    /// Time of the animation, in seconds.
    pub time_s: f32,
    /// Rays of each pixel, at most.
    pub rays: u32,
    /// Samples of the reference, where there is one.
    pub reference_samples: u64,
    /// The pixel that is inspected.
    pub inspected: Option<Inspected>,
    /// What has become of the time budget, where there is one.
    pub budget: Option<BudgetFacts>,
}

/// A time budget and what it has come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BudgetFacts {
    /// The time that the frame took.
    pub frame: Duration,
    /// The rung of the settings that made it, from 0.
    pub level: usize,
    /// Frames so far, and those within the budget.
    pub counts: Counts,
    /// Whether even the cheapest settings take longer.
    pub out_of_reach: bool,
}

/// A pixel, as the buffers have it.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspected {
    /// Which.
    pub px: UVec2,
    /// What it sees.
    pub surface: Surface,
    /// What it holds at the end of the chain.
    pub reservoir: Reservoir,
    /// Its mean and variance.
    pub moments: Moments,
    /// How far its surface has moved on the screen, in pixels.
    pub motion: Option<glam::Vec2>,
    /// The light that it holds, in words.
    pub light: String,
    /// Number of the frame.
    pub frame: u32,
}

/// What is known of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneFacts {
    /// Its name.
    pub name: String,
    /// Triangles over all instances.
    pub triangles: u64,
    /// Emissive ones.
    pub lights: u64,
    /// Instances.
    pub instances: usize,
    /// Whether anything moves over time.
    pub moves: bool,
    /// Whether there is an environment map.
    pub environment: bool,
    /// Bytes of its buffers.
    pub bytes: u64,
    /// Its box.
    pub bounds: Option<Bounds>,
}

/// Where frames are computed.
enum Place {
    Cpu,
    Gpu(Gpu, GpuScene),
}

/// An executor with its plan.
struct Chain {
    technique: Technique,
    plan: Plan,
    executor: Executor,
    schedule: Arc<Schedule>,
}

/// A second picture of the same frames, by other settings.
#[derive(Default)]
struct Second {
    real_time: Option<Chain>,
    still: Option<Chain>,
    last: Option<Frame>,
}

/// What has to stay the same for a picture to stand still.
#[derive(Clone, PartialEq)]
struct Key {
    camera: Camera,
    moment: Moment,
    settings: Settings,
    size: [u32; 2],
    view: View,
    compare: Compare,
    environment: (bool, u32, u32),
    inspects: bool,
}

/// A scene on its way through frames.
pub struct Engine {
    base: Scene,
    scattered: u32,
    sequence: Sequence<PackedScene>,
    place: Place,
    real_time: Option<Chain>,
    still: Option<Chain>,
    second: Second,
    accumulation: Accumulation,
    estimates: Vec<Estimate>,
    exposure: f32,
    key: Option<Key>,
    dynamic: bool,
    facts: SceneFacts,
    /// Frames of the still in batches, which say how far off it is.
    batches: Option<Batches>,
    /// The time budget, and the settings that it started from.
    budget: Option<(TimeBudget, Settings)>,
}

impl Engine {
    /// Reads a scene; computes on `gpu`, or on the host without one. Warnings in words.
    ///
    /// # Errors
    /// If the scene can't be read, packed or copied to the GPU.
    pub fn open(choice: &Choice, gpu: Option<&Gpu>) -> Result<(Self, Vec<String>), EngineError> {
        let loaded = choice.read()?;
        let warnings = loaded.warnings.iter().map(ToString::to_string).collect();
        Ok((Self::new(loaded.scene, gpu)?, warnings))
    }

    /// For a scene that is there already.
    ///
    /// # Errors
    /// If it can't be packed or copied to the GPU.
    pub fn new(scene: Scene, gpu: Option<&Gpu>) -> Result<Self, EngineError> {
        let packed = PackedScene::new(&scene, 0.0)?;
        let place = place(gpu, &packed)?;
        let request = Request {
            width: 1,
            height: 1,
            camera: scene.camera.unwrap_or_else(|| framing(&scene)),
            seed: 0,
            stop: Stop::Samples(1),
            curve: crate::technique::ToneCurve::default(),
            exposure: 1.0,
            technique: Technique::RealTime,
            settings: Settings::default(),
        };
        let facts = facts(&scene, &packed);
        Ok(Self {
            base: scene,
            scattered: 0,
            sequence: Sequence::new(packed, request),
            place,
            real_time: None,
            still: None,
            second: Second::default(),
            accumulation: Accumulation::default(),
            estimates: Vec::new(),
            exposure: 1.0,
            key: None,
            dynamic: false,
            facts,
            batches: None,
            budget: None,
        })
    }

    /// What is known of the scene.
    pub fn facts(&self) -> &SceneFacts {
        &self.facts
    }

    /// The camera that the scene suggests, or one that sees all of it.
    pub fn home(&self) -> Camera {
        self.base.camera.unwrap_or_else(|| framing(&self.base))
    }

    /// Whether it computes on a GPU.
    pub fn is_on_gpu(&self) -> bool {
        matches!(self.place, Place::Gpu(..))
    }

    /// Goes on elsewhere, as after the loss of a GPU; the picture starts anew.
    ///
    /// # Errors
    /// If the scene can't be copied there.
    pub fn move_to(&mut self, gpu: Option<&Gpu>) -> Result<(), EngineError> {
        // What is there is let go of first: two copies may not fit.
        self.forget();
        self.place = Place::Cpu;
        self.place = place(gpu, self.sequence.packed())?;
        Ok(())
    }

    /// Lets go of all frames.
    fn forget(&mut self) {
        (self.real_time, self.still, self.second) = (None, None, Second::default());
        self.key = None;
        self.sequence.cut();
    }

    /// Packs the scene anew, with what was added to it.
    fn repack(&mut self, moment: &Moment) -> Result<(), EngineError> {
        let mut scene = self.base.clone();
        lights::scatter(&mut scene, self.scattered);
        let packed =
            if self.dynamic { PackedScene::dynamic(&scene, moment)? } else { PackedScene::new(&scene, moment.time_s)? };
        self.forget();
        let gpu = match &self.place {
            Place::Cpu => None,
            Place::Gpu(gpu, _) => Some(gpu.clone()),
        };
        self.place = Place::Cpu;
        self.facts = facts(&scene, &packed);
        self.sequence = Sequence::new(packed, self.sequence.request.clone());
        self.place = place(gpu.as_ref(), self.sequence.packed())?;
        Ok(())
    }

    /// Another environment map for the scene.
    ///
    /// # Errors
    /// If the scene no longer fits with it.
    pub fn set_environment(&mut self, map: crate::scene::Environment) -> Result<(), EngineError> {
        let before = self.base.environment.replace(map);
        let moment = Moment::default();
        self.repack(&moment).inspect_err(|_| self.base.environment = before)
    }

    /// What a ray through a pixel of the last frame finds.
    pub fn pick(&self, want: &Want, px: UVec2) -> Option<Picked> {
        let frame = frame_of(self.sequence.packed(), &self.request(want, Technique::RealTime));
        pick::at(self.sequence.packed(), &frame, px)
    }

    /// Makes the light of a pick an instance of its own, so that it can be moved.
    ///
    /// # Errors
    /// If the scene no longer fits then.
    pub fn take_light(&mut self, picked: &Picked, want: &Want) -> Result<Option<u32>, EngineError> {
        let Some(light) = lights::detach(&mut self.base, picked.instance, picked.corners_object) else {
            return Ok(None);
        };
        self.dynamic = true;
        self.repack(&lights::moment(&self.base, want.time_s, &want.edits))?;
        Ok(Some(light))
    }

    fn request(&self, want: &Want, technique: Technique) -> Request {
        Request {
            width: want.size[0],
            height: want.size[1],
            camera: want.camera,
            seed: want.seed,
            stop: Stop::Samples(1),
            curve: want.curve,
            exposure: self.exposure,
            technique,
            settings: want.settings.clone(),
        }
    }

    /// The next frame; nothing if the last one is good enough and nothing has changed.
    ///
    /// # Errors
    /// If the scene can't be shown like that or the GPU fails.
    pub fn frame(&mut self, want: &Want) -> Result<Option<Frames>, EngineError> {
        let moment = lights::moment(&self.base, want.time_s, &want.edits);
        if want.scattered != self.scattered {
            self.scattered = want.scattered;
            self.repack(&moment)?;
        }
        if !want.auto_exposure {
            self.exposure = want.exposure;
        }
        let environment = (want.environment, want.environment_rotation_deg, want.environment_scale);
        self.sequence.packed_mut().turn_environment(environment.1, if environment.0 { environment.2 } else { 0.0 });
        let key = Key {
            camera: want.camera,
            // Time alone moves nothing in a scene that stands still.
            moment: if self.facts.moves { moment.clone() } else { Moment { time_s: 0.0, ..moment.clone() } },
            settings: Settings { time_s: 0.0, ..want.settings.clone() },
            size: want.size,
            view: want.view,
            compare: want.compare,
            environment: (environment.0, environment.1.to_bits(), environment.2.to_bits()),
            inspects: want.inspect.is_some(),
        };
        let moved = self.key.as_ref() != Some(&key);
        if moved {
            self.estimates.clear();
        }
        self.key = Some(key);
        // A still is made of frames of one moment.
        let mode = self.accumulation.next(moved, want.accumulate, want.goal_percent);
        let refines = want.compare == Compare::Reference || want.view == View::Error;
        let (technique, samples) = match mode {
            Mode::Rest if refines && self.estimates.first().is_none_or(|e| e.count < 4096) => {
                (Technique::Still, self.accumulation.samples().max(1) - 1)
            }
            Mode::Rest => return Ok(None),
            Mode::RealTime => (Technique::RealTime, 0),
            Mode::Still(samples) => (Technique::Still, samples),
        };
        let start = Instant::now();
        let mut request = self.request(want, technique);
        self.keep_budget(want);
        if let Some((budget, _)) = self.budget.as_ref().filter(|_| technique == Technique::RealTime) {
            request.settings = budget.settings().clone();
        }
        let (frames, changed) = if technique == Technique::RealTime {
            self.sequence.request = request.clone();
            self.sequence.next(&Shot { moment, camera: want.camera })?
        } else {
            (self.sequence.independent(&request, samples), Vec::new())
        };
        let mut made = self.show(want, &request, &frames, changed)?;
        if let Some((budget, _)) = self.budget.as_mut().filter(|_| technique == Technique::RealTime) {
            let level = budget.level();
            self.real_time.as_mut().map_or(Ok(()), |chain| chain.executor.finish())?;
            let frame = start.elapsed();
            budget.observe(frame);
            let (counts, out_of_reach) = (budget.counts(), budget.is_out_of_reach());
            made.budget = Some(BudgetFacts { frame, level, counts, out_of_reach });
        }
        Ok(Some(made))
    }

    /// Makes, changes or lets go of the time budget.
    fn keep_budget(&mut self, want: &Want) {
        let Some(ms) = want.budget_ms else {
            self.budget = None;
            return;
        };
        let wanted = Duration::from_secs_f32(ms / 1e3);
        match &mut self.budget {
            Some((budget, base)) => {
                if base != &want.settings {
                    budget.set_base(&want.settings);
                    base.clone_from(&want.settings);
                }
                if budget.budget().abs_diff(wanted) > Duration::from_micros(10) {
                    budget.set_budget(wanted);
                }
            }
            None => self.budget = Some((TimeBudget::new(wanted, &want.settings), want.settings.clone())),
        }
    }

    /// How far the still is off, where another batch of its frames is full.
    fn measure(&mut self, accumulated: u32) -> Result<(), GpuError> {
        let Some(chain) = &mut self.still else { return Ok(()) };
        if accumulated == 1 {
            let pixels = chain.plan.facts.width as usize * chain.plan.facts.height as usize;
            self.batches = Some(Batches::new(pixels, None));
        }
        let Some(batches) = self.batches.as_mut().filter(|batches| batches.due_in(accumulated) == 0) else {
            return Ok(());
        };
        let moments = chain.executor.read(&chain.plan, "moments")?;
        let moments: Vec<_> = moments.elements::<Moments>().iter().map(pixel_moments).collect();
        batches.add(accumulated, |pixel| moments[pixel]);
        if let Some(margin) = batches.margin(accumulated, &moments) {
            self.accumulation.measured(100.0 * margin.error as f32);
        }
        Ok(())
    }

    /// Computes a frame and what is shown of it.
    fn show(
        &mut self,
        want: &Want,
        request: &Request,
        frames: &FramePair,
        changed: Vec<Changed>,
    ) -> Result<Frames, EngineError> {
        let (sequence, place) = (&mut self.sequence, &self.place);
        let scene = sequence.packed().buffers();
        update(place, scene, changed)?;
        let chain = match request.technique {
            Technique::RealTime => &mut self.real_time,
            _ => &mut self.still,
        };
        let outputs = outputs_of(want, request.technique);
        let made_anew = chain_for(chain, place, sequence.packed(), request, &outputs)?;
        let chain = chain.as_mut().expect("made above");
        // The history of another plan is not that of this one.
        let mut frames = *frames;
        if made_anew {
            frames.now.has_history = 0;
        }
        let times = chain.executor.run(&chain.plan, scene, &frames)?;
        if want.auto_exposure && (frames.now.accumulated % 8 == 0 || frames.now.accumulated < 16) {
            let mean = log_mean(chain, request)?;
            self.exposure = exposure::adapted(self.exposure, mean, want.exposure);
        }
        if request.technique == Technique::Still {
            self.measure(frames.now.accumulated + 1)?;
        }
        let (sequence, place) = (&mut self.sequence, &self.place);
        let chain = match request.technique {
            Technique::RealTime => &mut self.real_time,
            _ => &mut self.still,
        };
        let chain = chain.as_mut().expect("made above");
        if self.estimates.len() != (request.width * request.height) as usize {
            self.estimates = vec![Estimate::default(); (request.width * request.height) as usize];
        }
        if want.compare == Compare::Reference || want.view == View::Error {
            let block = self.estimates[0].count;
            let reference = Reference::new(sequence.packed(), frames.now, request.settings.path_length);
            reference.accumulate(&mut self.estimates, block, 1);
        }
        let inspected = match want.inspect {
            Some(px) => Some(inspect(chain, sequence.packed(), &frames, px)?),
            None => None,
        };
        let size = [request.width, request.height];
        let pixels = if want.view == View::Picture {
            pixels_of(chain)?
        } else {
            let colors = colors(chain, want.view, sequence.packed(), &frames, &self.estimates)?;
            Pixels::Host(Arc::new(colors))
        };
        let other = match want.compare {
            Compare::Off => None,
            Compare::Reference => {
                let mean = |e: &Estimate| display_of(e.mean.as_vec3() * request.exposure, request.curve);
                Some(Pixels::Host(Arc::new(self.estimates.iter().map(mean).collect())))
            }
            Compare::With(preset) => {
                let mut settings = request.settings.clone();
                settings.apply(&format!("preset={}", preset.name())).expect("a preset");
                let request = Request { settings, ..request.clone() };
                Some(self.second.pixels(place, sequence.packed(), &request, &frames)?)
            }
        };
        Ok(Frames {
            shown: Shown { size, pixels },
            other: other.map(|pixels| Shown { size, pixels }),
            technique: request.technique,
            samples: frames.now.accumulated + 1,
            error_percent: self.accumulation.error_percent(),
            times,
            schedule: Arc::clone(&chain.schedule),
            exposure: request.exposure,
            time_s: want.time_s,
            rays: rays(&chain.plan, &request.settings),
            reference_samples: self.estimates.first().map_or(0, |e| e.count),
            inspected,
            budget: None,
        })
    }

    /// Mean radiance of the picture as it is, and the variance of it.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn moments(&mut self) -> Result<Option<Vec<Moments>>, EngineError> {
        let chain = if self.accumulation.samples() > 0 { &mut self.still } else { &mut self.real_time };
        let Some(chain) = chain else { return Ok(None) };
        Ok(Some(chain.executor.read(&chain.plan, "moments")?.elements().to_vec()))
    }

    /// The picture as 8-bit sRGB.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn display(&mut self) -> Result<Option<Vec<u32>>, EngineError> {
        let chain = if self.accumulation.samples() > 0 { &mut self.still } else { &mut self.real_time };
        let Some(chain) = chain else { return Ok(None) };
        Ok(Some(chain.executor.read(&chain.plan, "display")?.elements().to_vec()))
    }

    /// The scene as the last frame shows it.
    pub fn packed(&self) -> &PackedScene {
        self.sequence.packed()
    }
}

impl Second {
    fn pixels(
        &mut self,
        place: &Place,
        packed: &PackedScene,
        request: &Request,
        frames: &FramePair,
    ) -> Result<Pixels, EngineError> {
        let real_time = request.technique == Technique::RealTime;
        let chain = if real_time { &mut self.real_time } else { &mut self.still };
        let made_anew = chain_for(chain, place, packed, request, &["moments", "display"])?;
        let chain = chain.as_mut().expect("made above");
        let last = self.last.filter(|_| !made_anew && real_time && frames.now.has_history != 0);
        let (index, accumulated) = (frames.now.index, frames.now.accumulated);
        let has_history = u32::from(last.is_some());
        let now = Frame { index, accumulated, has_history, ..frame_of(packed, request) };
        if real_time {
            self.last = Some(now);
        }
        chain.executor.run(&chain.plan, packed.buffers(), &FramePair { now, prev: last.unwrap_or(now) })?;
        Ok(pixels_of(chain)?)
    }
}

fn framing(scene: &Scene) -> Camera {
    Camera::framing(scene.bounds().unwrap_or(Bounds { min: Vec3::ZERO, max: Vec3::ONE }))
}

fn facts(scene: &Scene, packed: &PackedScene) -> SceneFacts {
    SceneFacts {
        name: scene.name.clone(),
        triangles: scene.triangle_count(),
        lights: scene.emissive_triangle_count(),
        instances: scene.instances.len(),
        moves: packed.moves(),
        environment: scene.environment.is_some(),
        bytes: packed.bytes(),
        bounds: scene.bounds(),
    }
}

fn place(gpu: Option<&Gpu>, packed: &PackedScene) -> Result<Place, GpuError> {
    Ok(match gpu {
        None => Place::Cpu,
        Some(gpu) => Place::Gpu(gpu.clone(), pollster::block_on(GpuScene::upload(gpu, packed.buffers()))?),
    })
}

fn update(place: &Place, scene: SceneBuffers<'_>, changed: Vec<Changed>) -> Result<(), GpuError> {
    if let Place::Gpu(gpu, on_gpu) = place {
        for Changed { buffer, range } in changed {
            on_gpu.update(gpu, buffer, range.start as u64, &scene.bytes(buffer)[range])?;
        }
    }
    Ok(())
}

/// What has to outlive the frame: what is shown, measured or inspected of it.
fn outputs_of(want: &Want, technique: Technique) -> Vec<&'static str> {
    let mut outputs = vec!["moments", "display"];
    let inspects = want.inspect.is_some();
    if inspects || want.view.needs_surfaces() {
        outputs.push("surfaces");
    }
    if (inspects || want.view.needs_reservoirs()) && technique == Technique::RealTime {
        outputs.push("reservoirs");
    }
    outputs
}

/// The resource that holds what is shaded. In real time that is what the next frame remembers.
fn held(plan: &Plan) -> Option<&'static str> {
    let written = |step: &crate::graph::Planned| {
        let mut writes = step.pass.bindings.iter().zip(&step.names).filter(|(b, _)| b.access == Access::Write);
        writes.find(|(b, _)| ["fresh", "visible", "merged"].contains(&b.name)).map(|(_, name)| *name)
    };
    plan.steps.iter().rev().find_map(written)
}

/// Makes the chain unless there is one of the same plan; says whether it did.
fn chain_for(
    chain: &mut Option<Chain>,
    place: &Place,
    packed: &PackedScene,
    request: &Request,
    outputs: &[&'static str],
) -> Result<bool, EngineError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let planned =
        |outputs: &[&'static str]| direct_light(request.technique, &request.settings, &facts, request.curve, outputs);
    let mut plan = planned(outputs)?;
    // The reservoirs of a still have a name for each round; those of the last are the ones to keep.
    if request.technique == Technique::Still
        && let Some(held) = held(&plan)
    {
        plan = planned(&[outputs, &[held]].concat())?;
    }
    if chain.as_ref().is_some_and(|chain| chain.technique == request.technique && same(&chain.plan, &plan)) {
        return Ok(false);
    }
    // The old one is let go of first: two may not fit.
    *chain = None;
    let executor = match place {
        Place::Cpu => Executor::Cpu(Box::new(CpuExecutor::new(&plan))),
        Place::Gpu(gpu, scene) => {
            let made = GpuExecutor::on_scene(gpu, &plan, scene, Loader::Auto, Module::Plain);
            let executor = pollster::block_on(made)?;
            gpu.store_pipelines();
            Executor::Gpu(Box::new(executor))
        }
    };
    let schedule = Arc::new(schedule(&plan));
    *chain = Some(Chain { technique: request.technique, plan, executor, schedule });
    Ok(true)
}

/// Whether two plans run the same passes on the same memory.
fn same(a: &Plan, b: &Plan) -> bool {
    let is_like = |(a, b): (&crate::graph::Planned, &crate::graph::Planned)| {
        a.variant.entry_point == b.variant.entry_point && (&a.slots, &a.names, a.round) == (&b.slots, &b.names, b.round)
    };
    a.facts == b.facts
        && a.outputs == b.outputs
        && a.pool == b.pool
        && a.history == b.history
        && a.steps.len() == b.steps.len()
        && a.steps.iter().zip(&b.steps).all(is_like)
}

fn schedule(plan: &Plan) -> Schedule {
    let names = |step: &crate::graph::Planned, access: Access| {
        let used = step.slots.iter().zip(&step.names);
        let used = used.filter(|((a, slot), _)| *a == access && !matches!(slot, crate::graph::Slot::Scene(_)));
        used.map(|(_, name)| *name).collect::<Vec<_>>()
    };
    let scheduled = |step: &crate::graph::Planned| Scheduled {
        pass: step.pass.name,
        reads: names(step, Access::Read),
        writes: names(step, Access::Write),
    };
    Schedule {
        steps: plan.steps.iter().map(scheduled).collect(),
        left_out: plan.culled.iter().map(|(pass, why)| (*pass, why.to_string())).collect(),
        frame_bytes: plan.frame_bytes(),
    }
}

/// Rays of a pixel in a frame, at most.
fn rays(plan: &Plan, settings: &Settings) -> u32 {
    use weir_shared::reuse::probe;
    let merges = |neighbors: u32| match settings.rays.probe() {
        probe::NONE => 0,
        probe::ONE => 1,
        _ => 1 + neighbors,
    };
    let of = |pass: &str| match pass {
        "primary" => 1,
        "bsdf_rays" | "visibility" => settings.reservoirs,
        "temporal_rays" => settings.reservoirs * merges(1 + settings.temporal_neighbors),
        "spatial_rays" => settings.reservoirs * merges(settings.spatial_neighbors.max(settings.still_neighbors)),
        _ => 0,
    };
    plan.steps.iter().map(|step| of(step.pass.name)).sum()
}

/// Looks at some rows of the picture.
fn log_mean(chain: &mut Chain, request: &Request) -> Result<Option<f32>, GpuError> {
    let row_bytes = u64::from(request.width) * size_of::<Moments>() as u64;
    let rows = exposure::rows(request.height);
    let parts: Vec<_> = rows.iter().map(|&y| u64::from(y) * row_bytes..u64::from(y + 1) * row_bytes).collect();
    let bytes = chain.executor.read_parts(&chain.plan, "moments", &parts)?;
    Ok(exposure::log_mean(bytes.elements()))
}

fn pixels_of(chain: &mut Chain) -> Result<Pixels, GpuError> {
    Ok(match &chain.executor {
        Executor::Gpu(executor) => Pixels::Gpu(executor.output_buffer("display").expect("an output").clone()),
        Executor::Cpu(_) => Pixels::Host(Arc::new(chain.executor.read(&chain.plan, "display")?.elements().to_vec())),
    })
}

fn colors(
    chain: &mut Chain,
    view: View,
    packed: &PackedScene,
    frames: &FramePair,
    estimates: &[Estimate],
) -> Result<Vec<u32>, GpuError> {
    let mut read = |wanted: bool, name: Option<&str>| match name.filter(|_| wanted) {
        Some(name) => chain.executor.read(&chain.plan, name),
        None => Ok(AlignedBytes::default()),
    };
    let reservoirs = held(&chain.plan);
    let surfaces = read(view.needs_surfaces(), Some("surfaces"))?;
    let reservoirs = read(view.needs_reservoirs(), reservoirs)?;
    let moments = read(view.needs_moments(), Some("moments"))?;
    let reference: Vec<Vec3> = match view {
        View::Error => estimates.iter().map(|e| e.mean.as_vec3()).collect(),
        _ => Vec::new(),
    };
    Ok(buffers::false_color(
        view,
        &buffers::Buffers {
            frames,
            scene: pick::view_of(packed),
            surfaces: surfaces.elements(),
            reservoirs: reservoirs.elements(),
            moments: moments.elements(),
            reference: &reference,
        },
    ))
}

fn inspect(chain: &mut Chain, packed: &PackedScene, frames: &FramePair, px: UVec2) -> Result<Inspected, GpuError> {
    let frame = &frames.now;
    let px = px.min(UVec2::new(frame.width - 1, frame.height - 1));
    let mut element = |name: &str, index: u32, bytes: u64| {
        let at = u64::from(index) * bytes;
        chain.executor.read_parts(&chain.plan, name, &[at..at + bytes])
    };
    let surface: Surface = element("surfaces", frame.index_of(px), size_of::<Surface>() as u64)?.elements()[0];
    let moments: Moments = element("moments", frame.index_of(px), size_of::<Moments>() as u64)?.elements()[0];
    let reservoir = match held(&chain.plan) {
        Some(name) => {
            let at = frame.index_of_reservoir(px, 0);
            let bytes = u64::from(at) * size_of::<Reservoir>() as u64;
            let end = bytes + size_of::<Reservoir>() as u64;
            chain.executor.read_parts(&chain.plan, name, &[bytes..end])?.elements()[0]
        }
        None => Reservoir::EMPTY,
    };
    let scene = pick::view_of(packed);
    Ok(Inspected {
        px,
        surface,
        reservoir,
        moments,
        motion: (!surface.is_sky()).then(|| buffers::motion(frames, &scene, &surface)).flatten(),
        light: pick::light_in_words(packed, frame, &reservoir),
        frame: frame.index,
    })
}
