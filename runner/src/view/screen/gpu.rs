//! The window drawn by a GPU: the picture by the pass `present`, straight from the executor's buffer; panels by egui.

use std::sync::Arc;

use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use weir_shader::DRAWS;
use weir_shared::window::Window as PictureWindow;
use winit::window::Window;

use super::{Painted, Painting};
use crate::{
    executor::gpu::{AdapterChoice, Gpu, GpuError, instance},
    view::engine::{Pixels, Shown},
};

/// A window's surface on a GPU, and what draws there.
pub struct GpuScreen {
    gpu: Gpu,
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    egui: Renderer,
    layout: wgpu::BindGroupLayout,
    present: wgpu::RenderPipeline,
    uniform: wgpu::Buffer,
    /// Pictures of the host, copied here: their address there, and the copy.
    uploads: [Option<(Arc<Vec<u32>>, wgpu::Buffer)>; 2],
}

impl GpuScreen {
    pub(super) fn new(window: &Arc<Window>, choice: &AdapterChoice) -> Result<Self, GpuError> {
        let instance = instance();
        let surface = surface_of(&instance, window)?;
        let gpu = pollster::block_on(Gpu::open_on(instance, choice, Some(&surface)))?;
        let capabilities = surface.get_capabilities(&gpu.adapter);
        // egui blends encoded colours.
        let format = egui_wgpu::preferred_framebuffer_format(&capabilities.formats)
            .map_err(|error| GpuError::Validation(error.to_string()))?;
        let size = window.inner_size();
        let config = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            format,
            color_space: wgpu::SurfaceColorSpace::default(),
            width: size.width,
            height: size.height,
            present_mode: wgpu::PresentMode::AutoVsync,
            desired_maximum_frame_latency: 2,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: Vec::new(),
        };
        let draw = DRAWS.iter().find(|draw| draw.name == "present").expect("the table has it");
        let (layout, present) = pollster::block_on(gpu.draw_pipeline(draw, format))?;
        let (egui, uniform) = pollster::block_on(gpu.guarded(|| {
            let options = RendererOptions { dithering: false, ..RendererOptions::default() };
            let uniform = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("window"),
                size: size_of::<PictureWindow>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            (Renderer::new(&gpu.device, format, options), uniform)
        }))?;
        gpu.store_pipelines();
        let mut screen = Self {
            gpu,
            window: Arc::clone(window),
            surface,
            config,
            egui,
            layout,
            present,
            uniform,
            uploads: [None, None],
        };
        screen.configure();
        Ok(screen)
    }

    /// The GPU.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    pub(super) fn max_texture_side(&self) -> usize {
        self.gpu.device.limits().max_texture_dimension_2d as usize
    }

    /// A size of 0, of a window that is minimised, can't be configured.
    fn configure(&mut self) {
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        (self.config.width, self.config.height) = (self.config.width.min(limit), self.config.height.min(limit));
        if self.config.width > 0 && self.config.height > 0 {
            self.surface.configure(&self.gpu.device, &self.config);
        }
    }

    pub(super) fn resize(&mut self, size: [u32; 2]) {
        if [self.config.width, self.config.height] != size {
            (self.config.width, self.config.height) = (size[0], size[1]);
            self.configure();
        }
    }

    pub(super) fn set_vsync(&mut self, vsync: bool) {
        let mode = if vsync { wgpu::PresentMode::AutoVsync } else { wgpu::PresentMode::AutoNoVsync };
        if self.config.present_mode != mode {
            self.config.present_mode = mode;
            self.configure();
        }
    }

    pub(super) fn paint(&mut self, painting: &Painting<'_>) -> Result<Painted, GpuError> {
        for (id, deltas) in &painting.textures.set {
            for delta in deltas {
                self.egui.update_texture(&self.gpu.device, &self.gpu.queue, *id, delta);
            }
        }
        let painted = self.paint_surface(painting);
        for id in &painting.textures.free {
            self.egui.free_texture(id);
        }
        painted
    }

    fn paint_surface(&mut self, painting: &Painting<'_>) -> Result<Painted, GpuError> {
        use wgpu::CurrentSurfaceTexture as Current;
        self.gpu.check()?;
        if self.config.width == 0 || self.config.height == 0 {
            return Ok(Painted::Hidden);
        }
        let (texture, outdated) = match self.surface.get_current_texture() {
            Current::Success(texture) => (texture, false),
            Current::Suboptimal(texture) => (texture, true),
            Current::Timeout | Current::Occluded => return Ok(Painted::Hidden),
            Current::Outdated => {
                self.configure();
                return Ok(Painted::Again);
            }
            Current::Lost | Current::Validation => {
                self.gpu.check()?;
                self.lose_surface()?;
                return Ok(Painted::Again);
            }
        };
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let commands = self.commands(painting, &view, |_| {});
        self.gpu.queue.submit(commands);
        self.window.pre_present_notify();
        self.gpu.queue.present(texture);
        if outdated {
            self.configure();
        }
        self.gpu.check()?;
        Ok(Painted::Done)
    }

    /// Makes another surface, as after the loss of the present one.
    ///
    /// # Errors
    /// If the window system gives none.
    pub fn lose_surface(&mut self) -> Result<(), GpuError> {
        self.surface = surface_of(&self.gpu.instance, &self.window)?;
        self.configure();
        Ok(())
    }

    pub(super) fn capture(&mut self, painting: &Painting<'_>) -> Result<([u32; 2], Vec<u32>), GpuError> {
        let size @ [width, height] = [self.config.width.max(1), self.config.height.max(1)];
        let row_bytes = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let (texture, staging) = pollster::block_on(self.gpu.guarded(|| {
            let texture = self.gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("capture"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: self.config.format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            });
            let staging = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("capture"),
                size: u64::from(row_bytes) * u64::from(height),
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            (texture, staging)
        }))?;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let commands = self.commands(painting, &view, |encoder| {
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
            encoder.copy_texture_to_buffer(
                texture.as_image_copy(),
                wgpu::TexelCopyBufferInfo { buffer: &staging, layout },
                texture.size(),
            );
        });
        let submission = self.gpu.queue.submit(commands);
        let bytes = self.gpu.map(&staging, submission)?;
        let is_bgra =
            matches!(self.config.format, wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb);
        let rows = bytes.elements::<u32>().chunks_exact(row_bytes as usize / 4);
        let texels = rows.flat_map(|row| &row[..width as usize]).map(|texel| match is_bgra {
            true => (texel & 0xff00) | (texel >> 16 & 0xff) | (texel & 0xff) << 16 | 0xff00_0000,
            false => texel | 0xff00_0000,
        });
        Ok((size, texels.collect()))
    }

    /// The commands that draw into a target, and what comes after them.
    fn commands(
        &mut self,
        painting: &Painting<'_>,
        target: &wgpu::TextureView,
        after: impl FnOnce(&mut wgpu::CommandEncoder),
    ) -> Vec<wgpu::CommandBuffer> {
        let size = [self.config.width, self.config.height];
        let picture = self.picture(painting);
        let mut encoder =
            self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("window") });
        let screen = ScreenDescriptor { size_in_pixels: size, pixels_per_point: painting.pixels_per_point };
        let mut commands =
            self.egui.update_buffers(&self.gpu.device, &self.gpu.queue, &mut encoder, painting.primitives, &screen);
        let mut pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("window"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: target,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            })
            .forget_lifetime();
        let [left, top, width, height] = painting.scissor(size);
        if let Some(picture) = picture.filter(|_| width > 0 && height > 0) {
            pass.set_scissor_rect(left, top, width, height);
            pass.set_pipeline(&self.present);
            pass.set_bind_group(0, &picture, &[]);
            pass.draw(0..3, 0..1);
            pass.set_scissor_rect(0, 0, size[0], size[1]);
        }
        self.egui.render(&mut pass, painting.primitives, &screen);
        drop(pass);
        after(&mut encoder);
        commands.push(encoder.finish());
        commands
    }

    /// The bindings of `present` for the picture, if there is one.
    fn picture(&mut self, painting: &Painting<'_>) -> Option<wgpu::BindGroup> {
        let window = painting.window(self.config.format.is_srgb())?;
        let (left, right) = painting.pictures()?;
        let (left, right) = (self.buffer(0, left), self.buffer(1, right));
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&window));
        let buffers = [&self.uniform, &left, &right];
        let entries: Vec<_> = buffers
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        Some(self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("present"),
            layout: &self.layout,
            entries: &entries,
        }))
    }

    /// The buffer of a picture: the executor's own, or a copy of the host's.
    fn buffer(&mut self, slot: usize, shown: &Shown) -> wgpu::Buffer {
        let pixels = match &shown.pixels {
            Pixels::Gpu(buffer) => return buffer.clone(),
            Pixels::Host(pixels) => pixels,
        };
        let bytes: &[u8] = bytemuck::cast_slice(pixels);
        if let Some((copied, buffer)) = &mut self.uploads[slot] {
            if Arc::ptr_eq(copied, pixels) {
                return buffer.clone();
            }
            if buffer.size() == bytes.len() as u64 {
                self.gpu.queue.write_buffer(buffer, 0, bytes);
                *copied = Arc::clone(pixels);
                return buffer.clone();
            }
        }
        let buffer = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture of the host"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.gpu.queue.write_buffer(&buffer, 0, bytes);
        self.uploads[slot] = Some((Arc::clone(pixels), buffer.clone()));
        buffer
    }
}

fn surface_of(instance: &wgpu::Instance, window: &Arc<Window>) -> Result<wgpu::Surface<'static>, GpuError> {
    instance.create_surface(Arc::clone(window)).map_err(|error| {
        // Without any driver, the reason is that, and not the window.
        match pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all())).is_empty() {
            true => GpuError::NoAdapter,
            false => GpuError::Surface(error.to_string()),
        }
    })
}
