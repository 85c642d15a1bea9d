//! What a frame comes to: pictures, and what is known about them.

use std::{sync::Arc, time::Duration};

use glam::UVec2;
use weir_shared::{moments::Moments, reservoir::Reservoir, surface::Surface};

use crate::{budget::Counts, faults::Faults, scene::bounds::Bounds, technique::Technique};

/// Where the pixels of a picture are: 8-bit sRGB, red in the low byte.
#[derive(Clone)]
pub enum Pixels {
    /// In a buffer of the GPU.
    Gpu(wgpu::Buffer),
    /// On the host.
    Host(Arc<Vec<u32>>),
}

/// A picture, ready to be shown.
#[derive(Clone)]
pub struct Shown {
    /// Size.
    pub size: [u32; 2],
    /// Its pixels.
    pub pixels: Pixels,
}

/// What the frame of a technique is made of: a pass or a reason why not.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Passes in order, each with what it reads and writes.
    pub steps: Vec<Scheduled>,
    /// Passes that are left out, and why.
    pub left_out: Vec<(&'static str, String)>,
    /// Bytes of the frame's buffers.
    pub frame_bytes: u64,
}

/// A pass of a schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Scheduled {
    /// Its name.
    pub pass: &'static str,
    /// Resources that it reads; the scene's are left out.
    pub reads: Vec<&'static str>,
    /// Resources that it writes.
    pub writes: Vec<&'static str>,
}

/// A frame, and what is known about it.
#[derive(Clone)]
pub struct Frames {
    /// The picture.
    pub shown: Shown,
    /// What it is compared with.
    pub other: Option<Shown>,
    /// How it was made.
    pub technique: Technique,
    /// Samples of each pixel that were averaged.
    pub samples: u32,
    /// Estimated error of the picture, in percent, while it stands still.
    pub error_percent: Option<f32>,
    /// Time of each pass, where it is known.
    pub times: Vec<(&'static str, Duration)>,
    /// The schedule.
    pub schedule: Arc<Schedule>,
    /// Exposure that it was shown with.
    pub exposure: f32,
    /// Time of the animation, in seconds.
    pub time_s: f32,
    /// Rays of each pixel, at most; those at edges have more camera rays.
    pub rays: u32,
    /// Samples of the reference, where there is one.
    pub reference_samples: u64,
    /// The pixel that is inspected.
    pub inspected: Option<Inspected>,
    /// Weights that passes have dropped so far; known of stills, from time to time.
    pub faults: Option<Faults>,
    /// What has become of the time budget, where there is one.
    pub budget: Option<BudgetFacts>,
}

/// A time budget and what it has come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BudgetFacts {
    /// The time that the frame took.
    pub frame: Duration,
    /// The rung of the settings that made it, from 0.
    pub level: usize,
    /// Frames so far, and those within the budget.
    pub counts: Counts,
    /// Whether even the cheapest settings take longer.
    pub out_of_reach: bool,
}

/// A pixel, as the buffers have it.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspected {
    /// Which.
    pub px: UVec2,
    /// What it sees.
    pub surface: Surface,
    /// What it holds at the end of the chain.
    pub reservoir: Reservoir,
    /// Its mean and variance.
    pub moments: Moments,
    /// How far its surface has moved on the screen, in pixels.
    pub motion: Option<glam::Vec2>,
    /// The light that it holds, in words.
    pub light: String,
    /// Number of the frame.
    pub frame: u32,
}

/// What is known of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneFacts {
    /// Its name.
    pub name: String,
    /// Triangles over all instances.
    pub triangles: u64,
    /// Emissive ones.
    pub lights: u64,
    /// Instances.
    pub instances: usize,
    /// Whether anything moves over time.
    pub moves: bool,
    /// Whether there is an environment map.
    pub environment: bool,
    /// Bytes of its buffers.
    pub bytes: u64,
    /// Its box.
    pub bounds: Option<Bounds>,
}
