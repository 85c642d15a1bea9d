//! The passes against the reference integrator: equal means, within what noise allows; and planted errors are seen.

use glam::Vec3;
use weir::{
    executor::cpu::Order,
    packed::{Moment, PackOptions, PackedScene},
    render::{Backend, Rendered, Request, Stop, render, render_reference},
    scene::{Scene, Shape, builtin},
    settings::Settings,
    technique::{Technique, ToneCurve},
};
use weir_tests::scenes::{Lamp, lamp_above_a_floor, variety};

const WIDTH: u32 = 48;
const HEIGHT: u32 = 32;
const TILE: u32 = 8;

/// Largest |z| that noise alone reaches once in about 10,000 runs: two-sided normal quantile for 0.0001, corrected for
/// 24 tiles of three channels (Sidak) and for the whole picture.
const TILE_BOUND: f64 = 5.2;
const GLOBAL_BOUND: f64 = 4.3;
/// Pictures by which the noise of lights that pixels share is judged.
const SEEDS: usize = 64;

fn request(scene: &Scene, samples: u32, seed: u32, knobs: &[&str]) -> Request {
    let mut settings = Settings::default();
    for knob in knobs {
        settings.apply(knob).expect("a knob");
    }
    let camera = scene.camera.expect("the scene suggests a camera");
    let one = Request::new(camera, [WIDTH, HEIGHT], Technique::Candidates, settings);
    Request { seed, stop: Stop::Samples(samples), curve: ToneCurve::Clip, ..one }
}

/// A picture that is an estimate.
trait Estimated {
    /// By how much the quantile of a bound is wider than that of a normal distribution: for bounds of tiles and of the picture.
    const WIDER: [f64; 2];

    /// The sum over some pixels, and its variance.
    fn total(&self, pixels: &[usize], channel: usize) -> [f64; 2];
}

/// Pixels that know nothing of each other.
impl Estimated for Rendered {
    const WIDER: [f64; 2] = [1.0; 2];

    fn total(&self, pixels: &[usize], channel: usize) -> [f64; 2] {
        let sum = |values: &[[f32; 3]]| pixels.iter().map(|&i| f64::from(values[i][channel])).sum();
        [sum(&self.picture.rgb), sum(&self.variance)]
    }
}

/// Pictures of several seeds. How they scatter is right even where pixels share the lights that they draw from, which makes
/// neighbours err alike: in `studio` by `cells`, sums over tiles scatter more than twice as far as pixels that know nothing of
/// each other would let them.
impl Estimated for [Rendered; SEEDS] {
    // Student's t with 63 degrees of freedom.
    const WIDER: [f64; 2] = [5.84 / TILE_BOUND, 4.66 / GLOBAL_BOUND];

    fn total(&self, pixels: &[usize], channel: usize) -> [f64; 2] {
        let totals = self.each_ref().map(|one| one.total(pixels, channel)[0]);
        let n = SEEDS as f64;
        let mean = totals.iter().sum::<f64>() / n;
        let deviation: f64 = totals.iter().map(|total| (total - mean).powi(2)).sum();
        [mean, deviation / (n * (n - 1.0))]
    }
}

/// z of the difference of means over a set of pixels, and the relative difference.
fn z_over<T: Estimated>(a: &T, b: &Rendered, pixels: &[usize], channel: usize) -> (f64, f64) {
    let ([mean, own], [total, others]) = (a.total(pixels, channel), b.total(pixels, channel));
    // A floor of one part in 10,000 of the picture: below it rounding, not noise, decides.
    let floor = 1e-4 * total.abs() + 1e-9 * pixels.len() as f64;
    let difference = mean - total;
    (difference / (own + others + floor * floor).sqrt(), difference / total.abs().max(1e-30))
}

/// Whether two pictures have the same expectation as far as their noise lets one tell; else what differs.
fn compare<T: Estimated>(a: &T, b: &Rendered) -> Result<f64, String> {
    let mut worst = 0.0f64;
    let [of_tiles, of_picture] = T::WIDER;
    for channel in 0..3 {
        let all: Vec<usize> = (0..(WIDTH * HEIGHT) as usize).collect();
        let (z, relative) = z_over(a, b, &all, channel);
        if z.abs() > GLOBAL_BOUND * of_picture {
            return Err(format!("channel {channel} differs by {:.3} % overall, z = {z:.1}", relative * 100.0));
        }
        worst = worst.max(relative.abs());
        for tile in 0..(WIDTH / TILE) * (HEIGHT / TILE) {
            let (x0, y0) = (tile % (WIDTH / TILE) * TILE, tile / (WIDTH / TILE) * TILE);
            let pixels = (0..TILE * TILE).map(|i| ((y0 + i / TILE) * WIDTH + x0 + i % TILE) as usize);
            let (z, relative) = z_over(a, b, &pixels.collect::<Vec<_>>(), channel);
            if z.abs() > TILE_BOUND * of_tiles {
                return Err(format!(
                    "channel {channel}, tile at ({x0}, {y0}) differs by {:.2} %, z = {z:.1}",
                    relative * 100.0
                ));
            }
        }
    }
    Ok(worst)
}

fn passes(scene: &Scene, samples: u32, seed: u32, knobs: &[&str]) -> Rendered {
    passes_of(Technique::Candidates, scene, samples, seed, knobs)
}

fn passes_of(technique: Technique, scene: &Scene, samples: u32, seed: u32, knobs: &[&str]) -> Rendered {
    // Sampled everywhere, unless the knobs want it otherwise.
    let knobs = [&["skip.closed_form=off"], knobs].concat();
    let request = Request { technique, ..request(scene, samples, seed, &knobs) };
    let options = PackOptions::of(&request.settings);
    let packed = PackedScene::with(scene, &Moment::default(), options).expect("packs");
    render(&packed, &request, &Backend::Cpu(Order::default()), |_| true).expect("renders")
}

/// Sources of lights that pixels share.
const SHARED: [&str; 3] = ["candidates.source=tiles", "candidates.source=cells", "candidates.source=cuts"];

/// [`compare`]s what passes make of a scene, by pictures of many seeds where pixels share lights.
fn verdict(technique: Technique, scene: &Scene, samples: u32, knobs: &[&str], judge: &Rendered) -> Result<f64, String> {
    if knobs.iter().any(|knob| SHARED.contains(knob)) {
        let of_each = samples / SEEDS as u32;
        let of_seed = |seed: usize| passes_of(technique, scene, of_each, 1 + seed as u32, knobs);
        compare(&std::array::from_fn::<_, SEEDS, _>(of_seed), judge)
    } else {
        compare(&passes_of(technique, scene, samples, 1, knobs), judge)
    }
}

fn reference(scene: &Scene, samples: u32) -> Rendered {
    let packed = PackedScene::new(scene, 0.0).expect("packs");
    render_reference(&packed, &request(scene, samples, 7, &[]), |_| true).expect("renders")
}

/// A light of every kind.
fn studio() -> Scene {
    (builtin::find("studio").expect("built in").build)()
}

/// The box without its light in view: the edges of a bright light are noisier than everything it lights.
fn cornell() -> Scene {
    let mut scene = (builtin::find("cornell").expect("built in").build)();
    if let Some(camera) = &mut scene.camera {
        camera.vfov_deg *= 0.5;
    }
    scene
}

#[test]
fn resampled_candidates_have_the_mean_of_the_reference() {
    for (name, scene, samples) in [("cornell", cornell(), 512), ("variety", variety(), 1024), ("studio", studio(), 512)]
    {
        let judge = reference(&scene, samples);
        assert_eq!(judge.faults.samples, 0);
        for knobs in [
            &["candidates.count=1"] as &[&str],
            &["candidates.count=1", "candidates.source=uniform"],
            &["candidates.count=4", "candidates.source=uniform"],
            // Alone: on `variety` one candidate for the sky, and one for six lamps; on `studio` one for the moon, and one for
            // six other lights.
            &[
                "candidates.count=1",
                "candidates.source=tiles",
                "candidates.bsdf=0",
                "tiles.count=16",
                "tiles.size=64",
                "skip.presampling=off",
            ],
            &["candidates.count=1", "candidates.source=cells", "candidates.bsdf=0", "cells.slots=4"],
            &["candidates.count=1", "candidates.source=tree", "candidates.bsdf=0"],
            &["candidates.count=1", "candidates.source=cuts", "candidates.bsdf=0"],
            &["candidates.count=4", "reservoirs.choice=inversion"],
            &["candidates.count=32"],
            &["candidates.count=32", "skip.few=off"],
            &["candidates.count=1", "candidates.source=tiles", "candidates.bsdf=0"],
            &["skip.closed_form=on"],
        ] {
            match verdict(Technique::Candidates, &scene, samples, knobs, &judge) {
                Ok(bias) => println!("{name} {knobs:?}: within {:.3} %", bias * 100.0),
                Err(difference) => panic!("{name} {knobs:?}: {difference}"),
            }
        }
    }
}

#[test]
fn a_lamp_with_a_hole_in_its_mask_shines_as_what_is_left_of_it() {
    let samples = 256;
    let judge = reference(&lamp_above_a_floor(Lamp::Half), samples);
    let masked = lamp_above_a_floor(Lamp::Masked);
    let mean = |r: &Rendered| r.picture.rgb.iter().map(|p| f64::from(p[0])).sum::<f64>() / f64::from(WIDTH * HEIGHT);
    let check = |name: &str, result: &Rendered| {
        println!("{name}: mean of red {:.4}, of half the lamp {:.4}", mean(result), mean(&judge));
        compare(result, &judge).unwrap_or_else(|difference| panic!("{name}: {difference}"));
    };
    check("reference", &reference(&masked, samples));
    // Up to one candidate the two triangles are drawn, above they are enumerated.
    for (count, bsdf) in [(1, 0), (1, 1), (8, 0), (8, 1)] {
        let knobs = [format!("candidates.count={count}"), format!("candidates.bsdf={bsdf}")];
        let knobs = knobs.each_ref().map(String::as_str);
        check(&knobs.join(", "), &passes(&masked, samples, 1, &knobs));
    }
    check("reuse", &passes_of(Technique::Still, &masked, samples, 1, &[]));
    check("a mask has no closed form", &passes_of(Technique::Still, &masked, samples, 1, &["skip.closed_form=on"]));
    let whole = passes(&lamp_above_a_floor(Lamp::Whole), samples, 1, &[]);
    assert!(compare(&whole, &judge).is_err(), "half of the light went unnoticed");
}

/// The lamp is out of view and in nobody's way, so that rays find it or not without a difference to the picture.
#[test]
fn a_lamp_that_no_ray_finds_shines_like_one_that_rays_find() {
    let samples = 256;
    let judge = reference(&lamp_above_a_floor(Lamp::Whole), samples);
    let mut unseen = lamp_above_a_floor(Lamp::Whole);
    unseen.meshes[1].unseen = true;
    let check = |name: &str, result: &Rendered| {
        compare(result, &judge).unwrap_or_else(|difference| panic!("{name}: {difference}"));
    };
    check("reference", &reference(&unseen, samples));
    for (count, bsdf) in [(1, 0), (1, 1), (8, 0), (8, 1)] {
        let knobs = [format!("candidates.count={count}"), format!("candidates.bsdf={bsdf}")];
        let knobs = knobs.each_ref().map(String::as_str);
        check(&knobs.join(", "), &passes(&unseen, samples, 1, &knobs));
    }
    for source in ["uniform", "tiles", "cells", "tree", "cuts"] {
        let knobs = ["candidates.count=2", "candidates.bsdf=1", "skip.presampling=off", "skip.few=off"];
        let source = format!("candidates.source={source}");
        let knobs = [&knobs[..], &[source.as_str()]].concat();
        verdict(Technique::Candidates, &unseen, samples, &knobs, &judge).unwrap_or_else(|d| panic!("{source}: {d}"));
    }
    check("reuse", &passes_of(Technique::Still, &unseen, samples, 1, &[]));
    // Rays by the BSDF go through it: what they would have found is missing if light samples leave their share to them.
    let mut turned = unseen.clone();
    turned.meshes[1].positions.iter_mut().for_each(|p| p.y = 2.0 - p.y);
    turned.meshes[1].triangles.iter_mut().for_each(|t| t.swap(1, 2));
    assert!(compare(&passes(&turned, samples, 1, &[]), &judge).is_err(), "it shines to its back");
}

#[test]
fn two_seeds_of_the_passes_agree_and_differ() {
    let (a, b) = (passes(&cornell(), 64, 1, &[]), passes(&cornell(), 64, 2, &[]));
    assert_ne!(a.picture.rgb, b.picture.rgb);
    compare(&a, &b).expect("the same scene");
}

/// The comparison has teeth: a light brighter by one part in a hundred is seen.
#[test]
fn a_light_that_is_one_percent_brighter_is_caught() {
    let judge = reference(&cornell(), 512);
    let mut brighter = cornell();
    brighter.materials.iter_mut().for_each(|m| m.emission *= 1.01);
    for rule in ["off", "on"] {
        let verdict = compare(&passes(&brighter, 512, 1, &[&format!("skip.closed_form={rule}")]), &judge);
        println!("{verdict:?}");
        assert!(verdict.is_err(), "1 % more light went unnoticed, skip.closed_form={rule}");
    }
}

/// Each kind of light in turn: without it the picture is another one.
#[test]
fn every_kind_of_light_of_the_studio_is_missed() {
    let judge = reference(&studio(), 256);
    let is_missed = |what: &str, scene: &Scene| {
        let verdict = compare(&passes(scene, 256, 1, &[]), &judge);
        assert!(verdict.is_err(), "{what} went unnoticed");
    };
    for mesh in studio().meshes.iter().filter(|mesh| mesh.shape != Shape::Triangles) {
        let mut dark = studio();
        dark.materials[mesh.materials[0] as usize].emission = Vec3::ZERO;
        is_missed(&mesh.name, &dark);
    }
    let mut dark = studio();
    dark.distant.clear();
    is_missed("the directional light", &dark);
}

#[test]
fn reuse_in_space_keeps_lights_of_every_kind() {
    let judge = reference(&studio(), 1024);
    for knobs in [&[] as &[&str], &["candidates.source=cells", "cells.slots=4"], &["reuse.mis=balance", "rays=speed"]] {
        if let Err(difference) = verdict(Technique::Still, &studio(), 512, knobs, &judge) {
            panic!("{knobs:?}: {difference}");
        }
    }
}

/// And so is a whole technique that is dropped: the environment of a scene that has both kinds of light.
#[test]
fn a_missing_kind_of_light_is_caught() {
    let judge = reference(&variety(), 256);
    let mut dark = variety();
    dark.environment = None;
    assert!(compare(&passes(&dark, 256, 1, &[]), &judge).is_err());
}

#[test]
fn neither_threads_nor_the_order_of_pixels_change_a_bit() {
    let scene = variety();
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    let request = request(&scene, 3, 5, &[]);
    let draw = |threads: usize, order: Order| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let drawn = pool.install(|| render(&packed, &request, &Backend::Cpu(order), |_| true)).expect("renders");
        (drawn.picture.rgb, drawn.display, drawn.variance)
    };
    let expected = draw(1, Order::default());
    for threads in [1, 2, 16] {
        for order in [
            Order::default(),
            Order { band_rows: 1, backwards: false },
            Order { band_rows: 7, backwards: true },
            Order { band_rows: 64, backwards: true },
        ] {
            assert!(draw(threads, order) == expected, "{threads} threads, {order:?}");
        }
    }
}

#[test]
fn every_picture_of_a_hostile_size_is_finite() {
    let mut scene = cornell();
    scene.materials.iter_mut().for_each(|m| m.emission *= 1e18);
    let packed = PackedScene::new(&scene, 0.0).expect("packs");
    for (width, height) in [(1, 1), (1, 33), (7, 5)] {
        let request = Request { width, height, ..request(&scene, 4, 0, &[]) };
        let drawn = render(&packed, &request, &Backend::Cpu(Order::default()), |_| true).expect("renders");
        assert!(drawn.picture.rgb.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
    }
}
