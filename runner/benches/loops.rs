//! Inner loops on one core of the host: `cargo bench --bench loops`.
//!
//! Traversal, the choice of a light, its evaluation, a stream of candidates and a merge, over the pixels of a small
//! picture of the office building (`rooms`). Times are of one item: a ray, a light, a stream, a merge.

use std::sync::LazyLock;

use divan::{Bencher, black_box, counter::ItemsCount};
use glam::UVec2;
use weir::{
    packed::PackedScene,
    render::{Request, frame_of},
    scene::builtin,
    settings::Settings,
    technique::Technique,
};
use weir_shared::{
    alias,
    bvh::{closest_hit, unoccluded},
    camera::camera_ray,
    frame::Frame,
    light::{self, Address, LightPoint},
    light_tree::{Party, Walk},
    merge::{Inputs, Sink, form, merge},
    numerics::unit_float,
    ray::Ray,
    resample::{Chooser, Stream, candidate_scale, choice},
    rng::{Rng, pcg4d},
    scene::Scene as SceneView,
    surface::{Surface, surface_at},
    target::Domain,
};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 54;
/// Candidates of a stream.
const CANDIDATES: u32 = 32;
/// Inputs of a merge.
const INPUTS: usize = 6;

fn main() {
    divan::main();
}

/// What the loops run over.
struct World {
    packed: PackedScene,
    frame: Frame,
    camera: Vec<Ray>,
    surfaces: Vec<Surface>,
    points: Vec<LightPoint>,
    shadow: Vec<Ray>,
}

static WORLD: LazyLock<World> = LazyLock::new(|| {
    let scene = (builtin::find("rooms").expect("it is built in").build)();
    let packed = PackedScene::new(&scene, 0.0).expect("it has lights and inverses");
    let camera = scene.camera.expect("it has one");
    let request = Request::new(camera, [WIDTH, HEIGHT], Technique::Candidates, Settings::default());
    let frame = frame_of(&packed, &request);
    let view = SceneView { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    let camera: Vec<Ray> = (0..WIDTH * HEIGHT).map(|i| camera_ray(UVec2::new(i % WIDTH, i / WIDTH), &frame)).collect();
    let surface = |ray: &Ray| {
        let hit = closest_hit::<false, true>(&frame, &view, &packed.bvh, ray);
        (!hit.is_miss()).then(|| surface_at::<false>(&frame, &view, &hit, ray.direction).surface)
    };
    let surfaces: Vec<Surface> = camera.iter().filter_map(surface).collect();
    let point = |i: u32| {
        let picked = light::pick(&frame, &view, &packed.lights, pcg4d(i, 5, 6, 7));
        light::evaluate_triangle::<false>(&frame, &view, light::place_of(&frame, &view, picked.address), i)
    };
    let points: Vec<LightPoint> = (0..surfaces.len() as u32).map(point).collect();
    let shadow =
        surfaces.iter().zip(&points).map(|(surface, point)| light::shadow_ray::<false>(surface, point)).collect();
    World { frame, camera, surfaces, points, shadow, packed }
});

impl World {
    fn view(&self) -> SceneView<'_> {
        let PackedScene { triangles, records, texels, .. } = &self.packed;
        SceneView { triangles, records, texels }
    }

    fn domains(&self) -> Vec<Domain> {
        self.surfaces.iter().map(|surface| Domain::new(self.frame.camera_origin, surface)).collect()
    }
}

/// Times a loop over `items`, and says how long one of them takes.
fn each<T, R>(bencher: Bencher, items: &[T], mut run: impl FnMut(&T) -> R) {
    bencher.counter(ItemsCount::new(items.len())).bench_local(|| {
        for item in items {
            black_box(run(black_box(item)));
        }
    });
}

#[divan::bench]
fn closest_hit_of_camera_rays(bencher: Bencher) {
    let (world, view) = (&*WORLD, WORLD.view());
    each(bencher, &world.camera, |ray| closest_hit::<false, true>(&world.frame, &view, &world.packed.bvh, ray).t);
}

#[divan::bench]
fn any_hit_of_shadow_rays(bencher: Bencher) {
    let (world, view) = (&*WORLD, WORLD.view());
    each(bencher, &world.shadow, |ray| unoccluded::<false, true>(&world.frame, &view, &world.packed.bvh, ray));
}

/// One table of a million entries.
#[divan::bench]
fn pick_from_an_alias_table(bencher: Bencher) {
    const COUNT: u32 = 1 << 20;
    let weights: Vec<f64> = (0..COUNT).map(|i| f64::from(unit_float(pcg4d(i, 0, 0, 0)[0]))).collect();
    let table = alias::build(&weights).expect("weights above zero");
    let bits: Vec<[u32; 4]> = (0..4096).map(|i| pcg4d(i, 1, 2, 3)).collect();
    each(bencher, &bits, |&[x, y, ..]| alias::pick(&table, 0, COUNT, x, y).pmf);
}

/// Both levels of tables, 346,212 lights.
#[divan::bench]
fn pick_a_light_by_power(bencher: Bencher) {
    let (world, view) = (&*WORLD, WORLD.view());
    let bits: Vec<[u32; 4]> = (0..4096).map(|i| pcg4d(i, 1, 2, 3)).collect();
    each(bencher, &bits, |&bits| light::pick(&world.frame, &view, &world.packed.lights, bits).pmf);
}

#[divan::bench]
fn walk_down_the_light_tree(bencher: Bencher) {
    let (world, view) = (&*WORLD, WORLD.view());
    let mut rng = Rng::from_words(1, 2, 3, 0);
    let none = Address { emitter: 0, local: 0 };
    each(bencher, &world.domains(), |domain| {
        let (position, normal) = (domain.position, domain.bsdf.normal);
        let walk = Walk::new(&world.frame, &world.packed.lights, position, normal, false, none, rng);
        rng = rng.skip(16);
        walk.finish(&world.frame, &view, &world.packed.lights).pmf
    });
}

/// As candidates do it: a step of each in turn.
#[divan::bench]
fn four_walks_down_the_light_tree(bencher: Bencher) {
    let (world, view) = (&*WORLD, WORLD.view());
    let mut rng = Rng::from_words(1, 2, 3, 0);
    let none = Address { emitter: 0, local: 0 };
    each(bencher, &world.domains(), |domain| {
        let mut party = Party::new();
        for _ in 0..4 {
            party.add(Walk::new(
                &world.frame,
                &world.packed.lights,
                domain.position,
                domain.bsdf.normal,
                false,
                none,
                rng,
            ));
            rng = rng.skip(16);
        }
        party.finish(&world.frame, &view, &world.packed.lights);
        party.led(3).map(|reached| reached.pmf)
    });
}

/// The full target p̂ of a light point that is at hand.
#[divan::bench]
fn target_of_a_light_point(bencher: Bencher) {
    let pairs: Vec<_> = WORLD.domains().into_iter().zip(&WORLD.points).collect();
    each(bencher, &pairs, |(domain, point)| domain.target::<false, true>(point));
}

/// A number with the name that the table shows.
struct Named(&'static str, u32);

impl std::fmt::Display for Named {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.0)
    }
}

/// Lights picked by power, evaluated, and resampled to one.
#[divan::bench(args = [
    Named("threshold", choice::THRESHOLD), Named("plain", choice::PLAIN), Named("keys", choice::KEYS),
])]
fn stream_of_32_candidates(bencher: Bencher, &Named(_, way): &Named) {
    let (world, view) = (&*WORLD, WORLD.view());
    let mut rng = Rng::from_words(1, 2, 3, 0);
    each(bencher, &world.domains(), |domain| {
        let chooser = Chooser::new(rng.skip(1 << 20), way);
        let mut stream: Stream<f32, u32, Chooser> = Stream::new(0, chooser);
        for i in 0..CANDIDATES {
            let picked = light::pick(&world.frame, &view, &world.packed.lights, rng.next_four());
            let place = light::place_of(&world.frame, &view, picked.address);
            let point = light::evaluate_triangle::<false>(&world.frame, &view, place, rng.next_word());
            let target = domain.target::<false, true>(&point);
            stream.offer(i, target, target * candidate_scale(picked.pmf * CANDIDATES as f32));
        }
        stream.contribution_weight()
    });
}

/// Neighbours: each has a surface, and the light point that it brings.
struct Neighbours<'a> {
    domains: &'a [Domain],
    points: &'a [LightPoint],
}

impl Inputs<f32> for Neighbours<'_> {
    type Sample = LightPoint;
    type Domain = Domain;
    type Light = f32;

    fn count(&self) -> u32 {
        self.domains.len() as u32
    }

    fn confidence(&self, _: u32) -> f32 {
        1.0
    }

    fn domain(&self, input: u32) -> Domain {
        self.domains[input as usize]
    }

    fn sample(&self, input: u32) -> (f32, LightPoint) {
        (1.0, self.points[input as usize])
    }

    fn target_here(&self, here: &Domain, sample: &LightPoint) -> (f32, f32) {
        (here.target::<false, true>(sample), 0.0)
    }

    fn target(&self, there: &Domain, sample: &LightPoint) -> f32 {
        there.target::<false, true>(sample)
    }

    fn is_hidden_here(&self, _: u32) -> bool {
        false
    }

    fn is_hidden_there(&self, _: u32) -> bool {
        false
    }

    fn partner(&self) -> u32 {
        0
    }
}

/// Keeps one, as a pass does.
struct Keeper(Stream<f32, u32, Chooser>);

impl Sink<f32, LightPoint, f32> for Keeper {
    fn offer(&mut self, _: &LightPoint, _: f32, target: f32, scaled_ucw: f32) -> bool {
        self.0.offer(0, target, target * scaled_ucw)
    }
}

/// Six inputs by each form of weights; targets are evaluated, light points are at hand.
#[divan::bench(args = [
    Named("pairwise-defensive", form::PAIRWISE_DEFENSIVE), Named("pairwise", form::PAIRWISE),
    Named("balance", form::BALANCE), Named("contribution", form::CONTRIBUTION),
    Named("one-over-z", form::ONE_OVER_Z), Named("one-over-m", form::ONE_OVER_M),
])]
fn merge_of_6_inputs(bencher: Bencher, &Named(_, form): &Named) {
    let domains = WORLD.domains();
    let inputs: Vec<Neighbours<'_>> = domains
        .chunks_exact(INPUTS)
        .zip(WORLD.points.chunks_exact(INPUTS))
        .map(|(domains, points)| Neighbours { domains, points })
        .collect();
    let rng = Rng::from_words(1, 2, 3, 0);
    each(bencher, &inputs, |inputs| {
        let mut keeper = Keeper(Stream::new(0, Chooser::new(rng, choice::THRESHOLD)));
        let merged = merge(inputs, form, &mut keeper);
        keeper.0.contribution_weight() * merged.factor
    });
}
