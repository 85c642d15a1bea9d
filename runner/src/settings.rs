//! Knobs: every `--set key=value`, with its meaning, range and default, declared once.

use thiserror::Error;

use crate::exit::{Exit, HasExit};

/// What `--set` changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// See [`KNOBS`].
    pub candidates: u32,
    /// See [`KNOBS`].
    pub pick_by_power: bool,
    /// See [`KNOBS`].
    pub path_length: u32,
    /// See [`KNOBS`].
    pub time_s: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { candidates: 32, pick_by_power: true, path_length: 1, time_s: 0.0 }
    }
}

/// A knob.
pub struct Knob {
    /// What stands before the equals sign.
    pub key: &'static str,
    /// What may stand behind it.
    pub values: &'static str,
    /// Default, and what more and less of it do.
    pub help: &'static str,
    set: fn(&mut Settings, &str) -> bool,
}

fn number<T: std::str::FromStr + PartialOrd>(target: &mut T, text: &str, low: T, high: T) -> bool {
    match text.parse() {
        Ok(value) if value >= low && value <= high => {
            *target = value;
            true
        }
        _ => false,
    }
}

/// Every knob there is.
pub const KNOBS: &[Knob] = &[
    Knob {
        key: "candidates.count",
        values: "1 to 4096",
        help: "light samples offered to each pixel's reservoir in a frame. More: less noise a frame; less: faster \
               frames. With no more lights than this, each light is offered once. Default 32",
        set: |s, text| number(&mut s.candidates, text, 1, 4096),
    },
    Knob {
        key: "candidates.source",
        values: "power or uniform",
        help: "how candidates are drawn from the emissive triangles: by emitted power, or all alike. Default power",
        set: |s, text| {
            s.pick_by_power = text == "power";
            text == "power" || text == "uniform"
        },
    },
    Knob {
        key: "path.length",
        values: "1 to 64",
        help: "surfaces on a path, for `--integrator reference` only: 1 is direct light. More: light that has \
               bounced. Default 1",
        set: |s, text| number(&mut s.path_length, text, 1, 64),
    },
    Knob {
        key: "scene.time",
        values: "-1000000 to 1000000",
        help: "the moment of an animated scene, in seconds. Default 0",
        set: |s, text| number(&mut s.time_s, text, -1e6, 1e6),
    },
];

/// A `--set` that cannot be followed.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum SettingError {
    /// No equals sign.
    #[error("`{0}` is not of the form key=value")]
    Form(String),
    /// No such knob.
    #[error("there is no knob `{key}`; there are {known}")]
    Unknown {
        /// What was asked for.
        key: String,
        /// All keys.
        known: String,
    },
    /// A value out of range.
    #[error("`{key}` takes {values}, not `{value}`")]
    Value {
        /// The knob.
        key: &'static str,
        /// What it takes.
        values: &'static str,
        /// What was given.
        value: String,
    },
}

impl HasExit for SettingError {
    fn exit(&self) -> Exit {
        Exit::Usage
    }
}

impl Settings {
    /// Applies one `key=value`.
    ///
    /// # Errors
    /// If there is no such knob or the value is out of its range.
    pub fn apply(&mut self, assignment: &str) -> Result<(), SettingError> {
        let (key, value) = assignment.split_once('=').ok_or_else(|| SettingError::Form(assignment.to_owned()))?;
        let (key, value) = (key.trim(), value.trim());
        let Some(knob) = KNOBS.iter().find(|k| k.key == key) else {
            let known = KNOBS.iter().map(|k| format!("`{}`", k.key)).collect::<Vec<_>>().join(", ");
            return Err(SettingError::Unknown { key: key.to_owned(), known });
        };
        if (knob.set)(self, value) {
            Ok(())
        } else {
            Err(SettingError::Value { key: knob.key, values: knob.values, value: value.to_owned() })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knobs_take_what_is_in_range_and_say_what_is_not() {
        let mut settings = Settings::default();
        settings.apply("candidates.count=8").expect("in range");
        settings.apply(" candidates.source = uniform ").expect("in range");
        assert_eq!((settings.candidates, settings.pick_by_power), (8, false));
        let text = |assignment: &str| Settings::default().apply(assignment).expect_err("refused").to_string();
        assert_eq!(text("candidates.count=0"), "`candidates.count` takes 1 to 4096, not `0`");
        assert_eq!(text("scene.time=NaN"), "`scene.time` takes -1000000 to 1000000, not `NaN`");
        assert!(text("candidates=8").contains("there are `candidates.count`"));
        assert!(text("candidates").contains("key=value"));
    }
}
