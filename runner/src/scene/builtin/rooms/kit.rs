//! Furniture and lamps, one mesh of each kind and colour.

use glam::{Vec3, vec3};

use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::random::Pcg;
use crate::scene::builtin::shapes::{MeshBuilder, on_circle};

/// Colours of light: three whites, then those that tint a whole room.
pub(super) const TINTS: [(&str, [f32; 3]); 9] = [
    ("warm", [1.0, 0.62, 0.30]),
    ("neutral", [1.0, 0.86, 0.66]),
    ("cool", [0.72, 0.87, 1.0]),
    ("red", [1.0, 0.06, 0.04]),
    ("amber", [1.0, 0.40, 0.04]),
    ("green", [0.10, 1.0, 0.22]),
    ("teal", [0.04, 0.80, 0.90]),
    ("blue", [0.08, 0.18, 1.0]),
    ("magenta", [1.0, 0.08, 0.60]),
];

pub(super) const WARM: usize = 0;
pub(super) const NEUTRAL: usize = 1;
pub(super) const COOL: usize = 2;
pub(super) const RED: usize = 3;
pub(super) const AMBER: usize = 4;
pub(super) const GREEN: usize = 5;
pub(super) const TEAL: usize = 6;
pub(super) const BLUE: usize = 7;
pub(super) const MAGENTA: usize = 8;

/// Lamps hang from their origin, which is on the ceiling; all else stands on it. Everything faces +z.
pub(super) struct Kit {
    pub(super) tubes: [u32; TINTS.len()],
    pub(super) pendants: [u32; TINTS.len()],
    pub(super) panels: [u32; TINTS.len()],
    /// Without the whites.
    pub(super) tanks: [u32; 6],
    pub(super) desk_lamps: [u32; 3],
    pub(super) floor_lamps: [u32; 3],
    pub(super) screens: [u32; 3],
    pub(super) chandelier: u32,
    pub(super) exit_sign: u32,
    pub(super) rack: u32,
    pub(super) desk: u32,
    pub(super) chair: u32,
    pub(super) shelf: u32,
    pub(super) table: u32,
    pub(super) sofa: u32,
    pub(super) low_table: u32,
    pub(super) counter: u32,
    pub(super) crate_stack: u32,
    pub(super) plant: u32,
}

impl Kit {
    pub(super) fn new(scene: &mut Assembly, rng: &mut Pcg) -> Self {
        let steel = scene.metal("steel", [0.62, 0.62, 0.64], 0.3);
        let black = scene.glossy("black plastic", [0.03, 0.03, 0.035], 0.35);
        let wood = scene.glossy("desk wood", [0.45, 0.28, 0.15], 0.22);
        let white = scene.glossy("white lacquer", [0.75, 0.75, 0.74], 0.2);
        let fabric = scene.matte("fabric", [0.14, 0.20, 0.26]);
        let leather = scene.glossy("leather", [0.30, 0.10, 0.06], 0.4);
        let leaf = scene.glossy("leaf", [0.08, 0.24, 0.07], 0.4);
        let clay = scene.matte("clay", [0.45, 0.22, 0.14]);
        let card = scene.matte("cardboard", [0.42, 0.30, 0.18]);
        let books = [[0.5, 0.09, 0.07], [0.08, 0.2, 0.42], [0.62, 0.5, 0.2], [0.1, 0.32, 0.2], [0.6, 0.58, 0.52]]
            .map(|color| scene.matte("book", color));

        let bright = TINTS.map(|(name, tint)| scene.lamp(&format!("{name} tube"), tint, 36.0));
        let soft = TINTS.map(|(name, tint)| scene.lamp(&format!("{name} panel"), tint, 12.0));
        let bulb = [WARM, NEUTRAL, COOL].map(|i| scene.lamp(&format!("{} bulb", TINTS[i].0), TINTS[i].1, 90.0));
        let screen = [[0.25, 0.5, 1.0], [0.9, 0.9, 1.0], [0.3, 1.0, 0.6]].map(|tint| scene.lamp("screen", tint, 1.8));
        let led = [[0.1, 1.0, 0.2], [0.1, 0.3, 1.0], [1.0, 0.4, 0.05]].map(|tint| scene.lamp("led", tint, 12.0));
        let exit = scene.lamp("exit sign", [0.05, 1.0, 0.25], 5.0);

        Self {
            tubes: bright.map(|light| scene.mesh("tube light", |m| tube_light(m, steel, light))),
            pendants: bright.map(|light| scene.mesh("pendant light", |m| pendant_light(m, black, light))),
            panels: soft.map(|light| scene.mesh("panel light", |m| panel_light(m, steel, light))),
            tanks: [RED, AMBER, GREEN, TEAL, BLUE, MAGENTA].map(|tint| {
                scene.mesh("tank", |m| {
                    m.tube(vec3(0.0, 0.0, 0.0), vec3(0.0, 0.12, 0.0), 0.16, 20, black);
                    m.frustum((vec3(0.0, 0.11, 0.0), 0.13), (vec3(0.0, 0.7, 0.0), 0.13), 20, 5, soft[tint]);
                    m.tube(vec3(0.0, 0.69, 0.0), vec3(0.0, 0.78, 0.0), 0.16, 20, black);
                })
            }),
            desk_lamps: bulb.map(|light| scene.mesh("desk lamp", |m| desk_lamp(m, black, light))),
            floor_lamps: [WARM, AMBER, MAGENTA].map(|tint| {
                scene.mesh("floor lamp", |m| {
                    m.tube(vec3(0.0, -0.01, 0.0), vec3(0.0, 0.02, 0.0), 0.18, 24, steel);
                    m.tube(vec3(0.0, 0.01, 0.0), vec3(0.0, 1.4, 0.0), 0.012, 8, steel);
                    m.ball(vec3(0.0, 1.55, 0.0), 0.17, 2, bright[tint]);
                })
            }),
            screens: screen.map(|light| {
                scene.mesh("screen", |m| {
                    m.cuboid(vec3(-0.12, -0.005, -0.08), vec3(0.12, 0.012, 0.08), black);
                    m.cuboid(vec3(-0.02, 0.01, -0.03), vec3(0.02, 0.3, -0.01), black);
                    m.cuboid(vec3(-0.31, 0.12, -0.012), vec3(0.31, 0.5, 0.012), black);
                    m.grid(vec3(-0.295, 0.135, 0.014), Vec3::X * 0.59, Vec3::Y * 0.35, 8, 5, light);
                })
            }),
            chandelier: scene
                .mesh("chandelier", |m| chandelier(m, rng, black, [bulb[WARM], bright[WARM], bright[AMBER]])),
            exit_sign: scene.mesh("exit sign", |m| {
                for x in [-0.15, 0.15] {
                    m.tube(vec3(x, 0.01, 0.0), vec3(x, -0.16, 0.0), 0.006, 6, steel);
                }
                m.cuboid(vec3(-0.24, -0.37, -0.02), vec3(0.24, -0.15, 0.02), black);
                m.grid(vec3(-0.22, -0.35, 0.022), Vec3::X * 0.44, Vec3::Y * 0.18, 6, 3, exit);
                m.grid(vec3(0.22, -0.35, -0.022), -Vec3::X * 0.44, Vec3::Y * 0.18, 6, 3, exit);
            }),
            rack: scene.mesh("server rack", |m| rack(m, rng, black, &led)),
            desk: scene.mesh("desk", |m| four_legged(m, vec3(1.6, 0.74, 0.8), 0.035, wood, steel)),
            chair: scene.mesh("chair", |m| chair(m, fabric, black)),
            shelf: scene.mesh("shelf", |m| shelf(m, rng, white, &books)),
            table: scene.mesh("table", |m| four_legged(m, vec3(3.0, 0.75, 1.2), 0.05, wood, black)),
            sofa: scene.mesh("sofa", |m| {
                m.cuboid(vec3(-0.95, 0.08, -0.4), vec3(0.95, 0.42, 0.42), leather);
                m.cuboid(vec3(-0.96, 0.3, -0.46), vec3(0.96, 0.85, -0.25), leather);
                for x in [-0.97, 0.79] {
                    m.cuboid(vec3(x, 0.09, -0.45), vec3(x + 0.18, 0.6, 0.43), leather);
                }
                for (x, z) in [(-0.85, -0.35), (0.85, -0.35), (-0.85, 0.35), (0.85, 0.35)] {
                    m.tube(vec3(x, -0.01, z), vec3(x, 0.1, z), 0.025, 8, black);
                }
            }),
            low_table: scene.mesh("low table", |m| four_legged(m, vec3(1.1, 0.4, 0.6), 0.03, white, black)),
            counter: scene.mesh("counter", |m| {
                m.cuboid(vec3(-1.7, -0.01, -0.35), vec3(1.7, 1.0, 0.3), wood);
                m.cuboid(vec3(-1.8, 0.99, -0.42), vec3(1.8, 1.05, 0.42), white);
                m.grid(vec3(-1.65, 0.88, 0.302), Vec3::X * 3.3, Vec3::Y * 0.05, 24, 1, bright[TEAL]);
            }),
            crate_stack: scene.mesh("boxes", |m| {
                m.cuboid(vec3(-0.4, -0.01, -0.3), vec3(0.3, 0.5, 0.3), card);
                m.cuboid(vec3(-0.35, 0.49, -0.25), vec3(0.2, 0.9, 0.2), card);
                m.cuboid(vec3(0.35, -0.01, -0.2), vec3(0.8, 0.4, 0.25), card);
            }),
            plant: scene.mesh("plant", |m| plant(m, rng, clay, leaf)),
        }
    }
}

/// A bare fluorescent tube under its ballast, on two wires.
fn tube_light(m: &mut MeshBuilder, metal: u32, light: u32) {
    for z in [-0.55, 0.55] {
        m.tube(vec3(0.0, 0.01, z), vec3(0.0, -0.27, z), 0.004, 6, metal);
    }
    m.cuboid(vec3(-0.03, -0.3, -0.8), vec3(0.03, -0.26, 0.8), metal);
    for z in [-0.78, 0.74] {
        m.cuboid(vec3(-0.025, -0.4, z), vec3(0.025, -0.29, z + 0.04), metal);
    }
    m.frustum((vec3(0.0, -0.36, -0.75), 0.028), (vec3(0.0, -0.36, 0.75), 0.028), 12, 8, light);
}

/// A glowing ball on a cord.
fn pendant_light(m: &mut MeshBuilder, cord: u32, light: u32) {
    m.tube(vec3(0.0, 0.01, 0.0), vec3(0.0, -0.62, 0.0), 0.006, 6, cord);
    m.tube(vec3(0.0, -0.5, 0.0), vec3(0.0, -0.62, 0.0), 0.035, 12, cord);
    m.ball(vec3(0.0, -0.72, 0.0), 0.13, 2, light);
}

/// A flat square panel, facing down.
fn panel_light(m: &mut MeshBuilder, metal: u32, light: u32) {
    m.cuboid(vec3(-0.32, -0.05, -0.62), vec3(0.32, 0.01, 0.62), metal);
    m.grid(vec3(-0.3, -0.052, -0.6), Vec3::X * 0.6, Vec3::Z * 1.2, 6, 12, light);
}

/// An arm, a shade that is open below, and a bulb that looks out of it.
fn desk_lamp(m: &mut MeshBuilder, metal: u32, light: u32) {
    m.tube(vec3(0.0, -0.005, 0.0), vec3(0.0, 0.02, 0.0), 0.08, 20, metal);
    m.tube(vec3(0.0, 0.015, 0.0), vec3(-0.08, 0.3, 0.0), 0.008, 8, metal);
    m.tube(vec3(-0.08, 0.3, 0.0), vec3(0.12, 0.45, 0.0), 0.008, 8, metal);
    m.frustum((vec3(0.13, 0.41, 0.0), 0.075), (vec3(0.12, 0.47, 0.0), 0.03), 16, 1, metal);
    m.ball(vec3(0.132, 0.39, 0.0), 0.036, 1, light);
}

/// Fifty bulbs at different heights, a spiral that widens downward.
fn chandelier(m: &mut MeshBuilder, rng: &mut Pcg, cord: u32, lights: [u32; 3]) {
    m.tube(vec3(0.0, -0.03, 0.0), vec3(0.0, 0.01, 0.0), 0.9, 48, cord);
    for bulb in 0..50 {
        let t = (bulb as f32 + 0.5) / 50.0;
        // Equal areas at golden-section angles: no two cords come near each other.
        let foot = on_circle(0.85 * t.sqrt(), 0.618_034 * bulb as f32);
        let drop = 0.25 + 0.55 * (1.0 - t) + rng.between(0.0, 0.12);
        m.tube(foot - Vec3::Y * 0.02, foot - Vec3::Y * drop, 0.004, 5, cord);
        m.ball(foot - Vec3::Y * (drop + 0.03), rng.pick(&[0.035, 0.045, 0.06]), 1, rng.pick(&lights));
    }
}

/// A cabinet of servers whose front is full of small lights.
fn rack(m: &mut MeshBuilder, rng: &mut Pcg, case: u32, leds: &[u32]) {
    m.cuboid(vec3(-0.3, -0.01, -0.5), vec3(0.3, 2.1, 0.45), case);
    for unit in 0..16 {
        let y = 0.15 + 0.12 * unit as f32;
        m.cuboid(vec3(-0.28, y, 0.44), vec3(0.28, y + 0.1, 0.465), case);
        for column in 0..6 {
            if rng.chance(0.7) {
                let x = -0.24 + 0.045 * column as f32;
                m.cuboid(vec3(x, y + 0.03, 0.46), vec3(x + 0.02, y + 0.05, 0.475), rng.pick(leds));
            }
        }
    }
}

fn four_legged(m: &mut MeshBuilder, size: Vec3, thickness: f32, top: u32, legs: u32) {
    let (x, z) = (0.5 * size.x, 0.5 * size.z);
    m.cuboid(vec3(-x, size.y - thickness, -z), vec3(x, size.y, z), top);
    for (x, z) in [(-x, -z), (x, -z), (-x, z), (x, z)].map(|(x, z)| (x * 0.94, z * 0.88)) {
        m.cuboid(vec3(x - 0.025, -0.01, z - 0.025), vec3(x + 0.025, size.y - 0.01, z + 0.025), legs);
    }
}

fn chair(m: &mut MeshBuilder, fabric: u32, frame: u32) {
    m.cuboid(vec3(-0.23, 0.43, -0.22), vec3(0.23, 0.5, 0.23), fabric);
    m.cuboid(vec3(-0.21, 0.62, -0.27), vec3(0.21, 1.0, -0.21), fabric);
    m.tube(vec3(0.0, 0.44, -0.2), vec3(0.0, 0.7, -0.255), 0.02, 8, frame);
    m.tube(vec3(0.0, 0.05, 0.0), vec3(0.0, 0.44, 0.0), 0.025, 10, frame);
    for foot in 0..5 {
        let tip = on_circle(0.27, foot as f32 / 5.0);
        m.tube(vec3(0.0, 0.08, 0.0), tip + Vec3::Y * 0.045, 0.018, 6, frame);
        m.ball(tip + Vec3::Y * 0.025, 0.03, 0, frame);
    }
}

fn shelf(m: &mut MeshBuilder, rng: &mut Pcg, board: u32, books: &[u32]) {
    for x in [-0.6, 0.57] {
        m.cuboid(vec3(x, -0.01, -0.16), vec3(x + 0.03, 1.9, 0.16), board);
    }
    for level in 0..6 {
        let y = 0.08 + 0.35 * level as f32;
        m.cuboid(vec3(-0.59, y, -0.155), vec3(0.59, y + 0.025, 0.155), board);
        let mut x = -0.56;
        while level < 5 && x < 0.48 {
            let width = rng.between(0.025, 0.06);
            if rng.chance(0.8) {
                let high = vec3(x + width - 0.003, y + rng.between(0.2, 0.3), rng.between(0.05, 0.12));
                m.cuboid(vec3(x, y + 0.02, -0.14), high, rng.pick(books));
            }
            x += width;
        }
    }
}

fn plant(m: &mut MeshBuilder, rng: &mut Pcg, pot: u32, leaf: u32) {
    m.frustum((vec3(0.0, -0.01, 0.0), 0.14), (vec3(0.0, 0.36, 0.0), 0.2), 20, 1, pot);
    for frond in 0..22 {
        let away = on_circle(1.0, 0.618_034 * frond as f32);
        let (reach, height) = (rng.between(0.15, 0.5), rng.between(0.7, 1.45));
        let (root, bend) = (away * 0.05 + Vec3::Y * 0.34, away * (0.4 * reach) + Vec3::Y * height * 0.8);
        let tip = away * reach + Vec3::Y * (height - 0.2 * reach);
        m.frustum((root, 0.01), (bend, 0.03), 5, 1, leaf);
        m.frustum((bend, 0.03), (tip, 0.0), 5, 1, leaf);
    }
}
