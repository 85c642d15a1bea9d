//! Lights: emissive triangles, shapes (points, spots, spheres, rectangles), texels of the environment and directional
//! lights, addressed by an id and a point of the unit square.

use core::f32::consts::{PI, TAU};
use glam::Vec3;

use crate::{
    alias, environment,
    frame::Frame,
    numerics::{clamp, multiply_high, safe_sqrt, sin_cos, sqrt, unorm16_center},
    ray::{FAR, Hit, Ray, max_abs, offset_origin, position_error},
    scene::{NO_INSTANCE, NO_TEXTURE, Scene, attribute_flags, emitter_record, instance_record, material_record, shape},
    surface::Surface,
    texture,
    triangle::square_to_triangle,
};

/// Marks a light id as a texel of the environment, or behind the last texel as a directional light.
pub const ENVIRONMENT_BIT: u32 = 0x8000_0000;

/// Where candidates on emissive triangles and shapes are drawn from.
pub mod source {
    /// All of them alike.
    pub const UNIFORM: u32 = 0;
    /// The scene's alias tables: by power.
    pub const POWER: u32 = 1;
    /// Tiles of lights drawn ahead by power, see [`crate::presample`].
    pub const TILES: u32 = 2;
    /// Cells of space, with lights resampled for each, see [`crate::presample`].
    pub const CELLS: u32 = 3;
    /// The light tree alone, see [`crate::light_tree`].
    pub const TREE: u32 = 4;
    /// Cuts through trees of clusters, see [`crate::light_cuts`].
    pub const CUTS: u32 = 5;
}

/// Where light comes from: a point of a light, evaluated.
// naga takes the size of a structure with vectors for a multiple of 16, and rejects others that hold it twice if it is not.
#[derive(Clone, Copy)]
#[repr(align(16))]
pub struct LightPoint {
    /// World space; where `distant`, the direction toward it.
    pub position: Vec3,
    /// Front face of an emissive triangle or of a shape, or the axis of a spot, of length 1; zero where there is none.
    pub normal: Vec3,
    /// Emitted radiance, in W sr^-1 m^-2. Where `punctual`, radiant intensity on the axis, in W sr^-1; of a directional
    /// light, irradiance, in W m^-2.
    pub radiance: Vec3,
    /// Area in square scene units, or solid angle in sr, for the unit square of (u, v): the Jacobian that turns a
    /// density over (u, v) into one over area or solid angle. 1 for lights that are one point or one direction.
    pub jacobian: f32,
    /// Margin around `position` for rays that end there.
    pub error: f32,
    /// Whether both faces emit.
    pub two_sided: bool,
    /// Whether the light is infinitely far away.
    pub distant: bool,
    /// Whether no ray finds it: a shape, an unseen triangle or a directional light.
    pub analytic: bool,
    /// Whether it is a single point: then it has a falloff in place of a cosine.
    pub punctual: bool,
    /// Falloff of a punctual light: (cosine with the axis * `falloff_scale` + `falloff_offset`), clamped to 0..1, squared.
    pub falloff_scale: f32,
    /// See `falloff_scale`.
    pub falloff_offset: f32,
}

impl LightPoint {
    /// No light: nothing reaches anything.
    pub const NONE: Self = Self {
        position: Vec3::ZERO,
        normal: Vec3::ZERO,
        radiance: Vec3::ZERO,
        jacobian: 0.0,
        error: 0.0,
        two_sided: false,
        distant: false,
        analytic: false,
        punctual: false,
        falloff_scale: 0.0,
        falloff_offset: 0.0,
    };

    /// Share of its intensity that a punctual light sends where the cosine with its axis is `cosine`.
    ///
    /// Source: KHR_lights_punctual, the extension of glTF 2.0.
    #[inline(always)]
    pub fn falloff(&self, cosine: f32) -> f32 {
        let linear = clamp(cosine * self.falloff_scale + self.falloff_offset, 0.0, 1.0);
        linear * linear
    }
}

/// What of a light point reaches a surface, if nothing is in between.
#[derive(Clone, Copy)]
pub struct Arriving {
    /// From the surface toward the light, of length 1.
    pub direction: Vec3,
    /// On a surface that faces the light, for the unit square of (u, v), in W m^-2: times BSDF and cosine it is the
    /// integrand over (u, v).
    pub irradiance: Vec3,
    /// |d solid angle / d (u, v)|, in sr: turns a density over solid angle into one over (u, v). 0 for lights that no
    /// direction finds.
    pub solid_angle: f32,
}

/// A light id that stands for none.
pub const NO_LIGHT: u32 = 0xffff_ffff;

/// The emitter (an instance that emits) of an emissive triangle or shape.
#[inline(always)]
fn emitter_of(frame: &Frame, scene: &Scene, light: u32) -> u32 {
    // The guide has the emitter of the first light of every bucket, and at last that of the last light of all; most
    // buckets have one emitter or two. Binary search among them for the last whose first light is not beyond `light`.
    let bucket = frame.light_guide_at + (light >> frame.light_guide_shift);
    let mut low = scene.record(bucket);
    let mut high = scene.record(bucket + 1) + 1;
    while low + 1 < high {
        let middle = (low + high) / 2;
        if scene.emitter_word(frame, middle, emitter_record::FIRST_LIGHT) <= light {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// A light by its emitter, and its number among the emissive triangles of that emitter's mesh; 0 for a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// Number among the emitters.
    pub emitter: u32,
    /// Number among the emissive triangles of the mesh.
    pub local: u32,
}

/// The address of a light.
#[inline(always)]
pub fn address_of(frame: &Frame, scene: &Scene, light: u32) -> Address {
    let emitter = emitter_of(frame, scene, light);
    Address { emitter, local: light - scene.emitter_word(frame, emitter, emitter_record::FIRST_LIGHT) }
}

/// The light at an address.
#[inline(always)]
pub fn light_at(frame: &Frame, scene: &Scene, address: Address) -> u32 {
    scene.emitter_word(frame, address.emitter, emitter_record::FIRST_LIGHT) + address.local
}

/// Where the triangle of a light is; of a shape, which has none, its instance and the place of its material.
#[derive(Clone, Copy)]
pub struct Place {
    /// Its instance.
    pub instance: u32,
    /// Its number among all triangles.
    pub triangle: u32,
}

/// Where the triangle at an address is.
#[inline(always)]
pub fn place_of(frame: &Frame, scene: &Scene, address: Address) -> Place {
    let instance = scene.emitter_word(frame, address.emitter, emitter_record::INSTANCE);
    let list = scene.instance_word(frame, instance, instance_record::LIGHT_LIST_AT);
    let first = scene.instance_word(frame, instance, instance_record::FIRST_TRIANGLE);
    Place { instance, triangle: first + scene.record(list + address.local) }
}

/// Where the triangle of a light is.
#[inline(always)]
pub fn find(frame: &Frame, scene: &Scene, light: u32) -> Place {
    place_of(frame, scene, address_of(frame, scene, light))
}

/// Whether there is a light of that id. Every id that passes store is; what is not must do no harm beyond its pixel.
#[inline(always)]
pub fn exists(frame: &Frame, light: u32) -> bool {
    if (light & ENVIRONMENT_BIT) != 0 {
        (light & !ENVIRONMENT_BIT) < environment::count(frame)
    } else {
        light < frame.light_count
    }
}

/// The id in frame `to` of what has the id `light` in frame `from`; [`NO_LIGHT`] if it is not there. One of the frames
/// is the one before the other. The environment and directional lights are in both or in none.
#[inline(always)]
pub fn translate(from: &Frame, to: &Frame, scene: &Scene, light: u32) -> u32 {
    // Without a table of its own, a frame shares that of the frame before: nothing has moved.
    if from.instances_at == to.instances_at || (light & ENVIRONMENT_BIT) != 0 {
        return light;
    }
    if !exists(from, light) {
        return NO_LIGHT;
    }
    let address = address_of(from, scene, light);
    let instance = scene.emitter_word(from, address.emitter, emitter_record::INSTANCE);
    let counterpart = scene.instance_word(from, instance, instance_record::COUNTERPART);
    if counterpart == NO_INSTANCE {
        return NO_LIGHT;
    }
    scene.instance_word(to, counterpart, instance_record::FIRST_LIGHT) + address.local
}

/// The point `uv` (two 16-bit numbers) of light `light`. Evaluated from the quantised numbers, so that every reader
/// of a stored sample sees the same point. Without `IMAGES` only the place is right: emission has no texture and no
/// holes then. [`LightPoint::NONE`] for an id that does not exist.
#[inline(always)]
pub fn evaluate<const IMAGES: bool, const ENVIRONMENT: bool>(
    frame: &Frame,
    scene: &Scene,
    light: u32,
    uv: u32,
) -> LightPoint {
    if !exists(frame, light) {
        return LightPoint::NONE;
    }
    if ENVIRONMENT && (light & ENVIRONMENT_BIT) != 0 {
        return evaluate_environment(frame, scene, light, uv);
    }
    evaluate_at::<IMAGES, ENVIRONMENT>(frame, scene, find(frame, scene, light), uv)
}

/// [`evaluate`] for an emissive triangle or a shape whose place is known; `SHAPES`: whether there may be shapes.
#[inline(always)]
pub fn evaluate_at<const IMAGES: bool, const SHAPES: bool>(
    frame: &Frame,
    scene: &Scene,
    place: Place,
    uv: u32,
) -> LightPoint {
    let mut is_unseen = false;
    if SHAPES {
        let shape = scene.shape_of(frame, place.instance);
        is_unseen = shape == shape::UNSEEN;
        if !is_unseen && shape != shape::TRIANGLES {
            return evaluate_shape(frame, scene, place, uv);
        }
    }
    let mut point = evaluate_triangle::<IMAGES>(frame, scene, place, uv);
    point.analytic = is_unseen;
    point
}

/// [`evaluate`] for a shape: uniform over its area in (u, v), if it has one.
#[inline(always)]
pub fn evaluate_shape(frame: &Frame, scene: &Scene, place: Place, uv: u32) -> LightPoint {
    let Place { instance, triangle } = place;
    let (u, v) = (unorm16_center(uv), unorm16_center(uv >> 16));
    let shape = scene.shape_of(frame, instance);
    let matrix = scene.instance_at(frame, instance) + instance_record::WORLD_FROM_OBJECT;
    let center = scene.column(matrix, 3);
    let material = scene.material_of(frame, instance, triangle);
    let none = LightPoint {
        position: center,
        radiance: scene.emission(frame, instance, material),
        analytic: true,
        ..LightPoint::NONE
    };
    if shape == shape::SPHERE {
        let radius = f32::from_bits(scene.instance_word(frame, instance, instance_record::RADIUS));
        let z = 1.0 - 2.0 * u;
        let across = safe_sqrt(1.0 - z * z);
        let (sin, cos) = sin_cos((v - 0.5) * TAU);
        let normal = Vec3::new(across * cos, across * sin, z);
        LightPoint {
            position: center + normal * radius,
            normal,
            jacobian: 4.0 * PI * (radius * radius),
            error: position_error(max_abs(center) + radius),
            ..none
        }
    } else if shape == shape::RECTANGLE {
        let (x, y) = (scene.column(matrix, 0), scene.column(matrix, 1));
        let flags = scene.instance_word(frame, instance, instance_record::FLAGS);
        let facing = if (flags & attribute_flags::MIRRORED) != 0 { -1.0 } else { 1.0 };
        let cross = x.cross(y) * facing;
        let area = sqrt(cross.length_squared());
        let scale = if area > 0.0 { 1.0 / area } else { 0.0 };
        LightPoint {
            position: center + x * (2.0 * u - 1.0) + y * (2.0 * v - 1.0),
            normal: cross * scale,
            jacobian: 4.0 * area,
            error: position_error(max_abs(center) + max_abs(x) + max_abs(y)),
            two_sided: scene.material_word(material, material_record::TWO_SIDED) != 0,
            ..none
        }
    } else {
        let attributes = scene.instance_word(frame, instance, instance_record::ATTRIBUTES_AT);
        let axis = -scene.column(matrix, 2);
        let length = sqrt(axis.length_squared());
        LightPoint {
            normal: axis * (if length > 0.0 { 1.0 / length } else { 0.0 }),
            jacobian: 1.0,
            punctual: true,
            falloff_scale: f32::from_bits(scene.record(attributes + shape::FALLOFF_SCALE)),
            falloff_offset: f32::from_bits(scene.record(attributes + shape::FALLOFF_OFFSET)),
            ..none
        }
    }
}

/// [`evaluate`] for a texel of the environment, or a directional light.
#[inline(always)]
pub fn evaluate_environment(frame: &Frame, scene: &Scene, light: u32, uv: u32) -> LightPoint {
    let (u, v) = (unorm16_center(uv), unorm16_center(uv >> 16));
    let index = light & !ENVIRONMENT_BIT;
    let sample = environment::evaluate(frame, scene, index, u, v);
    LightPoint {
        position: sample.direction,
        radiance: sample.radiance,
        jacobian: sample.solid_angle,
        distant: true,
        analytic: index >= environment::texel_count(frame),
        ..LightPoint::NONE
    }
}

/// [`evaluate`] for an emissive triangle whose place is known.
#[inline(always)]
pub fn evaluate_triangle<const IMAGES: bool>(frame: &Frame, scene: &Scene, place: Place, uv: u32) -> LightPoint {
    let Place { instance, triangle } = place;
    let (u, v) = (unorm16_center(uv), unorm16_center(uv >> 16));
    let vertices = scene.world_triangle(frame, instance, triangle);
    let material = scene.material_of(frame, instance, triangle);
    let (b, c) = square_to_triangle(u, v);
    let mut radiance = scene.emission(frame, instance, material);
    if IMAGES {
        let map = scene.material_word(material, material_record::EMISSION_TEXTURE);
        if map != NO_TEXTURE {
            radiance *= texture::rgb_at(frame, scene, map, scene.uv_at(frame, instance, triangle, b, c));
        }
        // Rays go through the holes of a mask, so nothing there emits.
        if !texture::is_opaque(frame, scene, instance, triangle, b, c) {
            radiance = Vec3::ZERO;
        }
    }
    let cross = vertices.doubled_area_normal();
    let doubled_area = sqrt(cross.length_squared());
    let scale = if doubled_area > 0.0 { 1.0 / doubled_area } else { 0.0 };
    LightPoint {
        position: vertices.point(b, c),
        normal: cross * scale,
        radiance,
        jacobian: 0.5 * doubled_area,
        error: vertices.error(),
        two_sided: scene.material_word(material, material_record::TWO_SIDED) != 0,
        ..LightPoint::NONE
    }
}

/// What of `light` reaches `position`: zero behind a one-sided light, in its plane, and at distance zero. `ENVIRONMENT`:
/// whether there may be other lights than emissive triangles.
#[inline(always)]
pub fn arriving<const ENVIRONMENT: bool>(position: Vec3, light: &LightPoint) -> Arriving {
    if ENVIRONMENT && light.distant {
        let irradiance = light.radiance * light.jacobian;
        let solid_angle = if light.analytic { 0.0 } else { light.jacobian };
        return Arriving { direction: light.position, irradiance, solid_angle };
    }
    let toward = light.position - position;
    let distance2 = toward.length_squared();
    if !(distance2 > 0.0) {
        return Arriving { direction: Vec3::ZERO, irradiance: Vec3::ZERO, solid_angle: 0.0 };
    }
    let direction = toward * (1.0 / sqrt(distance2));
    let facing = -light.normal.dot(direction);
    let mut cosine = if light.two_sided && facing < 0.0 { -facing } else { facing };
    if ENVIRONMENT && light.punctual {
        cosine = light.falloff(facing);
    }
    if !(cosine > 0.0) {
        return Arriving { direction, irradiance: Vec3::ZERO, solid_angle: 0.0 };
    }
    let solid_angle = cosine * light.jacobian / distance2;
    let irradiance = light.radiance * solid_angle;
    Arriving { direction, irradiance, solid_angle: if ENVIRONMENT && light.analytic { 0.0 } else { solid_angle } }
}

/// Whether a surface may reflect anything of what reaches it from a light point: it is not black, and neither faces away
/// from the other. By the arithmetic of targets, which are zero where this is false.
#[inline(always)]
pub fn may_matter<const ENVIRONMENT: bool>(surface: &Surface, light: &LightPoint) -> bool {
    let arriving = arriving::<ENVIRONMENT>(surface.position(), light);
    let irradiance = arriving.irradiance.x + arriving.irradiance.y + arriving.irradiance.z;
    let is_before = surface.normal_shading().dot(arriving.direction) > 0.0
        && surface.normal_geometric().dot(arriving.direction) > 0.0;
    // What is not a number is no reason to leave the ray out.
    is_before && !(irradiance == 0.0) && !surface.is_black()
}

/// The ray between a surface and a light point, clear of both by their margins.
#[inline(always)]
pub fn shadow_ray<const ENVIRONMENT: bool>(surface: &Surface, light: &LightPoint) -> Ray {
    let position = surface.position();
    let normal = surface.normal_geometric();
    if ENVIRONMENT && light.distant {
        let origin = offset_origin(position, normal, surface.error, light.position);
        return Ray { origin, direction: light.position, t_max: FAR };
    }
    let toward = light.position - position;
    let origin = offset_origin(position, normal, surface.error, toward);
    let end = offset_origin(light.position, light.normal, light.error, -toward);
    Ray { origin, direction: end - origin, t_max: 1.0 }
}

/// An emissive triangle or shape that was drawn.
#[derive(Clone, Copy)]
pub struct Picked {
    /// Which.
    pub address: Address,
    /// Its probability.
    pub pmf: f32,
}

/// An emissive triangle or shape by the scene's tables, or uniformly where [`source`] says so, from four times 32 random bits.
#[inline(always)]
pub fn pick(frame: &Frame, scene: &Scene, lights: &[u32], bits: [u32; 4]) -> Picked {
    if frame.source == source::UNIFORM {
        let light = multiply_high(bits[0], frame.light_count);
        return Picked { address: address_of(frame, scene, light), pmf: 1.0 / frame.light_count as f32 };
    }
    // The table over emitters starts the buffer; each mesh has one over its emissive triangles.
    let emitter = alias::pick(lights, 0, frame.emitter_count, bits[0], bits[1]);
    let instance = scene.emitter_word(frame, emitter.index, emitter_record::INSTANCE);
    let table = scene.instance_word(frame, instance, instance_record::LIGHT_TABLE_AT);
    let count = scene.instance_word(frame, instance, instance_record::LIGHT_COUNT);
    let local = alias::pick(lights, table, count, bits[2], bits[3]);
    Picked { address: Address { emitter: emitter.index, local: local.index }, pmf: emitter.pmf * local.pmf }
}

/// Probability with which [`pick`] draws a light.
#[inline(always)]
pub fn pmf(frame: &Frame, scene: &Scene, lights: &[u32], address: Address) -> f32 {
    if frame.source == source::UNIFORM {
        return 1.0 / frame.light_count as f32;
    }
    let instance = scene.emitter_word(frame, address.emitter, emitter_record::INSTANCE);
    let table = scene.instance_word(frame, instance, instance_record::LIGHT_TABLE_AT);
    alias::pmf(lights, 0, address.emitter) * alias::pmf(lights, table, address.local)
}

/// The id of the light that a ray has hit; [`NO_LIGHT`] if what it hit does not emit.
#[inline(always)]
pub fn of_hit(frame: &Frame, scene: &Scene, hit: &Hit) -> u32 {
    let local = hit.triangle - scene.instance_word(frame, hit.instance, instance_record::FIRST_TRIANGLE);
    let list = scene.instance_word(frame, hit.instance, instance_record::LIGHT_LIST_AT);
    // Binary search: the list is in the order of the triangles.
    let mut low = 0;
    let mut high = scene.instance_word(frame, hit.instance, instance_record::LIGHT_COUNT);
    while low < high {
        let middle = (low + high) / 2;
        let there = scene.record(list + middle);
        if there == local {
            return scene.instance_word(frame, hit.instance, instance_record::FIRST_LIGHT) + middle;
        }
        if there < local {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    NO_LIGHT
}
