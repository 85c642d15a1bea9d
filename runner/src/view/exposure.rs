//! Exposure by what the picture shows.

use glam::Vec3;
use weir_shared::moments::Moments;

/// Rows of the picture that are looked at.
pub const ROWS: u32 = 12;
/// Brightness that the picture should have, before the tone curve.
const GREY: f32 = 0.18;
/// Share of the way that each look goes.
const SPEED: f32 = 0.25;

fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The rows to look at in a picture of so many, spread evenly.
pub fn rows(height: u32) -> Vec<u32> {
    let count = ROWS.min(height);
    (0..count).map(|i| (2 * i + 1) * height / (2 * count)).collect()
}

/// Mean luminance of pixels that are not black, averaged as logarithms; none if all are.
pub fn log_mean(pixels: &[Moments]) -> Option<f32> {
    let lit = pixels.iter().map(|pixel| luminance(pixel.mean())).filter(|value| *value > 1e-6 && value.is_finite());
    let (sum, count) = lit.fold((0.0_f64, 0_u32), |(sum, count), value| (sum + f64::from(value.ln()), count + 1));
    (count > 0).then(|| (sum / f64::from(count)).exp() as f32)
}

/// The next exposure on the way to a grey picture; `factor` is what the user wants beyond that.
pub fn adapted(exposure: f32, log_mean: Option<f32>, factor: f32) -> f32 {
    let Some(mean) = log_mean else { return exposure };
    let wanted = (factor * GREY / mean).clamp(1e-8, 1e8);
    let next = exposure * (wanted / exposure).powf(SPEED);
    if next.is_finite() && next > 0.0 { next } else { wanted }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(value: f32, count: usize) -> Vec<Moments> {
        vec![Moments::default().with(Vec3::splat(value), 0).with(Vec3::splat(value), 0); count]
    }

    #[test]
    fn any_picture_becomes_grey() {
        for value in [1e-4, 0.3, 5e3] {
            let mut exposure = 1.0;
            for _ in 0..200 {
                exposure = adapted(exposure, log_mean(&pixels(value, 9)), 1.0);
            }
            assert!((exposure * value / GREY - 1.0).abs() < 1e-3, "{value}: {exposure}");
        }
    }

    #[test]
    fn a_black_picture_leaves_the_exposure_alone() {
        assert_eq!(adapted(3.0, log_mean(&pixels(0.0, 4)), 1.0), 3.0);
        assert_eq!(adapted(3.0, log_mean(&[]), 1.0), 3.0);
    }

    #[test]
    fn rows_are_spread_over_any_height() {
        assert_eq!(rows(1), [0]);
        assert_eq!(rows(24), (0..12).map(|i| 2 * i + 1).collect::<Vec<_>>());
        assert!(rows(721).iter().all(|&row| row < 721));
    }
}
