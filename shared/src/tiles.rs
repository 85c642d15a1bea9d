//! Tiles in which there is something to do: passes that sample light run over a list of them.
//!
//! Pixels of the sky, and those of surfaces whose light is known, have nothing to sample. Three passes find the tiles of
//! the picture that hold any other pixel: the first tells of each block of 8x8 pixels whether it does, the second counts
//! such tiles in each row, the third lists them, in order, each word of the list for itself. The list starts with the
//! numbers of workgroups that a GPU dispatches for it, so the host never knows how long it is.
//!
//! A list of zeros lists nothing: then there are all tiles.

use glam::{UVec2, UVec4};
#[cfg(target_arch = "spirv")]
use spirv_std::arch::IndexUnchecked;

use crate::{frame::Frame, numerics::load, surface::Surface};

/// Pixels in a row and in a column of a block, which is a workgroup on a GPU.
pub const BLOCK: u32 = 8;
/// Vectors of a list: 16 KiB, what every adapter takes as a uniform.
pub const LIST_VECTORS: u32 = 1024;
/// Vectors before the first tile: workgroups of passes over reservoirs, and of those over candidates.
pub const HEAD_VECTORS: u32 = 2;
/// Tiles of a vector, 16 bits each.
const TILES_PER_VECTOR: u32 = 8;
/// Most tiles that a list has places for.
pub const MOST_TILES: u32 = (LIST_VECTORS - HEAD_VECTORS) * TILES_PER_VECTOR;
/// What stands behind the numbers of workgroups if the list lists tiles.
const LISTED: u32 = 1;

/// The list of tiles, as passes on a GPU bind it: a uniform.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct TileList {
    /// The head, then the tiles.
    pub vectors: [UVec4; LIST_VECTORS as usize],
}

impl TileList {
    /// A vector of it; `number` is below [`LIST_VECTORS`].
    #[inline(always)]
    fn vector(&self, number: u32) -> UVec4 {
        #[cfg(target_arch = "spirv")]
        // SAFETY: no list lists more tiles than it has places for.
        unsafe {
            *self.vectors.index_unchecked(number as usize)
        }
        #[cfg(not(target_arch = "spirv"))]
        self.vectors[number as usize]
    }
}

/// Tiles of a picture: squares of 1, 4, 16, ... blocks, as small as the list has places for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    /// Blocks in a row of a tile, as a power of two.
    pub shift: u32,
    /// Tiles in a row of the picture.
    pub columns: u32,
    /// Rows of tiles.
    pub rows: u32,
}

/// Blocks that cover so many pixels.
#[inline(always)]
pub fn blocks(pixels: u32) -> u32 {
    pixels.div_ceil(BLOCK)
}

impl Tiling {
    /// Tiles of a picture of at most 32,768 pixels in a row and in a column.
    #[inline(always)]
    pub fn new(width: u32, height: u32) -> Self {
        let (mut shift, mut columns, mut rows) = (0, blocks(width), blocks(height));
        while columns * rows > MOST_TILES {
            shift += 1;
            columns = (columns + 1) >> 1;
            rows = (rows + 1) >> 1;
        }
        Self { shift, columns, rows }
    }

    /// Tiles of a frame's picture.
    #[inline(always)]
    pub fn of(frame: &Frame) -> Self {
        Self::new(frame.width, frame.height)
    }

    /// Tiles in all.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.columns * self.rows
    }

    /// Blocks of a tile.
    #[inline(always)]
    pub fn blocks(&self) -> u32 {
        1 << (2 * self.shift)
    }

    /// Column and row of block `number` of tile `tile`; some of the last tiles are not of the picture.
    #[inline(always)]
    pub fn block(&self, tile: u32, number: u32) -> UVec2 {
        let (column, row) = (tile % self.columns, tile / self.columns);
        let (right, down) = (number & ((1 << self.shift) - 1), number >> self.shift);
        UVec2::new((column << self.shift) + right, (row << self.shift) + down)
    }
}

/// Whether a list lists tiles, by the first vector of its head.
#[inline(always)]
pub fn is_listed(head: UVec4) -> bool {
    head.w == LISTED
}

/// Tile `place` of a list, by the vector that holds it.
#[inline(always)]
fn in_vector(vector: UVec4, place: u32) -> u32 {
    let place = place % TILES_PER_VECTOR;
    let low = if place < 2 { vector.x } else { vector.y };
    let high = if place < 6 { vector.z } else { vector.w };
    let word = if place < 4 { low } else { high };
    (word >> (16 * (place & 1))) & 0xffff
}

/// The vector of a list that holds tile `place` of it.
#[inline(always)]
fn vector_of(place: u32) -> u32 {
    HEAD_VECTORS + place / TILES_PER_VECTOR
}

/// Tile `place` of a list that lists tiles.
#[inline(always)]
pub fn listed(list: &[UVec4], place: u32) -> u32 {
    in_vector(load(list, vector_of(place)), place)
}

/// How many tiles a list lists.
#[inline(always)]
pub fn length(list: &[UVec4]) -> u32 {
    load(list, 0).x
}

/// The pixel of invocation `within` of workgroup `group`: x is the place in the list, y the block of the tile there.
#[inline(always)]
pub fn pixel(frame: &Frame, list: &TileList, group: UVec2, within: UVec2) -> UVec2 {
    let mut tile = group.x;
    if is_listed(list.vector(0)) {
        tile = in_vector(list.vector(vector_of(tile)), tile);
    }
    Tiling::of(frame).block(tile, group.y) * BLOCK + within
}

/// Whether some pixel of a block has light to sample: 1, or 0.
#[inline(always)]
pub fn is_busy(block: UVec2, frame: &Frame, surfaces: &[Surface]) -> u32 {
    let first = block * BLOCK;
    // No return from within: llvmpipe forgets what invocations that leave a loop early have found, unless it is carried
    // from turn to turn.
    let mut busy = 0;
    let mut i = 0;
    while i < BLOCK * BLOCK && busy == 0 {
        let px = first + UVec2::new(i % BLOCK, i / BLOCK);
        if px.x < frame.width && px.y < frame.height && !load(surfaces, frame.index_of(px)).is_settled() {
            busy = 1;
        }
        i += 1;
    }
    busy
}

/// Whether some block of a tile is busy: 1, or 0.
#[inline(always)]
fn is_tile_busy(tiling: &Tiling, frame: &Frame, tile: u32, busy_blocks: &[u32]) -> u32 {
    let mut busy = 0;
    let mut i = 0;
    while i < tiling.blocks() && busy == 0 {
        let block = tiling.block(tile, i);
        if block.x < blocks(frame.width) && block.y < blocks(frame.height) {
            busy = load(busy_blocks, frame.index_of_block(block));
        }
        i += 1;
    }
    busy
}

/// Busy tiles of a row of tiles.
#[inline(always)]
pub fn busy_in_row(row: u32, frame: &Frame, busy_blocks: &[u32]) -> u32 {
    let tiling = Tiling::of(frame);
    let mut count = 0;
    let mut column = 0;
    while column < tiling.columns {
        count += is_tile_busy(&tiling, frame, row * tiling.columns + column, busy_blocks);
        column += 1;
    }
    count
}

/// Vector `number` of the list.
#[inline(always)]
pub fn list_vector(number: u32, frame: &Frame, busy_blocks: &[u32], busy_in_rows: &[u32]) -> UVec4 {
    let tiling = Tiling::of(frame);
    if number < HEAD_VECTORS {
        let mut count = 0;
        let mut row = 0;
        while row < tiling.rows {
            count += load(busy_in_rows, row);
            row += 1;
        }
        let of_pixel = if number == 0 { 1 } else { frame.candidates_in_memory() };
        return UVec4::new(count, tiling.blocks(), frame.reservoirs * of_pixel, LISTED);
    }
    let first = (number - HEAD_VECTORS) * TILES_PER_VECTOR;
    let mut vector = UVec4::ZERO;
    if first >= tiling.count() {
        return vector;
    }
    // The row that the first of them is in, and how many are to be passed over there.
    let (mut row, mut before) = (0, 0);
    while row < tiling.rows && before + load(busy_in_rows, row) <= first {
        before += load(busy_in_rows, row);
        row += 1;
    }
    let mut place = before;
    let mut tile = row * tiling.columns;
    while tile < tiling.count() && place < first + TILES_PER_VECTOR {
        if is_tile_busy(&tiling, frame, tile, busy_blocks) != 0 {
            if place >= first {
                let within = place - first;
                let half = tile << (16 * (within & 1));
                vector.x |= if within / 2 == 0 { half } else { 0 };
                vector.y |= if within / 2 == 1 { half } else { 0 };
                vector.z |= if within / 2 == 2 { half } else { 0 };
                vector.w |= if within / 2 == 3 { half } else { 0 };
            }
            place += 1;
        }
        tile += 1;
    }
    vector
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    fn frame(width: u32, height: u32) -> Frame {
        Frame { width, height, reservoirs: 2, candidates: 5, ..Frame::default() }
    }

    /// The list for blocks of which those are busy that `is_busy` says.
    fn list_of(frame: &Frame, is_busy: impl Fn(UVec2) -> bool) -> Vec<UVec4> {
        let (columns, rows) = (blocks(frame.width), blocks(frame.height));
        let places = (0..rows).flat_map(|y| (0..columns).map(move |x| UVec2::new(x, y)));
        let busy: Vec<u32> = places.map(|block| u32::from(is_busy(block))).collect();
        let in_rows: Vec<u32> = (0..Tiling::of(frame).rows).map(|row| busy_in_row(row, frame, &busy)).collect();
        (0..LIST_VECTORS).map(|number| list_vector(number, frame, &busy, &in_rows)).collect()
    }

    #[test]
    fn tiles_are_as_small_as_the_list_has_places_for() {
        for ((width, height), shift) in
            [((1, 1), 0), ((320, 180), 0), ((1280, 720), 1), ((1920, 1080), 1), ((3840, 2160), 2), ((32768, 32768), 6)]
        {
            let tiling = Tiling::new(width, height);
            assert_eq!(tiling.shift, shift, "{width}x{height}");
            assert!(tiling.count() <= MOST_TILES && tiling.columns << (shift + 3) >= width);
            assert!(tiling.rows << (shift + 3) >= height);
        }
    }

    #[test]
    fn a_list_holds_every_tile_with_a_busy_block_once_and_in_order() {
        for (size, (width, height)) in
            [(1, 1), (8, 9), (320, 180), (333, 77), (2000, 1100), (4097, 31)].iter().enumerate()
        {
            for share in [0_u32, 1, 30, 500, 999, 1000] {
                let frame = frame(*width, *height);
                let tiling = Tiling::of(&frame);
                let is_busy = |block: UVec2| {
                    let mut rng = Rng::for_reservoir(block, size as u32, &frame, crate::rng::Stage::BsdfRay);
                    rng.next_word() % 1000 < share
                };
                let expected: Vec<u32> = (0..tiling.count())
                    .filter(|tile| {
                        let of_tile = (0..tiling.blocks()).map(|i| tiling.block(*tile, i));
                        of_tile.filter(|b| b.x < blocks(*width) && b.y < blocks(*height)).any(is_busy)
                    })
                    .collect();
                let list = list_of(&frame, is_busy);
                let found: Vec<u32> = (0..length(&list)).map(|place| listed(&list, place)).collect();
                assert_eq!(found, expected, "{width}x{height}, {share} in 1000");
                assert!(is_listed(list[0]));
                let [count, blocks] = [expected.len() as u32, tiling.blocks()];
                assert_eq!([list[0].x, list[0].y, list[0].z], [count, blocks, 2]);
                assert_eq!([list[1].x, list[1].y, list[1].z], [count, blocks, 2 * frame.candidates_in_memory()]);
            }
        }
    }

    /// What a GPU's invocations compute, with a list and without: each pixel of the tiles once.
    #[test]
    fn workgroups_cover_the_pixels_of_listed_tiles_once() {
        for (width, height) in [(33, 20), (333, 77), (2000, 1100)] {
            let frame = frame(width, height);
            let tiling = Tiling::of(&frame);
            let is_busy = |block: UVec2| !(block.x + block.y).is_multiple_of(3);
            let lists = [(list_of(&frame, is_busy), true), (vec![UVec4::ZERO; LIST_VECTORS as usize], false)];
            for (list, some) in lists {
                let uniform = TileList { vectors: list.clone().try_into().expect("all vectors") };
                let groups = if some { length(&list) } else { tiling.count() };
                let mut seen = vec![0; (width * height) as usize];
                for group in (0..groups).flat_map(|x| (0..tiling.blocks()).map(move |y| UVec2::new(x, y))) {
                    for i in 0..BLOCK * BLOCK {
                        let px = pixel(&frame, &uniform, group, UVec2::new(i % BLOCK, i / BLOCK));
                        if px.x < width && px.y < height {
                            seen[frame.index_of(px) as usize] += 1;
                        }
                    }
                }
                for y in 0..height {
                    for x in 0..width {
                        let tile = ((y / BLOCK) >> tiling.shift) * tiling.columns + ((x / BLOCK) >> tiling.shift);
                        let of_tile = (0..tiling.blocks()).map(|i| tiling.block(tile, i));
                        let of_picture = |b: &UVec2| b.x < blocks(width) && b.y < blocks(height);
                        let is_in = !some || of_tile.filter(of_picture).any(is_busy);
                        assert_eq!(seen[(y * width + x) as usize], u32::from(is_in), "{x}, {y} of {width}x{height}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_block_is_busy_if_one_pixel_of_the_picture_is() {
        let frame = frame(19, 11);
        let sampled = Surface { instance: 0x8000_0000, ..Surface::default() };
        for (kind, is_sampled) in [(Surface::default(), false), (sampled.settled(), false), (sampled, true)] {
            for at in 0..19 * 11 {
                let mut surfaces = vec![Surface::default(); 19 * 11];
                surfaces[at as usize] = kind;
                for block in (0..2).flat_map(|y| (0..3).map(move |x| UVec2::new(x, y))) {
                    let holds = UVec2::new(at % 19 / BLOCK, at / 19 / BLOCK) == block;
                    assert_eq!(is_busy(block, &frame, &surfaces), u32::from(holds && is_sampled));
                }
            }
        }
    }
}
