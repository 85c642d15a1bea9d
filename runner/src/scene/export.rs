//! Writes a scene as Wavefront OBJ and MTL, with its images and a camera, for other renderers.
//!
//! The scene stands still at time 0 (see [`Scene::stop_at`] for another) and its instances become plain triangles in world
//! space; lights that are no triangles go into a file of their own. Numbers are written with as many digits as reading
//! them back bit by bit takes.

mod files;
mod mtl;
mod obj;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use glam::Vec3;
use serde::Serialize;

use crate::exit::{Exit, HasExit};
use crate::scene::{Camera, Environment, Scene, Shape, Texture, lights};
use files::PendingFiles;

/// Size of picture that the camera file suggests.
const SUGGESTED_SIZE: (u32, u32) = (1280, 720);

/// What [`export`] wrote.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportReport {
    /// The files, the OBJ first.
    pub files: Vec<PathBuf>,
    /// Positions in the OBJ file.
    pub positions: u64,
    /// Triangles in the OBJ file.
    pub triangles: u64,
    /// How many of them have a material that emits.
    pub emissive_triangles: u64,
}

impl std::fmt::Display for ExportReport {
    /// One line a file, then the counts.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for file in &self.files {
            writeln!(f, "{}", file.display())?;
        }
        write!(
            f,
            "{} triangles ({} emissive) over {} positions",
            self.triangles, self.emissive_triangles, self.positions
        )
    }
}

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The directory could not be made or is not one.
    #[error("cannot make the directory (name one that can be written to): {source}: {}", path.display())]
    Directory {
        /// The directory asked for.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file could not be written.
    #[error("cannot write the file, nothing was exported (check free space and permissions): {source}: {}", path.display())]
    Write {
        /// The file as it would have been called.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The scene refers to something that it does not have.
    #[error("scene `{scene}` cannot be exported: {fault}; this scene was not made by a reader or generator of weir")]
    Scene {
        /// Name of the scene.
        scene: String,
        /// What is wrong with what.
        fault: String,
    },
}

impl HasExit for ExportError {
    fn exit(&self) -> Exit {
        match self {
            Self::Directory { .. } => Exit::CannotCreate,
            Self::Write { source, .. } if source.kind() == io::ErrorKind::PermissionDenied => Exit::CannotCreate,
            Self::Write { source, .. } => source.exit(),
            Self::Scene { .. } => Exit::Internal,
        }
    }
}

/// Writes `NAME.obj`, `NAME.mtl`, `NAME-texture-0.png` and so on, `NAME.lights.json`, `NAME-camera.json` and
/// `NAME-environment.exr` into `dir`, which is made if need be; what the scene lacks has no file.
///
/// NAME is the scene's name with everything but letters, digits, `.`, `_` and `-` replaced by `_`. Existing files are
/// replaced. All files are complete before the first one gets its name; after an error none of them is there.
///
/// # Errors
///
/// [`ExportError`]: the directory cannot be made, a file cannot be written, or an index in the scene is out of range.
pub fn export(scene: &Scene, dir: &Path) -> Result<ExportReport, ExportError> {
    check(scene).map_err(|fault| ExportError::Scene { scene: scene.name.clone(), fault })?;
    let name = file_stem(&scene.name);
    let material_names = mtl::unique_names(scene);
    let mut files = PendingFiles::in_dir(dir)?;

    let mut report = ExportReport::default();
    let mtl_name = format!("{name}.mtl");
    files.write(&format!("{name}.obj"), |out| {
        let counts = obj::write(scene, &mtl_name, &material_names, out)?;
        report = ExportReport { files: Vec::new(), ..counts };
        Ok(())
    })?;
    let texture_names: Vec<String> =
        (0..scene.textures.len()).map(|index| format!("{name}-texture-{index}.png")).collect();
    files.write(&mtl_name, |out| mtl::write(scene, &material_names, &texture_names, out))?;
    for (texture, texture_name) in scene.textures.iter().zip(&texture_names) {
        files.write(texture_name, |out| write_png(texture, out))?;
    }
    if let Some(file) = lights::to_json(scene) {
        files.write(&format!("{name}.lights.json"), |out| {
            serde_json::to_writer_pretty(&mut *out, &file)?;
            writeln!(out)
        })?;
    }
    let environment = scene.environment.as_ref().map(|map| (map, format!("{name}-environment.exr")));
    if let Some((map, file)) = &environment {
        files.write(file, |out| write_exr(map, out))?;
    }
    if let Some(camera) = &scene.camera {
        let view = CameraFile::new(camera, environment.as_ref().map(|(map, file)| (*map, file.as_str())));
        files.write(&format!("{name}-camera.json"), |out| {
            serde_json::to_writer_pretty(&mut *out, &view)?;
            writeln!(out)
        })?;
    }

    report.files = files.finish()?;
    Ok(report)
}

/// Every index that the writers follow, so that they may follow them without looking.
fn check(scene: &Scene) -> Result<(), String> {
    for (index, instance) in scene.instances.iter().enumerate() {
        if instance.mesh as usize >= scene.meshes.len() {
            return Err(format!("instance {index} refers to mesh {}, there are {}", instance.mesh, scene.meshes.len()));
        }
    }
    for mesh in &scene.meshes {
        let (name, count) = (&mesh.name, mesh.positions.len());
        let optional = [("normals", mesh.normals.len()), ("texture coordinates", mesh.uvs.len())];
        if let Some((what, n)) = optional.into_iter().find(|&(_, n)| n != 0 && n != count) {
            return Err(format!("mesh `{name}` has {n} {what} for {count} positions"));
        }
        let has_triangles = mesh.shape == Shape::Triangles;
        if has_triangles && mesh.materials.len() != mesh.triangles.len() {
            return Err(format!(
                "mesh `{name}` has {} materials for {} triangles",
                mesh.materials.len(),
                mesh.triangles.len()
            ));
        }
        if let Some(corner) = mesh.triangles.iter().flatten().find(|&&corner| corner as usize >= count) {
            return Err(format!("mesh `{name}` refers to vertex {corner}, it has {count}"));
        }
        if let Some(material) = mesh.materials.iter().find(|&&material| material as usize >= scene.materials.len()) {
            return Err(format!("mesh `{name}` refers to material {material}, there are {}", scene.materials.len()));
        }
    }
    for material in &scene.materials {
        let used = [material.base_color_texture, material.emission_texture, material.alpha_texture];
        if let Some(texture) = used.into_iter().flatten().find(|&texture| texture as usize >= scene.textures.len()) {
            let count = scene.textures.len();
            return Err(format!("material `{}` refers to texture {texture}, there are {count}", material.name));
        }
    }
    for texture in &scene.textures {
        check_image(&texture.name, texture.width, texture.height, texture.texels.len())?;
    }
    scene.environment.iter().try_for_each(|map| check_image(&map.name, map.width, map.height, map.texels.len()))
}

fn check_image(name: &str, width: u32, height: u32, texels: usize) -> Result<(), String> {
    if u64::from(width) * u64::from(height) != texels as u64 || texels == 0 {
        return Err(format!("image `{name}` has {texels} texels for {width} x {height}"));
    }
    Ok(())
}

/// `name` as it can stand in a file name, and unquoted in an OBJ or MTL file.
fn file_stem(name: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let stem: String = name.chars().map(|c| if is_plain(c) { c } else { '_' }).collect();
    // A leading dot would hide the file, an empty name would be one.
    if stem.is_empty() || stem.starts_with('.') { format!("scene{stem}") } else { stem }
}

/// The camera file.
#[derive(Serialize)]
struct CameraFile<'a> {
    origin: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
    vfov_deg: f32,
    width: u32,
    height: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<EnvironmentUse<'a>>,
}

/// How the environment map is to be put around the scene.
#[derive(Serialize)]
struct EnvironmentUse<'a> {
    file: &'a str,
    rotation_deg: f32,
    scale: f32,
}

impl<'a> CameraFile<'a> {
    fn new(camera: &Camera, environment: Option<(&Environment, &'a str)>) -> Self {
        let array = |v: Vec3| v.to_array();
        Self {
            origin: array(camera.origin),
            target: array(camera.target),
            up: array(camera.up),
            vfov_deg: camera.vfov_deg,
            width: SUGGESTED_SIZE.0,
            height: SUGGESTED_SIZE.1,
            environment: environment.map(|(map, file)| EnvironmentUse {
                file,
                rotation_deg: map.rotation_deg,
                scale: map.scale,
            }),
        }
    }
}

fn write_png(texture: &Texture, out: &mut impl Write) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, texture.width, texture.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let bytes: Vec<u8> = texture.texels.iter().flat_map(|texel| texel.to_le_bytes()).collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&bytes)?;
    writer.finish()?;
    Ok(())
}

fn write_exr(map: &Environment, out: &mut (impl Write + io::Seek)) -> io::Result<()> {
    use exr::prelude::{Image, SpecificChannels, WritableImage};
    let size = (map.width as usize, map.height as usize);
    let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
        let [r, g, b] = map.texels[at.y() * size.0 + at.x()];
        (r, g, b)
    });
    Image::from_channels(size, channels).write().to_buffered(out).map_err(io::Error::other)
}

#[cfg(test)]
mod tests;
