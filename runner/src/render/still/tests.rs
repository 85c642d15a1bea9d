use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};

use super::*;

const PIXELS: usize = 24;

/// Frames of a few pixels that are black but for one in ten, which has ten times the mean: the noise that a mean of few of
/// them seems to have depends on the mean.
struct Sparks {
    rng: Pcg64Mcg,
    moments: Vec<PixelMoments>,
    frames: u32,
    /// Frames of pilots.
    discarded: u32,
}

impl Sparks {
    fn new(seed: u64) -> Self {
        Self {
            rng: Pcg64Mcg::seed_from_u64(seed),
            moments: vec![PixelMoments::default(); PIXELS],
            frames: 0,
            discarded: 0,
        }
    }

    fn mean(&self) -> f64 {
        self.moments.iter().map(|m| m.mean[0]).sum::<f64>() / PIXELS as f64
    }
}

impl Frames for Sparks {
    fn restart(&mut self, _pilot: bool) {
        self.discarded += self.frames;
        self.frames = 0;
        self.moments.fill(PixelMoments::default());
    }

    fn add(&mut self, _most: u32) -> Result<u32, RenderError> {
        self.frames += 1;
        let n = f64::from(self.frames);
        for m in &mut self.moments {
            let value = if self.rng.next_u64().is_multiple_of(10) { 10.0 } else { 0.0 };
            for c in 0..3 {
                let apart = value - m.mean[c];
                m.mean[c] += apart / n;
                m.deviation[c] += apart * (value - m.mean[c]);
            }
        }
        Ok(1)
    }

    fn finish(&mut self) -> Result<(), RenderError> {
        Ok(())
    }

    fn show(&mut self, frames: u32, batches: &mut Batches) -> Result<(), RenderError> {
        batches.add(frames, |pixel| self.moments[pixel]);
        Ok(())
    }

    fn moments(&mut self) -> Result<Vec<PixelMoments>, RenderError> {
        Ok(self.moments.clone())
    }
}

fn request(stop: Stop) -> Request {
    let camera = crate::scene::Camera { origin: Vec3::ZERO, target: Vec3::X, up: Vec3::Y, vfov_deg: 45.0 };
    let one = Request::new(camera, [PIXELS as u32, 1], Technique::Still, crate::settings::Settings::default());
    Request { stop, ..one }
}

/// Mean of many means, and how many standard errors it is from the true one.
fn deviation_of_mean(means: &[f64]) -> (f64, f64) {
    let n = means.len() as f64;
    let mean = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
    (mean, (mean - 1.0) / variance.sqrt())
}

const SEEDS: u64 = 12_000;

#[test]
fn the_mean_of_pictures_that_stop_at_an_error_is_unbiased() {
    let (mut means, mut frames, mut discarded) = (Vec::new(), 0, 0);
    for seed in 0..SEEDS {
        let mut sparks = Sparks::new(seed);
        let outcome = average(&mut sparks, &request(Stop::Error(0.4)), |_| true).expect("a picture");
        means.push(sparks.mean());
        frames += outcome.frames;
        discarded += sparks.discarded;
    }
    let (mean, sigmas) = deviation_of_mean(&means);
    println!("mean {mean:.5}, {sigmas:+.2} standard errors; {frames} frames kept, {discarded} of pilots");
    assert!(sigmas.abs() < 3.5, "mean {mean} is {sigmas} standard errors off");
}

/// The check above has teeth: pictures that go on until they look good enough are not.
#[test]
fn the_mean_of_pictures_that_stop_when_they_look_good_is_biased() {
    let stop_by_looks = |seed| {
        let mut sparks = Sparks::new(seed);
        let mut batches = Batches::new(PIXELS, None);
        loop {
            sparks.add(1).expect("a frame");
            if batches.due_in(sparks.frames) > 0 {
                continue;
            }
            sparks.show(sparks.frames, &mut batches).expect("moments");
            let margin = batches.margin(sparks.frames, &sparks.moments);
            if sparks.frames >= SHORTEST_PILOT && margin.is_some_and(|m| m.error <= 0.4) {
                return sparks.mean();
            }
        }
    };
    let (mean, sigmas) = deviation_of_mean(&(0..SEEDS).map(stop_by_looks).collect::<Vec<_>>());
    println!("mean {mean:.5}, {sigmas:+.2} standard errors");
    assert!(sigmas.abs() > 5.0, "mean {mean} is {sigmas} standard errors off");
}

#[test]
fn a_picture_reaches_the_error_that_was_asked_for_nearly_always_and_without_waste() {
    let mut reached = 0;
    let seeds = 200;
    for seed in 0..seeds {
        let mut sparks = Sparks::new(seed);
        let outcome = average(&mut sparks, &request(Stop::Error(0.1)), |_| true).expect("a picture");
        // Black nine times of ten and ten else: the variance of a frame is 9, of which the floor takes 1 %.
        let exact = 9.0 / 1.01 / 0.01;
        assert!(f64::from(outcome.frames) < 1.4 * exact, "{} frames", outcome.frames);
        assert!(f64::from(sparks.discarded) <= 0.3 * f64::from(outcome.frames), "{} discarded", sparks.discarded);
        reached += u32::from(f64::from(outcome.frames) >= exact);
    }
    println!("{reached} of {seeds} have enough frames");
    assert!(reached >= 180, "{reached} of {seeds}");
}

#[test]
fn who_interrupts_a_pilot_gets_its_mean() {
    let mut sparks = Sparks::new(1);
    let outcome = average(&mut sparks, &request(Stop::Error(1e-4)), |frames| frames < 5).expect("a picture");
    assert_eq!((outcome.frames, sparks.discarded), (5, 0));
}

#[test]
fn a_number_of_samples_is_kept_to_the_frame() {
    for n in [1, 2, 33] {
        let outcome = average(&mut Sparks::new(1), &request(Stop::Samples(n)), |_| true).expect("a picture");
        assert_eq!(outcome.frames, n);
    }
}

#[test]
fn a_still_is_tone_mapped_as_the_pass_does_it() {
    let scene = (crate::scene::builtin::find("cornell").expect("built in").build)();
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let (camera, settings) = (scene.camera.expect("it has one"), crate::settings::Settings::default());
    for curve in [ToneCurve::Clip, ToneCurve::Reinhard, ToneCurve::Aces, ToneCurve::Agx] {
        let one = Request::new(camera, [32, 24], Technique::Still, settings.clone());
        let request = Request { stop: Stop::Samples(3), curve, exposure: 1.7, ..one };
        let backend = Backend::Cpu(crate::executor::cpu::Order::default());
        let still = render(&packed, &request, &backend, |_| true).expect("a picture").display;
        let facts = facts_of(&packed, request.width, request.height, &request.settings);
        let plan = direct_light(request.technique, &request.settings, &facts, curve, &["display"]).expect("a plan");
        let mut executor = Executor::new(&backend, &plan, packed.buffers()).expect("it fits");
        let mut frame = frame_of(&packed, &request);
        for _ in 0..3 {
            executor.run(&plan, packed.buffers(), &FramePair { now: frame, prev: frame }).expect("a frame");
            (frame.index, frame.accumulated) = (frame.index + 1, frame.accumulated + 1);
        }
        let by_pass = executor.read(&plan, "display").expect("an output");
        // The mean of the still has what rounding cuts off from that of the pass: a step of a channel at most.
        for (a, b) in still.iter().zip(by_pass.elements::<u32>()) {
            let apart = a.to_le_bytes().iter().zip(b.to_le_bytes()).map(|(a, b)| a.abs_diff(b)).max();
            assert!(apart <= Some(1), "{curve:?}: {a:08x} {b:08x}");
        }
        assert!(still.iter().any(|pixel| pixel & 0x00ff_ffff != 0));
    }
}
