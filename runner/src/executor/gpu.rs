//! The plan on a GPU, through wgpu.
//!
//! Nothing here panics when the GPU fails: every call returns a [`GpuError`] that says what to do.

mod adapter;
mod draw;
mod error;
mod memory;
mod pipelines;
mod queries;
mod stored;
mod timing;

use std::{collections::VecDeque, ops::Range, time::Duration};

use glam::UVec4;
use weir_shader::wiring::Extent;
use weir_shared::{
    frame::FramePair,
    tiles::{self, Tiling},
};

pub use adapter::{AdapterChoice, AdapterFacts, Gpu, adapters, instance};
pub use error::GpuError;
pub use memory::GpuScene;
pub use pipelines::{Loader, Module, Preparation};
pub use queries::{Bound, RayLimits, Traced, Traversal, bound_with_queries};

use self::{memory::Memory, pipelines::Compiled, timing::Timer};
use super::{AlignedBytes, SceneBuffers, View};
use crate::{
    graph::{Plan, Slot},
    packed::Changed,
};

/// Frames that may wait for the GPU; more would add delay and nothing else.
const FRAMES_IN_FLIGHT: usize = 2;

/// Buffers and pipelines of one plan, and the state between frames.
pub struct GpuExecutor {
    gpu: Gpu,
    plan: Plan,
    memory: Memory,
    uniform: wgpu::Buffer,
    steps: Vec<Compiled>,
    loader: Loader,
    traced: Traced,
    in_flight: VecDeque<wgpu::SubmissionIndex>,
    /// One for each frame in flight; none where the GPU has no clock.
    timers: Vec<Timer>,
    times: Vec<(&'static str, Duration)>,
    frames: usize,
    view: View,
}

impl GpuExecutor {
    /// Copies the scene to the GPU and compiles the passes of the plan; blocks until that is done.
    ///
    /// # Errors
    /// If a buffer is too large for the device, if a pass binds too many, if the loader does not work there, or if the
    /// device fails.
    pub fn new(
        gpu: &Gpu,
        plan: &Plan,
        scene: SceneBuffers<'_>,
        loader: Loader,
        module: Module,
    ) -> Result<Self, GpuError> {
        pollster::block_on(Self::create(gpu, plan, scene, loader, module))
    }

    /// [`GpuExecutor::new`] for those who can't block.
    ///
    /// # Errors
    /// As [`GpuExecutor::new`].
    pub async fn create(
        gpu: &Gpu,
        plan: &Plan,
        scene: SceneBuffers<'_>,
        loader: Loader,
        module: Module,
    ) -> Result<Self, GpuError> {
        loader.resolve(gpu, module)?;
        let on_gpu = GpuScene::upload(gpu, scene).await?;
        if loader != Loader::Naga {
            on_gpu.accelerate(gpu, scene, plan.facts.traversal).await?;
        }
        Self::on_scene(gpu, plan, &on_gpu, loader, module).await
    }

    /// An executor on a scene that is on the GPU already, and that others may use as well.
    ///
    /// # Errors
    /// As [`GpuExecutor::new`].
    pub async fn on_scene(
        gpu: &Gpu,
        plan: &Plan,
        scene: &GpuScene,
        loader: Loader,
        module: Module,
    ) -> Result<Self, GpuError> {
        let loader = loader.resolve(gpu, module)?;
        let memory = Memory::new(gpu, plan, scene.clone()).await?;
        let uniform = gpu
            .guarded(|| {
                gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("frame"),
                    size: pipelines::uniform_stride(gpu) * u64::from(plan.rounds()),
                    usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            })
            .await?;
        let mut traced = match loader {
            Loader::Naga => Traced::Software("naga reads no ray queries".to_owned()),
            _ => scene.traced(gpu, plan.facts.traversal),
        };
        let compile = |traced| pipelines::compile(gpu, plan, &memory, &uniform, loader, module, traced);
        let steps = match compile(traced.clone()).await {
            Err(error @ (GpuError::Validation(_) | GpuError::OutOfMemory(_))) if traced == Traced::Hardware => {
                let why = format!("the driver refuses ray queries: {error}");
                tracing::warn!("rays are traced in software: {why}");
                scene.refuse(&why);
                traced = Traced::Software(why);
                compile(traced.clone()).await?
            }
            compiled => compiled?,
        };
        let timers = if gpu.facts.timestamps && !steps.is_empty() {
            gpu.guarded(|| (0..FRAMES_IN_FLIGHT).map(|_| Timer::new(gpu, steps.len())).collect()).await?
        } else {
            Vec::new()
        };
        Ok(Self {
            gpu: gpu.clone(),
            plan: plan.clone(),
            memory,
            uniform,
            steps,
            loader,
            traced,
            in_flight: VecDeque::new(),
            timers,
            times: Vec::new(),
            frames: 0,
            view: View::default(),
        })
    }

    /// Submits one frame. Waits for the GPU only if it is two frames behind.
    ///
    /// # Errors
    /// If the frame is not of the plan's size, or if the device fails; an earlier frame's failure can show here.
    pub fn run(&mut self, frames: &FramePair) -> Result<(), GpuError> {
        let [frame_size, plan_size] =
            [[frames.now.width, frames.now.height], [self.plan.facts.width, self.plan.facts.height]];
        if frame_size != plan_size {
            return Err(GpuError::FrameSize { frame: frame_size, plan: plan_size });
        }
        while self.in_flight.len() >= FRAMES_IN_FLIGHT {
            self.retire()?;
        }
        let timer = self.frames % FRAMES_IN_FLIGHT;
        let is_view_kept = self.view.is_kept(&frames.now);
        let commands = self.record(self.timers.get(timer), is_view_kept);
        // In the queue's order: frames in flight still see their own.
        for round in 0..self.plan.rounds() {
            let mut copy = *frames;
            copy.now.round = round;
            let at = u64::from(round) * pipelines::uniform_stride(&self.gpu);
            self.gpu.queue.write_buffer(&self.uniform, at, bytemuck::bytes_of(&copy));
        }
        self.in_flight.push_back(self.gpu.queue.submit([commands]));
        if let Some(timer) = self.timers.get_mut(timer) {
            timer.request();
        }
        self.frames += 1;
        self.gpu.check()
    }

    fn record(&self, timer: Option<&Timer>, is_view_kept: bool) -> wgpu::CommandBuffer {
        let mut encoder =
            self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        let parity = self.frames & 1;
        for (i, (step, planned)) in self.steps.iter().zip(&self.plan.steps).enumerate() {
            for slot in self.plan.cleared(planned) {
                encoder.clear_buffer(self.memory.buffer(slot, parity), 0, None);
            }
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(step.pass),
                timestamp_writes: timer.map(|timer| timer.around(i)),
            });
            if is_view_kept && planned.is_kept {
                continue;
            }
            pass.set_pipeline(&step.pipeline);
            pass.set_bind_group(0, &step.bind_groups[parity], &[]);
            let grid = self.plan.facts.grid(step.extent);
            if let Some(list) = planned.list() {
                let head = size_of::<UVec4>() as u64 * u64::from(step.extent == Extent::Candidates);
                pass.dispatch_workgroups_indirect(self.memory.buffer(list, parity), head);
            } else if step.extent.is_listed() {
                let tiling = Tiling::new(grid.columns, grid.rows);
                pass.dispatch_workgroups(tiling.count(), tiling.blocks(), grid.depth);
            } else {
                pass.dispatch_workgroups(tiles::blocks(grid.columns), tiles::blocks(grid.rows), grid.depth);
            }
        }
        if let Some(timer) = timer {
            timer.resolve(&mut encoder);
        }
        encoder.finish()
    }

    /// Waits for the oldest frame in flight.
    fn retire(&mut self) -> Result<(), GpuError> {
        let Some(submission) = self.in_flight.pop_front() else {
            return Ok(());
        };
        self.gpu.wait(Some(submission))?;
        let frame = self.frames - self.in_flight.len() - 1;
        let timer = self.timers.get_mut(frame % FRAMES_IN_FLIGHT);
        if let Some(times) = timer.and_then(|timer| timer.collect(&self.gpu)) {
            self.times = self.steps.iter().map(|step| step.pass).zip(times).collect();
        }
        Ok(())
    }

    /// Waits for all frames.
    ///
    /// # Errors
    /// If the device fails or does not answer.
    pub fn finish(&mut self) -> Result<(), GpuError> {
        while !self.in_flight.is_empty() {
            self.retire()?;
        }
        self.gpu.check()
    }

    /// Times of the passes of the last frame that is known to be done; empty where the GPU has no clock.
    pub fn last_times(&self) -> &[(&'static str, Duration)] {
        &self.times
    }

    /// How the SPIR-V reached the driver.
    pub fn loader(&self) -> Loader {
        self.loader
    }

    /// How rays find what they meet.
    pub fn traced(&self) -> &Traced {
        &self.traced
    }

    /// The bytes of an output of the plan after the frames that were run; waits for them.
    ///
    /// # Errors
    /// If it is not an output of the plan, if no frame was run, or if the device fails.
    pub fn read(&mut self, name: &str) -> Result<AlignedBytes, GpuError> {
        let output = self.plan.outputs.iter().find(|(output, _)| *output == name);
        let &(_, slot) = output.filter(|_| self.frames > 0).ok_or_else(|| GpuError::NoOutput(name.to_owned()))?;
        let mut bytes = self.read_slot(slot)?;
        // A shared buffer can be larger than the output.
        if let Some(output_bytes) = self.plan.output_bytes(name) {
            bytes.truncate(output_bytes);
        }
        Ok(bytes)
    }

    /// Parts of an output of the plan, in whole words, one after the other; waits for the frames that were run.
    ///
    /// # Errors
    /// As [`GpuExecutor::read`].
    pub fn read_parts(&mut self, name: &str, parts: &[Range<u64>]) -> Result<AlignedBytes, GpuError> {
        self.finish()?;
        let buffer = self.output_buffer(name).filter(|_| self.frames > 0);
        self.gpu.download_parts(buffer.ok_or_else(|| GpuError::NoOutput(name.to_owned()))?, parts)
    }

    /// Writes over a part of an output of the plan, from byte `offset` on; the next frame sees that if it is a history.
    ///
    /// # Errors
    /// If it is not an output of the plan, or not a part of it in whole words, or if the device fails.
    pub fn overwrite(&mut self, name: &str, offset: u64, bytes: &[u8]) -> Result<(), GpuError> {
        let (buffer, size) = match (self.output_buffer(name), self.plan.output_bytes(name)) {
            (Some(buffer), Some(size)) if self.frames > 0 => (buffer, size as u64),
            _ => return Err(GpuError::NoOutput(name.to_owned())),
        };
        let end = offset.saturating_add(bytes.len() as u64);
        if end > size || !offset.is_multiple_of(4) || !end.is_multiple_of(4) {
            return Err(GpuError::OutOfRange { buffer: name.to_owned(), offset, end, bytes: size });
        }
        self.gpu.queue.write_buffer(buffer, offset, bytes);
        self.gpu.check()
    }

    /// Fills with ones what the next frame is to write, so that whatever it leaves unwritten shows. For tests.
    ///
    /// # Errors
    /// If the device fails.
    pub fn poison(&mut self) -> Result<(), GpuError> {
        self.finish()?;
        self.view = View::default();
        let pool = (0..self.plan.pool.len()).map(Slot::Pool);
        let slots = pool.chain((0..self.plan.history.len()).map(Slot::Current));
        for slot in slots {
            let buffer = self.memory.buffer(slot, self.frames & 1);
            self.gpu.queue.write_buffer(buffer, 0, &vec![0xff; buffer.size() as usize]);
        }
        self.gpu.check()
    }

    /// All bytes of a slot, as the last frame saw it; waits for the frames that were run.
    ///
    /// # Errors
    /// If the device fails.
    pub fn read_slot(&mut self, slot: Slot) -> Result<AlignedBytes, GpuError> {
        self.finish()?;
        let bytes = match slot {
            Slot::Pool(i) => self.plan.pool[i],
            Slot::Current(i) | Slot::Previous(i) => self.plan.history[i].bytes,
            Slot::Zero => self.plan.zero_bytes,
            Slot::Scene(_) => self.memory.buffer(slot, 0).size(),
        };
        self.gpu.download(self.memory.buffer(slot, self.last_parity()), bytes)
    }

    fn last_parity(&self) -> usize {
        self.frames.wrapping_sub(1) & 1
    }

    /// An output's buffer as the last frame wrote it, for passes that draw it without a way over the host.
    pub fn output_buffer(&self, name: &str) -> Option<&wgpu::Buffer> {
        let &(_, slot) = self.plan.outputs.iter().find(|(output, _)| *output == name)?;
        Some(self.memory.buffer(slot, self.last_parity()))
    }

    /// Copies what has changed of the scene; the next frame sees it.
    ///
    /// # Errors
    /// If a change is not within its buffer or not in whole words, or if the device fails.
    pub fn update(&mut self, scene: SceneBuffers<'_>, changed: &[Changed]) -> Result<(), GpuError> {
        pollster::block_on(self.memory.scene().follow(&self.gpu, scene, changed))
    }
}
