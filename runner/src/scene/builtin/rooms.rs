//! An office building at night, in the manner of the Soda Hall scene: many lights, few of them visible from one place.

mod furnish;
mod kit;
mod shell;

use glam::{Mat4, Vec3, vec3};

use super::assembly::Assembly;
use super::random::Pcg;
use super::shapes::rotation;
use crate::scene::{Camera, Scene};
use furnish::{Decorator, Use};
use kit::{AMBER, BLUE, COOL, Kit, MAGENTA, RED, TEAL};
use shell::Shell;

/// Storeys of the building.
const FLOORS: u32 = 6;
/// Rooms along each side of a corridor; a floor has twice as many.
const ROOMS_A_SIDE: u32 = 12;
/// From floor to floor, in metres.
const STOREY: f32 = 3.2;
/// Thickness of a floor slab; the rest of a storey is clear height.
const SLAB: f32 = 0.3;
const CLEAR_HEIGHT: f32 = STOREY - SLAB;
const ROOM_WIDTH: f32 = 5.0;
const ROOM_DEPTH: f32 = 6.0;
/// Half the width of a corridor.
const CORRIDOR_HALF: f32 = 1.5;
/// The lobby takes the place of this many rooms on each side, before x = 0.
const LOBBY_ROOMS: u32 = 2;
const LOBBY_LENGTH: f32 = LOBBY_ROOMS as f32 * ROOM_WIDTH;
const CORRIDOR_LENGTH: f32 = ROOMS_A_SIDE as f32 * ROOM_WIDTH;
/// Half the depth of the building.
const BUILDING_HALF: f32 = CORRIDOR_HALF + ROOM_DEPTH;

/// Which side of the corridor a room is on.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    /// Towards +z.
    Front,
    /// Towards -z.
    Back,
}

/// From a room's own frame (x along the corridor, z from the corridor to the windows) to the world.
/// Slot 0 is the first room after the lobby, the lobby has the negative ones.
fn world_from_room(floor: u32, slot: i32, side: Side) -> Mat4 {
    let (x, y) = (slot as f32 * ROOM_WIDTH, floor as f32 * STOREY);
    match side {
        Side::Front => Mat4::from_translation(vec3(x, y, CORRIDOR_HALF)),
        Side::Back => Mat4::from_translation(vec3(x + ROOM_WIDTH, y, -CORRIDOR_HALF)) * rotation(Vec3::Y, 0.5),
    }
}

/// Use and tint of the rooms that are seen from the lobby, each floor in another order; the others are left to chance.
fn showpiece(floor: u32, slot: i32, side: Side) -> Option<(Use, usize)> {
    const SHOWPIECES: [(Use, usize); 6] = [
        (Use::Lounge, AMBER),
        (Use::Laboratory, MAGENTA),
        (Use::MeetingRoom, TEAL),
        (Use::Office, COOL),
        (Use::Lounge, RED),
        (Use::MeetingRoom, BLUE),
    ];
    let place = 2 * slot as usize + usize::from(side == Side::Back);
    (place < SHOWPIECES.len()).then(|| SHOWPIECES[(place + 2 * floor as usize + 2) % SHOWPIECES.len()])
}

/// Six floors of 24 rooms along a corridor that starts in a lobby; the camera stands in the lobby of the third.
pub fn build() -> Scene {
    let mut scene = Assembly::new("rooms");
    let mut rng = Pcg::new(1962);
    let kit = Kit::new(&mut scene, &mut rng);
    let shell = Shell::new(&mut scene);

    for floor in 0..FLOORS {
        shell.storey(&mut scene, floor);
        let mut decorator = Decorator { scene: &mut scene, kit: &kit, rng: &mut rng };
        decorator.lobby(Mat4::from_translation(vec3(-LOBBY_LENGTH, floor as f32 * STOREY, 0.0)));
        decorator.corridor(Mat4::from_translation(vec3(0.0, floor as f32 * STOREY, 0.0)));
        for slot in 0..ROOMS_A_SIDE as i32 {
            for side in [Side::Front, Side::Back] {
                shell.room(&mut scene, floor, slot, side, &mut rng);
                let mut decorator = Decorator { scene: &mut scene, kit: &kit, rng: &mut rng };
                decorator.room(world_from_room(floor, slot, side), showpiece(floor, slot, side));
            }
        }
    }
    shell.roof(&mut scene);

    let eye = 2.0 * STOREY + 1.65;
    scene.finish(Camera {
        origin: vec3(-4.6, eye, 0.9),
        target: vec3(6.0, eye - 0.45, -0.35),
        up: Vec3::Y,
        vfov_deg: 62.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_room_lies_between_the_corridor_and_the_windows() {
        for side in [Side::Front, Side::Back] {
            for corner in [Vec3::ZERO, vec3(ROOM_WIDTH, 0.0, ROOM_DEPTH)] {
                let p = world_from_room(3, 2, side).transform_point3(corner);
                assert!((10.0 - 1e-4..=15.0 + 1e-4).contains(&p.x), "{p}");
                assert!((CORRIDOR_HALF - 1e-4..=BUILDING_HALF + 1e-4).contains(&p.z.abs()), "{p}");
                assert_eq!(p.z > 0.0, side == Side::Front);
            }
        }
    }

    #[test]
    fn there_are_six_floors_of_twenty_to_forty_rooms() {
        let scene = build();
        let mut doors = [0; FLOORS as usize];
        for instance in &scene.instances {
            if scene.meshes[instance.mesh as usize].name == "door leaf" {
                doors[(instance.world_from_object.w_axis.y / STOREY).round() as usize] += 1;
            }
        }
        assert!(doors.iter().all(|count| (20..=40).contains(count)), "{doors:?}");
    }
}
