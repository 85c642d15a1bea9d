//! Cameras: from JSON files, and framed on a scene.

use std::io::Read;
use std::path::Path;

use glam::Vec3;
use serde::Deserialize;

use super::Camera;
use super::bounds::Bounds;
use super::error::{Place, SceneError};
use super::source::{Directory, Source};

/// Largest camera file accepted, in bytes; scene descriptions that hold one are a few kilobytes long.
const MAX_FILE_BYTES: u64 = 16 << 20;

const HELP: &str =
    "a camera is {\"origin\": [x, y, z], \"target\": [x, y, z], \"up\": [x, y, z], \"vfov_deg\": degrees}";

/// A camera as files have it; other fields are ignored.
#[derive(Deserialize)]
struct CameraJson {
    origin: [f64; 3],
    target: [f64; 3],
    #[serde(default = "default_up")]
    up: [f64; 3],
    vfov_deg: f64,
}

fn default_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// Reads a camera from a JSON file: an object with `origin`, `target`, `up` and `vfov_deg`, or one that has such an
/// object under the key `camera`.
///
/// # Errors
/// When the file is missing, is not such JSON, or the camera sees nothing.
pub fn load(path: &Path) -> Result<Camera, SceneError> {
    let shown = path.display().to_string();
    let (directory, name) = Directory::of_scene(path, None)?;
    let opened = directory.open(&name).map_err(|error| SceneError::no_input(&shown, error.to_string(), HELP))?;
    let mut text = Vec::new();
    let read = opened.reader.take(MAX_FILE_BYTES).read_to_end(&mut text);
    read.map_err(|source| SceneError::Read { place: Place::new(&shown, 0), source })?;
    parse(&text, &shown)
}

/// Reads a camera from JSON text of a file that messages call `name`; see [`load`].
///
/// # Errors
/// When the text is not such JSON, or the camera sees nothing.
pub fn parse(text: &[u8], name: &str) -> Result<Camera, SceneError> {
    let bad_json = |error: serde_json::Error| {
        SceneError::bad_data(Place::new(name, error.line() as u64), format!("not a camera: {error}"), HELP)
    };
    /// A file that nests its camera.
    #[derive(Deserialize)]
    struct SceneJson {
        camera: Option<serde::de::IgnoredAny>,
    }
    #[derive(Deserialize)]
    struct Nested {
        camera: CameraJson,
    }
    // Parsed again for the second form, because an untagged enum would lose line numbers.
    let nested: SceneJson = serde_json::from_slice(text).map_err(bad_json)?;
    let json: CameraJson = match nested.camera {
        Some(_) => serde_json::from_slice::<Nested>(text).map_err(bad_json)?.camera,
        None => serde_json::from_slice(text).map_err(bad_json)?,
    };
    let vector = |v: [f64; 3]| Vec3::from_array(v.map(|x| x as f32));
    let (origin, target) = (vector(json.origin), vector(json.target));
    let camera = Camera { origin, target, up: vector(json.up), vfov_deg: json.vfov_deg as f32 };
    camera.check().map_err(|what| SceneError::bad_data(Place::new(name, 0), what, HELP))?;
    Ok(camera)
}

impl Camera {
    /// Looks down along -z, from a little above, on the whole of `bounds`.
    pub fn framing(bounds: Bounds) -> Self {
        const VFOV_DEG: f32 = 45.0;
        let center = bounds.center();
        // The sphere around the box fits the smaller side of the picture when that is its height.
        let radius = (bounds.size().length() / 2.0).max(1e-3 * center.abs().max_element()).max(1e-6);
        let distance = radius / (VFOV_DEG.to_radians() / 2.0).sin();
        let direction = Vec3::new(0.0, 0.25, 1.0).normalize();
        Self { origin: center + direction * distance, target: center, up: Vec3::Y, vfov_deg: VFOV_DEG }
    }

    /// Whether the camera defines a picture: everything finite, a direction, an up beside it, an angle in 0..180.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn check(&self) -> Result<(), String> {
        let Self { origin, target, up, vfov_deg } = *self;
        if !(origin.is_finite() && target.is_finite() && up.is_finite() && vfov_deg.is_finite()) {
            return Err("the camera has a number that is not finite".to_owned());
        }
        if !(vfov_deg > 0.0 && vfov_deg < 180.0) {
            return Err(format!("the field of view `vfov_deg` is {vfov_deg}, it has to lie between 0 and 180"));
        }
        // In f64, because squares of large or small f32 are infinite or 0.
        let Some(view) = (target.as_dvec3() - origin.as_dvec3()).try_normalize() else {
            return Err("`origin` and `target` are the same point".to_owned());
        };
        let Some(up) = up.as_dvec3().try_normalize() else {
            return Err("`up` is a zero vector".to_owned());
        };
        if view.cross(up).length() < 1e-5 {
            return Err("`up` is parallel to the view".to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BARE: &str = r#"{"origin": [1, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0], "vfov_deg": 40, "width": 7}"#;

    #[test]
    fn a_camera_may_stand_alone_or_under_a_key() {
        let bare = parse(BARE.as_bytes(), "c.json").expect("valid");
        let nested = format!(r#"{{"name": "x", "camera": {BARE}, "other_lights": [{{}}]}}"#);
        assert_eq!(bare, parse(nested.as_bytes(), "c.json").expect("valid"));
        assert_eq!((bare.origin, bare.vfov_deg), (Vec3::new(1.0, 2.0, 3.0), 40.0));
    }

    #[test]
    fn broken_json_names_its_line() {
        let error = parse(b"{\n\"origin\": [1, 2],\n}", "c.json").expect_err("broken").to_string();
        assert!(
            error.starts_with("c.json:2: not a camera: ") || error.starts_with("c.json:3: not a camera: "),
            "{error}"
        );
        assert!(error.contains("\nhelp: a camera is {"), "{error}");
        let error = parse(b"{\n}", "c.json").expect_err("empty").to_string();
        assert!(error.contains("missing field `origin`"), "{error}");
    }

    #[test]
    fn a_camera_that_sees_nothing_is_refused() {
        for (from, to, what) in [
            ("[1, 2, 3]", "[0, 0, 0]", "are the same point"),
            ("[0, 1, 0]", "[0, 0, 0]", "`up` is a zero vector"),
            ("[0, 1, 0]", "[2, 4, 6]", "`up` is parallel to the view"),
            ("40", "180", "has to lie between 0 and 180"),
            ("40", "0", "has to lie between 0 and 180"),
            ("[1, 2, 3]", "[1e39, 2, 3]", "not finite"),
        ] {
            let error = parse(BARE.replace(from, to).as_bytes(), "c.json").expect_err(what).to_string();
            assert!(error.contains(what), "{error}");
        }
    }

    #[test]
    fn a_framing_camera_sees_every_corner() {
        for (min, max) in [((-1.0, 0.0, 2.0), (3.0, 1.0, 9.0)), ((5.0, 5.0, 5.0), (5.0, 5.0, 5.0))] {
            let bounds = Bounds { min: Vec3::from(min), max: Vec3::from(max) };
            let camera = Camera::framing(bounds);
            camera.check().expect("usable");
            let view = (camera.target - camera.origin).normalize();
            for corner in bounds.corners() {
                let angle = (corner - camera.origin).angle_between(view).to_degrees();
                assert!(angle <= camera.vfov_deg / 2.0 + 1e-3, "{corner} at {angle} degrees");
            }
        }
    }
}
