//! Weighted reservoir sampling: one sample kept of a stream, in proportion to its weight; or several, without replacement.
//!
//! Generic over the float, so that what the passes run in `f32` can be proved by enumeration in `f64`; and over the
//! way of choosing, all with one law.

use bytemuck::{Pod, Zeroable};
use core::{
    mem::{offset_of, size_of},
    ops::{Add, Div, Mul, Sub},
};

use crate::{
    fault,
    numerics::{is_finite, log2, max, min},
    rng::Rng,
    words::Words,
};

/// The floats that resampling runs on.
pub trait Real:
    Copy + PartialOrd + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// Neither infinite nor not-a-number.
    fn is_finite(self) -> bool;
    /// One of [`crate::fault`], for a weight and the sum that it would have led to.
    fn fault(weight: Self, sum: Self) -> u32;
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    #[inline(always)]
    fn is_finite(self) -> bool {
        is_finite(self)
    }
    #[inline(always)]
    fn fault(weight: Self, sum: Self) -> u32 {
        fault::of_weight(weight, sum)
    }
}

#[cfg(not(target_arch = "spirv"))]
impl Real for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    fn is_finite(self) -> bool {
        Self::is_finite(self)
    }
    fn fault(weight: Self, sum: Self) -> u32 {
        fault::of_weight(weight as f32, sum as f32)
    }
}

/// Decides whether the item just added to a stream takes the place of the one kept.
pub trait Choose<R> {
    /// `weight` is positive and finite and already part of `weight_sum`. True with probability `weight / weight_sum`.
    fn accept(&mut self, weight: R, weight_sum: R) -> bool;
}

/// A candidate that stays in memory, with all others of its reservoir, until one of them is chosen.
///
/// Zeros stand for none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Candidate {
    /// Light id, see [`crate::light`].
    pub light: u32,
    /// Point on the light, two 16-bit coordinates.
    pub uv: u32,
    /// Target p̂.
    pub target: f32,
    /// Resampling weight: target over the sum of densities.
    pub weight: f32,
    /// The worst [`fault`] of drawing it.
    pub fault: u32,
}

const _: () = assert!(size_of::<Candidate>() == 20 && offset_of!(Candidate, weight) == 12);

impl Candidate {
    /// None.
    pub const NONE: Self = Self { light: 0, uv: 0, target: 0.0, weight: 0.0, fault: fault::NONE };
}

/// Ways of choosing. All keep item i with probability `w_i / sum w`.
pub mod choice {
    /// A random number for each place that is taken, about ln M + 0.6 of them for M items of equal weight: the sum of
    /// weights at which the next item is taken is known beforehand.
    pub const THRESHOLD: u32 = 0;
    /// A random number for each item. Source: Chao 1982, "A General Purpose Unequal Probability Sampling Plan".
    pub const PLAIN: u32 = 1;
    /// The smallest of the keys -log(random) / weight, one for each item; independent of the order of items. Source:
    /// Efraimidis and Spirakis 2006, "Weighted Random Sampling with a Reservoir", in logarithms, because u^(1/w)
    /// underflows.
    pub const KEYS: u32 = 2;
    /// All candidates stay in memory, and one random number chooses by inversion of their cumulative distribution.
    /// Merges, which have few inputs, choose as by `PLAIN`.
    pub const INVERSION: u32 = 3;
}

/// Chooses by random numbers, in one of the ways of [`choice`].
#[derive(Clone, Copy)]
pub struct Chooser {
    rng: Rng,
    way: u32,
    /// `THRESHOLD`: random number of the item kept. `KEYS`: its key.
    kept: f32,
    /// `THRESHOLD`: sum of weights when the item was kept; 0 before the first.
    kept_sum: f32,
}

impl Chooser {
    /// A way of [`choice`], with numbers of a stream of its own.
    #[inline(always)]
    pub fn new(rng: Rng, way: u32) -> Self {
        Self { rng, way, kept: 1.0, kept_sum: 0.0 }
    }
}

impl Choose<f32> for Chooser {
    #[inline(always)]
    fn accept(&mut self, weight: f32, weight_sum: f32) -> bool {
        if self.way == choice::THRESHOLD {
            // An item survives from sum s to sum S with probability s / S: it is replaced where S exceeds s / u.
            // Multiplied out, because s / u can overflow.
            if self.kept * weight_sum < self.kept_sum {
                return false;
            }
            self.kept = self.rng.next_positive_float();
            self.kept_sum = weight_sum;
            true
        } else if self.way == choice::PLAIN || self.way == choice::INVERSION {
            // Strict: a weight of zero is not kept even where the random number is zero.
            self.rng.next_float() * weight_sum < weight
        } else {
            let key = key_of(weight, self.rng.next_positive_float());
            let first = self.kept_sum == 0.0;
            self.kept_sum = 1.0;
            if !first && !(key < self.kept) {
                return false;
            }
            self.kept = key;
            true
        }
    }
}

/// A key that is exponentially distributed with rate `weight`, in units of ln 2, from a uniform random number above 0. The
/// item with the smallest key is item i with probability `w_i / sum w`, and so on among the others.
#[inline(always)]
fn key_of(weight: f32, random: f32) -> f32 {
    -log2(random) / weight
}

/// Most items that [`WithoutReplacement`] keeps.
pub const MAX_KEPT: u32 = 16;

/// The place of an item that is not kept.
pub const NOT_KEPT: u32 = 0xffff_ffff;

/// Several items of a stream: the first in proportion to its weight, the second in proportion to its weight among the
/// others, and so on. Those with the smallest keys; the caller holds the items, by their places.
///
/// Source: Efraimidis and Spirakis 2006, "Weighted Random Sampling with a Reservoir", algorithm A-Res, in logarithms,
/// because u^(1/w) underflows.
#[derive(Clone, Copy)]
pub struct WithoutReplacement {
    low: Words,
    high: Words,
    wanted: u32,
    count: u32,
    /// Place of the largest key.
    worst: u32,
    worst_key: f32,
}

impl WithoutReplacement {
    /// Nothing offered yet; at most `wanted` items will be kept, and at most [`MAX_KEPT`].
    #[inline(always)]
    pub fn new(wanted: u32) -> Self {
        let wanted = wanted.min(MAX_KEPT);
        Self { low: Words::ZERO, high: Words::ZERO, wanted, count: 0, worst: 0, worst_key: -1.0 }
    }

    /// Items kept.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Key of the item at a place; the order of keys is the order of drawing.
    #[inline(always)]
    pub fn key(&self, place: u32) -> f32 {
        f32::from_bits(if place < 8 { self.low.get(place) } else { self.high.get(place - 8) })
    }

    /// Offers an item with a random number in 0..=1; the place that it takes, if that is taken from the item there, or
    /// [`NOT_KEPT`]. Weights that are not positive and finite are never kept.
    #[inline(always)]
    pub fn offer(&mut self, weight: f32, random: f32) -> u32 {
        if !(weight > 0.0) || !is_finite(weight) {
            return NOT_KEPT;
        }
        // Half of the smallest random number stands for zero. Beyond 1e30, weights are too small to tell apart.
        let key = min(key_of(weight, max(random, 1.0 / 33_554_432.0)), 1e30);
        let is_room = self.count < self.wanted;
        if !is_room && !(key < self.worst_key) {
            return NOT_KEPT;
        }
        let place = if is_room { self.count } else { self.worst };
        if place < 8 {
            self.low.set(place, key.to_bits());
        } else {
            self.high.set(place - 8, key.to_bits());
        }
        if is_room {
            self.count += 1;
        }
        (self.worst, self.worst_key) = (0, -1.0);
        let mut i = 0;
        while i < self.count {
            let there = self.key(i);
            if there > self.worst_key {
                (self.worst, self.worst_key) = (i, there);
            }
            i += 1;
        }
        place
    }
}

/// A stream being resampled: what only streaming needs.
#[derive(Clone, Copy)]
pub struct Stream<R, S, C> {
    kept: S,
    target: R,
    weight_sum: R,
    fault: u32,
    choose: C,
}

impl<R: Real, S: Copy, C: Choose<R>> Stream<R, S, C> {
    /// Nothing offered yet; `nothing` is what [`Stream::kept`] returns until then.
    #[inline(always)]
    pub fn new(nothing: S, choose: C) -> Self {
        Self { kept: nothing, target: R::ZERO, weight_sum: R::ZERO, fault: fault::NONE, choose }
    }

    /// Offers a sample with target p̂ and resampling weight w = m p̂ W; true if it is the one kept now. Weights that
    /// are not positive and finite, or with which the sum would overflow, are dropped; all but zeros as a [`fault`].
    #[inline(always)]
    pub fn offer(&mut self, sample: S, target: R, weight: R) -> bool {
        let sum = self.weight_sum + weight;
        if !(weight > R::ZERO) || !sum.is_finite() {
            self.fault = self.fault.max(R::fault(weight, sum));
            return false;
        }
        self.weight_sum = sum;
        let taken = self.choose.accept(weight, sum);
        if taken {
            self.kept = sample;
            self.target = target;
        }
        taken
    }

    /// The sample kept.
    #[inline(always)]
    pub fn kept(&self) -> S {
        self.kept
    }

    /// Unbiased contribution weight W = (sum of weights) / p̂ of the sample kept; 0 without one, or if it overflows.
    #[inline(always)]
    pub fn contribution_weight(&self) -> R {
        if !(self.target > R::ZERO) {
            return R::ZERO;
        }
        let weight = self.weight_sum / self.target;
        if weight.is_finite() { weight } else { R::ZERO }
    }

    /// The worst [`fault`] of what was dropped, the contribution weight among it.
    #[inline(always)]
    pub fn fault(&self) -> u32 {
        if self.target > R::ZERO && !(self.weight_sum / self.target).is_finite() {
            self.fault.max(fault::OVERFLOW)
        } else {
            self.fault
        }
    }
}

/// Resampling weight over target of a candidate: one over the balance denominator, the sum of N_t p_t over the
/// techniques t that can draw it.
#[inline(always)]
pub fn candidate_scale<R: Real>(density: R) -> R {
    R::ONE / density
}

/// The same for the survivor of a group of `offered` candidates, each drawn with probability `pmf`, that has the
/// contribution weight `ucw` within its group: the balance weight of its technique is N pmf / `density`, and the group
/// stands for `offered` / N of that.
#[inline(always)]
pub fn survivor_scale<R: Real>(pmf: R, offered: R, density: R, ucw: R) -> R {
    pmf * offered / density * ucw
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(way: u32, weights: &[f32], n: u32) -> Vec<f64> {
        let mut counts = vec![0.0f64; weights.len()];
        for i in 0..n {
            let mut stream = Stream::new(usize::MAX, Chooser::new(Rng::from_words(i, 5, way, 0), way));
            for (j, &w) in weights.iter().enumerate() {
                stream.offer(j, 2.0, w);
            }
            if let Some(count) = counts.get_mut(stream.kept()) {
                *count += 1.0;
            }
            let sum: f32 = weights.iter().filter(|w| **w > 0.0 && w.is_finite()).sum();
            assert!((stream.contribution_weight() * 2.0 - sum).abs() <= 1e-5 * sum);
        }
        counts
    }

    /// Statistic of Pearson's test against the weights.
    fn statistic(counts: &[f64], weights: &[f32]) -> f64 {
        let usable = |w: f32| if w > 0.0 && w.is_finite() { f64::from(w) } else { 0.0 };
        let (n, sum): (f64, f64) = (counts.iter().sum(), weights.iter().map(|&w| usable(w)).sum());
        let expected = weights.iter().map(|&w| n * usable(w) / sum);
        counts.iter().zip(expected).map(|(c, e)| if e > 0.0 { (c - e).powi(2) / e } else { c * 1e9 }).sum()
    }

    #[test]
    fn every_way_of_choosing_keeps_samples_in_proportion_to_their_weights() {
        let weights = [1.0, 0.0, 3.0, f32::NAN, 4.0, f32::INFINITY, -1.0, 0.25];
        for way in [choice::THRESHOLD, choice::PLAIN, choice::KEYS] {
            let counts = counts(way, &weights, 160_000);
            let statistic = statistic(&counts, &weights);
            // Quantile 1 - 1e-6 of the distribution with 3 degrees of freedom.
            assert!(statistic < 30.7, "way {way}: chi-square {statistic}, {counts:?}");
        }
    }

    #[test]
    fn four_thousand_equal_weights_are_kept_alike() {
        let weights = vec![1.0; 4096];
        for way in [choice::THRESHOLD, choice::KEYS] {
            let statistic = statistic(&counts(way, &weights, 40_960), &weights);
            // 4095 degrees of freedom: mean 4095, standard deviation 90.5; five of them.
            assert!((statistic - 4095.0).abs() < 455.0, "way {way}: {statistic}");
        }
    }

    #[test]
    fn the_threshold_draws_about_the_logarithm_of_the_number_of_items() {
        struct Counting(Chooser, u32);
        impl Choose<f32> for Counting {
            fn accept(&mut self, weight: f32, sum: f32) -> bool {
                let taken = self.0.accept(weight, sum);
                self.1 += u32::from(taken);
                taken
            }
        }
        let mut draws = 0;
        for i in 0..4_000 {
            let chooser = Chooser::new(Rng::from_words(i, 1, 2, 0), choice::THRESHOLD);
            let mut stream = Stream::new(0, Counting(chooser, 0));
            (0..32).for_each(|j| {
                stream.offer(j, 1.0, 1.0);
            });
            draws += stream.choose.1;
        }
        // Harmonic number of 32, 4.06.
        assert!((f64::from(draws) / 4_000.0 - 4.06).abs() < 0.1, "{draws}");
    }

    #[test]
    fn weights_sixty_decades_apart_neither_overflow_nor_tie() {
        for way in [choice::THRESHOLD, choice::PLAIN, choice::KEYS] {
            for weights in [[1e-30, 1e30], [1e30, 1e-30]] {
                let counts = counts(way, &weights, 1_000);
                assert_eq!(counts[usize::from(weights[1] > 1.0)], 1_000.0, "way {way}, {weights:?}");
            }
        }
    }

    /// Items kept without replacement, in the order of their keys.
    fn without_replacement(weights: &[f32], wanted: u32, mut random: impl FnMut() -> f32) -> Vec<usize> {
        let mut keys = WithoutReplacement::new(wanted);
        let mut items = Vec::new();
        for (item, &weight) in weights.iter().enumerate() {
            match keys.offer(weight, random()) {
                NOT_KEPT => {}
                place if place as usize == items.len() => items.push(item),
                place => items[place as usize] = item,
            }
            assert_eq!(keys.count() as usize, items.len());
        }
        let mut places: Vec<u32> = (0..keys.count()).collect();
        places.sort_by(|&a, &b| keys.key(a).total_cmp(&keys.key(b)));
        places.into_iter().map(|place| items[place as usize]).collect()
    }

    fn drawn(weights: &[f32], wanted: u32, stream: u32) -> Vec<usize> {
        let mut rng = Rng::from_words(stream, 8, 1, wanted);
        without_replacement(weights, wanted, || rng.next_positive_float())
    }

    /// Every order in which `wanted` of some items can be drawn one after the other, with its probability.
    fn orders(weights: &[f32], wanted: usize, begun: &[usize], chance: f64) -> Vec<(Vec<usize>, f64)> {
        let left = |i: &usize| weights[*i] > 0.0 && !begun.contains(i);
        let sum: f64 = (0..weights.len()).filter(left).map(|i| f64::from(weights[i])).sum();
        if begun.len() == wanted || sum == 0.0 {
            return vec![(begun.to_vec(), chance)];
        }
        let with = |i: usize| [begun, &[i]].concat();
        let next = (0..weights.len()).filter(left);
        next.flat_map(|i| orders(weights, wanted, &with(i), chance * f64::from(weights[i]) / sum)).collect()
    }

    /// Pearson's statistic of the orders drawn, over the number of orders.
    fn statistic_of_orders(weights: &[f32], wanted: u32, expected: &[(Vec<usize>, f64)]) -> f64 {
        const DRAWS: u32 = 200_000;
        let mut counts = vec![0.0; expected.len()];
        for stream in 0..DRAWS {
            let order = drawn(weights, wanted, stream);
            let known = expected.iter().position(|(known, _)| *known == order);
            counts[known.unwrap_or_else(|| panic!("{order:?} of {weights:?} is impossible"))] += 1.0;
        }
        let expected = expected.iter().map(|(_, chance)| chance * f64::from(DRAWS));
        counts.iter().zip(expected).map(|(c, e): (&f64, f64)| (c - e).powi(2) / e).sum()
    }

    /// The order of keys is that of drawing one after the other; so the probability that an item is kept at all is right
    /// too, as that is a sum over orders.
    #[test]
    fn items_without_replacement_come_in_every_order_as_often_as_they_should() {
        // Bounds: quantiles 1 - 1e-6, for one order less.
        for (weights, wanted, bound) in [
            (&[1.0f32, 0.0, 3.0, 0.5, 2.0, 1.0] as &[f32], 3, 126.5),
            (&[1.0, 2.0, 4.0, 8.0], 1, 30.7),
            (&[1.0, 2.0, 4.0], 3, 35.9),
            (&[1.0, 0.0, f32::NAN, 3.0, -1.0, f32::INFINITY], 4, 23.9),
            (&[1e20, 3e20, 2e20], 2, 35.9),
            (&[1e-20, 3e-20, 2e-20], 2, 35.9),
        ] {
            let usable: Vec<f32> = weights.iter().map(|&w| if w > 0.0 && w.is_finite() { w } else { 0.0 }).collect();
            let expected = orders(&usable, wanted as usize, &[], 1.0);
            assert!((expected.iter().map(|(_, chance)| chance).sum::<f64>() - 1.0).abs() < 1e-12);
            let statistic = statistic_of_orders(weights, wanted, &expected);
            assert!(statistic < bound, "{weights:?}: {statistic} over {} orders", expected.len());
        }
    }

    /// The check above has teeth: the second draw does not go by the weights of all items, the first one's included.
    #[test]
    fn wrong_chances_of_orders_are_seen() {
        let weights = [1.0, 2.0, 4.0, 2.0];
        let mut expected = orders(&weights, 2, &[], 1.0);
        for (order, chance) in &mut expected {
            // Two draws with replacement, drawn again if they are the same.
            *chance = f64::from(weights[order[0]]) * f64::from(weights[order[1]]);
        }
        let sum: f64 = expected.iter().map(|(_, chance)| chance).sum();
        expected.iter_mut().for_each(|(_, chance)| *chance /= sum);
        // Quantile 1 - 1e-6 for 11 degrees of freedom: 50.
        assert!(statistic_of_orders(&weights, 2, &expected) > 500.0);
    }

    #[test]
    fn sampling_without_replacement_stands_extreme_weights_and_random_numbers() {
        // The heavy ones first, whatever the numbers are.
        let mixed = [1e-20, 1e20, 1e-20, 1e20, 1e-20];
        for stream in 0..1_000 {
            let mut heavy = drawn(&mixed, 3, stream)[..2].to_vec();
            heavy.sort_unstable();
            assert_eq!(heavy, [1, 3]);
        }
        for random in [0.0, 1.0, 1.0 - 1.0 / 16_777_216.0] {
            for weight in [1e-38, 1e-20, 1.0, 1e20, 3e38] {
                let kept = without_replacement(&[weight; 5], 3, || random);
                assert_eq!(kept.len(), 3, "{weight} {random}");
            }
        }
        // Zero counts as the smallest number there is.
        let mut numbers = [0.0, 1.0 / 16_777_216.0].into_iter().cycle();
        assert_eq!(without_replacement(&[1.0, 1.0], 1, || numbers.next().expect("endless")), [1]);
        assert_eq!(drawn(&[0.0, 1.0, 0.0], 3, 0), [1], "fewer than asked for");
        assert!(drawn(&[0.0, -1.0], 2, 0).is_empty() && drawn(&[1.0], 0, 0).is_empty() && drawn(&[], 2, 0).is_empty());
        assert_eq!(drawn(&[1.0; 40], 40, 0).len(), MAX_KEPT as usize);
    }

    #[test]
    fn an_overflowing_weight_is_dropped() {
        let mut stream = Stream::new(0, Chooser::new(Rng::from_words(0, 0, 0, 0), choice::PLAIN));
        stream.offer(1, 1e-38, 1e10);
        assert_eq!(stream.contribution_weight(), 0.0);
        let mut stream = Stream::new(0, Chooser::new(Rng::from_words(0, 0, 0, 0), choice::PLAIN));
        stream.offer(1, 1.0, 3e38);
        stream.offer(2, 1.0, 3e38);
        assert_eq!((stream.kept(), stream.contribution_weight()), (1, 3e38));
    }
}
