//! Stills: independent frames, averaged, by the passes or by the reference integrator.

use std::time::Duration;

use glam::Vec3;
use rayon::prelude::*;
use weir_shared::{
    frame::{Frame, FramePair},
    moments::Moments,
};

use super::{Backend, Clock, Executor, RenderError, Rendered, Request, Stop, facts_of, frame_of};
use crate::{
    executor::SceneBuffers,
    faults::Faults,
    graph::Plan,
    margin::{Batches, PixelMoments, frames_for},
    output::Picture,
    packed::PackedScene,
    reference::{Estimate, Reference},
    technique::{Technique, ToneCurve, direct_light},
};

/// Frames of the first pilot; each next one has twice as many in all.
const SHORTEST_PILOT: u32 = 8;
/// A pilot of one frame for this many of the picture says well enough how many these have to be.
const FRAMES_PER_PILOT_FRAME: f64 = 8.0;
/// Most frames of a picture: f32 counts them.
const MOST_FRAMES: f64 = 16_777_216.0;

/// Independent frames and their mean.
trait Frames {
    /// Forgets the mean, and goes on with random numbers that no picture uses (`pilot`), or with those of a picture.
    fn restart(&mut self, pilot: bool);
    /// At least one frame more and at most `most`; returns how many. They may be under way afterwards.
    fn add(&mut self, most: u32) -> Result<u32, RenderError>;
    /// Waits until all frames are done.
    fn finish(&mut self) -> Result<(), RenderError>;
    /// Shows the moments so far.
    fn show(&mut self, frames: u32, batches: &mut Batches) -> Result<(), RenderError>;
    /// The moments of all pixels.
    fn moments(&mut self) -> Result<Vec<PixelMoments>, RenderError>;
}

/// What came of the frames of a picture.
struct Outcome {
    frames: u32,
    moments: Vec<PixelMoments>,
    batches: Batches,
    elapsed: Duration,
}

/// Adds frames until `stop`, or until `progress` does not want any more; `false` then.
fn run(
    frames: &mut impl Frames,
    stop: Stop,
    batches: &mut Batches,
    clock: &mut Clock,
    done: &mut u32,
    progress: &mut impl FnMut(u32) -> bool,
) -> Result<bool, RenderError> {
    loop {
        let most = match stop {
            Stop::Samples(n) => n - *done,
            Stop::Time(_) | Stop::Error(_) => 1,
        };
        *done += frames.add(most.min(batches.due_in(*done)))?;
        if matches!(stop, Stop::Time(_)) {
            frames.finish()?;
        }
        if batches.due_in(*done) == 0 {
            frames.show(*done, batches)?;
        }
        clock.tick();
        let is_done = clock.is_done(stop, *done);
        if !progress(*done) {
            return Ok(false);
        }
        if is_done {
            return Ok(true);
        }
    }
}

/// The mean of as many frames as `request` says.
///
/// To reach an error, frames are made in two stages. A pilot tells how many frames the picture needs, and is thrown away;
/// the picture is made of that many others, whatever they turn out to be like. So the number of frames does not depend
/// on the frames that are averaged, and their mean is unbiased. (To go on until the picture itself looks good enough
/// would favour those that happen to look less noisy than they are.)
fn average(
    frames: &mut impl Frames,
    request: &Request,
    mut progress: impl FnMut(u32) -> bool,
) -> Result<Outcome, RenderError> {
    let pixels = (request.width * request.height) as usize;
    let mut clock = Clock::start();
    let mut stop = request.stop;
    let (mut batches, mut done) = (Batches::new(pixels, None), 0);
    let mut wanted = true;
    if let Stop::Error(error) = stop {
        frames.restart(true);
        let mut pilot = SHORTEST_PILOT;
        let needed = loop {
            wanted = run(frames, Stop::Samples(pilot), &mut batches, &mut clock, &mut done, &mut progress)?;
            let margin = batches.margin(done, &frames.moments()?);
            let needed = margin.map_or(2.0, |margin| frames_for(error, &margin, done));
            if needed > MOST_FRAMES {
                tracing::warn!("that error takes {needed:.1e} samples a pixel; stopping at {MOST_FRAMES:.1e}");
            }
            let needed = needed.min(MOST_FRAMES);
            if !wanted || needed <= f64::from(pilot) * FRAMES_PER_PILOT_FRAME {
                break needed as u32;
            }
            pilot *= 2;
        };
        stop = Stop::Samples(needed);
        if wanted {
            tracing::info!("a pilot of {done} samples a pixel asks for {needed}");
        }
    }
    // Who interrupts a pilot gets its mean.
    if wanted {
        let known = if let Stop::Samples(n) = stop { Some(n) } else { None };
        (batches, done) = (Batches::new(pixels, known), 0);
        frames.restart(false);
        run(frames, stop, &mut batches, &mut clock, &mut done, &mut progress)?;
    }
    frames.finish()?;
    let elapsed = clock.elapsed();
    Ok(Outcome { frames: done, moments: frames.moments()?, batches, elapsed })
}

impl Outcome {
    fn rendered(self, request: &Request) -> Rendered {
        let n = f64::from(self.frames);
        let of = |f: &dyn Fn(&PixelMoments, usize) -> f64| -> Vec<[f32; 3]> {
            self.moments.iter().map(|m| std::array::from_fn(|c| f(m, c) as f32)).collect()
        };
        let variance = of(&|m, c| if self.frames < 2 { 0.0 } else { m.deviation[c] / (n * (n - 1.0)) });
        let rgb = of(&|m, c| m.mean[c]);
        // Once, and not in a pass after every frame: nobody sees those in between.
        let display =
            rgb.par_iter().map(|&rgb| display_of(Vec3::from(rgb) * request.exposure, request.curve)).collect();
        Rendered {
            picture: Picture { width: request.width, height: request.height, rgb, alpha: None },
            margin: self.batches.margin(self.frames, &self.moments),
            variance,
            display,
            samples: self.frames,
            elapsed: self.elapsed,
            pass_times: Vec::new(),
            faults: Faults::default(),
        }
    }
}

/// Frames by the passes.
struct Passes<'a> {
    executor: Executor,
    plan: Plan,
    scene: SceneBuffers<'a>,
    frame: Frame,
    pass_times: Vec<(&'static str, Duration)>,
}

/// Frame numbers of pilots begin here.
const PILOT_FRAMES: u32 = 1 << 31;

/// The moments of a pixel, in double precision.
pub(crate) fn pixel_moments(m: &Moments) -> PixelMoments {
    PixelMoments {
        // What rounding has cut off counts where means of many frames are subtracted from each other.
        mean: std::array::from_fn(|c| f64::from(m.mean[c]) - f64::from(m.carry[c])),
        deviation: m.deviation.map(f64::from),
    }
}

impl Frames for Passes<'_> {
    fn restart(&mut self, pilot: bool) {
        self.frame.index = if pilot { PILOT_FRAMES } else { 0 };
        self.frame.accumulated = 0;
    }

    fn add(&mut self, _most: u32) -> Result<u32, RenderError> {
        let frame = self.frame;
        self.pass_times = self.executor.run(&self.plan, self.scene, &FramePair { now: frame, prev: frame })?;
        self.frame.index = frame.index.wrapping_add(1);
        self.frame.accumulated += 1;
        Ok(1)
    }

    fn finish(&mut self) -> Result<(), RenderError> {
        Ok(self.executor.finish()?)
    }

    fn show(&mut self, frames: u32, batches: &mut Batches) -> Result<(), RenderError> {
        let moments = self.executor.read(&self.plan, "moments")?;
        let moments: &[Moments] = moments.elements();
        batches.add(frames, |pixel| pixel_moments(&moments[pixel]));
        Ok(())
    }

    fn moments(&mut self) -> Result<Vec<PixelMoments>, RenderError> {
        let moments = self.executor.read(&self.plan, "moments")?;
        Ok(moments.elements::<Moments>().iter().map(pixel_moments).collect())
    }
}

/// Renders a still by the passes: independent frames, averaged. `progress` is told the samples so far after each frame;
/// it ends the picture early by returning false.
///
/// # Errors
/// If the size is refused or the GPU fails.
pub fn render(
    packed: &PackedScene,
    request: &Request,
    backend: &Backend<'_>,
    progress: impl FnMut(u32) -> bool,
) -> Result<Rendered, RenderError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let plan = direct_light(request.technique, &request.settings, &facts, request.curve, &["moments"])?;
    let scene = packed.buffers();
    let executor = Executor::new(backend, &plan, scene)?;
    let mut passes = Passes { executor, plan, scene, frame: frame_of(packed, request), pass_times: Vec::new() };
    let outcome = average(&mut passes, request, progress)?;
    let pass_times = passes.executor.last_times(passes.pass_times);
    let faults = Faults::of(passes.executor.read(&passes.plan, "moments")?.elements());
    Ok(Rendered { pass_times, faults, ..outcome.rendered(request) })
}

/// Samples by the reference integrator.
struct Paths<'a> {
    reference: Reference<'a>,
    estimates: Vec<Estimate>,
    block: u64,
}

impl Frames for Paths<'_> {
    fn restart(&mut self, pilot: bool) {
        self.block = if pilot { 1 << 63 } else { 0 };
        self.estimates.fill(Estimate::default());
    }

    fn add(&mut self, most: u32) -> Result<u32, RenderError> {
        let step = most.min(4);
        self.reference.accumulate(&mut self.estimates, self.block, step);
        self.block += 1;
        Ok(step)
    }

    fn finish(&mut self) -> Result<(), RenderError> {
        Ok(())
    }

    fn show(&mut self, frames: u32, batches: &mut Batches) -> Result<(), RenderError> {
        batches.add(frames, |pixel| self.estimates[pixel].moments());
        Ok(())
    }

    fn moments(&mut self) -> Result<Vec<PixelMoments>, RenderError> {
        Ok(self.estimates.iter().map(Estimate::moments).collect())
    }
}

/// Renders by the reference integrator, on the host.
///
/// # Errors
/// If the size is refused.
pub fn render_reference(
    packed: &PackedScene,
    request: &Request,
    progress: impl FnMut(u32) -> bool,
) -> Result<Rendered, RenderError> {
    // The same limits on the size as for the passes.
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    direct_light(Technique::Candidates, &request.settings, &facts, request.curve, &["moments"])?;
    let reference = Reference::new(packed, frame_of(packed, request), request.settings.path_length);
    let estimates = vec![Estimate::default(); (request.width * request.height) as usize];
    let mut paths = Paths { reference, estimates, block: 0 };
    let outcome = average(&mut paths, request, progress)?;
    let faults = Faults { samples: paths.estimates.iter().map(|e| e.dropped).sum(), ..Faults::default() };
    Ok(Rendered { faults, ..outcome.rendered(request) })
}

/// Exposed radiance as 8-bit sRGB.
pub fn display_of(exposed: Vec3, curve: ToneCurve) -> u32 {
    use weir_shared::tonemap::{curve as number, display};
    match curve {
        ToneCurve::Clip => display::<{ number::CLIP }>(exposed),
        ToneCurve::Reinhard => display::<{ number::REINHARD }>(exposed),
        ToneCurve::Aces => display::<{ number::ACES }>(exposed),
        ToneCurve::Agx => display::<{ number::AGX }>(exposed),
    }
}

#[cfg(test)]
mod tests;
