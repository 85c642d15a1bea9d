//! Every outcome of an experiment, each with its exact probability.

use std::cell::{Cell, RefCell};

use weir_shared::resample::Choose;

use super::world::Float;

/// The decisions of one outcome, and where on the way through them an experiment is.
pub struct Walk {
    /// Options taken, and how many options there were.
    path: RefCell<Vec<(usize, usize)>>,
    at: Cell<usize>,
    chance: Cell<f64>,
}

impl Walk {
    /// Probability of the decisions so far.
    pub fn chance(&self) -> f64 {
        self.chance.get()
    }

    /// An option, with probability `chances[option]`. Those without any are passed over.
    pub fn pick(&self, chances: &[f64]) -> usize {
        self.decide(chances.len(), |option| chances[option])
    }

    /// The same, with the chances as a function.
    pub fn decide(&self, options: usize, chance: impl Fn(usize) -> f64) -> usize {
        let mut path = self.path.borrow_mut();
        let at = self.at.get();
        if at == path.len() {
            let last = (0..options).rev().find(|&option| chance(option) > 0.0).expect("an option with a chance");
            path.push((0, last + 1));
        }
        let (mut option, _) = path[at];
        while chance(option) == 0.0 {
            option += 1;
        }
        path[at].0 = option;
        self.at.set(at + 1);
        self.chance.set(self.chance.get() * chance(option));
        option
    }

    /// Starts over, with the next outcome; false if that was the last.
    fn advance(&self) -> bool {
        let mut path = self.path.borrow_mut();
        assert_eq!(self.at.get(), path.len(), "an experiment decides alike after like decisions");
        self.at.set(0);
        self.chance.set(1.0);
        while let Some((option, options)) = path.pop() {
            if option + 1 < options {
                path.push((option + 1, options));
                return true;
            }
        }
        false
    }
}

/// Runs an experiment once for each outcome of what it asks the walk.
pub fn enumerate(mut experiment: impl FnMut(&Walk)) {
    let walk = Walk { path: RefCell::default(), at: Cell::new(0), chance: Cell::new(1.0) };
    loop {
        experiment(&walk);
        if !walk.advance() {
            return;
        }
    }
}

/// Takes the place of random numbers in a stream: both outcomes of every choice.
pub struct Enumerating<'a> {
    walk: &'a Walk,
    sum_before: f64,
}

impl<'a> Enumerating<'a> {
    /// For one stream.
    pub fn new(walk: &'a Walk) -> Self {
        Self { walk, sum_before: 0.0 }
    }
}

impl<R: Float> Choose<R> for Enumerating<'_> {
    fn accept(&mut self, weight: R, weight_sum: R) -> bool {
        let (weight, sum, before) = (weight.to_f64(), weight_sum.to_f64(), self.sum_before);
        self.sum_before = sum;
        // 1 - weight / sum would lose all digits where the weight is most of the sum. The first item leaves no choice.
        before == 0.0 || self.walk.decide(2, |option| [weight / sum, before / sum][option]) == 0
    }
}

#[test]
fn a_walk_visits_every_outcome_once_and_their_chances_sum_to_one() {
    let (mut outcomes, mut chance) = (Vec::new(), 0.0);
    enumerate(|walk| {
        let first = walk.pick(&[0.25, 0.0, 0.75, 0.0]);
        let second = if first == 2 { walk.pick(&[0.5, 0.5]) } else { 7 };
        outcomes.push((first, second));
        chance += walk.chance();
    });
    assert_eq!(outcomes, [(0, 7), (2, 0), (2, 1)]);
    assert_eq!(chance, 1.0);
}
