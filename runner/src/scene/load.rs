//! Reading a scene: geometry, then the materials that it uses, then their textures.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::Mat4;

use super::error::{Place, SceneError, Warning, Warnings};
use super::material::{Unbound, interpret};
use super::mtl::{self, MtlMaterial};
use super::obj::{self, ObjFile};
use super::source::{Directory, Opened, Source, SourceError, locate};
use super::statements::MAX_LIBRARIES;
use super::texture::{Kind, Textures};
use super::{Instance, Material, Motion, Scene, lights};

/// How to read a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Make every surface Lambertian with albedo `Kd`.
    pub lambert: bool,
    /// Ignore shading normals.
    pub flat: bool,
    /// Textures together are reduced to at most this many bytes.
    pub texture_budget_bytes: u64,
    /// Another folder whose files the scene may use, beside its own.
    pub asset_root: Option<PathBuf>,
    /// Largest file accepted, in bytes.
    pub max_file_bytes: u64,
    /// Add the lights of `NAME.lights.json` where it lies beside `NAME.obj`.
    pub lights_beside: bool,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            lambert: false,
            flat: false,
            texture_budget_bytes: 128 << 20,
            asset_root: None,
            max_file_bytes: 4 << 30,
            lights_beside: true,
        }
    }
}

/// A scene, and what had to be changed to make it one.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene: one mesh, one instance, no environment and no camera, and the lights of a file beside it. It passes
    /// [`Scene::validate`].
    pub scene: Scene,
    /// What was corrected, replaced or left out.
    pub warnings: Vec<Warning>,
}

/// Reads the OBJ file at `path` with its materials and textures.
///
/// Opens regular files in the folder of `path`, below it, and below [`LoadOptions::asset_root`], and no others. Lights
/// other than emissive triangles come from a file beside it, see [`super::lights`].
///
/// # Errors
/// When the OBJ file cannot be read, is malformed, or holds no triangles to draw. Materials and textures that are
/// missing or malformed are warnings; a file of lights that is malformed is an error.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, SceneError> {
    let (directory, name) = Directory::of_scene(path, options.asset_root.as_deref())?;
    load_from(&directory, &name, options)
}

/// Reads the OBJ file that `source` calls `name`; see [`load`].
///
/// # Errors
/// As [`load`].
pub fn load_from(source: &dyn Source, name: &str, options: &LoadOptions) -> Result<Loaded, SceneError> {
    let mut warnings = Warnings::default();
    let opened = source.open(name).map_err(|error| SceneError::no_input(name, error.to_string(), "check the path"))?;
    if opened.bytes > options.max_file_bytes {
        let what = format!("the file has {} bytes, the limit is {}", opened.bytes, options.max_file_bytes);
        return Err(SceneError::bad_data(Place::new(opened.path, 0), what, "raise `--max-size`"));
    }
    let path = opened.path;
    let mut obj = obj::read(opened.reader, &path, options.max_file_bytes, &mut warnings)?;

    let library = read_libraries(source, &obj, &path, options, &mut warnings);
    let mut textures = Textures::new(source, options.max_file_bytes);
    let mut unbound: Vec<(Unbound, [Option<usize>; 3])> = Vec::new();
    for (name, &line) in obj.material_names.iter().zip(&obj.material_lines) {
        let Some((material, folder)) = library.get(name.trim()) else {
            if !name.is_empty() {
                let what = format!("material `{name}` is in no library, so grey is used; add `newmtl {name}` to one");
                warnings.push(Place::new(&path, line), what);
            }
            unbound.push((unnamed(name), [None; 3]));
            continue;
        };
        let parts = interpret(material, options.lambert, &mut warnings);
        let maps = [
            ("map_Kd", &parts.base_color_map, Kind::Color),
            ("map_Ke", &parts.emission_map, Kind::Color),
            ("map_d", &parts.alpha_map, Kind::Mask),
        ];
        let requests = maps.map(|(keyword, map, kind)| {
            textures.request(folder, map.as_ref()?, kind, &material.map_place(keyword), &mut warnings)
        });
        unbound.push((parts, requests));
    }
    // For triangles before the first `usemtl`.
    if obj.mesh.materials.contains(&(unbound.len() as u32)) {
        unbound.push((unnamed("default"), [None; 3]));
    }

    if unbound.iter().any(|(parts, _)| parts.invisible) {
        obj::retain_materials(&mut obj.mesh, |material| !unbound[material as usize].0.invisible);
        if obj.mesh.triangles.is_empty() {
            let what = "every triangle is fully transparent";
            return Err(SceneError::bad_data(Place::new(path, 0), what, "raise `d` in the material library"));
        }
    }
    obj::drop_unused_vertices(&mut obj.mesh);
    if options.flat {
        obj.mesh.normals = Vec::new();
    }

    let (textures, index_of_request) = textures.read(options.texture_budget_bytes, &mut warnings);
    let bind = |(parts, requests): (Unbound, [Option<usize>; 3])| {
        let [base_color_texture, emission_texture, alpha_texture] =
            requests.map(|request| request.and_then(|request| index_of_request[request]));
        Material { base_color_texture, emission_texture, alpha_texture, ..parts.material }
    };
    let materials = unbound.into_iter().map(bind).collect();
    let mut scene = Scene {
        name: Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default(),
        meshes: vec![obj.mesh],
        instances: vec![Instance { mesh: 0, world_from_object: Mat4::IDENTITY, motion: Motion::Still }],
        materials,
        textures,
        environment: None,
        distant: Vec::new(),
        camera: None,
    };
    let beside = Path::new(name).with_extension("lights.json");
    let beside = beside.to_str().filter(|_| options.lights_beside);
    if let Some(opened) = beside.and_then(|name| source.open(name).ok()) {
        lights::add_to(&mut scene, &lights::read(opened)?);
    }
    scene.validate()?;
    Ok(Loaded { scene, warnings: warnings.into_vec() })
}

/// A grey material.
fn unnamed(name: &str) -> Unbound {
    Unbound { material: Material { name: name.to_owned(), ..Material::default() }, ..Unbound::default() }
}

/// The materials of all libraries by name, each with the folder that its textures are relative to. The last of
/// equal names wins.
fn read_libraries(
    source: &dyn Source,
    obj: &ObjFile,
    path: &str,
    options: &LoadOptions,
    warnings: &mut Warnings,
) -> HashMap<String, (MtlMaterial, String)> {
    let mut materials = HashMap::new();
    let mut seen = HashSet::new();
    for (names, line) in &obj.material_libraries {
        let place = Place::new(path, *line);
        for (name, file) in open_libraries(source, names, &place, warnings) {
            if !seen.insert(file.key.clone()) {
                continue;
            }
            if file.bytes > options.max_file_bytes {
                let message = format!("material library `{name}` has {} bytes and is ignored", file.bytes);
                warnings.push(place.clone(), message);
                continue;
            }
            let folder = name.rsplit_once('/').map(|(folder, _)| format!("{folder}/")).unwrap_or_default();
            for material in mtl::read(file.reader, &file.path, options.max_file_bytes, warnings) {
                let name = material.statements.name.trim().to_owned();
                if materials.contains_key(&name) {
                    warnings
                        .push(material.place.clone(), format!("material `{name}` is defined again; this one is used"));
                }
                materials.insert(name, (material, folder.clone()));
            }
        }
    }
    materials
}

/// The files of one `mtllib` statement: one name with blanks in it, or several names.
fn open_libraries(source: &dyn Source, names: &str, place: &Place, warnings: &mut Warnings) -> Vec<(String, Opened)> {
    let mut opened = Vec::new();
    let mut add = |name: &str, warnings: &mut Warnings| -> Result<(), SourceError> {
        let located = locate(source, "", name)?;
        if let Some(reason) = &located.replaced {
            let message = format!("material library `{name}`: {reason}; `{}` is used in its place", located.name);
            warnings.push(place.clone(), message);
        }
        opened.push((located.name, located.file));
        Ok(())
    };
    let words: Vec<&str> = names.split_whitespace().collect();
    let Err(reason) = add(names, warnings) else {
        return opened;
    };
    if words.len() < 2 {
        let message = format!("material library `{names}` is left out, and its materials are grey: {reason}");
        warnings.push(place.clone(), message);
        return opened;
    }
    for word in words.into_iter().take(MAX_LIBRARIES) {
        if let Err(reason) = add(word, warnings) {
            let message = format!("material library `{word}` is left out, and its materials are grey: {reason}");
            warnings.push(place.clone(), message);
        }
    }
    opened
}
