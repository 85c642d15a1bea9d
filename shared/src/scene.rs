//! The scene as the passes see it: a few buffers of words, and typed views into them.
//!
//! The layouts of the records stand here once, as constants; the packing on the host writes by the same constants.

use glam::{UVec4, Vec2, Vec3};

use crate::{
    frame::Frame,
    numerics::{load, max},
    octahedral,
    ray::{max_abs, position_error},
};

/// Geometry, materials and images. What only some passes need (`bvh`, `lights`) is bound apart.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// Vertices, nine floats a triangle, in object space and in the order of the acceleration structure's leaves.
    pub triangles: &'a [f32],
    /// Instances, attributes of triangles, directional lights, materials, texture headers, emitters.
    pub records: &'a [u32],
    /// 8-bit images, and the environment's radiance.
    pub texels: &'a [u32],
}

/// Words of an instance in `records`.
pub mod instance_record {
    /// Rows of the 3x4 matrix to world space.
    pub const WORLD_FROM_OBJECT: u32 = 0;
    /// Rows of the 3x4 matrix to object space.
    pub const OBJECT_FROM_WORLD: u32 = 12;
    /// Root node of the mesh in `bvh`.
    pub const ROOT: u32 = 24;
    /// In its place, of a sphere: radius in world space.
    pub const RADIUS: u32 = ROOT;
    /// First triangle of the mesh in `triangles`.
    pub const FIRST_TRIANGLE: u32 = 25;
    /// Where the attributes of the mesh start in `records`.
    pub const ATTRIBUTES_AT: u32 = 26;
    /// Bits of [`super::attribute_flags`].
    pub const FLAGS: u32 = 27;
    /// Where the list of emissive triangles of the mesh starts in `records`.
    pub const LIGHT_LIST_AT: u32 = 28;
    /// Where the alias table of the mesh starts in `lights`.
    pub const LIGHT_TABLE_AT: u32 = 29;
    /// Emissive triangles of the mesh; 1 for a shape that emits.
    pub const LIGHT_COUNT: u32 = 30;
    /// Number of the instance's first light among all lights.
    pub const FIRST_LIGHT: u32 = 31;
    /// RGB factor on the emission of its materials.
    pub const EMISSION_SCALE: u32 = 32;
    /// The same instance in the other frame (before, for this frame's; this, for that before), or
    /// [`super::NO_INSTANCE`].
    pub const COUNTERPART: u32 = 35;
    /// Where the light tree of the mesh starts in `lights`, or [`crate::light_tree::NO_TREE`].
    pub const LIGHT_TREE_AT: u32 = 36;
    /// Where the tree for cuts of the mesh starts in `lights`, or [`crate::light_tree::NO_TREE`].
    pub const LIGHT_CUTS_AT: u32 = 37;
    /// Where the trees over its triangles start in `records` that tell where light has a closed form, or
    /// [`crate::closed_form::NO_TREES`].
    pub const CLOSED_FORM_AT: u32 = 38;
    /// Words in all.
    pub const WORDS: u32 = 39;
}

/// What an instance says of itself, and which attributes its mesh has beside a material for each triangle.
pub mod attribute_flags {
    /// Three packed shading normals; the code 0xffffffff stands for the geometric normal.
    pub const NORMALS: u32 = 1;
    /// Three pairs of texture coordinates.
    pub const UVS: u32 = 2;
    /// The instance's transform has a negative determinant.
    pub const MIRRORED: u32 = 4;
    /// From this bit on: a number of [`super::shape`].
    pub const SHAPE_SHIFT: u32 = 3;
}

/// What an instance is: triangles, or a light of a shape in closed form, which no ray finds.
///
/// A shape in closed form has one light. Its attributes are its material and, of a punctual one, [`shape::FALLOFF_SCALE`] and what follows.
pub mod shape {
    /// Triangles.
    pub const TRIANGLES: u32 = 0;
    /// A point at the origin of object space, which shines along -z as far as its falloff says.
    pub const PUNCTUAL: u32 = 1;
    /// A sphere about the origin of object space, which shines outward.
    pub const SPHERE: u32 = 2;
    /// The square from (-1, -1) to (1, 1) in the plane z = 0 of object space, which shines along +z.
    pub const RECTANGLE: u32 = 3;
    /// Triangles that shine, each a light of its own, and that no ray finds.
    pub const UNSEEN: u32 = 4;
    /// Word of its attributes: factor on the cosine with its axis.
    pub const FALLOFF_SCALE: u32 = 1;
    /// Word of its attributes: what is added to that.
    pub const FALLOFF_OFFSET: u32 = 2;
}

/// Words of a directional light in `records`.
pub mod distant_record {
    /// Direction toward it, of length 1.
    pub const DIRECTION: u32 = 0;
    /// RGB irradiance on a surface that faces it, in W m^-2.
    pub const IRRADIANCE: u32 = 3;
    /// Words in all.
    pub const WORDS: u32 = 6;
}

/// A packed normal that stands for the geometric one: no direction packs to it.
pub const NO_NORMAL: u32 = 0xffff_ffff;

/// Words of a material in `records`.
pub mod material_record {
    /// Linear RGB.
    pub const BASE_COLOR: u32 = 0;
    /// Perceptual roughness.
    pub const ROUGHNESS: u32 = 3;
    /// RGB reflectance at normal incidence.
    pub const SPECULAR: u32 = 4;
    /// Metallic share.
    pub const METALLIC: u32 = 7;
    /// RGB radiance; of a punctual shape, radiant intensity.
    pub const EMISSION: u32 = 8;
    /// 1: both faces emit.
    pub const TWO_SIDED: u32 = 11;
    /// Texture or [`super::NO_TEXTURE`].
    pub const BASE_COLOR_TEXTURE: u32 = 12;
    /// Texture or [`super::NO_TEXTURE`].
    pub const EMISSION_TEXTURE: u32 = 13;
    /// Texture or [`super::NO_TEXTURE`].
    pub const ALPHA_TEXTURE: u32 = 14;
    /// Words in all.
    pub const WORDS: u32 = 16;
}

/// An instance without a counterpart in the other frame.
pub const NO_INSTANCE: u32 = 0xffff_ffff;

/// A material without that texture.
pub const NO_TEXTURE: u32 = 0xffff_ffff;

/// Words of a texture header in `records`.
pub mod texture_record {
    /// Where the texels start in `texels`.
    pub const TEXELS_AT: u32 = 0;
    /// Texels in a row.
    pub const WIDTH: u32 = 1;
    /// Rows.
    pub const HEIGHT: u32 = 2;
    /// 1: RGB is sRGB-encoded.
    pub const SRGB: u32 = 3;
    /// Words in all.
    pub const WORDS: u32 = 4;
}

/// Words of an emitter, an instance that emits, in `records`; emitters stand in the order of their lights.
pub mod emitter_record {
    /// Number of its first light.
    pub const FIRST_LIGHT: u32 = 0;
    /// Its instance.
    pub const INSTANCE: u32 = 1;
    /// Words in all.
    pub const WORDS: u32 = 2;
}

/// A triangle in world space.
#[derive(Clone, Copy)]
pub struct WorldTriangle {
    /// First vertex.
    pub a: Vec3,
    /// Second vertex.
    pub b: Vec3,
    /// Third vertex.
    pub c: Vec3,
    /// -1 where the instance mirrors the mesh, else 1: the front face stays the front face.
    pub facing: f32,
}

impl WorldTriangle {
    /// Twice the area times the unit normal of the front face, where the vertices of the mesh run counter-clockwise.
    #[inline(always)]
    pub fn doubled_area_normal(&self) -> Vec3 {
        (self.b - self.a).cross(self.c - self.a) * self.facing
    }

    /// The point with weights `u` and `v` of the second and third vertex.
    #[inline(always)]
    pub fn point(&self, u: f32, v: f32) -> Vec3 {
        let w = 1.0 - u - v;
        self.a * w + self.b * u + self.c * v
    }

    /// Margin around an interpolated point, see [`position_error`].
    #[inline(always)]
    pub fn error(&self) -> f32 {
        position_error(max(max(max_abs(self.a), max_abs(self.b)), max_abs(self.c)))
    }
}

impl Scene<'_> {
    #[inline(always)]
    fn word(&self, at: u32) -> u32 {
        load(self.records, at)
    }

    #[inline(always)]
    fn float(&self, at: u32) -> f32 {
        f32::from_bits(load(self.records, at))
    }

    #[inline(always)]
    fn vector(&self, at: u32) -> Vec3 {
        Vec3::new(self.float(at), self.float(at + 1), self.float(at + 2))
    }

    /// Where instance number `instance` starts in `records`.
    #[inline(always)]
    pub fn instance_at(&self, frame: &Frame, instance: u32) -> u32 {
        frame.instances_at + instance * instance_record::WORDS
    }

    /// A field of an instance.
    #[inline(always)]
    pub fn instance_word(&self, frame: &Frame, instance: u32, field: u32) -> u32 {
        self.word(self.instance_at(frame, instance) + field)
    }

    /// A point through the 3x4 matrix whose rows start at word `at`.
    #[inline(always)]
    pub fn transform_point(&self, at: u32, p: Vec3) -> Vec3 {
        let row = |i: u32| {
            let r = at + i * 4;
            self.float(r) * p.x + self.float(r + 1) * p.y + self.float(r + 2) * p.z + self.float(r + 3)
        };
        Vec3::new(row(0), row(1), row(2))
    }

    /// A direction through the 3x4 matrix whose rows start at word `at`.
    #[inline(always)]
    pub fn transform_vector(&self, at: u32, d: Vec3) -> Vec3 {
        let row = |i: u32| {
            let r = at + i * 4;
            self.float(r) * d.x + self.float(r + 1) * d.y + self.float(r + 2) * d.z
        };
        Vec3::new(row(0), row(1), row(2))
    }

    /// Column `i` of the 3x4 matrix whose rows start at word `at`: where an axis goes, or, of the last, the origin.
    #[inline(always)]
    pub fn column(&self, at: u32, i: u32) -> Vec3 {
        Vec3::new(self.float(at + i), self.float(at + 4 + i), self.float(at + 8 + i))
    }

    /// A direction through the transpose of the 3x4 matrix whose rows start at word `at`: normals go to world space
    /// by the transpose of the matrix to object space.
    #[inline(always)]
    pub fn transform_normal(&self, at: u32, n: Vec3) -> Vec3 {
        let column = |i: u32| self.float(at + i) * n.x + self.float(at + 4 + i) * n.y + self.float(at + 8 + i) * n.z;
        Vec3::new(column(0), column(1), column(2))
    }

    #[inline(always)]
    fn vertex(&self, triangle: u32, corner: u32) -> Vec3 {
        let at = triangle * 9 + corner * 3;
        Vec3::new(load(self.triangles, at), load(self.triangles, at + 1), load(self.triangles, at + 2))
    }

    /// Triangle number `triangle` of all, placed by an instance of its mesh.
    #[inline(always)]
    pub fn world_triangle(&self, frame: &Frame, instance: u32, triangle: u32) -> WorldTriangle {
        let record = self.instance_at(frame, instance);
        let at = record + instance_record::WORLD_FROM_OBJECT;
        let mirrored = (self.word(record + instance_record::FLAGS) & attribute_flags::MIRRORED) != 0;
        WorldTriangle {
            a: self.transform_point(at, self.vertex(triangle, 0)),
            b: self.transform_point(at, self.vertex(triangle, 1)),
            c: self.transform_point(at, self.vertex(triangle, 2)),
            facing: if mirrored { -1.0 } else { 1.0 },
        }
    }

    /// Where the attributes of a triangle start in `records`, and which there are.
    #[inline(always)]
    pub(crate) fn attributes_at(&self, frame: &Frame, instance: u32, triangle: u32) -> (u32, u32) {
        let at = self.instance_at(frame, instance);
        let flags = self.word(at + instance_record::FLAGS);
        let local = triangle - self.word(at + instance_record::FIRST_TRIANGLE);
        (self.word(at + instance_record::ATTRIBUTES_AT) + local * attribute_words(flags), flags)
    }

    /// Material of a triangle.
    #[inline(always)]
    pub fn material_of(&self, frame: &Frame, instance: u32, triangle: u32) -> Material {
        let (at, _) = self.attributes_at(frame, instance, triangle);
        Material { at: frame.materials_at + self.word(at) * material_record::WORDS }
    }

    /// Texture coordinates at barycentric weights (`u`, `v`); zero without any.
    #[inline(always)]
    pub fn uv_at(&self, frame: &Frame, instance: u32, triangle: u32, u: f32, v: f32) -> Vec2 {
        let (at, flags) = self.attributes_at(frame, instance, triangle);
        if (flags & attribute_flags::UVS) == 0 {
            return Vec2::ZERO;
        }
        let first = at + 1 + (flags & attribute_flags::NORMALS) * 3;
        let corner = |i: u32| Vec2::new(self.float(first + i * 2), self.float(first + i * 2 + 1));
        corner(0) * (1.0 - u - v) + corner(1) * u + corner(2) * v
    }

    /// Shading normal in world space at barycentric weights (`u`, `v`), of length 1; `normal_geometric` where the
    /// mesh has none.
    #[inline(always)]
    pub fn shading_normal_at(
        &self,
        frame: &Frame,
        instance: u32,
        triangle: u32,
        u: f32,
        v: f32,
        normal_geometric: Vec3,
    ) -> Vec3 {
        let (at, flags) = self.attributes_at(frame, instance, triangle);
        if (flags & attribute_flags::NORMALS) == 0 {
            return normal_geometric;
        }
        let (a, b, c) = (self.word(at + 1), self.word(at + 2), self.word(at + 3));
        if a == NO_NORMAL || b == NO_NORMAL || c == NO_NORMAL {
            return normal_geometric;
        }
        let normal_object =
            octahedral::unpack(a) * (1.0 - u - v) + octahedral::unpack(b) * u + octahedral::unpack(c) * v;
        let matrix = self.instance_at(frame, instance) + instance_record::OBJECT_FROM_WORLD;
        let normal_world = self.transform_normal(matrix, normal_object);
        let length2 = normal_world.length_squared();
        if length2 > 1e-20 { normal_world * (1.0 / crate::numerics::sqrt(length2)) } else { normal_geometric }
    }

    /// RGB of a material at field `field`.
    #[inline(always)]
    pub fn material_rgb(&self, material: Material, field: u32) -> Vec3 {
        self.vector(material.at + field)
    }

    /// Emitted radiance of a material on an instance, before its texture.
    #[inline(always)]
    pub fn emission(&self, frame: &Frame, instance: u32, material: Material) -> Vec3 {
        let scale = self.vector(self.instance_at(frame, instance) + instance_record::EMISSION_SCALE);
        self.material_rgb(material, material_record::EMISSION) * scale
    }

    /// A number of a material.
    #[inline(always)]
    pub fn material_float(&self, material: Material, field: u32) -> f32 {
        self.float(material.at + field)
    }

    /// A word of a material.
    #[inline(always)]
    pub fn material_word(&self, material: Material, field: u32) -> u32 {
        self.word(material.at + field)
    }

    /// Header of a texture.
    #[inline(always)]
    pub fn texture(&self, frame: &Frame, texture: u32) -> UVec4 {
        let at = frame.textures_at + texture * texture_record::WORDS;
        UVec4::new(self.word(at), self.word(at + 1), self.word(at + 2), self.word(at + 3))
    }

    /// A field of an emitter.
    #[inline(always)]
    pub fn emitter_word(&self, frame: &Frame, emitter: u32, field: u32) -> u32 {
        self.word(frame.emitters_at + emitter * emitter_record::WORDS + field)
    }

    /// Which [`shape`] an instance is.
    #[inline(always)]
    pub fn shape_of(&self, frame: &Frame, instance: u32) -> u32 {
        self.instance_word(frame, instance, instance_record::FLAGS) >> attribute_flags::SHAPE_SHIFT
    }

    /// Three floats of `records` at an absolute place.
    #[inline(always)]
    pub fn record_vector(&self, at: u32) -> Vec3 {
        self.vector(at)
    }

    /// A word of `records` at an absolute place.
    #[inline(always)]
    pub fn record(&self, at: u32) -> u32 {
        self.word(at)
    }
}

/// Where a material stands in `records`.
#[derive(Clone, Copy)]
pub struct Material {
    /// First word.
    pub at: u32,
}

/// Words of attributes for each triangle of a mesh with these [`attribute_flags`].
#[inline(always)]
pub fn attribute_words(flags: u32) -> u32 {
    1 + (flags & attribute_flags::NORMALS) * 3 + ((flags & attribute_flags::UVS) >> 1) * 6
}
