//! Lights as the user changes them, and the many that can be added.

use std::collections::HashMap;

use glam::{Mat4, Vec3};
use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};

use crate::{
    packed::Moment,
    scene::{Instance, Material, Mesh, Motion, Scene, Shape, bounds::Bounds},
};

/// Most lights that can be added.
pub const MOST: u32 = 1_000_000;

/// What the user has made of the light of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edit {
    /// The instance.
    pub instance: u32,
    /// How far it was moved, in scene units.
    pub offset: Vec3,
    /// How much larger it is.
    pub scale: f32,
    /// Factor on its emission, for each channel.
    pub color: Vec3,
    /// Factor on its emission.
    pub gain: f32,
    /// Whether it is on.
    pub on: bool,
}

impl Edit {
    /// As it is.
    pub fn new(instance: u32) -> Self {
        Self { instance, offset: Vec3::ZERO, scale: 1.0, color: Vec3::ONE, gain: 1.0, on: true }
    }
}

/// The scene at `time_s` with what the user has changed.
pub fn moment(scene: &Scene, time_s: f32, edits: &[Edit]) -> Moment {
    let mut moment = Moment { time_s, ..Moment::default() };
    for edit in edits {
        let Some(instance) = scene.instances.get(edit.instance as usize) else { continue };
        let emission = if edit.on { edit.color * edit.gain } else { Vec3::ZERO };
        if emission != Vec3::ONE {
            moment.emission.push((edit.instance, emission));
        }
        if edit.offset != Vec3::ZERO || edit.scale != 1.0 {
            let placed = instance.world_from_object_at(time_s);
            let mesh = &scene.meshes[instance.mesh as usize];
            let center = Bounds::of(mesh.positions.iter().map(|p| placed.transform_point3(*p)));
            // Shapes have no vertices, but stand about their origin.
            let center = center.map_or(placed.w_axis.truncate(), Bounds::center);
            let change = Mat4::from_translation(center + edit.offset)
                * Mat4::from_scale(Vec3::splat(edit.scale))
                * Mat4::from_translation(-center);
            moment.placed.push((edit.instance, change * placed));
        }
    }
    moment
}

/// A point by its bits, so that it can be looked up.
fn bits(point: Vec3) -> [u32; 3] {
    // Both zeros are one point.
    point.to_array().map(|x| (x + 0.0).to_bits())
}

/// Makes the light that holds the given triangle of an instance an instance of its own, unless it is one; returns which,
/// or nothing if the triangle is no light. A light is what hangs together of emissive triangles, or a shape.
///
/// `corners` are in object space as it is packed, that of the mesh less `origin` (`PackedScene::object_origin`).
pub fn detach(scene: &mut Scene, instance: u32, corners: [Vec3; 3], origin: Vec3) -> Option<u32> {
    let placement = scene.instances.get(instance as usize)?.clone();
    let mesh = &scene.meshes[placement.mesh as usize];
    if mesh.shape != Shape::Triangles {
        return Some(instance);
    }
    let emits = |triangle: usize| scene.materials[mesh.materials[triangle] as usize].is_emissive();
    let points = |triangle: usize| mesh.triangles[triangle].map(|v| bits(mesh.positions[v as usize]));
    let wanted = corners.map(bits);
    // By the subtraction that the packed corners come from: added, the origin would be off by roundings.
    let packed = |triangle: usize| mesh.triangles[triangle].map(|v| bits(mesh.positions[v as usize] - origin));
    let first = (0..mesh.triangles.len()).find(|&t| emits(t) && packed(t) == wanted)?;

    let mut at_point: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
    for triangle in (0..mesh.triangles.len()).filter(|&t| emits(t)) {
        points(triangle).into_iter().for_each(|point| at_point.entry(point).or_default().push(triangle));
    }
    let mut taken = vec![false; mesh.triangles.len()];
    taken[first] = true;
    let mut to_visit = vec![first];
    while let Some(triangle) = to_visit.pop() {
        for point in points(triangle) {
            for next in at_point.remove(&point).unwrap_or_default() {
                if !std::mem::replace(&mut taken[next], true) {
                    to_visit.push(next);
                }
            }
        }
    }
    if taken.iter().all(|taken| *taken) {
        return Some(instance);
    }
    let (light, rest) = (part(mesh, &taken, true), part(mesh, &taken, false));
    let shared = scene.instances.iter().filter(|other| other.mesh == placement.mesh).count() > 1;
    let rest_mesh = if shared {
        scene.meshes.push(rest);
        scene.meshes.len() as u32 - 1
    } else {
        scene.meshes[placement.mesh as usize] = rest;
        placement.mesh
    };
    scene.instances[instance as usize].mesh = rest_mesh;
    scene.meshes.push(light);
    scene.instances.push(Instance { mesh: scene.meshes.len() as u32 - 1, ..placement });
    Some(scene.instances.len() as u32 - 1)
}

/// The triangles of a mesh for which `taken` is `which`.
fn part(mesh: &Mesh, taken: &[bool], which: bool) -> Mesh {
    let mut part = Mesh { name: mesh.name.clone(), unseen: mesh.unseen, ..Mesh::default() };
    let mut renamed: HashMap<u32, u32> = HashMap::new();
    for (triangle, _) in mesh.triangles.iter().enumerate().filter(|(i, _)| taken[*i] == which) {
        let corners = mesh.triangles[triangle].map(|vertex| {
            *renamed.entry(vertex).or_insert_with(|| {
                part.positions.push(mesh.positions[vertex as usize]);
                part.normals.extend(mesh.normals.get(vertex as usize));
                part.uvs.extend(mesh.uvs.get(vertex as usize));
                part.positions.len() as u32 - 1
            })
        });
        part.triangles.push(corners);
        part.materials.push(mesh.materials[triangle]);
    }
    part
}

/// Adds `count` small triangles that shine to both sides, at random places in the scene. Together they always shine as
/// much, so that a picture with many has the brightness of one with few. Rays don't find them: a million of them in
/// everybody's way would make each ray dearer, and what is to be seen is what lights cost.
///
/// They are one mesh: instances would take 37 words of a buffer for each of two frames, more than the 128 MiB of a
/// binding at a million.
pub fn scatter(scene: &mut Scene, count: u32) {
    let Some(bounds) = scene.bounds().filter(|_| count > 0) else { return };
    const COLORS: [[f32; 3]; 6] =
        [[1.0, 0.35, 0.2], [1.0, 0.7, 0.3], [0.9, 0.9, 0.5], [0.35, 1.0, 0.5], [0.3, 0.6, 1.0], [0.8, 0.4, 1.0]];
    let size = bounds.size();
    let spacing = (size.x.max(1e-6) * size.y.max(1e-6) * size.z.max(1e-6) / count as f32).cbrt();
    let side = (0.05 * spacing).min(0.01 * size.length());
    let area = side * side * 3.0_f32.sqrt() / 4.0;
    let walls = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
    let radiance = (0.1 * walls / (area * count as f32)).clamp(0.0, 1e20);

    let first_material = scene.materials.len() as u32;
    scene.materials.extend(COLORS.map(|color| Material {
        name: "added light".to_owned(),
        base_color: Vec3::ZERO,
        emission: Vec3::from(color) * radiance,
        two_sided_emission: true,
        ..Material::default()
    }));
    let mut rng = Pcg64Mcg::seed_from_u64(u64::from(count));
    let mut unit = || (rng.next_u32() >> 8) as f32 / 16_777_216.0;
    let mut mesh = Mesh { name: "added lights".to_owned(), unseen: true, ..Mesh::default() };
    mesh.positions.reserve(3 * count as usize);
    for i in 0..count {
        let center = bounds.min + size * (0.02 + 0.96 * Vec3::new(unit(), unit(), unit()));
        let (z, turn, spin) = (2.0 * unit() - 1.0, std::f32::consts::TAU * unit(), std::f32::consts::TAU * unit());
        let normal = Vec3::new((1.0 - z * z).sqrt() * turn.cos(), z, (1.0 - z * z).sqrt() * turn.sin());
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        for corner in 0..3 {
            let angle = spin + corner as f32 * std::f32::consts::TAU / 3.0;
            let arm = tangent * angle.cos() + bitangent * angle.sin();
            mesh.positions.push(center + arm * side / 3.0_f32.sqrt());
        }
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        mesh.materials.push(first_material + i % COLORS.len() as u32);
    }
    scene.meshes.push(mesh);
    let mesh = scene.meshes.len() as u32 - 1;
    scene.instances.push(Instance { mesh, world_from_object: Mat4::IDENTITY, motion: Motion::Still });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        packed::PackedScene,
        render::{Request, frame_of},
        scene::{Camera, builtin},
        settings::Settings,
        technique::Technique,
        view::pick,
    };
    use glam::UVec2;

    fn cornell() -> Scene {
        (builtin::find("cornell").expect("built in").build)()
    }

    /// An emissive triangle of an instance, in object space.
    fn lit_triangle(scene: &Scene, instance: u32) -> [Vec3; 3] {
        let mesh = &scene.meshes[scene.instances[instance as usize].mesh as usize];
        let lit = (0..mesh.triangles.len()).find(|&t| scene.materials[mesh.materials[t] as usize].is_emissive());
        mesh.triangles[lit.expect("a light")].map(|v| mesh.positions[v as usize])
    }

    fn lit_instance(scene: &Scene) -> u32 {
        let emits = |i: &Instance| {
            let mesh = &scene.meshes[i.mesh as usize];
            mesh.materials.iter().any(|m| scene.materials[*m as usize].is_emissive())
        };
        scene.instances.iter().position(emits).expect("a light") as u32
    }

    #[test]
    fn a_detached_light_takes_its_triangles_along_and_no_others() {
        let mut scene = cornell();
        let (all, lit) = (scene.triangle_count(), scene.emissive_triangle_count());
        let instance = lit_instance(&scene);
        let corners = lit_triangle(&scene, instance);
        let light = detach(&mut scene, instance, corners, Vec3::ZERO).expect("a light");
        scene.validate().expect("still a scene");
        assert_eq!((scene.triangle_count(), scene.emissive_triangle_count()), (all, lit));
        let mesh = &scene.meshes[scene.instances[light as usize].mesh as usize];
        assert_eq!(mesh.triangles.len() as u64, lit);
        assert!(mesh.materials.iter().all(|m| scene.materials[*m as usize].is_emissive()));
        // Once it is an instance of its own, it stays one.
        let count = scene.instances.len();
        assert_eq!(detach(&mut scene, light, corners, Vec3::ZERO), Some(light));
        assert_eq!(scene.instances.len(), count);
    }

    #[test]
    fn a_wall_is_no_light() {
        let mut scene = cornell();
        let mesh = &scene.meshes[0];
        let dark = (0..mesh.triangles.len()).find(|&t| !scene.materials[mesh.materials[t] as usize].is_emissive());
        let corners = mesh.triangles[dark.expect("a wall")].map(|v| mesh.positions[v as usize]);
        assert_eq!(detach(&mut scene, 0, corners, Vec3::ZERO), None);
        assert_eq!(detach(&mut scene, 99, corners, Vec3::ZERO), None);
    }

    #[test]
    fn edits_move_scale_and_switch_what_they_name() {
        let scene = cornell();
        let edit = Edit { offset: Vec3::X, scale: 2.0, on: false, ..Edit::new(lit_instance(&scene)) };
        let shown = moment(&scene, 1.0, &[edit, Edit::new(0), Edit { gain: 9.0, ..Edit::new(77) }]);
        assert_eq!(shown.emission, [(edit.instance, Vec3::ZERO)]);
        let [(_, placed)] = shown.placed[..] else { panic!("one is moved") };
        let mesh = &scene.meshes[scene.instances[edit.instance as usize].mesh as usize];
        let center = Bounds::of(mesh.positions.iter().copied()).expect("triangles").center();
        assert!(placed.transform_point3(center).distance(center + Vec3::X) < 1e-4);
        assert!((placed.determinant() - 8.0).abs() < 1e-3);
    }

    /// A shape is picked though no ray finds it, and moves about its own origin.
    #[test]
    fn shapes_are_picked_by_nearness_and_moved_like_other_lights() {
        let mut scene = (builtin::find("studio").expect("built in").build)();
        let ball = scene.instances.iter().position(|i| scene.meshes[i.mesh as usize].shape == Shape::Sphere);
        let ball = ball.expect("a sphere") as u32;
        let center = scene.instances[ball as usize].world_from_object.w_axis.truncate();
        let packed = PackedScene::new(&scene, 0.0).expect("packs");
        let camera = Camera { target: center, ..scene.camera.expect("a camera") };
        let request = Request::new(camera, [33, 33], Technique::Candidates, Settings::default());
        let frame = frame_of(&packed, &request);
        let picked = pick::at(&packed, &frame, UVec2::splat(16)).expect("the sphere");
        assert_eq!((picked.instance, picked.emits), (ball, true));
        let aside = pick::at(&packed, &frame, UVec2::new(16, 25));
        assert!(aside.is_none_or(|picked| picked.instance != ball));
        assert_eq!(detach(&mut scene, ball, picked.corners_object, Vec3::ZERO), Some(ball));
        let edit = Edit { offset: Vec3::Y, scale: 2.0, ..Edit::new(ball) };
        let shown = moment(&scene, 0.0, &[edit]);
        let (_, placed) = shown.placed[0];
        assert!(placed.w_axis.truncate().abs_diff_eq(center + Vec3::Y, 1e-5), "{placed}");
        assert!((placed.x_axis.length() - 0.24).abs() < 1e-5, "{placed}");
    }

    /// Rays go as if they were not there; a click finds the nearest, and one of them can be moved alone.
    #[test]
    fn added_lights_are_in_no_rays_way_and_are_picked_by_nearness() {
        let (bare, mut scene) = (cornell(), cornell());
        scatter(&mut scene, 500);
        let camera = scene.camera.expect("a camera");
        let request = Request::new(camera, [48, 48], Technique::Candidates, Settings::default());
        let seen = |scene: &Scene| {
            let mut packed = PackedScene::new(scene, 0.0).expect("packs");
            // As if there were no lights to pick.
            packed.frame.emitter_count = 0;
            let frame = frame_of(&packed, &request);
            let of_pixel = |i: u32| pick::at(&packed, &frame, UVec2::new(i % 48, i / 48)).map(|p| p.position);
            (0..48 * 48).map(of_pixel).collect::<Vec<_>>()
        };
        assert_eq!(seen(&bare), seen(&scene));

        let (mesh, instance) = (scene.meshes.len() - 1, scene.instances.len() as u32 - 1);
        let corners = scene.meshes[mesh].triangles[77].map(|v| scene.meshes[mesh].positions[v as usize]);
        let center = corners.iter().sum::<Vec3>() / 3.0;
        let near = Camera { origin: center + Vec3::new(0.0, 0.0, 0.02), target: center, ..camera };
        let request = Request::new(near, [33, 33], Technique::Candidates, Settings::default());
        let packed = PackedScene::new(&scene, 0.0).expect("packs");
        let picked = pick::at(&packed, &frame_of(&packed, &request), UVec2::splat(16)).expect("the light");
        assert_eq!((picked.instance, picked.emits, picked.corners_object), (instance, true, corners));
        let alone = detach(&mut scene, instance, picked.corners_object, Vec3::ZERO).expect("a light");
        let of = |instance: u32| &scene.meshes[scene.instances[instance as usize].mesh as usize];
        assert_eq!((of(alone).triangles.len(), of(alone).unseen), (1, true));
        assert_eq!((of(instance).triangles.len(), of(instance).unseen), (499, true));
        scene.validate().expect("still a scene");
    }

    /// However many lights that can't be seen are on the way to it.
    #[test]
    fn a_light_that_is_seen_is_picked_before_added_ones() {
        let mut scene = cornell();
        let lamp = lit_instance(&scene);
        let center = lit_triangle(&scene, lamp).iter().sum::<Vec3>() / 3.0;
        scatter(&mut scene, 100_000);
        let camera = Camera { target: center, ..scene.camera.expect("a camera") };
        let packed = PackedScene::new(&scene, 0.0).expect("packs");
        let request = Request::new(camera, [33, 33], Technique::Candidates, Settings::default());
        let picked = pick::at(&packed, &frame_of(&packed, &request), UVec2::splat(16)).expect("the lamp");
        assert_eq!((picked.instance, picked.emits), (lamp, true));
    }

    #[test]
    fn added_lights_are_lights_in_the_scene_and_shine_alike_however_many() {
        let power = |count: u32| {
            let mut scene = cornell();
            let (bounds, before) = (scene.bounds().expect("walls"), scene.emissive_triangle_count());
            scatter(&mut scene, count);
            scene.validate().expect("still a scene");
            assert_eq!(scene.emissive_triangle_count(), before + u64::from(count));
            let mesh = scene.meshes.last().expect("the lights");
            assert!(mesh.positions.iter().all(|p| p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()));
            PackedScene::new(&scene, 0.0).expect("it fits");
            let area = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
                (b - a).cross(c - a).length() / 2.0
            };
            let of = |t: usize| area(&mesh.triangles[t]) * scene.materials[mesh.materials[t] as usize].emission.x;
            (0..mesh.triangles.len()).map(of).sum::<f32>()
        };
        let (few, many) = (power(600), power(60_000));
        assert!((few / many - 1.0).abs() < 0.02, "{few} {many}");
        let mut scene = cornell();
        scatter(&mut scene, 0);
        assert_eq!(scene.meshes.len(), cornell().meshes.len());
    }
}
