//! Which scene, and how it is read: by a person's words, on the command line or in the viewer.

use std::path::{Path, PathBuf};

use super::{
    builtin, environment,
    error::SceneError,
    lights,
    load::{LoadOptions, Loaded, load},
};

/// A scene by name, and how to read it.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// A file, or the name of a built-in scene.
    pub scene: String,
    /// How files are read; `lambert` and `flat` hold for built-in scenes too.
    pub options: LoadOptions,
    /// An environment map in place of the scene's.
    pub environment: Option<PathBuf>,
    /// Its turn about the vertical, in degrees.
    pub environment_rotation_deg: f32,
    /// Factor on its radiance.
    pub environment_scale: f32,
    /// A file of lights, in place of that beside the scene's file; see [`lights`].
    pub lights: Option<PathBuf>,
}

impl Choice {
    /// A scene as it is.
    pub fn new(scene: impl Into<String>) -> Self {
        Self {
            scene: scene.into(),
            options: LoadOptions::default(),
            environment: None,
            environment_rotation_deg: 0.0,
            environment_scale: 1.0,
            lights: None,
        }
    }

    /// The file, where it is one.
    pub fn file(&self) -> Option<&Path> {
        let path = Path::new(&self.scene);
        (path.is_file() || builtin::find(&self.scene).is_none()).then_some(path)
    }

    /// Reads or builds the scene; it is valid.
    ///
    /// # Errors
    /// If there is no such scene, or it can't be read.
    pub fn read(&self) -> Result<Loaded, SceneError> {
        let mut loaded = match self.file() {
            Some(path) if !path.exists() && path.extension().is_none() => {
                let names: Vec<_> = builtin::BUILTIN.iter().map(|b| b.name).collect();
                let help = format!("name an .obj file, or one of the built-in scenes: {}", names.join(", "));
                return Err(SceneError::no_input(&self.scene, "there is no such file or built-in scene", help));
            }
            Some(path) => load(path, &LoadOptions { lights_beside: self.lights.is_none(), ..self.options.clone() })?,
            None => {
                let built_in = builtin::find(&self.scene).expect("what is no file is built in");
                let mut scene = (built_in.build)();
                if self.options.lambert {
                    scene.make_lambertian();
                }
                if self.options.flat {
                    scene.meshes.iter_mut().for_each(|mesh| mesh.normals.clear());
                }
                Loaded { scene, warnings: Vec::new() }
            }
        };
        if let Some(path) = &self.environment {
            let (map, warnings) = environment::load(path, self.environment_rotation_deg, self.environment_scale)?;
            loaded.warnings.extend(warnings);
            loaded.scene.environment = Some(map);
        }
        if let Some(path) = &self.lights {
            lights::add_to(&mut loaded.scene, &lights::load(path)?);
        }
        loaded.scene.validate()?;
        Ok(loaded)
    }
}
