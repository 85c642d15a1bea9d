//! Pixels at the edges of lights, of the sky and of surfaces whose light has a closed form have several camera rays: for less
//! noise, and with the mean of one.

use glam::Vec3;
use weir::technique::Technique;
use weir_shader::PASSES;

use crate::{
    Bench, TIERS,
    chains::Clip,
    planted,
    scenarios::{self, Scenario},
};

/// The room from where two lamps and what is behind the wall are in view.
fn lamps_in_view(name: &'static str, room: Scenario) -> Scenario {
    let mut scenario = room;
    scenario.name = name;
    for shot in &mut scenario.shots {
        shot.camera.target = Vec3::new(0.1, 1.9, -0.8);
    }
    scenario
}

/// Of each tier.
const RAYS: [&str; 3] = ["camera.rays=4", "camera.rays=7", "camera.rays=16"];

fn under_a_sky() -> Scenario {
    lamps_in_view("lamps under a sky", scenarios::environment())
}

fn in_closed_form() -> Scenario {
    lamps_in_view("lamps in a room of closed forms", scenarios::standing().with_closed_form())
}

#[test]
fn edges_of_lights_are_unbiased() {
    let mut wrong = Vec::new();
    for bench in [under_a_sky(), in_closed_form()].map(Bench::new) {
        wrong.extend(TIERS.iter().zip(RAYS).filter_map(|(tier, rays)| bench.check(Technique::RealTime, &[tier, rays])));
        wrong.extend(bench.check(Technique::Still, &["camera.rays=3"]));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The surface that was chosen stands for all of the pixel.
#[test]
fn edges_that_forget_how_much_of_a_pixel_they_cover_are_caught() {
    let bench = Bench::new(under_a_sky());
    for technique in [Technique::RealTime, Technique::Still] {
        let clip = bench.planted(planted::covering_whole_pixels(), technique, &["rays=quality"]);
        bench.assert_biased(&format!("whole pixels, {technique}"), &clip);
    }
}

/// Mean over pixels and channels of the variance of a frame of a still, but of the first, over many of them.
fn noise(scenario: &Scenario, knobs: &[&str]) -> f64 {
    const FRAMES: u32 = 257;
    let clip = Clip::new(scenario, PASSES, Technique::Still, knobs);
    let pixels = (scenario.size[0] * scenario.size[1]) as usize;
    let mut sums = vec![[[0.0_f64; 2]; 3]; pixels];
    let mut frame = 0;
    clip.stills(3, FRAMES, |color| {
        for (sum, color) in sums.iter_mut().zip(color).filter(|_| frame > 0) {
            for (sum, &value) in sum.iter_mut().zip(color) {
                (sum[0], sum[1]) = (sum[0] + f64::from(value), sum[1] + f64::from(value).powi(2));
            }
        }
        frame += 1;
    });
    let n = f64::from(FRAMES - 1);
    let variances = sums.as_flattened().iter().map(|[sum, squares]| (squares - sum * sum / n) / (n - 1.0));
    variances.sum::<f64>() / (3 * pixels) as f64
}

#[test]
fn rays_at_edges_take_most_of_the_noise_away() {
    for (scenario, bound) in [(under_a_sky(), 0.2), (in_closed_form(), 0.2)] {
        let [one, four, eight] = [1, 4, 8].map(|rays| noise(&scenario, &[&format!("camera.rays={rays}")]));
        println!("{}: variance {one:.3e} by one ray, {four:.3e} by 4, {eight:.3e} by 8", scenario.name);
        assert!(eight < four && four < one && eight < bound * one, "{one}, {four}, {eight}");
    }
}
