//! Frames that follow one another: the uniform of each, and of the one before it.

use std::borrow::BorrowMut;

use weir_shared::frame::{Frame, FramePair};

use crate::{
    packed::{Changed, Moment, PackError, PackedScene},
    render::{Request, frame_of},
    scene::Camera,
    settings::Settings,
    skips::Rule,
};

/// What a frame of a sequence shows, and from where.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// What there is.
    pub moment: Moment,
    /// View.
    pub camera: Camera,
}

/// A scene on its way through frames that reuse each other; the scene is borrowed, or the sequence's own.
pub struct Sequence<S> {
    packed: S,
    /// View, knobs and size of the frames to come; each has its own camera.
    pub request: Request,
    /// Whether others than the request's settings send candidates down the light tree.
    pub keeps_tree: bool,
    last: Option<Frame>,
    index: u32,
}

impl<S: BorrowMut<PackedScene>> Sequence<S> {
    /// Nothing shown yet. The camera of `request` is that of no frame; each has its own.
    pub fn new(packed: S, request: Request) -> Self {
        Self { packed, request, keeps_tree: false, last: None, index: 0 }
    }

    /// The scene as the last frame shows it.
    pub fn packed(&self) -> &PackedScene {
        self.packed.borrow()
    }

    /// The same, to be changed: what the next frame shows of the environment, for one.
    pub fn packed_mut(&mut self) -> &mut PackedScene {
        self.packed.borrow_mut()
    }

    /// The shot of frame number `index` of the request's animation.
    pub fn shot(&self, index: u32) -> Shot {
        let settings = &self.request.settings;
        let time_s = settings.time_s + settings.time_step_s * index as f32;
        Shot { moment: Moment { time_s, ..Moment::default() }, camera: self.request.camera }
    }

    /// The number of the next frame, which its random numbers are keyed by.
    pub fn start_at(&mut self, index: u32) {
        self.index = index;
    }

    /// Forgets the past, as after a cut.
    pub fn cut(&mut self) {
        self.last = None;
    }

    /// Other knobs from the next frame on: those that stand in the frame uniform, see [`crate::budget`]. The past stays.
    pub fn tune(&mut self, settings: &Settings) {
        self.request.settings.clone_from(settings);
    }

    /// The next frame, and the parts of the scene's buffers that it changes.
    ///
    /// # Errors
    /// As [`PackedScene::advance`].
    pub fn next(&mut self, shot: &Shot) -> Result<(FramePair, Vec<Changed>), PackError> {
        let packed = self.packed.borrow_mut();
        let settings = &self.request.settings;
        packed.tree_update = (settings.needs_tree() || self.keeps_tree).then_some(settings.tree_update);
        packed.keeps_still = settings.skips.is_on(Rule::Still);
        let changed = if self.request.settings.skips.is_on(Rule::Updates) {
            packed.advance(&shot.moment)?
        } else {
            packed.show_anew(&shot.moment)?
        };
        let request = Request { camera: shot.camera, ..self.request.clone() };
        let has_history = u32::from(self.last.is_some());
        let now = Frame { index: self.index, has_history, ..frame_of(self.packed(), &request) };
        let prev = self.last.unwrap_or(now);
        self.last = Some(now);
        self.index = self.index.wrapping_add(1);
        Ok((FramePair { now, prev }, changed))
    }

    /// A frame apart from those that follow one another, as stills are made of: of what the last one showed, with random
    /// numbers of its own, as number `accumulated` of those that are averaged.
    pub fn independent(&mut self, request: &Request, accumulated: u32) -> FramePair {
        let now = Frame { index: self.index, accumulated, ..frame_of(self.packed(), request) };
        self.index = self.index.wrapping_add(1);
        FramePair { now, prev: now }
    }
}
