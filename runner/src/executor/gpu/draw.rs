//! Pipelines of what is drawn.

use weir_shader::wiring::Draw;
use weir_shared::window::Window;

use super::{Gpu, GpuError};

impl Gpu {
    /// The pipeline of a row of the table of what is drawn, for a target of the given format, and its bindings.
    ///
    /// # Errors
    /// If the device refuses it.
    pub async fn draw_pipeline(
        &self,
        draw: &Draw,
        format: wgpu::TextureFormat,
    ) -> Result<(wgpu::BindGroupLayout, wgpu::RenderPipeline), GpuError> {
        let shader = self.module_of(&[draw.vertex, draw.fragment]).await?;
        self.guarded(|| {
            let entry = |binding, ty, bytes: usize| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty,
                    has_dynamic_offset: false,
                    min_binding_size: wgpu::BufferSize::new(bytes as u64),
                },
                count: None,
            };
            let storage = wgpu::BufferBindingType::Storage { read_only: true };
            let inputs = draw.bindings.iter().zip(1..).map(|(binding, number)| entry(number, storage, binding.stride));
            let uniform = entry(0, wgpu::BufferBindingType::Uniform, size_of::<Window>());
            let entries: Vec<_> = std::iter::once(uniform).chain(inputs).collect();
            let label = Some(draw.name);
            let layout =
                self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries: &entries });
            let pipeline_layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label,
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            let pipeline = self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label,
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &shader,
                    entry_point: Some(draw.vertex),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: None,
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &shader,
                    entry_point: Some(draw.fragment),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(format.into())],
                }),
                multiview_mask: None,
                cache: None,
            });
            (layout, pipeline)
        })
        .await
    }
}
