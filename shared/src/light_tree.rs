//! The light tree: emissive triangles and shapes in proportion to how much of their light may reach a surface, if nothing is in
//! between.
//!
//! Two levels: a tree over emitters, in world space, and for each mesh one over its emissive triangles, in object space,
//! which all its instances share. A node holds what its children, up to eight, need to be compared: spheres around their
//! triangles, cones around their normals, and their power. The host builds it (`packed::light_tree` of the crate `weir`).
//!
//! Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"; two levels:
//! Moreau, Pharr and Clarberg 2019, "Dynamic Many-Light Sampling for Real-Time Ray Tracing".

use glam::{UVec4, Vec3, Vec4};

use crate::{
    alias,
    frame::Frame,
    light::Address,
    numerics::{load, max, sqrt, window},
    rng::Rng,
    scene::{Scene, emitter_record, instance_record},
};

#[cfg(not(target_arch = "spirv"))]
use crate::light::{self, Place};

#[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
pub mod simd;

/// Most children of a node. Eight, so that the host compares them with vector instructions.
pub const WIDTH: u32 = 8;

/// Words of a node: for each field the words of all children.
pub const NODE_WORDS: u32 = WIDTH * node_field::COUNT;

/// Fields of a node's children. A child that is not there has no power.
pub mod node_field {
    /// Center of a sphere around all points that emit, three fields.
    pub const CENTER: u32 = 0;
    /// Radius of that sphere.
    pub const RADIUS: u32 = 3;
    /// Emitted power, as a share of the whole tree's, at least 1e-30 where there is any.
    pub const POWER: u32 = 4;
    /// Axis of a cone around all normals, times the cosine of its half angle, three fields; zero if that is a right angle
    /// or more.
    pub const AXIS: u32 = 5;
    /// Sine of the half angle; 1 if that is a right angle or more.
    pub const SIN_SPREAD: u32 = 8;
    /// The child's node, counted from the root's, or its item with [`super::LEAF`].
    pub const LINK: u32 = 9;
    /// Fields in all.
    pub const COUNT: u32 = 10;
}

/// Marks the link to an item.
pub const LEAF: u32 = 0x8000_0000;

/// A mesh without a tree, because it would be too large: its alias table stands in.
pub const NO_TREE: u32 = 0xffff_ffff;

/// Levels that a trail has room for. The trail of an item is one word with three bits a level, the root's lowest: which
/// child leads to it. Trails of all items stand before the nodes.
pub const MAX_DEPTH: u32 = 10;

/// Probabilities of a choice are whole multiples of one part in this, so that they are exactly what they are said to be.
const ONE: u32 = 1 << 23;

/// An emissive triangle or shape, and the probability of a walk to it.
#[derive(Clone, Copy)]
pub struct Reached {
    /// The light; of no meaning if `pmf` is 0.
    pub address: Address,
    /// Its probability; 0 if the walk ended early, because no light below reaches the surface.
    pub pmf: f32,
}

/// A walk down both trees, as a surface weighs their nodes: to a goal if it has one, else to where random numbers lead.
#[derive(Clone, Copy)]
pub struct Walk {
    /// Of the surface: in world space above the meshes, then in object space.
    position: Vec3,
    /// The same; of length 1.
    normal: Vec3,
    has_goal: bool,
    goal: Address,
    /// What is reached so far, with its probability.
    reached: Reached,
    /// Where the present tree starts, and how many items it has.
    at: u32,
    count: u32,
    is_mesh: bool,
    is_done: bool,
    /// The rest of the way to the goal.
    trail: u32,
    /// The node to come, or the item that was reached.
    link: u32,
    rng: Rng,
}

impl Walk {
    /// At the top, for a surface at `position` with `normal` (of length 1, world space); `goal` counts if `has_goal`.
    #[inline(always)]
    pub fn new(
        frame: &Frame,
        lights: &[u32],
        position: Vec3,
        normal: Vec3,
        has_goal: bool,
        goal: Address,
        rng: Rng,
    ) -> Self {
        let (at, count) = (frame.light_tree_at, frame.emitter_count);
        let has_tree = count > 1;
        Self {
            position,
            normal,
            has_goal,
            goal,
            reached: Reached { address: goal, pmf: 1.0 },
            at,
            count,
            is_mesh: false,
            is_done: false,
            trail: if has_goal && has_tree { load(lights, at + goal.emitter) } else { 0 },
            // Without nodes there is only the first item.
            link: if has_tree { 0 } else { LEAF },
            rng,
        }
    }

    /// Past one node, or from the tree over emitters into that of a mesh.
    #[inline(always)]
    fn step<N: Nodes>(&mut self, frame: &Frame, scene: &Scene, lights: &[u32], nodes: N) {
        if (self.link & LEAF) == 0 {
            let (words, node) = window(lights, self.at + self.count + self.link * NODE_WORDS, NODE_WORDS);
            let bits = if self.has_goal { 0 } else { self.rng.next_word() >> 9 };
            let goal = self.trail & (WIDTH - 1);
            let choice = nodes.choose(words, node, self.position, self.normal, self.has_goal, goal, bits);
            self.trail >>= 3;
            self.reached.pmf *= choice.part as f32 * (1.0 / ONE as f32);
            let link = node_field::LINK * WIDTH + choice.child;
            self.link = if choice.part > 0 { load(words, node + link) } else { LEAF };
            self.is_done = !(self.reached.pmf > 0.0);
        } else {
            self.enter_mesh(frame, scene, lights);
        }
        if self.is_mesh && !self.is_done && (self.link & LEAF) != 0 {
            self.arrive(frame, scene, lights);
        }
    }

    /// The emitter at a leaf of the tree over emitters.
    #[inline(always)]
    fn emitter(&self) -> u32 {
        if self.has_goal { self.goal.emitter } else { self.link & !LEAF }
    }

    /// From a leaf of the tree over emitters to the root of its mesh.
    #[inline(always)]
    fn enter_mesh(&mut self, frame: &Frame, scene: &Scene, lights: &[u32]) {
        self.reached.address.emitter = self.emitter();
        let instance = scene.emitter_word(frame, self.emitter(), emitter_record::INSTANCE);
        self.at = scene.instance_word(frame, instance, instance_record::LIGHT_TREE_AT);
        self.count = scene.instance_word(frame, instance, instance_record::LIGHT_COUNT);
        let record = scene.instance_at(frame, instance);
        self.position = scene.transform_point(record + instance_record::OBJECT_FROM_WORLD, self.position);
        // A plane goes to object space by the transpose of the matrix to world space.
        let plane = scene.transform_normal(record + instance_record::WORLD_FROM_OBJECT, self.normal);
        self.normal = plane * (1.0 / sqrt(max(plane.length_squared(), 1e-30)));
        let has_tree = self.at != NO_TREE && self.count > 1;
        self.trail = if self.has_goal && has_tree { load(lights, self.at + self.goal.local) } else { 0 };
        self.link = if has_tree { 0 } else { LEAF };
        self.is_mesh = true;
    }

    /// At a triangle of the mesh, or where its alias table has to choose one.
    #[inline(always)]
    fn arrive(&mut self, frame: &Frame, scene: &Scene, lights: &[u32]) {
        if !self.has_goal {
            self.reached.address.local = self.link & !LEAF;
        }
        if self.at == NO_TREE && self.count > 1 {
            let instance = instance_of(frame, scene, self.reached.address);
            let table = scene.instance_word(frame, instance, instance_record::LIGHT_TABLE_AT);
            if !self.has_goal {
                let [x, y, _, _] = self.rng.next_four();
                self.reached.address.local = alias::pick(lights, table, self.count, x, y).index;
            }
            self.reached.pmf *= alias::pmf(lights, table, self.reached.address.local);
        }
        self.is_done = true;
    }

    /// Walks to the end.
    #[inline(always)]
    pub fn finish(self, frame: &Frame, scene: &Scene, lights: &[u32]) -> Reached {
        #[cfg(all(not(target_arch = "spirv"), target_arch = "x86_64"))]
        if crate::bvh::simd::available() {
            // SAFETY: the processor has AVX2.
            return unsafe { simd::finish(self, frame, scene, lights) };
        }
        self.finish_with(frame, scene, lights, PortableNodes)
    }

    /// [`Walk::finish`] with a given choice among children.
    #[inline(always)]
    fn finish_with<N: Nodes>(mut self, frame: &Frame, scene: &Scene, lights: &[u32], nodes: N) -> Reached {
        while !self.is_done {
            self.step(frame, scene, lights, nodes);
        }
        self.reached
    }
}

/// Several walks, each a step in turn: while one waits for memory, the others go on. For processors that don't switch to
/// another pixel meanwhile, as GPUs do; where each walk leads does not depend on it.
#[cfg(not(target_arch = "spirv"))]
pub struct Party {
    walks: [core::mem::MaybeUninit<Walk>; Self::MOST],
    count: usize,
}

#[cfg(not(target_arch = "spirv"))]
impl Party {
    /// Most walks.
    pub const MOST: usize = 8;

    /// Nobody yet.
    #[inline(always)]
    pub fn new() -> Self {
        Self { walks: [const { core::mem::MaybeUninit::uninit() }; Self::MOST], count: 0 }
    }

    /// One walk more, unless there are [`Party::MOST`].
    #[inline(always)]
    pub fn add(&mut self, walk: Walk) {
        if let Some(place) = self.walks.get_mut(self.count) {
            place.write(walk);
            self.count += 1;
        }
    }

    /// All walks so far.
    #[inline(always)]
    fn walks(&mut self) -> &mut [Walk] {
        // SAFETY: the first `count` have been written.
        unsafe { self.walks[..self.count].assume_init_mut() }
    }

    /// Walks to the end of all.
    #[inline(always)]
    pub fn finish(&mut self, frame: &Frame, scene: &Scene, lights: &[u32]) {
        #[cfg(target_arch = "x86_64")]
        if crate::bvh::simd::available() {
            // SAFETY: the processor has AVX2.
            unsafe { simd::finish_party(self, frame, scene, lights) };
            return;
        }
        self.finish_with(frame, scene, lights, PortableNodes);
    }

    #[inline(always)]
    fn finish_with<N: Nodes>(&mut self, frame: &Frame, scene: &Scene, lights: &[u32], nodes: N) {
        let mut is_done = false;
        while !is_done {
            is_done = true;
            for walk in self.walks().iter_mut().filter(|walk| !walk.is_done) {
                walk.step(frame, scene, lights, nodes);
                // What the next step asks for: a node, or the instance of an emitter.
                if (walk.link & LEAF) == 0 {
                    nodes.fetch(lights, walk.at + walk.count + walk.link * NODE_WORDS, NODE_WORDS);
                } else if !walk.is_done {
                    let instance = scene.emitter_word(frame, walk.emitter(), emitter_record::INSTANCE);
                    nodes.fetch(scene.records, scene.instance_at(frame, instance), instance_record::WORDS);
                }
                is_done &= walk.is_done;
            }
        }
        // What they have led to is going to be evaluated: first which triangles these are, then the triangles.
        for walk in self.walks().iter().filter(|walk| walk.reached.pmf > 0.0) {
            let instance = instance_of(frame, scene, walk.reached.address);
            let list = scene.instance_word(frame, instance, instance_record::LIGHT_LIST_AT);
            nodes.fetch(scene.records, list + walk.reached.address.local, 1);
        }
        for walk in self.walks().iter().filter(|walk| walk.reached.pmf > 0.0) {
            let Place { instance, triangle } = light::place_of(frame, scene, walk.reached.address);
            nodes.fetch(scene.triangles, triangle * 9, 9);
            nodes.fetch(scene.records, scene.attributes_at(frame, instance, triangle).0, 1);
        }
    }

    /// Where walk number `number` without a goal has led, if there was such a walk; those come first.
    #[inline(always)]
    pub fn led(&mut self, number: u32) -> Option<Reached> {
        self.walks().get(number as usize).filter(|walk| !walk.has_goal).map(|walk| walk.reached)
    }

    /// The walk to `goal`, if there was one.
    #[inline(always)]
    pub fn to(&mut self, goal: Address) -> Option<Reached> {
        self.walks().iter().find(|walk| walk.has_goal && walk.goal == goal).map(|walk| walk.reached)
    }
}

#[cfg(not(target_arch = "spirv"))]
impl Default for Party {
    fn default() -> Self {
        Self::new()
    }
}

#[inline(always)]
fn instance_of(frame: &Frame, scene: &Scene, address: Address) -> u32 {
    scene.emitter_word(frame, address.emitter, emitter_record::INSTANCE)
}

/// One level of a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The child.
    pub child: u32,
    /// Its probability, in parts of 2^-23; 0 if no light below the node reaches the surface.
    pub part: u32,
}

/// How a child of a node is chosen: all implementations give the same result.
pub trait Nodes: Copy {
    /// The child `goal` of a node if `has_goal`, else that which the random number `bits` below 2^23 chooses in proportion
    /// to what the children may matter to a surface at `position` with `normal`, of length 1.
    fn choose(
        self,
        words: &[u32],
        node: u32,
        position: Vec3,
        normal: Vec3,
        has_goal: bool,
        goal: u32,
        bits: u32,
    ) -> Choice;

    /// The `count` words from `at` on will be asked for soon.
    #[inline(always)]
    fn fetch<T>(self, _words: &[T], _at: u32, _count: u32) {}
}

/// The choice for every processor.
#[derive(Clone, Copy)]
pub struct PortableNodes;

impl Nodes for PortableNodes {
    #[inline(always)]
    fn choose(
        self,
        words: &[u32],
        node: u32,
        position: Vec3,
        normal: Vec3,
        has_goal: bool,
        goal: u32,
        bits: u32,
    ) -> Choice {
        let first = importances(words, node, position, normal);
        let second = importances(words, node + 4, position, normal);
        let first_sums = running_sums(first);
        let second_sums = running_sums(second) + first_sums.w;
        // One part for each child that may matter at all, the others in proportion.
        let first_counts = running_counts(first);
        let second_counts = running_counts(second) + UVec4::splat(first_counts.w);
        let rest = (ONE - second_counts.w) as f32;
        // Not times 1 / total: the last sum must come out as exactly one.
        let total = max(second_sums.w, 1e-30);
        let first_bounds = parts(first_sums, total, rest) + first_counts;
        let second_bounds = parts(second_sums, total, rest) + second_counts;
        let mut choice = Choice { child: 0, part: 0 };
        let mut lower = 0;
        let mut i = 0;
        while i < WIDTH {
            let bounds = if i < 4 { first_bounds } else { second_bounds };
            let upper = match i & 3 {
                0 => bounds.x,
                1 => bounds.y,
                2 => bounds.z,
                _ => bounds.w,
            };
            let is_chosen = if has_goal { i == goal } else { lower <= bits && bits < upper };
            if is_chosen {
                choice = Choice { child: i, part: upper - lower };
            }
            lower = upper;
            i += 1;
        }
        choice
    }
}

/// Each number with all before it.
#[inline(always)]
fn running_sums(values: Vec4) -> Vec4 {
    let y = values.x + values.y;
    let z = y + values.z;
    Vec4::new(values.x, y, z, z + values.w)
}

/// For each number, how many are positive of it and all before it.
#[inline(always)]
fn running_counts(values: Vec4) -> UVec4 {
    let x = count(values.x);
    let y = x + count(values.y);
    let z = y + count(values.z);
    UVec4::new(x, y, z, z + count(values.w))
}

#[inline(always)]
fn count(value: f32) -> u32 {
    if value > 0.0 { 1 } else { 0 }
}

/// Shares of `total` in whole parts, of which there are `rest`, at most [`ONE`].
#[inline(always)]
fn parts(sums: Vec4, total: f32, rest: f32) -> UVec4 {
    // From 2^23 to 2^24 floats are the whole numbers, and so are their bits.
    let parts = sums / total * rest + ONE as f32;
    let first = (ONE as f32).to_bits();
    UVec4::new(parts.x.to_bits(), parts.y.to_bits(), parts.z.to_bits(), parts.w.to_bits()) - UVec4::splat(first)
}

/// A field of four children.
#[inline(always)]
fn lanes(words: &[u32], node: u32, field: u32) -> Vec4 {
    // No closure: naga has no structs that hold what one would capture.
    let at = node + field * WIDTH;
    Vec4::new(
        f32::from_bits(load(words, at)),
        f32::from_bits(load(words, at + 1)),
        f32::from_bits(load(words, at + 2)),
        f32::from_bits(load(words, at + 3)),
    )
}

/// What the lights of four children may matter to a surface: power / distance², times the cosines at the light and at the
/// surface, from 1e-30 to 1e30. Positive wherever any point of any of the lights reaches the surface.
///
/// Four at a time, because the host has instructions for that. Differs from the source: the cosines of an angle less the
/// angles of cone and sphere are replaced by sums that are zero only where those are, and need no square roots:
/// cos a cos o + sin o + r / d.
#[inline(always)]
pub fn importances(words: &[u32], node: u32, position: Vec3, normal: Vec3) -> Vec4 {
    let toward_x = lanes(words, node, node_field::CENTER) - position.x;
    let toward_y = lanes(words, node, node_field::CENTER + 1) - position.y;
    let toward_z = lanes(words, node, node_field::CENTER + 2) - position.z;
    let radius = lanes(words, node, node_field::RADIUS);
    let distance2 = toward_x * toward_x + toward_y * toward_y + toward_z * toward_z;
    let near2 = radius * radius;
    let safe2 = distance2.max(Vec4::splat(1e-30));
    let inverse = Vec4::ONE / Vec4::new(sqrt(safe2.x), sqrt(safe2.y), sqrt(safe2.z), sqrt(safe2.w));
    let above = toward_x * normal.x + toward_y * normal.y + toward_z * normal.z;
    let behind = toward_x * lanes(words, node, node_field::AXIS)
        + toward_y * lanes(words, node, node_field::AXIS + 1)
        + toward_z * lanes(words, node, node_field::AXIS + 2);
    let receiving = (above + radius) * inverse;
    let emitting = (radius - behind) * inverse + lanes(words, node, node_field::SIN_SPREAD);
    // Within the sphere anything may be.
    let within = ((near2 - distance2) * 1e30).max(Vec4::ZERO).min(Vec4::ONE);
    let cosines = receiving.max(Vec4::ZERO).min(Vec4::ONE) * emitting.max(Vec4::ZERO).min(Vec4::ONE);
    let (power, cosines) = (lanes(words, node, node_field::POWER), cosines.max(within));
    let value = power * cosines / safe2.max(near2);
    // 1 where power and cosines are positive: at least 1e-30 and some 1e-15 then; else 0.
    let matters = (power * 1e35).min(Vec4::ONE) * (cosines * 1e20).min(Vec4::ONE);
    // The sum of eight is finite, and denormal numbers, which some processors take for zero, don't decide.
    value.max(Vec4::splat(1e-30)).min(Vec4::splat(1e30)) * matters
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::rng::pcg4d;

    /// Numbers in -1..1.
    fn signed(i: u32, j: u32) -> [f32; 4] {
        pcg4d(i, j, 6, 17).map(|b| (b >> 8) as f32 / 8_388_608.0 - 1.0)
    }

    /// A node whose children are near and far, small and large, bright and dark, and not all there.
    fn random_node(i: u32) -> [u32; NODE_WORDS as usize] {
        let mut node = [0; NODE_WORDS as usize];
        for child in 0..WIDTH {
            let ([x, y, z, size], [a, b, c, power]) = (signed(i, child), signed(i, 8 + child));
            let scale = if i.is_multiple_of(7) { 1e-12 } else { 1.0 };
            let axis = if child % 3 == 0 { Vec3::ZERO } else { Vec3::new(a, b, c).normalize_or_zero() * 0.8 };
            let sin = if child % 3 == 0 { 1.0 } else { 0.6 };
            let power = if power < -0.6 { 0.0 } else { (power * 40.0).exp2() };
            let radius = if i.is_multiple_of(5) { 0.0 } else { size.abs() * 0.5 };
            let fields = [x, y, z, radius * scale, power, axis.x, axis.y, axis.z, sin, 0.0];
            for (field, value) in (0..).zip(fields) {
                node[(field * WIDTH + child) as usize] = f32::to_bits(value);
            }
        }
        node
    }

    #[test]
    fn the_wide_choice_equals_the_portable_one_bit_for_bit() {
        let Some(wide) = simd::WideNodes::new() else {
            eprintln!("SKIPPED: this processor has no AVX2");
            return;
        };
        let (mut chosen, mut ended) = (0, 0);
        for i in 0..100_000 {
            let node = random_node(i / 4);
            let ([x, y, z, _], [a, b, c, _]) = (signed(i, 100), signed(i, 101));
            // Now and then exactly at the center of a child.
            let center = Vec3::from_array([0, 1, 2].map(|field| f32::from_bits(node[field * WIDTH as usize + 3])));
            let position = if i.is_multiple_of(11) { center } else { Vec3::new(x, y, z) };
            let normal = Vec3::new(a, b, c).normalize_or_zero();
            let [bits, goal, ..] = pcg4d(i, 1, 2, 3);
            for has_goal in [false, true] {
                let arguments = (position, normal, has_goal, goal % WIDTH, bits >> 9);
                let of = |node: &[u32]| {
                    let (position, normal, has_goal, goal, bits) = arguments;
                    let portable = PortableNodes.choose(node, 0, position, normal, has_goal, goal, bits);
                    assert_eq!(wide.choose(node, 0, position, normal, has_goal, goal, bits), portable, "case {i}");
                    portable
                };
                let choice = of(&node);
                chosen += u32::from(choice.part > 0);
                ended += u32::from(!has_goal && choice.part == 0);
                // Nothing that shines.
                assert_eq!(of(&[0; NODE_WORDS as usize]).part, 0);
            }
        }
        assert!(chosen > 50_000 && ended > 10, "{chosen} chosen, {ended} ended");
    }
}
