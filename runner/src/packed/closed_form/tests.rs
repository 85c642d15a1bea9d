use glam::{Mat4, Vec3};
use weir_shared::{
    bvh::unoccluded,
    closed_form::{NO_TREES, reflected},
    light::{evaluate, shadow_ray},
    ray::Hit,
    rng::pcg4d,
    scene::{Scene as View, instance_record},
    surface::{Found, Surface, surface_at},
    target::Domain,
};

use crate::{
    packed::{Moment, PackOptions, PackedScene},
    scene::{Instance, Material, Motion, Scene, Texture, builtin},
    stress::scenes::quad,
};

fn built_in(name: &str) -> Scene {
    (builtin::find(name).expect("built in").build)()
}

fn packed(scene: &Scene) -> PackedScene {
    let options = PackOptions { closed_form: true, ..PackOptions::default() };
    PackedScene::with(scene, &Moment::default(), options).expect("packs")
}

fn view(packed: &PackedScene) -> View<'_> {
    View { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels }
}

/// Uniform numbers in 0..1.
fn random([a, b, c, d]: [u32; 4]) -> [f32; 4] {
    pcg4d(a, b, c, d).map(weir_shared::numerics::unit_float)
}

/// Points on both sides of every triangle, `each` on each.
fn points(packed: &PackedScene, each: u32) -> Vec<(Hit, Found)> {
    let (frame, view) = (&packed.frame, view(packed));
    let mut found = Vec::new();
    for instance in 0..frame.instance_count {
        let first = view.instance_word(frame, instance, instance_record::FIRST_TRIANGLE);
        let mesh = &packed.meshes[packed.dynamics.top.mesh(packed.scene_instance(instance).expect("drawn")) as usize];
        for triangle in first..first + mesh.count {
            for number in 0..2 * each {
                let [a, b, ..] = random([instance, triangle, number, 0]);
                let (u, v) = if a + b < 1.0 { (a, b) } else { (1.0 - a, 1.0 - b) };
                let hit = Hit { t: 1.0, u, v, triangle, instance };
                let normal = view.world_triangle(frame, instance, triangle).doubled_area_normal().normalize();
                let direction = if number % 2 == 0 { normal } else { -normal };
                found.push((hit, surface_at::<false>(frame, &view, &hit, direction)));
            }
        }
    }
    found
}

/// Checks at many points what is said to be known there, by rays: what each light sends is wholly seen or not at all, and its
/// sum is the radiance. Returns how many points are known, of how many, and of how many not all of the light is seen.
fn check(packed: &PackedScene, each: u32, name: &str) -> [usize; 3] {
    const ROOT: u32 = 12;
    let (frame, view) = (&packed.frame, view(packed));
    let points = points(packed, each);
    let mut known = [0, points.len(), 0];
    for (number, (hit, found)) in (0..).zip(&points) {
        let surface: &Surface = &found.surface;
        let reflected = reflected(frame, &view, hit, found);
        if !reflected.is_known {
            continue;
        }
        // Reflection of a Lambertian surface is the same wherever it is seen from.
        let domain = Domain::new(surface.position() + surface.normal_geometric(), surface);
        let (mut sum, mut is_shaded) = (Vec3::ZERO, false);
        for id in 0..frame.light_count {
            let (mut of_light, mut seen, mut hidden) = (Vec3::ZERO, 0, 0);
            for i in 0..ROOT * ROOT {
                let [x, y, ..] = random([number, id, i, 1]);
                let place = |stratum: u32, x: f32| (((stratum as f32 + x) / ROOT as f32) * 65535.0) as u32;
                let point = evaluate::<false, false>(frame, &view, id, place(i % ROOT, x) | (place(i / ROOT, y) << 16));
                let arrives = domain.reflected::<false, false>(&point);
                // What grazes the horizon, or is the horizon, is worth nothing and may be hidden.
                if arrives.max_element() <= 1e-5 {
                    continue;
                }
                let ray = shadow_ray::<false>(surface, &point);
                if unoccluded::<true, true>(frame, &view, &packed.bvh, &ray) {
                    (seen, of_light) = (seen + 1, of_light + arrives);
                } else {
                    hidden += 1;
                }
            }
            assert!(seen == 0 || hidden == 0, "{name}: {hit:?} sees a part of light {id}: {seen}, not {hidden}");
            is_shaded |= hidden > 0;
            sum += of_light / (ROOT * ROOT) as f32;
        }
        let (expected, actual) = (sum.max_element(), reflected.radiance.max_element());
        assert!((actual - expected).abs() <= 0.03 * expected + 5e-3, "{name}: {hit:?}: {actual}, by rays {expected}");
        known[0] += 1;
        known[2] += usize::from(is_shaded);
    }
    known
}

#[test]
fn what_is_known_of_the_cornell_box_is_what_rays_find() {
    let [known, all, shaded] = check(&packed(&built_in("cornell")), 60, "cornell");
    println!("{known} of {all} points known, {shaded} of them shaded");
    assert!(known * 9 > all * 4 && shaded > 50, "{known} of {all} points, {shaded} shaded");
}

/// Boxes and plates at random places and turns under lamps of random size, some of which shine to both sides.
fn random_scene(seed: u32) -> Scene {
    let number = |of: u32, what: u32| random([seed, of, what, 2]);
    let matte = |r: f32| Material { base_color: Vec3::new(0.2 + 0.7 * r, 0.5, 0.9 - 0.6 * r), ..Material::default() };
    let mut scene = Scene { name: format!("random {seed}"), ..Scene::default() };
    for i in 0..3 {
        scene.materials.push(matte(number(i, 0)[0]));
    }
    let emission = Vec3::new(3.0, 2.0, 1.0);
    scene.materials.push(Material {
        emission,
        base_color: Vec3::ZERO,
        two_sided_emission: seed.is_multiple_of(3),
        ..Material::default()
    });
    scene.meshes.push(quad("floor", Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 0));
    // Normals that are not those of the floor; and a mask, in some scenes far from the origin and with mirrored boxes.
    scene.meshes[0].normals = vec![Vec3::new(0.2, 1.0, 0.1).normalize(); 4];
    let texels = vec![0xffff_ffff, 0x00ff_ffff, 0x00ff_ffff, 0xffff_ffff];
    scene.textures.push(Texture { name: "holes".to_owned(), width: 2, height: 2, srgb: false, texels });
    let has_mask = seed % 4 == 1;
    scene.materials[2].alpha_texture = has_mask.then_some(0);
    let away = if seed % 5 == 2 { Vec3::new(300.0, -80.0, 20.0) } else { Vec3::ZERO };
    scene.meshes.push(quad("wall", Vec3::new(-2.0, 0.0, -2.0), Vec3::X * 4.0, Vec3::Y * 3.0, 1));
    for (axis, a, b) in [(Vec3::X, Vec3::Y, Vec3::Z), (Vec3::Y, Vec3::Z, Vec3::X), (Vec3::Z, Vec3::X, Vec3::Y)] {
        scene.meshes.push(quad("side", axis - a - b, a * 2.0, b * 2.0, 2));
        scene.meshes.push(quad("side", -axis + a - b, a * -2.0, b * 2.0, 2));
    }
    scene.meshes.push(quad("lamp", Vec3::new(-0.5, 0.0, -0.5), Vec3::X, Vec3::Z, 3));
    let mut place = |mesh: u32, world_from_object: Mat4| {
        let world_from_object = Mat4::from_translation(away) * world_from_object;
        scene.instances.push(Instance { mesh, world_from_object, motion: Motion::Still });
    };
    place(0, Mat4::IDENTITY);
    place(1, Mat4::IDENTITY);
    for i in 0..2 + seed % 3 {
        let ([x, z, turn, y], [a, b, c, _]) = (number(i, 3), number(i, 4));
        let at = Vec3::new(3.0 * x - 1.5, 0.3 + 0.8 * y, 3.0 * z - 1.5);
        let turn = Mat4::from_rotation_y(turn * 6.0) * Mat4::from_rotation_x(if i == 0 { 0.0 } else { a });
        let mirror = if (seed + i).is_multiple_of(3) { -1.0 } else { 1.0 };
        let size = Mat4::from_scale(Vec3::new(mirror * (0.1 + 0.3 * a), 0.1 + 0.3 * b, 0.1 + 0.3 * c));
        (2..8).for_each(|side| place(side, Mat4::from_translation(at) * turn * size));
    }
    for i in 0..1 + seed % 4 {
        let ([x, z, size, y], [tilt, ..]) = (number(i, 5), number(i, 6));
        let at = Vec3::new(2.0 * x - 1.0, 2.0 + y, 2.0 * z - 1.0);
        let tilt = Mat4::from_rotation_x(tilt - 0.5);
        place(8, Mat4::from_translation(at) * tilt * Mat4::from_scale(Vec3::splat(0.1 + size)));
    }
    scene
}

#[test]
fn what_is_known_of_random_scenes_is_what_rays_find() {
    let mut sums = [0; 3];
    for seed in 0..60 {
        let scene = random_scene(seed);
        let found = check(&packed(&scene), 6, &scene.name);
        sums.iter_mut().zip(found).for_each(|(sum, found)| *sum += found);
    }
    let [known, all, shaded] = sums;
    println!("{known} of {all} points known, {shaded} of them shaded");
    assert!(known * 5 > all && known < all && shaded > 20, "{known} of {all} points, {shaded} shaded");
}

/// A scene with something that the closed form does not know of has none, and none where it does.
#[test]
fn only_what_is_simple_enough_has_a_closed_form() {
    let plain = built_in("cornell");
    assert!(packed(&plain).content.closed_form);
    assert!(!PackedScene::new(&plain, 0.0).expect("packs").content.closed_form, "nobody asked");
    let options = PackOptions { closed_form: true, dynamic: true, ..PackOptions::default() };
    let dynamic = PackedScene::with(&plain, &Moment::default(), options).expect("packs");
    assert!(!dynamic.content.closed_form, "anything may move");
    let changed = |change: &dyn Fn(&mut Scene)| {
        let mut scene = plain.clone();
        change(&mut scene);
        packed(&scene).content.closed_form
    };
    assert!(!changed(&|s| s.materials.iter_mut().for_each(|m| m.metallic = 0.5)), "everything mirrors");
    assert!(
        !changed(&|s| s.instances[0].motion = Motion::Turn { center: Vec3::ZERO, axis: Vec3::Y, turns_per_second: 1.0 }),
        "it moves"
    );
    assert!(!changed(&|s| s.meshes[3].unseen = true), "rays don't find the light");
    // Ten lights; and triangles without number.
    assert!(!changed(&|s| (0..4).for_each(|_| s.instances.push(s.instances[3].clone()))));
    assert!(!changed(&|s| (0..30).for_each(|_| s.instances.push(s.instances[1].clone()))));
    for name in ["studio", "rooms", "park"] {
        assert!(!packed(&built_in(name)).content.closed_form, "{name}");
    }
    // Lights too small for a closed form are sampled everywhere, and a scene far too large or small for its digits.
    let center = Vec3::new(0.0, 1.99, 0.4);
    let is_lit = |scale: f32| {
        let mut scene = plain.clone();
        scene.meshes[3].positions.iter_mut().for_each(|p| *p = center + (*p - center) * scale);
        let packed = packed(&scene);
        let radiance = |(hit, found): &(Hit, Found)| reflected(&packed.frame, &view(&packed), hit, found).radiance;
        points(&packed, 20).iter().any(|point| radiance(point) != Vec3::ZERO)
    };
    assert!(is_lit(0.5) && !is_lit(0.005));
    for scale in [1e-9f32, 1e9] {
        let all = |s: &mut Scene| s.meshes.iter_mut().flat_map(|m| &mut m.positions).for_each(|p| *p *= scale);
        assert!(!changed(&|s| {
            all(s);
            s.instances
                .iter_mut()
                .for_each(|i| i.world_from_object.w_axis *= glam::Vec4::new(scale, scale, scale, 1.0));
        }));
    }
}

/// What was found of one moment is not said of another.
#[test]
fn another_moment_has_no_closed_form() {
    let mut packed = packed(&built_in("cornell"));
    let at = |packed: &PackedScene| view(packed).instance_word(&packed.frame, 0, instance_record::CLOSED_FORM_AT);
    let here = at(&packed);
    assert_ne!(here, NO_TREES);
    packed.show_anew(&Moment { time_s: 3.0, ..Moment::default() }).expect("shown");
    assert_eq!(at(&packed), here, "nothing moves by itself");
    packed.show_anew(&Moment { emission: vec![(0, Vec3::ONE)], ..Moment::default() }).expect("shown");
    assert_eq!(at(&packed), NO_TREES);
    packed.show_anew(&Moment::default()).expect("shown");
    assert_eq!(at(&packed), here);
}

#[test]
fn what_is_found_does_not_depend_on_threads() {
    let scene = random_scene(5);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool").install(|| packed(&scene));
    assert_eq!(one.records, packed(&scene).records);
}
