//! Lights drawn ahead of the pixels that draw their candidates from them.

use glam::UVec2;
use weir_shared::{
    block::Block,
    frame::Frame,
    light_cuts::cut_record,
    presample::{LightRecord, cell_record, tile_record},
    scene::Scene,
    surface::Surface,
};

/// A record of a tile: `at` is its place in the tile, and the tile.
///
/// Source: Wyman and Panteleev 2021, "Rearchitecting Spatiotemporal Resampling for Production".
pub fn tiles<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool>(
    at: UVec2,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
) -> LightRecord {
    tile_record::<EMISSION_IMAGES, ENVIRONMENT>(at, frame, scene, lights)
}

/// A record of a cell: `at` is its place in the cell, and the cell.
///
/// Source: Boksansky, Jukarainen and Wyman 2021, "Rendering Many Lights with Grid-Based Reservoirs".
pub fn cells<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool>(
    at: UVec2,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
) -> LightRecord {
    cell_record::<EMISSION_IMAGES, ENVIRONMENT>(at, frame, scene, lights)
}

/// A cluster of a cut: `at` is its place in the cut, and the cut.
///
/// Source: Lin and Yuksel 2020, "Real-Time Stochastic Lightcuts".
pub fn cuts(at: UVec2, frame: &Frame, scene: &Scene, lights: &[u32], blocks: &[Block]) -> LightRecord {
    cut_record(at, frame, scene, lights, blocks)
}

/// What cuts are made for: the surfaces of a block of 8x8 pixels.
pub fn blocks(block: UVec2, frame: &Frame, surfaces: &[Surface]) -> Block {
    Block::of(block, frame, surfaces)
}
