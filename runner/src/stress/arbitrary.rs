//! Scenes and settings out of any bytes: what an adversary, a fuzzer or chance may think of.

use glam::{Mat4, Vec2, Vec3};

use super::clip::{Clip, Take};
use crate::{
    render::{Backend, RenderError},
    scene::{Camera, DistantLight, Environment, Instance, Material, Mesh, Motion, Scene, Shape, Texture, lights},
    settings::{KNOBS, Settings},
    technique::Technique,
};

/// Width and height of the pictures.
const SIZE: [u32; 2] = [16, 16];
/// Frames of each.
const FRAMES: u32 = 3;

/// Bytes that decide; zeros when they have run out.
struct Bytes<'a>(std::slice::Iter<'a, u8>);

impl Bytes<'_> {
    fn next(&mut self) -> u32 {
        u32::from(self.0.next().copied().unwrap_or(0))
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.next() % bound
    }

    fn unit(&mut self) -> f32 {
        match self.next() {
            0 => 0.0,
            255 => 1.0,
            254 => 1e-40,
            253 => 1e-20,
            252 => 1.0 - f32::EPSILON / 2.0,
            x => x as f32 / 252.0,
        }
    }

    /// Of any magnitude up to 10^`most`, of either sign.
    fn number(&mut self, most: f32) -> f32 {
        let sign = if self.next() & 1 == 0 { 1.0 } else { -1.0 };
        let magnitude = match self.below(8) {
            0 => 0.0,
            1 => 1e-40,
            2 => 10f32.powf(self.unit() * most),
            3 => 10f32.powf(-self.unit() * 20.0),
            _ => 4.0 * self.unit(),
        };
        sign * magnitude
    }

    fn vector(&mut self, most: f32) -> Vec3 {
        Vec3::new(self.number(most), self.number(most), self.number(most))
    }

    fn color(&mut self, most: f32) -> Vec3 {
        self.vector(most).abs()
    }
}

fn material(bytes: &mut Bytes<'_>, textures: u32) -> Material {
    let texture = |bytes: &mut Bytes<'_>| Some(bytes.below(3)).filter(|&t| t < textures);
    Material {
        base_color: Vec3::new(bytes.unit(), bytes.unit(), bytes.unit()),
        specular: if bytes.below(2) == 0 { Vec3::ZERO } else { Vec3::new(bytes.unit(), bytes.unit(), bytes.unit()) },
        roughness: bytes.unit(),
        metallic: bytes.unit(),
        emission: if bytes.below(2) == 0 { Vec3::ZERO } else { bytes.color(20.0).min(Vec3::splat(1e20)) },
        two_sided_emission: bytes.below(2) == 0,
        base_color_texture: texture(bytes),
        emission_texture: texture(bytes),
        alpha_texture: texture(bytes),
        ..Material::default()
    }
}

fn mesh(bytes: &mut Bytes<'_>, materials: u32) -> Mesh {
    let mut mesh = Mesh { name: "any".into(), ..Mesh::default() };
    let count = 3 + bytes.below(6);
    let most = if bytes.below(4) == 0 { 9.0 } else { 1.0 };
    mesh.positions = (0..count).map(|_| bytes.vector(most)).collect();
    if bytes.below(3) == 0 {
        mesh.normals = (0..count).map(|_| bytes.vector(1.0)).collect();
    }
    if bytes.below(2) == 0 {
        mesh.uvs = (0..count).map(|_| Vec2::new(bytes.number(9.0), bytes.number(9.0))).collect();
    }
    for _ in 0..1 + bytes.below(6) {
        mesh.triangles.push([bytes.below(count), bytes.below(count), bytes.below(count)]);
        mesh.materials.push(bytes.below(materials));
    }
    mesh
}

/// A shape anywhere, or a directional light.
fn other_light(bytes: &mut Bytes<'_>, scene: &mut Scene) {
    let kind = bytes.below(5);
    let emission = bytes.color(20.0).min(Vec3::splat(1e20));
    if kind == 4 {
        let direction = bytes.vector(1.0).normalize_or(Vec3::NEG_Y);
        scene.distant.push(DistantLight { direction, irradiance: emission });
        return;
    }
    let shape = match kind {
        0 => Shape::Point,
        1 => {
            let outer_deg = 1.0 + 89.0 * bytes.unit();
            Shape::Spot { inner_deg: outer_deg * bytes.unit(), outer_deg }
        }
        2 => Shape::Sphere,
        _ => Shape::Rectangle,
    };
    let linear = match bytes.below(3) {
        0 => Mat4::IDENTITY,
        1 => Mat4::from_scale(bytes.vector(3.0)),
        _ => Mat4::from_axis_angle(bytes.vector(1.0).normalize_or(Vec3::Y), bytes.number(1.0)),
    };
    let world_from_object = Mat4::from_translation(bytes.vector(1.0)) * linear;
    let motion = match bytes.below(3) {
        0 => Motion::Swing { offset: bytes.vector(3.0), frequency_hz: bytes.number(3.0), phase: bytes.unit() },
        _ => Motion::Still,
    };
    let mesh = lights::add_shape(scene, shape, emission, bytes.below(2) == 0);
    scene.instances.push(Instance { mesh, world_from_object, motion });
}

/// A scene that keeps all promises that its validation asks for, or none.
fn scene(bytes: &mut Bytes<'_>) -> Option<Scene> {
    let texture = |bytes: &mut Bytes<'_>| {
        let (width, height) = (1 + bytes.below(4), 1 + bytes.below(4));
        let texels = (0..width * height).map(|_| bytes.next().wrapping_mul(0x0102_0305)).collect();
        Texture { name: "any".into(), width, height, texels, srgb: bytes.below(2) == 0 }
    };
    let textures: Vec<_> = (0..bytes.below(3)).map(|_| texture(bytes)).collect();
    let materials: Vec<_> = (0..1 + bytes.below(4)).map(|_| material(bytes, textures.len() as u32)).collect();
    let meshes: Vec<_> = (0..1 + bytes.below(3)).map(|_| mesh(bytes, materials.len() as u32)).collect();
    let instance = |bytes: &mut Bytes<'_>| {
        let linear = match bytes.below(4) {
            0 => Mat4::IDENTITY,
            1 => Mat4::from_scale(bytes.vector(3.0)),
            _ => Mat4::from_axis_angle(bytes.vector(1.0).normalize_or(Vec3::Y), bytes.number(1.0)),
        };
        let motion = match bytes.below(3) {
            0 => Motion::Swing { offset: bytes.vector(3.0), frequency_hz: bytes.number(3.0), phase: bytes.unit() },
            _ => Motion::Still,
        };
        let world_from_object = Mat4::from_translation(bytes.vector(1.0)) * linear;
        Instance { mesh: bytes.below(meshes.len() as u32), world_from_object, motion }
    };
    let instances: Vec<_> = (0..1 + bytes.below(5)).map(|_| instance(bytes)).collect();
    let environment = (bytes.below(3) == 0).then(|| {
        let (width, height) = (1 + bytes.below(5), 1 + bytes.below(4));
        let texels = (0..width * height).map(|_| bytes.color(20.0).min(Vec3::splat(1e20)).to_array()).collect();
        let (rotation_deg, scale) = (bytes.number(6.0), bytes.number(20.0).abs());
        Environment { name: "any".into(), width, height, texels, rotation_deg, scale }
    });
    let (origin, target, up) = (bytes.vector(1.0), bytes.vector(1.0), bytes.vector(1.0));
    let camera = Some(Camera { origin, target, up, vfov_deg: 1.0 + 170.0 * bytes.unit() });
    let name = "any".into();
    let mut scene = Scene { name, meshes, instances, materials, textures, environment, distant: Vec::new(), camera };
    // Last, so that inputs from before there were such lights stand for what they stood for.
    for _ in 0..bytes.below(5) {
        other_light(bytes, &mut scene);
    }
    scene.validate().is_ok().then_some(scene)
}

/// Values of knobs, each among those it takes; those that exclude each other are left alone.
fn knobs(bytes: &mut Bytes<'_>) -> Vec<String> {
    let mut settings = Settings::default();
    let mut turned = Vec::new();
    for _ in 0..bytes.below(8) {
        let knob = &KNOBS[bytes.below(KNOBS.len() as u32) as usize];
        let value = match knob.values.split_once(" to ").map(|(low, high)| (low.parse::<f64>(), high.parse::<f64>())) {
            // Large counts take long and are no more than more of the same.
            Some((Ok(low), Ok(high))) => (low + (high.min(64.0) - low) * f64::from(bytes.unit())).round().to_string(),
            _ => {
                let named: Vec<&str> = knob.values.split([',', ' ']).filter(|v| !matches!(*v, "" | "or")).collect();
                named[bytes.below(named.len() as u32) as usize].to_owned()
            }
        };
        let mut next = settings.clone();
        if knob.set(&mut next, &value) && next.check().is_ok() {
            settings = next;
            turned.push(format!("{}={value}", knob.key));
        }
    }
    // For a picture of 256 pixels, few lights need to be drawn ahead.
    turned.extend(["tiles.count=3", "tiles.size=32", "cells.slots=2", "cells.candidates=2"].map(String::from));
    turned
}

/// Renders three frames of 16 by 16 pixels of what the bytes stand for; pixels that are negative or not finite, or nothing
/// if the bytes stand for no scene.
///
/// # Errors
/// If the GPU fails, or the scene can't be shown.
pub fn unusable_pixels(backend: &Backend<'_>, bytes: &[u8]) -> Result<Option<usize>, RenderError> {
    let mut bytes = Bytes(bytes.iter());
    let technique = [Technique::Still, Technique::RealTime, Technique::Candidates][bytes.below(3) as usize];
    let knobs = knobs(&mut bytes);
    let Some(scene) = scene(&mut bytes) else { return Ok(None) };
    let knobs: Vec<&str> = knobs.iter().map(String::as_str).collect();
    let mut take = Take { size: SIZE, ..Take::still(&scene, technique, &knobs) };
    if technique == Technique::RealTime {
        let shot = take.shots[0].clone();
        take.shots = (0..FRAMES)
            .map(|i| {
                let mut shot = shot.clone();
                shot.moment.time_s = i as f32 * 0.1;
                shot
            })
            .collect();
    }
    let mut clip = Clip::new(backend, &take)?;
    for i in 0..FRAMES {
        let shot = if technique == Technique::RealTime { i as usize } else { 0 };
        clip.show(shot, |frames| (frames.now.index, frames.now.accumulated) = (i, i))?;
    }
    let still = super::clip::Still { moments: clip.output("moments")?, frames: Vec::new() };
    Ok(Some(still.unusable()))
}
