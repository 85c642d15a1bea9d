//! Accumulation: the running mean of independent frames, with its variance.

use glam::{UVec2, Vec4};
use weir_shared::{frame::Frame, moments::Moments, numerics::load};

/// The moments of a pixel with this frame's radiance and the fault that comes with it; from scratch where
/// `frame.accumulated` is 0.
pub fn accumulate(px: UVec2, frame: &Frame, color: &[Vec4], prev_moments: &[Moments]) -> Moments {
    let index = frame.index_of(px);
    let past = if frame.accumulated == 0 { Moments::default() } else { load(prev_moments, index) };
    let color = load(color, index);
    past.with(color.truncate(), color.w as u32)
}
