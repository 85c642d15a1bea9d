//! What panels and scripts have the window do.

use std::time::{Duration, Instant};

use winit::{dpi::PhysicalSize, window::Fullscreen};

use super::{App, ViewError, Wake};
use crate::view::{
    driver::{Command, Surroundings},
    screen::Screen,
    state::Order,
    stored,
};

/// A file dialog that has ended this soon has not been there.
const NO_DIALOG_WITHIN: Duration = Duration::from_millis(500);

impl App {
    /// Does what panels and keys have asked for.
    pub(super) fn follow_orders(&mut self) {
        for job in self.state.jobs.drain(..) {
            self.worker.send(job);
        }
        for order in std::mem::take(&mut self.state.orders) {
            match order {
                Order::OpenDialog => self.dialog(),
                Order::Copy(text) => self.copy(text),
                Order::Quit => self.end = Some(Ok(())),
                Order::FullScreen(wanted) => {
                    if let Some(live) = &self.live {
                        live.window.set_fullscreen(wanted.then_some(Fullscreen::Borderless(None)));
                    }
                }
                Order::SaveSettings => {
                    let saved = stored::path().and_then(|path| stored::save(&self.state, &path).map(|()| path));
                    match saved {
                        Ok(path) => self.state.say(format!("settings saved to {}", path.display())),
                        Err(error) => self.state.fail(error.to_string()),
                    }
                }
                Order::Take(path) => match stored::load(&mut self.state, &path) {
                    Ok(refused) => refused.into_iter().for_each(|reason| self.state.fail(reason)),
                    Err(error) => self.state.fail(error.to_string()),
                },
            }
        }
    }

    pub(super) fn dialog(&self) {
        let proxy = self.proxy.clone();
        let dialog = rfd::AsyncFileDialog::new()
            .add_filter("scenes, environments, cameras, settings", &["obj", "hdr", "exr", "json", "toml"])
            .pick_file();
        // It stays open for as long as the person likes.
        let waiting = std::thread::Builder::new().name("file dialog".to_owned()).spawn(move || {
            let start = Instant::now();
            match pollster::block_on(dialog) {
                Some(file) => drop(proxy.send_event(Wake::Chosen(file.path().to_owned()))),
                // Nobody closes a dialog as fast as one fails to open.
                None if start.elapsed() < NO_DIALOG_WITHIN => drop(proxy.send_event(Wake::NoDialog)),
                None => {}
            }
        });
        drop(waiting);
    }

    pub(super) fn copy(&mut self, text: String) {
        // A person without a clipboard still gets the text.
        match arboard::Clipboard::new().and_then(|mut clipboard| clipboard.set_text(text.clone())) {
            Ok(()) => self.state.say(format!("copied: {text}")),
            Err(error) => self.state.fail(format!("the clipboard takes nothing ({error}): {text}")),
        }
    }

    /// The next step of the script; its input goes to egui.
    pub(super) fn drive(&mut self) {
        if self.driver.is_done() || !self.state.is_open {
            return;
        }
        let [left, top, width, height] = self.state.place;
        let find = |name: &str| self.tree.iter().find(|(known, _)| known == name).map(|(_, at)| *at);
        let says = |text: &str| self.state.messages.iter().any(|message| message.text.contains(text));
        let around = Surroundings {
            middle: egui::pos2(left + width / 2.0, top + height / 2.0),
            serial: self.serial,
            resting: self.state.resting,
            says: &says,
            find: &find,
        };
        let (input, command) = match self.driver.next(&around) {
            Ok(next) => next,
            Err(reason) => {
                self.end = Some(Err(ViewError::Script(reason)));
                return;
            }
        };
        let Some(live) = &mut self.live else { return };
        live.input.egui_input_mut().events.extend(input);
        match command {
            None => {}
            Some(Command::Resize(width, height)) => {
                // Where the size is set at once, no event follows.
                if let Some(size) = live.window.request_inner_size(PhysicalSize::new(width, height))
                    && let Some(screen) = &mut self.screen
                {
                    screen.resize([size.width, size.height]);
                }
            }
            Some(Command::Minimize(minimized)) => live.window.set_minimized(minimized),
            Some(Command::Drop(path)) => self.state.take_file(path),
            Some(Command::Screenshot(path)) => self.screenshot = Some(path),
            Some(Command::Lose) => {
                if let Some(gpu) = self.gpu() {
                    gpu.lose();
                }
            }
            Some(Command::LoseSurface) => {
                if let Some(Screen::Gpu(screen)) = &mut self.screen
                    && let Err(error) = screen.lose_surface()
                {
                    self.state.fail(error.to_string());
                }
            }
            Some(Command::Quit) => self.end = Some(Ok(())),
        }
    }
}

/// Widgets with a name, and the middle of each in points.
pub(super) fn named_widgets(tree: &egui::accesskit::TreeUpdate, pixels_per_point: f32) -> Vec<(String, egui::Pos2)> {
    let of = |(_, node): &(egui::accesskit::NodeId, egui::accesskit::Node)| {
        let (name, bounds) = (node.label()?, node.bounds()?);
        let middle = egui::pos2(((bounds.x0 + bounds.x1) / 2.0) as f32, ((bounds.y0 + bounds.y1) / 2.0) as f32);
        Some((name.to_owned(), egui::Pos2::ZERO + middle.to_vec2() / pixels_per_point))
    };
    tree.nodes.iter().filter_map(of).collect()
}
