//! Frames go on while a thread compiles the pipelines of those to come.

use super::{
    Engine, EngineError,
    chain::{Place, outputs_of, planned},
};
use crate::{executor::gpu::Preparation, settings::Settings, technique::Technique, view::want::Want};

/// What is compiled, and what is shown until it is.
#[derive(Default)]
pub(super) struct Prepared {
    /// The settings of the last frame; none if nothing is shown that could go on.
    settings: Option<Settings>,
    /// Whether other settings are wanted.
    pub(super) is_behind: bool,
    pub(super) running: Option<Preparation>,
    /// The device refused something; frames compile what they need themselves, and say or work round what is wrong.
    gives_up: bool,
}

impl Engine {
    /// What is wanted; by the settings of the last frame as long as a thread compiles what those that are wanted need. The
    /// first frame, and the first of another scene, waits for its pipelines.
    pub(super) fn ready(&mut self, want: &Want) -> Result<Want, EngineError> {
        if let Some(running) = self.prepared.running.take_if(|running| running.is_done())
            && let Err(error) = running.finish()
        {
            tracing::warn!("passes could not be compiled ahead: {error}");
            self.prepared.gives_up = true;
        }
        let shown = self.prepared.settings.clone().filter(|_| self.real_time.is_some());
        let other = shown.filter(|shown| *shown != want.settings);
        self.prepared.is_behind = other.is_some() && !self.is_compiled(want, Technique::RealTime)?;
        match other.filter(|_| self.prepared.is_behind) {
            Some(settings) => Ok(Want { settings, ..want.clone() }),
            None => {
                self.prepared.settings = Some(want.settings.clone());
                Ok(want.clone())
            }
        }
    }

    /// Whether a thread compiles pipelines of frames to come.
    pub fn is_compiling(&self) -> bool {
        self.prepared.running.is_some()
    }

    /// Whether frames of a technique can be computed at once. If not, a thread compiles their pipelines, as soon as it is done
    /// with others.
    pub(super) fn is_compiled(&mut self, want: &Want, technique: Technique) -> Result<bool, EngineError> {
        let Place::Gpu(gpu, scene) = &self.place else { return Ok(true) };
        if self.prepared.gives_up {
            return Ok(true);
        }
        let packed = self.sequence.packed();
        let plan = planned(packed, &self.request(want, technique), &outputs_of(want, technique))?;
        // Which pipelines these are depends on how rays can be traced.
        pollster::block_on(scene.accelerate(gpu, packed.buffers(), plan.facts.traversal))?;
        if gpu.has_pipelines(&plan, scene) {
            return Ok(true);
        }
        if self.prepared.running.is_none() {
            self.prepared.running = Preparation::start(gpu, &plan, scene);
        }
        Ok(self.prepared.running.is_none())
    }
}
