//! Small scenes that something is to be seen in.

use crate::scene::{Camera, Environment, Instance, Material, Mesh, Motion, Scene, Texture, builtin};
use glam::{Mat4, Quat, Vec2, Vec3};

/// The built-in Cornell box.
///
/// # Panics
/// If it is gone.
pub fn cornell() -> Scene {
    (builtin::find("cornell").expect("the scene is built in").build)()
}

/// A room with a light of every kind.
pub fn studio() -> Scene {
    (builtin::find("studio").expect("the scene is built in").build)()
}

/// Two triangles with a corner at `origin` and the given edges, counter-clockwise.
pub fn quad(name: &str, origin: Vec3, a: Vec3, b: Vec3, material: u32) -> Mesh {
    Mesh {
        name: name.into(),
        positions: vec![origin, origin + a, origin + a + b, origin + b],
        normals: Vec::new(),
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        materials: vec![material; 2],
        ..Mesh::default()
    }
}

/// Has all that chooses among variants: a texture, an environment, a glossy floor, and three lights of one mesh, one
/// mirrored and one circling.
pub fn variety() -> Scene {
    let texels = (0..64u32).map(|i| if (i / 8 + i) % 2 == 0 { 0xff20_60d0 } else { 0xffe0_c040 }).collect();
    let sky = (0..32u32).map(|i| [0.1 + i as f32 * 0.01, 0.2, if i == 9 { 20.0 } else { 0.3 }]).collect();
    let floor = Material { specular: Vec3::splat(0.04), roughness: 0.3, metallic: 0.2, ..Material::default() };
    let wall = Material { base_color_texture: Some(0), ..Material::default() };
    let lamp = Material { emission: Vec3::new(6.0, 5.0, 3.0), ..Material::default() };
    let up = |x: f32, y: f32, z: f32| Mat4::from_translation(Vec3::new(x, y, z));
    let circling = Motion::Turn { center: Vec3::ZERO, axis: Vec3::Y, turns_per_second: 0.25 };
    let still = |mesh, world_from_object| Instance { mesh, world_from_object, motion: Motion::Still };
    Scene {
        name: "variety".into(),
        meshes: vec![
            quad("floor", Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 0),
            quad("wall", Vec3::new(-3.0, 0.0, -2.0), Vec3::X * 6.0, Vec3::Y * 2.0, 1),
            quad("lamp", Vec3::ZERO, Vec3::X * 0.5, Vec3::Z * 0.5, 2),
        ],
        instances: vec![
            still(0, Mat4::IDENTITY),
            still(1, Mat4::IDENTITY),
            still(2, up(-1.0, 1.5, -0.5)),
            still(2, up(1.0, 1.2, 0.0) * Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0))),
            Instance { mesh: 2, world_from_object: up(0.5, 0.9, 1.0), motion: circling },
        ],
        materials: vec![floor, wall, lamp],
        textures: vec![Texture { name: "checks".into(), width: 8, height: 8, texels, srgb: true }],
        environment: Some(Environment {
            name: "sky".into(),
            width: 8,
            height: 4,
            texels: sky,
            rotation_deg: 30.0,
            scale: 1.0,
        }),
        distant: Vec::new(),
        camera: Some(Camera {
            origin: Vec3::new(0.3, 1.4, 4.0),
            target: Vec3::new(0.0, 0.7, 0.0),
            up: Vec3::Y,
            vfov_deg: 45.0,
        }),
    }
}

/// Ten lamps of different size and radiance above the origin, none of which hides another from there: two meshes, one of
/// them twice, the second time mirrored and stretched. A sky with a black texel if `sky`.
pub fn lamps(sky: bool) -> Scene {
    let mesh = |name: &str, places: &[(f32, f32, f32)], first_material: u32| {
        let mut mesh = Mesh { name: name.into(), ..Mesh::default() };
        for (i, &(x, z, size)) in (0..).zip(places) {
            let corner = Vec3::new(x, 0.0, z);
            // Counter-clockwise seen from below.
            mesh.positions.extend([corner, corner + Vec3::X * size, corner + Vec3::Z * size]);
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
            mesh.materials.push((first_material + i) % 3);
        }
        mesh
    };
    let row = mesh("row", &[(-0.75, -0.2, 0.25), (-0.25, -0.1, 0.32), (0.25, -0.2, 0.4)], 0);
    let square = mesh("square", &[(-0.6, -0.6, 0.3), (0.1, -0.5, 0.4), (-0.5, 0.1, 0.2), (0.1, 0.0, 0.5)], 1);
    let tilt = Quat::from_rotation_z(0.2) * Quat::from_rotation_x(-0.1);
    let place = |mesh: u32, scale: Vec3, position: Vec3| Instance {
        mesh,
        world_from_object: Mat4::from_scale_rotation_translation(scale, tilt, position),
        motion: Motion::Still,
    };
    let texels = (0..128u32).map(|i| if i == 5 { [0.0; 3] } else { [0.005 * i as f32, 0.1, 0.2] }).collect();
    let emitting = |emission: Vec3| Material { emission, ..Material::default() };
    Scene {
        name: "lamps".into(),
        meshes: vec![row, square],
        instances: vec![
            place(0, Vec3::ONE, Vec3::new(-1.2, 1.0, 0.0)),
            place(1, Vec3::ONE, Vec3::new(0.0, 2.0, -1.2)),
            place(0, Vec3::new(-1.0, 1.0, 1.4), Vec3::new(1.6, 1.5, 0.3)),
        ],
        materials: vec![emitting(Vec3::ONE), emitting(Vec3::new(0.5, 3.0, 1.0)), emitting(Vec3::splat(8.0))],
        environment: sky.then(|| Environment {
            name: "sky".into(),
            width: 16,
            height: 8,
            texels,
            rotation_deg: 30.0,
            scale: 1.0,
        }),
        ..Scene::default()
    }
}

/// [`lamps`] above a floor, seen by a camera.
pub fn lamps_over_floor() -> Scene {
    let mut scene = lamps(false);
    scene.meshes.push(quad("floor", Vec3::new(-2.0, -0.5, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 3));
    scene.materials.push(Material::default());
    scene.instances.push(Instance { mesh: 2, world_from_object: Mat4::IDENTITY, motion: Motion::Still });
    scene.camera =
        Some(Camera { origin: Vec3::new(0.0, 0.8, 2.5), target: Vec3::NEG_Y * 0.5, up: Vec3::Y, vfov_deg: 40.0 });
    scene
}

/// What is left of a lamp of one by one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lamp {
    /// All of it.
    Whole,
    /// The half at larger x: the rest is a hole in its alpha mask.
    Masked,
    /// The same half, as a lamp of half the size.
    Half,
}

/// A lamp out of view above a floor.
pub fn lamp_above_a_floor(lamp: Lamp) -> Scene {
    // Interpolated between black and white and repeating, the mask is 0.5 at both ends of the white half.
    let mask =
        Texture { name: "mask".into(), width: 2, height: 1, texels: vec![0xff00_0000, 0xffff_ffff], srgb: false };
    let shining = Material {
        emission: Vec3::new(6.0, 5.0, 3.0),
        alpha_texture: (lamp == Lamp::Masked).then_some(0),
        ..Material::default()
    };
    let (left, width) = if lamp == Lamp::Half { (0.0, 0.5) } else { (-0.5, 1.0) };
    let still = |mesh| Instance { mesh, world_from_object: Mat4::IDENTITY, motion: Motion::Still };
    Scene {
        name: "lamp".into(),
        meshes: vec![
            quad("floor", Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 0),
            quad("lamp", Vec3::new(left, 1.0, -0.5), Vec3::X * width, Vec3::Z, 1),
        ],
        instances: vec![still(0), still(1)],
        materials: vec![Material::default(), shining],
        textures: if lamp == Lamp::Masked { vec![mask] } else { Vec::new() },
        environment: None,
        distant: Vec::new(),
        camera: Some(Camera {
            origin: Vec3::new(0.0, 0.9, 3.5),
            target: Vec3::new(0.0, -0.2, 0.5),
            up: Vec3::Y,
            vfov_deg: 36.0,
        }),
    }
}
