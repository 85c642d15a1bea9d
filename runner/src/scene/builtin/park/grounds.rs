//! The ground, the lanes of stalls with strings of bulbs above them, trees and lamp posts.

use glam::{Mat4, Vec3, vec3};

use super::{Bulbs, LANE_START, STALL_OFFSET, STALL_PITCH, STALLS_A_SIDE};
use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::random::Pcg;
use crate::scene::builtin::shapes::{MeshBuilder, on_circle, rotation, sin_cos};

/// Height of the posts that the strings hang from.
const POST_HEIGHT: f32 = 5.2;
/// From the middle of a lane to its posts.
const POST_OFFSET: f32 = 5.2;

/// Meshes of everything but the rides.
pub(super) struct Grounds {
    ground: u32,
    stalls: [u32; 5],
    strings: [u32; 4],
    post: u32,
    lamp_post: u32,
    bench: u32,
    figures: [u32; 3],
    pub(super) trees: [u32; 6],
}

impl Grounds {
    pub(super) fn new(scene: &mut Assembly, bulbs: Bulbs, rng: &mut Pcg) -> Self {
        let asphalt = scene.glossy("wet asphalt", [0.13, 0.125, 0.12], 0.3);
        let wood = scene.glossy("painted wood", [0.45, 0.30, 0.18], 0.4);
        let steel = scene.metal("painted steel", [0.25, 0.26, 0.28], 0.4);
        let canvas = scene.matte("white canvas", [0.75, 0.72, 0.66]);
        let awnings =
            [[0.62, 0.06, 0.05], [0.06, 0.20, 0.50], [0.07, 0.38, 0.16], [0.68, 0.42, 0.05], [0.40, 0.08, 0.40]]
                .map(|color| scene.matte("coloured canvas", color));
        let toys = [[0.7, 0.1, 0.1], [0.8, 0.6, 0.1], [0.1, 0.4, 0.7], [0.2, 0.6, 0.2], [0.8, 0.3, 0.5]]
            .map(|color| scene.glossy("toy", color, 0.25));
        let ceiling_lamp = scene.lamp("stall lamp", [1.0, 0.68, 0.38], 12.0);
        let globe = scene.lamp("street lamp", [1.0, 0.66, 0.34], 14.0);
        let bark = scene.matte("bark", [0.16, 0.11, 0.07]);
        let foliage = scene.matte("foliage", [0.06, 0.13, 0.04]);
        let coats = [[0.25, 0.06, 0.06], [0.08, 0.10, 0.20], [0.22, 0.20, 0.16]].map(|c| scene.matte("coat", c));
        let skin = scene.matte("skin", [0.5, 0.34, 0.26]);

        let trims = [
            bulbs.of([Bulbs::WHITE, Bulbs::RED]),
            bulbs.of([Bulbs::WHITE, Bulbs::BLUE]),
            bulbs.of([Bulbs::GOLD, Bulbs::GREEN]),
            bulbs.of([Bulbs::GOLD, Bulbs::ORANGE]),
            bulbs.of([Bulbs::CYAN, Bulbs::MAGENTA]),
        ];
        let strings = [
            bulbs.of([Bulbs::WHITE; 4]),
            bulbs.of([Bulbs::RED, Bulbs::GOLD, Bulbs::GREEN, Bulbs::BLUE]),
            bulbs.of([Bulbs::GOLD, Bulbs::ORANGE, Bulbs::GOLD, Bulbs::WHITE]),
            bulbs.of([Bulbs::MAGENTA, Bulbs::CYAN, Bulbs::WHITE, Bulbs::BLUE]),
        ];
        let fairy_lights = [
            bulbs.of([Bulbs::WHITE; 3]),
            bulbs.of([Bulbs::GOLD, Bulbs::WHITE, Bulbs::ORANGE]),
            bulbs.of([Bulbs::BLUE, Bulbs::CYAN, Bulbs::BLUE]),
            bulbs.of([Bulbs::RED, Bulbs::GREEN, Bulbs::GOLD]),
            bulbs.of([Bulbs::MAGENTA, Bulbs::MAGENTA, Bulbs::BLUE]),
            bulbs.of([Bulbs::GREEN, Bulbs::CYAN, Bulbs::WHITE]),
        ];
        Self {
            ground: scene.mesh("ground", |m| {
                m.grid(vec3(-400.0, 0.0, 400.0), Vec3::X * 800.0, Vec3::Z * -800.0, 32, 32, asphalt);
            }),
            stalls: [0, 1, 2, 3, 4].map(|kind| {
                let look = StallLook { wood, canvas, awning: awnings[kind], lamp: ceiling_lamp, trim: trims[kind] };
                scene.mesh("stall", |m| stall(m, rng, look, &toys))
            }),
            strings: strings.map(|colors| scene.mesh("string of bulbs", |m| string(m, steel, &colors))),
            post: scene.mesh("post", |m| {
                m.frustum((vec3(0.0, -0.05, 0.0), 0.08), (vec3(0.0, POST_HEIGHT + 0.15, 0.0), 0.05), 10, 1, steel);
                m.ball(vec3(0.0, POST_HEIGHT + 0.2, 0.0), 0.1, 1, bulbs.0[Bulbs::WHITE]);
            }),
            lamp_post: scene.mesh("lamp post", |m| {
                m.tube(vec3(0.0, -0.05, 0.0), vec3(0.0, 0.25, 0.0), 0.14, 12, steel);
                m.frustum((vec3(0.0, 0.2, 0.0), 0.06), (vec3(0.0, 3.35, 0.0), 0.04), 10, 1, steel);
                for side in 0..3 {
                    let away = on_circle(0.42, side as f32 / 3.0);
                    m.tube(vec3(0.0, 3.1, 0.0), away + Vec3::Y * 3.3, 0.02, 8, steel);
                    m.ball(away + Vec3::Y * 3.44, 0.16, 2, globe);
                }
            }),
            bench: scene.mesh("bench", |m| {
                m.cuboid(vec3(-0.9, 0.42, -0.22), vec3(0.9, 0.47, 0.22), wood);
                m.cuboid(vec3(-0.9, 0.6, -0.3), vec3(0.9, 0.9, -0.26), wood);
                for x in [-0.7, 0.66] {
                    m.cuboid(vec3(x, -0.02, -0.27), vec3(x + 0.04, 0.43, 0.18), steel);
                    m.cuboid(vec3(x, 0.42, -0.29), vec3(x + 0.04, 0.85, -0.255), steel);
                }
            }),
            figures: coats.map(|coat| {
                scene.mesh("visitor", |m| {
                    for x in [-0.09, 0.09] {
                        m.frustum((vec3(x, -0.01, 0.0), 0.06), (vec3(x, 0.8, 0.0), 0.09), 8, 1, steel);
                    }
                    m.frustum((vec3(0.0, 0.62, 0.0), 0.24), (vec3(0.0, 1.42, 0.0), 0.13), 12, 1, coat);
                    for x in [-0.22, 0.22] {
                        m.tube(vec3(x * 0.7, 1.36, 0.0), vec3(x * 1.2, 0.82, 0.06), 0.055, 8, coat);
                    }
                    m.ellipsoid(vec3(0.0, 1.6, 0.0), vec3(0.1, 0.13, 0.11), 1, skin);
                    m.ellipsoid(vec3(0.0, 1.66, -0.02), vec3(0.115, 0.1, 0.12), 1, bark);
                })
            }),
            trees: fairy_lights.map(|colors| scene.mesh("tree", |m| tree(m, rng, bark, foliage, &colors))),
        }
    }

    pub(super) fn floor(&self, scene: &mut Assembly) {
        scene.place(self.ground, Mat4::IDENTITY);
    }

    /// Two rows of stalls along -z with everything between them.
    pub(super) fn lane(&self, scene: &mut Assembly, x: f32, rng: &mut Pcg) {
        for row in 0..STALLS_A_SIDE {
            let z = LANE_START - STALL_PITCH * row as f32;
            for (side, turn) in [(-1.0, 0.25), (1.0, -0.25)] {
                let at = |away: f32, dz: f32| Mat4::from_translation(vec3(x + side * away, 0.0, z + dz));
                let size = vec3(1.0, rng.between(0.95, 1.1), 1.0);
                let stall = at(STALL_OFFSET, 0.0) * rotation(Vec3::Y, turn) * Mat4::from_scale(size);
                scene.place(rng.pick(&self.stalls), stall);
                scene.place(self.post, at(POST_OFFSET, 0.5 * STALL_PITCH));
                if row % 3 == 1 {
                    scene.place(self.lamp_post, at(POST_OFFSET - 0.7, 0.5 * STALL_PITCH));
                } else if rng.chance(0.6) {
                    let bench = at(POST_OFFSET - 0.9, 0.5 * STALL_PITCH + rng.between(-0.8, 0.8));
                    scene.place(self.bench, bench * rotation(Vec3::Y, turn));
                }
                self.string(scene, rng, vec3(x, POST_HEIGHT, z + 0.5 * STALL_PITCH), side);
            }
            for _ in 0..3 {
                let foot = vec3(x + rng.between(-3.2, 3.2), 0.0, z + rng.between(-3.0, 3.0));
                let size = Mat4::from_scale(Vec3::splat(rng.between(0.85, 1.08)));
                let visitor = rng.pick(&self.figures);
                scene.place(visitor, Mat4::from_translation(foot) * rotation(Vec3::Y, rng.unit()) * size);
            }
        }
    }

    /// A string from a post to the one across the lane, one pitch further: two of them cross in the middle.
    fn string(&self, scene: &mut Assembly, rng: &mut Pcg, middle: Vec3, side: f32) {
        let from = middle + Vec3::X * (side * POST_OFFSET);
        let to = middle - Vec3::X * (side * POST_OFFSET) - Vec3::Z * STALL_PITCH;
        let along = to - from;
        // The second string of a pair hangs lower, so that the wires do not meet.
        let sag = 1.0 + 0.15 * side;
        let frame = Mat4::from_cols(
            along.extend(0.0),
            (Vec3::Y * sag).extend(0.0),
            along.normalize().cross(Vec3::Y).extend(0.0),
            from.extend(1.0),
        );
        // The mesh is one unit long in x alone; its bulbs are squeezed there to be round in the world.
        debug_assert!((along.length() - STRING_LENGTH).abs() < 0.05);
        scene.place(rng.pick(&self.strings), frame);
    }
}

/// Length of a string in the world; in its mesh it is 1.
const STRING_LENGTH: f32 = 12.01;

/// Bulbs below a wire that sags by 1, from the origin to +x.
fn string(m: &mut MeshBuilder, wire: u32, colors: &[u32]) {
    const BULBS: u32 = 36;
    let point = |t: f32| vec3(t, -4.0 * t * (1.0 - t), 0.0);
    let squeeze = vec3(1.0 / STRING_LENGTH, 1.0, 1.0);
    for piece in 0..12 {
        let (from, to) = (point(piece as f32 / 12.0), point((piece + 1) as f32 / 12.0));
        let side = vec3(0.0, 0.008, 0.0);
        // A ribbon of two faces is as good as a rod at this size, but a rod is closed.
        m.cuboid_in(beam(from, to), vec3(0.0, -side.y, -0.008), vec3(1.0, side.y, 0.008), wire);
    }
    for bulb in 0..BULBS {
        let at = point((bulb as f32 + 0.5) / BULBS as f32) - Vec3::Y * 0.07;
        m.ellipsoid(at, squeeze * 0.065, 1, colors[(bulb / 2) as usize % colors.len()]);
    }
}

/// A frame whose x axis goes from one point to another in the xy plane; sheared, so that ends stay upright.
fn beam(from: Vec3, to: Vec3) -> Mat4 {
    Mat4::from_cols((to - from).extend(0.0), Vec3::Y.extend(0.0), Vec3::Z.extend(0.0), from.extend(1.0))
}

/// Materials of a stall.
#[derive(Clone, Copy)]
struct StallLook {
    wood: u32,
    canvas: u32,
    awning: u32,
    lamp: u32,
    trim: [u32; 2],
}

/// 4.4 m wide and 2.8 m deep, facing +z.
fn stall(m: &mut MeshBuilder, rng: &mut Pcg, look: StallLook, toys: &[u32]) {
    m.cuboid(vec3(-2.1, -0.02, 1.0), vec3(2.1, 1.0, 1.3), look.wood);
    m.cuboid(vec3(-2.25, 0.99, 0.9), vec3(2.25, 1.06, 1.45), look.wood);
    m.cuboid(vec3(-2.15, -0.02, -1.35), vec3(2.15, 2.55, -1.25), look.wood);
    for x in [-2.18, 2.08] {
        m.cuboid(vec3(x, -0.03, -1.36), vec3(x + 0.1, 2.7, -1.26), look.wood);
        m.cuboid(vec3(x, -0.03, 1.2), vec3(x + 0.1, 2.7, 1.31), look.wood);
    }
    // Eight stripes in a roof that falls to the front.
    let roof = Mat4::from_translation(vec3(0.0, 2.75, 0.0)) * rotation(Vec3::X, 0.03);
    for stripe in 0..8 {
        let x = -2.4 + 0.6 * stripe as f32;
        let material = if stripe % 2 == 0 { look.awning } else { look.canvas };
        m.cuboid_in(roof, vec3(x, -0.03, -1.6), vec3(x + 0.6, 0.03, 1.8), material);
        m.cuboid_in(roof, vec3(x, -0.35, 1.76), vec3(x + 0.6, -0.02, 1.8), material);
    }
    m.grid(vec3(-1.5, 2.6, -0.5), Vec3::X * 3.0, Vec3::Z * 0.4, 12, 2, look.lamp);
    m.cuboid(vec3(-1.55, 2.605, -0.55), vec3(1.55, 2.64, -0.05), look.wood);

    for shelf in 0..3 {
        let y = 1.05 + 0.45 * shelf as f32;
        m.cuboid(vec3(-2.05, y, -1.27), vec3(2.05, y + 0.03, -0.9), look.wood);
        for place in 0..9 {
            if rng.chance(0.85) {
                let radius = rng.between(0.1, 0.17);
                let at = vec3(-1.8 + 0.45 * place as f32, y + 0.02 + radius, -1.08);
                m.ball(at, radius, 1, rng.pick(toys));
            }
        }
    }
    // Bulbs around three edges of the roof.
    let mut bulb = |index: u32, at: Vec3| {
        m.ball(roof.transform_point3(at), 0.055, 1, look.trim[index as usize % 2]);
    };
    for i in 0..16 {
        bulb(i, vec3(-2.34 + 0.312 * i as f32, -0.4, 1.79));
    }
    for i in 0..8 {
        for x in [-2.42, 2.42] {
            bulb(i, vec3(x, -0.02, 1.5 - 0.4 * i as f32));
        }
    }
}

/// Some 7 m high, seven clumps of leaves hung with fairy lights.
fn tree(m: &mut MeshBuilder, rng: &mut Pcg, bark: u32, foliage: u32, colors: &[u32]) {
    const CLUMPS: u32 = 7;
    const BULBS_A_CLUMP: u32 = 58;
    m.frustum((vec3(0.0, -0.1, 0.0), 0.22), (vec3(0.0, 4.2, 0.0), 0.09), 9, 3, bark);
    for clump in 0..CLUMPS {
        let is_top = clump == 0;
        let away = if is_top { Vec3::ZERO } else { on_circle(rng.between(0.9, 1.25), clump as f32 / 6.0) };
        let center = away + Vec3::Y * if is_top { 5.4 } else { rng.between(3.2, 4.6) };
        let radii = vec3(rng.between(0.9, 1.2), rng.between(0.8, 1.3), rng.between(0.9, 1.2));
        m.tube(vec3(0.0, 2.4, 0.0), center, 0.05, 6, bark);
        m.ellipsoid(center, radii, 2, foliage);
        for bulb in 0..BULBS_A_CLUMP {
            // Golden-section spiral: even over the sphere.
            let height = 1.0 - 2.0 * (bulb as f32 + 0.5) / BULBS_A_CLUMP as f32;
            let (sin, cos) = sin_cos(0.618_034 * bulb as f32 + rng.between(-0.02, 0.02));
            let around = (1.0 - height * height).sqrt();
            let direction = vec3(around * cos, height, around * sin);
            let at = center + direction * radii * rng.between(1.01, 1.06);
            m.ball(at, 0.035, 0, rng.pick(colors));
        }
    }
}
