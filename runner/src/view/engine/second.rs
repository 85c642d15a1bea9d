//! A second picture of the same frames, by other settings.

use weir_shared::frame::{Frame, FramePair};

use super::{
    EngineError, Pixels,
    chain::{Chain, Place, chain_for, pixels_of},
};
use crate::{
    packed::PackedScene,
    render::{Request, frame_of},
    technique::Technique,
};

/// A second picture of the same frames, by other settings.
#[derive(Default)]
pub(super) struct Second {
    real_time: Option<Chain>,
    still: Option<Chain>,
    last: Option<Frame>,
}

impl Second {
    /// The picture by the settings of `request`, of the frames that the first one is of.
    pub(super) fn pixels(
        &mut self,
        place: &Place,
        packed: &PackedScene,
        request: &Request,
        frames: &FramePair,
    ) -> Result<Pixels, EngineError> {
        let real_time = request.technique == Technique::RealTime;
        let chain = if real_time { &mut self.real_time } else { &mut self.still };
        let made_anew = chain_for(chain, place, packed, request, &["moments", "display"])?;
        let chain = chain.as_mut().expect("made above");
        let last = self.last.filter(|_| !made_anew && real_time && frames.now.has_history != 0);
        let (index, accumulated) = (frames.now.index, frames.now.accumulated);
        let has_history = u32::from(last.is_some());
        let now = Frame { index, accumulated, has_history, ..frame_of(packed, request) };
        if real_time {
            self.last = Some(now);
        }
        chain.executor.run(&chain.plan, packed.buffers(), &FramePair { now, prev: last.unwrap_or(now) })?;
        Ok(pixels_of(chain)?)
    }
}
