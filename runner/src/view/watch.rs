//! Files that change while they are shown.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use notify::{RecommendedWatcher, RecursiveMode};
use notify_debouncer_full::{DebounceEventResult, Debouncer, RecommendedCache, new_debouncer};

/// Editors write a file in several steps: this long after the last, it is read.
const QUIET: Duration = Duration::from_millis(300);

/// Watches the folder of a scene until it is dropped.
pub struct Watch {
    _debouncer: Debouncer<RecommendedWatcher, RecommendedCache>,
}

impl Watch {
    /// Calls `changed` when the scene file or a material library beside it has changed. Folders are watched, because
    /// editors put another file in the place of the one that was there.
    ///
    /// # Errors
    /// If the system can't watch there, in its words.
    pub fn new(file: &Path, changed: impl Fn() + Send + 'static) -> Result<Self, String> {
        let file = std::path::absolute(file).map_err(|error| error.to_string())?;
        let folder = file.parent().map_or_else(|| PathBuf::from("."), Path::to_owned);
        let watched = file.clone();
        let heard = move |events: DebounceEventResult| {
            let Ok(events) = events else { return };
            let writes = events.iter().filter(|event| !event.kind.is_access());
            if writes.flat_map(|event| &event.paths).any(|path| is_part_of(path, &watched)) {
                changed();
            }
        };
        let mut debouncer = new_debouncer(QUIET, None, heard).map_err(|error| error.to_string())?;
        debouncer.watch(&folder, RecursiveMode::NonRecursive).map_err(|error| error.to_string())?;
        Ok(Self { _debouncer: debouncer })
    }
}

/// Whether a path is the scene file, or a library that it may use.
fn is_part_of(path: &Path, scene: &Path) -> bool {
    path.file_name() == scene.file_name() || path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("mtl"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn a_file_that_is_replaced_is_noticed_and_others_are_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let scene = folder.path().join("a.obj");
        std::fs::write(&scene, "v 0 0 0\n").expect("writable");
        let (sender, receiver) = mpsc::channel();
        let _watch = Watch::new(&scene, move || assert!(sender.send(()).is_ok())).expect("the system can watch");
        std::fs::write(folder.path().join("note.txt"), "nothing").expect("writable");
        assert!(receiver.recv_timeout(3 * QUIET).is_err(), "a note is no part of the scene");
        std::fs::write(folder.path().join("b.obj"), "v 1 1 1\n").expect("writable");
        std::fs::rename(folder.path().join("b.obj"), &scene).expect("renamable");
        receiver.recv_timeout(Duration::from_secs(10)).expect("the scene has changed");
    }
}
