//! The pass that is drawn: the GPU against the host.

use weir::executor::gpu::Gpu;
use weir_shared::window::Window;
use weir_tests::gpu_or_skip;

/// A picture on a larger target, wiped by another one: what the GPU draws, and the same function on the host.
#[test]
fn what_is_drawn_on_the_gpu_is_what_the_host_says() {
    const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
    let Some(gpu) = gpu_or_skip("what_is_drawn_on_the_gpu_is_what_the_host_says") else { return };
    let [width, height] = [64_u32, 40];
    let pictures: [Vec<u32>; 2] =
        [0x9e37_79b1_u32, 0x85eb_ca6b].map(|odd| (0..16 * 10).map(|i: u32| odd.wrapping_mul(i + 1)).collect());
    let draw = weir_shader::DRAWS.iter().find(|draw| draw.name == "present").expect("the table has it");
    let (layout, pipeline) = pollster::block_on(gpu.draw_pipeline(draw, FORMAT)).expect("it compiles");
    for (smooth, divided) in [(1, 1), (0, 0)] {
        let window = Window {
            width: 16,
            height: 10,
            left_px: 4.0,
            top_px: 3.0,
            step_x: 16.0 / 50.0,
            step_y: 10.0 / 30.0,
            divider_px: 30.5,
            smooth,
            divided,
            ..Window::default()
        };
        let drawn = drawn(&gpu, &layout, &pipeline, &window, &pictures, [width, height]);
        let mut most = 0;
        for (i, pixel) in drawn.into_iter().enumerate() {
            let target = glam::Vec2::new((i as u32 % width) as f32 + 0.5, (i as u32 / width) as f32 + 0.5);
            let expected = weir_shader::present::present(target, &window, &pictures[0], &pictures[1]);
            for (channel, value) in expected.to_array().into_iter().enumerate() {
                most = most.max((pixel >> (8 * channel) & 0xff).abs_diff((value * 255.0 + 0.5) as u32));
            }
        }
        assert!(most <= 1, "smooth {smooth}: {most} of 255 apart");
    }
}

/// One triangle over a target of the given size, as 8-bit colours.
fn drawn(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    pipeline: &wgpu::RenderPipeline,
    window: &Window,
    pictures: &[Vec<u32>; 2],
    [width, height]: [u32; 2],
) -> Vec<u32> {
    use wgpu::util::DeviceExt;
    let device = &gpu.device;
    let filled = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let buffers = [
        filled(bytemuck::bytes_of(window), wgpu::BufferUsages::UNIFORM),
        filled(bytemuck::cast_slice(&pictures[0]), wgpu::BufferUsages::STORAGE),
        filled(bytemuck::cast_slice(&pictures[1]), wgpu::BufferUsages::STORAGE),
    ];
    let entries: Vec<_> = buffers
        .iter()
        .zip(0..)
        .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries });
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let staging = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(4 * width * height),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations::default(),
        })],
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.draw(0..3, 0..1);
    drop(pass);
    // Rows of 64 pixels are as long as copies want them.
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
    let copy = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), copy, texture.size());
    let submission = gpu.queue.submit([encoder.finish()]);
    gpu.map(&staging, submission).expect("it answers").elements().to_vec()
}
