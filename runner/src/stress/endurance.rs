//! Many frames of one chain: whether anything drifts, sticks or grows.

use weir_shared::{
    frame::FramePair,
    reservoir::{MAX_CONFIDENCE, Reservoir},
};

use super::{Finding, Found, clip::Take, scenes};
use crate::{
    packed::{Moment, PackedScene},
    render::{Backend, Executor, RenderError, Request, facts_of},
    scene::Camera,
    sequence::{Sequence, Shot},
    settings::Settings,
    technique::{Technique, ToneCurve, direct_light},
};

/// Parts of a run whose means are compared.
const BLOCKS: u32 = 20;
/// Student's t for 18 degrees of freedom and a false alarm in 10,000, two-sided.
const MOST_T: f64 = 5.0;
/// Frames that a pixel may keep one sample for. By the confidence of all it merges with, a fresh sample takes its place with
/// probability 1/33 at least where all are alike: (32/33)^600 is 1e-8.
const LONGEST_HOLD: u32 = 600;
/// What memory may grow by from a tenth of a run to its end.
const MOST_GROWTH: u64 = 8 << 20;
/// Frames of one round of what moves.
const PERIOD: u32 = 100;

const SIZE: [u32; 2] = [12, 9];

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Nothing moves.
    Still,
    /// A lamp and the camera go round and round.
    Circling,
}

impl std::fmt::Display for Motion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if *self == Self::Still { "standing still" } else { "moving" })
    }
}

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Report {
    /// Frames.
    pub frames: u32,
    /// Mean of the picture over all frames, in each twentieth of them.
    pub blocks: Vec<f64>,
    /// Largest contribution weight that was stored.
    pub most_ucw: f32,
    /// Largest confidence, and what it may be.
    pub confidence: [u32; 2],
    /// Most frames for which a pixel has kept one sample.
    pub longest_hold: u32,
    /// Pixels of frames that were negative or not finite.
    pub unusable: u64,
    /// Pixels of frames for which a weight was dropped.
    pub faults: u64,
    /// Growth of the process's memory over the last nine tenths, in bytes, where the system tells.
    pub growth: Option<i64>,
    /// Mean of the reference and its standard error, of what stands still.
    pub reference: Option<[f64; 2]>,
}

impl Report {
    /// Mean over all frames, and its standard error from the spread of the blocks.
    pub fn mean(&self) -> [f64; 2] {
        let n = self.blocks.len() as f64;
        let mean = self.blocks.iter().sum::<f64>() / n;
        let variance = self.blocks.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / (n - 1.0);
        [mean, (variance / n).sqrt()]
    }

    /// Student's t of the slope of the blocks' means over time: the test of stationarity.
    pub fn trend(&self) -> f64 {
        let n = self.blocks.len() as f64;
        let middle = (n - 1.0) / 2.0;
        let [mean, _] = self.mean();
        let spread: f64 = (0..self.blocks.len()).map(|i| (i as f64 - middle).powi(2)).sum();
        let slope =
            self.blocks.iter().zip(0..).map(|(b, i)| (f64::from(i) - middle) * (b - mean)).sum::<f64>() / spread;
        let rest = self.blocks.iter().zip(0..).map(|(b, i)| (b - mean - slope * (f64::from(i) - middle)).powi(2));
        slope / (rest.sum::<f64>() / (n - 2.0) / spread).sqrt().max(1e-12 * mean.abs())
    }

    /// Whether all is as it should be.
    pub fn holds(&self) -> bool {
        let [mean, error] = self.mean();
        let z = self.reference.map(|[expected, its_error]| (mean - expected) / error.hypot(its_error));
        let held = self.longest_hold <= LONGEST_HOLD.min(self.frames / 2);
        let grew = self.growth.is_some_and(|bytes| bytes > MOST_GROWTH as i64);
        self.trend().abs() < MOST_T
            && z.is_none_or(|z| z.abs() < MOST_T)
            && self.confidence[0] <= self.confidence[1]
            && held
            && !grew
            && self.most_ucw.is_finite()
            && self.unusable + self.faults == 0
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [mean, error] = self.mean();
        write!(f, "{} frames, mean {mean:.5} +- {:.5}, trend t {:.1}", self.frames, 1.96 * error, self.trend())?;
        if let Some([expected, its_error]) = self.reference {
            write!(f, ", z {:.1} from the reference", (mean - expected) / error.hypot(its_error))?;
        }
        let [most, bound] = self.confidence;
        write!(f, ", W up to {:.3e}, c up to {most} of {bound}", self.most_ucw)?;
        write!(
            f,
            ", a sample kept for {} frames, {} unusable, {} faults",
            self.longest_hold, self.unusable, self.faults
        )?;
        if let Some(bytes) = self.growth {
            write!(f, ", memory {:+.1} MiB", bytes as f64 / f64::from(1 << 20))?;
        }
        Ok(())
    }
}

/// Memory of the process that is in use, in bytes.
fn resident_bytes() -> Option<u64> {
    let pages = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(pages.split(' ').nth(1)?.parse::<u64>().ok()? * 4096)
}

/// Runs frames of a chain; `progress` is told how many so far.
///
/// # Errors
/// If the GPU fails.
pub fn run(
    backend: &Backend<'_>,
    motion: Motion,
    frames: u32,
    mut progress: impl FnMut(u32),
) -> Result<Report, RenderError> {
    let scene = if motion == Motion::Still { scenes::lamps_over_floor() } else { scenes::variety() };
    let camera = scene.camera.expect("scenes of the list have a camera");
    let mut packed = PackedScene::new(&scene, 0.0)?;
    let [width, height] = SIZE;
    let (technique, settings, curve) = (Technique::RealTime, Settings::default(), ToneCurve::Clip);
    let facts = facts_of(&packed, width, height, &settings);
    let plan = direct_light(technique, &settings, &facts, curve, &["color", "reservoirs"])?;
    let mut executor = Executor::new(backend, &plan, packed.buffers())?;
    let request = Request { seed: 5, curve, ..Request::new(camera, SIZE, technique, settings) };
    let neighbors = (1 + request.settings.temporal_neighbors).max(request.settings.temporal_neighbors_unseen);
    let bound = (1 + request.settings.confidence_cap * neighbors).min(MAX_CONFIDENCE);
    let mut sequence = Sequence::new(&mut packed, request);
    let pixels = (width * height) as usize;
    let mut report = Report {
        frames,
        blocks: vec![0.0; BLOCKS as usize],
        most_ucw: 0.0,
        confidence: [0, bound],
        longest_hold: 0,
        unusable: 0,
        faults: 0,
        growth: None,
        reference: None,
    };
    let mut held = vec![((0, 0), 0u32); pixels];
    let mut memory = None;
    for i in 0..frames {
        let shot = shot(motion, i, &camera);
        let (pair, changed): (FramePair, _) = sequence.next(&shot)?;
        let buffers = sequence.packed().buffers();
        executor.update(buffers, changed)?;
        executor.run(&plan, buffers, &pair)?;
        let color = executor.read(&plan, "color")?;
        let color: &[[f32; 4]] = color.elements();
        let block = u64::from(i) * u64::from(BLOCKS) / u64::from(frames);
        report.blocks[block as usize] += color.iter().flat_map(|c| &c[..3]).map(|&x| f64::from(x)).sum::<f64>();
        report.unusable += color.iter().filter(|c| !c[..3].iter().all(|x| x.is_finite() && *x >= 0.0)).count() as u64;
        report.faults += color.iter().filter(|c| c[3] != 0.0).count() as u64;
        let reservoirs = executor.read(&plan, "reservoirs")?;
        for (reservoir, (kept, since)) in reservoirs.elements::<Reservoir>().iter().zip(&mut held) {
            report.confidence[0] = report.confidence[0].max(reservoir.confidence());
            report.most_ucw = if reservoir.ucw <= report.most_ucw { report.most_ucw } else { reservoir.ucw };
            let sample = (reservoir.light, reservoir.uv);
            if !reservoir.has_sample() || sample != *kept {
                (*kept, *since) = (sample, i);
            }
            report.longest_hold = report.longest_hold.max(i - *since);
        }
        if i == frames / 10 {
            memory = resident_bytes();
        }
        progress(i + 1);
    }
    report.growth = memory.zip(resident_bytes()).map(|(before, after)| after as i64 - before as i64);
    let samples = f64::from(frames / BLOCKS) * 3.0 * pixels as f64;
    report.blocks.iter_mut().for_each(|sum| *sum /= samples);
    if motion == Motion::Still {
        let take = Take { size: SIZE, ..Take::still(&scene, technique, &[]) };
        let total = take.judged(0, 1 << 14)?;
        let values = 3.0 * pixels as f64;
        report.reference = Some([total.mean / values, total.variance.sqrt() / values]);
    }
    Ok(report)
}

fn shot(motion: Motion, index: u32, camera: &Camera) -> Shot {
    if motion == Motion::Still {
        return Shot { moment: Moment::default(), camera: *camera };
    }
    let turn = (index % PERIOD) as f32 / PERIOD as f32;
    let (sine, cosine) = (core::f32::consts::TAU * turn).sin_cos();
    let origin = camera.origin + camera.up * (0.1 * sine) + (camera.target - camera.origin) * (0.05 * cosine);
    // The lamp of the scene goes round in four seconds.
    Shot { moment: Moment { time_s: 4.0 * turn, ..Moment::default() }, camera: Camera { origin, ..*camera } }
}

/// A run that is short enough for the list.
pub(super) fn short(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for (motion, frames) in [(Motion::Still, 4000), (Motion::Circling, 2000)] {
        let report = run(backend, motion, frames, |_| ())?;
        findings.push(Finding::new(report.holds(), report.to_string()).of(motion));
    }
    Ok(Finding::all(findings))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(block: impl Fn(u32) -> f64) -> Report {
        Report {
            frames: 4000,
            blocks: (0..BLOCKS).map(block).collect(),
            most_ucw: 1.0,
            confidence: [9, 33],
            longest_hold: 100,
            unusable: 0,
            faults: 0,
            growth: Some(0),
            reference: None,
        }
    }

    /// The tests have teeth: noise passes; a drift of half a standard deviation a block, a stuck sample, too much
    /// confidence and growing memory do not.
    #[test]
    fn what_drifts_sticks_or_grows_is_noticed() {
        let noise = |i: u32| 1.0 + 0.01 * (f64::from(weir_shared::rng::pcg4d(i, 0, 0, 0)[0]) / 4_294_967_296.0 - 0.5);
        assert!(report(noise).holds(), "{}", report(noise));
        assert!(!report(|i| noise(i) + 0.0015 * f64::from(i)).holds());
        assert!(!Report { longest_hold: 601, ..report(noise) }.holds());
        assert!(!Report { confidence: [34, 33], ..report(noise) }.holds());
        assert!(!Report { growth: Some(9 << 20), ..report(noise) }.holds());
        assert!(!Report { faults: 1, ..report(noise) }.holds());
        assert!(!Report { reference: Some([1.01, 1e-4]), ..report(noise) }.holds());
    }
}
