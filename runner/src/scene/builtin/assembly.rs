//! Puts materials, meshes and instances into a scene and hands out their indices.

use glam::{Mat4, Vec3};

use super::shapes::MeshBuilder;
use crate::scene::{Camera, Instance, Material, Motion, Scene};

/// A scene under construction.
pub(super) struct Assembly {
    scene: Scene,
}

impl Assembly {
    /// An empty scene.
    pub(super) fn new(name: &str) -> Self {
        Self { scene: Scene { name: name.to_owned(), ..Scene::default() } }
    }

    /// What has been assembled, seen from `camera`.
    pub(super) fn finish(mut self, camera: Camera) -> Scene {
        self.scene.camera = Some(camera);
        self.scene
    }

    /// How many triangles of a mesh emit light.
    pub(super) fn emissive_triangles_of(&self, mesh: u32) -> usize {
        let emits = |&material: &u32| self.scene.materials[material as usize].emission != Vec3::ZERO;
        self.scene.meshes[mesh as usize].materials.iter().filter(|material| emits(material)).count()
    }

    /// How many triangles emit light so far, over all instances.
    pub(super) fn emissive_triangles(&self) -> usize {
        let of_mesh: Vec<usize> =
            (0..self.scene.meshes.len() as u32).map(|mesh| self.emissive_triangles_of(mesh)).collect();
        self.scene.instances.iter().map(|instance| of_mesh[instance.mesh as usize]).sum()
    }

    fn material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// A Lambertian surface.
    pub(super) fn matte(&mut self, name: &str, base_color: [f32; 3]) -> u32 {
        self.material(Material { name: name.to_owned(), base_color: base_color.into(), ..Material::default() })
    }

    /// A coated surface: Lambert under a dielectric of refractive index 1.5.
    pub(super) fn glossy(&mut self, name: &str, base_color: [f32; 3], roughness: f32) -> u32 {
        self.material(Material {
            name: name.to_owned(),
            base_color: base_color.into(),
            specular: Vec3::splat(0.04),
            roughness,
            ..Material::default()
        })
    }

    /// A metal; its colour is what it reflects at normal incidence.
    pub(super) fn metal(&mut self, name: &str, base_color: [f32; 3], roughness: f32) -> u32 {
        self.material(Material {
            name: name.to_owned(),
            base_color: base_color.into(),
            specular: Vec3::splat(0.04),
            roughness,
            metallic: 1.0,
            ..Material::default()
        })
    }

    /// A lamp: black but for what it emits, `tint * radiance`.
    pub(super) fn lamp(&mut self, name: &str, tint: [f32; 3], radiance: f32) -> u32 {
        self.material(Material {
            name: name.to_owned(),
            base_color: Vec3::ZERO,
            emission: Vec3::from_array(tint) * radiance,
            ..Material::default()
        })
    }

    /// Adds a mesh; `shape` fills it.
    pub(super) fn mesh(&mut self, name: impl Into<String>, shape: impl FnOnce(&mut MeshBuilder)) -> u32 {
        let mut builder = MeshBuilder::new(name);
        shape(&mut builder);
        self.scene.meshes.push(builder.finish());
        self.scene.meshes.len() as u32 - 1
    }

    /// Places a mesh that stays where it is.
    pub(super) fn place(&mut self, mesh: u32, world_from_object: Mat4) {
        self.place_moving(mesh, world_from_object, Motion::Still);
    }

    /// Places a mesh that moves.
    pub(super) fn place_moving(&mut self, mesh: u32, world_from_object: Mat4, motion: Motion) {
        self.scene.instances.push(Instance { mesh, world_from_object, motion });
    }
}
