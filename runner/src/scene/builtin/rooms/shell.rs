//! Slabs, walls, doors and windows.

use glam::{Mat4, Vec3, vec3};

use super::{
    BUILDING_HALF, CLEAR_HEIGHT, CORRIDOR_HALF, CORRIDOR_LENGTH, FLOORS, LOBBY_LENGTH, LOBBY_ROOMS, ROOM_DEPTH,
    ROOM_WIDTH, SLAB, STOREY, Side, world_from_room,
};
use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::random::Pcg;
use crate::scene::builtin::shapes::{MeshBuilder, rotation};

const WALL_HALF: f32 = 0.06;
/// Walls reach this far into what they stand on, hang from and meet, so that no two faces coincide.
const SINK: f32 = 0.02;
const DOOR_LEFT: f32 = 0.6;
const DOOR_WIDTH: f32 = 0.95;
const DOOR_HEIGHT: f32 = 2.1;

/// An opening in a wall: from (left, bottom) to (right, top).
#[derive(Clone, Copy)]
struct Opening {
    left: f32,
    right: f32,
    bottom: f32,
    top: f32,
}

const DOORWAY: Opening = Opening { left: DOOR_LEFT, right: DOOR_LEFT + DOOR_WIDTH, bottom: -SINK, top: DOOR_HEIGHT };
/// Towards the corridor; there is no glass in it.
const INNER_WINDOW: Opening = Opening { left: 1.9, right: 4.85, bottom: 0.55, top: 2.5 };
/// To the night outside, behind a dark pane.
const OUTER_WINDOW: Opening = Opening { left: 0.5, right: 4.5, bottom: 0.9, top: 2.4 };
/// Between two rooms.
const SIDE_WINDOW: Opening = Opening { left: 0.5, right: 5.5, bottom: 0.5, top: 2.5 };

/// The meshes that the building itself is made of.
pub(super) struct Shell {
    slab: u32,
    lobby_floor: u32,
    corridor_floor: u32,
    room_floors: [u32; 4],
    inner_walls: [u32; 2],
    outer_wall: u32,
    side_walls: Vec<u32>,
    side_walls_with_window: Vec<u32>,
    end_wall: u32,
    door: u32,
}

impl Shell {
    pub(super) fn new(scene: &mut Assembly) -> Self {
        let ceiling = scene.matte("ceiling", [0.80, 0.79, 0.77]);
        let plaster = scene.matte("plaster", [0.78, 0.76, 0.72]);
        let frame = scene.metal("dark steel", [0.30, 0.31, 0.33], 0.35);
        let pane = scene.glossy("night pane", [0.005, 0.006, 0.008], 0.08);
        let door_wood = scene.glossy("door wood", [0.36, 0.19, 0.09], 0.3);
        let tiles = scene.glossy("polished stone", [0.16, 0.155, 0.15], 0.16);
        let floors = [
            scene.glossy("oak floor", [0.42, 0.27, 0.15], 0.25),
            scene.glossy("dark floor", [0.12, 0.11, 0.12], 0.2),
            scene.glossy("pale vinyl", [0.5, 0.5, 0.48], 0.3),
            scene.matte("blue carpet", [0.16, 0.2, 0.3]),
        ];
        let accents = [
            plaster,
            scene.matte("terracotta", [0.60, 0.27, 0.16]),
            scene.matte("sage", [0.36, 0.47, 0.34]),
            scene.matte("slate blue", [0.25, 0.34, 0.48]),
        ];

        let plate = |scene: &mut Assembly, name: &str, min: (f32, f32), max: (f32, f32), material: u32| {
            scene.mesh(name, |m| m.cuboid(vec3(min.0, -0.06, min.1), vec3(max.0, 0.0, max.1), material))
        };
        let room_floors = floors.map(|floor| plate(scene, "room floor", (0.0, 0.0), (ROOM_WIDTH, ROOM_DEPTH), floor));
        let side_wall = |scene: &mut Assembly, openings: &[Opening], accent| {
            scene.mesh("side wall", |m| wall(m, ROOM_DEPTH, openings, accent))
        };
        Self {
            slab: scene.mesh("slab", |m| {
                let reach = BUILDING_HALF + 0.15;
                let (low, high) =
                    (vec3(-LOBBY_LENGTH - 0.15, -SLAB, -reach), vec3(CORRIDOR_LENGTH + 0.15, -0.03, reach));
                m.cuboid(low, high, ceiling);
            }),
            lobby_floor: plate(scene, "lobby floor", (0.0, -BUILDING_HALF), (LOBBY_LENGTH, BUILDING_HALF), tiles),
            corridor_floor: plate(
                scene,
                "corridor floor",
                (0.0, -CORRIDOR_HALF),
                (CORRIDOR_LENGTH, CORRIDOR_HALF),
                tiles,
            ),
            room_floors,
            inner_walls: [&[DOORWAY, INNER_WINDOW][..], &[DOORWAY][..]].map(|openings| {
                scene.mesh("inner wall", |m| {
                    wall(m, ROOM_WIDTH, openings, plaster);
                    openings.iter().for_each(|&opening| opening_frame(m, opening, frame));
                })
            }),
            outer_wall: scene.mesh("outer wall", |m| {
                wall(m, ROOM_WIDTH, &[OUTER_WINDOW], plaster);
                opening_frame(m, OUTER_WINDOW, frame);
                let Opening { left, right, bottom, top } = OUTER_WINDOW;
                m.cuboid(vec3(left - SINK, bottom - SINK, -0.01), vec3(right + SINK, top + SINK, 0.01), pane);
                for x in [1.75, 3.25] {
                    m.cuboid(vec3(x - 0.025, bottom - SINK, -0.04), vec3(x + 0.025, top + SINK, 0.04), frame);
                }
            }),
            side_walls: accents.iter().map(|&accent| side_wall(scene, &[], accent)).collect(),
            side_walls_with_window: accents.iter().map(|&accent| side_wall(scene, &[SIDE_WINDOW], accent)).collect(),
            end_wall: scene.mesh("end wall", |m| wall(m, 2.0 * BUILDING_HALF, &[], plaster)),
            door: scene.mesh("door leaf", |m| {
                // Hinged at x = 0.
                m.cuboid(vec3(0.0, 0.01, -0.02), vec3(DOOR_WIDTH - 0.07, DOOR_HEIGHT - 0.04, 0.02), door_wood);
                for z in [-0.05, 0.05] {
                    m.tube(vec3(0.78, 1.02, 0.0), vec3(0.78, 1.02, z), 0.012, 8, frame);
                    m.tube(vec3(0.79, 1.02, z), vec3(0.66, 1.02, z), 0.011, 8, frame);
                }
            }),
        }
    }

    /// What a floor has once: slab, lobby, corridor, and the walls at both ends.
    pub(super) fn storey(&self, scene: &mut Assembly, floor: u32) {
        let at = |x: f32| Mat4::from_translation(vec3(x, floor as f32 * STOREY, 0.0));
        scene.place(self.slab, at(0.0));
        scene.place(self.lobby_floor, at(-LOBBY_LENGTH));
        scene.place(self.corridor_floor, at(0.0));
        for x in [-LOBBY_LENGTH, CORRIDOR_LENGTH] {
            // A wall runs along its own x; a quarter turn sends that to -z.
            let across = Mat4::from_translation(Vec3::Z * BUILDING_HALF) * rotation(Vec3::Y, 0.25);
            scene.place(self.end_wall, at(x) * across);
        }
        for slot in 1..=LOBBY_ROOMS as i32 {
            for side in [Side::Front, Side::Back] {
                self.outer_wall(scene, world_from_room(floor, -slot, side));
            }
        }
    }

    /// The walls of a room, its floor and its door.
    pub(super) fn room(&self, scene: &mut Assembly, floor: u32, slot: i32, side: Side, rng: &mut Pcg) {
        let room = world_from_room(floor, slot, side);
        scene.place(rng.pick(&self.room_floors), room);
        self.outer_wall(scene, room);
        scene.place(if slot < 3 || rng.chance(0.7) { self.inner_walls[0] } else { self.inner_walls[1] }, room);

        // Each room brings the wall on its side of lower x; the building's end wall closes the row.
        let is_first = slot == 0;
        let accent = rng.pick(&[0, 0, 1, 2, 3]);
        let walls = if is_first || rng.chance(0.25) { &self.side_walls_with_window } else { &self.side_walls };
        let x = slot as f32 * ROOM_WIDTH;
        let (z, quarter) = match side {
            Side::Front => (CORRIDOR_HALF, -0.25),
            Side::Back => (-CORRIDOR_HALF, 0.25),
        };
        let foot = Mat4::from_translation(vec3(x, floor as f32 * STOREY, z));
        scene.place(walls[accent], foot * rotation(Vec3::Y, quarter));

        let ajar = if rng.chance(0.65) { rng.between(0.17, 0.29) } else { 0.0 };
        let hinge = Mat4::from_translation(vec3(DOOR_LEFT + 0.035, 0.0, 0.0));
        scene.place(self.door, room * hinge * rotation(Vec3::Y, -ajar));
    }

    /// The slab on top of the last floor.
    pub(super) fn roof(&self, scene: &mut Assembly) {
        scene.place(self.slab, Mat4::from_translation(Vec3::Y * (FLOORS as f32 * STOREY)));
    }

    fn outer_wall(&self, scene: &mut Assembly, room: Mat4) {
        scene.place(self.outer_wall, room * Mat4::from_translation(Vec3::Z * ROOM_DEPTH));
    }
}

/// A wall along x with openings, which must be in order and apart.
fn wall(m: &mut MeshBuilder, length: f32, openings: &[Opening], material: u32) {
    let (foot, head) = (-SINK, CLEAR_HEIGHT + SINK);
    let mut block = |left: f32, right: f32, bottom: f32, top: f32| {
        if right > left && top > bottom {
            m.cuboid(vec3(left, bottom, -WALL_HALF), vec3(right, top, WALL_HALF), material);
        }
    };
    let mut x = 0.0;
    for opening in openings {
        block(x, opening.left, foot, head);
        block(opening.left, opening.right, foot, opening.bottom);
        block(opening.left, opening.right, opening.top, head);
        x = opening.right;
    }
    block(x, length, foot, head);
}

/// A frame in an opening, proud of the wall on both sides.
fn opening_frame(m: &mut MeshBuilder, opening: Opening, material: u32) {
    let Opening { left, right, bottom, top } = opening;
    let (half, proud) = (0.03, WALL_HALF + 0.015);
    for x in [left, right] {
        m.cuboid(vec3(x - half, bottom - 0.01, -proud), vec3(x + half, top + half, proud), material);
    }
    let inner = (left + half - 0.005, right - half + 0.005);
    let mut bar = |y: f32| {
        m.cuboid(
            vec3(inner.0, y - half + 0.001, -proud + 0.002),
            vec3(inner.1, y + half - 0.001, proud - 0.002),
            material,
        );
    };
    bar(top);
    if bottom > 0.0 {
        bar(bottom);
    }
}
