//! Building the trees that cuts are made through, see [`weir_shared::light_cuts`].

use glam::Vec3;
use rayon::prelude::*;
use weir_shared::light_cuts::{LEAST_POWER, NODE_WORDS, node_field};

use super::light_tree::LightBounds;

/// Bits of a place along each axis: those of three make a word.
const BITS: u32 = 10;

/// Words of a tree over `count` lights; none of them, no words.
pub(super) fn words(count: usize) -> usize {
    match count {
        0 => 0,
        _ => 1 + 2 * count + (2 * count.next_power_of_two() - 1) * NODE_WORDS as usize,
    }
}

/// Box and power of a node.
#[derive(Clone, Copy)]
struct Node {
    corners: [Vec3; 2],
    power: f64,
}

impl Node {
    /// No lights: the box is far from everything, and nobody asks where.
    const NONE: Self = Self { corners: [Vec3::ZERO; 2], power: 0.0 };

    fn union(&self, other: &Self) -> Self {
        if self.power == 0.0 || other.power == 0.0 {
            return if self.power == 0.0 { *other } else { *self };
        }
        Self {
            corners: [self.corners[0].min(other.corners[0]), self.corners[1].max(other.corners[1])],
            power: self.power + other.power,
        }
    }
}

/// A tree over lights, as words of `lights`.
pub(super) fn build(lights: &[LightBounds]) -> Vec<u32> {
    let count = lights.len();
    if count == 0 {
        return Vec::new();
    }
    let centers: Vec<Vec3> = lights.iter().map(|l| l.corners()[0] * 0.5 + l.corners()[1] * 0.5).collect();
    let low = centers.iter().fold(Vec3::INFINITY, |low, &c| low.min(c));
    let size = centers.iter().fold(Vec3::NEG_INFINITY, |high, &c| high.max(c)) - low;
    let scale = (1u32 << BITS) as f32 / size.max_element().max(f32::MIN_POSITIVE);
    let mut order: Vec<(u32, u32)> =
        centers.par_iter().zip(0..count as u32).map(|(c, i)| (morton((c - low) * scale), i)).collect();
    order.par_sort_unstable();

    let total: f64 = lights.iter().map(|l| l.power).sum();
    let leaves = count.next_power_of_two();
    let mut nodes = vec![Node::NONE; 2 * leaves];
    for (rank, &(_, item)) in order.iter().enumerate() {
        let light = &lights[item as usize];
        let power = if light.power > 0.0 { (light.power / total).max(f64::from(LEAST_POWER)) } else { 0.0 };
        nodes[leaves + rank] = Node { corners: light.corners(), power };
    }
    for node in (1..leaves).rev() {
        nodes[node] = nodes[2 * node].union(&nodes[2 * node + 1]);
    }
    let mut built = vec![0; words(count)];
    built[0] = leaves.ilog2();
    let (ranks, rest) = built[1..].split_at_mut(count);
    let (items, rest) = rest.split_at_mut(count);
    for (rank, &(_, item)) in order.iter().enumerate() {
        ranks[item as usize] = rank as u32;
        items[rank] = item;
    }
    for (node, words) in nodes[1..].iter().zip(rest.chunks_exact_mut(NODE_WORDS as usize)) {
        for (at, corner) in [node_field::LOW, node_field::HIGH].into_iter().zip(node.corners) {
            words[at as usize..][..3].copy_from_slice(&corner.to_array().map(f32::to_bits));
        }
        words[node_field::POWER as usize] = (node.power as f32).to_bits();
    }
    built
}

/// The place of a point on a Morton curve through a cube with edges of 2^[`BITS`].
fn morton(point: Vec3) -> u32 {
    let spread = |x: f32| {
        // Casts saturate, and take what is not a number for zero.
        let mut x = (x as u32).min((1 << BITS) - 1);
        x = (x | (x << 16)) & 0x0300_00ff;
        x = (x | (x << 8)) & 0x0300_f00f;
        x = (x | (x << 4)) & 0x030c_30c3;
        (x | (x << 2)) & 0x0924_9249
    };
    spread(point.x) | (spread(point.y) << 1) | (spread(point.z) << 2)
}

#[cfg(test)]
mod tests;
