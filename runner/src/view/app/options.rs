//! How the viewer starts, and why it may not.

use std::path::PathBuf;

use thiserror::Error;

use super::super::{script::Event, state::State};
use crate::{
    executor::gpu::AdapterChoice,
    exit::{Exit, HasExit},
    scene::Camera,
};

/// Where to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// On a GPU that is made of hardware, else on the host.
    Auto,
    /// On a GPU, in software if there is no other.
    Gpu,
    /// On the host.
    Cpu,
}

/// How the viewer starts.
pub struct Options {
    /// Scene, knobs and all that panels change.
    pub state: State,
    /// A camera in place of the scene's.
    pub camera: Option<Camera>,
    /// Which GPU.
    pub adapter: AdapterChoice,
    /// Where to compute.
    pub processor: Processor,
    /// Pixels of the picture to one of the window; by what computes, if not given.
    pub scale: Option<f32>,
    /// Size of the window, in pixels.
    pub size: [u32; 2],
    /// Ends after so many pictures.
    pub frames: Option<u32>,
    /// The window's contents at the end.
    pub screenshot: Option<PathBuf>,
    /// Every picture into a folder.
    pub record: Option<PathBuf>,
    /// Events in place of those of a person.
    pub script: Vec<Event>,
}

/// Why the viewer did not start, or had to end.
#[derive(Debug, Error)]
pub enum ViewError {
    /// There is no display.
    #[error("there is no display to open a window on ({0}); `weir render` needs none")]
    NoDisplay(String),
    /// There is no window.
    #[error("the window system gives no window: {0}")]
    NoWindow(String),
    /// Neither a GPU nor the host can draw.
    #[error("nothing can draw in the window: {0}")]
    NoScreen(String),
    /// The script can't go on.
    #[error("{0}")]
    Script(String),
    /// The thread that computes has died.
    #[error("the thread that computes pictures has ended; what it said is above")]
    Thread,
}

impl HasExit for ViewError {
    fn exit(&self) -> Exit {
        match self {
            Self::NoDisplay(_) | Self::NoWindow(_) | Self::NoScreen(_) => Exit::Unavailable,
            Self::Script(_) => Exit::CheckFailed,
            Self::Thread => Exit::Internal,
        }
    }
}
