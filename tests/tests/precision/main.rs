//! The core runs in `f32`; here `f64` judges it: errors by sweeps, each within what the function's documentation states.

mod scalars;
mod shapes;
mod watertight;

/// The largest of some errors, and where.
#[derive(Clone, Copy, Debug, Default)]
pub struct Worst {
    /// In units in the last place of the exact value.
    pub ulps: f64,
    /// Where that is.
    pub at: f64,
    /// Largest absolute error.
    pub absolute: f64,
}

impl Worst {
    /// With one more value. An ulp is at least that of the smallest normal number.
    pub fn add(&mut self, at: f64, value: f32, exact: f64) {
        let error = (f64::from(value) - exact).abs();
        let ulps = error / ulp(exact);
        // Not-a-number is the worst there is.
        if ulps.is_nan() || ulps > self.ulps {
            (self.ulps, self.at) = (if ulps.is_nan() { f64::INFINITY } else { ulps }, at);
        }
        self.absolute = self.absolute.max(error);
    }

    /// The larger of two.
    pub fn merged(self, other: Self) -> Self {
        let larger = if other.ulps > self.ulps { other } else { self };
        Self { absolute: self.absolute.max(other.absolute), ..larger }
    }
}

/// The distance between the floats around an exact value.
pub fn ulp(exact: f64) -> f64 {
    let magnitude = exact.abs().max(f64::from(f32::MIN_POSITIVE));
    (magnitude.log2().floor() - 23.0).exp2()
}

/// Checks an error against what the documentation states, and that it states no more than twice what there is.
#[track_caller]
pub fn assert_stated(what: &str, worst: Worst, stated_ulps: f64) {
    println!("{what}: {:.2} ulp at {:e}, {:.2e} absolute", worst.ulps, worst.at, worst.absolute);
    assert!(worst.ulps <= stated_ulps, "{what}: {worst:?}, {stated_ulps} are stated");
    assert!(worst.ulps * 2.0 > stated_ulps, "{what}: {worst:?}, far below the {stated_ulps} that are stated");
}

#[test]
fn an_ulp_is_the_distance_between_neighbours() {
    for x in [1.0f32, 1.5, 2.0, 3e-30, 1e30, f32::MIN_POSITIVE] {
        let next = f32::from_bits(x.to_bits() + 1);
        assert_eq!(ulp(f64::from(x)), f64::from(next) - f64::from(x));
    }
    let mut worst = Worst::default();
    worst.add(1.0, f32::NAN, 1.0);
    assert_eq!(worst.ulps, f64::INFINITY);
}
