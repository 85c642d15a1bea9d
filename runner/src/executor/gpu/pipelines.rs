//! From a planned step to a pipeline and its bind groups.

use std::{
    borrow::Cow,
    collections::HashMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
};

use weir_shader::wiring::{Access, Extent};
use weir_shared::{
    frame::FramePair,
    tiles::{BLOCK, TileList},
};

use super::{
    Gpu, GpuError, Traced,
    memory::{GpuScene, Memory},
    queries::{Acceleration, Bound, NODES, bound_with_queries},
};
use crate::graph::{Plan, Planned};

/// Bytes from the uniform of one round to that of the next.
pub(super) fn uniform_stride(gpu: &Gpu) -> u64 {
    let alignment = u64::from(gpu.device.limits().min_uniform_buffer_offset_alignment);
    (size_of::<FramePair>() as u64).next_multiple_of(alignment)
}

/// How SPIR-V reaches the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Loader {
    /// As it is where that works, else through naga
    #[default]
    Auto,
    /// As it is
    Passthrough,
    /// Read, checked and written anew by naga
    Naga,
}

/// Which of the compiled modules.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Module {
    /// Optimised; differs from the host in the last bits of floats
    #[default]
    Plain,
    /// Every float operation as written, so that it can equal the host; needs passthrough
    Strict,
}

/// What a pipeline is compiled from.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Source {
    Of(Module),
    RayQuery,
}

impl Source {
    fn of(step: &Planned, module: Module, traced: &Traced) -> Self {
        if *traced == Traced::Hardware && step.pass.bindings.iter().any(|binding| binding.name == NODES) {
            Self::RayQuery
        } else {
            Self::Of(module)
        }
    }

    fn words(self) -> Cow<'static, [u32]> {
        match self {
            Self::Of(Module::Plain) => crate::shaders::plain(),
            Self::Of(Module::Strict) => crate::shaders::strict(),
            Self::RayQuery => crate::shaders::ray_query(),
        }
    }

    /// What a pass binds, from number 1 on.
    fn bound(self, step: &Planned) -> Vec<Bound> {
        match self {
            Self::Of(_) => (0..step.pass.bindings.len()).map(Bound::Buffer).collect(),
            Self::RayQuery => bound_with_queries(step.pass),
        }
    }
}

/// A step, ready to run.
pub(super) struct Compiled {
    pub(super) pass: &'static str,
    pub(super) extent: Extent,
    pub(super) pipeline: wgpu::ComputePipeline,
    /// For frames of even and of odd number: the halves of history swap.
    pub(super) bind_groups: [wgpu::BindGroup; 2],
}

impl Loader {
    /// What `Auto` means here; always `Passthrough` or `Naga`.
    ///
    /// # Errors
    /// If passthrough is asked for, or the strict module needs it, where there is none.
    pub fn resolve(self, gpu: &Gpu, module: Module) -> Result<Self, GpuError> {
        let direct = match self {
            Self::Auto => module == Module::Strict || gpu.has_passthrough(),
            Self::Passthrough => true,
            Self::Naga => module == Module::Strict,
        };
        match direct {
            true if !gpu.has_passthrough() => {
                Err(GpuError::NoPassthrough { adapter: gpu.facts.name.clone(), backend: gpu.facts.backend.clone() })
            }
            true => Ok(Self::Passthrough),
            false => Ok(Self::Naga),
        }
    }
}

/// What a device has compiled: modules, and the pipelines of passes. Plans of any size share them.
#[derive(Default)]
pub(super) struct Cache {
    modules: HashMap<Module, wgpu::ShaderModule>,
    passes: HashMap<(Loader, Source, &'static str), (wgpu::BindGroupLayout, wgpu::ComputePipeline)>,
}

/// Pipelines for the steps of a plan, on the given memory.
pub(super) async fn compile(
    gpu: &Gpu,
    plan: &Plan,
    memory: &Memory,
    uniform: &wgpu::Buffer,
    loader: Loader,
    module: Module,
    traced: Traced,
) -> Result<Vec<Compiled>, GpuError> {
    let limit = gpu.device.limits().max_storage_buffers_per_shader_stage;
    for pass in plan.steps.iter().map(|s| s.pass) {
        let count = pass.storage_buffers();
        if count > limit as usize {
            return Err(GpuError::TooManyBuffers { pass: pass.name, count, limit, adapter: gpu.facts.name.clone() });
        }
    }
    let loader = loader.resolve(gpu, module)?;
    let mut compiled = Vec::new();
    for step in &plan.steps {
        let source = Source::of(step, module, &traced);
        let (layout, pipeline) = pass(gpu, step, loader, source).await?;
        let bound = source.bound(step);
        let bind_groups = gpu.guarded(|| bind_groups(gpu, step, &bound, memory, uniform, &layout)).await?;
        compiled.push(Compiled { pass: step.pass.name, extent: step.pass.extent, pipeline, bind_groups });
    }
    Ok(compiled)
}

/// A thread that compiles the pipelines of a plan, so that nobody has to wait for its first frame. Dropped, it stops after the
/// one that it is at.
pub struct Preparation {
    thread: Option<JoinHandle<Result<(), GpuError>>>,
    stops: Arc<AtomicBool>,
}

impl Preparation {
    /// Starts to compile what the device lacks for frames of a plan on a scene, and keeps that for the next run as well.
    /// Without a thread, it is left to the first frame.
    pub fn start(gpu: &Gpu, plan: &Plan, scene: &GpuScene) -> Option<Self> {
        let (gpu, plan, traced) = (gpu.clone(), plan.clone(), scene.traced(gpu, plan.facts.traversal));
        let stops = Arc::new(AtomicBool::new(false));
        let is_stopped = Arc::clone(&stops);
        let compile = move || {
            let loader = Loader::Auto.resolve(&gpu, Module::Plain)?;
            for step in plan.steps.iter().take_while(|_| !is_stopped.load(Ordering::Relaxed)) {
                pollster::block_on(pass(&gpu, step, loader, Source::of(step, Module::Plain, &traced)))?;
            }
            gpu.store_pipelines();
            Ok(())
        };
        let thread = std::thread::Builder::new().name("pipelines".to_owned()).spawn(compile);
        thread.ok().map(|thread| Self { thread: Some(thread), stops })
    }

    /// Whether it has come to its end.
    pub fn is_done(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the end.
    ///
    /// # Errors
    /// If a pipeline can't be compiled or the device fails.
    pub fn finish(mut self) -> Result<(), GpuError> {
        let panicked = |_| Err(GpuError::Validation("the driver's compiler panicked".to_owned()));
        self.thread.take().map_or(Ok(()), |thread| thread.join().unwrap_or_else(panicked))
    }
}

impl Drop for Preparation {
    fn drop(&mut self) {
        self.stops.store(true, Ordering::Relaxed);
        // A driver must not be at work when the process ends.
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Gpu {
    /// Whether the device has the pipelines of all passes of a plan, for frames of a scene: those of the optimised module,
    /// loaded as it works best.
    pub fn has_pipelines(&self, plan: &Plan, scene: &GpuScene) -> bool {
        let Ok(loader) = Loader::Auto.resolve(self, Module::Plain) else { return false };
        let traced = scene.traced(self, plan.facts.traversal);
        let cache = self.cache();
        plan.steps.iter().all(|step| {
            let source = Source::of(step, Module::Plain, &traced);
            cache.passes.contains_key(&(loader, source, step.variant.entry_point))
        })
    }
}

/// The module that holds an entry point. Through naga that is all of it, read once; a driver gets no more than it needs,
/// because it reads the whole of a module for each of its pipelines.
async fn module_for(
    gpu: &Gpu,
    loader: Loader,
    source: Source,
    entry_points: &[&'static str],
) -> Result<wgpu::ShaderModule, GpuError> {
    let label = Some("weir");
    if let (Loader::Naga, Source::Of(module)) = (loader, source) {
        if let Some(known) = gpu.cache().modules.get(&module) {
            return Ok(known.clone());
        }
        let descriptor = wgpu::ShaderModuleDescriptor { label, source: wgpu::ShaderSource::SpirV(source.words()) };
        let checks = wgpu::ShaderRuntimeChecks::unchecked();
        // SAFETY: passes index only what the frame and the scene say is there; naga's checks cost a third of the speed.
        let read = gpu.guarded(|| unsafe { gpu.device.create_shader_module_trusted(descriptor, checks) }).await?;
        gpu.cache().modules.insert(module, read.clone());
        return Ok(read);
    }
    // wgpu doesn't read the module, so it has to be told what it offers.
    let offered = entry_points
        .iter()
        .map(|name| wgpu::PassthroughShaderEntryPoint { name: (*name).into(), workgroup_size: (BLOCK, BLOCK, 1) });
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label,
        entry_points: offered.collect(),
        spirv: Some(crate::shaders::part::only(&source.words(), entry_points).into()),
        ..Default::default()
    };
    // SAFETY: the module is built and validated with this crate, and a test keeps it equal to its sources.
    gpu.guarded(|| unsafe { gpu.device.create_shader_module_passthrough(descriptor) }).await
}

impl Gpu {
    /// The optimised module, or the part of it that holds some entry points.
    pub(crate) async fn module_of(&self, entry_points: &[&'static str]) -> Result<wgpu::ShaderModule, GpuError> {
        let loader = Loader::Auto.resolve(self, Module::Plain)?;
        module_for(self, loader, Source::Of(Module::Plain), entry_points).await
    }
}

/// The pipeline of a step's pass and its layout, compiled unless the device has it.
async fn pass(
    gpu: &Gpu,
    step: &Planned,
    loader: Loader,
    source: Source,
) -> Result<(wgpu::BindGroupLayout, wgpu::ComputePipeline), GpuError> {
    let entry_point = step.variant.entry_point;
    if let Some(known) = gpu.cache().passes.get(&(loader, source, entry_point)) {
        return Ok(known.clone());
    }
    let shader = module_for(gpu, loader, source, &[entry_point]).await?;
    let name = Some(step.pass.name);
    let made = gpu
        .guarded(|| {
            let layout = layout(gpu, step, &source.bound(step));
            let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: name,
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: name,
                layout: Some(&pipeline_layout),
                module: &shader,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: gpu.stored_pipelines(),
            });
            (layout, pipeline)
        })
        .await?;
    gpu.cache().passes.insert((loader, source, entry_point), made.clone());
    Ok(made)
}

/// For frames of even and of odd number.
fn bind_groups(
    gpu: &Gpu,
    step: &Planned,
    bound: &[Bound],
    memory: &Memory,
    uniform: &wgpu::Buffer,
    layout: &wgpu::BindGroupLayout,
) -> [wgpu::BindGroup; 2] {
    let acceleration = memory.scene().acceleration();
    let tops = acceleration.as_ref().and_then(|built| built.as_ref().ok()).map(Acceleration::tops);
    [0, 1].map(|parity| {
        let frames = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: uniform,
            offset: u64::from(step.round) * uniform_stride(gpu),
            size: wgpu::BufferSize::new(size_of::<FramePair>() as u64),
        });
        let buffers = bound.iter().map(|bound| match *bound {
            Bound::Buffer(i) if step.pass.bindings[i].is_uniform => {
                let size = wgpu::BufferSize::new(size_of::<TileList>() as u64);
                let buffer = memory.buffer(step.slots[i].1, parity);
                wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size })
            }
            Bound::Buffer(i) => memory.buffer(step.slots[i].1, parity).as_entire_binding(),
            Bound::Top(block) => tops.expect("acceleration structures were built")[block].as_binding(),
        });
        let entries: Vec<_> = std::iter::once(frames)
            .chain(buffers)
            .zip(0..)
            .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(step.pass.name),
            layout,
            entries: &entries,
        })
    })
}

/// The frame at binding 0, then the buffers of the pass; explicit, because a passthrough module implies none.
fn layout(gpu: &Gpu, step: &Planned, bound: &[Bound]) -> wgpu::BindGroupLayout {
    let entry = |binding, ty, bytes| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: wgpu::BufferSize::new(bytes as u64),
        },
        count: None,
    };
    let others = bound.iter().zip(1..).map(|(bound, number)| match *bound {
        Bound::Buffer(i) if step.pass.bindings[i].is_uniform => {
            entry(number, wgpu::BufferBindingType::Uniform, size_of::<TileList>())
        }
        Bound::Buffer(i) => {
            let binding = &step.pass.bindings[i];
            let read_only = binding.access == Access::Read;
            entry(number, wgpu::BufferBindingType::Storage { read_only }, binding.stride)
        }
        Bound::Top(_) => wgpu::BindGroupLayoutEntry {
            ty: wgpu::BindingType::AccelerationStructure { vertex_return: false },
            ..entry(number, wgpu::BufferBindingType::Uniform, 0)
        },
    });
    let entries: Vec<_> =
        std::iter::once(entry(0, wgpu::BufferBindingType::Uniform, size_of::<FramePair>())).chain(others).collect();
    gpu.device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(step.pass.name), entries: &entries })
}
