//! The window's contents: the picture, and the panels on it; drawn by a GPU, or by the host where there is none.

mod gpu;
mod rasterizer;
mod soft;
mod textures;

use std::sync::Arc;

use egui::{ClippedPrimitive, TexturesDelta};
use weir_shared::window::Window as PictureWindow;
use winit::window::Window;

use super::engine::{Frames, Shown};
use crate::executor::gpu::{AdapterChoice, Gpu, GpuError};

pub use gpu::GpuScreen;
pub use soft::SoftScreen;
pub use textures::Textures;

/// What to draw.
pub struct Painting<'a> {
    /// The picture, and its number.
    pub frames: Option<(&'a Frames, u64)>,
    /// Where it lies: left, top, width and height in pixels of the window.
    pub place: [f32; 4],
    /// Where what it is compared with begins, as a share of the width.
    pub divider: f32,
    /// Whether colours blend between pixels.
    pub smooth: bool,
    /// Panels.
    pub primitives: &'a [ClippedPrimitive],
    /// What has changed of egui's textures.
    pub textures: &'a TexturesDelta,
    /// All of them, with those changes.
    pub all_textures: &'a Textures,
    /// Scale of the screen.
    pub pixels_per_point: f32,
}

impl<'a> Painting<'a> {
    /// An empty window.
    pub fn nothing(all_textures: &'a Textures) -> Self {
        Self {
            frames: None,
            place: [0.0; 4],
            divider: 0.0,
            smooth: false,
            primitives: &[],
            textures: all_textures.none(),
            all_textures,
            pixels_per_point: 1.0,
        }
    }

    /// The picture that is shown, and what lies right of the divider.
    fn pictures(&self) -> Option<(&Shown, &Shown)> {
        let (frames, _) = self.frames?;
        Some((&frames.shown, frames.other.as_ref().unwrap_or(&frames.shown)))
    }

    /// The uniform of the pass that draws the picture.
    fn window(&self, linear_target: bool) -> Option<PictureWindow> {
        let (shown, _) = self.pictures()?;
        let compares = self.frames.is_some_and(|(frames, _)| frames.other.is_some());
        let [left, top, width, height] = self.place;
        Some(PictureWindow {
            width: shown.size[0],
            height: shown.size[1],
            left_px: left,
            top_px: top,
            step_x: shown.size[0] as f32 / width.max(1.0),
            step_y: shown.size[1] as f32 / height.max(1.0),
            divider_px: if compares { left + self.divider * width } else { 1e30 },
            smooth: u32::from(self.smooth),
            linear_target: u32::from(linear_target),
            divided: u32::from(compares),
            ..PictureWindow::default()
        })
    }

    /// The part of a window of the given size that the picture covers: left, top, width, height.
    fn scissor(&self, size: [u32; 2]) -> [u32; 4] {
        let [left, top, width, height] = self.place.map(|x| x.max(0.0).round() as u32);
        let (left, top) = (left.min(size[0]), top.min(size[1]));
        [left, top, width.min(size[0] - left), height.min(size[1] - top)]
    }
}

/// What draws the window.
pub enum Screen {
    /// A GPU.
    Gpu(Box<GpuScreen>),
    /// The host.
    Soft(Box<SoftScreen>),
}

/// What came of drawing.
#[derive(Debug, PartialEq)]
pub enum Painted {
    /// It is on the screen.
    Done,
    /// The window can't be seen.
    Hidden,
    /// The surface was lost and made anew; draw again.
    Again,
}

impl Screen {
    /// A screen on the best GPU that can show pictures in the window, or on the one that was chosen.
    ///
    /// # Errors
    /// If there is none, or its driver fails.
    pub fn on_gpu(window: &Arc<Window>, choice: &AdapterChoice) -> Result<(Self, Gpu), GpuError> {
        let screen = GpuScreen::new(window, choice)?;
        let gpu = screen.gpu().clone();
        Ok((Self::Gpu(Box::new(screen)), gpu))
    }

    /// Draws everything, and keeps textures for the next time.
    ///
    /// # Errors
    /// If the GPU fails: make another screen then.
    pub fn paint(&mut self, painting: &Painting<'_>) -> Result<Painted, GpuError> {
        match self {
            Self::Gpu(screen) => screen.paint(painting),
            Self::Soft(screen) => screen.paint(painting),
        }
    }

    /// The window's contents as 8-bit sRGB, red in the low byte, with its size; textures are those of the last painting.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn capture(&mut self, painting: &Painting<'_>) -> Result<([u32; 2], Vec<u32>), GpuError> {
        match self {
            Self::Gpu(screen) => screen.capture(painting),
            Self::Soft(screen) => Ok(screen.capture(painting)),
        }
    }

    /// Takes note of another size of the window.
    pub fn resize(&mut self, size: [u32; 2]) {
        match self {
            Self::Gpu(screen) => screen.resize(size),
            Self::Soft(screen) => screen.resize(size),
        }
    }

    /// Waits for the screen, or does not.
    pub fn set_vsync(&mut self, vsync: bool) {
        if let Self::Gpu(screen) = self {
            screen.set_vsync(vsync);
        }
    }

    /// Largest texture.
    pub fn max_texture_side(&self) -> usize {
        match self {
            Self::Gpu(screen) => screen.max_texture_side(),
            Self::Soft(_) => 8192,
        }
    }
}
