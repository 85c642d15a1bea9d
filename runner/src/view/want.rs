//! What the window wants to see: made by the panels, read by the engine.

use glam::UVec2;

use super::{buffers::View, lights::Edit};
use crate::{
    scene::Camera,
    settings::{Preset, Settings},
    technique::ToneCurve,
};

/// What stands beside the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compare {
    /// Nothing.
    #[default]
    Off,
    /// The same by a preset.
    With(Preset),
    /// The running reference.
    Reference,
}

/// All that decides what the next frame is; the newest counts.
#[derive(Clone, Debug, PartialEq)]
pub struct Want {
    /// Pixels of the picture.
    pub size: [u32; 2],
    /// View.
    pub camera: Camera,
    /// Knobs.
    pub settings: Settings,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Tone curve.
    pub curve: ToneCurve,
    /// Factor on radiance, or with `auto_exposure` on what that finds.
    pub exposure: f32,
    /// Whether the exposure follows the picture.
    pub auto_exposure: bool,
    /// Time of the animation, in seconds.
    pub time_s: f32,
    /// Whether what stands still is averaged.
    pub accumulate: bool,
    /// Error at which the picture is good enough, in percent.
    pub goal_percent: f32,
    /// Time that a frame in real time may take, in milliseconds; knobs give way for it.
    pub budget_ms: Option<f32>,
    /// Which buffer.
    pub view: View,
    /// With what it is compared.
    pub compare: Compare,
    /// The pixel to look into.
    pub inspect: Option<UVec2>,
    /// Lights that were changed.
    pub edits: Vec<Edit>,
    /// Lights that were added.
    pub scattered: u32,
    /// Whether the environment shines.
    pub environment: bool,
    /// Its turn about the vertical, in degrees.
    pub environment_rotation_deg: f32,
    /// Factor on its radiance.
    pub environment_scale: f32,
}

impl Want {
    /// The picture by default settings as it is, without averaging, of a scene in which nothing was changed.
    pub fn plain(camera: Camera, size: [u32; 2]) -> Self {
        Self {
            size,
            camera,
            settings: Settings::default(),
            seed: 0,
            curve: ToneCurve::default(),
            exposure: 1.0,
            auto_exposure: false,
            time_s: 0.0,
            accumulate: false,
            goal_percent: 1.0,
            budget_ms: None,
            view: View::Picture,
            compare: Compare::Off,
            inspect: None,
            edits: Vec::new(),
            scattered: 0,
            environment: true,
            environment_rotation_deg: 0.0,
            environment_scale: 1.0,
        }
    }
}
