//! What recognition says of a track, over several looks.

/// Looks in either direction that are remembered.
const MAX_BELIEF: i8 = 3;

/// After so many looks a track counts as known.
pub(super) const KNOWN_LOOKS: u32 = 3;

/// What the recogniser's looks at a track say together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Class {
    /// Looks that recognised it less those that did not, bounded.
    pub(super) belief: i8,
    pub(super) looks: u32,
    /// Frames since the last look.
    pub(super) since: u32,
    pub(super) score: f32,
}

impl Class {
    /// The latest score of the class, when most looks of late recognised it; else `None`.
    pub fn score(&self) -> Option<f32> {
        (self.belief > 0).then_some(self.score)
    }

    pub(super) fn add(&mut self, score: Option<f32>) {
        let change = if score.is_some() { 1 } else { -1 };
        self.belief = (self.belief + change).clamp(-MAX_BELIEF, MAX_BELIEF);
        self.looks = self.looks.saturating_add(1);
        self.since = 0;
        self.score = score.unwrap_or(self.score);
    }
}
