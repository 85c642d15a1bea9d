//! Building light trees, see [`weir_shared::light_tree`].

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat4, Quat, Vec3};
use rayon::prelude::*;
use weir_shared::light_tree::{LEAF, MAX_DEPTH, NODE_WORDS, WIDTH, node_field};

/// Bins along each axis that splits are looked for between.
const BINS: usize = 12;

/// Items from which on the two sides of a split are built at the same time.
const PARALLEL: usize = 4_096;

/// What is known of a group of lights.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightBounds {
    /// Lower and upper corner of a box around all points that emit.
    corners: [Vec3; 2],
    /// Axis of a cone around all normals of faces that emit.
    axis: Vec3,
    /// Half angle of that cone in radians; pi holds every direction.
    spread: f32,
    /// Emitted power, in any unit.
    pub(super) power: f64,
}

impl LightBounds {
    /// Whether two are the same to the bit.
    pub(super) fn is(&self, other: &Self) -> bool {
        let bits = |bounds: &Self| {
            let [low, high] = bounds.corners;
            let floats = [low.x, low.y, low.z, high.x, high.y, high.z, bounds.axis.x, bounds.axis.y, bounds.axis.z];
            (floats.map(f32::to_bits), bounds.spread.to_bits(), bounds.power.to_bits())
        };
        bits(self) == bits(other)
    }

    /// No lights.
    pub(super) const NONE: Self =
        Self { corners: [Vec3::INFINITY, Vec3::NEG_INFINITY], axis: Vec3::Z, spread: 0.0, power: 0.0 };

    /// An emissive triangle.
    pub(super) fn triangle(corners: [Vec3; 3], two_sided: bool, power: f64) -> Self {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a).normalize_or_zero().as_vec3();
        let has_axis = !two_sided && normal != Vec3::ZERO;
        Self {
            corners: corners.into_iter().fold(Self::NONE.corners, |[low, high], p| [low.min(p), high.max(p)]),
            axis: if has_axis { normal } else { Vec3::Z },
            spread: if has_axis { 0.0 } else { PI },
            power,
        }
    }

    /// Lower and upper corner of a box around all points that emit.
    pub(super) fn corners(&self) -> [Vec3; 2] {
        self.corners
    }

    /// A light within a box whose normals all are `axis` (of length 1), or any direction if there is none.
    pub(super) fn around(corners: [Vec3; 2], axis: Option<Vec3>, power: f64) -> Self {
        let spread = if axis.is_some() { 0.0 } else { PI };
        Self { corners, axis: axis.unwrap_or(Vec3::Z), spread, power }
    }

    /// The same lights placed by a transform, with another power.
    pub(super) fn placed(&self, world_from_object: &Mat4, object_from_world: &Mat4, power: f64) -> Self {
        let [low, high] = self.corners;
        let mut corners = Self::NONE.corners;
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            let p = world_from_object.transform_point3(Vec3::new(pick(0), pick(1), pick(2)));
            corners = [corners[0].min(p), corners[1].max(p)];
        }
        // Normals go by the transpose of the inverse. Scales that differ would make another shape of the cone.
        let axis = object_from_world.transpose().transform_vector3(self.axis).normalize_or_zero();
        let columns = [world_from_object.x_axis, world_from_object.y_axis, world_from_object.z_axis];
        let lengths = columns.map(|column| column.truncate().length_squared());
        let [x, y, z] = columns.map(|column| column.truncate().normalize_or_zero());
        let is_even = lengths.iter().all(|&l| (l - lengths[0]).abs() <= 1e-3 * lengths[0])
            && [x.dot(y), y.dot(z), z.dot(x)].iter().all(|d| d.abs() < 1e-3);
        let spread = if axis == Vec3::ZERO || (!is_even && self.spread > 0.0) { PI } else { self.spread };
        Self { corners, axis: if axis == Vec3::ZERO { Vec3::Z } else { axis }, spread, power }
    }

    /// These lights and others.
    pub(super) fn union(&self, other: &Self) -> Self {
        if self.power == 0.0 || other.power == 0.0 {
            return if self.power == 0.0 { *other } else { *self };
        }
        let (wide, narrow) = if self.spread >= other.spread { (self, other) } else { (other, self) };
        // Not by the arc cosine, which takes angles below a thousandth for zero.
        let between = wide.axis.cross(narrow.axis).length().atan2(wide.axis.dot(narrow.axis));
        let (mut axis, mut spread) = (wide.axis, wide.spread);
        if between + narrow.spread > wide.spread {
            spread = 0.5 * (wide.spread + between + narrow.spread);
            let turn = wide.axis.cross(narrow.axis).try_normalize();
            match turn {
                Some(turn) if spread < PI => {
                    axis = (Quat::from_axis_angle(turn, spread - wide.spread) * wide.axis).normalize();
                }
                _ => spread = if between < FRAC_PI_2 { spread } else { PI },
            }
        }
        Self {
            corners: [self.corners[0].min(other.corners[0]), self.corners[1].max(other.corners[1])],
            axis,
            spread: spread.min(PI),
            power: self.power + other.power,
        }
    }

    /// Writes the fields of child number `child` of a node.
    fn write(&self, total_power: f64, link: u32, node: &mut [u32], child: usize) {
        let [low, high] = self.corners;
        let center = low * 0.5 + high * 0.5;
        // The corners are exact, the center is not.
        let radius = (high - center).max(center - low).length() * 1.000_001;
        // Rounding has moved the axes of unions, by much less than this.
        let spread = if self.spread > 0.0 { self.spread + 1e-5 } else { 0.0 };
        let (sin, axis) = if spread < FRAC_PI_2 { (spread.sin(), self.axis * spread.cos()) } else { (1.0, Vec3::ZERO) };
        let mut field = |field: u32, word: u32| node[field as usize * WIDTH as usize + child] = word;
        for (i, (center, axis)) in (0..).zip(center.to_array().into_iter().zip(axis.to_array())) {
            field(node_field::CENTER + i, center.to_bits());
            field(node_field::AXIS + i, axis.to_bits());
        }
        field(node_field::RADIUS, radius.to_bits());
        // Lights that all have no power have no share of it either.
        let share = if self.power > 0.0 { (self.power / total_power).max(1e-30) } else { 0.0 };
        field(node_field::POWER, (share as f32).to_bits());
        field(node_field::SIN_SPREAD, sin.to_bits());
        field(node_field::LINK, link);
    }
}

/// A light on its way to a leaf.
struct Item {
    bounds: LightBounds,
    center: Vec3,
    index: u32,
    trail: u32,
}

/// Most emissive triangles that the trees of all meshes hold together. Trees and alias tables of so many take about 120
/// MB, and WebGPU grants no more than 128 MiB to a storage binding. Half as many where there are trees for cuts as well,
/// of which so many take 72 MB at most.
pub(super) const MOST_IN_TREES: usize = 1 << 20;

/// Which meshes get a tree, by their numbers of emissive triangles: the smallest ones, while all together have no more
/// than `most`.
pub(super) fn which_have_trees(counts: &[usize], most: usize) -> Vec<bool> {
    let mut order: Vec<usize> = (0..counts.len()).collect();
    order.sort_by_key(|&mesh| counts[mesh]);
    let mut has_tree = vec![false; counts.len()];
    let mut sum = 0;
    for mesh in order {
        sum += counts[mesh];
        has_tree[mesh] = sum <= most;
    }
    has_tree
}

/// Words that a tree over `count` lights never exceeds.
///
/// A node over more than eight lights has eight children, any other has lights alone, two at least. So with b nodes of
/// the second kind there are (count - b - 1) / 7 of the first at most, and b is count / 2 at most.
pub(super) fn capacity_words(count: usize) -> usize {
    count + (4 * count).saturating_sub(1) / 7 * NODE_WORDS as usize
}

/// What is known of lights without a tree over them.
pub(super) fn bounds_of(lights: &[LightBounds]) -> LightBounds {
    match lights {
        [] => LightBounds::NONE,
        [light] => *light,
        // By halves: rounding adds up over few unions.
        _ => {
            let (one, two) = lights.split_at(lights.len() / 2);
            bounds_of(one).union(&bounds_of(two))
        }
    }
}

/// A tree over lights: its words in `lights`, and what is known of all of them. No lights: no words.
pub(super) fn build(lights: &[LightBounds]) -> (Vec<u32>, LightBounds) {
    let total: f64 = lights.iter().map(|l| l.power).sum();
    let mut items: Vec<Item> = (0..)
        .zip(lights)
        .map(|(index, &bounds)| Item {
            bounds,
            center: bounds.corners[0] * 0.5 + bounds.corners[1] * 0.5,
            index,
            trail: 0,
        })
        .collect();
    let tree = match items.len() {
        0 => return (Vec::new(), LightBounds::NONE),
        1 => Subtree { bounds: items[0].bounds, nodes: Vec::new() },
        _ => subtree(&mut items, 0, 0, total),
    };
    let mut words = vec![0; items.len()];
    for item in &items {
        words[item.index as usize] = item.trail;
    }
    words.extend(tree.nodes);
    (words, tree.bounds)
}

/// Fits the nodes of a tree, `words` as [`build`] makes them, to what its lights have become: as many, in the same places of
/// the tree. What a walk may do is as exact as in a new tree; how well it chooses depends on how far lights have moved from
/// each other. Lights that are as they were leave every word as it was.
pub(super) fn refit(words: &mut [u32], lights: &[LightBounds]) {
    let total: f64 = lights.iter().map(|l| l.power).sum();
    let Some((_, nodes)) = words.split_at_mut_checked(lights.len()) else { return };
    let (width, stride) = (WIDTH as usize, NODE_WORDS as usize);
    let count = nodes.len() / stride;
    let mut bounds = vec![LightBounds::NONE; count];
    // Children come after their node.
    for (number, node) in nodes.chunks_exact_mut(stride).enumerate().rev() {
        for child in 0..width {
            let link = node[node_field::LINK as usize * width + child];
            // Of a child that is not there.
            if link == 0 {
                break;
            }
            let below = if link & LEAF != 0 { lights[(link & !LEAF) as usize] } else { bounds[link as usize] };
            below.write(total, link, node, child);
            bounds[number] = bounds[number].union(&below);
        }
    }
}

/// Nodes over some lights, the root first, with links counted from it.
struct Subtree {
    bounds: LightBounds,
    nodes: Vec<u32>,
}

/// Nodes over two lights or more, `depth` levels below the root of the whole tree, where the trail so far is `trail`.
fn subtree(items: &mut [Item], depth: u32, trail: u32, total: f64) -> Subtree {
    let count = items.len();
    // How deep a full tree would be: where there is just room for that, it becomes one.
    let levels = (usize::BITS - (count - 1).leading_zeros()).div_ceil(WIDTH.ilog2());
    let is_tight = depth + levels + 1 >= MAX_DEPTH;
    let mut groups: Vec<&mut [Item]> = vec![items];
    while groups.len() < WIDTH as usize {
        // The largest group is split next: that keeps the tree flat.
        let Some(largest) = (0..groups.len()).max_by_key(|&g| groups[g].len()).filter(|&g| groups[g].len() > 1) else {
            break;
        };
        let items = groups.swap_remove(largest);
        let middle = if is_tight { halve(items) } else { split(items) };
        let (one, two) = items.split_at_mut(middle);
        groups.extend([one, two]);
    }
    let build = |(child, items): (usize, &mut [Item])| {
        let trail = trail | (child as u32) << (depth * WIDTH.ilog2());
        if let [item] = items {
            item.trail = trail;
            return (Subtree { bounds: item.bounds, nodes: Vec::new() }, item.index);
        }
        (subtree(items, depth + 1, trail, total), 0)
    };
    let children: Vec<(Subtree, u32)> = if count >= PARALLEL {
        groups.into_par_iter().enumerate().map(build).collect()
    } else {
        groups.into_iter().enumerate().map(build).collect()
    };
    let mut nodes = vec![0; NODE_WORDS as usize];
    let mut bounds = LightBounds::NONE;
    for (child, (below, item)) in children.into_iter().enumerate() {
        let first = (nodes.len() / NODE_WORDS as usize) as u32;
        let link = if below.nodes.is_empty() { LEAF | item } else { first };
        below.bounds.write(total, link, &mut nodes, child);
        bounds = bounds.union(&below.bounds);
        let links = node_field::LINK as usize * WIDTH as usize;
        for node in below.nodes.chunks_exact(NODE_WORDS as usize) {
            let at = nodes.len();
            nodes.extend_from_slice(node);
            // Links counted from that root, now from this one. A child that is not there has none.
            let children = nodes[at + links..][..WIDTH as usize].iter_mut();
            children.filter(|link| **link > 0 && **link & LEAF == 0).for_each(|link| *link += first);
        }
    }
    Subtree { bounds, nodes }
}

/// What a bin holds.
#[derive(Clone, Copy)]
struct Bin {
    corners: [Vec3; 2],
    normals: Vec3,
    count: u32,
    power: f64,
}

impl Bin {
    const EMPTY: Self = Self { corners: LightBounds::NONE.corners, normals: Vec3::ZERO, count: 0, power: 0.0 };

    fn of(item: &Item) -> Self {
        let is_directed = item.bounds.spread < FRAC_PI_2;
        Self {
            corners: item.bounds.corners,
            normals: if is_directed { item.bounds.axis } else { Vec3::ZERO },
            count: 1,
            power: item.bounds.power,
        }
    }

    fn with(&self, other: &Self) -> Self {
        Self {
            corners: [self.corners[0].min(other.corners[0]), self.corners[1].max(other.corners[1])],
            normals: self.normals + other.normals,
            count: self.count + other.count,
            power: self.power + other.power,
        }
    }

    /// How much there is to lose: power times surface area, times the solid angle that is lit. That is 4 pi where
    /// normals point everywhere and pi where they agree; between, it goes by the length of their mean.
    fn cost(&self) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let size = self.corners[1] - self.corners[0];
        let longest = size.max_element();
        // Lights in a row have no area; their length still counts.
        let area = size.x * size.y + size.y * size.z + size.z * size.x + 1e-3 * longest * longest;
        let agreement = (self.normals.length() / self.count as f32).min(1.0);
        self.power * f64::from(area) * f64::from(4.0 - 3.0 * agreement)
    }
}

/// Sorts items to two sides at the median along the longest axis; returns how many go first.
fn halve(items: &mut [Item]) -> usize {
    let (low, high) = extent(items);
    let size = high - low;
    let axis = (0..3).find(|&a| size[a] == size.max_element()).unwrap_or(0);
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| a.center[axis].total_cmp(&b.center[axis]).then(a.index.cmp(&b.index)));
    half
}

/// Corners of a box around the centers.
fn extent(items: &[Item]) -> (Vec3, Vec3) {
    items.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), i| (low.min(i.center), high.max(i.center)))
}

/// Sorts items to two sides, some to each; returns how many go first.
///
/// Differs from the source (Conty Estevez and Kulla 2018, surface area orientation heuristic): the cones of candidates for
/// a split are estimated, see [`Bin::cost`].
fn split(items: &mut [Item]) -> usize {
    let (low, high) = extent(items);
    let size = high - low;
    let longest = size.max_element();
    if longest <= 0.0 {
        return halve(items);
    }
    let bin_of = |item: &Item, axis: usize| {
        (((item.center[axis] - low[axis]) / size[axis] * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best = (f64::INFINITY, 0, 0);
    for axis in (0..3).filter(|&axis| size[axis] > 0.0) {
        let mut bins = [Bin::EMPTY; BINS];
        for item in items.iter() {
            let bin = &mut bins[bin_of(item, axis)];
            *bin = bin.with(&Bin::of(item));
        }
        let mut above = [Bin::EMPTY; BINS];
        let mut sum = Bin::EMPTY;
        for b in (1..BINS).rev() {
            sum = sum.with(&bins[b]);
            above[b] = sum;
        }
        // Long boxes are better cut across.
        let thin = f64::from(longest / size[axis]);
        let mut below = Bin::EMPTY;
        for b in 1..BINS {
            below = below.with(&bins[b - 1]);
            let cost = thin * (below.cost() + above[b].cost());
            if below.count > 0 && above[b].count > 0 && cost < best.0 {
                best = (cost, axis, b);
            }
        }
    }
    let (cost, axis, bin) = best;
    if !cost.is_finite() {
        return halve(items);
    }
    let mut middle = 0;
    for i in 0..items.len() {
        if bin_of(&items[i], axis) < bin {
            items.swap(i, middle);
            middle += 1;
        }
    }
    middle
}

#[cfg(test)]
pub(super) mod tests;
