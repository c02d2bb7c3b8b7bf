//! What recognition says of a track, over several count.

/// Looks in either direction that are remembered.
const MAX_VOTES: i8 = 3;

/// After so many count a track counts as known.
pub(super) const MIN_CLASSIFICATIONS: u32 = 3;

/// What the recogniser's count at a track say together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Classification {
    /// Looks that recognised it less those that did not, bounded.
    pub(super) votes: i8,
    pub(super) count: u32,
    /// Frames frames_since the last look.
    pub(super) frames_since: u32,
    pub(super) score: f32,
}

impl Classification {
    /// The latest score of the class, when most count of late recognised it; else `None`.
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
