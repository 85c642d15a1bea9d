//! Shading: emitted light, and the light of the samples that were kept.

use glam::{UVec2, Vec3, Vec4};
use weir_shared::{
    fault,
    frame::Frame,
    light,
    numerics::{is_finite, load},
    reservoir::Reservoir,
    scene::Scene,
    surface::{Shown, Surface},
    target::Domain,
};

/// Radiance toward the camera, linear Rec. 709, in W sr^-1 m^-2, by the mean over the pixel's reservoirs; w is the first
/// [`fault`] on the way to it.
pub fn shade<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    emitted: &[Vec4],
    visible: &[Reservoir],
) -> Vec4 {
    let emitted = load(emitted, frame.index_of(px));
    let (mut reflected, mut first) = (Vec3::ZERO, fault::NONE);
    let reservoirs = sampled(frame, emitted);
    let mut i = 0;
    while i < reservoirs {
        let held = load(visible, frame.index_of_reservoir(px, i));
        if held.has_sample() {
            let domain = Domain::new(frame.camera_origin, &load(surfaces, frame.index_of(px)));
            let point = light::evaluate::<EMISSION_IMAGES, ENVIRONMENT>(frame, scene, held.light, held.uv);
            reflected += domain.reflected::<ENVIRONMENT, SPECULAR>(&point) * held.ucw;
        }
        first = if first == fault::NONE { held.fault() } else { first };
        i += 1;
    }
    shaded(frame, emitted, reflected, first)
}

/// The same from the sums over all inputs of the last merge, whose visibility is known.
pub fn shade_sum(px: UVec2, frame: &Frame, emitted: &[Vec4], gathered: &[Vec4]) -> Vec4 {
    let emitted = load(emitted, frame.index_of(px));
    let (mut reflected, mut first) = (Vec3::ZERO, fault::NONE);
    let reservoirs = sampled(frame, emitted);
    let mut i = 0;
    while i < reservoirs {
        let sum = load(gathered, frame.index_of_reservoir(px, i));
        reflected += sum.truncate();
        first = if first == fault::NONE { sum.w as u32 } else { first };
        i += 1;
    }
    shaded(frame, emitted, reflected, first)
}

/// Reservoirs of a pixel that hold something: none of one that has no light to sample, for which nothing may have been
/// written.
#[inline(always)]
fn sampled(frame: &Frame, emitted: Vec4) -> u32 {
    if Shown::unpack(emitted.w).sampled > 0.0 { frame.reservoirs } else { 0 }
}

/// What is emitted, and the mean of what the reservoirs reflect, as far as surfaces that do so cover the pixel, unless that
/// overflows.
#[inline(always)]
fn shaded(frame: &Frame, emitted: Vec4, reflected: Vec3, first: u32) -> Vec4 {
    let color = emitted.truncate() + reflected * (Shown::unpack(emitted.w).sampled / frame.reservoirs as f32);
    // Numbers that are not negative: their sum is finite only if each is.
    if is_finite(color.x + color.y + color.z) {
        color.extend(first as f32)
    } else {
        let here = fault::at(fault::stage::SHADE, fault::OVERFLOW);
        emitted.truncate().extend(if first == fault::NONE { here } else { first } as f32)
    }
}
