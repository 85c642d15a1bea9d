//! Camera rays.

use glam::UVec2;

use crate::{
    frame::Frame,
    numerics::unit_float,
    ray::{FAR, Ray},
    rng::{Rng, Stage},
};

/// The ray of a pixel: through its center, or uniform over it where the frame asks for jitter (a box filter).
#[inline]
pub fn camera_ray(px: UVec2, frame: &Frame) -> Ray {
    let (mut x, mut y) = (0.5, 0.5);
    if frame.jitter != 0 {
        let bits = Rng::for_pixel(px, frame, Stage::Primary).next_four();
        x = unit_float(bits[0]);
        y = unit_float(bits[1]);
    }
    ray_through(frame, px.x as f32 + x, px.y as f32 + y)
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
