//! Stochastic lightcuts: lights in clusters, as many as a cut through a tree has, and a random light of a cluster.
//!
//! Two levels of trees, as in [`crate::light_tree`]: one over emitters, in world space, and for each mesh one over its
//! emissive triangles, in object space. Each is a perfect binary tree over the lights in the order of a Morton curve, filled
//! up with leaves without power; a node holds a box and a power. Such a tree is built by sorting alone. It knows nothing of
//! where lights face.
//!
//! Each block of 8x8 pixels has a cut: nodes that together hold every light once that may light one of its surfaces. It
//! starts at the root, and the node that may contribute most to one of the block's surfaces is replaced by its children until
//! there are enough of them; children that lie below the horizon of all of the surfaces are left out.
//!
//! Differs from the source: the block's surface is drawn anew in every frame; a child that may matter at all has a least
//! probability, so that no rounding takes it out of reach; a cut goes on from a tree over emitters into those of meshes.
//!
//! Source: Lin and Yuksel 2020, "Real-Time Stochastic Lightcuts".

use glam::{UVec2, Vec3};

use crate::{
    alias,
    block::Block,
    frame::Frame,
    light::Address,
    light_tree::{NO_TREE, Reached},
    numerics::{abs, clamp, load, max, sqrt},
    presample::LightRecord,
    rng::Rng,
    scene::{Scene, emitter_record, instance_record},
    tiles::{self, BLOCK},
    words::Words,
};

/// Words of a node.
pub const NODE_WORDS: u32 = 8;

/// Fields of a node. One without power holds no light.
pub mod node_field {
    /// Lower corner of a box around all points that emit, three fields.
    pub const LOW: u32 = 0;
    /// Emitted power, as a share of the whole tree's, at least [`super::LEAST_POWER`] where there is any.
    pub const POWER: u32 = 3;
    /// Upper corner of the box, three fields; one word is not used.
    pub const HIGH: u32 = 4;
}

/// Least share of the power of a node that has any.
pub const LEAST_POWER: f32 = 1e-20;

/// Most nodes of a cut.
pub const MOST_NODES: u32 = 16;

/// Most nodes that are split for a cut. One may have to be split that is above the horizon of the block but holds no light
/// that is, and so on below, without a place in the cut for it.
const MOST_SPLITS: u32 = 4 * MOST_NODES;

/// Stands for no emitter: a node of the tree over emitters.
const TOP: u32 = 0xffff_ffff;

/// Probabilities of a choice are whole multiples of one part in this.
const ONE: u32 = 1 << 23;

/// A tree over `count` items. Its words in `lights`: the number of levels below the root; for each item its rank among the
/// leaves; for each rank that an item has, the item; the nodes, numbered from 1, node n above 2n and 2n + 1.
#[derive(Clone, Copy)]
struct Tree {
    at: u32,
    count: u32,
    levels: u32,
}

impl Tree {
    #[inline(always)]
    fn new(lights: &[u32], at: u32, count: u32) -> Self {
        Self { at, count, levels: load(lights, at) }
    }

    #[inline(always)]
    fn is_leaf(&self, node: u32) -> bool {
        (node >> self.levels) != 0
    }

    #[inline(always)]
    fn leaf_of(&self, lights: &[u32], item: u32) -> u32 {
        (1 << self.levels) + load(lights, self.at + 1 + item)
    }

    #[inline(always)]
    fn item_at(&self, lights: &[u32], leaf: u32) -> u32 {
        load(lights, self.at + 1 + self.count + leaf - (1 << self.levels))
    }

    #[inline(always)]
    fn word(&self, lights: &[u32], node: u32, field: u32) -> f32 {
        f32::from_bits(load(lights, self.at + 1 + 2 * self.count + (node - 1) * NODE_WORDS + field))
    }

    #[inline(always)]
    fn vector(&self, lights: &[u32], node: u32, field: u32) -> Vec3 {
        Vec3::new(
            self.word(lights, node, field),
            self.word(lights, node, field + 1),
            self.word(lights, node, field + 2),
        )
    }

    #[inline(always)]
    fn power(&self, lights: &[u32], node: u32) -> f32 {
        self.word(lights, node, node_field::POWER)
    }
}

/// Whether `node` is `leaf` or above it.
#[inline(always)]
fn is_above(node: u32, leaf: u32) -> bool {
    let mut n = leaf;
    while n > node {
        n >>= 1;
    }
    n == node
}

/// What is known of the light of a node at a surface.
#[derive(Clone, Copy)]
struct Bound {
    /// Power times the largest cosine at the surface; 0 if nothing of it reaches the surface.
    power: f32,
    /// Least and greatest square of the distance to the box.
    near2: f32,
    far2: f32,
}

#[inline(always)]
fn bound_of(tree: &Tree, lights: &[u32], node: u32, position: Vec3, normal: Vec3) -> Bound {
    let (low, high) = (tree.vector(lights, node, node_field::LOW), tree.vector(lights, node, node_field::HIGH));
    let half = (high - low) * 0.5;
    let offset = (low + high) * 0.5 - position;
    let away = Vec3::new(abs(offset.x), abs(offset.y), abs(offset.z));
    let near = Vec3::new(max(away.x - half.x, 0.0), max(away.y - half.y, 0.0), max(away.z - half.z, 0.0));
    let (near2, far2) = (near.length_squared(), (away + half).length_squared());
    // The highest point of the box above the plane of the surface, and a little more for rounding.
    let reach = abs(normal.x) * half.x + abs(normal.y) * half.y + abs(normal.z) * half.z;
    let height = offset.dot(normal) + reach + sqrt(far2) * 1e-5;
    let cosine = if !(height > 0.0) {
        0.0
    } else if near2 > 0.0 {
        clamp(height * (1.0 / sqrt(near2)), 1e-6, 1.0)
    } else {
        1.0
    };
    Bound { power: tree.power(lights, node) * cosine, near2, far2 }
}

/// Share of the first of two powers over squared distances: powers times the other's share of both distances, which stays
/// within what floats tell apart.
#[inline(always)]
fn share(one: f32, one2: f32, other: f32, other2: f32) -> f32 {
    let total = max(one2 + other2, 1e-30);
    let (one, other) = (one * clamp(other2 / total, 1e-7, 1.0), other * clamp(one2 / total, 1e-7, 1.0));
    one / max(one + other, 1e-37)
}

/// Stands for no way on: no light below reaches the surface.
const DEAD: u32 = 0xffff_ffff;

/// Probability of the first child of a node, in parts of 2^-23; or [`DEAD`].
///
/// The mean of two shares of power over squared distance: by the least distances, which a box around the surface does not
/// have, and by the greatest.
#[inline(always)]
fn first_part(tree: &Tree, lights: &[u32], node: u32, position: Vec3, normal: Vec3) -> u32 {
    let first = bound_of(tree, lights, 2 * node, position, normal);
    let second = bound_of(tree, lights, 2 * node + 1, position, normal);
    if !(first.power > 0.0) {
        return if second.power > 0.0 { 0 } else { DEAD };
    }
    if !(second.power > 0.0) {
        return ONE;
    }
    let by_least = if first.near2 > 0.0 && second.near2 > 0.0 {
        share(first.power, first.near2, second.power, second.near2)
    } else {
        first.power / (first.power + second.power)
    };
    let by_greatest = share(first.power, first.far2, second.power, second.far2);
    let mean = clamp(0.5 * (by_least + by_greatest), 0.0, 1.0);
    1 + (mean * (ONE - 2) as f32) as u32
}

/// A node of a cut: of the tree over emitters, or of that over the lights of one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cluster {
    emitter: u32,
    /// 0: no lights.
    node: u32,
}

impl Cluster {
    /// No lights.
    pub const NONE: Self = Self { emitter: 0, node: 0 };

    /// The cluster that a record of a cut stands for.
    #[inline(always)]
    pub fn of(record: &LightRecord) -> Self {
        Self { emitter: record.emitter, node: record.local }
    }

    /// As a record, one without a light, of a cut of `count` clusters.
    #[inline(always)]
    pub fn record(&self, count: u32) -> LightRecord {
        LightRecord { emitter: self.emitter, local: self.node, uv: count, ..LightRecord::EMPTY }
    }

    /// Whether it holds no lights.
    #[inline(always)]
    pub fn is_none(&self) -> bool {
        self.node == 0
    }
}

/// What is asked of the mesh of an emitter.
#[derive(Clone, Copy)]
struct Emitter {
    instance: u32,
    count: u32,
    tree_at: u32,
}

impl Emitter {
    #[inline(always)]
    fn new(frame: &Frame, scene: &Scene, emitter: u32) -> Self {
        let instance = scene.emitter_word(frame, emitter, emitter_record::INSTANCE);
        Self {
            instance,
            count: scene.instance_word(frame, instance, instance_record::LIGHT_COUNT),
            tree_at: scene.instance_word(frame, instance, instance_record::LIGHT_CUTS_AT),
        }
    }

    #[inline(always)]
    fn has_tree(&self) -> bool {
        self.count > 1 && self.tree_at != NO_TREE
    }

    /// A surface in object space: a plane goes there by the transpose of the matrix to world space.
    #[inline(always)]
    fn surface(&self, frame: &Frame, scene: &Scene, position: Vec3, normal: Vec3) -> (Vec3, Vec3) {
        let record = scene.instance_at(frame, self.instance);
        let plane = scene.transform_normal(record + instance_record::WORLD_FROM_OBJECT, normal);
        let length = sqrt(max(plane.length_squared(), 1e-30));
        (scene.transform_point(record + instance_record::OBJECT_FROM_WORLD, position), plane * (1.0 / length))
    }
}

/// A walk from a cluster down to a light of it, as a surface at `position` with `normal` (of length 1, world space) weighs
/// their boxes: to `goal` if `has_goal`, which must be in the cluster, else to where random numbers lead. With the
/// probability of that light among those of the cluster.
#[inline(always)]
pub fn walk(
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    cluster: Cluster,
    position: Vec3,
    normal: Vec3,
    has_goal: bool,
    goal: Address,
    mut rng: Rng,
) -> Reached {
    let mut reached = Reached { address: goal, pmf: if cluster.is_none() { 0.0 } else { 1.0 } };
    let mut is_top = cluster.emitter == TOP;
    let mut node = cluster.node;
    let mut emitter = if has_goal { goal.emitter } else { cluster.emitter };
    let mut place = (position, normal);
    // First down the tree over emitters, if the cluster is one of it, then down that of a mesh.
    let mut is_done = cluster.is_none();
    while !is_done {
        let mut of_mesh = Emitter { instance: 0, count: frame.emitter_count, tree_at: frame.light_cuts_at };
        let mut has_tree = true;
        if !is_top {
            of_mesh = Emitter::new(frame, scene, emitter);
            place = of_mesh.surface(frame, scene, position, normal);
            has_tree = of_mesh.has_tree();
        }
        let mut item = 0;
        if has_tree {
            let tree = Tree::new(lights, of_mesh.tree_at, of_mesh.count);
            let goal_item = if is_top { goal.emitter } else { goal.local };
            let goal_leaf = if has_goal { tree.leaf_of(lights, goal_item) } else { 0 };
            let mut height = tree.levels;
            let mut above = node;
            while above > 1 {
                above >>= 1;
                height -= 1;
            }
            while !tree.is_leaf(node) && reached.pmf > 0.0 {
                height -= 1;
                let part = first_part(&tree, lights, node, place.0, place.1);
                let takes_second = if has_goal {
                    (goal_leaf >> height) & 1 != 0
                } else {
                    part == DEAD || (rng.next_word() >> 9) >= part
                };
                let chosen = if part == DEAD {
                    0
                } else if takes_second {
                    ONE - part
                } else {
                    part
                };
                node = 2 * node + if takes_second { 1 } else { 0 };
                reached.pmf *= chosen as f32 * (1.0 / ONE as f32);
            }
            if reached.pmf > 0.0 {
                item = if has_goal { goal_item } else { tree.item_at(lights, node) };
            }
        } else if of_mesh.count > 1 {
            let table = scene.instance_word(frame, of_mesh.instance, instance_record::LIGHT_TABLE_AT);
            let [x, y, _, _] = rng.next_four();
            item = if has_goal { goal.local } else { alias::pick(lights, table, of_mesh.count, x, y).index };
            reached.pmf *= alias::pmf(lights, table, item);
        }
        if is_top {
            emitter = item;
            node = 1;
        } else {
            reached.address = Address { emitter, local: item };
        }
        is_done = !is_top || !(reached.pmf > 0.0);
        is_top = false;
    }
    reached
}

/// The cluster that holds a light, of the `size` clusters of cut `cut`.
#[inline(always)]
pub fn cluster_of(
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    presampled: &[LightRecord],
    cut: u32,
    size: u32,
    light: Address,
) -> Cluster {
    let top = Tree::new(lights, frame.light_cuts_at, frame.emitter_count);
    let top_leaf = top.leaf_of(lights, light.emitter);
    let mesh = Emitter::new(frame, scene, light.emitter);
    let mut mesh_leaf = 1;
    if mesh.has_tree() {
        mesh_leaf = Tree::new(lights, mesh.tree_at, mesh.count).leaf_of(lights, light.local);
    }
    let mut found = Cluster::NONE;
    let mut column = 0;
    while column < size && found.is_none() {
        let cluster = Cluster::of(&load(presampled, frame.index_of_record(UVec2::new(column, cut))));
        let leaf = if cluster.emitter == TOP { top_leaf } else { mesh_leaf };
        if (cluster.emitter == TOP || cluster.emitter == light.emitter)
            && !cluster.is_none()
            && is_above(cluster.node, leaf)
        {
            found = cluster;
        }
        column += 1;
    }
    found
}

/// Clusters of a cut, at least 1; they stand first in its row.
#[inline(always)]
pub fn size_of_cut(frame: &Frame, presampled: &[LightRecord], cut: u32) -> u32 {
    load(presampled, frame.index_of_record(UVec2::new(0, cut))).uv.max(1)
}

/// The cut of a pixel: that of its block of 8x8 pixels.
#[inline(always)]
pub fn cut_of(frame: &Frame, px: UVec2) -> u32 {
    frame.index_of_block(px / BLOCK)
}

/// Cuts of a picture.
#[inline(always)]
pub fn cuts_of(width: u32, height: u32) -> u32 {
    tiles::blocks(width) * tiles::blocks(height)
}

/// A cut while it grows: for each cluster its emitter, its node, and what it may contribute.
#[derive(Clone, Copy)]
struct Cut {
    emitters: [Words; 2],
    nodes: [Words; 2],
    errors: [Words; 2],
}

impl Cut {
    const EMPTY: Self = Self { emitters: [Words::ZERO; 2], nodes: [Words::ZERO; 2], errors: [Words::ZERO; 2] };

    #[inline(always)]
    fn set(&mut self, i: u32, cluster: Cluster, error: f32) {
        if i < 8 {
            self.emitters[0].set(i, cluster.emitter);
            self.nodes[0].set(i, cluster.node);
            self.errors[0].set(i, error.to_bits());
        } else {
            self.emitters[1].set(i - 8, cluster.emitter);
            self.nodes[1].set(i - 8, cluster.node);
            self.errors[1].set(i - 8, error.to_bits());
        }
    }

    /// Without cluster `i` of `count`: the last takes its place.
    #[inline(always)]
    fn remove(&mut self, i: u32, count: u32) {
        let (last, error) = (self.cluster(count - 1), self.error(count - 1));
        self.set(i, last, error);
    }

    #[inline(always)]
    fn cluster(&self, i: u32) -> Cluster {
        if i < 8 {
            Cluster { emitter: self.emitters[0].get(i), node: self.nodes[0].get(i) }
        } else {
            Cluster { emitter: self.emitters[1].get(i - 8), node: self.nodes[1].get(i - 8) }
        }
    }

    #[inline(always)]
    fn error(&self, i: u32) -> f32 {
        f32::from_bits(if i < 8 { self.errors[0].get(i) } else { self.errors[1].get(i - 8) })
    }
}

/// Record `at.x` of cut `at.y`: a cluster of it.
///
/// The cut is made for the surface drawn from its block, of lights that may be above the horizon of some of its surfaces, and
/// has as many clusters as a row has columns, [`MOST_NODES`] at most; fewer where there are no more lights.
#[inline(always)]
pub fn cut_record(at: UVec2, frame: &Frame, scene: &Scene, lights: &[u32], blocks: &[Block]) -> LightRecord {
    if frame.light_count == 0 {
        return LightRecord::EMPTY;
    }
    let block = load(blocks, at.y);
    if !block.has_surface() {
        return LightRecord::EMPTY;
    }
    let (position, normal) = (block.position.truncate(), block.normal.truncate());
    let top = Tree::new(lights, frame.light_cuts_at, frame.emitter_count);
    let most = frame.presampled_columns.min(MOST_NODES);
    let mut cut = Cut::EMPTY;
    let root = cluster_at(&top, lights, TOP, 1);
    cut.set(0, root, if is_splittable(frame, scene, lights, root) { 1.0 } else { 0.0 });
    let mut count = 1;
    let mut splits = 0;
    let mut is_done = false;
    while count < most && splits < MOST_SPLITS && !is_done {
        splits += 1;
        let (mut worst, mut worst_error) = (0, 0.0);
        let mut i = 0;
        while i < count {
            let error = cut.error(i);
            if error > worst_error {
                (worst, worst_error) = (i, error);
            }
            i += 1;
        }
        is_done = !(worst_error > 0.0);
        if !is_done {
            let split = cut.cluster(worst);
            // The tree that the cluster is of, the surface as seen from there, and what turns its powers over squared
            // distances into those of the world.
            let mut tree = top;
            let mut place = (position, normal);
            let mut scale = 1.0;
            let mut to_world = 0;
            if split.emitter != TOP {
                let mesh = Emitter::new(frame, scene, split.emitter);
                tree = Tree::new(lights, mesh.tree_at, mesh.count);
                place = mesh.surface(frame, scene, position, normal);
                to_world = scene.instance_at(frame, mesh.instance) + instance_record::WORLD_FROM_OBJECT;
                let x2 = scene.column(to_world, 0).length_squared();
                let y2 = scene.column(to_world, 1).length_squared();
                let z2 = scene.column(to_world, 2).length_squared();
                let mean2 = (x2 + y2 + z2) * (1.0 / 3.0);
                scale = top.power(lights, top.leaf_of(lights, split.emitter)) / max(mean2, 1e-30);
            }
            // A child without lights for the block takes no place in the cut.
            let mut has_place = true;
            let mut child = 0;
            while child < 2 {
                let node = 2 * split.node + child;
                let (low, high) = world_box(&tree, lights, node, scene, split.emitter == TOP, to_world);
                if tree.power(lights, node) > 0.0 && block.may_see(low, high) {
                    let bound = bound_of(&tree, lights, node, place.0, place.1);
                    let cluster = cluster_at(&tree, lights, split.emitter, node);
                    let distance2 = max(max(bound.near2, bound.far2 * 1e-4), 1e-30);
                    let may_split = is_splittable(frame, scene, lights, cluster);
                    // The least that counts goes last, but goes: all of the cut is used while there are lights.
                    let error = if may_split { clamp(bound.power * scale / distance2, 1e-30, 1e30) } else { 0.0 };
                    if has_place {
                        cut.set(worst, cluster, error);
                        has_place = false;
                    } else {
                        cut.set(count, cluster, error);
                        count += 1;
                    }
                }
                child += 1;
            }
            // Nothing below emits, or lights the block.
            if has_place {
                cut.remove(worst, count);
                count -= 1;
            }
        }
    }
    if at.x < count { cut.cluster(at.x).record(count) } else { LightRecord::EMPTY }
}

/// A box in world space around all points of a node that emit; `to_world` is where the matrix of its mesh stands.
#[inline(always)]
fn world_box(tree: &Tree, lights: &[u32], node: u32, scene: &Scene, is_top: bool, to_world: u32) -> (Vec3, Vec3) {
    let (low, high) = (tree.vector(lights, node, node_field::LOW), tree.vector(lights, node, node_field::HIGH));
    let (mut center, mut half) = ((low + high) * 0.5, (high - low) * 0.5);
    if !is_top {
        center = scene.transform_point(to_world, center);
        let (x, y, z) = (scene.column(to_world, 0), scene.column(to_world, 1), scene.column(to_world, 2));
        half = x.abs() * half.x + y.abs() * half.y + z.abs() * half.z;
    }
    (center - half, center + half)
}

/// The cluster of a node: a leaf of the tree over emitters is the root of a mesh.
#[inline(always)]
fn cluster_at(tree: &Tree, lights: &[u32], emitter: u32, node: u32) -> Cluster {
    if emitter == TOP && tree.is_leaf(node) {
        return Cluster { emitter: tree.item_at(lights, node), node: 1 };
    }
    Cluster { emitter, node }
}

/// Whether a cluster has children.
#[inline(always)]
fn is_splittable(frame: &Frame, scene: &Scene, lights: &[u32], cluster: Cluster) -> bool {
    if cluster.emitter == TOP {
        return true;
    }
    let mesh = Emitter::new(frame, scene, cluster.emitter);
    mesh.has_tree() && !Tree::new(lights, mesh.tree_at, mesh.count).is_leaf(cluster.node)
}
