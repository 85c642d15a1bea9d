//! Runs a script: what goes into each pass of the window's interface, and what the window has to do between them.

use std::{collections::VecDeque, path::PathBuf};

use egui::{Event as Input, Key, Modifiers, MouseWheelUnit, PointerButton, Pos2, TouchPhase, vec2};

use super::script::Event;

/// Something that is done outside of the interface.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Another size of the window.
    Resize(u32, u32),
    /// Minimise, or restore.
    Minimize(bool),
    /// A file is dropped.
    Drop(PathBuf),
    /// The window's contents go to a file.
    Screenshot(PathBuf),
    /// The GPU is lost.
    Lose,
    /// The surface is lost.
    LoseSurface,
    /// The end.
    Quit,
}

/// What happens in one pass of the interface.
#[derive(Clone, Debug, PartialEq)]
enum Step {
    Input(Vec<Input>),
    Press(String),
    Frames(u32),
    Rest,
    Message(String),
    Command(Command),
}

/// What the driver asks about.
pub struct Surroundings<'a> {
    /// The middle of the picture, in points.
    pub middle: Pos2,
    /// Number of the newest picture.
    pub serial: u64,
    /// Whether it is at rest.
    pub resting: bool,
    /// Whether there is a message with a text in it.
    pub says: &'a dyn Fn(&str) -> bool,
    /// Where the widget of a name is.
    pub find: &'a dyn Fn(&str) -> Option<Pos2>,
}

/// A script on its way.
pub struct Driver {
    events: VecDeque<Event>,
    steps: VecDeque<Step>,
    /// The number of the picture that is waited for.
    until: Option<u64>,
    patience: u32,
}

/// Passes that a widget may take to appear.
const PATIENCE: u32 = 200;

fn key(key: Key, modifiers: Modifiers, pressed: bool) -> Input {
    Input::Key { key, physical_key: Some(key), pressed, repeat: false, modifiers }
}

fn button(pos: Pos2, button: PointerButton, pressed: bool) -> Input {
    Input::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
}

impl Driver {
    /// At the start of a script.
    pub fn new(events: Vec<Event>) -> Self {
        Self { events: events.into(), steps: VecDeque::new(), until: None, patience: PATIENCE }
    }

    /// Whether the script has ended.
    pub fn is_done(&self) -> bool {
        self.events.is_empty() && self.steps.is_empty()
    }

    /// The input of the next pass, and what is to be done beside it.
    ///
    /// # Errors
    /// If the script can't go on: a widget is not there.
    pub fn next(&mut self, around: &Surroundings<'_>) -> Result<(Vec<Input>, Option<Command>), String> {
        if self.steps.is_empty()
            && let Some(event) = self.events.pop_front()
        {
            self.steps.extend(steps(&event, around.middle));
        }
        let Some(step) = self.steps.front() else { return Ok((Vec::new(), None)) };
        match step {
            Step::Frames(count) => {
                let until = *self.until.get_or_insert(around.serial + u64::from(*count));
                // A picture at rest is the last one.
                if around.serial >= until || around.resting {
                    self.until = None;
                    self.steps.pop_front();
                }
                Ok((Vec::new(), None))
            }
            Step::Rest => {
                if around.resting {
                    self.steps.pop_front();
                }
                Ok((Vec::new(), None))
            }
            Step::Message(text) => {
                if (around.says)(text) {
                    self.steps.pop_front();
                }
                Ok((Vec::new(), None))
            }
            Step::Press(name) => match (around.find)(name) {
                Some(at) => {
                    self.steps.pop_front();
                    self.patience = PATIENCE;
                    click(at).into_iter().rev().for_each(|step| self.steps.push_front(step));
                    Ok((Vec::new(), None))
                }
                None if self.patience == 0 => Err(format!("the script presses `{name}`, but there is no such widget")),
                None => {
                    self.patience -= 1;
                    Ok((Vec::new(), None))
                }
            },
            Step::Input(input) => {
                let input = input.clone();
                self.steps.pop_front();
                Ok((input, None))
            }
            Step::Command(command) => {
                let command = command.clone();
                self.steps.pop_front();
                Ok((Vec::new(), Some(command)))
            }
        }
    }
}

fn click(at: Pos2) -> Vec<Step> {
    vec![
        Step::Input(vec![Input::PointerMoved(at)]),
        Step::Input(vec![button(at, PointerButton::Primary, true)]),
        Step::Input(vec![button(at, PointerButton::Primary, false)]),
    ]
}

fn steps(event: &Event, middle: Pos2) -> Vec<Step> {
    let command = |command| vec![Step::Command(command)];
    match event.clone() {
        Event::Key(Key::C, modifiers) if modifiers.command => {
            let held = Step::Input(vec![Input::ModifiersChanged(modifiers), Input::Copy]);
            vec![held, Step::Input(vec![Input::ModifiersChanged(Modifiers::NONE)])]
        }
        Event::Key(name, modifiers) => vec![
            Step::Input(vec![Input::ModifiersChanged(modifiers), key(name, modifiers, true)]),
            Step::Input(vec![key(name, modifiers, false), Input::ModifiersChanged(Modifiers::NONE)]),
        ],
        Event::Hold(name, modifiers, frames) => vec![
            Step::Input(vec![Input::ModifiersChanged(modifiers), key(name, modifiers, true)]),
            Step::Frames(frames),
            Step::Input(vec![key(name, modifiers, false), Input::ModifiersChanged(Modifiers::NONE)]),
        ],
        Event::Drag(which, [x, y]) => {
            let at = |share: f32| middle + vec2(x, y) * share;
            let mut steps =
                vec![Step::Input(vec![Input::PointerMoved(at(0.0))]), Step::Input(vec![button(at(0.0), which, true)])];
            steps.extend((1..=4).map(|i| Step::Input(vec![Input::PointerMoved(at(i as f32 / 4.0))])));
            steps.push(Step::Input(vec![button(at(1.0), which, false)]));
            steps
        }
        Event::Click([x, y]) => click(middle + vec2(x, y)),
        Event::DoubleClick([x, y]) => {
            let once = click(middle + vec2(x, y));
            [once.clone(), once].concat()
        }
        Event::Press(name) => vec![Step::Press(name)],
        Event::Wheel(notches) => vec![
            Step::Input(vec![Input::PointerMoved(middle)]),
            Step::Input(vec![Input::MouseWheel {
                unit: MouseWheelUnit::Line,
                delta: vec2(0.0, notches),
                phase: TouchPhase::Move,
                source: egui::MouseWheelSource::Wheel,
                modifiers: Modifiers::NONE,
            }]),
        ],
        Event::Resize(width, height) => command(Command::Resize(width, height)),
        Event::Minimize(minimized) => command(Command::Minimize(minimized)),
        Event::Drop(path) => command(Command::Drop(path)),
        Event::Wait(frames) => vec![Step::Frames(frames)],
        Event::Rest => vec![Step::Rest],
        Event::Message(text) => vec![Step::Message(text)],
        Event::Screenshot(path) => command(Command::Screenshot(path)),
        Event::Lose => command(Command::Lose),
        Event::LoseSurface => command(Command::LoseSurface),
        Event::Quit => command(Command::Quit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::script::parse;

    fn run(text: &str, find: &dyn Fn(&str) -> Option<Pos2>) -> Result<(Vec<Input>, Vec<Command>), String> {
        let mut driver = Driver::new(parse(text).expect("a script"));
        let (mut inputs, mut commands) = (Vec::new(), Vec::new());
        for serial in 0..1000 {
            if driver.is_done() {
                return Ok((inputs, commands));
            }
            let around = Surroundings {
                middle: Pos2::new(100.0, 50.0),
                serial,
                resting: false,
                says: &|text| serial > 7 && text == "late",
                find,
            };
            let (input, command) = driver.next(&around)?;
            inputs.extend(input);
            commands.extend(command);
        }
        panic!("the script does not end");
    }

    #[test]
    fn a_drag_presses_moves_and_lets_go() {
        let (inputs, _) = run("drag right 40 -20", &|_| None).expect("it runs");
        assert_eq!(inputs.first(), Some(&Input::PointerMoved(Pos2::new(100.0, 50.0))));
        assert_eq!(inputs.last(), Some(&button(Pos2::new(140.0, 30.0), PointerButton::Secondary, false)));
    }

    #[test]
    fn a_message_is_waited_for() {
        let (_, commands) = run("message late\nquit", &|_| None).expect("it runs");
        assert_eq!(commands, [Command::Quit]);
        let never = std::panic::catch_unwind(|| run("message never\nquit", &|_| None));
        assert!(never.is_err(), "it does not come");
    }

    #[test]
    fn waits_pass_and_commands_follow_in_order() {
        let (inputs, commands) = run("wait 5\nresize 30 40\nkey F1\nquit", &|_| None).expect("it runs");
        assert_eq!(commands, [Command::Resize(30, 40), Command::Quit]);
        assert!(inputs.contains(&key(Key::F1, Modifiers::NONE, true)));
    }

    #[test]
    fn a_widget_is_clicked_by_its_name_and_a_missing_one_is_an_error() {
        let at = Pos2::new(7.0, 8.0);
        let (inputs, _) = run("press Frame all", &|name| (name == "Frame all").then_some(at)).expect("it is there");
        assert!(inputs.contains(&button(at, PointerButton::Primary, true)));
        let error = run("press Nowhere", &|_| None).expect_err("it is not there");
        assert!(error.contains("`Nowhere`"));
    }
}
