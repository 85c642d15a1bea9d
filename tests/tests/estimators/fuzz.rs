//! Random small worlds, each enumerated; and what the passes run in `f32` against the same in `f64`.

use weir::stress::worlds::random::{furthest_from_double, worst_of};

use crate::ROUNDING;

#[test]
fn no_random_world_is_an_exception() {
    let (error, world) = worst_of(1_000_000);
    assert!(error < ROUNDING, "world {world}: error {error}");
}

#[test]
fn single_precision_follows_double_precision_when_it_decides_alike() {
    let (distance, case) = furthest_from_double(100_000);
    assert!(distance < 1e-5, "case {case}: {distance}");
}
