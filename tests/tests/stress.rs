//! The stress list, as tests: a function for each theme, so that they run side by side. On the CPU; with
//! `WEIR_LONG_TESTS=1` on the GPU as well. `weir stress --backend gpu` is what the checks of a clean clone run.

use weir::stress::{Executors, Outcome, Row, THEMES};
use weir_tests::gpu_or_skip;

/// Runs the cases of a theme.
fn assert_holds(name: &str) {
    let theme = THEMES.iter().find(|theme| theme.name == name).expect("a theme of that name");
    let is_long = std::env::var("WEIR_LONG_TESTS").is_ok_and(|v| v == "1");
    let gpu = if is_long { gpu_or_skip(&format!("stress: {name}")) } else { None };
    let executors = Executors { cpu: true, gpu: gpu.as_ref().ok_or("not asked for") };
    let rows = theme.run_all(&executors);
    for row in &rows {
        println!("{row} | {:.2} s", row.seconds);
    }
    let failing: Vec<String> = rows.iter().filter(|row| row.outcome == Outcome::Fail).map(Row::to_string).collect();
    assert!(failing.is_empty(), "{}", failing.join("\n"));
    assert!(rows.iter().any(|row| row.outcome == Outcome::Pass), "nothing was looked at");
}

#[test]
fn the_list_holds_for_sampling() {
    assert_holds("sampling");
}

#[test]
fn the_list_holds_for_lights() {
    assert_holds("lights");
}

#[test]
fn the_list_holds_for_geometry() {
    assert_holds("geometry");
}

#[test]
fn the_list_holds_for_the_bsdf() {
    assert_holds("bsdf");
}

#[test]
fn the_list_holds_for_the_screen() {
    assert_holds("screen");
}

#[test]
fn the_list_holds_for_the_infrastructure() {
    assert_holds("infrastructure");
}
