//! The classical box of red and green walls, two blocks and one light.

use glam::{Mat4, Vec3, vec3};

use super::assembly::Assembly;
use super::shapes::rotation;
use crate::scene::{Camera, Scene};

/// Half the inner width, and half the depth, in metres.
const HALF: f32 = 1.0;
const HEIGHT: f32 = 2.0;

/// A box of 2 m, open to the viewer, under one square light of two triangles.
pub fn build() -> Scene {
    let mut scene = Assembly::new("cornell");
    let white = scene.matte("white", [0.73, 0.71, 0.68]);
    let red = scene.matte("red", [0.62, 0.06, 0.05]);
    let green = scene.matte("green", [0.13, 0.44, 0.10]);
    let block = scene.glossy("glazed blue-grey", [0.42, 0.50, 0.60], 0.3);
    let light = scene.lamp("light", [1.0, 0.80, 0.54], 24.0);

    let corner = |x: f32, y: f32, z: f32| vec3(x * HALF, y * HEIGHT, z * HALF);
    let walls = scene.mesh("walls", |m| {
        let (left, right, front, back) = (-1.0, 1.0, 1.0, -1.0);
        let wall = |corners: [(f32, f32, f32); 4]| corners.map(|(x, y, z)| corner(x, y, z));
        m.quad(wall([(left, 0.0, front), (right, 0.0, front), (right, 0.0, back), (left, 0.0, back)]), white);
        m.quad(wall([(left, 1.0, back), (right, 1.0, back), (right, 1.0, front), (left, 1.0, front)]), white);
        m.quad(wall([(left, 0.0, back), (right, 0.0, back), (right, 1.0, back), (left, 1.0, back)]), white);
        m.quad(wall([(left, 0.0, front), (left, 0.0, back), (left, 1.0, back), (left, 1.0, front)]), red);
        m.quad(wall([(right, 0.0, back), (right, 0.0, front), (right, 1.0, front), (right, 1.0, back)]), green);
    });
    let short = scene.mesh("short block", |m| m.cuboid(vec3(-0.3, -0.01, -0.3), vec3(0.3, 0.6, 0.3), white));
    let tall = scene.mesh("tall block", |m| m.cuboid(vec3(-0.3, -0.01, -0.3), vec3(0.3, 1.2, 0.3), block));
    let lamp = scene.mesh("light", |m| {
        // A hair below the ceiling, facing down.
        m.grid(vec3(-0.26, HEIGHT - 0.01, 0.20), Vec3::X * 0.52, Vec3::Z * 0.40, 1, 1, light);
    });

    scene.place(walls, Mat4::IDENTITY);
    scene.place(short, Mat4::from_translation(vec3(0.36, 0.0, -0.08)) * rotation(Vec3::Y, -0.05));
    scene.place(tall, Mat4::from_translation(vec3(-0.36, 0.0, -0.50)) * rotation(Vec3::Y, 0.055));
    scene.place(lamp, Mat4::IDENTITY);
    scene.finish(Camera { origin: vec3(0.0, 1.0, 4.0), target: vec3(0.0, 1.0, 0.0), up: Vec3::Y, vfov_deg: 38.0 })
}
