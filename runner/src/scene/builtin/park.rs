//! An amusement park at night: 3.4 million emissive triangles, many of them on the move.

mod coaster;
mod grounds;
mod rides;
mod wheel;

use glam::{Mat4, Vec2, Vec3, vec2, vec3};

use super::assembly::Assembly;
use super::random::Pcg;
use super::shapes::rotation;
use crate::scene::{Camera, Scene};
use grounds::Grounds;

/// Emissive triangles over all instances; trees are planted until there are as many, to within one tree.
const EMISSIVE_TRIANGLES: usize = 3_400_000;

/// The lanes run along z, at these x, between rows of stalls.
const LANES: [f32; 3] = [0.0, -36.0, 36.0];
const LANE_START: f32 = 48.0;
const STALLS_A_SIDE: u32 = 15;
const STALL_PITCH: f32 = 6.0;
/// From the middle of a lane to the middle of a stall.
const STALL_OFFSET: f32 = 7.5;

/// Colours of bulbs.
const COLORS: [(&str, [f32; 3]); 8] = [
    ("white", [1.0, 0.66, 0.32]),
    ("gold", [1.0, 0.40, 0.06]),
    ("red", [1.0, 0.020, 0.012]),
    ("orange", [1.0, 0.14, 0.012]),
    ("green", [0.030, 0.80, 0.05]),
    ("cyan", [0.015, 0.55, 0.80]),
    ("blue", [0.025, 0.06, 1.0]),
    ("magenta", [1.0, 0.025, 0.42]),
];
/// Radiance of a bulb whose colour has a channel of 1.
const BULB_RADIANCE: f32 = 36.0;

/// A bulb material for each of [`COLORS`].
#[derive(Clone, Copy)]
struct Bulbs([u32; COLORS.len()]);

impl Bulbs {
    const WHITE: usize = 0;
    const GOLD: usize = 1;
    const RED: usize = 2;
    const ORANGE: usize = 3;
    const GREEN: usize = 4;
    const CYAN: usize = 5;
    const BLUE: usize = 6;
    const MAGENTA: usize = 7;

    fn of<const N: usize>(self, colors: [usize; N]) -> [u32; N] {
        colors.map(|color| self.0[color])
    }
}

/// Where a ride stands and how much room it needs: no tree is planted there.
#[derive(Clone, Copy)]
struct Plot {
    center: Vec2,
    radius: f32,
}

/// Lanes of stalls between trees, with the rides behind them; the camera looks down the middle lane.
pub fn build() -> Scene {
    let mut scene = Assembly::new("park");
    let mut rng = Pcg::new(1893);
    let bulbs = Bulbs(COLORS.map(|(name, tint)| scene.lamp(&format!("{name} bulb"), tint, BULB_RADIANCE)));

    let grounds = Grounds::new(&mut scene, bulbs, &mut rng);
    grounds.floor(&mut scene);
    for lane in LANES {
        grounds.lane(&mut scene, lane, &mut rng);
    }
    let mut plots = rides::place(&mut scene, bulbs, &mut rng);
    plots.extend(coaster::place(&mut scene, bulbs));
    plant(&mut scene, &grounds, &plots, &mut rng);

    scene.finish(Camera { origin: vec3(1.2, 3.0, 55.0), target: vec3(-3.5, 9.0, 0.0), up: Vec3::Y, vfov_deg: 52.0 })
}

/// Plants trees wherever there is room until the park has its number of lights.
fn plant(scene: &mut Assembly, grounds: &Grounds, plots: &[Plot], rng: &mut Pcg) {
    const SPACING: f32 = 4.6;
    let mut missing = EMISSIVE_TRIANGLES.saturating_sub(scene.emissive_triangles());
    let mut trees: Vec<Vec2> = Vec::new();
    // Room for twice as many trees as are wanted, so this many tries are plenty.
    for _ in 0..40_000 {
        let at = vec2(rng.between(-115.0, 115.0), rng.between(-82.0, 62.0));
        let in_lane = LANES.iter().any(|lane| (at.x - lane).abs() < STALL_OFFSET + 4.2) && at.y > -52.0;
        let in_plot = plots.iter().any(|plot| at.distance(plot.center) < plot.radius + 2.5);
        let is_crowded = trees.iter().any(|tree| at.distance(*tree) < SPACING);
        if in_lane || in_plot || is_crowded {
            continue;
        }
        let tree = rng.pick(&grounds.trees);
        let lights = scene.emissive_triangles_of(tree);
        if missing < lights / 2 {
            return;
        }
        missing = missing.saturating_sub(lights);
        trees.push(at);
        let size = vec3(rng.between(0.85, 1.15), rng.between(0.85, 1.4), rng.between(0.85, 1.15));
        let foot = Mat4::from_translation(vec3(at.x, 0.0, at.y));
        scene.place(tree, foot * rotation(Vec3::Y, rng.unit()) * Mat4::from_scale(size));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Motion;

    #[test]
    fn unique_geometry_is_small_and_instances_are_many() {
        let scene = build();
        let unique: usize = scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
        assert!(unique < 250_000, "{unique} triangles");
        assert!((1_000..=10_000).contains(&scene.instances.len()), "{} instances", scene.instances.len());
    }

    #[test]
    fn wheels_turn_and_cars_swing() {
        let scene = build();
        let turning = scene.instances.iter().filter(|i| matches!(i.motion, Motion::Turn { .. })).count();
        let swinging = scene.instances.iter().filter(|i| matches!(i.motion, Motion::Swing { .. })).count();
        assert!(turning >= 100 && swinging >= 20, "{turning} turn, {swinging} swing");
    }

    #[test]
    fn a_turning_wheel_stays_a_wheel() {
        let scene = build();
        for instance in &scene.instances {
            if let Motion::Turn { center, axis, .. } = instance.motion {
                assert!(axis.is_normalized());
                let distance =
                    |time_s: f32| instance.world_from_object_at(time_s).transform_point3(Vec3::X).distance(center);
                assert!((distance(0.0) - distance(7.3)).abs() < 1e-3);
            }
        }
    }
}
