//! What the compiled shaders were compiled from, as one number. The build script includes this file too.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// The toolchain that rust-gpu 0.11 is built for.
pub const TOOLCHAIN: &str = "nightly-2026-08-15";

/// Where the modules and [`DIGEST_FILE`] are, from the root of the workspace.
pub const FOLDER: &str = "assets/shaders";

/// A line `<blake3>  <what>` for the sources and for each module.
pub const DIGEST_FILE: &str = "weir.digest";

/// Optimised.
pub const PLAIN_FILE: &str = "weir.spv";

/// Not optimised, and without contraction: the arithmetic of the host.
pub const STRICT_FILE: &str = "weir-strict.spv";

/// As strict; of the passes that trace rays only, by ray queries.
pub const RAY_QUERY_FILE: &str = "weir-ray-query.spv";

/// All modules, in the order in which [`digest`] takes them.
pub const MODULES: [&str; 3] = [PLAIN_FILE, STRICT_FILE, RAY_QUERY_FILE];

/// Packages outside the workspace whose code is in the modules.
const PACKAGES: [&str; 3] = ["bytemuck", "glam", "spirv-std"];

/// Folders of the workspace whose Rust sources and manifests are in the modules.
pub const SOURCES: [&str; 2] = ["shader", "shared"];

/// The text of [`DIGEST_FILE`] for the sources below `root` and the [`MODULES`].
///
/// # Errors
///
/// Where a source or `Cargo.lock` cannot be read.
pub fn digest(root: &Path, modules: [&[u8]; MODULES.len()]) -> io::Result<String> {
    let mut text = format!("{}  sources\n", hash_sources(root)?);
    for (name, module) in MODULES.iter().zip(modules) {
        text += &format!("{}  {name}\n", blake3::hash(module).to_hex());
    }
    Ok(text)
}

/// The same for every line ending, checkout and operating system.
fn hash_sources(root: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    let mut field = |text: &str| {
        // The length in front, so that no two lists of fields look alike.
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    field(TOOLCHAIN);
    for package in locked(&read(&root.join("Cargo.lock"))?) {
        field(&package);
    }
    let mut files = Vec::new();
    for folder in SOURCES {
        list(&root.join(folder), folder, &mut files)?;
    }
    files.sort();
    for (name, path) in files {
        field(&name);
        field(&read(&path)?);
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// The text of a file with `\n` line ends; an error names the file.
fn read(path: &Path) -> io::Result<String> {
    let text = fs::read_to_string(path).map_err(|e| named(e, path))?;
    Ok(text.replace("\r\n", "\n"))
}

fn named(error: io::Error, path: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{error}: {}", path.display()))
}

/// `name version` of [`PACKAGES`] in the text of a `Cargo.lock`.
fn locked(lock: &str) -> Vec<String> {
    let mut found = Vec::new();
    for block in lock.split("[[package]]") {
        let value =
            |key: &str| block.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = \"")?.strip_suffix('"'));
        if let (Some(name), Some(version)) = (value("name"), value("version"))
            && PACKAGES.contains(&name)
        {
            found.push(format!("{name} {version}"));
        }
    }
    found
}

/// Adds the sources in `folder`, under names with `/` that start with `name`. Build outputs are no sources.
fn list(folder: &Path, name: &str, files: &mut Vec<(String, PathBuf)>) -> io::Result<()> {
    for entry in fs::read_dir(folder).map_err(|e| named(e, folder))? {
        let path = entry.map_err(|e| named(e, folder))?.path();
        let last = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let name = format!("{name}/{last}");
        if path.is_dir() {
            if last != "target" {
                list(&path, &name, files)?;
            }
        } else if last == "Cargo.toml" || last.ends_with(".rs") {
            files.push((name, path));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(root: &Path, name: &str, text: &str) {
        let path = root.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("creatable");
        fs::write(path, text).expect("writable");
    }

    fn workspace() -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("a folder");
        let package =
            |name: &str, version: &str| format!("[[package]]\nname = \"{name}\"\nversion = \"{version}\"\n\n");
        write(root.path(), "Cargo.lock", &(package("clap", "4.0.0") + &package("glam", "0.34.3")));
        write(root.path(), "shader/src/lib.rs", "fn a() {}\nfn b() {}\n");
        write(root.path(), "shared/Cargo.toml", "[package]\n");
        root
    }

    #[test]
    fn line_ends_folders_and_other_files_do_not_change_the_digest() {
        let (one, other) = (workspace(), workspace());
        write(other.path(), "shader/src/lib.rs", "fn a() {}\r\nfn b() {}\r\n");
        write(other.path(), "shader/README.md", "text");
        write(other.path(), "shared/target/out.rs", "generated");
        write(other.path(), "Cargo.lock", "[[package]]\r\nname = \"glam\"\r\nversion = \"0.34.3\"\r\n");
        assert_eq!(hash_sources(one.path()).expect("readable"), hash_sources(other.path()).expect("readable"));
    }

    #[test]
    fn sources_their_names_and_versions_of_packages_change_the_digest() {
        let before = hash_sources(workspace().path()).expect("readable");
        for (name, text) in [
            ("shader/src/lib.rs", "fn a() {}\nfn c() {}\n"),
            ("shader/src/new.rs", ""),
            ("shared/Cargo.toml", "[package]\n\n"),
            ("Cargo.lock", "[[package]]\nname = \"glam\"\nversion = \"0.34.4\"\n"),
        ] {
            let changed = workspace();
            write(changed.path(), name, text);
            assert_ne!(hash_sources(changed.path()).expect("readable"), before, "{name}");
        }
    }

    #[test]
    fn a_missing_source_folder_is_named() {
        let root = workspace();
        fs::remove_dir_all(root.path().join("shared")).expect("removable");
        let message = hash_sources(root.path()).expect_err("no folder").to_string();
        assert!(message.contains("shared"), "{message}");
    }
}
