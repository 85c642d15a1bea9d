//! The picture's pixels, and the frame before.

use glam::UVec2;
use weir_shared::{
    reservoir::Reservoir,
    reuse::{self, rule},
    surface::Surface,
};

use super::{
    Case, Check, Finding, Found,
    clip::{Clip, Still, Take},
    endurance, motion, scenes,
};
use crate::{
    executor::gpu::GpuError,
    render::{Backend, RenderError},
    technique::Technique,
};

pub(super) const CASES: &[Case] = &[
    Case {
        number: 53,
        name: "pictures of 1x1, 1x17, 17x1 and 7x5 pixels",
        expected: "usable, no fault",
        checks: &[Check::Frames(odd_sizes)],
    },
    Case {
        number: 54,
        name: "a radius beyond the picture; no neighbour at all",
        expected: "usable; the picture of reuse in time alone, to rounding",
        checks: &[Check::Frames(no_neighbors)],
    },
    Case {
        number: 55,
        name: "a cut to another camera",
        expected: "the mean of the reference right after it and later",
        checks: &[Check::Frames(motion::camera_cut)],
    },
    Case {
        number: 56,
        name: "a camera that trembles by parts of a pixel",
        expected: "the mean of the reference",
        checks: &[Check::Frames(motion::trembling_camera)],
    },
    Case {
        number: 57,
        name: "surfaces that come from behind the camera",
        expected: "the mean of the reference",
        checks: &[Check::Frames(motion::from_behind)],
    },
    Case {
        number: 58,
        name: "thousands of frames where nothing moves",
        expected: "a stationary mean, no stuck pixel, confidence within its bound",
        checks: &[Check::Frames(endurance::short)],
    },
    Case {
        number: 59,
        name: "paired neighbours",
        expected: "each has the other, unless the test of similarity is not mutual",
        checks: &[Check::Frames(pairs)],
    },
    Case {
        number: 60,
        name: "another size in mid-run",
        expected: "frames of another size refused; the first of the new size is that after a cut, bit by bit",
        checks: &[Check::Frames(resized)],
    },
    Case {
        number: 61,
        name: "an occluder that moves",
        expected: "each frame has the mean of the reference, in two tiers",
        checks: &[Check::Frames(motion::moving_occluder)],
    },
];

/// Frames of a chain that stands still.
fn chain(clip: &mut Clip, frames: u32) -> Result<(), RenderError> {
    (0..frames).try_for_each(|i| {
        clip.show(0, |f| {
            (f.now.index, f.now.has_history, f.now.accumulated) = (i, u32::from(i > 0), i);
        })
    })
}

fn odd_sizes(backend: &Backend<'_>) -> Found {
    let scene = scenes::variety();
    let mut findings = Vec::new();
    for size in [[1, 1], [1, 17], [17, 1], [7, 5]] {
        for (technique, knobs) in [
            (Technique::Still, &["reuse.rule=paired"] as &[&str]),
            (Technique::RealTime, &["spatial.rounds=1", "reuse.rule=compatible"]),
        ] {
            let mut clip = Clip::new(backend, &Take { size, ..Take::still(&scene, technique, knobs) })?;
            chain(&mut clip, 5)?;
            let still = Still { moments: clip.output("moments")?, frames: Vec::new() };
            let count = still.moments.iter().filter(|m| m.count == 5).count();
            let all = count as u32 == size[0] * size[1];
            findings.push(still.finding(all, format!("{}x{}: {count} written", size[0], size[1])));
        }
    }
    Ok(Finding::all(findings))
}

fn no_neighbors(backend: &Backend<'_>) -> Found {
    let scene = scenes::lamps_over_floor();
    let mut findings = Vec::new();
    let wide =
        Take { size: [7, 5], ..Take::still(&scene, Technique::RealTime, &["reuse.radius=120", "spatial.rounds=2"]) };
    let mut clip = Clip::new(backend, &wide)?;
    chain(&mut clip, 6)?;
    findings.push(Still { moments: clip.output("moments")?, frames: Vec::new() }.finding(true, "radius 120 on 7x5"));
    // A single pixel has no neighbours.
    let mut colors = Vec::new();
    for rounds in ["spatial.rounds=0", "spatial.rounds=2"] {
        let take = Take { size: [1, 1], ..Take::still(&scene, Technique::RealTime, &["rays=speed", rounds]) };
        let mut clip = Clip::new(backend, &take)?;
        let mut of_frames = Vec::new();
        for i in 0..16 {
            // Fresh reservoirs each time: W of a merge of one is rounded, and what is kept later may hang on that.
            clip.show(0, |f| (f.now.index, f.now.has_history) = (i, 0))?;
            of_frames.push(clip.output::<[f32; 4]>("color")?[0]);
        }
        colors.push(of_frames);
    }
    let pairs = colors[0].iter().flatten().zip(colors[1].iter().flatten());
    let worst = pairs.map(|(a, b)| super::streams::ulps(*a, *b)).max().unwrap_or(u32::MAX);
    findings.push(Finding::new(worst <= 8, format!("one pixel: {worst} ulp from reuse in time alone")));
    Ok(Finding::all(findings))
}

fn pairs(backend: &Backend<'_>) -> Found {
    let scene = scenes::variety();
    let take = Take { size: [24, 18], outputs: &["surfaces"], ..Take::still(&scene, Technique::RealTime, &[]) };
    let mut clip = Clip::new(backend, &take)?;
    clip.show(0, |_| ())?;
    let surfaces: Vec<Surface> = clip.output("surfaces")?;
    let (mut alone, mut found, mut one_sided) = (0, 0, 0);
    for index in 0..16 {
        let mut frame = clip.frames(0).now;
        (frame.neighbor_rule, frame.index, frame.spatial_neighbors, frame.radius_px) = (rule::PAIRED, index, 1, 8.0);
        let of = |px: UVec2| {
            let surface = &surfaces[frame.index_of(px) as usize];
            let neighbors = reuse::find_present(px, 0, &frame, surface, &surfaces, 2);
            (0..neighbors.count).map(|i| neighbors.get(i)).collect::<Vec<_>>()
        };
        for px in (0..24 * 18).map(|i| UVec2::new(i % 24, i / 24)) {
            for partner in of(px) {
                found += 1;
                if !of(partner).contains(&px) {
                    // Distance from the tangent plane is measured at either.
                    let [here, there] = [px, partner].map(|p| &surfaces[frame.index_of(p) as usize]);
                    let site = |s: &Surface| reuse::Site::new(s, s.position(), frame.camera_origin);
                    let mutual = site(here).is_similar(&frame, there) && site(there).is_similar(&frame, here);
                    alone += u32::from(mutual);
                    one_sided += u32::from(!mutual);
                }
            }
        }
    }
    let text = format!("{alone} of {found} without the other, {one_sided} more where similarity is one-sided");
    Ok(Finding::new(alone == 0 && found > 1000, text))
}

fn resized(backend: &Backend<'_>) -> Found {
    let scene = scenes::lamps_over_floor();
    let small = Take { outputs: &["color", "reservoirs"], ..Take::still(&scene, Technique::RealTime, &[]) };
    let mut clip = Clip::new(backend, &small)?;
    chain(&mut clip, 4)?;
    let refused = clip.show(0, |frames| frames.now.width = 20);
    let refuses = matches!(refused, Err(RenderError::Gpu(GpuError::FrameSize { .. })));
    let large = Take { size: [20, 15], ..small };
    let mut colors = Vec::new();
    for has_history in [1, 0] {
        let mut clip = Clip::new(backend, &large)?;
        clip.show(0, |frames| (frames.now.index, frames.now.has_history) = (4, has_history))?;
        let held: Vec<Reservoir> = clip.output("reservoirs")?;
        colors.push((clip.output::<[f32; 4]>("color")?, held.iter().map(Reservoir::confidence).max()));
    }
    let differ = colors[0].0.iter().zip(&colors[1].0).filter(|(a, b)| a != b).count();
    let text = format!("refused: {refuses}; {differ} pixels differ, confidence {:?}", colors[0].1);
    Ok(Finding::new(refuses && differ == 0 && colors[0].1 == Some(1), text))
}
