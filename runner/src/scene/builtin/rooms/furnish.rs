//! Who works where: puts furniture into rooms and decides on their light.

use glam::{Mat4, Vec3, vec3};

use super::kit::{AMBER, BLUE, COOL, GREEN, Kit, MAGENTA, NEUTRAL, RED, TEAL, WARM};
use super::{CLEAR_HEIGHT, CORRIDOR_LENGTH, LOBBY_LENGTH, ROOM_WIDTH};
use crate::scene::builtin::assembly::Assembly;
use crate::scene::builtin::random::Pcg;
use crate::scene::builtin::shapes::rotation;

/// What a room is for.
#[derive(Clone, Copy)]
pub(super) enum Use {
    Office,
    MeetingRoom,
    Servers,
    Lounge,
    Laboratory,
    Storage,
}

/// One of these is drawn for each room, so a use is as frequent as it is named here.
const USES: [Use; 11] = [
    Use::Office,
    Use::Office,
    Use::Office,
    Use::MeetingRoom,
    Use::MeetingRoom,
    Use::Servers,
    Use::Lounge,
    Use::Lounge,
    Use::Laboratory,
    Use::Laboratory,
    Use::Storage,
];

/// Furnishes in a frame that the caller gives.
pub(super) struct Decorator<'a> {
    pub(super) scene: &'a mut Assembly,
    pub(super) kit: &'a Kit,
    pub(super) rng: &'a mut Pcg,
}

impl Decorator<'_> {
    /// A room; its frame is that of `world_from_room`. Without a `showpiece` its use and tint are left to chance.
    pub(super) fn room(&mut self, room: Mat4, showpiece: Option<(Use, usize)>) {
        let (what, tint) = showpiece.unwrap_or_else(|| {
            // Most rooms have white light, some are coloured through and through.
            let tint = if self.rng.chance(0.62) {
                self.rng.pick(&[WARM, WARM, NEUTRAL, NEUTRAL, COOL])
            } else {
                self.rng.pick(&[RED, AMBER, GREEN, TEAL, BLUE, MAGENTA])
            };
            (self.rng.pick(&USES), tint)
        });
        match what {
            Use::Office => self.office(room, tint),
            Use::MeetingRoom => self.meeting_room(room, tint),
            Use::Servers => self.server_room(room),
            Use::Lounge => self.lounge(room, tint),
            Use::Laboratory => self.laboratory(room, tint),
            Use::Storage => self.storage(room),
        }
        self.put(self.kit.exit_sign, room, vec3(1.1, CLEAR_HEIGHT, 0.3), 0.0);
    }

    /// The open space at the start of each floor; x from 0, z on both sides of 0.
    pub(super) fn lobby(&mut self, lobby: Mat4) {
        let kit = self.kit;
        for z in [-3.4, 3.4] {
            self.put(kit.chandelier, lobby, vec3(6.3, CLEAR_HEIGHT, z), 0.0);
            self.put(kit.sofa, lobby, vec3(6.3, 0.0, z + 1.6), 0.5);
            self.put(kit.sofa, lobby, vec3(4.6, 0.0, z), 0.25);
            self.put(kit.low_table, lobby, vec3(6.4, 0.0, z), 0.0);
            let lamp = self.rng.pick(&kit.floor_lamps);
            self.put(lamp, lobby, vec3(4.6, 0.0, z + 1.5), 0.0);
            self.put(kit.plant, lobby, vec3(9.5, 0.0, z * 0.47), 0.0);
        }
        for corner in [vec3(0.6, 0.0, 6.6), vec3(0.6, 0.0, -6.6), vec3(9.4, 0.0, 6.7), vec3(9.4, 0.0, -6.7)] {
            self.put(kit.plant, lobby, corner, 0.3);
        }
        self.put(kit.counter, lobby, vec3(1.6, 0.0, 0.0), 0.25);
        for z in [-0.8, 0.7] {
            self.put(kit.screens[0], lobby, vec3(1.55, 1.05, z), -0.25);
            self.put(kit.pendants[WARM], lobby, vec3(1.6, CLEAR_HEIGHT, z), 0.0);
        }
        self.put(kit.exit_sign, lobby, vec3(LOBBY_LENGTH - 0.4, CLEAR_HEIGHT, 0.0), 0.25);
    }

    /// From the lobby, at x = 0, to the end of the building.
    pub(super) fn corridor(&mut self, corridor: Mat4) {
        let kit = self.kit;
        let mut x = 2.0;
        while x < CORRIDOR_LENGTH {
            // Dim, so that the light of the rooms shows on the floor; every fourth lamp is out.
            if self.rng.chance(0.75) {
                let tint = self.rng.pick(&[WARM, WARM, NEUTRAL]);
                let at = vec3(x, CLEAR_HEIGHT + 0.3, 0.0);
                self.put(kit.pendants[tint], corridor, at, 0.0);
            }
            x += 5.0;
        }
        for x in [14.5, 29.5, 44.5, CORRIDOR_LENGTH - 0.5] {
            self.put(kit.exit_sign, corridor, vec3(x, CLEAR_HEIGHT, 0.0), 0.25);
        }
    }

    fn office(&mut self, room: Mat4, tint: usize) {
        let kit = self.kit;
        for (x, turn) in [(1.25, 0.0), (3.75, 0.5)] {
            for z in [2.2, 4.9] {
                let desk = room * Mat4::from_translation(vec3(x, 0.0, z)) * rotation(Vec3::Y, turn);
                let twist = self.rng.between(-0.08, 0.08);
                self.put(kit.desk, desk, Vec3::ZERO, 0.0);
                self.put(kit.chair, desk, vec3(0.1, 0.0, 0.75), 0.5 + twist);
                let screen = self.rng.pick(&kit.screens);
                self.put(screen, desk, vec3(0.1, 0.74, -0.15), 0.0);
                if self.rng.chance(0.7) {
                    let lamp = self.rng.pick(&kit.desk_lamps);
                    self.put(lamp, desk, vec3(-0.62, 0.74, -0.2), 0.0);
                }
            }
        }
        self.put(kit.shelf, room, vec3(0.3, 0.0, 3.55), 0.25);
        self.put(kit.shelf, room, vec3(ROOM_WIDTH - 0.3, 0.0, 1.0), -0.25);
        self.put(kit.plant, room, vec3(4.5, 0.0, 3.55), 0.0);
        // Some work late, by their desk lamps alone.
        if self.rng.chance(0.8) {
            for (x, z) in [(1.4, 1.7), (3.6, 1.7), (1.4, 4.3), (3.6, 4.3)] {
                self.put(kit.tubes[tint], room, vec3(x, CLEAR_HEIGHT, z), 0.0);
            }
        }
    }

    fn meeting_room(&mut self, room: Mat4, tint: usize) {
        let kit = self.kit;
        let middle = vec3(2.5, 0.0, 3.2);
        self.put(kit.table, room, middle, 0.25);
        for place in [-1.1, -0.4, 0.4, 1.1] {
            for (side, turn) in [(-0.95, 0.25), (0.95, -0.25)] {
                let wobble = self.rng.between(-0.05, 0.05);
                self.put(kit.chair, room, middle + vec3(side, 0.0, place), turn + wobble);
            }
            self.put(kit.pendants[tint], room, middle + vec3(0.0, CLEAR_HEIGHT, place), 0.0);
        }
        self.put(kit.screens[1], room, middle + vec3(0.0, 0.75, 1.2), 0.5);
        self.put(kit.shelf, room, vec3(4.7, 0.0, 3.0), -0.25);
        self.put(kit.plant, room, vec3(0.5, 0.0, 5.4), 0.0);
    }

    fn server_room(&mut self, room: Mat4) {
        let kit = self.kit;
        for (x, turn) in [(0.62, 0.25), (4.38, -0.25)] {
            for place in 0..6 {
                self.put(kit.rack, room, vec3(x, 0.0, 1.7 + 0.65 * place as f32), turn);
            }
        }
        let tint = self.rng.pick(&[TEAL, BLUE, BLUE]);
        self.put(kit.tubes[tint], room, vec3(2.5, CLEAR_HEIGHT, 2.2), 0.0);
        self.put(kit.tubes[tint], room, vec3(2.5, CLEAR_HEIGHT, 4.4), 0.0);
    }

    fn lounge(&mut self, room: Mat4, tint: usize) {
        let kit = self.kit;
        self.put(kit.sofa, room, vec3(2.5, 0.0, 5.3), 0.5);
        self.put(kit.sofa, room, vec3(0.7, 0.0, 3.6), 0.25);
        self.put(kit.low_table, room, vec3(2.5, 0.0, 3.8), 0.0);
        self.put(kit.counter, room, vec3(4.6, 0.0, 3.0), -0.25);
        let lamp = self.rng.pick(&kit.floor_lamps);
        self.put(lamp, room, vec3(0.7, 0.0, 5.3), 0.0);
        self.put(kit.plant, room, vec3(4.3, 0.0, 5.4), 0.0);
        for (x, z) in [(1.6, 2.8), (2.5, 3.8), (3.4, 4.8)] {
            self.put(kit.pendants[tint], room, vec3(x, CLEAR_HEIGHT + 0.2, z), 0.0);
        }
    }

    fn laboratory(&mut self, room: Mat4, tint: usize) {
        let kit = self.kit;
        for (x, turn) in [(0.6, 0.25), (4.4, -0.25)] {
            for z in [2.6, 4.3] {
                let bench = room * Mat4::from_translation(vec3(x, 0.0, z)) * rotation(Vec3::Y, turn);
                self.put(kit.desk, bench, Vec3::ZERO, 0.0);
                for place in [-0.5, 0.0, 0.5] {
                    if self.rng.chance(0.75) {
                        let tank = self.rng.pick(&kit.tanks);
                        self.put(tank, bench, vec3(place, 0.738, -0.1), 0.0);
                    }
                }
            }
        }
        self.put(kit.table, room, vec3(2.5, 0.0, 3.3), 0.25);
        self.put(kit.screens[2], room, vec3(2.5, 0.75, 2.4), 0.5);
        if self.rng.chance(0.6) {
            for z in [2.0, 4.4] {
                self.put(kit.panels[tint], room, vec3(2.5, CLEAR_HEIGHT, z), 0.0);
            }
        }
    }

    /// Dark but for the sign over the door.
    fn storage(&mut self, room: Mat4) {
        let kit = self.kit;
        for z in [2.0, 3.3, 4.6] {
            self.put(kit.shelf, room, vec3(0.3, 0.0, z), 0.25);
            let (x, turn) = (self.rng.between(2.4, 4.0), self.rng.unit());
            self.put(kit.crate_stack, room, vec3(x, 0.0, z), turn);
        }
    }

    fn put(&mut self, mesh: u32, frame: Mat4, at: Vec3, turn: f32) {
        self.scene.place(mesh, frame * Mat4::from_translation(at) * rotation(Vec3::Y, turn));
    }
}
