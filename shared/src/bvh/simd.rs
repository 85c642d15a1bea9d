//! The tests of a node's children eight at a time, for processors with AVX2: the same operations in the same order
//! on every child, so the same results. No multiplication is fused with an addition.

use core::{
    arch::x86_64::*,
    sync::atomic::{AtomicU8, Ordering},
};

use glam::{UVec4, Vec3};

use super::{Children, NODE_ROWS, NodeRay, Tests};
use crate::{
    frame::Frame,
    ray::{Hit, Ray},
    scene::Scene,
    triangle::ShearedRay,
};

/// Whether this processor has AVX2 and the bit counting that came with it.
#[inline(always)]
pub fn available() -> bool {
    // Asked for every ray: five look-ups each time would show.
    static ANSWER: AtomicU8 = AtomicU8::new(0);
    match ANSWER.load(Ordering::Relaxed) {
        0 => ask(&ANSWER),
        answer => answer == 1,
    }
}

#[cold]
fn ask(answer: &AtomicU8) -> bool {
    let yes = std::is_x86_feature_detected!("avx2")
        && std::is_x86_feature_detected!("bmi1")
        && std::is_x86_feature_detected!("bmi2")
        && std::is_x86_feature_detected!("lzcnt")
        && std::is_x86_feature_detected!("popcnt");
    answer.store(if yes { 1 } else { 2 }, Ordering::Relaxed);
    yes
}

/// The eight-wide test. Made only where [`available`] is true.
#[derive(Clone, Copy)]
pub struct WideTests {
    /// Whether the tree is the first in the buffer: only then do its nodes number their children from the start of
    /// the buffer, which is where they are fetched from ahead of the visit.
    fetch_children: bool,
}

impl WideTests {
    /// The test, if this processor can run it.
    pub fn new() -> Option<Self> {
        available().then_some(Self { fetch_children: true })
    }
}

impl Tests for WideTests {
    #[inline(always)]
    fn children(self, bvh: &[UVec4], node: u32, ray: &NodeRay, t_max: f32) -> Children {
        // SAFETY: a `WideTests` exists only where `available` is true.
        unsafe { intersect_node(bvh, node, ray, t_max, self.fetch_children) }
    }

    #[inline(always)]
    fn triangles(self, triangles: &[f32], first: u32, marked: u32, ray: &ShearedRay, t_max: f32) -> u32 {
        // Two are tested sooner than eight are loaded.
        if marked.count_ones() <= 2 {
            return marked;
        }
        // SAFETY: a `WideTests` exists only where `available` is true.
        unsafe { intersect_triangles(triangles, first, marked, ray, t_max) }
    }
}

/// # Safety
/// [`available`] must be true.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn closest_hit<const MASKS: bool, const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
) -> Hit {
    super::closest_hit_with::<MASKS, INSTANCES, _>(frame, scene, bvh, ray, WideTests { fetch_children: !INSTANCES })
}

/// # Safety
/// [`available`] must be true.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn unoccluded<const MASKS: bool, const INSTANCES: bool>(
    frame: &Frame,
    scene: &Scene,
    bvh: &[UVec4],
    ray: &Ray,
) -> bool {
    super::unoccluded_with::<MASKS, INSTANCES, _>(frame, scene, bvh, ray, WideTests { fetch_children: !INSTANCES })
}

/// Eight bytes to eight floats.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn planes(bytes: u64) -> __m256 {
    _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(bytes as i64)))
}

/// [`super::NodeSlabs`] as x, y, z and a lane without meaning, twice over.
struct WideSlabs {
    scale: __m256,
    near: __m256,
    far: __m256,
}

/// As `NodeSlabs::new`, the three axes at a time.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn slabs(rows: &[UVec4; 5], ray: &NodeRay) -> WideSlabs {
    let twice = |v: Vec3| _mm256_setr_ps(v.x, v.y, v.z, 1.0, v.x, v.y, v.z, 1.0);
    let (origin, inverse) = (twice(ray.origin), twice(ray.inverse));
    let head: &[i32; 4] = bytemuck::cast_ref(&rows[0]);
    let head = _mm256_broadcastsi128_si256(_mm_setr_epi32(head[0], head[1], head[2], head[3]));
    // The three exponents, bytes 12 to 14, each to the highest byte of a lane.
    let byte = |e: i32| (e << 24) | 0x0080_8080;
    let spread = _mm256_setr_epi32(byte(12), byte(13), byte(14), byte(12), byte(12), byte(13), byte(14), byte(12));
    let extent = _mm256_castsi256_ps(_mm256_srli_epi32::<1>(_mm256_shuffle_epi8(head, spread)));
    let scale = _mm256_mul_ps(extent, inverse);
    let shift = _mm256_mul_ps(_mm256_sub_ps(_mm256_castsi256_ps(head), origin), inverse);
    let magnitude = |x: __m256| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x);
    let padding = _mm256_mul_ps(
        _mm256_add_ps(magnitude(shift), _mm256_mul_ps(magnitude(scale), _mm256_set1_ps(256.0))),
        _mm256_set1_ps(2.4e-7),
    );
    WideSlabs { scale, near: _mm256_sub_ps(shift, padding), far: _mm256_add_ps(shift, padding) }
}

/// One lane of each half to all lanes of that half: 0x00 the first, 0x55 the second, 0xaa the third.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn splat<const LANES: i32>(v: __m256) -> __m256 {
    _mm256_permute_ps::<LANES>(v)
}

#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn intersect_node(bvh: &[UVec4], node: u32, ray: &NodeRay, t_max: f32, fetch_children: bool) -> Children {
    let at = (node * NODE_ROWS) as usize;
    // Not copied: the planes are loaded from where they are.
    let rows: &[UVec4; 5] = bvh[at..].first_chunk().expect("a node of the tree has all its rows");
    let words: &[u64; 10] = bytemuck::cast_ref(rows);
    let slabs = slabs(rows, ray);
    let line = |q: __m256, scale: __m256, shift: __m256| _mm256_add_ps(_mm256_mul_ps(q, scale), shift);
    // Lower planes stand before upper ones: picked by address, so that there is nothing to predict.
    let axis = |row: usize, inverse: f32, scale: __m256, near: __m256, far: __m256| {
        let flip = usize::from(inverse < 0.0);
        (line(planes(words[row * 2 + flip]), scale, near), line(planes(words[row * 2 + 1 - flip]), scale, far))
    };
    let (near_x, far_x) =
        axis(2, ray.inverse.x, splat::<0x00>(slabs.scale), splat::<0x00>(slabs.near), splat::<0x00>(slabs.far));
    let (near_y, far_y) =
        axis(3, ray.inverse.y, splat::<0x55>(slabs.scale), splat::<0x55>(slabs.near), splat::<0x55>(slabs.far));
    let (near_z, far_z) =
        axis(4, ray.inverse.z, splat::<0xaa>(slabs.scale), splat::<0xaa>(slabs.near), splat::<0xaa>(slabs.far));
    if fetch_children {
        // The child to visit next is seldom far behind the first one, and triangles are tested before it is read.
        let first_child = bvh.as_ptr().wrapping_add(rows[1].x.wrapping_mul(NODE_ROWS) as usize);
        // A prefetch does not fault, whatever the address: leaves alone have no children.
        _mm_prefetch::<_MM_HINT_T0>(first_child.cast());
        _mm_prefetch::<_MM_HINT_T0>(first_child.wrapping_add(4).cast());
    }
    // The instructions return their second operand on a tie or a NaN, as `numerics::{min, max}` do.
    let near = _mm256_max_ps(_mm256_max_ps(near_x, near_y), _mm256_max_ps(near_z, _mm256_setzero_ps()));
    let far = _mm256_min_ps(_mm256_min_ps(far_x, far_y), _mm256_min_ps(far_z, _mm256_set1_ps(t_max)));
    let meets = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));

    let meta = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(words[3] as i64));
    let inner_bits = _mm256_set1_epi32(0x18);
    let inner = _mm256_cmpeq_epi32(_mm256_and_si256(meta, inner_bits), inner_bits);
    let octant = _mm256_and_si256(inner, _mm256_set1_epi32((ray.octant & 0xff) as i32));
    let index = _mm256_and_si256(_mm256_xor_si256(meta, octant), _mm256_set1_epi32(0x1f));
    let marks = _mm256_and_si256(_mm256_sllv_epi32(_mm256_srli_epi32::<5>(meta), index), meets);
    // Different children mark different bits: a sum of lanes would do as well as a union.
    let half = _mm_or_si128(_mm256_castsi256_si128(marks), _mm256_extracti128_si256::<1>(marks));
    let quarter = _mm_or_si128(half, _mm_shuffle_epi32::<0b0100_1110>(half));
    let all = _mm_or_si128(quarter, _mm_shuffle_epi32::<0b1011_0001>(quarter));
    Children::new(rows, _mm_cvtsi128_si32(all) as u32)
}

/// As [`Tests::triangles`], eight neighbours in the buffer at a time.
// Inlined, its preparation of the ray would move out of the walk, to rays that meet no triangles.
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn intersect_triangles(triangles: &[f32], first: u32, marked: u32, ray: &ShearedRay, t_max: f32) -> u32 {
    let mut left = marked;
    let mut met = 0;
    while left != 0 {
        let start = left.trailing_zeros();
        let at = (first + start) as usize * 9;
        let Some(window) = triangles.get(at..).and_then(|rest| rest.first_chunk()) else {
            // Fewer than eight to the end of the buffer: left to the test one by one.
            return (met & marked) | left;
        };
        met |= intersect_eight(window, ray, t_max) << start;
        left &= !(0xff << start);
    }
    met & marked
}

/// Four floats from `at` and the same four triangles later, permuted by `axes`; `at` is at most 32.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn pair(window: &[f32; 72], at: usize, axes: __m256i) -> __m256 {
    debug_assert!(at <= 32);
    // SAFETY: the last float is number 32 + 36 + 3, the last of the window.
    unsafe {
        let p = window.as_ptr().add(at);
        _mm256_permutevar_ps(_mm256_loadu2_m128(p.add(36), p), axes)
    }
}

/// The same vertex of eight triangles: its coordinates along the axes of the ray.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn vertices(window: &[f32; 72], at: usize, axes: __m256i) -> [__m256; 3] {
    let [a, b, c, d] = [0, 9, 18, 27].map(|triangle| pair(window, at + triangle, axes));
    let (ab_xy, cd_xy) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
    let (ab_z, cd_z) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
    [
        _mm256_shuffle_ps::<0b01_00_01_00>(ab_xy, cd_xy),
        _mm256_shuffle_ps::<0b11_10_11_10>(ab_xy, cd_xy),
        _mm256_shuffle_ps::<0b01_00_01_00>(ab_z, cd_z),
    ]
}

/// Which of the eight triangles in `window` the ray meets for t in `0..=t_max`: the operations of
/// [`ShearedRay::intersect`] in the same order.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn intersect_eight(window: &[f32; 72], ray: &ShearedRay, t_max: f32) -> u32 {
    let (x, y, z) = (ray.axis_x as i32, ray.axis_y as i32, ray.axis_z as i32);
    let axes = _mm256_setr_epi32(x, y, z, 0, x, y, z, 0);
    // The last vertex is loaded from one float before it, because no float follows the last triangle.
    let axes_last = _mm256_setr_epi32(x + 1, y + 1, z + 1, 0, x + 1, y + 1, z + 1, 0);
    let (origin_x, origin_y, origin_z) =
        (_mm256_set1_ps(ray.origin_x), _mm256_set1_ps(ray.origin_y), _mm256_set1_ps(ray.origin_z));
    let (shear_x, shear_y) = (_mm256_set1_ps(ray.shear_x), _mm256_set1_ps(ray.shear_y));
    let sheared = |[x, y, z]: [__m256; 3]| {
        let z = _mm256_sub_ps(z, origin_z);
        let x = _mm256_sub_ps(_mm256_sub_ps(x, origin_x), _mm256_mul_ps(shear_x, z));
        let y = _mm256_sub_ps(_mm256_sub_ps(y, origin_y), _mm256_mul_ps(shear_y, z));
        [x, y, z]
    };
    let [a_x, a_y, a_z] = sheared(vertices(window, 0, axes));
    let [b_x, b_y, b_z] = sheared(vertices(window, 3, axes));
    let [c_x, c_y, c_z] = sheared(vertices(window, 5, axes_last));
    let cross = |a, b, c, d| _mm256_sub_ps(_mm256_mul_ps(a, b), _mm256_mul_ps(c, d));
    let u = cross(c_x, b_y, c_y, b_x);
    let v = cross(a_x, c_y, a_y, c_x);
    let w = cross(b_x, a_y, b_y, a_x);
    let determinant = _mm256_add_ps(_mm256_add_ps(u, v), w);
    let zero = _mm256_setzero_ps();
    // Where one of the three is not a number, t is none either and no comparison with it holds.
    let lowest = _mm256_min_ps(_mm256_min_ps(u, v), w);
    let highest = _mm256_max_ps(_mm256_max_ps(u, v), w);
    let outside = _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(lowest, zero), _mm256_cmp_ps::<_CMP_GT_OQ>(highest, zero));
    if _mm256_movemask_ps(outside) == 0xff {
        return 0;
    }
    let inverse = _mm256_div_ps(_mm256_set1_ps(1.0), determinant);
    let sum = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(u, a_z), _mm256_mul_ps(v, b_z)), _mm256_mul_ps(w, c_z));
    let t = _mm256_mul_ps(_mm256_mul_ps(sum, _mm256_set1_ps(ray.shear_z)), inverse);
    let within =
        _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(t, zero), _mm256_cmp_ps::<_CMP_LE_OQ>(t, _mm256_set1_ps(t_max)));
    _mm256_movemask_ps(_mm256_andnot_ps(outside, within)) as u32
}
