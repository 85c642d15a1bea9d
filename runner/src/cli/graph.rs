//! `weir graph`.

use std::fmt::Write;

use weir::{
    executor::cpu::Order,
    exit::Exit,
    packed::PackOptions,
    render::{Backend, Request, facts_of},
    skips::{Cost, costs},
    technique::{ToneCurve, direct_light},
};

use super::{
    GraphArguments, no_passes,
    open::{self, Opened},
    print, render,
};

/// Prints the schedule, and what leaving work out saves if that is asked for.
pub fn run(arguments: &GraphArguments) -> anyhow::Result<Exit> {
    let (scene, settings) = open::read(&arguments.scene)?;
    let Opened { packed, camera, .. } =
        open::pack(&arguments.scene, &scene, settings.clone(), PackOptions::of(&settings))?;
    let (width, height) = (arguments.size.width, arguments.size.height);
    let facts = facts_of(&packed, width, height, &settings);
    let technique = arguments.integrator.technique().ok_or_else(no_passes)?;
    let plan = direct_light(technique, &settings, &facts, ToneCurve::default(), &["moments", "display"])?;
    print(&if arguments.dot { plan.to_dot() } else { format!("{plan}\n") })?;
    if !arguments.dot {
        let list = |words: &[&str]| if words.is_empty() { "nothing".to_owned() } else { words.join(", ") };
        print(&format!("the scene lacks: {}\n", list(&packed.content.lacks())))?;
    }
    drop(packed);
    if arguments.costs {
        arguments.backend.use_threads()?;
        let gpu = render::choose_gpu(&arguments.backend)?;
        let backend = gpu.as_ref().map_or(Backend::Cpu(Order::default()), Backend::Gpu);
        let request = Request::new(camera, [width, height], technique, settings);
        let measured = costs(&scene, &request, &backend, arguments.turns, || true)?;
        print(&table(&measured.unwrap_or_default()))?;
    }
    Ok(Exit::Ok)
}

/// What each rule saves, as a table.
fn table(costs: &[Cost]) -> String {
    let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let mut text =
        String::from("\nrules                        ms a frame  frame MiB  scene MiB  ms to pack  other pixels\n");
    for cost in costs {
        let _ = writeln!(
            text,
            "{:<27} {:>11.2} {:>10.2} {:>10.2} {:>11.1}  {:>12}",
            cost.name(),
            cost.frame_ms,
            mebibytes(cost.frame_bytes),
            mebibytes(cost.scene_bytes),
            cost.pack_ms,
            cost.different.map_or("drawn apart".to_owned(), |count| count.to_string()),
        );
    }
    text
}
