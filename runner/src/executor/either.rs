//! One executor or the other, behind one set of calls.

use std::{ops::Range, time::Duration};

use weir_shared::frame::FramePair;

use super::{
    AlignedBytes, SceneBuffers,
    cpu::{CpuExecutor, Order},
    gpu::{Gpu, GpuError, GpuExecutor, Loader, Module, Traversal},
};
use crate::{graph::Plan, packed::Changed};

/// Who computes.
pub enum Backend<'a> {
    /// The host's threads, in the given order.
    Cpu(Order),
    /// A GPU.
    Gpu(&'a Gpu),
}

/// An executor of either kind.
pub enum Executor {
    /// On the host.
    Cpu(Box<CpuExecutor>),
    /// On a GPU.
    Gpu(Box<GpuExecutor>),
}

impl Executor {
    /// Memory for a plan, and on a GPU a copy of the scene.
    ///
    /// # Errors
    /// As [`GpuExecutor::new`].
    pub fn new(backend: &Backend<'_>, plan: &Plan, scene: SceneBuffers<'_>) -> Result<Self, GpuError> {
        Ok(match backend {
            Backend::Cpu(order) => {
                if plan.facts.traversal == Traversal::Hardware {
                    tracing::warn!("rays are traced in software: the CPU has no ray queries");
                }
                let mut executor = CpuExecutor::new(plan);
                executor.order = *order;
                Self::Cpu(Box::new(executor))
            }
            Backend::Gpu(gpu) => Self::Gpu(Box::new(GpuExecutor::new(gpu, plan, scene, Loader::Auto, Module::Plain)?)),
        })
    }

    /// Runs a frame; on a GPU it may still be under way afterwards.
    ///
    /// # Errors
    /// If the frame is not of the plan's size, or if the GPU fails.
    pub fn run(
        &mut self,
        plan: &Plan,
        scene: SceneBuffers<'_>,
        frames: &FramePair,
    ) -> Result<Vec<(&'static str, Duration)>, GpuError> {
        match self {
            Self::Cpu(executor) => {
                let [frame, plan_size] = [[frames.now.width, frames.now.height], [plan.facts.width, plan.facts.height]];
                if frame != plan_size {
                    return Err(GpuError::FrameSize { frame, plan: plan_size });
                }
                Ok(executor.run(plan, scene, frames))
            }
            Self::Gpu(executor) => {
                executor.run(frames)?;
                Ok(executor.last_times().to_vec())
            }
        }
    }

    /// Tells the executor what of the scene has changed.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn update(&mut self, scene: SceneBuffers<'_>, changed: Vec<Changed>) -> Result<(), GpuError> {
        if let Self::Gpu(executor) = self {
            executor.update(scene, &changed)?;
        }
        Ok(())
    }

    /// Writes over a part of an output of the last frame; the next sees that if it is a history.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn overwrite(&mut self, plan: &Plan, name: &str, offset: usize, bytes: &[u8]) -> Result<(), GpuError> {
        match self {
            Self::Cpu(executor) => {
                let output = executor.output_mut(plan, name).expect("the plan has this output");
                output[offset..][..bytes.len()].copy_from_slice(bytes);
                Ok(())
            }
            Self::Gpu(executor) => executor.overwrite(name, offset as u64, bytes),
        }
    }

    /// The bytes of an output of the plan, after the frames that were run.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn read(&mut self, plan: &Plan, name: &str) -> Result<AlignedBytes, GpuError> {
        match self {
            Self::Cpu(executor) => {
                Ok(AlignedBytes::from_bytes(executor.output(plan, name).expect("the plan has this output")))
            }
            Self::Gpu(executor) => executor.read(name),
        }
    }

    /// Parts of an output, in whole words, one after the other.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn read_parts(&mut self, plan: &Plan, name: &str, parts: &[Range<u64>]) -> Result<AlignedBytes, GpuError> {
        match self {
            Self::Cpu(executor) => {
                let all = executor.output(plan, name).expect("the plan has this output");
                let bytes: Vec<u8> =
                    parts.iter().flat_map(|part| &all[part.start as usize..part.end as usize]).copied().collect();
                Ok(AlignedBytes::from_bytes(&bytes))
            }
            Self::Gpu(executor) => executor.read_parts(name, parts),
        }
    }

    /// Waits for all frames.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn finish(&mut self) -> Result<(), GpuError> {
        match self {
            Self::Cpu(_) => Ok(()),
            Self::Gpu(executor) => executor.finish(),
        }
    }

    /// Times of the passes of the last frame. `returned` is what [`Executor::run`] returned, which on a GPU are those of
    /// a frame before.
    pub fn last_times(&self, returned: Vec<(&'static str, Duration)>) -> Vec<(&'static str, Duration)> {
        match self {
            Self::Cpu(_) => returned,
            Self::Gpu(executor) => executor.last_times().to_vec(),
        }
    }
}
