//! Still pictures: independent frames, accumulated, on whichever executor there is.

use std::time::{Duration, Instant};

use glam::{Mat4, UVec2, Vec3, Vec4};
use thiserror::Error;
use weir_shared::{
    frame::{Frame, FramePair},
    light::ENVIRONMENT_BIT,
    moments::Moments,
    reservoir::Reservoir,
    surface::Surface,
};

use crate::{
    executor::{
        AlignedBytes, SceneBuffers,
        cpu::{CpuExecutor, Order},
        gpu::{Gpu, GpuError, GpuExecutor, Loader, Module},
    },
    exit::{Exit, HasExit},
    faults::Faults,
    graph::{Facts, GraphError, Plan},
    output::{Layers, Picture},
    packed::{Changed, PackError, PackedScene},
    reference::{Estimate, Reference},
    scene::Camera,
    sequence::Sequence,
    settings::Settings,
    technique::{Technique, ToneCurve, direct_light},
};

/// When a picture is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// After so many samples of each pixel.
    Samples(u32),
    /// After so much time, in whole frames.
    Time(Duration),
}

/// What to render.
#[derive(Clone, Debug)]
pub struct Request {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// View.
    pub camera: Camera,
    /// Seed of all random numbers.
    pub seed: u32,
    /// End.
    pub stop: Stop,
    /// Tone curve of the 8-bit picture.
    pub curve: ToneCurve,
    /// Multiplies radiance before the tone curve.
    pub exposure: f32,
    /// Which passes.
    pub technique: Technique,
    /// Knobs.
    pub settings: Settings,
}

/// Who computes.
pub enum Backend<'a> {
    /// The host's threads, in the given order.
    Cpu(Order),
    /// A GPU.
    Gpu(&'a Gpu),
}

/// A picture, and what it took.
pub struct Rendered {
    /// Linear mean radiance.
    pub picture: Picture,
    /// Variance of the mean of each channel.
    pub variance: Vec<[f32; 3]>,
    /// Tone-mapped, 8-bit sRGB, red in the low byte.
    pub display: Vec<u32>,
    /// Samples of each pixel.
    pub samples: u32,
    /// Time from the first frame to the last.
    pub elapsed: Duration,
    /// Time of each pass in the last frame, where it is known.
    pub pass_times: Vec<(&'static str, Duration)>,
    /// What passes dropped. The reference integrator drops nothing but whole samples that are not finite, which count as
    /// black.
    pub faults: Faults,
}

/// Why there is no picture.
#[derive(Debug, Error)]
pub enum RenderError {
    /// The frame has no plan.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The scene has no such moment.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

impl HasExit for RenderError {
    fn exit(&self) -> Exit {
        match self {
            Self::Graph(error) => error.exit(),
            Self::Pack(error) => error.exit(),
            Self::Gpu(error) => error.exit(),
        }
    }
}

/// The uniform of frame 0 of a request: scene, view and knobs.
pub fn frame_of(packed: &PackedScene, request: &Request) -> Frame {
    let (camera, settings) = (&request.camera, &request.settings);
    let neighbors = match request.technique {
        Technique::RealTime => [settings.spatial_neighbors, settings.spatial_neighbors_unseen],
        Technique::Still | Technique::Candidates => [settings.still_neighbors; 2],
    };
    let forward = (camera.target - camera.origin).normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let half_height = (camera.vfov_deg.to_radians() * 0.5).tan();
    let half_width = half_height * request.width as f32 / request.height as f32;
    Frame {
        width: request.width,
        height: request.height,
        index: 0,
        seed: request.seed,
        camera_origin: camera.origin,
        accumulated: 0,
        camera_right: right * half_width,
        jitter: u32::from(settings.jitter),
        camera_up: up * half_height,
        exposure: request.exposure,
        camera_forward: forward,
        candidates: settings.candidates,
        pick_by_power: u32::from(settings.pick_by_power),
        reservoirs: settings.reservoirs,
        round: 0,
        choice: settings.choice,
        candidates_tree: settings.candidates_tree,
        candidates_bsdf: request.technique.bsdf_rays(settings),
        candidates_full: settings.candidates_full,
        mis_form: settings.mis_form,
        has_history: 0,
        temporal_neighbors: settings.temporal_neighbors,
        temporal_neighbors_unseen: settings.temporal_neighbors_unseen,
        spatial_neighbors: neighbors[0],
        spatial_neighbors_unseen: neighbors[1],
        confidence_cap: settings.confidence_cap,
        neighbor_rule: settings.neighbor_rule,
        radius_px: settings.radius_px,
        normal_cosine: settings.normal_angle_deg.to_radians().cos(),
        plane_tolerance: settings.plane_tolerance,
        roughness_tolerance: settings.roughness_tolerance,
        probe: settings.rays.probe(),
        lattice: settings.lattice,
        occlusion_reach: settings.occlusion_reach_px,
        occlusion: settings.occlusion,
        candidates_off_lattice: settings.candidates_off_lattice,
        ..packed.frame
    }
}

/// What the plan of a request depends on.
pub fn facts_of(packed: &PackedScene, width: u32, height: u32, settings: &Settings) -> Facts {
    Facts { width, height, reservoirs: settings.reservoirs, has: packed.has(), features: packed.features.clone() }
}

/// An executor of either kind.
pub(crate) enum Executor {
    Cpu(Box<CpuExecutor>),
    Gpu(Box<GpuExecutor>),
}

impl Executor {
    pub(crate) fn new(backend: &Backend<'_>, plan: &Plan, scene: SceneBuffers<'_>) -> Result<Self, GpuError> {
        Ok(match backend {
            Backend::Cpu(order) => {
                let mut executor = CpuExecutor::new(plan);
                executor.order = *order;
                Self::Cpu(Box::new(executor))
            }
            Backend::Gpu(gpu) => Self::Gpu(Box::new(GpuExecutor::new(gpu, plan, scene, Loader::Auto, Module::Plain)?)),
        })
    }

    /// Runs a frame; on a GPU it may still be under way afterwards.
    pub(crate) fn run(
        &mut self,
        plan: &Plan,
        scene: SceneBuffers<'_>,
        frames: &FramePair,
    ) -> Result<Vec<(&'static str, Duration)>, GpuError> {
        match self {
            Self::Cpu(executor) => {
                let [frame, plan_size] = [[frames.now.width, frames.now.height], [plan.facts.width, plan.facts.height]];
                if frame != plan_size {
                    return Err(GpuError::FrameSize { frame, plan: plan_size });
                }
                Ok(executor.run(plan, scene, frames))
            }
            Self::Gpu(executor) => {
                executor.run(frames)?;
                Ok(executor.last_times().to_vec())
            }
        }
    }

    /// Tells the executor what of the scene has changed.
    pub(crate) fn update(&mut self, scene: SceneBuffers<'_>, changed: Vec<Changed>) -> Result<(), GpuError> {
        if let Self::Gpu(executor) = self {
            for Changed { buffer, range } in changed {
                executor.update_scene(buffer, range.start as u64, &scene.bytes(buffer)[range])?;
            }
        }
        Ok(())
    }

    /// Writes over a part of an output of the last frame.
    pub(crate) fn overwrite(&mut self, plan: &Plan, name: &str, offset: usize, bytes: &[u8]) -> Result<(), GpuError> {
        match self {
            Self::Cpu(executor) => {
                let output = executor.output_mut(plan, name).expect("the plan has this output");
                output[offset..][..bytes.len()].copy_from_slice(bytes);
                Ok(())
            }
            Self::Gpu(executor) => executor.overwrite(name, offset as u64, bytes),
        }
    }

    pub(crate) fn read(&mut self, plan: &Plan, name: &str) -> Result<AlignedBytes, GpuError> {
        match self {
            Self::Cpu(executor) => {
                Ok(AlignedBytes::from_bytes(executor.output(plan, name).expect("the plan has this output")))
            }
            Self::Gpu(executor) => executor.read(name),
        }
    }

    fn finish(&mut self) -> Result<(), GpuError> {
        match self {
            Self::Cpu(_) => Ok(()),
            Self::Gpu(executor) => executor.finish(),
        }
    }
}

/// Whether a picture is done after `frames` of it, of which the last may be under way.
fn is_done(stop: Stop, frames: u32, start: Instant) -> bool {
    match stop {
        Stop::Samples(n) => frames >= n,
        Stop::Time(limit) => {
            // Stops where another frame of average length would end beyond the limit by more than it falls short.
            let elapsed = start.elapsed();
            elapsed + elapsed / frames / 2 >= limit
        }
    }
}

/// Renders a still by the passes: independent frames, averaged. `progress` is told the samples so far after each frame;
/// it ends the picture early by returning false.
///
/// # Errors
/// If the size is refused or the GPU fails.
pub fn render(
    packed: &PackedScene,
    request: &Request,
    backend: &Backend<'_>,
    mut progress: impl FnMut(u32) -> bool,
) -> Result<Rendered, RenderError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let plan = direct_light(request.technique, &request.settings, &facts, request.curve, &["moments", "display"])?;
    let scene = packed.buffers();
    let mut executor = Executor::new(backend, &plan, scene)?;
    let mut frame = frame_of(packed, request);
    let start = Instant::now();
    let mut pass_times;
    loop {
        pass_times = executor.run(&plan, scene, &FramePair { now: frame, prev: frame })?;
        frame.index = frame.index.wrapping_add(1);
        frame.accumulated += 1;
        if matches!(request.stop, Stop::Time(_)) {
            executor.finish()?;
        }
        let done = is_done(request.stop, frame.accumulated, start);
        if !progress(frame.accumulated) || done {
            break;
        }
    }
    picture_of(&mut executor, &plan, request, frame.accumulated, start, pass_times)
}

/// Renders frames that reuse each other, as a viewer would, and returns the last: one sample a pixel, with no variance
/// known. The scene's animation goes on from frame to frame. `progress` is told the frames so far.
///
/// # Errors
/// If the size is refused, the scene can't be shown at some time or the GPU fails.
pub fn render_real_time(
    packed: &mut PackedScene,
    request: &Request,
    backend: &Backend<'_>,
    mut progress: impl FnMut(u32) -> bool,
) -> Result<Rendered, RenderError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let plan = direct_light(Technique::RealTime, &request.settings, &facts, request.curve, &["moments", "display"])?;
    let mut executor = Executor::new(backend, &plan, packed.buffers())?;
    let mut sequence = Sequence::new(packed, Request { technique: Technique::RealTime, ..request.clone() });
    let start = Instant::now();
    let mut count = 0;
    let mut pass_times;
    loop {
        let (frames, changed) = sequence.next(&sequence.shot(count))?;
        let scene = sequence.packed().buffers();
        executor.update(scene, changed)?;
        pass_times = executor.run(&plan, scene, &frames)?;
        count += 1;
        if matches!(request.stop, Stop::Time(_)) {
            executor.finish()?;
        }
        let done = is_done(request.stop, count, start);
        if !progress(count) || done {
            break;
        }
    }
    picture_of(&mut executor, &plan, request, count, start, pass_times)
}

/// What the frames have come to.
fn picture_of(
    executor: &mut Executor,
    plan: &Plan,
    request: &Request,
    samples: u32,
    start: Instant,
    mut pass_times: Vec<(&'static str, Duration)>,
) -> Result<Rendered, RenderError> {
    executor.finish()?;
    let elapsed = start.elapsed();
    if let Executor::Gpu(gpu) = executor {
        // What `run` returned were the times of a frame before the last.
        pass_times = gpu.last_times().to_vec();
    }
    let moments = executor.read(plan, "moments")?;
    let moments: &[Moments] = moments.elements();
    let display = executor.read(plan, "display")?.elements().to_vec();
    Ok(Rendered {
        picture: Picture {
            width: request.width,
            height: request.height,
            rgb: moments.iter().map(|m| m.mean().to_array()).collect(),
            alpha: None,
        },
        variance: moments.iter().map(|m| m.variance_of_mean().to_array()).collect(),
        display,
        samples,
        elapsed,
        pass_times,
        faults: Faults::of(moments),
    })
}

/// Renders by the reference integrator, on the host.
pub fn render_reference(
    packed: &PackedScene,
    request: &Request,
    mut progress: impl FnMut(u32) -> bool,
) -> Result<Rendered, RenderError> {
    // The same limits on the size as for the passes.
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    direct_light(Technique::Candidates, &request.settings, &facts, request.curve, &["moments"])?;
    let frame = frame_of(packed, request);
    let reference = Reference::new(packed, frame, request.settings.path_length);
    let mut estimates = vec![Estimate::default(); (request.width * request.height) as usize];
    let start = Instant::now();
    let mut samples = 0u32;
    let mut block = 0;
    loop {
        let step = match request.stop {
            Stop::Samples(n) => (n - samples).min(4),
            Stop::Time(_) => 1,
        };
        reference.accumulate(&mut estimates, block, step);
        block += 1;
        samples += step;
        let done = is_done(request.stop, samples, start);
        if !progress(samples) || done {
            break;
        }
    }
    let elapsed = start.elapsed();
    let mean = |e: &Estimate| e.mean.as_vec3();
    let display = estimates.iter().map(|e| display_of(mean(e) * request.exposure, request.curve)).collect();
    Ok(Rendered {
        picture: Picture {
            width: request.width,
            height: request.height,
            rgb: estimates.iter().map(|e| mean(e).to_array()).collect(),
            alpha: None,
        },
        variance: estimates.iter().map(|e| e.variance_of_mean().as_vec3().to_array()).collect(),
        display,
        samples,
        elapsed,
        pass_times: Vec::new(),
        faults: Faults { samples: estimates.iter().map(|e| e.dropped).sum(), ..Faults::default() },
    })
}

/// Exposed radiance as 8-bit sRGB.
fn display_of(exposed: Vec3, curve: ToneCurve) -> u32 {
    use weir_shared::tonemap::{curve as number, pack_srgb, tone_map};
    pack_srgb(match curve {
        ToneCurve::Clip => tone_map::<{ number::CLIP }>(exposed),
        ToneCurve::Reinhard => tone_map::<{ number::REINHARD }>(exposed),
        ToneCurve::Aces => tone_map::<{ number::ACES }>(exposed),
        ToneCurve::Agx => tone_map::<{ number::AGX }>(exposed),
    })
}

/// Depth, normals, positions, albedo and light of each pixel's center, from one frame on the host.
///
/// # Errors
/// If the size is refused.
pub fn layers(packed: &PackedScene, request: &Request, rendered: &Rendered) -> Result<Layers, RenderError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let outputs: &[&str] = if packed.has().is_empty() { &["surfaces"] } else { &["surfaces", "fresh"] };
    let plan = direct_light(Technique::Candidates, &request.settings, &facts, request.curve, outputs)?;
    let mut executor = CpuExecutor::new(&plan);
    let frame = Frame { jitter: 0, ..frame_of(packed, request) };
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
        position: vectors(&|s| s.position()),
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
