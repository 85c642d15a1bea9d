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
    scene::{NO_TEXTURE, Scene, attribute_flags, instance_record, material_record},
    texture::alpha_at,
    triangle::ShearedRay,
};

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

/// The state of a walk through one tree: what is left to visit.
struct Walk {
    stack: [UVec2; MAX_DEPTH as usize],
    depth: u32,
    /// First child, and in the high byte the inner children still to visit, in the low byte the inner-child mask.
    nodes: UVec2,
    /// First primitive, and the primitives still to test.
    primitives: UVec2,
}

impl Walk {
    #[inline(always)]
    fn from_root() -> Self {
        Self {
            stack: [UVec2::ZERO; MAX_DEPTH as usize],
            depth: 0,
            nodes: UVec2::new(0, 0x8000_0000),
            primitives: UVec2::ZERO,
        }
    }

    /// Takes a primitive off the list, if there is one.
    #[inline(always)]
    fn next_primitive(&mut self) -> u32 {
        let bit = 31 - self.primitives.y.leading_zeros();
        self.primitives.y &= !(1 << bit);
        self.primitives.x + bit
    }

    /// Whether there are primitives to test.
    #[inline(always)]
    fn has_primitive(&self) -> bool {
        self.primitives.y != 0
    }

    /// Whether there is an inner node to visit, after popping the stack where needed.
    #[inline(always)]
    fn has_node(&mut self) -> bool {
        if (self.nodes.y & 0xff00_0000) == 0 {
            if self.depth == 0 {
                return false;
            }
            self.depth -= 1;
            self.nodes = self.stack[self.depth as usize];
        }
        true
    }

    /// Takes the next inner node off the list: its number, counted from the root.
    #[inline(always)]
    fn next_node(&mut self, octant: u32) -> u32 {
        let hits = self.nodes.y;
        let bit = 31 - hits.leading_zeros();
        let base = self.nodes.x;
        self.nodes.y &= !(1 << bit);
        if (self.nodes.y & 0xff00_0000) != 0 && self.depth < MAX_DEPTH {
            self.stack[self.depth as usize] = self.nodes;
            self.depth += 1;
        }
        let slot = (bit - 24) ^ (octant & 0xff);
        base + (hits & !(0xffff_ffffu32 << slot) & 0xff).count_ones()
    }

    /// Enters a node whose children were tested.
    #[inline(always)]
    fn enter(&mut self, rows: &[UVec4; 5], mask: u32) {
        self.nodes = UVec2::new(rows[1].x, (mask & 0xff00_0000) | (rows[0].w >> 24));
        self.primitives = UVec2::new(rows[1].y, mask & 0x00ff_ffff);
    }
}

#[inline(always)]
fn node_rows(bvh: &[UVec4], node: u32) -> [UVec4; 5] {
    let at = node * NODE_ROWS;
    [load(bvh, at), load(bvh, at + 1), load(bvh, at + 2), load(bvh, at + 3), load(bvh, at + 4)]
}

/// Tests a node's children; the host has a SIMD version with the same results.
pub trait NodeTest: Copy {
    /// As [`intersect_node`].
    fn test(self, rows: &[UVec4; 5], ray: &NodeRay, t_max: f32) -> u32;
}

/// [`intersect_node`] itself.
#[derive(Clone, Copy)]
pub struct PortableNodeTest;

impl NodeTest for PortableNodeTest {
    #[inline(always)]
    fn test(self, rows: &[UVec4; 5], ray: &NodeRay, t_max: f32) -> u32 {
        intersect_node(rows, ray, t_max)
    }
}

/// The nearest triangle that a ray meets before `ray.t_max`.
///
/// `TEXTURES`: alpha masks are honoured. `INSTANCES`: the scene has a top level; without it, instance 0 is all
/// there is, in world space.
#[inline(always)]
pub fn closest_hit<const TEXTURES: bool, const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
) -> Hit {
    #[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
    if simd::available() {
        // SAFETY: the processor has AVX2.
        return unsafe { simd::closest_hit::<TEXTURES, INSTANCES>(frame, scene, bvh, ray) };
    }
    closest_hit_with::<TEXTURES, INSTANCES, _>(frame, scene, bvh, ray, PortableNodeTest)
}

/// Whether no triangle lies between the ends of the ray. The constants are those of [`closest_hit`].
#[inline(always)]
pub fn unoccluded<const TEXTURES: bool, const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
) -> bool {
    #[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
    if simd::available() {
        // SAFETY: the processor has AVX2.
        return unsafe { simd::unoccluded::<TEXTURES, INSTANCES>(frame, scene, bvh, ray) };
    }
    unoccluded_with::<TEXTURES, INSTANCES, _>(frame, scene, bvh, ray, PortableNodeTest)
}

/// [`closest_hit`] with a given node test.
#[inline(always)]
pub fn closest_hit_with<const TEXTURES: bool, const INSTANCES: bool, N: NodeTest>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    node_test: N,
) -> Hit {
    let mut hit = Hit::miss(ray.t_max);
    if !INSTANCES {
        closest_in_instance::<TEXTURES, N>(frame, scene, bvh, ray, 0, node_test, &mut hit);
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
            closest_in_instance::<TEXTURES, N>(frame, scene, bvh, &object_ray, instance, node_test, &mut hit);
        }
        if !walk.has_node() {
            return hit;
        }
        let rows = node_rows(bvh, frame.top_root + walk.next_node(node_ray.octant));
        let mask = node_test.test(&rows, &node_ray, hit.t);
        walk.enter(&rows, mask);
    }
}

#[inline(always)]
fn closest_in_instance<const TEXTURES: bool, N: NodeTest>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    instance: u32,
    node_test: N,
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
                && (!TEXTURES || is_opaque(frame, scene, instance, triangle, found.u, found.v))
            {
                *hit = Hit { t: found.t, u: found.u, v: found.v, triangle, instance };
            }
        }
        if !walk.has_node() {
            return;
        }
        let rows = node_rows(bvh, root + walk.next_node(node_ray.octant));
        let mask = node_test.test(&rows, &node_ray, hit.t);
        walk.enter(&rows, mask);
    }
}

/// [`unoccluded`] with a given node test.
#[inline(always)]
pub fn unoccluded_with<const TEXTURES: bool, const INSTANCES: bool, N: NodeTest>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    node_test: N,
) -> bool {
    if !INSTANCES {
        return unoccluded_in_instance::<TEXTURES, N>(frame, scene, bvh, ray, 0, node_test);
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
            if !unoccluded_in_instance::<TEXTURES, N>(frame, scene, bvh, &object_ray, instance, node_test) {
                return false;
            }
        }
        if !walk.has_node() {
            return true;
        }
        let rows = node_rows(bvh, frame.top_root + walk.next_node(node_ray.octant));
        let mask = node_test.test(&rows, &node_ray, ray.t_max);
        walk.enter(&rows, mask);
    }
}

#[inline(always)]
fn unoccluded_in_instance<const TEXTURES: bool, N: NodeTest>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
    instance: u32,
    node_test: N,
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
                && (!TEXTURES || is_opaque(frame, scene, instance, triangle, found.u, found.v))
            {
                return false;
            }
        }
        if !walk.has_node() {
            return true;
        }
        let rows = node_rows(bvh, root + walk.next_node(node_ray.octant));
        let mask = node_test.test(&rows, &node_ray, ray.t_max);
        walk.enter(&rows, mask);
    }
}

/// Whether the alpha mask leaves a surface at barycentric weights (`u`, `v`).
#[inline(always)]
fn is_opaque(frame: &Frame, scene: &Scene, instance: u32, triangle: u32, u: f32, v: f32) -> bool {
    if (scene.instance_word(frame, instance, instance_record::FLAGS) & attribute_flags::UVS) == 0 {
        return true;
    }
    let material = scene.material_of(frame, instance, triangle);
    let mask = scene.material_word(material, material_record::ALPHA_TEXTURE);
    mask == NO_TEXTURE || alpha_at(frame, scene, mask, scene.uv_at(frame, instance, triangle, u, v)) >= 0.5
}

/// The node test eight children at a time, for processors with AVX2: the same operations in the same order on
/// every child, so the same results.
#[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
pub mod simd {
    use core::arch::x86_64::*;

    use glam::UVec4;

    use super::{NodeRay, NodeSlabs, NodeTest};
    use crate::{
        frame::Frame,
        ray::{Hit, Ray},
        scene::Scene,
    };

    /// Whether this processor has AVX2.
    #[inline(always)]
    pub fn available() -> bool {
        std::is_x86_feature_detected!("avx2")
    }

    /// The eight-wide test. Made only where [`available`] is true.
    #[derive(Clone, Copy)]
    pub struct WideNodeTest(());

    impl WideNodeTest {
        /// The test, if this processor can run it.
        pub fn new() -> Option<Self> {
            available().then_some(Self(()))
        }
    }

    impl NodeTest for WideNodeTest {
        #[inline(always)]
        fn test(self, rows: &[UVec4; 5], ray: &NodeRay, t_max: f32) -> u32 {
            // SAFETY: a `WideNodeTest` exists only on processors with AVX2.
            unsafe { intersect_node(rows, ray, t_max) }
        }
    }

    /// # Safety
    /// The processor must have AVX2.
    #[target_feature(enable = "avx2")]
    pub unsafe fn closest_hit<const TEXTURES: bool, const INSTANCES: bool>(
        frame: &Frame,
        scene: &Scene,
        bvh: &[UVec4],
        ray: &Ray,
    ) -> Hit {
        super::closest_hit_with::<TEXTURES, INSTANCES, _>(frame, scene, bvh, ray, WideNodeTest(()))
    }

    /// # Safety
    /// The processor must have AVX2.
    #[target_feature(enable = "avx2")]
    pub unsafe fn unoccluded<const TEXTURES: bool, const INSTANCES: bool>(
        frame: &Frame,
        scene: &Scene,
        bvh: &[UVec4],
        ray: &Ray,
    ) -> bool {
        super::unoccluded_with::<TEXTURES, INSTANCES, _>(frame, scene, bvh, ray, WideNodeTest(()))
    }

    /// Eight bytes to eight floats.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn planes(low: u32, high: u32) -> __m256 {
        let bytes = _mm_cvtsi64_si128((u64::from(low) | (u64::from(high) << 32)) as i64);
        _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes))
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn intersect_node(rows: &[UVec4; 5], ray: &NodeRay, t_max: f32) -> u32 {
        let slabs = NodeSlabs::new(rows[0], ray);
        let line = |q: __m256, scale: f32, shift: f32| {
            _mm256_add_ps(_mm256_mul_ps(q, _mm256_set1_ps(scale)), _mm256_set1_ps(shift))
        };
        let axis = |row: UVec4, inverse: f32, scale: f32, near: f32, far: f32| {
            let (first, second) = (planes(row.x, row.y), planes(row.z, row.w));
            let (q_near, q_far) = if inverse < 0.0 { (second, first) } else { (first, second) };
            (line(q_near, scale, near), line(q_far, scale, far))
        };
        let (near_x, far_x) = axis(rows[2], ray.inverse.x, slabs.scale.x, slabs.near.x, slabs.far.x);
        let (near_y, far_y) = axis(rows[3], ray.inverse.y, slabs.scale.y, slabs.near.y, slabs.far.y);
        let (near_z, far_z) = axis(rows[4], ray.inverse.z, slabs.scale.z, slabs.near.z, slabs.far.z);
        // The instructions return their second operand on a tie or a NaN, as `numerics::{min, max}` do.
        let near = _mm256_max_ps(_mm256_max_ps(near_x, near_y), _mm256_max_ps(near_z, _mm256_setzero_ps()));
        let far = _mm256_min_ps(_mm256_min_ps(far_x, far_y), _mm256_min_ps(far_z, _mm256_set1_ps(t_max)));
        let meets = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));

        let meta =
            _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((u64::from(rows[1].z) | (u64::from(rows[1].w) << 32)) as i64));
        let inner_bit = _mm256_set1_epi32(0x10);
        let inner = _mm256_cmpeq_epi32(
            _mm256_and_si256(_mm256_and_si256(meta, _mm256_slli_epi32::<1>(meta)), inner_bit),
            inner_bit,
        );
        let octant = _mm256_and_si256(inner, _mm256_set1_epi32((ray.octant & 0xff) as i32));
        let index = _mm256_and_si256(_mm256_xor_si256(meta, octant), _mm256_set1_epi32(0x1f));
        let bits = _mm256_and_si256(_mm256_srli_epi32::<5>(meta), _mm256_set1_epi32(7));
        let marks = _mm256_and_si256(_mm256_sllv_epi32(bits, index), meets);
        // Different children mark different bits: a sum of lanes would do as well as a union.
        let half = _mm_or_si128(_mm256_castsi256_si128(marks), _mm256_extracti128_si256::<1>(marks));
        let quarter = _mm_or_si128(half, _mm_shuffle_epi32::<0b0100_1110>(half));
        let all = _mm_or_si128(quarter, _mm_shuffle_epi32::<0b1011_0001>(quarter));
        _mm_cvtsi128_si32(all) as u32
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
        let Some(wide) = simd::WideNodeTest::new() else {
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
            let expected = intersect_node(&rows, &ray, t_max);
            hits += expected.count_ones();
            assert_eq!(wide.test(&rows, &ray, t_max), expected, "node {i}");
        }
        assert!(hits > 20_000, "the comparison must not be one of misses only: {hits}");
    }
}
