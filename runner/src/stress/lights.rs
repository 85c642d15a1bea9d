//! Lights and their distributions.

use std::iter;

use glam::{Mat4, Vec3};
use weir_shared::reservoir::Reservoir;

use super::{
    Case, Check, Finding, Found,
    clip::{Clip, Take, Total},
    motion,
    scenes::{self, Lamp, lamp_above_a_floor},
    stage::{Stage, shining, white_sky},
    streams::ulps,
    tables,
};
use crate::{
    packed::Moment,
    render::{Backend, RenderError},
    scene::{DistantLight, Environment, Material, Shape, Texture, lights},
    sequence::Shot,
    technique::Technique,
};

pub(super) const CASES: &[Case] = &[
    Case {
        number: 19,
        name: "no light at all, a sky alone, one light",
        expected: "black; lit; W 1 to 2 ulp wherever the light is kept",
        checks: &[Check::Frames(few_lights)],
    },
    Case {
        number: 20,
        name: "lights without power",
        expected: "never drawn; nothing but such lights: black, no fault",
        checks: &[Check::Host(tables::powerless), Check::Frames(all_off)],
    },
    Case {
        number: 21,
        name: "powers from 1e-20 to 1e20, the weakest of them next to the surface",
        expected: "probabilities sum to 1 to 1e-12; the mean is that of Lambert's formula",
        checks: &[Check::Host(tables::forty_decades), Check::Frames(weak_but_near)],
    },
    Case {
        number: 22,
        name: "3.4 million equal lights",
        expected: "stated probability is the sampled one, every light can be drawn",
        checks: &[Check::Host(tables::millions)],
    },
    Case {
        number: 23,
        name: "one light with 99.9999 % of the power",
        expected: "the others as often as they should; whatever the source, the mean is that of Lambert's formula",
        checks: &[Check::Host(tables::one_dominates), Check::Frames(dominated)],
    },
    Case {
        number: 24,
        name: "degenerate triangles that emit",
        expected: "not in the table, nothing that is not finite",
        checks: &[Check::Host(tables::degenerate), Check::Frames(degenerate_lamps)],
    },
    Case {
        number: 25,
        name: "a needle of 1e-6 by 1e3",
        expected: "area above 0 and right to 1e-5, points uniform over it",
        checks: &[Check::Host(tables::needle)],
    },
    Case {
        number: 26,
        name: "a light of 1e-6 at a distance of 1e6",
        expected: "finite, right to 1e-4, in proportion to the area",
        checks: &[Check::Host(tables::tiny_and_far)],
    },
    Case {
        number: 27,
        name: "a point in the plane of the light, or on it",
        expected: "exactly 0, nothing infinite",
        checks: &[Check::Host(tables::in_the_plane), Check::Frames(lamp_in_the_floor)],
    },
    Case {
        number: 28,
        name: "a point just below a large light",
        expected: "the mean of the formula down to 1e-3 of the light's size; finite and not brighter below",
        checks: &[Check::Host(tables::under_a_large_light)],
    },
    Case {
        number: 29,
        name: "spherical lights",
        expected: "the mean over (u, v) is pi L (r/d)^2 down to r/d = 1e-6; none from within; finite where they touch",
        checks: &[Check::Host(tables::spherical_lights)],
    },
    Case {
        number: 30,
        name: "lights that no direction finds",
        expected: "the mean of the reference, with rays by the BSDF and without",
        checks: &[Check::Frames(lights_that_no_direction_finds)],
    },
    Case {
        number: 31,
        name: "the back of a light, one-sided and two-sided",
        expected: "0; as much as the front",
        checks: &[Check::Frames(backs)],
    },
    Case {
        number: 32,
        name: "a light with one bright texel; one with a hole in its mask",
        expected: "the mean of the reference",
        checks: &[Check::Frames(textured)],
    },
    Case {
        number: 33,
        name: "a sky with one texel of 1e6, with bright poles, and a black one",
        expected: "the mean of the reference; black, no fault",
        checks: &[Check::Frames(skies)],
    },
    Case {
        number: 34,
        name: "lights that come, go and change places every frame",
        expected: "each frame has the mean of the reference",
        checks: &[Check::Frames(motion::changing_lights)],
    },
    Case {
        number: 35,
        name: "lights that flicker and jump every frame",
        expected: "each frame has the mean of the reference",
        checks: &[Check::Frames(motion::flickering)],
    },
    Case {
        number: 36,
        name: "a light that is 1000 times larger in every other frame",
        expected: "each frame has the mean of the reference",
        checks: &[Check::Frames(motion::scaled_light)],
    },
];

const BOTH: [Technique; 2] = [Technique::Still, Technique::RealTime];

/// Every source of candidates, with fewer of them than there are lights; drawing ahead for small pictures.
const SOURCES: [&[&str]; 6] = [
    &["candidates.count=1"],
    &["candidates.count=1", "candidates.source=uniform"],
    &["candidates.count=1", "candidates.source=tiles", "tiles.count=4", "tiles.size=32", "skip.presampling=off"],
    &["candidates.count=1", "candidates.source=cells", "cells.slots=4"],
    &["candidates.count=1", "candidates.source=tree"],
    &["candidates.count=1", "candidates.source=cuts"],
];

fn few_lights(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    let mut stage = Stage::floor();
    for technique in BOTH {
        let dark = Clip::new(backend, &Take::still(&stage.scene, technique, &[]))?.stills(2)?;
        let most = dark.channels().fold(0.0, f32::max);
        findings.push(dark.finding(most == 0.0, format!("no light {most}")));
    }
    stage.scene.environment = Some(white_sky());
    let sky = Clip::new(backend, &Take::still(&stage.scene, Technique::Still, &[]))?.stills(64)?;
    // Half of the light of a white sky, whatever the direction.
    let expected = Total::exact(0.5 * 3.0 * 192.0);
    let (agrees, text) = sky.total().agrees(&expected, 0.03);
    findings.push(sky.finding(agrees, format!("sky {text}")));

    let mut stage = Stage::floor();
    stage.panel(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, shining(4.0));
    // One triangle of the panel.
    let lamp = stage.scene.meshes.last_mut().expect("a panel has a mesh");
    lamp.triangles.truncate(1);
    lamp.materials.truncate(1);
    let knobs = ["candidates.bsdf=0", "rays=speed"];
    let take = Take { outputs: &["fresh"], ..Take::still(&stage.scene, Technique::RealTime, &knobs) };
    let mut clip = Clip::new(backend, &take)?;
    clip.show(0, |_| ())?;
    let fresh: Vec<Reservoir> = clip.output("fresh")?;
    let held: Vec<&Reservoir> = fresh.iter().filter(|r| r.has_sample()).collect();
    let worst = held.iter().map(|r| ulps(r.ucw, 1.0)).max().unwrap_or(u32::MAX);
    findings.push(Finding::new(
        worst <= 2 && held.len() == 192,
        format!("one light: {} samples, W within {worst} ulp", held.len()),
    ));

    let mut stage = Stage::floor();
    stage.lamp(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, shining(4.0));
    // Fewer candidates than triangles of the one lamp: none are enumerated.
    findings.extend(by_each(&SOURCES, &stage, backend, 32, 0.03)?);
    Ok(Finding::all(findings))
}

/// Whether the mean of `frames` frames of a still is that of the formula, to a share of `margin`, with each of some sets of
/// knobs.
fn by_each(
    sets: &[&[&str]],
    stage: &Stage,
    backend: &Backend<'_>,
    frames: u32,
    margin: f64,
) -> Result<Vec<Finding>, RenderError> {
    let judge = |knobs: &&[&str]| {
        let (still, formula) = stage.measured(backend, Technique::Still, knobs, frames)?;
        let (agrees, text) = still.total().agrees(&formula, margin);
        Ok(still.finding(agrees, format!("{} {text}", knobs.join(" "))))
    };
    sets.iter().map(judge).collect()
}

/// Twenty lamps with a millionth of the power between them, and one with the rest.
fn dominated(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    stage.lamp(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, shining(2e6));
    for i in 0..20 {
        let corner = Vec3::new(-1.0 + 0.1 * i as f32, 1.0 + 0.05 * (i % 4) as f32, 0.8);
        stage.lamp(corner, Vec3::X * 0.05, Vec3::Z * 0.05, shining(40.0));
    }
    Ok(Finding::all(by_each(&SOURCES, &stage, backend, 128, 0.1)?))
}

fn all_off(backend: &Backend<'_>) -> Found {
    let scene = scenes::lamps_over_floor();
    let off = Moment { emission: (0..3).map(|i| (i, Vec3::ZERO)).collect(), ..Moment::default() };
    let camera = scene.camera.expect("it has one");
    let mut findings = Vec::new();
    let pairs = BOTH.iter().flat_map(|technique| SOURCES.iter().map(move |knobs| (*technique, *knobs)));
    for (technique, knobs) in pairs {
        let take =
            Take { shots: vec![Shot { moment: off.clone(), camera }; 3], ..Take::still(&scene, technique, knobs) };
        let mut clip = Clip::new(backend, &take)?;
        (0..3).try_for_each(|i| clip.show(i, |frames| frames.now.accumulated = i as u32))?;
        let still = super::clip::Still { moments: clip.output("moments")?, frames: Vec::new() };
        let most = still.channels().fold(0.0, f32::max);
        findings.push(still.finding(most == 0.0, format!("{technique} {most}")));
    }
    Ok(Finding::all(findings))
}

/// A point, a spot and a directional light over a floor.
fn lights_that_no_direction_finds(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    let spot = Shape::Spot { inner_deg: 10.0, outer_deg: 40.0 };
    for (shape, place) in [
        (Shape::Point, Mat4::from_translation(Vec3::new(0.3, 0.7, 0.2))),
        (spot, lights::along(Vec3::new(-0.4, 0.8, 0.0), Vec3::NEG_Y)),
    ] {
        let mesh = lights::add_shape(&mut stage.scene, shape, Vec3::ONE, false);
        stage.place(mesh, place);
    }
    let direction = Vec3::new(0.5, -1.0, 0.2).normalize();
    stage.scene.distant.push(DistantLight { direction, irradiance: Vec3::splat(0.5) });
    let mut findings = Vec::new();
    for bsdf in ["candidates.bsdf=0", "candidates.bsdf=1"] {
        let take = Take::still(&stage.scene, Technique::Still, &[bsdf]);
        let still = Clip::new(backend, &take)?.stills(64)?;
        let (agrees, text) = still.total().agrees(&take.judged(0, 1024)?, 0.03);
        findings.push(still.finding(agrees, format!("{bsdf} {text}")));
    }
    Ok(Finding::all(findings))
}

/// A strong light that the floor hardly sees, and a weak one just above it, out of view.
fn weak_but_near(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    // Facing up: all of its power is lost. Power 1e12 times that of the other.
    stage.panel(Vec3::new(-5.0, 30.0, 5.0), Vec3::X * 10.0, Vec3::NEG_Z * 10.0, shining(1e10));
    stage.lamp(Vec3::new(0.5, 0.05, -0.5), Vec3::Z, Vec3::Y * 0.01, shining(1.0));
    let sets = [&[] as &[&str], &["candidates.count=32", "candidates.tree=16"]];
    Ok(Finding::all(by_each(&sets, &stage, backend, 256, 0.1)?))
}

fn degenerate_lamps(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    let lamp = shining(5.0);
    stage.lamp(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, lamp.clone());
    for (a, b) in [(Vec3::X, Vec3::X), (Vec3::ZERO, Vec3::Z), (Vec3::ZERO, Vec3::ZERO), (Vec3::X, Vec3::X * 2.0)] {
        stage.panel(Vec3::new(0.1, 1.5, 0.1), a, b, lamp.clone());
    }
    let sets: Vec<&[&str]> = iter::once(&[] as &[&str]).chain(SOURCES).collect();
    Ok(Finding::all(by_each(&sets, &stage, backend, 32, 0.03)?))
}

fn lamp_in_the_floor(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    stage.panel(Vec3::new(-0.2, 0.0, 0.2), Vec3::X * 0.4, Vec3::NEG_Z * 0.4, shining(3.0));
    let mut findings = Vec::new();
    for technique in BOTH {
        let still = Clip::new(backend, &stage.take(technique, &[]))?.stills(8)?;
        // The two panels are equally near; either is seen, but the floor reflects nothing.
        let lit = still.channels().filter(|x| *x != 0.0 && *x != 3.0).count();
        findings.push(still.finding(lit == 0, format!("{technique}: {lit} channels neither 0 nor 3")));
    }
    Ok(Finding::all(findings))
}

fn backs(backend: &Backend<'_>) -> Found {
    let (corner, a, b) = (Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z);
    let mut findings = Vec::new();
    for two_sided in [false, true] {
        // Up: b x a.
        let mut stage = Stage::floor();
        let material = Material { two_sided_emission: two_sided, ..shining(4.0) };
        stage.lamp(corner, b, a, material);
        for technique in BOTH {
            let (still, formula) = stage.measured(backend, technique, &[], 48)?;
            let total = still.total();
            let (holds, text) =
                if two_sided { total.agrees(&formula, 0.05) } else { (total.mean == 0.0, total.mean.to_string()) };
            let sides = if two_sided { "two-sided" } else { "one-sided" };
            findings.push(still.finding(holds, format!("{sides} {technique} {text}")));
        }
    }
    Ok(Finding::all(findings))
}

fn textured(backend: &Backend<'_>) -> Found {
    let mut stage = Stage::floor();
    let mut texels = vec![0xff00_0000; 64];
    texels[19] = 0xffff_ffff;
    stage.scene.textures.push(Texture { name: "one".into(), width: 8, height: 8, texels, srgb: false });
    let material = Material { emission_texture: Some(0), ..shining(200.0) };
    stage.panel(Vec3::new(-0.5, 1.5, -0.5), Vec3::X, Vec3::Z, material);
    let mut findings = Vec::new();
    for (name, scene) in [("texel", stage.scene), ("mask", lamp_above_a_floor(Lamp::Masked))] {
        let take = Take::still(&scene, Technique::Still, &["candidates.count=16", "camera.jitter=off"]);
        let judged = take.judged(0, 8192)?;
        let still = Clip::new(backend, &take)?.stills(128)?;
        let (agrees, text) = still.total().agrees(&judged, 0.05);
        findings.push(still.finding(agrees, format!("{name} {text}")));
        // From lights drawn ahead, texels have their say then.
        for knobs in &SOURCES[2..4] {
            let knobs = [*knobs, &["camera.jitter=off"]].concat();
            let still = Clip::new(backend, &Take::still(&scene, Technique::Still, &knobs))?.stills(1024)?;
            let (agrees, text) = still.total().agrees(&judged, 0.08);
            findings.push(still.finding(agrees, format!("{name} {} {text}", knobs[1])));
        }
    }
    Ok(Finding::all(findings))
}

fn skies(backend: &Backend<'_>) -> Found {
    let mut findings = Vec::new();
    let dim = [0.1f32, 0.2, 0.3];
    let mut sun = vec![dim; 32 * 16];
    sun[3 * 32 + 11] = [1e6; 3];
    let mut poles = vec![[0.0; 3]; 32 * 16];
    poles[..32].fill([5.0; 3]);
    poles[15 * 32..].fill([7.0; 3]);
    for (name, texels, margin) in [("sun", sun, 0.05), ("poles", poles, 0.05), ("black", vec![[0.0; 3]; 512], 0.0)] {
        let mut scene = lamp_above_a_floor(Lamp::Whole);
        scene.meshes.truncate(1);
        scene.instances.truncate(1);
        let sky = Environment { name: name.into(), width: 32, height: 16, texels, rotation_deg: 40.0, scale: 1.0 };
        scene.environment = Some(sky);
        let take = Take::still(&scene, Technique::Still, &[]);
        let still = Clip::new(backend, &take)?.stills(64)?;
        let total = still.total();
        let (holds, text) = if margin > 0.0 {
            total.agrees(&take.judged(0, 4096)?, margin)
        } else {
            (total.mean == 0.0, total.mean.to_string())
        };
        findings.push(still.finding(holds, format!("{name} {text}")));
    }
    Ok(Finding::all(findings))
}
