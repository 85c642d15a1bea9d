//! What can go wrong while a scene is read: where, what, and what to do about it.

use std::fmt;

use crate::exit::{Exit, HasExit};

/// A file, and a line in it where there is one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Path as the user would write it.
    pub file: String,
    /// Line number from 1; 0 stands for the whole file.
    pub line: u64,
}

impl Place {
    /// Line `line` of `file`; 0 stands for the whole file.
    pub fn new(file: impl Into<String>, line: u64) -> Self {
        Self { file: file.into(), line }
    }
}

/// `file:line`, the form that editors and build logs make into a link.
impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str(&self.file),
            line => write!(f, "{}:{line}", self.file),
        }
    }
}

/// Why a scene, an environment map or a camera cannot be used.
///
/// The first line of the text says where and what, the second (`help:`) what to do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// There is no such file, or it may not be opened.
    #[error("{file}: {what}\nhelp: {help}")]
    NoInput {
        /// The file asked for.
        file: String,
        /// What is wrong.
        what: String,
        /// The remedy.
        help: String,
    },
    /// The file opened, but reading it failed part of the way.
    #[error("{place}: reading failed: {source}\nhelp: check the disk or the network, then try again")]
    Read {
        /// How far reading came.
        place: Place,
        /// What the system said.
        source: std::io::Error,
    },
    /// The contents cannot be understood, or are larger than the limits.
    #[error("{place}: {what}\nhelp: {help}")]
    BadData {
        /// Where.
        place: Place,
        /// What is wrong.
        what: String,
        /// The remedy.
        help: String,
    },
    /// A [`Scene`](crate::scene::Scene) breaks a promise that the packing into GPU buffers relies on.
    #[error("scene `{scene}`: {what}\nhelp: the reader or generator that made this scene has to be corrected")]
    Invalid {
        /// Name of the scene.
        scene: String,
        /// The broken promise, with the thing that breaks it.
        what: String,
    },
}

impl HasExit for SceneError {
    fn exit(&self) -> Exit {
        match self {
            Self::NoInput { .. } => Exit::NoInput,
            Self::Read { source, .. } => source.exit(),
            Self::BadData { .. } => Exit::BadData,
            Self::Invalid { .. } => Exit::Internal,
        }
    }
}

impl SceneError {
    /// Bad contents at a place.
    pub fn bad_data(place: Place, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::BadData { place, what: what.into(), help: help.into() }
    }

    /// A file that cannot be had.
    pub fn no_input(file: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::NoInput { file: file.into(), what: what.into(), help: help.into() }
    }
}

/// Something that was corrected, replaced or left out while reading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// Where.
    pub place: Place,
    /// What was found and what was done about it.
    pub message: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.message)
    }
}

/// Collects warnings, and counts them instead once there are too many to read.
#[derive(Debug, Default)]
pub struct Warnings {
    list: Vec<Warning>,
    left_out: u64,
}

impl Warnings {
    /// More than this many would be read by nobody; a damaged file can cause millions.
    pub const MAX: usize = 200;

    /// Longer messages, which hold names from files, are cut.
    const MAX_CHARS: usize = 600;

    /// Adds one, or counts it when there are [`Self::MAX`] already.
    pub fn push(&mut self, place: Place, message: impl Into<String>) {
        if self.list.len() < Self::MAX {
            let mut message = message.into();
            if let Some((end, _)) = message.char_indices().nth(Self::MAX_CHARS) {
                message.truncate(end);
                message.push_str("...");
            }
            self.list.push(Warning { place, message });
        } else {
            self.left_out += 1;
        }
    }

    /// Adds one about `file` as a whole, for `count` cases; none when `count` is 0.
    pub fn push_count(&mut self, place: Place, count: u64, message: impl FnOnce(u64) -> String) {
        if count > 0 {
            self.push(place, message(count));
        }
    }

    /// Adds those of another collection.
    pub fn append(&mut self, other: Self) {
        other.list.into_iter().for_each(|warning| self.push(warning.place, warning.message));
        self.left_out += other.left_out;
    }

    /// The list, with the number of those left out as its last entry.
    pub fn into_vec(mut self) -> Vec<Warning> {
        if self.left_out > 0 {
            let file = self.list.last().map(|w| w.place.file.clone()).unwrap_or_default();
            let message = format!("{} more warnings are not shown", self.left_out);
            self.list.push(Warning { place: Place::new(file, 0), message });
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_beyond_the_limit_are_counted() {
        let mut warnings = Warnings::default();
        for line in 1..=Warnings::MAX as u64 + 5 {
            warnings.push(Place::new("a.obj", line), "odd");
        }
        let list = warnings.into_vec();
        assert_eq!(list.len(), Warnings::MAX + 1);
        assert_eq!(list[0].to_string(), "a.obj:1: odd");
        assert_eq!(list[Warnings::MAX].to_string(), "a.obj: 5 more warnings are not shown");
    }

    #[test]
    fn long_names_do_not_make_long_messages() {
        let mut warnings = Warnings::default();
        warnings.push(Place::new("a.obj", 1), "\u{e9}".repeat(1_000_000));
        assert!(warnings.into_vec()[0].message.len() < 1300);
    }
}
