//! What else a file says of each pixel, and of the camera.

use glam::{Mat4, UVec2, Vec3, Vec4};
use weir_shared::{
    frame::{Frame, FramePair},
    light::ENVIRONMENT_BIT,
    reservoir::Reservoir,
    surface::Surface,
};

use super::{RenderError, Rendered, Request, facts_of, frame_of};
use crate::{
    executor::cpu::CpuExecutor,
    output::Layers,
    packed::PackedScene,
    scene::Camera,
    settings::Settings,
    skips::Rule,
    technique::{Technique, direct_light},
};

/// Depth, normals, positions, albedo and light of each pixel's center, from one frame on the host.
///
/// # Errors
/// If the size is refused.
pub fn layers(packed: &PackedScene, request: &Request, rendered: &Rendered) -> Result<Layers, RenderError> {
    // Every surface holds a sample, even where light is known without.
    let skips = request.settings.skips.with(Rule::ClosedForm, false);
    let settings = Settings { skips, ..request.settings.clone() };
    let facts = facts_of(packed, request.width, request.height, &settings);
    let outputs: &[&str] = if !packed.content.shines() { &["surfaces"] } else { &["surfaces", "fresh"] };
    let plan = direct_light(Technique::Candidates, &settings, &facts, request.curve, outputs)?;
    let mut executor = CpuExecutor::new(&plan);
    let frame = Frame { camera_rays: 0, ..frame_of(packed, request) };
    executor.run(&plan, packed.buffers(), &FramePair { now: frame, prev: frame });
    let surfaces: &[Surface] = bytemuck::cast_slice(executor.output(&plan, "surfaces").unwrap_or_default());
    let reservoirs: &[Reservoir] = bytemuck::cast_slice(executor.output(&plan, "fresh").unwrap_or_default());
    let vectors = |f: &dyn Fn(&Surface) -> Vec3| -> Option<Vec<[f32; 3]>> {
        Some(surfaces.iter().map(|s| if s.is_sky() { [0.0; 3] } else { f(s).to_array() }).collect())
    };
    let relative = rendered.variance.iter().zip(&rendered.picture.rgb);
    Ok(Layers {
        depth: Some(
            surfaces
                .iter()
                .map(|s| {
                    let distance = (s.position() - frame.camera_origin).dot(frame.camera_forward);
                    if s.is_sky() { f32::INFINITY } else { distance }
                })
                .collect(),
        ),
        normal_geometric: vectors(&|s| s.normal_geometric()),
        normal_shading: vectors(&|s| s.normal_shading()),
        position: vectors(&|s| s.position() + packed.origin),
        albedo: vectors(&|s| s.diffuse() + s.specular()),
        relative_variance: Some(
            relative
                .map(|(v, m)| core::array::from_fn(|i| if m[i] > 0.0 { v[i] / (m[i] * m[i]) } else { 0.0 }))
                .collect(),
        ),
        variance: Some(rendered.variance.clone()),
        samples: Some(vec![rendered.samples; surfaces.len()]),
        light_id: (!reservoirs.is_empty()).then(|| {
            let id = |r: &Reservoir| if r.has_sample() { r.light } else { u32::MAX };
            let of_pixel = |i: usize| {
                let (x, y) = (i as u32 % frame.width, i as u32 / frame.width);
                &reservoirs[frame.index_of_reservoir(UVec2::new(x, y), 0) as usize]
            };
            let ids = (0..surfaces.len()).map(|i| id(of_pixel(i)));
            ids.map(|id| if id & ENVIRONMENT_BIT != 0 { u32::MAX } else { id }).collect()
        }),
    })
}

/// Camera matrices for file headers: camera from world, and normalised device coordinates from world.
pub fn camera_matrices(camera: &Camera, width: u32, height: u32) -> (Mat4, Mat4) {
    let forward = (camera.target - camera.origin).normalize();
    let right = forward.cross(camera.up).normalize();
    let world_from_camera = Mat4::from_cols(
        right.extend(0.0),
        right.cross(forward).extend(0.0),
        (-forward).extend(0.0),
        camera.origin.extend(1.0),
    );
    let camera_from_world = world_from_camera.inverse();
    // The far plane at infinity.
    let scale = 1.0 / (camera.vfov_deg.to_radians() * 0.5).tan();
    let near = 1e-3;
    let ndc_from_camera = Mat4::from_cols(
        Vec4::new(scale * height as f32 / width as f32, 0.0, 0.0, 0.0),
        Vec4::new(0.0, scale, 0.0, 0.0),
        Vec4::new(0.0, 0.0, -1.0, -1.0),
        Vec4::new(0.0, 0.0, -near, 0.0),
    );
    (camera_from_world, ndc_from_camera * camera_from_world)
}
