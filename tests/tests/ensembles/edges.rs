//! Pixels at the edges of lights and of the sky, and between surfaces whose light has a closed form, have several camera rays:
//! for less noise, and with the mean of one.

use glam::Vec3;
use weir::technique::Technique;

use crate::{
    Bench, TIERS,
    options::noise_of,
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

#[test]
fn rays_at_edges_take_most_of_the_noise_away() {
    for scenario in [under_a_sky(), in_closed_form()] {
        let noise = |rays: u32| noise_of(&scenario, Technique::Still, &[&format!("camera.rays={rays}")]);
        let [one, four, eight] = [1, 4, 8].map(noise);
        println!("{}: variance {one:.3e} by one ray, {four:.3e} by 4, {eight:.3e} by 8", scenario.name);
        assert!(eight < four && four < one && eight < 0.2 * one, "{one}, {four}, {eight}");
    }
}
