//! Where the samples of a merge end: in a reservoir, and in a sum over all of them.

use glam::{Vec3, Vec4};
use weir_shared::{
    fault,
    frame::Frame,
    merge::{Merged, Sink},
    numerics::is_finite,
    resample::{Chooser, Stream},
    reservoir::Reservoir,
    reuse::probe,
    rng::Rng,
};

/// A sample that a merge offers.
pub trait Offered {
    /// Light and place on it, in the ids of the frame that is computed.
    fn id(&self) -> (u32, u32);
}

/// Keeps one sample, and adds up the light of all.
pub struct Collector {
    stream: Stream<f32, (u32, u32), Chooser>,
    light: Vec3,
    /// Of the sum of light.
    fault: u32,
}

impl Collector {
    /// Chooses by `rng` in one of the ways of [`weir_shared::resample::choice`].
    #[inline(always)]
    pub fn new(rng: Rng, way: u32) -> Self {
        Self { stream: Stream::new((0, 0), Chooser::new(rng, way)), light: Vec3::ZERO, fault: fault::NONE }
    }

    /// The reservoir merged at `stage` of [`fault`], and reflected radiance as the sum over the inputs of m f W
    /// (Rao-Blackwell: what the choice of one sample would give on average) with the first fault as w. Forms that weigh
    /// after the choice give the sum a wrong colour; who shades by it takes another.
    #[inline(always)]
    pub fn finish(&self, frame: &Frame, own: &Reservoir, merged: &Merged<f32>, stage: u32) -> (Reservoir, Vec4) {
        let (light, uv) = self.stream.kept();
        let ucw = self.stream.contribution_weight() * merged.factor;
        let overflow = if is_finite(ucw) { fault::NONE } else { fault::OVERFLOW };
        let kind = self.stream.fault().max(self.fault).max(overflow);
        let mut reservoir = Reservoir::new(light, uv, if is_finite(ucw) { ucw } else { 0.0 }, merged.confidence as u32);
        // Faults of the other inputs are their pixels' own.
        reservoir = reservoir.with_fault(own.fault()).with_fault(fault::at(stage, kind));
        // A ray has found that the pixel's own sample is visible, or else it would have none; of the others it has if
        // all were asked.
        if merged.kept == 0 && own.is_known_visible() || frame.probe == probe::ALL {
            reservoir = reservoir.known_visible();
        }
        (reservoir, (self.light * merged.factor).extend(reservoir.fault() as f32))
    }
}

impl<S: Offered> Sink<f32, S, Vec3> for Collector {
    #[inline(always)]
    fn offer(&mut self, sample: &S, light: Vec3, target: f32, scaled_ucw: f32) -> bool {
        let light = light * scaled_ucw;
        if is_finite(light.x) && is_finite(light.y) && is_finite(light.z) {
            self.light += light;
        } else {
            self.fault = self.fault.max(fault::OVERFLOW);
        }
        self.stream.offer(sample.id(), target, target * scaled_ucw)
    }
}
