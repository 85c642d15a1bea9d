//! How large a scene is: its box, and its triangles as instanced.

use glam::Vec3;

use super::{Material, Mesh, Scene, Shape};

/// A box along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Bounds {
    /// The box around some points; `None` around none.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Option<Self> {
        points.into_iter().fold(None, |bounds: Option<Self>, point| {
            let Self { min, max } = bounds.unwrap_or(Self { min: point, max: point });
            Some(Self { min: min.min(point), max: max.max(point) })
        })
    }

    /// The point in its middle.
    pub fn center(self) -> Vec3 {
        self.min + self.size() / 2.0
    }

    /// Its extent along each axis.
    pub fn size(self) -> Vec3 {
        self.max - self.min
    }

    /// Its corners.
    pub fn corners(self) -> [Vec3; 8] {
        let pick = |bit: usize, min: f32, max: f32| if bit == 0 { min } else { max };
        std::array::from_fn(|corner| {
            Vec3::new(
                pick(corner & 1, self.min.x, self.max.x),
                pick(corner & 2, self.min.y, self.max.y),
                pick(corner & 4, self.min.z, self.max.z),
            )
        })
    }
}

impl Material {
    /// Whether it sends out light.
    pub fn is_emissive(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}

impl Scene {
    /// A box that holds the triangles of every instance at time 0; `None` for a scene without any.
    ///
    /// Turned instances make it larger than need be: it goes by the boxes of their meshes.
    pub fn bounds(&self) -> Option<Bounds> {
        let meshes: Vec<_> = self.meshes.iter().map(|mesh| Bounds::of(mesh.positions.iter().copied())).collect();
        let corners = self.instances.iter().filter_map(|instance| {
            let mesh = meshes.get(instance.mesh as usize).copied().flatten()?;
            let world_from_object = instance.world_from_object_at(0.0);
            Some(mesh.corners().map(|corner| world_from_object.transform_point3(corner)))
        });
        Bounds::of(corners.flatten())
    }

    /// Triangles of all instances.
    pub fn triangle_count(&self) -> u64 {
        self.count_triangles(|_| true)
    }

    /// Triangles of all instances whose material is emissive.
    pub fn emissive_triangle_count(&self) -> u64 {
        let emissive: Vec<_> = self.materials.iter().map(Material::is_emissive).collect();
        self.count_triangles(|material| emissive.get(material as usize) == Some(&true))
    }

    /// Lights that are no triangles: instances of shapes, and directional lights.
    pub fn shape_count(&self) -> u64 {
        let is_shape = |mesh: u32| self.meshes.get(mesh as usize).is_some_and(|mesh| mesh.shape != Shape::Triangles);
        (self.instances.iter().filter(|instance| is_shape(instance.mesh)).count() + self.distant.len()) as u64
    }

    fn count_triangles(&self, counts: impl Fn(u32) -> bool) -> u64 {
        let count = |mesh: &Mesh| {
            let has_triangles = mesh.shape == Shape::Triangles;
            mesh.materials.iter().filter(|&&material| has_triangles && counts(material)).count() as u64
        };
        let in_mesh: Vec<_> = self.meshes.iter().map(count).collect();
        self.instances.iter().map(|instance| in_mesh.get(instance.mesh as usize).copied().unwrap_or(0)).sum()
    }
}
