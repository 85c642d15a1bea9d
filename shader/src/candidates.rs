//! Initial candidates: one light sample for each reservoir, by streaming resampled importance sampling.

use glam::UVec2;
use weir_shared::{
    environment, fault,
    frame::{Frame, skip},
    light::{self, Address, ENVIRONMENT_BIT, NO_LIGHT, source},
    light_cuts::{self, Cluster, cut_of},
    light_tree::Walk,
    numerics::{is_finite, load},
    presample::{LightRecord, NO_ROW, cell_of, column_of, tile_of},
    resample::{Candidate, Chooser, Stream, candidate_scale, survivor_scale},
    reservoir::Reservoir,
    reuse::is_on_lattice,
    rng::{Rng, Stage},
    scene::Scene,
    surface::Surface,
    target::{Domain, occlusion, screen_occlusion},
};

#[cfg(not(target_arch = "spirv"))]
use weir_shared::light_tree::Party;

/// A sample on its way through a stream: light and place on it.
type Sample = (u32, u32);

/// How many candidates each technique offers. They share one balance denominator.
#[derive(Clone, Copy)]
struct Shares {
    /// By the scene's tables, at once or through lights drawn ahead.
    table: u32,
    tree: u32,
    environment: u32,
    bsdf: u32,
    /// Every emissive triangle and shape once instead of drawing from the table.
    enumerate: bool,
    /// The row of lights drawn ahead, or of a cut, that the table's candidates come from, or [`NO_ROW`].
    row: u32,
    /// Whether that row is a cut.
    has_cut: bool,
    /// Records of that row, or clusters of that cut.
    columns: u32,
}

impl Shares {
    /// At least one for the table, or for the tree if that is the source, and for the environment where there is any, or
    /// that light would be missing; with both, a quarter of the candidates for the environment. Of the rest the light tree
    /// has as many as it may.
    fn new<const ENVIRONMENT: bool>(frame: &Frame, px: UVec2, domain: &Domain, presampled: &[LightRecord]) -> Self {
        let all = if is_on_lattice(frame, px) { frame.candidates } else { frame.candidates_off_lattice };
        let environment = if !ENVIRONMENT || environment::count(frame) == 0 {
            0
        } else if frame.light_count == 0 {
            all
        } else {
            (all / 4).max(1)
        };
        let triangles = if frame.light_count == 0 { 0 } else { (all - environment.min(all)).max(1) };
        let are_few = frame.light_count <= triangles && frame.skips(skip::FEW_LIGHTS);
        let enumerate = frame.light_count == 0 || are_few;
        let tree = if enumerate {
            0
        } else if frame.source == source::TREE {
            triangles
        } else {
            frame.candidates_tree.min(triangles - 1)
        };
        let table = if enumerate { frame.light_count } else { triangles - tree };
        let row = if enumerate {
            NO_ROW
        } else if frame.source == source::TILES {
            tile_of(frame, px)
        } else if frame.source == source::CELLS {
            cell_of(frame, domain.position)
        } else if frame.source == source::CUTS {
            cut_of(frame, px)
        } else {
            NO_ROW
        };
        let has_cut = row != NO_ROW && frame.source == source::CUTS;
        let columns = if has_cut { light_cuts::size_of_cut(frame, presampled, row) } else { frame.presampled_columns };
        Self { table, tree, environment, bsdf: frame.candidates_bsdf, enumerate, row, has_cut, columns }
    }

    /// The points on lights, a word each, where candidate `number` takes its own.
    #[inline(always)]
    fn points_from(&self, points: Rng, number: u32) -> Rng {
        // Lights drawn ahead have theirs.
        let before = if self.row != NO_ROW && !self.has_cut { self.table } else { 0 };
        let words = number - number.min(before);
        let mut points = points.skip(words >> 2);
        let mut i = 0;
        while i < (words & 3) {
            points.next_word();
            i += 1;
        }
        points
    }
}

/// Candidate `number` of a group of `count` from the lights drawn ahead.
#[inline(always)]
fn drawn_ahead(
    frame: &Frame,
    presampled: &[LightRecord],
    shares: &Shares,
    start: u32,
    number: u32,
    count: u32,
) -> LightRecord {
    load(presampled, frame.index_of_record(UVec2::new(column_of(shares.columns, start, number, count), shares.row)))
}

/// Random numbers that a walk down the light tree may take, as a power of two of fours.
const WALK_BITS: u32 = 4;

/// The walks down the light tree that a pixel is going to ask for, as far as they are known before its candidates are:
/// those of the tree's candidates, and those to what the table and the BSDF's ray find.
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
fn ahead(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    domain: &Domain,
    shares: &Shares,
    grouped: bool,
    picks: Rng,
    walk_rng: Rng,
    bsdf_hits: &[Reservoir],
    presampled: &[LightRecord],
) -> Party {
    let mut party = Party::new();
    if shares.tree == 0 {
        return party;
    }
    let (position, normal) = (domain.position, domain.bsdf.normal);
    let walk = |has_goal, goal, rng| Walk::new(frame, lights, position, normal, has_goal, goal, rng);
    for number in 0..shares.tree {
        party.add(walk(false, Address { emitter: 0, local: 0 }, walk_rng.skip(number << WALK_BITS)));
    }
    if !grouped {
        // As the loop over candidates draws them.
        let start = picks.skip(0).next_four()[0];
        for number in 0..shares.table.min(Party::MOST as u32) {
            if shares.row != NO_ROW {
                let record = drawn_ahead(frame, presampled, shares, start, number, shares.table);
                if record.has_light() {
                    party.add(walk(true, record.address(), walk_rng));
                }
                continue;
            }
            let picked = light::pick(frame, scene, lights, picks.skip(number).next_four());
            party.add(walk(true, picked.address, walk_rng));
        }
    }
    if shares.bsdf > 0 {
        let hit = load(bsdf_hits, frame.index_of_reservoir(px, reservoir));
        if hit.has_sample() && (hit.light & ENVIRONMENT_BIT) == 0 {
            party.add(walk(true, light::address_of(frame, scene, hit.light), walk_rng));
        }
    }
    party.finish(frame, scene, lights);
    party
}

/// More candidates than there are.
const EVERY: u32 = 0x7fff_ffff;

/// What candidates are offered to.
trait Offered {
    /// A sample with its target p̂ and its resampling weight.
    fn offer(&mut self, sample: Sample, target: f32, weight: f32);
}

impl Offered for Stream<f32, Sample, Chooser> {
    #[inline(always)]
    fn offer(&mut self, sample: Sample, target: f32, weight: f32) {
        Stream::offer(self, sample, target, weight);
    }
}

impl Offered for Candidate {
    #[inline(always)]
    fn offer(&mut self, (light, uv): Sample, target: f32, weight: f32) {
        *self = Self { light, uv, target, weight, fault: self.fault };
    }
}

/// Offers the candidates of a reservoir from number `from` on, `most` of them at most, for the surface of the pixel; returns
/// the worst fault of drawing them. See [`candidates`]. Candidates compete in groups only if all of them are offered.
#[inline(always)]
fn offer_candidates<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool, O: Offered>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    surfaces: &[Surface],
    bsdf_hits: &[Reservoir],
    presampled: &[LightRecord],
    surface: &Surface,
    from: u32,
    most: u32,
    offered: &mut O,
) -> u32 {
    let domain = &Domain::new(frame.camera_origin, surface);
    let shares = &Shares::new::<ENVIRONMENT>(frame, px, domain, presampled);
    let is_whole = most == EVERY;
    let grouped = is_whole && frame.candidates_full > 0 && frame.candidates_full < shares.table && !shares.enumerate;
    let groups = if grouped { frame.candidates_full } else { 1 };
    // Candidates one after the other: the table's, group by group and after each group its survivor; the tree's; the
    // environment's; the BSDF's. One loop body, because on a GPU everything is inlined.
    let of_table = shares.table + if grouped { groups } else { 0 };
    let of_triangles = of_table + shares.tree;
    let of_table_and_sky = of_triangles + shares.environment;
    let total = (of_table_and_sky + shares.bsdf).min(from + most);
    let (position, normal) = (domain.position, domain.bsdf.normal);
    let mut points = shares.points_from(Rng::for_reservoir(px, reservoir, frame, Stage::Candidates), from);
    let picks = Rng::for_reservoir(px, reservoir, frame, Stage::CandidatePicks);
    let group_rng = Rng::for_reservoir(px, reservoir, frame, Stage::GroupChoice);
    let mut cheap: Stream<f32, (u32, u32, f32), Chooser> =
        Stream::new((0, 0, 0.0), Chooser::new(group_rng, frame.choice));
    let walk_rng = Rng::for_reservoir(px, reservoir, frame, Stage::LightTree);
    let cut_rng = Rng::for_reservoir(px, reservoir, frame, Stage::LightCuts);
    #[cfg(not(target_arch = "spirv"))]
    let mut party = if is_whole {
        ahead(px, reservoir, frame, scene, lights, domain, shares, grouped, picks, walk_rng, bsdf_hits, presampled)
    } else {
        Party::new()
    };
    let (mut group, mut first, mut drawn) = (0, 0, from.min(shares.table));
    // Where a group starts among the lights drawn ahead, as random bits.
    let mut start = 0;
    let mut group_fault = fault::NONE;
    let mut i = from;
    while i < total {
        // Groups as equal as whole numbers allow; each stands for its share of the table's candidates.
        let group_end = shares.table * (group + 1) / groups;
        let is_survivor = grouped && i < of_table && drawn == group_end;
        let is_drawn = i < of_table && !is_survivor;
        let is_walked = i >= of_table && i < of_triangles;
        let is_sky = ENVIRONMENT && i >= of_triangles && i < of_table_and_sky;
        let mut id = NO_LIGHT;
        let (mut uv, mut pmf, mut survivor_ucw) = (0, 0.0, 0.0);
        let mut address = Address { emitter: 0, local: 0 };
        let mut address_known = false;
        let mut record = LightRecord::EMPTY;
        let mut cluster = Cluster::NONE;
        if is_drawn && shares.row != NO_ROW {
            if drawn == first || i == from {
                start = picks.skip(first + group).next_four()[0];
            }
            record = drawn_ahead(frame, presampled, shares, start, drawn - first, group_end - first);
            group_fault = group_fault.max(record.fault());
            if shares.has_cut {
                uv = points.next_word();
                cluster = Cluster::of(&record);
            } else if record.has_light() {
                (id, uv, pmf) = (record.light, record.uv, record.pmf);
                address = record.address();
                address_known = true;
            }
            drawn += 1;
        } else if is_drawn {
            uv = points.next_word();
            if shares.enumerate {
                (id, pmf) = (drawn, 1.0 / shares.table as f32);
            } else {
                let picked = light::pick(frame, scene, lights, picks.skip(i).next_four());
                (address, pmf) = (picked.address, picked.pmf);
                id = light::light_at(frame, scene, address);
                address_known = true;
            }
            drawn += 1;
        } else if is_survivor {
            survivor_ucw = cheap.contribution_weight();
            if survivor_ucw > 0.0 {
                (id, uv, pmf) = cheap.kept();
            }
        } else if is_walked {
            uv = points.next_word();
        } else if is_sky {
            let bits = picks.skip(i).next_four();
            let texel = environment::pick(frame, lights, bits[0], bits[1]);
            (id, uv, pmf) = (texel.index | ENVIRONMENT_BIT, bits[2], texel.pmf);
        } else {
            let hit = load(bsdf_hits, frame.index_of_reservoir(px, reservoir));
            if hit.has_sample() {
                (id, uv) = (hit.light, hit.uv);
                if ENVIRONMENT && (id & ENVIRONMENT_BIT) != 0 {
                    pmf = environment::pmf(frame, lights, id & !ENVIRONMENT_BIT);
                } else if shares.enumerate {
                    pmf = 1.0 / shares.table as f32;
                }
            }
        }
        let is_distant = ENVIRONMENT && id != NO_LIGHT && (id & ENVIRONMENT_BIT) != 0;
        if id != NO_LIGHT && !is_distant && !address_known {
            address = light::address_of(frame, scene, id);
        }
        // Among the candidates of a group only the table's probability counts; the tree's is asked of the survivor.
        let meets_cheap_target = grouped && is_drawn;
        let mut walked_density = 0.0;
        // The tree is asked and the cut is: of a candidate of the cut first the cut, which finds its light.
        let mut step = 0;
        while step < 2 {
            if (step == 0) == (is_drawn && shares.has_cut) {
                if shares.has_cut && !is_distant && !is_survivor && (is_drawn || id != NO_LIGHT) {
                    if !is_drawn {
                        cluster = light_cuts::cluster_of(
                            frame,
                            scene,
                            lights,
                            presampled,
                            shares.row,
                            shares.columns,
                            address,
                        );
                    }
                    let rng = cut_rng.skip(i << WALK_BITS);
                    let reached =
                        light_cuts::walk(frame, scene, lights, cluster, position, normal, !is_drawn, address, rng);
                    pmf = reached.pmf * (1.0 / shares.columns as f32);
                    if is_drawn && reached.pmf > 0.0 {
                        address = reached.address;
                        id = light::light_at(frame, scene, address);
                    }
                }
            } else if shares.tree > 0 && !is_distant && !meets_cheap_target && (is_walked || id != NO_LIGHT) {
                let number = i.wrapping_sub(of_table);
                let rng = walk_rng.skip(number << WALK_BITS);
                let walk = Walk::new(frame, lights, position, normal, !is_walked, address, rng);
                #[cfg(target_arch = "spirv")]
                let reached = walk.finish(frame, scene, lights);
                #[cfg(not(target_arch = "spirv"))]
                let reached = (if is_walked { party.led(number) } else { party.to(address) })
                    .unwrap_or_else(|| walk.finish(frame, scene, lights));
                if is_walked && reached.pmf > 0.0 {
                    address = reached.address;
                    id = light::light_at(frame, scene, address);
                }
                walked_density = reached.pmf * shares.tree as f32;
            }
            step += 1;
        }
        if id != NO_LIGHT {
            let point = if is_distant {
                light::evaluate_environment(frame, scene, id, uv)
            } else if record.has_light() && !(ENVIRONMENT && record.is_punctual()) {
                record.point()
            } else {
                let place = light::place_of(frame, scene, address);
                light::evaluate_at::<EMISSION_IMAGES, ENVIRONMENT>(frame, scene, place, uv)
            };
            // Of a light drawn ahead: its contribution weight, in place of one over its probability.
            let record_scale = if record.has_light() { record.scale } else { 1.0 };
            if meets_cheap_target {
                let target = domain.cheap_target::<ENVIRONMENT>(&point);
                let density = pmf * (group_end - first) as f32;
                cheap.offer((id, uv, pmf), target, target * (candidate_scale(density) * record_scale));
            } else {
                let is_pmf_known = is_drawn || is_survivor || is_distant || shares.enumerate || shares.has_cut;
                if !is_pmf_known {
                    pmf = light::pmf(frame, scene, lights, address);
                }
                let drawn_density = pmf * (if is_distant { shares.environment } else { shares.table }) as f32;
                let (mut target, density) = if shares.bsdf == 0 {
                    (domain.target::<ENVIRONMENT, SPECULAR>(&point), drawn_density + walked_density)
                } else {
                    let (target, bsdf) = domain.target_and_density::<ENVIRONMENT, SPECULAR>(&point);
                    // What a direction finds with infinite density it finds alone; an overflow must not make that a zero
                    // weight.
                    let bsdf = if is_finite(bsdf) { bsdf } else { 1e30 };
                    (target, drawn_density + walked_density + bsdf * shares.bsdf as f32)
                };
                if frame.occlusion == occlusion::SCREEN && target > 0.0 {
                    target *= screen_occlusion(frame, surfaces, px, domain.position, &point);
                }
                let scale = if is_survivor {
                    survivor_scale(pmf, (group_end - first) as f32, density, survivor_ucw)
                } else {
                    candidate_scale(density)
                };
                // What a direction has found may be out of reach by a rounding error: no target, and no density either.
                let weight = if target == 0.0 { 0.0 } else { target * (scale * record_scale) };
                offered.offer((id, uv), target, weight);
            }
        }
        if is_survivor {
            first = group_end;
            group += 1;
            group_fault = group_fault.max(cheap.fault());
            cheap = Stream::new((0, 0, 0.0), Chooser::new(group_rng.skip(group << 8), frame.choice));
        }
        i += 1;
    }
    group_fault
}

/// Offers light samples to a reservoir and keeps one; the zero reservoir for sky and settled surfaces.
///
/// The target p̂ is the mean over the colour channels of the unshadowed reflected radiance, per unit of (u, v).
/// Techniques: emissive triangles and shapes by the scene's tables, or each once if there are no more of them than
/// candidates; the same by the light tree; texels of the environment and directional lights; directions from the BSDF
/// (`bsdf_hits`), which find neither shapes nor directional lights. A candidate has the weight p̂ / sum of N_t p_t over
/// the techniques t that can draw it, all densities over (light, u, v): balance weights, multiplied out.
///
/// The tables' candidates may come from lights drawn ahead (`presampled`). In tiles they have the law of the tables. In
/// cells their density is not known, but their contribution weight is; the tables' density stands for it in the balance
/// weights, which may be any that sum to 1 for each light. Or they come from the cut of the pixel's block (`presampled`
/// again): each from one of its clusters, evenly apart, by a walk down from there.
///
/// With `frame.candidates_full` groups, candidates of the table compete within their group by a target that leaves the
/// surface's reflection out, and only the survivors meet the full one, each with the contribution weight of its group.
///
/// Source: Talbot et al. 2005; Bitterli et al. 2020, algorithm 3; two stages: Wyman 2020.
pub fn candidates<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    reservoir: u32,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    surfaces: &[Surface],
    bsdf_hits: &[Reservoir],
    presampled: &[LightRecord],
) -> Reservoir {
    let surface = load(surfaces, frame.index_of(px));
    if surface.is_settled() {
        return Reservoir::EMPTY;
    }
    if surface.is_black() && frame.skips(skip::BLACK) {
        return Reservoir::new(0, 0, 0.0, 1);
    }
    let choice = Rng::for_reservoir(px, reservoir, frame, Stage::CandidateChoice);
    let mut stream: Stream<f32, Sample, Chooser> = Stream::new((0, 0), Chooser::new(choice, frame.choice));
    let group_fault = offer_candidates::<EMISSION_IMAGES, ENVIRONMENT, SPECULAR, _>(
        px,
        reservoir,
        frame,
        scene,
        lights,
        surfaces,
        bsdf_hits,
        presampled,
        &surface,
        0,
        EVERY,
        &mut stream,
    );
    let (id, uv) = stream.kept();
    let fault = fault::at(fault::stage::CANDIDATES, stream.fault().max(group_fault));
    Reservoir::new(id, uv, stream.contribution_weight(), 1).with_fault(fault)
}

/// Candidate `number` of all candidates of a pixel, those of its reservoirs one after the other, as [`candidates`] offers
/// it to its stream: to be kept in memory with all others. Nothing competes in groups.
pub fn resident<const EMISSION_IMAGES: bool, const ENVIRONMENT: bool, const SPECULAR: bool>(
    px: UVec2,
    number: u32,
    frame: &Frame,
    scene: &Scene,
    lights: &[u32],
    surfaces: &[Surface],
    bsdf_hits: &[Reservoir],
    presampled: &[LightRecord],
) -> Candidate {
    let surface = load(surfaces, frame.index_of(px));
    let mut candidate = Candidate::NONE;
    if surface.is_settled() || (surface.is_black() && frame.skips(skip::BLACK)) {
        return candidate;
    }
    let count = frame.candidates_in_memory();
    let (reservoir, number) = (number / count, number % count);
    candidate.fault = offer_candidates::<EMISSION_IMAGES, ENVIRONMENT, SPECULAR, _>(
        px,
        reservoir,
        frame,
        scene,
        lights,
        surfaces,
        bsdf_hits,
        presampled,
        &surface,
        number,
        1,
        &mut candidate,
    );
    candidate
}

/// One of the candidates of a reservoir that are in memory: by inversion of their cumulative distribution.
///
/// Source: Talbot et al. 2005, before streams: with memory for all candidates, and one random number for all.
pub fn by_inversion(px: UVec2, reservoir: u32, frame: &Frame, resident: &[Candidate]) -> Reservoir {
    let count = frame.candidates_in_memory();
    let first = reservoir * count;
    let mut sum = 0.0;
    let mut fault = fault::NONE;
    let mut i = 0;
    while i < count {
        let candidate = load(resident, frame.index_of_candidate(px, first + i));
        let with = sum + candidate.weight;
        fault = fault.max(candidate.fault);
        if candidate.weight > 0.0 && is_finite(with) {
            sum = with;
        } else {
            fault = fault.max(fault::of_weight(candidate.weight, with));
        }
        i += 1;
    }
    let random = Rng::for_reservoir(px, reservoir, frame, Stage::CandidateChoice).next_float() * sum;
    let mut chosen = Candidate::NONE;
    let mut cumulative = 0.0;
    let mut is_beyond = false;
    i = 0;
    while i < count && !is_beyond {
        let candidate = load(resident, frame.index_of_candidate(px, first + i));
        let with = cumulative + candidate.weight;
        if candidate.weight > 0.0 && is_finite(with) {
            cumulative = with;
            // The last one that has a weight, should rounding not let the sum exceed the number.
            chosen = candidate;
            is_beyond = cumulative > random;
        }
        i += 1;
    }
    let ucw = if chosen.target > 0.0 { sum / chosen.target } else { 0.0 };
    if !is_finite(ucw) {
        fault = fault.max(fault::OVERFLOW);
    }
    let fault = fault::at(fault::stage::CANDIDATES, fault);
    Reservoir::new(chosen.light, chosen.uv, if is_finite(ucw) { ucw } else { 0.0 }, 1).with_fault(fault)
}
