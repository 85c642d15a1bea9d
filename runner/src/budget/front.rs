//! The front of quality against cost that the time budget moves along.

use crate::settings::Settings;

/// A setting of which none of the others is both faster and better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rung {
    /// What it sets, as `--set` takes it: knobs that stand in the frame uniform, and no others.
    pub knobs: &'static [&'static str],
    /// Time of a frame as a share of that of the default.
    pub cost: f64,
    /// MAPE of a frame as a share of that of the default.
    pub mape: f64,
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

const fn rung(knobs: &'static [&'static str], cost: f64, mape: f64) -> Rung {
    Rung { knobs, cost, mape, is_default: false }
}

/// The knobs of a rung, in one order.
macro_rules! knobs {
    ($count:literal $tree:literal $near:literal $unseen:literal $resolution:literal $off:literal) => {
        &[
            concat!("candidates.count=", $count),
            concat!("candidates.tree=", $tree),
            concat!("temporal.neighbors=", $near),
            concat!("temporal.neighbors_unseen=", $unseen),
            concat!("reuse.resolution=", $resolution),
            concat!("candidates.off_lattice=", $off),
        ]
    };
}

/// From the cheapest to the best: what is left of fourteen settings without those that another beats in both.
///
/// Measured by `weir bench --scene SCENE --method chain:KNOBS ... --chain-frames 20` on two shared CPU cores, all settings in
/// turns, 320x180. Times are medians on `rooms`; errors are those of the second half of one chain, the geometric mean over
/// `rooms` and `park`. Other machines and scenes have other steps: the budget learns them.
pub const FRONT: &[Rung] = &[
    rung(knobs!(2 1 0 1 "half" 1), 0.43, 1.65),
    rung(knobs!(2 1 0 1 "checkerboard" 1), 0.52, 1.57),
    rung(knobs!(2 1 1 6 "full" 2), 0.71, 1.17),
    rung(knobs!(4 3 1 6 "full" 2), 0.87, 1.06),
    Rung { is_default: true, ..rung(knobs!(4 3 3 6 "full" 2), 1.0, 1.0) },
    rung(knobs!(8 6 6 6 "full" 2), 1.44, 0.949),
    rung(knobs!(16 12 6 6 "full" 2), 2.00, 0.938),
    rung(knobs!(32 24 6 6 "full" 2), 3.57, 0.919),
];
