//! `weir stress`: the list of numerical cases.

use anyhow::Context;
use weir::{
    executor::{
        cpu::Order,
        gpu::{AdapterChoice, Gpu, Traced, Traversal},
    },
    exit::{Exit, Usage},
    render::Backend,
    stress::{
        Executors, Outcome, Row, THEMES,
        endurance::{self, Motion},
    },
};

use super::{BackendChoice, StressArguments, print};

/// Frames of the long run: where nothing moves, and where something does.
const ENDURANCE: [(Motion, u32); 2] = [(Motion::Still, 100_000), (Motion::Circling, 10_000)];

/// Runs `weir stress`.
pub fn run(arguments: &StressArguments) -> anyhow::Result<Exit> {
    let choice: AdapterChoice = match &arguments.backend.adapter {
        Some(text) => text.parse()?,
        None => AdapterChoice::Best,
    };
    arguments.backend.use_threads()?;
    let mut gpu = match arguments.backend.backend {
        BackendChoice::Cpu => Err(String::new()),
        BackendChoice::Gpu => Ok(Gpu::open(&choice)?),
        BackendChoice::Auto => Gpu::open(&choice).map_err(|error| error.to_string()),
    };
    if let Ok(gpu) = &mut gpu {
        let traced = gpu.facts.traced(arguments.traversal);
        match (arguments.traversal, traced) {
            (Traversal::Hardware, Traced::Software(why)) => {
                return Err(Usage(format!("rays can't be traced by hardware: {why}")).into());
            }
            (Traversal::Hardware, Traced::Hardware) => gpu.facts.prefers_queries = true,
            (Traversal::Software, _) => gpu.facts.ray_queries = Err("`--traversal software`"),
            (Traversal::Auto, _) => {}
        }
    }
    if let (Traversal::Hardware, Err(why)) = (arguments.traversal, &gpu) {
        let why = if why.is_empty() { "the CPU has no ray queries" } else { why };
        return Err(Usage(format!("rays can't be traced by hardware: {why}")).into());
    }
    let cpu = arguments.backend.backend != BackendChoice::Gpu;
    if arguments.endurance {
        return run_long(cpu, gpu.as_ref().ok());
    }
    let executors = Executors { cpu, gpu: gpu.as_ref().map_err(String::as_str) };
    let wanted = |number| arguments.case.is_empty() || arguments.case.contains(&number);
    let known = |number: &u32| THEMES.iter().flat_map(|t| t.cases).any(|c| c.number == *number);
    if let Some(number) = arguments.case.iter().find(|number| !known(number)) {
        return Err(Usage(format!("there is no case {number}; they are numbered from 1 to 68")).into());
    }
    let mut rows: Vec<Row> = Vec::new();
    if !arguments.json {
        print("case | what | expected | on | seen | outcome\n")?;
    }
    for theme in THEMES {
        for case in theme.cases.iter().filter(|case| wanted(case.number)) {
            for row in theme.run(case, &executors) {
                if !arguments.json {
                    print(&format!("{row}\n"))?;
                }
                rows.push(row);
            }
        }
    }
    if arguments.json {
        print(&format!("{}\n", serde_json::to_string_pretty(&rows).context("rows are plain data")?))?;
    } else {
        let count = |outcome| rows.iter().filter(|row| row.outcome == outcome).count();
        let seconds: f64 = rows.iter().map(|row| row.seconds).sum();
        print(&format!(
            "{} pass, {} fail, {} skipped, {} not applicable; {seconds:.1} s\n",
            count(Outcome::Pass),
            count(Outcome::Fail),
            count(Outcome::Skipped),
            count(Outcome::Inapplicable)
        ))?;
    }
    let fails = rows.iter().any(|row| row.outcome == Outcome::Fail);
    Ok(if fails { Exit::CheckFailed } else { Exit::Ok })
}

/// Runs the long chains.
fn run_long(cpu: bool, gpu: Option<&Gpu>) -> anyhow::Result<Exit> {
    let backends = [cpu.then(|| Backend::Cpu(Order::default())), gpu.map(Backend::Gpu)];
    let mut holds = true;
    for backend in backends.iter().flatten() {
        for (motion, frames) in ENDURANCE {
            let report = endurance::run(backend, motion, frames, |_| ())?;
            holds &= report.holds();
            let on = if matches!(backend, Backend::Cpu(_)) { "CPU" } else { "GPU" };
            print(&format!("{on}, {motion}: {report}: {}\n", if report.holds() { "pass" } else { "FAIL" }))?;
        }
    }
    Ok(if holds { Exit::Ok } else { Exit::CheckFailed })
}
