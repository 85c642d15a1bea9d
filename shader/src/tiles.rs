//! Tiles: a list of those in which there is light to sample, for the passes that do so.

use glam::{UVec2, UVec4};
use weir_shared::{frame::Frame, surface::Surface, tiles};

/// Whether some pixel of a block of 8x8 has light to sample: 1, or 0.
pub fn blocks(block: UVec2, frame: &Frame, surfaces: &[Surface]) -> u32 {
    tiles::is_busy(block, frame, surfaces)
}

/// How many tiles of a row hold such a block.
pub fn rows(at: UVec2, frame: &Frame, busy_blocks: &[u32]) -> u32 {
    tiles::busy_in_row(at.x, frame, busy_blocks)
}

/// A vector of the list of such tiles.
pub fn list(at: UVec2, frame: &Frame, busy_blocks: &[u32], busy_in_rows: &[u32]) -> UVec4 {
    tiles::list_vector(at.x, frame, busy_blocks, busy_in_rows)
}
