//! Frames of a scene on either executor, as often as a case wants them; and the means that they should have.

use bytemuck::Pod;
use glam::UVec4;
use weir_shared::{frame::FramePair, moments::Moments};

use super::Finding;
use crate::{
    executor::{Placement, SceneBuffers},
    graph::Plan,
    packed::{Changed, Moment, PackOptions, PackedScene},
    reference::{Estimate, Reference},
    render::{Backend, Executor, RenderError, Request, facts_of, frame_of},
    scene::{Camera, Scene},
    sequence::{Sequence, Shot},
    settings::Settings,
    technique::{Technique, ToneCurve, direct_light},
};

/// What is drawn, and how.
#[derive(Clone)]
pub struct Take<'a> {
    /// What there is.
    pub scene: &'a Scene,
    /// What the frames show.
    pub shots: Vec<Shot>,
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Which passes.
    pub technique: Technique,
    /// Knobs that are turned.
    pub knobs: Vec<&'a str>,
    /// What of a frame can be read.
    pub outputs: &'a [&'static str],
}

impl<'a> Take<'a> {
    /// Frames of a scene that stands still, by its own camera, of 16 by 12 pixels; their colour and moments can be read.
    ///
    /// # Panics
    /// If the scene has no camera.
    pub fn still(scene: &'a Scene, technique: Technique, knobs: &[&'a str]) -> Self {
        let camera = scene.camera.expect("scenes of the list have a camera");
        let shots = vec![Shot { moment: Moment::default(), camera }];
        Self { scene, shots, size: [16, 12], technique, knobs: knobs.to_vec(), outputs: &["color", "moments"] }
    }

    fn is_dynamic(&self) -> bool {
        self.shots.iter().any(|s| s.moment != Moment::default())
    }

    fn pack(&self, shot: usize) -> Result<PackedScene, RenderError> {
        let (camera, moment) = (self.shots[shot].camera, &self.shots[shot].moment);
        let of_settings = PackOptions::of(&self.request(camera).settings);
        // What is put to the test is sampling, even where light has a closed form.
        let options = PackOptions { dynamic: self.is_dynamic(), closed_form: false, ..of_settings };
        Ok(PackedScene::with(self.scene, moment, options)?)
    }

    fn request(&self, camera: Camera) -> Request {
        let mut settings = Settings::default();
        for knob in &self.knobs {
            settings.apply(knob).expect("cases turn knobs that exist");
        }
        let one = Request::new(camera, self.size, self.technique, settings);
        Request { seed: 7, curve: ToneCurve::Clip, ..one }
    }

    /// What the reference integrator makes of one of the shots.
    ///
    /// # Errors
    /// If the scene does not pack.
    pub fn judged(&self, shot: usize, samples: u32) -> Result<Total, RenderError> {
        let packed = self.pack(shot)?;
        let request = self.request(self.shots[shot].camera);
        let reference = Reference::new(&packed, frame_of(&packed, &request), 1);
        let mut estimates = vec![Estimate::default(); (request.width * request.height) as usize];
        reference.accumulate(&mut estimates, 0, samples);
        let mean = estimates.iter().map(|e| e.mean.element_sum()).sum();
        // The channels of a sample are not independent; their standard deviations add up at most.
        let deviation = |e: &Estimate| e.variance_of_mean().to_array().iter().map(|v| v.sqrt()).sum::<f64>();
        let variance = estimates.iter().map(|e| deviation(e).powi(2)).sum();
        Ok(Total { mean, variance })
    }
}

/// One frame of a clip: its uniform, and what of the scene it may have changed.
struct Snapshot {
    frames: FramePair,
    records: Vec<u32>,
    bvh: Vec<UVec4>,
    lights: Vec<u32>,
}

/// Frames that can be run again and again, with other seeds.
pub struct Clip {
    packed: PackedScene,
    plan: Plan,
    executor: Executor,
    snapshots: Vec<Snapshot>,
    is_dynamic: bool,
}

impl Clip {
    /// Prepares a take on an executor.
    ///
    /// # Errors
    /// If the scene does not pack, the size is refused or the GPU fails.
    pub fn new(backend: &Backend<'_>, take: &Take<'_>) -> Result<Self, RenderError> {
        let mut packed = take.pack(0)?;
        let request = take.request(take.shots[0].camera);
        let facts = facts_of(&packed, take.size[0], take.size[1], &request.settings);
        let plan = direct_light(take.technique, &request.settings, &facts, request.curve, take.outputs)?;
        let executor = Executor::new(backend, &plan, packed.buffers())?;
        let mut snapshots = Vec::new();
        let mut sequence = Sequence::new(&mut packed, request);
        for shot in &take.shots {
            let (frames, _) = sequence.next(shot)?;
            let now = sequence.packed();
            let (records, bvh, lights) = (now.records.clone(), now.bvh.clone(), now.lights.clone());
            snapshots.push(Snapshot { frames, records, bvh, lights });
        }
        Ok(Self { packed, plan, executor, snapshots, is_dynamic: take.is_dynamic() })
    }

    /// The scene as packed for the last shot.
    pub fn packed(&self) -> &PackedScene {
        &self.packed
    }

    /// The uniform of a shot.
    pub fn frames(&self, shot: usize) -> FramePair {
        self.snapshots[shot].frames
    }

    /// Runs a frame that shows a shot, after `change` of its uniform.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn show(&mut self, shot: usize, change: impl FnOnce(&mut FramePair)) -> Result<(), RenderError> {
        let Snapshot { frames, records, bvh, lights } = &self.snapshots[shot];
        let mut frames = *frames;
        change(&mut frames);
        let buffers = self.packed.buffers();
        let placement = Placement { blocks: Placement::blocks_of(&frames), ..buffers.placement };
        let buffers = SceneBuffers { records, bvh, lights, placement, ..buffers };
        if self.is_dynamic {
            let all = |buffer: &'static str| Changed { buffer, range: 0..buffers.bytes(buffer).len() };
            self.executor.update(buffers, ["records", "bvh", "lights"].map(all).to_vec())?;
        }
        self.executor.run(&self.plan, buffers, &frames)?;
        Ok(())
    }

    /// One of the outputs of the frame that was run last.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn output<T: Pod>(&mut self, name: &str) -> Result<Vec<T>, RenderError> {
        Ok(self.executor.read(&self.plan, name)?.elements().to_vec())
    }

    /// Writes over a part of an output of the frame that was run last; if it is a history, the next frame sees that.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn overwrite(&mut self, name: &str, offset: usize, bytes: &[u8]) -> Result<(), RenderError> {
        Ok(self.executor.overwrite(&self.plan, name, offset, bytes)?)
    }

    /// The mean of `count` independent stills of the first shot.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn stills(&mut self, count: u32) -> Result<Still, RenderError> {
        self.stills_of(count, |_| true)
    }

    /// The same, of the pixels of these numbers alone.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn stills_of(&mut self, count: u32, counts: impl Fn(usize) -> bool) -> Result<Still, RenderError> {
        let mut frames = Vec::new();
        for i in 0..count {
            self.show(0, |frames| (frames.now.index, frames.now.accumulated) = (i, i))?;
            let color: Vec<[f32; 4]> = self.output("color")?;
            let counted = color.iter().enumerate().filter(|(pixel, _)| counts(*pixel));
            frames.push(counted.flat_map(|(_, c)| &c[..3]).map(|&x| f64::from(x)).sum());
        }
        let moments: Vec<Moments> = self.output("moments")?;
        let counted = moments.into_iter().enumerate().filter(|(pixel, _)| counts(*pixel));
        Ok(Still { moments: counted.map(|(_, m)| m).collect(), frames })
    }

    /// The totals of a shot's frame over independent chains of all shots up to it.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn chains(&mut self, shot: usize, chains: u32) -> Result<Total, RenderError> {
        let mut totals = Vec::new();
        for chain in 0..chains {
            for i in 0..=shot {
                self.show(i, |frames| (frames.now.seed, frames.prev.seed) = (chain, chain))?;
            }
            let color: Vec<[f32; 4]> = self.output("color")?;
            totals.push(color.iter().flat_map(|c| &c[..3]).map(|&x| f64::from(x)).sum::<f64>());
        }
        Ok(Total::of(&totals))
    }
}

/// The mean of stills.
pub struct Still {
    /// Of each pixel.
    pub moments: Vec<Moments>,
    /// Sum over channels and pixels of each frame; neighbours share samples, so that pixels don't tell how sure it is.
    pub frames: Vec<f64>,
}

impl Still {
    /// Every channel of every pixel.
    pub fn channels(&self) -> impl Iterator<Item = f32> + '_ {
        self.moments.iter().flat_map(|m| m.mean)
    }

    /// Pixels of which some channel is negative or not finite, in mean or variance.
    pub fn unusable(&self) -> usize {
        let is_usable = |x: &f32| x.is_finite() && *x >= 0.0;
        let is_unusable = |m: &&Moments| !m.mean.iter().chain(&m.deviation).all(is_usable);
        self.moments.iter().filter(is_unusable).count()
    }

    /// Samples of pixels for which a weight was dropped.
    pub fn faults(&self) -> u64 {
        self.moments.iter().map(|m| u64::from(m.faults)).sum()
    }

    /// The sum over channels and pixels.
    pub fn total(&self) -> Total {
        Total::of(&self.frames)
    }

    /// Finds that the picture can be used, that nothing was dropped, and `more`.
    pub fn finding(&self, more: bool, seen: impl std::fmt::Display) -> Finding {
        let (unusable, faults) = (self.unusable(), self.faults());
        let text = format!("{seen}; {unusable} unusable pixels, {faults} faults");
        Finding::new(more && unusable == 0 && faults == 0, text)
    }
}

/// A sum over a picture, and the variance with which it is known.
#[derive(Clone, Copy, Debug)]
pub struct Total {
    /// Sum over channels and pixels.
    pub mean: f64,
    /// Its variance.
    pub variance: f64,
}

impl Total {
    /// The mean of independent sums.
    pub fn of(sums: &[f64]) -> Self {
        let n = sums.len() as f64;
        let mean = sums.iter().sum::<f64>() / n;
        let variance = sums.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
        Self { mean, variance }
    }

    /// Known without error.
    pub fn exact(mean: f64) -> Self {
        Self { mean, variance: 0.0 }
    }

    /// Compares with what it should be: equal but for noise, and known to be within `margin` of it at 95 %.
    pub fn agrees(&self, with: &Total, margin: f64) -> (bool, String) {
        // The normal quantile for one test in a million, two-sided.
        const BOUND: f64 = 4.89;
        // Below one part in 100,000 rounding, not noise, decides.
        let error = (self.variance + with.variance).sqrt().max(1e-5 * with.mean.abs());
        let (difference, scale) = (self.mean - with.mean, 100.0 / with.mean.abs());
        let z = difference / error;
        let agrees = z.abs() < BOUND && difference.abs() + 1.645 * error < margin * with.mean.abs();
        (agrees, format!("mean {:+.2} % +- {:.2} %, z {z:.1}", difference * scale, 1.96 * error * scale))
    }

    /// [`Total::agrees`] as a finding.
    pub fn finding(&self, with: &Total, margin: f64) -> Finding {
        let (agrees, text) = self.agrees(with, margin);
        Finding::new(agrees, text)
    }
}

impl Finding {
    /// All of several findings.
    pub(super) fn all(findings: impl IntoIterator<Item = Self>) -> Self {
        let (mut holds, mut seen) = (true, Vec::new());
        for finding in findings {
            holds &= finding.holds;
            seen.push(finding.seen);
        }
        Self { holds, seen: seen.join("; ") }
    }

    /// The same, with a word before it.
    pub(super) fn of(self, what: impl std::fmt::Display) -> Self {
        Self { seen: format!("{what}: {}", self.seen), ..self }
    }
}
