//! What draws and what computes: at the start, and after failures.

use std::sync::Arc;

use winit::window::Window;

use super::{App, HOST_SCALE, MOST_LOSSES, Processor, ViewError};
use crate::{
    executor::gpu::{Gpu, GpuError},
    view::{
        screen::{Painting, Screen, SoftScreen},
        worker::Job,
    },
};

impl App {
    /// A screen on a GPU, or without one on the host; and the thread is told where to compute.
    pub(super) fn make_screen(&mut self, window: &Arc<Window>) -> Result<(), ViewError> {
        // The window can have one surface at a time.
        self.screen = None;
        let wanted = self.losses < MOST_LOSSES;
        let made = if wanted { Screen::on_gpu(window, &self.adapter) } else { Err(GpuError::NoAdapter) };
        let (screen, gpu) = match made {
            Ok((screen, gpu)) => (screen, Some(gpu)),
            Err(error) => {
                let screen = SoftScreen::new(window).map_err(|e| ViewError::NoScreen(format!("{error}; {e}")))?;
                if wanted {
                    self.state.fail(format!("{error}\nThe CPU draws the window."));
                }
                (Screen::Soft(Box::new(screen)), None)
            }
        };
        self.screen = Some(screen);
        self.place(gpu);
        Ok(())
    }

    /// Settles where pictures are computed.
    pub(super) fn place(&mut self, gpu: Option<Gpu>) {
        let in_software = gpu.as_ref().is_some_and(|gpu| gpu.facts.kind == "software");
        let computes = match (self.processor, &gpu) {
            (Processor::Cpu, _) | (_, None) => false,
            (Processor::Gpu, Some(_)) => true,
            (Processor::Auto, Some(_)) => !in_software,
        };
        self.state.device = match &gpu {
            Some(gpu) if computes => gpu.facts.name.clone(),
            Some(gpu) => format!("CPU (window: {})", gpu.facts.name),
            None => "CPU (no GPU)".to_owned(),
        };
        match self.scale {
            Some(scale) => self.state.render_scale = scale,
            None if computes => self.state.render_scale = 1.0,
            None => {
                self.state.render_scale = HOST_SCALE;
                self.state.say(format!("The CPU computes the picture, at {:.0} % of its size.", 100.0 * HOST_SCALE));
            }
        }
        self.worker.send(Job::Use(gpu.filter(|_| computes)));
    }

    /// After a failure of the GPU: another device, or the host.
    pub(super) fn recover(&mut self, error: &GpuError) {
        let Some(window) = self.live.as_ref().map(|live| Arc::clone(&live.window)) else { return };
        match error {
            GpuError::OutOfMemory(_) | GpuError::TooLarge { .. } | GpuError::TooManyBuffers { .. } => {
                self.state.fail(format!("{error}\nThe CPU computes from now on."));
                self.processor = Processor::Cpu;
                self.place(self.gpu());
                return;
            }
            _ => self.losses += 1,
        }
        let next = if self.losses < MOST_LOSSES { "It is opened again." } else { "The CPU goes on." };
        self.state.fail(format!("{error}\n{next}"));
        // Pictures in the lost GPU's memory are gone.
        self.state.frames = None;
        if let Err(error) = self.make_screen(&window) {
            self.end = Some(Err(error));
            return;
        }
        let size = window.inner_size();
        if let Some(screen) = &mut self.screen {
            screen.resize([size.width, size.height]);
            // What egui has told the old screen, the new one does not know.
            let nothing = Painting::nothing(&self.textures);
            let all = self.textures.all();
            if let Err(error) = screen.paint(&Painting { textures: &all, ..nothing }) {
                tracing::warn!("{error}");
            }
        }
    }

    pub(super) fn gpu(&self) -> Option<Gpu> {
        match &self.screen {
            Some(Screen::Gpu(screen)) => Some(screen.gpu().clone()),
            _ => None,
        }
    }
}
