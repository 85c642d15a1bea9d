use std::fs;

use glam::{Mat4, Vec2, Vec3, vec3};

use super::*;
use crate::scene::{Instance, Material, Mesh, Motion, builtin};

fn read_back(report: &ExportReport) -> (Vec<tobj::Model>, Vec<tobj::Material>) {
    let (models, materials) = tobj::load_obj(&report.files[0], &tobj::LoadOptions::default()).expect("an OBJ file");
    (models, materials.expect("an MTL file"))
}

/// A quad of two materials, in a frame that `world_from_object` maps to the world.
fn small_scene(world_from_object: Mat4) -> Scene {
    Scene {
        name: "small scene".to_owned(),
        meshes: vec![Mesh {
            name: "quad".to_owned(),
            positions: vec![Vec3::ZERO, Vec3::X, vec3(1.0, 1.0, 0.1), Vec3::Y, Vec3::X],
            normals: vec![Vec3::Z, Vec3::Z, vec3(0.6, 0.0, 0.8), Vec3::ZERO, Vec3::Z],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y, Vec2::X],
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 4, 2]],
            materials: vec![1, 0, 1],
            ..Mesh::default()
        }],
        instances: vec![Instance { mesh: 0, world_from_object, motion: Motion::Still }],
        materials: vec![
            Material {
                name: "same name".to_owned(),
                specular: Vec3::splat(0.04),
                roughness: 0.3,
                base_color_texture: Some(0),
                ..Material::default()
            },
            Material { name: "same name".to_owned(), emission: vec3(1.0, 0.1, 1.0 / 3.0), ..Material::default() },
        ],
        textures: vec![Texture {
            name: "dots".to_owned(),
            width: 2,
            height: 1,
            srgb: true,
            texels: vec![0xff00_00ff, 0x8012_3456],
        }],
        environment: Some(Environment {
            name: "sky".to_owned(),
            width: 2,
            height: 1,
            texels: vec![[0.1, 0.2, 0.3], [4.0, 5.0, 1.0 / 3.0]],
            rotation_deg: 30.0,
            scale: 2.0,
        }),
        ..Scene::default()
    }
}

fn vertex(mesh: &tobj::Mesh, list: &[f32], index: u32) -> Vec3 {
    assert!(!mesh.indices.is_empty());
    Vec3::from_slice(&list[3 * index as usize..])
}

/// Corners in world space, in the order of the export: by material, then as they come.
fn expected_corners(scene: &Scene) -> Vec<Vec3> {
    let mut corners = Vec::new();
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh as usize];
        let mut order: Vec<usize> = (0..mesh.triangles.len()).collect();
        order.sort_by_key(|&triangle| mesh.materials[triangle]);
        for triangle in order {
            let mut vertices = mesh.triangles[triangle];
            if instance.world_from_object.determinant() < 0.0 {
                vertices.swap(1, 2);
            }
            let world = |v: u32| instance.world_from_object_at(0.0).transform_point3(mesh.positions[v as usize]);
            corners.extend(vertices.map(world));
        }
    }
    corners
}

fn assert_reads_back(scene: &Scene) {
    let dir = tempfile::tempdir().expect("a directory");
    let report = export(scene, dir.path()).expect("an export");
    let (models, _) = read_back(&report);
    let corners: Vec<Vec3> = models
        .iter()
        .flat_map(|model| model.mesh.indices.iter().map(|&i| vertex(&model.mesh, &model.mesh.positions, i)))
        .collect();
    assert_eq!(corners, expected_corners(scene), "{}", scene.name);
    assert_eq!(report.triangles, corners.len() as u64 / 3);
}

#[test]
fn positions_read_back_bit_by_bit() {
    assert_reads_back(&small_scene(Mat4::from_scale_rotation_translation(
        vec3(0.3, 1.7, 2.1),
        glam::Quat::from_rotation_x(0.4),
        vec3(1e-7, 1e6, 1.0 / 3.0),
    )));
    for name in ["cornell", "rooms"] {
        assert_reads_back(&(builtin::find(name).expect("a built-in scene").build)());
    }
}

#[test]
fn equal_positions_are_written_once() {
    let dir = tempfile::tempdir().expect("a directory");
    let report = export(&small_scene(Mat4::IDENTITY), dir.path()).expect("an export");
    assert_eq!((report.positions, report.triangles, report.emissive_triangles), (4, 3, 2));
}

#[test]
fn a_mirrored_instance_keeps_its_front_in_front() {
    for scale in [vec3(1.0, 1.0, 1.0), vec3(-2.0, 1.0, 1.0)] {
        let dir = tempfile::tempdir().expect("a directory");
        let report = export(&small_scene(Mat4::from_scale(scale)), dir.path()).expect("an export");
        for model in read_back(&report).0 {
            let mesh = &model.mesh;
            for face in 0..mesh.indices.len() / 3 {
                let at = |corner: usize| 3 * face + corner;
                let [a, b, c] = [0, 1, 2].map(|k| vertex(mesh, &mesh.positions, mesh.indices[at(k)]));
                let geometric = (b - a).cross(c - a).normalize();
                for k in 0..3 {
                    let normal = vertex(mesh, &mesh.normals, mesh.normal_indices[at(k)]);
                    assert!(normal.dot(geometric) > 0.5, "scale {scale}: {normal} against {geometric}");
                    assert!(geometric.z > 0.0);
                }
            }
        }
    }
}

#[test]
fn materials_read_back_with_names_of_their_own() {
    let dir = tempfile::tempdir().expect("a directory");
    let (_, materials) = read_back(&export(&small_scene(Mat4::IDENTITY), dir.path()).expect("an export"));
    let [coated, lamp] = &materials[..] else { panic!("{} materials", materials.len()) };
    assert_eq!((&*coated.name, &*lamp.name), ("same_name", "same_name-1"));
    assert_eq!(coated.unknown_param["Pr"], "0.3");
    let index = coated.optical_density.expect("a refractive index");
    assert!((((index - 1.0) / (index + 1.0)).powi(2) - 0.04).abs() < 1e-7);
    assert_eq!(
        (coated.diffuse_texture.as_deref(), coated.diffuse),
        (Some("small_scene-texture-0.png"), Some([0.5; 3]))
    );
    assert_eq!((lamp.illumination_model, lamp.specular), (Some(1), Some([0.0; 3])));
    assert_eq!(lamp.emissive, Some([1.0, 0.1, 1.0 / 3.0]));
}

#[test]
fn images_and_camera_read_back() {
    let dir = tempfile::tempdir().expect("a directory");
    let mut scene = small_scene(Mat4::IDENTITY);
    let camera = Camera { origin: Vec3::ZERO, target: vec3(0.1, 0.2, 0.3), up: Vec3::Y, vfov_deg: 38.5 };
    scene.camera = Some(camera);
    export(&scene, dir.path()).expect("an export");

    let pixels = image::open(dir.path().join("small_scene-texture-0.png")).expect("a PNG file").into_rgba8();
    let texels: Vec<u32> = pixels.pixels().map(|pixel| u32::from_le_bytes(pixel.0)).collect();
    assert_eq!(texels, scene.textures[0].texels);

    let exr = exr::prelude::read_first_rgba_layer_from_file(
        dir.path().join("small_scene-environment.exr"),
        |size, _| (size.width(), Vec::new()),
        |(_, texels), _, (r, g, b, _): (f32, f32, f32, f32)| texels.push([r, g, b]),
    )
    .expect("an EXR file");
    assert_eq!(Some(exr.layer_data.channel_data.pixels.1), scene.environment.map(|map| map.texels));

    let json = fs::read_to_string(dir.path().join("small_scene-camera.json")).expect("a camera file");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["vfov_deg"].as_f64(), Some(38.5));
    assert_eq!(json["target"][2].as_f64().map(|z| z as f32), Some(camera.target.z));
    assert_eq!(json["environment"]["rotation_deg"].as_f64(), Some(30.0));
}

fn names_in(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).expect("a directory");
    entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn a_failed_export_leaves_no_files() {
    let dir = tempfile::tempdir().expect("a directory");
    // The last file to be named cannot be: a directory has its name.
    fs::create_dir(dir.path().join("small_scene-environment.exr")).expect("a directory");
    let error = export(&small_scene(Mat4::IDENTITY), dir.path()).expect_err("a name that is taken");
    assert!(error.to_string().contains("small_scene-environment.exr"), "{error}");
    assert_eq!(names_in(dir.path()), ["small_scene-environment.exr"]);
}

#[test]
fn a_failure_while_writing_removes_the_directories_it_made() {
    let dir = tempfile::tempdir().expect("a directory");
    let inner = dir.path().join("a/b");
    let mut files = PendingFiles::in_dir(&inner).expect("a directory");
    files.write("first", |out| writeln!(out, "complete")).expect("a file");
    let full = |_: &mut _| Err(io::Error::from(io::ErrorKind::StorageFull));
    let error = files.write("second", full).expect_err("a full disk");
    assert!(error.to_string().contains("second"), "{error}");
    drop(files);
    assert!(names_in(dir.path()).is_empty());
}

#[test]
fn a_file_in_place_of_the_directory_is_an_error() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let error = export(&small_scene(Mat4::IDENTITY), &file.path().join("below")).expect_err("not a directory");
    assert!(matches!(error, ExportError::Directory { .. }), "{error}");
}

#[test]
fn indices_out_of_range_are_an_error_in_words() {
    let mut scene = small_scene(Mat4::IDENTITY);
    scene.meshes[0].materials[2] = 9;
    let dir = tempfile::tempdir().expect("a directory");
    let error = export(&scene, dir.path()).expect_err("no such material");
    assert!(error.to_string().contains("mesh `quad` refers to material 9, there are 2"), "{error}");
    assert!(names_in(dir.path()).is_empty());
}
