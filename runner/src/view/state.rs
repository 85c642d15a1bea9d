//! Everything that the panels change, and what they show.

use std::{path::PathBuf, sync::Arc};

use glam::UVec2;

use super::{
    buffers::View,
    engine::{Frames, SceneFacts},
    keys::Action,
    lights::Edit,
    navigation::{Rig, camera_json},
    pick::Picked,
    save,
    stats::Stats,
    want::{Compare, Want},
    worker::{Job, News, Purpose},
};
use crate::{
    output::{Destination, atomic},
    scene::{Camera, builtin, choice::Choice},
    settings::{Preset, Settings},
    technique::{Technique, ToneCurve},
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
            }
            News::Changed(facts) => self.facts = facts,
            News::Failed(reason) => self.fail(reason),
            News::GpuFailed(error) => self.fail(error.to_string()),
            News::Saved(path) => self.say(format!("saved {}", path.display())),
            News::Found(found, purpose) => self.found(found, purpose),
            News::LightTaken(instance) => self.edit(instance),
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

    /// The settings as a command line.
    pub fn command_line(&self) -> String {
        let mut words = vec!["weir".to_owned(), "view".to_owned(), quoted(&self.choice.scene)];
        if let Some(path) = &self.choice.environment {
            words.extend(["--environment".to_owned(), quoted(&path.to_string_lossy())]);
        }
        let default = Settings::default().describe();
        let changed = self.settings.describe().into_iter().zip(default).filter(|(now, default)| now != default);
        words.extend(changed.map(|((key, value), _)| format!("--set {key}={value}")));
        if self.seed != 0 {
            words.push(format!("--seed {}", self.seed));
        }
        words.join(" ")
    }

    /// The command that runs a pixel on the CPU.
    pub fn replay_command(&self, px: UVec2) -> String {
        let camera = camera_json(self.rig.camera).split_whitespace().collect::<Vec<_>>().join(" ");
        let [width, height] = self.picture_size();
        let (frame, integrator) = self.frames.as_ref().map_or((0, "restir"), |frames| {
            let frame = frames.inspected.as_ref().map_or(0, |inspected| inspected.frame);
            (frame, if frames.technique == Technique::RealTime { "restir-temporal" } else { "restir" })
        });
        let rest = self.command_line();
        let rest = rest.strip_prefix("weir view ").unwrap_or_default();
        format!(
            "weir pixel {},{} {rest} --size {width}x{height} --frame {frame} --integrator {integrator} --camera {}",
            px.x,
            px.y,
            quoted(&camera)
        )
    }

    /// Does what a key asks for.
    pub fn act(&mut self, action: Action) {
        let presets = Preset::ALL;
        match action {
            Action::Help => self.help = !self.help,
            Action::Panels => self.panels = !self.panels,
            Action::Open => self.orders.push(Order::OpenDialog),
            Action::Reload => self.jobs.push(Job::Open(self.choice.clone())),
            Action::ScreenshotPng => self.screenshot("png"),
            Action::ScreenshotExr => self.screenshot("exr"),
            Action::Record => self.record(),
            Action::SaveSettings => self.orders.push(Order::SaveSettings),
            Action::CopyCommand => self.orders.push(Order::Copy(self.command_line())),
            Action::CopyCamera => self.orders.push(Order::Copy(camera_json(self.rig.camera))),
            Action::FullScreen => self.set_full_screen(!self.full_screen),
            Action::Leave if self.help => self.help = false,
            Action::Leave => self.set_full_screen(false),
            Action::Quit => self.orders.push(Order::Quit),
            Action::Pause => self.playing = !self.playing,
            Action::Step => {
                self.playing = false;
                let step = self.settings.time_step_s;
                self.time_s += if step > 0.0 { step } else { 1.0 / 30.0 };
            }
            Action::Slower => self.speed = (self.speed / 2.0).max(1.0 / 64.0),
            Action::Faster => self.speed = (self.speed * 2.0).min(64.0),
            Action::FrameAll => {
                if let Some(bounds) = self.facts.bounds {
                    self.rig.frame(bounds);
                }
            }
            Action::ResetCamera => self.rig.reset(),
            Action::Focus => self.jobs.extend(self.pointer.map(|px| Job::Pick(px, Purpose::Focus))),
            Action::GoTo(number) => {
                if let Some(camera) = self.bookmarks[usize::from(number) - 1] {
                    self.rig.go(camera);
                }
            }
            Action::Store(number) => {
                self.bookmarks[usize::from(number) - 1] = Some(self.rig.camera);
                self.say(format!("camera {number} stored"));
            }
            Action::NextView => self.view = self.view.step(true),
            Action::PreviousView => self.view = self.view.step(false),
            Action::PlainView => self.view = View::Picture,
            Action::Compare => {
                self.compare = match self.compare {
                    Compare::Off => Compare::With(presets[0]),
                    Compare::With(preset) => {
                        let at = presets.iter().position(|p| *p == preset).unwrap_or(0);
                        presets.get(at + 1).map_or(Compare::Reference, |next| Compare::With(*next))
                    }
                    Compare::Reference => Compare::Off,
                };
            }
            Action::Preset => {
                let now = presets.iter().position(|preset| self.preset() == Some(*preset));
                let next = presets[now.map_or(0, |at| (at + 1) % presets.len())];
                self.set_knob("preset", next.name());
            }
            Action::Accumulate => self.accumulate = !self.accumulate,
            Action::Brighter => self.exposure_ev = (self.exposure_ev + 1.0 / 3.0).min(20.0),
            Action::Darker => self.exposure_ev = (self.exposure_ev - 1.0 / 3.0).max(-20.0),
            Action::AutoExposure => self.auto_exposure = !self.auto_exposure,
            Action::Vsync => self.vsync = !self.vsync,
            Action::Environment => self.environment = !self.environment,
            Action::Inspect => self.inspecting = !self.inspecting,
        }
    }

    /// The preset that the knobs are at.
    pub fn preset(&self) -> Option<Preset> {
        let knob = crate::settings::KNOBS.iter().find(|knob| knob.key == "preset")?;
        let name = knob.get(&self.settings);
        Preset::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// Sets a knob, unless it does not go together with the others.
    pub fn set_knob(&mut self, key: &str, value: &str) {
        let mut settings = self.settings.clone();
        match settings.apply(&format!("{key}={value}")).and_then(|()| settings.check()) {
            Ok(()) => self.settings = settings,
            Err(error) => self.fail(error.to_string()),
        }
    }

    fn set_full_screen(&mut self, wanted: bool) {
        if self.full_screen != wanted {
            self.full_screen = wanted;
            self.orders.push(Order::FullScreen(wanted));
        }
    }

    fn screenshot(&mut self, ending: &str) {
        let folder = save::folder();
        if let Err(error) = std::fs::create_dir_all(&folder) {
            self.fail(format!("cannot create the folder for pictures: {error}: {}", folder.display()));
            return;
        }
        self.jobs.push(Job::Save(save::free_name(&folder, &self.facts.name, self.view, ending)));
    }

    /// Writes the camera as JSON, beside the pictures.
    pub fn save_camera(&mut self) {
        let folder = save::folder();
        let path = save::free_name(&folder, &format!("{}_camera", self.facts.name), View::Picture, "json");
        let saved = std::fs::create_dir_all(&folder).map_err(|error| error.to_string()).and_then(|()| {
            let text = camera_json(self.rig.camera);
            atomic::write(&Destination::File(path.clone()), text.as_bytes()).map_err(|error| error.to_string())
        });
        match saved {
            Ok(()) => self.say(format!("saved {}; `--camera` reads it", path.display())),
            Err(reason) => self.fail(format!("cannot save the camera: {reason}")),
        }
    }

    fn record(&mut self) {
        self.recording = match self.recording.take() {
            Some(folder) => {
                self.say(format!("recorded to {}", folder.display()));
                None
            }
            None => {
                let folder = save::free_name(&save::folder(), &self.facts.name, View::Picture, "frames");
                self.say(format!("recording to {}", folder.display()));
                Some(folder)
            }
        };
        self.jobs.push(Job::Record(self.recording.clone()));
    }

    /// Names of the built-in scenes.
    pub fn gallery() -> impl Iterator<Item = (&'static str, &'static str)> {
        builtin::BUILTIN.iter().map(|scene| (scene.name, scene.description))
    }
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+:".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> State {
        State::new(Choice::new("cornell"), Settings::default())
    }

    #[test]
    fn the_command_line_makes_the_same_settings_again() {
        let mut state = state();
        state.choice.scene = "a scene's file.obj".to_owned();
        for (key, value) in [("preset", "quality"), ("candidates.count", "7"), ("scene.time", "2.5")] {
            state.set_knob(key, value);
        }
        let line = state.command_line();
        assert!(line.starts_with(r"weir view 'a scene'\''s file.obj' --set "), "{line}");
        let mut again = Settings::default();
        for assignment in line.split(" --set ").skip(1) {
            again.apply(assignment).expect("a knob");
        }
        assert_eq!(again, state.settings);
    }

    #[test]
    fn knobs_that_exclude_each_other_are_refused_with_a_message() {
        let mut state = state();
        let before = state.settings.clone();
        state.set_knob("reuse.mis", "balance");
        assert_eq!(state.settings, before);
        assert!(state.messages[0].is_error && state.messages[0].text.contains("rays=speed"));
    }

    #[test]
    fn files_are_taken_by_their_ending_and_others_refused_in_words() {
        let mut state = state();
        state.take_file("a/b.OBJ".into());
        state.take_file("night.hdr".into());
        assert!(matches!(&state.jobs[0], Job::Open(choice) if choice.scene == "a/b.OBJ"));
        assert!(matches!(&state.jobs[1], Job::Environment(path) if path.ends_with("night.hdr")));
        state.take_file("song.mp3".into());
        state.take_file("no/such/camera.json".into());
        assert_eq!((state.jobs.len(), state.messages.len()), (2, 2));
        assert!(state.messages[0].text.contains("song.mp3"));
    }

    #[test]
    fn keys_change_what_they_say() {
        let mut state = state();
        state.facts.moves = true;
        for action in [Action::Pause, Action::Step, Action::Store(3), Action::Help, Action::Brighter] {
            state.act(action);
        }
        assert!(!state.playing && state.time_s > 0.0 && state.help && state.exposure_ev > 0.3);
        assert_eq!(state.bookmarks[2], Some(state.rig.camera));
        state.rig.dolly(2.0);
        state.act(Action::GoTo(3));
        assert_eq!(state.bookmarks[2], Some(state.rig.camera));
        let mut seen = vec![state.compare];
        for _ in 0..6 {
            state.act(Action::Compare);
            seen.push(state.compare);
        }
        assert_eq!(seen[0], seen[6], "six comparisons come round");
        state.act(Action::Leave);
        assert!(!state.help);
    }

    #[test]
    fn presets_go_round() {
        let mut state = state();
        let first = state.preset();
        for _ in Preset::ALL {
            state.act(Action::Preset);
        }
        assert_eq!(state.preset(), first);
    }

    #[test]
    fn the_picture_follows_the_window_and_the_scale() {
        let mut state = state();
        assert_eq!(state.want(), None, "there is nothing to show yet");
        (state.is_open, state.place, state.pixels_per_point) = (true, [10.0, 0.0, 300.0, 200.0], 2.0);
        state.render_scale = 0.25;
        assert_eq!(state.want().map(|want| want.size), Some([150, 100]));
    }

    #[test]
    fn a_picked_wall_is_let_go_and_a_picked_light_is_taken() {
        let mut state = state();
        let wall =
            Picked { position: glam::Vec3::ONE, instance: 0, corners_object: [glam::Vec3::ZERO; 3], emits: false };
        state.hear(News::Found(Some(wall), Purpose::Light));
        assert!(state.light.is_none() && state.jobs.is_empty());
        state.hear(News::Found(Some(Picked { emits: true, ..wall }), Purpose::Light));
        assert!(matches!(state.jobs[0], Job::TakeLight(_)));
        state.hear(News::LightTaken(4));
        state.hear(News::LightTaken(5));
        state.hear(News::LightTaken(4));
        assert_eq!((state.light, state.edits.len()), (Some(0), 2));
        state.hear(News::Found(Some(wall), Purpose::Focus));
        assert_eq!(state.rig.camera.target, glam::Vec3::ONE);
    }
}
