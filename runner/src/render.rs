//! Pictures: independent frames, averaged, or frames that reuse each other, on whichever executor there is.

mod layers;
mod still;
mod stop;

use std::time::{Duration, Instant};

use thiserror::Error;
use weir_shared::{frame::Frame, light::source, moments::Moments, resample::choice, reuse::lattice};

use crate::{
    budget::TimeBudget,
    executor::gpu::GpuError,
    exit::{Exit, HasExit},
    faults::Faults,
    graph::{Facts, GraphError, Need},
    margin::Margin,
    output::Picture,
    packed::{PackError, PackedScene},
    scene::Camera,
    sequence::Sequence,
    settings::Settings,
    skips::Rule,
    technique::{Technique, ToneCurve, direct_light},
};

pub use crate::executor::{Backend, Executor};
pub use layers::{camera_matrices, layers};
#[cfg(feature = "window")]
pub(crate) use still::pixel_moments;
pub use still::{display_of, render, render_reference};
use stop::Clock;
pub use stop::Stop;

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

impl Request {
    /// One sample of a picture of `[width, height]` pixels, by seed 0, the default tone curve and exposure 1.
    pub fn new(camera: Camera, [width, height]: [u32; 2], technique: Technique, settings: Settings) -> Self {
        let (stop, curve) = (Stop::Samples(1), ToneCurve::default());
        Self { width, height, camera, seed: 0, stop, curve, exposure: 1.0, technique, settings }
    }
}

/// A picture, and what it took.
pub struct Rendered {
    /// Linear mean radiance.
    pub picture: Picture,
    /// How far it is from the truth; of a mean of two frames and more.
    pub margin: Option<Margin>,
    /// Variance of the mean of each channel: the squared standard error.
    pub variance: Vec<[f32; 3]>,
    /// Tone-mapped, 8-bit sRGB, red in the low byte.
    pub display: Vec<u32>,
    /// Samples of each pixel.
    pub samples: u32,
    /// Time from the beginning of the first frame to the end of the last, those of a pilot included.
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
    /// Frames in real time share their error.
    #[error(
        "frames that reuse each other are no independent samples, so their error is not known; choose another integrator, or stop by samples or time"
    )]
    NoMargin,
}

impl HasExit for RenderError {
    fn exit(&self) -> Exit {
        match self {
            Self::Graph(error) => error.exit(),
            Self::Pack(error) => error.exit(),
            Self::Gpu(error) => error.exit(),
            Self::NoMargin => Exit::Usage,
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
    let [presampled_columns, presampled_rows] = records_of(packed, request.width, request.height, settings);
    Frame {
        width: request.width,
        height: request.height,
        index: 0,
        seed: request.seed,
        camera_origin: camera.origin - packed.origin,
        accumulated: 0,
        camera_right: right * half_width,
        camera_rays: camera_rays(request),
        camera_up: up * half_height,
        exposure: request.exposure,
        camera_forward: forward,
        candidates: settings.candidates,
        source: source_of(packed, settings),
        reservoirs: settings.reservoirs,
        round: 0,
        choice: settings.choice,
        candidates_tree: if packed.content.light_tree { settings.candidates_tree } else { 0 },
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
        presampled_columns,
        presampled_rows,
        // So that squares of it stay finite.
        cell_size: (packed.diagonal() * settings.cell_size).min(1e17),
        cell_candidates: settings.cell_candidates,
        not_skipped: settings.skips.in_passes(),
        ..packed.frame
    }
}

/// Camera rays of a pixel, as a frame has them. Where nothing is known of neighbours, that is in the first frame, some of a
/// still: it counts as much as any other. In real time one, or a cut would take longer than other frames.
fn camera_rays(request: &Request) -> u32 {
    let Settings { jitter, camera_rays, .. } = request.settings;
    let of_first = match request.technique {
        Technique::RealTime => 1,
        Technique::Still | Technique::Candidates => camera_rays.min(4),
    };
    if jitter { camera_rays | (of_first << 16) } else { 0 }
}

/// Where candidates come from: by power in place of structures that the scene has not been packed with, and of tiles
/// that are of no use. By what does not change from frame to frame, as the plan depends on it.
fn source_of(packed: &PackedScene, settings: &Settings) -> u32 {
    let is_there = match settings.source {
        source::CUTS => packed.content.light_cuts,
        source::TREE => packed.content.light_tree,
        source::TILES => has_use_for_tiles(packed, settings),
        _ => true,
    };
    if is_there { settings.source } else { source::POWER }
}

/// Whether a tile is a smaller list to draw from than that of all lights. Always, with the rule off.
fn has_use_for_tiles(packed: &PackedScene, settings: &Settings) -> bool {
    let of_a_tile = settings.tile_size.next_power_of_two();
    packed.content.lights > u64::from(of_a_tile) || !settings.skips.is_on(Rule::Presampling)
}

/// Columns and rows of records of lights drawn ahead; one of each where none are drawn.
fn records_of(packed: &PackedScene, width: u32, height: u32, settings: &Settings) -> [u32; 2] {
    let is_drawn = packed.content.emitters && source_of(packed, settings) == settings.source;
    if is_drawn { settings.records(width, height) } else { [1; 2] }
}

/// What steps may need, as the plan is told: with the rule for what is absent off, lights of all kinds. Trees for cuts are
/// memory that is there or not.
fn has_of(packed: &PackedScene, settings: &Settings) -> Vec<Need> {
    let mut has = packed.content.has();
    if !settings.skips.is_on(Rule::Absent) {
        has.extend(
            [Need::Lights, Need::EmissiveTriangles].into_iter().filter(|need| !packed.content.has().contains(need)),
        );
    }
    if packed.content.emitters && has_use_for_tiles(packed, settings) {
        has.push(Need::MoreThanATile);
    }
    has
}

/// Work within and around passes that frames do without, and why; shadow rays to what is known to be visible and candidates
/// of black surfaces apart, which are a matter of single pixels.
fn spared(packed: &PackedScene, settings: &Settings) -> Vec<(&'static str, &'static str)> {
    let (content, skips) = (&packed.content, settings.skips);
    let spared = [
        (
            content.emitters && enumerates(packed, settings),
            Rule::Few,
            "drawing lights",
            "each of the few is a candidate",
        ),
        (
            content.emitters && source_of(packed, settings) == source::CUTS && !enumerates(packed, settings),
            Rule::Horizon,
            "lights in cuts",
            "that no surface of the block sees",
        ),
        (content.closed_form, Rule::ClosedForm, "sampling", "where light has a closed form"),
        (content.emitters && !settings.needs_tree(), Rule::Trees, "light trees", "no candidate comes down one"),
        (!packed.moves(), Rule::Updates, "updates", "nothing moves by itself"),
        (packed.moves(), Rule::Still, "updates", "of what stands still"),
        (content.has().contains(&Need::Lights), Rule::Tiles, "tiles", "in which no pixel has light to sample"),
        (!settings.jitter, Rule::Primary, "camera rays", "of frames that see what the last two have seen"),
    ];
    let is_spared = |(holds, rule, ..): &(bool, Rule, &'static str, &'static str)| *holds && skips.is_on(*rule);
    spared.into_iter().filter(is_spared).map(|(_, _, what, why)| (what, why)).collect()
}

/// Whether every triangle and shape that emits is a candidate of each pixel, as the pass `candidates` decides.
fn enumerates(packed: &PackedScene, settings: &Settings) -> bool {
    let off_lattice =
        if settings.lattice == lattice::FULL { settings.candidates } else { settings.candidates_off_lattice };
    let all = settings.candidates.min(off_lattice);
    let environment = if packed.content.distant { (all / 4).max(1) } else { 0 };
    packed.frame.light_count <= (all - environment.min(all)).max(1)
}

/// What the plan of a request depends on.
pub fn facts_of(packed: &PackedScene, width: u32, height: u32, settings: &Settings) -> Facts {
    Facts {
        width,
        height,
        reservoirs: settings.reservoirs,
        candidates: if settings.choice == choice::INVERSION { settings.candidates_in_memory() } else { 1 },
        records: records_of(packed, width, height, settings),
        has: has_of(packed, settings),
        features: settings.skips.features(&packed.content.features()),
        traversal: settings.traversal,
        spared: spared(packed, settings),
    }
}

/// Renders frames that reuse each other, as a viewer would, and returns the last: one sample a pixel, with no variance
/// known. The scene's animation goes on from frame to frame. With a `budget`, it chooses the settings of each frame.
/// `progress` is told the frames so far.
///
/// # Errors
/// If the size is refused, the scene can't be shown at some time or the GPU fails; or if it is to stop at an error, which
/// is not known.
pub fn render_real_time(
    packed: &mut PackedScene,
    request: &Request,
    backend: &Backend<'_>,
    mut budget: Option<&mut TimeBudget>,
    mut progress: impl FnMut(u32) -> bool,
) -> Result<Rendered, RenderError> {
    if matches!(request.stop, Stop::Error(_)) {
        return Err(RenderError::NoMargin);
    }
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let plan = direct_light(Technique::RealTime, &request.settings, &facts, request.curve, &["moments", "display"])?;
    let mut executor = Executor::new(backend, &plan, packed.buffers())?;
    let mut sequence = Sequence::new(packed, Request { technique: Technique::RealTime, ..request.clone() });
    let mut clock = Clock::start();
    let mut count = 0;
    let mut pass_times;
    loop {
        let frame_start = Instant::now();
        if let Some(budget) = &budget {
            sequence.tune(budget.settings());
        }
        let (frames, changed) = sequence.next(&sequence.shot(count))?;
        let scene = sequence.packed().buffers();
        executor.update(scene, changed)?;
        pass_times = executor.run(&plan, scene, &frames)?;
        count += 1;
        if matches!(request.stop, Stop::Time(_)) || budget.is_some() {
            executor.finish()?;
        }
        if let Some(budget) = &mut budget {
            budget.observe(frame_start.elapsed());
        }
        clock.tick();
        let done = clock.is_done(request.stop, count);
        if !progress(count) || done {
            break;
        }
    }
    executor.finish()?;
    let elapsed = clock.elapsed();
    let moments = executor.read(&plan, "moments")?;
    let moments: &[Moments] = moments.elements();
    Ok(Rendered {
        picture: Picture {
            width: request.width,
            height: request.height,
            rgb: moments.iter().map(|m| m.mean().to_array()).collect(),
            alpha: None,
        },
        margin: None,
        variance: moments.iter().map(|m| m.variance_of_mean().to_array()).collect(),
        display: executor.read(&plan, "display")?.elements().to_vec(),
        samples: count,
        elapsed,
        pass_times: executor.last_times(pass_times),
        faults: Faults::of(moments),
    })
}
