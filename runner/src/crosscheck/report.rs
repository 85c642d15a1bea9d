//! What the cross-check found.

use std::fmt;

use weir_shader::wiring::Grid;

use crate::{
    executor::gpu::{Gpu, GpuExecutor, Loader, Module, Traced},
    graph::Plan,
};

/// What the cross-check found.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Name of the adapter.
    pub adapter: String,
    /// Module that the GPU ran.
    pub module: Module,
    /// How it got there.
    pub loader: Loader,
    /// How rays find what they meet on the GPU; the host traces them in software.
    pub traced: Traced,
    /// Frames that were compared.
    pub frames: u32,
    /// One for each output of each pass, in the order of the frame.
    pub rows: Vec<Row>,
}

/// One output of one pass, over all frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The pass.
    pub pass: &'static str,
    /// Its output.
    pub buffer: &'static str,
    /// Words that were compared.
    pub words: u64,
    /// Words that are not the same, bit by bit.
    pub differing_words: u64,
    /// Pixels that were compared.
    pub pixels: u64,
    /// Pixels with such a word.
    pub differing_pixels: u64,
    /// Pixels with floats that differ by more than rounding explains: a thousandth, and a millionth in absolute terms.
    pub far_pixels: u64,
    /// Largest difference of two floats; infinite if one of them is not finite.
    pub largest_absolute: f32,
    /// The same, as a part of the larger of the two.
    pub largest_relative: f32,
    /// Where it begins.
    pub first: Option<Difference>,
}

/// Two words that should be the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Number of the frame.
    pub frame: u32,
    /// Column and row of the pixel, of the record of a light, or of another element of what a pass runs over.
    pub pixel: [u32; 2],
    /// Which word of the pixel's element.
    pub word: usize,
    /// Whether it is a float.
    pub float: bool,
    /// The GPU's.
    pub gpu: u32,
    /// The host's.
    pub host: u32,
}

impl Report {
    pub(super) fn new(gpu: &Gpu, module: Module, executor: &GpuExecutor, plan: &Plan) -> Self {
        let row = |pass, buffer| Row {
            pass,
            buffer,
            words: 0,
            differing_words: 0,
            pixels: 0,
            differing_pixels: 0,
            far_pixels: 0,
            largest_absolute: 0.0,
            largest_relative: 0.0,
            first: None,
        };
        let rows = plan.steps.iter().flat_map(|step| step.writes().map(move |(name, _)| row(step.pass.name, name)));
        Self {
            adapter: gpu.facts.name.clone(),
            module,
            loader: executor.loader(),
            traced: executor.traced().clone(),
            frames: 0,
            rows: rows.collect(),
        }
    }

    /// Whether no word differs.
    pub fn is_equal(&self) -> bool {
        self.rows.iter().all(|row| row.differing_words == 0)
    }

    /// Whether no output has more than one pixel in a hundred with floats that differ by more than rounding explains: what
    /// the plain module owes, and the strict one on hardware whose division is not exact.
    pub fn is_close(&self) -> bool {
        self.rows.iter().all(|row| row.far_pixels * 100 <= row.pixels)
    }

    /// Adds an output of a frame; bit i of `floats` says that word i of an element is a float.
    pub(super) fn compare(
        &mut self,
        pass: &'static str,
        (buffer, stride): (&'static str, usize),
        floats: u32,
        (frame, grid): (u32, Grid),
        gpu: &[u32],
        host: &[u32],
    ) {
        let Some(row) = self.rows.iter_mut().find(|row| row.pass == pass && row.buffer == buffer) else {
            return;
        };
        let words = stride / 4;
        row.words += host.len() as u64;
        row.pixels += (host.len() / words) as u64;
        for (i, (on_gpu, on_host)) in gpu.chunks_exact(words).zip(host.chunks_exact(words)).enumerate() {
            if on_gpu == on_host {
                continue;
            }
            row.differing_pixels += 1;
            let mut far = false;
            for (word, (&gpu, &host)) in on_gpu.iter().zip(on_host).enumerate().filter(|(_, (g, h))| g != h) {
                row.differing_words += 1;
                let float = floats >> word & 1 == 1;
                let pixel = [i as u32 % grid.columns, i as u32 / grid.columns / grid.depth];
                row.first.get_or_insert(Difference { frame, pixel, word, float, gpu, host });
                if float {
                    let (absolute, relative) = distance(f32::from_bits(gpu), f32::from_bits(host));
                    row.largest_absolute = row.largest_absolute.max(absolute);
                    row.largest_relative = row.largest_relative.max(relative);
                    far |= absolute > 1e-6 && relative > 1e-3;
                }
            }
            row.far_pixels += u64::from(far);
        }
    }
}

/// Absolute and relative difference.
fn distance(a: f32, b: f32) -> (f32, f32) {
    let absolute = (a - b).abs();
    match (a.is_finite() && b.is_finite(), absolute == 0.0) {
        (false, _) => (f32::INFINITY, f32::INFINITY),
        (true, true) => (0.0, 0.0),
        (true, false) => (absolute, absolute / a.abs().max(b.abs())),
    }
}

impl fmt::Display for Report {
    /// A line for each output, then for each that differs where it begins.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let module = format!("{:?}", self.module).to_lowercase();
        let loader = format!("{:?}", self.loader).to_lowercase();
        writeln!(f, "{}: {module} module by {loader}, {} frames", self.adapter, self.frames)?;
        writeln!(f, "rays: {}", self.traced)?;
        writeln!(
            f,
            "{:<18} {:<12} {:>12} {:>12} {:>12} {:>12} {:>12} {:>10} {:>10}",
            "pass", "buffer", "words", "differing", "pixels", "differing", "far", "absolute", "relative"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<18} {:<12} {:>12} {:>12} {:>12} {:>12} {:>12} {:>10.2e} {:>10.2e}",
                row.pass,
                row.buffer,
                row.words,
                row.differing_words,
                row.pixels,
                row.differing_pixels,
                row.far_pixels,
                row.largest_absolute,
                row.largest_relative
            )?;
        }
        for row in &self.rows {
            if let Some(first) = row.first {
                writeln!(f, "pass `{}`, `{}`: {first}", row.pass, row.buffer)?;
            }
        }
        let worst = |count: fn(&Row) -> u64| {
            let share = |row: &Row| count(row) as f64 * 100.0 / row.pixels.max(1) as f64;
            self.rows.iter().map(share).fold(0.0, f64::max)
        };
        if self.is_equal() {
            f.write_str("equal, bit by bit")
        } else {
            write!(
                f,
                "{}: of the pixels of an output up to {:.3} % differ, {:.3} % by more than rounding explains",
                if self.is_close() { "not equal, but close" } else { "not equal" },
                worst(|row| row.differing_pixels),
                worst(|row| row.far_pixels)
            )
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.pixel;
        write!(f, "first at pixel ({x}, {y}), frame {}, word {}: ", self.frame, self.word)?;
        if self.float {
            write!(f, "GPU {:e}, host {:e}", f32::from_bits(self.gpu), f32::from_bits(self.host))
        } else {
            write!(f, "GPU {:#010x}, host {:#010x}", self.gpu, self.host)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Loader, Module, Report, Row, Traced, distance};

    #[test]
    fn one_pixel_in_a_hundred_may_be_far_and_no_more() {
        let with = |far_pixels| Report {
            adapter: String::new(),
            module: Module::Plain,
            loader: Loader::Naga,
            traced: Traced::Hardware,
            frames: 1,
            rows: vec![Row {
                pass: "shade",
                buffer: "color",
                words: 400,
                differing_words: far_pixels,
                pixels: 100,
                differing_pixels: far_pixels,
                far_pixels,
                largest_absolute: 1.0,
                largest_relative: 1.0,
                first: None,
            }],
        };
        assert!(with(1).is_close() && !with(1).is_equal());
        assert!(!with(2).is_close());
        assert!(with(2).to_string().ends_with(
            "not equal: of the pixels of an output up to 2.000 % differ, 2.000 % by more than rounding explains"
        ));
    }

    #[test]
    fn a_float_that_is_not_finite_is_infinitely_far_from_any_other() {
        assert_eq!(distance(f32::NAN, 1.0).0, f32::INFINITY);
        assert_eq!(distance(1.0, f32::INFINITY).1, f32::INFINITY);
    }

    #[test]
    fn the_relative_difference_is_a_part_of_the_larger() {
        assert_eq!(distance(3.0, 4.0), (1.0, 0.25));
        assert_eq!(distance(0.0, -0.0), (0.0, 0.0));
    }
}
