//! Random numbers, and what the frame is made with.

use weir_shared::{
    fault,
    frame::Frame,
    light::ENVIRONMENT_BIT,
    moments::Moments,
    reservoir::Reservoir,
    rng::{Rng, Stage, pcg4d},
};

use super::{
    Case, Check, Finding, Found,
    clip::{Clip, Take},
    scenes,
    statistics::misfit,
    worlds::{
        ROUNDING,
        random::{furthest_from_double, worst_of},
    },
};
use crate::{render::Backend, technique::Technique};

pub(super) const CASES: &[Case] = &[
    Case {
        number: 62,
        name: "seeds 0 and 2^32 - 1, frame numbers that wrap",
        expected: "uniform and uncorrelated numbers, no frame twice",
        checks: &[Check::Host(hashes), Check::Frames(wrapping_frames)],
    },
    Case {
        number: 63,
        name: "1, 2 and 16 threads",
        expected: "the same bits, and again when repeated",
        checks: &[Check::Frames(threads)],
    },
    Case {
        number: 64,
        name: "random numbers of candidates against those of choices",
        expected: "independent; all ways of choosing have the mean of the reference",
        checks: &[Check::Host(independent_stages), Check::Frames(ways_of_choosing)],
    },
    Case {
        number: 65,
        name: "the core in f32 against f64, 100,000 merges",
        expected: "the same samples, weights within 1e-5",
        checks: &[Check::Host(single_and_double)],
    },
    Case {
        number: 66,
        name: "a million random worlds of four lights, enumerated in f64",
        expected: "every mean right to 1e-12, all numbers finite",
        checks: &[Check::Host(random_worlds)],
    },
    Case {
        number: 67,
        name: "a reservoir that makes no sense among those of the frame before",
        expected: "for all pixels, itself included, one without a sample, bit by bit",
        checks: &[Check::Frames(poisoned)],
    },
    Case {
        number: 68,
        name: "2^20 frames of 0.1",
        expected: "the mean right to 1e-9",
        checks: &[Check::Host(accumulation)],
    },
];

/// Pearson's statistic of pairs of numbers on a grid of 16 by 16, as a share of what noise allows.
fn pairs(pair: impl Fn(u32) -> [u32; 2]) -> f64 {
    const COUNT: u32 = 1 << 16;
    let mut counts = vec![0.0; 256];
    (0..COUNT).for_each(|i| {
        let [a, b] = pair(i).map(|x| (x >> 28) as usize);
        counts[16 * a + b] += 1.0;
    });
    misfit(&counts, &[f64::from(COUNT) / 256.0; 256])
}

fn hashes() -> Finding {
    let mut worst = 0.0f64;
    for seed in [0, u32::MAX] {
        for lane in 0..4 {
            let at = |pixel: u32, frame: u32, dimension: u32| pcg4d(pixel, seed, frame, dimension)[lane];
            let laws = [
                pairs(|i| [at((i & 255) | ((i >> 8) << 16), 0, 7), at(((i & 255) + 1) | ((i >> 8) << 16), 0, 7)]),
                pairs(|i| {
                    [at(5, u32::MAX - 1000 + i.min(999), i), at(5, (u32::MAX - 1000 + i.min(999)).wrapping_add(1), i)]
                }),
                pairs(|i| [at(5, i.wrapping_sub(1 << 15), 7), at(5, i.wrapping_sub((1 << 15) - 1), 7)]),
                pairs(|i| [at(5, 3, i), at(5, 3, i + 1)]),
                pairs(|i| [at(i, 3, 7), pcg4d(i, seed.wrapping_add(1), 3, 7)[lane]]),
            ];
            worst = laws.into_iter().fold(worst, f64::max);
        }
    }
    Finding::new(worst < 1.0, format!("worst of 40 laws at {worst:.2} of the chi-square that noise allows"))
}

fn wrapping_frames(backend: &Backend<'_>) -> Found {
    let scene = scenes::lamps_over_floor();
    let mut clip = Clip::new(backend, &Take::still(&scene, Technique::Still, &[]))?;
    let mut seen: Vec<Vec<[f32; 4]>> = Vec::new();
    for seed in [0, u32::MAX] {
        for index in [u32::MAX - 1, u32::MAX, 0, 1, 1 << 31] {
            clip.show(0, |frames| (frames.now.seed, frames.now.index) = (seed, index))?;
            seen.push(clip.output("color")?);
        }
    }
    let same = (0..seen.len()).flat_map(|i| (0..i).map(move |j| (i, j))).filter(|&(i, j)| seen[i] == seen[j]).count();
    let finite = seen.iter().flatten().flatten().all(|x| x.is_finite());
    Ok(Finding::new(same == 0 && finite, format!("{same} of 45 pairs of frames are equal")))
}

fn threads(backend: &Backend<'_>) -> Found {
    let scene = scenes::variety();
    let take = Take { size: [33, 21], ..Take::still(&scene, Technique::RealTime, &[]) };
    let mut pictures: Vec<Vec<[u32; 4]>> = Vec::new();
    for threads in [1, 2, 16, 2] {
        let mut draw = || -> Result<(), crate::render::RenderError> {
            let mut clip = Clip::new(backend, &take)?;
            for i in 0..4 {
                clip.show(0, |f| (f.now.index, f.now.has_history) = (i, u32::from(i > 0)))?;
            }
            pictures.push(clip.output("color")?);
            Ok(())
        };
        match backend {
            Backend::Cpu(_) => match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
                Ok(pool) => pool.install(&mut draw)?,
                Err(error) => return Ok(Finding::new(false, error.to_string())),
            },
            Backend::Gpu(_) => draw()?,
        }
    }
    let differ = pictures.iter().filter(|p| **p != pictures[0]).count();
    Ok(Finding::new(differ == 0, format!("{differ} of {} pictures differ", pictures.len())))
}

fn independent_stages() -> Finding {
    let stages = [
        Stage::Candidates,
        Stage::CandidateChoice,
        Stage::GroupChoice,
        Stage::LightTree,
        Stage::TemporalInputs,
        Stage::TemporalChoice,
    ];
    let mut worst = 0.0f64;
    let first = |stage: Stage, i: u32| {
        let px = glam::UVec2::new(i & 255, i >> 8);
        Rng::for_reservoir(px, 0, &Frame { seed: 3, index: 9, ..Frame::default() }, stage).next_word()
    };
    let mut count = 0;
    for (a, &one) in stages.iter().enumerate() {
        for &other in &stages[..a] {
            worst = worst.max(pairs(|i| [first(one, i), first(other, i)]));
            count += 1;
        }
    }
    Finding::new(worst < 1.0, format!("worst of {count} pairs at {worst:.2} of the chi-square that noise allows"))
}

fn ways_of_choosing(backend: &Backend<'_>) -> Found {
    let scene = scenes::lamps_over_floor();
    let mut findings = Vec::new();
    for way in ["threshold", "plain", "keys", "inversion"] {
        let knob = format!("reservoirs.choice={way}");
        let take = Take::still(&scene, Technique::Still, &[&knob, "candidates.count=6"]);
        let still = Clip::new(backend, &take)?.stills(48)?;
        let (agrees, text) = still.total().agrees(&take.judged(0, 4096)?, 0.04);
        findings.push(still.finding(agrees, format!("{way} {text}")));
    }
    Ok(Finding::all(findings))
}

fn single_and_double() -> Finding {
    let (distance, case) = furthest_from_double(100_000);
    Finding::new(distance < 1e-5, format!("{distance:.1e} at most, in merge {case}"))
}

fn random_worlds() -> Finding {
    let (error, world) = worst_of(1_000_000);
    Finding::new(error < ROUNDING, format!("worst mean off by {error:.1e}, in world {world}"))
}

fn poisoned(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    for scene in [scenes::variety(), scenes::lamps_over_floor()] {
        let knobs = ["temporal.neighbors=6", "reuse.radius=4"];
        let take = Take { outputs: &["color", "reservoirs"], ..Take::still(&scene, Technique::RealTime, &knobs) };
        let at = 7 * 16 + 8;
        let null = |r: Reservoir| Reservoir { light: 0, uv: 0, ucw: 0.0, ..r };
        let mut pictures: Vec<Vec<[f32; 4]>> = Vec::new();
        let poisons: [fn(Reservoir) -> Reservoir; 6] = [
            |r| Reservoir { ucw: f32::NAN, ..r },
            |r| Reservoir { ucw: f32::INFINITY, ..r },
            |r| Reservoir { ucw: -1.0, ..r },
            |r| Reservoir { light: !ENVIRONMENT_BIT, ucw: 1.0, ..r },
            |r| Reservoir { light: u32::MAX - 1, ucw: 1.0, ..r },
            // A sample like any other, for comparison: it has to show.
            |r| Reservoir { light: 0, uv: 0x8000_8000, ucw: 1e4, ..r },
        ];
        let mut clip = Clip::new(backend, &take)?;
        for poison in std::iter::once(&(null as fn(Reservoir) -> Reservoir)).chain(&poisons) {
            for i in 0..4 {
                clip.show(0, |f| (f.now.index, f.now.has_history) = (i, u32::from(i > 0)))?;
            }
            let held = clip.output::<Reservoir>("reservoirs")?[at];
            let changed = poison(held);
            clip.overwrite("reservoirs", at * size_of::<Reservoir>(), bytemuck::bytes_of(&changed))?;
            clip.show(0, |f| (f.now.index, f.now.has_history) = (4, 1))?;
            pictures.push(clip.output("color")?);
        }
        let differ = |i: usize| pictures[i].iter().zip(&pictures[0]).filter(|(a, b)| a != b).count();
        let reached: usize = (1..=5).map(differ).sum();
        let shows = differ(6);
        findings.push(Finding::new(
            reached == 0 && shows > 0,
            format!("{}: {reached} pixels reached by nonsense, {shows} by a sample", scene.name),
        ));
    }
    Ok(Finding::all(findings))
}

fn accumulation() -> Finding {
    let (mut moments, mut naive) = (Moments::default(), 0.0f32);
    let count = 1u32 << 20;
    for _ in 0..count {
        moments = moments.with(glam::Vec3::splat(0.1), fault::NONE);
        naive += 0.1;
    }
    let exact = f64::from(0.1f32);
    let error = f64::from(moments.mean[0]) - f64::from(moments.carry[0]) - exact;
    let text =
        format!("off by {error:.1e}; a plain sum in f32 is off by {:.1e}", f64::from(naive) / f64::from(count) - exact);
    Finding::new(error.abs() < 1e-9, text)
}
