//! The one core of reuse: merges reservoirs of several domains (pixels, frames) into one of the first of them.
//!
//! Input 0 is the canonical one: the pixel's own. Each input brings a sample with a contribution weight and a
//! confidence; each has a target, and the MIS weights compare the targets. A sample is a point of the lights, the same
//! in all domains, so shifting it has Jacobian 1.
//!
//! Sources: Lin et al. 2022, "Generalized Resampled Importance Sampling"; Bitterli et al. 2020 for the older forms.

use crate::resample::Real;

/// Weights of merging. Those without a remark are unbiased.
pub mod form {
    /// Each input against the canonical one alone, with a share of the canonical one that nothing can take away.
    /// Source: Lin et al. 2022, equation 38, with confidences.
    pub const PAIRWISE_DEFENSIVE: u32 = 0;
    /// The same without that share.
    pub const PAIRWISE: u32 = 1;
    /// All against all: the least variance, and a number of targets quadratic in the number of inputs.
    pub const BALANCE: u32 = 2;
    /// After the choice: the target of the chosen sample in its own domain against that in all others. Source:
    /// Bitterli et al. 2020, equation 22.
    pub const CONTRIBUTION: u32 = 3;
    /// After the choice: one over the confidence of all inputs that could have had the chosen sample. Source: Bitterli
    /// et al. 2020, algorithm 6.
    pub const ONE_OVER_Z: u32 = 4;
    /// One over the confidence of all inputs. Biased: too dark where some input could not have had the sample.
    pub const ONE_OVER_M: u32 = 5;
}

/// The inputs of a merge.
pub trait Inputs<R: Real> {
    /// A sample that can be evaluated in every domain.
    type Sample: Copy;
    /// What the target of an input depends on.
    type Domain;
    /// What the canonical domain makes of a sample beside its target: its light.
    type Light: Copy + Default;

    /// Number of inputs, the canonical one included.
    fn count(&self) -> u32;
    /// Confidence of an input, whether or not it has a sample.
    fn confidence(&self, input: u32) -> R;
    /// Domain of an input.
    fn domain(&self, input: u32) -> Self::Domain;
    /// The sample of an input with its contribution weight W, which is 0 if there is none, or if it does not exist for
    /// the canonical input; the sample is not looked at then.
    fn sample(&self, input: u32) -> (R, Self::Sample);
    /// Target p̂ of a sample in the canonical domain, without visibility, and its light there.
    fn target_here(&self, here: &Self::Domain, sample: &Self::Sample) -> (R, Self::Light);
    /// Target p̂ of a sample in another domain, without visibility.
    fn target(&self, there: &Self::Domain, sample: &Self::Sample) -> R;
    /// Whether the sample of `input` is known to be hidden from the canonical domain.
    fn is_hidden_here(&self, input: u32) -> bool;
    /// Whether the canonical sample is known to be hidden from the domain of `input`.
    fn is_hidden_there(&self, input: u32) -> bool;
    /// The input that stands for all in the canonical sample's MIS weight, drawn in proportion to confidence; 0: each
    /// stands for itself. Only pairwise forms ask.
    fn partner(&self) -> u32;
}

/// What takes the samples of a merge: a reservoir, and whoever wants to see them all.
pub trait Sink<R, S, L> {
    /// A sample, its light and target in the canonical domain, and m W; the resampling weight is the product of the
    /// last two. True if it is the sample kept now.
    fn offer(&mut self, sample: &S, light: L, target: R, scaled_ucw: R) -> bool;
}

/// How a merge ended.
#[derive(Clone, Copy)]
pub struct Merged<R> {
    /// Sum of the confidences.
    pub confidence: R,
    /// Multiplies the contribution weight of the sample kept: 1 unless the form weighs after the choice.
    pub factor: R,
    /// Input whose sample was kept last; meaningless if none was.
    pub kept: u32,
}

/// a / (a + b), and 0 where both are 0.
#[inline(always)]
fn share<R: Real>(a: R, b: R) -> R {
    let sum = a + b;
    if sum > R::ZERO { a / sum } else { R::ZERO }
}

/// Merges by pairwise MIS, `defensive` or not: two targets for each input beside the canonical one.
///
/// With C the sum of confidences, D that without the canonical one's c, and p̂ the targets (the canonical without
/// index): input i has m_i = c_i/C · D p̂_i / (D p̂_i + c p̂), and the canonical one
/// c/C + sum of c_i/C · c p̂ / (D p̂_i + c p̂). Not defensive: D in place of C, and no first term. The canonical input
/// must have a confidence above zero, as every fresh reservoir has: it alone is compared with all others.
#[inline(always)]
pub fn pairwise<R: Real, I: Inputs<R>, K: Sink<R, I::Sample, I::Light>>(
    inputs: &I,
    defensive: bool,
    sink: &mut K,
) -> Merged<R> {
    let count = inputs.count();
    let own_confidence = inputs.confidence(0);
    let mut others = R::ZERO;
    let mut i = 1;
    while i < count {
        others = others + inputs.confidence(i);
        i += 1;
    }
    let total = own_confidence + others;
    let mut merged = Merged { confidence: total, factor: R::ONE, kept: 0 };
    if !(total > R::ZERO) {
        return merged;
    }
    let alone = !(others > R::ZERO);
    let divisor = if defensive || alone { total } else { others };
    let partner = inputs.partner();
    let here = inputs.domain(0);
    let (own_ucw, own) = inputs.sample(0);
    let has_own = own_ucw > R::ZERO;
    let mut own_light = I::Light::default();
    let mut own_target = R::ZERO;
    let mut own_weight = if defensive || alone { own_confidence / total } else { R::ZERO };
    // Once more than there are inputs: the canonical sample is offered last, when its weight is known. One loop body,
    // because on a GPU everything is inlined.
    let mut i = 0;
    while i <= count {
        let (mut ucw, mut sample) = (own_ucw, own);
        if i > 0 && i < count {
            (ucw, sample) = inputs.sample(i);
        }
        let is_own = i == 0 || i == count;
        let confidence = if is_own { own_confidence } else { inputs.confidence(i) };
        let usable = confidence > R::ZERO && ucw > R::ZERO && (is_own || !inputs.is_hidden_here(i));
        let (mut target, mut light) = (own_target, own_light);
        if usable && i < count {
            let (evaluated, its_light) = inputs.target_here(&here, &sample);
            target = evaluated;
            light = its_light;
        }
        if i == 0 {
            own_target = target;
            own_light = light;
        }
        let mut weight = own_weight;
        if !is_own && confidence > R::ZERO {
            let there = inputs.domain(i);
            if has_own && (partner == 0 || partner == i) {
                let target = if inputs.is_hidden_there(i) { R::ZERO } else { inputs.target(&there, &own) };
                // The partner is drawn with probability c_i / D, so its term stands for D / c_i such terms.
                let stands_for = if partner == 0 { confidence } else { others };
                own_weight = own_weight + stands_for / divisor * share(own_confidence * own_target, others * target);
            }
            weight = R::ZERO;
            if usable && target > R::ZERO {
                let its_own = inputs.target(&there, &sample);
                weight = confidence / divisor * share(others * its_own, own_confidence * target);
            }
        }
        if usable && i > 0 && sink.offer(&sample, light, target, weight * ucw) {
            merged.kept = if is_own { 0 } else { i };
        }
        i += 1;
    }
    merged
}

/// Merges by any [`form`]; pairwise ones too.
#[inline(always)]
pub fn merge<R: Real, I: Inputs<R>, K: Sink<R, I::Sample, I::Light>>(inputs: &I, form: u32, sink: &mut K) -> Merged<R> {
    if form == form::PAIRWISE_DEFENSIVE || form == form::PAIRWISE {
        return pairwise(inputs, form == form::PAIRWISE_DEFENSIVE, sink);
    }
    let mut merged = Merged { confidence: R::ZERO, factor: R::ONE, kept: 0 };
    let mut i = 0;
    while i < inputs.count() {
        merged.confidence = merged.confidence + inputs.confidence(i);
        i += 1;
    }
    let here = inputs.domain(0);
    // Of the sample chosen last: confidence-weighted targets of all inputs, confidences where the target is not zero,
    // and the target in its own domain.
    let (mut chosen_sum, mut chosen_able, mut chosen_own) = (R::ZERO, R::ZERO, R::ZERO);
    let mut i = 0;
    while i < inputs.count() {
        let confidence = inputs.confidence(i);
        let (ucw, sample) = inputs.sample(i);
        if confidence > R::ZERO && ucw > R::ZERO {
            let (target, light) = inputs.target_here(&here, &sample);
            let (mut sum, mut able, mut own) = (R::ZERO, R::ZERO, R::ZERO);
            let mut j = 0;
            while j < inputs.count() {
                let mut there = target;
                if j > 0 {
                    there = inputs.target(&inputs.domain(j), &sample);
                }
                if there > R::ZERO {
                    sum = sum + inputs.confidence(j) * there;
                    able = able + inputs.confidence(j);
                }
                if j == i {
                    own = there;
                }
                j += 1;
            }
            let weight = if form != form::BALANCE {
                confidence
            } else if sum > R::ZERO {
                confidence * own / sum
            } else {
                R::ZERO
            };
            if sink.offer(&sample, light, target, weight * ucw) {
                merged.kept = i;
                (chosen_sum, chosen_able, chosen_own) = (sum, able, own);
            }
        }
        i += 1;
    }
    merged.factor = if form == form::CONTRIBUTION {
        if chosen_sum > R::ZERO { chosen_own / chosen_sum } else { R::ZERO }
    } else if form == form::ONE_OVER_Z {
        if chosen_able > R::ZERO { R::ONE / chosen_able } else { R::ZERO }
    } else if form == form::ONE_OVER_M && merged.confidence > R::ZERO {
        R::ONE / merged.confidence
    } else {
        R::ONE
    };
    merged
}
