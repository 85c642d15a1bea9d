//! A frame, what is shown of it, and what is learned from it.

use std::{sync::Arc, time::Duration};

use weir_shared::{frame::FramePair, moments::Moments};

use super::{
    Engine, EngineError,
    chain::{chain_for, outputs_of, pixels_of, rays, update},
    look,
    shown::{Frames, Pixels, Shown},
};
use crate::{
    budget::TimeBudget,
    executor::gpu::GpuError,
    faults::Faults,
    margin::Batches,
    packed::Changed,
    reference::{Estimate, Reference},
    render::{Request, display_of, pixel_moments},
    technique::Technique,
    view::{
        buffers::View,
        exposure,
        want::{Compare, Want},
    },
};

impl Engine {
    /// Makes, changes or lets go of the time budget.
    pub(super) fn keep_budget(&mut self, want: &Want) {
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
            self.faults = None;
            let pixels = chain.plan.facts.width as usize * chain.plan.facts.height as usize;
            self.batches = Some(Batches::new(pixels, None));
        }
        let Some(batches) = self.batches.as_mut().filter(|batches| batches.due_in(accumulated) == 0) else {
            return Ok(());
        };
        let moments = chain.executor.read(&chain.plan, "moments")?;
        self.faults = Some(Faults::of(moments.elements()));
        let moments: Vec<_> = moments.elements::<Moments>().iter().map(pixel_moments).collect();
        batches.add(accumulated, |pixel| moments[pixel]);
        if let Some(margin) = batches.margin(accumulated, &moments) {
            self.accumulation.measured(100.0 * margin.error as f32);
        }
        Ok(())
    }

    /// Computes a frame and what is shown of it.
    pub(super) fn show(
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
        if want.auto_exposure && (frames.now.accumulated.is_multiple_of(8) || frames.now.accumulated < 16) {
            let mean = look::log_mean(chain, request)?;
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
            Some(px) => Some(look::inspect(chain, sequence.packed(), &frames, px)?),
            None => None,
        };
        let size = [request.width, request.height];
        let pixels = if want.view == View::Picture {
            pixels_of(chain)?
        } else {
            let colors = look::colors(chain, want.view, sequence.packed(), &frames, &self.estimates)?;
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
            faults: self.faults.clone().filter(|_| request.technique == Technique::Still),
            budget: None,
        })
    }
}
