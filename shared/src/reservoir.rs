//! What a pixel remembers between passes.

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};

use crate::fault;

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
    /// From the lowest bit on: confidence (14 bits), marks of [`Reservoir::is_hidden`] (13), the first [`crate::fault`] (4),
    /// whether visibility is known (1).
    pub state: u32,
}

const _: () = assert!(size_of::<Reservoir>() == 16 && offset_of!(Reservoir, state) == 12);

/// Largest confidence that a reservoir can have: beyond it, confidence stays where it is.
pub const MAX_CONFIDENCE: u32 = 0x3fff;

/// Inputs of a merge that marks can tell apart, the pixel's own among them.
pub const MAX_INPUTS: u32 = 13;

const FIRST_MARK: u32 = 14;
const FAULT_SHIFT: u32 = FIRST_MARK + MAX_INPUTS;
const FAULT_MASK: u32 = 15 << FAULT_SHIFT;
const _: () = assert!(FAULT_SHIFT + 4 == 31 && MAX_CONFIDENCE == (1 << FIRST_MARK) - 1);

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

    /// Whether there is a sample that contributes: its weight is above zero, and finite.
    #[inline(always)]
    pub fn has_sample(&self) -> bool {
        // Of the bits: zero wraps around, what is negative, infinite or not a number lies above.
        self.ucw.to_bits().wrapping_sub(1) < 0x7f7f_ffff
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
        (self.state >> (FIRST_MARK + mark)) & 1 != 0
    }

    /// The same with mark `mark` set.
    #[inline(always)]
    pub fn with_hidden(self, mark: u32) -> Self {
        Self { state: self.state | (1 << (FIRST_MARK + mark)), ..self }
    }

    /// The first [`crate::fault`] on the way to this reservoir in its frame.
    #[inline(always)]
    pub fn fault(&self) -> u32 {
        (self.state & FAULT_MASK) >> FAULT_SHIFT
    }

    /// The same with another fault on its way.
    #[inline(always)]
    pub fn with_fault(self, fault: u32) -> Self {
        if self.fault() == fault::NONE { Self { state: self.state | (fault << FAULT_SHIFT), ..self } } else { self }
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
    fn confidence_marks_and_faults_do_not_touch_each_other() {
        let mut reservoir = Reservoir::new(1, 2, 3.0, 70_000).with_fault(0).with_fault(5).with_fault(12);
        assert_eq!(reservoir.confidence(), MAX_CONFIDENCE);
        for mark in 0..MAX_INPUTS {
            assert!(!reservoir.is_hidden(mark));
            reservoir = reservoir.with_hidden(mark);
            assert!(reservoir.is_hidden(mark) && !reservoir.is_known_visible());
        }
        assert_eq!((reservoir.known_visible().confidence(), reservoir.known_visible().fault()), (MAX_CONFIDENCE, 5));
        assert!(reservoir.known_visible().is_known_visible() && Reservoir::new(1, 2, 3.0, 5).confidence() == 5);
    }

    #[test]
    fn only_a_positive_finite_weight_makes_a_sample() {
        for (ucw, expected) in [
            (0.0, false),
            (-0.0, false),
            (1e-45, true),
            (f32::MAX, true),
            (f32::INFINITY, false),
            (f32::NAN, false),
            (-f32::NAN, false),
            (-1.0, false),
        ] {
            assert_eq!(Reservoir::new(0, 0, ucw, 1).has_sample(), expected, "{ucw}");
        }
    }
}
