//! An executor with its plan, and the scene that it runs on.

use std::sync::Arc;

use weir_shader::wiring::Access;

use super::{EngineError, Pixels, Schedule, Scheduled};
use crate::{
    executor::{
        Executor, SceneBuffers,
        cpu::CpuExecutor,
        gpu::{Gpu, GpuError, GpuExecutor, GpuScene, Loader, Module},
    },
    graph::{GraphError, Plan, Planned, Slot},
    packed::{Changed, PackedScene},
    render::{Request, facts_of},
    settings::Settings,
    technique::{Technique, direct_light},
    view::want::Want,
};

/// Where frames are computed.
pub(super) enum Place {
    Cpu,
    Gpu(Box<Gpu>, GpuScene),
}

/// An executor with its plan.
pub(super) struct Chain {
    pub(super) technique: Technique,
    pub(super) plan: Plan,
    pub(super) executor: Executor,
    pub(super) schedule: Arc<Schedule>,
}

pub(super) fn place(gpu: Option<&Gpu>, packed: &PackedScene) -> Result<Place, GpuError> {
    Ok(match gpu {
        None => Place::Cpu,
        Some(gpu) => Place::Gpu(Box::new(gpu.clone()), pollster::block_on(GpuScene::upload(gpu, packed.buffers()))?),
    })
}

pub(super) fn update(place: &Place, scene: SceneBuffers<'_>, changed: Vec<Changed>) -> Result<(), GpuError> {
    if let Place::Gpu(gpu, on_gpu) = place {
        pollster::block_on(on_gpu.follow(gpu, scene, &changed))?;
    }
    Ok(())
}

/// What has to outlive the frame: what is shown, measured or inspected of it.
pub(super) fn outputs_of(want: &Want, technique: Technique) -> Vec<&'static str> {
    let mut outputs = vec!["moments", "display"];
    let inspects = want.inspect.is_some();
    if inspects || want.view.needs_surfaces() {
        outputs.push("surfaces");
    }
    if (inspects || want.view.needs_reservoirs()) && technique == Technique::RealTime {
        outputs.push("reservoirs");
    }
    outputs
}

/// The resource that holds what is shaded. In real time that is what the next frame remembers.
pub(super) fn held(plan: &Plan) -> Option<&'static str> {
    let written = |step: &Planned| {
        let mut writes = step.pass.bindings.iter().zip(&step.names).filter(|(b, _)| b.access == Access::Write);
        writes.find(|(b, _)| ["fresh", "visible", "merged"].contains(&b.name)).map(|(_, name)| *name)
    };
    plan.steps.iter().rev().find_map(written)
}

/// The plan of frames of a request.
pub(super) fn planned(packed: &PackedScene, request: &Request, outputs: &[&'static str]) -> Result<Plan, GraphError> {
    let facts = facts_of(packed, request.width, request.height, &request.settings);
    let with =
        |outputs: &[&'static str]| direct_light(request.technique, &request.settings, &facts, request.curve, outputs);
    let plan = with(outputs)?;
    // The reservoirs of a still have a name for each round; those of the last are the ones to keep.
    match held(&plan).filter(|_| request.technique == Technique::Still) {
        Some(held) => with(&[outputs, &[held]].concat()),
        None => Ok(plan),
    }
}

/// Makes the chain unless there is one of the same plan; says whether it did.
pub(super) fn chain_for(
    chain: &mut Option<Chain>,
    place: &Place,
    packed: &PackedScene,
    request: &Request,
    outputs: &[&'static str],
) -> Result<bool, EngineError> {
    let plan = planned(packed, request, outputs)?;
    let is_there = |chain: &&mut Chain| chain.technique == request.technique && same(&chain.plan, &plan);
    if let Some(chain) = chain.as_mut().filter(is_there) {
        if chain.plan.facts.spared != plan.facts.spared {
            chain.plan.facts.spared = plan.facts.spared;
            chain.schedule = Arc::new(schedule(&chain.plan));
        }
        return Ok(false);
    }
    // The old one is let go of first: two may not fit.
    *chain = None;
    let executor = match place {
        Place::Cpu => Executor::Cpu(Box::new(CpuExecutor::new(&plan))),
        Place::Gpu(gpu, scene) => {
            pollster::block_on(scene.accelerate(gpu, packed.buffers(), plan.facts.traversal))?;
            let made = GpuExecutor::on_scene(gpu, &plan, scene, Loader::Auto, Module::Plain);
            let executor = pollster::block_on(made)?;
            gpu.store_pipelines();
            Executor::Gpu(Box::new(executor))
        }
    };
    let schedule = Arc::new(schedule(&plan));
    *chain = Some(Chain { technique: request.technique, plan, executor, schedule });
    Ok(true)
}

/// Whether two plans run the same passes on the same memory.
fn same(a: &Plan, b: &Plan) -> bool {
    let is_like = |(a, b): (&Planned, &Planned)| {
        a.variant.entry_point == b.variant.entry_point
            && (&a.slots, &a.names, a.round, a.is_kept) == (&b.slots, &b.names, b.round, b.is_kept)
    };
    a.facts.is_like(&b.facts)
        && a.outputs == b.outputs
        && a.pool == b.pool
        && a.history == b.history
        && a.steps.len() == b.steps.len()
        && a.steps.iter().zip(&b.steps).all(is_like)
}

fn schedule(plan: &Plan) -> Schedule {
    let names = |step: &Planned, access: Access| {
        let used = step.slots.iter().zip(&step.names);
        let used = used.filter(|((a, slot), _)| *a == access && !matches!(slot, Slot::Scene(_)));
        used.map(|(_, name)| *name).collect::<Vec<_>>()
    };
    let scheduled = |step: &Planned| Scheduled {
        pass: step.pass.name,
        reads: names(step, Access::Read),
        writes: names(step, Access::Write),
    };
    Schedule {
        steps: plan.steps.iter().map(scheduled).collect(),
        left_out: plan.left_out(),
        frame_bytes: plan.frame_bytes(),
    }
}

/// Rays of a pixel in a frame, at most: of one that has one camera ray, as all have but those at edges.
pub(super) fn rays(plan: &Plan, settings: &Settings) -> u32 {
    use weir_shared::reuse::probe;
    let merges = |neighbors: u32| match settings.rays.probe() {
        probe::NONE => 0,
        probe::ONE => 1,
        _ => 1 + neighbors,
    };
    let of = |pass: &str| match pass {
        "primary" => 1,
        "bsdf_rays" | "visibility" => settings.reservoirs,
        "temporal_rays" => settings.reservoirs * merges(1 + settings.temporal_neighbors),
        "spatial_rays" => settings.reservoirs * merges(settings.spatial_neighbors.max(settings.still_neighbors)),
        _ => 0,
    };
    plan.steps.iter().map(|step| of(step.pass.name)).sum()
}

/// The picture that a chain has made last.
pub(super) fn pixels_of(chain: &mut Chain) -> Result<Pixels, GpuError> {
    Ok(match &chain.executor {
        Executor::Gpu(executor) => Pixels::Gpu(executor.output_buffer("display").expect("an output").clone()),
        Executor::Cpu(_) => Pixels::Host(Arc::new(chain.executor.read(&chain.plan, "display")?.elements().to_vec())),
    })
}
