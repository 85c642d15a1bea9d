use std::collections::{BTreeMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use glam::{Mat3, Vec3};

use super::*;
use crate::scene::{Mesh, Shape};

/// What a scene consists of; triangles are counted once a mesh, then over all instances.
#[derive(Debug, PartialEq)]
struct Counts {
    meshes: usize,
    instances: usize,
    unique_triangles: usize,
    triangles: usize,
    emissive_triangles: usize,
}

fn count(scene: &Scene) -> Counts {
    let emits = |&&material: &&u32| scene.materials[material as usize].emission != Vec3::ZERO;
    let emissive: Vec<usize> = scene
        .meshes
        .iter()
        .map(|mesh| mesh.materials.iter().take(mesh.triangles.len()).filter(emits).count())
        .collect();
    let over_instances =
        |of_mesh: &dyn Fn(usize) -> usize| scene.instances.iter().map(|i| of_mesh(i.mesh as usize)).sum();
    Counts {
        meshes: scene.meshes.len(),
        instances: scene.instances.len(),
        unique_triangles: scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum(),
        triangles: over_instances(&|mesh| scene.meshes[mesh].triangles.len()),
        emissive_triangles: over_instances(&|mesh| emissive[mesh]),
    }
}

fn built(name: &str) -> Scene {
    (find(name).expect("a built-in scene").build)()
}

fn corners(mesh: &Mesh, triangle: [u32; 3]) -> [Vec3; 3] {
    triangle.map(|vertex| mesh.positions[vertex as usize])
}

/// A digest of every number and name.
fn digest(scene: &Scene) -> u64 {
    let mut hasher = DefaultHasher::new();
    let mut feed = |numbers: &[f32]| numbers.iter().for_each(|x| x.to_bits().hash(&mut hasher));
    for mesh in &scene.meshes {
        mesh.positions.iter().chain(&mesh.normals).for_each(|v| feed(&v.to_array()));
    }
    scene.instances.iter().for_each(|instance| feed(&instance.world_from_object.to_cols_array()));
    for mesh in &scene.meshes {
        (&mesh.name, &mesh.triangles, &mesh.materials).hash(&mut hasher);
    }
    for instance in &scene.instances {
        (instance.mesh, format!("{:?}", instance.motion)).hash(&mut hasher);
    }
    let shapes: Vec<_> = scene.meshes.iter().map(|mesh| mesh.shape).collect();
    format!("{:?} {:?} {shapes:?} {:?}", scene.materials, scene.camera, scene.distant).hash(&mut hasher);
    hasher.finish()
}

#[test]
fn names_are_found_and_others_are_not() {
    for builtin in BUILTIN {
        assert_eq!(find(builtin.name).map(|found| found.description), Some(builtin.description));
        assert_eq!((builtin.build)().name, builtin.name);
    }
    assert!(find("no such scene").is_none());
}

#[test]
fn two_builds_are_equal_in_every_bit() {
    for builtin in BUILTIN {
        assert_eq!(digest(&(builtin.build)()), digest(&(builtin.build)()), "{}", builtin.name);
    }
}

#[test]
fn the_digest_sees_a_single_bit() {
    let scene = built("cornell");
    let mut other = scene.clone();
    other.meshes[1].positions[3].x = other.meshes[1].positions[3].x.next_up();
    assert_ne!(digest(&scene), digest(&other));
}

/// Published measurements name these scenes, so a change in them must be deliberate.
#[test]
fn the_scenes_are_as_large_as_they_were() {
    let pinned = BTreeMap::from(PINNED);
    for builtin in BUILTIN {
        assert_eq!(Some(&count(&(builtin.build)())), pinned.get(builtin.name), "{}", builtin.name);
    }
}

const PINNED: [(&str, Counts); 4] = [
    ("cornell", Counts { meshes: 4, instances: 4, unique_triangles: 36, triangles: 36, emissive_triangles: 2 }),
    ("studio", Counts { meshes: 9, instances: 9, unique_triangles: 48, triangles: 48, emissive_triangles: 2 }),
    (
        "rooms",
        Counts {
            meshes: 74,
            instances: 3_233,
            unique_triangles: 21_876,
            triangles: 963_312,
            emissive_triangles: 346_212,
        },
    ),
    (
        "park",
        Counts {
            meshes: 48,
            instances: 1_180,
            unique_triangles: 241_334,
            triangles: 4_368_284,
            emissive_triangles: 3_399_120,
        },
    ),
];

#[test]
fn the_scenes_have_the_lights_they_promise() {
    assert_eq!(count(&built("cornell")).emissive_triangles, 2);
    assert!(count(&built("rooms")).emissive_triangles >= 50_000);
    let park = count(&built("park")).emissive_triangles;
    assert!(park.abs_diff(3_400_000) <= 68_000, "{park}");
}

#[test]
fn indices_are_in_range() {
    for builtin in BUILTIN {
        let scene = (builtin.build)();
        for mesh in &scene.meshes {
            assert_eq!(mesh.positions.len(), mesh.normals.len(), "{}", mesh.name);
            let picks = if mesh.shape == Shape::Triangles { mesh.triangles.len() } else { 1 };
            assert_eq!(picks, mesh.materials.len(), "{}", mesh.name);
            assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.positions.len()), "{}", mesh.name);
            assert!(mesh.materials.iter().all(|&m| (m as usize) < scene.materials.len()), "{}", mesh.name);
        }
        assert!(scene.instances.iter().all(|instance| (instance.mesh as usize) < scene.meshes.len()));
    }
}

#[test]
fn triangles_are_finite_with_area_and_unit_normals_on_their_front() {
    for builtin in BUILTIN {
        for mesh in &(builtin.build)().meshes {
            assert!(mesh.normals.iter().all(|normal| normal.is_normalized()), "{}", mesh.name);
            for &triangle in &mesh.triangles {
                let [a, b, c] = corners(mesh, triangle);
                let front = (b - a).cross(c - a);
                assert!(front.is_finite() && front.length() > 1e-8, "{}: {a} {b} {c}", mesh.name);
                let normals = triangle.map(|vertex| mesh.normals[vertex as usize]);
                assert!(normals.iter().all(|normal| normal.dot(front) > 0.0), "{}: {a} {b} {c}", mesh.name);
            }
        }
    }
}

#[test]
fn no_triangle_lies_upon_its_like() {
    for builtin in BUILTIN {
        for mesh in &(builtin.build)().meshes {
            let mut seen = HashSet::new();
            for &triangle in &mesh.triangles {
                let mut key = corners(mesh, triangle).map(|p| p.to_array().map(|x| (x + 0.0).to_bits()));
                let first = (0..3).min_by_key(|&corner| key[corner]).expect("three corners");
                key.rotate_left(first);
                assert!(seen.insert(key), "{}: {:?}", mesh.name, corners(mesh, triangle));
            }
        }
    }
}

#[test]
fn placements_are_affine_and_can_be_undone() {
    for builtin in BUILTIN {
        for (index, instance) in (builtin.build)().instances.iter().enumerate() {
            let m = instance.world_from_object;
            assert_eq!(m.row(3).to_array(), [0.0, 0.0, 0.0, 1.0], "instance {index}");
            let undone = Mat3::from_mat4(m).inverse() * Mat3::from_mat4(m);
            assert!(undone.abs_diff_eq(Mat3::IDENTITY, 1e-3), "instance {index} of {}: {m}", builtin.name);
        }
    }
}

#[test]
fn the_camera_looks_at_something() {
    for builtin in BUILTIN {
        let camera = (builtin.build)().camera.expect("a camera");
        let view = camera.target - camera.origin;
        assert!(view.is_finite() && view.cross(camera.up).length() > 0.1, "{}", builtin.name);
        assert!(camera.vfov_deg > 0.0 && camera.vfov_deg < 180.0, "{}", builtin.name);
    }
}
