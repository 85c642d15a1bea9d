//! What the chains show. Lights are few, not tiny and out of view: less noise, so smaller biases are seen.

use super::scenes::quad;
use crate::{
    packed::{Moment, PackOptions, PackedScene},
    scene::{Camera, DistantLight, Environment, Instance, Material, Motion, Scene, Shape, lights},
    sequence::Shot,
};
use glam::{Mat4, Vec3};

/// Pixels in a row of most pictures.
pub const WIDTH: u32 = 32;
/// Rows of most pictures.
pub const HEIGHT: u32 = 24;

/// Frames of a chain, of which the last is judged: enough for confidence to reach the default cap, as reservoirs of
/// several pixels add up. None are needed to forget the first frame, which has the mean that it should have.
pub const FRAMES: u32 = 8;

/// A scene and the shots of a chain of frames.
pub struct Scenario {
    /// What it is called.
    pub name: &'static str,
    /// What there is.
    pub scene: Scene,
    /// What the frames show, one after the other.
    pub shots: Vec<Shot>,
    /// Of the picture.
    pub size: [u32; 2],
    /// Knobs beside those that are tested.
    pub knobs: Vec<&'static str>,
    /// Whether instances come, go and move by more than the scene's own motion.
    is_dynamic: bool,
    /// Whether light is not sampled where it has a closed form.
    closed_form: bool,
}

impl Scenario {
    fn new(name: &'static str, scene: Scene, shot: impl Fn(u32, &Camera) -> Shot) -> Self {
        let camera = scene.camera.expect("the scene has a camera");
        let shots: Vec<Shot> = (0..FRAMES).map(|i| shot(i, &camera)).collect();
        let is_dynamic = shots.iter().any(|s| s.moment != shots[0].moment);
        Self {
            name,
            scene,
            shots,
            size: [WIDTH, HEIGHT],
            knobs: vec!["candidates.count=4", "reuse.radius=4"],
            is_dynamic,
            closed_form: false,
        }
    }

    /// The same, where light is not sampled if it has a closed form.
    pub fn with_closed_form(self) -> Self {
        Self { closed_form: true, ..self }
    }

    /// Where nothing moves.
    fn standing(name: &'static str, scene: Scene) -> Self {
        Self::new(name, scene, |_, camera| Shot { moment: Moment::default(), camera: *camera })
    }

    /// What moves beside the camera.
    fn moving(name: &'static str, scene: Scene, moment: impl Fn(u32) -> Moment) -> Self {
        Self::new(name, scene, |i, camera| Shot { moment: moment(i), camera: *camera })
    }

    /// The scene at one of the shots.
    ///
    /// # Panics
    /// If it does not pack, which only a bug here can cause.
    pub fn pack(&self, shot: usize) -> PackedScene {
        let Self { is_dynamic, closed_form, .. } = *self;
        let options = PackOptions { dynamic: is_dynamic, light_tree: true, light_cuts: true, closed_form };
        PackedScene::with(&self.scene, &self.shots[shot].moment, options).expect("packs")
    }
}

fn still(mesh: u32, world_from_object: Mat4) -> Instance {
    Instance { mesh, world_from_object, motion: Motion::Still }
}

fn lamp_at(x: f32, y: f32, z: f32, size: f32) -> Mat4 {
    Mat4::from_translation(Vec3::new(x, y, z)) * Mat4::from_scale(Vec3::splat(size))
}

fn gray(albedo: Vec3) -> Material {
    Material { base_color: albedo, ..Material::default() }
}

fn emitter(emission: Vec3) -> Material {
    Material { emission, base_color: Vec3::ZERO, ..Material::default() }
}

const OCCLUDER: u32 = 2;
/// The lamps of the room.
const LAMPS: [u32; 4] = [3, 4, 5, 6];

/// Where the lamps of the room are.
fn lamp(number: usize) -> Mat4 {
    [
        lamp_at(-1.2, 2.5, -0.4, 0.5),
        lamp_at(1.3, 2.4, -0.9, 0.7),
        lamp_at(0.2, 2.6, 0.6, 0.4),
        lamp_at(-0.4, 2.3, -1.3, 0.35),
    ][number]
}

/// A floor, a wall, a plate that stands between them, and four lamps of different power and two colours.
fn room() -> Scene {
    let lamps = (0..4).map(|i| still(3 + i as u32 % 2, lamp(i)));
    Scene {
        name: "room".into(),
        meshes: vec![
            quad("floor", Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 0),
            quad("wall", Vec3::new(-3.0, 0.0, -2.0), Vec3::X * 6.0, Vec3::Y * 3.0, 1),
            quad("plate", Vec3::new(-0.5, 0.0, 0.0), Vec3::X, Vec3::Y * 0.9, 0),
            quad("warm", Vec3::new(-0.5, 0.0, -0.5), Vec3::X, Vec3::Z, 2),
            quad("cool", Vec3::new(-0.5, 0.0, -0.5), Vec3::X, Vec3::Z, 3),
        ],
        instances: [still(0, Mat4::IDENTITY), still(1, Mat4::IDENTITY)]
            .into_iter()
            .chain([still(2, Mat4::from_translation(Vec3::new(0.1, 0.0, -0.6)))])
            .chain(lamps)
            .collect(),
        materials: vec![
            gray(Vec3::new(0.6, 0.5, 0.4)),
            gray(Vec3::new(0.4, 0.5, 0.6)),
            emitter(Vec3::new(9.0, 6.0, 4.0)),
            emitter(Vec3::new(3.0, 5.0, 8.0)),
        ],
        camera: Some(Camera {
            origin: Vec3::new(0.0, 1.3, 3.5),
            target: Vec3::new(0.0, 0.45, -0.8),
            up: Vec3::Y,
            vfov_deg: 35.0,
        }),
        ..Scene::default()
    }
}

/// A point, a spot, a sphere, a rectangle and a directional light in place of the lamps; all but the last move, and the
/// point flickers.
pub fn moving_shapes() -> Scenario {
    let mut scene = room();
    scene.instances.truncate(LAMPS[0] as usize);
    let down = |x: f32, y: f32, z: f32| lights::along(Vec3::new(x, y, z), Vec3::new(0.1, -1.0, -0.2).normalize());
    let spot = Shape::Spot { inner_deg: 20.0, outer_deg: 45.0 };
    for (shape, emission, world_from_object) in [
        (Shape::Point, Vec3::new(2.0, 1.2, 0.8), lamp_at(-1.2, 1.6, -0.4, 1.0)),
        (spot, Vec3::new(5.0, 6.0, 8.0), down(0.8, 2.4, -0.6)),
        (Shape::Sphere, Vec3::new(9.0, 6.0, 4.0), lamp_at(-0.4, 1.9, -1.2, 0.25)),
        (Shape::Rectangle, Vec3::new(3.0, 5.0, 8.0), down(0.2, 2.6, 0.6) * Mat4::from_rotation_y(std::f32::consts::PI)),
    ] {
        let mesh = lights::add_shape(&mut scene, shape, emission, false);
        scene.instances.push(still(mesh, world_from_object));
    }
    let direction = Vec3::new(-0.4, -0.8, -0.5).normalize();
    scene.distant.push(DistantLight { direction, irradiance: Vec3::new(0.3, 0.4, 0.5) });
    let placed: Vec<Mat4> = LAMPS.iter().map(|&i| scene.instances[i as usize].world_from_object).collect();
    Scenario::moving("moving shapes", scene, move |i| {
        let step = i as f32 * 0.1;
        let moved = |number: usize| {
            let offset = Vec3::new(step * (1.0 - number as f32 * 0.6), -0.3 * step, 0.5 * step);
            (LAMPS[number], Mat4::from_translation(offset) * placed[number])
        };
        let emission = vec![(LAMPS[0], if i % 2 == 0 { Vec3::ONE } else { Vec3::new(0.4, 2.0, 1.0) })];
        Moment { placed: (0..LAMPS.len()).map(moved).collect(), emission, ..Moment::default() }
    })
}

/// Where nothing moves at all.
pub fn standing() -> Scenario {
    Scenario::standing("standing", room())
}

/// The camera goes sideways and forward, by about a pixel a frame and then by some.
pub fn moving_camera() -> Scenario {
    Scenario::new("moving camera", room(), |i, camera| {
        let step = i as f32 * if i > 5 { 0.12 } else { 0.06 };
        let (origin, target) = (camera.origin + Vec3::new(step, 0.3 * step, -step), camera.target);
        Shot { moment: Moment::default(), camera: Camera { origin, target, ..*camera } }
    })
}

/// Two lamps pass over the room.
pub fn moving_light() -> Scenario {
    Scenario::moving("moving light", room(), |i| {
        let shift = |x: f32| Mat4::from_translation(Vec3::new(x * i as f32, 0.0, 0.1 * i as f32));
        Moment {
            placed: vec![(LAMPS[0], shift(0.15) * lamp(0)), (LAMPS[1], shift(-0.2) * lamp(1))],
            ..Moment::default()
        }
    })
}

/// The plate moves, and with it its shadows.
pub fn moving_occluder() -> Scenario {
    Scenario::moving("moving occluder", room(), |i| {
        let plate = Mat4::from_translation(Vec3::new(0.2 * i as f32 - 0.9, 0.1, -0.6 + 0.08 * i as f32));
        Moment { placed: vec![(OCCLUDER, plate)], ..Moment::default() }
    })
}

/// Lamps come, go and change places in the list every frame.
pub fn changing_lights() -> Scenario {
    const DRAWN: [&[u32]; 8] = [
        &[0, 1, 2, 3, 4, 5, 6],
        &[0, 1, 2, 6, 4, 3],
        &[5, 0, 4, 1, 2],
        &[3, 6, 0, 1, 5, 2],
        &[0, 2, 1, 4, 5],
        &[6, 5, 4, 3, 2, 1, 0],
        &[4, 0, 1, 2, 6],
        &[0, 5, 1, 3, 2, 4],
    ];
    Scenario::moving("changing lights", room(), |i| Moment {
        drawn: Some(DRAWN[i as usize % 8].to_vec()),
        ..Moment::default()
    })
}

/// The same lamps every frame, in another order.
pub fn reordered_lights() -> Scenario {
    Scenario::moving("reordered lights", room(), |i| {
        let order: [u32; 4] = std::array::from_fn(|k| LAMPS[(k + i as usize) % 4]);
        Moment { drawn: Some([0, 1, 2].into_iter().chain(order).collect()), ..Moment::default() }
    })
}

/// Lamps go on and off, and one is now large and dim, now a thousand times smaller and brighter.
pub fn flickering() -> Scenario {
    Scenario::moving("flickering", room(), |i| {
        let lit = |on: bool| Vec3::splat(if on { 1.0 } else { 0.0 });
        let small = i % 2 == 0;
        let (scale, factor) = if small { (1.0 / 32.0, 1000.0) } else { (1.0, 1.0) };
        Moment {
            emission: vec![
                (LAMPS[0], lit(i % 2 == 1)),
                (LAMPS[1], Vec3::new(1.0, 0.7, 0.4) * (0.3 + 0.2 * i as f32)),
                (LAMPS[2], Vec3::splat(factor)),
                (LAMPS[3], 2.0 * lit(i % 3 != 1)),
            ],
            placed: vec![(LAMPS[2], lamp(2) * Mat4::from_scale(Vec3::splat(scale)))],
            ..Moment::default()
        }
    })
}

/// A sky with a bright patch beside the lamps, and candidates drawn from the BSDF: they find only what is visible, so a
/// chain that knows of no visibility must leave them out or be too dark.
pub fn environment() -> Scenario {
    let mut scene = room();
    let bright = |i: u32| if i == 10 || i == 11 { 4.0 } else { 0.4 };
    let texels = (0..32).map(|i| [0.5 * bright(i), 0.6 * bright(i), bright(i)]).collect();
    scene.environment =
        Some(Environment { name: "sky".into(), width: 8, height: 4, texels, rotation_deg: 200.0, scale: 1.0 });
    let mut scenario = Scenario::standing("environment", scene);
    scenario.knobs.push("candidates.bsdf=1");
    scenario
}

/// Surfaces with highlights, and candidates drawn from them.
pub fn glossy() -> Scenario {
    let mut scene = room();
    for (material, roughness) in scene.materials.iter_mut().zip([0.2, 0.4]) {
        (material.specular, material.roughness, material.metallic) = (Vec3::splat(0.3), roughness, 0.3);
    }
    let mut scenario = Scenario::standing("glossy", scene);
    scenario.knobs.push("candidates.bsdf=1");
    scenario
}

/// A floor seen from above with a broad low wall on it, and a lamp on either side that is lower than the wall, one much
/// brighter than the other. From above, the depth of the picture tells what hides what.
pub fn low_wall() -> Scenario {
    let side = |name: &str, x: f32, toward: Vec3| {
        quad(name, Vec3::new(x, 0.0, -2.0 * toward.z), Vec3::Y * 0.3, 4.0 * toward, 1)
    };
    let scene = Scene {
        name: "low wall".into(),
        meshes: vec![
            quad("floor", Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 0),
            side("right face", 0.125, Vec3::Z),
            side("left face", -0.125, Vec3::NEG_Z),
            quad("top", Vec3::new(-0.125, 0.3, 2.0), Vec3::X * 0.25, Vec3::NEG_Z * 4.0, 0),
            // (0, 1, 0) x (0, 0, 1) is +x.
            quad("bright lamp a", Vec3::new(-1.6, 0.02, -1.0), Vec3::Y * 0.25, Vec3::Z, 2),
            quad("bright lamp b", Vec3::new(-1.6, 0.02, 0.0), Vec3::Y * 0.25, Vec3::Z, 2),
            quad("dim lamp a", Vec3::new(1.6, 0.02, 1.0), Vec3::Y * 0.25, Vec3::NEG_Z, 3),
            quad("dim lamp b", Vec3::new(1.6, 0.02, 0.0), Vec3::Y * 0.25, Vec3::NEG_Z, 3),
        ],
        instances: (0..8).map(|mesh| still(mesh, Mat4::IDENTITY)).collect(),
        materials: vec![
            gray(Vec3::splat(0.5)),
            gray(Vec3::splat(0.3)),
            emitter(Vec3::new(20.0, 15.0, 10.0)),
            emitter(Vec3::new(4.0, 5.0, 6.0)),
        ],
        camera: Some(Camera { origin: Vec3::new(0.0, 5.0, 0.0), target: Vec3::ZERO, up: Vec3::NEG_Z, vfov_deg: 17.0 }),
        ..Scene::default()
    };
    Scenario::standing("low wall", scene)
}

/// A floor seen from above and parted by a wall seen edge-on: on either side, one lamp that the other side does not
/// see for the wall, and one that it does not see because that lamp turns its back. To the test of similarity all of
/// the floor is alike.
pub fn half_shadowed() -> Scenario {
    let half = 0.01;
    let side = |name: &str, x: f32, toward: Vec3| {
        quad(name, Vec3::new(x, 0.0, -2.0 * toward.z), Vec3::Y * 2.0, 4.0 * toward, 1)
    };
    let panel = |name: &str, x: f32, toward: Vec3| {
        quad(name, Vec3::new(x, 0.5, -0.4 * toward.z), Vec3::Y * 0.5, 0.8 * toward, 2)
    };
    let scene = Scene {
        name: "half shadowed".into(),
        meshes: vec![
            quad("floor", Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 0),
            // The wall has two faces and an edge; (0, 1, 0) x (0, 0, 1) is +x.
            side("right face", half, Vec3::Z),
            side("left face", -half, Vec3::NEG_Z),
            quad("edge", Vec3::new(-half, 2.0, 2.0), Vec3::X * 2.0 * half, Vec3::NEG_Z * 4.0, 1),
            panel("right panel", half * 1.2, Vec3::Z),
            panel("left panel", -half * 1.2, Vec3::NEG_Z),
            quad("lamp a", Vec3::new(-1.7, 1.2, -0.3), Vec3::X * 0.5, Vec3::Z * 0.6, 3),
            quad("lamp b", Vec3::new(1.2, 1.2, -0.3), Vec3::X * 0.5, Vec3::Z * 0.6, 4),
        ],
        instances: (0..8).map(|mesh| still(mesh, Mat4::IDENTITY)).collect(),
        materials: vec![
            gray(Vec3::splat(0.5)),
            gray(Vec3::ZERO),
            emitter(Vec3::new(1.2, 1.2, 1.2)),
            emitter(Vec3::new(8.0, 6.0, 4.0)),
            emitter(Vec3::new(4.0, 6.0, 8.0)),
        ],
        camera: Some(Camera { origin: Vec3::new(0.0, 5.0, 0.0), target: Vec3::ZERO, up: Vec3::NEG_Z, vfov_deg: 17.0 }),
        ..Scene::default()
    };
    let mut scenario = Scenario::standing("half shadowed", scene);
    scenario.knobs.extend(["reuse.radius=8", "temporal.neighbors=2"]);
    scenario
}

/// The same in a picture so small that each pixel is a neighbour of pixels in another light.
pub fn small_half_shadowed() -> Scenario {
    Scenario { name: "small half shadowed", size: [16, 12], ..half_shadowed() }
}
