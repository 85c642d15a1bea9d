//! Time per frame against the number of lights: `cargo bench --bench lights -- [FRAMES] [knobs ...]`.
//!
//! The park with its 3.4 million emissive triangles, and the same triangles in the same places of which only three on
//! each lamp post emit: 90 lights, more than there are candidates, so that they are drawn rather than enumerated. Both
//! chains on the CPU at 320x180, frame by frame in turns after some that don't count; medians of FRAMES (at least 15).
//! The time of a real-time frame includes that of moving the scene.

mod common;

use std::{
    f32::consts::TAU,
    time::{Duration, Instant},
};

use common::{Failure, median_ms, settings};
use glam::Vec3;
use weir::{
    executor::cpu::CpuExecutor,
    graph::Plan,
    packed::PackedScene,
    render::{Request, facts_of, frame_of},
    scene::{Material, Scene, builtin},
    sequence::Sequence,
    technique::{Technique, direct_light},
};
use weir_shared::{
    frame::{Frame, FramePair},
    moments::Moments,
};

/// Frames before those that count: caches fill, and the chain forgets its beginning.
const WARM_UP: usize = 20;

/// The same geometry, in which three triangles on each lamp post emit and nothing else does. They face down and outward,
/// a third of a turn apart, so that nearly as many pixels are lit.
fn with_few_lights(scene: &Scene) -> Result<Scene, Failure> {
    let mut few = scene.clone();
    let post = few.meshes.iter().position(|m| m.name == "lamp post").ok_or("the park has no mesh `lamp post`")?;
    let facing = |t: usize| {
        let [a, b, c] = scene.meshes[post].triangles[t].map(|v| scene.meshes[post].positions[v as usize]);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let emits = |t: &usize| scene.materials[scene.meshes[post].materials[*t] as usize].emission != Vec3::ZERO;
    let lit = (0..3).map(|third| {
        let (z, x) = (third as f32 * TAU / 3.0).sin_cos();
        let wanted = Vec3::new(x, -0.5, z).normalize();
        let emissive = (0..scene.meshes[post].triangles.len()).filter(emits);
        emissive.max_by(|&a, &b| facing(a).dot(wanted).total_cmp(&facing(b).dot(wanted)))
    });
    let lit: Vec<usize> = lit.collect::<Option<_>>().ok_or("the lamp posts of the park don't emit")?;
    few.materials.iter_mut().for_each(|m| m.emission = Vec3::ZERO);
    for t in lit {
        let bright: Material = scene.materials[scene.meshes[post].materials[t] as usize].clone();
        few.meshes[post].materials[t] = few.materials.len() as u32;
        few.materials.push(bright);
    }
    Ok(few)
}

fn request(scene: &Scene, technique: Technique, knobs: &[&str]) -> Result<Request, Failure> {
    let settings = settings(knobs)?;
    let camera = scene.camera.ok_or("the park suggests no camera")?;
    Ok(Request { seed: 1, ..Request::new(camera, [320, 180], technique, settings) })
}

/// Where the next uniform comes from.
enum Frames<'a> {
    /// Independent frames of a scene that stands still.
    Still(&'a PackedScene, Box<Frame>),
    /// Frames that reuse each other, of a scene that moves.
    RealTime(Box<Sequence<&'a mut PackedScene>>),
}

struct Chain<'a> {
    plan: Plan,
    executor: CpuExecutor,
    frames: Frames<'a>,
    count: u32,
    times: Vec<Duration>,
    /// Of each frame, the time of each pass in the order of the plan.
    passes: Vec<Vec<(&'static str, Duration)>>,
}

impl<'a> Chain<'a> {
    fn new(packed: &'a mut PackedScene, request: &Request) -> Result<Self, Failure> {
        let facts = facts_of(packed, request.width, request.height, &request.settings);
        let outputs = &["moments", "display"];
        let plan = direct_light(request.technique, &request.settings, &facts, request.curve, outputs)?;
        let frames = if request.technique == Technique::RealTime {
            Frames::RealTime(Box::new(Sequence::new(packed, request.clone())))
        } else {
            let first = frame_of(packed, request);
            Frames::Still(packed, Box::new(first))
        };
        Ok(Self { executor: CpuExecutor::new(&plan), plan, frames, count: 0, times: Vec::new(), passes: Vec::new() })
    }

    /// One frame more.
    fn step(&mut self) -> Result<(), Failure> {
        let start = Instant::now();
        let passes = match &mut self.frames {
            Frames::Still(packed, frame) => {
                let passes =
                    self.executor.run(&self.plan, packed.buffers(), &FramePair { now: **frame, prev: **frame });
                frame.index += 1;
                frame.accumulated += 1;
                passes
            }
            Frames::RealTime(sequence) => {
                let shot = sequence.shot(self.count);
                let (frames, _) = sequence.next(&shot)?;
                self.executor.run(&self.plan, sequence.packed().buffers(), &frames)
            }
        };
        self.times.push(start.elapsed());
        self.passes.push(passes);
        self.count += 1;
        Ok(())
    }

    /// Median of the frames that count, in milliseconds.
    fn median_ms(&self) -> f64 {
        median_ms(self.times[WARM_UP..].iter().copied())
    }

    /// The passes of a frame, each with the median of its times in milliseconds; those that run several times as one.
    fn passes_ms(&self) -> Vec<(&'static str, f64)> {
        let mut names: Vec<&'static str> = Vec::new();
        for (name, _) in &self.passes[0] {
            if !names.contains(name) {
                names.push(name);
            }
        }
        let of =
            |name: &str, frame: &[(&'static str, Duration)]| frame.iter().filter(|p| p.0 == name).map(|p| p.1).sum();
        names
            .iter()
            .map(|name| (*name, median_ms(self.passes[WARM_UP..].iter().map(|frame| of(name, frame)))))
            .collect()
    }

    /// Share of the pixels of the last picture that are not black.
    fn lit(&self) -> f64 {
        let bytes = self.executor.output(&self.plan, "moments").unwrap_or_default();
        let moments: &[Moments] = bytemuck::cast_slice(bytes);
        moments.iter().filter(|m| m.mean() != Vec3::ZERO).count() as f64 / moments.len() as f64
    }
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let count = arguments.iter().find_map(|a| a.parse().ok()).unwrap_or(31usize).max(15);
    let knobs: Vec<&str> = arguments.iter().filter(|a| a.contains('=')).map(String::as_str).collect();
    let park = (builtin::find("park").ok_or("the park is gone")?.build)();
    let few = with_few_lights(&park)?;
    let (mut park_packed, mut few_packed) = (PackedScene::new(&park, 0.0)?, PackedScene::new(&few, 0.0)?);
    let lights = [&park_packed, &few_packed].map(|p| p.frame.light_count);
    println!("park, 320x180, {} threads, medians of {count} frames in turns", rayon::current_num_threads());
    println!("{:<10} {:>10} {:>10} {:>10} {:>10} {:>6}", "chain", "lights", "ms/frame", "lights", "ms/frame", "ratio");
    for technique in [Technique::RealTime, Technique::Still] {
        let request = request(&park, technique, &knobs)?;
        if request.settings.candidates >= lights[1] {
            return Err(
                format!("with {} candidates {} lights are enumerated", request.settings.candidates, lights[1]).into()
            );
        }
        let mut many = Chain::new(&mut park_packed, &request)?;
        let mut few = Chain::new(&mut few_packed, &request)?;
        for _ in 0..WARM_UP + count {
            many.step()?;
            few.step()?;
        }
        let (a, b) = (many.median_ms(), few.median_ms());
        let shares = [many.lit(), few.lit()].map(|share| share * 100.0);
        println!(
            "{:<10} {:>10} {a:>10.1} {:>10} {b:>10.1} {:>6.3}  ({:.0} % and {:.0} % of the pixels are lit)",
            technique.to_string(),
            lights[0],
            lights[1],
            a / b,
            shares[0],
            shares[1]
        );
        for ((name, a), (_, b)) in many.passes_ms().into_iter().zip(few.passes_ms()) {
            println!("  {name:<19} {a:>10.1} {:>10} {b:>10.1} {:>6.3}", "", a / b);
        }
    }
    Ok(())
}
