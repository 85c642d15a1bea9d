use bytemuck::{bytes_of, cast_slice, cast_slice_mut};
use glam::{Mat4, Vec3};
use weir_shared::{
    bvh::{PortableTests, closest_hit, closest_hit_with, unoccluded, unoccluded_with},
    light,
    ray::{FAR, Hit, Ray},
    rng::pcg4d,
    scene::{Scene as SceneView, instance_record},
    triangle::ShearedRay,
};

use super::*;
use crate::scene::{Instance, Mesh, Motion, Shape};

/// Numbers in -1..1.
fn signed(i: u32, j: u32) -> [f32; 4] {
    pcg4d(i, j, 5, 99).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0)
}

/// `n` triangles about the origin, every tenth emissive.
fn soup(n: u32) -> Scene {
    let mut mesh = Mesh { name: "soup".into(), ..Mesh::default() };
    for i in 0..n {
        let (center, a, b) = (signed(i, 0), signed(i, 1), signed(i, 2));
        let center = Vec3::from_slice(&center);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([center, center + Vec3::from_slice(&a) * 0.2, center + Vec3::from_slice(&b) * 0.2]);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.materials.push(u32::from(i % 10 == 0));
    }
    Scene {
        name: "soup".into(),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_object: Mat4::IDENTITY, motion: Motion::Still }],
        materials: vec![Material::default(), Material { emission: Vec3::ONE, ..Material::default() }],
        ..Scene::default()
    }
}

fn view(packed: &PackedScene) -> SceneView<'_> {
    SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels }
}

fn rays(n: u32) -> impl Iterator<Item = Ray> {
    (0..n).map(|i| {
        let origin = Vec3::from_slice(&signed(i, 10)) * 2.0;
        let direction = match i % 8 {
            0 => Vec3::X,
            1 => Vec3::new(0.0, -0.0, -1.0),
            _ => Vec3::from_slice(&signed(i, 11)),
        };
        Ray { origin, direction, t_max: if i % 3 == 0 { 1.0 } else { FAR } }
    })
}

#[test]
fn traversal_equals_brute_force_on_either_path() {
    let packed = PackedScene::new(&soup(3_000), 0.0).expect("packs");
    let (scene, frame) = (view(&packed), packed.frame);
    let mut hits = 0;
    for ray in rays(4_000) {
        let sheared = ShearedRay::new(ray.origin, ray.direction);
        let mut expected = Hit::miss(ray.t_max);
        for triangle in 0..3_000 {
            let found = sheared.intersect(&packed.triangles, triangle);
            if found.t > 0.0 && found.t < expected.t {
                expected = Hit { t: found.t, u: found.u, v: found.v, triangle, instance: 0 };
            }
        }
        hits += u32::from(!expected.is_miss());
        assert_eq!(closest_hit::<false, false>(&frame, &scene, &packed.bvh, &ray), expected);
        let portable = closest_hit_with::<false, false, _>(&frame, &scene, &packed.bvh, &ray, PortableTests);
        assert_eq!(portable, expected);
        assert_eq!(unoccluded::<false, false>(&frame, &scene, &packed.bvh, &ray), expected.is_miss());
    }
    assert!(hits > 500, "{hits} hits are too few to compare");
}

#[test]
fn instances_are_found_where_they_stand_and_mirrored_lights_keep_their_front() {
    let mut scene = soup(300);
    scene.instances = (0..20)
        .map(|i| {
            let mirror = if i % 2 == 0 { Vec3::new(-1.0, 1.0, 0.5) } else { Vec3::ONE };
            Instance {
                mesh: 0,
                world_from_object: Mat4::from_translation(Vec3::X * 4.0 * i as f32) * Mat4::from_scale(mirror),
                motion: if i == 3 {
                    Motion::Swing { offset: Vec3::Y, frequency_hz: 1.0, phase: 0.0 }
                } else {
                    Motion::Still
                },
            }
        })
        .collect();
    let mut packed = PackedScene::new(&scene, 0.0).expect("packs");
    assert!(packed.content.instances && packed.moves());
    assert_eq!(packed.frame.light_count, 20 * 30);
    for time in [0.0, 0.25] {
        packed.set_time(time).expect("moves");
        let (view, frame) = (view(&packed), packed.frame);
        let mut hits = 0;
        for (i, ray) in rays(3_000).enumerate() {
            let ray = Ray { origin: ray.origin + Vec3::X * 4.0 * (i % 20) as f32, ..ray };
            let hit = closest_hit::<false, true>(&frame, &view, &packed.bvh, &ray);
            let mut nearest = ray.t_max;
            for instance in 0..20 {
                for triangle in 0..300 {
                    let t = view.world_triangle(&frame, instance, triangle);
                    let mut vertices = [0.0; 9];
                    for (k, p) in [t.a, t.b, t.c].iter().enumerate() {
                        p.write_to_slice(&mut vertices[k * 3..]);
                    }
                    let found = ShearedRay::new(ray.origin, ray.direction).intersect(&vertices, 0);
                    if found.t > 0.0 && found.t < nearest {
                        nearest = found.t;
                    }
                }
            }
            hits += u32::from(!hit.is_miss());
            assert!((hit.t - nearest).abs() <= 1e-4 * nearest.min(100.0), "{} {nearest}", hit.t);
        }
        assert!(hits > 50, "{hits} hits are too few to compare");
    }
    // Light ids go through the emitters to an emissive triangle of the right instance, mirrored or not.
    let (view, frame) = (view(&packed), packed.frame);
    for id in 0..frame.light_count {
        let light::Place { instance, triangle } = light::find(&frame, &view, id);
        assert_eq!(instance, id / 30);
        assert_eq!(packed.records[packed.records_attribute(instance, triangle)], 1);
        let world = view.world_triangle(&frame, instance, triangle);
        let t = view.world_triangle(&frame, instance | 1, triangle);
        // Instance i is mirrored in x when even; its odd neighbour is not.
        let expected = if instance % 2 == 0 {
            let n = t.doubled_area_normal();
            Vec3::new(-n.x * 0.5, n.y * 0.5, n.z)
        } else {
            t.doubled_area_normal()
        };
        assert!((world.doubled_area_normal() - expected).length() < 1e-4, "light {id}");
    }
}

impl PackedScene {
    /// Word of a triangle's material.
    fn records_attribute(&self, instance: u32, triangle: u32) -> usize {
        let at = (self.frame.instances_at + instance * instance_record::WORDS) as usize;
        let local = triangle - self.records[at + instance_record::FIRST_TRIANGLE as usize];
        let flags = self.records[at + instance_record::FLAGS as usize];
        (self.records[at + instance_record::ATTRIBUTES_AT as usize]
            + local * weir_shared::scene::attribute_words(flags)) as usize
    }
}

/// The bits of what both paths find, for rays of every kind; how many of them hit.
fn hits_on_both_paths<const INSTANCES: bool>(packed: &PackedScene) -> u32 {
    let (scene, frame) = (view(packed), packed.frame);
    let mut hits = 0;
    for (i, mut ray) in (0u32..).zip(rays(20_000)) {
        if i % 4 == 0 {
            // From a vertex of the scene, in object space; with one instance that is the world.
            let at = (signed(i, 12)[0].abs() * packed.triangles.len() as f32 / 3.0) as usize * 3;
            ray.origin = Vec3::from_slice(&packed.triangles[at.min(packed.triangles.len() - 3)..]);
        }
        if i % 5 == 0 {
            // Toward a vertex.
            let at = (signed(i, 13)[0].abs() * packed.triangles.len() as f32 / 3.0) as usize * 3;
            let vertex = Vec3::from_slice(&packed.triangles[at.min(packed.triangles.len() - 3)..]);
            if vertex != ray.origin {
                ray.direction = vertex - ray.origin;
            }
        }
        let fast = closest_hit::<false, INSTANCES>(&frame, &scene, &packed.bvh, &ray);
        let plain = closest_hit_with::<false, INSTANCES, _>(&frame, &scene, &packed.bvh, &ray, PortableTests);
        let bits = |h: Hit| [h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.triangle, h.instance];
        assert_eq!(bits(fast), bits(plain), "ray {i}: {ray:?}");
        let visible = unoccluded::<false, INSTANCES>(&frame, &scene, &packed.bvh, &ray);
        let plain = unoccluded_with::<false, INSTANCES, _>(&frame, &scene, &packed.bvh, &ray, PortableTests);
        assert_eq!(visible, plain, "ray {i}: {ray:?}");
        assert_eq!(visible, fast.is_miss(), "ray {i}: {ray:?}");
        hits += u32::from(!fast.is_miss());
    }
    hits
}

#[test]
fn the_fast_path_finds_the_same_bits_as_the_plain_one() {
    let mut scene = soup(5_000);
    // A grid whose triangles share vertices and edges, twice in the same place: equally near hits.
    let mesh = &mut scene.meshes[0];
    for copy in 0..2 {
        let first = mesh.positions.len() as u32;
        mesh.positions
            .extend((0..400).map(|i| Vec3::new((i % 20) as f32 * 0.1 - 1.0, (i / 20) as f32 * 0.1 - 1.0, 0.25)));
        for i in (0..379).filter(|i| i % 20 != 19) {
            let corner = first + i;
            mesh.triangles.extend([[corner, corner + 1, corner + 20], [corner + 21, corner + 20, corner + 1]]);
            mesh.materials.extend([copy; 2]);
        }
    }
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    assert!(!packed.content.instances);
    let hits = hits_on_both_paths::<false>(&packed);
    assert!(hits > 5_000, "{hits} hits are too few to compare");

    scene.instances = (0..9)
        .map(|i| Instance {
            mesh: 0,
            world_from_object: Mat4::from_translation(Vec3::new((i % 3) as f32, (i / 3) as f32, 0.0) - Vec3::ONE)
                * Mat4::from_rotation_x(0.3 * i as f32),
            motion: Motion::Still,
        })
        .collect();
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    assert!(packed.content.instances);
    let hits = hits_on_both_paths::<true>(&packed);
    assert!(hits > 5_000, "{hits} hits are too few to compare");
}

#[test]
fn a_scene_without_triangles_packs_and_every_ray_misses() {
    let packed = PackedScene::new(&Scene::default(), 0.0).expect("packs");
    assert!(!packed.content.shines() && packed.frame.light_count == 0);
    let ray = Ray { origin: Vec3::ZERO, direction: Vec3::X, t_max: FAR };
    assert!(closest_hit::<false, true>(&packed.frame, &view(&packed), &packed.bvh, &ray).is_miss());
}

#[test]
fn coincident_and_wildly_different_triangles_still_build() {
    let mut scene = soup(0);
    let mesh = &mut scene.meshes[0];
    for i in 0..100_000u32 {
        let size = if i % 2 == 0 { 1.0 } else { (i as f32 / 100_000.0 * 60.0 - 30.0).exp2() };
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([Vec3::ZERO, Vec3::X * size, Vec3::Y * size]);
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.materials.push(0);
    }
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let ray = Ray { origin: Vec3::new(0.1, 0.1, 1.0), direction: -Vec3::Z, t_max: FAR };
    assert!(!closest_hit::<false, false>(&packed.frame, &view(&packed), &packed.bvh, &ray).is_miss());
}

/// Twenty instances of a soup in a row.
fn row_of_soups() -> Scene {
    let mut scene = soup(300);
    let place = |i: i32| Mat4::from_translation(Vec3::X * 4.0 * i as f32);
    scene.instances =
        (0..20).map(|i| Instance { mesh: 0, world_from_object: place(i), motion: Motion::Still }).collect();
    scene
}

#[test]
fn light_ids_translate_both_ways_when_instances_come_go_and_change_order() {
    let scene = row_of_soups();
    let first = Moment::default();
    let second = Moment { drawn: Some(vec![7, 3, 19, 0]), ..Moment::default() };
    let mut packed = PackedScene::dynamic(&scene, &first).expect("packs");
    let prev = packed.frame;
    assert!(packed.advance(&first).expect("the same").is_empty());
    assert!(!packed.advance(&second).expect("exists").is_empty());
    let now = packed.frame;
    assert_eq!((prev.light_count, now.light_count), (600, 120));
    let view = view(&packed);
    for (position, instance) in [7u32, 3, 19, 0].into_iter().enumerate() {
        for local in [0, 1, 29] {
            let (before, after) = (instance * 30 + local, position as u32 * 30 + local);
            assert_eq!(light::translate(&now, &prev, &view, after), before);
            assert_eq!(light::translate(&prev, &now, &view, before), after);
            // The same point of the world under both ids.
            let [a, b] = [(&prev, before), (&now, after)]
                .map(|(frame, id)| light::evaluate::<false, false>(frame, &view, id, 0x1234_5678).position);
            assert_eq!(a, b);
        }
    }
    assert_eq!(light::translate(&prev, &now, &view, 5 * 30), light::NO_LIGHT);
    // Back again: the blocks have changed places.
    packed.advance(&first).expect("exists");
    let third = packed.frame;
    let view = self::view(&packed);
    assert_eq!(third.instances_at, prev.instances_at);
    assert_eq!(light::translate(&third, &now, &view, 19 * 30 + 4), 2 * 30 + 4);
    assert_eq!(light::translate(&third, &now, &view, 5 * 30), light::NO_LIGHT);
}

/// What stands still is left as it is: buffers are those of a scene that is brought up to date as a whole, and the parts said
/// to have changed are all that a copy needs to stay equal.
#[test]
fn what_stands_still_is_left_as_it_is_and_no_bit_differs() {
    let mut scene = row_of_soups();
    scene.instances[4].motion = Motion::Turn { center: Vec3::X * 16.0, axis: Vec3::Y, turns_per_second: 0.1 };
    // A shape among them, which no ray finds.
    let shape = Shape::Sphere;
    scene.meshes.push(Mesh { name: "lamp".into(), materials: vec![1], shape, ..Mesh::default() });
    scene.instances[2].mesh = 1;
    // One that emits nothing.
    let mut dark = scene.meshes[0].clone();
    dark.materials.fill(0);
    scene.meshes.push(dark);
    scene.instances[3].mesh = 2;
    for update in [Some(TreeUpdate::Rebuild), Some(TreeUpdate::Refit), None] {
        let options = PackOptions { dynamic: true, light_cuts: true, ..PackOptions::default() };
        let pack = || PackedScene::with(&scene, &Moment::default(), options).expect("packs");
        let (mut keeping, mut plain) = (pack(), pack());
        (keeping.tree_update, plain.tree_update, plain.keeps_still) = (update, update, false);
        let mut copy = (keeping.records.clone(), keeping.bvh.clone(), keeping.lights.clone());
        let place = |i: u32, y: f32| (i, Mat4::from_translation(Vec3::new(4.0 * i as f32, y, 0.0)));
        let dim = |i: u32, by: f32| (i, Vec3::splat(by));
        for (number, (time_s, placed, emission, drawn)) in [
            (0.0, vec![], vec![], None),
            (0.0, vec![], vec![], None),
            (0.0, vec![], vec![dim(2, 0.5)], None),
            (0.0, vec![], vec![dim(2, 0.25)], None),
            (1.0, vec![], vec![dim(2, 0.25)], None),
            (1.0, vec![place(7, 1.0)], vec![], None),
            (1.0, vec![place(7, 1.5), place(2, 0.5)], vec![dim(7, 0.0)], None),
            (1.0, vec![place(7, 1.5)], vec![], Some(vec![7, 3, 19, 0, 9, 5, 11, 2, 4, 1])),
            (1.0, vec![place(7, 1.0)], vec![], Some(vec![7, 3, 19, 0, 9, 5, 11, 2, 4, 1])),
            (1.0, vec![place(7, 1.0)], vec![], Some(vec![7, 3, 19, 0, 9, 5, 11, 2, 4, 1])),
            (1.0, vec![place(7, 1.0)], vec![], Some(vec![7, 19, 0, 9, 5, 11, 2, 4, 1])),
            (1.0, vec![place(7, 1.0)], vec![], Some(vec![7, 19, 3, 0, 9, 5, 11, 2, 4, 1])),
            (2.0, vec![], vec![], Some(vec![])),
            (2.0, vec![], vec![], None),
            (2.0, vec![], vec![], None),
        ]
        .into_iter()
        .enumerate()
        {
            let moment = Moment { time_s, placed, emission, drawn };
            let changed = keeping.show_anew(&moment).expect("shown");
            plain.show_anew(&moment).expect("shown");
            assert_eq!(bytes_of(&keeping.frame), bytes_of(&plain.frame), "{update:?}, {number}");
            assert!(keeping.records == plain.records, "{update:?}, {number}");
            assert!(keeping.bvh == plain.bvh, "{update:?}, {number}");
            assert!(keeping.lights == plain.lights, "{update:?}, {number}");
            for Changed { buffer, range } in changed {
                let (to, from): (&mut [u8], &[u8]) = match buffer {
                    "records" => (cast_slice_mut(&mut copy.0), cast_slice(&keeping.records)),
                    "bvh" => (cast_slice_mut(&mut copy.1), cast_slice(&keeping.bvh)),
                    _ => (cast_slice_mut(&mut copy.2), cast_slice(&keeping.lights)),
                };
                to[range.clone()].copy_from_slice(&from[range]);
            }
            assert!(copy == (keeping.records.clone(), keeping.bvh.clone(), keeping.lights.clone()), "{number}");
        }
    }
}

/// How many bytes of each buffer change once both blocks have seen the same: of records one instance's, of the top level
/// nothing while rays find nothing moved, of what lights are chosen by nothing while none of them has changed.
#[test]
fn what_changes_of_a_scene_is_no_more_than_what_moves() {
    let mut scene = row_of_soups();
    // The last ones emit nothing.
    let mut dark = scene.meshes[0].clone();
    dark.materials.fill(scene.materials.len() as u32);
    scene.materials.push(Material::default());
    scene.meshes.push(dark);
    scene.instances[19].mesh = 1;
    let settle = |packed: &mut PackedScene| {
        for _ in 0..2 {
            packed.show_anew(&Moment::default()).expect("shown");
        }
    };
    let mut packed = PackedScene::dynamic(&scene, &Moment::default()).expect("packs");
    settle(&mut packed);
    let bytes = |packed: &mut PackedScene, moment: &Moment| {
        let changed = packed.show_anew(moment).expect("shown");
        ["records", "bvh", "lights"]
            .map(|name| changed.iter().filter(|c| c.buffer == name).map(|c| c.range.len()).sum::<usize>())
    };
    assert_eq!(bytes(&mut packed, &Moment::default()), [0; 3]);
    let of_instance = instance_record::WORDS as usize * 4;
    let moved = Moment { placed: vec![(19, Mat4::from_translation(Vec3::Y * 9.0))], ..Moment::default() };
    let [records, bvh, lights] = bytes(&mut packed, &moved);
    assert!(records <= 4 * 20 + of_instance && records > 0 && bvh > 0 && lights == 0, "{records} {bvh} {lights}");
    settle(&mut packed);
    let dimmed = Moment { emission: vec![(3, Vec3::splat(0.5))], ..Moment::default() };
    let [records, bvh, lights] = bytes(&mut packed, &dimmed);
    assert!(records <= of_instance && records > 0 && bvh == 0 && lights > 0, "{records} {bvh} {lights}");
    // All of it without the rule.
    packed.keeps_still = false;
    let all = bytes(&mut packed, &Moment::default());
    assert!(all[0] > 20 * of_instance && all[1] > 0 && all[2] > 0, "{all:?}");
}

#[test]
fn every_light_is_found_by_its_id_however_uneven_the_numbers_of_lights_are() {
    // Meshes of 1, 700 and 2 lights, in an order that puts many small ones into a bucket and many buckets into a large one.
    let mut scene = soup(10);
    scene.meshes.extend([soup(7_000), soup(20)].into_iter().flat_map(|s| s.meshes));
    let order = [0, 0, 0, 1, 2, 0, 1, 1, 2, 2, 2, 2, 0];
    scene.instances =
        order.iter().map(|&mesh| Instance { mesh, world_from_object: Mat4::IDENTITY, motion: Motion::Still }).collect();
    for drawn in [None, Some(vec![12]), Some(vec![3]), Some(vec![3, 12, 0, 4, 6])] {
        let moment = Moment { drawn: drawn.clone(), ..Moment::default() };
        let packed = PackedScene::dynamic(&scene, &moment).expect("packs");
        let mut light = 0;
        for (emitter, instance) in (0..).zip(drawn.unwrap_or((0..13).collect())) {
            for local in 0..[1, 700, 2][order[instance as usize] as usize] {
                let address = light::address_of(&packed.frame, &view(&packed), light);
                assert_eq!(address, light::Address { emitter, local });
                light += 1;
            }
        }
        assert_eq!(light, packed.frame.light_count);
    }
}

#[test]
fn moments_move_scale_and_dim_instances_and_refuse_what_is_not_there() {
    let scene = row_of_soups();
    let mut packed = PackedScene::dynamic(&scene, &Moment::default()).expect("packs");
    let place = Mat4::from_scale_rotation_translation(Vec3::splat(3.0), glam::Quat::IDENTITY, Vec3::Y);
    let moment =
        Moment { emission: vec![(2, Vec3::new(0.5, 0.0, 2.0))], placed: vec![(2, place)], ..Moment::default() };
    packed.advance(&moment).expect("exists");
    let view = view(&packed);
    let [still, moved] = [1, 2].map(|i| light::evaluate::<false, false>(&packed.frame, &view, i * 30, 0));
    assert_eq!(moved.radiance, still.radiance * Vec3::new(0.5, 0.0, 2.0));
    assert!((moved.jacobian / still.jacobian - 9.0).abs() < 1e-4);
    for drawn in [vec![20], vec![3, 3]] {
        let refused = packed.advance(&Moment { drawn: Some(drawn), ..Moment::default() });
        assert!(matches!(refused, Err(PackError::NoInstance(_))));
    }
    // All gone: nothing to hit, no light.
    packed.advance(&Moment { drawn: Some(Vec::new()), ..Moment::default() }).expect("an empty scene");
    assert_eq!((packed.frame.light_count, packed.frame.instance_count), (0, 0));
    let ray = Ray { origin: Vec3::ZERO, direction: Vec3::X, t_max: FAR };
    assert!(closest_hit::<false, true>(&packed.frame, &self::view(&packed), &packed.bvh, &ray).is_miss());
}

#[test]
fn the_probability_of_a_light_is_the_one_it_is_picked_with_and_hits_know_their_light() {
    let packed = PackedScene::new(&row_of_soups(), 0.0).expect("packs");
    let (view, frame) = (view(&packed), packed.frame);
    for by_power in [0, 1] {
        let frame = Frame { source: by_power, ..frame };
        for i in 0..2_000 {
            let picked = light::pick(&frame, &view, &packed.lights, pcg4d(i, 1, 2, 3));
            assert_eq!(picked.pmf, light::pmf(&frame, &view, &packed.lights, picked.address));
            let light = light::light_at(&frame, &view, picked.address);
            assert_eq!(light::address_of(&frame, &view, light), picked.address);
            let place = light::find(&frame, &view, light);
            let hit = Hit { t: 1.0, u: 0.0, v: 0.0, triangle: place.triangle, instance: place.instance };
            assert_eq!(light::of_hit(&frame, &view, &hit), light);
        }
    }
    let dark = Hit { t: 1.0, u: 0.0, v: 0.0, triangle: 0, instance: 0 };
    let lights: Vec<u32> = (0..300).map(|t| light::of_hit(&frame, &view, &Hit { triangle: t, ..dark })).collect();
    assert_eq!(lights.iter().filter(|&&l| l == light::NO_LIGHT).count(), 270);
}

/// A mesh without triangles has nothing to find, whether rays look for it or not: it takes its place among the instances.
#[test]
fn an_unseen_mesh_without_triangles_does_no_harm() {
    let mut scene = soup(100);
    let still = |mesh| Instance { mesh, world_from_object: Mat4::IDENTITY, motion: Motion::Still };
    scene.meshes.insert(0, Mesh { name: "nothing".into(), unseen: true, ..Mesh::default() });
    scene.instances.iter_mut().for_each(|instance| instance.mesh += 1);
    scene.instances.insert(0, still(0));
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let placement = packed.buffers().placement;
    assert!(placement.blocks[0][1] <= placement.capacity);
    assert_eq!(packed.frame.light_count, PackedScene::new(&soup(100), 0.0).expect("packs").frame.light_count);
}
