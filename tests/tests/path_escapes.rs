//! Names in scene files that lead elsewhere: nothing outside the scene's folder is opened, and nothing blocks.

use std::fs;
use std::path::Path;

use weir::scene::load::{LoadOptions, Loaded, load};

/// A scene whose material library and texture have these names, in `folder/scene/a.obj`, beside a secret.
fn scene(folder: &Path, library: &str, texture: &str) {
    let scene = folder.join("scene");
    fs::create_dir_all(&scene).expect("temporary folder");
    let obj = format!("mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
    fs::write(scene.join("a.obj"), obj).expect("writable");
    fs::write(scene.join("a.mtl"), format!("newmtl m\nKd 0 0 1\nmap_Kd {texture}\n")).expect("writable");
    fs::write(folder.join("secret.mtl"), "newmtl m\nKd 1 0 0\n").expect("writable");
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/folder/pixel.png"), folder.join("secret.png"))
        .expect("writable");
}

fn loaded(folder: &Path, options: &LoadOptions) -> Loaded {
    load(&folder.join("scene/a.obj"), options).expect("a wrong name is not worth an error")
}

#[test]
fn names_that_lead_out_of_the_folder_open_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let absolute = folder.path().join("secret.mtl").display().to_string();
    for library in ["../secret.mtl", "..\\secret.mtl", "x/../../secret.mtl", "./../scene/../secret.mtl", &absolute] {
        scene(folder.path(), library, "a.png");
        let Loaded { scene, warnings } = loaded(folder.path(), &LoadOptions::default());
        assert_eq!(scene.materials[0].base_color, glam::Vec3::splat(0.5), "{library} was opened");
        assert!(warnings[0].to_string().contains("a.obj:1: material library"), "{warnings:?}");
    }
    for texture in
        ["../secret.png", "/dev/zero", "/dev/stdin", "C:\\secret.png", "\\\\host\\share\\secret.png", "..", "."]
    {
        scene(folder.path(), "a.mtl", texture);
        let Loaded { scene, warnings } = loaded(folder.path(), &LoadOptions::default());
        assert!(scene.textures.is_empty(), "{texture} was opened");
        assert!(warnings[0].to_string().contains("a.mtl:3: texture"), "{warnings:?}");
    }
}

#[test]
fn an_asset_root_opens_one_more_folder() {
    let folder = tempfile::tempdir().expect("temporary folder");
    scene(folder.path(), "a.mtl", "../secret.png");
    let options = LoadOptions { asset_root: Some(folder.path().to_owned()), ..LoadOptions::default() };
    let Loaded { scene, warnings } = loaded(folder.path(), &options);
    assert_eq!((scene.textures.len(), warnings.len()), (1, 0), "{warnings:?}");
    let options = LoadOptions { asset_root: Some(folder.path().join("nowhere")), ..LoadOptions::default() };
    let error = load(&folder.path().join("scene/a.obj"), &options).expect_err("no such root").to_string();
    assert!(error.contains("the asset root is not a folder\nhelp: check `--asset-root`"), "{error}");
}

#[cfg(unix)]
#[test]
fn links_out_of_the_folder_open_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    scene(folder.path(), "link.mtl", "link.png");
    for name in ["secret.mtl", "secret.png"] {
        let link = folder.path().join("scene").join(name.replace("secret", "link"));
        std::os::unix::fs::symlink(folder.path().join(name), link).expect("writable");
    }
    let found = loaded(folder.path(), &LoadOptions::default()).scene;
    assert_eq!(found.materials[0].base_color, glam::Vec3::splat(0.5));
    // With the library inside, the link of the texture remains.
    scene(folder.path(), "a.mtl", "link.png");
    assert!(loaded(folder.path(), &LoadOptions::default()).scene.textures.is_empty());
}

#[cfg(unix)]
#[test]
fn a_scene_may_itself_be_a_link() {
    let folder = tempfile::tempdir().expect("temporary folder");
    scene(folder.path(), "a.mtl", "b.png");
    let link = folder.path().join("link.obj");
    std::os::unix::fs::symlink(folder.path().join("scene/a.obj"), &link).expect("writable");
    let scene = load(&link, &LoadOptions::default()).expect("loads").scene;
    assert_eq!(scene.materials[0].base_color, glam::Vec3::Z);
}

#[cfg(unix)]
#[test]
fn pipes_are_not_waited_for() {
    let folder = tempfile::tempdir().expect("temporary folder");
    scene(folder.path(), "pipe.mtl", "pipe.png");
    for name in ["pipe.mtl", "pipe.png", "pipe.obj"] {
        let made = std::process::Command::new("mkfifo").arg(folder.path().join("scene").join(name)).status();
        assert!(made.expect("mkfifo runs").success());
    }
    let Loaded { warnings, .. } = loaded(folder.path(), &LoadOptions::default());
    assert!(warnings[0].to_string().contains("it is not a regular file"), "{warnings:?}");
    scene(folder.path(), "a.mtl", "pipe.png");
    assert!(loaded(folder.path(), &LoadOptions::default()).scene.textures.is_empty());
    for path in ["scene/pipe.obj", "scene"] {
        let error = load(&folder.path().join(path), &LoadOptions::default()).expect_err(path).to_string();
        assert!(error.contains("is not a regular file\nhelp: "), "{error}");
    }
}

#[test]
fn a_missing_scene_is_an_error_with_its_path() {
    let error = load(Path::new("nowhere/a.obj"), &LoadOptions::default()).expect_err("missing").to_string();
    assert_eq!(error, "nowhere/a.obj: there is no such file\nhelp: check the path");
}
