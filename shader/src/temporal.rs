//! Temporal reuse: the frame before lends its reservoirs.
//!
//! Its targets are evaluated with its own surfaces, camera, lights and acceleration structure, so that the weights are
//! exact whatever moves. Samples are translated between the light ids of the two frames.

use glam::{UVec2, Vec3, Vec4};
use weir_shared::{
    fault,
    frame::{Frame, FramePair, skip},
    light::{self, LightPoint, NO_LIGHT},
    merge::{self, Inputs, form},
    numerics::load,
    reservoir::Reservoir,
    reuse::{Chosen, find_past, probe},
    rng::{Rng, Stage},
    scene::Scene,
    surface::Surface,
    target::{Domain, mean},
    trace::Tracer,
};

use crate::collect::Collector;

/// A sample in both frames.
#[derive(Clone, Copy)]
struct Sample {
    light: u32,
    uv: u32,
    now: LightPoint,
    /// As the frame before had it; no light if it did not.
    before: LightPoint,
}

struct Past<'a, const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool> {
    frame: &'a Frame,
    prev_frame: &'a Frame,
    scene: Scene<'a>,
    surface: Surface,
    prev_surfaces: &'a [Surface],
    own: Reservoir,
    prev_reservoirs: &'a [Reservoir],
    reservoir: u32,
    chosen: Chosen,
}

impl<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>
    Past<'_, EMISSION_IMAGES, ENVIRONMENT, SPECULAR>
{
    #[inline(always)]
    fn stored(&self, input: u32) -> Reservoir {
        if input == 0 {
            return self.own;
        }
        load(self.prev_reservoirs, self.frame.index_of_reservoir(self.chosen.pixel(input), self.reservoir))
    }
}

impl<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool> Inputs<f32>
    for Past<'_, EMISSION_IMAGES, ENVIRONMENT, SPECULAR>
{
    type Sample = Sample;
    type Domain = Domain;
    type Light = Vec3;

    #[inline(always)]
    fn count(&self) -> u32 {
        self.chosen.count()
    }

    #[inline(always)]
    fn confidence(&self, input: u32) -> f32 {
        let Self { chosen, frame, own, prev_reservoirs, reservoir, .. } = self;
        chosen.confidence(*reservoir, frame, own, prev_reservoirs, true, input) as f32
    }

    #[inline(always)]
    fn domain(&self, input: u32) -> Domain {
        if input == 0 {
            return Domain::new(self.frame.camera_origin, &self.surface);
        }
        let surface = load(self.prev_surfaces, self.frame.index_of(self.chosen.pixel(input)));
        Domain::new(self.prev_frame.camera_origin, &surface)
    }

    #[inline(always)]
    fn sample(&self, input: u32) -> (f32, Sample) {
        let (frame, prev_frame) = (self.frame, self.prev_frame);
        let stored = self.stored(input);
        let mut sample = Sample { light: stored.light, uv: stored.uv, now: LightPoint::NONE, before: LightPoint::NONE };
        if !stored.has_sample() {
            return (0.0, sample);
        }
        // Own samples are translated to the frame before, the others from it.
        let is_own = input == 0;
        let from = FramePair::moment(frame, prev_frame, !is_own);
        let to = FramePair::moment(frame, prev_frame, is_own);
        let translated = light::translate(&from, &to, &self.scene, stored.light);
        let before = if is_own { translated } else { stored.light };
        if !is_own {
            sample.light = translated;
        }
        if sample.light == NO_LIGHT {
            return (0.0, sample);
        }
        let changed = frame.instances_at != prev_frame.instances_at || ENVIRONMENT;
        // One body for both frames, because on a GPU everything is inlined.
        let mut past = 0;
        while past < 2 {
            let moment = FramePair::moment(frame, prev_frame, past == 1);
            let light = if past == 1 { before } else { sample.light };
            let mut point = sample.now;
            if light == NO_LIGHT {
                point = LightPoint::NONE;
            } else if past == 0 || changed {
                point = light::evaluate::<EMISSION_IMAGES, ENVIRONMENT>(&moment, &self.scene, light, stored.uv);
            }
            if past == 0 {
                sample.now = point;
            } else {
                sample.before = point;
            }
            past += 1;
        }
        (stored.ucw, sample)
    }

    #[inline(always)]
    fn target_here(&self, here: &Domain, sample: &Sample) -> (f32, Vec3) {
        let light = here.reflected::<ENVIRONMENT, SPECULAR>(&sample.now);
        (mean(light), light)
    }

    #[inline(always)]
    fn target(&self, there: &Domain, sample: &Sample) -> f32 {
        there.target::<ENVIRONMENT, SPECULAR>(&sample.before)
    }

    #[inline(always)]
    fn is_hidden_here(&self, input: u32) -> bool {
        self.own.is_hidden(input)
    }

    #[inline(always)]
    fn is_hidden_there(&self, _input: u32) -> bool {
        // Only the partner is asked.
        self.own.is_hidden(0)
    }

    #[inline(always)]
    fn partner(&self) -> u32 {
        self.chosen.partner
    }
}

/// The pixel's reservoir, merged with those of the frame before; and the light of all its inputs, each with its weight.
pub fn temporal<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    prev_frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    prev_surfaces: &[Surface],
    fresh: &[Reservoir],
    prev_reservoirs: &[Reservoir],
) -> (Reservoir, Vec4) {
    merged::<EMISSION_IMAGES, ENVIRONMENT, SPECULAR, true>(
        px,
        reservoir,
        frame,
        prev_frame,
        scene,
        surfaces,
        prev_surfaces,
        fresh,
        prev_reservoirs,
    )
}

/// [`temporal`] with any of [`weir_shared::merge::form`], for any scene: slower, for comparisons.
pub fn any_form(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    prev_frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    prev_surfaces: &[Surface],
    fresh: &[Reservoir],
    prev_reservoirs: &[Reservoir],
) -> (Reservoir, Vec4) {
    merged::<true, true, true, false>(
        px,
        reservoir,
        frame,
        prev_frame,
        scene,
        surfaces,
        prev_surfaces,
        fresh,
        prev_reservoirs,
    )
}

#[inline(always)]
fn merged<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool, const PAIRWISE: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    prev_frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    prev_surfaces: &[Surface],
    fresh: &[Reservoir],
    prev_reservoirs: &[Reservoir],
) -> (Reservoir, Vec4) {
    let surface = load(surfaces, frame.index_of(px));
    if surface.is_settled() {
        return (Reservoir::EMPTY, Vec4::ZERO);
    }
    let own = load(fresh, frame.index_of_reservoir(px, reservoir));
    let neighbors = find_past(px, reservoir, frame, prev_frame, scene, &surface, prev_surfaces);
    let chosen = Chosen::new(px, reservoir, frame, &own, neighbors, prev_reservoirs, true);
    let inputs: Past<'_, EMISSION_IMAGES, ENVIRONMENT, SPECULAR> =
        Past { frame, prev_frame, scene: *scene, surface, prev_surfaces, own, prev_reservoirs, reservoir, chosen };
    let rng = Rng::for_reservoir(px, reservoir, frame, Stage::TemporalChoice);
    let mut sink = Collector::new(rng, frame.choice);
    let ended = if PAIRWISE {
        merge::pairwise(&inputs, frame.mis_form == form::PAIRWISE_DEFENSIVE, &mut sink)
    } else {
        merge::merge(&inputs, frame.mis_form, &mut sink)
    };
    sink.finish(frame, &own, &ended, fault::stage::TEMPORAL)
}

impl crate::collect::Offered for Sample {
    #[inline(always)]
    fn id(&self) -> (u32, u32) {
        (self.light, self.uv)
    }
}

/// The pixel's reservoir with the marks of the shadow rays that temporal reuse asks for: from the partner in the frame
/// before, through that frame's acceleration structure, to the pixel's own sample; and, for [`probe::ALL`], from the
/// pixel to every other sample.
pub fn rays<const MASKS: bool, const ENVIRONMENT: bool, const INSTANCES: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    prev_frame: &Frame,
    scene: &Scene,
    tracer: impl Tracer,
    surfaces: &[Surface],
    prev_surfaces: &[Surface],
    fresh: &[Reservoir],
    prev_reservoirs: &[Reservoir],
) -> Reservoir {
    let surface = load(surfaces, frame.index_of(px));
    let mut own = load(fresh, frame.index_of_reservoir(px, reservoir));
    if surface.is_settled() {
        return own;
    }
    let neighbors = find_past(px, reservoir, frame, prev_frame, scene, &surface, prev_surfaces);
    let chosen = Chosen::new(px, reservoir, frame, &own, neighbors, prev_reservoirs, true);
    // Ray 0: from the partner to the own sample, in the frame before. Others: from here to the sample of an input. One
    // body for both, because on a GPU everything is inlined.
    let rays = if frame.probe == probe::ALL { chosen.count() } else { 1 };
    let mut i = 0;
    while i < rays {
        let past = i == 0;
        let input = if past { chosen.partner } else { i };
        let mut sample = own;
        if !past {
            sample = load(prev_reservoirs, frame.index_of_reservoir(chosen.pixel(i), reservoir));
        }
        if input > 0 && sample.has_sample() {
            let from = FramePair::moment(frame, prev_frame, !past);
            let moment = FramePair::moment(frame, prev_frame, past);
            let light = light::translate(&from, &moment, scene, sample.light);
            // What is not there has no target there, seen or not.
            if light != NO_LIGHT {
                let mut start = surface;
                if past {
                    start = load(prev_surfaces, frame.index_of(chosen.pixel(input)));
                }
                let point = light::evaluate::<false, ENVIRONMENT>(&moment, scene, light, sample.uv);
                let ray = light::shadow_ray::<ENVIRONMENT>(&start, &point);
                let matters = !frame.skips(skip::UNLIT) || light::may_matter::<ENVIRONMENT>(&start, &point);
                if matters && !tracer.unoccluded::<MASKS, INSTANCES>(&moment, scene, &ray) {
                    own = own.with_hidden(i);
                }
            }
        }
        i += 1;
    }
    own
}
