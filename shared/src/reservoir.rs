//! What a pixel remembers between passes.

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};

/// A light sample and its weight: one 16-byte row. All zero: no sample, no trial.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Reservoir {
    /// Light id, see [`crate::light`]; meaningless while `ucw` is 0.
    pub light: u32,
    /// Point on the light, two 16-bit coordinates. Quantised before any use.
    pub uv: u32,
    /// Unbiased contribution weight W: stands for the reciprocal of the sample's density over (light, u, v).
    pub ucw: f32,
    /// Low half: confidence. High half: marks, see [`Reservoir::is_hidden`].
    pub state: u32,
}

const _: () = assert!(size_of::<Reservoir>() == 16 && offset_of!(Reservoir, state) == 12);

/// Largest confidence that a reservoir can have: beyond it, confidence stays where it is.
pub const MAX_CONFIDENCE: u32 = 0xffff;

/// Inputs of a merge that marks can tell apart, the pixel's own among them.
pub const MAX_INPUTS: u32 = 15;

const KNOWN_VISIBLE: u32 = 0x8000_0000;

impl Reservoir {
    /// No sample, no trial.
    pub const EMPTY: Self = Self { light: 0, uv: 0, ucw: 0.0, state: 0 };

    /// A sample of given confidence (at most [`MAX_CONFIDENCE`] is kept of it) without marks. Confidence counts even
    /// without a sample (`ucw` 0): it is part of the estimate that nothing was found.
    #[inline(always)]
    pub fn new(light: u32, uv: u32, ucw: f32, confidence: u32) -> Self {
        Self { light, uv, ucw, state: confidence.min(MAX_CONFIDENCE) }
    }

    /// Whether there is a sample that contributes.
    #[inline(always)]
    pub fn has_sample(&self) -> bool {
        self.ucw > 0.0
    }

    /// Confidence c: how many independent trials this sample stands for.
    #[inline(always)]
    pub fn confidence(&self) -> u32 {
        self.state & MAX_CONFIDENCE
    }

    /// Mark 0: the pixel's own sample is hidden from the input that was asked for it. Mark i: the sample of input i
    /// is hidden from the pixel. Shadow rays are traced in passes of their own, and this is how they report.
    #[inline(always)]
    pub fn is_hidden(&self, mark: u32) -> bool {
        (self.state >> (16 + mark)) & 1 != 0
    }

    /// The same with mark `mark` set.
    #[inline(always)]
    pub fn with_hidden(self, mark: u32) -> Self {
        Self { state: self.state | (1 << (16 + mark)), ..self }
    }

    /// Whether a shadow ray from this pixel to the sample is known to pass.
    #[inline(always)]
    pub fn is_known_visible(&self) -> bool {
        self.state & KNOWN_VISIBLE != 0
    }

    /// The same, known to be visible.
    #[inline(always)]
    pub fn known_visible(self) -> Self {
        Self { state: self.state | KNOWN_VISIBLE, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_and_marks_do_not_touch_each_other() {
        let mut reservoir = Reservoir::new(1, 2, 3.0, 70_000);
        assert_eq!(reservoir.confidence(), MAX_CONFIDENCE);
        for mark in 0..MAX_INPUTS {
            assert!(!reservoir.is_hidden(mark));
            reservoir = reservoir.with_hidden(mark);
            assert!(reservoir.is_hidden(mark) && !reservoir.is_known_visible());
        }
        assert_eq!(reservoir.known_visible().confidence(), MAX_CONFIDENCE);
        assert!(reservoir.known_visible().is_known_visible() && Reservoir::new(1, 2, 3.0, 5).confidence() == 5);
    }
}
