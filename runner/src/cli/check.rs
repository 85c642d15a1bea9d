//! `weir check`: the GPU against the CPU, pass by pass.

use weir::{
    crosscheck::{Check, check},
    executor::gpu::{AdapterChoice, Gpu, Loader, Module},
    exit::Exit,
    render::{Request, Stop, facts_of, frame_of},
    technique::ToneCurve,
};
use weir_shared::frame::Frame;

use super::{CheckArguments, open, print};

/// Runs `weir check`.
pub fn run(arguments: &CheckArguments) -> anyhow::Result<Exit> {
    let choice: AdapterChoice = match &arguments.adapter {
        Some(text) => text.parse()?,
        None => AdapterChoice::Best,
    };
    let opened = open::open(&arguments.scene)?;
    let gpu = Gpu::open(&choice)?;
    let request = Request {
        width: arguments.size.width,
        height: arguments.size.height,
        camera: opened.camera,
        seed: arguments.seed,
        stop: Stop::Samples(arguments.frames),
        curve: ToneCurve::default(),
        exposure: 1.0,
        settings: opened.settings.clone(),
    };
    let first = frame_of(&opened.packed, &request);
    let frames: Vec<Frame> = (0..arguments.frames).map(|i| Frame { index: i, accumulated: i, ..first }).collect();
    let facts = facts_of(&opened.packed, request.width, request.height);
    let what = Check {
        passes: weir_shader::PASSES,
        facts: &facts,
        curve: request.curve,
        loader: if arguments.strict { Loader::Passthrough } else { Loader::Auto },
        module: if arguments.strict { Module::Strict } else { Module::Plain },
    };
    let report = check(&gpu, &what, opened.packed.buffers(), &frames)?;
    print(&format!("{}: {}\n{report}\n", opened.name, gpu.facts.name))?;
    // The plain module is contracted and reassociated: its report informs, the strict one's decides.
    Ok(if report.is_equal() || !arguments.strict { Exit::Ok } else { Exit::CheckFailed })
}
