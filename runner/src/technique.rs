//! The frames that weir knows: resources and steps.

use glam::{UVec4, Vec4};
use weir_shader::wiring::{Extent, Kernel, Pass, Variant};
use weir_shared::{
    block::Block,
    light::source,
    merge::form,
    moments::Moments,
    presample::LightRecord,
    resample::{Candidate, choice},
    reservoir::Reservoir,
    reuse::probe,
    surface::Surface,
};

use crate::{
    graph::{Culled, Facts, GraphError, Life, Need, Plan, Resource, Step, plan, step},
    settings::{Rays, Settings},
    skips::Rule,
};

/// Most rounds of spatial reuse in a frame.
pub const MAX_ROUNDS: u32 = 6;

/// Every buffer that passes share.
pub const RESOURCES: &[Resource] = &[
    Resource::new::<f32>("triangles", Life::Scene),
    Resource::new::<u32>("records", Life::Scene),
    Resource::new::<u32>("texels", Life::Scene),
    Resource::new::<UVec4>("bvh", Life::Scene),
    Resource::new::<u32>("lights", Life::Scene),
    Resource::new::<Surface>("surfaces", Life::History),
    Resource::new::<Vec4>("emitted", Life::History),
    Resource::new::<u32>("busy_blocks", Life::Transient).over(Extent::Blocks),
    Resource::new::<u32>("busy_in_rows", Life::Transient).over(Extent::TileRows),
    Resource::new::<UVec4>("tiles", Life::Transient).over(Extent::TileList),
    Resource::reservoirs::<Reservoir>("bsdf_hits", Life::Transient),
    Resource::new::<Block>("blocks", Life::Transient).over(Extent::Blocks),
    Resource::records::<LightRecord>("presampled", Life::Transient),
    Resource::candidates::<Candidate>("resident", Life::Transient),
    Resource::reservoirs::<Reservoir>("fresh", Life::Transient),
    Resource::reservoirs::<Reservoir>("fresh_visible", Life::Transient),
    Resource::reservoirs::<Reservoir>("temporal_marked", Life::Transient),
    Resource::reservoirs::<Reservoir>("temporal_merged", Life::Transient),
    Resource::reservoirs::<Vec4>("temporal_gathered", Life::Transient),
    Resource::reservoirs::<Reservoir>("temporal_visible", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_marked_a", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_marked_b", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_marked_c", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_marked_d", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_marked_e", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_marked_f", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_merged_a", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_merged_b", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_merged_c", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_merged_d", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_merged_e", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_merged_f", Life::Transient),
    Resource::reservoirs::<Vec4>("spatial_gathered_a", Life::Transient),
    Resource::reservoirs::<Vec4>("spatial_gathered_b", Life::Transient),
    Resource::reservoirs::<Vec4>("spatial_gathered_c", Life::Transient),
    Resource::reservoirs::<Vec4>("spatial_gathered_d", Life::Transient),
    Resource::reservoirs::<Vec4>("spatial_gathered_e", Life::Transient),
    Resource::reservoirs::<Vec4>("spatial_gathered_f", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_visible_a", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_visible_b", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_visible_c", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_visible_d", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_visible_e", Life::Transient),
    Resource::reservoirs::<Reservoir>("spatial_visible_f", Life::Transient),
    Resource::reservoirs::<Reservoir>("reservoirs", Life::History),
    Resource::reservoirs::<Reservoir>("visible", Life::Transient),
    Resource::new::<Vec4>("color", Life::Transient),
    Resource::new::<Moments>("moments", Life::History),
    Resource::new::<u32>("display", Life::Transient),
];

/// Resources of one round of spatial reuse: each result of a frame has a name of its own; memory is shared.
struct Round {
    marked: &'static str,
    merged: &'static str,
    gathered: &'static str,
    visible: &'static str,
}

macro_rules! rounds {
    ($($letter:literal)*) => {
        [$(Round {
            marked: concat!("spatial_marked_", $letter),
            merged: concat!("spatial_merged_", $letter),
            gathered: concat!("spatial_gathered_", $letter),
            visible: concat!("spatial_visible_", $letter),
        }),*]
    };
}

const ROUNDS: [Round; MAX_ROUNDS as usize] = rounds!("a" "b" "c" "d" "e" "f");

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

/// How direct light is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    /// Resampled candidates, each pixel and frame for itself.
    Candidates,
    /// Frames that are independent of each other, with spatial reuse: the error of their mean falls with the square root
    /// of their number.
    Still,
    /// Frames that reuse the frame before: what a viewer shows.
    RealTime,
}

impl std::fmt::Display for Technique {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Candidates => "candidates",
            Self::Still => "still",
            Self::RealTime => "real time",
        })
    }
}

impl Technique {
    /// Rays in directions of the BSDF, for each reservoir. They find no light that is hidden, so a reservoir that they
    /// feed speaks of visible lights only: reuse must know of visibility, or neighbours would be too dark.
    pub fn bsdf_rays(self, settings: &Settings) -> u32 {
        let reuses = self == Self::RealTime || self.rounds(settings) > 0;
        if reuses && settings.rays.probe() == probe::NONE { 0 } else { settings.candidates_bsdf }
    }

    /// Rounds of spatial reuse.
    pub fn rounds(self, settings: &Settings) -> u32 {
        match self {
            Self::Candidates => 0,
            Self::Still => settings.still_rounds,
            Self::RealTime => settings.spatial_rounds,
        }
    }
}

/// The chain of passes from candidates to what is shaded: steps, and where the reservoirs are at its end.
struct Chain {
    steps: Vec<Step>,
    /// Reservoirs after the last step.
    held: &'static str,
    /// Sum over the inputs of the last merge.
    gathered: Option<&'static str>,
    /// Whether samples that are hidden from their pixel have lost their weight.
    is_seen: bool,
}

impl Chain {
    fn push(&mut self, step: Step) {
        self.steps.push(step.needs(Need::Lights));
    }

    /// A shadow ray to each sample that is held.
    fn look(&mut self, into: &'static str) {
        self.push(step("visibility").with("unseen", self.held).with("visible", into));
        self.held = into;
        self.is_seen = true;
    }

    /// A merge; after it, with lazy rays, a shadow ray to what it kept.
    fn merged(&mut self, rays: Rays, merged: &'static str, gathered: &'static str, visible: &'static str) {
        self.held = merged;
        self.gathered = Some(gathered);
        self.is_seen = rays == Rays::Quality;
        if rays == Rays::Balanced {
            self.look(visible);
        }
    }
}

/// The steps of a frame.
fn steps(technique: Technique, settings: &Settings, curve: ToneCurve) -> Vec<Step> {
    let (rays, rounds) = (settings.rays, technique.rounds(settings));
    let reuses = technique == Technique::RealTime || rounds > 0;
    let pairwise = matches!(settings.mis_form, form::PAIRWISE | form::PAIRWISE_DEFENSIVE);
    let mut chain = Chain { steps: Vec::new(), held: "fresh", gathered: None, is_seen: false };
    let why_not =
        if settings.candidates_bsdf > 0 { "reuse does not know of visibility" } else { "`candidates.bsdf` is 0" };
    chain.push(step("bsdf_rays").only_if(technique.bsdf_rays(settings) > 0, why_not));
    let (ahead, need) = match settings.source {
        source::CELLS => ("presample_cells", Need::EmissiveTriangles),
        source::CUTS => ("light_cuts", Need::LightCuts),
        _ => ("presample_tiles", Need::MoreThanATile),
    };
    let draws_ahead = matches!(settings.source, source::TILES | source::CELLS | source::CUTS);
    if settings.source == source::CUTS {
        chain.steps.push(step("light_cuts_blocks").needs(need));
    }
    chain.steps.push(step(ahead).only_if(draws_ahead, "`candidates.source` draws no lights ahead").needs(need));
    if settings.choice == choice::INVERSION {
        chain.push(step("resident"));
        chain.push(step("candidates_by_inversion"));
    } else {
        chain.push(step("candidates"));
    }
    if reuses && rays.before() {
        chain.look("fresh_visible");
    }
    if technique == Technique::RealTime {
        if rays.probe() != probe::NONE {
            chain.push(step("temporal_rays").with("fresh", chain.held).with("marked", "temporal_marked"));
            chain.held = "temporal_marked";
        }
        // The result of the last merge of the frame is what the next frame remembers.
        let last = rounds == 0;
        let names = match (last, rays == Rays::Balanced) {
            (true, true) => ("temporal_merged", "reservoirs"),
            (true, false) => ("reservoirs", ""),
            (false, _) => ("temporal_merged", "temporal_visible"),
        };
        let pass = if pairwise { "temporal" } else { "temporal_any_form" };
        chain.push(step(pass).with("fresh", chain.held).with("merged", names.0).with("gathered", "temporal_gathered"));
        chain.merged(rays, names.0, "temporal_gathered", names.1);
    }
    for (round, names) in (0..rounds).zip(&ROUNDS) {
        let merging = chain.held;
        let mut own = merging;
        if rays.probe() != probe::NONE {
            chain.push(step("spatial_rays").with("merging", merging).with("marked", names.marked).round(round));
            own = names.marked;
        }
        let last = round + 1 == rounds && technique == Technique::RealTime;
        let (merged, visible) = match (last, rays == Rays::Balanced) {
            (true, true) => (names.merged, "reservoirs"),
            (true, false) => ("reservoirs", ""),
            (false, _) => (names.merged, names.visible),
        };
        let pass = if pairwise { "spatial" } else { "spatial_any_form" };
        let merge = step(pass).with("marked", own).with("merging", merging);
        chain.push(merge.with("merged", merged).with("gathered", names.gathered).round(round));
        chain.merged(rays, merged, names.gathered, visible);
    }
    if !chain.is_seen && rays.after(reuses) {
        chain.look("visible");
    }

    let has_edges = settings.jitter && settings.camera_rays > 1;
    let is_kept = !settings.jitter && settings.skips.is_on(Rule::Primary);
    let mut steps = vec![step("primary").kept_if(is_kept).reads_if("prev_emitted", has_edges)];
    steps.extend(["tiles_blocks", "tiles_rows", "tiles_list"].map(|pass| {
        let wanted = settings.skips.is_on(Rule::Tiles);
        step(pass).only_if(wanted, "`skip.tiles` is off: all tiles").needs(Need::Lights).kept_if(is_kept)
    }));
    steps.append(&mut chain.steps);
    match chain.gathered.filter(|_| settings.sum && rays == Rays::Quality) {
        Some(gathered) => steps.push(step("shade_sum").with("gathered", gathered)),
        None => steps.push(step("shade").with("visible", chain.held)),
    }
    steps.push(step("accumulate"));
    steps.push(step(match curve {
        ToneCurve::Clip => "display_clip",
        ToneCurve::Reinhard => "display_reinhard",
        ToneCurve::Aces => "display_aces",
        ToneCurve::Agx => "display_agx",
    }));
    steps
}

/// Plans a frame with the given outputs.
///
/// # Errors
/// As [`plan`]: the size, or an output that no step writes.
pub fn direct_light(
    technique: Technique,
    settings: &Settings,
    facts: &Facts,
    curve: ToneCurve,
    outputs: &[&'static str],
) -> Result<Plan, GraphError> {
    direct_light_with(weir_shader::PASSES, technique, settings, facts, curve, outputs)
}

/// [`direct_light`] with another pass table of the same names, for tests that plant a difference in one kernel.
///
/// # Errors
/// As [`direct_light`].
pub fn direct_light_with(
    passes: &'static [Pass],
    technique: Technique,
    settings: &Settings,
    facts: &Facts,
    curve: ToneCurve,
    outputs: &[&'static str],
) -> Result<Plan, GraphError> {
    let steps = steps(technique, settings, curve);
    if settings.skips.is_on(Rule::Unread) {
        return plan(&steps, passes, RESOURCES, facts, outputs);
    }
    // Everything that a step writes is wanted.
    let whole = plan(&steps, passes, RESOURCES, facts, outputs)?;
    let unread = whole.culled.iter().filter(|(_, why)| *why == Culled::NothingReadsIt).map(|(pass, _)| *pass);
    let unread: Vec<&str> = unread.collect();
    let all = steps.iter().filter(|step| unread.contains(&step.pass)).flat_map(|step| step.writes(passes));
    plan(&steps, passes, RESOURCES, facts, &outputs.iter().copied().chain(all).collect::<Vec<_>>())
}

/// The pass table, with other kernels for the variants of passes of which `kernels` has any, for tests that plant a difference.
/// Its memory is never given back.
pub fn passes_with(kernels: impl Fn(&Pass) -> Option<Vec<Kernel>>) -> &'static [Pass] {
    let replaced = |pass: &'static Pass| -> &'static [Variant] {
        let Some(kernels) = kernels(pass) else { return pass.variants };
        let variants = pass.variants.iter().zip(kernels);
        Vec::leak(variants.map(|(&Variant { entry_point, .. }, run)| Variant { entry_point, run }).collect())
    };
    let of = |pass: &'static Pass| {
        let &Pass { name, extent, features, bindings, .. } = pass;
        Pass { name, extent, features, variants: replaced(pass), bindings }
    };
    Vec::leak(weir_shader::PASSES.iter().map(of).collect())
}

/// [`passes_with`] one kernel for all variants of the pass of that name.
pub fn passes_with_one(name: &str, kernel: Kernel) -> &'static [Pass] {
    passes_with(|pass| (pass.name == name).then(|| vec![kernel; pass.variants.len()]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{executor::gpu::Traversal, settings::Preset};

    /// Passes that shoot rays after the camera's, and how many of them a frame has.
    fn rays(technique: Technique, preset: Preset) -> [usize; 4] {
        let facts = Facts {
            width: 8,
            height: 8,
            reservoirs: 1,
            candidates: 2,
            records: [1; 2],
            has: vec![Need::Lights],
            features: Vec::new(),
            traversal: Traversal::Auto,
            spared: Vec::new(),
        };
        let plan = direct_light(technique, &preset.settings(), &facts, ToneCurve::default(), &["display"]);
        let names = plan.expect("a frame").pass_names();
        ["bsdf_rays", "visibility", "temporal_rays", "spatial_rays"]
            .map(|pass| names.iter().filter(|name| **name == pass).count())
    }

    /// Help and README state them: `temporal_rays` and `spatial_rays` shoot one ray from a partner and, for `quality`,
    /// one to the sample of every other input; the others shoot one.
    #[test]
    fn each_preset_shoots_the_rays_that_its_help_states() {
        assert_eq!(rays(Technique::RealTime, Preset::Fast), [0, 1, 0, 0]);
        assert_eq!(rays(Technique::RealTime, Preset::Balanced), [1, 2, 1, 0]);
        assert_eq!(rays(Technique::RealTime, Preset::Quality), [1, 1, 1, 1]);
        assert_eq!(rays(Technique::RealTime, Preset::Paper), [0, 1, 1, 1]);
        assert_eq!(rays(Technique::Still, Preset::Balanced), [1, 4, 0, 3]);
    }

    #[test]
    fn lights_are_drawn_ahead_only_where_they_are_asked_for_and_there_are_any() {
        let plan_of = |source: &str, has: &[Need]| {
            let mut settings = Settings::default();
            settings.apply(&format!("candidates.source={source}")).expect("a source");
            let records = settings.records(8, 8);
            let facts = Facts {
                width: 8,
                height: 8,
                reservoirs: 1,
                candidates: 2,
                records,
                has: has.to_vec(),
                features: Vec::new(),
                traversal: Traversal::Auto,
                spared: Vec::new(),
            };
            direct_light(Technique::Still, &settings, &facts, ToneCurve::default(), &["display"]).expect("a frame")
        };
        let all = [Need::Lights, Need::EmissiveTriangles, Need::LightCuts, Need::MoreThanATile];
        for (source, passes, bytes) in [
            ("tiles", &["presample_tiles"] as &[&str], 64 * 128 * 1024),
            ("cells", &["presample_cells"], 64 * 32 * 6 * 512),
            ("cuts", &["light_cuts_blocks", "light_cuts"], 64 * 8),
        ] {
            let plan = plan_of(source, &all);
            let mut names = plan.pass_names();
            names.retain(|name| name.starts_with("presample") || name.contains("cuts"));
            assert_eq!(names, *passes);
            assert_eq!(plan.output_bytes("presampled"), Some(bytes));
            let of_a_sky = plan_of(source, &all[..1]).pass_names();
            assert!(passes.iter().all(|pass| !of_a_sky.contains(pass)), "a sky alone");
        }
        let plan = plan_of("power", &all);
        assert_eq!(plan.output_bytes("presampled"), None);
        assert!(plan.culled.iter().any(|(name, why)| *name == "presample_tiles" && why.to_string().contains("ahead")));
        assert!(plan.frame_bytes() < 1 << 20, "no memory for what is not drawn: {}", plan.frame_bytes());
    }

    #[test]
    fn candidates_stay_in_memory_only_where_they_are_chosen_by_inversion() {
        let plan_of = |choice: &str| {
            let mut settings = Settings::default();
            settings.apply(&format!("reservoirs.choice={choice}")).expect("a choice");
            let candidates = settings.candidates_in_memory();
            let (records, has) = ([1; 2], vec![Need::Lights]);
            let facts = Facts {
                width: 8,
                height: 8,
                reservoirs: 2,
                candidates,
                records,
                has,
                features: Vec::new(),
                traversal: Traversal::Auto,
                spared: Vec::new(),
            };
            direct_light(Technique::Still, &settings, &facts, ToneCurve::default(), &["display"]).expect("a frame")
        };
        let (stream, memory) = (plan_of("threshold"), plan_of("inversion"));
        assert_eq!((stream.output_bytes("resident"), stream.output_bytes("fresh")), (None, Some(64 * 2 * 16)));
        // Four and one by the BSDF, 20 bytes each.
        assert_eq!(memory.output_bytes("resident"), Some(64 * 2 * 5 * 20));
        assert!(stream.pass_names().contains(&"candidates") && !memory.pass_names().contains(&"candidates"));
    }
}
