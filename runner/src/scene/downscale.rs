//! Making textures fit a memory budget.

use std::collections::BinaryHeap;
use std::sync::LazyLock;

use super::Texture;

/// How often each texture of these sizes (width, height) has to be halved for all of them, at 4 bytes a texel, to fit
/// `budget_bytes`: always the largest first, of equals the later one. Nothing gets smaller than one texel.
pub fn plan(sizes: &[(u32, u32)], budget_bytes: u64) -> Vec<u32> {
    let texels = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
    let mut halvings = vec![0; sizes.len()];
    let mut total: u64 = sizes.iter().map(|&size| texels(size)).sum();
    let mut largest_first: BinaryHeap<_> =
        sizes.iter().enumerate().map(|(index, &size)| (texels(size), index, size)).collect();
    while total > budget_bytes / 4 {
        let Some((count, index, size)) = largest_first.pop() else {
            break;
        };
        if count <= 1 {
            break;
        }
        let half = halved(size);
        halvings[index] += 1;
        total -= count - texels(half);
        largest_first.push((texels(half), index, half));
    }
    halvings
}

/// Half the size, rounded down, but never nothing.
pub fn halved((width, height): (u32, u32)) -> (u32, u32) {
    ((width / 2).max(1), (height / 2).max(1))
}

/// Averages blocks of 2x2 texels, in linear light.
pub fn halve(texture: &mut Texture) {
    let (width, height) = halved((texture.width, texture.height));
    let (step_x, step_y) = (texture.width.min(2), texture.height.min(2));
    let decode = if texture.srgb { &TABLES.linear_from_srgb } else { &TABLES.linear_from_linear };
    let encode = if texture.srgb { &TABLES.srgb_from_linear } else { &TABLES.eight_bits_from_linear };
    let scale = 1.0 / (step_x * step_y) as f32;
    let mut texels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0.0; 4];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                if dx < step_x && dy < step_y {
                    let index = (y * step_y + dy) as usize * texture.width as usize + (x * step_x + dx) as usize;
                    let [red, green, blue, alpha] = texture.texels[index].to_le_bytes();
                    let color = [red, green, blue].map(|channel| decode[usize::from(channel)]);
                    (0..3).for_each(|channel| sum[channel] += color[channel]);
                    sum[3] += f32::from(alpha) / 255.0;
                }
            }
            let steps = |sum: f32| (sum * scale * STEPS as f32 + 0.5) as usize;
            let [red, green, blue] = [sum[0], sum[1], sum[2]].map(|sum| encode[steps(sum)]);
            let alpha = TABLES.eight_bits_from_linear[steps(sum[3])];
            texels.push(u32::from_le_bytes([red, green, blue, alpha]));
        }
    }
    (texture.width, texture.height, texture.texels) = (width, height, texels);
}

/// Steps of linear light in the tables: fine enough for a fifth of the smallest 8-bit step of sRGB.
const STEPS: usize = 1 << 14;

struct Tables {
    linear_from_srgb: [f32; 256],
    linear_from_linear: [f32; 256],
    srgb_from_linear: Vec<u8>,
    eight_bits_from_linear: Vec<u8>,
}

/// Source of the curve: IEC 61966-2-1.
static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let level = |index: usize| index as f64 / 255.0;
    let decode = |x: f64| {
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    let encode = |x: f64| {
        if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
    };
    let steps = || (0..=STEPS).map(|step| step as f64 / STEPS as f64);
    Tables {
        linear_from_srgb: std::array::from_fn(|index| decode(level(index)) as f32),
        linear_from_linear: std::array::from_fn(|index| level(index) as f32),
        srgb_from_linear: steps().map(|x| (encode(x) * 255.0).round() as u8).collect(),
        eight_bits_from_linear: steps().map(|x| (x * 255.0).round() as u8).collect(),
    }
});

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(width: u32, height: u32, srgb: bool, texels: Vec<u32>) -> Texture {
        Texture { name: "t".into(), width, height, srgb, texels }
    }

    #[test]
    fn the_largest_are_halved_until_all_fit() {
        assert_eq!(plan(&[(8, 8), (4, 4)], 80 * 4), [0, 0]);
        assert_eq!(plan(&[(8, 8), (4, 4)], 79 * 4), [1, 0]);
        assert_eq!(plan(&[(8, 8), (4, 4)], 31 * 4), [1, 1]);
        assert_eq!(plan(&[(8, 1)], 0), [3]);
        assert_eq!(plan(&[], 0), [0; 0]);
    }

    #[test]
    fn a_uniform_texture_stays_what_it_is() {
        for srgb in [false, true] {
            for level in 0..=255_u8 {
                let texel = u32::from_le_bytes([level, level, 255 - level, level]);
                let mut texture = texture(4, 2, srgb, vec![texel; 8]);
                halve(&mut texture);
                assert_eq!((texture.width, texture.height, texture.texels), (2, 1, vec![texel; 2]), "srgb {srgb}");
            }
        }
    }

    #[test]
    fn colours_are_averaged_as_light_and_masks_as_numbers() {
        let black_and_white = vec![0xFF00_0000, 0xFFFF_FFFF];
        let mut color = texture(2, 1, true, black_and_white.clone());
        halve(&mut color);
        assert_eq!(color.texels, [0xFFBC_BCBC], "half the light is level 188");
        let mut mask = texture(2, 1, false, black_and_white);
        halve(&mut mask);
        assert_eq!(mask.texels, [0xFF80_8080]);
    }

    #[test]
    fn odd_sizes_are_rounded_down() {
        let mut texture = texture(3, 3, false, (0..9).collect());
        halve(&mut texture);
        assert_eq!((texture.width, texture.height, texture.texels.len()), (1, 1, 1));
    }
}
