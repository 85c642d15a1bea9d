//! Display: the mean radiance, exposed, tone-mapped and encoded for the screen. One pass for each tone curve.

use glam::UVec2;
use weir_shared::{
    frame::Frame,
    moments::Moments,
    numerics::load,
    tonemap::{self, curve},
};

fn display<const CURVE: u32>(px: UVec2, frame: &Frame, moments: &[Moments]) -> u32 {
    let radiance = load(moments, frame.index_of(px)).mean();
    tonemap::display::<CURVE>(radiance * frame.exposure)
}

/// 8-bit sRGB, clipped to 0..=1; red in the low byte.
pub fn clip(px: UVec2, frame: &Frame, moments: &[Moments]) -> u32 {
    display::<{ curve::CLIP }>(px, frame, moments)
}

/// 8-bit sRGB through Reinhard's curve; red in the low byte.
pub fn reinhard(px: UVec2, frame: &Frame, moments: &[Moments]) -> u32 {
    display::<{ curve::REINHARD }>(px, frame, moments)
}

/// 8-bit sRGB through the ACES fit; red in the low byte.
pub fn aces(px: UVec2, frame: &Frame, moments: &[Moments]) -> u32 {
    display::<{ curve::ACES }>(px, frame, moments)
}

/// 8-bit sRGB through AgX; red in the low byte.
pub fn agx(px: UVec2, frame: &Frame, moments: &[Moments]) -> u32 {
    display::<{ curve::AGX }>(px, frame, moments)
}
