//! Classification of a track, accumulated over several runs of the recogniser.

/// Bound of the votes in either direction.
const MAX_VOTES: i8 = 3;

/// Number of classifications after which the class of a track counts as known.
pub(super) const MIN_CLASSIFICATIONS: u32 = 3;

/// Accumulated classification of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Classification {
    /// Positive minus negative classifications, bounded.
    pub(super) votes: i8,
    pub(super) count: u32,
    /// Frames since the last classification.
    pub(super) frames_since: u32,
    pub(super) score: f32,
}

impl Classification {
    /// Latest positive score if the majority of recent classifications is positive, else `None`.
    pub fn score(&self) -> Option<f32> {
        (self.votes > 0).then_some(self.score)
    }

    pub(super) fn add(&mut self, score: Option<f32>) {
        let change = if score.is_some() { 1 } else { -1 };
        self.votes = (self.votes + change).clamp(-MAX_VOTES, MAX_VOTES);
        self.count = self.count.saturating_add(1);
        self.frames_since = 0;
        self.score = score.unwrap_or(self.score);
    }
}
