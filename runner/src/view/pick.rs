//! What is under the pointer: a ray on the host, and lights in words.

use glam::{UVec2, Vec3};
use weir_shader::wiring::Feature;
use weir_shared::{
    bvh,
    camera::ray_through,
    environment,
    frame::Frame,
    light::{self, ENVIRONMENT_BIT},
    reservoir::Reservoir,
    scene::{Scene as SceneView, material_record, shape},
};

use crate::packed::PackedScene;

/// What a ray has found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// Where, in world space.
    pub position: Vec3,
    /// The instance of the scene.
    pub instance: u32,
    /// Corners of the triangle, in the packed space of its mesh (`PackedScene::object_origin`).
    pub corners_object: [Vec3; 3],
    /// Whether it is a light.
    pub emits: bool,
}

/// The buffers of a scene, as passes see them.
pub fn view_of(packed: &PackedScene) -> SceneView<'_> {
    SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels }
}

/// What the ray through the middle of a pixel finds.
pub fn at(packed: &PackedScene, frame: &Frame, px: UVec2) -> Option<Picked> {
    let (scene, bvh) = (view_of(packed), packed.bvh.as_slice());
    let ray = ray_through(frame, px.x as f32 + 0.5, px.y as f32 + 0.5);
    let has = |feature| packed.features.contains(&feature);
    let hit = match (has(Feature::TEXTURES), has(Feature::INSTANCES)) {
        (false, false) => bvh::closest_hit::<false, false>(frame, &scene, bvh, &ray),
        (true, false) => bvh::closest_hit::<true, false>(frame, &scene, bvh, &ray),
        (false, true) => bvh::closest_hit::<false, true>(frame, &scene, bvh, &ray),
        (true, true) => bvh::closest_hit::<true, true>(frame, &scene, bvh, &ray),
    };
    if hit.is_miss() {
        return None;
    }
    let material = scene.material_of(frame, hit.instance, hit.triangle);
    let corner = |i: usize| Vec3::from_slice(&packed.triangles[hit.triangle as usize * 9 + 3 * i..]);
    Some(Picked {
        position: ray.origin + ray.direction * hit.t + packed.origin,
        instance: packed.scene_instance(hit.instance)?,
        corners_object: [corner(0), corner(1), corner(2)],
        emits: scene.material_rgb(material, material_record::EMISSION).max_element() > 0.0,
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
        shape::TRIANGLES => format!("light {light}: triangle {}{instance}", place.triangle),
        shape::PUNCTUAL => format!("light {light}: point or spot{instance}"),
        shape::SPHERE => format!("light {light}: sphere{instance}"),
        _ => format!("light {light}: rectangle{instance}"),
    }
}
