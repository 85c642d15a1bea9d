//! A small room with a light of every kind.

use glam::{Mat4, Vec3, vec3};

use super::assembly::Assembly;
use super::shapes::rotation;
use crate::scene::{Camera, DistantLight, Instance, Motion, Scene, Shape, Texture, lights};

/// A room of 4 m, open to the viewer: a lamp of triangles behind stained glass, a rectangle at the ceiling, a sphere, a
/// spot, a point that swings, and moonlight.
pub fn build() -> Scene {
    let mut scene = Assembly::new("studio");
    let plaster = scene.matte("plaster", [0.62, 0.60, 0.57]);
    let floor = scene.glossy("varnished floor", [0.34, 0.24, 0.16], 0.35);
    let clay = scene.matte("clay", [0.55, 0.28, 0.18]);
    let enamel = scene.glossy("enamel", [0.12, 0.30, 0.42], 0.25);
    let brass = scene.metal("brass", [0.85, 0.66, 0.32], 0.3);
    let glass = scene.lamp("stained glass", [1.0, 1.0, 1.0], 5.0);

    let room = scene.mesh("room", |m| {
        m.quad([vec3(-2.0, 0.0, 2.0), vec3(2.0, 0.0, 2.0), vec3(2.0, 0.0, -2.0), vec3(-2.0, 0.0, -2.0)], floor);
        m.quad([vec3(-2.0, 3.0, -2.0), vec3(2.0, 3.0, -2.0), vec3(2.0, 3.0, 2.0), vec3(-2.0, 3.0, 2.0)], plaster);
        m.quad([vec3(-2.0, 0.0, -2.0), vec3(2.0, 0.0, -2.0), vec3(2.0, 3.0, -2.0), vec3(-2.0, 3.0, -2.0)], plaster);
        m.quad([vec3(-2.0, 0.0, 2.0), vec3(-2.0, 0.0, -2.0), vec3(-2.0, 3.0, -2.0), vec3(-2.0, 3.0, 2.0)], plaster);
        m.quad([vec3(2.0, 0.0, -2.0), vec3(2.0, 0.0, 2.0), vec3(2.0, 3.0, 2.0), vec3(2.0, 3.0, -2.0)], plaster);
    });
    let block = scene.mesh("block", |m| m.cuboid(vec3(-0.35, -0.01, -0.35), vec3(0.35, 0.7, 0.35), clay));
    let pillar = scene.mesh("pillar", |m| m.cuboid(vec3(-0.2, -0.01, -0.2), vec3(0.2, 1.5, 0.2), enamel));
    let bar = scene.mesh("bar", |m| m.cuboid(vec3(-0.6, 0.0, -0.12), vec3(0.6, 0.24, 0.12), brass));
    let lamp = scene.mesh("lamp", |m| {
        m.quad([vec3(-0.3, -0.5, 0.0), vec3(0.3, -0.5, 0.0), vec3(0.3, 0.5, 0.0), vec3(-0.3, 0.5, 0.0)], glass);
    });
    scene.place(room, Mat4::IDENTITY);
    scene.place(block, Mat4::from_translation(vec3(-0.8, 0.0, 0.1)) * rotation(Vec3::Y, 0.06));
    scene.place(pillar, Mat4::from_translation(vec3(0.9, 0.0, -0.9)) * rotation(Vec3::Y, -0.04));
    scene.place(bar, Mat4::from_translation(vec3(0.5, 0.0, 0.6)) * rotation(Vec3::Y, 0.1));
    scene.place(lamp, Mat4::from_translation(vec3(-1.98, 1.5, -0.6)) * rotation(Vec3::Y, 0.25));
    let camera = Camera { origin: vec3(0.0, 1.5, 5.6), target: vec3(0.0, 1.25, 0.0), up: Vec3::Y, vfov_deg: 36.0 };
    let mut scene = scene.finish(camera);

    let lit = scene.meshes[lamp as usize].materials[0] as usize;
    scene.materials[lit].emission_texture = Some(0);
    scene.meshes[lamp as usize].uvs = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Into::into).to_vec();
    // Red, yellow, green and blue.
    let texels = vec![0xff20_30f0, 0xff20_c8f0, 0xff30_d050, 0xfff0_6030];
    scene.textures.push(Texture { name: "stained glass".to_owned(), width: 2, height: 2, srgb: true, texels });

    let mut add = |shape, emission: [f32; 3], world_from_object, motion| {
        let mesh = lights::add_shape(&mut scene, shape, emission.into(), false);
        scene.instances.push(Instance { mesh, world_from_object, motion });
    };
    let swing = Motion::Swing { offset: vec3(0.5, 0.0, 0.2), frequency_hz: 0.25, phase: 0.0 };
    add(Shape::Point, [0.5, 0.9, 1.6], Mat4::from_translation(vec3(-0.2, 1.3, -1.2)), swing);
    let spot = Shape::Spot { inner_deg: 12.0, outer_deg: 22.0 };
    let toward = (vec3(-0.8, 0.7, 0.1) - vec3(1.5, 2.8, 1.2)).normalize();
    add(spot, [26.0, 20.0, 12.0], lights::along(vec3(1.5, 2.8, 1.2), toward), Motion::Still);
    let ball = Mat4::from_translation(vec3(1.2, 0.3, 0.2)) * Mat4::from_scale(Vec3::splat(0.12));
    add(Shape::Sphere, [9.0, 3.0, 1.5], ball, Motion::Still);
    // On the ceiling, front down.
    let panel = [vec3(0.5, 0.0, 0.0), vec3(0.0, 0.0, 0.25), vec3(0.0, -1.0, 0.0)].map(|axis| axis.extend(0.0));
    let panel = Mat4::from_cols(panel[0], panel[1], panel[2], vec3(0.2, 2.98, -0.8).extend(1.0));
    add(Shape::Rectangle, [4.5, 4.4, 4.0], panel, Motion::Still);
    let direction = vec3(0.45, -0.55, -0.7).normalize();
    scene.distant.push(DistantLight { direction, irradiance: vec3(0.35, 0.42, 0.6) });
    scene
}
