//! How the error of a mean of stills falls with their number.

use rayon::prelude::*;
use weir::reference::Estimate;

use crate::chains::Clip;

/// Mean squared error of the mean of N stills, for N = 1, 4, 16, ... `most`: over pixels, channels, seeds, and all the
/// disjoint runs of N stills of each seed. The noise of the reference is taken off.
pub fn squared_errors(clip: &Clip, reference: &[Estimate], seeds: u32, most: u32) -> Vec<(f64, f64)> {
    let sizes: Vec<u32> = (0..).map(|i| 4u32.pow(i)).take_while(|&n| n <= most).collect();
    let truth: Vec<[f64; 3]> = reference.iter().map(|e| e.mean.to_array()).collect();
    let of_seed = |seed: u32| {
        let mut sums = vec![vec![[0.0f64; 3]; truth.len()]; sizes.len()];
        let mut errors = vec![0.0; sizes.len()];
        let mut count = 0;
        clip.stills(seed, most, |color| {
            count += 1;
            for ((&n, sum), error) in sizes.iter().zip(&mut sums).zip(&mut errors) {
                for (sum, color) in sum.iter_mut().zip(color) {
                    (0..3).for_each(|c| sum[c] += f64::from(color[c]));
                }
                if count % n == 0 {
                    let pairs = sum.iter().zip(&truth);
                    let squares = pairs.map(|(s, t)| (0..3).map(|c| (s[c] / f64::from(n) - t[c]).powi(2)).sum::<f64>());
                    *error += squares.sum::<f64>() * f64::from(n) / f64::from(most);
                    sum.fill([0.0; 3]);
                }
            }
        });
        errors
    };
    let errors: Vec<Vec<f64>> = (0..seeds).into_par_iter().map(of_seed).collect();
    let values = 3.0 * truth.len() as f64;
    let noise = reference.iter().map(|e| e.variance_of_mean().element_sum()).sum::<f64>() / values;
    let mean = |i: usize| errors.iter().map(|e| e[i]).sum::<f64>() / f64::from(seeds) / values - noise;
    sizes.iter().enumerate().map(|(i, &n)| (f64::from(n), mean(i))).collect()
}

/// Slope of the least-squares line through the logarithms.
pub fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(n, error)| (n.ln(), error.ln())).collect();
    let n = logs.len() as f64;
    let (x, y) = (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let covariance: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    covariance / logs.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}
