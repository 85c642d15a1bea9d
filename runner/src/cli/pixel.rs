//! `weir pixel`: one pixel of a frame on the host, with everything that passes leave there.

use std::fmt::Write;

use glam::UVec2;
use weir::executor::cpu::CpuExecutor;
use weir::{
    exit::{Exit, Usage},
    render::{Request, facts_of},
    sequence::Sequence,
    technique::{RESOURCES, Technique, direct_light},
};
use weir_shader::wiring::Extent;

use super::{PixelArguments, no_passes, open};

/// A pixel, as in 211,87.
#[derive(Clone, Copy, Debug)]
pub struct Pixel(pub UVec2);

impl std::str::FromStr for Pixel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parsed = text.split_once(',').and_then(|(x, y)| Some((x.trim().parse().ok()?, y.trim().parse().ok()?)));
        parsed.map(|(x, y)| Self(UVec2::new(x, y))).ok_or_else(|| String::from("a pixel is X,Y, such as 211,87"))
    }
}

/// Runs `weir pixel`.
pub fn run(arguments: &PixelArguments) -> anyhow::Result<Exit> {
    let technique = arguments.integrator.technique().ok_or_else(no_passes)?;
    let (px, size) = (arguments.pixel.0, arguments.size);
    if px.x >= size.width || px.y >= size.height {
        let message = format!("there is no pixel {},{} in {}x{}", px.x, px.y, size.width, size.height);
        return Err(Usage(message).into());
    }
    let opened = open::open(&arguments.scene)?;
    let one = Request::new(opened.camera, [size.width, size.height], technique, opened.settings);
    let request = Request { seed: arguments.seed, ..one };
    let mut sequence = Sequence::new(opened.packed, request.clone());
    // The frames before it make the history of one in real time; those of stills have none.
    let past = if technique == Technique::RealTime { arguments.history.min(arguments.frame) } else { 0 };
    sequence.start_at(arguments.frame - past);
    let facts = facts_of(sequence.packed(), size.width, size.height, &request.settings);
    let all = direct_light(technique, &request.settings, &facts, request.curve, &["moments", "display"])?;
    let kept: Vec<&'static str> = all.steps.iter().flat_map(|step| step.writes().map(|(name, _)| name)).collect();
    let plan = direct_light(technique, &request.settings, &facts, request.curve, &kept)?;
    let mut executor = CpuExecutor::new(&plan);
    for number in 0..=past {
        let frames = match technique {
            Technique::RealTime => sequence.next(&sequence.shot(number))?.0,
            Technique::Still | Technique::Candidates => sequence.independent(&request, 0),
        };
        executor.run(&plan, sequence.packed().buffers(), &frames);
    }

    let mut text = format!("pixel {},{} of frame {}\n", px.x, px.y, arguments.frame);
    for step in &plan.steps {
        let _ = writeln!(text, "{}", step.pass.name);
        for (name, stride) in step.writes() {
            let is_of_pixels = |extent| matches!(extent, Extent::Pixels | Extent::Reservoirs | Extent::Candidates);
            let resource = RESOURCES.iter().find(|r| r.name == name && is_of_pixels(r.extent));
            let (Some(bytes), Some(resource)) = (executor.output(&plan, name), resource) else { continue };
            let reservoirs = facts.elements(resource.extent) / (u64::from(size.width) * u64::from(size.height));
            for number in 0..reservoirs as u32 {
                let index = (px.y * reservoirs as u32 + number) * size.width + px.x;
                let words = &bytes[index as usize * stride..][..stride];
                let _ = writeln!(text, "  {name}: {}", in_words(words, resource.float_words));
            }
        }
    }
    super::print(&text)?;
    Ok(Exit::Ok)
}

/// Words of an element: floats in decimals, integers in hexadecimals.
fn in_words(bytes: &[u8], float_words: u32) -> String {
    let words = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).enumerate();
    let shown = words.map(|(i, word)| match float_words >> i & 1 {
        1 => format!("{:?}", f32::from_bits(word)),
        _ => format!("{word:#x}"),
    });
    shown.collect::<Vec<_>>().join(" ")
}
