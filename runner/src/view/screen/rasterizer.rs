//! egui's triangles on the host.

use egui::{
    ClippedPrimitive,
    epaint::{ColorImage, Mesh, Primitive, Vertex},
};
use rayon::prelude::*;

use super::textures::Textures;

/// Rows that one thread draws.
const BAND: u32 = 32;

/// What draws triangles.
pub(super) struct Rasterizer<'a>(pub(super) &'a Textures);

impl Rasterizer<'_> {
    /// Draws over `pixels`, of which there are `size`.
    pub(super) fn draw(&self, primitives: &[ClippedPrimitive], scale: f32, size: [u32; 2], pixels: &mut [u32]) {
        let bands = pixels.par_chunks_mut((size[0].max(1) * BAND) as usize).enumerate();
        bands.for_each(|(i, rows)| {
            let first_row = i as u32 * BAND;
            let band = Band { first_row, rows: (rows.len() as u32) / size[0].max(1), width: size[0] };
            for primitive in primitives {
                let clip = primitive.clip_rect * scale;
                let Primitive::Mesh(mesh) = &primitive.primitive else { continue };
                let Some(texture) = self.0.get(mesh.texture_id) else { continue };
                let clip = [clip.min.x, clip.min.y, clip.max.x, clip.max.y].map(|x| x.round().max(0.0) as u32);
                band.draw(mesh, texture, scale, clip, rows);
            }
        });
    }
}

/// Rows of the window.
struct Band {
    first_row: u32,
    rows: u32,
    width: u32,
}

impl Band {
    fn draw(&self, mesh: &Mesh, texture: &ColorImage, scale: f32, clip: [u32; 4], pixels: &mut [u32]) {
        for corners in mesh.indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|i| &mesh.vertices[corners[i] as usize]);
            self.triangle([a, b, c], texture, scale, clip, pixels);
        }
    }

    fn triangle(&self, corners: [&Vertex; 3], texture: &ColorImage, scale: f32, clip: [u32; 4], pixels: &mut [u32]) {
        let [a, b, c] = corners.map(|vertex| vertex.pos * scale);
        let area = (b - a).x * (c - a).y - (b - a).y * (c - a).x;
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let least = |x: f32, low: u32, high: u32| (x.floor().max(0.0) as u32).clamp(low, high);
        let most = |x: f32, low: u32, high: u32| (x.ceil().max(0.0) as u32).clamp(low, high);
        let (right, bottom) = (clip[2].min(self.width), clip[3].min(self.first_row + self.rows));
        let (left, top) = (clip[0].min(right), clip[1].max(self.first_row).min(bottom));
        let (x0, x1) = (least(a.x.min(b.x).min(c.x), left, right), most(a.x.max(b.x).max(c.x), left, right));
        let (y0, y1) = (least(a.y.min(b.y).min(c.y), top, bottom), most(a.y.max(b.y).max(c.y), top, bottom));
        let flat = corners.iter().all(|v| v.color == corners[0].color && v.uv == corners[0].uv);
        let flat = flat.then(|| shade(corners, [1.0, 0.0, 0.0], texture));
        for y in y0..y1 {
            let row = &mut pixels[((y - self.first_row) * self.width) as usize..];
            for x in x0..x1 {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                // Twice the area of the triangle on the other side of each corner, by the whole; edges belong to one side.
                let weight = |p: egui::Pos2, q: egui::Pos2| {
                    let cross = (q.x - p.x) * (py - p.y) - (q.y - p.y) * (px - p.x);
                    let oriented = if area < 0.0 { p - q } else { q - p };
                    let is_inclusive = oriented.y < 0.0 || (oriented.y == 0.0 && oriented.x > 0.0);
                    let weight = cross / area;
                    (weight > 0.0 || (weight == 0.0 && is_inclusive)).then_some(weight)
                };
                if let (Some(u), Some(v), Some(w)) = (weight(b, c), weight(c, a), weight(a, b)) {
                    let color = flat.unwrap_or_else(|| shade(corners, [u, v, w], texture));
                    let pixel = &mut row[x as usize];
                    *pixel = blend(color, *pixel);
                }
            }
        }
    }
}

/// Colour of the triangle times that of the texture, both with premultiplied alpha in 0..=255.
fn shade(corners: [&Vertex; 3], weights: [f32; 3], texture: &ColorImage) -> [f32; 4] {
    let mut color = [0.0; 4];
    let (mut u, mut v) = (0.0, 0.0);
    for (vertex, weight) in corners.into_iter().zip(weights) {
        for (sum, channel) in color.iter_mut().zip(vertex.color.to_array()) {
            *sum += weight * f32::from(channel);
        }
        u += weight * vertex.uv.x;
        v += weight * vertex.uv.y;
    }
    let texel = lookup(texture, u, v);
    std::array::from_fn(|i| color[i] * texel[i] / 255.0)
}

/// Bilinear, clamped to the edge.
fn lookup(texture: &ColorImage, u: f32, v: f32) -> [f32; 4] {
    let [width, height] = texture.size;
    if texture.pixels.is_empty() {
        return [255.0; 4];
    }
    let axis = |x: f32, size: usize| {
        let x = (x * size as f32 - 0.5).clamp(0.0, size as f32 - 1.0);
        let low = (x as usize).min(size - 1);
        (low, (low + 1).min(size - 1), x - low as f32)
    };
    let ((x0, x1, fx), (y0, y1, fy)) = (axis(u, width), axis(v, height));
    let at = |x: usize, y: usize| texture.pixels[y * width + x].to_array().map(f32::from);
    if fx == 0.0 && fy == 0.0 {
        return at(x0, y0);
    }
    let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
    std::array::from_fn(|i| {
        let (top, bottom) = (a[i] + (b[i] - a[i]) * fx, c[i] + (d[i] - c[i]) * fx);
        top + (bottom - top) * fy
    })
}

fn blend(color: [f32; 4], below: u32) -> u32 {
    let keep = 1.0 - color[3] / 255.0;
    let channel = |i: usize| {
        let under = f32::from((below >> (8 * i)) as u8);
        ((color[i] + under * keep + 0.5).min(255.0) as u32) << (8 * i)
    };
    channel(0) | channel(1) | channel(2) | 0xff00_0000
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::{Color32, Rect, TextureId, TexturesDelta, pos2};
    use std::sync::Arc;

    const BLACK: u32 = 0xff00_0000;

    /// A rectangle of one colour with a white texture, clipped, in a window of 40 by 70 pixels.
    fn drawn(rect: Rect, clip: Rect, color: Color32, scale: f32) -> Vec<u32> {
        let mut textures = Textures::default();
        let image = ColorImage::filled([4, 4], Color32::WHITE);
        let change = egui::epaint::ImageDelta::full(Arc::new(image), egui::TextureOptions::LINEAR);
        let mut delta = TexturesDelta::default();
        delta.set.entry(TextureId::default()).or_default().push(change);
        textures.update(&delta);
        let mut mesh = Mesh::with_texture(TextureId::default());
        mesh.add_colored_rect(rect, color);
        let primitive = ClippedPrimitive { clip_rect: clip, primitive: Primitive::Mesh(mesh) };
        let mut pixels = vec![BLACK; 40 * 70];
        Rasterizer(&textures).draw(&[primitive], scale, [40, 70], &mut pixels);
        pixels
    }

    #[test]
    fn a_rectangle_covers_its_pixels_once_and_no_others() {
        let rect = Rect::from_min_max(pos2(3.0, 5.0), pos2(23.0, 60.0));
        let half = Color32::from_rgba_premultiplied(100, 0, 0, 128);
        let pixels = drawn(rect, Rect::EVERYTHING, half, 1.0);
        for (i, pixel) in pixels.iter().enumerate() {
            let inside = (3..23).contains(&(i % 40)) && (5..60).contains(&(i / 40));
            // Drawn twice, along the diagonal, it would be brighter.
            assert_eq!(*pixel, if inside { BLACK | 100 } else { BLACK }, "({}, {})", i % 40, i / 40);
        }
    }

    #[test]
    fn nothing_leaves_its_clip_rectangle_or_the_window() {
        let huge = Rect::from_min_max(pos2(-1e4, -1e4), pos2(1e4, 1e4));
        let clip = Rect::from_min_max(pos2(2.0, 2.0), pos2(4.0, 3.0));
        let pixels = drawn(huge, clip, Color32::WHITE, 2.0);
        assert_eq!(pixels.iter().filter(|pixel| **pixel != BLACK).count(), 4 * 2);
        assert_eq!(pixels[4 * 40 + 4], 0xffff_ffff);
        assert!(drawn(huge, Rect::EVERYTHING, Color32::WHITE, 1.0).iter().all(|pixel| *pixel == 0xffff_ffff));
    }
}
