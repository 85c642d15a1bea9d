//! Bugs on purpose: kernels of reuse that see altered inputs, and scenes that say something false.

use glam::Vec4;
use weir::technique;
use weir_shader::{
    PASSES, kernel,
    wiring::{Access, Band, Buffers, Kernel, Pass},
};
use weir_shared::{
    alias,
    block::Block,
    closed_form::{NO_TREES, node},
    frame::FramePair,
    reservoir::{MAX_CONFIDENCE, Reservoir},
    scene::{NO_INSTANCE, instance_record},
    surface::Surface,
};

use crate::chains::{Clip, Snapshot};

/// What reuse is about to read.
pub struct Seen<'a> {
    pub frames: &'a mut FramePair,
    /// The pixel's own reservoirs; none where they are read from those of the others.
    own: &'a mut [Reservoir],
    /// Those of the frame before or, within a frame, of the neighbours.
    pub others: &'a mut [Reservoir],
    place: &'static Place,
}

/// A pass of reuse, and the names of its inputs.
struct Place {
    pass: &'static str,
    own: Option<&'static str>,
    others: &'static str,
    /// The merge itself, not the shadow rays before it.
    is_merge: bool,
    /// Within a frame, where others are always there.
    is_spatial: bool,
}

const PLACES: [Place; 4] = [
    Place { pass: "temporal", own: Some("fresh"), others: "prev_reservoirs", is_merge: true, is_spatial: false },
    Place { pass: "temporal_rays", own: Some("fresh"), others: "prev_reservoirs", is_merge: false, is_spatial: false },
    Place { pass: "spatial", own: Some("marked"), others: "merging", is_merge: true, is_spatial: true },
    Place { pass: "spatial_rays", own: None, others: "merging", is_merge: false, is_spatial: true },
];

/// A bug in reuse.
pub trait Bug {
    fn plant(seen: &mut Seen<'_>);
}

/// Nothing: what goes through the same detour and is right.
pub struct NoBug;

impl Bug for NoBug {
    fn plant(_: &mut Seen<'_>) {}
}

/// The pixel's own sample is lost where there are others, but not its confidence.
pub struct NoCanonicalTerm;

impl Bug for NoCanonicalTerm {
    fn plant(seen: &mut Seen<'_>) {
        if seen.place.is_spatial || seen.frames.now.has_history == 1 {
            seen.own.iter_mut().for_each(|r| r.ucw = 0.0);
        }
    }
}

/// Reservoirs that have found nothing count for nothing.
pub struct NullWithoutConfidence;

impl Bug for NullWithoutConfidence {
    fn plant(seen: &mut Seen<'_>) {
        seen.others.iter_mut().filter(|r| !r.has_sample()).for_each(|r| *r = Reservoir::EMPTY);
    }
}

/// Reservoirs with a large weight are not reused, as a filter of bright pixels would have it.
pub struct RejectedByContent;

impl Bug for RejectedByContent {
    fn plant(seen: &mut Seen<'_>) {
        let mut weights: Vec<f32> = seen.others.iter().map(|r| r.ucw).filter(|&w| w > 0.0).collect();
        if weights.is_empty() {
            return;
        }
        let at = weights.len() * 4 / 5;
        let limit = *weights.select_nth_unstable_by(at, f32::total_cmp).1;
        seen.others.iter_mut().filter(|r| r.ucw > limit).for_each(|r| *r = Reservoir::EMPTY);
    }
}

/// The past is judged by the lights of the present.
pub struct PastUnderPresentLights;

impl Bug for PastUnderPresentLights {
    fn plant(seen: &mut Seen<'_>) {
        let now = seen.frames.now;
        let prev = &mut seen.frames.prev;
        prev.instances_at = now.instances_at;
        prev.instance_count = now.instance_count;
        prev.emitters_at = now.emitters_at;
        prev.emitter_count = now.emitter_count;
        prev.light_count = now.light_count;
        prev.light_guide_at = now.light_guide_at;
        prev.light_guide_shift = now.light_guide_shift;
    }
}

/// Shadow rays take weights away, but the MIS weights do not know of them.
pub struct VisibilityUnknownToMis;

impl Bug for VisibilityUnknownToMis {
    fn plant(seen: &mut Seen<'_>) {
        if seen.place.is_merge {
            seen.own.iter_mut().for_each(|r| r.state &= 0xf800_0000 | MAX_CONFIDENCE);
        }
    }
}

/// The passes, with `B` in the merges of reuse and in their shadow rays.
pub fn passes_with<B: Bug + 'static>() -> &'static [Pass] {
    technique::passes_with(|pass| {
        let runs = match PLACES.iter().position(|place| place.pass == pass.name)? {
            0 => runs::<B, 0>(),
            1 => runs::<B, 1>(),
            2 => runs::<B, 2>(),
            _ => runs::<B, 3>(),
        };
        Some(runs.to_vec())
    })
}

/// A kernel is a plain function, so there is one for each variant.
fn runs<B: Bug, const PLACE: usize>() -> [Kernel; 8] {
    [
        altered::<B, PLACE, 0>,
        altered::<B, PLACE, 1>,
        altered::<B, PLACE, 2>,
        altered::<B, PLACE, 3>,
        altered::<B, PLACE, 4>,
        altered::<B, PLACE, 5>,
        altered::<B, PLACE, 6>,
        altered::<B, PLACE, 7>,
    ]
}

/// Calls the kernel of variant `VARIANT` with altered copies of the reservoirs.
fn altered<B: Bug, const PLACE: usize, const VARIANT: usize>(frames: &FramePair, band: Band, mut buffers: Buffers) {
    let place = &PLACES[PLACE];
    let pass = PASSES.iter().find(|p| p.name == place.pass).expect("the pass is in the table");
    let inputs: Vec<_> = pass.bindings.iter().filter(|b| b.access == Access::Read).collect();
    let mut reads: Vec<&[u8]> = inputs.iter().map(|_| buffers.read::<u8>()).collect();
    let mut writes: Vec<&mut [u8]> = (inputs.len()..pass.bindings.len()).map(|_| buffers.write::<u8>()).collect();
    let find = |name: &str| inputs.iter().position(|b| b.name == name).expect("the pass has this input");
    let (own_at, others_at) = (place.own.map(find), find(place.others));
    let copied = |at: usize| bytemuck::cast_slice::<u8, Reservoir>(reads[at]).to_vec();
    let (mut frames, mut own, mut others) = (*frames, own_at.map_or_else(Vec::new, copied), copied(others_at));
    B::plant(&mut Seen { frames: &mut frames, own: &mut own, others: &mut others, place });
    if let Some(at) = own_at {
        reads[at] = bytemuck::cast_slice(&own);
    }
    reads[others_at] = bytemuck::cast_slice(&others);
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

/// The leaves of the trees that tell where light has a closed form; they are the last words of `records`.
fn closed_form_leaves(
    Snapshot { frames: FramePair { now, .. }, records, .. }: &mut Snapshot,
) -> impl Iterator<Item = &mut u32> {
    let start_of = |slot| now.instances_at + slot * instance_record::WORDS + instance_record::CLOSED_FORM_AT;
    let starts = (0..now.instance_count).map(|slot| records[start_of(slot) as usize]).filter(|&at| at != NO_TREES);
    let first = starts.min().expect("trees") as usize;
    records[first..].iter_mut().filter(|word| **word & node::LEAF != 0)
}

/// Penumbras, and what is hidden there, pass for lit by all lights.
pub fn take_penumbras_for_lit(clip: &mut Clip) {
    for snapshot in &mut clip.snapshots {
        let lights = (1 << snapshot.frames.now.light_count) - 1;
        closed_form_leaves(snapshot).filter(|leaf| **leaf & node::KNOWN == 0).for_each(|leaf| {
            *leaf |= node::KNOWN | lights;
        });
    }
}

/// Where all lights are seen whole, one of them is forgotten.
pub fn forget_a_light(clip: &mut Clip) {
    for snapshot in &mut clip.snapshots {
        closed_form_leaves(snapshot).filter(|leaf| **leaf & node::KNOWN != 0).for_each(|leaf| *leaf &= !1);
    }
}

/// Pixels whose light is known are sampled as well.
pub fn sampling_what_is_settled() -> &'static [Pass] {
    fn primary(frames: &FramePair, band: Band, mut buffers: Buffers) {
        let pass = PASSES.iter().find(|p| p.name == "primary").expect("the pass is in the table");
        let inputs = pass.bindings.iter().filter(|b| b.access == Access::Read);
        let reads: Vec<&[u8]> = inputs.map(|_| buffers.read::<u8>()).collect();
        let [surfaces, emitted] = [buffers.write::<u8>(), buffers.write::<u8>()];
        // All code that there is.
        let last = pass.variants.last().expect("it has variants");
        (last.run)(frames, band, Buffers::new(&reads, &mut [&mut *surfaces, &mut *emitted]));
        let surfaces = bytemuck::cast_slice_mut::<u8, Surface>(surfaces).iter_mut();
        for (surface, emitted) in surfaces.zip(bytemuck::cast_slice_mut::<u8, Vec4>(emitted)) {
            if surface.is_settled() && !surface.is_sky() {
                surface.instance ^= Surface::default().settled().instance;
                emitted.w = 1.0;
            }
        }
    }
    technique::passes_with_one("primary", primary)
}

/// Where a part of a pixel shows surfaces with light to sample, that light counts as if all of it did.
pub fn covering_whole_pixels() -> &'static [Pass] {
    fn shade_sum(frames: &FramePair, band: Band, mut buffers: Buffers) {
        let [emitted, gathered]: [&[Vec4]; 2] = [buffers.read(), buffers.read()];
        let emitted: Vec<Vec4> =
            emitted.iter().map(|e| e.truncate().extend(if e.w == 0.0 { 0.0 } else { 1.0 })).collect();
        let reads = [bytemuck::cast_slice(&emitted), bytemuck::cast_slice(gathered)];
        kernel::shade_sum::main(frames, band, Buffers::new(&reads, &mut [buffers.write::<u8>()]));
    }
    technique::passes_with_one("shade_sum", shade_sum)
}

/// What one pixel of a block doesn't see takes no place in the cut of any.
pub fn bounding_one_pixel_for_its_block() -> &'static [Pass] {
    fn blocks(frames: &FramePair, band: Band, mut buffers: Buffers) {
        let surfaces = buffers.read::<u8>();
        let blocks = buffers.write::<u8>();
        kernel::light_cuts_blocks::main(frames, band, Buffers::new(&[surfaces], &mut [&mut *blocks]));
        for block in bytemuck::cast_slice_mut::<u8, Block>(blocks) {
            (block.low, block.high) = (block.position, block.position);
            (block.normal_low, block.normal_high) = (block.normal, block.normal);
        }
    }
    technique::passes_with_one("light_cuts_blocks", blocks)
}
