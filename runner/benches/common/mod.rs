//! What benches share.

use std::time::Duration;

use weir::settings::Settings;

pub type Failure = Box<dyn std::error::Error>;

/// The defaults with knobs turned.
pub fn settings(knobs: &[&str]) -> Result<Settings, Failure> {
    let mut settings = Settings::default();
    for knob in knobs {
        settings.apply(knob)?;
    }
    settings.check()?;
    Ok(settings)
}

/// In milliseconds.
pub fn median_ms(times: impl Iterator<Item = Duration>) -> f64 {
    let mut times: Vec<f64> = times.map(|t| t.as_secs_f64() * 1e3).collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
