//! The weight W of the candidate that is kept stands for the measure of (light, u, v): its mean over a cell, zero
//! counted where the candidate is elsewhere, is the size of the cell.

use glam::{UVec2, Vec3};
use rayon::prelude::*;
use weir_shader::{
    bsdf_rays::bsdf_rays,
    candidates::{by_inversion, candidates, resident},
};
use weir_shared::{
    alias,
    block::Block,
    fault,
    frame::Frame,
    light::source,
    light_cuts::{self, cut_of, cut_record},
    light_tree::NO_TREE,
    octahedral,
    presample::{LEVEL_CELLS, LEVELS, LightRecord, cell_of, cell_record, tile_of, tile_record},
    resample::{Candidate, choice},
    reservoir::Reservoir,
    reuse::lattice,
    scene::{
        Scene,
        instance_record::{LIGHT_CUTS_AT, LIGHT_TREE_AT},
    },
    surface::Surface,
    tiles::blocks,
};
use weir_tests::statistics::Sums;

use crate::cells::{Bench, Cell, PX};

/// Trials that are added up by one thread: sums do not depend on how many threads there are.
const PART: u32 = 1_000;

/// A kind of candidates by its name.
type Kind = (&'static str, fn(&mut Frame));

/// From the table alone to everything at once. There are ten lamps.
const KINDS: [Kind; 25] = [
    ("table", |f| f.candidates = 8),
    ("each lamp once", |f| f.candidates = 16),
    ("uniform", |f| (f.candidates, f.source) = (8, source::UNIFORM)),
    ("table and tree", tree),
    ("table, tree and BSDF", all),
    ("table and BSDF", |f| (f.candidates, f.candidates_bsdf) = (8, 1)),
    ("groups", |f| (f.candidates, f.candidates_full, f.choice) = (8, 3, choice::KEYS)),
    ("groups, tree and BSDF", |f| {
        all(f);
        // Enough for the table to have more than there are groups.
        (f.candidates_tree, f.candidates_full, f.choice) = (2, 2, choice::PLAIN);
    }),
    ("tiles", |f| tiles(f, 8)),
    ("tiles of fewer lights than candidates", |f| tiles(f, 2)),
    ("tiles, tree and BSDF", |f| {
        all(f);
        tiles(f, 8);
    }),
    ("tiles in groups", |f| {
        (f.candidates_full, f.choice) = (3, choice::KEYS);
        tiles(f, 16);
    }),
    ("cells", cells),
    ("cells in groups", |f| {
        (f.candidates_full, f.choice) = (3, choice::KEYS);
        cells(f);
    }),
    ("cells, tree and BSDF", |f| {
        all(f);
        cells(f);
    }),
    ("tree alone", |f| (f.candidates, f.source) = (4, source::TREE)),
    ("tree alone and BSDF", |f| (f.candidates, f.source, f.candidates_bsdf) = (4, source::TREE, 1)),
    ("cuts", cuts),
    ("cuts of more clusters than candidates", |f| {
        cuts(f);
        f.candidates = 2;
    }),
    ("cuts in groups", |f| {
        cuts(f);
        (f.candidates_full, f.choice) = (3, choice::KEYS);
    }),
    ("cuts, tree and BSDF", |f| {
        all(f);
        cuts(f);
    }),
    ("in memory", |f| (f.candidates, f.choice) = (8, choice::INVERSION)),
    ("in memory, each lamp once", |f| (f.candidates, f.candidates_bsdf, f.choice) = (16, 1, choice::INVERSION)),
    ("in memory, of tiles, tree and BSDF", |f| {
        all(f);
        tiles(f, 8);
        f.choice = choice::INVERSION;
    }),
    ("off the lattice", |f| {
        all(f);
        (f.lattice, f.candidates_off_lattice) = (lattice::CHECKERBOARD, 2);
    }),
];

fn tree(frame: &mut Frame) {
    (frame.candidates, frame.candidates_tree) = (8, 6);
}

fn tiles(frame: &mut Frame, columns: u32) {
    (frame.candidates, frame.source) = (8, source::TILES);
    (frame.presampled_columns, frame.presampled_rows) = (columns, 3);
}

/// The surface is in the second level of cells.
fn cells(frame: &mut Frame) {
    (frame.candidates, frame.source) = (8, source::CELLS);
    (frame.presampled_columns, frame.presampled_rows) = (6, LEVELS * LEVEL_CELLS);
    (frame.cell_size, frame.cell_candidates) = (0.4, 3);
}

fn cuts(frame: &mut Frame) {
    (frame.candidates, frame.source) = (8, source::CUTS);
    (frame.presampled_columns, frame.presampled_rows) = (5, 1);
}

/// Draws a record, or makes a cluster of a cut.
type Draw = fn(UVec2, &Frame, &Scene, &[u32], &[Surface]) -> LightRecord;

/// Draws ahead what the surface asks for.
fn draw_ahead(bench: &Bench, frame: &Frame, presampled: &mut Vec<LightRecord>) {
    let (view, lights) = (bench.view(), &bench.packed.lights);
    let (row, record): (u32, Draw) = match frame.source {
        source::TILES => (tile_of(frame, PX), |at, f, s, l, _| tile_record::<false, true>(at, f, s, l)),
        source::CELLS => {
            (cell_of(frame, bench.domain().position), |at, f, s, l, _| cell_record::<false, true>(at, f, s, l))
        }
        source::CUTS => (cut_of(frame, PX), |at, f, s, l, surfaces| {
            let across = blocks(f.width);
            let block = |i| Block::of(UVec2::new(i % across, i / across), f, surfaces);
            cut_record(at, f, s, l, &(0..across * blocks(f.height)).map(block).collect::<Vec<_>>())
        }),
        _ => return,
    };
    presampled.resize((frame.presampled_columns * frame.presampled_rows) as usize, LightRecord::EMPTY);
    for column in 0..frame.presampled_columns {
        let at = UVec2::new(column, row);
        presampled[frame.index_of_record(at) as usize] = record(at, frame, &view, lights, &bench.surfaces);
    }
}

fn all(frame: &mut Frame) {
    tree(frame);
    frame.candidates_bsdf = 1;
}

/// Means of W: in each cell; in all cells of a light that are lit; in all that are lit.
struct Means<'a> {
    bench: &'a Bench,
    cells: &'a [Cell],
    lights: usize,
}

impl<'a> Means<'a> {
    fn new(bench: &'a Bench, cells: &'a [Cell]) -> Self {
        Self { bench, cells, lights: bench.light_of(cells.len() - 1) + 1 }
    }

    fn quantities(&self) -> usize {
        self.cells.len() + self.lights + 1
    }

    /// What a reservoir adds to.
    fn add(&self, sums: &mut Sums, reservoir: Reservoir) {
        let cell = self.bench.cell_of(reservoir.light, reservoir.uv);
        if !reservoir.has_sample() || !self.cells[cell].is_lit {
            return sums.add([]);
        }
        let totals = [cell, self.cells.len() + self.bench.light_of(cell), self.quantities() - 1];
        sums.add(totals.map(|quantity| (quantity, f64::from(reservoir.ucw))));
    }

    fn expected(&self) -> Vec<Option<f64>> {
        let mut expected = vec![None; self.quantities()];
        for (i, cell) in self.cells.iter().enumerate().filter(|(_, cell)| cell.is_lit) {
            for quantity in [i, self.cells.len() + self.bench.light_of(i), self.quantities() - 1] {
                *expected[quantity].get_or_insert(0.0) += cell.size;
            }
        }
        expected
    }
}

/// How far the worst mean is from the size that it stands for; above 1 is too far. `spoil` may plant an error in what
/// the BSDF has found in a trial.
fn deviation(
    bench: &Bench,
    cells: &[Cell],
    kind: fn(&mut Frame),
    parts: u32,
    spoil: impl Fn(u32, Reservoir) -> Reservoir + Sync,
) -> (usize, f64) {
    let means = Means::new(bench, cells);
    let (view, surfaces, lights) = (bench.view(), &bench.surfaces, &bench.packed.lights);
    let trials = |(mut sums, mut presampled): (Sums, Vec<LightRecord>), index: u32| {
        let mut frame = bench.frame(index);
        kind(&mut frame);
        let mut hits = [Reservoir::EMPTY; 4];
        if frame.candidates_bsdf > 0 {
            let bvh = &bench.packed.bvh;
            let hit = if bench.has_others() {
                bsdf_rays::<false, true, true>(PX, 0, &frame, &view, bvh.as_slice(), surfaces)
            } else {
                bsdf_rays::<false, false, true>(PX, 0, &frame, &view, bvh.as_slice(), surfaces)
            };
            hits[frame.index_of(PX) as usize] = spoil(index, hit);
        }
        draw_ahead(bench, &frame, &mut presampled);
        let kept = match (frame.choice, bench.has_others()) {
            (choice::INVERSION, has_others) => {
                let candidate = if has_others { resident::<false, true, true> } else { resident::<false, false, true> };
                let count = frame.candidates_in_memory();
                let mut memory = vec![Candidate::NONE; (count * frame.width * frame.height) as usize];
                for number in 0..count {
                    memory[frame.index_of_candidate(PX, number) as usize] =
                        candidate(PX, number, &frame, &view, lights, surfaces, &hits, &presampled);
                }
                by_inversion(PX, 0, &frame, &memory)
            }
            (_, true) => candidates::<false, true, true>(PX, 0, &frame, &view, lights, surfaces, &hits, &presampled),
            (_, false) => candidates::<false, false, true>(PX, 0, &frame, &view, lights, surfaces, &hits, &presampled),
        };
        means.add(&mut sums, kept);
        (sums, presampled)
    };
    let none = || Sums::new(means.quantities());
    let parts: Vec<Sums> = (0..parts)
        .into_par_iter()
        .map(|p| (p * PART..(p + 1) * PART).fold((none(), vec![LightRecord::EMPTY]), trials).0)
        .collect();
    parts.iter().fold(none(), |all, part| all.merged(part)).worst(&means.expected())
}

fn check(bench: &Bench) {
    let cells = bench.cells();
    let lit = cells.iter().filter(|c| c.is_lit).count();
    assert!(lit >= if bench.has_others() { 50 } else { 40 }, "{lit} cells are too few");
    for (name, kind) in KINDS {
        let (worst, share) = deviation(bench, &cells, kind, 400, |_, hit| hit);
        println!("{name}: {share:.2}");
        assert!(
            share < 1.0,
            "others {}, {name}: quantity {worst} is off by {share} times the bound",
            bench.has_others()
        );
    }
}

#[test]
fn the_mean_of_w_over_a_cell_is_its_size() {
    check(&Bench::new(false, 0.3, 0.5));
}

#[test]
fn with_a_sky_the_mean_of_w_over_a_cell_is_its_size() {
    check(&Bench::new(true, 0.3, 0.5));
}

/// Points, a spot and a rectangle among the lamps, and moonlight instead of a sky.
#[test]
fn with_lights_of_other_shapes_the_mean_of_w_over_a_cell_is_its_size() {
    let bench = Bench::with_shapes(0.3, 0.5);
    let cells = bench.cells();
    let last = bench.light_of(cells.len() - 1);
    for light in last - 4..=last {
        let is_lit = (0..cells.len()).any(|cell| bench.light_of(cell) == light && cells[cell].is_lit);
        assert!(is_lit, "light {light} of {last} is dark");
    }
    check(&bench);
}

/// Where trees would be too large, alias tables stand in.
#[test]
fn without_trees_of_meshes_the_mean_of_w_over_a_cell_is_its_size() {
    let mut bench = Bench::new(false, 0.0, 1.0);
    for instance in 0..bench.packed.frame.instance_count {
        let at = bench.view().instance_at(&bench.packed.frame, instance);
        for word in [LIGHT_TREE_AT, LIGHT_CUTS_AT] {
            bench.packed.records[(at + word) as usize] = NO_TREE;
        }
    }
    check(&bench);
}

/// Candidates that stay in memory are those of the stream, of which another is kept.
#[test]
fn candidates_in_memory_are_those_of_the_stream() {
    let bench = Bench::new(true, 0.3, 0.5);
    let (view, lights, surfaces) = (bench.view(), &bench.packed.lights, &bench.surfaces);
    for (name, kind) in KINDS.into_iter().filter(|(name, _)| !name.contains("groups")) {
        let mut seen = 0;
        for index in 0..200 {
            let mut frame = bench.frame(index);
            kind(&mut frame);
            let mut presampled = vec![LightRecord::EMPTY];
            draw_ahead(&bench, &frame, &mut presampled);
            let hit = bsdf_rays::<false, true, true>(PX, 0, &frame, &view, bench.packed.bvh.as_slice(), surfaces);
            let mut hits = [Reservoir::EMPTY; 4];
            hits[frame.index_of(PX) as usize] = hit;
            let of_memory =
                |number| resident::<false, true, true>(PX, number, &frame, &view, lights, surfaces, &hits, &presampled);
            let all: Vec<Candidate> = (0..frame.candidates_in_memory()).map(of_memory).collect();
            let kept = candidates::<false, true, true>(PX, 0, &frame, &view, lights, surfaces, &hits, &presampled);
            let sum: f32 = all.iter().map(|c| c.weight).sum();
            if !kept.has_sample() {
                assert_eq!(sum, 0.0, "{name}");
                continue;
            }
            seen += 1;
            let same = all.iter().find(|c| (c.light, c.uv) == (kept.light, kept.uv)).expect(name);
            let ucw = sum / same.target;
            assert!((ucw - kept.ucw).abs() <= 1e-5 * ucw, "{name}: {ucw} for {}", kept.ucw);
        }
        assert!(seen > 150, "{name}: {seen}");
    }
}

/// A ray by the BSDF may end, by a rounding error, where nothing else leads and no light comes from: no fault.
#[test]
fn what_no_technique_can_draw_has_no_weight_and_is_no_fault() {
    let bench = Bench::new(false, 0.3, 0.5);
    let down = octahedral::pack(Vec3::NEG_Y);
    let surfaces = vec![Surface { normal_geometric: down, normal_shading: down, ..bench.surface }; 4];
    let frame = Frame { candidates: 4, source: source::TREE, candidates_bsdf: 1, ..bench.frame(0) };
    // All lamps are above.
    let hits = [Reservoir::new(0, 0x8000_8000, 1.0, 1); 4];
    let (view, lights, none) = (bench.view(), &bench.packed.lights, [LightRecord::EMPTY]);
    let kept = candidates::<false, false, true>(PX, 0, &frame, &view, lights, &surfaces, &hits, &none);
    assert!(!kept.has_sample() && kept.fault() == fault::NONE, "{kept:?}, fault {}", kept.fault());
}

/// Multiplies the reported probabilities of an alias table by 1.03, but not what it draws.
fn spoil_table(lights: &mut [u32], at: u32, count: u32) {
    for entry in lights[at as usize..].chunks_exact_mut(alias::ENTRY_WORDS as usize).take(count as usize) {
        entry[2] = (f32::from_bits(entry[2]) * 1.03).to_bits();
    }
}

/// The checks above have teeth: 3 % in the density of one technique is seen, and so is a tree that leads to one lamp and
/// reports another.
#[test]
fn an_error_of_three_percent_in_a_density_is_seen() {
    let see = |what: &str, bench: &Bench, kind: fn(&mut Frame), spoil: fn(u32, Reservoir) -> Reservoir| {
        let (_, share) = deviation(bench, &bench.cells(), kind, 1_600, spoil);
        println!("{what}: {share:.2}");
        assert!(share > 1.0, "{what}: {share}");
    };
    let fine = |_, hit| hit;
    // Where they matter most: few other candidates, and a surface that mirrors.
    let few: fn(&mut Frame) = |f| (f.candidates, f.candidates_bsdf) = (2, 1);
    see("rays", &Bench::new(true, 0.9, 0.4), few, |index, hit| if index % 33 == 0 { Reservoir::EMPTY } else { hit });
    let mut bench = Bench::new(false, 0.3, 0.5);
    let emitters = bench.packed.frame.emitter_count;
    spoil_table(&mut bench.packed.lights, 0, emitters);
    see("table", &bench, all, fine);
    see("table of tiles", &bench, |f| tiles(f, 8), fine);
    see("table of cells", &bench, cells, fine);

    let mut bench = Bench::new(true, 0.3, 0.5);
    let Frame { environment_table_at, environment_width, environment_height, .. } = bench.packed.frame;
    spoil_table(&mut bench.packed.lights, environment_table_at, environment_width * environment_height);
    see("sky", &bench, |f| f.candidates = 8, fine);

    let mut bench = Bench::new(false, 0.3, 0.5);
    let at = bench.packed.frame.light_tree_at as usize;
    bench.packed.lights.swap(at, at + 1);
    see("tree", &bench, all, fine);

    // A leaf of the tree for cuts that says that nothing emits there.
    let mut bench = Bench::new(false, 0.3, 0.5);
    let at = bench.packed.frame.light_cuts_at;
    let leaf = 1 << bench.packed.lights[at as usize];
    let power = at + 1 + 2 * emitters + (leaf - 1) * light_cuts::NODE_WORDS + light_cuts::node_field::POWER;
    bench.packed.lights[power as usize] = 0;
    see("cuts", &bench, cuts, fine);
}
