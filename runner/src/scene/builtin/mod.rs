//! Scenes made by code: the same bytes on every machine, and nothing to download.

mod assembly;
mod cornell;
mod park;
mod random;
mod rooms;
mod shapes;
mod studio;

use crate::scene::Scene;

/// A scene that comes with the program.
pub struct Builtin {
    /// What the command line calls it.
    pub name: &'static str,
    /// One line about it.
    pub description: &'static str,
    /// Makes it; each call gives an equal scene.
    pub build: fn() -> Scene,
}

/// All of them, from the fewest lights to the most.
pub const BUILTIN: &[Builtin] = &[
    Builtin {
        name: "cornell",
        description: "red and green walls, two blocks, one light of 2 triangles",
        build: cornell::build,
    },
    Builtin {
        name: "studio",
        description: "a room lit by a point, a spot, a sphere, a rectangle, a directional light and triangles",
        build: studio::build,
    },
    Builtin {
        name: "rooms",
        description: "an office building at night, most of its lights out of sight",
        build: rooms::build,
    },
    Builtin {
        name: "park",
        description: "an amusement park at night, moving, lit by 3.4 million triangles",
        build: park::build,
    },
];

/// The built-in scene of this name.
pub fn find(name: &str) -> Option<&'static Builtin> {
    BUILTIN.iter().find(|builtin| builtin.name == name)
}

#[cfg(test)]
mod tests;
