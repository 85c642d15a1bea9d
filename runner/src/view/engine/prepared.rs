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
    running: Option<Preparation>,
}

impl Engine {
    /// What is wanted; by the settings of the last frame as long as a thread compiles what those that are wanted need. The
    /// first frame, and the first of another scene, waits for its pipelines.
    pub(super) fn ready(&mut self, want: &Want) -> Result<Want, EngineError> {
        if let Some(running) = self.prepared.running.take_if(|running| running.is_done()) {
            running.finish()?;
        }
        let shown = self.prepared.settings.clone().filter(|_| self.real_time.is_some());
        match shown.filter(|shown| *shown != want.settings) {
            Some(settings) if !self.is_compiled(want, Technique::RealTime)? => Ok(Want { settings, ..want.clone() }),
            _ => {
                self.prepared.settings = Some(want.settings.clone());
                Ok(want.clone())
            }
        }
    }

    /// Whether a thread compiles pipelines of frames to come.
    pub fn is_compiling(&self) -> bool {
        self.prepared.running.is_some()
    }

    /// Whether frames of a technique can be computed at once. If not, a thread compiles their pipelines, unless it is busy
    /// with others; frames in real time go on until it is done.
    pub(super) fn is_compiled(&mut self, want: &Want, technique: Technique) -> Result<bool, EngineError> {
        let Place::Gpu(gpu, scene) = &self.place else { return Ok(true) };
        let plan = planned(self.sequence.packed(), &self.request(want, technique), &outputs_of(want, technique))?;
        if gpu.has_pipelines(&plan, scene) {
            return Ok(true);
        }
        if self.prepared.running.is_none() {
            self.prepared.running = Preparation::start(gpu, &plan, scene);
        }
        Ok(self.prepared.running.is_none())
    }
}
