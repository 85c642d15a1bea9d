//! Scenes as the host sees them: meshes, instances, materials, textures, an environment, a camera.
//!
//! Everything here is plain data with public fields. Readers ([`crate::scene::obj`]) and generators
//! ([`crate::scene::builtin`]) make a [`Scene`]; [`Scene::validate`] is what they must satisfy, and what the
//! packing into GPU buffers relies on.

pub mod bounds;
pub mod builtin;
pub mod camera;
pub mod choice;
mod downscale;
pub mod environment;
pub mod error;
pub mod export;
mod keywords;
pub mod lights;
mod lines;
pub mod load;
mod map_options;
mod material;
pub mod mtl;
mod normalize;
mod numbers;
pub mod obj;
pub mod source;
mod statements;
mod texture;
mod validate;

use glam::{Mat4, Vec2, Vec3};

/// A scene: flat tables that refer to each other by index.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// A short name for messages and file names.
    pub name: String,
    /// Geometry in object space; every instance refers to one.
    pub meshes: Vec<Mesh>,
    /// What is in the world.
    pub instances: Vec<Instance>,
    /// Materials, referred to by triangle.
    pub materials: Vec<Material>,
    /// Images, referred to by materials.
    pub textures: Vec<Texture>,
    /// Light from infinitely far away.
    pub environment: Option<Environment>,
    /// Directional lights: light from infinitely far away, each from one direction.
    pub distant: Vec<DistantLight>,
    /// The camera that the scene suggests.
    pub camera: Option<Camera>,
}

/// Triangles in object space, counter-clockwise seen from the front; or a light of another [`Shape`].
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// A name for messages.
    pub name: String,
    /// Vertex positions in scene units, all finite.
    pub positions: Vec<Vec3>,
    /// Shading normals, one a vertex or none at all. A zero vector means: use the geometric normal there.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one a vertex or none at all. (0, 0) is the lower left corner of the image.
    pub uvs: Vec<Vec2>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Material of each triangle; of a shape, its only one.
    pub materials: Vec<u32>,
    /// What the mesh is; other than triangles, it has nothing but this, a name and a material.
    pub shape: Shape,
    /// Whether its triangles shine, but no ray finds them: they are not seen, and cast no shadows. Of OBJ files, none are.
    pub unseen: bool,
}

/// What a mesh is: triangles, or a light in closed form.
///
/// The emission of such a light's material is its radiance in W sr^-1 m^-2, or the radiant intensity in W sr^-1 of a point
/// or spot; its textures have no effect. Rays find none of these lights: they shine, but the camera does not see them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Shape {
    /// Triangles.
    #[default]
    Triangles,
    /// The origin; shines in all directions alike.
    Point,
    /// The origin; shines along -z, with the falloff of `KHR_lights_punctual`. Angles are between the axis and the
    /// surface of a cone, in degrees: 0 <= inner <= outer, 1 <= outer <= 90.
    Spot {
        /// Within this angle it shines with full intensity.
        inner_deg: f32,
        /// Beyond this angle it does not shine.
        outer_deg: f32,
    },
    /// The unit sphere; shines outward. Under a placement that scales unevenly it is a sphere of the same volume as the
    /// ellipsoid.
    Sphere,
    /// The square from (-1, -1) to (1, 1) in the plane z = 0, with its front to +z.
    Rectangle,
}

/// Light from infinitely far away, from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistantLight {
    /// Which way the light travels, of length 1.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it, in W m^-2, linear Rec. 709, each in 0..=1e20.
    pub irradiance: Vec3,
}

/// One placement of a mesh in the world.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Placement at time 0; affine and invertible.
    pub world_from_object: Mat4,
    /// How the placement changes over time.
    pub motion: Motion,
}

/// A motion, a closed form in time, so that any frame can be asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Motion {
    /// Stays where it is.
    #[default]
    Still,
    /// Turns about an axis through `center` (world space).
    Turn {
        /// A point on the axis.
        center: Vec3,
        /// Direction of the axis, of length 1.
        axis: Vec3,
        /// Speed; negative turns the other way.
        turns_per_second: f32,
    },
    /// Moves to and fro: `offset * sin(2 pi (frequency_hz * t + phase))`.
    Swing {
        /// Displacement at the extreme, in scene units.
        offset: Vec3,
        /// Swings a second.
        frequency_hz: f32,
        /// Fraction of a swing at time 0, in 0..1.
        phase: f32,
    },
}

impl Scene {
    /// Places everything as it is at `time_s` seconds, and stops it there.
    pub fn stop_at(&mut self, time_s: f32) {
        for instance in &mut self.instances {
            instance.world_from_object = instance.world_from_object_at(time_s);
            instance.motion = Motion::Still;
        }
    }
}

impl Instance {
    /// The placement at `time_s` seconds.
    pub fn world_from_object_at(&self, time_s: f32) -> Mat4 {
        use core::f32::consts::TAU;
        match self.motion {
            Motion::Still => self.world_from_object,
            Motion::Turn { center, axis, turns_per_second } => {
                let angle = TAU * (turns_per_second * time_s).fract();
                Mat4::from_translation(center)
                    * Mat4::from_axis_angle(axis, angle)
                    * Mat4::from_translation(-center)
                    * self.world_from_object
            }
            Motion::Swing { offset, frequency_hz, phase } => {
                let angle = TAU * (frequency_hz * time_s + phase).fract();
                Mat4::from_translation(offset * angle.sin()) * self.world_from_object
            }
        }
    }
}

/// A surface: Lambert plus GGX with Schlick's Fresnel term, as in the glTF 2.0 specification.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file, for messages.
    pub name: String,
    /// Linear Rec. 709 albedo, in 0..=1 (`Kd`).
    pub base_color: Vec3,
    /// Multiplies `base_color`; index into [`Scene::textures`] (`map_Kd`).
    pub base_color_texture: Option<u32>,
    /// Reflectance at normal incidence of the dielectric, in 0..=1. Zero: no specular lobe at all.
    pub specular: Vec3,
    /// Perceptual roughness, the square root of the GGX alpha, in 0..=1 (`Pr`).
    pub roughness: f32,
    /// 0 is a dielectric, 1 a metal (`Pm`).
    pub metallic: f32,
    /// Radiance emitted from the front face, in W sr^-1 m^-2, linear Rec. 709, each in 0..=1e20 (`Ke`); for points and
    /// spots see [`Shape`].
    pub emission: Vec3,
    /// Multiplies `emission` (`map_Ke`).
    pub emission_texture: Option<u32>,
    /// Whether both faces emit.
    pub two_sided_emission: bool,
    /// Alpha mask: where the red channel of this texture (linear) is below 0.5 there is no surface (`map_d`).
    pub alpha_texture: Option<u32>,
}

impl Default for Material {
    /// A grey Lambertian surface: what is drawn where a material is missing.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec3::splat(0.5),
            base_color_texture: None,
            specular: Vec3::ZERO,
            roughness: 1.0,
            metallic: 0.0,
            emission: Vec3::ZERO,
            emission_texture: None,
            two_sided_emission: false,
            alpha_texture: None,
        }
    }
}

impl Scene {
    /// Makes every surface Lambertian with its base colour, for comparisons with other renderers.
    pub fn make_lambertian(&mut self) {
        for material in &mut self.materials {
            (material.specular, material.metallic, material.roughness) = (Vec3::ZERO, 0.0, 1.0);
        }
    }
}

/// An 8-bit image that repeats in both directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// File name, for messages.
    pub name: String,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Whether RGB is sRGB-encoded (colours) or linear (masks).
    pub srgb: bool,
    /// RGBA, red in the low byte; the first row is the top of the image.
    pub texels: Vec<u32>,
}

/// Radiance from infinitely far away, an equirectangular map: the first row is up (+y), the middle column is -z.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// File name, for messages.
    pub name: String,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance, linear Rec. 709, finite and not negative, in W sr^-1 m^-2.
    pub texels: Vec<[f32; 3]>,
    /// Turn about +y, counter-clockwise seen from above, in degrees.
    pub rotation_deg: f32,
    /// Multiplies the radiance.
    pub scale: f32,
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands, in scene units.
    pub origin: Vec3,
    /// What is in the middle of the picture.
    pub target: Vec3,
    /// Which way is up; need not be perpendicular to the view.
    pub up: Vec3,
    /// Vertical field of view in degrees, in 0..180 exclusive.
    pub vfov_deg: f32,
}
