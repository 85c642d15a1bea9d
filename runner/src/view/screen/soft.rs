//! The window drawn by the host, where no GPU answers: the same picture by the same pass, the same panels.

use std::{num::NonZeroU32, sync::Arc};

use glam::Vec2;
use rayon::prelude::*;
use softbuffer::{Context, Surface};
use winit::window::Window;

use super::{Painted, Painting, rasterizer::Rasterizer};
use crate::{
    executor::gpu::GpuError,
    view::engine::{Pixels, Shown},
};

/// A window's pixels.
pub struct SoftScreen {
    surface: Surface<Arc<Window>, Arc<Window>>,
    size: [u32; 2],
}

impl SoftScreen {
    /// A screen in the window.
    ///
    /// # Errors
    /// If the window system has none to give, in its words.
    pub fn new(window: &Arc<Window>) -> Result<Self, String> {
        let context = Context::new(Arc::clone(window)).map_err(|error| error.to_string())?;
        let surface = Surface::new(&context, Arc::clone(window)).map_err(|error| error.to_string())?;
        let size = window.inner_size();
        Ok(Self { surface, size: [size.width, size.height] })
    }

    pub(super) fn resize(&mut self, size: [u32; 2]) {
        self.size = size;
    }

    pub(super) fn paint(&mut self, painting: &Painting<'_>) -> Result<Painted, GpuError> {
        self.paint_surface(painting).map_err(|error| GpuError::Surface(error.to_string()))
    }

    fn paint_surface(&mut self, painting: &Painting<'_>) -> Result<Painted, softbuffer::SoftBufferError> {
        let [Some(width), Some(height)] = self.size.map(NonZeroU32::new) else { return Ok(Painted::Hidden) };
        self.surface.resize(width, height)?;
        let (_, pixels) = self.capture(painting);
        let mut buffer = self.surface.buffer_mut()?;
        for (out, pixel) in buffer.iter_mut().zip(pixels) {
            // Blue is in the low byte there.
            *out = (pixel & 0xff00) | (pixel >> 16 & 0xff) | (pixel & 0xff) << 16;
        }
        buffer.present()?;
        Ok(Painted::Done)
    }

    pub(super) fn capture(&self, painting: &Painting<'_>) -> ([u32; 2], Vec<u32>) {
        let mut pixels = vec![0xff00_0000; (self.size[0] * self.size[1]) as usize];
        picture(painting, self.size, &mut pixels);
        Rasterizer(painting.all_textures).draw(painting.primitives, painting.pixels_per_point, self.size, &mut pixels);
        (self.size, pixels)
    }
}

/// The picture, by the function that a GPU would run.
fn picture(painting: &Painting<'_>, size: [u32; 2], pixels: &mut [u32]) {
    let (Some(window), Some((left, right))) = (painting.window(false), painting.pictures()) else { return };
    let (Some(left), Some(right)) = (host(left), host(right)) else { return };
    let [x0, y0, width, height] = painting.scissor(size);
    let rows = pixels.par_chunks_mut(size[0].max(1) as usize).enumerate().skip(y0 as usize).take(height as usize);
    rows.for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate().skip(x0 as usize).take(width as usize) {
            let target = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let color = weir_shader::present::present(target, &window, left, right) * 255.0 + 0.5;
            let [red, green, blue, _] = color.to_array().map(|channel| channel as u32);
            *pixel = red | green << 8 | blue << 16 | 0xff00_0000;
        }
    });
}

fn host(shown: &Shown) -> Option<&[u32]> {
    match &shown.pixels {
        Pixels::Host(pixels) => Some(pixels),
        Pixels::Gpu(_) => None,
    }
}
