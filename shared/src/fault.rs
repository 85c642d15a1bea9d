//! Faults: why and where a weight was dropped. Every reservoir and every pixel keeps the first one on its way, so that they
//! can be counted, on both processors, without anything that passes share.

use crate::numerics::is_finite;

/// No fault.
pub const NONE: u32 = 0;
/// Below zero.
pub const NEGATIVE: u32 = 1;
/// Finite, but with it a sum or quotient would not have been.
pub const OVERFLOW: u32 = 2;
/// Infinite.
pub const INFINITE: u32 = 3;
/// Not a number.
pub const NOT_A_NUMBER: u32 = 4;

/// Names of the kinds from [`NEGATIVE`] on.
#[cfg(not(target_arch = "spirv"))]
pub const KINDS: [&str; 4] = ["negative", "overflow", "infinite", "not a number"];

/// Where weights are dropped.
pub mod stage {
    /// In resampling candidates.
    pub const CANDIDATES: u32 = 0;
    /// In merging the frame before.
    pub const TEMPORAL: u32 = 1;
    /// In merging neighbours.
    pub const SPATIAL: u32 = 2;
    /// In shading.
    pub const SHADE: u32 = 3;
    /// Names of the stages, which are those of their passes.
    #[cfg(not(target_arch = "spirv"))]
    pub const NAMES: [&str; 4] = ["candidates", "temporal", "spatial", "shade"];
}

/// A fault of a kind at a stage, as one number; [`NONE`] stays that.
#[inline(always)]
pub fn at(stage: u32, kind: u32) -> u32 {
    if kind == NONE { NONE } else { stage * 4 + kind }
}

/// Names of the stage and of the kind of a fault other than [`NONE`].
#[cfg(not(target_arch = "spirv"))]
pub fn names_of(fault: u32) -> [&'static str; 2] {
    let index = (fault.wrapping_sub(1) & 15) as usize;
    [stage::NAMES[index / 4], KINDS[index % 4]]
}

/// What is wrong with a weight, and with the sum that it would have led to. Looks at the bits, because shader compilers
/// may assume that such numbers never occur.
#[inline(always)]
pub fn of_weight(weight: f32, sum: f32) -> u32 {
    let magnitude = weight.to_bits() & 0x7fff_ffff;
    if magnitude > 0x7f80_0000 {
        NOT_A_NUMBER
    } else if magnitude == 0 {
        NONE
    } else if weight.to_bits() != magnitude {
        NEGATIVE
    } else if magnitude == 0x7f80_0000 {
        INFINITE
    } else if is_finite(sum) {
        NONE
    } else {
        OVERFLOW
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_a_name_of_its_own() {
        assert_eq!(at(stage::TEMPORAL, NONE), NONE);
        for (stage, stage_name) in (0..).zip(stage::NAMES) {
            for (kind, kind_name) in (1..).zip(KINDS) {
                assert_eq!(names_of(at(stage, kind)), [stage_name, kind_name]);
            }
        }
    }

    #[test]
    fn each_kind_is_told_from_the_others() {
        let cases = [
            (0.0, 1.0, NONE),
            (-0.0, 1.0, NONE),
            (1e-45, 1.0, NONE),
            (3e38, 3e38, NONE),
            (-1e-45, 0.0, NEGATIVE),
            (f32::NEG_INFINITY, 0.0, NEGATIVE),
            (3e38, f32::INFINITY, OVERFLOW),
            (f32::INFINITY, f32::INFINITY, INFINITE),
            (f32::NAN, f32::NAN, NOT_A_NUMBER),
            (-f32::NAN, 0.0, NOT_A_NUMBER),
        ];
        for (weight, sum, expected) in cases {
            assert_eq!(of_weight(weight, sum), expected, "{weight} in {sum}");
        }
    }
}
