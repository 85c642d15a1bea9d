//! Damaged, odd and hostile scene files: each is an error or a warning at its place, or means what it should.
//!
//! `corpus/expected.txt` holds what loading each file of the corpus says. After a change of wording, write it anew with
//! `WEIR_BLESS=1 cargo test -p weir-tests --test bad_input`, and read the difference.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{MAIN_SEPARATOR_STR, Path, PathBuf};

use glam::Vec3;
use weir::scene::Material;
use weir::scene::error::SceneError;
use weir::scene::load::{LoadOptions, Loaded, load};

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus")
}

fn try_load(name: &str) -> Result<Loaded, SceneError> {
    load(&corpus().join(format!("{name}.obj")), &LoadOptions::default())
}

fn loaded(name: &str) -> Loaded {
    try_load(name).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// What loading a file of the corpus says, without the path of the corpus.
fn report(name: &str) -> String {
    let mut report = String::new();
    match try_load(name) {
        Ok(Loaded { scene, warnings }) => {
            writeln!(report, "{} triangles", scene.triangle_count()).expect("memory");
            warnings.iter().for_each(|warning| writeln!(report, "warning: {warning}").expect("memory"));
        }
        Err(error) => writeln!(report, "error: {error}").expect("memory"),
    }
    let folder = corpus().display().to_string();
    report.replace(&format!("{folder}{MAIN_SEPARATOR_STR}"), "").replace("1 triangles\n", "1 triangle\n")
}

fn scene_names() -> Vec<String> {
    let files = corpus().read_dir().expect("the corpus is a folder").flatten();
    let names = files.filter_map(|file| file.file_name().into_string().ok());
    let mut names: Vec<_> = names.filter_map(|name| Some(name.strip_suffix(".obj")?.to_owned())).collect();
    names.sort();
    names
}

#[test]
fn every_file_of_the_corpus_says_what_is_expected() {
    let path = corpus().join("expected.txt");
    let reports: BTreeMap<String, String> =
        scene_names().into_iter().map(|name| (name.clone(), report(&name))).collect();
    if std::env::var_os("WEIR_BLESS").is_some() {
        let text: String = reports.iter().map(|(name, report)| format!("[{name}]\n{report}\n")).collect();
        std::fs::write(&path, text).expect("the corpus is writable");
    }
    let expected = std::fs::read_to_string(&path).expect("the corpus has its expectations");
    let mut expected: BTreeMap<&str, &str> =
        expected.split("\n\n").filter_map(|section| section.trim().strip_prefix('[')?.split_once("]\n")).collect();
    for (name, report) in &reports {
        assert_eq!(Some(report.trim()), expected.remove(name.as_str()), "{name}");
    }
    assert!(expected.is_empty(), "expectations without a file: {expected:?}");
    assert!(reports.len() >= 90, "the corpus has lost files: {} are left", reports.len());
}

#[test]
fn every_error_names_its_file_and_a_remedy() {
    let mut with_line = 0;
    for name in scene_names() {
        let Err(error) = try_load(&name) else {
            continue;
        };
        let error = error.to_string();
        let (what, help) = error.split_once("\nhelp: ").unwrap_or_else(|| panic!("{name} has no help: {error}"));
        assert!(what.contains(&format!("{name}.obj:")) && !help.is_empty(), "{error}");
        with_line += usize::from(what.contains(".obj:1:") || what.contains(".obj:4:") || what.contains(".obj:5:"));
    }
    assert!(with_line >= 18, "{with_line}");
}

#[test]
fn line_ends_marks_tabs_and_colours_do_not_change_the_geometry() {
    for name in
        ["mac_line_ends", "windows_line_ends", "no_final_line_end", "byte_order_mark", "tabs", "some_vertex_colors"]
    {
        assert_eq!(loaded(name).scene.meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y], "{name}");
    }
    assert_eq!(loaded("homogeneous_vertices").scene.meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(loaded("several_objects").scene.meshes.len(), 1);
    assert_eq!(loaded("some_normals").scene.meshes[0].normals, [Vec3::Z, Vec3::Z, Vec3::ZERO]);
}

#[test]
fn odd_materials_mean_what_they_should() {
    let material = |name: &str| -> Material { loaded(name).scene.materials[0].clone() };
    let teal = Vec3::new(0.25, 0.5, 0.75);
    let colors = [
        ("tabs", teal),
        ("library_after_use", teal),
        ("library_drive_letter", teal),
        ("library_with_blanks", Vec3::Z),
        ("library_outside", Vec3::splat(0.5)),
        ("inline_comments", teal),
        ("kd_one_component", Vec3::splat(0.5)),
        ("kd_out_of_range", Vec3::Y),
        ("illum_300", Vec3::Y),
        ("material_twice", Vec3::Y),
        // The library has `e` with a grave accent too, in Latin-1, as another material.
        ("latin1", Vec3::Y),
    ];
    for (name, color) in colors {
        assert_eq!(material(name).base_color, color, "{name}");
    }
    for (name, emission) in [
        ("ke_two_components", Vec3::new(1.0, 2.0, 2.0)),
        ("ke_out_of_range", Vec3::new(0.0, 0.0, 1e20)),
        ("kd_spectral", Vec3::ONE),
        ("ka_emission", Vec3::ZERO),
    ] {
        assert_eq!(material(name).emission, emission, "{name}");
    }
    let libraries = loaded("two_libraries").scene;
    assert_eq!(libraries.materials.iter().map(|m| m.base_color).collect::<Vec<_>>(), [Vec3::X, Vec3::Y]);
}

#[test]
fn textures_are_found_behind_options_and_foreign_paths() {
    let scene = loaded("texture_options").scene;
    assert_eq!((scene.materials[0].base_color_texture, scene.materials[0].alpha_texture), (Some(0), Some(1)));
    assert_eq!(scene.textures[0].texels, [u32::from_le_bytes([255, 128, 0, 255])]);
    assert!(scene.textures[0].srgb && !scene.textures[1].srgb);
    assert_eq!(loaded("texture_elsewhere").scene.textures[0].texels, scene.textures[0].texels);
}

#[test]
fn lambert_and_flat_leave_only_kd_and_the_geometry() {
    let options = LoadOptions { lambert: true, flat: true, ..LoadOptions::default() };
    let glass = load(&corpus().join("glass.obj"), &options).expect("loads").scene;
    assert_eq!((glass.materials[0].specular, glass.materials[0].base_color), (Vec3::ZERO, Vec3::ZERO));
    assert_eq!(loaded("glass").scene.materials[0].specular, Vec3::ONE);
    assert!(load(&corpus().join("some_normals.obj"), &options).expect("loads").scene.meshes[0].normals.is_empty());
}
