//! A floor under lamps, and the light that it reflects by Lambert's formula, in `f64`.

use glam::{DVec3, Mat4, Vec3};
use weir_shared::surface::Surface;

use super::{
    clip::{Clip, Take, Total},
    scenes::quad,
};
use crate::{
    render::{Backend, RenderError},
    scene::{Camera, Environment, Instance, Material, Motion, Scene},
    technique::Technique,
};

/// Albedo of the floor.
pub const ALBEDO: f32 = 0.5;

/// A scene that grows.
pub struct Stage {
    /// What there is so far.
    pub scene: Scene,
    /// Lamps as the formula sees them: corners, and radiance summed over the channels.
    lamps: Vec<([DVec3; 4], f64)>,
}

/// Radiance of a lamp that has no colour of its own.
pub fn shining(radiance: f32) -> Material {
    Material { base_color: Vec3::ZERO, emission: Vec3::splat(radiance), ..Material::default() }
}

/// Radiance 1 from everywhere.
pub fn white_sky() -> Environment {
    let (width, height) = (16, 8);
    let texels = vec![[1.0; 3]; (width * height) as usize];
    Environment { name: "white".into(), width, height, texels, rotation_deg: 0.0, scale: 1.0 }
}

impl Stage {
    /// A floor of 4 by 4 that faces up at height 0, seen from 1 above its middle.
    pub fn floor() -> Self {
        let camera = Camera { origin: Vec3::Y, target: Vec3::ZERO, up: Vec3::NEG_Z, vfov_deg: 40.0 };
        let mut stage = Self::bare(camera);
        let gray = Material { base_color: Vec3::splat(ALBEDO), ..Material::default() };
        stage.panel(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, gray);
        stage
    }

    /// Nothing but a camera.
    pub fn bare(camera: Camera) -> Self {
        let scene = Scene { name: "stage".into(), camera: Some(camera), ..Scene::default() };
        Self { scene, lamps: Vec::new() }
    }

    /// A parallelogram that faces along `a x b`; the number of its instance.
    pub fn panel(&mut self, corner: Vec3, a: Vec3, b: Vec3, material: Material) -> u32 {
        let (mesh, number) = (self.scene.meshes.len() as u32, self.scene.materials.len() as u32);
        self.scene.materials.push(material);
        self.scene.meshes.push(quad("panel", corner, a, b, number));
        self.place(mesh, Mat4::IDENTITY)
    }

    /// One more instance of a mesh; its number.
    pub fn place(&mut self, mesh: u32, world_from_object: Mat4) -> u32 {
        self.scene.instances.push(Instance { mesh, world_from_object, motion: Motion::Still });
        self.scene.instances.len() as u32 - 1
    }

    /// A panel that emits along `a x b`, that the formula knows, all above the floor's horizon, and that nothing hides.
    pub fn lamp(&mut self, corner: Vec3, a: Vec3, b: Vec3, material: Material) -> u32 {
        let corners = [corner, corner + a, corner + a + b, corner + b].map(|p| p.as_dvec3());
        self.knows(corners, f64::from(material.emission.element_sum()));
        self.panel(corner, a, b, material)
    }

    /// Tells the formula of a lamp.
    pub fn knows(&mut self, corners: [DVec3; 4], radiance: f64) {
        self.lamps.push((corners, radiance));
    }

    /// Stills of the stage through the centers of pixels.
    pub fn take<'a>(&'a self, technique: Technique, knobs: &[&'a str]) -> Take<'a> {
        let knobs = [&["camera.jitter=off"], knobs].concat();
        Take { outputs: &["surfaces", "color", "moments"], ..Take::still(&self.scene, technique, &knobs) }
    }

    /// The mean of stills, and what the formula says of the surfaces that they see.
    ///
    /// # Errors
    /// If there is no picture.
    pub fn measured(
        &self,
        backend: &Backend<'_>,
        technique: Technique,
        knobs: &[&str],
        count: u32,
    ) -> Result<(super::clip::Still, Total), RenderError> {
        let mut clip = Clip::new(backend, &self.take(technique, knobs))?;
        let still = clip.stills(count)?;
        let surfaces: Vec<Surface> = clip.output("surfaces")?;
        Ok((still, self.formula(&surfaces)))
    }

    /// Light that those of the surfaces reflect that are the floor's.
    pub fn formula(&self, surfaces: &[Surface]) -> Total {
        let seen = surfaces.iter().filter(|s| !s.is_sky() && s.instance() == 0);
        let of = |s: &Surface| self.lamps.iter().map(|(c, l)| l * form_factor(s.position().as_dvec3(), c)).sum::<f64>();
        Total::exact(seen.map(of).sum::<f64>() * f64::from(ALBEDO))
    }
}

/// Share of its hemisphere, weighted by the cosine, that a point with a normal along +y sees filled by a polygon above its
/// horizon. Source: Lambert 1760.
pub fn form_factor(point: DVec3, corners: &[DVec3]) -> f64 {
    let direction = |i: usize| (corners[i % corners.len()] - point).normalize();
    let of_edge = |i: usize| {
        let (from, to) = (direction(i), direction(i + 1));
        let normal = from.cross(to);
        let sine = normal.length();
        // By the arc tangent: the arc cosine of nearly 1 has few digits.
        if sine > 0.0 { sine.atan2(from.dot(to)) * normal.y / sine } else { 0.0 }
    };
    (0..corners.len()).map(of_edge).sum::<f64>().abs() / core::f64::consts::TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the textbook's formula for a rectangle that is parallel to the floor, with a corner above the point.
    #[test]
    fn the_form_factor_of_a_rectangle_overhead_is_that_of_the_textbook() {
        for (a, b, c) in [(1.0f64, 2.0, 1.0), (0.1, 0.1, 3.0), (100.0, 100.0, 0.1)] {
            let (x, y) = (a / c, b / c);
            let part = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
            let expected = (part(x, y) + part(y, x)) / core::f64::consts::TAU;
            let corners = [(0.0, 0.0), (a, 0.0), (a, b), (0.0, b)].map(|(x, z)| DVec3::new(x, c, z));
            assert!((form_factor(DVec3::ZERO, &corners) / expected - 1.0).abs() < 1e-12, "{a} {b} {c}");
        }
    }
}
