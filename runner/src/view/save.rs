//! Pictures to files.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::{
    buffers::View,
    engine::{Engine, EngineError},
    want::Want,
};
use crate::{
    output::{Destination, Layers, OutputError, Picture, exr, png},
    render::camera_matrices,
};

/// Why a picture was not saved.
#[derive(Debug, Error)]
pub enum SaveError {
    /// There is no picture yet.
    #[error("there is no picture yet to be saved")]
    NoPicture,
    /// A name that ends in neither.
    #[error("pictures are .png or .exr, not {}", .0.display())]
    Format(PathBuf),
    /// The picture can't be read.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The file can't be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Writes the picture that was shown last: .png as it is on the screen, .exr with linear radiance.
///
/// # Errors
/// If there is none, or it can't be written.
pub fn picture(engine: &mut Engine, want: &Want, path: &Path) -> Result<(), SaveError> {
    let [width, height] = want.size;
    let destination = Destination::File(path.to_owned());
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("png") => {
            let display = engine.display()?.ok_or(SaveError::NoPicture)?;
            Ok(png::write(&destination, width, height, &display)?)
        }
        Some("exr") => {
            let moments = engine.moments()?.ok_or(SaveError::NoPicture)?;
            let picture =
                Picture { width, height, rgb: moments.iter().map(|m| m.mean().to_array()).collect(), alpha: None };
            let layers = Layers {
                variance: Some(moments.iter().map(|m| m.variance_of_mean().to_array()).collect()),
                samples: Some(moments.iter().map(|m| m.count).collect()),
                ..Layers::default()
            };
            let (camera_from_world, ndc_from_world) = camera_matrices(&want.camera, width, height);
            let metadata = exr::Metadata {
                samples_per_pixel: moments.first().map(|m| m.count),
                camera_from_world: Some(camera_from_world),
                ndc_from_world: Some(ndc_from_world),
                seed: Some(u64::from(want.seed)),
                ..exr::Metadata::default()
            };
            Ok(exr::write(&destination, &picture, &layers, &metadata)?)
        }
        _ => Err(SaveError::Format(path.to_owned())),
    }
}

/// Where pictures go that nobody has named: the folder for pictures, or else the present one.
pub fn folder() -> PathBuf {
    let named = std::env::var_os("XDG_PICTURES_DIR").map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || Some(etcetera::home_dir().ok()?.join("Pictures")).filter(|path| path.is_dir());
    named.or_else(home).map_or_else(|| PathBuf::from("."), |pictures| pictures.join("weir"))
}

/// A name in `folder` that no file has: of the scene, of the view, and the next number.
pub fn free_name(folder: &Path, scene: &str, view: View, ending: &str) -> PathBuf {
    let safe: String = scene.chars().map(|c| if c.is_alphanumeric() || c == '-' { c } else { '_' }).collect();
    let view = if view == View::Picture { String::new() } else { format!("_{}", view.name().replace(' ', "_")) };
    (1..)
        .map(|number| folder.join(format!("{safe}{view}_{number}.{ending}")))
        .find(|path| !path.exists())
        .expect("there are more numbers than files")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_picture_overwrites_another() {
        let folder = tempfile::tempdir().expect("a folder");
        let first = free_name(folder.path(), "a/b c", View::Picture, "png");
        assert_eq!(first, folder.path().join("a_b_c_1.png"));
        std::fs::write(&first, b"").expect("writable");
        assert_eq!(free_name(folder.path(), "a/b c", View::Picture, "png"), folder.path().join("a_b_c_2.png"));
        let light = free_name(folder.path(), "x", View::Light, "exr");
        assert_eq!(light, folder.path().join("x_light_id_1.exr"));
    }
}
