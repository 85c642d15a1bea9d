//! From a planned step to a pipeline and its bind groups.

use std::{borrow::Cow, collections::HashMap};

use weir_shader::wiring::{Access, Extent, Pass};
use weir_shared::frame::FramePair;

use super::{Gpu, GpuError, memory::Memory};
use crate::graph::{Plan, Planned};

/// Pixels in a row and in a column of a workgroup; entry points say the same.
pub(super) const WORKGROUP: u32 = 8;

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
    modules: HashMap<(Loader, Module), wgpu::ShaderModule>,
    passes: HashMap<(Loader, Module, &'static str), (wgpu::BindGroupLayout, wgpu::ComputePipeline)>,
}

/// Pipelines for the steps of a plan, on the given memory.
pub(super) async fn compile(
    gpu: &Gpu,
    plan: &Plan,
    memory: &Memory,
    uniform: &wgpu::Buffer,
    loader: Loader,
    module: Module,
) -> Result<Vec<Compiled>, GpuError> {
    let limit = gpu.device.limits().max_storage_buffers_per_shader_stage;
    for pass in plan.steps.iter().map(|s| s.pass) {
        let count = pass.bindings.len();
        if count > limit as usize {
            return Err(GpuError::TooManyBuffers { pass: pass.name, count, limit, adapter: gpu.facts.name.clone() });
        }
    }
    let loader = loader.resolve(gpu, module)?;
    let mut compiled = Vec::new();
    for step in &plan.steps {
        let (layout, pipeline) = pass(gpu, step, loader, module).await?;
        let bind_groups = gpu.guarded(|| bind_groups(gpu, step, memory, uniform, &layout)).await?;
        compiled.push(Compiled { pass: step.pass.name, extent: step.pass.extent, pipeline, bind_groups });
    }
    Ok(compiled)
}

fn words(module: Module) -> Cow<'static, [u32]> {
    match module {
        Module::Plain => crate::shaders::plain(),
        Module::Strict => crate::shaders::strict(),
    }
}

/// The module that holds an entry point. Through naga that is all of it, read once; a driver gets no more than it needs,
/// because it reads the whole of a module for each of its pipelines.
async fn module_for(
    gpu: &Gpu,
    loader: Loader,
    module: Module,
    entry_points: &[&'static str],
) -> Result<wgpu::ShaderModule, GpuError> {
    let label = Some("weir");
    if loader == Loader::Naga {
        if let Some(known) = gpu.cache().modules.get(&(loader, module)) {
            return Ok(known.clone());
        }
        let descriptor = wgpu::ShaderModuleDescriptor { label, source: wgpu::ShaderSource::SpirV(words(module)) };
        let checks = wgpu::ShaderRuntimeChecks::unchecked();
        // SAFETY: passes index only what the frame and the scene say is there; naga's checks cost a third of the speed.
        let read = gpu.guarded(|| unsafe { gpu.device.create_shader_module_trusted(descriptor, checks) }).await?;
        gpu.cache().modules.insert((loader, module), read.clone());
        return Ok(read);
    }
    // wgpu doesn't read the module, so it has to be told what it offers.
    let offered = entry_points.iter().map(|name| wgpu::PassthroughShaderEntryPoint {
        name: (*name).into(),
        workgroup_size: (WORKGROUP, WORKGROUP, 1),
    });
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label,
        entry_points: offered.collect(),
        spirv: Some(crate::shaders::part::only(&words(module), entry_points).into()),
        ..Default::default()
    };
    // SAFETY: the module is built and validated with this crate, and a test keeps it equal to its sources.
    gpu.guarded(|| unsafe { gpu.device.create_shader_module_passthrough(descriptor) }).await
}

impl Gpu {
    /// The optimised module, or the part of it that holds some entry points.
    pub(crate) async fn module_of(&self, entry_points: &[&'static str]) -> Result<wgpu::ShaderModule, GpuError> {
        let loader = Loader::Auto.resolve(self, Module::Plain)?;
        module_for(self, loader, Module::Plain, entry_points).await
    }
}

/// The pipeline of a step's pass and its layout, compiled unless the device has it.
async fn pass(
    gpu: &Gpu,
    step: &Planned,
    loader: Loader,
    module: Module,
) -> Result<(wgpu::BindGroupLayout, wgpu::ComputePipeline), GpuError> {
    let entry_point = step.variant.entry_point;
    if let Some(known) = gpu.cache().passes.get(&(loader, module, entry_point)) {
        return Ok(known.clone());
    }
    let shader = module_for(gpu, loader, module, &[entry_point]).await?;
    let name = Some(step.pass.name);
    let made = gpu
        .guarded(|| {
            let layout = layout(gpu, step.pass);
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
    gpu.cache().passes.insert((loader, module, entry_point), made.clone());
    Ok(made)
}

/// For frames of even and of odd number.
fn bind_groups(
    gpu: &Gpu,
    step: &Planned,
    memory: &Memory,
    uniform: &wgpu::Buffer,
    layout: &wgpu::BindGroupLayout,
) -> [wgpu::BindGroup; 2] {
    [0, 1].map(|parity| {
        let frames = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: uniform,
            offset: u64::from(step.round) * uniform_stride(gpu),
            size: wgpu::BufferSize::new(size_of::<FramePair>() as u64),
        });
        let buffers = step.slots.iter().map(|&(_, slot)| memory.buffer(slot, parity).as_entire_binding());
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
fn layout(gpu: &Gpu, pass: &Pass) -> wgpu::BindGroupLayout {
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
    let storage = pass.bindings.iter().zip(1..).map(|(binding, number)| {
        let read_only = binding.access == Access::Read;
        entry(number, wgpu::BufferBindingType::Storage { read_only }, binding.stride)
    });
    let entries: Vec<_> =
        std::iter::once(entry(0, wgpu::BufferBindingType::Uniform, size_of::<FramePair>())).chain(storage).collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(pass.name), entries: &entries })
}
