//! Which tracks the recogniser looks at in a frame, and what its looks add up to.
//!
//! A look costs time, so a frame has only so many: the nearest of those that are not known yet, then
//! those whose last look is long ago. Nothing is hidden by not being looked at: it stays an obstacle.

use super::class::KNOWN_LOOKS;
use super::{Track, Tracker};

/// A frame of waiting counts as much as this many metres nearer.
const WAIT_M: f64 = 2.0;

/// How often is looked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScheduleParameters {
    /// Most looks in a frame.
    pub most: usize,
    /// A track that is known is looked at again after this many frames.
    pub again_frames: u32,
}

impl Default for ScheduleParameters {
    fn default() -> Self {
        Self { most: 8, again_frames: 5 }
    }
}

impl Tracker {
    /// Lets the recogniser look: calls `recognise` for some of the tracks that were seen in this frame
    /// and that `may` be looked at, and keeps the score of the recogniser's class that it gives. Call
    /// once a frame.
    pub fn look(
        &mut self,
        parameters: ScheduleParameters,
        may: impl Fn(&Track) -> bool,
        mut recognise: impl FnMut(&Track) -> Option<f32>,
    ) {
        self.order.clear();
        for (i, track) in self.tracks.iter_mut().enumerate() {
            let class = &mut track.class;
            class.since = class.since.saturating_add(1);
            let unknown = class.looks < KNOWN_LOOKS;
            let due = unknown || class.since >= parameters.again_frames;
            if due && track.detection.is_some() && may(track) {
                let waited = WAIT_M * f64::from(track.class.since.min(1000));
                // What is not known comes first.
                let first = if unknown { 0.0 } else { 1e4 };
                self.order.push((first + track.along.distance_m() - waited, i as u32));
            }
        }
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, i) in self.order.iter().take(parameters.most) {
            let track = &mut self.tracks[i as usize];
            let score = recognise(track);
            track.class.add(score);
        }
    }
}
