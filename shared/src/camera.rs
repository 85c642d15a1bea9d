//! Camera rays.

use glam::{UVec2, Vec2, Vec3};

use crate::{
    frame::Frame,
    numerics::unit_float,
    ray::{FAR, Ray},
    rng::{Rng, Stage},
};

/// Steps along the sequence of points of a pixel: 1/g and 1/g^2, g^3 = g + 1.
///
/// Source: Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences" (R2).
const STEP: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// The first point of a pixel that a camera ray goes through, in pixels from its upper left corner: the center or, where the
/// frame asks for jitter, uniform over it (a box filter). z is another number, uniform from 0 to below 1.
#[inline(always)]
pub fn first_point(px: UVec2, frame: &Frame) -> Vec3 {
    if frame.is_jittered() {
        let bits = Rng::for_pixel(px, frame, Stage::Primary).next_four();
        Vec3::new(unit_float(bits[0]), unit_float(bits[1]), unit_float(bits[2]))
    } else {
        Vec3::new(0.5, 0.5, 0.0)
    }
}

/// The next point of a pixel: as uniform as the one before it, and all of them spread evenly.
///
/// Source: Cranley and Patterson 1976, "Randomization of Number Theoretic Methods for Multiple Integration".
#[inline(always)]
pub fn next_point(point: Vec2) -> Vec2 {
    let (x, y) = (point.x + STEP.x, point.y + STEP.y);
    Vec2::new(if x < 1.0 { x } else { x - 1.0 }, if y < 1.0 { y } else { y - 1.0 })
}

/// The ray through the first point of a pixel.
#[inline]
pub fn camera_ray(px: UVec2, frame: &Frame) -> Ray {
    let point = first_point(px, frame);
    ray_through(frame, px.x as f32 + point.x, px.y as f32 + point.y)
}

/// The ray through a point of the image, in pixels from the upper left corner; its direction has length 1.
#[inline]
pub fn ray_through(frame: &Frame, x_px: f32, y_px: f32) -> Ray {
    let x = 2.0 * x_px / frame.width as f32 - 1.0;
    let y = 1.0 - 2.0 * y_px / frame.height as f32;
    let toward = frame.camera_forward + frame.camera_right * x + frame.camera_up * y;
    Ray {
        origin: frame.camera_origin,
        direction: toward * (1.0 / crate::numerics::sqrt(toward.length_squared())),
        t_max: FAR,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares of areas, by as many points as an edge has rays: closer than those of random points.
    #[test]
    fn points_of_a_pixel_stay_in_it_and_are_spread_evenly() {
        const RAYS: u32 = 8;
        let frame = Frame { width: 64, height: 64, camera_rays: RAYS, ..Frame::default() };
        let mut squared = [0.0_f32; 3];
        let mut means = [0.0_f32; 3];
        for i in 0..4096 {
            let first = first_point(UVec2::new(i % 64, i / 64), &frame);
            assert!((0.0..1.0).contains(&first.z));
            let mut point = first.truncate();
            let mut inside = [0; 3];
            for _ in 0..RAYS {
                assert!(point.min_element() >= 0.0 && point.max_element() < 1.0, "{point}");
                let areas = [point.x < 0.3, point.y < 0.5, point.x + point.y < 0.8];
                areas.iter().zip(&mut inside).for_each(|(is_in, inside)| *inside += u32::from(*is_in));
                point = next_point(point);
            }
            for (k, area) in [0.3, 0.5, 0.32].into_iter().enumerate() {
                let share = inside[k] as f32 / RAYS as f32;
                means[k] += share / 4096.0;
                squared[k] += (share - area) * (share - area) / 4096.0;
            }
        }
        for (k, area) in [0.3_f32, 0.5, 0.32].into_iter().enumerate() {
            let random = area * (1.0 - area) / RAYS as f32;
            // Five standard errors of independent points.
            assert!((means[k] - area).abs() < 5.0 * (random / 4096.0).sqrt(), "{} instead of {area}", means[k]);
            assert!(squared[k] < 0.5 * random, "area {k}: {} of {random}", squared[k]);
        }
    }
}
