//! Rules by which work is left out that a scene or its settings have no use for.
//!
//! [`Rule::Few`], [`Rule::Presampling`], [`Rule::Horizon`] and [`Rule::ClosedForm`] change which lights are drawn, but not
//! the mean of pictures. None of the others changes a picture by a bit, but for one: without [`Rule::Updates`], reuse in
//! time finds where a surface was by way of the space of its instance, and rounds twice on the way, so that a neighbour can
//! be another one. Each can be switched off by `--set skip.NAME=off`; tests and `weir graph --costs` compare what comes out.

mod costs;

use weir_shader::wiring::Feature;
use weir_shared::frame::skip;

pub use costs::{Cost, costs};

/// All features of passes.
pub const FEATURES: [Feature; 7] = [
    Feature::TEXTURES,
    Feature::MASKS,
    Feature::EMISSION_IMAGES,
    Feature::ENVIRONMENT,
    Feature::INSTANCES,
    Feature::SPECULAR,
    Feature::CLOSED_FORM,
];

/// A reason to leave work out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Passes for lights or emitters, where the scene has none.
    Absent,
    /// Passes whose results nothing reads, and the memory of these.
    Unread,
    /// Code that looks up images at what camera rays find, where no material has any.
    Textures,
    /// Code that lets rays through alpha masks, where no material has any.
    Masks,
    /// Code that looks up images and alpha masks of what emits, where nothing that emits has any.
    EmissionImages,
    /// Code for an environment, directional lights and shapes, where there are only emissive triangles that rays find.
    Environment,
    /// Code that takes rays into the space of instances, where there is one, in place.
    Instances,
    /// Code for specular lobes, where every material is Lambert's.
    Specular,
    /// Drawing lights, where each can be a candidate. Changes what is drawn, not its mean.
    Few,
    /// Drawing lights ahead in tiles, where there are no more lights than a tile has records. Changes what is drawn, not its
    /// mean.
    Presampling,
    /// Lights below the horizon of all surfaces in a block of pixels, in cuts. Changes what is drawn, not its mean.
    Horizon,
    /// Sampling, where light has a closed form. Changes what is drawn, not its mean.
    ClosedForm,
    /// Shadow rays to samples that are known to be visible.
    Known,
    /// Candidates and rays by the BSDF, where a surface reflects nothing.
    Black,
    /// Shadow rays of reuse from surfaces to lights that face away from them or that they face away from.
    Unlit,
    /// Light trees, where no candidate comes down one.
    Trees,
    /// Light tables, trees, top level and their upload for a frame that shows the same moment as the last.
    Updates,
    /// The same of all that stands still, in frames in which something else moves or emits otherwise.
    Still,
    /// Camera rays of a frame that sees what the last two have seen.
    Primary,
    /// Tiles in which no pixel has light to sample, in the passes that do so.
    Tiles,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 20] = [
        Self::Absent,
        Self::Unread,
        Self::Textures,
        Self::Masks,
        Self::EmissionImages,
        Self::Environment,
        Self::Instances,
        Self::Specular,
        Self::Few,
        Self::Presampling,
        Self::Horizon,
        Self::ClosedForm,
        Self::Known,
        Self::Black,
        Self::Unlit,
        Self::Trees,
        Self::Updates,
        Self::Still,
        Self::Primary,
        Self::Tiles,
    ];

    /// What stands behind `skip.` in its knob.
    pub fn name(self) -> &'static str {
        match self {
            Self::Absent => "absent",
            Self::Unread => "unread",
            Self::Textures => "textures",
            Self::Masks => "masks",
            Self::EmissionImages => "emission_images",
            Self::Environment => "environment",
            Self::Instances => "instances",
            Self::Specular => "specular",
            Self::Few => "few",
            Self::Presampling => "presampling",
            Self::Horizon => "horizon",
            Self::ClosedForm => "closed_form",
            Self::Known => "known",
            Self::Black => "black",
            Self::Unlit => "unlit",
            Self::Trees => "trees",
            Self::Updates => "updates",
            Self::Still => "still",
            Self::Primary => "primary",
            Self::Tiles => "tiles",
        }
    }

    /// Whether it changes what is drawn, and with it pictures but not their mean.
    pub fn changes_draws(self) -> bool {
        matches!(self, Self::Few | Self::Presampling | Self::Horizon | Self::ClosedForm)
    }

    /// The rule that leaves a feature out of the code of passes; for closed forms, which are code that spares work elsewhere,
    /// the rule that puts it in.
    pub fn of(feature: Feature) -> Self {
        match feature {
            Feature::TEXTURES => Self::Textures,
            Feature::MASKS => Self::Masks,
            Feature::EMISSION_IMAGES => Self::EmissionImages,
            Feature::ENVIRONMENT => Self::Environment,
            Feature::INSTANCES => Self::Instances,
            Feature::SPECULAR => Self::Specular,
            Feature::CLOSED_FORM => Self::ClosedForm,
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

    /// What passes are told of rules that are off: [`Frame::not_skipped`](weir_shared::frame::Frame::not_skipped).
    pub fn in_passes(self) -> u32 {
        let rules = [
            (Rule::Few, skip::FEW_LIGHTS),
            (Rule::Horizon, skip::HORIZON),
            (Rule::Known, skip::KNOWN_VISIBLE),
            (Rule::Black, skip::BLACK),
            (Rule::Unlit, skip::UNLIT),
        ];
        rules.into_iter().filter(|(rule, _)| !self.is_on(*rule)).fold(0, |bits, (_, bit)| bits | bit)
    }

    /// Features that passes are compiled with, of a scene that has `present`.
    pub fn features(self, present: &[Feature]) -> Vec<Feature> {
        let is_in = |feature: &Feature| match feature {
            Feature::CLOSED_FORM => present.contains(feature) && self.is_on(Rule::ClosedForm),
            _ => present.contains(feature) || !self.is_on(Rule::of(*feature)),
        };
        FEATURES.into_iter().filter(is_in).collect()
    }
}

#[cfg(test)]
mod tests;
