//! Writing a file whole or not at all.
//!
//! The bytes go to a temporary file in the target's directory, are forced to the disk, and only then take the target's
//! name. Whatever happens before that, the old content stays. A process that is killed leaves its temporary file behind;
//! the next one to write the same target removes it. A temporary file that is locked still has a writer, and is left alone.

use std::ffi::OsStr;
use std::fs::{self, File, FileType, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::{Destination, OutputError};

/// What the names of all temporary files end in.
pub const TEMPORARY_SUFFIX: &str = ".weir-tmp";

/// Writes all of `bytes` to the destination; a file gets them whole or stays as it was.
///
/// A symbolic link is followed and stays. Character devices and FIFOs are written in place. Standard output is not
/// written to if it is a terminal.
///
/// # Errors
///
/// Nothing can be created there, or writing failed; see [`OutputError`]. No temporary file is left then.
pub fn write(destination: &Destination, bytes: &[u8]) -> Result<(), OutputError> {
    match destination {
        Destination::File(path) => match target(path)? {
            Target::File(file) => replace(path, &file, bytes),
            Target::Stream => stream(destination, OpenOptions::new().write(true).open(path), bytes),
        },
        Destination::Stdout => {
            let stdout = io::stdout().lock();
            if stdout.is_terminal() {
                return Err(OutputError::Terminal);
            }
            stream(destination, Ok(stdout), bytes)
        }
    }
}

/// Finds out, before hours of work, whether there is a place to write to, by making a temporary file there and removing it;
/// it may still fill up or go away.
///
/// # Errors
///
/// Nothing can be created there; see [`OutputError`].
pub fn check(destination: &Destination) -> Result<(), OutputError> {
    match destination {
        Destination::File(path) => match target(path)? {
            Target::File(file) => locked_temporary(&file).map(drop).map_err(|error| match failure(path, 0, error) {
                OutputError::Io { source, .. } => OutputError::NoNewFile { path: path.clone(), reason: source.kind() },
                known => known,
            }),
            Target::Stream => Ok(()),
        },
        Destination::Stdout if io::stdout().is_terminal() => Err(OutputError::Terminal),
        Destination::Stdout => Ok(()),
    }
}

/// What an output path leads to.
enum Target {
    /// A regular file, there or not yet; links are resolved.
    File(PathBuf),
    /// A character device or a FIFO: written in place, never replaced.
    Stream,
}

fn target(path: &Path) -> Result<Target, OutputError> {
    match fs::metadata(path) {
        Ok(metadata) if metadata.is_dir() => Err(OutputError::IsDirectory { path: path.into() }),
        Ok(metadata) if is_stream(metadata.file_type()) => Ok(Target::Stream),
        Ok(metadata) if !metadata.is_file() => Err(OutputError::NotAFile { path: path.into() }),
        // A rename would replace it all the same, which is not what its owner asked for.
        Ok(metadata) if metadata.permissions().readonly() => Err(OutputError::ReadOnly { path: path.into() }),
        // Resolved, so that the link stays and its target is replaced.
        Ok(_) => fs::canonicalize(path).map(Target::File).map_err(|source| failure(path, 0, source)),
        Err(_) if path.is_symlink() => Err(OutputError::DanglingLink { path: path.into() }),
        Err(_) if path.file_name().is_none() || ends_in_separator(path) => {
            Err(OutputError::NoName { path: path.into() })
        }
        Err(_) => {
            let parent = directory_of(path);
            match fs::metadata(parent) {
                Ok(metadata) if metadata.is_dir() => Ok(Target::File(path.into())),
                Ok(_) => Err(OutputError::ParentNotDirectory { path: path.into(), parent: parent.into() }),
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    Err(OutputError::MissingParent { path: path.into(), parent: parent.into() })
                }
                Err(error) => Err(failure(path, 0, error)),
            }
        }
    }
}

#[cfg(unix)]
fn is_stream(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_fifo()
}

#[cfg(not(unix))]
fn is_stream(_: FileType) -> bool {
    false
}

/// Whether the path can only mean a directory; [`Path`] itself hides this.
fn ends_in_separator(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().last().is_some_and(|byte| std::path::is_separator(char::from(*byte)))
}

fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes to something that cannot be replaced.
fn stream<W: Write>(destination: &Destination, writer: io::Result<W>, bytes: &[u8]) -> Result<(), OutputError> {
    let written = writer.and_then(|mut writer| {
        writer.write_all(bytes)?;
        writer.flush()
    });
    written.map_err(|error| classify(destination.clone(), bytes.len(), error))
}

/// Puts a file in the place of `target`; `path` is what the user called it.
fn replace(path: &Path, target: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    remove_abandoned(target);
    let written = locked_temporary(target).and_then(|mut temporary| {
        temporary.write_all(bytes)?;
        // The existing file's mode, as if it had been written in place.
        if let Ok(metadata) = fs::metadata(target) {
            temporary.as_file().set_permissions(metadata.permissions())?;
        }
        // Before the rename: otherwise a power cut could leave the new name on missing data.
        temporary.as_file().sync_all()?;
        temporary.persist(target).map_err(|error| error.error)?;
        sync_directory(directory_of(target));
        Ok(())
    });
    written.map_err(|error| failure(path, bytes.len(), error))
}

/// Creates a temporary file beside `target`, locked for as long as it is open.
fn locked_temporary(target: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    let prefix = temporary_prefix(target);
    builder.prefix(&prefix).suffix(TEMPORARY_SUFFIX);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // What any new file gets: the umask is applied to it.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    loop {
        let temporary = builder.tempfile_in(directory_of(target))?;
        // A file system without locks has no one to remove the file either.
        let unlockable = temporary.as_file().lock().is_err();
        // Between creation and lock another process may have taken it for abandoned.
        if unlockable || temporary.path().exists() {
            return Ok(temporary);
        }
    }
}

/// Hidden, and recognisable as a part of `target`. At most 194 bytes, so that the whole fits a file name.
fn temporary_prefix(target: &Path) -> String {
    let name: String = target.file_name().unwrap_or(OsStr::new("")).to_string_lossy().chars().take(48).collect();
    format!(".{name}.")
}

/// Removes temporary files of `target` whose writers are gone. Failing to is no failure.
fn remove_abandoned(target: &Path) {
    let prefix = temporary_prefix(target);
    let entries = fs::read_dir(directory_of(target)).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let ours = name.starts_with(&prefix) && name.ends_with(TEMPORARY_SUFFIX);
        // The type of the entry itself: a link could lead anywhere, and opening a FIFO would wait.
        if !ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // Opened for writing, because NFS needs that to lock. The lock is held until the file is gone.
        if let Ok(file) = OpenOptions::new().write(true).open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Makes the rename itself survive a power cut, where the system offers that.
fn sync_directory(directory: &Path) {
    if cfg!(unix) {
        // Some file systems refuse; the file is complete either way.
        let _ = File::open(directory).and_then(|directory| directory.sync_all());
    }
}

fn failure(path: &Path, bytes: usize, source: io::Error) -> OutputError {
    classify(Destination::File(path.into()), bytes, source)
}

fn classify(destination: Destination, bytes: usize, source: io::Error) -> OutputError {
    use ErrorKind as Kind;
    match (source.kind(), destination) {
        (Kind::PermissionDenied | Kind::ReadOnlyFilesystem, Destination::File(path)) => {
            OutputError::Denied { path, source }
        }
        (Kind::NotADirectory, Destination::File(path)) => {
            let parent = directory_of(&path).into();
            OutputError::ParentNotDirectory { path, parent }
        }
        (Kind::BrokenPipe, destination) => OutputError::Closed { destination },
        (Kind::StorageFull | Kind::QuotaExceeded | Kind::FileTooLarge, destination) => {
            OutputError::Full { destination, bytes }
        }
        (_, destination) => OutputError::Io { destination, source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exit::{Exit, HasExit};

    #[test]
    fn a_temporary_file_is_removed_only_if_nobody_writes_it() {
        let directory = tempfile::tempdir().expect("a directory");
        let target = directory.path().join("a.exr");
        let living = locked_temporary(&target).expect("a file");
        let abandoned = locked_temporary(&target).expect("a file");
        let abandoned = abandoned.into_temp_path().keep().expect("stays behind");
        let foreign = directory.path().join(".b.exr.abc.weir-tmp");
        fs::write(&foreign, "").expect("writes");

        remove_abandoned(&target);
        assert!(living.path().exists());
        assert!(!abandoned.exists());
        assert!(foreign.exists());
    }

    #[test]
    fn a_temporary_file_is_beside_its_target_and_carries_its_name() {
        let directory = tempfile::tempdir().expect("a directory");
        let temporary = locked_temporary(&directory.path().join("a.exr")).expect("a file");
        assert_eq!(temporary.path().parent(), Some(directory.path()));
        let name = temporary.path().file_name().expect("a name").to_string_lossy().into_owned();
        assert!(name.starts_with(".a.exr.") && name.ends_with(TEMPORARY_SUFFIX), "{name}");
    }

    #[test]
    fn the_longest_file_name_still_leaves_room() {
        let directory = tempfile::tempdir().expect("a directory");
        for name in ["x".repeat(255), "\u{1f600}".repeat(63)] {
            let path = directory.path().join(&name);
            write(&Destination::File(path.clone()), b"whole").expect("writes");
            assert_eq!(fs::read(path).expect("reads"), b"whole");
        }
    }

    /// A pipe of which the reading end is closed, as `weir render -o - | true` makes one.
    #[cfg(unix)]
    #[test]
    fn a_reader_that_went_away_is_an_error() {
        let (reader, writer) = io::pipe().expect("a pipe");
        drop(reader);
        let error = stream(&Destination::Stdout, Ok(writer), b"late").expect_err("nobody reads");
        assert!(matches!(error, OutputError::Closed { destination: Destination::Stdout }), "{error:?}");
        assert_eq!(error.exit(), Exit::Io);
    }

    /// Writing may succeed and only flushing fail, as it does for a buffered standard output.
    #[test]
    fn a_failing_flush_is_an_error() {
        struct FullOnFlush;
        impl Write for FullOnFlush {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                Ok(bytes.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Err(ErrorKind::StorageFull.into())
            }
        }
        let error = stream(&Destination::Stdout, Ok(FullOnFlush), b"x").expect_err("full");
        assert!(matches!(error, OutputError::Full { bytes: 1, .. }), "{error:?}");
    }

    #[test]
    fn what_the_system_refuses_is_told_apart() {
        let error = |kind: ErrorKind| failure(Path::new("d/a.exr"), 9, kind.into());
        assert!(matches!(error(ErrorKind::PermissionDenied), OutputError::Denied { .. }));
        assert!(matches!(error(ErrorKind::ReadOnlyFilesystem), OutputError::Denied { .. }));
        assert!(matches!(error(ErrorKind::QuotaExceeded), OutputError::Full { bytes: 9, .. }));
        assert_eq!(error(ErrorKind::StaleNetworkFileHandle).exit(), Exit::Temporary);
        let message = error(ErrorKind::StorageFull).to_string();
        assert_eq!(message, "no space left for 9 bytes; free some or choose another disk: d/a.exr");
    }
}
