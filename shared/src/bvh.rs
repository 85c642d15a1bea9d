//! Traversal of compressed wide acceleration structures, in two levels.
//!
//! Nodes are those of obvhs (eight children, 80 bytes), five rows of four words each; see Ylitie, Karras, Laine
//! 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs". Closest and any hit are
//! separate loops. Among equally near triangles the one with the lowest (instance, number) wins, so that the
//! result does not depend on the shape of the tree.

use glam::{UVec2, UVec4, Vec3};

use crate::{
    frame::Frame,
    numerics::{abs, copysign, load, max, min},
    ray::{Hit, Ray},
    scene::{Scene, instance_record},
    texture::is_opaque,
    trace::Tracer,
    triangle::ShearedRay,
};

#[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
pub mod simd;

/// Rows of a node in the `bvh` buffer.
pub const NODE_ROWS: u32 = 5;

/// Depth of tree that traversal can take. Each level leaves at most one group of siblings on the stack.
pub const MAX_DEPTH: u32 = 32;

/// A ray prepared for nodes.
#[derive(Clone, Copy)]
pub struct NodeRay {
    /// Start.
    pub origin: Vec3,
    /// Reciprocal of the direction, finite.
    pub inverse: Vec3,
    /// The octant that the direction does not point to, in each byte: children are visited front to back.
    pub octant: u32,
}

impl NodeRay {
    /// Prepares a ray.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        // Components of nearly zero become tiny ones, so that no 0 * inf arises.
        let reciprocal = |d: f32| 1.0 / (if abs(d) < 1e-20 { copysign(1e-20, d) } else { d });
        let inverse = Vec3::new(reciprocal(direction.x), reciprocal(direction.y), reciprocal(direction.z));
        // By the sign of the reciprocal: -0.0 counts as negative here and in `intersect_node`.
        let octant = (if inverse.x < 0.0 { 0 } else { 0x0404_0404u32 })
            | (if inverse.y < 0.0 { 0 } else { 0x0202_0202 })
            | (if inverse.z < 0.0 { 0 } else { 0x0101_0101 });
        Self { origin, inverse, octant }
    }
}

/// Which slabs of a node the ray meets, as lines `t = q * scale + shift` in the 8-bit plane position q, with `near`
/// and `far` shifted outward by more than the rounding errors can move a plane.
#[derive(Clone, Copy)]
pub struct NodeSlabs {
    scale: Vec3,
    near: Vec3,
    far: Vec3,
}

impl NodeSlabs {
    #[inline(always)]
    fn new(head: UVec4, ray: &NodeRay) -> Self {
        let exponent = |byte: u32| f32::from_bits(byte << 23);
        let corner = Vec3::new(f32::from_bits(head.x), f32::from_bits(head.y), f32::from_bits(head.z));
        let extent =
            Vec3::new(exponent(head.w & 0xff), exponent((head.w >> 8) & 0xff), exponent((head.w >> 16) & 0xff));
        let scale = extent * ray.inverse;
        let shift = (corner - ray.origin) * ray.inverse;
        let pad = |shift: f32, scale: f32| (abs(shift) + abs(scale) * 256.0) * 2.4e-7;
        let padding = Vec3::new(pad(shift.x, scale.x), pad(shift.y, scale.y), pad(shift.z, scale.z));
        Self { scale, near: shift - padding, far: shift + padding }
    }
}

/// Tests the eight children of the node in `rows` for t in `0..=t_max`. The low 24 bits of the result mark
/// primitives, counted from the node's first; the high 8 bits inner children in the order of traversal.
#[inline(always)]
pub fn intersect_node(rows: &[UVec4; 5], ray: &NodeRay, t_max: f32) -> u32 {
    let slabs = NodeSlabs::new(rows[0], ray);
    let mut mask = 0;
    let mut child = 0;
    while child < 8 {
        mask |= child_bits(rows, &slabs, ray, t_max, child);
        child += 1;
    }
    mask
}

#[inline(always)]
fn child_bits(rows: &[UVec4; 5], slabs: &NodeSlabs, ray: &NodeRay, t_max: f32, child: u32) -> u32 {
    let shift = (child & 3) * 8;
    let upper = child >= 4;
    let pick = |low: u32, high: u32| ((if upper { high } else { low }) >> shift) & 0xff;
    let meta = pick(rows[1].z, rows[1].w);
    let axis = |low: u32, high: u32, inverse: f32, scale: f32, near: f32, far: f32| {
        let (q_near, q_far) = if inverse < 0.0 { (high, low) } else { (low, high) };
        (q_near as f32 * scale + near, q_far as f32 * scale + far)
    };
    let (near_x, far_x) = axis(
        pick(rows[2].x, rows[2].y),
        pick(rows[2].z, rows[2].w),
        ray.inverse.x,
        slabs.scale.x,
        slabs.near.x,
        slabs.far.x,
    );
    let (near_y, far_y) = axis(
        pick(rows[3].x, rows[3].y),
        pick(rows[3].z, rows[3].w),
        ray.inverse.y,
        slabs.scale.y,
        slabs.near.y,
        slabs.far.y,
    );
    let (near_z, far_z) = axis(
        pick(rows[4].x, rows[4].y),
        pick(rows[4].z, rows[4].w),
        ray.inverse.z,
        slabs.scale.z,
        slabs.near.z,
        slabs.far.z,
    );
    let near = max(max(near_x, near_y), max(near_z, 0.0));
    let far = min(min(far_x, far_y), min(far_z, t_max));
    // Inner children have bits 3 and 4 set; their order depends on the octant. Empty slots have no bits at all.
    let inner = ((meta & (meta << 1)) & 0x10) != 0;
    let index = (meta ^ (if inner { ray.octant & 0xff } else { 0 })) & 0x1f;
    if near <= far { ((meta >> 5) & 7) << index } else { 0 }
}

/// Children of one node that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Children {
    /// First inner child, and in the high byte the inner children to visit, in the low byte the inner-child mask.
    nodes: UVec2,
    /// First primitive, and the primitives to test.
    primitives: UVec2,
}

impl Children {
    /// From the rows of the node and the result of [`intersect_node`].
    #[inline(always)]
    fn new(rows: &[UVec4; 5], mask: u32) -> Self {
        Self {
            nodes: UVec2::new(rows[1].x, (mask & 0xff00_0000) | (rows[0].w >> 24)),
            primitives: UVec2::new(rows[1].y, mask & 0x00ff_ffff),
        }
    }
}

/// The state of a walk through one tree: what is left to visit.
struct Walk {
    stack: [UVec2; MAX_DEPTH as usize],
    depth: u32,
    to_visit: Children,
}

impl Walk {
    #[inline(always)]
    fn from_root() -> Self {
        Self {
            stack: [UVec2::ZERO; MAX_DEPTH as usize],
            depth: 0,
            to_visit: Children { nodes: UVec2::new(0, 0x8000_0000), primitives: UVec2::ZERO },
        }
    }

    /// Takes a primitive off the list, if there is one.
    #[inline(always)]
    fn next_primitive(&mut self) -> u32 {
        let bit = 31 - self.to_visit.primitives.y.leading_zeros();
        self.to_visit.primitives.y &= !(1 << bit);
        self.to_visit.primitives.x + bit
    }

    /// Whether there are primitives to test.
    #[inline(always)]
    fn has_primitive(&self) -> bool {
        self.to_visit.primitives.y != 0
    }

    /// Whether there is an inner node to visit, after popping the stack where needed.
    #[inline(always)]
    fn has_node(&mut self) -> bool {
        if (self.to_visit.nodes.y & 0xff00_0000) == 0 {
            if self.depth == 0 {
                return false;
            }
            self.depth -= 1;
            self.to_visit.nodes = self.stack[self.depth as usize];
        }
        true
    }

    /// Takes the next inner node off the list: its number, counted from the root.
    #[inline(always)]
    fn next_node(&mut self, octant: u32) -> u32 {
        let hits = self.to_visit.nodes.y;
        let bit = 31 - hits.leading_zeros();
        let base = self.to_visit.nodes.x;
        self.to_visit.nodes.y &= !(1 << bit);
        if (self.to_visit.nodes.y & 0xff00_0000) != 0 && self.depth < MAX_DEPTH {
            self.stack[self.depth as usize] = self.to_visit.nodes;
            self.depth += 1;
        }
        let slot = (bit - 24) ^ (octant & 0xff);
        base + (hits & !(0xffff_ffffu32 << slot) & 0xff).count_ones()
    }
}

#[inline(always)]
fn node_rows(bvh: &[UVec4], node: u32) -> [UVec4; 5] {
    let at = node * NODE_ROWS;
    [load(bvh, at), load(bvh, at + 1), load(bvh, at + 2), load(bvh, at + 3), load(bvh, at + 4)]
}

/// Tests of a node's children, many at once where the processor can; the results are the same everywhere.
pub trait Tests: Copy {
    /// What the ray meets of node number `node` for t in `0..=t_max`, as [`intersect_node`] has it.
    fn children(self, bvh: &[UVec4], node: u32, ray: &NodeRay, t_max: f32) -> Children;

    /// Those triangles of the set `marked`, counted from `first`, that are worth a test by
    /// [`ShearedRay::intersect`]: at least those that it meets for t in `0..=t_max`.
    fn triangles(self, triangles: &[f32], first: u32, marked: u32, ray: &ShearedRay, t_max: f32) -> u32;
}

/// One child after the other.
#[derive(Clone, Copy)]
pub struct PortableTests;

impl Tests for PortableTests {
    #[inline(always)]
    fn children(self, bvh: &[UVec4], node: u32, ray: &NodeRay, t_max: f32) -> Children {
        let rows = node_rows(bvh, node);
        Children::new(&rows, intersect_node(&rows, ray, t_max))
    }

    #[inline(always)]
    fn triangles(self, _triangles: &[f32], _first: u32, marked: u32, _ray: &ShearedRay, _t_max: f32) -> u32 {
        marked
    }
}

/// The nearest triangle that a ray meets before `ray.t_max`; see [`Tracer::closest_hit`].
#[inline(always)]
pub fn closest_hit<const MASKS: bool, const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
) -> Hit {
    #[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
    if simd::available() {
        // SAFETY: the processor has AVX2.
        return unsafe { simd::closest_hit::<MASKS, INSTANCES>(frame, scene, bvh, ray) };
    }
    closest_hit_with::<MASKS, INSTANCES, _>(frame, scene, bvh, ray, PortableTests)
}

/// Whether no triangle lies between the ends of the ray; see [`Tracer::unoccluded`].
#[inline(always)]
pub fn unoccluded<const MASKS: bool, const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
) -> bool {
    #[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
    if simd::available() {
        // SAFETY: the processor has AVX2.
        return unsafe { simd::unoccluded::<MASKS, INSTANCES>(frame, scene, bvh, ray) };
    }
    unoccluded_with::<MASKS, INSTANCES, _>(frame, scene, bvh, ray, PortableTests)
}

/// Nodes of this module.
impl Tracer for &[UVec4] {
    #[inline(always)]
    fn closest_hit<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> Hit {
        closest_hit::<MASKS, INSTANCES>(frame, scene, self, ray)
    }

    #[inline(always)]
    fn unoccluded<const MASKS: bool, const INSTANCES: bool>(self, frame: &Frame, scene: &Scene, ray: &Ray) -> bool {
        unoccluded::<MASKS, INSTANCES>(frame, scene, self, ray)
    }
}

/// [`closest_hit`] with given tests.
#[inline(always)]
pub fn closest_hit_with<const MASKS: bool, const INSTANCES: bool, T: Tests>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    tests: T,
) -> Hit {
    let mut hit = Hit::miss(ray.t_max);
    if !INSTANCES {
        closest_in_instance::<MASKS, T>(frame, scene, bvh, ray, 0, tests, &mut hit);
        return hit;
    }
    let node_ray = NodeRay::new(ray.origin, ray.direction);
    let mut walk = Walk::from_root();
    loop {
        while walk.has_primitive() {
            let instance = scene.record(frame.top_order_at + walk.next_primitive());
            let at = scene.instance_at(frame, instance) + instance_record::OBJECT_FROM_WORLD;
            let object_ray = Ray {
                origin: scene.transform_point(at, ray.origin),
                direction: scene.transform_vector(at, ray.direction),
                t_max: hit.t,
            };
            closest_in_instance::<MASKS, T>(frame, scene, bvh, &object_ray, instance, tests, &mut hit);
        }
        if !walk.has_node() {
            return hit;
        }
        let node = frame.top_root + walk.next_node(node_ray.octant);
        walk.to_visit = tests.children(bvh, node, &node_ray, hit.t);
    }
}

#[inline(always)]
fn closest_in_instance<const MASKS: bool, T: Tests>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    instance: u32,
    tests: T,
    hit: &mut Hit,
) {
    let record = scene.instance_at(frame, instance);
    let root = scene.record(record + instance_record::ROOT);
    let first_triangle = scene.record(record + instance_record::FIRST_TRIANGLE);
    let node_ray = NodeRay::new(ray.origin, ray.direction);
    let sheared = ShearedRay::new(ray.origin, ray.direction);
    let mut walk = Walk::from_root();
    loop {
        while walk.has_primitive() {
            let triangle = first_triangle + walk.next_primitive();
            let found = sheared.intersect(scene.triangles, triangle);
            let tie =
                found.t == hit.t && (instance < hit.instance || (instance == hit.instance && triangle < hit.triangle));
            if found.t > 0.0
                && (found.t < hit.t || (tie && !hit.is_miss()))
                && (!MASKS || is_opaque(frame, scene, instance, triangle, found.u, found.v))
            {
                *hit = Hit { t: found.t, u: found.u, v: found.v, triangle, instance };
            }
        }
        if !walk.has_node() {
            return;
        }
        let node = root + walk.next_node(node_ray.octant);
        walk.to_visit = tests.children(bvh, node, &node_ray, hit.t);
        let (first, marked) = (first_triangle + walk.to_visit.primitives.x, walk.to_visit.primitives.y);
        walk.to_visit.primitives.y = tests.triangles(scene.triangles, first, marked, &sheared, hit.t);
    }
}

/// [`unoccluded`] with given tests.
#[inline(always)]
pub fn unoccluded_with<const MASKS: bool, const INSTANCES: bool, T: Tests>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    tests: T,
) -> bool {
    if !INSTANCES {
        return unoccluded_in_instance::<MASKS, T>(frame, scene, bvh, ray, 0, tests);
    }
    let node_ray = NodeRay::new(ray.origin, ray.direction);
    let mut walk = Walk::from_root();
    loop {
        while walk.has_primitive() {
            let instance = scene.record(frame.top_order_at + walk.next_primitive());
            let at = scene.instance_at(frame, instance) + instance_record::OBJECT_FROM_WORLD;
            let object_ray = Ray {
                origin: scene.transform_point(at, ray.origin),
                direction: scene.transform_vector(at, ray.direction),
                t_max: ray.t_max,
            };
            if !unoccluded_in_instance::<MASKS, T>(frame, scene, bvh, &object_ray, instance, tests) {
                return false;
            }
        }
        if !walk.has_node() {
            return true;
        }
        let node = frame.top_root + walk.next_node(node_ray.octant);
        walk.to_visit = tests.children(bvh, node, &node_ray, ray.t_max);
    }
}

#[inline(always)]
fn unoccluded_in_instance<const MASKS: bool, T: Tests>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    instance: u32,
    tests: T,
) -> bool {
    let record = scene.instance_at(frame, instance);
    let root = scene.record(record + instance_record::ROOT);
    let first_triangle = scene.record(record + instance_record::FIRST_TRIANGLE);
    let node_ray = NodeRay::new(ray.origin, ray.direction);
    let sheared = ShearedRay::new(ray.origin, ray.direction);
    let mut walk = Walk::from_root();
    loop {
        while walk.has_primitive() {
            let triangle = first_triangle + walk.next_primitive();
            let found = sheared.intersect(scene.triangles, triangle);
            if found.t > 0.0
                && found.t < ray.t_max
                && (!MASKS || is_opaque(frame, scene, instance, triangle, found.u, found.v))
            {
                return false;
            }
        }
        if !walk.has_node() {
            return true;
        }
        let node = root + walk.next_node(node_ray.octant);
        walk.to_visit = tests.children(bvh, node, &node_ray, ray.t_max);
        let (first, marked) = (first_triangle + walk.to_visit.primitives.x, walk.to_visit.primitives.y);
        walk.to_visit.primitives.y = tests.triangles(scene.triangles, first, marked, &sheared, ray.t_max);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::pcg4d;

    fn random_rows(i: u32) -> [UVec4; 5] {
        let word = |j: u32| UVec4::from_array(pcg4d(i, j, 17, 3));
        // Lower planes in 0..128, upper ones in 128..256.
        let slab = |j: u32| {
            let w = word(j);
            let (low, high) = (0x7f7f_7f7f, 0x8080_8080);
            UVec4::new(w.x & low, w.y & low, w.z | high, w.w | high)
        };
        let unit = |bits: u32| (bits >> 8) as f32 / 16_777_216.0 * 8.0 - 4.0;
        let h = word(0);
        let exponents = (122 + (h.w & 3)) | ((122 + ((h.w >> 2) & 3)) << 8) | ((122 + ((h.w >> 4) & 3)) << 16);
        [
            UVec4::new(unit(h.x).to_bits(), unit(h.y).to_bits(), unit(h.z).to_bits(), exponents | (h.w & 0xff00_0000)),
            word(1),
            slab(2),
            slab(3),
            slab(4),
        ]
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn the_wide_node_test_equals_the_portable_one_bit_for_bit() {
        let Some(wide) = simd::WideTests::new() else {
            eprintln!("SKIPPED: this processor has no AVX2");
            return;
        };
        let mut hits = 0;
        for i in 0..200_000 {
            let rows = random_rows(i);
            let r = pcg4d(i, 1, 2, 3).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0);
            let s = pcg4d(i, 4, 5, 6).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0);
            let direction = match i % 5 {
                0 => Vec3::new(0.0, r[1], -0.0),
                1 => Vec3::new(-0.0, 0.0, r[0]),
                _ => Vec3::new(r[0], r[1], r[2]),
            };
            let ray = NodeRay::new(Vec3::new(s[0], s[1], s[2]) * 3.0, direction);
            let t_max = if i % 3 == 0 { 0.5 } else { 1e30 };
            hits += intersect_node(&rows, &ray, t_max).count_ones();
            let expected = PortableTests.children(&rows, 0, &ray, t_max);
            assert_eq!(wide.children(&rows, 0, &ray, t_max), expected, "node {i}");
        }
        assert!(hits > 20_000, "the comparison must not be one of misses only: {hits}");
    }

    /// Small whole coordinates, so that rays often meet edges and vertices and distances are often equal.
    #[cfg(target_arch = "x86_64")]
    #[test]
    fn the_wide_triangle_test_keeps_every_hit_and_nothing_that_the_ray_misses() {
        let Some(wide) = simd::WideTests::new() else {
            eprintln!("SKIPPED: this processor has no AVX2");
            return;
        };
        let (mut hits, mut misses) = (0, 0);
        for i in 0..20_000 {
            let whole = |j: u32| pcg4d(i, j, 8, 9).map(|b| (b >> 16) as f32 % 5.0 - 2.0);
            let mut triangles = [0.0; 9 * 30];
            for (j, four) in (0..).zip(triangles.chunks_mut(4)) {
                four.copy_from_slice(&whole(j)[..four.len()]);
            }
            let (o, d) = (whole(100), whole(101));
            let direction = match i % 6 {
                0 => Vec3::new(0.0, -0.0, if d[2] < 0.0 { -1.0 } else { 1.0 }),
                1 => Vec3::new(if d[0] < 0.0 { -1.0 } else { 1.0 }, 0.0, 0.0),
                _ => Vec3::new(d[0], d[1] + 0.5, d[2]),
            };
            // Every other ray starts on a vertex.
            let origin = if i % 2 == 0 { Vec3::new(o[0], o[1], o[2]) } else { Vec3::from_slice(&triangles[36..]) };
            let ray = ShearedRay::new(origin, direction);
            // At the end of the buffer the last ones have no window of eight.
            let first = i % 7;
            let marked = pcg4d(i, 1, 2, 3)[0] & 0x00ff_ffff;
            let t_max = if i % 3 == 0 { 1.0 } else { 1e30 };
            let kept = wide.triangles(&triangles, first, marked, &ray, t_max);
            assert_eq!(kept & !marked, 0, "case {i}");
            if marked.count_ones() <= 2 {
                continue;
            }
            for bit in (0..24).filter(|bit| marked >> bit & 1 == 1) {
                let found = ray.intersect(&triangles, first + bit);
                let hit = found.t > 0.0 && found.t <= t_max;
                let has_window = first + bit + 8 <= 30;
                if hit || has_window {
                    assert_eq!(kept >> bit & 1 == 1, hit, "case {i}, triangle {bit}: t = {}", found.t);
                }
                hits += u32::from(hit);
                misses += u32::from(has_window && !hit);
            }
        }
        assert!(hits > 10_000 && misses > 50_000, "{hits} hits and {misses} misses are too few to compare");
    }
}
