//! Bugs on purpose: kernels of temporal reuse that see altered inputs, and scenes that say something false.

use weir_shader::{
    PASSES,
    wiring::{Access, Band, Buffers, Kernel, Pass, Variant},
};
use weir_shared::{
    alias,
    frame::{Frame, FramePair},
    reservoir::{MAX_CONFIDENCE, Reservoir},
    scene::{NO_INSTANCE, instance_record},
};

use crate::chains::{Clip, Snapshot};

/// What temporal reuse is about to read.
pub struct Seen<'a> {
    pub frames: &'a mut FramePair,
    /// The pixel's own reservoirs.
    own: &'a mut [Reservoir],
    /// Those of the frame before.
    past: &'a mut [Reservoir],
    /// The merge itself, not the shadow rays before it.
    is_merge: bool,
}

/// A bug in temporal reuse.
pub trait Bug {
    fn plant(seen: &mut Seen<'_>);
}

/// Nothing: what goes through the same detour and is right.
pub struct NoBug;

impl Bug for NoBug {
    fn plant(_: &mut Seen<'_>) {}
}

/// The pixel's own sample is lost where there is history, but not its confidence.
pub struct NoCanonicalTerm;

impl Bug for NoCanonicalTerm {
    fn plant(seen: &mut Seen<'_>) {
        if seen.frames.now.has_history == 1 {
            seen.own.iter_mut().for_each(|r| r.ucw = 0.0);
        }
    }
}

/// Reservoirs that have found nothing count for nothing.
pub struct NullWithoutConfidence;

impl Bug for NullWithoutConfidence {
    fn plant(seen: &mut Seen<'_>) {
        seen.past.iter_mut().filter(|r| !r.has_sample()).for_each(|r| *r = Reservoir::EMPTY);
    }
}

/// Reservoirs with a large weight are not reused, as a filter of bright pixels would have it.
pub struct RejectedByContent;

impl Bug for RejectedByContent {
    fn plant(seen: &mut Seen<'_>) {
        let mut weights: Vec<f32> = seen.past.iter().map(|r| r.ucw).filter(|&w| w > 0.0).collect();
        if weights.is_empty() {
            return;
        }
        let at = weights.len() * 4 / 5;
        let limit = *weights.select_nth_unstable_by(at, f32::total_cmp).1;
        seen.past.iter_mut().filter(|r| r.ucw > limit).for_each(|r| *r = Reservoir::EMPTY);
    }
}

/// The past is judged by the lights of the present.
pub struct PastUnderPresentLights;

impl Bug for PastUnderPresentLights {
    fn plant(seen: &mut Seen<'_>) {
        let now = seen.frames.now;
        let Frame { instances_at, instance_count, emitters_at, emitter_count, light_count, .. } = now;
        seen.frames.prev =
            Frame { instances_at, instance_count, emitters_at, emitter_count, light_count, ..seen.frames.prev };
    }
}

/// Shadow rays take weights away, but the MIS weights do not know of them.
pub struct VisibilityUnknownToMis;

impl Bug for VisibilityUnknownToMis {
    fn plant(seen: &mut Seen<'_>) {
        if seen.is_merge {
            seen.own.iter_mut().for_each(|r| r.state &= 0x8000_0000 | MAX_CONFIDENCE);
        }
    }
}

/// The passes, with `B` in the merge of temporal reuse and in its shadow rays.
pub fn passes_with<B: Bug + 'static>() -> &'static [Pass] {
    let copied = PASSES.iter().map(|pass| Pass {
        name: pass.name,
        extent: pass.extent,
        features: pass.features,
        bindings: pass.bindings,
        variants: match pass.name {
            "temporal" => with_runs(pass, runs::<B, true>()),
            "temporal_rays" => with_runs(pass, runs::<B, false>()),
            _ => pass.variants,
        },
    });
    Vec::leak(copied.collect())
}

fn with_runs(pass: &Pass, runs: [Kernel; 8]) -> &'static [Variant] {
    let variants = pass.variants.iter().zip(runs);
    Vec::leak(variants.map(|(v, run)| Variant { entry_point: v.entry_point, run }).collect())
}

/// A kernel is a plain function, so there is one for each variant.
fn runs<B: Bug, const MERGE: bool>() -> [Kernel; 8] {
    [
        altered::<B, MERGE, 0>,
        altered::<B, MERGE, 1>,
        altered::<B, MERGE, 2>,
        altered::<B, MERGE, 3>,
        altered::<B, MERGE, 4>,
        altered::<B, MERGE, 5>,
        altered::<B, MERGE, 6>,
        altered::<B, MERGE, 7>,
    ]
}

/// Calls the kernel of variant `VARIANT` with altered copies of the reservoirs.
fn altered<B: Bug, const MERGE: bool, const VARIANT: usize>(frames: &FramePair, band: Band, mut buffers: Buffers) {
    let name = if MERGE { "temporal" } else { "temporal_rays" };
    let pass = PASSES.iter().find(|p| p.name == name).expect("the pass is in the table");
    let inputs: Vec<_> = pass.bindings.iter().filter(|b| b.access == Access::Read).collect();
    let mut reads: Vec<&[u8]> = inputs.iter().map(|_| buffers.read::<u8>()).collect();
    let mut writes: Vec<&mut [u8]> = (inputs.len()..pass.bindings.len()).map(|_| buffers.write::<u8>()).collect();
    let place = |name: &str| inputs.iter().position(|b| b.name == name).expect("the pass has this input");
    let (own_at, past_at) = (place("fresh"), place("prev_reservoirs"));
    let copied = |at: usize| bytemuck::cast_slice::<u8, Reservoir>(reads[at]).to_vec();
    let (mut frames, mut own, mut past) = (*frames, copied(own_at), copied(past_at));
    B::plant(&mut Seen { frames: &mut frames, own: &mut own, past: &mut past, is_merge: MERGE });
    reads[own_at] = bytemuck::cast_slice(&own);
    reads[past_at] = bytemuck::cast_slice(&past);
    (pass.variants[VARIANT].run)(&frames, band, Buffers::new(&reads, &mut writes));
}

/// Every bin of the table over emitters has the threshold of the next.
pub fn shift_alias_table(clip: &mut Clip) {
    for Snapshot { frames, lights, .. } in &mut clip.snapshots {
        let words = alias::ENTRY_WORDS as usize;
        let table = &mut lights[..frames.now.emitter_count as usize * words];
        let first = table[0];
        let next: Vec<u32> = table.iter().skip(words).step_by(words).copied().chain([first]).collect();
        table.iter_mut().step_by(words).zip(next).for_each(|(threshold, shifted)| *threshold = shifted);
    }
}

/// A pixel's own sample passes for that of the light with the same number in the frame before. (Kept both ways, numbers
/// would be a shift of samples like any other that has an inverse, and unbiased.)
pub fn keep_own_light_ids(clip: &mut Clip) {
    for Snapshot { frames: FramePair { now, prev }, records, .. } in &mut clip.snapshots {
        for slot in 0..now.instance_count {
            let at = now.instances_at + slot * instance_record::WORDS + instance_record::COUNTERPART;
            records[at as usize] = if slot < prev.instance_count { slot } else { NO_INSTANCE };
        }
    }
}
