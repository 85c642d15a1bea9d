//! A level of a walk with all eight children at a time, for processors with AVX2: the same operations in the same order
//! on every child, so the same results. No multiplication is fused with an addition.

use core::arch::x86_64::*;

use glam::Vec3;

use super::{Choice, NODE_WORDS, Nodes, ONE, Party, Reached, WIDTH, Walk, node_field};
use crate::{bvh::simd::available, frame::Frame, scene::Scene};

/// The eight-wide choice. Made only where [`available`] is true.
#[derive(Clone, Copy)]
pub struct WideNodes(());

impl WideNodes {
    /// The choice, if this processor can run it.
    pub fn new() -> Option<Self> {
        available().then_some(Self(()))
    }
}

impl Nodes for WideNodes {
    #[inline(always)]
    fn choose(
        self,
        words: &[u32],
        node: u32,
        position: Vec3,
        normal: Vec3,
        has_goal: bool,
        goal: u32,
        bits: u32,
    ) -> Choice {
        // SAFETY: a `WideNodes` exists only where `available` is true.
        unsafe { choose(words, node, position, normal, has_goal, goal, bits) }
    }

    #[inline(always)]
    fn fetch<T>(self, words: &[T], at: u32, count: u32) {
        const LINE_WORDS: u32 = 16;
        let first = words.as_ptr().wrapping_add(at as usize);
        for line in 0..=count / LINE_WORDS {
            // A prefetch does not fault, whatever the address.
            // SAFETY: every processor of this architecture has the instruction.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.wrapping_add((line * LINE_WORDS) as usize).cast()) };
        }
    }
}

/// # Safety
/// [`available`] must be true.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn finish(walk: Walk, frame: &Frame, scene: &Scene, lights: &[u32]) -> Reached {
    walk.finish_with(frame, scene, lights, WideNodes(()))
}

/// # Safety
/// [`available`] must be true.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn finish_party(party: &mut Party, frame: &Frame, scene: &Scene, lights: &[u32]) {
    party.finish_with(frame, scene, lights, WideNodes(()));
}

/// In each half, the sum in lane `FROM` (four times two bits) onto the lane that `TO` marks.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn add_lane<const FROM: i32, const TO: i32>(sums: __m256) -> __m256 {
    let moved = _mm256_permute_ps::<FROM>(sums);
    _mm256_add_ps(sums, _mm256_blend_ps::<TO>(_mm256_setzero_ps(), moved))
}

/// For each set of children, how many are in it of each child and all before it.
static RUNNING_COUNTS: [[u32; WIDTH as usize]; 256] = {
    let mut counts = [[0; WIDTH as usize]; 256];
    let mut set = 0;
    while set < 256 {
        let mut child = 0;
        while child < WIDTH {
            counts[set][child as usize] = (set as u32 & ((2 << child) - 1)).count_ones();
            child += 1;
        }
        set += 1;
    }
    counts
};

/// As the portable choice, see [`super::PortableNodes`].
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn choose(words: &[u32], node: u32, position: Vec3, normal: Vec3, has_goal: bool, goal: u32, bits: u32) -> Choice {
    let children: &[u32; NODE_WORDS as usize] =
        words[node as usize..].first_chunk().expect("a node of the tree has all its words");
    let field = |field: u32| {
        let lanes: &[u32; WIDTH as usize] =
            children[(field * WIDTH) as usize..].first_chunk().expect("a field has a word for every child");
        // SAFETY: eight words, no alignment asked for.
        unsafe { _mm256_loadu_ps(lanes.as_ptr().cast()) }
    };
    let all = |x: f32| _mm256_set1_ps(x);
    let zero = _mm256_setzero_ps();
    let clamped = |x: __m256| _mm256_min_ps(_mm256_max_ps(x, zero), all(1.0));
    let toward_x = _mm256_sub_ps(field(node_field::CENTER), all(position.x));
    let toward_y = _mm256_sub_ps(field(node_field::CENTER + 1), all(position.y));
    let toward_z = _mm256_sub_ps(field(node_field::CENTER + 2), all(position.z));
    let dot = |x: __m256, y: __m256, z: __m256| {
        let xy = _mm256_add_ps(_mm256_mul_ps(toward_x, x), _mm256_mul_ps(toward_y, y));
        _mm256_add_ps(xy, _mm256_mul_ps(toward_z, z))
    };
    let radius = field(node_field::RADIUS);
    let distance2 = dot(toward_x, toward_y, toward_z);
    let near2 = _mm256_mul_ps(radius, radius);
    let safe2 = _mm256_max_ps(distance2, all(1e-30));
    let inverse = _mm256_div_ps(all(1.0), _mm256_sqrt_ps(safe2));
    let above = dot(all(normal.x), all(normal.y), all(normal.z));
    let behind = dot(field(node_field::AXIS), field(node_field::AXIS + 1), field(node_field::AXIS + 2));
    let receiving = _mm256_mul_ps(_mm256_add_ps(above, radius), inverse);
    let facing = _mm256_mul_ps(_mm256_sub_ps(radius, behind), inverse);
    let emitting = _mm256_add_ps(facing, field(node_field::SIN_SPREAD));
    let within = clamped(_mm256_mul_ps(_mm256_sub_ps(near2, distance2), all(1e30)));
    let cosines = _mm256_mul_ps(clamped(receiving), clamped(emitting));
    let (power, cosines) = (field(node_field::POWER), _mm256_max_ps(cosines, within));
    let value = _mm256_div_ps(_mm256_mul_ps(power, cosines), _mm256_max_ps(safe2, near2));
    let has_power = _mm256_min_ps(_mm256_mul_ps(power, all(1e35)), all(1.0));
    let matters = _mm256_mul_ps(has_power, _mm256_min_ps(_mm256_mul_ps(cosines, all(1e20)), all(1.0)));
    let value = _mm256_mul_ps(_mm256_min_ps(_mm256_max_ps(value, all(1e-30)), all(1e30)), matters);
    let positive = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(value, zero)) as u8;

    // Sums within each half, lane after lane; then the first half before the second.
    let sums = add_lane::<0b00_00_00_00, 0b0010_0010>(value);
    let sums = add_lane::<0b01_01_01_01, 0b0100_0100>(sums);
    let sums = add_lane::<0b10_10_10_10, 0b1000_1000>(sums);
    let last = _mm256_permute_ps::<0b11_11_11_11>(sums);
    let before = _mm256_permute2f128_ps::<0b0000_1000>(last, last);
    let sums = _mm256_add_ps(sums, before);
    let highest = _mm256_permute_ps::<0b11_11_11_11>(sums);
    let total = _mm256_max_ps(_mm256_permute2f128_ps::<0b0001_0001>(highest, highest), all(1e-30));

    // One part for each positive child, the others in proportion.
    let rest = (ONE - positive.count_ones()) as f32;
    let shares = _mm256_mul_ps(_mm256_div_ps(sums, total), all(rest));
    let parts = _mm256_castps_si256(_mm256_add_ps(shares, all(ONE as f32)));
    let parts = _mm256_sub_epi32(parts, _mm256_set1_epi32((ONE as f32).to_bits() as i32));
    // SAFETY: eight words, no alignment asked for.
    let counts = unsafe { _mm256_loadu_si256(RUNNING_COUNTS[positive as usize].as_ptr().cast()) };
    let bounds = _mm256_add_epi32(parts, counts);
    let child = if has_goal {
        goal
    } else {
        // The bounds ascend: the first beyond the number.
        let beyond = _mm256_cmpgt_epi32(bounds, _mm256_set1_epi32(bits as i32));
        _mm256_movemask_ps(_mm256_castsi256_ps(beyond)).trailing_zeros()
    };
    if child >= WIDTH {
        return Choice { child: 0, part: 0 };
    }
    let lower = _mm256_permutevar8x32_epi32(bounds, _mm256_set1_epi32((child as i32 - 1) & 7));
    let upper = _mm256_permutevar8x32_epi32(bounds, _mm256_set1_epi32(child as i32));
    let lower = if child > 0 { _mm256_cvtsi256_si32(lower) } else { 0 };
    Choice { child, part: (_mm256_cvtsi256_si32(upper) - lower) as u32 }
}
