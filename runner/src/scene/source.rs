//! Where the files of a scene come from: a folder, or memory.
//!
//! Names inside scene files are not trusted. A [`Directory`] opens regular files inside its roots and nothing
//! else, whatever `..`, links, absolute paths or drive letters a name uses.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::error::SceneError;

/// Opens files by the names that scene files use.
pub trait Source: Sync {
    /// Opens `name`, relative to the scene's folder, with `/` or `\` between folders.
    ///
    /// # Errors
    /// When there is no such file, when it lies outside what the source may open, or when opening fails.
    fn open(&self, name: &str) -> Result<Opened, SourceError>;

    /// A name that [`Self::open`] accepts for the file called `base_name`, in whichever folder of the scene it is.
    fn find(&self, base_name: &str) -> Option<String>;
}

/// An open file.
pub struct Opened {
    /// The same for every name of this file: what caches go by.
    pub key: String,
    /// What messages call it.
    pub path: String,
    /// Its size, in bytes.
    pub bytes: u64,
    /// Its contents.
    pub reader: Box<dyn Read + Send>,
}

impl Opened {
    /// Reads all of it, at most `max_bytes`.
    ///
    /// # Errors
    /// When the file is larger, or reading fails.
    pub fn read(self, max_bytes: u64) -> Result<Vec<u8>, SourceError> {
        if self.bytes > max_bytes {
            return Err(SourceError::TooLarge { bytes: self.bytes, max_bytes });
        }
        let mut contents = Vec::with_capacity(self.bytes as usize);
        // One byte more than allowed shows that the file has grown meanwhile.
        self.reader.take(max_bytes.saturating_add(1)).read_to_end(&mut contents).map_err(SourceError::Io)?;
        match contents.len() as u64 {
            bytes if bytes > max_bytes => Err(SourceError::TooLarge { bytes, max_bytes }),
            _ => Ok(contents),
        }
    }
}

/// Why a [`Source`] does not open a name.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// No file has this name.
    #[error("there is no such file")]
    NotFound,
    /// The name leads out of the scene's folder.
    #[error("it lies outside the scene's folder; `--asset-root` allows another one")]
    Outside,
    /// A folder, pipe, socket or device.
    #[error("it is not a regular file")]
    NotAFile,
    /// Larger than the limit.
    #[error("it has {bytes} bytes, the limit is {max_bytes}; `--max-size` raises it")]
    TooLarge {
        /// Its size.
        bytes: u64,
        /// The limit.
        max_bytes: u64,
    },
    /// The system refused.
    #[error("{0}")]
    Io(io::Error),
}

/// Turns `\` into `/`, and strips blanks and quotation marks around the name.
fn portable(name: &str) -> String {
    name.trim().trim_matches('"').replace('\\', "/")
}

/// Whether a name with forward slashes is absolute on any system.
fn is_absolute(name: &str) -> bool {
    let bytes = name.as_bytes();
    name.starts_with('/') || (bytes.len() >= 2 && bytes[0].is_ascii_alphabetic() && bytes[1] == b':')
}

/// The last part of a name, if it can be the name of a file.
fn base_name(name: &str) -> Option<&str> {
    let base = name.rsplit('/').next().unwrap_or(name);
    (!matches!(base, "" | "." | "..")).then_some(base)
}

/// A file found for a name in a scene file.
pub struct Located {
    /// The name under which the source opens it.
    pub name: String,
    /// The open file.
    pub file: Opened,
    /// Set when another file than the one named stands in for it: why.
    pub replaced: Option<SourceError>,
}

/// Opens `name` relative to `folder` (itself relative to the scene's, empty or ending in `/`), else relative to the
/// scene's folder, else any file of the scene with the same last part.
///
/// # Errors
/// When none of them can be opened: the reason for the first.
pub fn locate(source: &dyn Source, folder: &str, name: &str) -> Result<Located, SourceError> {
    let name = portable(name);
    let mut candidates = vec![name.clone()];
    if !folder.is_empty() && !is_absolute(&name) {
        candidates.insert(0, format!("{folder}{name}"));
    }
    let mut reason = None;
    for candidate in candidates {
        match source.open(&candidate) {
            Ok(file) => {
                return Ok(Located { name: candidate, file, replaced: None });
            }
            Err(error) => _ = reason.get_or_insert(error),
        }
    }
    let reason = reason.unwrap_or(SourceError::NotFound);
    let found = base_name(&name).and_then(|base| source.find(base));
    match found.and_then(|name| source.open(&name).ok().map(|file| (name, file))) {
        Some((name, file)) => Ok(Located { name, file, replaced: Some(reason) }),
        None => Err(reason),
    }
}

/// Regular files below a scene's folder, and below an asset root where one is given.
pub struct Directory {
    /// As given, for messages, and resolved, for the test whether a file lies inside.
    roots: Vec<(PathBuf, PathBuf)>,
    by_base_name: OnceLock<HashMap<String, String>>,
}

impl Directory {
    /// How many entries, and how many folders down, [`Source::find`] looks.
    const MAX_SEARCH: (usize, usize) = (20_000, 4);

    /// The folder of a scene file, and the name of that file in it.
    ///
    /// # Errors
    /// When the file is missing or not a regular file, or the asset root is not a folder.
    pub fn of_scene(scene: &Path, asset_root: Option<&Path>) -> Result<(Self, String), SceneError> {
        let shown = scene.display().to_string();
        let resolved = scene.canonicalize().map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => SceneError::no_input(&shown, "there is no such file", "check the path"),
            _ => {
                SceneError::no_input(&shown, format!("cannot be opened: {error}"), "check the path and its permissions")
            }
        })?;
        if !resolved.is_file() {
            return Err(SceneError::no_input(&shown, "is not a regular file", "name the .obj file itself"));
        }
        let name = resolved
            .file_name()
            .and_then(|name| name.to_str().map(str::to_owned))
            .ok_or_else(|| SceneError::no_input(&shown, "its name is not valid Unicode", "rename the file"))?;
        let shown_folder = scene.parent().unwrap_or(Path::new("")).to_owned();
        let folder = resolved.parent().unwrap_or(Path::new("/")).to_owned();
        let mut roots = vec![(shown_folder.clone(), folder)];
        // A link to the scene file: what lies beside the link belongs to the scene as well.
        let beside = if shown_folder.as_os_str().is_empty() { Path::new(".") } else { &shown_folder };
        if let Ok(beside) = beside.canonicalize()
            && beside != roots[0].1
        {
            roots.push((shown_folder, beside));
        }
        if let Some(root) = asset_root {
            let resolved = root.canonicalize().ok().filter(|path| path.is_dir()).ok_or_else(|| {
                SceneError::no_input(
                    root.display().to_string(),
                    "the asset root is not a folder",
                    "check `--asset-root`",
                )
            })?;
            roots.push((root.to_owned(), resolved));
        }
        Ok((Self { roots, by_base_name: OnceLock::new() }, name))
    }

    /// Every regular file below the roots, by lower-case base name; of equal ones the first, a folder before those in it.
    fn index(&self) -> HashMap<String, String> {
        let mut index = HashMap::new();
        let (mut entries_left, max_depth) = Self::MAX_SEARCH;
        for (_, root) in &self.roots {
            let mut folders = vec![(root.clone(), String::new(), 0)];
            while let Some((folder, prefix, depth)) = folders.pop() {
                let Ok(entries) = folder.read_dir() else {
                    continue;
                };
                let mut entries: Vec<_> = entries.flatten().take(entries_left).collect();
                entries_left -= entries.len();
                entries.sort_by_key(|entry| std::cmp::Reverse(entry.file_name()));
                let files_first = entries.iter().rev();
                for entry in files_first {
                    let (Ok(kind), Ok(name)) = (entry.file_type(), entry.file_name().into_string()) else {
                        continue;
                    };
                    if kind.is_file() {
                        index.entry(name.to_lowercase()).or_insert_with(|| format!("{prefix}{name}"));
                    }
                }
                for entry in entries {
                    let (Ok(kind), Ok(name)) = (entry.file_type(), entry.file_name().into_string()) else {
                        continue;
                    };
                    if kind.is_dir() && depth < max_depth {
                        folders.push((entry.path(), format!("{prefix}{name}/"), depth + 1));
                    }
                }
            }
        }
        index
    }
}

impl Source for Directory {
    fn open(&self, name: &str) -> Result<Opened, SourceError> {
        let name = portable(name);
        if is_absolute(&name) {
            return Err(SourceError::Outside);
        }
        let mut reason = SourceError::NotFound;
        for (shown, root) in &self.roots {
            // Fails for missing files, and for names that no file can have.
            let Ok(resolved) = root.join(&name).canonicalize() else {
                continue;
            };
            if !self.roots.iter().any(|(_, root)| resolved.starts_with(root)) {
                reason = SourceError::Outside;
                continue;
            }
            // Before opening: opening a pipe would wait for a writer.
            let metadata = resolved.metadata().map_err(SourceError::Io)?;
            if !metadata.is_file() {
                reason = SourceError::NotAFile;
                continue;
            }
            let file = std::fs::File::open(&resolved).map_err(SourceError::Io)?;
            return Ok(Opened {
                key: resolved.to_string_lossy().into_owned(),
                path: shown.join(&name).display().to_string(),
                bytes: metadata.len(),
                reader: Box::new(file),
            });
        }
        Err(reason)
    }

    fn find(&self, base_name: &str) -> Option<String> {
        self.by_base_name.get_or_init(|| self.index()).get(&base_name.to_lowercase()).cloned()
    }
}

/// Files held in memory: what a browser has fetched, or what a test has made up.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    files: BTreeMap<String, std::sync::Arc<[u8]>>,
}

impl Memory {
    /// Adds a file, or replaces it.
    pub fn insert(&mut self, name: impl Into<String>, contents: impl AsRef<[u8]>) {
        self.files.insert(name.into(), contents.as_ref().into());
    }
}

impl<N: Into<String>, C: AsRef<[u8]>> FromIterator<(N, C)> for Memory {
    fn from_iter<I: IntoIterator<Item = (N, C)>>(files: I) -> Self {
        let mut memory = Self::default();
        files.into_iter().for_each(|(name, contents)| memory.insert(name, contents));
        memory
    }
}

impl Source for Memory {
    fn open(&self, name: &str) -> Result<Opened, SourceError> {
        let name = portable(name);
        let name = name.strip_prefix("./").unwrap_or(&name);
        let contents = self.files.get(name).ok_or(SourceError::NotFound)?.clone();
        Ok(Opened {
            key: name.to_owned(),
            path: name.to_owned(),
            bytes: contents.len() as u64,
            reader: Box::new(io::Cursor::new(contents)),
        })
    }

    fn find(&self, base: &str) -> Option<String> {
        let same = |name: &&String| base_name(name).is_some_and(|other| other.eq_ignore_ascii_case(base));
        self.files.keys().find(same).cloned()
    }
}
