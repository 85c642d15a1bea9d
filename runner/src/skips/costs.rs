//! What leaving work out saves, measured.

use std::time::Instant;

use bytemuck::bytes_of;
use weir_shared::moments::Moments;

use super::{Rule, Skips};
use crate::{
    packed::PackedScene,
    render::{Backend, Executor, RenderError, Request, facts_of},
    sequence::Sequence,
    settings::Settings,
    technique::{Technique, direct_light},
};

/// Frames of a turn; the first, after a cut, is not timed.
const FRAMES: u32 = 4;

/// What a frame costs with some of the rules.
#[derive(Clone, Debug, PartialEq)]
pub struct Cost {
    /// Which are on.
    pub skips: Skips,
    /// Median time of a frame, moving the scene and uploading included.
    pub frame_ms: f64,
    /// Bytes of all buffers of the frame, the scene's apart.
    pub frame_bytes: u64,
    /// Pixels of the last picture that differ in some bit from that of all rules off.
    pub different: usize,
}

/// Measures frames of the request's technique without any rule, with each alone, and with all, in this order: `turns` times
/// each, in turns, so that what else a machine does slows all alike.
///
/// # Errors
/// If the size is refused, the scene can't be shown at some time or the GPU fails.
pub fn costs(
    packed: &mut PackedScene,
    request: &Request,
    backend: &Backend<'_>,
    turns: u32,
) -> Result<Vec<Cost>, RenderError> {
    let alone = Rule::ALL.into_iter().map(|rule| Skips::none().with(rule, true));
    let ways: Vec<Skips> = [Skips::none()].into_iter().chain(alone).chain([Skips::default()]).collect();
    let mut times = vec![Vec::new(); ways.len()];
    let mut bytes = vec![0; ways.len()];
    let mut pictures: Vec<Vec<Moments>> = vec![Vec::new(); ways.len()];
    for turn in 0..turns {
        for (way, skips) in ways.iter().enumerate() {
            let settings = Settings { skips: *skips, ..request.settings.clone() };
            let facts = facts_of(packed, request.width, request.height, &settings);
            let plan = direct_light(request.technique, &settings, &facts, request.curve, &["moments"])?;
            let mut executor = Executor::new(backend, &plan, packed.buffers())?;
            let mut sequence = Sequence::new(&mut *packed, Request { settings, ..request.clone() });
            sequence.start_at(turn * FRAMES);
            for number in 0..FRAMES {
                let start = Instant::now();
                let (frames, changed) = match request.technique {
                    Technique::RealTime => sequence.next(&sequence.shot(number))?,
                    Technique::Still | Technique::Candidates => {
                        let request = sequence.request.clone();
                        (sequence.independent(&request, number), Vec::new())
                    }
                };
                let scene = sequence.packed().buffers();
                executor.update(scene, changed)?;
                executor.run(&plan, scene, &frames)?;
                executor.finish()?;
                if number > 0 {
                    times[way].push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
            bytes[way] = plan.frame_bytes();
            pictures[way] = executor.read(&plan, "moments")?.elements().to_vec();
        }
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let of = |(way, skips): (usize, Skips)| Cost {
        skips,
        frame_ms: median(&mut times[way]),
        frame_bytes: bytes[way],
        different: pictures[way].iter().zip(&pictures[0]).filter(|(a, b)| bytes_of(*a) != bytes_of(*b)).count(),
    };
    Ok(ways.into_iter().enumerate().map(of).collect())
}
