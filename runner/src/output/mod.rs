//! Results: pictures, where they go, and how they are compared.
//!
//! A writer encodes in memory first and hands the bytes to [`atomic::write`], so that a picture that cannot be encoded
//! touches no file, and a file is there whole or not at all.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::exit::{Exit, HasExit};

pub mod atomic;
pub mod compare;
pub mod exr;
pub mod heat;
pub mod png;

/// A picture: radiance in linear Rec. 709, in W sr^-1 m^-2.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// One value a pixel, row by row, the top row first.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage in 0..=1, where it is known.
    pub alpha: Option<Vec<f32>>,
}

/// What else is known of each pixel of a [`Picture`], in the same order. What is absent is not written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Distance along the view direction, in scene units (`Z`).
    pub depth: Option<Vec<f32>>,
    /// Unit normal of the triangle, in world space (`N`).
    pub normal_geometric: Option<Vec<[f32; 3]>>,
    /// Interpolated unit normal, in world space (`Ns`).
    pub normal_shading: Option<Vec<[f32; 3]>>,
    /// Visible point in world space, in scene units (`P`).
    pub position: Option<Vec<[f32; 3]>>,
    /// Reflectance in 0..=1, linear Rec. 709 (`Albedo`).
    pub albedo: Option<Vec<[f32; 3]>>,
    /// Variance of the pixel's mean, not of one sample (`Variance`).
    pub variance: Option<Vec<[f32; 3]>>,
    /// The same, divided by the square of the mean (`RelativeVariance`).
    pub relative_variance: Option<Vec<[f32; 3]>>,
    /// Samples taken (`samples`).
    pub samples: Option<Vec<u32>>,
    /// Light that the pixel's reservoir holds (`light.id`).
    pub light_id: Option<Vec<u32>>,
}

/// Where a result goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// A file; a character device or a FIFO works too.
    File(PathBuf),
    /// Standard output.
    Stdout,
}

impl From<PathBuf> for Destination {
    /// Reads an `-o` argument: `-` is standard output, `./-` a file of that name.
    fn from(path: PathBuf) -> Self {
        if path == Path::new("-") { Self::Stdout } else { Self::File(path) }
    }
}

impl fmt::Display for Destination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => write!(f, "{}", path.display()),
            Self::Stdout => f.write_str("standard output"),
        }
    }
}

/// Why a result was not written.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The path has no file name.
    #[error("the output path names no file; append a file name: {}", path.display())]
    NoName {
        /// As given.
        path: PathBuf,
    },
    /// The directory to write into does not exist.
    #[error("directory `{}` does not exist; create it or choose another for {}", parent.display(), path.display())]
    MissingParent {
        /// The output.
        path: PathBuf,
        /// Its directory.
        parent: PathBuf,
    },
    /// What should be a directory is something else.
    #[error("`{}` is not a directory; choose another for {}", parent.display(), path.display())]
    ParentNotDirectory {
        /// The output.
        path: PathBuf,
        /// What should be its directory.
        parent: PathBuf,
    },
    /// The output is a directory.
    #[error("the output is a directory; append a file name: {}", path.display())]
    IsDirectory {
        /// The directory.
        path: PathBuf,
    },
    /// The output exists and is marked read-only.
    #[error("the output exists and is read-only; make it writable or choose another name: {}", path.display())]
    ReadOnly {
        /// The output.
        path: PathBuf,
    },
    /// The system does not let this user write there.
    #[error("no permission to write here; choose another directory or change its permissions: {}", path.display())]
    Denied {
        /// The output.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The output is a block device, a socket or the like.
    #[error("the output is neither a file nor a stream; choose another name: {}", path.display())]
    NotAFile {
        /// The output.
        path: PathBuf,
    },
    /// The output is a symbolic link that leads nowhere.
    #[error("the output is a symbolic link to nothing; remove the link or create its target: {}", path.display())]
    DanglingLink {
        /// The link.
        path: PathBuf,
    },
    /// Standard output is a terminal, which would show the bytes as garbage.
    #[error("standard output is a terminal; redirect it (`> picture.exr`) or name a file with -o")]
    Terminal,
    /// The reader of a pipe went away.
    #[error("the reader stopped reading before all was written; keep it running to the end: {destination}")]
    Closed {
        /// The pipe.
        destination: Destination,
    },
    /// No space is left, or a quota or size limit is reached.
    #[error("no space left for {bytes} bytes; free some or choose another disk: {destination}")]
    Full {
        /// Where.
        destination: Destination,
        /// How many bytes the whole output has.
        bytes: usize,
    },
    /// No new file can be made in the directory.
    #[error("no file can be created there ({reason}); choose another place: {}", path.display())]
    NoNewFile {
        /// The file asked for.
        path: PathBuf,
        /// What kind of error the system had.
        reason: std::io::ErrorKind,
    },
    /// Writing failed for another reason.
    #[error("cannot write ({source}); check the disk or choose another place: {destination}")]
    Io {
        /// Where.
        destination: Destination,
        /// What the system said.
        source: io::Error,
    },
    /// A channel does not have one value a pixel: a bug in the caller.
    #[error("channel `{channel}` holds {found} values, a {width}x{height} picture needs {}", u64::from(*width) * u64::from(*height))]
    Shape {
        /// Name in the file.
        channel: &'static str,
        /// How many there are.
        found: usize,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The picture has no pixels.
    #[error("a {width}x{height} picture has no pixels; choose a size of at least 1x1")]
    Empty {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The encoder refused.
    #[error("cannot encode as {format} ({reason}); try another format or a smaller size")]
    Encode {
        /// `EXR` or `PNG`.
        format: &'static str,
        /// What the encoder said.
        reason: String,
    },
}

impl HasExit for OutputError {
    fn exit(&self) -> Exit {
        match self {
            Self::NoName { .. }
            | Self::MissingParent { .. }
            | Self::ParentNotDirectory { .. }
            | Self::IsDirectory { .. }
            | Self::ReadOnly { .. }
            | Self::Denied { .. }
            | Self::NotAFile { .. }
            | Self::DanglingLink { .. }
            | Self::NoNewFile { .. }
            | Self::Terminal => Exit::CannotCreate,
            Self::Closed { .. } | Self::Full { .. } => Exit::Io,
            Self::Io { source, .. } => source.exit(),
            Self::Empty { .. } => Exit::Usage,
            Self::Shape { .. } | Self::Encode { .. } => Exit::Internal,
        }
    }
}

/// Checks that there are pixels, and one value for each.
fn check_shape(channel: &'static str, found: usize, width: u32, height: u32) -> Result<(), OutputError> {
    if width == 0 || height == 0 {
        return Err(OutputError::Empty { width, height });
    }
    if found as u64 != u64::from(width) * u64::from(height) {
        return Err(OutputError::Shape { channel, found, width, height });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dash_is_standard_output_and_anything_else_a_file() {
        assert_eq!(Destination::from(PathBuf::from("-")), Destination::Stdout);
        assert_eq!(Destination::from(PathBuf::from("./-")), Destination::File("./-".into()));
    }

    #[test]
    fn a_wrong_number_of_values_names_the_channel() {
        let error = check_shape("Z", 5, 2, 3).expect_err("5 is not 2 x 3");
        assert_eq!(error.to_string(), "channel `Z` holds 5 values, a 2x3 picture needs 6");
        assert_eq!(error.exit(), Exit::Internal);
    }
}
