//! What a scene has, and what it lacks: everything that chooses passes, their code and their memory, derived in one place.

use glam::Vec3;
use weir_shader::wiring::Feature;

use crate::{
    graph::Need,
    scene::{Material, Scene},
};

/// What a scene has, as it is packed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Content {
    /// Triangles or shapes that emit.
    pub emitters: bool,
    /// An environment that shines, or directional lights.
    pub distant: bool,
    /// Lights that no ray finds: spheres, rectangles, points, spots, and triangles that are unseen.
    pub shapes: bool,
    /// Images of any kind.
    pub images: bool,
    /// Alpha masks.
    pub masks: bool,
    /// Images or alpha masks on what emits.
    pub emission_images: bool,
    /// Specular lobes.
    pub gloss: bool,
    /// More than one material.
    pub materials: bool,
    /// Lights that shine to both sides.
    pub two_sided: bool,
    /// Lights of different power.
    pub powers: bool,
    /// More than one instance, or one that is not in place.
    pub instances: bool,
    /// Anything that moves, or may.
    pub motion: bool,
    /// A light tree.
    pub light_tree: bool,
    /// Trees for cuts.
    pub light_cuts: bool,
    /// Surfaces whose light has a closed form, as far as was looked for any.
    pub closed_form: bool,
    /// Triangles and shapes that emit, over all instances there may be.
    pub lights: u64,
}

impl Content {
    /// With what the materials of a scene say; the rest is as in `self`.
    pub(super) fn with_materials(self, scene: &Scene) -> Self {
        let materials = &scene.materials;
        let has = |test: fn(&Material) -> bool| materials.iter().any(test);
        Self {
            images: has(|m| {
                m.base_color_texture.is_some() || m.emission_texture.is_some() || m.alpha_texture.is_some()
            }),
            masks: has(|m| m.alpha_texture.is_some()),
            emission_images: has(|m| {
                m.emission != Vec3::ZERO && (m.emission_texture.is_some() || m.alpha_texture.is_some())
            }),
            gloss: has(|m| m.metallic > 0.0 || m.specular != Vec3::ZERO),
            materials: materials.len() > 1,
            two_sided: has(|m| m.emission != Vec3::ZERO && m.two_sided_emission),
            ..self
        }
    }

    /// Features that choose among the variants of passes.
    pub fn features(&self) -> Vec<Feature> {
        let all = [
            (Feature::TEXTURES, self.images),
            (Feature::MASKS, self.masks),
            (Feature::EMISSION_IMAGES, self.emission_images),
            (Feature::ENVIRONMENT, self.distant || self.shapes),
            (Feature::INSTANCES, self.instances),
            (Feature::SPECULAR, self.gloss),
            (Feature::CLOSED_FORM, self.closed_form),
        ];
        all.into_iter().filter(|(_, has)| *has).map(|(feature, _)| feature).collect()
    }

    /// What steps may need.
    pub fn has(&self) -> Vec<Need> {
        let all = [
            (Need::Lights, self.emitters || self.distant),
            (Need::EmissiveTriangles, self.emitters),
            (Need::LightCuts, self.light_cuts),
        ];
        all.into_iter().filter(|(_, has)| *has).map(|(need, _)| need).collect()
    }

    /// Whether light may have a closed form: of emissive triangles without images, where nothing moves.
    pub(super) fn may_have_closed_form(&self) -> bool {
        self.emitters && !self.distant && !self.shapes && !self.emission_images && !self.motion
    }

    /// Whether there is light of any kind.
    pub fn shines(&self) -> bool {
        self.emitters || self.distant
    }

    /// What the scene lacks, in words.
    pub fn lacks(&self) -> Vec<&'static str> {
        let all = [
            ("triangles or shapes that emit", self.emitters),
            ("an environment or directional lights", self.distant),
            ("other shapes that emit", self.shapes),
            ("images", self.images),
            ("alpha masks", self.masks),
            ("images on what emits", self.emission_images),
            ("specular lobes", self.gloss),
            ("a second material", self.materials),
            ("lights that shine to both sides", self.two_sided),
            ("lights of different power", self.powers),
            ("instances", self.instances),
            ("motion", self.motion),
        ];
        all.into_iter().filter(|(_, has)| !has).map(|(what, _)| what).collect()
    }
}
