//! Rays, hits, and where secondary rays start.

use glam::Vec3;

use crate::numerics::{abs, max};

/// A half-line: `origin + t * direction` for t in `0..t_max`, both ends exclusive.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, in scene units.
    pub origin: Vec3,
    /// Direction; its length sets the unit of t.
    pub direction: Vec3,
    /// End.
    pub t_max: f32,
}

/// A t beyond every scene. Not f32::MAX: naga prints that in a form that browsers reject.
pub const FAR: f32 = 1e30;

/// The instance of a [`Hit`] that found nothing.
pub const MISS: u32 = 0xffff_ffff;

/// The nearest intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the direction's length.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex.
    pub v: f32,
    /// Triangle, counted over all meshes.
    pub triangle: u32,
    /// Instance, or [`MISS`].
    pub instance: u32,
}

impl Hit {
    /// No intersection before `t_max`.
    #[inline(always)]
    pub fn miss(t_max: f32) -> Self {
        Self { t: t_max, u: 0.0, v: 0.0, triangle: MISS, instance: MISS }
    }

    /// Whether there is no intersection.
    #[inline(always)]
    pub fn is_miss(&self) -> bool {
        self.instance == MISS
    }
}

/// Largest magnitude among the coordinates of a point.
#[inline(always)]
pub fn max_abs(p: Vec3) -> f32 {
    max(max(abs(p.x), abs(p.y)), abs(p.z))
}

/// How far a computed point may lie from the true surface, times a margin, for a point interpolated from
/// coordinates of the given magnitude: 8 times the bound gamma_7 of pbrt (4th edition, section 6.8).
#[inline(always)]
pub fn position_error(magnitude: f32) -> f32 {
    magnitude * 3.4e-6
}

/// Start of a ray that leaves a surface toward `direction`, moved off the surface along its geometric normal.
#[inline(always)]
pub fn offset_origin(position: Vec3, normal_geometric: Vec3, error: f32, direction: Vec3) -> Vec3 {
    let side = if direction.dot(normal_geometric) < 0.0 { -error } else { error };
    position + normal_geometric * side
}
