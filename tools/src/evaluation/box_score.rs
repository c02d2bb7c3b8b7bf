//! Boxes against objects: today's matching rule beside the strict one, fragments, false boxes.

use super::scene_match::FrameMatch;
use crate::reporting::record::{tidy, tidy_finite};
use serde::Serialize;

/// Sums over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoxCounts {
    evaluable: usize,
    found: usize,
    one_to_one: usize,
    boxes: usize,
    on_road: usize,
    off_road: usize,
}

/// How boxes find objects. JSON of `lookout evaluate weather`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BoxScore {
    /// Share of the evaluable objects with a matching box; a box may find several.
    pub detection_rate: Option<f64>,
    /// The same if a box may find one object only.
    pub strict_rate: Option<f64>,
    /// Boxes on an object that is found: 1 without fragments.
    pub boxes_per_object: Option<f64>,
    /// False boxes on the road per minute, summed over frames.
    pub false_per_minute: f64,
    /// False boxes beside the road per minute, summed over frames.
    pub off_road_per_minute: f64,
}

impl BoxCounts {
    /// Adds a frame.
    pub fn add(&mut self, frame: &FrameMatch) {
        self.evaluable += frame.evaluable.len();
        self.found += frame.evaluable.iter().filter(|object| object.detection.is_some()).count();
        self.one_to_one += frame.one_to_one;
        self.boxes += frame.boxes;
        self.on_road += frame.false_positives.on_road;
        self.off_road += frame.false_positives.off_road;
    }

    /// Adds the sums of other frames.
    pub fn merge(&mut self, other: &Self) {
        self.evaluable += other.evaluable;
        self.found += other.found;
        self.one_to_one += other.one_to_one;
        self.boxes += other.boxes;
        self.on_road += other.on_road;
        self.off_road += other.off_road;
    }

    /// The score of frames that last `seconds` together.
    pub fn score(&self, seconds: f64) -> BoxScore {
        let share = |part: usize, whole: usize| tidy_finite(part as f64 / whole as f64);
        let per_minute = |count: usize| tidy(count as f64 * 60.0 / seconds.max(1e-9));
        BoxScore {
            detection_rate: share(self.found, self.evaluable),
            strict_rate: share(self.one_to_one, self.evaluable),
            boxes_per_object: share(self.boxes, self.found),
            false_per_minute: per_minute(self.on_road),
            off_road_per_minute: per_minute(self.off_road),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::scene_match::FalsePositives;

    #[test]
    fn counts_become_rates() {
        let mut counts =
            BoxCounts { evaluable: 8, found: 6, one_to_one: 5, boxes: 9, on_road: 1, off_road: 0 };
        let frame = FrameMatch {
            false_positives: FalsePositives { on_road: 0, off_road: 3 },
            one_to_one: 0,
            boxes: 0,
            ..FrameMatch::default()
        };
        let mut more = BoxCounts::default();
        more.add(&frame);
        counts.merge(&more);
        let score = counts.score(30.0);
        assert_eq!((score.detection_rate, score.strict_rate), (Some(0.75), Some(0.625)));
        assert_eq!((score.boxes_per_object, score.false_per_minute), (Some(1.5), 2.0));
        assert_eq!(score.off_road_per_minute, 6.0);
        assert_eq!(BoxCounts::default().score(1.0).detection_rate, None);
    }
}
