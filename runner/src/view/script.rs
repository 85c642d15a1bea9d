//! Events from a file in place of those of a person: for tests, and for pictures that can be made again.
//!
//! They enter where those of the window system do once egui has read them, so keys, drags and dropped files go the same
//! way from there on.

use std::{path::PathBuf, str::FromStr};

use egui::{Key, Modifiers, PointerButton};
use thiserror::Error;

/// A line of a script.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A key goes down and up, with its modifiers.
    Key(Key, Modifiers),
    /// Keys stay down for some frames.
    Hold(Key, Modifiers, u32),
    /// A button is pressed in the middle of the picture, moves by this many points, and is let go.
    Drag(PointerButton, [f32; 2]),
    /// A click this many points from the middle of the picture.
    Click([f32; 2]),
    /// Two of them.
    DoubleClick([f32; 2]),
    /// A click on the widget of this name.
    Press(String),
    /// The wheel, in notches away from the user.
    Wheel(f32),
    /// The window gets this size, in pixels.
    Resize(u32, u32),
    /// The window is minimised, or restored.
    Minimize(bool),
    /// A file is dropped.
    Drop(PathBuf),
    /// This many frames of the picture pass.
    Wait(u32),
    /// The picture is at rest.
    Rest,
    /// The window shows a message with this text in it.
    Message(String),
    /// The window's contents go to a file.
    Screenshot(PathBuf),
    /// The GPU is lost, as after a reset of its driver.
    Lose,
    /// The surface is lost.
    LoseSurface,
    /// The program ends.
    Quit,
}

/// What is wrong with a script.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("line {line} of the script: {reason}; lines are such as `key Shift+F12`, `drag left 40 -10`, `wait 10`")]
pub struct ScriptError {
    line: usize,
    reason: String,
}

impl crate::exit::HasExit for ScriptError {
    fn exit(&self) -> crate::exit::Exit {
        crate::exit::Exit::BadData
    }
}

/// Reads a script: one event a line; `#` starts a comment.
///
/// # Errors
/// The first line that is none, and why.
pub fn parse(text: &str) -> Result<Vec<Event>, ScriptError> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.split('#').next().unwrap_or("").trim()));
    let parsed = lines
        .filter(|(_, line)| !line.is_empty())
        .map(|(line, text)| event(text).ok_or_else(|| ScriptError { line, reason: format!("`{text}` is no event") }));
    parsed.collect()
}

fn number<T: FromStr>(word: Option<&str>) -> Option<T> {
    word?.parse().ok()
}

fn chord(text: &str) -> Option<(Key, Modifiers)> {
    let mut modifiers = Modifiers::NONE;
    let mut words: Vec<&str> = text.split('+').collect();
    let key = Key::from_name(words.pop()?)?;
    for word in words {
        modifiers |= match word {
            "Shift" => Modifiers::SHIFT,
            "Ctrl" => Modifiers::COMMAND | Modifiers::CTRL,
            "Alt" => Modifiers::ALT,
            _ => return None,
        };
    }
    Some((key, modifiers))
}

fn event(text: &str) -> Option<Event> {
    let (name, rest) = text.split_once(' ').unwrap_or((text, ""));
    let rest = rest.trim();
    let mut words = rest.split_whitespace();
    let point = |words: &mut std::str::SplitWhitespace<'_>| Some([number(words.next())?, number(words.next())?]);
    let event = match name {
        "key" => {
            let (key, modifiers) = chord(words.next()?)?;
            Event::Key(key, modifiers)
        }
        "hold" => {
            let (key, modifiers) = chord(words.next()?)?;
            Event::Hold(key, modifiers, number(words.next())?)
        }
        "drag" => {
            let button = match words.next()? {
                "left" => PointerButton::Primary,
                "right" => PointerButton::Secondary,
                "middle" => PointerButton::Middle,
                _ => return None,
            };
            Event::Drag(button, point(&mut words)?)
        }
        "click" => Event::Click(point(&mut words)?),
        "doubleclick" => Event::DoubleClick(point(&mut words)?),
        "press" => return (!rest.is_empty()).then(|| Event::Press(rest.to_owned())),
        "wheel" => Event::Wheel(number(words.next())?),
        "resize" => Event::Resize(number(words.next())?, number(words.next())?),
        "minimize" => Event::Minimize(true),
        "restore" => Event::Minimize(false),
        "drop" => return (!rest.is_empty()).then(|| Event::Drop(rest.into())),
        "wait" => Event::Wait(number(words.next())?),
        "rest" => Event::Rest,
        "message" => return (!rest.is_empty()).then(|| Event::Message(rest.to_owned())),
        "screenshot" => return (!rest.is_empty()).then(|| Event::Screenshot(rest.into())),
        "lose" => Event::Lose,
        "lose-surface" => Event::LoseSurface,
        "quit" => Event::Quit,
        _ => return None,
    };
    words.next().is_none().then_some(event)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_line_is_read() {
        let text = "key Shift+F12  # a comment\n\nhold Shift+W 5\ndrag left 40 -10\nclick 1 2\nwheel -3\nresize 640 480\n\
                    minimize\nrestore\ndrop a file.obj\nwait 10\nrest\nscreenshot out dir/a.png\nlose\nmessage no file\nquit";
        let events = parse(text).expect("a script");
        assert_eq!(events[0], Event::Key(Key::F12, Modifiers::SHIFT));
        assert_eq!(events[1], Event::Hold(Key::W, Modifiers::SHIFT, 5));
        assert_eq!(events[2], Event::Drag(PointerButton::Primary, [40.0, -10.0]));
        assert_eq!(events[8], Event::Drop("a file.obj".into()));
        assert_eq!(events[11], Event::Screenshot("out dir/a.png".into()));
        assert_eq!(events[13], Event::Message("no file".into()));
        assert_eq!(events.len(), 15);
    }

    #[test]
    fn the_first_line_that_is_no_event_is_named() {
        for bad in ["jump", "key NoSuchKey", "drag up 1 2", "wait", "wait x", "resize 3", "drop", "click 1 2 3"] {
            let error = parse(&format!("wait 1\n{bad}\n")).expect_err(bad).to_string();
            assert!(error.starts_with(&format!("line 2 of the script: `{bad}` is no event")), "{error}");
        }
    }
}
