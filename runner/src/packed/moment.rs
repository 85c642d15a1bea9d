//! What of a scene changes from frame to frame: instances, where they are, and how they emit.
//!
//! All of it lies in two blocks of each buffer, one for the frame that is computed and one for the frame before it, which
//! reuse in time asks about. The blocks take turns.

use std::{collections::HashMap, ops::Range, time::Instant};

use bytemuck::bytes_of;
use glam::{Mat4, Vec3};
use weir_shared::{
    alias,
    closed_form::NO_TREES,
    scene::{NO_INSTANCE, attribute_flags, emitter_record, instance_record},
};

use super::{
    Changed, PackError, PackedScene, closed_form,
    dynamics::ClosedForm,
    light_cuts,
    light_tree::{self, LightBounds},
    shape,
    top_level::Place,
};

/// What becomes of the light tree over emitters from one moment to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TreeUpdate {
    /// It is built anew.
    #[default]
    Rebuild,
    /// While the same instances are drawn, its nodes are fitted to where they are; which belong together stays.
    Refit,
}

/// What the scene shows at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Time in seconds, for the motions of the scene.
    pub time_s: f32,
    /// Instances that are drawn, in the order of their lights; all of them if `None`.
    pub drawn: Option<Vec<u32>>,
    /// Instances with an RGB factor on their emission.
    pub emission: Vec<(u32, Vec3)>,
    /// Instances with a transform in place of that of the scene.
    pub placed: Vec<(u32, Mat4)>,
}

impl PackedScene {
    /// The scene's instance behind one that is drawn, as surfaces and lights name them.
    pub fn scene_instance(&self, drawn: u32) -> Option<u32> {
        self.dynamics.drawn.get(drawn as usize).copied()
    }

    /// Origin of the object space of buffers and passes, for an instance of the scene, in that of the scene's mesh: zero
    /// unless both are far from their own.
    pub fn object_origin(&self, instance: u32) -> Vec3 {
        self.origins.of_mesh(instance)
    }

    /// Goes on to another moment; returns what has changed, nothing if that is the moment shown already. What was shown
    /// before stays in the other block, where the uniform of the frame before finds it.
    ///
    /// # Errors
    /// If an instance does not exist, is drawn twice or has a transform without an inverse.
    pub fn advance(&mut self, moment: &Moment) -> Result<Vec<Changed>, PackError> {
        let same = self.dynamics.shown.as_ref().is_some_and(|shown| {
            shown == moment || (!self.moves() && Moment { time_s: moment.time_s, ..shown.clone() } == *moment)
        });
        let lacks_tree =
            self.dynamics.capacity.has_tree && self.tree_update.is_some() && !self.dynamics.is_tree_current;
        if same && !lacks_tree { Ok(Vec::new()) } else { self.show_anew(moment) }
    }

    /// [`PackedScene::advance`], even to the moment that is shown already.
    ///
    /// # Errors
    /// As [`PackedScene::advance`].
    pub fn show_anew(&mut self, moment: &Moment) -> Result<Vec<Changed>, PackError> {
        let (words, light_words) = (2 * self.dynamics.capacity.record_words(), self.dynamics.capacity.light_words());
        let rows = self.dynamics.top.capacity_rows();
        let first_row = self.dynamics.top.first_row + (self.dynamics.half ^ 1) * rows;
        let nodes = first_row..first_row + rows;
        if !self.keeps_still {
            self.show(moment)?;
            // Both blocks of records: each knows its counterparts in the other.
            return Ok(vec![
                Changed::words("records", 0..words),
                Changed::rows(nodes),
                Changed::words("lights", 0..light_words),
            ]);
        }
        let before = std::mem::take(&mut self.dynamics.before).of(
            &self.records[..words],
            &self.lights[..light_words],
            &self.bvh[nodes.clone()],
        );
        let shown = self.show(moment);
        let changed = before.changed(&self.records, &self.lights, &self.bvh[nodes], first_row);
        self.dynamics.before = before;
        shown.map(|()| changed)
    }

    /// Fills the block that is not in use, and makes it this frame's.
    pub(super) fn show(&mut self, moment: &Moment) -> Result<(), PackError> {
        let drawn = self.dynamics.drawn_at(moment)?;
        let keeps = self.keeps_still;
        let placed = self.dynamics.top.place(&self.origins.moment(moment), &drawn, keeps)?;
        let half = self.dynamics.half ^ 1;
        let capacity = self.dynamics.capacity;
        let block = half * capacity.record_words();
        let words = instance_record::WORDS as usize;

        let emission_of: HashMap<u32, Vec3> = moment.emission.iter().copied().collect();
        // Of a scene that stands still, whatever the time.
        let is_known = |known: &&ClosedForm| known.moment == Moment { time_s: known.moment.time_s, ..moment.clone() };
        let closed_form = self.dynamics.closed_form.as_ref().filter(is_known).map(|known| known.starts.clone());
        let mut first_light = 0;
        let mut is_found_alike = self.dynamics.shown.is_some() && drawn == self.dynamics.drawn;
        let block_before = self.dynamics.half * capacity.record_words();
        let (mut emitters, mut weights, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
        // The power of a light of each emitter: the least and the most, and whether those of one differ.
        let (mut powers, mut has_powers) = ([f64::INFINITY, 0.0], false);
        for (slot, (&instance, Place { world_from_object, object_from_world, .. })) in
            drawn.iter().zip(&placed.places).enumerate()
        {
            let start = &self.dynamics.starts[self.dynamics.top.mesh(instance) as usize];
            let emission = emission_of.get(&instance).copied().unwrap_or(Vec3::ONE);
            let determinant = world_from_object.determinant();
            let mirrored = if determinant < 0.0 { attribute_flags::MIRRORED } else { 0 };
            let record = &mut self.records[block + slot * words..][..words];
            write_rows(&mut record[instance_record::WORLD_FROM_OBJECT as usize..][..12], world_from_object);
            write_rows(&mut record[instance_record::OBJECT_FROM_WORLD as usize..][..12], object_from_world);
            record[instance_record::ROOT as usize..][..8].copy_from_slice(&[
                start.root,
                start.first_triangle,
                start.attributes_at,
                start.flags | mirrored,
                start.light_list_at,
                start.light_table_at,
                start.light_count,
                first_light,
            ]);
            record[instance_record::EMISSION_SCALE as usize..][..3]
                .copy_from_slice(&emission.to_array().map(f32::to_bits));
            record[instance_record::COUNTERPART as usize] = NO_INSTANCE;
            record[instance_record::LIGHT_TREE_AT as usize] = start.light_tree_at;
            record[instance_record::LIGHT_CUTS_AT as usize] = start.light_cuts_at;
            record[instance_record::CLOSED_FORM_AT as usize] =
                closed_form.as_ref().map_or(NO_TREES, |starts| starts[slot]);
            if self.dynamics.top.is_found(instance) && is_found_alike {
                let of = |block: usize, words: Range<u32>| {
                    let at = block + slot * instance_record::WORDS as usize;
                    &self.records[at + words.start as usize..at + words.end as usize]
                };
                let place = instance_record::WORLD_FROM_OBJECT..instance_record::WORLD_FROM_OBJECT + 12;
                let scale = instance_record::EMISSION_SCALE..instance_record::EMISSION_SCALE + 3;
                is_found_alike =
                    [place, scale].into_iter().all(|words| of(block, words.clone()) == of(block_before, words));
            }
            let record = &mut self.records[block + slot * words..][..words];
            if start.light_count > 0 {
                emitters.extend([first_light, slot as u32]);
                let gain = f64::from(emission.element_sum() / 3.0);
                if start.shape.is_some() {
                    record[instance_record::RADIUS as usize] = shape::radius(world_from_object).to_bits();
                }
                let is_there = |(place, scale, _): &&(Mat4, Vec3, LightBounds)| {
                    bytes_of(place) == bytes_of(world_from_object) && bytes_of(scale) == bytes_of(&emission)
                };
                let lit = &mut self.dynamics.lit[instance as usize];
                let placed = match (lit.as_ref().filter(|_| keeps).filter(is_there), &start.shape) {
                    (Some((.., known)), _) => *known,
                    (None, Some(shape)) => shape.bounds(world_from_object, gain),
                    (None, None) => {
                        let area_scale = f64::from(determinant.abs()).powf(2.0 / 3.0);
                        let weight = start.light_bounds.power * area_scale * gain;
                        start.light_bounds.placed(world_from_object, object_from_world, weight)
                    }
                };
                *lit = Some((*world_from_object, emission, placed));
                weights.push(placed.power);
                let of_each = placed.power / f64::from(start.light_count);
                powers = [powers[0].min(of_each), powers[1].max(of_each)];
                has_powers |= start.has_powers;
                bounds.push(placed);
                first_light += start.light_count;
            }
        }
        let order_at = block + capacity.instances * words;
        let order = self.dynamics.top.order();
        self.records[order_at..order_at + order.len()].copy_from_slice(order);
        let emitters_at = order_at + capacity.instances;
        self.records[emitters_at..emitters_at + emitters.len()].copy_from_slice(&emitters);
        let guide_at = emitters_at + capacity.emitters * emitter_record::WORDS as usize;
        let (guide, guide_shift) = guide_to(&emitters, first_light);
        self.records[guide_at..guide_at + guide.len()].copy_from_slice(&guide);
        if !weights.iter().any(|&w| w > 0.0) {
            weights.fill(1.0);
        }
        let tree_at = capacity.table_words();
        let cuts_at = tree_at + capacity.tree_words();
        self.choose_lights_by(&weights, bounds, drawn == self.dynamics.drawn);
        self.frame.light_tree_at = tree_at as u32;
        self.frame.light_cuts_at = cuts_at as u32;
        let first_row = self.dynamics.top.first_row + half * self.dynamics.top.capacity_rows();
        let nodes = self.dynamics.top.nodes();
        self.bvh[first_row..first_row + nodes.len()].copy_from_slice(nodes);

        self.link(half, &drawn);
        self.frame.instances_at = block as u32;
        self.frame.instance_count = drawn.len() as u32;
        self.frame.top_order_at = order_at as u32;
        self.frame.emitters_at = emitters_at as u32;
        self.frame.light_guide_at = guide_at as u32;
        self.frame.light_guide_shift = guide_shift;
        self.frame.emitter_count = weights.len() as u32;
        self.frame.light_count = first_light;
        self.frame.found_moment = self.frame.found_moment.wrapping_add(u32::from(!is_found_alike));
        self.frame.top_root = (first_row / 5) as u32;
        self.bounds = placed.bounds.map(|corner| corner + self.origin);
        self.frame.block = half as u32;
        self.content.powers = has_powers || powers[1] > powers[0] * 1.001;
        self.dynamics.half = half;
        self.dynamics.blocks[half] = [block as u32, drawn.len() as u32];
        self.dynamics.shown = Some(moment.clone());
        self.dynamics.drawn = drawn;
        Ok(())
    }

    /// Brings the table over emitters and the trees over them up to date: their weights, their bounds, and whether they are of
    /// the instances that were drawn before.
    fn choose_lights_by(&mut self, weights: &[f64], bounds: Vec<LightBounds>, is_drawn_alike: bool) {
        let capacity = self.dynamics.capacity;
        let update = self.tree_update.filter(|_| capacity.has_tree);
        let (before, updated) = &self.dynamics.emitters;
        let is_same = |(a, b): (&LightBounds, &LightBounds)| a.is(b);
        let stands = self.keeps_still
            && self.dynamics.shown.is_some()
            && before.len() == bounds.len()
            && before.iter().zip(&bounds).all(is_same);
        // A tree that is fitted to its lights once more stays as it is, as long as it would be fitted and not built.
        let is_alike = is_drawn_alike || update != Some(TreeUpdate::Refit);
        let keeps_tree = stands && self.dynamics.is_tree_current && *updated == update && is_alike;
        let start = Instant::now();
        if !stands {
            let table = alias::build(weights).unwrap_or_default();
            self.lights[..table.len()].copy_from_slice(&table);
        }
        self.light_costs.table.update = start.elapsed();
        let start = Instant::now();
        let tree_at = capacity.table_words();
        let mut done = update;
        match update.filter(|_| !keeps_tree) {
            Some(TreeUpdate::Refit) if self.dynamics.is_tree_current && is_drawn_alike => {
                light_tree::refit(&mut self.lights[tree_at..][..self.dynamics.tree_words], &bounds);
            }
            Some(_) => {
                let (tree, _) = light_tree::build(&bounds);
                self.lights[tree_at..][..tree.len()].copy_from_slice(&tree);
                self.dynamics.tree_words = tree.len();
                done = Some(TreeUpdate::Rebuild);
            }
            None => {}
        }
        self.dynamics.is_tree_current = update.is_some();
        self.light_costs.tree.update = start.elapsed();
        if capacity.has_cuts {
            let start = Instant::now();
            if !stands {
                let cuts = light_cuts::build(&bounds);
                self.lights[tree_at + capacity.tree_words()..][..cuts.len()].copy_from_slice(&cuts);
            }
            self.light_costs.cuts.update = start.elapsed();
        }
        self.dynamics.emitters = (bounds, done);
    }

    /// Finds out where light has a closed form, of what is shown.
    pub(super) fn find_closed_forms(&mut self, moment: &Moment) {
        let triangles_of = |&instance: &u32| self.meshes[self.dynamics.top.mesh(instance) as usize].count;
        let triangles_of: Vec<u32> = self.dynamics.drawn.iter().map(triangles_of).collect();
        let view =
            weir_shared::scene::Scene { triangles: &self.triangles, records: &self.records, texels: &self.texels };
        let start = self.records.len() as u32;
        let Some(found) = closed_form::build(&self.frame, &view, &triangles_of, start) else { return };
        self.records.extend(found.words);
        for (slot, start) in found.starts.iter().enumerate() {
            let at = self.frame.instances_at as usize + slot * instance_record::WORDS as usize;
            self.records[at + instance_record::CLOSED_FORM_AT as usize] = *start;
        }
        self.dynamics.closed_form = Some(ClosedForm { moment: moment.clone(), starts: found.starts });
        self.content.closed_form = true;
    }

    /// Tells every instance of both blocks which one it is in the other.
    fn link(&mut self, half: usize, drawn: &[u32]) {
        let (words, block_words) = (instance_record::WORDS as usize, self.dynamics.capacity.record_words());
        let counterpart_at =
            |half: usize, slot: usize| half * block_words + slot * words + instance_record::COUNTERPART as usize;
        let mut slots = vec![NO_INSTANCE; self.dynamics.top.len()];
        for (slot, &instance) in self.dynamics.drawn.iter().enumerate() {
            slots[instance as usize] = slot as u32;
            self.records[counterpart_at(half ^ 1, slot)] = NO_INSTANCE;
        }
        for (slot, &instance) in drawn.iter().enumerate() {
            let before = slots[instance as usize];
            self.records[counterpart_at(half, slot)] = before;
            if before != NO_INSTANCE {
                self.records[counterpart_at(half ^ 1, before as usize)] = slot as u32;
            }
        }
    }
}

/// The guide to emitters, whose records are given, and the size of its buckets as a power of two: the smallest with which
/// there are no more buckets than emitters. No words without lights.
fn guide_to(emitters: &[u32], light_count: u32) -> (Vec<u32>, u32) {
    let words = emitter_record::WORDS as usize;
    let emitter_count = (emitters.len() / words) as u32;
    let Some(last_light) = light_count.checked_sub(1) else { return (Vec::new(), 0) };
    let shift = (0..u32::BITS).find(|shift| (last_light >> shift) < emitter_count).unwrap_or(0);
    let mut guide = Vec::with_capacity(emitter_count as usize + 1);
    let mut emitter = 0;
    for bucket in 0..=last_light >> shift {
        let next = |emitter: u32| (emitter as usize + 1) * words + emitter_record::FIRST_LIGHT as usize;
        while emitters.get(next(emitter)).is_some_and(|&first| first <= bucket << shift) {
            emitter += 1;
        }
        guide.push(emitter);
    }
    guide.push(emitter_count - 1);
    (guide, shift)
}

/// The upper three rows of an affine matrix.
fn write_rows(words: &mut [u32], matrix: &Mat4) {
    for (row, words) in words.chunks_exact_mut(4).enumerate() {
        for (word, x) in words.iter_mut().zip(matrix.row(row).to_array()) {
            *word = x.to_bits();
        }
    }
}
