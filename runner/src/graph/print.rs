//! The plan as text and as a drawing.

use std::fmt::{Display, Formatter, Result, Write};

use weir_shader::wiring::Access;

use super::{Plan, Slot};

impl Display for Slot {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Self::Scene(_) => f.write_str("scene"),
            Self::Current(i) => write!(f, "history {i}, this frame"),
            Self::Previous(i) => write!(f, "history {i}, last frame"),
            Self::Pool(i) => write!(f, "pool {i}"),
            Self::Zero => f.write_str("zeros"),
        }
    }
}

/// Storage buffers that every WebGPU device lets a pass bind.
const PORTABLE_BUFFERS: usize = 8;

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

impl Display for Plan {
    /// One line a step, then what was left out and why, then memory.
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(f, "{}x{} pixels", self.facts.width, self.facts.height)?;
        for (i, step) in self.steps.iter().enumerate() {
            let round = if step.round > 0 { format!(" (round {})", step.round + 1) } else { String::new() };
            writeln!(f, "{:>2}. {:<18} {}{round}", i + 1, step.pass.name, step.variant.entry_point)?;
            for ((binding, name), (access, slot)) in step.pass.bindings.iter().zip(&step.names).zip(&step.slots) {
                let arrow = if *access == Access::Read { "reads " } else { "writes" };
                writeln!(f, "      {arrow} {name:<18} {:>3} B  {slot}", binding.stride)?;
            }
            let buffers = step.pass.storage_buffers();
            if buffers > PORTABLE_BUFFERS {
                writeln!(f, "      binds {buffers} buffers; WebGPU promises {PORTABLE_BUFFERS}")?;
            }
        }
        for (what, reason) in self.left_out() {
            writeln!(f, " -  {what:<18} left out: {reason}")?;
        }
        for (i, bytes) in self.pool.iter().enumerate() {
            writeln!(f, "pool {i}: {:.1} MiB", mebibytes(*bytes))?;
        }
        for (i, history) in self.history.iter().enumerate() {
            writeln!(f, "history {i} ({}): 2 x {:.1} MiB", history.name, mebibytes(history.bytes))?;
        }
        if self.zero_bytes > 0 {
            writeln!(f, "zeros: {:.1} MiB", mebibytes(self.zero_bytes))?;
        }
        write!(f, "frame memory: {:.1} MiB", mebibytes(self.frame_bytes()))
    }
}

impl Plan {
    /// The plan in the DOT language of Graphviz: passes as boxes, resources as ellipses, what was left out dashed.
    pub fn to_dot(&self) -> String {
        let mut dot = String::from("digraph frame {\n  rankdir=LR;\n");
        for step in &self.steps {
            let pass = match step.round {
                0 => step.pass.name.to_owned(),
                round => format!("{} {}", step.pass.name, round + 1),
            };
            let _ = writeln!(dot, "  \"pass {pass}\" [shape=box, label=\"{pass}\"];");
            for (name, (access, slot)) in step.names.iter().zip(&step.slots) {
                let _ = writeln!(dot, "  \"{name}\" [label=\"{name}\\n{slot}\"];");
                let _ = match access {
                    Access::Read => writeln!(dot, "  \"{name}\" -> \"pass {pass}\";"),
                    Access::Write => writeln!(dot, "  \"pass {pass}\" -> \"{name}\";"),
                };
            }
        }
        for (pass, reason) in &self.culled {
            let _ = writeln!(dot, "  \"pass {pass}\" [shape=box, style=dashed, label=\"{pass}\\n{reason}\"];");
        }
        dot.push_str("}\n");
        dot
    }
}
