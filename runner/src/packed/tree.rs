//! Acceleration structures over boxes: by agglomeration, or by halving where agglomeration would degenerate.

use std::time::Duration;

use glam::{UVec4, Vec3A};
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, node::Bvh2Node},
    cwbvh::{CwBvh, builder::build_cwbvh, bvh2_to_cwbvh::bvh2_to_cwbvh, node::CwBvhNode},
};
use rayon::prelude::*;
use weir_shared::bvh::MAX_DEPTH;

/// Boxes of about one size with their centers in one cell of that size, above which agglomeration is not tried: it merges
/// nearest neighbours, and where all are equally near, or lie in each other, it takes one step for each box.
const CROWD: usize = 2_048;

/// A tree of at most [`MAX_DEPTH`] levels over `boxes`, with at most three in a leaf. No boxes: no nodes.
pub(super) fn build(boxes: &[Aabb], careful: bool) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    if !crowded(boxes) {
        let preset = if careful { BvhBuildParams::medium_build() } else { BvhBuildParams::fast_build() };
        let tree = build_cwbvh(boxes, BvhBuildParams { pre_split: false, ..preset }, &mut Duration::default());
        if depth(&tree) <= MAX_DEPTH {
            return tree;
        }
    }
    bvh2_to_cwbvh(&halve(boxes), 3, true, false)
}

fn bounds(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::empty(), |all, one| all.union(&one))
}

/// Whether many boxes of about one size have their centers in one cell of that size, or of a 1024th of the scene.
fn crowded(boxes: &[Aabb]) -> bool {
    if boxes.len() <= CROWD {
        return false;
    }
    let all = bounds(boxes.iter().copied());
    let scale = Vec3A::splat(1023.0) / (all.max - all.min).max(Vec3A::splat(f32::MIN_POSITIVE));
    let mut cells: Vec<u64> = boxes
        .par_iter()
        .map(|b| {
            let cell = ((b.center() - all.min) * scale).clamp(Vec3A::ZERO, Vec3A::splat(1023.0));
            // Powers of two of the smallest cells: 0 to 10.
            // Along an axis without extent, not-a-number: `f32::max` passes it over.
            let sizes = ((b.max - b.min) * scale).to_array();
            let size = sizes.into_iter().fold(1.0, f32::max).min(1023.0) as u32;
            let level = size.ilog2();
            let [x, y, z] = [cell.x, cell.y, cell.z].map(|c| (c as u64) >> level);
            u64::from(level) << 30 | x << 20 | y << 10 | z
        })
        .collect();
    cells.par_sort_unstable();
    cells.windows(CROWD).any(|w| w[0] == w[CROWD - 1])
}

/// A balanced tree: each node halves its boxes at the median center along its longest axis.
fn halve(boxes: &[Aabb]) -> Bvh2 {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let of = |order: &[u32]| bounds(order.iter().map(|&i| boxes[i as usize]));
    let mut nodes = vec![Bvh2Node::new(of(&order), 0, 0)];
    let mut open = vec![(0usize, 0usize, boxes.len(), 1usize)];
    let mut levels = 1;
    while let Some((node, start, end, level)) = open.pop() {
        levels = levels.max(level);
        let part = &mut order[start..end];
        if part.len() <= 1 {
            nodes[node] = Bvh2Node::new(of(part), 1, start as u32);
            continue;
        }
        let centers = bounds(part.iter().map(|&i| {
            let c = boxes[i as usize].center();
            Aabb::new(c, c)
        }));
        let size = centers.max - centers.min;
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let middle = part.len() / 2;
        // The index breaks ties, so that the tree is the same everywhere.
        part.select_nth_unstable_by(middle, |&a, &b| {
            let center = |i: u32| boxes[i as usize].center()[axis];
            center(a).total_cmp(&center(b)).then(a.cmp(&b))
        });
        let first = nodes.len();
        nodes[node] = Bvh2Node::new(of(&order[start..end]), 0, first as u32);
        nodes.push(Bvh2Node::new(of(&order[start..start + middle]), 0, 0));
        nodes.push(Bvh2Node::new(of(&order[start + middle..end]), 0, 0));
        open.push((first, start, start + middle, level + 1));
        open.push((first + 1, start + middle, end, level + 1));
    }
    Bvh2 {
        nodes,
        primitive_indices: order,
        children_are_ordered_after_parents: true,
        max_depth: levels.max(96),
        ..Bvh2::default()
    }
}

/// Levels of inner nodes.
pub(super) fn depth(tree: &CwBvh) -> u32 {
    let mut deepest = 0;
    let mut stack = vec![(0u32, 1u32)];
    while let Some((node, level)) = stack.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[node as usize];
        let inner = (0..8).filter(|&child| !node.is_leaf(child) && !node.is_child_empty(child));
        stack.extend(inner.map(|child| (node.child_node_index(child), level + 1)));
    }
    deepest
}

/// A node as five rows of words.
pub(super) fn rows(node: &CwBvhNode) -> [UVec4; 5] {
    let words: [u32; 20] = bytemuck::cast(*node);
    core::array::from_fn(|i| UVec4::from_slice(&words[i * 4..]))
}
