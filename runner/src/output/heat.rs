//! Heat maps: how large an error is where, in colour.

use plotters::style::colors::colormaps::{ColorMap, ViridisRGB};

use crate::{margin::FLOOR, render::Rendered};

/// Least and largest error that has a colour of its own, as decimal logarithms: 0.1 % and 100 %.
const DECADES: [f64; 2] = [-3.0, 0.0];

/// The colour of a relative error, by its logarithm, from dark blue through green to yellow (viridis); display-encoded RGBA,
/// red in the low byte. Black where there is no number.
pub fn color_of(error: f64) -> u32 {
    if error.is_nan() {
        return 0xff00_0000;
    }
    let [low, high] = DECADES;
    let place = ((error.max(1e-30).log10() - low) / (high - low)).clamp(0.0, 1.0);
    let color = ViridisRGB.get_color(place);
    let [r, g, b] = [color.0, color.1, color.2].map(u32::from);
    0xff00_0000 | b << 16 | g << 8 | r
}

/// The relative standard error of each pixel, over its channels: the root of the mean of squared standard error over
/// x² + 0.01 m², m the mean of the picture. The mean of its squares is the picture's own, see [`crate::margin`].
pub fn heat_map_picture(rendered: &Rendered) -> Vec<u32> {
    let rgb = &rendered.picture.rgb;
    let mean = rgb.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * rgb.len()) as f64;
    let square = |(x, v): (&f32, &f32)| match f64::from(*v) {
        0.0 => 0.0,
        v => v / (f64::from(*x).powi(2) + FLOOR * mean * mean),
    };
    let error = |(x, v): (&[f32; 3], &[f32; 3])| (x.iter().zip(v).map(square).sum::<f64>() / 3.0).sqrt();
    rgb.iter().zip(&rendered.variance).map(|pixel| color_of(error(pixel))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_error_is_brighter_and_the_ends_are_those_of_the_scale() {
        let luma = |error: f64| {
            let c = color_of(error);
            0.2126 * f64::from(c & 255) + 0.7152 * f64::from(c >> 8 & 255) + 0.0722 * f64::from(c >> 16 & 255)
        };
        let scale: Vec<f64> = (0..=30).map(|i| luma(10f64.powf(-3.0 + 0.1 * f64::from(i)))).collect();
        assert!(scale.windows(2).all(|pair| pair[0] < pair[1]), "{scale:?}");
        assert_eq!(color_of(0.0), color_of(1e-3));
        assert_eq!(color_of(7.0), color_of(1.0));
        assert_eq!(color_of(f64::NAN), 0xff00_0000);
    }
}
