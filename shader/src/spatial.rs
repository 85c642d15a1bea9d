//! Spatial reuse: pixels nearby lend their reservoirs. A round of it reads what the round before has written.

use glam::{UVec2, Vec3, Vec4};
use weir_shared::{
    fault,
    frame::{Frame, skip},
    light::{self, LightPoint},
    merge::{self, Inputs, form},
    numerics::load,
    reservoir::Reservoir,
    reuse::{Chosen, find_present, probe},
    rng::{Rng, Stage},
    scene::Scene,
    surface::Surface,
    target::{Domain, mean},
    trace::Tracer,
};

use crate::collect::{Collector, Offered};

/// A sample, evaluated.
#[derive(Clone, Copy)]
struct Sample {
    light: u32,
    uv: u32,
    point: LightPoint,
}

struct Present<'a, const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool> {
    px: UVec2,
    frame: &'a Frame,
    scene: Scene<'a>,
    surfaces: &'a [Surface],
    own: Reservoir,
    merging: &'a [Reservoir],
    reservoir: u32,
    chosen: Chosen,
}

impl<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>
    Present<'_, EMISSION_IMAGES, ENVIRONMENT, SPECULAR>
{
    #[inline(always)]
    fn stored(&self, input: u32) -> Reservoir {
        if input == 0 {
            return self.own;
        }
        load(self.merging, self.frame.index_of_reservoir(self.chosen.pixel(input), self.reservoir))
    }
}

impl<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool> Inputs<f32>
    for Present<'_, EMISSION_IMAGES, ENVIRONMENT, SPECULAR>
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
        let Self { chosen, frame, own, merging, reservoir, .. } = self;
        chosen.confidence(*reservoir, frame, own, merging, false, input) as f32
    }

    #[inline(always)]
    fn domain(&self, input: u32) -> Domain {
        let px = if input == 0 { self.px } else { self.chosen.pixel(input) };
        Domain::new(self.frame.camera_origin, &load(self.surfaces, self.frame.index_of(px)))
    }

    #[inline(always)]
    fn sample(&self, input: u32) -> (f32, Sample) {
        let stored = self.stored(input);
        let (mut ucw, mut point) = (0.0, LightPoint::NONE);
        if stored.has_sample() {
            ucw = stored.ucw;
            point = light::evaluate::<EMISSION_IMAGES, ENVIRONMENT>(self.frame, &self.scene, stored.light, stored.uv);
        }
        (ucw, Sample { light: stored.light, uv: stored.uv, point })
    }

    #[inline(always)]
    fn target_here(&self, here: &Domain, sample: &Sample) -> (f32, Vec3) {
        let light = here.reflected::<ENVIRONMENT, SPECULAR>(&sample.point);
        (mean(light), light)
    }

    #[inline(always)]
    fn target(&self, there: &Domain, sample: &Sample) -> f32 {
        there.target::<ENVIRONMENT, SPECULAR>(&sample.point)
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

impl Offered for Sample {
    #[inline(always)]
    fn id(&self) -> (u32, u32) {
        (self.light, self.uv)
    }
}

/// The pixel's reservoir, merged with those of neighbours; and the light of all its inputs, each with its weight.
pub fn spatial<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    own: &[Reservoir],
    merging: &[Reservoir],
) -> (Reservoir, Vec4) {
    merged::<EMISSION_IMAGES, ENVIRONMENT, SPECULAR, true>(px, reservoir, frame, scene, surfaces, own, merging)
}

/// [`spatial`] with any of [`weir_shared::merge::form`], for any scene: slower, for comparisons.
pub fn any_form(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    own: &[Reservoir],
    merging: &[Reservoir],
) -> (Reservoir, Vec4) {
    merged::<true, true, true, false>(px, reservoir, frame, scene, surfaces, own, merging)
}

#[inline(always)]
fn merged<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool, const PAIRWISE: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    surfaces: &[Surface],
    own: &[Reservoir],
    merging: &[Reservoir],
) -> (Reservoir, Vec4) {
    let surface = load(surfaces, frame.index_of(px));
    if surface.is_settled() {
        return (Reservoir::EMPTY, Vec4::ZERO);
    }
    let own = load(own, frame.index_of_reservoir(px, reservoir));
    let neighbors = find_present(px, reservoir, frame, &surface, surfaces, own.confidence());
    let chosen = Chosen::new(px, reservoir, frame, &own, neighbors, merging, false);
    let inputs: Present<'_, EMISSION_IMAGES, ENVIRONMENT, SPECULAR> =
        Present { px, frame, scene: *scene, surfaces, own, merging, reservoir, chosen };
    let rng = Rng::for_reservoir(px, reservoir, frame, Stage::SpatialChoice);
    let mut sink = Collector::new(rng, frame.choice);
    let ended = if PAIRWISE {
        merge::pairwise(&inputs, frame.mis_form == form::PAIRWISE_DEFENSIVE, &mut sink)
    } else {
        merge::merge(&inputs, frame.mis_form, &mut sink)
    };
    sink.finish(frame, &own, &ended, fault::stage::SPATIAL)
}

/// The pixel's reservoir with the marks of the shadow rays that spatial reuse asks for; as [`crate::temporal::rays`],
/// within one frame.
pub fn rays<const MASKS: bool, const ENVIRONMENT: bool, const INSTANCES: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    tracer: impl Tracer,
    surfaces: &[Surface],
    merging: &[Reservoir],
) -> Reservoir {
    let surface = load(surfaces, frame.index_of(px));
    let mut own = load(merging, frame.index_of_reservoir(px, reservoir));
    if surface.is_settled() {
        return own;
    }
    let neighbors = find_present(px, reservoir, frame, &surface, surfaces, own.confidence());
    let chosen = Chosen::new(px, reservoir, frame, &own, neighbors, merging, false);
    // Ray 0: from the partner to the own sample. Others: from here to the sample of an input.
    let rays = if frame.probe == probe::ALL { chosen.count() } else { 1 };
    let mut i = 0;
    while i < rays {
        let input = if i == 0 { chosen.partner } else { i };
        let (mut sample, mut start) = (own, surface);
        if input > 0 {
            if i == 0 {
                start = load(surfaces, frame.index_of(chosen.pixel(input)));
            } else {
                sample = load(merging, frame.index_of_reservoir(chosen.pixel(input), reservoir));
            }
        }
        if input > 0 && sample.has_sample() {
            let point = light::evaluate::<false, ENVIRONMENT>(frame, scene, sample.light, sample.uv);
            let ray = light::shadow_ray::<ENVIRONMENT>(&start, &point);
            let matters = !frame.skips(skip::UNLIT) || light::may_matter::<ENVIRONMENT>(&start, &point);
            if matters && !tracer.unoccluded::<MASKS, INSTANCES>(frame, scene, &ray) {
                own = own.with_hidden(i);
            }
        }
        i += 1;
    }
    own
}
