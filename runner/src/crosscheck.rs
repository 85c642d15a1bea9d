//! The cross-check: every pass on the GPU against the same pass on the host, from the same inputs.
//!
//! A frame runs on the GPU, and everything that its passes read and wrote is fetched. Then the host's kernel of each pass
//! gets the GPU's *inputs*, and its outputs are compared with the GPU's word by word. So a difference is blamed on the
//! pass that makes it, never on the one that inherits it.

mod report;

use std::{borrow::BorrowMut, collections::BTreeMap};

use thiserror::Error;
use weir_shader::wiring::{Access, Pass};
use weir_shared::frame::FramePair;

pub use report::{Difference, Report, Row};

use crate::{
    executor::{
        AlignedBytes, SceneBuffers,
        cpu::{Order, run_kernel},
        gpu::{Gpu, GpuError, GpuExecutor, Loader, Module},
    },
    exit::{Exit, HasExit},
    graph::{Facts, GraphError, Plan, Planned, Slot},
    packed::{PackError, PackedScene},
    sequence::{Sequence, Shot},
    settings::Settings,
    technique::{RESOURCES, Technique, ToneCurve, direct_light_with},
};

/// What to compare.
#[derive(Clone, Copy, Debug)]
pub struct Check<'a> {
    /// The host's side. Entry points are taken from it as well, so it must be the pass table or one like it.
    pub passes: &'static [Pass],
    /// Which frames.
    pub technique: Technique,
    /// Their settings.
    pub settings: &'a Settings,
    /// Size, and what the scene has.
    pub facts: &'a Facts,
    /// Which of the display passes.
    pub curve: ToneCurve,
    /// How the SPIR-V reaches the driver.
    pub loader: Loader,
    /// Equality is to be expected of [`Module::Strict`] only, and of rays in software.
    pub module: Module,
}

/// Why there is nothing to report.
#[derive(Debug, Error)]
pub enum CheckError {
    /// The frame has no plan.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// A shot can't be shown.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

impl HasExit for CheckError {
    fn exit(&self) -> Exit {
        match self {
            Self::Graph(error) => error.exit(),
            Self::Pack(error) => error.exit(),
            Self::Gpu(error) => error.exit(),
        }
    }
}

/// Runs a frame for each shot on the GPU, and every pass of each of them on the host as well.
///
/// Give it more than one frame: only then does history hold anything.
///
/// # Errors
/// If the size is refused, a shot can't be shown or the GPU fails. A difference is not an error, but in the report.
pub fn check<S: BorrowMut<PackedScene>>(
    gpu: &Gpu,
    what: &Check<'_>,
    sequence: &mut Sequence<S>,
    shots: &[Shot],
) -> Result<Report, CheckError> {
    let plan = unshared_plan(what)?;
    let scene = sequence.packed().buffers();
    let mut executor = GpuExecutor::new(gpu, &plan, scene, what.loader, what.module)?;
    let mut report = Report::new(gpu, what.module, &executor, &plan);
    for (i, shot) in shots.iter().enumerate() {
        let (mut frames, changed) = sequence.next(shot)?;
        if what.technique != Technique::RealTime {
            frames.now.accumulated = i as u32;
        }
        let scene = sequence.packed().buffers();
        executor.update(scene, &changed)?;
        executor.run(&frames)?;
        let mut contents = BTreeMap::new();
        for &(_, slot) in plan.steps.iter().flat_map(|s| &s.slots) {
            if !matches!(slot, Slot::Scene(_)) && !contents.contains_key(&slot) {
                contents.insert(slot, executor.read_slot(slot)?);
            }
        }
        for step in &plan.steps {
            compare_step(step, scene, &frames, &contents, &mut report);
        }
        report.frames += 1;
    }
    Ok(report)
}

/// The plan of a frame in which every result has its own memory, so that all are there after the last pass.
fn unshared_plan(what: &Check<'_>) -> Result<Plan, GraphError> {
    let plan = |outputs: &[&'static str]| {
        direct_light_with(what.passes, what.technique, what.settings, what.facts, what.curve, outputs)
    };
    let shared = plan(&["display"])?;
    let outputs: Vec<_> = shared.steps.iter().flat_map(|s| s.writes().map(|(name, _)| name)).collect();
    // Outputs live to the end of the frame.
    plan(&outputs)
}

fn compare_step(
    step: &Planned,
    scene: SceneBuffers<'_>,
    frames: &FramePair,
    contents: &BTreeMap<Slot, AlignedBytes>,
    report: &mut Report,
) {
    let on_gpu = |slot: Slot| match slot {
        Slot::Scene(name) => scene.bytes(name),
        other => contents[&other].bytes(),
    };
    let bound = |access| step.slots.iter().filter(move |slot| slot.0 == access).map(|&(_, slot)| slot);
    let inputs: Vec<&[u8]> = bound(Access::Read).map(on_gpu).collect();
    let grid = step.pass.extent.grid(&frames.now);
    let elements = grid.elements() as usize;
    let mut on_host: Vec<AlignedBytes> =
        step.writes().map(|(_, stride)| AlignedBytes::zeroed(stride * elements)).collect();
    let outputs = on_host.iter_mut().map(AlignedBytes::bytes_mut).collect();
    run_kernel(step, frames, Order::default(), &inputs, outputs);

    for ((written, slot), host) in step.writes().zip(bound(Access::Write)).zip(&on_host) {
        let floats = RESOURCES.iter().find(|r| r.name == written.0).map_or(0, |r| r.float_words);
        let gpu_words: &[u32] = bytemuck::cast_slice(&on_gpu(slot)[..host.bytes().len()]);
        report.compare(step.pass.name, written, floats, (frames.now.index, grid), gpu_words, host.elements());
    }
}
