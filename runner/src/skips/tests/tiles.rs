use glam::{Vec3, Vec4};
use weir_shader::{
    PASSES, kernel,
    wiring::{Band, Buffers, Extent, Kernel, Pass},
};
use weir_shared::{
    frame::FramePair,
    surface::Surface,
    tiles::{BLOCK, Tiling},
};

use super::{bright_sky, built_in, settings};
use crate::{
    executor::cpu::{CpuExecutor, Order},
    packed::{Moment, PackOptions, PackedScene},
    render::{Request, facts_of},
    scene::{Camera, Scene},
    sequence::Sequence,
    technique::{Technique, ToneCurve, direct_light_with, passes_with_one},
};

/// A box seen from outside, with walls around it that are sky: pixels that are settled, sky, or neither, each in tiles of
/// their own and beside each other.
fn from_outside() -> (Scene, Camera) {
    let cornell = built_in("cornell");
    let mut camera = cornell.camera.expect("a camera");
    camera.origin += (camera.origin - camera.target).normalize() * 1.5;
    (cornell, camera)
}

/// What is drawn, and how.
#[derive(Clone, Copy)]
struct Drawing<'a> {
    scene: &'a Scene,
    camera: Camera,
    passes: &'static [Pass],
    technique: Technique,
    knobs: &'a [&'a str],
    size: [u32; 2],
}

impl Drawing<'_> {
    /// The moments of the third frame of a moving camera, and how many tiles were listed; with memory full of ones before
    /// each frame if `poisons`.
    fn draw(&self, rule: &str, order: Order, poisons: bool) -> (Vec<u8>, Option<u32>) {
        let &Self { scene, camera, passes, technique, knobs, size: [width, height] } = self;
        let mut settings = settings(knobs);
        settings.apply(&format!("skip.tiles={rule}")).expect("a knob");
        let options = PackOptions::of(&settings);
        let mut packed = PackedScene::with(scene, &Moment::default(), options).expect("it fits");
        let facts = facts_of(&packed, width, height, &settings);
        let outputs: &[&str] = if rule == "on" { &["moments", "tiles"] } else { &["moments"] };
        let plan = direct_light_with(passes, technique, &settings, &facts, ToneCurve::default(), outputs);
        let plan = plan.expect("a frame");
        let mut executor = CpuExecutor::new(&plan);
        executor.order = order;
        let mut sequence = Sequence::new(&mut packed, Request::new(camera, [width, height], technique, settings));
        for number in 0..3 {
            let mut shot = sequence.shot(number);
            shot.camera.origin += Vec3::X * 0.05 * number as f32;
            let (mut frames, _) = sequence.next(&shot).expect("a frame");
            if technique != Technique::RealTime {
                frames.now.accumulated = number;
            }
            if poisons {
                executor.poison();
            }
            executor.run(&plan, sequence.packed().buffers(), &frames);
        }
        let listed = executor.output(&plan, "tiles").map(|list| bytemuck::cast_slice::<u8, u32>(list)[0]);
        (executor.output(&plan, "moments").expect("an output").to_vec(), listed)
    }
}

/// Of tiles without work nothing is written, and whatever is there is read by none: pictures with memory full of ones
/// before each frame, in any order, are those of memory full of zeros and of all tiles.
#[test]
fn what_is_left_unwritten_in_tiles_without_work_is_never_read() {
    let (cornell, camera) = from_outside();
    let mut lit = cornell.clone();
    lit.environment = Some(bright_sky());
    for scene in [&cornell, &lit] {
        for (technique, knobs, [width, height]) in [
            (Technique::RealTime, &[] as &[&str], [100, 60]),
            (Technique::RealTime, &["rays=quality", "reservoirs.count=2", "reuse.rule=paired"], [100, 60]),
            (Technique::RealTime, &["camera.jitter=off", "preset=paper", "spatial.rounds=2"], [100, 60]),
            (Technique::RealTime, &["reuse.resolution=checkerboard", "spatial.rounds=1", "rays=speed"], [100, 60]),
            (Technique::Still, &["reuse.mis=balance"], [100, 60]),
            (Technique::Candidates, &["reservoirs.choice=inversion", "reservoirs.count=2"], [100, 60]),
            // Tiles of four blocks.
            (Technique::Candidates, &["candidates.count=1"], [1003, 603]),
        ] {
            let tiles = Tiling::new(width, height).count();
            let drawing = Drawing { scene, camera, passes: PASSES, technique, knobs, size: [width, height] };
            let (expected, _) = drawing.draw("off", Order::default(), false);
            for (order, poisons) in [
                (Order::default(), false),
                (Order::default(), true),
                (Order { band_rows: 3, backwards: true }, true),
                (Order { band_rows: 60, backwards: false }, true),
            ] {
                let (picture, listed) = drawing.draw("on", order, poisons);
                let listed = listed.expect("an output");
                assert!((1..tiles).contains(&listed), "{technique}, {knobs:?}: {listed} tiles of {tiles}");
                assert!(picture == expected, "{technique}, {knobs:?}, {order:?}, {poisons}");
            }
        }
    }
}

/// A bug: a block is busy if its first pixel is.
fn by_the_first_pixel(frames: &FramePair, band: Band, mut buffers: Buffers) {
    let surfaces: &[Surface] = buffers.read();
    let busy: &mut [u32] = buffers.write();
    band.for_each(Extent::Blocks, &frames.now, &[], |i, block, _| {
        let first = surfaces[frames.now.index_of(block * BLOCK) as usize];
        busy[i] = u32::from(!first.is_settled());
    });
}

/// A bug: shading takes the sums over inputs of every pixel.
fn shade_all(frames: &FramePair, band: Band, mut buffers: Buffers) {
    let [emitted, gathered]: [&[Vec4]; 2] = [buffers.read(), buffers.read()];
    let emitted: Vec<Vec4> = emitted.iter().map(|e| e.truncate().extend(1.0)).collect();
    let reads = [bytemuck::cast_slice(&emitted), bytemuck::cast_slice(gathered)];
    kernel::shade_sum::main(frames, band, Buffers::new(&reads, &mut [buffers.write::<u8>()]));
}

/// The comparison has teeth.
#[test]
fn every_bug_planted_in_tiles_is_seen() {
    let (cornell, camera) = from_outside();
    let drawing = |passes| Drawing {
        scene: &cornell,
        camera,
        passes,
        technique: Technique::RealTime,
        knobs: &["rays=quality"],
        size: [100, 60],
    };
    let (expected, _) = drawing(PASSES).draw("off", Order::default(), false);
    let (picture, _) = drawing(PASSES).draw("on", Order::default(), true);
    assert!(picture == expected);
    for (what, name, kernel) in [
        ("blocks go by their first pixel", "tiles_blocks", by_the_first_pixel as Kernel),
        ("shading takes what was never written", "shade_sum", shade_all),
    ] {
        let (picture, _) = drawing(passes_with_one(name, kernel)).draw("on", Order::default(), true);
        assert!(picture != expected, "{what}: unseen");
    }
}
