//! The strip that the vehicle drove through after a frame, and how far an obstacle reaches into it.

use crate::reporting::path::PathLine;
use crate::reporting::record::ObstacleLine;
use perception::motion::pose::Pose;
use sources::motion_file::{OXTS_LEVER_ARM_M, Trajectory};

/// Width of the strip, in metres: a car without its mirrors.
pub const STRIP_WIDTH_M: f64 = 1.8;

/// How far ahead the path is looked at, in seconds: farther away the vehicle may have evaded what was there.
pub const AHEAD_S: f64 = 3.0;

/// A frame is judged if this many frames of its path ahead are known, the frame itself included,
const MIN_AHEAD_FRAMES: usize = 15;
/// or, of a recording with fewer frames a second, this time, in seconds.
const MIN_AHEAD_FRAMES_S: f64 = 1.5;
/// A frame is judged if the vehicle drove at least this far, in metres: one that stands drives through nothing.
const MIN_AHEAD_M: f64 = 3.0;

/// Distance from the camera forward to the vehicle's front, in metres.
const FRONT_M: f64 = 2.0;
/// What is nearer to the front than this, in metres, is not judged,
const MIN_GAP_M: f64 = 0.5;
/// nor is what is nearer than this to the end of the strip, in metres: the vehicle may have stopped before it.
const END_GAP_M: f64 = 1.0;

/// An obstacle is false if at least this much of its width lies in the strip, in metres: less than that is within the error
/// of its sides and of the path.
pub const MIN_OVERLAP_M: f64 = 0.2;

/// What moves along with the vehicle has left the strip when the vehicle is there, so the strip cannot tell whether it was false.
/// A speed over ground that is this many standard deviations above 0,
const ALONG_SIGMAS: f64 = 3.0;
/// and above this one, in m/s: walking pace, and more than the error of the path's own speed.
const MIN_ALONG_M_S: f64 = 1.0;
/// Time around a frame over which the path's own speed is taken, in seconds: from frame to frame it is noise.
const OWN_SPEED_S: f64 = 0.5;

/// Where the vehicle was at each frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DrivenPath {
    poses: Vec<Pose>,
    times_s: Vec<f64>,
}

/// The strip ahead of one frame: forward and right of the camera in metres, forward never falling.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Strip {
    points_m: Vec<[f64; 2]>,
}

impl DrivenPath {
    /// The path of a trajectory. `times_s` are the times of the frames where it has none. Ends with the shorter of poses,
    /// times and `frames`.
    ///
    /// A path of satellite navigation (one with measurements between frames) is taken where the unit is, not the camera:
    /// so do the peers of this evaluation, and elsewhere than in KITTI's vehicle the distance between both is unknown.
    pub fn new(path: &Trajectory, times_s: &[f64], frames: usize) -> Self {
        let times_s = if path.times_s.is_empty() { times_s } else { &path.times_s };
        let to_unit = Pose { translation_m: [0.0, 0.0, -OXTS_LEVER_ARM_M], ..Pose::IDENTITY };
        let is_unit = !path.between.is_empty();
        let place = |pose: &Pose| if is_unit { pose.after(&to_unit) } else { *pose };
        let count = path.poses.len().min(times_s.len()).min(frames);
        Self { poses: path.poses[..count].iter().map(place).collect(), times_s: times_s[..count].to_vec() }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.poses.len()
    }

    /// Duration, in seconds.
    pub fn seconds(&self) -> f64 {
        self.times_s.last().zip(self.times_s.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// Time of a frame since the first, in seconds; 0 beyond the end.
    pub fn time_s(&self, frame: usize) -> f64 {
        self.times_s.get(frame).zip(self.times_s.first()).map_or(0.0, |(time, first)| time - first)
    }

    /// The frame whose time is nearest to this one since the first, in seconds.
    pub fn frame_at(&self, time_s: f64) -> usize {
        let apart = |frame: &usize| (self.time_s(*frame) - time_s).abs();
        (0..self.frames()).min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(0)
    }

    /// Whether an obstacle moves along with the vehicle at a frame, by its closing speed and the driven path; `None` if its
    /// closing speed, or the path, is not known.
    pub fn moves_along(&self, frame: usize, obstacle: &ObstacleLine) -> Option<bool> {
        let (closing_m_s, sigma_m_s) = obstacle.closing_m_s.zip(obstacle.closing_sigma_m_s)?;
        let standing_m_s = self.standing_closing_m_s(frame, [obstacle.lateral_m, obstacle.distance_m])?;
        Some(standing_m_s - closing_m_s > MIN_ALONG_M_S.max(ALONG_SIGMAS * sigma_m_s))
    }

    /// How fast a standing thing to the right and forward of the camera comes nearer at a frame, in m/s: in a bend not with
    /// the vehicle's speed.
    fn standing_closing_m_s(&self, frame: usize, [right_m, forward_m]: [f64; 2]) -> Option<f64> {
        let now_s = *self.times_s.get(frame)?;
        let is_near = |j: &usize| (self.times_s[*j] - now_s).abs() <= OWN_SPEED_S / 2.0;
        let first = (0..=frame).rev().take_while(is_near).last().unwrap_or(frame);
        let last = (frame..self.frames()).take_while(is_near).last().unwrap_or(frame);
        // Of a recording with few frames a second, the next one.
        let last = if first == last { last + 1 } else { last };
        let elapsed_s = self.times_s.get(last)? - self.times_s[first];
        let place = self.poses[frame].apply([right_m, 0.0, forward_m]);
        let ahead_m = |j: usize| self.poses[j].inverse().apply(place)[2];
        (elapsed_s > 0.0).then(|| (ahead_m(first) - ahead_m(last)) / elapsed_s)
    }

    /// The strip that the vehicle drove through within [`AHEAD_S`] after a frame; `None` if too little of it is known, or
    /// the vehicle stood.
    pub fn strip(&self, frame: usize) -> Option<Strip> {
        let (from, now_s) = (self.poses.get(frame)?.inverse(), self.times_s[frame]);
        let later = frame..self.frames();
        let ahead: Vec<usize> = later.filter(|&j| self.times_s[j] <= now_s + AHEAD_S).collect();
        let last_s = ahead.last().map_or(now_s, |&j| self.times_s[j]);
        if ahead.len() < MIN_AHEAD_FRAMES && last_s - now_s < MIN_AHEAD_FRAMES_S {
            return None;
        }
        let mut points_m: Vec<[f64; 2]> = Vec::with_capacity(ahead.len());
        for frame in ahead {
            let [x, _, z] = from.apply(self.poses[frame].translation_m);
            // A vehicle that rolls back drives through nothing new.
            if points_m.last().is_none_or(|last| z >= last[0]) {
                points_m.push([z, x]);
            }
        }
        let strip = Strip { points_m };
        (strip.end_m() >= MIN_AHEAD_M).then_some(strip)
    }
}

impl Strip {
    /// Distance at which the known path ends, in metres.
    pub(super) fn end_m(&self) -> f64 {
        self.points_m.last().map_or(0.0, |last| last[0])
    }

    /// Lateral position of the strip's centre at a distance, in metres, to the right positive; beyond its ends theirs.
    pub(super) fn centre_m(&self, distance_m: f64) -> f64 {
        let after = self.points_m.partition_point(|point| point[0] <= distance_m);
        match (self.points_m.get(after.wrapping_sub(1)), self.points_m.get(after)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (distance_m - a[0]) / (b[0] - a[0]),
            (Some(end), None) | (None, Some(end)) => end[1],
            (None, None) => 0.0,
        }
    }

    /// How much of an obstacle's width lies in the strip, in metres, if that is enough to make it false; `None` too for one
    /// that is not confirmed, or not where the vehicle drove.
    pub fn false_overlap_m(&self, obstacle: &ObstacleLine) -> Option<f64> {
        let gap_m = obstacle.distance_m - FRONT_M;
        if !obstacle.confirmed || gap_m <= MIN_GAP_M || gap_m >= self.end_m() - END_GAP_M {
            return None;
        }
        let centre_m = self.centre_m(obstacle.distance_m);
        let (half_strip, half) = (STRIP_WIDTH_M / 2.0, obstacle.width_m / 2.0);
        let right_m = (obstacle.lateral_m + half).min(centre_m + half_strip);
        let left_m = (obstacle.lateral_m - half).max(centre_m - half_strip);
        Some(right_m - left_m).filter(|overlap_m| *overlap_m > MIN_OVERLAP_M)
    }

    /// Its edges, for drawing.
    pub fn line(&self) -> PathLine {
        let edge = |side_m: f64| self.points_m.iter().map(|[z, x]| [x + side_m, *z]).collect();
        PathLine {
            known: true,
            left_m: edge(-STRIP_WIDTH_M / 2.0),
            right_m: edge(STRIP_WIDTH_M / 2.0),
            ..PathLine::default()
        }
    }
}

/// Paths and things for tests.
#[cfg(test)]
pub mod tests {
    use super::*;

    /// Straight ahead at this speed, ten frames a second.
    pub fn straight(frames: usize, speed_m_s: f64) -> DrivenPath {
        let times_s: Vec<f64> = (0..frames).map(|i| 0.1 * i as f64).collect();
        let pose = |time_s: &f64| Pose { translation_m: [0.0, 0.0, speed_m_s * time_s], ..Pose::IDENTITY };
        let path = Trajectory { poses: times_s.iter().map(pose).collect(), ..Trajectory::default() };
        DrivenPath::new(&path, &times_s, frames)
    }

    /// A confirmed obstacle at this place.
    pub fn thing(distance_m: f64, lateral_m: f64, width_m: f64) -> ObstacleLine {
        ObstacleLine {
            track: 1,
            confirmed: true,
            distance_m,
            lateral_m,
            width_m,
            height_m: 1.0,
            ..ObstacleLine::default()
        }
    }

    #[test]
    fn what_stands_in_the_strip_is_false_and_what_stands_beside_it_is_not() {
        let strip = straight(60, 8.0).strip(0).unwrap();
        let overlap = |thing: ObstacleLine| strip.false_overlap_m(&thing).map(|m| (m * 1e6).round() / 1e6);
        assert_eq!(overlap(thing(12.0, 0.0, 1.0)), Some(1.0));
        // Wider than the strip.
        assert_eq!(overlap(thing(12.0, 0.0, 4.0)), Some(1.8));
        // Its left side is 0.3 m, 0.2 m and −0.5 m into the strip.
        assert_eq!(overlap(thing(12.0, 1.1, 1.0)), Some(0.3));
        assert_eq!(overlap(thing(12.0, 1.21, 1.0)), None);
        assert_eq!(overlap(thing(12.0, -1.9, 1.0)), None);
        assert_eq!(overlap(ObstacleLine { confirmed: false, ..thing(12.0, 0.0, 1.0) }), None);
        // Nearer than the front, and beyond the 24 m that were driven less one.
        assert_eq!((overlap(thing(2.4, 0.0, 1.0)), overlap(thing(25.1, 0.0, 1.0))), (None, None));
        assert_eq!(overlap(thing(24.9, 0.0, 1.0)), Some(1.0));
    }

    /// Four seconds to the left at 8 m/s on a radius of 40 m, ten frames a second.
    fn bend() -> DrivenPath {
        let times_s: Vec<f64> = (0..40).map(|i| 0.1 * f64::from(i)).collect();
        let pose = |time_s: &f64| {
            let turned = 0.2 * time_s;
            let translation_m = [40.0 * (turned.cos() - 1.0), 0.0, 40.0 * turned.sin()];
            Pose { translation_m, ..Pose::from_rotation_vector([0.0, -turned, 0.0]) }
        };
        let path = Trajectory { poses: times_s.iter().map(pose).collect(), ..Trajectory::default() };
        DrivenPath::new(&path, &times_s, 40)
    }

    #[test]
    fn what_moves_along_is_told_from_what_stands() {
        let path = straight(60, 8.0);
        let moves = |closing_m_s, sigma_m_s| {
            let [closing_m_s, closing_sigma_m_s] = [closing_m_s, sigma_m_s].map(Some);
            path.moves_along(20, &ObstacleLine { closing_m_s, closing_sigma_m_s, ..thing(12.0, 0.0, 1.8) })
        };
        assert_eq!(
            (moves(0.0, 0.3), moves(8.0, 0.3), moves(14.0, 0.3)),
            (Some(true), Some(false), Some(false))
        );
        // 2 m/s over ground, well and badly known, and less than walking pace.
        assert_eq!(
            (moves(6.0, 0.5), moves(6.0, 0.8), moves(7.2, 0.1)),
            (Some(true), Some(false), Some(false))
        );
        assert_eq!(path.moves_along(20, &thing(12.0, 0.0, 1.8)), None, "its speed is not known");
        let still =
            ObstacleLine { closing_m_s: Some(0.0), closing_sigma_m_s: Some(0.1), ..thing(12.0, 0.0, 1.8) };
        assert_eq!(
            (path.moves_along(59, &still), path.moves_along(60, &still)),
            (Some(true), None),
            "the path ends"
        );
        // On a bend to the left with 0.2 rad/s: what is 4 m to the left closes by 0.8 m/s slower.
        let path = bend();
        for (right_m, expected) in [(-4.0, 7.2), (0.0, 8.0), (4.0, 8.8)] {
            let found = path.standing_closing_m_s(20, [right_m, 12.0]).unwrap();
            assert!((found - expected).abs() < 0.05, "{right_m}: {found}");
        }
    }

    #[test]
    fn a_frame_is_judged_if_enough_of_what_follows_is_known() {
        let path = straight(60, 8.0);
        assert!(path.strip(45).is_some() && path.strip(46).is_none() && path.strip(60).is_none());
        // A vehicle that stands or creeps.
        assert!(straight(60, 0.9).strip(0).is_none() && straight(60, 1.1).strip(0).is_some());
        // Two frames a second.
        let times_s: Vec<f64> = (0..10).map(|i| 0.5 * f64::from(i)).collect();
        let pose = |time_s: &f64| Pose { translation_m: [0.0, 0.0, 8.0 * time_s], ..Pose::IDENTITY };
        let slow = Trajectory { poses: times_s.iter().map(pose).collect(), ..Trajectory::default() };
        let slow = DrivenPath::new(&slow, &times_s, 10);
        assert!(slow.strip(6).is_some() && slow.strip(7).is_none());
        assert_eq!((slow.seconds(), slow.frame_at(1.1), slow.time_s(3)), (4.5, 2, 1.5));
    }

    #[test]
    fn the_strip_bends_as_the_vehicle_drove() {
        let path = bend();
        for frame in [0, 20] {
            let strip = path.strip(frame).unwrap();
            // At 12 m the arc lies 1.84 m to the left of the axis.
            assert!(strip.false_overlap_m(&thing(12.0, -1.84, 1.0)).is_some_and(|m| m > 0.99), "{frame}");
            assert!(strip.false_overlap_m(&thing(12.0, 0.0, 1.0)).is_none(), "{frame}");
            let line = strip.line();
            assert!(line.left_m[9][0] < line.right_m[9][0] && line.left_m[9][0] < -0.9, "{line:?}");
        }
    }
}
