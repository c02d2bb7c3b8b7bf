//! A confirmed obstacle, as the alarm judges it.

use super::path::LateralMotion;
use super::swept::{MIN_GAP_M, Obstacle, encounter};
use crate::motion::path::SweptPath;
use crate::outline::Outline;
use crate::tracking::Obstacle as Tracked;
use crate::tracking::filter::ground::{GroundMotion, Movement};
use crate::tracking::filter::{TimeToCollision, braking_seconds};

/// On the swept path, the distance counts for what is approached at least this fast, in m/s: following a car at its speed
/// is no approach.
const MIN_APPROACH_M_S: f64 = 0.5;
/// While the vehicle stands, only what moves towards it at least this fast counts, in m/s: faster than people walk.
const MIN_CLOSING_AT_REST_M_S: f64 = 3.0;

/// What is as high as the wall behind it and stands at most so far before it, in metres, is on the pavement: trees, poles, porches. Where it
/// is straight ahead, the road bends before the wall.
const BESIDE_WALL_M: f64 = 2.5;

/// A confirmed obstacle, as input of the alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Candidate {
    /// Identifier of its track.
    pub track: u32,
    /// Number of frames with a detection.
    pub seen: u32,
    /// Consecutive frames with a detection, up to this one; 0 if it is not detected.
    pub consecutive_frames: u32,
    /// Time since the last detection, in seconds; 0 if it is detected in this frame.
    pub unseen_s: f64,
    /// Mean absolute log ratio of its width from frame to frame.
    pub width_jitter: f64,
    /// Distance from the camera, in metres.
    pub distance_m: f64,
    /// Closing speed, in m/s.
    pub closing_m_s: f64,
    /// Time to collision; `None` if it does not approach significantly.
    pub time_to_collision: Option<TimeToCollision>,
    /// Lateral position and speed.
    pub motion: LateralMotion,
    /// Outline of the thing.
    pub outline: Outline,
    /// By how much it stands before a wall that is as high, in metres; `None` where there is none.
    pub before_wall_m: Option<f64>,
    /// Motion over ground; `None` if the own motion is unknown.
    pub ground: Option<GroundMotion>,
    /// Whether the vehicle drives towards it, so that its distance alone may raise the alarm; on the straight strip that
    /// is not asked.
    pub(super) is_approached: bool,
    /// Distance from the vehicle's front, in metres; from the camera as long as the alarm has not judged it.
    pub(super) gap_m: f64,
    /// Whether it is so probably in the way that it may raise a level, and not only keep one.
    pub(super) may_raise: bool,
    /// Whether it comes from beside, and its place at the arrival is in doubt (`Encounter::is_unsure`), or it stands beside the road as
    /// walls do, which then bends (`BESIDE_WALL_M`): a warning can wait.
    pub(super) is_unsure: bool,
    /// Whether it is less probably in the way than an alarm needs, but the path is in doubt (`Encounter::may_be_in_the_way`): it may raise
    /// or keep a warning, and nothing else.
    pub(super) is_doubtful: bool,
}

impl Candidate {
    /// Whether it counts as an obstacle in the path, and is not only warned of.
    pub fn is_sure(&self) -> bool {
        !self.is_doubtful
    }

    /// Converts a tracked obstacle.
    pub fn of(tracked: &Tracked) -> Self {
        Self {
            track: tracked.track,
            seen: tracked.seen,
            consecutive_frames: tracked.consecutive_frames,
            unseen_s: tracked.unseen_s,
            width_jitter: tracked.width_jitter,
            distance_m: tracked.distance_m,
            closing_m_s: tracked.closing_m_s,
            time_to_collision: tracked.time_to_collision,
            motion: LateralMotion {
                lateral_m: tracked.lateral_m,
                speed_m_s: tracked.lateral_speed_m_s,
                speed_sigma_m_s: tracked.lateral_speed_sigma_m_s,
                width_m: tracked.width_m,
            },
            outline: tracked.outline,
            before_wall_m: tracked.before_wall_m,
            ground: tracked.ground,
            is_approached: true,
            gap_m: tracked.distance_m,
            may_raise: true,
            is_unsure: false,
            is_doubtful: false,
        }
    }

    /// Whether all its numbers are: with another one nothing can be judged.
    pub(super) fn is_finite(&self) -> bool {
        let LateralMotion { lateral_m, speed_m_s, speed_sigma_m_s, width_m } = self.motion;
        let ttc = self.time_to_collision.map_or([0.0; 2], |t| [t.seconds, t.sigma_s]);
        [lateral_m, speed_m_s, speed_sigma_m_s, width_m, self.distance_m, self.closing_m_s, self.width_jitter]
            .into_iter()
            .chain(ttc)
            .chain(self.outline.measures_m())
            .chain(self.ground.iter().flat_map(|g| {
                [g.speed_m_s, g.speed_sigma_m_s, g.place_sigma_m].into_iter().flatten().chain(g.correlations)
            }))
            .all(f64::is_finite)
    }

    /// Whether it stands so near to a wall that is as high that the road does not lead between both.
    fn is_beside_wall(&self) -> bool {
        self.before_wall_m.is_some_and(|before_m| before_m < BESIDE_WALL_M)
    }

    /// Whether it is detected in this frame. A place that is only predicted raises nothing.
    pub(super) fn is_detected(&self) -> bool {
        self.consecutive_frames > 0
    }

    /// Place and motion over ground, if that is known.
    fn obstacle(&self) -> Option<Obstacle> {
        Some(Obstacle {
            place_m: [self.motion.lateral_m, self.distance_m],
            width_m: self.motion.width_m,
            outline: self.outline,
            closing_m_s: self.closing_m_s,
            time_to_collision: self.time_to_collision,
            ground: self.ground?,
        })
    }

    /// The candidate as the alarm judges it: along the path that the body sweeps, or in the straight strip of this width
    /// (in metres) if the path or its motion over ground is unknown. `None` if it is not in the way. `is_held`: it already
    /// raised a level.
    pub fn in_the_way(self, path: Option<&SweptPath>, path_width_m: f64, is_held: bool) -> Option<Self> {
        let Some((path, obstacle)) = path.zip(self.obstacle()) else {
            return self.is_in_the_way(path_width_m).then_some(Self {
                is_approached: true,
                may_raise: true,
                gap_m: self.distance_m,
                ..self
            });
        };
        let found = encounter(path, &obstacle);
        let is_doubtful = !found.is_in_the_way(is_held);
        if is_doubtful && !found.may_be_in_the_way() {
            return None;
        }
        let moves = obstacle.ground.movement == Movement::Moving;
        let ttc = if path.is_at_rest() {
            found.time_to_collision.filter(|_| moves && found.closing_m_s >= MIN_CLOSING_AT_REST_M_S)
        } else {
            found.time_to_collision
        };
        let is_approached = ttc.is_some() && (is_held || found.closing_m_s >= MIN_APPROACH_M_S);
        Some(Self {
            distance_m: found.distance_m.max(0.0),
            gap_m: found.gap_m,
            closing_m_s: found.closing_m_s,
            time_to_collision: ttc,
            is_approached: is_approached && found.is_in_strip(is_held) && !path.is_at_rest(),
            may_raise: found.is_in_the_way(false),
            is_unsure: if moves { !is_doubtful && found.is_unsure() } else { self.is_beside_wall() },
            is_doubtful,
            ..self
        })
    }

    /// The candidate on the straight strip as the vehicle's front meets it, which is so far ahead of the camera, in metres.
    pub(super) fn seen_at_front(self, front_m: f64) -> Self {
        let gap_m = (self.distance_m - front_m).max(MIN_GAP_M);
        let time_to_collision = self.time_to_collision.map(|ttc| {
            let braking = ttc.braking_m_s2(self.distance_m, self.closing_m_s);
            TimeToCollision { seconds: braking_seconds(gap_m, self.closing_m_s, braking), ..ttc }
        });
        Self { gap_m, time_to_collision, ..self }
    }

    /// Gap between it and the vehicle's path when the vehicle arrives, in metres; negative if they overlap: by so much it
    /// would have to be farther aside. Along the path that the body sweeps, or beside the straight strip of this width (in
    /// metres) if the path or its motion over ground is unknown.
    pub fn clearance_m(&self, path: Option<&SweptPath>, path_width_m: f64) -> f64 {
        match path.zip(self.obstacle()) {
            Some((path, obstacle)) => encounter(path, &obstacle).clearance_m,
            None => self.motion.clearance_m(path_width_m, self.time_to_collision.map(|t| t.seconds)),
        }
    }

    /// Whether the vehicle would collide with it in a straight path of this width (in metres).
    pub fn is_in_the_way(&self, path_width_m: f64) -> bool {
        let arrival_s = self.time_to_collision.map(|t| t.seconds);
        self.motion.path_relation(path_width_m, arrival_s).is_in_the_way()
    }

    /// Deceleration that reduces the closing speed to 0 before the gap is 0, in m/s²; 0 if it does not
    /// approach significantly.
    pub fn required_deceleration_m_s2(&self) -> f64 {
        let is_closing = self.time_to_collision.is_some();
        if is_closing { self.closing_m_s * self.closing_m_s / (2.0 * self.gap_m.max(0.1)) } else { 0.0 }
    }
}
