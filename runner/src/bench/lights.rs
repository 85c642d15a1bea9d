//! Scenes that differ in the number of their lights alone.

use glam::Vec3;

use crate::scene::Scene;

/// `scene` with at least `wanted` of its emissive triangles, over all instances, as far as it has them; the others are
/// dark. Which ones is a matter of an even spread over meshes and their triangles.
pub fn with_lights(scene: &Scene, wanted: u64) -> Scene {
    let mut instances = vec![0u64; scene.meshes.len()];
    scene.instances.iter().for_each(|instance| instances[instance.mesh as usize] += 1);
    let emits = |mesh: usize, triangle: usize| {
        let material = scene.meshes[mesh].materials[triangle] as usize;
        scene.materials[material].emission != Vec3::ZERO
    };
    let mut all: Vec<(usize, usize)> = Vec::new();
    for (mesh, triangles) in scene.meshes.iter().enumerate() {
        all.extend((0..triangles.triangles.len()).filter(|&t| emits(mesh, t)).map(|t| (mesh, t)));
    }
    // In the order of multiples of the golden ratio, but those with few instances first: few lights need them.
    let spread = |i: usize| (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by_key(|&i| (instances[all[i].0].max(1).ilog2(), spread(i)));
    let mut kept = vec![false; all.len()];
    let mut count = 0;
    for i in order {
        if count >= wanted {
            break;
        }
        kept[i] = true;
        count += instances[all[i].0];
    }
    let mut dimmed = scene.clone();
    let dark: Vec<u32> = scene
        .materials
        .iter()
        .map(|material| {
            dimmed.materials.push(crate::scene::Material {
                emission: Vec3::ZERO,
                emission_texture: None,
                ..material.clone()
            });
            dimmed.materials.len() as u32 - 1
        })
        .collect();
    for ((mesh, triangle), _) in all.into_iter().zip(kept).filter(|(_, kept)| !kept) {
        let material = &mut dimmed.meshes[mesh].materials[triangle];
        *material = dark[*material as usize];
    }
    dimmed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn scenes_have_about_as_many_lights_as_wanted_and_all_of_their_geometry() {
        let park = (builtin::find("park").expect("built in").build)();
        for wanted in [100, 10_000, u64::MAX] {
            let dimmed = with_lights(&park, wanted);
            let (found, all) = (dimmed.emissive_triangle_count(), park.emissive_triangle_count());
            assert!(found >= wanted.min(all) && found <= wanted.saturating_mul(4).min(all), "{found} of {wanted}");
            assert_eq!(dimmed.triangle_count(), park.triangle_count());
        }
    }
}
