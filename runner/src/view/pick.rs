//! What is under the pointer: a ray on the host, and lights in words.

use glam::{UVec2, Vec3};
use weir_shared::{
    bvh,
    camera::ray_through,
    environment,
    frame::Frame,
    light::{self, ENVIRONMENT_BIT},
    ray::{Hit, Ray},
    reservoir::Reservoir,
    scene::{Scene as SceneView, emitter_record, instance_record, material_record, shape},
};

use crate::packed::PackedScene;

/// What a ray has found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// Where, in world space.
    pub position: Vec3,
    /// The instance of the scene.
    pub instance: u32,
    /// Corners of the triangle, if it is one, in the packed space of its mesh (`PackedScene::object_origin`).
    pub corners_object: [Vec3; 3],
    /// Whether it is a light.
    pub emits: bool,
}

/// The buffers of a scene, as passes see them.
pub fn view_of(packed: &PackedScene) -> SceneView<'_> {
    SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels }
}

/// How far a ray may miss a shape and still pick it: the tangent of two degrees.
const REACH: f32 = 0.035;
/// The same of one of many unseen triangles: of a fifth of a degree.
const REACH_OF_MANY: f32 = 0.0035;

/// A light that rays don't find, as a ray passes it.
struct Near {
    instance: u32,
    /// Its triangle; nothing for a shape.
    triangle: Option<u32>,
    /// Distance along the ray.
    along: f32,
    /// Tangent of the angle to the ray.
    angle: f32,
}

/// The light that rays don't find that a ray passes nearest to, by the angle, no farther than `t_max`.
fn light_near(frame: &Frame, scene: &SceneView<'_>, ray: &Ray, t_max: f32) -> Option<Near> {
    let passed = |instance: u32, triangle: Option<u32>, center: Vec3, (reach, size): (f32, f32)| {
        let toward = center - ray.origin;
        let along = toward.dot(ray.direction);
        let across = (toward - ray.direction * along).length();
        let is_near = along > 0.0 && along < t_max && across <= along * reach + size;
        is_near.then_some(Near { instance, triangle, along, angle: across / along })
    };
    let nearer = |a: &Near, b: &Near| a.angle.total_cmp(&b.angle);
    let of_emitter = |emitter: u32| {
        let instance = scene.emitter_word(frame, emitter, emitter_record::INSTANCE);
        let matrix = scene.instance_at(frame, instance) + instance_record::WORLD_FROM_OBJECT;
        let edge = |axis: Vec3| scene.transform_vector(matrix, axis).length();
        let size = match scene.shape_of(frame, instance) {
            shape::TRIANGLES => return None,
            shape::UNSEEN => {
                let lights = 0..scene.instance_word(frame, instance, instance_record::LIGHT_COUNT);
                let of_light = |local: u32| {
                    let triangle = light::place_of(frame, scene, light::Address { emitter, local }).triangle;
                    let world = scene.world_triangle(frame, instance, triangle);
                    passed(instance, Some(triangle), world.point(1.0 / 3.0, 1.0 / 3.0), (REACH_OF_MANY, 0.0))
                };
                return lights.filter_map(of_light).min_by(nearer);
            }
            shape::SPHERE => f32::from_bits(scene.instance_word(frame, instance, instance_record::RADIUS)),
            shape::RECTANGLE => edge(Vec3::X).min(edge(Vec3::Y)),
            _ => 0.0,
        };
        passed(instance, None, scene.transform_point(matrix, Vec3::ZERO), (REACH, size))
    };
    (0..frame.emitter_count).filter_map(of_emitter).min_by(nearer)
}

/// What the ray through the middle of a pixel finds: a light that it passes near to, though it can't be seen, or else the
/// first triangle.
pub fn at(packed: &PackedScene, frame: &Frame, px: UVec2) -> Option<Picked> {
    let (scene, bvh) = (view_of(packed), packed.bvh.as_slice());
    let ray = ray_through(frame, px.x as f32 + 0.5, px.y as f32 + 0.5);
    let hit = match (packed.content.masks, packed.content.instances) {
        (false, false) => bvh::closest_hit::<false, false>(frame, &scene, bvh, &ray),
        (true, false) => bvh::closest_hit::<true, false>(frame, &scene, bvh, &ray),
        (false, true) => bvh::closest_hit::<false, true>(frame, &scene, bvh, &ray),
        (true, true) => bvh::closest_hit::<true, true>(frame, &scene, bvh, &ray),
    };
    let corners_of = |triangle: u32| {
        let corner = |i: usize| Vec3::from_slice(&packed.triangles[triangle as usize * 9 + 3 * i..]);
        [corner(0), corner(1), corner(2)]
    };
    let emits = |hit: &Hit| {
        let material = scene.material_of(frame, hit.instance, hit.triangle);
        scene.material_rgb(material, material_record::EMISSION).max_element() > 0.0
    };
    let is_light = !hit.is_miss() && emits(&hit);
    // What is seen goes before one of many that are not.
    let near = light_near(frame, &scene, &ray, hit.t).filter(|near| near.triangle.is_none() || !is_light);
    if let Some(near) = near {
        return Some(Picked {
            position: ray.origin + ray.direction * near.along + packed.origin,
            instance: packed.scene_instance(near.instance)?,
            corners_object: near.triangle.map_or([Vec3::ZERO; 3], corners_of),
            emits: true,
        });
    }
    if hit.is_miss() {
        return None;
    }
    Some(Picked {
        position: ray.origin + ray.direction * hit.t + packed.origin,
        instance: packed.scene_instance(hit.instance)?,
        corners_object: corners_of(hit.triangle),
        emits: is_light,
    })
}

/// The light of a reservoir.
pub fn light_in_words(packed: &PackedScene, frame: &Frame, reservoir: &Reservoir) -> String {
    let light = reservoir.light;
    if !reservoir.has_sample() {
        return "none".to_owned();
    }
    if light & ENVIRONMENT_BIT != 0 {
        let texel = light & !ENVIRONMENT_BIT;
        let width = frame.environment_width.max(1);
        if let Some(number) = texel.checked_sub(environment::texel_count(frame)) {
            return format!("directional light {number}");
        }
        return format!("texel ({}, {}) of the environment", texel % width, texel / width);
    }
    if light >= frame.light_count {
        return format!("light {light}, which the scene does not have now");
    }
    let scene = view_of(packed);
    let place = light::find(frame, &scene, light);
    let instance = packed.scene_instance(place.instance).map_or_else(String::new, |i| format!(" of instance {i}"));
    match scene.shape_of(frame, place.instance) {
        shape::TRIANGLES | shape::UNSEEN => format!("light {light}: triangle {}{instance}", place.triangle),
        shape::PUNCTUAL => format!("light {light}: point or spot{instance}"),
        shape::SPHERE => format!("light {light}: sphere{instance}"),
        _ => format!("light {light}: rectangle{instance}"),
    }
}
