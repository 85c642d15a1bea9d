//! What every scene promises to those who pack and trace it.

use glam::{Mat4, Vec3, Vec4};

use super::error::SceneError;
use super::keywords::MAX_RADIANCE;
use super::{DistantLight, Environment, Instance, Material, Mesh, Motion, Scene, Shape, Texture};

impl Scene {
    /// Checks that indices are in range, lengths match, numbers are finite and in range, and placements are affine
    /// and invertible.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] with the first broken promise.
    pub fn validate(&self) -> Result<(), SceneError> {
        self.check().map_err(|what| SceneError::Invalid { scene: self.name.clone(), what })
    }

    fn check(&self) -> Result<(), String> {
        let in_thing = |kind: &str, index: usize, name: &str| {
            let thing = format!("{kind} {index} (`{name}`)");
            move |what: String| format!("{thing}: {what}")
        };
        for (index, mesh) in self.meshes.iter().enumerate() {
            check_mesh(mesh, self.materials.len()).map_err(in_thing("mesh", index, &mesh.name))?;
        }
        for (index, instance) in self.instances.iter().enumerate() {
            check_instance(instance, self.meshes.len()).map_err(in_thing("instance", index, ""))?;
        }
        for (index, material) in self.materials.iter().enumerate() {
            check_material(material, &self.textures).map_err(in_thing("material", index, &material.name))?;
        }
        for (index, texture) in self.textures.iter().enumerate() {
            check_size(texture.width, texture.height, texture.texels.len()).map_err(in_thing(
                "texture",
                index,
                &texture.name,
            ))?;
        }
        if let Some(environment) = &self.environment {
            check_environment(environment).map_err(in_thing("environment", 0, &environment.name))?;
        }
        for (index, light) in self.distant.iter().enumerate() {
            check_distant(light).map_err(in_thing("directional light", index, ""))?;
        }
        match &self.camera {
            Some(camera) => camera.check(),
            None => Ok(()),
        }
    }
}

/// `Err(what())` unless `holds`.
fn ensure(holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what()) }
}

fn check_mesh(mesh: &Mesh, materials: usize) -> Result<(), String> {
    let vertices = mesh.positions.len();
    ensure(vertices <= u32::MAX as usize, || format!("{vertices} vertices are more than an index can tell apart"))?;
    for (what, count) in [("normals", mesh.normals.len()), ("texture coordinates", mesh.uvs.len())] {
        ensure(count == 0 || count == vertices, || format!("{count} {what} for {vertices} vertices"))?;
    }
    let (triangles, picks) = (mesh.triangles.len(), mesh.materials.len());
    if mesh.shape == Shape::Triangles {
        ensure(triangles == picks, || format!("{picks} materials for {triangles} triangles"))?;
    } else {
        check_shape(mesh.shape)?;
        ensure(triangles == 0 && vertices == 0 && picks == 1, || {
            format!(
                "{vertices} vertices, {triangles} triangles and {picks} materials for a shape, which has one material"
            )
        })?;
    }
    let not_finite = mesh.positions.iter().position(|position| !position.is_finite());
    ensure(not_finite.is_none(), || format!("position {} is not finite", not_finite.unwrap_or(0)))?;
    let not_finite = mesh.normals.iter().position(|normal| !normal.is_finite());
    ensure(not_finite.is_none(), || format!("normal {} is not finite", not_finite.unwrap_or(0)))?;
    let not_finite = mesh.uvs.iter().position(|uv| !uv.is_finite());
    ensure(not_finite.is_none(), || format!("texture coordinate {} is not finite", not_finite.unwrap_or(0)))?;
    let outside = mesh.triangles.iter().position(|corners| corners.iter().any(|&corner| corner as usize >= vertices));
    ensure(outside.is_none(), || {
        format!("triangle {} refers to a vertex beyond the {vertices} there are", outside.unwrap_or(0))
    })?;
    let outside = mesh.materials.iter().position(|&material| material as usize >= materials);
    ensure(outside.is_none(), || {
        format!("triangle {} refers to a material beyond the {materials} there are", outside.unwrap_or(0))
    })
}

fn check_shape(shape: Shape) -> Result<(), String> {
    let Shape::Spot { inner_deg, outer_deg } = shape else { return Ok(()) };
    ensure((1.0..=90.0).contains(&outer_deg), || format!("outer cone {outer_deg} is not in 1..=90 degrees"))?;
    ensure((0.0..=outer_deg).contains(&inner_deg), || {
        format!("inner cone {inner_deg} is not between 0 and the outer one, {outer_deg} degrees")
    })
}

fn check_distant(light: &DistantLight) -> Result<(), String> {
    let DistantLight { direction, irradiance } = *light;
    let unit = (direction.length_squared() - 1.0).abs() < 1e-3;
    ensure(unit, || format!("its direction {direction} does not have length 1"))?;
    let within = irradiance.min_element() >= 0.0 && irradiance.max_element() <= MAX_RADIANCE as f32;
    ensure(within && irradiance.is_finite(), || format!("irradiance {irradiance} is not in 0..=1e20"))
}

fn check_instance(instance: &Instance, meshes: usize) -> Result<(), String> {
    ensure((instance.mesh as usize) < meshes, || format!("mesh {} of {meshes} does not exist", instance.mesh))?;
    let placement = instance.world_from_object;
    ensure(is_placement(placement), || format!("its placement is not affine and invertible: {placement}"))?;
    match instance.motion {
        Motion::Still => Ok(()),
        Motion::Turn { center, axis, turns_per_second } => {
            let unit = (axis.length_squared() - 1.0).abs() < 1e-3;
            ensure(unit, || format!("its axis {axis} does not have length 1"))?;
            ensure(center.is_finite() && turns_per_second.is_finite(), || "its turn is not finite".to_owned())
        }
        Motion::Swing { offset, frequency_hz, phase } => {
            let finite = offset.is_finite() && frequency_hz.is_finite() && phase.is_finite();
            ensure(finite, || "its swing is not finite".to_owned())
        }
    }
}

fn is_placement(matrix: Mat4) -> bool {
    let affine = matrix.is_finite() && matrix.row(3) == Vec4::W;
    // In f64: the determinant of a small but sound placement is 0 in f32.
    let determinant = matrix.as_dmat4().determinant();
    affine && determinant != 0.0 && matrix.as_dmat4().inverse().as_mat4().is_finite()
}

fn check_material(material: &Material, textures: &[Texture]) -> Result<(), String> {
    let within = |v: Vec3, max: f32| v.min_element() >= 0.0 && v.max_element() <= max && v.is_finite();
    ensure(within(material.base_color, 1.0), || format!("base colour {} is not in 0..=1", material.base_color))?;
    ensure(within(material.specular, 1.0), || format!("specular {} is not in 0..=1", material.specular))?;
    ensure(within(material.emission, MAX_RADIANCE as f32), || {
        format!("emission {} is not in 0..=1e20", material.emission)
    })?;
    for (what, value) in [("roughness", material.roughness), ("metallic", material.metallic)] {
        ensure((0.0..=1.0).contains(&value), || format!("{what} {value} is not in 0..=1"))?;
    }
    for texture in [material.base_color_texture, material.emission_texture, material.alpha_texture] {
        let exists = texture.is_none_or(|texture| (texture as usize) < textures.len());
        ensure(exists, || format!("texture {texture:?} of {} does not exist", textures.len()))?;
    }
    Ok(())
}

fn check_size(width: u32, height: u32, texels: usize) -> Result<(), String> {
    let expected = u64::from(width) * u64::from(height);
    ensure(expected > 0 && expected == texels as u64, || format!("{texels} texels for {width}x{height}"))
}

fn check_environment(environment: &Environment) -> Result<(), String> {
    check_size(environment.width, environment.height, environment.texels.len())?;
    let Environment { rotation_deg, scale, .. } = *environment;
    ensure(rotation_deg.is_finite(), || format!("rotation {rotation_deg} is not finite"))?;
    ensure(scale.is_finite() && scale >= 0.0, || format!("scale {scale} is not a finite number of at least 0"))?;
    let bad = environment.texels.as_flattened().iter().position(|value| !(value.is_finite() && *value >= 0.0));
    ensure(bad.is_none(), || format!("texel {} is negative or not finite", bad.unwrap_or(0) / 3))?;
    let brightest = environment.texels.as_flattened().iter().fold(0.0, |most: f32, value| most.max(*value));
    ensure(brightest * scale <= MAX_RADIANCE as f32, || format!("radiance {brightest} times {scale} is above 1e20"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, bounds::Bounds};

    fn scene() -> Scene {
        Scene {
            name: "s".into(),
            meshes: vec![Mesh {
                name: "m".into(),
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                triangles: vec![[0, 1, 2]],
                materials: vec![0],
                ..Mesh::default()
            }],
            instances: vec![Instance { mesh: 0, world_from_object: Mat4::IDENTITY, motion: Motion::Still }],
            materials: vec![Material::default()],
            ..Scene::default()
        }
    }

    #[test]
    fn a_sound_scene_passes() {
        scene().validate().expect("sound");
        Scene::default().validate().expect("empty scenes are sound");
    }

    #[test]
    fn every_broken_promise_is_found_and_named() {
        type Break = fn(&mut Scene);
        let cases: [(Break, &str); 19] = [
            (|s| s.meshes[0].triangles[0][1] = 3, "triangle 0 refers to a vertex beyond the 3"),
            (|s| s.meshes[0].materials[0] = 1, "refers to a material beyond the 1"),
            (|s| s.meshes[0].materials.clear(), "0 materials for 1 triangles"),
            (|s| s.meshes[0].normals.push(Vec3::Z), "1 normals for 3 vertices"),
            (|s| s.meshes[0].uvs.push(glam::Vec2::ZERO), "1 texture coordinates for 3 vertices"),
            (|s| s.meshes[0].positions[2].y = f32::NAN, "mesh 0 (`m`): position 2 is not finite"),
            (|s| s.meshes[0].normals = vec![Vec3::INFINITY; 3], "normal 0 is not finite"),
            (|s| s.meshes[0].uvs = vec![glam::Vec2::NAN; 3], "texture coordinate 0 is not finite"),
            (|s| s.instances[0].mesh = 1, "mesh 1 of 1 does not exist"),
            (|s| s.instances[0].world_from_object.x_axis.w = 1.0, "not affine and invertible"),
            (|s| s.instances[0].world_from_object.y_axis = Vec4::ZERO, "not affine and invertible"),
            (
                |s| s.instances[0].motion = Motion::Turn { center: Vec3::ZERO, axis: Vec3::ONE, turns_per_second: 1.0 },
                "does not have length 1",
            ),
            (
                |s| s.instances[0].motion = Motion::Swing { offset: Vec3::NAN, frequency_hz: 1.0, phase: 0.0 },
                "swing is not finite",
            ),
            (|s| s.materials[0].base_color.x = 1.5, "base colour"),
            (|s| s.materials[0].emission.y = f32::INFINITY, "emission"),
            (|s| s.materials[0].roughness = f32::NAN, "roughness NaN"),
            (|s| s.materials[0].alpha_texture = Some(0), "texture Some(0) of 0 does not exist"),
            (
                |s| s.textures.push(Texture { name: "t".into(), width: 2, height: 1, srgb: true, texels: vec![0] }),
                "texture 0 (`t`): 1 texels for 2x1",
            ),
            (
                |s| {
                    let (name, texels) = ("e".into(), vec![[0.0, -1.0, 0.0]]);
                    s.environment =
                        Some(Environment { name, width: 1, height: 1, texels, rotation_deg: 0.0, scale: 1.0 });
                },
                "environment 0 (`e`): texel 0 is negative",
            ),
        ];
        for (break_it, expected) in cases {
            let mut scene = scene();
            break_it(&mut scene);
            let error = scene.validate().expect_err(expected).to_string();
            assert!(error.starts_with("scene `s`: ") && error.contains(expected), "{error}");
        }
    }

    #[test]
    fn small_placements_are_invertible() {
        let mut scene = scene();
        scene.instances[0].world_from_object = Mat4::from_scale(Vec3::splat(1e-14));
        scene.validate().expect("determinant 1e-42, but invertible");
    }

    #[test]
    fn counts_and_bounds_go_by_instances() {
        let mut scene = scene();
        let mut shifted = scene.instances[0].clone();
        shifted.world_from_object = Mat4::from_translation(Vec3::new(10.0, 0.0, 0.0));
        scene.instances.push(shifted);
        assert_eq!((scene.triangle_count(), scene.emissive_triangle_count()), (2, 0));
        scene.materials[0].emission = Vec3::X;
        assert_eq!(scene.emissive_triangle_count(), 2);
        let bounds = scene.bounds();
        assert_eq!(bounds, Some(Bounds { min: Vec3::ZERO, max: Vec3::new(11.0, 1.0, 0.0) }));
        assert_eq!(Scene::default().bounds(), None);
        scene.camera = Some(Camera::framing(scene.bounds().expect("not empty")));
        scene.validate().expect("sound");
    }
}
