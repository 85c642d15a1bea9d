//! Rules by which work is left out that a scene or its settings have no use for.
//!
//! None of them changes a picture by a bit, but for one: without [`Rule::Updates`], reuse in time finds where a surface was
//! by way of the space of its instance, and rounds twice on the way, so that a neighbour can be another one. Each can be
//! switched off by `--set skip.NAME=off`; tests and `weir graph --costs` compare what comes out.

mod costs;

use weir_shader::wiring::Feature;

pub use costs::{Cost, costs};

/// All features of passes.
pub const FEATURES: [Feature; 4] = [Feature::TEXTURES, Feature::ENVIRONMENT, Feature::INSTANCES, Feature::SPECULAR];

/// A reason to leave work out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Passes for lights or emitters, where the scene has none.
    Absent,
    /// Passes whose results nothing reads, and the memory of these.
    Unread,
    /// Code that looks up images and alpha masks, where no material has any.
    Textures,
    /// Code for an environment, directional lights and shapes, where there are only emissive triangles.
    Environment,
    /// Code that takes rays into the space of instances, where there is one, in place.
    Instances,
    /// Code for specular lobes, where every material is Lambert's.
    Specular,
    /// Light tables, trees, top level and their upload for a frame that shows the same moment as the last.
    Updates,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Absent, Self::Unread, Self::Textures, Self::Environment, Self::Instances, Self::Specular, Self::Updates];

    /// What stands behind `skip.` in its knob.
    pub fn name(self) -> &'static str {
        match self {
            Self::Absent => "absent",
            Self::Unread => "unread",
            Self::Textures => "textures",
            Self::Environment => "environment",
            Self::Instances => "instances",
            Self::Specular => "specular",
            Self::Updates => "updates",
        }
    }

    /// The rule that leaves a feature out of the code of passes.
    pub fn of(feature: Feature) -> Self {
        match feature {
            Feature::TEXTURES => Self::Textures,
            Feature::ENVIRONMENT => Self::Environment,
            Feature::INSTANCES => Self::Instances,
            Feature::SPECULAR => Self::Specular,
        }
    }
}

/// Which rules are on: all by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skips {
    /// Bit i: rule i of [`Rule::ALL`] is off.
    off: u32,
}

impl Skips {
    /// No rule is on.
    pub fn none() -> Self {
        Rule::ALL.into_iter().fold(Self::default(), |skips, rule| skips.with(rule, false))
    }

    /// Whether a rule is on.
    pub fn is_on(self, rule: Rule) -> bool {
        self.off & (1 << rule as u32) == 0
    }

    /// The same with a rule on or off.
    pub fn with(self, rule: Rule, on: bool) -> Self {
        let bit = 1 << rule as u32;
        Self { off: if on { self.off & !bit } else { self.off | bit } }
    }

    /// Features that passes are compiled with, of a scene that has `present`.
    pub fn features(self, present: &[Feature]) -> Vec<Feature> {
        let is_in = |feature: &Feature| present.contains(feature) || !self.is_on(Rule::of(*feature));
        FEATURES.into_iter().filter(is_in).collect()
    }
}

#[cfg(test)]
mod tests;
