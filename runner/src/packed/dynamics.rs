//! The state behind what changes of a scene: where its meshes are, how much a block of each buffer can hold, and what was
//! shown last.

use glam::{Mat4, Vec3};
use weir_shared::{
    alias,
    scene::{emitter_record, instance_record},
};

use super::{
    Moment, PackError, PackOptions,
    changed::Before,
    geometry::PackedMesh,
    light_cuts,
    light_tree::{self, LightBounds},
    moment::TreeUpdate,
    shape::ShapeLight,
    top_level::TopLevel,
};
use crate::scene::Scene;

/// Where a mesh is in each buffer, and what it emits.
pub(super) struct MeshStart {
    pub(super) root: u32,
    pub(super) first_triangle: u32,
    pub(super) attributes_at: u32,
    pub(super) flags: u32,
    pub(super) light_list_at: u32,
    pub(super) light_table_at: u32,
    pub(super) light_count: u32,
    pub(super) light_tree_at: u32,
    pub(super) light_cuts_at: u32,
    pub(super) light_bounds: LightBounds,
    /// Whether its lights differ in power.
    pub(super) has_powers: bool,
    pub(super) shape: Option<ShapeLight>,
}

/// Most that a block can hold.
#[derive(Clone, Copy)]
pub(super) struct Capacity {
    pub(super) instances: usize,
    pub(super) emitters: usize,
    /// Triangles and shapes that emit, over all instances.
    pub(super) lights: u64,
    /// Whether there is a light tree.
    pub(super) has_tree: bool,
    /// Whether there is a tree for cuts.
    pub(super) has_cuts: bool,
}

impl Capacity {
    pub(super) fn of(scene: &Scene, meshes: &[PackedMesh], options: PackOptions) -> Result<Self, PackError> {
        // As `TopLevel::has_any`.
        let has_any = |m: &&PackedMesh| !m.triangles.is_empty() || !m.is_found;
        let drawn = || scene.instances.iter().map(|i| &meshes[i.mesh as usize]).filter(has_any);
        let lights: u64 = drawn().map(|m| m.lights.len() as u64).sum();
        if lights > u64::from(weir_shared::light::ENVIRONMENT_BIT - 1) {
            return Err(PackError::TooManyLights(lights));
        }
        let emitters = drawn().filter(|m| !m.lights.is_empty()).count();
        let (has_tree, has_cuts) = (options.light_tree && emitters > 0, options.light_cuts && emitters > 0);
        Ok(Self { instances: drawn().count(), emitters, lights, has_tree, has_cuts })
    }

    /// Words of a block of `records`: instances, their order in the top level, emitters, the guide to them.
    pub(super) fn record_words(&self) -> usize {
        let guide = if self.emitters > 0 { self.emitters + 1 } else { 0 };
        self.instances * (instance_record::WORDS as usize + 1) + self.emitters * emitter_record::WORDS as usize + guide
    }

    /// Words of the table over emitters, of which there is one: the frame before is not sampled.
    pub(super) fn table_words(&self) -> usize {
        self.emitters * alias::ENTRY_WORDS as usize
    }

    /// Words of the light tree over emitters, which follows it.
    pub(super) fn tree_words(&self) -> usize {
        if self.has_tree { light_tree::capacity_words(self.emitters) } else { 0 }
    }

    /// Words of the tree for cuts over emitters, which follows that.
    pub(super) fn cuts_words(&self) -> usize {
        if self.has_cuts { light_cuts::words(self.emitters) } else { 0 }
    }

    /// Words of all of these.
    pub(super) fn light_words(&self) -> usize {
        self.table_words() + self.tree_words() + self.cuts_words()
    }
}

/// The state behind the blocks.
pub(super) struct Dynamics {
    pub(super) top: TopLevel,
    pub(super) starts: Vec<MeshStart>,
    pub(super) capacity: Capacity,
    /// Which block is this frame's.
    pub(super) half: usize,
    /// Where the instances of each block start in `records`, and how many there are.
    pub(super) blocks: [[u32; 2]; 2],
    /// What it shows; nothing before the first.
    pub(super) shown: Option<Moment>,
    /// The scene's instance behind each of its own.
    pub(super) drawn: Vec<u32>,
    /// Words of the light tree over emitters.
    pub(super) tree_words: usize,
    /// Whether that tree is of the moment shown.
    pub(super) is_tree_current: bool,
    /// Bounds of the emitters, and how trees over them were brought up to date last.
    pub(super) emitters: (Vec<LightBounds>, Option<TreeUpdate>),
    /// The light of each instance of the scene when it was placed last: its place, its emission, and its bounds.
    pub(super) lit: Vec<Option<(Mat4, Vec3, LightBounds)>>,
    /// Memory for the comparison that tells what has changed.
    pub(super) before: Before,
    /// Where light has a closed form.
    pub(super) closed_form: Option<ClosedForm>,
    pub(super) is_dynamic: bool,
    pub(super) has_lights: bool,
}

/// Where light has a closed form, at one moment.
pub(super) struct ClosedForm {
    pub(super) moment: Moment,
    /// Where the trees of each instance that is drawn start in `records`.
    pub(super) starts: Vec<u32>,
}

impl Dynamics {
    pub(super) fn new(
        top: TopLevel,
        starts: Vec<MeshStart>,
        capacity: Capacity,
        is_dynamic: bool,
        has_lights: bool,
    ) -> Self {
        let lit = vec![None; top.len()];
        Self {
            top,
            starts,
            capacity,
            half: 1,
            blocks: [[0; 2]; 2],
            shown: None,
            drawn: Vec::new(),
            tree_words: 0,
            is_tree_current: false,
            emitters: (Vec::new(), None),
            lit,
            before: Before::default(),
            closed_form: None,
            is_dynamic,
            has_lights,
        }
    }

    /// Words of the light tree over emitters.
    #[cfg(test)]
    pub(super) fn tree_words(&self) -> usize {
        self.tree_words
    }

    /// The instances of a moment, those with nothing to see left out.
    pub(super) fn drawn_at(&self, moment: &Moment) -> Result<Vec<u32>, PackError> {
        let Some(asked) = &moment.drawn else {
            return Ok((0..self.top.len() as u32).filter(|&i| self.top.has_any(i)).collect());
        };
        let mut seen = vec![false; self.top.len()];
        for &i in asked {
            if !self.top.has_any(i) || std::mem::replace(&mut seen[i as usize], true) {
                return Err(PackError::NoInstance(i));
            }
        }
        Ok(asked.clone())
    }
}
