//! Rays a second of the host's traversal: `cargo bench --bench rays -- SCENE.obj [camera.json]`, or a built-in name.
//!
//! Closest hits of camera rays, closest hits of cosine-distributed rays from what those found, and shadow rays from
//! there to points of lights picked by power. Single rays, in tiles of 8x8 pixels, on all threads of the pool
//! (RAYON_NUM_THREADS sets how many). Prints the median of nine runs of each.

use std::{path::Path, time::Instant};

use glam::UVec2;
use rayon::prelude::*;
use weir::{
    packed::PackedScene,
    render::{Request, frame_of},
    scene::{Camera, builtin, camera, load},
    settings::Settings,
    technique::Technique,
};
use weir_shared::{
    bsdf::basis,
    bvh::{closest_hit, unoccluded},
    camera::camera_ray,
    frame::Frame,
    light,
    numerics::unit_float,
    ray::{FAR, Ray, offset_origin},
    rng::pcg4d,
    scene::Scene as SceneView,
    surface::{Surface, surface_at},
};

const WIDTH: u32 = 1280;
const HEIGHT: u32 = 720;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let name = arguments.first().map_or("rooms", String::as_str);
    let scene = match builtin::find(name) {
        Some(scene) => (scene.build)(),
        None => load::load(Path::new(name), &load::LoadOptions::default())?.scene,
    };
    let view = match (arguments.get(1), scene.camera) {
        (Some(path), _) => camera::load(Path::new(path))?,
        (None, Some(camera)) => camera,
        (None, None) => Camera::framing(scene.bounds().ok_or("the scene is empty")?),
    };
    let packed = PackedScene::new(&scene, 0.0)?;
    let request = Request::new(view, [WIDTH, HEIGHT], Technique::Candidates, Settings::default());
    let frame = frame_of(&packed, &request);
    println!("{name}: {WIDTH}x{HEIGHT} rays, {} threads", rayon::current_num_threads());
    if packed.content.instances {
        measure::<true>(&packed, &frame);
    } else {
        measure::<false>(&packed, &frame);
    }
    Ok(())
}

fn measure<const INSTANCES: bool>(packed: &PackedScene, frame: &Frame) {
    let scene = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    // Tiles of 8x8 pixels, as in the passes.
    let pixels: Vec<UVec2> = (0..WIDTH * HEIGHT)
        .map(|i| {
            let (tile, inside) = (i / 64, i % 64);
            UVec2::new(tile % (WIDTH / 8) * 8 + inside % 8, tile / (WIDTH / 8) * 8 + inside / 8)
        })
        .collect();
    let primary: Vec<Ray> = pixels.iter().map(|&px| camera_ray(px, frame)).collect();
    let surfaces: Vec<Option<(Surface, u32)>> = primary
        .par_iter()
        .enumerate()
        .map(|(i, ray)| {
            let hit = closest_hit::<false, INSTANCES>(frame, &scene, &packed.bvh, ray);
            (!hit.is_miss()).then(|| (surface_at::<false>(frame, &scene, &hit, ray.direction).surface, i as u32))
        })
        .collect();
    let bounce: Vec<Ray> = surfaces
        .iter()
        .flatten()
        .map(|(surface, i)| {
            let [a, b, ..] = pcg4d(*i, 1, 2, 3);
            let normal = surface.normal_geometric();
            let (tangent, bitangent) = basis(normal);
            let (sin, cos) = (unit_float(a) * core::f32::consts::TAU).sin_cos();
            let radius = unit_float(b).sqrt();
            let direction =
                tangent * (radius * cos) + bitangent * (radius * sin) + normal * (1.0 - unit_float(b)).sqrt();
            let origin = offset_origin(surface.position(), normal, surface.error, direction);
            Ray { origin, direction, t_max: FAR }
        })
        .collect();
    let shadow: Vec<Ray> = surfaces
        .iter()
        .flatten()
        .filter(|_| frame.light_count > 0)
        .map(|(surface, i)| {
            let picked = light::pick(frame, &scene, &packed.lights, pcg4d(*i, 5, 6, 7));
            let place = light::place_of(frame, &scene, picked.address);
            let point = light::evaluate_triangle::<false>(frame, &scene, place, pcg4d(*i, 8, 9, 10)[0]);
            light::shadow_ray::<false>(surface, &point)
        })
        .collect();
    let closest = |rays: &[Ray]| {
        rays.par_chunks(1024)
            .map(|chunk| {
                let hit = |ray: &Ray| closest_hit::<false, INSTANCES>(frame, &scene, &packed.bvh, ray).t;
                chunk.iter().map(hit).map(f64::from).filter(|t| *t < f64::from(FAR)).sum::<f64>()
            })
            .sum::<f64>()
    };
    let any = |rays: &[Ray]| {
        rays.par_chunks(1024)
            .map(|chunk| {
                chunk.iter().filter(|ray| unoccluded::<false, INSTANCES>(frame, &scene, &packed.bvh, ray)).count()
            })
            .sum::<usize>() as f64
    };
    report("closest hit, camera rays", &primary, closest);
    report("closest hit, bounce rays", &bounce, closest);
    report("any hit, shadow rays", &shadow, any);
}

fn report(what: &str, rays: &[Ray], run: impl Fn(&[Ray]) -> f64) {
    let mut rates: Vec<f64> = (0..9)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(run(rays));
            rays.len() as f64 / start.elapsed().as_secs_f64() / 1e6
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    println!("{what:<26} {:>6.2} Mray/s  (of nine runs: {:.2} to {:.2})", rates[4], rates[0], rates[8]);
}
