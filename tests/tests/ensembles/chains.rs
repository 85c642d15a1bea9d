//! Many chains of frames that differ in their seed alone, and the reference for where they end.

use bytemuck::Pod;
use rayon::prelude::*;
use weir::{
    budget::FRONT,
    executor::{
        SceneBuffers,
        cpu::{CpuExecutor, Order},
    },
    graph::Plan,
    packed::PackedScene,
    reference::{Estimate, Reference},
    render::{Request, facts_of, frame_of},
    sequence::Sequence,
    technique::{Technique, ToneCurve, direct_light_with},
};
use weir_shader::wiring::Pass;
use weir_shared::frame::FramePair;
use weir_tests::request;

pub use crate::scenarios::{HEIGHT, WIDTH};
use crate::{
    scenarios::Scenario,
    statistics::{Ensemble, TOTALS},
};

/// One frame of a clip: its uniform, and what of the scene it may have changed.
pub struct Snapshot {
    pub frames: FramePair,
    pub records: Vec<u32>,
    bvh: Vec<glam::UVec4>,
    pub lights: Vec<u32>,
}

/// The frames of a scenario. What they show does not depend on the seed, so all chains share it.
pub struct Clip {
    packed: PackedScene,
    plan: Plan,
    pub snapshots: Vec<Snapshot>,
}

impl Clip {
    /// The frames of `scenario` by the kernels of `passes`; of a still, only the last of them.
    pub fn new(scenario: &Scenario, passes: &'static [Pass], technique: Technique, knobs: &[&str]) -> Self {
        Self::showing(&["color"], scenario, passes, technique, knobs)
    }

    /// The same, of which more than the colour can be seen.
    pub fn showing(
        outputs: &[&'static str],
        scenario: &Scenario,
        passes: &'static [Pass],
        technique: Technique,
        knobs: &[&str],
    ) -> Self {
        Self::tuned(outputs, scenario, passes, technique, knobs, None)
    }

    /// The same, with other knobs in each frame: those of the rung of the budget's front that `rung_of` names.
    pub fn tuned(
        outputs: &[&'static str],
        scenario: &Scenario,
        passes: &'static [Pass],
        technique: Technique,
        knobs: &[&str],
        rung_of: Option<fn(usize) -> usize>,
    ) -> Self {
        let shots = if technique == Technique::RealTime {
            &scenario.shots[..]
        } else {
            &scenario.shots[scenario.shots.len() - 1..]
        };
        let mut packed = scenario.pack(0);
        let knobs = [&scenario.knobs[..], knobs].concat();
        let request = request(&shots[0].camera, scenario.size, technique, &knobs);
        let facts = facts_of(&packed, scenario.size[0], scenario.size[1], &request.settings);
        let plan = direct_light_with(passes, technique, &request.settings, &facts, ToneCurve::Clip, outputs)
            .expect("the frame has a plan");
        let base = request.settings.clone();
        let mut sequence = Sequence::new(&mut packed, request);
        let mut snapshots = Vec::new();
        for (index, shot) in shots.iter().enumerate() {
            if let Some(rung_of) = rung_of {
                sequence.tune(&FRONT[rung_of(index)].applied_to(&base));
            }
            let (frames, _) = sequence.next(shot).expect("the scenario's own moment");
            let now = sequence.packed();
            let (records, bvh, lights) = (now.records.clone(), now.bvh.clone(), now.lights.clone());
            snapshots.push(Snapshot { frames, records, bvh, lights });
        }
        Self { packed, plan, snapshots }
    }

    /// Runs frames, each with its number, how many are averaged before it, and the number of what it shows; calls `seen` after
    /// every one.
    fn run(&self, seed: u32, snapshots: impl Iterator<Item = (u32, u32, usize)>, mut seen: impl FnMut(&Shown<'_>)) {
        let mut executor = CpuExecutor::new(&self.plan);
        // Chains are what runs in parallel.
        executor.order = Order { band_rows: HEIGHT, backwards: false };
        for (index, accumulated, snapshot) in snapshots {
            let Snapshot { frames, records, bvh, lights } = &self.snapshots[snapshot];
            let mut frames = *frames;
            (frames.now.seed, frames.prev.seed) = (seed, seed);
            (frames.now.index, frames.now.accumulated) = (index, accumulated);
            let buffers = SceneBuffers { records, bvh, lights, ..self.packed.buffers() };
            executor.run(&self.plan, buffers, &frames);
            seen(&Shown { executor: &executor, plan: &self.plan });
        }
    }

    /// The totals of the last frames of the chains of the given seeds, in their order, whichever thread was first.
    pub fn totals(&self, seeds: std::ops::Range<u32>) -> Vec<[f64; TOTALS]> {
        let of_chain = |seed| {
            let (mut totals, mut left) = ([0.0; TOTALS], self.snapshots.len());
            self.chain(seed, |shown| {
                left -= 1;
                if left == 0 {
                    totals = shown.totals();
                }
            });
            totals
        };
        seeds.into_par_iter().map(of_chain).collect()
    }

    /// Runs a chain; calls `seen` after every frame.
    pub fn chain(&self, seed: u32, seen: impl FnMut(&Shown<'_>)) {
        self.run(seed, (0..self.snapshots.len()).map(|i| (i as u32, 0, i)), seen);
    }

    /// Independent stills of one seed, `count` of them: red, green and blue of each pixel.
    pub fn stills(&self, seed: u32, count: u32, mut seen: impl FnMut(&[[f32; 4]])) {
        self.run(seed, (0..count).map(|i| (i, i, 0)), |shown| seen(shown.output("color")));
    }
}

/// A frame that was computed.
pub struct Shown<'a> {
    executor: &'a CpuExecutor,
    plan: &'a Plan,
}

impl Shown<'_> {
    /// One of the outputs that were asked for.
    pub fn output<T: Pod>(&self, name: &str) -> &[T] {
        bytemuck::cast_slice(self.executor.output(self.plan, name).expect("the plan has this output"))
    }

    /// The totals of the picture.
    pub fn totals(&self) -> [f64; TOTALS] {
        Ensemble::totals(self.output::<[f32; 4]>("color").iter().map(|c| [c[0], c[1], c[2]].map(f64::from)))
    }
}

/// What the reference integrator makes of the last shot of a scenario.
pub fn judge(scenario: &Scenario, samples: u32) -> Vec<Estimate> {
    let last = scenario.shots.last().expect("a scenario has a shot");
    let packed = scenario.pack(scenario.shots.len() - 1);
    let request: Request = request(&last.camera, scenario.size, Technique::Candidates, &[]);
    let reference = Reference::new(&packed, frame_of(&packed, &request), 1);
    let mut estimates = vec![Estimate::default(); (request.width * request.height) as usize];
    reference.accumulate(&mut estimates, 0, samples);
    assert!(estimates.iter().all(|e| e.dropped == 0));
    estimates
}
