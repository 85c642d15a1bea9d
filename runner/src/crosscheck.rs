//! The cross-check: every pass on the GPU against the same pass on the host, from the same inputs.
//!
//! A frame runs on the GPU, and everything that its passes read and wrote is fetched. Then the host's kernel of each pass
//! gets the GPU's *inputs*, and its outputs are compared with the GPU's word by word. So a difference is blamed on the
//! pass that makes it, never on the one that inherits it.

mod report;

use std::collections::BTreeMap;

use thiserror::Error;
use weir_shader::wiring::{Access, Pass};
use weir_shared::frame::Frame;

pub use report::{Difference, Report, Row};

use crate::{
    executor::{
        AlignedBytes, SceneBuffers,
        cpu::{Order, run_kernel},
        gpu::{Gpu, GpuError, GpuExecutor, Loader, Module},
    },
    exit::{Exit, HasExit},
    graph::{Facts, GraphError, Plan, Planned, Slot},
    technique::{RESOURCES, ToneCurve, direct_light_with},
};

/// What to compare.
#[derive(Clone, Copy, Debug)]
pub struct Check<'a> {
    /// The host's side. Entry points are taken from it as well, so it must be the pass table or one like it.
    pub passes: &'static [Pass],
    /// Size, and what the scene has.
    pub facts: &'a Facts,
    /// Which of the display passes.
    pub curve: ToneCurve,
    /// How the SPIR-V reaches the driver.
    pub loader: Loader,
    /// Equality is to be expected of [`Module::Strict`] only.
    pub module: Module,
}

/// Why there is nothing to report.
#[derive(Debug, Error)]
pub enum CheckError {
    /// The frame has no plan.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

impl HasExit for CheckError {
    fn exit(&self) -> Exit {
        match self {
            Self::Graph(error) => error.exit(),
            Self::Gpu(error) => error.exit(),
        }
    }
}

/// Runs the frames on the GPU, and every pass of each of them on the host as well.
///
/// Give it more than one frame, with `accumulated` counting: only then does history hold anything.
///
/// # Errors
/// If the size is refused or the GPU fails. A difference is not an error, but in the report.
pub fn check(gpu: &Gpu, what: &Check<'_>, scene: SceneBuffers<'_>, frames: &[Frame]) -> Result<Report, CheckError> {
    let plan = unshared_plan(what)?;
    let mut executor = GpuExecutor::new(gpu, &plan, scene, what.loader, what.module)?;
    let mut report = Report::new(gpu, what.module, executor.loader(), &plan);
    for frame in frames {
        executor.run(frame)?;
        let mut contents = BTreeMap::new();
        for &(_, slot) in plan.steps.iter().flat_map(|s| &s.slots) {
            if !matches!(slot, Slot::Scene(_)) && !contents.contains_key(&slot) {
                contents.insert(slot, executor.read_slot(slot)?);
            }
        }
        for step in &plan.steps {
            compare_step(step, scene, frame, &contents, &mut report);
        }
        report.frames += 1;
    }
    Ok(report)
}

/// The plan of a frame in which every result has its own memory, so that all are there after the last pass.
fn unshared_plan(what: &Check<'_>) -> Result<Plan, GraphError> {
    let shared = direct_light_with(what.passes, what.facts, what.curve, &["display"])?;
    let bindings = shared.steps.iter().flat_map(|s| s.pass.bindings);
    let outputs: Vec<_> = bindings.filter(|b| b.access == Access::Write).map(|b| b.name).collect();
    // Outputs live to the end of the frame.
    direct_light_with(what.passes, what.facts, what.curve, &outputs)
}

fn compare_step(
    step: &Planned,
    scene: SceneBuffers<'_>,
    frame: &Frame,
    contents: &BTreeMap<Slot, AlignedBytes>,
    report: &mut Report,
) {
    let on_gpu = |slot: Slot| match slot {
        Slot::Scene(name) => scene.bytes(name),
        other => contents[&other].bytes(),
    };
    let bound = |access| step.slots.iter().filter(move |slot| slot.0 == access).map(|&(_, slot)| slot);
    let inputs: Vec<&[u8]> = bound(Access::Read).map(on_gpu).collect();
    let written: Vec<_> = step.pass.bindings.iter().filter(|b| b.access == Access::Write).collect();
    let strides: Vec<usize> = written.iter().map(|b| b.stride).collect();
    let pixels = frame.width as usize * frame.height as usize;
    let mut on_host: Vec<AlignedBytes> = strides.iter().map(|stride| AlignedBytes::zeroed(stride * pixels)).collect();
    let outputs = on_host.iter_mut().map(AlignedBytes::bytes_mut).collect();
    run_kernel(step, frame, Order::default(), &inputs, outputs, &strides);

    for ((binding, slot), host) in written.into_iter().zip(bound(Access::Write)).zip(&on_host) {
        let floats = RESOURCES.iter().find(|r| r.name == binding.name).map_or(0, |r| r.float_words);
        let gpu_words: &[u32] = bytemuck::cast_slice(&on_gpu(slot)[..host.bytes().len()]);
        report.compare(step.pass.name, binding, floats, frame, gpu_words, host.elements());
    }
}
