//! What a camera ray found, packed: the input of every pass after the first.

use bytemuck::{Pod, Zeroable};
use core::mem::{offset_of, size_of};
use glam::Vec3;

use crate::{
    frame::Frame,
    numerics::{abs, copysign, max, min, pack_unorm16, sqrt, unpack_unorm16},
    octahedral,
    ray::Hit,
    scene::{NO_TEXTURE, Scene, material_record},
    texture,
};

/// The surface seen by a pixel: 48 bytes. All zero: sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Surface {
    /// World space, in scene units.
    pub position: [f32; 3],
    /// Margin for rays that start here, see [`crate::ray::position_error`].
    pub error: f32,
    /// Toward the camera's side; octahedral.
    pub normal_geometric: u32,
    /// Interpolated, on the camera's side; octahedral.
    pub normal_shading: u32,
    /// Reflectance at normal incidence: red and green, 16-bit unorm.
    pub specular_rg: u32,
    /// Reflectance at normal incidence, blue; perceptual roughness in the upper half.
    pub specular_b_roughness: u32,
    /// Albedo of the diffuse lobe, linear Rec. 709.
    pub diffuse: [f32; 3],
    /// Bit 31: there is a surface. Bit 30: what it reflects is known, see [`crate::closed_form`]. Below: the instance.
    pub instance: u32,
}

const _: () = assert!(size_of::<Surface>() == 48 && offset_of!(Surface, diffuse) == 32);

const PRESENT: u32 = 0x8000_0000;
const SETTLED: u32 = 0x4000_0000;

impl Surface {
    /// Whether the pixel sees no surface.
    #[inline(always)]
    pub fn is_sky(&self) -> bool {
        self.instance & PRESENT == 0
    }

    /// Whether no light is to be sampled for the pixel: it sees the sky, or what the surface reflects is known.
    #[inline(always)]
    pub fn is_settled(&self) -> bool {
        self.instance & (PRESENT | SETTLED) != PRESENT
    }

    /// The same surface, of which it is known what it reflects.
    #[inline(always)]
    pub fn settled(self) -> Self {
        Self { instance: self.instance | SETTLED, ..self }
    }

    /// Whether the surface reflects nothing, from wherever it is lit.
    #[inline(always)]
    pub fn is_black(&self) -> bool {
        let diffuse = self.diffuse[0] + self.diffuse[1] + self.diffuse[2];
        diffuse == 0.0 && self.specular_rg == 0 && self.specular_b_roughness & 0xffff == 0
    }

    /// The instance that the surface is part of.
    #[inline(always)]
    pub fn instance(&self) -> u32 {
        self.instance & !(PRESENT | SETTLED)
    }

    /// World space, in scene units.
    #[inline(always)]
    pub fn position(&self) -> Vec3 {
        Vec3::new(self.position[0], self.position[1], self.position[2])
    }

    /// Of length 1, on the camera's side.
    #[inline(always)]
    pub fn normal_geometric(&self) -> Vec3 {
        octahedral::unpack(self.normal_geometric)
    }

    /// Of length 1, on the camera's side.
    #[inline(always)]
    pub fn normal_shading(&self) -> Vec3 {
        octahedral::unpack(self.normal_shading)
    }

    /// Albedo of the diffuse lobe.
    #[inline(always)]
    pub fn diffuse(&self) -> Vec3 {
        Vec3::new(self.diffuse[0], self.diffuse[1], self.diffuse[2])
    }

    /// Reflectance at normal incidence.
    #[inline(always)]
    pub fn specular(&self) -> Vec3 {
        Vec3::new(
            unpack_unorm16(self.specular_rg),
            unpack_unorm16(self.specular_rg >> 16),
            unpack_unorm16(self.specular_b_roughness),
        )
    }

    /// Perceptual roughness, in 0..=1.
    #[inline(always)]
    pub fn roughness(&self) -> f32 {
        unpack_unorm16(self.specular_b_roughness >> 16)
    }
}

/// What the camera rays of a pixel have found, in a word beside its emitted radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Share of the pixel with light to sample, in 0..=1.
    pub sampled: f32,
    /// Whether a ray has found what emits, or the sky.
    pub is_bright: bool,
}

impl Shown {
    /// As one number: the sign bit tells what is bright.
    #[inline(always)]
    pub fn pack(&self) -> f32 {
        copysign(self.sampled, if self.is_bright { -1.0 } else { 1.0 })
    }

    /// Inverse of [`Self::pack`].
    #[inline(always)]
    pub fn unpack(packed: f32) -> Self {
        Self { sampled: abs(packed), is_bright: (packed.to_bits() >> 31) != 0 }
    }
}

/// A surface, and what it emits toward the ray that found it.
#[derive(Clone, Copy)]
pub struct Found {
    /// Packed, as the passes store it.
    pub surface: Surface,
    /// Emitted radiance toward the ray's origin.
    pub emitted: Vec3,
    /// The shading normal before it was packed.
    pub normal: Vec3,
    /// Whether the ray has found the front face.
    pub is_front: bool,
}

/// The surface at a hit of a ray with the given direction. `hit` must not be a miss.
///
/// Differs from common practice: where the interpolated normal faces away from the ray, the geometric one is used.
#[inline(always)]
pub fn surface_at<const TEXTURES: bool>(frame: &Frame, scene: &Scene, hit: &Hit, direction: Vec3) -> Found {
    let triangle = scene.world_triangle(frame, hit.instance, hit.triangle);
    let material = scene.material_of(frame, hit.instance, hit.triangle);
    let mut base_color = scene.material_rgb(material, material_record::BASE_COLOR);
    let mut emission = scene.emission(frame, hit.instance, material);
    if TEXTURES {
        let color_map = scene.material_word(material, material_record::BASE_COLOR_TEXTURE);
        let emission_map = scene.material_word(material, material_record::EMISSION_TEXTURE);
        if color_map != NO_TEXTURE || emission_map != NO_TEXTURE {
            let uv = scene.uv_at(frame, hit.instance, hit.triangle, hit.u, hit.v);
            if color_map != NO_TEXTURE {
                base_color *= texture::rgb_at(frame, scene, color_map, uv);
            }
            if emission_map != NO_TEXTURE {
                emission *= texture::rgb_at(frame, scene, emission_map, uv);
            }
        }
    }

    let cross = triangle.doubled_area_normal();
    let front = cross * (1.0 / max(sqrt(cross.length_squared()), 1e-30));
    let faces_camera = front.dot(direction) < 0.0;
    let two_sided = scene.material_word(material, material_record::TWO_SIDED) != 0;
    let normal_geometric = if faces_camera { front } else { -front };
    let interpolated = scene.shading_normal_at(frame, hit.instance, hit.triangle, hit.u, hit.v, front);
    let toward_camera = if interpolated.dot(normal_geometric) < 0.0 { -interpolated } else { interpolated };
    let normal_shading = if toward_camera.dot(direction) < -1e-3 { toward_camera } else { normal_geometric };

    let metallic = scene.material_float(material, material_record::METALLIC);
    let dielectric = scene.material_rgb(material, material_record::SPECULAR);
    let specular = dielectric * (1.0 - metallic) + base_color * metallic;
    let diffuse = base_color * (1.0 - metallic);
    let roughness = scene.material_float(material, material_record::ROUGHNESS);
    let position = triangle.point(hit.u, hit.v);
    Found {
        surface: Surface {
            position: [position.x, position.y, position.z],
            error: triangle.error(),
            normal_geometric: octahedral::pack(normal_geometric),
            normal_shading: octahedral::pack(normal_shading),
            specular_rg: pack_unorm16(specular.x) | (pack_unorm16(specular.y) << 16),
            specular_b_roughness: pack_unorm16(specular.z) | (pack_unorm16(min(roughness, 1.0)) << 16),
            diffuse: [diffuse.x, diffuse.y, diffuse.z],
            instance: hit.instance | PRESENT,
        },
        emitted: if faces_camera || two_sided { emission } else { Vec3::ZERO },
        normal: normal_shading,
        is_front: faces_camera,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_pixel_shows_survives_packing() {
        for sampled in [0.0, 0.25, 1.0 / 3.0, 1.0] {
            for is_bright in [false, true] {
                let shown = Shown { sampled, is_bright };
                assert_eq!(Shown::unpack(shown.pack()), shown);
            }
        }
    }
}
