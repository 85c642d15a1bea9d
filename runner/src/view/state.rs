//! Everything that the panels change, and what they show.

mod actions;

use std::{path::PathBuf, sync::Arc};

use glam::UVec2;

use super::{
    buffers::View,
    engine::{Frames, SceneFacts},
    lights::Edit,
    navigation::Rig,
    pick::Picked,
    stats::Stats,
    want::{Compare, Want},
    worker::{Job, News, Purpose},
};
use crate::{
    scene::{Camera, builtin, choice::Choice},
    settings::Settings,
    skips::Cost,
    technique::ToneCurve,
};

/// Something that the window has to do.
#[derive(Debug, PartialEq)]
pub enum Order {
    /// The file dialog.
    OpenDialog,
    /// Text to the clipboard.
    Copy(String),
    /// Full screen, or not.
    FullScreen(bool),
    /// The end.
    Quit,
    /// Writes the settings.
    SaveSettings,
    /// A file was dropped or chosen.
    Take(PathBuf),
}

/// A message to the person at the window.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// What it says.
    pub text: String,
    /// Whether something went wrong; such messages stay until they are closed.
    pub is_error: bool,
    /// When it came, in seconds; none until it is first seen.
    pub since_s: Option<f64>,
}

/// The state of the window.
pub struct State {
    /// The camera.
    pub rig: Rig,
    /// Which scene.
    pub choice: Choice,
    /// What is known of it.
    pub facts: SceneFacts,
    /// Whether one is there.
    pub is_open: bool,
    /// Knobs.
    pub settings: Settings,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Tone curve.
    pub curve: ToneCurve,
    /// Exposure in stops.
    pub exposure_ev: f32,
    /// Whether the exposure follows the picture.
    pub auto_exposure: bool,
    /// Whether what stands still is averaged.
    pub accumulate: bool,
    /// Error at which a still is good enough, in percent.
    pub goal_percent: f32,
    /// Whether knobs give way for a time budget.
    pub budgeted: bool,
    /// That budget, in milliseconds.
    pub budget_ms: f32,
    /// Which buffer is shown.
    pub view: View,
    /// With what the picture is compared.
    pub compare: Compare,
    /// Where that begins, as a share of the width.
    pub divider: f32,
    /// Whether the inspector is open.
    pub inspecting: bool,
    /// The pixel it looks into.
    pub inspect: Option<UVec2>,
    /// Lights that were changed.
    pub edits: Vec<Edit>,
    /// The one that is being changed: an index of `edits`.
    pub light: Option<usize>,
    /// Lights that were added.
    pub scattered: u32,
    /// Whether the environment shines.
    pub environment: bool,
    /// Its turn, in degrees.
    pub environment_rotation_deg: f32,
    /// Factor on its radiance.
    pub environment_scale: f32,
    /// Whether the animation runs.
    pub playing: bool,
    /// Its speed; 1 is real time.
    pub speed: f32,
    /// Where it is, in seconds.
    pub time_s: f32,
    /// Pixels of the picture to one of the window, in each direction.
    pub render_scale: f32,
    /// Whether colours blend between pixels of the picture.
    pub smooth: bool,
    /// Whether frames wait for the screen.
    pub vsync: bool,
    /// Cameras to come back to.
    pub bookmarks: [Option<Camera>; 9],
    /// Whether panels are shown.
    pub panels: bool,
    /// Whether the list of keys is shown.
    pub help: bool,
    /// Whether the window fills the screen.
    pub full_screen: bool,
    /// Where pictures are recorded to, if they are.
    pub recording: Option<PathBuf>,
    /// Messages.
    pub messages: Vec<Message>,
    /// Times.
    pub stats: Stats,
    /// The newest picture.
    pub frames: Option<Arc<Frames>>,
    /// What leaving work out saves, if it was measured, and with which knobs.
    pub costs: Option<(Settings, Vec<Cost>)>,
    /// Whether it is good enough and nothing is computed.
    pub resting: bool,
    /// What takes long just now.
    pub busy: Option<String>,
    /// What computes, in words.
    pub device: String,
    /// Where the picture lies, in points of the window: left, top, width, height.
    pub place: [f32; 4],
    /// Pixels of the window to a point.
    pub pixels_per_point: f32,
    /// The pixel of the picture under the pointer.
    pub pointer: Option<UVec2>,
    /// For the thread.
    pub jobs: Vec<Job>,
    /// For the window.
    pub orders: Vec<Order>,
}

impl State {
    /// As the program starts.
    pub fn new(choice: Choice, settings: Settings) -> Self {
        let home = Camera { origin: glam::Vec3::Z, target: glam::Vec3::ZERO, up: glam::Vec3::Y, vfov_deg: 45.0 };
        Self {
            rig: Rig::new(home, None),
            environment_rotation_deg: choice.environment_rotation_deg,
            environment_scale: choice.environment_scale,
            choice,
            facts: SceneFacts::default(),
            is_open: false,
            time_s: settings.time_s,
            settings,
            seed: 0,
            curve: ToneCurve::default(),
            exposure_ev: 0.0,
            auto_exposure: false,
            accumulate: true,
            goal_percent: 1.0,
            budgeted: false,
            budget_ms: 100.0,
            view: View::Picture,
            compare: Compare::Off,
            divider: 0.5,
            inspecting: false,
            inspect: None,
            edits: Vec::new(),
            light: None,
            scattered: 0,
            environment: true,
            playing: true,
            speed: 1.0,
            render_scale: 1.0,
            smooth: true,
            vsync: true,
            bookmarks: [None; 9],
            panels: true,
            help: false,
            full_screen: false,
            recording: None,
            messages: Vec::new(),
            stats: Stats::default(),
            costs: None,
            frames: None,
            resting: false,
            busy: None,
            device: String::new(),
            place: [0.0; 4],
            pixels_per_point: 1.0,
            pointer: None,
            jobs: Vec::new(),
            orders: Vec::new(),
        }
    }

    /// Says something.
    pub fn say(&mut self, text: impl Into<String>) {
        self.message(text.into(), false);
    }

    /// Says that something went wrong.
    pub fn fail(&mut self, text: impl Into<String>) {
        self.message(text.into(), true);
    }

    fn message(&mut self, text: String, is_error: bool) {
        // Also to stderr, where it can be read when the window is gone.
        if is_error {
            tracing::warn!("{text}");
        } else {
            tracing::info!("{text}");
        }
        self.messages.retain(|message| message.text != text);
        self.messages.push(Message { text, is_error, since_s: None });
        let excess = self.messages.len().saturating_sub(6);
        self.messages.drain(..excess);
    }

    /// Pixels of the picture.
    pub fn picture_size(&self) -> [u32; 2] {
        let scale = self.pixels_per_point * self.render_scale;
        [self.place[2], self.place[3]].map(|length| ((length * scale).round() as u32).clamp(1, 16_384))
    }

    /// What is to be shown; nothing before there is a place to show it.
    pub fn want(&self) -> Option<Want> {
        (self.place[2] >= 1.0 && self.place[3] >= 1.0 && self.is_open).then(|| Want {
            size: self.picture_size(),
            camera: self.rig.camera,
            settings: self.settings.clone(),
            seed: self.seed,
            curve: self.curve,
            exposure: self.exposure_ev.exp2(),
            auto_exposure: self.auto_exposure,
            time_s: self.time_s,
            accumulate: self.accumulate,
            goal_percent: self.goal_percent,
            budget_ms: self.budgeted.then_some(self.budget_ms),
            view: self.view,
            compare: self.compare,
            inspect: self.inspect.filter(|_| self.inspecting),
            edits: self.edits.clone(),
            scattered: self.scattered,
            environment: self.environment,
            environment_rotation_deg: self.environment_rotation_deg,
            environment_scale: self.environment_scale,
        })
    }

    /// Takes the animation on by so many seconds of the clock on the wall.
    pub fn advance(&mut self, seconds: f32) {
        if self.playing && self.facts.moves {
            self.time_s += seconds * self.speed;
        }
    }

    /// Opens another scene.
    pub fn open(&mut self, scene: impl Into<String>) {
        let choice = Choice { scene: scene.into(), ..self.choice.clone() };
        self.jobs.push(Job::Open(choice));
    }

    /// Takes a file by the ending of its name.
    pub fn take_file(&mut self, path: PathBuf) {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).unwrap_or_default();
        match ending.as_str() {
            "obj" => self.open(path.to_string_lossy().into_owned()),
            "hdr" | "exr" => self.jobs.push(Job::Environment(path)),
            "json" => match crate::scene::camera::load(&path) {
                Ok(camera) => self.rig.go(camera),
                Err(error) => self.fail(error.to_string()),
            },
            "toml" => self.orders.push(Order::Take(path)),
            _ => self.fail(format!(
                "{} is nothing that weir reads; drop an .obj, an environment (.hdr, .exr), a camera (.json) or settings \
                 (.toml)",
                path.display()
            )),
        }
    }

    /// Takes note of what the thread has done.
    pub fn hear(&mut self, news: News) {
        match news {
            News::Opened { facts, home, warnings, choice } => {
                let is_new = !self.is_open || self.choice.scene != choice.scene;
                if is_new {
                    self.rig = Rig::new(home, facts.bounds);
                    self.time_s = self.settings.time_s;
                }
                (self.edits, self.light, self.inspect) = (Vec::new(), None, None);
                self.is_open = true;
                self.say(format!("{}: {} triangles, {} of them lights", facts.name, facts.triangles, facts.lights));
                if facts.lights == 0 && !facts.environment {
                    self.fail(format!("{}: nothing emits light; only `Ke` and an environment map do", facts.name));
                }
                match &warnings[..] {
                    [] => {}
                    [only] => self.say(only.clone()),
                    [first, rest @ ..] => self.say(format!("{first}\n(and {} more)", rest.len())),
                }
                (self.facts, self.choice) = (facts, choice);
                self.costs = None;
            }
            News::Changed(facts) => {
                self.facts = facts;
                self.costs = None;
            }
            News::Failed(reason) => self.fail(reason),
            News::GpuFailed(error) => self.fail(error.to_string()),
            News::Saved(path) => self.say(format!("saved {}", path.display())),
            News::Found(found, purpose) => self.found(found, purpose),
            News::LightTaken(instance) => self.edit(instance),
            News::Measured { settings, costs } => self.costs = Some((*settings, costs)),
        }
    }

    fn found(&mut self, found: Option<Picked>, purpose: Purpose) {
        match (found, purpose) {
            (Some(picked), Purpose::Focus) => self.rig.focus(picked.position),
            (Some(picked), Purpose::Light) if picked.emits => self.jobs.push(Job::TakeLight(picked)),
            (_, Purpose::Light) => self.light = None,
            (None, Purpose::Focus) => {}
        }
    }

    /// Changes the light of an instance from now on.
    fn edit(&mut self, instance: u32) {
        let at = self.edits.iter().position(|edit| edit.instance == instance);
        self.light = Some(at.unwrap_or_else(|| {
            self.edits.push(Edit::new(instance));
            self.edits.len() - 1
        }));
    }

    /// Names of the built-in scenes.
    pub fn gallery() -> impl Iterator<Item = (&'static str, &'static str)> {
        builtin::BUILTIN.iter().map(|scene| (scene.name, scene.description))
    }
}

#[cfg(test)]
mod tests;
