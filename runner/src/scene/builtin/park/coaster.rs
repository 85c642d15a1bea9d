//! A roller coaster around the back of the park.

use glam::{Mat4, Vec3, vec2, vec3};

use super::{Bulbs, Plot};
use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::shapes::{MeshBuilder, sin_cos};

/// Pieces of track, each straight.
const PIECES: u32 = 150;
/// Length of a piece in its mesh; placing it stretches it by a few per cent.
const PIECE_LENGTH: f32 = 4.0;

/// The closed curve of the track, `t` in 0..1.
fn track(t: f32) -> Vec3 {
    let (sin, cos) = sin_cos(t);
    let hills = 9.0 * sin_cos(3.0 * t + 0.15).0 + 5.0 * sin_cos(7.0 * t).0;
    vec3(8.0 + 105.0 * cos, 17.0 + hills, -132.0 + 45.0 * sin)
}

/// Builds and places the coaster; returns the ground it takes.
pub(super) fn place(scene: &mut Assembly, bulbs: Bulbs) -> Option<Plot> {
    let red = scene.glossy("red steel", [0.5, 0.05, 0.04], 0.3);
    let white = scene.glossy("white paint", [0.65, 0.64, 0.6], 0.35);
    let pieces = [[Bulbs::GOLD, Bulbs::WHITE], [Bulbs::ORANGE, Bulbs::GOLD], [Bulbs::GREEN, Bulbs::WHITE]]
        .map(|colors| scene.mesh("track", |m| piece(m, red, bulbs.of(colors))));
    let pillar = scene.mesh("pillar", |m| m.tube(vec3(0.0, -0.01, 0.0), Vec3::Y, 0.22, 10, white));

    for index in 0..PIECES {
        let (from, to) = (track(index as f32 / PIECES as f32), track((index + 1) as f32 / PIECES as f32));
        let along = to - from;
        let forward = along.normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let piece = Mat4::from_cols(
            right.extend(0.0),
            right.cross(forward).extend(0.0),
            (-along / PIECE_LENGTH).extend(0.0),
            from.extend(1.0),
        );
        scene.place(pieces[(index / 10) as usize % pieces.len()], piece);
        if index % 2 == 0 {
            let foot = vec3(from.x, 0.0, from.z);
            let height = vec3(1.0, from.y - 0.35, 1.0);
            scene.place(pillar, Mat4::from_translation(foot) * Mat4::from_scale(height));
        }
    }
    Some(Plot { center: vec2(8.0, -132.0), radius: 50.0 })
}

/// Rails, ties and two rows of bulbs, from the origin towards -z.
fn piece(m: &mut MeshBuilder, steel: u32, colors: [u32; 2]) {
    for x in [-0.6, 0.6] {
        m.tube(vec3(x, 0.0, 0.03), vec3(x, 0.0, -PIECE_LENGTH - 0.03), 0.08, 8, steel);
    }
    m.tube(vec3(0.0, -0.4, 0.05), vec3(0.0, -0.4, -PIECE_LENGTH - 0.05), 0.16, 8, steel);
    for tie in 0..4 {
        let z = -PIECE_LENGTH * (tie as f32 + 0.5) / 4.0;
        for x in [-0.6, 0.6] {
            m.tube(vec3(0.0, -0.4, z), vec3(x, 0.0, z), 0.05, 6, steel);
        }
    }
    for bulb in 0..10 {
        let z = -PIECE_LENGTH * (bulb as f32 + 0.5) / 10.0;
        for x in [-0.74, 0.74] {
            m.ball(vec3(x, 0.06, z), 0.1, 1, colors[bulb % 2]);
        }
    }
}
