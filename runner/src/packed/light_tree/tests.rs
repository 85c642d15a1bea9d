use std::collections::HashSet;

use weir_shared::{
    frame::Frame,
    light::{Address, address_of},
    light_tree::{NO_TREE, Party, Reached, Walk, importances},
    numerics::sqrt,
    rng::{Rng, pcg4d},
    scene::{Scene as SceneView, emitter_record, instance_record},
};

use super::*;
use crate::{
    packed::{Moment, PackOptions, PackedScene, TreeUpdate},
    scene::{Instance, Material, Mesh, Motion, Scene},
};

/// Numbers in -1..1.
fn signed(i: u32, j: u32) -> [f32; 4] {
    pcg4d(i, j, 7, 1234).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0)
}

pub(in crate::packed) fn vector(i: u32, j: u32) -> Vec3 {
    Vec3::from_slice(&signed(i, j))
}

fn direction(i: u32, j: u32) -> Vec3 {
    vector(i, j).try_normalize().unwrap_or(Vec3::Y)
}

/// Materials: dark; one-sided; two-sided and ten times as bright; one-sided, a tenth as bright.
fn materials() -> Vec<Material> {
    let emitting = |emission: f32, two_sided_emission: bool| Material {
        emission: Vec3::splat(emission),
        two_sided_emission,
        ..Material::default()
    };
    vec![Material::default(), emitting(1.0, false), emitting(10.0, true), emitting(0.1, false)]
}

/// Triangles of every material about the origin.
fn soup(triangles: u32, key: u32) -> Mesh {
    let mut mesh = Mesh { name: "soup".into(), ..Mesh::default() };
    for i in 0..triangles {
        let center = vector(i, key);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([center, center + vector(i, key + 1) * 0.2, center + vector(i, key + 2) * 0.2]);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.materials.push(1 + i % 3);
    }
    mesh
}

/// Instances of soups of 1, 8 and 60 triangles that are turned, mirrored and scaled; unevenly if `uneven`.
pub(in crate::packed) fn two_levels(uneven: bool) -> Scene {
    let instances = (0..9).map(|i| {
        let size = 1.0 + 0.1 * i as f32;
        let mirror = if i % 2 == 0 { -1.0 } else { 1.0 };
        let scale = if uneven { Vec3::new(mirror * size, 1.0, 0.4) } else { Vec3::new(mirror, 1.0, 1.0) * size };
        let rotation = Quat::from_axis_angle(direction(i, 30), 2.0 * signed(i, 31)[0]);
        let place = Vec3::new((i % 3) as f32, (i / 3) as f32, 0.0) * 3.0 - Vec3::splat(3.0);
        Instance {
            mesh: i % 3,
            world_from_object: Mat4::from_scale_rotation_translation(scale, rotation, place),
            motion: Motion::Still,
        }
    });
    Scene {
        name: "two levels".into(),
        meshes: vec![soup(1, 0), soup(8, 3), soup(60, 6)],
        instances: instances.collect(),
        materials: materials(),
        ..Scene::default()
    }
}

/// The same with small triangles that all face about the same way, so that nodes have narrow cones.
fn facing_one_way(uneven: bool) -> Scene {
    let mut scene = two_levels(uneven);
    for mesh in &mut scene.meshes {
        mesh.materials.fill(1);
        for (i, corners) in (0..).zip(mesh.positions.chunks_exact_mut(3)) {
            let normal = (Vec3::Z + 0.6 * vector(i, 20)).normalize();
            let tangent = normal.any_orthonormal_vector();
            corners[1] = corners[0] + tangent * 0.02;
            corners[2] = corners[0] + normal.cross(tangent) * 0.02;
        }
    }
    scene
}

pub(in crate::packed) fn view(packed: &PackedScene) -> SceneView<'_> {
    SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels }
}

fn packed_within(scene: &Scene, most_in_trees: usize) -> PackedScene {
    PackedScene::pack(scene, &Moment::default(), PackOptions::default(), most_in_trees).expect("packs")
}

const NOBODY: Address = Address { emitter: 0, local: 0 };

fn start(packed: &PackedScene, (position, normal): (Vec3, Vec3), goal: Option<Address>, stream: u32) -> Walk {
    let rng = Rng::from_words(stream, 3, 1, 9);
    let address = goal.unwrap_or(NOBODY);
    Walk::new(&packed.frame, &packed.lights, position, normal, goal.is_some(), address, rng)
}

fn random_walk(packed: &PackedScene, position: Vec3, normal: Vec3, stream: u32) -> Reached {
    start(packed, (position, normal), None, stream).finish(&packed.frame, &view(packed), &packed.lights)
}

fn pmf_of(packed: &PackedScene, position: Vec3, normal: Vec3, goal: Address) -> f32 {
    let walk = start(packed, (position, normal), Some(goal), 0);
    let reached = walk.finish(&packed.frame, &view(packed), &packed.lights);
    assert_eq!(reached.address, goal);
    reached.pmf
}

pub(in crate::packed) fn addresses(packed: &PackedScene) -> Vec<Address> {
    (0..packed.frame.light_count).map(|light| address_of(&packed.frame, &view(packed), light)).collect()
}

/// Probabilities of all lights.
fn pmfs(packed: &PackedScene, position: Vec3, normal: Vec3) -> Vec<f64> {
    addresses(packed).into_iter().map(|goal| f64::from(pmf_of(packed, position, normal, goal))).collect()
}

/// Surfaces among lights and around them.
pub(in crate::packed) fn surfaces(count: u32) -> impl Iterator<Item = (Vec3, Vec3)> {
    (0..count).map(|i| (vector(i, 40) * [2.0, 6.0, 20.0][i as usize % 3], direction(i, 41)))
}

/// Pearson's statistic as a share of its quantile 1 - 1e-7 (Wilson and Hilferty's approximation); items that are
/// expected less than ten times count as one.
pub(in crate::packed) fn misfit(observed: &[f64], expected: &[f64]) -> f64 {
    let (mut statistic, mut cells, mut rest) = (0.0, 0.0, (0.0, 0.0));
    for (o, e) in observed.iter().zip(expected) {
        if *e < 10.0 {
            rest = (rest.0 + o, rest.1 + e);
        } else {
            statistic += (o - e).powi(2) / e;
            cells += 1.0;
        }
    }
    if rest.1 >= 10.0 {
        statistic += (rest.0 - rest.1).powi(2) / rest.1;
        cells += 1.0;
    } else if rest.0 > rest.1 + 30.0 {
        return f64::INFINITY;
    }
    let freedom: f64 = f64::max(cells - 1.0, 1.0);
    let spread = 2.0 / (9.0 * freedom);
    statistic / (freedom * (1.0 - spread + 5.2 * spread.sqrt()).powi(3))
}

/// How badly the frequencies of walks fit what `claimed` says of each light; above 1 is too badly. The last item stands
/// for walks that end early.
fn misfit_of_walks(packed: &PackedScene, (position, normal): (Vec3, Vec3), claimed: &[f64]) -> f64 {
    const WALKS: u32 = 60_000;
    let first: Vec<u32> = (0..packed.frame.emitter_count)
        .map(|e| view(packed).emitter_word(&packed.frame, e, emitter_record::FIRST_LIGHT))
        .collect();
    let mut observed = vec![0.0; claimed.len() + 1];
    for stream in 0..WALKS {
        let reached = random_walk(packed, position, normal, stream);
        let light = (first[reached.address.emitter as usize] + reached.address.local) as usize;
        observed[if reached.pmf > 0.0 { light } else { claimed.len() }] += 1.0;
    }
    let early = 1.0 - claimed.iter().sum::<f64>();
    let expected: Vec<f64> = claimed.iter().chain([&early]).map(|p| p * f64::from(WALKS)).collect();
    misfit(&observed, &expected)
}

/// Scenes with a tree for each mesh, and with alias tables in place of those of the larger meshes.
fn with_and_without_trees() -> Vec<PackedScene> {
    let scene = two_levels(true);
    let packed: Vec<PackedScene> = [1_000, 9, 0].map(|most| packed_within(&scene, most)).into_iter().collect();
    let trees_of = |packed: &PackedScene| {
        (0..9)
            .filter(|&i| view(packed).instance_word(&packed.frame, i, instance_record::LIGHT_TREE_AT) != NO_TREE)
            .count()
    };
    assert_eq!(packed.iter().map(trees_of).collect::<Vec<_>>(), [9, 6, 0]);
    packed
}

#[test]
fn walks_reach_lights_as_often_as_they_report() {
    for packed in with_and_without_trees() {
        for surface in surfaces(9) {
            let claimed = pmfs(&packed, surface.0, surface.1);
            let misfit = misfit_of_walks(&packed, surface, &claimed);
            assert!(misfit < 1.0, "{surface:?}: {misfit}");
        }
    }
}

/// The check above has teeth: 5 % too much on each light of one mesh is seen, and so is a light that is left out.
#[test]
fn walks_that_report_a_wrong_probability_are_seen() {
    let packed = packed_within(&two_levels(true), 1_000);
    let surface = (Vec3::new(0.5, -0.5, 4.0), Vec3::NEG_Z);
    let claimed = pmfs(&packed, surface.0, surface.1);
    let by_instance: Vec<f64> = addresses(&packed).iter().map(|a| if a.emitter == 2 { 1.05 } else { 1.0 }).collect();
    let wrong: Vec<f64> = claimed.iter().zip(by_instance).map(|(p, factor)| p * factor).collect();
    assert!(misfit_of_walks(&packed, surface, &wrong) > 1.0);
    let mut missing = claimed;
    let likely = (0..missing.len()).find(|&i| missing[i] > 0.01).expect("a light that matters");
    missing[likely] = 0.0;
    assert!(misfit_of_walks(&packed, surface, &missing) > 1.0);
}

#[test]
fn walks_lead_where_they_would_alone() {
    for packed in with_and_without_trees() {
        for (i, (position, normal)) in (0..).zip(surfaces(500)) {
            let alone = |k: u32| random_walk(&packed, position, normal, 8 * i + k);
            let goal = alone(0).address;
            let mut party = Party::new();
            (0..3).for_each(|k| party.add(start(&packed, (position, normal), None, 8 * i + k)));
            party.add(start(&packed, (position, normal), Some(goal), 0));
            party.finish(&packed.frame, &view(&packed), &packed.lights);
            for k in 0..3 {
                let led = party.led(k).expect("a walk without a goal");
                assert_eq!((led.address, led.pmf.to_bits()), (alone(k).address, alone(k).pmf.to_bits()));
            }
            assert!(party.led(3).is_none() && party.led(4).is_none());
            let to = party.to(goal).expect("the walk to the goal");
            assert_eq!(to.pmf.to_bits(), pmf_of(&packed, position, normal, goal).to_bits());
            // More than there is room for are walked alone.
            let mut full = Party::new();
            (0..=Party::MOST as u32).for_each(|k| full.add(start(&packed, (position, normal), None, k)));
            assert!(full.led(Party::MOST as u32 - 1).is_some() && full.led(Party::MOST as u32).is_none());
        }
    }
}

#[test]
fn the_probability_of_a_light_is_bitwise_that_of_the_walk_to_it() {
    for packed in with_and_without_trees() {
        let mut reached_lights = HashSet::new();
        for (i, (position, normal)) in (0..).zip(surfaces(2_000)) {
            let reached = random_walk(&packed, position, normal, i);
            if reached.pmf > 0.0 {
                reached_lights.insert((reached.address.emitter, reached.address.local));
                let pmf = pmf_of(&packed, position, normal, reached.address);
                assert_eq!(pmf.to_bits(), reached.pmf.to_bits(), "{position} {normal} {:?}", reached.address);
            }
        }
        assert!(reached_lights.len() > 100, "{} lights are too few to compare", reached_lights.len());
    }
}

/// Beside rounding, walks are lost only where a node seems to reach the surface and none of its children does.
#[test]
fn the_probabilities_of_all_lights_sum_to_one_less_what_walks_lose_early() {
    let (mut lost, mut count) = (0.0, 0.0);
    for uneven in [false, true] {
        let packed = packed_within(&two_levels(uneven), 1_000);
        for (position, normal) in surfaces(600) {
            let sum: f64 = pmfs(&packed, position, normal).iter().sum();
            assert!(sum <= 1.0 + 1e-5, "{position} {normal}: {sum}");
            if sum > 0.0 {
                (lost, count) = (lost + 1.0 - sum, count + 1.0);
            }
            // Far from all lights and toward them.
            let toward = -position.normalize();
            let far = toward * -30.0;
            let sum: f64 = pmfs(&packed, far, toward).iter().sum();
            assert!((sum - 1.0).abs() < 2e-2, "{far} {toward}: {sum}");
        }
    }
    println!("walks lost early: {:.3} %", 100.0 * lost / count);
    // Lights in disorder, seen by surfaces among them that face any way: much of what nodes hold is below the horizon.
    assert!(count > 900.0 && lost / count < 0.2, "{lost} of {count}");
}

/// Lights that emit to both sides, all of them above the horizon: nothing is lost but by rounding.
#[test]
fn where_every_light_reaches_the_surface_the_probabilities_sum_to_one() {
    let mut scene = two_levels(true);
    scene.materials.iter_mut().for_each(|m| m.two_sided_emission = true);
    let packed = packed_within(&scene, 1_000);
    for (position, _) in surfaces(300) {
        let toward = -position.normalize();
        let sum: f64 = pmfs(&packed, toward * -30.0, toward).iter().sum();
        assert!((sum - 1.0).abs() < 1e-5, "{toward}: {sum}");
    }
}

/// Every step down to a light: importance of the child that leads to it, and its share of the node's.
fn steps_to(packed: &PackedScene, goal: Address, position: Vec3, normal: Vec3) -> Vec<(f32, f32)> {
    let (frame, scene, lights) = (&packed.frame, view(packed), &packed.lights);
    let mut steps = Vec::new();
    let mut down = |at: u32, count: u32, item: u32, position: Vec3, normal: Vec3| {
        let mut trail = lights[(at + item) as usize];
        let mut link = if count > 1 && at != NO_TREE { 0 } else { LEAF | item };
        while link & LEAF == 0 {
            let node = at + count + link * NODE_WORDS;
            let halves = [0, 4].map(|half| importances(lights, node + half, position, normal).to_array());
            let all = halves.concat();
            let child = (trail & (WIDTH - 1)) as usize;
            steps.push((all[child], all[child] / all.iter().sum::<f32>().max(1e-30)));
            link = lights[(node + node_field::LINK * WIDTH) as usize + child];
            trail >>= 3;
        }
        assert_eq!(link & !LEAF, item, "a trail leads to its light");
    };
    down(frame.light_tree_at, frame.emitter_count, goal.emitter, position, normal);
    let instance = scene.emitter_word(frame, goal.emitter, emitter_record::INSTANCE);
    let record = scene.instance_at(frame, instance);
    let plane = scene.transform_normal(record + instance_record::WORLD_FROM_OBJECT, normal);
    down(
        scene.instance_word(frame, instance, instance_record::LIGHT_TREE_AT),
        scene.instance_word(frame, instance, instance_record::LIGHT_COUNT),
        goal.local,
        scene.transform_point(record + instance_record::OBJECT_FROM_WORLD, position),
        plane * (1.0 / sqrt(plane.length_squared())),
    );
    steps
}

/// Whether some point of a light reaches a surface, by more than rounding.
pub(in crate::packed) fn reaches(
    packed: &PackedScene,
    frame: &Frame,
    light: u32,
    position: Vec3,
    normal: Vec3,
) -> bool {
    (0..16).any(|i| {
        // Corners and edges included.
        let uv = [0, 0xffff, 0xffff_0000, 0xffff_ffff].get(i as usize).copied().unwrap_or(pcg4d(i, 1, 1, 1)[0]);
        let point = weir_shared::light::evaluate::<false, false>(frame, &view(packed), light, uv);
        let toward = (point.position - position).normalize_or_zero();
        let facing = -toward.dot(point.normal);
        toward.dot(normal) > 1e-4 && if point.two_sided { facing.abs() > 1e-4 } else { facing > 1e-4 }
    })
}

/// How many of the lights that reach a surface a walk could not reach, and how many there were.
fn unreachable(packed: &PackedScene) -> (u32, u32) {
    let (mut missed, mut all) = (0, 0);
    for (position, normal) in surfaces(400) {
        for (light, goal) in (0..).zip(addresses(packed)) {
            if reaches(packed, &packed.frame, light, position, normal) {
                all += 1;
                let steps = steps_to(packed, goal, position, normal);
                let is_missed = steps.iter().any(|&(importance, _)| importance.is_nan() || importance <= 0.0);
                missed += u32::from(is_missed);
                // However small its share, a child that matters has a part of its own.
                assert_eq!(pmf_of(packed, position, normal, goal) > 0.0, !is_missed, "{light}: {steps:?}");
            }
        }
    }
    (missed, all)
}

#[test]
fn every_light_that_reaches_a_surface_can_be_walked_to() {
    for uneven in [false, true] {
        for scene in [two_levels(uneven), facing_one_way(uneven)] {
            let (missed, all) = unreachable(&packed_within(&scene, 1_000));
            assert!(all > 10_000, "{all} lights are too few");
            assert_eq!(missed, 0, "of {all}");
        }
    }
}

/// The check above has teeth: spheres and cones that are too small are seen.
#[test]
fn a_tree_that_is_not_conservative_is_seen() {
    // The bound on the cosine at the light leaves cones room of its own.
    let radius = (node_field::RADIUS, 0.9, two_levels(false));
    let cone = (node_field::SIN_SPREAD, 0.5, facing_one_way(false));
    for (field, factor, scene) in [radius, cone] {
        let mut packed = packed_within(&scene, 1_000);
        let (at, count) = (packed.frame.light_tree_at, packed.frame.emitter_count);
        let mut trees = vec![(at, count)];
        for instance in 0..9 {
            let word = |field| view(&packed).instance_word(&packed.frame, instance, field);
            trees.push((word(instance_record::LIGHT_TREE_AT), word(instance_record::LIGHT_COUNT)));
        }
        trees.sort_unstable();
        trees.dedup();
        for (at, count) in trees.into_iter().filter(|&(_, count)| count > 1) {
            let (nodes, _) = check(&packed.lights[at as usize..], count as usize);
            for node in 0..nodes {
                let words = (at + count) as usize + node * NODE_WORDS as usize + (field * WIDTH) as usize;
                for word in &mut packed.lights[words..words + WIDTH as usize] {
                    *word = (f32::from_bits(*word) * factor).to_bits();
                }
            }
        }
        assert!(unreachable(&packed).0 > 0, "field {field}");
    }
}

/// Follows the trail of every item; returns the number of nodes and of levels.
fn check(words: &[u32], count: usize) -> (usize, u32) {
    let mut nodes = HashSet::new();
    let mut deepest = 0;
    for item in 0..count {
        let (mut trail, mut link, mut depth) = (words[item], 0, 0);
        while link & LEAF == 0 {
            nodes.insert(link);
            let at = count + (link * NODE_WORDS + node_field::LINK * WIDTH + (trail & (WIDTH - 1))) as usize;
            link = words[at];
            (trail, depth) = (trail >> 3, depth + 1);
            assert!(depth <= MAX_DEPTH, "item {item}");
        }
        assert_eq!((link & !LEAF, trail), (item as u32, 0), "the trail of item {item}");
        deepest = deepest.max(depth);
    }
    (nodes.len(), deepest)
}

fn light(position: Vec3, size: f32, power: f64) -> LightBounds {
    LightBounds::triangle([position, position + Vec3::X * size, position + Vec3::Y * size], false, power)
}

#[test]
fn trees_over_any_lights_have_trails_that_fit_and_no_more_words_than_said() {
    let spread = |n: u32| (0..n).map(|i| light(vector(i, 50), 0.01, 1.0)).collect::<Vec<_>>();
    let mut cases: Vec<Vec<LightBounds>> = (2..=80).map(spread).collect();
    cases.push(spread(30_000));
    cases.push(vec![light(Vec3::ONE, 1.0, 2.0); 100_000]);
    // Heaps at distances that double: every split could take one heap off.
    cases.push((0..100_000).map(|i| light(Vec3::X * ((i / 1_000) as f32 - 50.0).exp2(), 1e-30, 1.0)).collect());
    cases.push((0..1_000).map(|i| light(vector(i, 51) * 1e18, 1e17, 1.0)).collect());
    cases.push((0..3_000).map(|i| light(vector(i, 52), 0.1, 10f64.powi(i as i32 % 41 - 20))).collect());
    cases.push((0..1_000).map(|i| light(vector(i, 53), 0.1, f64::from(i % 2))).collect());
    cases.push(vec![light(Vec3::ONE, 1.0, 0.0); 20]);
    for (number, lights) in cases.iter().enumerate() {
        let (words, bounds) = build(lights);
        let (nodes, depth) = check(&words, lights.len());
        assert_eq!(words.len(), lights.len() + nodes * NODE_WORDS as usize, "case {number}: a node for nothing");
        assert!(words.len() <= capacity_words(lights.len()), "case {number}: {} words", words.len());
        assert!(depth <= MAX_DEPTH, "case {number}: {depth} levels");
        let total: f64 = lights.iter().map(|l| l.power).sum();
        assert!((bounds.power - total).abs() <= 1e-9 * total, "case {number}");
        let numbers = nodes_of(&words, lights.len(), node_field::LINK).map(f32::from_bits);
        assert!(numbers.into_iter().all(f32::is_finite), "case {number}: a number that is none");
    }
    assert_eq!((build(&[]).0.len(), build(&cases[0][..1]).0), (0, vec![0]));
    assert_eq!([0, 1, 2, 16].map(capacity_words), [0, 1, 2 + 80, 16 + 9 * 80]);
}

/// Words of all fields below `end`, over all nodes.
fn nodes_of(words: &[u32], count: usize, end: u32) -> impl Iterator<Item = u32> {
    let nodes = words[count..].chunks_exact(NODE_WORDS as usize);
    nodes.flat_map(move |node| node[..(end * WIDTH) as usize].to_vec()).collect::<Vec<_>>().into_iter()
}

#[test]
fn a_tree_is_the_same_for_any_number_of_threads() {
    let lights: Vec<LightBounds> = (0..20_000).map(|i| light(vector(i, 60), 0.01, f64::from(i % 7 + 1))).collect();
    let built = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| build(&lights).0)
    };
    let one = built(1);
    assert!([2, 5].into_iter().all(|threads| built(threads) == one));
}

/// Two lights that almost agree: the angle between them is below what an arc cosine tells from zero.
#[test]
fn cones_hold_normals_that_hardly_differ() {
    for angle in [1e-5f32, 1e-4, 3e-4, 1e-3, 0.3, 2.0, 3.1] {
        let turned = Vec3::new(angle.sin(), 0.0, angle.cos());
        let at = |axis: Vec3| LightBounds { axis, ..light(Vec3::ZERO, 1.0, 1.0) };
        for lights in [[at(Vec3::Z), at(turned)], [at(turned), at(Vec3::Z)]] {
            for bounds in [bounds_of(&lights), build(&lights).1] {
                let angle_to = |n: Vec3| bounds.axis.cross(n).length().atan2(bounds.axis.dot(n));
                for normal in [Vec3::Z, turned] {
                    assert!(angle_to(normal) <= bounds.spread + 1e-6, "{angle}: {normal} outside {bounds:?}");
                }
                assert!(bounds.spread <= 0.51 * angle + 1e-6, "{angle}: wider than it need be, {bounds:?}");
            }
        }
    }
}

/// One instance of one mesh of the given lights, seen from `position`: the walks fit, whatever the lights are.
fn check_walks(mesh: Mesh, positions: &[Vec3]) {
    let scene = Scene {
        name: "case".into(),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_object: Mat4::IDENTITY, motion: Motion::Still }],
        materials: materials(),
        ..Scene::default()
    };
    let packed = packed_within(&scene, 1_000);
    for (i, &position) in (0..).zip(positions) {
        let normal = direction(i, 70);
        let claimed = pmfs(&packed, position, normal);
        assert!(claimed.iter().all(|p| (0.0..=1.0).contains(p)), "{claimed:?}");
        assert!(misfit_of_walks(&packed, (position, normal), &claimed) < 1.0, "{position} {normal}");
    }
}

#[test]
fn one_light_two_lights_and_surfaces_on_and_far_from_lights_are_no_exceptions() {
    for count in [1, 2] {
        let mesh = soup(count, 80);
        let corner = mesh.positions[0];
        let middle = (corner + mesh.positions[1] + mesh.positions[2]) / 3.0;
        check_walks(mesh, &[Vec3::ZERO, corner, middle, Vec3::X * 1e6]);
    }
    // One light: the walk can't miss it.
    let mesh = soup(12, 83);
    let on_lights: Vec<Vec3> = mesh.positions.iter().copied().step_by(3).take(4).collect();
    check_walks(mesh.clone(), &on_lights);
    check_walks(mesh, &[Vec3::new(1e6, 0.0, 0.0), Vec3::new(-1e6, 1e6, 3.0), Vec3::splat(1e18), Vec3::splat(1e25)]);
}

#[test]
fn lights_of_forty_decades_of_power_and_dark_instances_are_walked_to_as_reported() {
    let mut scene = two_levels(false);
    let mut moment = Moment::default();
    let mut packed = PackedScene::dynamic(&scene, &moment).expect("packs");
    let surface = (Vec3::new(0.5, -0.5, 6.0), Vec3::NEG_Z);
    let fits = |packed: &PackedScene| {
        let claimed = pmfs(packed, surface.0, surface.1);
        assert!(misfit_of_walks(packed, surface, &claimed) < 1.0);
        claimed
    };
    moment.emission = (0..9).map(|i| (i, Vec3::splat(10f32.powi(i as i32 * 5 - 20)))).collect();
    packed.advance(&moment).expect("exists");
    assert!(fits(&packed).iter().sum::<f64>() > 0.9);
    // Half of the instances dark, then all.
    moment.emission = (0..9).step_by(2).map(|i| (i, Vec3::ZERO)).collect();
    packed.advance(&moment).expect("exists");
    for (address, pmf) in addresses(&packed).iter().zip(fits(&packed)) {
        assert!(address.emitter % 2 == 1 || pmf == 0.0, "{address:?} is dark");
    }
    moment.emission = (0..9).map(|i| (i, Vec3::ZERO)).collect();
    packed.advance(&moment).expect("exists");
    assert!(fits(&packed).iter().all(|&pmf| pmf == 0.0));
    // Radiances as far apart, in one mesh.
    for (i, material) in scene.materials.iter_mut().enumerate() {
        material.emission = Vec3::splat(10f32.powi(i as i32 * 20 - 40));
    }
    fits(&packed_within(&scene, 1_000));
}

#[test]
fn the_smallest_meshes_have_trees_within_the_limit() {
    assert_eq!(which_have_trees(&[5, 1, 3, 0, 3], 7), [false, true, true, true, true]);
    assert_eq!(which_have_trees(&[5, 1, 3, 0, 3], 6), [false, true, true, true, false]);
    assert_eq!(which_have_trees(&[5, 1], 0), [false, false]);
    assert_eq!(which_have_trees(&[2, 2], 4), [true, true]);
    let packed = packed_within(&two_levels(false), usize::MAX);
    let tables = packed_within(&two_levels(false), 0);
    assert!(tables.lights.len() < packed.lights.len());
    assert_eq!(
        pmf_of(&tables, Vec3::ZERO, Vec3::Z, addresses(&tables)[0]),
        pmf_of(&packed, Vec3::ZERO, Vec3::Z, NOBODY)
    );
}

/// What [`MOST_IN_TREES`] rests on; an eighth of that many, to be quick.
#[test]
fn trees_and_tables_of_all_meshes_fit_a_storage_binding() {
    let count = MOST_IN_TREES / 8;
    let lights: Vec<LightBounds> = (0..count as u32).map(|i| light(vector(i, 90), 0.001, 1.0)).collect();
    let words = build(&lights).0.len() + count * weir_shared::alias::ENTRY_WORDS as usize;
    println!("{} bytes a light", words * 4 / count);
    assert!(words * 4 * 8 < 128 << 20, "{words} words for {count} lights");
}

/// Instances turned, moved and scaled, each in its own way; one of them dimmed.
fn elsewhere(scene: &Scene) -> Moment {
    let placed = (0..).zip(&scene.instances).map(|(i, instance)| {
        let turn = Quat::from_axis_angle(direction(i, 70), 1.5 * signed(i, 71)[1]);
        let scale = Vec3::splat(1.0 + 0.5 * signed(i, 72)[2]);
        let there = Mat4::from_scale_rotation_translation(scale, turn, vector(i, 73) * 4.0);
        (i, there * instance.world_from_object)
    });
    Moment { placed: placed.collect(), emission: vec![(4, Vec3::splat(0.01))], ..Moment::default() }
}

#[test]
fn a_tree_fitted_to_lights_that_have_not_changed_is_the_tree_as_it_was() {
    for count in [1, 2, 7, 8, 9, 64, 65, 1_000] {
        let lights: Vec<LightBounds> = (0..count)
            .map(|i| {
                let dark = if i % 7 == 3 { 0.0 } else { 1.0 };
                let normal = (i % 3 > 0).then(|| direction(i, 61));
                let at = vector(i, 60) * 5.0;
                LightBounds::around([at, at + vector(i, 62).abs()], normal, f64::from(dark * (1.0 + i as f32)))
            })
            .collect();
        let (built, _) = build(&lights);
        let mut fitted = built.clone();
        refit(&mut fitted, &lights);
        assert_eq!(fitted, built, "{count}");
        // From what is no longer true, the same.
        let others: Vec<LightBounds> = (0..count).map(|i| light(vector(i, 63), 0.1, 1.0)).collect();
        refit(&mut fitted, &others);
        assert!(count == 1 || fitted != built, "{count}");
        refit(&mut fitted, &lights);
        assert_eq!(fitted, built, "{count}");
    }
}

#[test]
fn a_tree_fitted_to_where_lights_have_gone_is_walked_as_reported_and_reaches_all() {
    for uneven in [false, true] {
        for scene in [two_levels(uneven), facing_one_way(uneven)] {
            let moment = elsewhere(&scene);
            let mut packed = packed_within(&scene, 1_000);
            packed.tree_update = Some(TreeUpdate::Refit);
            let tree_at = packed.frame.light_tree_at as usize;
            let before = packed.lights[tree_at..].to_vec();
            packed.advance(&moment).expect("a moment");
            let anew = PackedScene::with(&scene, &moment, PackOptions::default()).expect("packs");
            assert_ne!(packed.lights[tree_at..], before, "fitted");
            assert_ne!(packed.lights[tree_at..], anew.lights[tree_at..], "not built anew");
            for surface in surfaces(6) {
                let claimed = pmfs(&packed, surface.0, surface.1);
                assert!(claimed.iter().sum::<f64>() <= 1.0 + 1e-5);
                let misfit = misfit_of_walks(&packed, surface, &claimed);
                assert!(misfit < 1.0, "{surface:?}: {misfit}");
            }
            let (missed, looked_at) = unreachable(&packed);
            assert!(missed == 0 && looked_at > 1_000, "{missed} of {looked_at}");

            // Others are drawn: what belongs together is asked again.
            let fewer = Moment { drawn: Some(vec![0, 1, 2, 5]), ..moment };
            packed.advance(&fewer).expect("a moment");
            let anew = PackedScene::with(&scene, &fewer, PackOptions::default()).expect("packs");
            let nodes = packed.dynamics.tree_words();
            assert_eq!(packed.lights[tree_at..][..nodes], anew.lights[tree_at..][..nodes]);
        }
    }
}
