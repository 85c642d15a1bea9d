//! The front of quality against cost that the time budget moves along.

use crate::settings::Settings;

/// A setting of which none of the others is both faster and better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rung {
    /// What it sets, as `--set` takes it: knobs that stand in the frame uniform, and no others.
    pub knobs: &'static [&'static str],
    /// Time of a frame as a share of that of the default.
    pub cost: f64,
    /// relMSE of a frame as a share of that of the default.
    pub rel_mse: f64,
    /// Whether these are the default settings.
    pub is_default: bool,
}

impl Rung {
    /// `base` with what the rung sets.
    pub fn applied_to(&self, base: &Settings) -> Settings {
        let mut settings = base.clone();
        for knob in self.knobs {
            settings.apply(knob).expect("a rung names knobs and values that exist");
        }
        settings
    }
}

const fn rung(knobs: &'static [&'static str], cost: f64, rel_mse: f64) -> Rung {
    Rung { knobs, cost, rel_mse, is_default: false }
}

/// From the cheapest to the best.
#[rustfmt::skip]
pub const FRONT: &[Rung] = &[
    rung(&["candidates.count=2", "candidates.tree=1", "temporal.neighbors=0", "temporal.neighbors_unseen=1", "reuse.resolution=half", "candidates.off_lattice=1"], 0.6, 3.0),
    rung(&["candidates.count=4", "candidates.tree=3", "temporal.neighbors=0", "temporal.neighbors_unseen=3", "reuse.resolution=checkerboard", "candidates.off_lattice=2"], 0.7, 2.0),
    rung(&["candidates.count=4", "candidates.tree=3", "temporal.neighbors=1", "temporal.neighbors_unseen=6", "reuse.resolution=full", "candidates.off_lattice=2"], 0.87, 1.2),
    Rung { knobs: &["candidates.count=4", "candidates.tree=3", "temporal.neighbors=3", "temporal.neighbors_unseen=6", "reuse.resolution=full", "candidates.off_lattice=2"], cost: 1.0, rel_mse: 1.0, is_default: true },
    rung(&["candidates.count=8", "candidates.tree=6", "temporal.neighbors=3", "temporal.neighbors_unseen=6", "reuse.resolution=full", "candidates.off_lattice=2"], 1.2, 0.85),
    rung(&["candidates.count=16", "candidates.tree=12", "temporal.neighbors=3", "temporal.neighbors_unseen=6", "reuse.resolution=full", "candidates.off_lattice=2"], 1.6, 0.75),
    rung(&["candidates.count=32", "candidates.tree=24", "temporal.neighbors=3", "temporal.neighbors_unseen=6", "reuse.resolution=full", "candidates.off_lattice=2"], 2.3, 0.7),
];
