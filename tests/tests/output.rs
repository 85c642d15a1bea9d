//! Results on the disk: whole or absent, and clear words when they cannot be written.

#![expect(clippy::unwrap_used, reason = "a test that cannot set up its files has failed")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;
use weir::exit::{Exit, HasExit};
use weir::output::exr::{Metadata, ReadError};
use weir::output::{Destination, Layers, OutputError, Picture, atomic, exr, png};

fn file(path: impl Into<PathBuf>) -> Destination {
    Destination::File(path.into())
}

fn names_in(directory: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn picture() -> Picture {
    Picture { width: 2, height: 1, rgb: vec![[1.0, 2.0, 3.0], [-4.0, f32::INFINITY, 1e-30]], alpha: None }
}

fn write_picture(destination: &Destination) -> Result<(), OutputError> {
    exr::write(destination, &picture(), &Layers::default(), &Metadata::default())
}

/// Writes to `path`, expects failure, and that the directory is as it was.
fn refused(directory: &TempDir, path: &Path) -> OutputError {
    let before = names_in(directory.path());
    let error = write_picture(&file(path)).unwrap_err();
    assert_eq!(names_in(directory.path()), before, "something was left behind");
    assert!(error.to_string().contains(path.to_str().unwrap()), "no path in: {error}");
    error
}

#[test]
fn a_picture_survives_the_disk_and_leaves_nothing_beside_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    for _ in 0..2 {
        write_picture(&file(&path)).unwrap();
        assert_eq!(exr::read(&path).unwrap(), (picture(), vec![]));
    }
    png::write(&file(directory.path().join("a.png")), 1, 1, &[0xff00_00ff]).unwrap();
    assert_eq!(names_in(directory.path()), ["a.exr", "a.png"]);
}

#[test]
fn a_missing_directory_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let error = refused(&directory, &directory.path().join("missing/a.exr"));
    assert!(matches!(&error, OutputError::MissingParent { parent, .. } if parent.ends_with("missing")), "{error:?}");
    assert_eq!(error.exit(), Exit::CannotCreate);
}

#[test]
fn a_file_in_place_of_the_directory_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let parent = directory.path().join("file");
    fs::write(&parent, "").unwrap();
    let error = refused(&directory, &parent.join("a.exr"));
    assert!(matches!(error, OutputError::ParentNotDirectory { .. }), "{error:?}");
    assert_eq!(error.exit(), Exit::CannotCreate);
}

#[test]
fn a_directory_is_not_an_output() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    fs::create_dir(&path).unwrap();
    let error = refused(&directory, &path);
    assert!(matches!(error, OutputError::IsDirectory { .. }), "{error:?}");
    assert_eq!(error.exit(), Exit::CannotCreate);
}

#[test]
fn a_path_that_can_only_be_a_directory_needs_a_file_name() {
    let directory = tempfile::tempdir().unwrap();
    for name in ["missing/", "missing/.."] {
        let error = refused(&directory, &directory.path().join(name));
        assert!(matches!(error, OutputError::NoName { .. }), "{name}: {error:?}");
    }
}

#[test]
fn a_read_only_file_is_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    fs::write(&path, "precious").unwrap();
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&path, permissions).unwrap();
    let error = refused(&directory, &path);
    assert!(matches!(error, OutputError::ReadOnly { .. }), "{error:?}");
    assert_eq!(fs::read(&path).unwrap(), b"precious");
}

#[test]
fn a_picture_that_is_not_there_or_not_a_file_is_no_input() {
    let directory = tempfile::tempdir().unwrap();
    let missing = exr::read(&directory.path().join("missing.exr")).unwrap_err();
    assert!(matches!(missing, ReadError::Open { .. }), "{missing:?}");
    let not_a_file = exr::read(directory.path()).unwrap_err();
    assert!(matches!(not_a_file, ReadError::NotAFile { .. }), "{not_a_file:?}");
    assert_eq!([missing.exit(), not_a_file.exit()], [Exit::NoInput; 2]);
}

#[test]
fn a_picture_of_another_format_is_bad_data_and_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    fs::write(&path, "text").unwrap();
    let error = exr::read(&path).unwrap_err();
    assert_eq!(error.exit(), Exit::BadData);
    assert!(error.to_string().ends_with(path.to_str().unwrap()), "{error}");
}

#[cfg(unix)]
mod unix {
    use std::io::Read;
    use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};

    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_an_io_error_and_stays_a_device() {
        let error = write_picture(&file("/dev/full")).unwrap_err();
        assert!(matches!(error, OutputError::Full { .. }), "{error:?}");
        assert_eq!(error.exit(), Exit::Io);
        assert!(fs::metadata("/dev/full").unwrap().file_type().is_char_device());
    }

    #[test]
    fn the_null_device_takes_everything_and_stays_a_device() {
        write_picture(&file("/dev/null")).unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    }

    #[test]
    fn a_link_stays_and_its_target_is_replaced() {
        let directory = tempfile::tempdir().unwrap();
        let (link, target) = (directory.path().join("link.exr"), directory.path().join("target.exr"));
        fs::write(&target, "old").unwrap();
        symlink("target.exr", &link).unwrap();
        write_picture(&file(&link)).unwrap();
        assert!(link.is_symlink());
        assert_eq!(exr::read(&target).unwrap().0, picture());
    }

    #[test]
    fn a_link_to_nothing_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let link = directory.path().join("link.exr");
        symlink("missing.exr", &link).unwrap();
        let error = refused(&directory, &link);
        assert!(matches!(error, OutputError::DanglingLink { .. }), "{error:?}");
    }

    #[test]
    fn a_socket_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&path).unwrap();
        let error = refused(&directory, &path);
        assert!(matches!(error, OutputError::NotAFile { .. }), "{error:?}");
    }

    #[test]
    fn a_fifo_is_written_in_place() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("fifo");
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        let reader = {
            let path = path.clone();
            std::thread::spawn(move || {
                let mut bytes = Vec::new();
                fs::File::open(path).unwrap().read_to_end(&mut bytes).map(|_| bytes)
            })
        };
        atomic::write(&file(&path), b"through").unwrap();
        assert_eq!(reader.join().unwrap().unwrap(), b"through");
        assert!(fs::metadata(&path).unwrap().file_type().is_fifo());
    }

    /// Only for those whom permissions bind; the superuser may write anywhere.
    #[test]
    fn a_directory_without_permission_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        fs::set_permissions(directory.path(), fs::Permissions::from_mode(0o555)).unwrap();
        let superuser = fs::metadata("/proc/self").is_ok_and(|process| process.uid() == 0);
        if superuser {
            eprintln!("skipped: the superuser may write to a read-only directory");
        } else {
            let error = refused(&directory, &path);
            assert!(matches!(error, OutputError::Denied { .. }), "{error:?}");
            assert_eq!(error.exit(), Exit::CannotCreate);
        }
    }

    #[test]
    fn a_new_file_is_as_readable_as_any_other_and_an_old_one_keeps_its_mode() {
        let directory = tempfile::tempdir().unwrap();
        let mode = |name: &str| fs::metadata(directory.path().join(name)).unwrap().mode() & 0o777;
        let path = directory.path().join("a.exr");
        fs::write(directory.path().join("plain"), "").unwrap();
        write_picture(&file(&path)).unwrap();
        assert_eq!(mode("a.exr"), mode("plain"));

        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        write_picture(&file(&path)).unwrap();
        assert_eq!(mode("a.exr"), 0o640);
    }
}

/// Names the output to the child process of the tests below.
const CHILD_OUTPUT: &str = "WEIR_TEST_CHILD_OUTPUT";
/// Large enough to be killed in the middle of.
const CHILD_BYTES: usize = 16 << 20;

/// Writes the same file again and again until it is killed; each time filled with another byte.
#[test]
#[ignore = "a child process of the tests in this file"]
fn child_that_writes_until_killed() {
    let Some(path) = std::env::var_os(CHILD_OUTPUT) else {
        eprintln!("skipped: only the tests in this file start it");
        return;
    };
    let started = Instant::now();
    // Should the parent die first, this ends all the same.
    while started.elapsed() < Duration::from_secs(60) {
        for byte in 1..=255 {
            atomic::write(&file(&path), &vec![byte; CHILD_BYTES]).unwrap();
        }
    }
}

fn spawn_child(path: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "child_that_writes_until_killed"])
        .env(CHILD_OUTPUT, path)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn assert_whole(path: &Path) {
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes.len(), CHILD_BYTES, "cut off");
    assert!(bytes.iter().all(|byte| *byte == bytes[0]), "two writes are mixed");
}

/// Killed at 50 moments spread over several writes.
#[test]
fn a_killed_writer_leaves_the_output_whole_and_the_next_one_cleans_up() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.bin");
    for attempt in 0..50 {
        let mut child = spawn_child(&path);
        std::thread::sleep(Duration::from_millis(5 + 3 * attempt));
        child.kill().unwrap();
        child.wait().unwrap();
        if path.exists() {
            assert_whole(&path);
        }
    }
    assert!(path.exists(), "the child never finished a write: the test needs more time or fewer bytes");

    atomic::write(&file(&path), &[7; CHILD_BYTES]).unwrap();
    assert_whole(&path);
    assert_eq!(names_in(directory.path()), ["a.bin"]);
}

#[test]
fn writers_of_the_same_file_do_not_disturb_each_other() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.bin");
    std::thread::scope(|scope| {
        for byte in 1..=4 {
            let path = &path;
            scope.spawn(move || {
                for _ in 0..25 {
                    atomic::write(&file(path), &[byte; 4096]).unwrap();
                }
            });
        }
    });
    let bytes = fs::read(&path).unwrap();
    assert!(bytes.len() == 4096 && bytes.iter().all(|byte| *byte == bytes[0]));
    assert_eq!(names_in(directory.path()), ["a.bin"]);
}
