//! Cases about the tables of lights and what is read from them.

use glam::{DVec3, Mat4, Quat, Vec3};
use weir_shared::{
    alias,
    light::{self, LightPoint},
    numerics::{multiply_high, pack_cell, unit_float},
    octahedral,
    rng::pcg4d,
    scene::Scene as SceneView,
    surface::Surface,
    target::Domain,
    triangle::square_to_triangle,
};

use super::{Finding, stage, statistics::misfit};
use crate::{
    packed::PackedScene,
    scene::{Instance, Mesh, Motion, Scene, Shape, lights},
};

/// Probabilities with which a table is sampled, from its bins: exact in units of 2^-32 / n.
fn sampled(words: &[u32]) -> Vec<u64> {
    let n = words.len() / alias::ENTRY_WORDS as usize;
    let mut units = vec![0u64; n];
    for (bin, entry) in words.chunks_exact(alias::ENTRY_WORDS as usize).enumerate() {
        let (threshold, other) = (u64::from(entry[0]), entry[1] as usize);
        let own = if other == bin { 1 << 32 } else { threshold };
        units[bin] += own;
        units[other] += (1 << 32) - own;
    }
    units
}

/// How far the probabilities that a table states are from those that it samples, relatively, and from a sum of 1.
fn misstatement(words: &[u32]) -> (f64, f64) {
    let n = words.len() / alias::ENTRY_WORDS as usize;
    let total = n as f64 * 4_294_967_296.0;
    let (mut worst, mut sum) = (0.0f64, 0u64);
    for (i, &units) in sampled(words).iter().enumerate() {
        let (exact, stated) = (units as f64 / total, f64::from(alias::pmf(words, 0, i as u32)));
        sum += units;
        worst = worst.max(if exact == 0.0 { stated } else { (stated / exact - 1.0).abs() });
    }
    (worst, (sum as f64 / total - 1.0).abs())
}

/// Draws `draws` items; how often each came.
fn drawn(words: &[u32], draws: u32) -> Vec<f64> {
    let count = words.len() as u32 / alias::ENTRY_WORDS;
    let mut counts = vec![0.0; count as usize];
    for i in 0..draws {
        let [a, b, ..] = pcg4d(i, 1, 9, 4);
        counts[alias::pick(words, 0, count, a, b).index as usize] += 1.0;
    }
    counts
}

pub fn powerless() -> Finding {
    let Some(words) = alias::build(&[1.0, 0.0, 2.0, 0.0, 5.0]) else { return Finding::new(false, "no table") };
    let counts = drawn(&words, 1_000_000);
    let (zeros, none) = (counts[1] + counts[3], alias::build(&[0.0; 5]).is_none());
    let stated = [1, 3].map(|i| alias::pmf(&words, 0, i));
    let text = format!("{zeros} of 10^6 draws, stated {stated:?}; no table of zeros: {none}");
    Finding::new(zeros == 0.0 && stated == [0.0; 2] && none, text)
}

pub fn forty_decades() -> Finding {
    let weights: Vec<f64> = (0..41).map(|i| 10f64.powi(i - 20)).collect();
    let Some(words) = alias::build(&weights) else { return Finding::new(false, "no table") };
    let (misstated, off) = misstatement(&words);
    let unreachable = sampled(&words).iter().filter(|u| **u == 0).count();
    let text = format!("sum off by {off:.1e}, stated within {misstated:.1e}, {unreachable} unreachable");
    Finding::new(off < 1e-12 && misstated < 6e-8 && unreachable == 0, text)
}

pub fn millions() -> Finding {
    const LIGHTS: u32 = 3_400_000;
    let Some(words) = alias::build(&vec![0.7; LIGHTS as usize]) else { return Finding::new(false, "no table") };
    let (misstated, off) = misstatement(&words);
    let group = |light: u32| (u64::from(light) * 1024 / u64::from(LIGHTS)) as usize;
    let mut expected = vec![0.0; 1024];
    let (draws, mut observed) = (2_000_000u32, vec![0.0; 1024]);
    (0..LIGHTS).for_each(|light| expected[group(light)] += f64::from(draws) / f64::from(LIGHTS));
    for i in 0..draws {
        let [a, b, ..] = pcg4d(i, 5, 2, 8);
        observed[group(alias::pick(&words, 0, LIGHTS, a, b).index)] += 1.0;
    }
    let share = misfit(&observed, &expected);
    // The first number of each light: in f32, beyond 2^24, some would have none.
    let first = |light: u64| (light << 32).div_ceil(u64::from(LIGHTS)) as u32;
    let lost = (0..u64::from(LIGHTS)).filter(|&l| u64::from(multiply_high(first(l), LIGHTS)) != l).count();
    let text = format!(
        "p within {misstated:.1e}, sum off by {off:.1e}, chi-square at {share:.2} of what noise allows, {lost} never drawn"
    );
    Finding::new(misstated < 6e-8 && off < 1e-12 && share < 1.0 && lost == 0, text)
}

pub fn one_dominates() -> Finding {
    let mut weights = vec![1.0; 101];
    weights[40] = 1e8 - 100.0;
    let Some(words) = alias::build(&weights) else { return Finding::new(false, "no table") };
    let (misstated, _) = misstatement(&words);
    let draws = 4_000_000;
    let counts = drawn(&words, draws);
    let others = f64::from(draws) - counts[40];
    let share = misfit(&[counts[40], others], &[f64::from(draws) * (1.0 - 1e-6), f64::from(draws) * 1e-6]);
    let unreachable = sampled(&words).iter().filter(|u| **u == 0).count();
    let text =
        format!("{unreachable} of 101 unreachable, p within {misstated:.1e}, others drawn {others} times in 4 million");
    Finding::new(unreachable == 0 && misstated < 6e-8 && share < 1.0, text)
}

/// A scene of one mesh with the given triangles, all of which emit.
fn emitting(triangles: &[[Vec3; 3]]) -> Scene {
    let positions: Vec<Vec3> = triangles.iter().flatten().copied().collect();
    let corners = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = Mesh { positions, triangles: corners, materials: vec![0; triangles.len()], ..Mesh::default() };
    Scene {
        name: "triangles".into(),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_object: glam::Mat4::IDENTITY, motion: Motion::Still }],
        materials: vec![stage::shining(1.0)],
        ..Scene::default()
    }
}

fn point_of(packed: &PackedScene, light: u32, u: f32, v: f32) -> LightPoint {
    let view = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    light::evaluate::<true, true>(&packed.frame, &view, light, pack_cell(u, v))
}

pub fn degenerate() -> Finding {
    let at = |x: f32| Vec3::new(x, 0.0, 0.0);
    let good = [at(0.0), at(1.0), Vec3::Z];
    let flat = [[at(0.0), at(1.0), at(2.0)], [at(1.0); 3], [at(0.0), at(0.0), Vec3::Z]];
    // Not degenerate, but its area is below the smallest float.
    let tiny = [at(0.0), at(1e-30), Vec3::Z * 1e-30];
    let count = |triangles: &[[Vec3; 3]]| {
        let Ok(packed) = PackedScene::new(&emitting(triangles), 0.0) else { return (u32::MAX, u32::MAX) };
        let is_sound = |light: &u32| {
            let point = point_of(&packed, *light, 0.3, 0.6);
            let target = floor_at(Vec3::NEG_Y).target::<true, true>(&point);
            point.normal.is_finite() && point.position.is_finite() && point.jacobian >= 0.0 && target.is_finite()
        };
        (packed.frame.light_count, (0..packed.frame.light_count).filter(|light| !is_sound(light)).count() as u32)
    };
    let (lights, bad) = count(&[&flat[..2], &[good], &flat[2..]].concat());
    let (_, bad_with_tiny) = count(&[good, tiny]);
    let text =
        format!("{lights} of 4 emissive triangles in the table, {bad} not finite, {bad_with_tiny} with one of 1e-60");
    Finding::new(lights == 1 && bad + bad_with_tiny == 0, text)
}

pub fn needle() -> Finding {
    let corners = [Vec3::new(-500.0, 1.0, 0.0), Vec3::new(500.0, 1.0, 0.0), Vec3::new(500.0, 1.0, 1e-6)];
    let packed = match PackedScene::new(&emitting(&[corners]), 0.0) {
        Ok(packed) => packed,
        Err(error) => return Finding::new(false, error.to_string()),
    };
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let exact = 0.5 * (b - a).cross(c - a).length();
    let area = f64::from(point_of(&packed, 0, 0.5, 0.5).jacobian);
    // Along the needle, the share of the area up to x is quadratic.
    let (draws, mut observed) = (400_000u32, [0.0; 64]);
    for i in 0..draws {
        let [u, v, ..] = pcg4d(i, 3, 3, 3).map(unit_float);
        let (second, third) = square_to_triangle(u, v);
        let along = f64::from(second + third);
        observed[((along * along * 64.0) as usize).min(63)] += 1.0;
    }
    let share = misfit(&observed, &[f64::from(draws) / 64.0; 64]);
    let error = area / exact - 1.0;
    let text = format!("area {area:.3e}, off by {error:.1e}; chi-square at {share:.2} of what noise allows");
    Finding::new(area > 0.0 && error.abs() < 1e-5 && share < 1.0, text)
}

/// A white floor that faces up.
fn floor_at(position: Vec3) -> Domain {
    let up = octahedral::pack(Vec3::Y);
    let surface = Surface {
        position: position.to_array(),
        normal_geometric: up,
        normal_shading: up,
        diffuse: [1.0; 3],
        instance: 0x8000_0000,
        ..Surface::default()
    };
    Domain::new(position + Vec3::Y, &surface)
}

pub fn tiny_and_far() -> Finding {
    let (mut worst, mut least) = (0.0f64, f32::MAX);
    for size in [1e-6f32, 2e-6, 4e-6] {
        let corner = Vec3::new(1e6, 1e6, 0.0);
        // The floats near 1e6 are 0.06 apart, so the light is at the origin and the floor is far.
        let scene = emitting(&[[Vec3::ZERO, Vec3::X * size, Vec3::Z * size]]);
        let floor = floor_at(-corner);
        let packed = match PackedScene::new(&scene, 0.0) {
            Ok(packed) => packed,
            Err(error) => return Finding::new(false, error.to_string()),
        };
        let target = floor.target::<true, true>(&point_of(&packed, 0, 0.5, 0.5));
        least = least.min(target);
        let toward = corner.as_dvec3();
        let distance2 = toward.length_squared();
        let cosine = toward.normalize().y;
        let exact =
            core::f64::consts::FRAC_1_PI * cosine * cosine / distance2 * 0.5 * f64::from(size) * f64::from(size);
        worst = worst.max((f64::from(target) / exact - 1.0).abs());
    }
    Finding::new(worst < 1e-4 && least > 0.0, format!("target {least:.2e} at least, off the exact one by {worst:.1e}"))
}

pub fn in_the_plane() -> Finding {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Z];
    let packed = match PackedScene::new(&emitting(&[corners]), 0.0) {
        Ok(packed) => packed,
        Err(error) => return Finding::new(false, error.to_string()),
    };
    let (mut wrong, mut infinite, mut count) = (0, 0, 0);
    for i in 0..10_000u32 {
        let [u, v, x, z] = pcg4d(i, 1, 1, 7).map(unit_float);
        let point = point_of(&packed, 0, u, v);
        let near = 10f32.powf(-40.0 * x);
        for position in [point.position, Vec3::new(2.0 * x - 0.5, 0.0, 2.0 * z - 0.5), point.position + Vec3::X * near]
        {
            let arriving = light::arriving::<false>(position, &point);
            count += 1;
            wrong += u32::from(arriving.irradiance != Vec3::ZERO);
            infinite += u32::from(!arriving.irradiance.is_finite() || !arriving.solid_angle.is_finite());
        }
        // A hair off the plane, on the side that shines: finite, as long as its square is a normal number. Around 1e-20 it
        // is not, and what streams drop as infinite; below, the distance counts as zero.
        for off in [1e-7f32, 1e-12, 1e-18, 1e-23, 1e-38] {
            let arriving = light::arriving::<false>(point.position - Vec3::Y * off, &point);
            count += 1;
            infinite += u32::from(!arriving.solid_angle.is_finite());
        }
    }
    Finding::new(wrong + infinite == 0, format!("{wrong} not zero and {infinite} not finite of {count}"))
}

/// The light of a square of side 1 that a point at `height` below its middle reflects, by one candidate of each of two
/// techniques under one denominator: over the area, and by the BSDF. Over the exact value; and its standard error.
fn below_a_square(height: f32) -> (f64, f64) {
    let (samples, mut sum, mut squares) = (200_000u32, 0.0, 0.0);
    let halves = [
        [Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 0.0, -0.5), Vec3::new(0.5, 0.0, 0.5)],
        [Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 0.0, 0.5), Vec3::new(-0.5, 0.0, 0.5)],
    ];
    let Ok(packed) = PackedScene::new(&emitting(&halves), 0.0) else { return (0.0, 0.0) };
    let at = Vec3::new(0.1, -height, 0.05);
    let floor = floor_at(at);
    let view = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    let weigh = |light: u32, uv: u32| {
        let point = light::evaluate::<false, false>(&packed.frame, &view, light, uv);
        let (target, density) = floor.target_and_density::<false, false>(&point);
        // Half of the lights is drawn with probability 1/2.
        if target > 0.0 { f64::from(target) / (0.5 + f64::from(density)) } else { 0.0 }
    };
    for i in 0..samples {
        let [bits, pick, ..] = pcg4d(i, 8, 8, 1);
        let mut value = weigh(pick >> 31, bits);
        let [choice, u, v, _] = pcg4d(i, 8, 8, 2).map(unit_float);
        let direction = floor.bsdf.sample(choice, u, v).as_dvec3();
        let hit = at.as_dvec3() + direction * (f64::from(height) / direction.y);
        if hit.x.abs() < 0.5 && hit.z.abs() < 0.5 && direction.y > 0.0 {
            let (x, z) = (hit.x + 0.5, hit.z + 0.5);
            let first = x > z;
            let found = (0..2).find(|&l| {
                let triangle = light::find(&packed.frame, &view, l).triangle;
                let corners = view.world_triangle(&packed.frame, 0, triangle);
                let middle = (corners.a + corners.b + corners.c) / 3.0;
                (middle.x > middle.z) == first
            });
            let light = found.unwrap_or(0);
            let triangle = light::find(&packed.frame, &view, light).triangle;
            let corners = view.world_triangle(&packed.frame, 0, triangle);
            let (b, c) = weights_in(&hit, [corners.a, corners.b, corners.c].map(|p| p.as_dvec3()));
            let (u, v) = weir_shared::triangle::triangle_to_square(b as f32, c as f32);
            value += weigh(light, pack_cell(u, v));
        }
        sum += value;
        squares += value * value;
    }
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let exact = stage::form_factor(at.as_dvec3(), &corners);
    let n = f64::from(samples);
    let (mean, error) = (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt());
    (mean / exact, error / exact)
}

/// Barycentric weights of the second and third corner.
fn weights_in(p: &DVec3, [a, b, c]: [DVec3; 3]) -> (f64, f64) {
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    ((c - a).cross(a - *p).dot(normal) / area, (a - b).cross(a - *p).dot(normal) / area)
}

pub fn under_a_large_light() -> Finding {
    let mut findings = Vec::new();
    for height in [1.0, 1e-1, 1e-2, 1e-3] {
        let (share, error) = below_a_square(height);
        let holds = (share - 1.0).abs() < 5.0 * error + 1e-4;
        findings.push(Finding::new(
            holds,
            format!("at {height:e} {:+.3} % +- {:.3} %", 100.0 * (share - 1.0), 196.0 * error),
        ));
    }
    // Closer than a cell of (u, v) is wide, 1.5e-5 of the light, the cell's center stands for all of it.
    let (share, _) = below_a_square(1e-7);
    findings.push(Finding::new(share.is_finite() && share < 1.05, format!("at 1e-7 {share:.3} of the light")));
    Finding::all(findings)
}

/// Share of what a sphere of radius `ratio`, one above a floor, sends to the point below its center: of pi (r/d)^2, from the
/// mean over 256 by 256 cells of (u, v).
fn below_a_sphere(ratio: f32) -> f64 {
    const SIDE: u32 = 256;
    let mut scene = emitting(&[[Vec3::ZERO, Vec3::X, Vec3::Z]]);
    scene.materials[0].emission = Vec3::ZERO;
    let mesh = lights::add_shape(&mut scene, Shape::Sphere, Vec3::ONE, false);
    let world_from_object = Mat4::from_scale_rotation_translation(Vec3::splat(ratio), Quat::IDENTITY, Vec3::Y);
    scene.instances.push(Instance { mesh, world_from_object, motion: Motion::Still });
    let Ok(packed) = PackedScene::new(&scene, 0.0) else { return f64::NAN };
    let view = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    let floor = floor_at(Vec3::ZERO);
    let at = |i: u32| (i as f32 + 0.5) / SIDE as f32;
    let sum: f64 = (0..SIDE * SIDE)
        .map(|i| {
            let uv = pack_cell(at(i % SIDE), at(i / SIDE));
            let point = light::evaluate::<false, true>(&packed.frame, &view, 0, uv);
            f64::from(floor.target::<true, false>(&point))
        })
        .sum();
    // A white floor reflects the irradiance over pi.
    sum / f64::from(SIDE * SIDE) / f64::from(ratio).powi(2)
}

pub fn spherical_lights() -> Finding {
    let shares = [1e-6, 1e-3, 0.1, 0.5].map(below_a_sphere);
    let worst = shares.iter().fold(0.0, |worst: f64, share| worst.max((share - 1.0).abs()));
    let within = below_a_sphere(2.0);
    let touching = [1.0 - 1e-7, 1.0].map(below_a_sphere);
    Finding::new(
        shares.iter().all(|share| (share - 1.0).abs() < 1e-2)
            && within == 0.0
            && touching.iter().all(|share| share.is_finite()),
        format!("off by {worst:.1e} at most, {within} within, {touching:.2?} of the light where they touch"),
    )
}
