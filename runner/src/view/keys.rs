//! Keys and what they do: one table, from which the help in the window and that in the README are made.

use egui::{Key, Modifiers};

/// What a key does at the moment when it goes down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// The list of keys.
    Help,
    /// Panels, shown or hidden.
    Panels,
    /// The file dialog.
    Open,
    /// Reads the scene again.
    Reload,
    /// A picture as PNG.
    ScreenshotPng,
    /// A picture as EXR.
    ScreenshotExr,
    /// Starts or ends a sequence of pictures.
    Record,
    /// Writes the settings.
    SaveSettings,
    /// Copies the command line.
    CopyCommand,
    /// Copies the camera.
    CopyCamera,
    /// Full screen and back.
    FullScreen,
    /// Leaves what is open: help, then full screen.
    Leave,
    /// Ends the program.
    Quit,
    /// Animation: on and off.
    Pause,
    /// Animation: one step.
    Step,
    /// Animation: slower.
    Slower,
    /// Animation: faster.
    Faster,
    /// The whole scene in sight.
    FrameAll,
    /// The camera of the scene.
    ResetCamera,
    /// The point under the pointer becomes the target.
    Focus,
    /// Goes to a bookmark.
    GoTo(u8),
    /// Stores a bookmark.
    Store(u8),
    /// The next view of the buffers.
    NextView,
    /// The view before.
    PreviousView,
    /// The plain picture.
    PlainView,
    /// The next comparison.
    Compare,
    /// The next preset.
    Preset,
    /// Averages what stands still, or not.
    Accumulate,
    /// Brighter.
    Brighter,
    /// Darker.
    Darker,
    /// Exposure by the picture, or by hand.
    AutoExposure,
    /// Waits for the screen, or not.
    Vsync,
    /// The environment map, on and off.
    Environment,
    /// The pixel inspector.
    Inspect,
}

/// A key with its modifiers; letters as on an American keyboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chord {
    /// The key.
    pub key: Key,
    /// With Ctrl (on a Mac: Command).
    pub command: bool,
    /// With Shift.
    pub shift: bool,
}

const fn plain(key: Key) -> Chord {
    Chord { key, command: false, shift: false }
}

const fn shift(key: Key) -> Chord {
    Chord { key, command: false, shift: true }
}

const fn ctrl(key: Key) -> Chord {
    Chord { key, command: true, shift: false }
}

/// A row of the table: chords that do the same, what they do, and that in words.
pub struct Binding {
    /// Any of them.
    pub chords: &'static [Chord],
    /// What they do.
    pub action: Action,
    /// In words.
    pub text: &'static str,
}

const fn row(chords: &'static [Chord], action: Action, text: &'static str) -> Binding {
    Binding { chords, action, text }
}

/// What the pointer and held keys do.
pub const HELD: &[(&str, &str)] = &[
    ("drag", "orbit around the target"),
    ("right drag", "look around"),
    ("middle drag, Shift + drag", "pan"),
    ("wheel", "dolly"),
    ("double click", "focus on that point"),
    ("click", "pick a light; with the inspector, a pixel"),
    ("W A S D, Q E", "fly: forward, left, back, right; down, up"),
    ("Shift, Alt while flying", "five times as fast, a fifth as fast"),
    ("1 to 9", "go to a camera bookmark"),
    ("Shift + 1 to 9", "store a camera bookmark"),
    ("drop a file", ".obj: the scene; .hdr or .exr: the environment; .json: the camera; .toml: settings"),
];

/// Every key that does something when it goes down.
pub const KEYS: &[Binding] = &[
    row(&[plain(Key::F1), plain(Key::H)], Action::Help, "this list"),
    row(&[plain(Key::Tab), plain(Key::F2)], Action::Panels, "panels on and off"),
    row(&[ctrl(Key::O)], Action::Open, "open a file"),
    row(&[plain(Key::F5)], Action::Reload, "read the scene again"),
    row(&[plain(Key::F12)], Action::ScreenshotPng, "save the picture as PNG"),
    row(&[shift(Key::F12)], Action::ScreenshotExr, "save the picture as EXR, linear"),
    row(&[plain(Key::F9)], Action::Record, "record a sequence of pictures, or end it"),
    row(&[ctrl(Key::S)], Action::SaveSettings, "save the settings"),
    row(&[ctrl(Key::C)], Action::CopyCommand, "copy the settings as a command line"),
    row(&[Chord { key: Key::C, command: true, shift: true }], Action::CopyCamera, "copy the camera as JSON"),
    row(&[plain(Key::F11)], Action::FullScreen, "full screen"),
    row(&[plain(Key::Escape)], Action::Leave, "close the help, leave full screen"),
    row(&[ctrl(Key::Q)], Action::Quit, "end the program"),
    row(&[plain(Key::Space)], Action::Pause, "pause or play the animation"),
    row(&[plain(Key::Period)], Action::Step, "one step of the animation"),
    row(&[plain(Key::OpenBracket)], Action::Slower, "animate at half the speed"),
    row(&[plain(Key::CloseBracket)], Action::Faster, "animate at twice the speed"),
    row(&[plain(Key::Home)], Action::FrameAll, "show the whole scene"),
    row(&[plain(Key::R)], Action::ResetCamera, "back to the camera of the scene"),
    row(&[plain(Key::F)], Action::Focus, "focus on the point under the pointer"),
    row(&[plain(Key::N)], Action::NextView, "next view of the buffers"),
    row(&[shift(Key::N)], Action::PreviousView, "view of the buffers before"),
    row(&[plain(Key::M)], Action::PlainView, "back to the picture"),
    row(&[plain(Key::X)], Action::Compare, "compare: with another preset, with the reference, not at all"),
    row(&[plain(Key::P)], Action::Preset, "next preset"),
    row(&[plain(Key::C)], Action::Accumulate, "average the picture while nothing moves, or not"),
    row(&[plain(Key::Plus), plain(Key::Equals)], Action::Brighter, "brighter by a third of a stop"),
    row(&[plain(Key::Minus)], Action::Darker, "darker by a third of a stop"),
    row(&[plain(Key::Num0)], Action::AutoExposure, "exposure by the picture, or by hand"),
    row(&[plain(Key::V)], Action::Vsync, "wait for the screen, or not"),
    row(&[plain(Key::L)], Action::Environment, "environment map on and off"),
    row(&[plain(Key::I)], Action::Inspect, "pixel inspector"),
];

const DIGITS: [Key; 9] =
    [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];

/// What a key does when it goes down with the given modifiers.
pub fn action(key: Key, physical: Option<Key>, modifiers: Modifiers) -> Option<Action> {
    // With Shift, digits have another meaning on most keyboards: the place of the key counts.
    let digit = |key: Key| DIGITS.iter().position(|digit| *digit == key);
    if !modifiers.command
        && let Some(index) = physical.and_then(digit).or(digit(key))
    {
        let number = index as u8 + 1;
        return Some(if modifiers.shift { Action::Store(number) } else { Action::GoTo(number) });
    }
    let is_it = |chord: &Chord| {
        // Plus is a shifted key on many keyboards.
        let shift = chord.shift == modifiers.shift || chord.key == Key::Plus;
        chord.key == key && chord.command == modifiers.command && shift
    };
    KEYS.iter().find(|binding| binding.chords.iter().any(is_it)).map(|binding| binding.action)
}

impl std::fmt::Display for Chord {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let command = if self.command { "Ctrl + " } else { "" };
        let shift = if self.shift { "Shift + " } else { "" };
        write!(f, "{command}{shift}{}", self.key.symbol_or_name())
    }
}

/// Every row of the help: keys, and what they do.
pub fn help() -> Vec<(String, &'static str)> {
    let held = HELD.iter().map(|(keys, text)| ((*keys).to_owned(), *text));
    let pressed = KEYS.iter().map(|binding| {
        let chords: Vec<String> = binding.chords.iter().map(ToString::to_string).collect();
        (chords.join(", "), binding.text)
    });
    held.chain(pressed).collect()
}

/// The table of keys in Markdown, as the README has it.
pub fn markdown() -> String {
    let rows = help().into_iter().map(|(keys, text)| format!("| {keys} | {text} |\n"));
    format!("| key | does |\n|---|---|\n{}", rows.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_chord_does_two_things() {
        let chords: Vec<&Chord> = KEYS.iter().flat_map(|binding| binding.chords).collect();
        for (i, chord) in chords.iter().enumerate() {
            assert!(!chords[..i].contains(chord), "{chord} stands twice");
        }
    }

    #[test]
    fn every_chord_of_the_table_does_what_its_row_says() {
        for binding in KEYS {
            for chord in binding.chords {
                let modifiers =
                    Modifiers { shift: chord.shift, command: chord.command, ctrl: chord.command, ..Modifiers::NONE };
                assert_eq!(action(chord.key, None, modifiers), Some(binding.action), "{chord}");
            }
        }
    }

    #[test]
    fn shifted_digits_store_whatever_sign_is_on_them() {
        assert_eq!(action(Key::Num3, Some(Key::Num3), Modifiers::NONE), Some(Action::GoTo(3)));
        assert_eq!(action(Key::Exclamationmark, Some(Key::Num1), Modifiers::SHIFT), Some(Action::Store(1)));
        assert_eq!(action(Key::Num1, Some(Key::Num1), Modifiers::COMMAND), None);
        assert_eq!(action(Key::Plus, Some(Key::Equals), Modifiers::SHIFT), Some(Action::Brighter));
        assert_eq!(action(Key::C, None, Modifiers::COMMAND), Some(Action::CopyCommand));
        assert_eq!(action(Key::C, None, Modifiers::NONE), Some(Action::Accumulate));
    }

    #[test]
    fn keys_that_fly_do_nothing_else() {
        for key in [Key::W, Key::A, Key::S, Key::D, Key::Q, Key::E] {
            assert_eq!(action(key, None, Modifiers::NONE), None, "{key:?}");
            assert_eq!(action(key, None, Modifiers::SHIFT), None, "{key:?}");
        }
    }

    #[test]
    fn the_readme_has_this_table() {
        let readme = include_str!("../../../README.md").replace("\r\n", "\n");
        assert!(readme.contains(&markdown()), "put this into the README:\n{}", markdown());
    }
}
