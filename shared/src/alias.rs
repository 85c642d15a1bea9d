//! Alias tables: one item of n in proportion to its weight, in constant time.
//!
//! Built on the host in integers, so that the probability that is reported is the one that is sampled.

use crate::numerics::{load, multiply_high};

/// Words of an entry in the `lights` buffer: threshold, alias, probability (as bits of a float), payload.
pub const ENTRY_WORDS: u32 = 4;

/// What a table was asked for.
#[derive(Clone, Copy)]
pub struct Pick {
    /// The item.
    pub index: u32,
    /// Its probability.
    pub pmf: f32,
}

/// Draws from the table of `count` entries that starts at word `at`, with two times 32 random bits.
#[inline(always)]
pub fn pick(lights: &[u32], at: u32, count: u32, first: u32, second: u32) -> Pick {
    let bin = multiply_high(first, count);
    let threshold = load(lights, at + bin * ENTRY_WORDS);
    let index = if second < threshold { bin } else { load(lights, at + bin * ENTRY_WORDS + 1) };
    Pick { index, pmf: pmf(lights, at, index) }
}

/// Probability of item `index`.
#[inline(always)]
pub fn pmf(lights: &[u32], at: u32, index: u32) -> f32 {
    f32::from_bits(load(lights, at + index * ENTRY_WORDS + 2))
}

/// Builds a table over `weights` (not negative, finite), as words of the `lights` buffer.
///
/// Weights are rounded to whole units, n * 2^32 in all, every positive one to at least one unit; then Vose's method
/// runs in integers, so that no leftovers arise and an item of weight zero is never drawn. All weights zero: uniform
/// probability zero, `None`.
///
/// Source: Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given Distribution".
#[cfg(not(target_arch = "spirv"))]
pub fn build(weights: &[f64]) -> Option<std::vec::Vec<u32>> {
    let units = whole_units(weights)?;
    let n = weights.len();
    let full = 1u64 << 32;
    let total = n as f64 * full as f64;
    let mut rest = units.clone();
    let (mut small, mut large): (std::vec::Vec<u32>, std::vec::Vec<u32>) =
        (0..n as u32).partition(|&i| rest[i as usize] < full);
    let mut words = std::vec![0u32; n * ENTRY_WORDS as usize];
    let mut set = |bin: u32, threshold: u64, alias: u32| {
        let entry = &mut words[(bin * ENTRY_WORDS) as usize..][..ENTRY_WORDS as usize];
        entry[0] = u32::try_from(threshold).unwrap_or(u32::MAX);
        entry[1] = alias;
        entry[2] = ((units[bin as usize] as f64 / total) as f32).to_bits();
    };
    while let Some(bin) = small.pop() {
        let Some(&donor) = large.last() else { break };
        set(bin, rest[bin as usize], donor);
        rest[donor as usize] -= full - rest[bin as usize];
        if rest[donor as usize] < full {
            large.pop();
            small.push(donor);
        }
    }
    // A full bin is its own alias: the threshold no longer matters.
    for bin in large {
        set(bin, full, bin);
    }
    Some(words)
}

/// Weights as integers that sum to n * 2^32.
#[cfg(not(target_arch = "spirv"))]
fn whole_units(weights: &[f64]) -> Option<std::vec::Vec<u64>> {
    let sum: f64 = weights.iter().sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return None;
    }
    let total = (weights.len() as u64) << 32;
    let mut units: std::vec::Vec<u64> =
        weights.iter().map(|&w| if w > 0.0 { ((w / sum * total as f64) as u64).max(1) } else { 0 }).collect();
    // What rounding left over goes to the heaviest item, where it is the smallest share.
    let heaviest = (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b]))?;
    let others: u64 = units.iter().enumerate().filter(|&(i, _)| i != heaviest).map(|(_, &u)| u).sum();
    units[heaviest] = total.checked_sub(others)?;
    Some(units)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exact probability of every item, in units of 2^-32 / n, by summing the bins.
    fn exact_units(words: &[u32]) -> Vec<u64> {
        let n = words.len() / 4;
        let mut units = vec![0u64; n];
        for bin in 0..n {
            let (threshold, alias) = (words[bin * 4], words[bin * 4 + 1] as usize);
            if alias == bin {
                units[bin] += 1 << 32;
            } else {
                units[bin] += u64::from(threshold);
                units[alias] += (1 << 32) - u64::from(threshold);
            }
        }
        units
    }

    #[test]
    fn the_table_samples_exactly_what_it_reports() {
        let cases: [&[f64]; 6] =
            [&[1.0], &[1.0, 2.0, 3.0], &[0.0, 5.0, 0.0], &[1e-20, 1.0, 1e20], &[0.5; 7], &[1e-300, 0.0, 1e-300]];
        for weights in cases {
            let words = build(weights).expect("a table");
            let n = weights.len();
            let sum: f64 = weights.iter().sum();
            let units = exact_units(&words);
            assert_eq!(units.iter().sum::<u64>(), (n as u64) << 32);
            for (i, &w) in weights.iter().enumerate() {
                let p = units[i] as f64 / ((n as u64) << 32) as f64;
                assert_eq!(f32::from_bits(words[i * 4 + 2]), p as f32);
                assert!((p - w / sum).abs() <= 2.0 * n as f64 / 4e9, "{weights:?} item {i}: {p}");
                assert_eq!(w > 0.0, units[i] > 0, "{weights:?} item {i}");
            }
        }
    }

    #[test]
    fn weights_without_a_positive_finite_sum_give_no_table() {
        assert!(build(&[]).is_none());
        assert!(build(&[0.0, 0.0]).is_none());
        assert!(build(&[f64::INFINITY]).is_none());
    }

    #[test]
    fn picks_follow_the_weights() {
        let weights = [4.0, 0.0, 1.0, 3.0];
        let words = build(&weights).expect("a table");
        let mut counts = [0.0; 4];
        for i in 0..80_000 {
            let [a, b, ..] = crate::rng::pcg4d(i, 0, 0, 0);
            let picked = pick(&words, 0, 4, a, b);
            assert_eq!(f64::from(picked.pmf), weights[picked.index as usize] / 8.0);
            counts[picked.index as usize] += 1.0;
        }
        assert_eq!(counts[1], 0.0);
        let statistic: f64 =
            [0, 2, 3].iter().map(|&i| (counts[i] - weights[i] * 1e4).powi(2) / (weights[i] * 1e4)).sum();
        assert!(statistic < 27.0, "chi-square with 2 degrees of freedom: {statistic}");
    }
}
