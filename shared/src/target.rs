//! The target p̂ of resampling: what a light sample is worth at a surface, as one number.

use glam::{UVec2, Vec3};

use crate::{
    bsdf::Bsdf,
    frame::Frame,
    light::{self, LightPoint},
    numerics::{load, max, min, sqrt},
    surface::Surface,
};

/// Approximate occlusion as a factor in the target. It guides the choice only: the factor never is zero, so that no
/// light is lost to it.
pub mod occlusion {
    /// None.
    pub const NONE: u32 = 0;
    /// A short march through the depth of the frame's pixels toward the light.
    pub const SCREEN: u32 = 1;
    /// What is left of the target of a sample that seems hidden.
    pub const REST: f32 = 0.1;
}

/// What the target of a surface depends on.
#[derive(Clone, Copy)]
pub struct Domain {
    /// World space.
    pub position: Vec3,
    /// Reflection toward the camera.
    pub bsdf: Bsdf,
}

impl Domain {
    /// A surface as a camera at `camera_origin` sees it.
    #[inline(always)]
    pub fn new(camera_origin: Vec3, surface: &Surface) -> Self {
        let position = surface.position();
        let toward_camera = camera_origin - position;
        let outgoing = toward_camera * (1.0 / max(sqrt(toward_camera.length_squared()), 1e-30));
        Self { position, bsdf: Bsdf::new(surface, outgoing) }
    }

    /// Reflected radiance per unit of (u, v), if nothing is in between.
    #[inline(always)]
    pub fn reflected<const ENVIRONMENT: bool, const SPECULAR: bool>(&self, point: &LightPoint) -> Vec3 {
        let arriving = light::arriving::<ENVIRONMENT>(self.position, point);
        self.bsdf.evaluate::<SPECULAR>(arriving.direction) * arriving.irradiance
    }

    /// Target p̂: the mean over the channels of [`Domain::reflected`]. The mean, because a luminance would give blue
    /// light a fourteenth of its share.
    #[inline(always)]
    pub fn target<const ENVIRONMENT: bool, const SPECULAR: bool>(&self, point: &LightPoint) -> f32 {
        mean(self.reflected::<ENVIRONMENT, SPECULAR>(point))
    }

    /// The target, and the density over (u, v) of directions drawn by [`Bsdf::sample`].
    #[inline(always)]
    pub fn target_and_density<const ENVIRONMENT: bool, const SPECULAR: bool>(&self, point: &LightPoint) -> (f32, f32) {
        let arriving = light::arriving::<ENVIRONMENT>(self.position, point);
        let target = mean(self.bsdf.evaluate::<SPECULAR>(arriving.direction) * arriving.irradiance);
        (target, self.bsdf.pdf_solid_angle(arriving.direction) * arriving.solid_angle)
    }

    /// The cheap target: irradiance at the surface, whatever the surface reflects. Positive wherever the target is.
    #[inline(always)]
    pub fn cheap_target<const ENVIRONMENT: bool>(&self, point: &LightPoint) -> f32 {
        let arriving = light::arriving::<ENVIRONMENT>(self.position, point);
        mean(arriving.irradiance) * max(self.bsdf.normal.dot(arriving.direction), 0.0)
    }
}

/// Mean of the channels.
#[inline(always)]
pub fn mean(rgb: Vec3) -> f32 {
    (rgb.x + rgb.y + rgb.z) * (1.0 / 3.0)
}

/// Factor for what seems to stand between the surface of `px` and a light: 1, or [`occlusion::REST`].
///
/// Eight steps over `frame.occlusion_reach` pixels at most; a surface that is nearer than the ray by less than a tenth
/// of its depth counts as in the way.
#[inline(always)]
pub fn screen_occlusion(frame: &Frame, surfaces: &[Surface], px: UVec2, position: Vec3, point: &LightPoint) -> f32 {
    const STEPS: u32 = 8;
    let start = position - frame.camera_origin;
    let depth = start.dot(frame.camera_forward);
    // A stretch of the ray no longer than the depth, and never behind the camera.
    let toward = if point.distant { point.position * depth } else { point.position - position };
    let length = sqrt(toward.length_squared());
    let toward = toward * min(1.0, depth / max(length, 1e-30));
    let forward = toward.dot(frame.camera_forward);
    let toward = if depth + forward < 0.25 * depth { toward * (0.75 * depth / -forward) } else { toward };
    let from = project(frame, start);
    let to = project(frame, start + toward);
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let pixels = sqrt(dx * dx + dy * dy);
    let share = min(1.0, frame.occlusion_reach / max(pixels, 1e-3));
    // The projection is not linear along the ray: 1 / depth is.
    let inverse_start = 1.0 / max(depth, 1e-30);
    let inverse_end = 1.0 / max(depth + toward.dot(frame.camera_forward), 1e-30);
    let mut factor = 1.0;
    let mut i = 1;
    while i <= STEPS {
        let t = share * (i as f32 * (1.0 / STEPS as f32));
        let (x, y) = (px.x as f32 + 0.5 + dx * t, px.y as f32 + 0.5 + dy * t);
        if x >= 0.0 && y >= 0.0 && x < frame.width as f32 && y < frame.height as f32 {
            let there = UVec2::new(x as u32, y as u32);
            let surface = load(surfaces, frame.index_of(there));
            let ray_depth = 1.0 / (inverse_start + (inverse_end - inverse_start) * t);
            let surface_depth = (surface.position() - frame.camera_origin).dot(frame.camera_forward);
            let is_between = surface_depth < ray_depth * 0.995 && surface_depth > ray_depth * 0.9;
            if is_between && !surface.is_sky() && (there.x != px.x || there.y != px.y) {
                factor = occlusion::REST;
            }
        }
        i += 1;
    }
    factor
}

/// Where on the image a point is that lies before the camera, in pixels from the upper left corner. `offset`: from the
/// camera.
#[inline(always)]
pub fn project(frame: &Frame, offset: Vec3) -> [f32; 2] {
    let depth = max(offset.dot(frame.camera_forward), 1e-30);
    let x = offset.dot(frame.camera_right) / (depth * frame.camera_right.length_squared());
    let y = offset.dot(frame.camera_up) / (depth * frame.camera_up.length_squared());
    [(x * 0.5 + 0.5) * frame.width as f32, (0.5 - y * 0.5) * frame.height as f32]
}
