//! `weir graph`.

use std::fmt::Write;

use weir::{
    executor::cpu::Order,
    exit::Exit,
    render::{Backend, Request, facts_of},
    skips::{Cost, Rule, Skips, costs},
    technique::{ToneCurve, direct_light},
};

use super::{GraphArguments, no_passes, open, print, render};

/// Prints the schedule, and what leaving work out saves if that is asked for.
pub fn run(arguments: &GraphArguments) -> anyhow::Result<Exit> {
    let mut opened = open::open(&arguments.scene)?;
    let (width, height) = (arguments.size.width, arguments.size.height);
    let facts = facts_of(&opened.packed, width, height, &opened.settings);
    let technique = arguments.integrator.technique().ok_or_else(no_passes)?;
    let plan = direct_light(technique, &opened.settings, &facts, ToneCurve::default(), &["moments", "display"])?;
    print(&if arguments.dot { plan.to_dot() } else { format!("{plan}\n") })?;
    if arguments.costs {
        arguments.backend.use_threads()?;
        let gpu = render::choose_gpu(&arguments.backend)?;
        let backend = gpu.as_ref().map_or(Backend::Cpu(Order::default()), Backend::Gpu);
        let request = Request::new(opened.camera, [width, height], technique, opened.settings);
        let found = costs(&mut opened.packed, &request, &backend, arguments.turns)?;
        print(&table(&found, opened.packed.bytes()))?;
    }
    Ok(Exit::Ok)
}

/// What each rule saves, as a table.
fn table(costs: &[Cost], scene_bytes: u64) -> String {
    let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let mut text = String::from("\nrules                 ms a frame  frame MiB  other pixels\n");
    for cost in costs {
        let on: Vec<&str> = Rule::ALL.into_iter().filter(|rule| cost.skips.is_on(*rule)).map(Rule::name).collect();
        let name = match on.as_slice() {
            [] => "all off".to_owned(),
            _ if cost.skips == Skips::default() => "all on".to_owned(),
            names => format!("{} alone", names.join(" and ")),
        };
        let _ = writeln!(
            text,
            "{name:<20} {:>11.2} {:>10.2}  {:>12}",
            cost.frame_ms,
            mebibytes(cost.frame_bytes),
            cost.different
        );
    }
    let _ = writeln!(text, "scene memory: {:.1} MiB", mebibytes(scene_bytes));
    text
}
