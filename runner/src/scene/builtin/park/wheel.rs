//! Ferris wheels.

use glam::{Mat4, Vec3, vec3};

use super::Bulbs;
use crate::scene::Motion;
use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::shapes::{MeshBuilder, rotation, sin_cos};

/// Sectors of a Ferris wheel, each with a cabin.
const SECTORS: u32 = 24;
const WHEEL_RADIUS: f32 = 28.0;
/// Half the distance between the two faces of a wheel.
const WHEEL_HALF: f32 = 1.7;

/// The meshes of a Ferris wheel; its own frame has the hub in the origin and the axis along z.
pub(super) struct Wheel {
    sectors: [u32; 2],
    cabins: [u32; 4],
    hub: u32,
    legs: u32,
}

impl Wheel {
    pub(super) fn new(scene: &mut Assembly, bulbs: Bulbs, steel: u32, lacquers: [u32; 4]) -> Self {
        // From the hub to the rim; the two kinds of sector alternate.
        let colors = [
            [Bulbs::GOLD, Bulbs::WHITE, Bulbs::MAGENTA, Bulbs::BLUE, Bulbs::CYAN],
            [Bulbs::GOLD, Bulbs::WHITE, Bulbs::RED, Bulbs::MAGENTA, Bulbs::CYAN],
        ];
        Self {
            sectors: colors.map(|colors| scene.mesh("wheel sector", |m| sector(m, steel, bulbs.of(colors)))),
            cabins: lacquers.map(|lacquer| {
                scene.mesh("cabin", |m| {
                    // Round about the axis of the wheel, because it turns with it.
                    m.ball(Vec3::ZERO, 1.25, 2, lacquer);
                    m.ring(Vec3::ZERO, Vec3::Z, 1.28, 0.09, 32, steel);
                    for bulb in 0..16 {
                        let (sin, cos) = sin_cos((bulb as f32 + 0.5) / 16.0);
                        for z in [-0.62, 0.62] {
                            m.ball(vec3(1.14 * cos, 1.14 * sin, z), 0.09, 1, bulbs.0[Bulbs::WHITE]);
                        }
                    }
                })
            }),
            hub: scene.mesh("hub", |m| {
                m.tube(vec3(0.0, 0.0, -2.6), vec3(0.0, 0.0, 2.6), 1.5, 32, steel);
                for ring in 0..3 {
                    for bulb in 0..12 * (ring + 1) {
                        let (sin, cos) = sin_cos(bulb as f32 / (12 * (ring + 1)) as f32);
                        let radius = 0.45 * (ring + 1) as f32;
                        for z in [-2.62, 2.62] {
                            m.ball(vec3(radius * cos, radius * sin, z), 0.08, 1, bulbs.0[Bulbs::GOLD]);
                        }
                    }
                }
            }),
            legs: scene.mesh("wheel legs", |m| {
                for (x, z) in [(-13.0, -4.5), (13.0, -4.5), (-13.0, 4.5), (13.0, 4.5)] {
                    let (foot, top) = (vec3(x, -WHEEL_RADIUS - 4.0, z), vec3(0.0, 0.0, z * 0.62));
                    m.tube(foot - Vec3::Y * 0.3, top, 0.42, 12, steel);
                    for bulb in 1..60 {
                        let out = vec3(0.0, 0.0, 0.45 * z.signum());
                        m.ball(foot.lerp(top, bulb as f32 / 60.0) + out, 0.08, 1, bulbs.0[Bulbs::WHITE]);
                    }
                }
            }),
        }
    }

    /// Places a wheel whose legs stand on `foot`.
    pub(super) fn place(&self, scene: &mut Assembly, foot: Vec3, size: f32, yaw: f32, turns_per_second: f32) {
        let center = foot + Vec3::Y * ((WHEEL_RADIUS + 4.0) * size);
        let turn = rotation(Vec3::Y, yaw);
        let wheel = Mat4::from_translation(center) * turn * Mat4::from_scale(Vec3::splat(size));
        let axis = turn.transform_vector3(Vec3::Z).normalize();
        let motion = Motion::Turn { center, axis, turns_per_second };
        scene.place(self.legs, wheel);
        scene.place_moving(self.hub, wheel, motion);
        for index in 0..SECTORS {
            let spoke = wheel * rotation(Vec3::Z, index as f32 / SECTORS as f32);
            scene.place_moving(self.sectors[index as usize % 2], spoke, motion);
            let cabin = spoke * Mat4::from_translation(Vec3::X * (WHEEL_RADIUS + 0.4));
            scene.place_moving(self.cabins[index as usize % 4], cabin, motion);
        }
    }
}

/// A spoke along x and its part of the rim, on both faces of the wheel.
fn sector(m: &mut MeshBuilder, steel: u32, colors: [u32; 5]) {
    const SPOKE_BULBS: u32 = 34;
    const RIM_BULBS: u32 = 9;
    let at = |radius: f32, turns: f32, z: f32| {
        let (sin, cos) = sin_cos(turns);
        vec3(radius * cos, radius * sin, z)
    };
    let step = 1.0 / SECTORS as f32;
    let inner = WHEEL_RADIUS - 3.0;
    for z in [-WHEEL_HALF, WHEEL_HALF] {
        m.tube(at(1.3, 0.0, z), at(WHEEL_RADIUS + 0.2, 0.0, z), 0.09, 8, steel);
        m.tube(at(WHEEL_RADIUS, 0.0, z), at(WHEEL_RADIUS, step, z), 0.14, 8, steel);
        m.tube(at(inner, 0.0, z), at(inner, step, z), 0.10, 8, steel);
        m.tube(at(inner, 0.0, z), at(WHEEL_RADIUS, step, z), 0.06, 6, steel);

        let out = z + 0.14 * z.signum();
        for bulb in 0..SPOKE_BULBS {
            let t = (bulb as f32 + 0.5) / SPOKE_BULBS as f32;
            let radius = 1.8 + (WHEEL_RADIUS - 2.2) * t;
            m.ball(at(radius, 0.0, out), 0.11, 1, colors[((t * 5.0) as usize).min(4)]);
        }
        for bulb in 0..RIM_BULBS {
            let turns = step * (bulb as f32 + 0.5) / RIM_BULBS as f32;
            // The chord's sag is below a bulb's radius at the ends and three of them in the middle.
            let chord = |radius: f32| radius * sin_cos(0.5 * step).1 / sin_cos(turns - 0.5 * step).1;
            m.ball(at(chord(WHEEL_RADIUS), turns, out + 0.05 * z.signum()), 0.12, 1, colors[4]);
            m.ball(at(chord(inner), turns, out), 0.10, 1, colors[3]);
        }
    }
    m.tube(at(WHEEL_RADIUS, 0.0, -WHEEL_HALF), at(WHEEL_RADIUS, 0.0, WHEEL_HALF), 0.09, 8, steel);
}
