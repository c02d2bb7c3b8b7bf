//! Schedule of classifications: selects the obstacles that the recogniser processes in a frame, and keeps their classes.
//!
//! Recognition is expensive, so the number of classifications per frame is limited. The nearest obstacles of unknown class
//! come first, then those whose last classification is oldest. One that is not classified remains an obstacle.

use super::Obstacle;
use super::classification::{Classification, MIN_CLASSIFICATIONS};
use crate::recognition::MAX_CLASSES;

/// Priority of waiting: one frame counts as this many metres nearer.
const PRIORITY_M_PER_FRAME: f64 = 2.0;

/// Limits of the classification schedule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScheduleParameters {
    /// Largest number of classifications per frame.
    pub max_per_frame: usize,
    /// Number of frames after which a track of known class is classified again.
    pub repeat_frames: u32,
    /// Log-odds of each class before the first look.
    pub prior: f64,
}

impl Default for ScheduleParameters {
    fn default() -> Self {
        Self { max_per_frame: 8, repeat_frames: 5, prior: 0.0 }
    }
}

/// How likely tracked obstacles, by their numbers, are of the classes of one recogniser; memory is allocated once.
#[derive(Debug)]
pub struct ClassificationSchedule {
    parameters: ScheduleParameters,
    /// Track and its classification.
    known: Vec<(u32, Classification)>,
    order: Vec<(f64, u32)>,
}

impl ClassificationSchedule {
    /// A schedule for at most `capacity` tracks.
    pub fn new(parameters: ScheduleParameters, capacity: usize) -> Self {
        Self { parameters, known: Vec::with_capacity(capacity), order: Vec::with_capacity(capacity) }
    }

    /// Forgets all classes.
    pub fn reset(&mut self) {
        self.known.clear();
    }

    /// Probability that a track is of a class, by its number, if that is more likely than not; else `None`.
    pub fn probability(&self, track: u32, class: usize) -> Option<f64> {
        self.known.iter().find(|(id, _)| *id == track)?.1.probability(class)
    }

    /// Classifies obstacles: calls `recognise` with the index of some of those that are seen in this frame and for which
    /// `is_eligible` holds, and adds the evidence for each class that it returns, in log-odds; `None` where nothing could be looked at. Forgets the
    /// tracks that are gone. Must be called once per frame.
    pub fn classify(
        &mut self,
        obstacles: &[Obstacle],
        is_eligible: impl Fn(usize) -> bool,
        mut recognise: impl FnMut(usize) -> Option<[f64; MAX_CLASSES]>,
    ) {
        self.known.retain(|(id, _)| obstacles.iter().any(|o| o.track == *id));
        self.order.clear();
        for (i, obstacle) in obstacles.iter().enumerate() {
            let slot = match self.known.iter().position(|(id, _)| *id == obstacle.track) {
                Some(slot) => slot,
                None if self.known.len() < self.known.capacity() => {
                    self.known.push((obstacle.track, Classification::new(self.parameters.prior)));
                    self.known.len() - 1
                }
                None => continue,
            };
            let classification = &mut self.known[slot].1;
            classification.frames_since = classification.frames_since.saturating_add(1);
            let unknown = classification.count < MIN_CLASSIFICATIONS;
            let due = unknown || classification.frames_since >= self.parameters.repeat_frames;
            if due && obstacle.missed == 0 && is_eligible(i) && self.order.len() < self.order.capacity() {
                let waited_m = PRIORITY_M_PER_FRAME * f64::from(classification.frames_since.min(1000));
                // Tracks of unknown class come first.
                let priority_m = if unknown { 0.0 } else { 1e4 };
                self.order.push((priority_m + obstacle.distance_m - waited_m, i as u32));
            }
        }
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, i) in self.order.iter().take(self.parameters.max_per_frame) {
            let track = obstacles[i as usize].track;
            let Some(evidence) = recognise(i as usize) else { continue };
            if let Some((_, classification)) = self.known.iter_mut().find(|(id, _)| *id == track) {
                classification.add(evidence);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::classification::MAX_LOG_ODDS;

    #[test]
    fn evidence_is_added_up_and_all_obstacles_get_their_turn() {
        let policy = ScheduleParameters { max_per_frame: 1, repeat_frames: 3, prior: -0.5 };
        let mut schedule = ClassificationSchedule::new(policy, 4);
        let at = |track: u32, distance_m: f64| Obstacle { track, distance_m, ..Obstacle::default() };
        let obstacles = [at(1, 20.0), at(2, 10.0)];
        let mut classified = Vec::new();
        let mut frame = |schedule: &mut ClassificationSchedule, evidence: f64| {
            schedule.classify(
                &obstacles,
                |_| true,
                |i| {
                    classified.push(obstacles[i].track);
                    Some([evidence; MAX_CLASSES])
                },
            );
        };
        frame(&mut schedule, 1.5);
        assert_eq!(schedule.probability(1, 1), None, "nothing was looked at");
        assert_eq!(
            schedule.probability(2, 1),
            Some(1.0 / (1.0 + (-1.0_f64).exp())),
            "the nearest comes first"
        );
        for _ in 0..12 {
            frame(&mut schedule, 1.5);
        }
        let bound = 1.0 / (1.0 + (-MAX_LOG_ODDS).exp());
        assert_eq!(schedule.probability(1, 1), Some(bound), "looks are not independent");
        // A few negative looks change nothing, many do.
        for _ in 0..2 {
            frame(&mut schedule, -1.5);
        }
        assert!([1, 2].iter().all(|track| schedule.probability(*track, 1).is_some()));
        for _ in 0..12 {
            frame(&mut schedule, -1.5);
        }
        assert!([1, 2].iter().all(|track| schedule.probability(*track, 1).is_none()));
        let [first, second] = [1, 2].map(|id| classified.iter().filter(|&&l| l == id).count());
        assert!(first >= 8 && second >= 8, "both are classified: {classified:?}");
        schedule.classify(&obstacles, |_| false, |_| unreachable!("none may be classified"));
        // What is not seen in this frame is not classified; what has gone is forgotten.
        let hidden = [Obstacle { missed: 1, ..at(3, 5.0) }];
        schedule.classify(&hidden, |_| true, |_| unreachable!("it is not seen"));
        assert_eq!(schedule.known.len(), 1);
    }
}
