//! Methods whose frames are independent: error against time.

use std::time::Instant;

use weir_shared::{frame::FramePair, moments::Moments};

use super::{
    Halt, Target,
    judge::Judge,
    methods::Method,
    results::{MethodResults, Point},
    statistics::{Quantity, median},
    timing::{FrameTimes, Yardstick},
};
use crate::{
    executor::SceneBuffers,
    graph::Plan,
    output::{
        Picture,
        compare::{compare, flip},
    },
    render::{Backend, Executor, RenderError, display_of, facts_of, frame_of},
    technique::{ToneCurve, direct_light},
};

/// A picture for the report.
pub struct Shown {
    /// The method that made it.
    pub method: String,
    /// Time spent on it, in seconds.
    pub time_s: f64,
    /// The picture.
    pub picture: Picture,
}

/// Errors of a picture.
struct Errors {
    rel_mse: f64,
    mape: f64,
    smape: f64,
    flip: Option<f64>,
}

/// A method with one seed.
struct Run<'a> {
    method: usize,
    executor: Executor,
    plan: Plan,
    scene: SceneBuffers<'a>,
    frame: weir_shared::frame::Frame,
    spent_s: f64,
    times: FrameTimes,
    /// Time, frames and errors at each point.
    points: Vec<(f64, u32, Errors)>,
    /// Mean of all values at each point.
    totals: Vec<f64>,
}

/// What the seeds of a method have come to.
#[derive(Default)]
struct Gathered {
    times: FrameTimes,
    points: Vec<Vec<(f64, u32, Errors)>>,
    /// Means of parts of runs, with their frames.
    parts: Vec<(f64, f64)>,
    variances: Vec<f64>,
    frame_bytes: u64,
}

impl Run<'_> {
    fn step(&mut self, yardstick: &Yardstick) -> Result<(), RenderError> {
        let start = Instant::now();
        let returned = self.executor.run(&self.plan, self.scene, &FramePair { now: self.frame, prev: self.frame })?;
        self.executor.finish()?;
        let elapsed_s = start.elapsed().as_secs_f64();
        self.spent_s += elapsed_s;
        self.times.add(elapsed_s, yardstick.measure(), self.executor.last_times(returned));
        self.frame.index += 1;
        self.frame.accumulated += 1;
        Ok(())
    }

    fn moments(&mut self) -> Result<Vec<Moments>, RenderError> {
        Ok(self.executor.read(&self.plan, "moments")?.elements().to_vec())
    }

    /// Judges the picture so far.
    fn judge(&mut self, judge: &Judge) -> Result<Picture, RenderError> {
        let rgb: Vec<[f32; 3]> = self.moments()?.iter().map(|m| m.mean().to_array()).collect();
        let picture = Picture { rgb, alpha: None, ..judge.picture.clone() };
        self.points.push((self.spent_s, self.frame.accumulated, errors(&picture, judge)));
        self.totals.push(mean_of(&picture));
        self.times.end_part();
        Ok(picture)
    }

    /// Means of the parts between points, with their frames.
    fn parts(&self) -> Vec<(f64, f64)> {
        let (mut frames, mut sum) = (0.0, 0.0);
        let ends = self.points.iter().map(|p| f64::from(p.1)).zip(&self.totals);
        let parts = ends.map(|(n, mean)| {
            let part = (n - frames, (n * mean - sum) / (n - frames));
            (frames, sum) = (n, n * mean);
            part
        });
        parts.filter(|part| part.0 > 0.0).collect()
    }
}

pub(super) fn mean_of(picture: &Picture) -> f64 {
    picture.rgb.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * picture.rgb.len()) as f64
}

/// Display-encoded, as the report shows pictures and FLIP compares them.
pub(super) fn shown(picture: &Picture) -> Vec<u32> {
    picture.rgb.iter().map(|&rgb| display_of(rgb.into(), ToneCurve::default())).collect()
}

fn errors(picture: &Picture, judge: &Judge) -> Errors {
    let found = compare(picture, &judge.picture).unwrap_or_default();
    Errors {
        rel_mse: found.rel_mse - judge.facts.rel_mse,
        mape: found.mape,
        smape: found.smape,
        flip: flip(picture.width, picture.height, &shown(picture), &shown(&judge.picture)),
    }
}

fn point_of(runs: &[&(f64, u32, Errors)]) -> Point {
    let of = |f: &dyn Fn(&Errors) -> f64| Quantity::median(runs.iter().map(|run| f(&run.2)).collect());
    let with_flip = runs.iter().all(|run| run.2.flip.is_some());
    Point {
        time_s: median(&runs.iter().map(|run| run.0).collect::<Vec<_>>()),
        frames: median(&runs.iter().map(|run| f64::from(run.1)).collect::<Vec<_>>()),
        rel_mse: of(&|e| e.rel_mse),
        mape: of(&|e| e.mape),
        smape: of(&|e| e.smape),
        flip: with_flip.then(|| of(&|e| e.flip.unwrap_or(f64::NAN))),
    }
}

/// The bias of a mean whose parts are independent, against a reference that has noise of its own.
fn bias(parts: &[(f64, f64)], judge: &Judge) -> Quantity {
    let frames: f64 = parts.iter().map(|part| part.0).sum();
    let mean = parts.iter().map(|part| part.0 * part.1).sum::<f64>() / frames;
    let freedom = parts.len() as f64 - 1.0;
    // Parts with more frames have less noise.
    let variance = parts.iter().map(|part| part.0 * (part.1 - mean).powi(2)).sum::<f64>() / (freedom * frames);
    let error = (variance / judge.mean.powi(2) + judge.facts.mean_error.powi(2)).sqrt();
    let half = if freedom > 0.0 { crate::margin::student(freedom) * error } else { f64::NAN };
    let value = mean / judge.mean - 1.0;
    let samples = parts.iter().map(|part| part.1 / judge.mean - 1.0).collect();
    Quantity { value, low: value - half, high: value + half, samples }
}

/// Relative variance of one frame: what a picture says of itself, over what the reference says is there.
fn relative_variance(moments: &[Moments], judge: &Judge) -> f64 {
    let n = moments.first().map_or(0.0, |m| f64::from(m.count));
    let squares = moments.iter().flat_map(|m| m.deviation).map(|d| f64::from(d) / (n - 1.0));
    if n < 2.0 { f64::NAN } else { judge.weighted(squares) }
}

/// Runs all methods in turns, frame by frame, each with the same time, so that what else the machine does hits all alike;
/// judges them at each of `times_s`.
pub(super) fn measure(
    target: &Target,
    methods: &[Method],
    judge: &Judge,
    times_s: &[f64],
    seeds: u32,
    backend: &Backend<'_>,
    halt: &Halt<'_>,
) -> Result<(Vec<MethodResults>, Vec<Shown>), RenderError> {
    let yardstick = Yardstick::new();
    let mut gathered: Vec<Gathered> = methods.iter().map(|_| Gathered::default()).collect();
    let mut pictures = Vec::new();
    for seed in 0..seeds {
        let mut runs = Vec::new();
        for (index, method) in methods.iter().enumerate() {
            let request = crate::render::Request { seed, ..target.request(method) };
            let facts = facts_of(&target.packed, target.width, target.height, &method.settings);
            let outputs = &["moments"];
            let plan = direct_light(method.technique, &method.settings, &facts, ToneCurve::default(), outputs)?;
            let scene = target.packed.buffers();
            let executor = Executor::new(backend, &plan, scene)?;
            gathered[index].frame_bytes = plan.frame_bytes();
            let frame = frame_of(&target.packed, &request);
            let (times, points, totals) = (FrameTimes::default(), Vec::new(), Vec::new());
            runs.push(Run { method: index, executor, plan, scene, frame, spent_s: 0.0, times, points, totals });
        }
        // The one that has had the least time goes next.
        while let Some(run) = runs
            .iter_mut()
            .filter(|run| run.points.len() < times_s.len())
            .min_by(|a, b| a.spent_s.total_cmp(&b.spent_s))
        {
            run.step(&yardstick)?;
            let mut last = None;
            // A long frame may pass several points.
            while times_s.get(run.points.len()).is_some_and(|time| run.spent_s >= *time) {
                last = Some(run.judge(judge)?);
            }
            let is_last_point = run.points.len() == times_s.len();
            if let Some(picture) = last.filter(|_| is_last_point && seed == 0) {
                pictures.push(Shown { method: methods[run.method].name.clone(), time_s: run.spent_s, picture });
            }
            if halt.reason().is_some() {
                break;
            }
        }
        for mut run in runs {
            let moments = run.moments()?;
            let of = &mut gathered[run.method];
            of.parts.extend(run.parts());
            of.variances.push(relative_variance(&moments, judge));
            of.points.push(std::mem::take(&mut run.points));
            of.times.join(run.times);
        }
        if halt.reason().is_some() {
            break;
        }
    }
    pictures.sort_by_key(|shown| methods.iter().position(|method| method.name == shown.method));
    let results = methods.iter().zip(gathered).map(|(method, gathered)| gathered.results(method, target, judge));
    Ok((results.collect(), pictures))
}

impl Gathered {
    fn results(self, method: &Method, target: &Target, judge: &Judge) -> MethodResults {
        let most = self.points.iter().map(Vec::len).max().unwrap_or(0);
        let at = |i: usize| self.points.iter().filter_map(|run| run.get(i)).collect::<Vec<_>>();
        let points: Vec<Point> = (0..most).map(|i| point_of(&at(i))).collect();
        let efficiency = points.last().map_or(f64::NAN, |p| 1.0 / (p.rel_mse.value * p.time_s));
        let variances = self.variances.into_iter().filter(|v| v.is_finite()).collect();
        MethodResults {
            efficiency: if efficiency > 0.0 { efficiency } else { f64::NAN },
            relative_variance: Quantity::median(variances),
            bias: bias(&self.parts, judge),
            points,
            frame_bytes: self.frame_bytes,
            ..self.times.results(method, target)
        }
    }
}
