//! Statistical tests: frequencies, and means.

/// Probability that noise alone fails one comparison, whatever the number of things that it compares.
const FALSE_ALARM: f64 = 1e-6;

/// The normal quantile 1 - `p`, for small `p`; the error is below 0.0005. Source: Abramowitz and Stegun 1964, 26.2.23.
fn normal_quantile(p: f64) -> f64 {
    let t = (-2.0 * p.ln()).sqrt();
    t - (2.515_517 + 0.802_853 * t + 0.010_328 * t * t)
        / (1.0 + 1.432_788 * t + 0.189_269 * t * t + 0.001_308 * t * t * t)
}

/// Pearson's statistic as a share of its largest value by noise alone (Wilson and Hilferty's approximation). Above 1 the
/// frequencies are not those expected. Cells in which fewer than ten are expected count as one; something where nothing
/// is expected does not fit at all.
pub fn misfit(observed: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(observed.len(), expected.len(), "a cell has both");
    let (mut statistic, mut cells, mut rest) = (0.0, 0.0, (0.0, 0.0));
    let mut add = |o: f64, e: f64| {
        statistic += (o - e).powi(2) / e;
        cells += 1.0;
    };
    for (&o, &e) in observed.iter().zip(expected) {
        if e == 0.0 && o > 0.0 {
            return f64::INFINITY;
        } else if e < 10.0 {
            rest = (rest.0 + o, rest.1 + e);
        } else {
            add(o, e);
        }
    }
    if rest.1 >= 10.0 {
        add(rest.0, rest.1);
    } else if rest.0 > rest.1 + 30.0 {
        return f64::INFINITY;
    }
    let freedom: f64 = f64::max(cells - 1.0, 1.0);
    let spread = 2.0 / (9.0 * freedom);
    statistic / (freedom * (1.0 - spread + normal_quantile(FALSE_ALARM) * spread.sqrt()).powi(3))
}

/// Sums over trials, for the means of several quantities.
#[derive(Clone)]
pub struct Sums {
    count: f64,
    sums: Vec<f64>,
    squares: Vec<f64>,
}

impl Sums {
    /// Of `quantities`, no trial yet.
    pub fn new(quantities: usize) -> Self {
        Self { count: 0.0, sums: vec![0.0; quantities], squares: vec![0.0; quantities] }
    }

    /// A trial in which `values` are not zero, each with its quantity.
    pub fn add(&mut self, values: impl IntoIterator<Item = (usize, f64)>) {
        self.count += 1.0;
        for (quantity, value) in values {
            self.sums[quantity] += value;
            self.squares[quantity] += value * value;
        }
    }

    /// Those of other trials too.
    pub fn merged(mut self, other: &Self) -> Self {
        self.count += other.count;
        self.sums.iter_mut().zip(&other.sums).for_each(|(a, b)| *a += b);
        self.squares.iter_mut().zip(&other.squares).for_each(|(a, b)| *a += b);
        self
    }

    /// The quantity whose mean is furthest from the `expected` one, and how far, as a share of what noise allows with
    /// so many quantities (Sidak). `None` for a quantity that is not looked at.
    pub fn worst(&self, expected: &[Option<f64>]) -> (usize, f64) {
        let looked_at = expected.iter().flatten().count() as f64;
        // Two-sided.
        let bound = normal_quantile(0.5 * (1.0 - (1.0 - FALSE_ALARM).powf(1.0 / looked_at)));
        let share = |quantity: usize, expected: f64| {
            let mean = self.sums[quantity] / self.count;
            let variance = (self.squares[quantity] / self.count - mean * mean) / self.count;
            // Rounding of single numbers leaves one part in 100,000.
            (mean - expected).abs() / variance.sqrt().max(1e-5 * expected.abs()) / bound
        };
        let shares = expected.iter().enumerate().filter_map(|(i, e)| e.map(|e| (i, share(i, e))));
        shares.fold((0, 0.0), |worst, this| if this.1 <= worst.1 { worst } else { this })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_tables() {
        for (p, expected) in [(0.05, 1.644_854), (1e-3, 3.090_232), (1e-6, 4.753_424)] {
            assert!((normal_quantile(p) - expected).abs() < 5e-4);
        }
        // Chi-square at its quantile 1 - 1e-6 for 3 degrees of freedom, 30.665, from four cells: the approximation is worst
        // there, and too careful.
        let off = (30.665f64 / 2.0 * 1e6).sqrt();
        let share = misfit(&[1e6 + off, 1e6 - off, 1e6, 1e6], &[1e6; 4]);
        assert!(share < 1.0 && share > 0.92, "{share}");
        assert_eq!(misfit(&[1.0, 99.0], &[0.0, 100.0]), f64::INFINITY);
        assert_eq!(misfit(&[50.0, 1000.0], &[1.0, 1000.0]), f64::INFINITY);
    }

    #[test]
    fn means_are_compared_by_their_own_noise() {
        let mut sums = Sums::new(2);
        (0..10_000).for_each(|i| sums.add((i % 2 == 0).then_some((1, 2.0))));
        assert_eq!(sums.worst(&[Some(0.0), Some(1.0)]).1, 0.0);
        // Standard error 0.01; the bound for one quantity is 4.89 of them.
        assert!(sums.worst(&[None, Some(0.952)]).1 < 1.0 && sums.worst(&[None, Some(0.95)]).1 > 1.0);
        assert!(sums.clone().merged(&sums).worst(&[None, Some(0.952)]).1 > 1.0);
    }
}
