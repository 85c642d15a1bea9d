//! The frames that weir knows: resources and steps.

use glam::{UVec4, Vec4};
use weir_shader::wiring::Pass;
use weir_shared::{moments::Moments, reservoir::Reservoir, surface::Surface};

use crate::graph::{Facts, GraphError, Life, Need, Plan, Resource, Step, plan, step};

/// Every buffer that passes share.
pub const RESOURCES: &[Resource] = &[
    Resource::new::<f32>("triangles", Life::Scene),
    Resource::new::<u32>("records", Life::Scene),
    Resource::new::<u32>("texels", Life::Scene),
    Resource::new::<UVec4>("bvh", Life::Scene),
    Resource::new::<u32>("lights", Life::Scene),
    Resource::new::<Surface>("surfaces", Life::Transient),
    Resource::new::<Vec4>("emitted", Life::Transient),
    Resource::new::<Reservoir>("reservoirs", Life::Transient),
    Resource::new::<Reservoir>("visible", Life::Transient),
    Resource::new::<Vec4>("color", Life::Transient),
    Resource::new::<Moments>("moments", Life::History),
    Resource::new::<u32>("display", Life::Transient),
];

/// How radiance becomes a colour on the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ToneCurve {
    /// Clip to 0..1
    Clip,
    /// Reinhard 2002, each channel
    Reinhard,
    /// The fit of the ACES reference by Narkowicz
    Aces,
    /// AgX: keeps the hue of bright colours natural
    #[default]
    Agx,
}

/// Direct light by resampled candidates without reuse, accumulated over independent frames.
fn resampled(curve: ToneCurve) -> Vec<Step> {
    let display = match curve {
        ToneCurve::Clip => "display_clip",
        ToneCurve::Reinhard => "display_reinhard",
        ToneCurve::Aces => "display_aces",
        ToneCurve::Agx => "display_agx",
    };
    vec![
        step("primary"),
        step("candidates").needs(Need::Lights),
        step("visibility").needs(Need::Lights),
        step("shade"),
        step("accumulate"),
        step(display),
    ]
}

/// Plans a frame of direct light with the given outputs.
///
/// # Errors
/// As [`plan`]: the size, or an output that no step writes.
pub fn direct_light(facts: &Facts, curve: ToneCurve, outputs: &[&'static str]) -> Result<Plan, GraphError> {
    direct_light_with(weir_shader::PASSES, facts, curve, outputs)
}

/// [`direct_light`] with another pass table of the same names, for tests that plant a difference in one kernel.
///
/// # Errors
/// As [`direct_light`].
pub fn direct_light_with(
    passes: &'static [Pass],
    facts: &Facts,
    curve: ToneCurve,
    outputs: &[&'static str],
) -> Result<Plan, GraphError> {
    plan(&resampled(curve), passes, RESOURCES, facts, outputs)
}
