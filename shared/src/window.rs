//! The picture in a window: where it lies on the target, and what is shown of it.

use bytemuck::{Pod, Zeroable};
use core::mem::size_of;
use glam::Vec2;

use crate::numerics::{clamp, floor};

/// Binding 0 of the passes that draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Window {
    /// Pixels in a row of the picture.
    pub width: u32,
    /// Rows of the picture.
    pub height: u32,
    /// Upper left corner of the picture on the target, in pixels of the target.
    pub left_px: f32,
    /// Its distance from the upper edge.
    pub top_px: f32,
    /// Pixels of the picture to one of the target.
    pub step_x: f32,
    /// The same downwards.
    pub step_y: f32,
    /// Targets left of this show the first picture, those right of it the second.
    pub divider_px: f32,
    /// 1: between pixels of the picture, colours blend; 0: the nearest.
    pub smooth: u32,
    /// 1: the target encodes for the screen itself, and wants linear colours.
    pub linear_target: u32,
    /// 1: a line marks the divider.
    pub divided: u32,
    /// Not used.
    pub padding: u32,
    /// Not used.
    pub padding_end: u32,
}

const _: () = assert!(size_of::<Window>() == 48);

/// Four pixels of a picture and how much of the lower right ones a place between them takes.
pub struct Blend {
    /// Indices: upper left, upper right, lower left, lower right.
    pub pixels: [u32; 4],
    /// Share of the right ones, share of the lower ones.
    pub share: Vec2,
}

impl Window {
    /// The pixels behind a place on the target; all within the picture, wherever the place is.
    #[inline(always)]
    pub fn blend_at(&self, target: Vec2) -> Blend {
        let (right, bottom) = (self.width.wrapping_sub(1), self.height.wrapping_sub(1));
        let x = (target.x - self.left_px) * self.step_x - 0.5;
        let y = (target.y - self.top_px) * self.step_y - 0.5;
        // The nearest pixel is the one whose middle is less than half a pixel away.
        let (nearest, blends) = if self.smooth != 0 { (0.0, 1.0) } else { (0.5, 0.0) };
        let x = clamp(x + nearest, 0.0, right as f32);
        let y = clamp(y + nearest, 0.0, bottom as f32);
        let (left, top) = (floor(x), floor(y));
        let share = Vec2::new((x - left) * blends, (y - top) * blends);
        let (left, top) = ((left as u32).min(right), (top as u32).min(bottom));
        let (next, below) = (left.wrapping_add(1).min(right), top.wrapping_add(1).min(bottom));
        let (row, row_below) = (top.wrapping_mul(self.width), below.wrapping_mul(self.width));
        Blend {
            pixels: [
                row.wrapping_add(left),
                row.wrapping_add(next),
                row_below.wrapping_add(left),
                row_below.wrapping_add(next),
            ],
            share,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_on_the_target_has_pixels_of_the_picture() {
        for smooth in [0, 1] {
            let window =
                Window { width: 7, height: 5, left_px: 3.0, step_x: 0.3, step_y: 2.5, smooth, ..Window::default() };
            for place in [[-1e9, -1e9], [0.0, 0.0], [3.5, 0.5], [26.2, 1.7], [1e9, 1e9], [f32::NAN, f32::NAN]] {
                let blend = window.blend_at(Vec2::from(place));
                assert!(blend.pixels.iter().all(|&i| i < 35), "{place:?}: {:?}", blend.pixels);
                assert!((0.0..1.0).contains(&blend.share.x) && (0.0..1.0).contains(&blend.share.y));
            }
        }
    }

    #[test]
    fn at_its_own_size_each_place_shows_its_pixel_and_nothing_else() {
        for smooth in [0, 1] {
            let window = Window { width: 4, height: 3, step_x: 1.0, step_y: 1.0, smooth, ..Window::default() };
            for (i, (x, y)) in (0..3).flat_map(|y| (0..4).map(move |x| (x, y))).enumerate() {
                let blend = window.blend_at(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                assert_eq!((blend.pixels[0], blend.share), (i as u32, Vec2::ZERO));
            }
        }
    }
}
