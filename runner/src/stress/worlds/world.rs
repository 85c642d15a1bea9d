//! A world of a few lights in which the estimators are enumerated: domains with a target and a visibility for each
//! light, and the reservoirs that they hold.

use weir_shared::{
    merge::{Inputs, Merged, Sink, merge},
    resample::{Choose, Real, Stream, candidate_scale, survivor_scale},
};

use super::walk::{Enumerating, Walk, enumerate};

/// Lights of the world.
pub const LIGHTS: usize = 4;

/// Light over target: not the same for all, so that no light can stand for another.
const COLORS: [f64; LIGHTS] = [1.0, 0.25, 3.0, 0.5];

/// A float to run the core in, and the way from and to the numbers of the world.
pub trait Float: Real + Default {
    /// The nearest.
    fn from_f64(x: f64) -> Self;
    /// The same.
    fn to_f64(self) -> f64;
}

impl Float for f64 {
    fn from_f64(x: f64) -> Self {
        x
    }
    fn to_f64(self) -> f64 {
        self
    }
}

impl Float for f32 {
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

/// What a pixel makes of the lights.
#[derive(Clone, Copy, Debug)]
pub struct Domain {
    /// Target of each light, without visibility.
    pub target: [f64; LIGHTS],
    /// Whether a shadow ray to the light passes.
    pub visible: [bool; LIGHTS],
}

/// A reservoir; without a sample if `ucw` is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Which light.
    pub light: usize,
    /// Contribution weight W.
    pub ucw: f64,
    /// Confidence c.
    pub confidence: f64,
}

/// A reservoir before it is known what it holds: states with their probabilities.
pub type Law = Vec<(f64, Held)>;

/// What part shadow rays have, as [`weir_shared::reuse::probe`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Probe {
    /// None.
    None,
    /// A ray to the canonical sample, and one after the merge.
    One,
    /// Those to the samples of all inputs too.
    All,
}

/// How to merge.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// Of [`weir_shared::merge::form`].
    pub form: u32,
    /// Whether one input stands for all.
    pub partner: bool,
    /// Shadow rays.
    pub probe: Probe,
}

/// A sample of the world, and the input that it came from.
#[derive(Clone, Copy)]
pub struct Sample {
    /// Which light.
    pub light: usize,
    /// The input.
    pub owner: u32,
}

/// The inputs of a merge: `domains[i]` holds `held[i]`.
#[derive(Clone, Copy)]
pub struct Case<'a> {
    /// What each input makes of the lights.
    pub domains: &'a [Domain],
    /// What each input holds.
    pub held: &'a [Held],
    /// Shadow rays.
    pub probe: Probe,
    /// The input that stands for all; 0: none.
    pub partner: u32,
}

impl<R: Float> Inputs<R> for Case<'_> {
    type Sample = Sample;
    type Domain = usize;
    type Light = R;

    fn count(&self) -> u32 {
        self.held.len() as u32
    }

    fn confidence(&self, input: u32) -> R {
        R::from_f64(self.held[input as usize].confidence)
    }

    fn domain(&self, input: u32) -> usize {
        input as usize
    }

    fn sample(&self, input: u32) -> (R, Sample) {
        let held = self.held[input as usize];
        (R::from_f64(held.ucw), Sample { light: held.light, owner: input })
    }

    fn target_here(&self, here: &usize, sample: &Sample) -> (R, R) {
        assert_eq!(*here, 0, "the canonical domain is that of input 0");
        let target = self.domains[0].target[sample.light];
        (R::from_f64(target), R::from_f64(light_of(&self.domains[0], sample.light)))
    }

    fn target(&self, there: &usize, sample: &Sample) -> R {
        R::from_f64(self.domains[*there].target[sample.light])
    }

    fn is_hidden_here(&self, input: u32) -> bool {
        self.probe == Probe::All && !self.domains[0].visible[self.held[input as usize].light]
    }

    fn is_hidden_there(&self, input: u32) -> bool {
        assert!(self.partner == 0 || self.partner == input, "no ray was traced but from the partner");
        self.probe != Probe::None && !self.domains[input as usize].visible[self.held[0].light]
    }

    fn partner(&self) -> u32 {
        self.partner
    }
}

/// Light that a domain sees of a source if nothing is in between.
pub fn light_of(domain: &Domain, light: usize) -> f64 {
    domain.target[light] * COLORS[light]
}

/// Keeps one sample and adds up the light of all, source by source; and the MIS weights times W.
pub struct Keeper<R, C> {
    /// The one sample.
    pub stream: Stream<R, usize, C>,
    /// Light of each source.
    pub sums: [R; LIGHTS],
    /// Sum of m W.
    pub scaled_ucw: R,
}

impl<R: Float, C: Choose<R>> Keeper<R, C> {
    /// Nothing offered yet.
    pub fn new(choose: C) -> Self {
        Self { stream: Stream::new(LIGHTS, choose), sums: [R::ZERO; LIGHTS], scaled_ucw: R::ZERO }
    }

    /// The merged reservoir, without a ray to its sample.
    pub fn held(&self, merged: &Merged<R>) -> Held {
        let ucw = (self.stream.contribution_weight() * merged.factor).to_f64();
        Held { light: self.stream.kept().min(LIGHTS - 1), ucw, confidence: merged.confidence.to_f64() }
    }
}

impl<R: Float, C: Choose<R>> Sink<R, Sample, R> for Keeper<R, C> {
    fn offer(&mut self, sample: &Sample, light: R, target: R, scaled_ucw: R) -> bool {
        self.sums[sample.light] = self.sums[sample.light] + light * scaled_ucw;
        self.scaled_ucw = self.scaled_ucw + scaled_ucw;
        self.stream.offer(sample.light, target, target * scaled_ucw)
    }
}

/// A merged reservoir, and the light of each source summed over the inputs.
pub struct Outcome {
    /// The reservoir.
    pub held: Held,
    /// Light of each source.
    pub sums: [f64; LIGHTS],
}

/// Draws the input that stands for all, if the rule wants one.
pub fn draw_partner(walk: &Walk, held: &[Held], rule: &Rule) -> u32 {
    let others: f64 = held[1..].iter().map(|h| h.confidence).sum();
    if !rule.partner || others == 0.0 {
        return 0;
    }
    walk.decide(held.len() - 1, |i| held[i + 1].confidence / others) as u32 + 1
}

/// Merges any inputs; with rays, one goes to the sample that was kept.
pub fn run(
    walk: &Walk,
    inputs: &impl Inputs<f64, Sample = Sample, Light = f64>,
    here: &Domain,
    rule: &Rule,
) -> Outcome {
    let mut keeper = Keeper::new(Enumerating::new(walk));
    let merged = merge(inputs, rule.form, &mut keeper);
    let mut outcome = Outcome { held: keeper.held(&merged), sums: keeper.sums.map(|s| s * merged.factor) };
    if rule.probe == Probe::One {
        // Who shades with the sum has to ask for the visibility of all.
        outcome.sums = std::array::from_fn(|light| if here.visible[light] { outcome.sums[light] } else { 0.0 });
    }
    if rule.probe != Probe::None && !here.visible[outcome.held.light] {
        outcome.held.ucw = 0.0;
    }
    outcome
}

/// Merges what domains hold.
pub fn merge_held(walk: &Walk, domains: &[Domain], held: &[Held], rule: &Rule) -> Outcome {
    let partner = draw_partner(walk, held, rule);
    run(walk, &Case { domains, held, probe: rule.probe, partner }, &domains[0], rule)
}

/// One of the reservoirs that a law allows.
pub fn draw(walk: &Walk, law: &Law) -> Held {
    law[walk.decide(law.len(), |state| law[state].0)].1
}

/// The law of what an experiment ends with; equal states become one.
pub fn law_of(experiment: impl Fn(&Walk) -> Held) -> Law {
    let mut law = Law::new();
    enumerate(|walk| {
        let held = experiment(walk);
        match law.iter_mut().find(|(_, known)| *known == held) {
            Some((chance, _)) => *chance += walk.chance(),
            None => law.push((walk.chance(), held)),
        }
    });
    law
}

/// Candidates of one kind: how many, and the probability of each light.
#[derive(Clone, Copy)]
pub struct Technique {
    /// How many.
    pub count: u32,
    /// Of each light.
    pub pmf: [f64; LIGHTS],
}

/// The balance denominator of a light.
fn density_of(techniques: &[Technique], light: usize) -> f64 {
    techniques.iter().map(|t| f64::from(t.count) * t.pmf[light]).sum()
}

/// Initial candidates: streaming resampling, all techniques with one balance denominator.
pub fn initial(walk: &Walk, domain: &Domain, techniques: &[Technique], confidence: f64, probe: Probe) -> Held {
    let mut stream = Stream::new(0, Enumerating::new(walk));
    for technique in techniques {
        for _ in 0..technique.count {
            let light = walk.pick(&technique.pmf);
            let target = domain.target[light];
            stream.offer(light, target, target * candidate_scale(density_of(techniques, light)));
        }
    }
    ended(&stream, domain, confidence, probe)
}

/// The same in two stages: the candidates of the first technique compete in groups of the given sizes by a cheap
/// target, and only the survivors meet the target of the domain.
///
/// # Panics
/// If the sizes of the groups don't add up to the first technique's candidates.
pub fn initial_in_groups(
    walk: &Walk,
    domain: &Domain,
    cheap: &[f64; LIGHTS],
    techniques: &[Technique],
    groups: &[u32],
    probe: Probe,
) -> Held {
    assert_eq!(groups.iter().sum::<u32>(), techniques[0].count);
    let mut stream = Stream::new(0, Enumerating::new(walk));
    for &offered in groups {
        let mut group = Stream::new(0, Enumerating::new(walk));
        for _ in 0..offered {
            let light = walk.pick(&techniques[0].pmf);
            let density = techniques[0].pmf[light] * f64::from(offered);
            group.offer(light, cheap[light], cheap[light] * candidate_scale(density));
        }
        let (light, ucw) = (group.kept(), group.contribution_weight());
        if ucw > 0.0 {
            let density = density_of(techniques, light);
            let scale = survivor_scale(techniques[0].pmf[light], f64::from(offered), density, ucw);
            stream.offer(light, domain.target[light], domain.target[light] * scale);
        }
    }
    for technique in &techniques[1..] {
        for _ in 0..technique.count {
            let light = walk.pick(&technique.pmf);
            let target = domain.target[light];
            stream.offer(light, target, target * candidate_scale(density_of(techniques, light)));
        }
    }
    ended(&stream, domain, 1.0, probe)
}

/// The reservoir of a stream, empty if a ray shows that its sample is hidden.
fn ended(stream: &Stream<f64, usize, Enumerating<'_>>, domain: &Domain, confidence: f64, probe: Probe) -> Held {
    let light = stream.kept();
    let hidden = probe != Probe::None && !domain.visible[light];
    Held { light, ucw: if hidden { 0.0 } else { stream.contribution_weight() }, confidence }
}

/// Expectations over all outcomes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Means {
    /// Sum of the probabilities of all outcomes.
    pub chance: f64,
    /// Of W where the light is the one kept.
    pub ucw: [f64; LIGHTS],
    /// Of the light of each source summed over the inputs.
    pub sum: [f64; LIGHTS],
}

impl Means {
    /// Of an experiment.
    pub fn of(experiment: impl Fn(&Walk) -> Outcome) -> Self {
        let mut means = Self::default();
        enumerate(|walk| {
            let outcome = experiment(walk);
            means.chance += walk.chance();
            means.ucw[outcome.held.light] += walk.chance() * outcome.held.ucw;
            for (mean, sum) in means.sum.iter_mut().zip(outcome.sums) {
                *mean += walk.chance() * sum;
            }
        });
        means
    }

    /// Largest relative error: W should be 1 on average for each light of the canonical domain that is `found`, and
    /// the sum over the inputs the light itself; infinite where there should be nothing. The sum is left out where the
    /// weights are not known before the choice.
    ///
    /// # Panics
    /// If a mean is not finite.
    pub fn error(&self, here: &Domain, rule: &Rule, found: [bool; LIGHTS]) -> f64 {
        let mut worst = (self.chance - 1.0).abs();
        for (light, &is_found) in found.iter().enumerate() {
            let seen = rule.probe == Probe::None || here.visible[light];
            let mut compare = |mean: f64, expected: f64| {
                worst = worst.max(match expected {
                    0.0 if mean == 0.0 => 0.0,
                    0.0 => f64::INFINITY,
                    _ => (mean / expected - 1.0).abs(),
                });
                assert!(mean.is_finite(), "{self:?}");
            };
            let exists = seen && is_found && here.target[light] > 0.0;
            compare(self.ucw[light], f64::from(u8::from(exists)));
            if !is_weighed_after(rule.form) {
                compare(self.sum[light], if exists { light_of(here, light) } else { 0.0 });
            }
        }
        worst
    }
}

/// Whether a form weighs after the choice.
pub fn is_weighed_after(form: u32) -> bool {
    use weir_shared::merge::form::{CONTRIBUTION, ONE_OVER_Z};
    form == CONTRIBUTION || form == ONE_OVER_Z
}

/// Expectations of the merge of up to four independent reservoirs.
pub fn merged_means(domains: &[Domain], laws: &[Law], rule: &Rule) -> Means {
    Means::of(|walk| {
        let mut held = [Held { light: 0, ucw: 0.0, confidence: 0.0 }; 4];
        for (held, law) in held.iter_mut().zip(laws) {
            *held = draw(walk, law);
        }
        merge_held(walk, domains, &held[..laws.len()], rule)
    })
}
