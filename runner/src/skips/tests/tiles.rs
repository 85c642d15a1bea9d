use glam::Vec3;
use weir_shared::tiles::Tiling;

use super::{bright_sky, built_in, settings};
use crate::{
    executor::cpu::{CpuExecutor, Order},
    packed::{Moment, PackOptions, PackedScene},
    render::{Request, facts_of},
    sequence::Sequence,
    technique::{Technique, ToneCurve, direct_light},
};

/// Of tiles without work nothing is written, and whatever is there is read by none: pictures with memory full of ones
/// before each frame, in any order, are those of memory full of zeros and of all tiles.
#[test]
fn what_is_left_unwritten_in_tiles_without_work_is_never_read() {
    // Pixels that are settled, sky, or neither, each in tiles of their own and beside each other.
    let cornell = built_in("cornell");
    let mut outside = cornell.camera.expect("a camera");
    outside.origin += (outside.origin - outside.target).normalize() * 1.5;
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
            let draw = |rule: &str, order: Order, poisons: bool| {
                let mut settings = settings(knobs);
                settings.apply(&format!("skip.tiles={rule}")).expect("a knob");
                let options = PackOptions::of(&settings);
                let mut packed = PackedScene::with(scene, &Moment::default(), options).expect("it fits");
                let facts = facts_of(&packed, width, height, &settings);
                let outputs: &[&str] = if rule == "on" { &["moments", "tiles"] } else { &["moments"] };
                let plan = direct_light(technique, &settings, &facts, ToneCurve::default(), outputs).expect("a frame");
                let mut executor = CpuExecutor::new(&plan);
                executor.order = order;
                let mut sequence =
                    Sequence::new(&mut packed, Request::new(outside, [width, height], technique, settings));
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
            };
            let (expected, _) = draw("off", Order::default(), false);
            for (order, poisons) in [
                (Order::default(), false),
                (Order::default(), true),
                (Order { band_rows: 3, backwards: true }, true),
                (Order { band_rows: 60, backwards: false }, true),
            ] {
                let (picture, listed) = draw("on", order, poisons);
                let listed = listed.expect("an output");
                assert!((1..tiles).contains(&listed), "{technique}, {knobs:?}: {listed} tiles of {tiles}");
                assert!(picture == expected, "{technique}, {knobs:?}, {order:?}, {poisons}");
            }
        }
    }
}
