//! What buffers are made of.

use core::mem::offset_of;

use bytemuck::Pod;
use glam::{UVec4, Vec4};
use weir_shared::{
    block::Block, moments::Moments, presample::LightRecord, resample::Candidate, reservoir::Reservoir, surface::Surface,
};

/// A type that fills buffers: whole words, each an integer or a float.
pub trait Element: Pod {
    /// Bit i: word i is a float.
    const FLOAT_WORDS: u32;
}

/// The bits of `count` words from byte `offset` on.
const fn words(offset: usize, count: usize) -> u32 {
    ((1 << count) - 1) << (offset / 4)
}

impl Element for f32 {
    const FLOAT_WORDS: u32 = words(0, 1);
}

impl Element for u32 {
    const FLOAT_WORDS: u32 = 0;
}

impl Element for Vec4 {
    const FLOAT_WORDS: u32 = words(0, 4);
}

impl Element for UVec4 {
    const FLOAT_WORDS: u32 = 0;
}

impl Element for Surface {
    const FLOAT_WORDS: u32 =
        words(offset_of!(Self, position), 3) | words(offset_of!(Self, error), 1) | words(offset_of!(Self, diffuse), 3);
}

impl Element for Block {
    const FLOAT_WORDS: u32 = words(0, 24);
}

impl Element for LightRecord {
    const FLOAT_WORDS: u32 =
        words(offset_of!(Self, position), 3) | words(offset_of!(Self, area), 3) | words(offset_of!(Self, radiance), 5);
}

impl Element for Candidate {
    const FLOAT_WORDS: u32 = words(offset_of!(Self, target), 2);
}

impl Element for Reservoir {
    const FLOAT_WORDS: u32 = words(offset_of!(Self, ucw), 1);
}

impl Element for Moments {
    const FLOAT_WORDS: u32 =
        words(offset_of!(Self, mean), 3) | words(offset_of!(Self, carry), 3) | words(offset_of!(Self, deviation), 3);
}
