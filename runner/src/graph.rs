//! The frame graph: which passes run, on which memory.
//!
//! Data, not objects: a table of resources and an ordered list of steps. [`plan`] checks them, leaves out what nobody
//! needs and places what remains; it never reorders. Two executors run one plan. A result that is left out reads as
//! zeros, the neutral value of every buffer.

mod element;
mod place;
mod print;

use std::collections::BTreeSet;

use thiserror::Error;
use weir_shader::wiring::{Access, Extent, Feature, Grid, Pass, Variant};
use weir_shared::frame::{Frame, FramePair};

use crate::{
    executor::gpu::Traversal,
    exit::{Exit, HasExit},
    skips::FEATURES,
};

pub use element::Element;

/// A buffer that passes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resource {
    /// Name that the pass table uses; last frame's contents are `prev_` and this.
    pub name: &'static str,
    /// Bytes of an element.
    pub stride: usize,
    /// Bit i: word i of an element is a float.
    pub float_words: u32,
    /// How many elements it has.
    pub extent: Extent,
    /// How long it lives.
    pub life: Life,
}

/// How long a resource lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Life {
    /// As long as the scene, which also sets its size; no pass writes it.
    Scene,
    /// Within a frame; shares memory with others.
    Transient,
    /// Into the next frame.
    History,
}

impl Resource {
    /// A resource with an element of type `T` for each pixel.
    pub const fn new<T: Element>(name: &'static str, life: Life) -> Self {
        Self { name, stride: size_of::<T>(), float_words: T::FLOAT_WORDS, extent: Extent::Pixels, life }
    }

    /// A resource with an element of type `T` for each reservoir of each pixel.
    pub const fn reservoirs<T: Element>(name: &'static str, life: Life) -> Self {
        Self { extent: Extent::Reservoirs, ..Self::new::<T>(name, life) }
    }

    /// A resource with an element of type `T` for each candidate of each reservoir.
    pub const fn candidates<T: Element>(name: &'static str, life: Life) -> Self {
        Self { extent: Extent::Candidates, ..Self::new::<T>(name, life) }
    }

    /// A resource with an element of type `T` for each record of lights drawn ahead.
    pub const fn records<T: Element>(name: &'static str, life: Life) -> Self {
        Self { extent: Extent::Records, ..Self::new::<T>(name, life) }
    }

    /// The same with an element for each of something else.
    pub const fn over(self, extent: Extent) -> Self {
        Self { extent, ..self }
    }

    /// Bytes of it, for what is not the scene's.
    pub(crate) fn bytes(&self, facts: &Facts) -> u64 {
        self.stride as u64 * facts.elements(self.extent)
    }
}

/// Something that a scene can lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Light of any kind.
    Lights,
    /// Emissive triangles or shapes that emit: what the tables over emitters draw.
    EmissiveTriangles,
    /// Trees for cuts.
    LightCuts,
    /// More lights than a tile has records.
    MoreThanATile,
}

impl std::fmt::Display for Need {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Lights => "lights",
            Self::EmissiveTriangles => "emissive triangles or shapes",
            Self::LightCuts => "trees for cuts",
            Self::MoreThanATile => "more lights than a tile has records",
        })
    }
}

/// A pass in the frame, with what it is good for only if the scene has it.
#[derive(Clone, Debug)]
pub struct Step {
    /// Name in the pass table.
    pub pass: &'static str,
    /// Without this, the step is left out and its results read as zeros.
    pub needs: Option<Need>,
    /// Why the settings leave the step out, if they do.
    pub off: Option<&'static str>,
    /// Resources that stand in for those that the pass names: (name in the pass, resource).
    pub renamed: Vec<(&'static str, &'static str)>,
    /// Which round of a repeated pass this is, from 0: what `Frame::round` says to it.
    pub round: u32,
    /// Whether its results are those of the frame before if that has seen the same, and stay in memory for it.
    pub is_kept: bool,
    /// Inputs that it does not look at with these settings, so that nobody has to keep them.
    pub ignored: Vec<&'static str>,
}

/// A step that always runs.
pub const fn step(pass: &'static str) -> Step {
    Step { pass, needs: None, off: None, renamed: Vec::new(), round: 0, is_kept: false, ignored: Vec::new() }
}

impl Step {
    /// The step, run only in scenes that have `need`.
    pub fn needs(self, need: Need) -> Self {
        Self { needs: Some(need), ..self }
    }

    /// The step, run only if the settings want it; else the reason why not.
    pub fn only_if(self, wanted: bool, reason: &'static str) -> Self {
        Self { off: if wanted { None } else { Some(reason) }, ..self }
    }

    /// The step with `resource` in place of what the pass calls `name`.
    pub fn with(mut self, name: &'static str, resource: &'static str) -> Self {
        self.renamed.push((name, resource));
        self
    }

    /// The step as round `round` of a repeated pass.
    pub fn round(self, round: u32) -> Self {
        Self { round, ..self }
    }

    /// The step, not run again while the camera sees the same, if `wanted`.
    pub fn kept_if(self, wanted: bool) -> Self {
        Self { is_kept: wanted, ..self }
    }

    /// The step, which does not look at input `name` unless `wanted`: one zero takes its place.
    pub fn reads_if(mut self, name: &'static str, wanted: bool) -> Self {
        if !wanted {
            self.ignored.push(name);
        }
        self
    }

    /// Names of the resources that it writes.
    pub(crate) fn writes(&self, passes: &'static [Pass]) -> Vec<&'static str> {
        let bindings = passes.iter().find(|pass| pass.name == self.pass).map_or(&[][..], |pass| pass.bindings);
        bindings.iter().filter(|b| b.access == Access::Write).map(|b| self.resource_of(b.name)).collect()
    }

    /// The resource behind what the pass calls `name`.
    fn resource_of(&self, name: &'static str) -> &'static str {
        self.renamed.iter().find(|(from, _)| *from == name).map_or(name, |(_, to)| to)
    }
}

/// What the plan depends on beside the steps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Facts {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Reservoirs of each pixel.
    pub reservoirs: u32,
    /// Candidates of each reservoir that memory has places for, where they stay in memory.
    pub candidates: u32,
    /// Columns and rows of records of lights drawn ahead.
    pub records: [u32; 2],
    /// What the scene has of what steps may need.
    pub has: Vec<Need>,
    /// Features that choose among the variants of passes.
    pub features: Vec<Feature>,
    /// How rays find what they meet on a GPU.
    pub traversal: Traversal,
    /// Work within and around passes that frames do without, and why.
    pub spared: Vec<(&'static str, &'static str)>,
}

impl Facts {
    /// Whether plans are the same by both: all but [`Facts::spared`], which nothing depends on.
    pub fn is_like(&self, other: &Self) -> bool {
        let spared = &self.spared;
        *self == Self { spared: spared.clone(), ..other.clone() }
    }

    /// What a pass of an extent runs over.
    pub fn grid(&self, extent: Extent) -> Grid {
        let &Self { width, height, reservoirs, candidates, records: [presampled_columns, presampled_rows], .. } = self;
        extent.grid(&Frame {
            width,
            height,
            reservoirs,
            candidates,
            presampled_columns,
            presampled_rows,
            ..Frame::default()
        })
    }

    /// Number of elements of an extent.
    pub fn elements(&self, extent: Extent) -> u64 {
        self.grid(extent).elements()
    }
}

/// Why a step does not run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Culled {
    /// No kept step reads what it writes, and nobody asked for it.
    NothingReadsIt,
    /// The scene lacks what the step needs.
    SceneHasNo(Need),
    /// The settings do without, for this reason.
    Setting(&'static str),
}

impl std::fmt::Display for Culled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NothingReadsIt => f.write_str("nothing reads what it writes"),
            Self::SceneHasNo(need) => write!(f, "the scene has no {need}"),
            Self::Setting(reason) => f.write_str(reason),
        }
    }
}

/// Memory that a binding refers to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// A buffer of the scene.
    Scene(&'static str),
    /// This frame's half of a doubled buffer: an index into [`Plan::history`].
    Current(usize),
    /// Last frame's half.
    Previous(usize),
    /// A buffer of the frame's pool: an index into [`Plan::pool`].
    Pool(usize),
    /// The buffer of zeros that stands in for what was left out.
    Zero,
}

/// A step that runs.
#[derive(Clone, Debug)]
pub struct Planned {
    /// The row of the pass table.
    pub pass: &'static Pass,
    /// The variant for the scene's features.
    pub variant: &'static Variant,
    /// Memory for each binding of the pass, in its order.
    pub slots: Vec<(Access, Slot)>,
    /// Resource of each binding of the pass, in its order; last frame's contents are `prev_` and its name.
    pub names: Vec<&'static str>,
    /// Which round of a repeated pass this is.
    pub round: u32,
    /// Whether a frame that sees what the last two have seen does without it, see [`crate::executor::View`].
    pub is_kept: bool,
}

impl Planned {
    /// The frame as this step sees it.
    pub fn frames(&self, frames: &FramePair) -> FramePair {
        FramePair { now: Frame { round: self.round, ..frames.now }, prev: frames.prev }
    }

    /// Whether it runs over a list of tiles, and writes nothing of others.
    pub fn is_listed(&self) -> bool {
        self.list().is_some()
    }

    /// Where the list of tiles is that it runs over.
    pub(crate) fn list(&self) -> Option<Slot> {
        let mut slots = self.pass.bindings.iter().zip(&self.slots);
        slots.find(|(b, (_, slot))| b.is_uniform && *slot != Slot::Zero).map(|(_, (_, slot))| *slot)
    }

    /// Names of the resources that it writes, with the bytes of an element.
    pub fn writes(&self) -> impl Iterator<Item = (&'static str, usize)> + '_ {
        let bindings = self.pass.bindings.iter().zip(&self.names);
        bindings.filter(|(b, _)| b.access == Access::Write).map(|(b, name)| (*name, b.stride))
    }
}

/// A doubled buffer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct History {
    /// The resource.
    pub name: &'static str,
    /// Bytes of each half.
    pub bytes: u64,
}

/// What to run for each frame, and how much memory that takes.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Steps, in order.
    pub steps: Vec<Planned>,
    /// Steps that do not run, with the reason.
    pub culled: Vec<(&'static str, Culled)>,
    /// Doubled buffers.
    pub history: Vec<History>,
    /// Bytes of each buffer of the pool.
    pub pool: Vec<u64>,
    /// Bytes of the buffer of zeros; 0 if no step needs it.
    pub zero_bytes: u64,
    /// Where the requested outputs are after a frame.
    pub outputs: Vec<(&'static str, Slot)>,
    /// What the plan was made for.
    pub facts: Facts,
}

/// What is wrong with a list of steps.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum GraphError {
    /// A step names no row of the pass table.
    #[error("step `{0}` names no pass; the table in shader/src/lib.rs lists them")]
    UnknownPass(&'static str),
    /// A binding names no resource.
    #[error("pass `{pass}` binds `{name}`, which is not in the resource table")]
    UnknownResource {
        /// The pass.
        pass: &'static str,
        /// The binding.
        name: &'static str,
    },
    /// Element sizes differ.
    #[error("pass `{pass}` sees `{name}` as {pass_stride}-byte elements, the resource table says {stride}")]
    Stride {
        /// The pass.
        pass: &'static str,
        /// The binding.
        name: &'static str,
        /// Bytes of an element in the pass.
        pass_stride: usize,
        /// Bytes of an element in the table.
        stride: usize,
    },
    /// A pass computes an element for each of one thing, the resource has one for each of another.
    #[error("pass `{pass}` writes `{name}` once for each {pass_extent}, the resource table says each {extent}")]
    Extent {
        /// The pass.
        pass: &'static str,
        /// The resource.
        name: &'static str,
        /// Of the pass.
        pass_extent: Extent,
        /// Of the resource.
        extent: Extent,
    },
    /// A result is read before it is written.
    #[error("pass `{pass}` reads `{name}`, but no earlier step writes it; for last frame's value bind `prev_{name}`")]
    ReadBeforeWrite {
        /// The pass.
        pass: &'static str,
        /// The binding.
        name: &'static str,
    },
    /// A pass reads what it writes.
    #[error("pass `{pass}` reads its own output `{name}`: its neighbours would race; give the result another name")]
    ReadsOwnOutput {
        /// The pass.
        pass: &'static str,
        /// The binding.
        name: &'static str,
    },
    /// Two steps write one resource.
    #[error("pass `{second}` writes `{name}`, which `{first}` wrote; give the second result another name")]
    TwoWriters {
        /// The resource.
        name: &'static str,
        /// The earlier writer.
        first: &'static str,
        /// The later writer.
        second: &'static str,
    },
    /// A pass writes a buffer of the scene.
    #[error("pass `{pass}` writes `{name}`, which belongs to the scene and is the same for all frames")]
    WritesScene {
        /// The pass.
        pass: &'static str,
        /// The binding.
        name: &'static str,
    },
    /// `prev_x` of something that does not outlive the frame.
    #[error("pass `{pass}` reads `prev_{name}`, but `{name}` is not history; set its life to Life::History")]
    NotHistory {
        /// The pass.
        pass: &'static str,
        /// The resource.
        name: &'static str,
    },
    /// `prev_x` that no step fills.
    #[error("pass `{pass}` reads `prev_{name}`, but no step writes `{name}`")]
    HistoryNeverWritten {
        /// The pass.
        pass: &'static str,
        /// The resource.
        name: &'static str,
    },
    /// An output that no step writes.
    #[error("output `{0}` was asked for, but no step writes it")]
    UnknownOutput(&'static str),
    /// An image without pixels.
    #[error("the image is {0}x{1} pixels; both must be between 1 and 32768")]
    Size(u32, u32),
}

impl HasExit for GraphError {
    /// Only the size comes from the command line; steps and passes are weir's own.
    fn exit(&self) -> Exit {
        match self {
            Self::Size(..) => Exit::Usage,
            _ => Exit::Internal,
        }
    }
}

/// A binding of a step, resolved: which resource, and whether last frame's.
#[derive(Clone, Copy)]
struct Use {
    access: Access,
    resource: Resource,
    previous: bool,
    /// Whether the step does not look at it.
    ignored: bool,
    /// Name of the resource, with `prev_` for last frame's.
    name: &'static str,
}

/// A step with its row of the pass table and its resources.
struct Resolved {
    pass: &'static Pass,
    uses: Vec<Use>,
}

impl Resolved {
    fn names(&self, access: Access) -> impl Iterator<Item = &'static str> + '_ {
        self.uses.iter().filter(move |u| u.access == access && !u.ignored).map(|u| u.resource.name)
    }
}

fn resolve(step: &Step, passes: &'static [Pass], resources: &[Resource]) -> Result<Resolved, GraphError> {
    let pass = passes.iter().find(|p| p.name == step.pass).ok_or(GraphError::UnknownPass(step.pass))?;
    let mut uses = Vec::new();
    for binding in pass.bindings {
        let name = step.resource_of(binding.name);
        let base = name.strip_prefix("prev_");
        let resource = *resources
            .iter()
            .find(|r| r.name == base.unwrap_or(name))
            .ok_or(GraphError::UnknownResource { pass: pass.name, name })?;
        if resource.stride != binding.stride {
            let (pass_stride, stride) = (binding.stride, resource.stride);
            return Err(GraphError::Stride { pass: pass.name, name, pass_stride, stride });
        }
        if base.is_some() && resource.life != Life::History {
            return Err(GraphError::NotHistory { pass: pass.name, name: resource.name });
        }
        if binding.access == Access::Write && resource.life != Life::Scene && resource.extent != pass.extent {
            let (pass_extent, extent) = (pass.extent, resource.extent);
            return Err(GraphError::Extent { pass: pass.name, name, pass_extent, extent });
        }
        let ignored = step.ignored.contains(&binding.name);
        uses.push(Use { access: binding.access, resource, previous: base.is_some(), ignored, name });
    }
    Ok(Resolved { pass, uses })
}

/// Checks the steps, leaves out what `outputs` do not depend on or the scene has no use for, and places memory.
///
/// # Errors
/// A [`GraphError`] that says in words what is wrong with the steps, the table or the size.
pub fn plan(
    steps: &[Step],
    passes: &'static [Pass],
    resources: &[Resource],
    facts: &Facts,
    outputs: &[&'static str],
) -> Result<Plan, GraphError> {
    let (width, height) = (facts.width, facts.height);
    if !(1..=32_768).contains(&width) || !(1..=32_768).contains(&height) {
        return Err(GraphError::Size(width, height));
    }
    let resolved = check(steps, passes, resources, outputs)?;
    let (live, culled) = cull(steps, resolved, facts, outputs);
    Ok(place::place(&live, culled, resources, facts, outputs))
}

/// Looks up every pass and rejects hazards; the whole list is checked, culled or not.
fn check(
    steps: &[Step],
    passes: &'static [Pass],
    resources: &[Resource],
    outputs: &[&'static str],
) -> Result<Vec<Resolved>, GraphError> {
    let mut all = Vec::new();
    let mut written: Vec<(&'static str, &'static str)> = Vec::new();
    for step in steps {
        let resolved = resolve(step, passes, resources)?;
        let pass = resolved.pass;
        for Use { access, resource, previous, name: full_name, .. } in &resolved.uses {
            let name = resource.name;
            let own = resolved.uses.iter().any(|u| u.access == Access::Write && u.name == *full_name);
            match access {
                Access::Read if *previous || resource.life == Life::Scene => {}
                Access::Read if own => return Err(GraphError::ReadsOwnOutput { pass: pass.name, name }),
                Access::Read if !written.iter().any(|(w, _)| *w == name) => {
                    return Err(GraphError::ReadBeforeWrite { pass: pass.name, name });
                }
                Access::Read => {}
                Access::Write if resource.life == Life::Scene => {
                    return Err(GraphError::WritesScene { pass: pass.name, name });
                }
                Access::Write => {
                    if let Some((_, first)) = written.iter().find(|(w, _)| *w == name) {
                        return Err(GraphError::TwoWriters { name, first, second: pass.name });
                    }
                    written.push((name, pass.name));
                }
            }
        }
        all.push(resolved);
    }
    for resolved in &all {
        for Use { resource, .. } in resolved.uses.iter().filter(|u| u.previous) {
            if !written.iter().any(|(w, _)| *w == resource.name) {
                let (pass, name) = (resolved.pass.name, resource.name);
                return Err(GraphError::HistoryNeverWritten { pass, name });
            }
        }
    }
    match outputs.iter().find(|&&o| !written.iter().any(|(w, _)| *w == o)) {
        Some(missing) => Err(GraphError::UnknownOutput(missing)),
        None => Ok(all),
    }
}

/// A step that survived: its pass, its resources and the variant for the scene.
struct Live {
    resolved: Resolved,
    variant: &'static Variant,
    round: u32,
    is_kept: bool,
}

fn cull(
    steps: &[Step],
    resolved: Vec<Resolved>,
    facts: &Facts,
    outputs: &[&'static str],
) -> (Vec<Live>, Vec<(&'static str, Culled)>) {
    let lacks = |step: &Step| {
        let need = step.needs.filter(|need| !facts.has.contains(need)).map(Culled::SceneHasNo);
        step.off.map(Culled::Setting).or(need)
    };
    // Backwards from the outputs, until history adds nothing more.
    let mut wanted: BTreeSet<&str> = outputs.iter().copied().collect();
    loop {
        let before = wanted.len();
        for (step, resolved) in steps.iter().zip(&resolved).rev() {
            if lacks(step).is_none() && resolved.names(Access::Write).any(|name| wanted.contains(name)) {
                wanted.extend(resolved.names(Access::Read));
            }
        }
        if wanted.len() == before {
            break;
        }
    }
    let (mut live, mut culled) = (Vec::new(), Vec::new());
    for (step, resolved) in steps.iter().zip(resolved) {
        let writes_wanted = resolved.names(Access::Write).any(|name| wanted.contains(name));
        match lacks(step) {
            Some(reason) => culled.push((step.pass, reason)),
            None if !writes_wanted => culled.push((step.pass, Culled::NothingReadsIt)),
            None => {
                let variant = resolved.pass.variant(&facts.features);
                live.push(Live { resolved, variant, round: step.round, is_kept: step.is_kept });
            }
        }
    }
    (live, culled)
}

impl Plan {
    /// What is left out, and why: steps, then code that passes would have for what the scene lacks, then other work.
    pub fn left_out(&self) -> Vec<(&'static str, String)> {
        let steps = self.culled.iter().map(|(pass, why)| (*pass, why.to_string()));
        let is_absent = |feature: &Feature| !self.facts.features.contains(feature);
        let code = FEATURES.into_iter().filter(is_absent).map(|feature| match feature {
            Feature::TEXTURES => ("code: images", "no material has any"),
            Feature::MASKS => ("code: alpha masks", "no material has any"),
            Feature::EMISSION_IMAGES => ("code: images of lights", "nothing that emits has any"),
            Feature::ENVIRONMENT => ("code: other lights", "all that emits is triangles"),
            Feature::INSTANCES => ("code: instances", "there is one, in place"),
            Feature::SPECULAR => ("code: gloss", "every material is Lambert's"),
            Feature::CLOSED_FORM => ("code: closed forms", "light has none here, or is to be sampled everywhere"),
        });
        let others = code.chain(self.facts.spared.iter().copied());
        steps.chain(others.map(|(what, why)| (what, why.to_owned()))).collect()
    }

    /// Names of the passes that run, in order.
    pub fn pass_names(&self) -> Vec<&'static str> {
        self.steps.iter().map(|s| s.pass.name).collect()
    }

    /// What is to be zeros before a step runs: outputs of the plan of which it leaves tiles unwritten. Of other results
    /// nobody reads these.
    pub fn cleared(&self, step: &Planned) -> impl Iterator<Item = Slot> + '_ {
        let written: Vec<Slot> =
            step.slots.iter().filter(|(access, _)| *access == Access::Write).map(|(_, slot)| *slot).collect();
        let is_listed = step.is_listed();
        self.outputs.iter().map(|(_, slot)| *slot).filter(move |slot| is_listed && written.contains(slot))
    }

    /// Bytes of all buffers of the frame, the scene's apart.
    pub fn frame_bytes(&self) -> u64 {
        self.pool.iter().sum::<u64>() + 2 * self.history.iter().map(|h| h.bytes).sum::<u64>() + self.zero_bytes
    }

    /// Bytes of a result of one of the steps; `None` if no step writes it.
    pub fn output_bytes(&self, name: &str) -> Option<usize> {
        self.steps.iter().find_map(|step| {
            let (_, stride) = step.writes().find(|(written, _)| *written == name)?;
            Some(stride * self.facts.elements(step.pass.extent) as usize)
        })
    }

    /// Number of rounds that some pass is repeated for; at least 1.
    pub fn rounds(&self) -> u32 {
        self.steps.iter().map(|s| s.round + 1).max().unwrap_or(1)
    }
}

#[cfg(test)]
mod tests;
