use glam::{UVec2, UVec4};
use weir_shared::{
    frame::Frame,
    tiles::{BLOCK, LIST_VECTORS, Tiling, blocks, busy_in_row, list_vector},
};

use super::{Band, Extent};

/// How often the bands visit each element, and whether at the right index.
fn visits(frame: &Frame, extent: Extent, list: &[UVec4], band_rows: u32, backwards: bool) -> Vec<u32> {
    let grid = extent.grid(frame);
    let mut seen = vec![0; grid.elements() as usize];
    for first_row in (0..grid.rows).step_by(band_rows as usize) {
        let band = Band { first_row, rows: band_rows.min(grid.rows - first_row), backwards };
        let start = (first_row * grid.depth * grid.columns) as usize;
        band.for_each(extent, frame, list, |index, px, number| {
            assert!(px.x < grid.columns && px.y < grid.rows && number < grid.depth);
            if extent == Extent::Reservoirs {
                assert_eq!((start + index) as u32, frame.index_of_reservoir(px, number));
            }
            seen[start + index] += 1;
        });
    }
    seen
}

#[test]
fn bands_of_any_size_visit_every_element_once_and_those_of_a_list_only() {
    // Tiles of one block, and of four.
    for (width, height) in [(33, 20), (70, 100), (1003, 603)] {
        let frame =
            Frame { width, height, reservoirs: 2, presampled_columns: 9, presampled_rows: 3, ..Frame::default() };
        let is_busy = |block: UVec2| (block.x * 7 + block.y * 3).is_multiple_of(5);
        let places = (0..blocks(height)).flat_map(|y| (0..blocks(width)).map(move |x| UVec2::new(x, y)));
        let busy: Vec<u32> = places.map(|block| u32::from(is_busy(block))).collect();
        let tiling = Tiling::of(&frame);
        let in_rows: Vec<u32> = (0..tiling.rows).map(|row| busy_in_row(row, &frame, &busy)).collect();
        let list: Vec<UVec4> = (0..LIST_VECTORS).map(|number| list_vector(number, &frame, &busy, &in_rows)).collect();
        let is_listed = |x: u32, y: u32| {
            let tile = ((y / BLOCK) >> tiling.shift) * tiling.columns + ((x / BLOCK) >> tiling.shift);
            let of_tile = (0..tiling.blocks()).map(|i| tiling.block(tile, i));
            of_tile.filter(|b| b.x < blocks(width) && b.y < blocks(height)).any(is_busy)
        };
        let expected: Vec<u32> = (0..height)
            .flat_map(|y| (0..2 * width).map(move |x| (x % width, y)))
            .map(|(x, y)| u32::from(is_listed(x, y)))
            .collect();
        assert!(expected.contains(&0) && expected.contains(&1));
        for (band_rows, backwards) in [(1, false), (7, true), (8, false), (8, true), (16, true), (height, false)] {
            let seen = visits(&frame, Extent::Reservoirs, &list, band_rows, backwards);
            assert!(seen == expected, "{width}x{height}, bands of {band_rows}");
            // A list of zeros lists nothing, and others have none.
            for (extent, list) in [
                (Extent::Reservoirs, &[UVec4::ZERO; 1] as &[UVec4]),
                (Extent::Pixels, &list),
                (Extent::Records, &[]),
                (Extent::Blocks, &[]),
            ] {
                let seen = visits(&frame, extent, list, band_rows, backwards);
                assert!(seen.iter().all(|times| *times == 1), "{width}x{height}, {extent}, bands of {band_rows}");
            }
        }
    }
}
