//! Schedule of classifications: selects the tracks that the recogniser processes in a frame.
//!
//! Recognition is expensive, so the number of classifications per frame is limited. The nearest tracks of
//! unknown class come first, then those whose last classification is oldest. A track that is not classified
//! remains an obstacle.

use super::classification::MIN_CLASSIFICATIONS;
use super::{Track, Tracker};

/// Priority of waiting: one frame counts as this many metres nearer.
const PRIORITY_M_PER_FRAME: f64 = 2.0;

/// Limits of the classification schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScheduleParameters {
    /// Largest number of classifications per frame.
    pub max_per_frame: usize,
    /// Number of frames after which a track of known class is classified again.
    pub repeat_frames: u32,
}

impl Default for ScheduleParameters {
    fn default() -> Self {
        Self { max_per_frame: 8, repeat_frames: 5 }
    }
}

impl Tracker {
    /// Classifies tracks: calls `recognise` for some of the tracks that were detected in this frame and for
    /// which `is_eligible` holds, and adds the returned score (`None`: not recognised) to their votes. Must
    /// be called once per frame.
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
                // Tracks of unknown class come first.
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
