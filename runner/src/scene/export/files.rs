//! A set of files that appear together or not at all.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempPath};

use super::ExportError;

/// Complete files that wait for their names in the directory they will stay in.
pub(super) struct PendingFiles {
    dir: PathBuf,
    /// Directories that did not exist before, the innermost first.
    made: Vec<PathBuf>,
    waiting: Vec<(TempPath, PathBuf)>,
}

impl PendingFiles {
    /// Starts an empty set; makes the directory where it is missing.
    pub(super) fn in_dir(dir: &Path) -> Result<Self, ExportError> {
        let made = dir
            .ancestors()
            .filter(|path| !path.as_os_str().is_empty())
            .take_while(|path| !path.exists())
            .map(Path::to_owned)
            .collect();
        // From here on, dropping removes what was made.
        let files = Self { dir: dir.to_owned(), made, waiting: Vec::new() };
        match fs::create_dir_all(dir) {
            Ok(()) => Ok(files),
            Err(source) => Err(ExportError::Directory { path: dir.to_owned(), source }),
        }
    }

    /// Adds a file called `name`, filled by `fill`.
    pub(super) fn write(
        &mut self,
        name: &str,
        fill: impl FnOnce(&mut BufWriter<NamedTempFile>) -> io::Result<()>,
    ) -> Result<(), ExportError> {
        let path = self.dir.join(name);
        let filled = || -> io::Result<TempPath> {
            let mut out = BufWriter::with_capacity(1 << 18, new_temporary(&self.dir)?);
            fill(&mut out)?;
            out.flush()?;
            Ok(out.into_inner()?.into_temp_path())
        };
        let temporary = filled().map_err(|source| ExportError::Write { path: path.clone(), source })?;
        self.waiting.push((temporary, path));
        Ok(())
    }

    /// Gives every file its name, in the order they were written.
    pub(super) fn finish(mut self) -> Result<Vec<PathBuf>, ExportError> {
        let mut named: Vec<PathBuf> = Vec::new();
        for (temporary, path) in std::mem::take(&mut self.waiting) {
            if let Err(error) = temporary.persist(&path) {
                // Best effort: a file that cannot be removed either is no worse than the error reported.
                named.iter().for_each(|path| drop(fs::remove_file(path)));
                return Err(ExportError::Write { path, source: error.error });
            }
            named.push(path);
        }
        self.made.clear();
        Ok(named)
    }
}

impl Drop for PendingFiles {
    fn drop(&mut self) {
        // The temporary files first: a directory must be empty to go.
        self.waiting.clear();
        self.made.iter().for_each(|dir| drop(fs::remove_dir(dir)));
    }
}

/// A temporary file in `dir` with the permissions of an ordinary new file.
fn new_temporary(dir: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".weir-export-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(dir)
}
