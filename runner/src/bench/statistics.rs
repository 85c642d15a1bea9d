//! Medians, means and their intervals.

use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};
use serde::{Deserialize, Deserializer, Serialize};

use crate::margin::student;

/// A quantity that was measured several times: the middle, an interval that holds the true middle with 95 %, and what it
/// is made of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// Median, or mean.
    #[serde(deserialize_with = "unknown_if_null")]
    pub value: f64,
    /// Lower end.
    #[serde(deserialize_with = "unknown_if_null")]
    pub low: f64,
    /// Upper end.
    #[serde(deserialize_with = "unknown_if_null")]
    pub high: f64,
    /// One value for each independent part of the run.
    pub samples: Vec<f64>,
}

/// JSON has no word for a number that is none: what is not known, such as the noise of one sample, is null there.
fn unknown_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// Resamples of a bootstrap.
const RESAMPLES: usize = 1000;

impl Quantity {
    /// The median, with the interval of the percentile bootstrap. Of few samples it is narrow: it never leaves their range.
    ///
    /// Source: Efron 1979.
    pub fn median(samples: Vec<f64>) -> Self {
        let value = median(&samples);
        let mut rng = Pcg64Mcg::seed_from_u64(samples.len() as u64);
        let mut resample = || {
            let pick = |_| samples[((u128::from(rng.next_u64()) * samples.len() as u128) >> 64) as usize];
            median(&(0..samples.len()).map(pick).collect::<Vec<_>>())
        };
        let mut medians: Vec<f64> =
            if samples.is_empty() { Vec::new() } else { (0..RESAMPLES).map(|_| resample()).collect() };
        medians.sort_unstable_by(f64::total_cmp);
        let at =
            |share: f64| medians.get((share * (RESAMPLES - 1) as f64).round() as usize).copied().unwrap_or(f64::NAN);
        Self { value, low: at(0.025), high: at(0.975), samples }
    }

    /// The mean, with the interval of Student's t.
    pub fn mean(samples: Vec<f64>) -> Self {
        let n = samples.len() as f64;
        let value = samples.iter().sum::<f64>() / n;
        let variance = samples.iter().map(|x| (x - value).powi(2)).sum::<f64>() / (n * (n - 1.0));
        // One sample says nothing of its own noise.
        let half = if samples.len() < 2 { f64::NAN } else { student(n - 1.0) * variance.sqrt() };
        Self { value, low: value - half, high: value + half, samples }
    }
}

/// The middle value; the mean of two. Not a number if there is none.
pub fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_is_that_of_the_t_test() {
        let q = Quantity::mean(vec![1.0, 2.0, 3.0, 4.0, 5.0]);
        // Standard error sqrt(2.5 / 5), quantile 2.776 for four degrees of freedom.
        assert!((q.high - 3.0 - 2.776_445 * 0.5f64.sqrt()).abs() < 1e-5 && (q.value - 3.0).abs() < 1e-12);
        let one = Quantity::mean(vec![2.0]);
        let text = serde_json::to_string(&one).expect("JSON");
        let again: Quantity = serde_json::from_str(&text).expect("its own JSON");
        assert!(again.value == 2.0 && again.high.is_nan(), "{text}");
    }

    #[test]
    fn the_bootstrap_holds_the_median_about_nineteen_times_in_twenty() {
        let mut rng = Pcg64Mcg::seed_from_u64(9);
        // Skewed, with the median 0.25.
        let mut draw = || (0..25).map(|_| ((rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64).powi(2)).collect();
        let inside = (0..300).map(|_| Quantity::median(draw())).filter(|q| (q.low..=q.high).contains(&0.25)).count();
        assert!((270..=297).contains(&inside), "{inside} of 300");
    }

    #[test]
    fn medians_of_none_one_and_two() {
        assert!(median(&[]).is_nan() && Quantity::median(vec![]).low.is_nan());
        assert_eq!((median(&[3.0]), median(&[3.0, 1.0]), median(&[9.0, 1.0, 2.0])), (3.0, 2.0, 2.0));
    }
}
