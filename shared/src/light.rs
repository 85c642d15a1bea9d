//! Lights: emissive triangles and the environment, addressed by an id and a point of the unit square.

use glam::Vec3;

use crate::{
    alias, environment,
    frame::Frame,
    numerics::{multiply_high, sqrt, unorm16_center},
    ray::{FAR, Ray, offset_origin},
    scene::{NO_TEXTURE, Scene, emitter_record, instance_record, material_record},
    surface::Surface,
    texture,
    triangle::square_to_triangle,
};

/// Marks a light id as a texel of the environment.
pub const ENVIRONMENT_BIT: u32 = 0x8000_0000;

/// Where light comes from: a point of a light, evaluated.
#[derive(Clone, Copy)]
pub struct LightPoint {
    /// World space; for the environment, the direction toward it.
    pub position: Vec3,
    /// Front face of an emissive triangle, of length 1; zero for the environment.
    pub normal: Vec3,
    /// Emitted radiance, in W sr^-1 m^-2.
    pub radiance: Vec3,
    /// Area in square scene units, or solid angle in sr, for the unit square of (u, v): the Jacobian that turns a
    /// density over (u, v) into one over area or solid angle.
    pub jacobian: f32,
    /// Margin around `position` for rays that end there.
    pub error: f32,
    /// Whether both faces emit.
    pub two_sided: bool,
    /// Whether the light is infinitely far away.
    pub distant: bool,
}

/// What of a light point reaches a surface, if nothing is in between.
#[derive(Clone, Copy)]
pub struct Arriving {
    /// From the surface toward the light, of length 1.
    pub direction: Vec3,
    /// Radiance times |d solid angle / d (u, v)|, in W m^-2: times BSDF and cosine it is the integrand over (u, v).
    pub irradiance: Vec3,
}

/// Instance and triangle of a light.
#[inline(always)]
pub fn triangle_of(frame: &Frame, scene: &Scene, light: u32) -> (u32, u32) {
    // Binary search for the last emitter whose first light is not beyond `light`.
    let mut low = 0;
    let mut high = frame.emitter_count;
    while low + 1 < high {
        let middle = (low + high) / 2;
        if scene.emitter_word(frame, middle, emitter_record::FIRST_LIGHT) <= light {
            low = middle;
        } else {
            high = middle;
        }
    }
    let instance = scene.emitter_word(frame, low, emitter_record::INSTANCE);
    let local = light - scene.emitter_word(frame, low, emitter_record::FIRST_LIGHT);
    let list = scene.instance_word(frame, instance, instance_record::LIGHT_LIST_AT);
    let first = scene.instance_word(frame, instance, instance_record::FIRST_TRIANGLE);
    (instance, first + scene.record(list + local))
}

/// The point `uv` (two 16-bit numbers) of light `light`. Evaluated from the quantised numbers, so that every reader
/// of a stored sample sees the same point.
#[inline(always)]
pub fn evaluate<const TEXTURES: bool, const ENVIRONMENT: bool>(
    frame: &Frame,
    scene: &Scene,
    light: u32,
    uv: u32,
) -> LightPoint {
    let (u, v) = (unorm16_center(uv), unorm16_center(uv >> 16));
    if ENVIRONMENT && (light & ENVIRONMENT_BIT) != 0 {
        let sample = environment::evaluate(frame, scene, light & !ENVIRONMENT_BIT, u, v);
        return LightPoint {
            position: sample.direction,
            normal: Vec3::ZERO,
            radiance: sample.radiance,
            jacobian: sample.solid_angle,
            error: 0.0,
            two_sided: false,
            distant: true,
        };
    }
    let (instance, triangle) = triangle_of(frame, scene, light);
    let vertices = scene.world_triangle(frame, instance, triangle);
    let material = scene.material_of(frame, instance, triangle);
    let (b, c) = square_to_triangle(u, v);
    let mut radiance = scene.material_rgb(material, material_record::EMISSION);
    if TEXTURES {
        let map = scene.material_word(material, material_record::EMISSION_TEXTURE);
        if map != NO_TEXTURE {
            radiance *= texture::rgb_at(frame, scene, map, scene.uv_at(frame, instance, triangle, b, c));
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
        distant: false,
    }
}

/// What of `light` reaches `position`: zero behind a one-sided light, in its plane, and at distance zero.
#[inline(always)]
pub fn arriving<const ENVIRONMENT: bool>(position: Vec3, light: &LightPoint) -> Arriving {
    if ENVIRONMENT && light.distant {
        return Arriving { direction: light.position, irradiance: light.radiance * light.jacobian };
    }
    let toward = light.position - position;
    let distance2 = toward.length_squared();
    if !(distance2 > 0.0) {
        return Arriving { direction: Vec3::ZERO, irradiance: Vec3::ZERO };
    }
    let direction = toward * (1.0 / sqrt(distance2));
    let facing = -light.normal.dot(direction);
    let cosine = if light.two_sided && facing < 0.0 { -facing } else { facing };
    if !(cosine > 0.0) {
        return Arriving { direction, irradiance: Vec3::ZERO };
    }
    Arriving { direction, irradiance: light.radiance * (cosine * light.jacobian / distance2) }
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

/// A light by the scene's table, or uniformly, with its probability, from four times 32 random bits.
#[inline(always)]
pub fn pick(frame: &Frame, scene: &Scene, lights: &[u32], bits: [u32; 4]) -> alias::Pick {
    if frame.pick_by_power == 0 {
        return alias::Pick { index: multiply_high(bits[0], frame.light_count), pmf: 1.0 / frame.light_count as f32 };
    }
    // The table over emitters starts the buffer; each mesh has one over its emissive triangles.
    let emitter = alias::pick(lights, 0, frame.emitter_count, bits[0], bits[1]);
    let instance = scene.emitter_word(frame, emitter.index, emitter_record::INSTANCE);
    let table = scene.instance_word(frame, instance, instance_record::LIGHT_TABLE_AT);
    let count = scene.instance_word(frame, instance, instance_record::LIGHT_COUNT);
    let local = alias::pick(lights, table, count, bits[2], bits[3]);
    let first = scene.emitter_word(frame, emitter.index, emitter_record::FIRST_LIGHT);
    alias::Pick { index: first + local.index, pmf: emitter.pmf * local.pmf }
}
