//! Frames that follow one another: the uniform of each, and of the one before it.

use weir_shared::frame::{Frame, FramePair};

use crate::{
    packed::{Changed, Moment, PackError, PackedScene},
    render::{Request, frame_of},
    scene::Camera,
    settings::Settings,
};

/// What a frame of a sequence shows, and from where.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// What there is.
    pub moment: Moment,
    /// View.
    pub camera: Camera,
}

/// A scene on its way through frames that reuse each other.
pub struct Sequence<'a> {
    packed: &'a mut PackedScene,
    request: Request,
    last: Option<Frame>,
    index: u32,
}

impl<'a> Sequence<'a> {
    /// Nothing shown yet. The camera of `request` is that of no frame; each has its own.
    pub fn new(packed: &'a mut PackedScene, request: Request) -> Self {
        Self { packed, request, last: None, index: 0 }
    }

    /// The scene as the last frame shows it.
    pub fn packed(&self) -> &PackedScene {
        self.packed
    }

    /// The shot of frame number `index` of the request's animation.
    pub fn shot(&self, index: u32) -> Shot {
        let settings = &self.request.settings;
        let time_s = settings.time_s + settings.time_step_s * index as f32;
        Shot { moment: Moment { time_s, ..Moment::default() }, camera: self.request.camera }
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
        let changed = self.packed.advance(&shot.moment)?;
        let request = Request { camera: shot.camera, ..self.request.clone() };
        let has_history = u32::from(self.last.is_some());
        let now = Frame { index: self.index, has_history, ..frame_of(self.packed, &request) };
        let prev = self.last.unwrap_or(now);
        self.last = Some(now);
        self.index = self.index.wrapping_add(1);
        Ok((FramePair { now, prev }, changed))
    }
}
