//! Settings in a file, from one run to the next.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use etcetera::{BaseStrategy, choose_base_strategy};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{buffers::View, navigation::StoredCamera, state::State};
use crate::{
    output::{Destination, OutputError, atomic},
    technique::ToneCurve,
};

/// Larger files are none of ours.
const MOST_BYTES: u64 = 1 << 20;

/// What is kept.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Stored {
    render_scale: Option<f32>,
    smooth: Option<bool>,
    vsync: Option<bool>,
    tone: Option<String>,
    exposure_ev: Option<f32>,
    auto_exposure: Option<bool>,
    accumulate: Option<bool>,
    goal_percent: Option<f32>,
    view: Option<View>,
    panels: Option<bool>,
    knobs: BTreeMap<String, String>,
    bookmarks: BTreeMap<String, StoredCamera>,
}

/// Why settings were not read or written.
#[derive(Debug, Error)]
pub enum StoredError {
    /// The system has no folder for them.
    #[error("there is no folder for settings; set XDG_CONFIG_HOME")]
    NoFolder,
    /// The file can't be read.
    #[error("cannot read the settings: {reason}: {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// The folder can't be created, or the file not written.
    #[error("cannot write the settings: {0}")]
    Write(String),
}

impl From<OutputError> for StoredError {
    fn from(error: OutputError) -> Self {
        Self::Write(error.to_string())
    }
}

/// Where settings are kept.
///
/// # Errors
/// If the system has no folder for them.
pub fn path() -> Result<PathBuf, StoredError> {
    let strategy = choose_base_strategy().map_err(|_| StoredError::NoFolder)?;
    Ok(strategy.config_dir().join("weir").join("viewer.toml"))
}

fn word(curve: ToneCurve) -> Option<String> {
    use clap::ValueEnum;
    Some(curve.to_possible_value()?.get_name().to_owned())
}

impl Stored {
    /// What of the state is kept.
    pub fn of(state: &State) -> Self {
        let numbered = state.bookmarks.iter().enumerate();
        let bookmarks = numbered.filter_map(|(i, camera)| Some(((i + 1).to_string(), (*camera)?.into())));
        Self {
            render_scale: Some(state.render_scale),
            smooth: Some(state.smooth),
            vsync: Some(state.vsync),
            tone: word(state.curve),
            exposure_ev: Some(state.exposure_ev),
            auto_exposure: Some(state.auto_exposure),
            accumulate: Some(state.accumulate),
            goal_percent: Some(state.goal_percent),
            view: Some(state.view),
            panels: Some(state.panels),
            knobs: state.settings.describe().into_iter().map(|(key, value)| (key.to_owned(), value)).collect(),
            bookmarks: bookmarks.collect(),
        }
    }

    /// Puts it back; what is out of range is left as it is, and named in the result.
    pub fn restore(self, state: &mut State) -> Vec<String> {
        use clap::ValueEnum;
        let mut refused = Vec::new();
        let mut number = |name: &str, value: Option<f32>, low: f32, high: f32, target: &mut f32| match value {
            Some(value) if (low..=high).contains(&value) => *target = value,
            Some(value) => refused.push(format!("`{name}` takes {low} to {high}, not {value}")),
            None => {}
        };
        number("render_scale", self.render_scale, 0.1, 2.0, &mut state.render_scale);
        number("exposure_ev", self.exposure_ev, -20.0, 20.0, &mut state.exposure_ev);
        number("goal_percent", self.goal_percent, 0.01, 100.0, &mut state.goal_percent);
        state.smooth = self.smooth.unwrap_or(state.smooth);
        state.vsync = self.vsync.unwrap_or(state.vsync);
        state.auto_exposure = self.auto_exposure.unwrap_or(state.auto_exposure);
        state.accumulate = self.accumulate.unwrap_or(state.accumulate);
        state.view = self.view.unwrap_or(state.view);
        state.panels = self.panels.unwrap_or(state.panels);
        match self.tone.as_deref().map(|word| ToneCurve::from_str(word, true)) {
            Some(Ok(curve)) => state.curve = curve,
            Some(Err(reason)) => refused.push(format!("`tone`: {reason}")),
            None => {}
        }
        let mut settings = state.settings.clone();
        for (key, value) in &self.knobs {
            if let Err(error) = settings.apply(&format!("{key}={value}")) {
                refused.push(error.to_string());
            }
        }
        match settings.check() {
            Ok(()) => state.settings = settings,
            Err(error) => refused.push(error.to_string()),
        }
        for (number, camera) in self.bookmarks {
            let slot = number.parse::<usize>().ok().and_then(|n| state.bookmarks.get_mut(n.wrapping_sub(1)));
            match (slot, crate::scene::Camera::from(camera)) {
                (Some(slot), camera) if camera.check().is_ok() => *slot = Some(camera),
                _ => refused.push(format!("bookmark {number} is no camera, or not of 1 to 9")),
            }
        }
        refused
    }
}

/// Writes the state to a file.
///
/// # Errors
/// If that can't be done.
pub fn save(state: &State, path: &Path) -> Result<(), StoredError> {
    let text = toml::to_string_pretty(&Stored::of(state)).map_err(|error| StoredError::Write(error.to_string()))?;
    if let Some(folder) = path.parent() {
        let made = std::fs::create_dir_all(folder);
        made.map_err(|error| StoredError::Write(format!("{error}: {}", folder.display())))?;
    }
    Ok(atomic::write(&Destination::File(path.to_owned()), text.as_bytes())?)
}

/// Reads a file into the state; what it says that is out of range is left out, and named in the result.
///
/// # Errors
/// If it can't be read, or is not such a file.
pub fn load(state: &mut State, path: &Path) -> Result<Vec<String>, StoredError> {
    let read = |reason: String| StoredError::Read { path: path.to_owned(), reason };
    let size = std::fs::metadata(path).map_err(|error| read(error.to_string()))?.len();
    if size > MOST_BYTES {
        return Err(read(format!("the file has {size} bytes, the limit is {MOST_BYTES}")));
    }
    let text = std::fs::read_to_string(path).map_err(|error| read(error.to_string()))?;
    let stored: Stored = toml::from_str(&text).map_err(|error| read(error.to_string().trim().to_owned()))?;
    Ok(stored.restore(state))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{scene::choice::Choice, settings::Settings, view::keys::Action};

    fn state() -> State {
        State::new(Choice::new("rooms"), Settings::default())
    }

    #[test]
    fn what_is_saved_comes_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("deep/viewer.toml");
        let mut changed = state();
        changed.set_knob("preset", "quality");
        changed.set_knob("reuse.radius", "17.5");
        changed.act(Action::Store(2));
        (changed.render_scale, changed.curve, changed.view) = (0.5, ToneCurve::Aces, View::Normals);
        save(&changed, &path).expect("writable");
        let mut again = state();
        assert_eq!(load(&mut again, &path).expect("readable"), Vec::<String>::new());
        assert_eq!(again.settings, changed.settings);
        assert_eq!((again.render_scale, again.curve, again.view), (0.5, ToneCurve::Aces, View::Normals));
        assert_eq!(again.bookmarks, changed.bookmarks);
    }

    #[test]
    fn what_is_out_of_range_is_named_and_left_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("viewer.toml");
        let text = "render_scale = 50.0\ntone = \"sepia\"\n[knobs]\n\"candidates.count\" = \"0\"\n\"no.such\" = \"1\"\n\
                    \"spatial.rounds\" = \"2\"\n[bookmarks.12]\norigin = [0.0, 0.0, 0.0]\ntarget = [0.0, 0.0, 1.0]\n\
                    up = [0.0, 1.0, 0.0]\nvfov_deg = 40.0\n";
        std::fs::write(&path, text).expect("writable");
        let mut state = state();
        let refused = load(&mut state, &path).expect("readable");
        assert_eq!(refused.len(), 5, "{refused:?}");
        assert_eq!((state.render_scale, state.settings.spatial_rounds), (1.0, 2));
    }

    #[test]
    fn files_that_are_no_settings_are_errors_with_their_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("viewer.toml");
        for text in ["render_scale = \"wide\"", "unknown = 1", "[", "\u{0}"] {
            std::fs::write(&path, text).expect("writable");
            let error = load(&mut state(), &path).expect_err(text).to_string();
            assert!(error.contains("viewer.toml"), "{error}");
        }
        assert!(load(&mut state(), &folder.path().join("none.toml")).is_err());
    }
}
