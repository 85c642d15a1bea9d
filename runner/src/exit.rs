//! How the process ends: the exit codes, and which error asks for which.

use std::error::Error;
use std::io;
use std::process::{ExitCode, Termination};

use crate::bench::{BenchError, JudgeError, methods::MethodError};
use crate::crosscheck::CheckError;
use crate::executor::gpu::GpuError;
use crate::graph::GraphError;
use crate::output::OutputError;
use crate::output::exr::ReadError;
use crate::packed::PackError;
use crate::render::RenderError;
use crate::scene::{error::SceneError, export::ExportError};
use crate::settings::SettingError;
#[cfg(feature = "window")]
use crate::view::{app::ViewError, script::ScriptError};

/// The exit codes of `weir`. 64 and above are those of BSD's `sysexits.h`, so that batch systems can act on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done.
    Ok = 0,
    /// The command ran, and what it checked does not hold.
    CheckFailed = 1,
    /// The command line is wrong; the same code as clap's own.
    Usage = 2,
    /// `compare`: the pictures have different sizes, as of OpenImageIO's `idiff`.
    SizesDiffer = 3,
    /// `compare`: a picture cannot be read, as of `idiff`.
    FileError = 4,
    /// An input file holds something that cannot be used (`EX_DATAERR`).
    BadData = 65,
    /// An input file does not exist or cannot be opened (`EX_NOINPUT`).
    NoInput = 66,
    /// No adapter, or the adapter lacks a feature (`EX_UNAVAILABLE`).
    Unavailable = 69,
    /// A bug in weir (`EX_SOFTWARE`).
    Internal = 70,
    /// The output cannot be created where it was asked for (`EX_CANTCREAT`).
    CannotCreate = 73,
    /// Reading or writing failed on the way (`EX_IOERR`).
    Io = 74,
    /// A passing condition: the same command may well succeed later (`EX_TEMPFAIL`).
    Temporary = 75,
    /// Interrupted from the keyboard (128 + SIGINT).
    Interrupted = 130,
    /// Asked to stop by the system (128 + SIGTERM).
    Terminated = 143,
}

impl Exit {
    /// `compare`: the pictures differ by enough for a warning; the code of `idiff`.
    pub const WARNS: Self = Self::CheckFailed;
    /// `compare`: the pictures differ by too much; the code of `idiff`, which a wrong command line has too.
    pub const DIFFERS: Self = Self::Usage;

    /// The number that the shell sees.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The code for an error and its causes: the outermost error that knows its own code decides.
    ///
    /// An error that nobody knows is a bug: [`Exit::Internal`].
    pub fn of(error: &(dyn Error + 'static)) -> Self {
        let mut next = Some(error);
        while let Some(error) = next {
            if let Some(exit) = KNOWN.iter().find_map(|known| known(error)) {
                return exit;
            }
            next = error.source();
        }
        Self::Internal
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

impl Termination for Exit {
    fn report(self) -> ExitCode {
        self.into()
    }
}

/// An error that knows with which code the process should end.
pub trait HasExit {
    /// The code.
    fn exit(&self) -> Exit;
}

impl HasExit for io::Error {
    /// Only conditions that pass by themselves are [`Exit::Temporary`]; everything else is [`Exit::Io`].
    fn exit(&self) -> Exit {
        use io::ErrorKind as Kind;
        match self.kind() {
            Kind::Interrupted
            | Kind::ResourceBusy
            | Kind::StaleNetworkFileHandle
            | Kind::TimedOut
            | Kind::WouldBlock => Exit::Temporary,
            _ => Exit::Io,
        }
    }
}

/// The code of an error, if it is an `E`.
fn exit_of<E: HasExit + Error + 'static>(error: &(dyn Error + 'static)) -> Option<Exit> {
    error.downcast_ref::<E>().map(HasExit::exit)
}

/// [`exit_of`] for every error that has a code.
const KNOWN: &[fn(&(dyn Error + 'static)) -> Option<Exit>] = &[
    exit_of::<Usage>,
    exit_of::<BenchError>,
    exit_of::<JudgeError>,
    exit_of::<MethodError>,
    exit_of::<SettingError>,
    exit_of::<SceneError>,
    exit_of::<PackError>,
    exit_of::<RenderError>,
    exit_of::<GraphError>,
    exit_of::<GpuError>,
    exit_of::<CheckError>,
    exit_of::<OutputError>,
    exit_of::<ReadError>,
    exit_of::<ExportError>,
    #[cfg(feature = "window")]
    exit_of::<ScriptError>,
    #[cfg(feature = "window")]
    exit_of::<ViewError>,
    exit_of::<io::Error>,
];

/// A request on the command line that cannot be followed as it stands.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("{0}")]
pub struct Usage(pub String);

impl HasExit for Usage {
    fn exit(&self) -> Exit {
        Exit::Usage
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::Destination;

    fn writing(kind: io::ErrorKind) -> OutputError {
        OutputError::Io { destination: Destination::Stdout, source: kind.into() }
    }

    #[test]
    fn a_full_disk_is_an_io_error_and_a_busy_one_is_temporary() {
        assert_eq!(writing(io::ErrorKind::StorageFull).exit(), Exit::Io);
        assert_eq!(writing(io::ErrorKind::ResourceBusy).exit(), Exit::Temporary);
    }

    #[test]
    fn context_around_an_error_keeps_its_code() {
        let error =
            anyhow::Error::new(OutputError::IsDirectory { path: "x".into() }).context("cannot save the picture");
        assert_eq!(Exit::of(error.as_ref()), Exit::CannotCreate);
    }

    #[test]
    fn the_outermost_known_error_decides() {
        // The inner I/O error alone would be 74.
        let denied = OutputError::Denied { path: "x".into(), source: io::ErrorKind::PermissionDenied.into() };
        assert_eq!(Exit::of(&denied), Exit::CannotCreate);
    }

    /// `#[error(transparent)]` leaves the wrapped error itself out of the chain of causes.
    #[test]
    fn errors_that_wrap_others_ask_them() {
        assert_eq!(Exit::of(&RenderError::from(GpuError::NoAdapter)), Exit::Unavailable);
        assert_eq!(Exit::of(&RenderError::from(GraphError::Size(0, 1))), Exit::Usage);
        assert_eq!(Exit::of(&CheckError::from(GraphError::UnknownPass("x"))), Exit::Internal);
    }

    #[test]
    fn an_unknown_error_is_internal() {
        assert_eq!(Exit::of(anyhow::anyhow!("lost").as_ref()), Exit::Internal);
    }
}
