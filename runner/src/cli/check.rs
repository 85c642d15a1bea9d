//! `weir check`: the GPU against the CPU, pass by pass.

use weir::{
    crosscheck::{Check, check},
    executor::gpu::{AdapterChoice, Gpu, Loader, Module, Traced},
    exit::Exit,
    render::{Request, Stop, facts_of},
    sequence::Sequence,
    technique::Technique,
};

use super::{CheckArguments, no_passes, open, print};

/// Runs `weir check`.
pub fn run(arguments: &CheckArguments) -> anyhow::Result<Exit> {
    let choice: AdapterChoice = match &arguments.adapter {
        Some(text) => text.parse()?,
        None => AdapterChoice::Best,
    };
    let mut opened = open::open(&arguments.scene)?;
    let gpu = Gpu::open(&choice)?;
    let techniques = match arguments.integrator {
        Some(integrator) => vec![integrator.technique().ok_or_else(no_passes)?],
        None => vec![Technique::Still, Technique::RealTime],
    };
    let mut holds = true;
    for technique in techniques {
        let size = [arguments.size.width, arguments.size.height];
        let request = Request {
            seed: arguments.seed,
            stop: Stop::Samples(arguments.frames),
            ..Request::new(opened.camera, size, technique, opened.settings.clone())
        };
        let facts = facts_of(&opened.packed, request.width, request.height, &request.settings);
        let what = Check {
            passes: weir_shader::PASSES,
            technique,
            settings: &opened.settings,
            facts: &facts,
            curve: request.curve,
            loader: if arguments.strict { Loader::Passthrough } else { Loader::Auto },
            module: if arguments.strict { Module::Strict } else { Module::Plain },
        };
        let mut sequence = Sequence::new(&mut opened.packed, request);
        let shots: Vec<_> = (0..arguments.frames).map(|i| sequence.shot(i)).collect();
        let report = check(&gpu, &what, &mut sequence, &shots)?;
        print(&format!("{}: {technique}: {}\n{report}\n", opened.name, gpu.facts.name))?;
        // Ray queries may find another one of equally near triangles.
        let must_be_equal = arguments.strict && gpu.rounds_exactly() && report.traced != Traced::Hardware;
        holds &= if must_be_equal { report.is_equal() } else { report.is_close() };
    }
    Ok(if holds { Exit::Ok } else { Exit::CheckFailed })
}
