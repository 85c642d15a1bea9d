use std::collections::HashSet;

use glam::UVec2;
use weir_shared::{
    block,
    frame::{Frame, skip},
    light::{Address, light_at},
    light_cuts::{Cluster, MOST_NODES, cluster_of, cut_of, cut_record, size_of_cut, walk},
    light_tree::{NO_TREE, Reached},
    octahedral,
    presample::LightRecord,
    rng::Rng,
    scene::{Scene as SceneView, instance_record},
    surface::Surface,
};

use super::*;
use crate::{
    packed::{
        Moment, PackOptions, PackedScene,
        light_tree::tests::{addresses, misfit, reaches, surfaces, two_levels, vector, view},
    },
    scene::Scene,
};

const NOBODY: Address = Address { emitter: 0, local: 0 };
const ALL: usize = 1_000;

/// With trees for meshes that have no more than `most` lights together.
fn packed_within(scene: &Scene, most: usize) -> PackedScene {
    let options = PackOptions { light_cuts: true, ..PackOptions::default() };
    PackedScene::pack(scene, &Moment::default(), options, most).expect("packs")
}

/// Trees for each mesh, for some and for none.
fn with_and_without_trees() -> Vec<PackedScene> {
    let packed: Vec<_> = [ALL, 9, 0].map(|most| packed_within(&two_levels(true), most)).into_iter().collect();
    let trees_of = |packed: &PackedScene| {
        let word = |i| view(packed).instance_word(&packed.frame, i, instance_record::LIGHT_CUTS_AT);
        (0..9).filter(|&i| word(i) != NO_TREE).count()
    };
    assert_eq!(packed.iter().map(trees_of).collect::<Vec<_>>(), [9, 6, 0]);
    packed
}

fn surface((position, normal): (Vec3, Vec3)) -> Surface {
    Surface {
        position: position.to_array(),
        normal_shading: octahedral::pack(normal),
        normal_geometric: octahedral::pack(normal),
        instance: 1 << 31,
        ..Surface::default()
    }
}

/// A block of pixels, and its cut.
struct Block<'a> {
    packed: &'a PackedScene,
    frame: Frame,
    view: SceneView<'a>,
    surface: (Vec3, Vec3),
    cut: Vec<LightRecord>,
}

impl<'a> Block<'a> {
    /// With lights that the surface doesn't see.
    fn new(packed: &'a PackedScene, surface: (Vec3, Vec3), columns: u32) -> Self {
        Self::with(packed, &[surface; 64], columns, skip::HORIZON)
    }

    /// Of pixels that see a surface each; one of them asks.
    fn with(packed: &'a PackedScene, surfaces: &[(Vec3, Vec3); 64], columns: u32, not_skipped: u32) -> Self {
        let frame =
            Frame { width: 8, height: 8, presampled_columns: columns, presampled_rows: 1, not_skipped, ..packed.frame };
        let view = view(packed);
        let blocks = [block::Block::of(UVec2::ZERO, &frame, &surfaces.map(surface))];
        let record = |column| cut_record(UVec2::new(column, 0), &frame, &view, &packed.lights, &blocks);
        let cut = (0..columns).map(record).collect();
        Self { packed, frame, view, surface: surfaces[0], cut }
    }

    fn walk(&self, cluster: Cluster, goal: Option<Address>, stream: u32) -> Reached {
        let (position, normal) = self.surface;
        let rng = Rng::from_words(stream, 3, 1, 9);
        let to = goal.unwrap_or(NOBODY);
        walk(&self.frame, &self.view, &self.packed.lights, cluster, position, normal, goal.is_some(), to, rng)
    }

    fn clusters(&self) -> impl Iterator<Item = Cluster> + '_ {
        self.cut.iter().map(Cluster::of).filter(|cluster| !cluster.is_none())
    }

    fn cluster_of(&self, light: Address) -> Cluster {
        let size = size_of_cut(&self.frame, &self.cut, 0);
        cluster_of(&self.frame, &self.view, &self.packed.lights, &self.cut, 0, size, light)
    }

    /// The probability of each light among those of its cluster.
    fn pmfs(&self) -> Vec<f64> {
        let pmf = |light| f64::from(self.walk(self.cluster_of(light), Some(light), 0).pmf);
        addresses(self.packed).into_iter().map(pmf).collect()
    }
}

#[test]
fn a_cut_holds_every_light_in_one_of_its_clusters() {
    // Without trees of meshes there are nine emitters, else lights enough.
    for (packed, most) in with_and_without_trees().into_iter().zip([MOST_NODES, MOST_NODES, 9]) {
        for (i, surface) in (0..).zip(surfaces(60)) {
            let columns = 1 + i % MOST_NODES;
            let block = Block::new(&packed, surface, columns);
            let found: HashSet<_> = addresses(&packed)
                .into_iter()
                .map(|light| {
                    let cluster = block.cluster_of(light);
                    assert!(!cluster.is_none(), "{light:?} is in no cluster of {:?}", block.cut);
                    let alone = |other: &Cluster| {
                        let cut = [other.record(1)];
                        let frame = Frame { presampled_columns: 1, ..block.frame };
                        !cluster_of(&frame, &block.view, &packed.lights, &cut, 0, 1, light).is_none()
                    };
                    assert_eq!(block.clusters().filter(alone).count(), 1, "{light:?}");
                    format!("{cluster:?}")
                })
                .collect();
            assert_eq!(found.len(), columns.min(most) as usize, "{surface:?}");
            assert_eq!(block.clusters().count(), found.len());
            assert_eq!(size_of_cut(&block.frame, &block.cut, 0) as usize, found.len());
        }
    }
}

#[test]
fn walks_reach_lights_of_their_cluster_as_often_as_they_report() {
    const WALKS: u32 = 40_000;
    for packed in with_and_without_trees() {
        for (surface, columns) in surfaces(6).zip([1, 5, 2, 1, 8, 16]) {
            let block = Block::new(&packed, surface, columns);
            let (lights, pmfs) = (addresses(&packed), block.pmfs());
            for cluster in block.clusters() {
                let within: Vec<f64> = lights
                    .iter()
                    .zip(&pmfs)
                    .map(|(&light, pmf)| if block.cluster_of(light) == cluster { *pmf } else { 0.0 })
                    .collect();
                let check = |claimed: &[f64]| {
                    let mut observed = vec![0.0; lights.len() + 1];
                    for stream in 0..WALKS {
                        let reached = block.walk(cluster, None, stream);
                        let light = light_at(&block.frame, &block.view, reached.address) as usize;
                        observed[if reached.pmf > 0.0 { light } else { lights.len() }] += 1.0;
                    }
                    let early = 1.0 - claimed.iter().sum::<f64>();
                    let expected: Vec<f64> = claimed.iter().chain([&early]).map(|p| p * f64::from(WALKS)).collect();
                    misfit(&observed, &expected)
                };
                let share = check(&within);
                assert!(share < 1.0, "{surface:?} {cluster:?}: {share}");
                // The check has teeth: a light of two hundredths or more that is said to be half as likely.
                if let Some(likely) = (0..within.len()).find(|&i| within[i] > 0.02) {
                    let mut wrong = within.clone();
                    wrong[likely] *= 0.5;
                    assert!(check(&wrong) > 1.0, "{surface:?} {cluster:?}");
                }
            }
        }
    }
}

#[test]
fn the_probability_of_a_light_is_bitwise_that_of_the_walk_to_it() {
    for packed in with_and_without_trees() {
        let mut seen = HashSet::new();
        for (i, surface) in (0..).zip(surfaces(300)) {
            let block = Block::new(&packed, surface, 1 + i % MOST_NODES);
            for cluster in block.clusters() {
                let reached = block.walk(cluster, None, i);
                if reached.pmf > 0.0 {
                    seen.insert((reached.address.emitter, reached.address.local));
                    assert_eq!(block.cluster_of(reached.address), cluster);
                    let to = block.walk(cluster, Some(reached.address), 0);
                    assert_eq!((to.pmf.to_bits(), to.address), (reached.pmf.to_bits(), reached.address));
                }
            }
        }
        assert!(seen.len() > 100, "{} lights are too few to compare", seen.len());
    }
}

#[test]
fn a_light_that_reaches_the_surface_is_within_reach_of_a_walk() {
    let mut count = 0;
    for packed in with_and_without_trees() {
        for (i, surface) in (0..).zip(surfaces(200)) {
            let block = Block::new(&packed, surface, 1 + i % MOST_NODES);
            for (light, pmf) in (0..).zip(block.pmfs()) {
                if reaches(&packed, &packed.frame, light, surface.0, surface.1) {
                    count += 1;
                    assert!(pmf > 0.0, "light {light} {surface:?}");
                }
            }
        }
    }
    assert!(count > 10_000, "{count}");
}

/// Whatever another pixel of the block sees: the cut is for one of them.
#[test]
fn lights_below_the_horizon_of_the_cut_are_within_reach_of_others() {
    let packed = packed_within(&two_levels(true), ALL);
    let (high, low) = (Vec3::new(0.0, 0.0, 40.0), Vec3::new(0.0, 0.0, -40.0));
    // No light is above a plane that faces away from all: only what is alone in its cluster is not asked where it is.
    let made = Block::new(&packed, (high, Vec3::Z), 8);
    assert!(made.pmfs().iter().sum::<f64>() < 4.0);
    let other = Block { surface: (low, Vec3::Z), cut: made.cut.clone(), ..Block::new(&packed, (high, Vec3::Z), 8) };
    let sums: f64 = other.pmfs().iter().sum();
    assert!((sums - other.clusters().count() as f64).abs() < 1e-4, "{sums}");
}

/// What is left out lights none of a block's surfaces, and only that; what is proved of one surface is not of all.
#[test]
fn lights_that_no_surface_of_a_block_sees_take_no_place_in_its_cut() {
    let (mut left_out, mut reached, mut lost) = (0, 0, 0);
    for packed in with_and_without_trees() {
        for (i, (position, normal)) in (0..).zip(surfaces(100)) {
            let columns = 2 + i % (MOST_NODES - 1);
            let patch: [(Vec3, Vec3); 64] = core::array::from_fn(|pixel| {
                let near = |stream| vector(i * 64 + pixel as u32, stream);
                (position + 0.3 * near(50), (normal + 0.2 * near(51)).normalize())
            });
            let block = Block::with(&packed, &patch, columns, 0);
            let alike = Block::with(&packed, &[patch[0]; 64], columns, 0);
            for (light, address) in (0..).zip(addresses(&packed)) {
                let sees = |(p, n): &&(Vec3, Vec3)| reaches(&packed, &packed.frame, light, *p, *n);
                if let Some(&surface) = patch.iter().find(sees) {
                    reached += 1;
                    let of_it = Block { surface, cut: block.cut.clone(), ..Block::with(&packed, &patch, columns, 0) };
                    let pmf = of_it.walk(of_it.cluster_of(address), Some(address), 0).pmf;
                    assert!(pmf > 0.0, "light {light} {surface:?} {:?}", block.cut);
                    lost += u32::from(alike.cluster_of(address).is_none());
                } else {
                    left_out += u32::from(block.cluster_of(address).is_none());
                }
            }
        }
    }
    assert!(reached > 10_000 && left_out > 5_000 && lost > 100, "{reached} {left_out} {lost}");
}

#[test]
fn lights_without_power_take_no_place_and_one_light_is_a_tree() {
    let off = |instances: std::ops::Range<u32>| Moment {
        emission: instances.map(|i| (i, Vec3::ZERO)).collect(),
        ..Moment::default()
    };
    let options = PackOptions { dynamic: true, light_tree: true, light_cuts: true, closed_form: false };
    let packed = PackedScene::with(&two_levels(false), &off(1..9), options).expect("packs");
    let block = Block::new(&packed, (Vec3::splat(9.0), Vec3::NEG_ONE.normalize()), 16);
    // Instance 0 has one light.
    assert_eq!(block.clusters().count(), 1);
    let pmfs = block.pmfs();
    assert!((pmfs[0] - 1.0).abs() < 1e-6 && pmfs[1..].iter().all(|&pmf| pmf == 0.0), "{pmfs:?}");

    let dark = PackedScene::with(&two_levels(false), &off(0..9), options).expect("packs");
    let block = Block::new(&dark, (Vec3::splat(9.0), Vec3::NEG_ONE.normalize()), 16);
    assert!(block.pmfs().iter().all(|&pmf| pmf == 0.0));

    let mut alone = two_levels(false);
    alone.instances.truncate(1);
    let packed = packed_within(&alone, ALL);
    let block = Block::new(&packed, (Vec3::splat(9.0), Vec3::NEG_ONE.normalize()), 4);
    assert_eq!((block.clusters().count(), block.pmfs()), (1, vec![1.0]));
}

#[test]
fn a_block_without_a_surface_has_no_cut_and_blocks_have_rows_of_their_own() {
    let packed = packed_within(&two_levels(false), ALL);
    let frame = Frame {
        width: 20,
        height: 9,
        presampled_columns: 4,
        presampled_rows: 6,
        not_skipped: skip::HORIZON,
        ..packed.frame
    };
    let sky = vec![Surface::default(); 180];
    let rows_of = |surfaces: &[Surface]| -> Vec<bool> {
        let blocks: Vec<_> = (0..6).map(|i| block::Block::of(UVec2::new(i % 3, i / 3), &frame, surfaces)).collect();
        let record = |row| cut_record(UVec2::new(0, row), &frame, &view(&packed), &packed.lights, &blocks);
        (0..6).map(|row| !Cluster::of(&record(row)).is_none()).collect()
    };
    assert_eq!(rows_of(&sky), [false; 6]);
    // The last block has four columns of pixels in one row, and one of them has a surface.
    let mut surfaces = sky;
    surfaces[8 * 20 + 17] = Surface { normal_shading: octahedral::pack(Vec3::Z), instance: 1 << 31, ..surfaces[0] };
    assert_eq!(rows_of(&surfaces), [false, false, false, false, false, true]);
    assert_eq!(cut_of(&frame, UVec2::new(17, 8)), 5);
    assert_eq!(weir_shared::light_cuts::cuts_of(20, 9), 6);
}

#[test]
fn a_curve_fills_its_cube_and_stays_together() {
    assert_eq!(morton(Vec3::ZERO), 0);
    assert_eq!(morton(Vec3::splat(1023.5)), (1 << 30) - 1);
    assert_eq!(morton(Vec3::splat(1e9)), (1 << 30) - 1);
    assert_eq!([Vec3::X, Vec3::Y, Vec3::Z].map(morton), [1, 2, 4]);
    assert_eq!([Vec3::X, Vec3::Y, Vec3::Z].map(|v| morton(v * 512.0)), [1 << 27, 1 << 28, 1 << 29]);
    assert_eq!(morton(Vec3::NAN), 0);
}

#[test]
fn nodes_hold_what_is_below_them() {
    let lights: Vec<LightBounds> = (0..37)
        .map(|i| {
            let corner = Vec3::new((i * 7 % 11) as f32, (i * 5 % 13) as f32, i as f32);
            LightBounds::triangle([corner, corner + Vec3::X, corner + Vec3::Y], false, f64::from(i % 5))
        })
        .collect();
    let built = build(&lights);
    assert_eq!((built.len(), built[0]), (words(37), 6));
    let node = |n: usize| &built[1 + 2 * 37 + (n - 1) * NODE_WORDS as usize..][..NODE_WORDS as usize];
    let float = |n: usize, field: u32| f32::from_bits(node(n)[field as usize]);
    assert!((float(1, node_field::POWER) - 1.0).abs() < 1e-6);
    for n in 1..64 {
        for child in [2 * n, 2 * n + 1].into_iter().filter(|&c| float(c, node_field::POWER) > 0.0) {
            for axis in 0..3 {
                assert!(float(n, node_field::LOW + axis) <= float(child, node_field::LOW + axis));
                assert!(float(n, node_field::HIGH + axis) >= float(child, node_field::HIGH + axis));
            }
        }
        let below = float(2 * n, node_field::POWER) + float(2 * n + 1, node_field::POWER);
        assert!((float(n, node_field::POWER) - below).abs() <= 1e-6 * below);
    }
    for item in 0..37 {
        let rank = built[1 + item] as usize;
        assert_eq!(built[1 + 37 + rank] as usize, item);
        let power = f64::from(float(64 + rank, node_field::POWER));
        assert!((power - lights[item].power / lights.iter().map(|l| l.power).sum::<f64>()).abs() < 1e-7);
    }
}
