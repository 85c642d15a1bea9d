//! Lights of a shape in closed form, see [`crate::scene::Shape`]: what tables and trees need to know of them.

use glam::{DMat4, DVec3, Mat4, Vec3};
use weir_shared::{ray::position_error, scene::shape};

use super::light_tree::LightBounds;
use crate::scene::{Material, Mesh, Shape};

/// Smallest difference of the cosines of the two cones of a spot: below it, its edge would be finer than rounding.
///
/// Differs from the source (KHR_lights_punctual), which has 1e-3 and makes spots of less than three degrees dark.
const LEAST_EDGE: f64 = 1e-5;

/// A shape, and what it emits.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShapeLight {
    shape: Shape,
    /// Sum over the channels of its radiance or radiant intensity.
    emission: f64,
    two_sided: bool,
}

/// Radius of the sphere that the unit sphere becomes.
pub(super) fn radius(world_from_object: &Mat4) -> f32 {
    world_from_object.as_dmat4().determinant().abs().cbrt() as f32
}

/// Cosine of an angle in degrees, exact at a right angle.
fn cosine(degrees: f32) -> f64 {
    if degrees == 90.0 { 0.0 } else { f64::from(degrees).to_radians().cos() }
}

impl ShapeLight {
    /// The shape of a mesh, unless it is one of triangles.
    pub(super) fn new(mesh: &Mesh, materials: &[Material]) -> Option<Self> {
        if mesh.shape == Shape::Triangles {
            return None;
        }
        let material = &materials[mesh.materials[0] as usize];
        let emission = material.emission.to_array().map(f64::from).iter().sum();
        Some(Self { shape: mesh.shape, emission, two_sided: material.two_sided_emission })
    }

    /// Whether it shines at all.
    pub(super) fn emits(&self) -> bool {
        self.emission > 0.0
    }

    /// Its number in records.
    pub(super) fn kind(&self) -> u32 {
        match self.shape {
            Shape::Triangles => shape::TRIANGLES,
            Shape::Point | Shape::Spot { .. } => shape::PUNCTUAL,
            Shape::Sphere => shape::SPHERE,
            Shape::Rectangle => shape::RECTANGLE,
        }
    }

    /// Cosine of the outer cone of a spot, and the difference to that of the inner one.
    fn edge(inner_deg: f32, outer_deg: f32) -> (f64, f64) {
        let outer = cosine(outer_deg);
        (outer, (cosine(inner_deg) - outer).max(LEAST_EDGE))
    }

    /// Factor and summand of its falloff, see `LightPoint::falloff`: of anything but a spot, 1 everywhere.
    pub(super) fn falloff(&self) -> [f32; 2] {
        let Shape::Spot { inner_deg, outer_deg } = self.shape else { return [0.0, 1.0] };
        let (outer, edge) = Self::edge(inner_deg, outer_deg);
        [(1.0 / edge) as f32, (-outer / edge) as f32]
    }

    /// Where it is, where it shines and how much: like the weights of triangles, the sum over the channels of its emitted
    /// power, divided by pi. `gain` is a factor on its emission.
    pub(super) fn bounds(&self, world_from_object: &Mat4, gain: f64) -> LightBounds {
        let matrix: DMat4 = world_from_object.as_dmat4();
        let center = world_from_object.w_axis.truncate();
        let emission = self.emission * gain;
        // Half the size of a box around it, with room for rounding.
        let around = |half: DVec3| {
            let half = half.as_vec3();
            let half = half + position_error((center.abs() + half).max_element());
            [center - half, center + half]
        };
        match self.shape {
            Shape::Triangles => LightBounds::NONE,
            Shape::Point => LightBounds::around(around(DVec3::ZERO), None, 4.0 * emission),
            Shape::Spot { inner_deg, outer_deg } => {
                let (outer, edge) = Self::edge(inner_deg, outer_deg);
                // The integral of the falloff over directions, divided by pi. From the outer cone on it is a parabola, as
                // far as cosines go.
                let width = edge.min(1.0 - outer);
                let share = 2.0 * (width.powi(3) / (3.0 * edge * edge) + (1.0 - outer - width));
                let axis = matrix.transform_vector3(DVec3::NEG_Z).normalize_or_zero().as_vec3();
                // The cone of directions that tables and trees take for lit is a right angle wider than that of normals, so
                // the axis alone holds every spot.
                LightBounds::around(around(DVec3::ZERO), Some(axis).filter(|&a| a != Vec3::ZERO), share * emission)
            }
            Shape::Sphere => {
                let radius = f64::from(radius(world_from_object));
                let power = 4.0 * std::f64::consts::PI * radius * radius * emission;
                LightBounds::around(around(DVec3::splat(radius)), None, power)
            }
            Shape::Rectangle => {
                let (x, y) = (matrix.x_axis.truncate(), matrix.y_axis.truncate());
                let facing = if world_from_object.determinant() < 0.0 { -1.0 } else { 1.0 };
                let cross = x.cross(y) * facing;
                let sides = if self.two_sided { 2.0 } else { 1.0 };
                let axis = cross.normalize_or_zero().as_vec3();
                let axis = Some(axis).filter(|&a| !self.two_sided && a != Vec3::ZERO);
                LightBounds::around(around(x.abs() + y.abs()), axis, sides * 4.0 * cross.length() * emission)
            }
        }
    }
}

#[cfg(test)]
mod tests;
