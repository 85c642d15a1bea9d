//! 8-bit images: bilinear lookups that repeat in both directions, and alpha masks.

use glam::{UVec4, Vec2, Vec3};

use crate::{
    frame::Frame,
    numerics::{floor, load},
    scene::{NO_TEXTURE, Scene, attribute_flags, instance_record, material_record, texture_record},
    tonemap::decode_srgb,
};

/// The four texels around a point and how far it lies between them.
struct Footprint {
    texels: [u32; 4],
    x: f32,
    y: f32,
}

/// Texel coordinate and its successor, both wrapped to `0..size`, and the fraction between.
#[inline(always)]
fn wrap(coordinate: f32, size: u32) -> (u32, u32, f32) {
    let extent = size as f32;
    let repeated = coordinate - floor(coordinate);
    let position = repeated * extent - 0.5;
    let whole = floor(position);
    let first = if whole < 0.0 { size - 1 } else { (whole as u32).min(size - 1) };
    let second = if first + 1 == size { 0 } else { first + 1 };
    (first, second, position - whole)
}

#[inline(always)]
fn footprint(header: UVec4, texels: &[u32], uv: Vec2) -> Footprint {
    let (x0, x1, x) = wrap(uv.x, header.y);
    // The first row is the top of the image, the origin of uv its lower left corner.
    let (y0, y1, y) = wrap(1.0 - uv.y, header.z);
    // Not a closure: it would hold a pointer, which naga does not take in a struct.
    let (row0, row1) = (header.x + y0 * header.y, header.x + y1 * header.y);
    Footprint {
        texels: [load(texels, row0 + x0), load(texels, row0 + x1), load(texels, row1 + x0), load(texels, row1 + x1)],
        x,
        y,
    }
}

#[inline(always)]
fn rgb(texel: u32, srgb: bool) -> Vec3 {
    let (r, g, b) = (texel & 0xff, (texel >> 8) & 0xff, (texel >> 16) & 0xff);
    if srgb {
        let decode = |byte: u32| decode_srgb(byte as f32 / 255.0);
        Vec3::new(decode(r), decode(g), decode(b))
    } else {
        Vec3::new(r as f32, g as f32, b as f32) * (1.0 / 255.0)
    }
}

/// Linear RGB of texture number `texture` at `uv`, in 0..=1; interpolated after decoding.
#[inline(always)]
pub fn rgb_at(frame: &Frame, scene: &Scene, texture: u32, uv: Vec2) -> Vec3 {
    let header = scene.texture(frame, texture);
    let f = footprint(header, scene.texels, uv);
    let srgb = header.to_array()[texture_record::SRGB as usize] != 0;
    let top = rgb(f.texels[0], srgb) * (1.0 - f.x) + rgb(f.texels[1], srgb) * f.x;
    let bottom = rgb(f.texels[2], srgb) * (1.0 - f.x) + rgb(f.texels[3], srgb) * f.x;
    top * (1.0 - f.y) + bottom * f.y
}

/// The red channel of texture number `texture` at `uv`, in 0..=1, as it is stored.
#[inline(always)]
pub fn alpha_at(frame: &Frame, scene: &Scene, texture: u32, uv: Vec2) -> f32 {
    let f = footprint(scene.texture(frame, texture), scene.texels, uv);
    let red = |texel: u32| (texel & 0xff) as f32 / 255.0;
    let top = red(f.texels[0]) * (1.0 - f.x) + red(f.texels[1]) * f.x;
    let bottom = red(f.texels[2]) * (1.0 - f.x) + red(f.texels[3]) * f.x;
    top * (1.0 - f.y) + bottom * f.y
}

/// Whether the alpha mask of a triangle's material leaves a surface at barycentric weights (`u`, `v`).
#[inline(always)]
pub fn is_opaque(frame: &Frame, scene: &Scene, instance: u32, triangle: u32, u: f32, v: f32) -> bool {
    if (scene.instance_word(frame, instance, instance_record::FLAGS) & attribute_flags::UVS) == 0 {
        return true;
    }
    let material = scene.material_of(frame, instance, triangle);
    let mask = scene.material_word(material, material_record::ALPHA_TEXTURE);
    mask == NO_TEXTURE || alpha_at(frame, scene, mask, scene.uv_at(frame, instance, triangle, u, v)) >= 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lookups_repeat_and_interpolate_and_the_first_row_is_the_top() {
        // Two texels wide, two high: black and red above, green and blue below.
        let texels = [0x0000_0000, 0x0000_00ff, 0x0000_ff00, 0x00ff_0000];
        let records = [0, 2, 2, 0];
        let scene = Scene { triangles: &[], records: &records, texels: &texels };
        let frame = Frame::default();
        let at = |u: f32, v: f32| rgb_at(&frame, &scene, 0, Vec2::new(u, v));
        assert_eq!(at(0.75, 0.75), Vec3::X);
        assert_eq!(at(0.25, 0.25), Vec3::Y);
        assert_eq!(at(-0.25, 2.25), Vec3::Z);
        assert_eq!(at(0.5, 0.5), Vec3::splat(0.25));
        assert_eq!(alpha_at(&frame, &scene, 0, Vec2::new(0.5, 0.75)), 0.5);
    }
}
