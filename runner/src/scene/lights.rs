//! Lights that an OBJ file has no words for, from JSON files: points, spots, directional lights, spheres and rectangles.
//!
//! Names are those of `KHR_lights_punctual`, the extension of glTF 2.0, where it has them.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use glam::{DMat4, DVec3, Mat4, Vec3};
use serde_json::{Map, Value, json};

use super::error::{Place, SceneError};
use super::keywords::MAX_RADIANCE;
use super::source::{Directory, Opened, Source};
use super::{DistantLight, Instance, Material, Mesh, Motion, Scene, Shape};

/// Largest file of lights accepted, in bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Lengths of spheres and rectangles: areas and volumes are finite, and not zero, in f32.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

const HELP: &str = "a file of lights is {\"lights\": [...]}, each with `type` \"point\" (position, color, intensity), \"spot\" \
    (position, direction, inner_cone_deg, outer_cone_deg, color, intensity), \"directional\" (direction, color, irradiance), \
    \"sphere\" (position, radius, color, radiance) or \"rectangle\" (position, u, v, two_sided, color, radiance)";

/// A light of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// A shape, where it stands, and its radiance or radiant intensity.
    Shape {
        /// What it is.
        shape: Shape,
        /// Its placement.
        world_from_object: Mat4,
        /// See [`Shape`].
        emission: Vec3,
        /// Whether both faces emit.
        two_sided: bool,
    },
    /// A directional light.
    Distant(DistantLight),
}

/// Reads a file of lights.
///
/// # Errors
/// When the file is missing, or is not such JSON.
pub fn load(path: &Path) -> Result<Vec<Light>, SceneError> {
    let shown = path.display().to_string();
    let (directory, name) = Directory::of_scene(path, None)?;
    let opened = directory.open(&name).map_err(|error| SceneError::no_input(shown, error.to_string(), HELP))?;
    read(opened)
}

/// Reads an open file of lights; see [`load`].
///
/// # Errors
/// As [`load`].
pub fn read(opened: Opened) -> Result<Vec<Light>, SceneError> {
    let path = opened.path;
    let mut text = Vec::new();
    // One byte more than allowed shows that the file is too large.
    let read = opened.reader.take(MAX_FILE_BYTES + 1).read_to_end(&mut text);
    read.map_err(|source| SceneError::Read { place: Place::new(&path, 0), source })?;
    if text.len() as u64 > MAX_FILE_BYTES {
        let what = format!("the file has more than {MAX_FILE_BYTES} bytes");
        return Err(SceneError::bad_data(Place::new(path, 0), what, "use emissive triangles for so many lights"));
    }
    parse(&text, &path)
}

/// Reads lights from JSON text of a file that messages call `name`; see [`load`].
///
/// # Errors
/// When the text is not such JSON, or a light has a field too many, too few or out of range.
pub fn parse(text: &[u8], name: &str) -> Result<Vec<Light>, SceneError> {
    let bad = |line: u64, what: String| SceneError::bad_data(Place::new(name, line), what, HELP);
    let file: Map<String, Value> =
        serde_json::from_slice(text).map_err(|error| bad(error.line() as u64, format!("not lights: {error}")))?;
    let mut file = Fields(file);
    let lights = file.take("lights").and_then(|lights| match lights {
        Value::Array(lights) => file.finish("such a file").map(|()| lights),
        _ => Err("`lights` is not a list".to_owned()),
    });
    let lights = lights.map_err(|what| bad(0, format!("not lights: {what}")))?;
    let of = |(number, value): (usize, Value)| match value {
        Value::Object(fields) => light(Fields(fields)).map_err(|what| bad(0, format!("light {number}: {what}"))),
        _ => Err(bad(0, format!("light {number}: not an object"))),
    };
    (1..).zip(lights).map(of).collect()
}

/// A number as people write it.
fn shown(x: f64) -> String {
    if x == 0.0 || (1e-3..1e6).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}

/// The fields of a light that are not read yet.
struct Fields(Map<String, Value>);

impl Fields {
    fn take(&mut self, name: &str) -> Result<Value, String> {
        self.0.remove(name).ok_or_else(|| format!("`{name}` is missing"))
    }

    fn number(&mut self, name: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
        let value = self.take(name)?;
        let number = value.as_f64().ok_or_else(|| format!("`{name}` is {value}, not a number"))?;
        let (low, high) = (shown(*range.start()), shown(*range.end()));
        if range.contains(&number) { Ok(number) } else { Err(format!("`{name}` is {value}, not in {low}..={high}")) }
    }

    fn vector(&mut self, name: &str) -> Result<DVec3, String> {
        let value = self.take(name)?;
        let numbers: Option<Vec<f64>> =
            value.as_array().and_then(|numbers| numbers.iter().map(Value::as_f64).collect());
        let Some(&[x, y, z]) = numbers.as_deref() else { return Err(format!("`{name}` is not three numbers")) };
        let vector = DVec3::new(x, y, z);
        if vector.as_vec3().is_finite() { Ok(vector) } else { Err(format!("`{name}` is too large: {vector}")) }
    }

    fn direction(&mut self, name: &str) -> Result<Vec3, String> {
        let direction = self.vector(name)?.try_normalize().map(DVec3::as_vec3);
        direction.ok_or_else(|| format!("`{name}` is a zero vector"))
    }

    /// `color`, white if it is not there, times the number `name`: positive, and not too large for arithmetic.
    fn emission(&mut self, name: &str) -> Result<Vec3, String> {
        let color = if self.0.contains_key("color") { self.vector("color")? } else { DVec3::ONE };
        let emission = (color * self.number(name, 0.0..=MAX_RADIANCE)?).as_vec3();
        let is_within = color.cmpge(DVec3::ZERO).all() && emission.cmple(Vec3::splat(MAX_RADIANCE as f32)).all();
        if !is_within {
            return Err(format!("`color` times `{name}` is {emission}, not in 0..={MAX_RADIANCE:e}"));
        }
        Ok(emission)
    }

    fn finish(&self, of: &str) -> Result<(), String> {
        self.0.keys().next().map_or(Ok(()), |name| Err(format!("`{name}` is no field of {of}")))
    }
}

fn light(mut fields: Fields) -> Result<Light, String> {
    let kind = fields.take("type")?;
    let at = |position: DVec3| Mat4::from_translation(position.as_vec3());
    let mut two_sided = false;
    let (shape, world_from_object, emission) = match kind.as_str() {
        Some("point") => (Shape::Point, at(fields.vector("position")?), fields.emission("intensity")?),
        Some("spot") => {
            let placed = along(fields.vector("position")?.as_vec3(), fields.direction("direction")?);
            let outer_deg = fields.number("outer_cone_deg", 1.0..=90.0)? as f32;
            let inner_deg = match fields.0.contains_key("inner_cone_deg") {
                true => fields.number("inner_cone_deg", 0.0..=f64::from(outer_deg))? as f32,
                false => 0.0,
            };
            (Shape::Spot { inner_deg, outer_deg }, placed, fields.emission("intensity")?)
        }
        Some("directional") => {
            let light =
                DistantLight { direction: fields.direction("direction")?, irradiance: fields.emission("irradiance")? };
            return fields.finish("a directional light").map(|()| Light::Distant(light));
        }
        Some("sphere") => {
            let scale = Mat4::from_scale(Vec3::splat(fields.number("radius", LENGTHS)? as f32));
            (Shape::Sphere, at(fields.vector("position")?) * scale, fields.emission("radiance")?)
        }
        Some("rectangle") => {
            let (position, u, v) = (fields.vector("position")?, fields.vector("u")?, fields.vector("v")?);
            let is_long = |edge: DVec3| LENGTHS.contains(&edge.length());
            let front = u.normalize_or_zero().cross(v.normalize_or_zero());
            if !is_long(u) || !is_long(v) || front.length() < 1e-4 {
                let (least, most) = (shown(*LENGTHS.start()), shown(*LENGTHS.end()));
                return Err(format!("`u` and `v` are not two edges of length {least}..={most} across each other"));
            }
            if let Some(value) = fields.0.remove("two_sided") {
                two_sided = value.as_bool().ok_or_else(|| format!("`two_sided` is {value}, not true or false"))?;
            }
            let [x, y, z, w] = [u.extend(0.0), v.extend(0.0), front.normalize().extend(0.0), position.extend(1.0)];
            (Shape::Rectangle, DMat4::from_cols(x, y, z, w).as_mat4(), fields.emission("radiance")?)
        }
        _ => {
            return Err(format!(
                "`type` is {kind}, not \"point\", \"spot\", \"directional\", \"sphere\" or \"rectangle\""
            ));
        }
    };
    fields.finish(&format!("a {} light", kind.as_str().unwrap_or_default()))?;
    Ok(Light::Shape { shape, world_from_object, emission, two_sided })
}

/// A placement at `position` whose -z is `direction`, of length 1.
pub fn along(position: Vec3, direction: Vec3) -> Mat4 {
    let (x, y) = (-direction).any_orthonormal_pair();
    Mat4::from_cols(x.extend(0.0), y.extend(0.0), (-direction).extend(0.0), position.extend(1.0))
}

/// Puts lights into a scene. Equal ones share their mesh.
pub fn add_to(scene: &mut Scene, lights: &[Light]) {
    let mut meshes: HashMap<String, u32> = HashMap::new();
    for light in lights {
        match light {
            Light::Distant(light) => scene.distant.push(*light),
            Light::Shape { shape, world_from_object, emission, two_sided } => {
                let key = format!("{shape:?} {:?} {two_sided}", emission.to_array().map(f32::to_bits));
                let mesh = *meshes.entry(key).or_insert_with(|| add_shape(scene, *shape, *emission, *two_sided));
                let world_from_object = *world_from_object;
                scene.instances.push(Instance { mesh, world_from_object, motion: Motion::Still });
            }
        }
    }
}

/// Adds the mesh of a shape, with its material; returns its number. It is placed by instances.
pub fn add_shape(scene: &mut Scene, shape: Shape, emission: Vec3, two_sided_emission: bool) -> u32 {
    let name = match shape {
        Shape::Triangles => "triangles",
        Shape::Point => "point",
        Shape::Spot { .. } => "spot",
        Shape::Sphere => "sphere",
        Shape::Rectangle => "rectangle",
    };
    scene.materials.push(Material {
        name: format!("{name} light"),
        base_color: Vec3::ZERO,
        emission,
        two_sided_emission,
        ..Material::default()
    });
    let material = scene.materials.len() as u32 - 1;
    scene.meshes.push(Mesh { name: format!("{name} light"), shape, materials: vec![material], ..Mesh::default() });
    scene.meshes.len() as u32 - 1
}

/// The lights of a scene at time 0 that are no triangles, as a file that [`parse`] reads; `None` without any.
pub fn to_json(scene: &Scene) -> Option<Value> {
    let array = |v: Vec3| json!(v.to_array());
    let shapes = scene.instances.iter().filter_map(|instance| {
        let mesh = scene.meshes.get(instance.mesh as usize)?;
        let material = scene.materials.get(*mesh.materials.first()? as usize)?;
        let matrix = instance.world_from_object_at(0.0);
        let (position, color) = (array(matrix.w_axis.truncate()), array(material.emission));
        Some(match mesh.shape {
            Shape::Triangles => return None,
            Shape::Point => json!({"type": "point", "position": position, "color": color, "intensity": 1.0}),
            Shape::Spot { inner_deg, outer_deg } => json!({
                "type": "spot", "position": position, "direction": array(matrix.transform_vector3(Vec3::NEG_Z).normalize()),
                "inner_cone_deg": inner_deg, "outer_cone_deg": outer_deg, "color": color, "intensity": 1.0,
            }),
            Shape::Sphere => json!({
                "type": "sphere", "position": position, "radius": matrix.as_dmat4().determinant().abs().cbrt() as f32,
                "color": color, "radiance": 1.0,
            }),
            Shape::Rectangle => {
                let (u, v) = (matrix.x_axis.truncate(), matrix.y_axis.truncate());
                // The front of a mirrored one is on the other side of its edges.
                let (u, v) = if matrix.determinant() < 0.0 { (v, u) } else { (u, v) };
                json!({
                    "type": "rectangle", "position": position, "u": array(u), "v": array(v),
                    "two_sided": material.two_sided_emission, "color": color, "radiance": 1.0,
                })
            }
        })
    });
    let distant = scene.distant.iter().map(|light| {
        let (direction, color) = (array(light.direction), array(light.irradiance));
        json!({"type": "directional", "direction": direction, "color": color, "irradiance": 1.0})
    });
    let lights: Vec<Value> = shapes.chain(distant).collect();
    (!lights.is_empty()).then(|| json!({ "lights": lights }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: &str = r#"{"lights": [
        {"type": "point", "position": [1, 2, 3], "color": [1, 0.5, 0.25], "intensity": 8},
        {"type": "spot", "position": [0, 4, 0], "direction": [0, -2, 0], "inner_cone_deg": 10, "outer_cone_deg": 30,
         "color": [1, 1, 1], "intensity": 5},
        {"type": "directional", "direction": [0, -3, 4], "color": [1, 1, 0.5], "irradiance": 2},
        {"type": "sphere", "position": [1, 0, 0], "radius": 0.25, "radiance": 10},
        {"type": "rectangle", "position": [0, 3, 0], "u": [0.5, 0, 0], "v": [0, 0, 1], "two_sided": true, "radiance": 4}
    ]}"#;

    fn read_back(text: &str) -> Scene {
        let mut scene = Scene::default();
        add_to(&mut scene, &parse(text.as_bytes(), "a.lights.json").expect("lights"));
        scene.validate().expect("a sound scene");
        scene
    }

    #[test]
    fn every_type_becomes_the_light_that_its_fields_say() {
        let scene = read_back(ALL);
        let shapes: Vec<_> = scene.meshes.iter().map(|mesh| mesh.shape).collect();
        let spot = Shape::Spot { inner_deg: 10.0, outer_deg: 30.0 };
        assert_eq!(shapes, [Shape::Point, spot, Shape::Sphere, Shape::Rectangle]);
        assert_eq!(scene.materials[0].emission, Vec3::new(8.0, 4.0, 2.0));
        assert!(scene.materials[3].two_sided_emission && !scene.materials[2].two_sided_emission);
        let down = scene.instances[1].world_from_object.transform_vector3(Vec3::NEG_Z);
        assert!(down.abs_diff_eq(Vec3::NEG_Y, 1e-6), "{down}");
        let edge = scene.instances[3].world_from_object.transform_point3(Vec3::new(1.0, 1.0, 0.0));
        assert!(edge.abs_diff_eq(Vec3::new(0.5, 3.0, 1.0), 1e-6), "{edge}");
        assert_eq!(scene.distant[0].irradiance, Vec3::new(2.0, 2.0, 1.0));
        assert!(scene.distant[0].direction.abs_diff_eq(Vec3::new(0.0, -0.6, 0.8), 1e-6));
        assert_eq!(scene.shape_count(), 5);
        assert_eq!((scene.triangle_count(), scene.emissive_triangle_count()), (0, 0));
    }

    #[test]
    fn lights_that_are_written_are_read_back_as_they_were() {
        let scene = read_back(ALL);
        let written = to_json(&scene).expect("lights").to_string();
        let again = read_back(&written);
        assert_eq!(again.distant, scene.distant);
        assert_eq!(again.materials, scene.materials);
        for (was, is) in scene.instances.iter().zip(&again.instances) {
            assert!(is.world_from_object.abs_diff_eq(was.world_from_object, 1e-6), "{is:?} {was:?}");
        }
        assert_eq!(to_json(&again).expect("lights").to_string(), written);
        assert_eq!(to_json(&Scene::default()), None);
    }

    #[test]
    fn equal_lights_share_a_mesh() {
        let one = r#"{"type": "point", "position": [1, 2, 3], "intensity": 8}"#;
        let scene = read_back(&format!(r#"{{"lights": [{one}, {one}, {one}]}}"#));
        assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 3));
    }

    #[test]
    fn errors_name_file_light_field_and_remedy() {
        let point = |from: &str, to: &str| {
            let light = r#"{"type": "point", "position": [1, 2, 3], "color": [1, 1, 1], "intensity": 8}"#;
            format!(r#"{{"lights": [{light}, {}]}}"#, light.replace(from, to))
        };
        let rest = |light: &str| format!(r#"{{"lights": [{light}]}}"#);
        let spot = |inner: &str, outer: &str| {
            rest(&format!(
                r#"{{"type": "spot", "position": [0, 0, 0], "direction": [0, 1, 0], "inner_cone_deg": {inner},
                "outer_cone_deg": {outer}, "intensity": 1}}"#
            ))
        };
        let rectangle = |u: &str| {
            rest(&format!(r#"{{"type": "rectangle", "position": [0, 0, 0], "u": {u}, "v": [0, 1, 0], "radiance": 1}}"#))
        };
        let sphere = |radius: &str| {
            rest(&format!(r#"{{"type": "sphere", "position": [0, 0, 0], "radius": {radius}, "radiance": 1}}"#))
        };
        for (text, what) in [
            (point("position", "place"), "light 2: `position` is missing"),
            (point("\"intensity\": 8", "\"intensity\": 8, \"range\": 1"), "light 2: `range` is no field of a point"),
            (point("[1, 2, 3]", "[1, 2]"), "light 2: `position` is not three numbers"),
            (point("[1, 2, 3]", "[1, 2, 1e39]"), "light 2: `position` is too large"),
            (point("[1, 1, 1]", "[1, -1, 1]"), "light 2: `color` times `intensity`"),
            (point("8", "-8"), "light 2: `intensity` is -8, not in 0..="),
            (point("8", "1e30"), "light 2: `intensity` is 1e+30, not in 0..=1e20"),
            (point("8", "null"), "light 2: `intensity` is null, not a number"),
            (point("\"point\"", "\"area\""), "light 2: `type` is \"area\", not \"point\""),
            (spot("5", "0"), "light 1: `outer_cone_deg` is 0, not in 1..=90"),
            (spot("31", "30"), "light 1: `inner_cone_deg` is 31, not in 0..=30"),
            (rectangle("[0, 2, 0]"), "light 1: `u` and `v` are not two edges"),
            (rectangle("[0, 0, 0]"), "light 1: `u` and `v` are not two edges"),
            (sphere("0"), "light 1: `radius` is 0, not in"),
            (sphere("1e30"), "light 1: `radius` is 1e+30, not in 1e-9..=1e9"),
            (rest("7"), "light 1: not an object"),
            ("{\"lights\": 3}".to_owned(), "not lights: `lights` is not a list"),
            ("{\"lights\": [], \"camera\": 1}".to_owned(), "not lights: `camera` is no field of such a file"),
            ("{}".to_owned(), "not lights: `lights` is missing"),
            ("[]".to_owned(), "not lights: invalid type"),
            ("{\"lights\": [}".to_owned(), "not lights: expected value"),
        ] {
            let error = parse(text.as_bytes(), "a.lights.json").expect_err(what).to_string();
            assert!(error.starts_with("a.lights.json") && error.contains(what), "{error}\n{what}");
            assert!(error.contains("\nhelp: a file of lights is"), "{error}");
        }
    }
}
