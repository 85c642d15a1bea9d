//! What keys and buttons ask for.

use glam::UVec2;

use super::{Order, State};
use crate::{
    output::{Destination, atomic},
    settings::{Preset, Settings},
    technique::Technique,
    view::{
        buffers::View,
        keys::Action,
        navigation::camera_json,
        save,
        want::Compare,
        worker::{Job, Purpose},
    },
};

impl State {
    /// The settings as a command line.
    pub fn command_line(&self) -> String {
        let mut words = vec!["weir".to_owned(), "view".to_owned(), quoted(&self.choice.scene)];
        if let Some(path) = &self.choice.environment {
            words.extend(["--environment".to_owned(), quoted(&path.to_string_lossy())]);
        }
        let default = Settings::default().describe();
        let changed = self.settings.describe().into_iter().zip(default).filter(|(now, default)| now != default);
        words.extend(changed.map(|((key, value), _)| format!("--set {key}={value}")));
        if self.scattered > 0 {
            words.push(format!("--added-lights {}", self.scattered));
        }
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
        // Lights that were added or changed are not there.
        let rest = Self::new(self.choice.clone(), self.settings.clone()).command_line();
        let rest = rest.strip_prefix("weir view ").unwrap_or_default();
        format!(
            "weir pixel {},{} {rest} --seed {} --size {width}x{height} --frame {frame} --integrator {integrator} --camera {}",
            px.x,
            px.y,
            self.seed,
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
