//! What leaving work out saves, measured.

use std::{
    collections::{HashMap, hash_map::Entry},
    time::Instant,
};

use bytemuck::bytes_of;
use weir_shared::moments::Moments;

use super::{Rule, Skips};
use crate::{
    packed::{Moment, PackOptions, PackedScene},
    render::{Backend, Executor, RenderError, Request, facts_of},
    scene::Scene,
    sequence::Sequence,
    settings::Settings,
    technique::{Technique, direct_light},
};

/// Frames of a turn; the first three are not timed: one after a cut, and those without which no frame sees what the last
/// two have seen.
const FRAMES: u32 = 6;
const NOT_TIMED: u32 = 3;

/// What a frame costs with some of the rules.
#[derive(Clone, Debug, PartialEq)]
pub struct Cost {
    /// Which are on.
    pub skips: Skips,
    /// Time to pack the scene, of one time.
    pub pack_ms: f64,
    /// Median time of a frame, moving the scene and uploading included.
    pub frame_ms: f64,
    /// Bytes of all buffers of the frame, the scene's apart.
    pub frame_bytes: u64,
    /// Bytes of the scene's buffers.
    pub scene_bytes: u64,
    /// Pixels of the last picture that differ in some bit from that of all rules off but for those that change what is
    /// drawn, which are on in both or in neither; `None` if one of them is on alone.
    pub different: Option<usize>,
}

impl Cost {
    /// Which rules are on, in words.
    pub fn name(&self) -> String {
        let on: Vec<Rule> = Rule::ALL.into_iter().filter(|rule| self.skips.is_on(*rule)).collect();
        match on.as_slice() {
            [] => "all off".to_owned(),
            [only] => format!("{} alone", only.name()),
            _ if self.skips == Skips::default() => "all on".to_owned(),
            some if some.iter().all(|rule| rule.changes_draws()) => "all that draw otherwise".to_owned(),
            some => some.iter().map(|rule| rule.name()).collect::<Vec<_>>().join(" and "),
        }
    }
}

/// What is measured with some of the rules.
#[derive(Default)]
struct Measured {
    times: Vec<f64>,
    frame_bytes: u64,
    picture: Vec<Moments>,
}

/// Measures frames of the request's technique without any rule, with each alone, with those that change what is drawn, and
/// with all, in this order: `turns` times each, in turns, so that what else a machine does slows all alike. Asks before
/// the scene is packed and before each turn of each whether to go on; `None` if not.
///
/// # Errors
/// If the size is refused, the scene can't be packed or shown at some time, or the GPU fails.
pub fn costs(
    scene: &Scene,
    request: &Request,
    backend: &Backend<'_>,
    turns: u32,
    mut goes_on: impl FnMut() -> bool,
) -> Result<Option<Vec<Cost>>, RenderError> {
    let none = Skips::none();
    let alone = Rule::ALL.into_iter().map(|rule| none.with(rule, true));
    let drawn =
        Rule::ALL.into_iter().filter(|rule| rule.changes_draws()).fold(none, |skips, rule| skips.with(rule, true));
    let ways: Vec<Skips> = [none].into_iter().chain(alone).chain([drawn, Skips::default()]).collect();
    let settings_of = |skips: Skips| Settings { skips, ..request.settings.clone() };
    let mut packed: HashMap<PackOptions, (PackedScene, f64)> = HashMap::new();
    for options in ways.iter().map(|skips| PackOptions::of(&settings_of(*skips))) {
        if let Entry::Vacant(place) = packed.entry(options) {
            if !goes_on() {
                return Ok(None);
            }
            let start = Instant::now();
            let moment = Moment { time_s: request.settings.time_s, ..Moment::default() };
            let scene = PackedScene::with(scene, &moment, options)?;
            place.insert((scene, start.elapsed().as_secs_f64() * 1e3));
        }
    }
    let mut measured: Vec<Measured> = ways.iter().map(|_| Measured::default()).collect();
    for turn in 0..turns {
        for (skips, measured) in ways.iter().zip(&mut measured) {
            if !goes_on() {
                return Ok(None);
            }
            let settings = settings_of(*skips);
            let (packed, _) = packed.get_mut(&PackOptions::of(&settings)).expect("packed for every way");
            measure(packed, Request { settings, ..request.clone() }, backend, turn, measured)?;
        }
    }
    let pictures: Vec<Vec<Moments>> = measured.iter_mut().map(|m| std::mem::take(&mut m.picture)).collect();
    let plain =
        |skips: Skips| Rule::ALL.into_iter().filter(|rule| !rule.changes_draws()).fold(skips, |s, r| s.with(r, false));
    let of = |(way, skips): (usize, Skips)| {
        let base = ways.iter().position(|other| *other == plain(skips)).filter(|base| *base != way || skips == none);
        let Measured { times, frame_bytes, .. } = &mut measured[way];
        times.sort_by(f64::total_cmp);
        let (packed, pack_ms) = &packed[&PackOptions::of(&settings_of(skips))];
        let is_other = |(a, b): &(&Moments, &Moments)| bytes_of(*a) != bytes_of(*b);
        Cost {
            skips,
            pack_ms: *pack_ms,
            frame_ms: times.get(times.len() / 2).copied().unwrap_or(f64::NAN),
            frame_bytes: *frame_bytes,
            scene_bytes: packed.bytes(),
            different: base.map(|base| pictures[way].iter().zip(&pictures[base]).filter(is_other).count()),
        }
    };
    Ok(Some(ways.iter().copied().enumerate().map(of).collect()))
}

/// One turn of frames.
fn measure(
    packed: &mut PackedScene,
    request: Request,
    backend: &Backend<'_>,
    turn: u32,
    measured: &mut Measured,
) -> Result<(), RenderError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let plan = direct_light(request.technique, &request.settings, &facts, request.curve, &["moments"])?;
    let mut executor = Executor::new(backend, &plan, packed.buffers())?;
    let mut sequence = Sequence::new(packed, request);
    sequence.start_at(turn * FRAMES);
    for number in 0..FRAMES {
        let start = Instant::now();
        let (frames, changed) = match sequence.request.technique {
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
        if number >= NOT_TIMED {
            measured.times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    measured.frame_bytes = plan.frame_bytes();
    measured.picture = executor.read(&plan, "moments")?.elements().to_vec();
    Ok(())
}
