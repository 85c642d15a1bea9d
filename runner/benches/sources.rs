//! What each source of candidates costs: `cargo bench --bench sources -- [SCENE.obj CAMERA.json] [--curve]`.
//!
//! On the CPU at 320x180, frames in turns, medians of 9. For each scene (`rooms`, `park`, and one from a file if it is
//! named): time to build and to update, memory a light, time for drawing ahead, and time a sample; and what it takes to keep
//! candidates in memory instead of streaming them. With `--curve` also the
//! time of a frame in real time for 100 to 3.4 million lights in `park`.

mod common;

use std::{
    path::Path,
    time::{Duration, Instant},
};

use common::{Failure, median_ms, settings};
use weir::{
    bench::lights::with_lights,
    executor::cpu::CpuExecutor,
    graph::Plan,
    packed::{LightCost, LightCosts, Moment, PackOptions, PackedScene, TreeUpdate},
    render::{Request, facts_of, frame_of},
    scene::{
        Camera, Scene, builtin, camera,
        load::{self, LoadOptions},
    },
    sequence::Sequence,
    technique::{Technique, direct_light},
};
use weir_shared::{
    frame::{Frame, FramePair},
    presample::LightRecord,
};

/// Frames that count, after as many that don't.
const FRAMES: usize = 9;
const SIZE: [u32; 2] = [320, 180];
/// Samples of a pixel by which the time of one is found.
const SAMPLES: u32 = 32;

const SOURCES: [&str; 6] = ["uniform", "power", "tiles", "cells", "tree", "cuts"];

/// Independent frames without reuse, of one source.
struct Ris {
    source: &'static str,
    plan: Plan,
    executor: CpuExecutor,
    frame: Frame,
    passes: Vec<Vec<(&'static str, Duration)>>,
}

impl Ris {
    fn new(packed: &PackedScene, camera: Camera, source: &'static str) -> Result<Self, Failure> {
        Self::with(packed, camera, source, SAMPLES, "threshold")
    }

    fn with(
        packed: &PackedScene,
        camera: Camera,
        source: &'static str,
        samples: u32,
        choice: &str,
    ) -> Result<Self, Failure> {
        let (count, from) = (format!("candidates.count={samples}"), format!("candidates.source={source}"));
        let choice = format!("reservoirs.choice={choice}");
        let settings =
            settings(&[&count, &from, &choice, "candidates.tree=0", "candidates.bsdf=0", "skip.presampling=off"])?;
        let request = Request { seed: 1, ..Request::new(camera, SIZE, Technique::Candidates, settings) };
        let facts = facts_of(packed, request.width, request.height, &request.settings);
        let plan = direct_light(request.technique, &request.settings, &facts, request.curve, &["fresh"])?;
        let frame = frame_of(packed, &request);
        Ok(Self { source, executor: CpuExecutor::new(&plan), plan, frame, passes: Vec::new() })
    }

    fn step(&mut self, packed: &PackedScene) {
        let pair = FramePair { now: self.frame, prev: self.frame };
        self.passes.push(self.executor.run(&self.plan, packed.buffers(), &pair));
        self.frame.index += 1;
    }

    /// Median of the passes whose names start so, in milliseconds.
    fn pass_ms(&self, name: &str) -> f64 {
        median_ms(
            self.passes[FRAMES..]
                .iter()
                .map(|frame| frame.iter().filter(|(pass, _)| pass.starts_with(name)).map(|(_, time)| *time).sum()),
        )
    }
}

/// Packed for all sources.
fn packed(scene: &Scene) -> Result<PackedScene, Failure> {
    let options = PackOptions { light_cuts: true, ..PackOptions::default() };
    Ok(PackedScene::with(scene, &Moment::default(), options)?)
}

/// What a source draws from.
fn structure(source: &str, costs: &LightCosts) -> LightCost {
    match source {
        "uniform" => LightCost::default(),
        "tree" => costs.tree,
        "cuts" => costs.cuts,
        _ => costs.table,
    }
}

fn costs(name: &str, scene: &Scene, camera: Camera) -> Result<(), Failure> {
    let mut packed = packed(scene)?;
    // As if all of it moved.
    packed.keeps_still = false;
    let lights = f64::from(packed.frame.light_count);
    let mut updates = Vec::new();
    let mut refits = Vec::new();
    for i in 0..FRAMES {
        for (update, found) in [(TreeUpdate::Rebuild, &mut updates), (TreeUpdate::Refit, &mut refits)] {
            packed.tree_update = Some(update);
            packed.show_anew(&Moment { time_s: i as f32 / 60.0, ..Moment::default() })?;
            found.push(packed.light_costs);
        }
    }
    let update = |source: &str| median_ms(updates.iter().map(|costs| structure(source, costs).update));
    let mut all = Vec::new();
    for source in SOURCES {
        all.push(Ris::new(&packed, camera, source)?);
    }
    for _ in 0..2 * FRAMES {
        all.iter_mut().for_each(|ris| ris.step(&packed));
    }
    println!("\n{name}, {lights} emissive triangles, {} emitters", packed.frame.emitter_count);
    println!("| source | build, ms | update, ms | bytes a light | drawn ahead, ms a frame | ns a sample |");
    println!("|---|---|---|---|---|---|");
    let refit = median_ms(refits.iter().map(|costs| costs.tree.update));
    for ris in &all {
        let cost = structure(ris.source, &packed.light_costs);
        let records = u64::from(ris.frame.presampled_columns) * u64::from(ris.frame.presampled_rows);
        let drawn_ahead = if records > 1 { records * size_of::<LightRecord>() as u64 } else { 0 };
        let samples = f64::from(SIZE[0] * SIZE[1] * SAMPLES);
        println!(
            "| {} | {:.2} | {:.2} | {:.1} | {:.1} | {:.0} |",
            ris.source,
            cost.build.as_secs_f64() * 1e3,
            update(ris.source),
            (cost.bytes + drawn_ahead) as f64 / lights,
            ris.pass_ms("presample") + ris.pass_ms("light_cuts"),
            ris.pass_ms("candidates") * 1e6 / samples,
        );
    }
    println!("update of the tree by refitting: {refit:.2} ms");
    Ok(())
}

/// Candidates that are streamed against those that stay in memory.
fn streams_and_memory(name: &str, scene: &Scene, camera: Camera) -> Result<(), Failure> {
    let packed = packed(scene)?;
    let mut all = Vec::new();
    for (samples, choice) in [(4, "threshold"), (4, "inversion"), (32, "threshold"), (32, "inversion")] {
        all.push((samples, choice, Ris::with(&packed, camera, "power", samples, choice)?));
    }
    for _ in 0..2 * FRAMES {
        all.iter_mut().for_each(|(.., ris)| ris.step(&packed));
    }
    println!("\n{name}, by power\n\n| candidates | choice | bytes a pixel | ms a frame |\n|---|---|---|---|");
    for (samples, choice, ris) in &all {
        // Beside the surface that candidates are for, in every plan.
        let kept = ["resident", "fresh"].iter().filter_map(|name| ris.plan.output_bytes(name)).sum::<usize>();
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        let ms = ris.pass_ms("candidates") + ris.pass_ms("resident");
        println!("| {samples} | {choice} | {} | {ms:.1} |", kept / pixels);
    }
    Ok(())
}

/// Time of a frame in real time against lights, for each source alone and for the default.
fn curve(park: &Scene, camera: Camera) -> Result<(), Failure> {
    let counts = [100, 1000, 10_000, 100_000, 1_000_000, u64::MAX];
    let scenes: Vec<Scene> = counts.iter().map(|&count| with_lights(park, count)).collect();
    let mut knobs: Vec<[String; 2]> =
        SOURCES.iter().map(|source| [format!("candidates.source={source}"), "candidates.tree=0".to_owned()]).collect();
    knobs.push(["candidates.source=power".to_owned(), "candidates.tree=3".to_owned()]);
    println!("\npark, ms a frame in real time");
    print!("| lights |");
    knobs.iter().for_each(|knobs| print!(" {} |", knobs.join(" ")));
    println!("\n|---|{}", "---|".repeat(knobs.len()));
    for scene in &scenes {
        let mut copies: Vec<PackedScene> = knobs.iter().map(|_| packed(scene)).collect::<Result<_, _>>()?;
        let lights = copies[0].frame.light_count;
        let mut chains = Vec::new();
        for (packed, knobs) in copies.iter_mut().zip(&knobs) {
            let settings = settings(&[&knobs[0], &knobs[1]])?;
            let request = Request { seed: 1, ..Request::new(camera, SIZE, Technique::RealTime, settings) };
            let facts = facts_of(packed, request.width, request.height, &request.settings);
            let plan = direct_light(request.technique, &request.settings, &facts, request.curve, &["display"])?;
            chains.push((CpuExecutor::new(&plan), plan, Sequence::new(packed, request), Vec::new()));
        }
        for count in 0..2 * FRAMES as u32 {
            for (executor, plan, sequence, times) in &mut chains {
                let start = Instant::now();
                let (frames, _) = sequence.next(&sequence.shot(count))?;
                executor.run(plan, sequence.packed().buffers(), &frames);
                times.push(start.elapsed());
            }
        }
        print!("| {lights} |");
        chains.iter().for_each(|chain| print!(" {:.0} |", median_ms(chain.3[FRAMES..].iter().copied())));
        println!();
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let files: Vec<&String> = arguments.iter().filter(|a| !a.starts_with("--")).collect();
    println!("{}x{}, {} threads, medians of {FRAMES} frames in turns", SIZE[0], SIZE[1], rayon::current_num_threads());
    for name in ["rooms", "park"] {
        let scene = (builtin::find(name).ok_or("a built-in scene is gone")?.build)();
        let camera = scene.camera.ok_or("it suggests no camera")?;
        costs(name, &scene, camera)?;
        if name == "rooms" {
            streams_and_memory(name, &scene, camera)?;
        }
        if name == "park" && arguments.iter().any(|a| a == "--curve") {
            curve(&scene, camera)?;
        }
    }
    if files.len() == 1 {
        return Err("a scene from a file needs a camera file after it".into());
    }
    if let [scene, camera] = files[..] {
        let loaded = load::load(Path::new(scene), &LoadOptions::default())?;
        costs(&loaded.scene.name, &loaded.scene, camera::load(Path::new(camera))?)?;
    }
    Ok(())
}
