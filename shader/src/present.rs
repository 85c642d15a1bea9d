//! The picture on the screen: the last pass, and the only one that is drawn.

use glam::{Vec2, Vec3, Vec4};
use weir_shared::{
    numerics::{load, max},
    tonemap::decode_srgb,
    window::Window,
};

/// The corner `index` of a triangle that covers the whole target.
pub fn corner(index: u32) -> Vec4 {
    let x = if index == 1 { 3.0 } else { -1.0 };
    let y = if index == 2 { 3.0 } else { -1.0 };
    Vec4::new(x, y, 0.0, 1.0)
}

fn color(packed: u32) -> Vec3 {
    let (red, green, blue) = (packed & 0xff, (packed >> 8) & 0xff, (packed >> 16) & 0xff);
    Vec3::new(red as f32, green as f32, blue as f32) * (1.0 / 255.0)
}

fn pixel(first: bool, left: &[u32], right: &[u32], index: u32) -> Vec3 {
    color(if first { load(left, index) } else { load(right, index) })
}

fn channel(encoded: f32, linear_target: u32) -> f32 {
    if linear_target != 0 { decode_srgb(encoded) } else { encoded }
}

/// The colour of a pixel of the target whose middle is at `target`: of the picture `left` or, beyond the divider, of
/// `right`, both 8-bit sRGB with red in the low byte.
pub fn present(target: Vec2, window: &Window, left: &[u32], right: &[u32]) -> Vec4 {
    let beyond = target.x - window.divider_px;
    let is_line = window.divided != 0 && beyond > -1.0 && beyond < 1.0;
    let first = beyond < 0.0;
    let blend = window.blend_at(target);
    let (x, y) = (blend.share.x, blend.share.y);
    let top = pixel(first, left, right, blend.pixels[0]) * (1.0 - x) + pixel(first, left, right, blend.pixels[1]) * x;
    let bottom =
        pixel(first, left, right, blend.pixels[2]) * (1.0 - x) + pixel(first, left, right, blend.pixels[3]) * x;
    let encoded = top * (1.0 - y) + bottom * y;
    let line = if is_line { 1.0 } else { 0.0 };
    Vec4::new(
        max(channel(encoded.x, window.linear_target), line),
        max(channel(encoded.y, window.linear_target), line),
        max(channel(encoded.z, window.linear_target), line),
        1.0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: u32 = 0xff00_00ff;
    const BLUE: u32 = 0xffff_0000;

    fn window() -> Window {
        Window { width: 2, height: 1, step_x: 1.0, step_y: 1.0, divider_px: 1e9, smooth: 1, ..Window::default() }
    }

    #[test]
    fn the_divider_parts_two_pictures() {
        let (left, right) = ([RED; 2], [BLUE; 2]);
        let window = Window { divider_px: 1.0, ..window() };
        assert_eq!(present(Vec2::new(0.5, 0.5), &window, &left, &right), Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert_eq!(present(Vec2::new(1.5, 0.5), &window, &left, &right), Vec4::new(0.0, 0.0, 1.0, 1.0));
        let marked = Window { divided: 1, ..window };
        assert_eq!(present(Vec2::new(0.5, 0.5), &marked, &left, &right), Vec4::ONE);
    }

    #[test]
    fn colors_blend_between_pixels_only_where_asked() {
        let picture = [RED, BLUE];
        let between = Vec2::new(1.0, 0.5);
        assert_eq!(present(between, &window(), &picture, &picture), Vec4::new(0.5, 0.0, 0.5, 1.0));
        let nearest = Window { smooth: 0, ..window() };
        assert_eq!(present(between, &nearest, &picture, &picture), Vec4::new(0.0, 0.0, 1.0, 1.0));
    }

    #[test]
    fn a_target_that_encodes_gets_linear_colors() {
        let grey = [0xff80_8080; 2];
        let place = Vec2::new(0.5, 0.5);
        let linear = present(place, &Window { linear_target: 1, ..window() }, &grey, &grey);
        assert!((linear.x - 0.215_86).abs() < 1e-4, "{linear}");
        assert!((present(place, &window(), &grey, &grey).x - 128.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn the_triangle_covers_every_corner_of_the_target() {
        let [a, b, c] = [0, 1, 2].map(|i| corner(i).truncate().truncate());
        for p in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(Vec2::from) {
            let side = |from: Vec2, to: Vec2| (to - from).perp_dot(p - from);
            assert!(side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0, "{p}");
        }
    }
}
