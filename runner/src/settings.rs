//! Knobs: every `--set key=value`, with its meaning, range and default, declared once.

mod knobs;
mod preset;

use thiserror::Error;
use weir_shared::{
    frame::Frame,
    light::source,
    light_cuts::cuts_of,
    presample::{LEVEL_CELLS, LEVELS, LightRecord},
    resample::choice,
    reuse::probe,
};

use crate::{
    executor::gpu::Traversal,
    exit::{Exit, HasExit},
    packed::TreeUpdate,
    skips::{Rule, Skips},
};

pub use knobs::{KNOBS, Knob};
pub use preset::Preset;

/// Most records of lights drawn ahead: those of 128 MiB.
const MOST_RECORDS: u32 = (128 << 20) / size_of::<LightRecord>() as u32;

/// Shadow rays: where in the frame, and whether reuse knows of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rays {
    /// One, to the sample that is shaded. Unbiased.
    Speed,
    /// One before reuse, one in each merge for the pixel's own sample, one for what the merge kept. Unbiased.
    Balanced,
    /// One before reuse, and in each merge one for the pixel's own sample and one for that of each other input. Unbiased.
    Quality,
    /// One before reuse, of which reuse does not know. Biased: shadows are wrong where neighbours differ.
    Before,
    /// That, and one to the sample that is shaded. Biased: too dark where neighbours differ.
    Both,
    /// None. Biased: no shadows.
    None,
}

impl Rays {
    /// Whether fresh samples are looked at before reuse.
    pub fn before(self) -> bool {
        matches!(self, Self::Balanced | Self::Quality | Self::Before | Self::Both)
    }

    /// Whether what is shaded is looked at, in a frame that `reuses` samples or not.
    pub fn after(self, reuses: bool) -> bool {
        match self {
            Self::None => false,
            Self::Before => !reuses,
            Self::Speed | Self::Balanced | Self::Quality | Self::Both => true,
        }
    }

    /// What part they have in reuse, see [`probe`].
    pub fn probe(self) -> u32 {
        match self {
            Self::Balanced => probe::ONE,
            Self::Quality => probe::ALL,
            Self::Speed | Self::Before | Self::Both | Self::None => probe::NONE,
        }
    }
}

/// What `--set` changes. Each field has a knob, see [`KNOBS`].
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "the knobs document the fields")]
pub struct Settings {
    pub candidates: u32,
    pub source: u32,
    pub candidates_tree: u32,
    pub tree_update: TreeUpdate,
    pub tile_count: u32,
    pub tile_size: u32,
    pub cell_size: f32,
    pub cell_slots: u32,
    pub cell_candidates: u32,
    pub cut_size: u32,
    pub candidates_bsdf: u32,
    pub candidates_full: u32,
    pub candidates_off_lattice: u32,
    pub reservoirs: u32,
    pub choice: u32,
    pub mis_form: u32,
    pub rays: Rays,
    pub traversal: Traversal,
    pub sum: bool,
    pub confidence_cap: u32,
    pub temporal_neighbors: u32,
    pub temporal_neighbors_unseen: u32,
    pub spatial_rounds: u32,
    pub spatial_neighbors: u32,
    pub spatial_neighbors_unseen: u32,
    pub still_rounds: u32,
    pub still_neighbors: u32,
    pub radius_px: f32,
    pub neighbor_rule: u32,
    pub normal_angle_deg: f32,
    pub plane_tolerance: f32,
    pub roughness_tolerance: f32,
    pub occlusion: u32,
    pub occlusion_reach_px: f32,
    pub lattice: u32,
    pub jitter: bool,
    pub camera_rays: u32,
    pub path_length: u32,
    pub time_s: f32,
    pub time_step_s: f32,
    pub skips: Skips,
}

impl Default for Settings {
    fn default() -> Self {
        Preset::Balanced.settings()
    }
}

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
    /// Two values that exclude each other.
    #[error("{0}")]
    Together(&'static str),
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
        if knob.set(self, value) {
            Ok(())
        } else {
            Err(SettingError::Value { key: knob.key, values: knob.values, value: value.to_owned() })
        }
    }

    /// Checks what no single knob can.
    ///
    /// # Errors
    /// If two knobs exclude each other.
    pub fn check(&self) -> Result<(), SettingError> {
        use weir_shared::merge::form;
        let pairwise = matches!(self.mis_form, form::PAIRWISE | form::PAIRWISE_DEFENSIVE);
        if !pairwise && self.rays.probe() != probe::NONE {
            return Err(SettingError::Together(
                "`reuse.mis` other than pairwise compares all inputs with all, for which `rays` of balanced and quality \
                 do not ask; set `rays=speed`",
            ));
        }
        if self.source == source::TILES && self.tile_size.next_power_of_two() * self.tile_count > MOST_RECORDS {
            return Err(SettingError::Together(
                "`tiles.count` times `tiles.size`, which is rounded up to a power of two, is above 2097152: more lights \
                 drawn ahead than a buffer of 128 MiB holds",
            ));
        }
        if self.choice == choice::INVERSION && self.candidates_full > 0 {
            return Err(SettingError::Together(
                "`reservoirs.choice=inversion` keeps all candidates in memory, where they don't compete in groups; set \
                 `candidates.full=0`",
            ));
        }
        Ok(())
    }

    /// Places for the candidates of a reservoir in memory, see [`Frame::candidates_in_memory`].
    pub fn candidates_in_memory(&self) -> u32 {
        Frame {
            candidates: self.candidates,
            candidates_off_lattice: self.candidates_off_lattice,
            candidates_bsdf: self.candidates_bsdf,
            ..Frame::default()
        }
        .candidates_in_memory()
    }

    /// Columns and rows of records of lights drawn ahead for a picture; one of each where none are drawn.
    pub fn records(&self, width: u32, height: u32) -> [u32; 2] {
        match self.source {
            source::TILES => [self.tile_size.next_power_of_two(), self.tile_count],
            source::CELLS => [self.cell_slots, LEVELS * LEVEL_CELLS],
            source::CUTS => [self.cut_size, cuts_of(width, height)],
            _ => [1; 2],
        }
    }

    /// Whether candidates come down a light tree, or one is to be built all the same.
    pub fn needs_tree(&self) -> bool {
        self.source == source::TREE || self.candidates_tree > 0 || !self.skips.is_on(Rule::Trees)
    }

    /// Every knob with its value, in the order of [`KNOBS`]: what `--set` would make these settings again.
    pub fn describe(&self) -> Vec<(&'static str, String)> {
        KNOBS.iter().filter(|k| k.key != "preset").map(|k| (k.key, k.get(self))).collect()
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
        assert_eq!((settings.candidates, settings.source), (8, source::UNIFORM));
        let text = |assignment: &str| Settings::default().apply(assignment).expect_err("refused").to_string();
        assert_eq!(text("candidates.count=0"), "`candidates.count` takes 1 to 4096, not `0`");
        assert_eq!(text("scene.time=NaN"), "`scene.time` takes -1000000 to 1000000, not `NaN`");
        assert!(text("candidates=8").contains("there are `preset`, `candidates.count`"));
        assert!(text("candidates").contains("key=value"));
    }

    #[test]
    fn more_tiles_than_a_buffer_holds_are_refused() {
        let mut settings = Settings::default();
        ["tiles.count=4096", "tiles.size=1000"].iter().for_each(|knob| settings.apply(knob).expect("in range"));
        settings.check().expect("no tiles");
        settings.apply("candidates.source=tiles").expect("in range");
        assert_eq!(settings.records(8, 8), [1024, 4096]);
        assert!(settings.check().expect_err("refused").to_string().contains("2097152"));
        settings.apply("tiles.size=512").expect("in range");
        settings.check().expect("128 MiB");
        settings.apply("candidates.source=cells").expect("in range");
        settings.apply("cells.slots=256").expect("in range");
        settings.check().expect("48 MiB");
    }

    #[test]
    fn every_knob_reads_back_what_it_was_set_to() {
        for preset in Preset::ALL {
            let settings = preset.settings();
            let mut again = Preset::Paper.settings();
            for (key, value) in settings.describe() {
                again.apply(&format!("{key}={value}")).expect("its own value");
            }
            assert_eq!(again, settings);
            settings.check().expect("a preset does not contradict itself");
        }
    }

    #[test]
    fn the_help_of_every_knob_shows_its_default() {
        let settings = Settings::default();
        for knob in KNOBS {
            let default = knob.get(&settings);
            assert!(
                !default.is_empty() && knob.shown_help().ends_with(&format!(". Default {default}")),
                "{}",
                knob.key
            );
            assert!(!knob.help.contains("Default"), "`{}` has its default typed by hand", knob.key);
            assert!(knob.set(&mut settings.clone(), &default), "`{}` refuses `{default}`", knob.key);
        }
    }

    #[test]
    fn the_help_of_every_knob_says_what_more_and_less_or_each_value_does() {
        for Knob { key, values, help, .. } in KNOBS {
            let is_range = values.contains(" to ") || *values == "0 or 1";
            if is_range {
                assert!(help.contains("More: ") && help.contains("less: "), "{key}");
                continue;
            }
            let names = values.split([',', ' ']).filter(|name| !name.is_empty() && *name != "or");
            let said: Vec<&str> = help.split([' ', ':', '(', ')', ',']).collect();
            names.for_each(|name| assert!(said.contains(&name), "{key}: {name}"));
        }
    }

    #[test]
    fn a_preset_knows_its_name_until_a_knob_leaves_it() {
        let preset = KNOBS.iter().find(|k| k.key == "preset").expect("there is one");
        for wanted in Preset::ALL {
            let mut settings = Settings::default();
            settings.apply("camera.jitter=off").expect("a knob");
            settings.apply(&format!("preset={}", wanted.name())).expect("a preset");
            assert_eq!(preset.get(&settings), wanted.name());
            settings.apply("candidates.count=5").expect("in range");
            assert_eq!(preset.get(&settings), "");
        }
    }

    #[test]
    fn forms_that_compare_all_with_all_refuse_lazy_rays() {
        let mut settings = Settings::default();
        settings.apply("reuse.mis=balance").expect("in range");
        settings.apply("rays=balanced").expect("in range");
        assert!(settings.check().expect_err("refused").to_string().contains("rays=speed"));
        settings.apply("rays=speed").expect("in range");
        settings.check().expect("one ray after reuse");
    }
}
