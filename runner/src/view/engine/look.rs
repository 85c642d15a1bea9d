//! What a chain's buffers hold: brightness, colours of a view, one pixel.

use glam::{UVec2, Vec3};
use weir_shared::{frame::FramePair, moments::Moments, reservoir::Reservoir, surface::Surface};

use super::{
    Inspected,
    chain::{Chain, held},
};
use crate::{
    executor::{AlignedBytes, gpu::GpuError},
    packed::PackedScene,
    reference::Estimate,
    render::Request,
    view::{
        buffers::{self, View},
        exposure, pick,
    },
};

/// Looks at some rows of the picture.
pub(super) fn log_mean(chain: &mut Chain, request: &Request) -> Result<Option<f32>, GpuError> {
    let row_bytes = u64::from(request.width) * size_of::<Moments>() as u64;
    let rows = exposure::rows(request.height);
    let parts: Vec<_> = rows.iter().map(|&y| u64::from(y) * row_bytes..u64::from(y + 1) * row_bytes).collect();
    let bytes = chain.executor.read_parts(&chain.plan, "moments", &parts)?;
    Ok(exposure::log_mean(bytes.elements()))
}

pub(super) fn colors(
    chain: &mut Chain,
    view: View,
    packed: &PackedScene,
    frames: &FramePair,
    estimates: &[Estimate],
) -> Result<Vec<u32>, GpuError> {
    let mut read = |wanted: bool, name: Option<&str>| match name.filter(|_| wanted) {
        Some(name) => chain.executor.read(&chain.plan, name),
        None => Ok(AlignedBytes::default()),
    };
    let reservoirs = held(&chain.plan);
    let surfaces = read(view.needs_surfaces(), Some("surfaces"))?;
    let reservoirs = read(view.needs_reservoirs(), reservoirs)?;
    let moments = read(view.needs_moments(), Some("moments"))?;
    let reference: Vec<Vec3> = match view {
        View::Error => estimates.iter().map(|e| e.mean.as_vec3()).collect(),
        _ => Vec::new(),
    };
    Ok(buffers::false_color(
        view,
        &buffers::Buffers {
            frames,
            scene: pick::view_of(packed),
            surfaces: surfaces.elements(),
            reservoirs: reservoirs.elements(),
            moments: moments.elements(),
            reference: &reference,
        },
    ))
}

pub(super) fn inspect(
    chain: &mut Chain,
    packed: &PackedScene,
    frames: &FramePair,
    px: UVec2,
) -> Result<Inspected, GpuError> {
    let frame = &frames.now;
    let px = px.min(UVec2::new(frame.width - 1, frame.height - 1));
    let mut element = |name: &str, index: u32, bytes: u64| {
        let at = u64::from(index) * bytes;
        chain.executor.read_parts(&chain.plan, name, std::slice::from_ref(&(at..at + bytes)))
    };
    let surface: Surface = element("surfaces", frame.index_of(px), size_of::<Surface>() as u64)?.elements()[0];
    let moments: Moments = element("moments", frame.index_of(px), size_of::<Moments>() as u64)?.elements()[0];
    let reservoir = match held(&chain.plan) {
        Some(name) => {
            let at = frame.index_of_reservoir(px, 0);
            let bytes = u64::from(at) * size_of::<Reservoir>() as u64;
            let end = bytes + size_of::<Reservoir>() as u64;
            chain.executor.read_parts(&chain.plan, name, std::slice::from_ref(&(bytes..end)))?.elements()[0]
        }
        None => Reservoir::EMPTY,
    };
    let scene = pick::view_of(packed);
    // A person knows the scene's world space, not that of the passes.
    let position = (surface.position() + packed.origin).to_array();
    Ok(Inspected {
        px,
        surface: if surface.is_sky() { surface } else { Surface { position, ..surface } },
        reservoir,
        moments,
        motion: (!surface.is_sky()).then(|| buffers::motion(frames, &scene, &surface)).flatten(),
        light: pick::light_in_words(packed, frame, &reservoir),
        frame: frame.index,
    })
}
