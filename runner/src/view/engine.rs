//! Frames of the viewer: which kind comes next, on which processor, of which scene.

mod chain;
mod look;
mod picture;
mod prepared;
mod second;
mod shown;

use std::time::Instant;

use glam::{UVec2, Vec3};
use thiserror::Error;
use weir_shared::moments::Moments;

pub use self::shown::{BudgetFacts, Frames, Inspected, Pixels, SceneFacts, Schedule, Scheduled, Shown};
use self::{
    chain::{Chain, Place, place},
    prepared::Prepared,
    second::Second,
};
use super::{
    accumulation::{Accumulation, Mode},
    buffers::View,
    lights,
    pick::{self, Picked},
    want::{Compare, Want},
};
use crate::{
    budget::TimeBudget,
    executor::{
        cpu::Order,
        gpu::{Gpu, GpuError, Preparation},
    },
    faults::Faults,
    graph::GraphError,
    margin::Batches,
    packed::{Moment, PackError, PackOptions, PackedScene},
    reference::Estimate,
    render::{Backend, RenderError, Request, frame_of},
    scene::{Camera, Scene, bounds::Bounds, choice::Choice, error::SceneError},
    sequence::{Sequence, Shot},
    settings::Settings,
    skips,
    technique::Technique,
};

/// Samples after which the reference is as good as it gets.
const REFERENCE_SAMPLES: u64 = 4096;

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
    prepared: Prepared,
    accumulation: Accumulation,
    estimates: Vec<Estimate>,
    exposure: f32,
    key: Option<Key>,
    dynamic: bool,
    /// Whether the scene is packed for cuts.
    light_cuts: bool,
    facts: SceneFacts,
    /// Frames of the still in batches, which say how far off it is.
    batches: Option<Batches>,
    faults: Option<Faults>,
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
        let options = PackOptions { closed_form: true, ..PackOptions::default() };
        let packed = PackedScene::with(&scene, &Moment::default(), options)?;
        let place = place(gpu, &packed)?;
        let camera = scene.camera.unwrap_or_else(|| framing(&scene));
        let request = Request::new(camera, [1, 1], Technique::RealTime, Settings::default());
        let facts = facts(&scene, &packed);
        Ok(Self {
            base: scene,
            scattered: 0,
            sequence: Sequence::new(packed, request),
            place,
            real_time: None,
            still: None,
            second: Second::default(),
            prepared: Prepared::default(),
            accumulation: Accumulation::default(),
            estimates: Vec::new(),
            exposure: 1.0,
            key: None,
            dynamic: false,
            light_cuts: false,
            facts,
            batches: None,
            faults: None,
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
        self.prepared = Prepared::default();
        self.key = None;
        self.sequence.cut();
    }

    /// Packs the scene anew, with what was added to it.
    fn repack(&mut self, moment: &Moment) -> Result<(), EngineError> {
        let mut scene = self.base.clone();
        lights::scatter(&mut scene, self.scattered);
        let moment = if self.dynamic { moment.clone() } else { Moment { time_s: moment.time_s, ..Moment::default() } };
        let options =
            PackOptions { dynamic: self.dynamic, light_tree: true, light_cuts: self.light_cuts, closed_form: true };
        let packed = PackedScene::with(&scene, &moment, options)?;
        self.forget();
        let gpu = match &self.place {
            Place::Cpu => None,
            Place::Gpu(gpu, _) => Some(Gpu::clone(gpu)),
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
        let origin = self.sequence.packed().object_origin(picked.instance);
        let Some(light) = lights::detach(&mut self.base, picked.instance, picked.corners_object, origin) else {
            return Ok(None);
        };
        self.dynamic = true;
        self.repack(&lights::moment(&self.base, want.time_s, &want.edits))?;
        Ok(Some(light))
    }

    /// What leaving work out saves in frames in real time of the scene without changes to its lights, but with what was
    /// added to it; see
    /// [`skips::costs`].
    ///
    /// # Errors
    /// If such frames can't be computed.
    pub fn costs(
        &mut self,
        want: &Want,
        goes_on: impl FnMut() -> bool,
    ) -> Result<Option<Vec<skips::Cost>>, RenderError> {
        // A compiler beside them would slow frames down; the errors of its pipelines are those of the frames that need them.
        let _ = self.prepared.running.take().map(Preparation::finish);
        let mut scene = self.base.clone();
        lights::scatter(&mut scene, self.scattered);
        let backend = match &self.place {
            Place::Cpu => Backend::Cpu(Order::default()),
            Place::Gpu(gpu, _) => Backend::Gpu(gpu),
        };
        skips::costs(&scene, &self.request(want, Technique::RealTime), &backend, 1, goes_on)
    }

    fn request(&self, want: &Want, technique: Technique) -> Request {
        Request {
            seed: want.seed,
            curve: want.curve,
            exposure: self.exposure,
            ..Request::new(want.camera, want.size, technique, want.settings.clone())
        }
    }

    /// The next frame; nothing if the last one is good enough and nothing has changed.
    ///
    /// # Errors
    /// If the scene can't be shown like that or the GPU fails.
    pub fn frame(&mut self, want: &Want) -> Result<Option<Frames>, EngineError> {
        let moment = lights::moment(&self.base, want.time_s, &want.edits);
        // What the scene is packed for it keeps.
        let needs_cuts = !self.light_cuts && PackOptions::of(&want.settings).light_cuts;
        if want.scattered != self.scattered || needs_cuts {
            self.scattered = want.scattered;
            self.light_cuts |= needs_cuts;
            self.repack(&moment)?;
        }
        let want = &self.ready(want)?;
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
        // Frames in real time go on until those to come can be computed.
        let starts = want.accumulate && !moved && self.accumulation.samples() == 0;
        let waits = self.prepared.is_behind || (starts && !self.is_compiled(want, Technique::Still)?);
        if moved {
            self.estimates.clear();
        }
        self.key = Some(key);
        // A still is made of frames of one moment.
        let refines = want.compare == Compare::Reference || want.view == View::Error;
        let refines = refines && self.estimates.first().is_none_or(|estimate| estimate.count < REFERENCE_SAMPLES);
        let goal = if refines { None } else { Some(want.goal_percent) };
        let (technique, samples) = match self.accumulation.next(moved || waits, want.accumulate, goal) {
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
        self.sequence.keeps_tree = matches!(want.compare, Compare::With(_));
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
            // What a compiler takes of the time is no reason to lower the quality.
            if self.prepared.running.is_none() {
                budget.observe(frame);
            }
            let (counts, out_of_reach) = (budget.counts(), budget.is_out_of_reach());
            made.budget = Some(BudgetFacts { frame, level, counts, out_of_reach });
        }
        Ok(Some(made))
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

#[cfg(test)]
mod tests;
