//! The stress list: cases that break renderers of this kind, each with what is expected and what is seen.
//!
//! A case looks at functions that the passes share, or at frames; the latter on the CPU and on a GPU. What is seen is
//! measured each time. `weir stress` prints the table, and the tests run the same cases.

pub mod arbitrary;
mod bsdf;
pub mod clip;
mod contact;
pub mod endurance;
pub mod geometry;
mod infrastructure;
mod lights;
mod motion;
mod sampling;
pub mod scenarios;
pub mod scenes;
mod screen;
pub mod stage;
pub mod statistics;
mod streams;
mod tables;
pub mod worlds;

use serde::Serialize;

use crate::{
    executor::{cpu::Order, gpu::Gpu},
    render::{Backend, RenderError},
};

/// What a case has seen, and whether that is as expected.
#[derive(Debug)]
pub struct Finding {
    seen: String,
    holds: bool,
}

impl Finding {
    /// `holds`: as expected.
    fn new(holds: bool, seen: impl Into<String>) -> Self {
        Self { seen: seen.into(), holds }
    }
}

/// A finding, unless there was no picture to look at.
type Found = Result<Finding, RenderError>;

/// What a case looks at.
#[derive(Clone, Copy)]
enum Check {
    /// Functions that passes share, and what the host builds.
    Host(fn() -> Finding),
    /// Frames, on the CPU and on a GPU.
    Frames(fn(&Backend<'_>) -> Found),
    /// Nothing, for this reason.
    #[cfg_attr(not(test), expect(dead_code, reason = "every case of the list applies; one that can't is to say why"))]
    Inapplicable(&'static str),
}

/// A case of the list.
pub struct Case {
    /// Its number.
    pub number: u32,
    /// What is put under stress.
    pub name: &'static str,
    /// What has to come of it.
    pub expected: &'static str,
    checks: &'static [Check],
}

/// Cases with something in common.
pub struct Theme {
    /// What they have in common.
    pub name: &'static str,
    /// The cases, by their numbers.
    pub cases: &'static [Case],
}

/// All cases.
pub const THEMES: &[Theme] = &[
    Theme { name: "sampling", cases: sampling::CASES },
    Theme { name: "lights", cases: lights::CASES },
    Theme { name: "geometry", cases: geometry::CASES },
    Theme { name: "bsdf", cases: bsdf::CASES },
    Theme { name: "screen", cases: screen::CASES },
    Theme { name: "infrastructure", cases: infrastructure::CASES },
];

/// How a row ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// As expected.
    Pass,
    /// Not as expected.
    Fail,
    /// Not looked at: there is no GPU.
    Skipped,
    /// Not looked at: there is nothing of the kind in weir.
    Inapplicable,
}

/// A row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Number of the case.
    pub number: u32,
    /// Its theme.
    pub theme: &'static str,
    /// What is put under stress.
    pub case: &'static str,
    /// What has to come of it.
    pub expected: &'static str,
    /// Where: `host` for functions, `CPU` or `GPU` for frames.
    pub on: &'static str,
    /// What was seen.
    pub seen: String,
    /// How it ended.
    pub outcome: Outcome,
    /// How long it took.
    pub seconds: f64,
}

/// Where frames are computed.
#[derive(Clone, Copy)]
pub struct Executors<'a> {
    /// On the CPU too.
    pub cpu: bool,
    /// On this GPU, or not for that reason; nothing of it if the empty text.
    pub gpu: Result<&'a Gpu, &'a str>,
}

impl Theme {
    /// Runs a case of the theme: a row for each place where it looks.
    pub fn run(&self, case: &Case, executors: &Executors<'_>) -> Vec<Row> {
        let mut rows = Vec::new();
        for check in case.checks {
            match *check {
                Check::Host(look) => rows.push(self.row(case, "host", || Ok(look()))),
                Check::Frames(look) => {
                    if executors.cpu {
                        rows.push(self.row(case, "CPU", || look(&Backend::Cpu(Order::default()))));
                    }
                    match executors.gpu {
                        Ok(gpu) => rows.push(self.row(case, "GPU", || look(&Backend::Gpu(gpu)))),
                        Err("") => {}
                        Err(why) => rows.push(self.unseen(case, "GPU", why, Outcome::Skipped)),
                    }
                }
                Check::Inapplicable(why) => rows.push(self.unseen(case, "", why, Outcome::Inapplicable)),
            }
        }
        rows
    }

    /// Runs all cases of the theme.
    pub fn run_all(&self, executors: &Executors<'_>) -> Vec<Row> {
        self.cases.iter().flat_map(|case| self.run(case, executors)).collect()
    }

    fn row(&self, case: &Case, on: &'static str, look: impl FnOnce() -> Found) -> Row {
        let start = std::time::Instant::now();
        let finding = look().unwrap_or_else(|error| Finding::new(false, error.to_string()));
        let outcome = if finding.holds { Outcome::Pass } else { Outcome::Fail };
        Row { seconds: start.elapsed().as_secs_f64(), ..self.unseen(case, on, &finding.seen, outcome) }
    }

    fn unseen(&self, case: &Case, on: &'static str, seen: &str, outcome: Outcome) -> Row {
        let Case { number, name, expected, .. } = *case;
        Row { number, theme: self.name, case: name, expected, on, seen: seen.to_owned(), outcome, seconds: 0.0 }
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let outcome = match self.outcome {
            Outcome::Pass => "pass",
            Outcome::Fail => "FAIL",
            Outcome::Skipped => "skipped",
            Outcome::Inapplicable => "n/a",
        };
        let Self { number, case, expected, on, seen, .. } = self;
        write!(f, "{number:>2} | {case} | {expected} | {on} | {seen} | {outcome}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_of_the_list_is_there_once_and_looks_at_something() {
        let numbers: Vec<u32> = THEMES.iter().flat_map(|t| t.cases).map(|c| c.number).collect();
        assert_eq!(numbers, (1..=68).collect::<Vec<_>>());
        for case in THEMES.iter().flat_map(|t| t.cases) {
            assert!(!case.checks.is_empty() && !case.name.is_empty() && !case.expected.is_empty(), "{}", case.number);
        }
    }

    /// The table has teeth: what does not hold, and what does not even run, is a failure.
    #[test]
    fn what_does_not_hold_is_a_failure() {
        fn wrong() -> Finding {
            Finding::new(false, "2")
        }
        fn broken(_: &Backend<'_>) -> Found {
            Err(RenderError::Gpu(crate::executor::gpu::GpuError::NoAdapter))
        }
        const CASES: &[Case] = &[Case {
            number: 1,
            name: "sum",
            expected: "1",
            checks: &[Check::Host(wrong), Check::Frames(broken), Check::Inapplicable("none")],
        }];
        let theme = Theme { name: "wrong", cases: CASES };
        let rows = theme.run_all(&Executors { cpu: true, gpu: Err("no adapter") });
        let outcomes: Vec<Outcome> = rows.iter().map(|row| row.outcome).collect();
        assert_eq!(outcomes, [Outcome::Fail, Outcome::Fail, Outcome::Skipped, Outcome::Inapplicable]);
        assert_eq!(rows[0].to_string(), " 1 | sum | 1 | host | 2 | FAIL");
    }
}
