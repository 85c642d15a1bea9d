//! Whether an ensemble has the mean of the reference: tests of difference, and of equivalence.
//!
//! Neighbouring pixels of a chain share samples, so the variance of a tile is that of its total over the chains, not
//! the sum of those of its pixels.

use weir::reference::Estimate;

use crate::chains::{HEIGHT, WIDTH};

const TILE: u32 = 8;
const TILES: usize = ((WIDTH / TILE) * (HEIGHT / TILE)) as usize;
/// Totals that are tested: each channel of each tile, each channel of the picture, the picture.
pub const TOTALS: usize = 3 * TILES + 4;
const PICTURE: usize = TOTALS - 1;

/// Probability that noise alone fails a whole comparison.
const FALSE_ALARM: f64 = 1e-4;
/// Normal quantile for 95 %, one-sided: two such tests make one of equivalence.
const ONE_SIDED: f64 = 1.645;

/// Mean and variance of the mean of each total.
#[derive(Clone)]
pub struct Ensemble {
    mean: [f64; TOTALS],
    variance: [f64; TOTALS],
    count: u32,
}

fn add_pixel(totals: &mut [f64; TOTALS], pixel: usize, rgb: [f64; 3]) {
    let (x, y) = (pixel as u32 % WIDTH, pixel as u32 / WIDTH);
    let tile = (y / TILE * (WIDTH / TILE) + x / TILE) as usize;
    for (channel, value) in rgb.into_iter().enumerate() {
        totals[3 * tile + channel] += value;
        totals[3 * TILES + channel] += value;
        totals[PICTURE] += value;
    }
}

impl Ensemble {
    /// The totals of one picture.
    pub fn totals(pixels: impl Iterator<Item = [f64; 3]>) -> [f64; TOTALS] {
        let mut totals = [0.0; TOTALS];
        pixels.enumerate().for_each(|(i, rgb)| add_pixel(&mut totals, i, rgb));
        totals
    }

    /// From the totals of independent pictures.
    pub fn new(pictures: &[[f64; TOTALS]]) -> Self {
        let n = pictures.len() as f64;
        let mean: [f64; TOTALS] = std::array::from_fn(|i| pictures.iter().map(|p| p[i]).sum::<f64>() / n);
        let deviation = |i: usize| pictures.iter().map(|p| (p[i] - mean[i]).powi(2)).sum::<f64>();
        let variance = std::array::from_fn(|i| deviation(i) / (n * (n - 1.0)));
        Self { mean, variance, count: pictures.len() as u32 }
    }

    /// From the pixels of the reference, which are independent.
    pub fn of_reference(estimates: &[Estimate]) -> Self {
        let mean = Self::totals(estimates.iter().map(|e| e.mean.to_array()));
        let mut variance = Self::totals(estimates.iter().map(|e| e.variance_of_mean().to_array()));
        // The channels of a sample are not independent; their standard deviations add up at most.
        variance[PICTURE] = variance[3 * TILES..PICTURE].iter().map(|v| v.sqrt()).sum::<f64>().powi(2);
        Self { mean, variance, count: estimates.first().map_or(0, |e| e.count as u32) }
    }

    /// Standard deviation of the whole of one picture, as a share of its mean.
    pub fn spread(&self) -> f64 {
        (self.variance[PICTURE] * f64::from(self.count)).sqrt() / self.mean[PICTURE]
    }
}

/// A difference between two means.
#[derive(Clone, Copy)]
pub struct Difference {
    /// Which total.
    total: usize,
    /// As a share of the reference.
    pub relative: f64,
    /// Its standard error.
    pub error: f64,
    /// Difference over standard error (Welch).
    pub z: f64,
    /// Largest |z| that noise alone may reach.
    bound: f64,
}

impl Difference {
    fn new(total: usize, a: &Ensemble, b: &Ensemble) -> Self {
        let variance = a.variance[total] + b.variance[total];
        let difference = a.mean[total] - b.mean[total];
        // Below one part in 100,000 rounding, not noise, decides.
        let error = variance.sqrt().max(1e-5 * b.mean[total].abs()).max(1e-12);
        let freedom = variance.powi(2)
            / (a.variance[total].powi(2) / f64::from(a.count - 1) + b.variance[total].powi(2) / f64::from(b.count - 1))
                .max(1e-300);
        let scale = 1.0 / b.mean[total].abs().max(1e-12);
        Self {
            total,
            relative: difference * scale,
            error: error * scale,
            z: difference / error,
            bound: student_bound(freedom.max(1.0)),
        }
    }

    /// Whether it is more than noise.
    fn is_significant(&self) -> bool {
        self.z.abs() > self.bound
    }

    /// Whether the two means are known, at 95 %, to be within `margin` of each other.
    fn is_within(&self, margin: f64) -> bool {
        self.relative.abs() + ONE_SIDED * self.error < margin
    }
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (tile, channel) = (self.total as u32 / 3, self.total % 3);
        match self.total {
            PICTURE => f.write_str("picture")?,
            t if t >= 3 * TILES => write!(f, "channel {channel}")?,
            _ => write!(
                f,
                "tile ({}, {}) channel {channel}",
                tile % (WIDTH / TILE) * TILE,
                tile / (WIDTH / TILE) * TILE
            )?,
        }
        write!(f, " {:+.3} % +- {:.3} %, z = {:.1}", 100.0 * self.relative, 196.0 * self.error, self.z)
    }
}

/// The outcome of a comparison.
pub struct Verdict {
    /// Of the whole picture.
    pub picture: Difference,
    /// The total of largest |z| against its bound.
    pub worst: Difference,
    /// The tile with the largest difference among those bright enough for a relative one.
    pub widest: Difference,
    pub chains: u32,
    picture_margin: f64,
    tile_margin: Option<f64>,
    tiles_within: bool,
}

impl Verdict {
    /// Compares with the reference. The picture must be equivalent within `picture_margin`; its tiles within
    /// `tile_margin`, if any, where they are bright enough to matter: a third of the picture's mean.
    pub fn new(chains: &Ensemble, judge: &Ensemble, picture_margin: f64, tile_margin: Option<f64>) -> Self {
        let all: Vec<_> = (0..TOTALS).map(|i| Difference::new(i, chains, judge)).collect();
        let bright = |i: &&Difference| {
            i.total < 3 * TILES && judge.mean[i.total] * TILES as f64 > judge.mean[3 * TILES + i.total % 3] / 3.0
        };
        let by = |f: fn(&Difference) -> f64| move |a: &&Difference, b: &&Difference| f(a).total_cmp(&f(b));
        let worst =
            **all.iter().collect::<Vec<_>>().iter().max_by(|a, b| by(|d| d.z.abs() / d.bound)(a, b)).expect("totals");
        let reach = |d: &Difference| d.relative.abs() + ONE_SIDED * d.error;
        let widest = *all.iter().filter(bright).max_by(by(reach)).expect("some tile is bright");
        let tiles_within = tile_margin.is_none_or(|margin| widest.is_within(margin));
        let picture = all[PICTURE];
        Self { picture, worst, widest, chains: chains.count, picture_margin, tile_margin, tiles_within }
    }

    /// Whether some mean differs by more than noise.
    pub fn differs(&self) -> bool {
        self.worst.is_significant()
    }

    /// Nothing differs, and the noise is low enough to say that it does not.
    pub fn is_unbiased(&self) -> bool {
        !self.differs() && self.picture.is_within(self.picture_margin) && self.tiles_within
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} | worst: {} | widest: {} | {} chains", self.picture, self.worst, self.widest, self.chains)?;
        let tiles = self.tile_margin.map_or_else(String::new, |m| format!(", of a tile {} %", 100.0 * m));
        write!(f, " | margin {} %{tiles}", 100.0 * self.picture_margin)
    }
}

/// Two-sided quantile of Student's distribution for one of [`TOTALS`] tests that together fail by chance with
/// [`FALSE_ALARM`] (Sidak). Source for Student's from the normal one: Abramowitz and Stegun 26.7.5, first term.
fn student_bound(freedom: f64) -> f64 {
    let tail = -(-FALSE_ALARM).ln_1p() / TOTALS as f64 / 2.0;
    let (mut low, mut high) = (3.0f64, 9.0f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if normal_tail(middle) > tail { low = middle } else { high = middle }
    }
    low + (low.powi(3) + low) / (4.0 * freedom)
}

/// Probability that a normal variable exceeds `z`, for z above 2: Laplace's continued fraction.
fn normal_tail(z: f64) -> f64 {
    let fraction = (1..60).rev().fold(z, |rest, i| z + f64::from(i) / rest);
    (-0.5 * z * z).exp() / (std::f64::consts::TAU.sqrt() * fraction)
}

#[test]
fn quantiles_are_those_of_the_tables() {
    assert!((normal_tail(3.0) - 1.349_898e-3).abs() < 1e-8);
    assert!((normal_tail(4.5) - 3.397_673e-6).abs() < 1e-11);
    let bound = student_bound(1e9);
    assert!((normal_tail(bound) * 2.0 * TOTALS as f64 - FALSE_ALARM).abs() < 1e-7);
    assert!(student_bound(255.0) > bound && student_bound(255.0) < 1.04 * bound);
}
