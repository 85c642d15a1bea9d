//! What is measured: ways to make a picture, each with a name.

use thiserror::Error;

use crate::{
    exit::{Exit, HasExit},
    settings::{SettingError, Settings},
    technique::Technique,
};

/// A way to make a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Method {
    /// As `--method` takes it.
    pub name: String,
    /// Which passes.
    pub technique: Technique,
    /// Knobs, as `--set` takes them.
    pub knobs: Vec<String>,
    /// Knobs on top of the defaults, with those that make pictures comparable.
    pub settings: Settings,
}

/// Camera rays through pixel centers and a scene that stands still: so that what differs is light alone.
pub const COMPARABLE: [&str; 2] = ["camera.jitter=off", "scene.time_step=0"];

/// The unit of N_eff: one candidate by power for each pixel and frame.
pub const UNIT: &str = "power";

/// Names, kinds and knobs.
const KNOWN: &[(&str, Technique, &str)] = &[
    (UNIT, Technique::Candidates, "candidates.count=1 candidates.tree=0 candidates.bsdf=0"),
    (
        "uniform",
        Technique::Candidates,
        "candidates.count=1 candidates.tree=0 candidates.bsdf=0 candidates.source=uniform",
    ),
    ("ris-32", Technique::Candidates, "candidates.count=32 candidates.tree=0 candidates.bsdf=0"),
    ("candidates", Technique::Candidates, "preset=balanced"),
    ("still:fast", Technique::Still, "preset=fast"),
    ("still:balanced", Technique::Still, "preset=balanced"),
    ("still:quality", Technique::Still, "preset=quality"),
    ("still:paper", Technique::Still, "preset=paper"),
    ("chain:fast", Technique::RealTime, "preset=fast"),
    ("chain:balanced", Technique::RealTime, "preset=balanced"),
    ("chain:quality", Technique::RealTime, "preset=quality"),
    ("chain:paper", Technique::RealTime, "preset=paper"),
];

/// Sources of candidates that [`Method::sources`] compares.
const SOURCES: &[&str] = &[
    "candidates.source=uniform",
    "candidates.source=power",
    "candidates.source=tiles,skip.presampling=off",
    "candidates.source=cells",
    "candidates.source=tree",
    "candidates.source=cuts",
    "candidates.tree=3",
];

/// What they are compared as.
const SOURCES_AS: &[&str] = &[
    "ris:candidates.count=1,candidates.tree=0,candidates.bsdf=0",
    "ris:candidates.count=8,candidates.tree=0,candidates.bsdf=0",
    "still:candidates.count=4,candidates.tree=0",
    "chain:candidates.count=4,candidates.tree=0",
];

/// A method that cannot be measured.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum MethodError {
    /// No such name.
    #[error(
        "there is no method `{name}`; there are {known}, `sources` for all of those that compare sources of candidates, or `ris:`, `still:` and `chain:` with knobs, as in still:candidates.count=8,still.rounds=1"
    )]
    Unknown {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A knob of it.
    #[error("method `{name}`: {source}")]
    Knob {
        /// The method.
        name: String,
        /// What is wrong.
        source: SettingError,
    },
}

impl HasExit for MethodError {
    fn exit(&self) -> Exit {
        Exit::Usage
    }
}

impl Method {
    /// A method by its name, see [`Method::all`]; or `ris:`, `still:` or `chain:` and knobs, set apart by commas.
    ///
    /// # Errors
    /// If there is none of that name, or a knob is wrong.
    pub fn named(name: &str) -> Result<Self, MethodError> {
        if let Some((_, technique, knobs)) = KNOWN.iter().find(|known| known.0 == name) {
            return Self::new(name, *technique, knobs.split(' '));
        }
        let kinds = [("ris:", Technique::Candidates), ("still:", Technique::Still), ("chain:", Technique::RealTime)];
        let custom = kinds.iter().find_map(|(prefix, technique)| Some((*technique, name.strip_prefix(prefix)?)));
        match custom {
            Some((technique, knobs)) if knobs.contains('=') => Self::new(name, technique, knobs.split(',')),
            _ => {
                let known = KNOWN.iter().map(|known| format!("`{}`", known.0)).collect::<Vec<_>>().join(", ");
                Err(MethodError::Unknown { name: name.to_owned(), known })
            }
        }
    }

    /// Any method.
    ///
    /// # Errors
    /// If a knob is wrong.
    pub fn new<'a>(
        name: &str,
        technique: Technique,
        knobs: impl IntoIterator<Item = &'a str>,
    ) -> Result<Self, MethodError> {
        let knobs: Vec<String> = knobs.into_iter().map(str::to_owned).collect();
        let mut settings = Settings::default();
        let wrong = |source| MethodError::Knob { name: name.to_owned(), source };
        for knob in knobs.iter().map(String::as_str).chain(COMPARABLE) {
            settings.apply(knob).map_err(wrong)?;
        }
        settings.check().map_err(wrong)?;
        Ok(Self { name: name.to_owned(), technique, knobs, settings })
    }

    /// Those that compare sources of candidates: each alone, as candidates of resampling, as those of reuse between
    /// pixels, and as those of frames in real time.
    ///
    /// # Panics
    /// As [`Method::all`].
    pub fn sources() -> Vec<Self> {
        let ways = SOURCES_AS.iter().flat_map(|way| SOURCES.iter().map(move |source| (way, source)));
        // Of one candidate, none is left for the tree.
        let ways = ways.filter(|(way, source)| !way.contains("count=1,") || !source.contains("tree="));
        let named = |name: String| Self::named(&name).expect("the table names knobs that exist");
        ways.map(|(way, source)| named(format!("{way},{source}"))).collect()
    }

    /// All that have a name.
    ///
    /// # Panics
    /// If the table above names a knob that is gone; a test says so first.
    pub fn all() -> Vec<Self> {
        KNOWN.iter().map(|known| Self::named(known.0).expect("the table names knobs that exist")).collect()
    }

    /// Whether its frames are independent of each other.
    pub fn is_independent(&self) -> bool {
        self.technique != Technique::RealTime
    }

    /// How many candidates have had a say in one frame: those of a reservoir, times the inputs of each merge. What they
    /// share is counted again and again.
    pub fn nominal_count(&self) -> u64 {
        let s = &self.settings;
        let neighbors = if self.is_independent() { s.still_neighbors } else { s.spatial_neighbors };
        let past = match self.technique {
            Technique::RealTime => 1 + u64::from(s.confidence_cap) * u64::from(1 + s.temporal_neighbors),
            Technique::Still | Technique::Candidates => 1,
        };
        let candidates = u64::from(s.candidates + self.technique.bsdf_rays(s));
        candidates * past * u64::from(1 + neighbors).pow(self.technique.rounds(s))
    }
}

/// The ablation: `balanced` in real time and one knob at a time.
pub const ABLATION: &[(&str, &[&str])] = &[
    ("candidates.count", &["1", "2", "4", "8", "16", "32"]),
    ("candidates.tree", &["0", "2", "3"]),
    ("candidates.source", &["power", "uniform", "tiles", "cells", "tree", "cuts"]),
    ("candidates.bsdf", &["0", "1"]),
    ("temporal.neighbors", &["0", "1", "2", "3", "4", "6"]),
    ("temporal.cap", &["0", "2", "4", "8", "16", "32"]),
    ("reuse.radius", &["3", "10", "30"]),
    ("reuse.resolution", &["full", "checkerboard", "half"]),
    ("reuse.mis", &["pairwise-defensive", "pairwise"]),
    ("reuse.rule", &["disk", "compatible", "paired"]),
    ("rays", &["speed", "balanced", "quality"]),
    ("spatial.rounds", &["0", "1", "2"]),
    ("reservoirs.count", &["1", "2", "4"]),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::KNOBS;

    #[test]
    fn every_named_method_exists_and_knobs_make_others() {
        assert_eq!(Method::all().len(), KNOWN.len());
        let own = Method::named("chain:candidates.count=8,temporal.cap=4").expect("knobs");
        assert_eq!((own.settings.candidates, own.settings.confidence_cap), (8, 4));
        assert!(own.technique == Technique::RealTime && !own.settings.jitter && own.settings.time_step_s == 0.0);
    }

    #[test]
    fn sources_are_compared_in_each_way() {
        let methods = Method::sources();
        assert_eq!(methods.len(), SOURCES.len() * SOURCES_AS.len() - 1);
        let settings: std::collections::HashSet<_> =
            methods.iter().map(|m| format!("{:?} {:?}", m.technique, m.settings)).collect();
        assert_eq!(settings.len(), methods.len(), "two are the same");
    }

    #[test]
    fn an_unknown_method_is_refused_with_those_there_are() {
        let text = |name: &str| Method::named(name).expect_err("refused").to_string();
        assert!(text("fastest").contains("no method `fastest`") && text("fastest").contains("`still:balanced`"));
        assert!(text("still:best").contains("no method"));
        assert!(text("still:candidates.count=0").contains("takes 1 to 4096"));
        assert!(text("chain:reuse.mis=balance").contains("rays=speed"));
    }

    #[test]
    fn the_ablation_turns_knobs_that_exist_and_passes_through_the_default() {
        for (key, values) in ABLATION {
            let knob = KNOBS.iter().find(|knob| knob.key == *key).expect(key);
            for value in *values {
                Method::new(key, Technique::RealTime, [format!("{key}={value}").as_str()]).expect(value);
            }
            let default = knob.get(&Settings::default());
            assert!(values.contains(&default.as_str()), "{key}: {default}");
        }
    }

    #[test]
    fn the_nominal_count_multiplies_candidates_and_inputs() {
        let count = |name: &str| Method::named(name).expect("known").nominal_count();
        // One by the BSDF beside four; three rounds of six neighbours.
        assert_eq!((count("power"), count("ris-32"), count("still:balanced")), (1, 32, 5 * 343));
        // Eight frames for the pixel and each of three neighbours.
        assert_eq!(count("chain:balanced"), 5 * 33);
    }
}
