use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{Quat, UVec2};
use weir_shared::{
    alias,
    frame::Frame,
    light::{self, Address, LightPoint},
    light_tree::{MAX_DEPTH, Walk},
    numerics::pack_cell,
    presample::{LEVEL_CELLS, LEVELS, cell_record},
    rng::{Rng, Stage},
    scene::Scene as SceneView,
};

use super::*;
use crate::{
    packed::PackedScene,
    scene::{DistantLight, Instance, Motion, Scene, lights},
};

/// Lights of these shapes, each with its emission, placement and faces.
fn scene(all: &[(Shape, Vec3, Mat4, bool)]) -> Scene {
    let mut scene = Scene::default();
    for &(shape, emission, world_from_object, two_sided) in all {
        let mesh = lights::add_shape(&mut scene, shape, emission, two_sided);
        scene.instances.push(Instance { mesh, world_from_object, motion: Motion::Still });
    }
    scene.validate().expect("a sound scene");
    scene
}

fn packed(scene: &Scene) -> PackedScene {
    PackedScene::new(scene, 0.0).expect("packs")
}

fn view(packed: &PackedScene) -> SceneView<'_> {
    SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels }
}

fn point_of(packed: &PackedScene, light: u32, u: f32, v: f32) -> LightPoint {
    light::evaluate::<false, true>(&packed.frame, &view(packed), light, pack_cell(u, v))
}

/// Irradiance at `position` with `normal` from light `light`, by the midpoint rule over (u, v).
fn irradiance(packed: &PackedScene, light: u32, position: Vec3, normal: Vec3, side: u32) -> f64 {
    let mut sum = 0.0;
    for i in 0..side * side {
        let at = |i: u32| (i as f32 + 0.5) / side as f32;
        let arriving = light::arriving::<true>(position, &point_of(packed, light, at(i % side), at(i / side)));
        assert_eq!(arriving.solid_angle, 0.0, "a direction would find it");
        sum += f64::from(arriving.irradiance.x * normal.dot(arriving.direction).max(0.0));
    }
    sum / f64::from(side * side)
}

fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
}

/// A placement that turns, mirrors and stretches.
fn askew() -> Mat4 {
    Mat4::from_rotation_translation(Quat::from_rotation_x(0.4), Vec3::new(1.0, 2.0, -0.5))
        * Mat4::from_scale(Vec3::new(-1.5, 0.7, 2.0))
        * Mat4::from_rotation_z(0.3)
}

const SPOT: Shape = Shape::Spot { inner_deg: 20.0, outer_deg: 40.0 };

#[test]
fn a_point_has_intensity_over_distance_squared() {
    let packed = packed(&scene(&[(Shape::Point, Vec3::splat(5.0), Mat4::from_translation(Vec3::Y * 3.0), false)]));
    for x in [0.0, 1.0, 7.0] {
        let d2: f64 = x * x + 9.0;
        close(irradiance(&packed, 0, Vec3::X * x as f32, Vec3::Y, 2), 5.0 / d2 * 3.0 / d2.sqrt(), 1e-6);
    }
    // At distance zero nothing is defined, and nothing arrives.
    assert_eq!(irradiance(&packed, 0, Vec3::Y * 3.0, Vec3::Y, 1), 0.0);
}

#[test]
fn a_spot_falls_off_between_its_cones() {
    let down = lights::along(Vec3::Y * 2.0, Vec3::NEG_Y);
    let hard = Shape::Spot { inner_deg: 90.0, outer_deg: 90.0 };
    let packed = packed(&scene(&[(SPOT, Vec3::splat(8.0), down, false), (hard, Vec3::splat(8.0), down, false)]));
    for degrees in [0.0f64, 10.0, 19.9, 25.0, 30.0, 39.0, 39.9, 40.1, 60.0, 89.0, 100.0, 180.0] {
        let angle = degrees.to_radians();
        let below = Vec3::new(angle.sin() as f32, 2.0 - angle.cos() as f32, 0.0);
        let toward = (Vec3::Y * 2.0 - below).normalize();
        let (inner, outer) = (20f64.to_radians().cos(), 40f64.to_radians().cos());
        let falloff = ((angle.cos() - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
        let seen = irradiance(&packed, 0, below, toward, 1);
        assert!((seen - 8.0 * falloff).abs() < 1e-4, "{degrees}: {seen} {}", 8.0 * falloff);
        let seen = irradiance(&packed, 1, below, toward, 1);
        assert!((seen - if degrees < 90.0 { 8.0 } else { 0.0 }).abs() < 1e-4, "{degrees}: {seen}");
    }
}

#[test]
fn a_sphere_shines_on_a_plane_like_its_projection() {
    let ball = Mat4::from_translation(Vec3::new(1.0, 2.0, 0.5)) * Mat4::from_scale(Vec3::splat(0.4));
    let packed = packed(&scene(&[(Shape::Sphere, Vec3::splat(3.0), ball, false)]));
    for position in [Vec3::ZERO, Vec3::X * 4.0, Vec3::new(1.0, 0.0, 0.5)] {
        let toward = (Vec3::new(1.0, 2.0, 0.5) - position).as_dvec3();
        let cosine = toward.normalize().y;
        let expected = 3.0 * PI * 0.16 / toward.length_squared() * cosine;
        close(irradiance(&packed, 0, position, Vec3::Y, 512), expected, 2e-3);
    }
    assert_eq!(irradiance(&packed, 0, Vec3::new(1.1, 2.1, 0.5), Vec3::Y, 32), 0.0, "inside it is dark");
}

#[test]
fn a_rectangle_shines_as_quadrature_says_to_its_front() {
    for two_sided in [false, true] {
        let matrix = askew();
        let packed = packed(&scene(&[(Shape::Rectangle, Vec3::splat(2.0), matrix, two_sided)]));
        let world = matrix.as_dmat4();
        let front = world.inverse().transpose().transform_vector3(DVec3::Z).normalize();
        let area = 4.0 * world.x_axis.truncate().cross(world.y_axis.truncate()).length();
        for side in [1.0, -1.0] {
            let position = world.w_axis.truncate() + front * side * 1.3 + DVec3::new(0.2, 0.1, 0.3);
            let mut expected = 0.0;
            const N: i32 = 400;
            for i in 0..N * N {
                let at = |i: i32| 2.0 * (f64::from(i) + 0.5) / f64::from(N) - 1.0;
                let toward = world.transform_point3(DVec3::new(at(i % N), at(i / N), 0.0)) - position;
                let emitted = -front.dot(toward.normalize());
                let emitted = if two_sided { emitted.abs() } else { emitted.max(0.0) };
                expected += 2.0 * emitted * (-front * side).dot(toward.normalize()).max(0.0) / toward.length_squared();
            }
            expected *= area / f64::from(N * N);
            assert_eq!(expected > 0.0, side > 0.0 || two_sided);
            let normal = (-front * side).as_vec3();
            close(irradiance(&packed, 0, position.as_vec3(), normal, 64), expected, 1e-3);
        }
    }
}

#[test]
fn a_directional_light_has_its_irradiance_everywhere() {
    let direction = Vec3::new(0.6, -0.8, 0.0);
    let mut scene = scene(&[]);
    scene.distant.push(DistantLight { direction, irradiance: Vec3::splat(7.0) });
    let packed = packed(&scene);
    for position in [Vec3::ZERO, Vec3::splat(1e6)] {
        close(irradiance(&packed, light::ENVIRONMENT_BIT, position, Vec3::Y, 2), 7.0 * 0.8, 1e-6);
    }
    assert!(!light::exists(&packed.frame, light::ENVIRONMENT_BIT | 1));
    assert!(light::exists(&packed.frame, light::ENVIRONMENT_BIT));
}

/// Tables weigh lights by their power: pi times the weight is the integral of what is emitted.
#[test]
fn weights_are_power_as_that_of_triangles_is() {
    let integral = |intensity: &dyn Fn(f64) -> f64| {
        const N: u32 = 100_000;
        let at = |i: u32| PI * (f64::from(i) + 0.5) / f64::from(N);
        (0..N).map(|i| intensity(at(i)) * at(i).sin()).sum::<f64>() * TAU * PI / f64::from(N)
    };
    let weight = |shape: Shape, matrix: Mat4, two_sided: bool| {
        let scene = scene(&[(shape, Vec3::splat(1.0 / 3.0), matrix, two_sided)]);
        let shape = ShapeLight::new(&scene.meshes[0], &scene.materials).expect("a shape");
        shape.bounds(&matrix, 1.0).power * PI
    };
    let placed = askew();
    close(weight(Shape::Point, placed, false), 4.0 * PI, 1e-6);
    for (inner_deg, outer_deg) in [(20.0, 40.0), (0.0, 90.0), (30.0, 30.0), (89.0, 90.0), (0.0, 1.0), (1.0, 1.0)] {
        let (inner, outer) = (cosine(inner_deg), cosine(outer_deg));
        let edge = (inner - outer).max(LEAST_EDGE);
        let falloff = |angle: f64| ((angle.cos() - outer) / edge).clamp(0.0, 1.0).powi(2);
        close(weight(Shape::Spot { inner_deg, outer_deg }, placed, false), integral(&falloff), 1e-3);
    }
    let radius2 = f64::from(1.5f32 * 0.7 * 2.0).powf(2.0 / 3.0);
    close(weight(Shape::Sphere, placed, false), 4.0 * PI * PI * radius2, 1e-5);
    let area = 4.0 * placed.x_axis.truncate().cross(placed.y_axis.truncate()).length();
    close(weight(Shape::Rectangle, placed, false), PI * f64::from(area), 1e-5);
    close(weight(Shape::Rectangle, placed, true), TAU * f64::from(area), 1e-5);
    // A rectangle of triangles in the same place has the weight of one in closed form.
    let mut both = scene(&[(Shape::Rectangle, Vec3::ONE, placed, false)]);
    both.meshes.push(crate::stress::scenes::quad("quad", Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, 0));
    let rigid = Mat4::from_rotation_y(FRAC_PI_2 as f32);
    both.instances[0].world_from_object = rigid;
    both.instances.push(Instance { mesh: 1, world_from_object: rigid, motion: Motion::Still });
    let packed = packed(&both);
    close(f64::from(alias::pmf(&packed.lights, 0, 0)), 0.5, 1e-6);
}

/// Lights all over the place, of which none may be left out where it shines.
fn crowd() -> Scene {
    let mut all = Vec::new();
    for i in 0..60u32 {
        let [x, y, z, w] = weir_shared::rng::pcg4d(i, 1, 2, 3).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0);
        let turn = Quat::from_xyzw(x, y + 0.1, z, w).normalize();
        let at = Vec3::new(z, w, x) * 3.0;
        let shape = match i % 5 {
            0 => Shape::Point,
            1 => SPOT,
            2 => Shape::Spot { inner_deg: 90.0, outer_deg: 90.0 },
            3 => Shape::Sphere,
            _ => Shape::Rectangle,
        };
        let scale = if i % 2 == 0 { Vec3::splat(0.2) } else { Vec3::new(-0.2, 0.3, 0.1) };
        let matrix = Mat4::from_scale_rotation_translation(scale, turn, at);
        all.push((shape, Vec3::splat(1e-3 + (y + 1.0).powi(8)), matrix, i % 10 == 4));
    }
    scene(&all)
}

#[test]
fn tables_trees_and_cells_have_every_light_wherever_it_shines() {
    let packed = packed(&crowd());
    let frame = Frame {
        cell_size: 0.5,
        cell_candidates: 512,
        presampled_columns: 64,
        presampled_rows: LEVELS * LEVEL_CELLS,
        source: light::source::POWER,
        ..packed.frame
    };
    let (view, lights) = (view(&packed), &packed.lights);
    let mut shone = 0;
    for i in 0..4_000u32 {
        let number = |j: u32| weir_shared::rng::pcg4d(i, j, 5, 6).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0);
        let ([x, y, z, u], [a, b, c, v]) = (number(0), number(1));
        let (position, normal) = (Vec3::new(x, y, z) * 3.5, Vec3::new(a, b, c).normalize());
        let light = i % frame.light_count;
        let point = light::evaluate::<false, true>(&frame, &view, light, pack_cell(u * 0.5 + 0.5, v * 0.5 + 0.5));
        let arriving = light::arriving::<true>(position, &point);
        if arriving.irradiance.x * normal.dot(arriving.direction) <= 0.0 {
            continue;
        }
        shone += 1;
        let goal = light::address_of(&frame, &view, light);
        assert_eq!(goal, Address { emitter: light, local: 0 });
        assert!(light::pmf(&frame, &view, lights, goal) > 0.0);
        let rng = Rng::for_pixel(UVec2::ZERO, &frame, Stage::LightTree);
        let reached = Walk::new(&frame, lights, position, normal, true, goal, rng).finish(&frame, &view, lights);
        assert!(reached.address == goal && reached.pmf > 0.0, "light {light} is not in the tree");
    }
    assert!(shone > 500 && MAX_DEPTH > 1, "{shone}");
    // Records of cells hold shapes with all that makes them shine, or say that they do not.
    let mut records = 0;
    for row in 0..LEVEL_CELLS {
        let record = cell_record::<false, true>(UVec2::new(3, row), &frame, &view, lights);
        if !record.has_light() {
            continue;
        }
        records += 1;
        let point = light::evaluate::<false, true>(&frame, &view, record.light, record.uv);
        assert_eq!(record.is_punctual(), point.punctual);
        assert!(record.point().analytic);
        if !point.punctual {
            let [a, b] = [point, record.point()].map(|p| light::arriving::<true>(Vec3::splat(5.0), &p).irradiance);
            assert!(a.abs_diff_eq(b, 1e-5 * a.x), "{a} {b}");
        }
    }
    assert!(records > 100, "{records}");
}

#[test]
fn no_ray_finds_a_shape_and_a_scene_of_shapes_alone_is_one() {
    use weir_shared::{
        bvh::closest_hit,
        ray::{FAR, Ray},
    };
    let packed = packed(&crowd());
    assert_eq!(packed.frame.light_count, 60);
    let ray = Ray { origin: Vec3::splat(9.0), direction: Vec3::NEG_ONE, t_max: FAR };
    assert!(closest_hit::<false, true>(&packed.frame, &view(&packed), &packed.bvh, &ray).is_miss());
    use weir_shader::wiring::Feature;
    for feature in [Feature::ENVIRONMENT, Feature::INSTANCES] {
        assert!(packed.content.features().contains(&feature), "{feature:?}");
    }
}

#[test]
fn a_moving_shape_keeps_its_id_between_frames_and_moves() {
    let mut scene = scene(&[
        (Shape::Point, Vec3::ONE, Mat4::from_translation(Vec3::Y), false),
        (Shape::Sphere, Vec3::ONE, Mat4::IDENTITY, false),
    ]);
    scene.instances[0].motion = Motion::Swing { offset: Vec3::X, frequency_hz: 0.25, phase: 0.0 };
    let mut packed = packed(&scene);
    let before = packed.frame;
    packed.set_time(1.0).expect("moves");
    let now = packed.frame;
    let scene = view(&packed);
    let at = |frame: &Frame, id: u32| light::evaluate::<false, true>(frame, &scene, id, 0).position;
    assert!(at(&before, 0).abs_diff_eq(Vec3::Y, 1e-6) && at(&now, 0).abs_diff_eq(Vec3::new(1.0, 1.0, 0.0), 1e-6));
    assert_eq!([0, 1].map(|id| light::translate(&before, &now, &scene, id)), [0, 1]);
}

#[test]
fn shapes_without_emission_are_no_lights() {
    let packed = packed(&scene(&[(Shape::Point, Vec3::ZERO, Mat4::IDENTITY, false)]));
    assert_eq!((packed.frame.light_count, packed.frame.emitter_count), (0, 0));
    assert!(!packed.content.shines());
}
