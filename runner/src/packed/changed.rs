//! Parts of a scene's buffers that differ from one moment to the next.

use std::ops::Range;

use glam::UVec4;

/// A part of a scene buffer that has changed, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changed {
    /// The buffer.
    pub buffer: &'static str,
    /// Bytes.
    pub range: Range<usize>,
}

impl Changed {
    /// Words of `buffer`.
    pub(super) fn words(buffer: &'static str, words: Range<usize>) -> Self {
        Self { buffer, range: 4 * words.start..4 * words.end }
    }

    /// Rows of the acceleration structure.
    pub(super) fn rows(rows: Range<usize>) -> Self {
        Self { buffer: "bvh", range: 16 * rows.start..16 * rows.end }
    }
}

/// What a moment may overwrite, as it was.
#[derive(Default)]
pub(super) struct Before {
    records: Vec<u32>,
    lights: Vec<u32>,
    nodes: Vec<UVec4>,
}

impl Before {
    /// The same memory with a copy of these.
    pub(super) fn of(mut self, records: &[u32], lights: &[u32], nodes: &[UVec4]) -> Self {
        self.records.clear();
        self.records.extend_from_slice(records);
        self.lights.clear();
        self.lights.extend_from_slice(lights);
        self.nodes.clear();
        self.nodes.extend_from_slice(nodes);
        self
    }

    /// What differs now; `first_row` is where these nodes start. Of each buffer it is one part, from the first difference to
    /// the last.
    pub(super) fn changed(&self, records: &[u32], lights: &[u32], nodes: &[UVec4], first_row: usize) -> Vec<Changed> {
        let rows = |rows: Range<usize>| Changed::rows(first_row + rows.start..first_row + rows.end);
        let changed = [
            differing(&self.records, records).map(|words| Changed::words("records", words)),
            differing(&self.nodes, nodes).map(rows),
            differing(&self.lights, lights).map(|words| Changed::words("lights", words)),
        ];
        changed.into_iter().flatten().collect()
    }
}

/// From the first element that differs to the last; `now` may be longer.
fn differing<T: PartialEq>(before: &[T], now: &[T]) -> Option<Range<usize>> {
    let differs = |(a, b): (&T, &T)| a != b;
    let first = before.iter().zip(now).position(differs)?;
    let last = before.iter().zip(&now[..before.len()]).rposition(differs)?;
    Some(first..last + 1)
}
