//! Carousels, drop towers and bumper cars, and where all the rides stand.

use glam::{Mat4, Vec3, vec2, vec3};

use super::wheel::Wheel;
use super::{Bulbs, Plot};
use crate::scene::Motion;
use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::random::Pcg;
use crate::scene::builtin::shapes::{MeshBuilder, on_circle, rotation};

/// Builds and places all rides but the coaster; returns the ground they take.
pub(super) fn place(scene: &mut Assembly, bulbs: Bulbs, rng: &mut Pcg) -> Vec<Plot> {
    let steel = scene.metal("white steel", [0.70, 0.70, 0.72], 0.35);
    let gold = scene.metal("gilding", [0.85, 0.60, 0.25], 0.25);
    let lacquers = [[0.55, 0.05, 0.06], [0.06, 0.16, 0.45], [0.06, 0.36, 0.18], [0.60, 0.36, 0.05]]
        .map(|color| scene.glossy("lacquer", color, 0.2));
    let cream = scene.glossy("cream lacquer", [0.70, 0.62, 0.48], 0.25);

    let wheel = Wheel::new(scene, bulbs, steel, lacquers);
    let carousel = Carousel::new(scene, bulbs, [lacquers[0], cream, gold], lacquers);
    let tower = Tower::new(scene, bulbs, steel, lacquers[1]);
    let arena = Arena::new(scene, bulbs, steel, lacquers);

    let mut plots = Vec::new();
    let mut plot = |at: Vec3, radius: f32| plots.push(Plot { center: vec2(at.x, at.z), radius });
    for (at, size, yaw, turns_per_second) in
        [(vec3(-27.0, 0.0, -66.0), 1.0, 0.06, 0.012), (vec3(62.0, 0.0, -62.0), 0.62, -0.09, -0.02)]
    {
        wheel.place(scene, at, size, yaw, turns_per_second);
        plot(at, 16.0 * size);
    }
    for at in [vec3(18.0, 0.0, -62.0), vec3(-18.5, 0.0, 14.0), vec3(18.5, 0.0, -8.0), vec3(60.0, 0.0, 20.0)] {
        carousel.place(scene, at, rng);
        plot(at, 6.5);
    }
    for (at, phase) in [(vec3(25.0, 0.0, -84.0), 0.1), (vec3(-66.0, 0.0, -40.0), 0.6)] {
        tower.place(scene, at, phase);
        plot(at, 6.0);
    }
    for at in [vec3(-64.0, 0.0, 10.0), vec3(62.0, 0.0, -18.0)] {
        arena.place(scene, at, rng);
        plot(at, 13.0);
    }
    plots
}

struct Carousel {
    body: u32,
    base: u32,
    horses: [u32; 4],
}

impl Carousel {
    fn new(scene: &mut Assembly, bulbs: Bulbs, [red, cream, gold]: [u32; 3], lacquers: [u32; 4]) -> Self {
        Self {
            base: scene.mesh("carousel base", |m| m.tube(vec3(0.0, -0.05, 0.0), vec3(0.0, 0.2, 0.0), 6.4, 48, cream)),
            body: scene.mesh("carousel", |m| {
                m.tube(vec3(0.0, 0.21, 0.0), vec3(0.0, 0.4, 0.0), 6.0, 48, cream);
                m.tube(vec3(0.0, 0.39, 0.0), vec3(0.0, 4.6, 0.0), 1.1, 24, gold);
                m.tube(vec3(0.0, 4.0, 0.0), vec3(0.0, 4.55, 0.0), 6.15, 48, cream);
                m.frustum((vec3(0.0, 4.5, 0.0), 6.4), (vec3(0.0, 6.6, 0.0), 0.5), 24, 1, red);
                m.ball(vec3(0.0, 6.8, 0.0), 0.4, 2, gold);
                let row = bulbs.of([Bulbs::WHITE, Bulbs::GOLD, Bulbs::WHITE, Bulbs::RED]);
                for rib in 0..24 {
                    for bulb in 0..9 {
                        let t = (bulb as f32 + 0.5) / 9.0;
                        // Ribs are the edges of the 24-sided roof.
                        let foot = on_circle(6.44 + (0.54 - 6.44) * t, (rib as f32 + 0.5) / 24.0);
                        m.ball(foot + Vec3::Y * (4.54 + 2.1 * t), 0.07, 1, row[rib % 4]);
                    }
                }
                for bulb in 0..60 {
                    let foot = on_circle(6.17, bulb as f32 / 60.0);
                    m.ball(foot + Vec3::Y * 4.28, 0.08, 1, row[bulb % 2]);
                    m.ball(foot * 0.955 + Vec3::Y * 3.97, 0.06, 1, row[0]);
                }
                for ring in 0..5 {
                    for bulb in 0..10 {
                        let foot = on_circle(1.11, (bulb as f32 + 0.5 * (ring % 2) as f32) / 10.0);
                        m.ball(foot + Vec3::Y * (1.0 + 0.65 * ring as f32), 0.07, 1, row[1]);
                    }
                }
            }),
            horses: lacquers.map(|coat| scene.mesh("horse", |m| horse(m, coat, gold, bulbs.0[Bulbs::WHITE]))),
        }
    }

    fn place(&self, scene: &mut Assembly, foot: Vec3, rng: &mut Pcg) {
        let motion = Motion::Turn { center: foot, axis: Vec3::Y, turns_per_second: 0.07 };
        let at = Mat4::from_translation(foot);
        scene.place(self.base, at);
        scene.place_moving(self.body, at, motion);
        for (radius, count) in [(3.1, 10), (4.9, 16)] {
            for index in 0..count {
                let turns = index as f32 / count as f32;
                let seat = at * rotation(Vec3::Y, turns) * Mat4::from_translation(vec3(radius, 0.4, 0.0));
                let size = vec3(rng.between(0.9, 1.1), 1.0, rng.between(0.85, 1.1));
                scene.place_moving(rng.pick(&self.horses), seat * Mat4::from_scale(size), motion);
            }
        }
    }
}

/// A wooden horse on a pole from floor to roof, galloping towards -z.
fn horse(m: &mut MeshBuilder, coat: u32, gold: u32, bulb: u32) {
    m.tube(vec3(0.0, -0.02, 0.0), vec3(0.0, 3.65, 0.0), 0.03, 10, gold);
    m.ellipsoid(vec3(0.0, 1.15, 0.0), vec3(0.24, 0.28, 0.55), 2, coat);
    m.ellipsoid(vec3(0.0, 1.42, 0.02), vec3(0.2, 0.08, 0.22), 1, gold);
    m.frustum((vec3(0.0, 1.25, -0.35), 0.19), (vec3(0.0, 1.78, -0.68), 0.11), 12, 1, coat);
    m.ellipsoid(vec3(0.0, 1.77, -0.8), vec3(0.1, 0.12, 0.24), 1, coat);
    for (x, z, reach) in [(-0.13, -0.4, -0.25), (0.13, -0.4, -0.05), (-0.13, 0.42, 0.1), (0.13, 0.42, 0.3)] {
        m.frustum((vec3(x, 1.05, z), 0.1), (vec3(x, 0.45, z + reach), 0.045), 8, 1, coat);
    }
    m.frustum((vec3(0.0, 1.25, 0.5), 0.07), (vec3(0.0, 0.8, 0.75), 0.0), 8, 1, gold);
    for index in 0..6 {
        m.ball(vec3(0.05, 2.1 + 0.24 * index as f32, 0.0), 0.045, 1, bulb);
    }
}

struct Tower {
    storey: u32,
    car: u32,
    top: u32,
}

impl Tower {
    const STOREYS: u32 = 11;
    const STOREY_HEIGHT: f32 = 4.0;

    fn new(scene: &mut Assembly, bulbs: Bulbs, steel: u32, lacquer: u32) -> Self {
        Self {
            storey: scene.mesh("tower storey", |m| {
                let corner = |side: u32, y: f32| on_circle(1.1, side as f32 / 4.0 + 0.125) + Vec3::Y * y;
                for side in 0..4 {
                    m.tube(corner(side, -0.02), corner(side, Self::STOREY_HEIGHT), 0.1, 8, steel);
                    m.tube(corner(side, 0.1), corner(side + 1, Self::STOREY_HEIGHT - 0.1), 0.05, 6, steel);
                    m.tube(corner(side, 0.1), corner(side + 1, 0.1), 0.05, 6, steel);
                    let colors = bulbs.of([Bulbs::BLUE, Bulbs::CYAN, Bulbs::WHITE, Bulbs::MAGENTA]);
                    for bulb in 0..8 {
                        let at = corner(side, Self::STOREY_HEIGHT * (bulb as f32 + 0.5) / 8.0);
                        m.ball(at * vec3(1.12, 1.0, 1.12), 0.1, 1, colors[bulb % 4]);
                    }
                }
            }),
            car: scene.mesh("tower car", |m| {
                m.ring(Vec3::ZERO, Vec3::Y, 2.1, 0.45, 40, lacquer);
                m.ring(Vec3::Y * 1.0, Vec3::Y, 1.75, 0.18, 40, steel);
                for bulb in 0..48 {
                    let foot = on_circle(1.0, bulb as f32 / 48.0);
                    m.ball(foot * 2.58, 0.08, 1, bulbs.0[if bulb % 2 == 0 { Bulbs::GOLD } else { Bulbs::RED }]);
                    m.ball(foot * 1.95 + Vec3::Y, 0.08, 1, bulbs.0[Bulbs::WHITE]);
                }
            }),
            top: scene.mesh("tower top", |m| {
                m.frustum((Vec3::ZERO, 2.0), (Vec3::Y * 3.0, 0.0), 24, 2, lacquer);
                for bulb in 0..40 {
                    m.ball(on_circle(2.05, bulb as f32 / 40.0), 0.1, 1, bulbs.0[Bulbs::RED]);
                }
            }),
        }
    }

    fn place(&self, scene: &mut Assembly, foot: Vec3, phase: f32) {
        let height = Self::STOREYS as f32 * Self::STOREY_HEIGHT;
        let at = |y: f32| Mat4::from_translation(foot + Vec3::Y * y);
        for storey in 0..Self::STOREYS {
            scene.place(self.storey, at(storey as f32 * Self::STOREY_HEIGHT));
        }
        scene.place(self.top, at(height - 0.1));
        let motion = Motion::Swing { offset: Vec3::Y * (0.42 * height), frequency_hz: 0.09, phase };
        scene.place_moving(self.car, at(0.5 * height), motion);
    }
}

struct Arena {
    hall: u32,
    cars: [u32; 4],
}

impl Arena {
    fn new(scene: &mut Assembly, bulbs: Bulbs, steel: u32, lacquers: [u32; 4]) -> Self {
        let floor = scene.glossy("arena floor", [0.08, 0.08, 0.09], 0.18);
        Self {
            hall: scene.mesh("arena", |m| {
                m.cuboid(vec3(-9.0, -0.05, -7.0), vec3(9.0, 0.3, 7.0), floor);
                m.cuboid(vec3(-9.5, 4.0, -7.5), vec3(9.5, 4.4, 7.5), steel);
                for (x, z) in [(-8.8, -6.8), (8.8, -6.8), (-8.8, 6.8), (8.8, 6.8)] {
                    m.tube(vec3(x, 0.2, z), vec3(x, 4.1, z), 0.14, 10, steel);
                }
                let colors = bulbs.of([Bulbs::GREEN, Bulbs::WHITE, Bulbs::MAGENTA, Bulbs::GOLD]);
                for i in 0..48 {
                    let t = -9.4 + 0.4 * i as f32;
                    for z in [-7.52, 7.52] {
                        m.ball(vec3(t, 4.2, z), 0.1, 1, colors[i % 4]);
                    }
                    if i % 3 == 1 {
                        for z in [-5.0, -2.5, 0.0, 2.5, 5.0] {
                            m.ball(vec3(t * 0.93, 3.95, z), 0.07, 1, colors[(i / 3) % 4]);
                        }
                    }
                }
            }),
            cars: lacquers.map(|lacquer| {
                scene.mesh("bumper car", |m| {
                    m.ellipsoid(vec3(0.0, 0.35, 0.0), vec3(0.6, 0.33, 0.95), 2, lacquer);
                    m.tube(vec3(0.0, 0.07, 0.0), vec3(0.0, 0.3, 0.0), 0.85, 24, steel);
                    m.tube(vec3(0.0, 0.4, 0.7), vec3(0.0, 3.6, 0.8), 0.02, 8, steel);
                    for bulb in 0..12 {
                        let at = on_circle(0.87, bulb as f32 / 12.0) + Vec3::Y * 0.2;
                        m.ball(at, 0.045, 1, bulbs.0[Bulbs::CYAN]);
                    }
                })
            }),
        }
    }

    fn place(&self, scene: &mut Assembly, foot: Vec3, rng: &mut Pcg) {
        scene.place(self.hall, Mat4::from_translation(foot));
        for lane in 0..5 {
            for column in 0..3 {
                // Each keeps to its own strip, so that none runs through another.
                let at = foot + vec3(-5.6 + 5.6 * column as f32, 0.3, -5.2 + 2.6 * lane as f32);
                let motion = Motion::Swing {
                    offset: vec3(rng.between(0.8, 1.6), 0.0, 0.0),
                    frequency_hz: rng.between(0.1, 0.25),
                    phase: rng.unit(),
                };
                let car = Mat4::from_translation(at) * rotation(Vec3::Y, 0.25);
                scene.place_moving(rng.pick(&self.cars), car, motion);
            }
        }
    }
}
