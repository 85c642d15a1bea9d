//! Methods whose frames reuse each other: the error of a frame, how it falls after a cut, and how it flickers.

use std::time::Instant;

use weir_shared::moments::Moments;

use super::{
    Halt, Target,
    judge::Judge,
    methods::Method,
    results::{MethodResults, Point},
    statistics::{Quantity, median},
    stills::{Shown, mean_of, shown},
    timing::{FrameTimes, Yardstick},
};
use crate::{
    graph::Plan,
    output::{
        Picture,
        compare::{compare, flip},
    },
    packed::PackedScene,
    render::{Backend, Executor, RenderError, Request, facts_of},
    sequence::Sequence,
    technique::{ToneCurve, direct_light},
};

/// The share of a chain, at its end, whose frames count: by then it has forgotten its beginning.
const STEADY: f64 = 0.5;

/// A method with one seed.
struct Chain<'a> {
    executor: Executor,
    plan: Plan,
    sequence: Sequence<&'a mut PackedScene>,
    count: u32,
    times: FrameTimes,
    last: Option<Picture>,
    /// Of each frame.
    frames: Vec<FrameErrors>,
}

/// A frame against the reference, and against the frame before.
#[derive(Clone, Copy, Default)]
struct FrameErrors {
    rel_mse: f64,
    mape: f64,
    smape: f64,
    flip: Option<f64>,
    change: f64,
    mean: f64,
}

impl<'a> Chain<'a> {
    fn new(packed: &'a mut PackedScene, request: &Request, backend: &Backend<'_>) -> Result<Self, RenderError> {
        let facts = facts_of(packed, request.width, request.height, &request.settings);
        let outputs = &["moments", "display"];
        let plan = direct_light(request.technique, &request.settings, &facts, ToneCurve::default(), outputs)?;
        let executor = Executor::new(backend, &plan, packed.buffers())?;
        let sequence = Sequence::new(packed, request.clone());
        let (times, last, frames) = (FrameTimes::default(), None, Vec::new());
        Ok(Self { executor, plan, sequence, count: 0, times, last, frames })
    }

    /// A frame more: moving the scene, uploading what has changed, all passes.
    fn step(&mut self, yardstick: &Yardstick) -> Result<(), RenderError> {
        let start = Instant::now();
        let (frames, changed) = self.sequence.next(&self.sequence.shot(self.count))?;
        let built = start.elapsed();
        let scene = self.sequence.packed().buffers();
        self.executor.update(scene, changed)?;
        let uploaded = start.elapsed() - built;
        let returned = self.executor.run(&self.plan, scene, &frames)?;
        self.executor.finish()?;
        let elapsed = start.elapsed();
        let mut passes = vec![("build", built), ("upload", uploaded)];
        passes.extend(self.executor.last_times(returned));
        self.times.add(elapsed.as_secs_f64(), yardstick.measure(), passes);
        self.count += 1;
        Ok(())
    }

    fn picture(&mut self, like: &Picture) -> Result<Picture, RenderError> {
        let moments = self.executor.read(&self.plan, "moments")?;
        let rgb = moments.elements::<Moments>().iter().map(|m| m.mean().to_array()).collect();
        Ok(Picture { rgb, alpha: None, ..like.clone() })
    }

    /// Judges the frame that was made last; FLIP takes long and is for few frames.
    fn judge(&mut self, judge: &Judge, with_flip: bool) -> Result<(), RenderError> {
        let picture = self.picture(&judge.picture)?;
        let found = compare(&picture, &judge.picture).unwrap_or_default();
        let change = self.last.as_ref().map_or(f64::NAN, |last| {
            let pairs = picture.rgb.iter().flatten().zip(last.rgb.iter().flatten());
            0.5 * judge.weighted(pairs.map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2)))
        });
        self.frames.push(FrameErrors {
            rel_mse: found.rel_mse - judge.facts.rel_mse,
            mape: found.mape,
            smape: found.smape,
            flip: if with_flip {
                flip(picture.width, picture.height, &shown(&picture), &shown(&judge.picture))
            } else {
                None
            },
            change,
            mean: mean_of(&picture),
        });
        self.last = Some(picture);
        Ok(())
    }
}

/// Runs chains of all methods in turns, frame by frame, and judges each frame.
pub(super) fn measure(
    target: &Target,
    methods: &[Method],
    judge: &Judge,
    frames: u32,
    seeds: u32,
    backend: &Backend<'_>,
    halt: &Halt<'_>,
) -> Result<(Vec<MethodResults>, Vec<Shown>), RenderError> {
    let yardstick = Yardstick::new();
    let mut scenes = Vec::new();
    for _ in methods {
        scenes.push(target.copy()?);
    }
    let mut gathered: Vec<(FrameTimes, Vec<Vec<FrameErrors>>, u64)> =
        methods.iter().map(|_| Default::default()).collect();
    let mut pictures = Vec::new();
    for seed in 0..seeds {
        let mut chains = Vec::new();
        for (method, packed) in methods.iter().zip(&mut scenes) {
            let request = Request { seed: seed + 1, ..target.request(method) };
            chains.push(Chain::new(packed, &request, backend)?);
        }
        'frames: for frame in 0..frames {
            for chain in &mut chains {
                chain.step(&yardstick)?;
                chain.judge(judge, frame + 1 == frames)?;
                if frame + 1 == frames / 2 {
                    chain.times.end_part();
                }
                if halt.reason().is_some() {
                    break 'frames;
                }
            }
        }
        for ((chain, method), gathered) in chains.into_iter().zip(methods).zip(&mut gathered) {
            if let Some(picture) = chain.last.filter(|_| seed == 0) {
                pictures.push(Shown { method: method.name.clone(), time_s: f64::NAN, picture });
            }
            gathered.2 = chain.plan.frame_bytes();
            gathered.0.join(chain.times);
            gathered.1.push(chain.frames);
        }
        if halt.reason().is_some() {
            break;
        }
    }
    let results: Vec<MethodResults> = methods
        .iter()
        .zip(gathered)
        .map(|(method, (times, chains, frame_bytes))| MethodResults {
            frame_bytes,
            ..results_of(&times.results(method, target), &chains, judge)
        })
        .collect();
    for picture in &mut pictures {
        let of = results.iter().find(|result| result.name == picture.method);
        picture.time_s = of.map_or(f64::NAN, |result| result.frame_ms.value * 1e-3);
    }
    Ok((results, pictures))
}

fn results_of(timed: &MethodResults, chains: &[Vec<FrameErrors>], judge: &Judge) -> MethodResults {
    let steady = |chain: &Vec<FrameErrors>| chain[(STEADY * chain.len() as f64) as usize..].to_vec();
    let ends: Vec<Vec<FrameErrors>> = chains.iter().filter(|chain| chain.len() > 1).map(steady).collect();
    let mean = |end: &[FrameErrors], f: &dyn Fn(&FrameErrors) -> f64| end.iter().map(f).sum::<f64>() / end.len() as f64;
    let per_chain = |f: &dyn Fn(&FrameErrors) -> f64| ends.iter().map(|end| mean(end, f)).collect::<Vec<f64>>();
    let over_seeds = |f: &dyn Fn(&FrameErrors) -> f64| Quantity::median(per_chain(f));
    let rel_mse = over_seeds(&|e| e.rel_mse);
    let flips: Vec<f64> = chains.iter().filter_map(|chain| chain.last()?.flip).collect();
    let longest = chains.iter().map(Vec::len).max().unwrap_or(0);
    let at = |i: usize| median(&chains.iter().filter_map(|chain| chain.get(i)).map(|e| e.rel_mse).collect::<Vec<_>>());
    // One value for each chain: its frames share their error.
    let mut bias = Quantity::mean(per_chain(&|e| e.mean / judge.mean - 1.0));
    let half = (bias.high - bias.value).hypot(1.96 * judge.facts.mean_error);
    (bias.low, bias.high) = (bias.value - half, bias.value + half);
    MethodResults {
        points: vec![Point {
            time_s: timed.frame_ms.value * 1e-3,
            frames: 1.0,
            mape: over_seeds(&|e| e.mape),
            smape: over_seeds(&|e| e.smape),
            flip: (!flips.is_empty()).then(|| Quantity::median(flips)),
            rel_mse: rel_mse.clone(),
        }],
        efficiency: 1.0 / (rel_mse.value * timed.frame_ms.value * 1e-3),
        relative_variance: rel_mse,
        bias,
        flicker: Some(over_seeds(&|e| e.change).value),
        recovery: (0..longest).map(at).collect(),
        ..timed.clone()
    }
}

/// Times of frames of several scenes and methods, in turns; nothing is judged. Independent frames are made the same way:
/// moving the scene counts.
pub(super) fn time_in_turns(
    pairs: &[(&Target, &Method)],
    frames: u32,
    backend: &Backend<'_>,
    halt: &Halt<'_>,
) -> Result<Vec<Quantity>, RenderError> {
    let yardstick = Yardstick::new();
    let mut scenes = Vec::new();
    for (target, _) in pairs {
        scenes.push(target.copy()?);
    }
    let mut chains = Vec::new();
    for ((target, method), packed) in pairs.iter().zip(&mut scenes) {
        chains.push(Chain::new(packed, &target.request(method), backend)?);
    }
    for frame in 0..frames {
        for chain in &mut chains {
            chain.step(&yardstick)?;
            // Parts of four frames: enough of them for an interval.
            if frame % 4 == 0 {
                chain.times.end_part();
            }
            if halt.reason().is_some() {
                return Ok(Vec::new());
            }
        }
    }
    Ok(chains.iter().map(|chain| chain.times.frame_ms()).collect())
}
