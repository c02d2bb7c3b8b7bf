//! Which tracks the recogniser looks at in a frame, and what its looks add up to.
//!
//! A look costs time, so a frame has only so many: the nearest of those that are not known yet, then
//! those whose last look is long ago. Nothing is hidden by not being looked at: it stays an obstacle.

use super::class::MIN_CLASSIFICATIONS;
use super::{Track, Tracker};

/// A frame of waiting counts as much as this many metres nearer.
const PRIORITY_M_PER_FRAME: f64 = 2.0;

/// How often is looked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScheduleParameters {
    /// Most looks in a frame.
    pub max_per_frame: usize,
    /// A track that is known is looked at again after this many frames.
    pub repeat_frames: u32,
}

impl Tracker {
    /// Lets the recogniser look: calls `recognise` for some of the tracks that were seen in this frame
    /// and that `may` be looked at, and keeps the score of the recogniser's class that it gives. Call
    /// once a frame.
    pub fn classify(
        &mut self,
        parameters: ScheduleParameters,
        is_eligible: impl Fn(&Track) -> bool,
        mut recognise: impl FnMut(&Track) -> Option<f32>,
    ) {
        self.order.clear();
        for (i, track) in self.tracks.iter_mut().enumerate() {
            let classification = &mut track.classification;
            classification.frames_since = classification.frames_since.saturating_add(1);
            let unknown = classification.count < MIN_CLASSIFICATIONS;
            let due = unknown || classification.frames_since >= parameters.repeat_frames;
            if due && track.detection.is_some() && is_eligible(track) {
                let waited_m = PRIORITY_M_PER_FRAME * f64::from(track.classification.frames_since.min(1000));
                // What is not known comes first.
                let priority_m = if unknown { 0.0 } else { 1e4 };
                self.order.push((priority_m + track.longitudinal.distance_m() - waited_m, i as u32));
            }
        }
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, i) in self.order.iter().take(parameters.max_per_frame) {
            let track = &mut self.tracks[i as usize];
            let score = recognise(track);
            track.classification.add(score);
        }
    }
}
