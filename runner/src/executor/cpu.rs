//! The plan on the host: rayon over bands of rows.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use rayon::prelude::*;
use weir_shader::wiring::{Access, Band, Buffers};
use weir_shared::frame::FramePair;

use super::{AlignedBytes, SceneBuffers, View};
use crate::graph::{Plan, Planned, Slot};

/// Order in which the pixels of a pass are computed. The picture is the same; a test says so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// Rows of a band, the unit of work of a thread.
    pub band_rows: u32,
    /// From the last pixel of a band to the first.
    pub backwards: bool,
}

impl Default for Order {
    fn default() -> Self {
        Self { band_rows: 8, backwards: false }
    }
}

/// Which half of a history is which: halves swap every frame.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Place {
    Pool(usize),
    Half(usize, usize),
    Zero,
}

/// Buffers of the frames of one plan, and the state between frames.
pub struct CpuExecutor {
    buffers: BTreeMap<Place, AlignedBytes>,
    frames: usize,
    view: View,
    /// Order of the pixels.
    pub order: Order,
}

impl CpuExecutor {
    /// Memory for a plan, all zeros.
    pub fn new(plan: &Plan) -> Self {
        let mut buffers = BTreeMap::new();
        for (i, &bytes) in plan.pool.iter().enumerate() {
            buffers.insert(Place::Pool(i), AlignedBytes::zeroed(bytes as usize));
        }
        for (i, history) in plan.history.iter().enumerate() {
            for half in 0..2 {
                buffers.insert(Place::Half(i, half), AlignedBytes::zeroed(history.bytes as usize));
            }
        }
        buffers.insert(Place::Zero, AlignedBytes::zeroed(plan.zero_bytes as usize));
        Self { buffers, frames: 0, view: View::default(), order: Order::default() }
    }

    /// Where a slot is in frame number `frame` of this executor.
    fn place(slot: Slot, frame: usize) -> Option<Place> {
        match slot {
            Slot::Scene(_) => None,
            Slot::Pool(i) => Some(Place::Pool(i)),
            Slot::Current(i) => Some(Place::Half(i, frame & 1)),
            Slot::Previous(i) => Some(Place::Half(i, (frame & 1) ^ 1)),
            Slot::Zero => Some(Place::Zero),
        }
    }

    /// Runs one frame; returns the time of each step.
    pub fn run(&mut self, plan: &Plan, scene: SceneBuffers<'_>, frames: &FramePair) -> Vec<(&'static str, Duration)> {
        let is_view_kept = self.view.is_kept(&frames.now);
        let run = |step: &Planned| {
            let start = Instant::now();
            if !(is_view_kept && step.is_kept) {
                self.run_step(plan, step, scene, frames);
            }
            (step.pass.name, start.elapsed())
        };
        // All of it on a thread of the pool, which else would have to be woken for each step.
        let times = rayon::scope(|_| plan.steps.iter().map(run).collect());
        self.frames += 1;
        times
    }

    fn run_step(&mut self, plan: &Plan, step: &Planned, scene: SceneBuffers<'_>, frames: &FramePair) {
        // Outputs leave the map while the step runs, so that inputs can be borrowed from it.
        let mut outputs: Vec<(Place, AlignedBytes)> = step
            .slots
            .iter()
            .filter(|(access, _)| *access == Access::Write)
            .filter_map(|&(_, slot)| {
                let place = Self::place(slot, self.frames)?;
                Some((place, self.buffers.remove(&place)?))
            })
            .collect();
        for slot in plan.cleared(step) {
            let of_output = |(place, _): &&mut (Place, AlignedBytes)| Self::place(slot, self.frames) == Some(*place);
            if let Some((_, buffer)) = outputs.iter_mut().find(of_output) {
                buffer.bytes_mut().fill(0);
            }
        }
        let inputs: Vec<&[u8]> = step
            .slots
            .iter()
            .filter(|(access, _)| *access == Access::Read)
            .map(|&(_, slot)| match slot {
                Slot::Scene(name) => scene.bytes(name),
                other => Self::place(other, self.frames)
                    .and_then(|place| self.buffers.get(&place))
                    .expect("the plan never reads what a step writes")
                    .bytes(),
            })
            .collect();
        let slices = outputs.iter_mut().map(|(_, buffer)| buffer.bytes_mut()).collect();
        run_kernel(step, frames, self.order, &inputs, slices);
        self.buffers.extend(outputs);
    }

    /// The bytes of an output after [`CpuExecutor::run`].
    pub fn output(&self, plan: &Plan, name: &str) -> Option<&[u8]> {
        let place = self.place_of(plan, name)?;
        // A buffer of the pool is as large as its largest tenant.
        Some(&self.buffers.get(&place)?.bytes()[..plan.output_bytes(name)?])
    }

    /// The same, to be altered; the next frame sees that if the output is a history.
    pub fn output_mut(&mut self, plan: &Plan, name: &str) -> Option<&mut [u8]> {
        let place = self.place_of(plan, name)?;
        Some(&mut self.buffers.get_mut(&place)?.bytes_mut()[..plan.output_bytes(name)?])
    }

    /// Fills with ones what the next frame is to write, so that whatever it leaves unwritten and reads all the same shows.
    /// For tests.
    pub fn poison(&mut self) {
        self.view = View::default();
        for (place, buffer) in &mut self.buffers {
            let is_written = match place {
                Place::Pool(_) => true,
                Place::Half(_, half) => *half == self.frames & 1,
                Place::Zero => false,
            };
            if is_written {
                buffer.bytes_mut().fill(0xff);
            }
        }
    }

    /// Where an output of the last frame is.
    fn place_of(&self, plan: &Plan, name: &str) -> Option<Place> {
        let &(_, slot) = plan.outputs.iter().find(|(n, _)| *n == name)?;
        Self::place(slot, self.frames.checked_sub(1)?)
    }
}

/// Runs one pass over all of its grid, with inputs and outputs in the order of its bindings.
pub fn run_kernel(step: &Planned, frames: &FramePair, order: Order, inputs: &[&[u8]], outputs: Vec<&mut [u8]>) {
    let frames = step.frames(frames);
    let frame = &frames.now;
    let rows = order.band_rows.max(1);
    let grid = step.pass.extent.grid(frame);
    // Each band gets its own rows of every output.
    let bands = grid.rows.div_ceil(rows) as usize;
    let mut parts: Vec<Vec<&mut [u8]>> = (0..bands).map(|_| Vec::new()).collect();
    for (output, (_, stride)) in outputs.into_iter().zip(step.writes()) {
        let row_bytes = stride * grid.depth as usize * grid.columns as usize;
        let used = row_bytes * grid.rows as usize;
        for (part, chunk) in parts.iter_mut().zip(output[..used].chunks_mut(row_bytes * rows as usize)) {
            part.push(chunk);
        }
    }
    // Work is spread unevenly over a picture, so threads take one band after the other.
    parts.into_par_iter().enumerate().with_max_len(1).for_each(|(i, mut writes)| {
        let first_row = i as u32 * rows;
        let band = Band { first_row, rows: rows.min(grid.rows - first_row), backwards: order.backwards };
        (step.variant.run)(&frames, band, Buffers::new(inputs, &mut writes));
    });
}
