//! Picks from tables.

use glam::UVec2;
use weir_shared::{
    environment,
    frame::Frame,
    light::{self, source},
    presample::tile_record,
    rng::pcg4d,
};
use weir_tests::statistics::misfit;

use crate::cells::Bench;

const PICKS: u32 = 2_000_000;

/// Frequencies of picks, each among `count`.
fn frequencies(count: u32, pick: impl Fn([u32; 4]) -> u32) -> Vec<f64> {
    let mut counts = vec![0.0; count as usize];
    (0..PICKS).for_each(|i| counts[pick(pcg4d(i, 3, 1, 4)) as usize] += 1.0);
    counts
}

/// Whether frequencies fit the probabilities, and would not with the largest of them 10 % larger.
fn fits(observed: &[f64], pmf: &[f64]) -> bool {
    assert!((pmf.iter().sum::<f64>() - 1.0).abs() < 1e-6, "{pmf:?}");
    let largest = pmf.iter().fold(0.0, |a: f64, &b| a.max(b));
    let share = |wrong: f64| {
        let expected = pmf.iter().map(|&p| p * f64::from(PICKS) * if p == largest { wrong } else { 1.0 });
        misfit(observed, &expected.collect::<Vec<_>>())
    };
    assert!(share(1.1) > 1.0, "the check has no teeth");
    share(1.0) < 1.0
}

#[test]
fn texels_of_the_sky_are_picked_as_often_as_reported() {
    let bench = Bench::new(true, 0.0, 1.0);
    let (frame, lights) = (&bench.packed.frame, &bench.packed.lights);
    let count = frame.environment_width * frame.environment_height;
    let pmf: Vec<f64> = (0..count).map(|texel| f64::from(environment::pmf(frame, lights, texel))).collect();
    let observed = frequencies(count, |bits| {
        let picked = environment::pick(frame, lights, bits[0], bits[1]);
        assert_eq!(picked.pmf, environment::pmf(frame, lights, picked.index));
        picked.index
    });
    assert!(fits(&observed, &pmf), "{observed:?} for {pmf:?}");
}

#[test]
fn lamps_are_picked_as_often_as_reported_by_power_and_uniformly() {
    let bench = Bench::new(false, 0.0, 1.0);
    for source in [source::UNIFORM, source::POWER] {
        let (frame, view) = (Frame { source, ..bench.packed.frame }, bench.view());
        let lights = &bench.packed.lights;
        let pmf = |light| f64::from(light::pmf(&frame, &view, lights, light::address_of(&frame, &view, light)));
        let pmf: Vec<f64> = (0..frame.light_count).map(pmf).collect();
        let observed = frequencies(frame.light_count, |bits| {
            light::light_at(&frame, &view, light::pick(&frame, &view, lights, bits).address)
        });
        assert!(fits(&observed, &pmf), "source {source}: {observed:?} for {pmf:?}");
    }
}

#[test]
fn any_record_of_a_tile_is_a_lamp_as_often_as_reported_and_a_tile_has_its_parts() {
    let bench = Bench::new(false, 0.0, 1.0);
    let (view, lights) = (bench.view(), &bench.packed.lights);
    // Rows are told apart up to 65,536: more tiles take another frame.
    let (columns, rows) = (16, 1_000);
    let tiles = PICKS / columns;
    let frame = Frame { presampled_columns: columns, presampled_rows: rows, ..bench.packed.frame };
    let pmf = |light| f64::from(light::pmf(&frame, &view, lights, light::address_of(&frame, &view, light)));
    let pmf: Vec<f64> = (0..frame.light_count).map(pmf).collect();
    let mut counts = vec![0.0; pmf.len()];
    let mut emitters = vec![[0u32; 2]; frame.emitter_count as usize];
    for tile in 0..tiles {
        let frame = Frame { index: tile / rows, ..frame };
        let mut of_tile = vec![0u32; emitters.len()];
        for column in 0..columns {
            let record = tile_record::<false, true>(UVec2::new(column, tile % rows), &frame, &view, lights);
            assert_eq!(f64::from(record.pmf), pmf[record.light as usize]);
            assert_eq!((record.scale, light::light_at(&frame, &view, record.address())), (1.0, record.light));
            counts[record.light as usize] += 1.0;
            of_tile[record.emitter as usize] += 1;
        }
        for (seen, count) in emitters.iter_mut().zip(of_tile) {
            *seen = [seen[0] + count, seen[1] + count * count];
        }
    }
    // Strata spread frequencies less than independent picks would.
    assert!(fits(&counts, &pmf), "{counts:?} for {pmf:?}");
    // By strata, an emitter is in a tile nearly as often as it should be: far less spread than without.
    for [sum, squares] in emitters {
        let mean = f64::from(sum) / f64::from(tiles);
        let variance = f64::from(squares) / f64::from(tiles) - mean * mean;
        let share = mean / f64::from(columns);
        let independent = f64::from(columns) * share * (1.0 - share);
        assert!(variance < 0.8 * independent, "{variance} of {independent}");
    }
}
