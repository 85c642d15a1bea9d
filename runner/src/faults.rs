//! Weights that passes dropped because they were not finite, or not positive: how often, where and why.

use std::collections::BTreeMap;

use weir_shared::{fault, moments::Moments};

/// What was dropped on the way to a picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Samples of pixels for which any weight was dropped: pixels times frames at most.
    pub samples: u64,
    /// Pixels by the stage and the kind of the first fault on their way.
    pub pixels: BTreeMap<[&'static str; 2], u64>,
}

impl Faults {
    /// Counts what the moments of a picture say.
    pub fn of(moments: &[Moments]) -> Self {
        let mut faults = Self::default();
        for moment in moments.iter().filter(|m| m.faults > 0) {
            faults.samples += u64::from(moment.faults);
            *faults.pixels.entry(fault::names_of(moment.fault)).or_default() += 1;
        }
        faults
    }
}

/// A sentence; nothing is said of what did not happen.
impl std::fmt::Display for Faults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "weights were dropped for {} samples of pixels", self.samples)?;
        for (i, ([stage, kind], pixels)) in self.pixels.iter().enumerate() {
            f.write_str(if i == 0 { "; first in pass " } else { ", in " })?;
            write!(f, "`{stage}` ({kind}, {pixels} pixels)")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_counted_by_stage_and_kind() {
        let bad = |stage, kind, faults| Moments { faults, fault: fault::at(stage, kind), ..Moments::default() };
        let moments = [
            Moments::default(),
            bad(fault::stage::CANDIDATES, fault::INFINITE, 3),
            bad(fault::stage::CANDIDATES, fault::INFINITE, 1),
            bad(fault::stage::SPATIAL, fault::OVERFLOW, 2),
        ];
        let faults = Faults::of(&moments);
        assert_eq!(faults.samples, 6);
        assert_eq!(
            faults.to_string(),
            "weights were dropped for 6 samples of pixels; first in pass `candidates` (infinite, 2 pixels), in `spatial` \
             (overflow, 1 pixels)"
        );
        assert_eq!(Faults::of(&moments[..1]), Faults::default());
    }
}
