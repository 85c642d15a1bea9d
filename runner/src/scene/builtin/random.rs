//! The random numbers of the generators: the same on every platform and in every release.

/// PCG-XSH-RR 64/32.
///
/// Source: O'Neill 2014, "PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms".
pub(super) struct Pcg {
    state: u64,
}

impl Pcg {
    /// A stream of its own for each `seed`.
    pub(super) fn new(seed: u64) -> Self {
        let mut pcg = Self { state: seed.wrapping_add(0x9e37_79b9_7f4a_7c15) };
        pcg.next_u32();
        pcg
    }

    /// 32 uniform bits.
    pub(super) fn next_u32(&mut self) -> u32 {
        let state = self.state;
        self.state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let folded = (((state >> 18) ^ state) >> 27) as u32;
        folded.rotate_right((state >> 59) as u32)
    }

    /// Uniform in 0..1.
    pub(super) fn unit(&mut self) -> f32 {
        (self.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in `low..high`.
    pub(super) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// True with this chance.
    pub(super) fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    /// One of `choices`, which must not be empty.
    pub(super) fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        let index = (u64::from(self.next_u32()) * choices.len() as u64) >> 32;
        choices[index as usize]
    }
}
