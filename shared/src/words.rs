//! Small arrays that live in registers.

/// Eight words, told apart by selection: graphics drivers unroll loops over a local array into thousands of
/// instructions.
#[derive(Clone, Copy)]
pub(crate) struct Words {
    words: [u32; 8],
}

impl Words {
    /// All zero.
    pub(crate) const ZERO: Self = Self { words: [0; 8] };

    #[inline(always)]
    pub(crate) fn get(&self, i: u32) -> u32 {
        let [a, b, c, d, e, f, g, h] = self.words;
        let [a, b, c, d] = if i < 4 { [a, b, c, d] } else { [e, f, g, h] };
        let [a, b] = if i & 2 == 0 { [a, b] } else { [c, d] };
        if i & 1 == 0 { a } else { b }
    }

    #[inline(always)]
    pub(crate) fn set(&mut self, i: u32, word: u32) {
        let pick = |old: u32, place: u32| if i == place { word } else { old };
        let [a, b, c, d, e, f, g, h] = self.words;
        self.words = [pick(a, 0), pick(b, 1), pick(c, 2), pick(d, 3), pick(e, 4), pick(f, 5), pick(g, 6), pick(h, 7)];
    }
}
