//! The values that frames are made of: what the daemon last said, and what of it holds at the time of a cycle.

/// Bits of the alarm's failed self-checks that this side sets itself, as in the daemon's messages: a stage is not
/// running; there has been no result for too long.
pub const STAGE_FAULT: u32 = 1 << 8;
/// See [`STAGE_FAULT`].
pub const STALE_FAULT: u32 = 1 << 9;

/// State of the daemon, by its number in `Status_DaemonState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DaemonState {
    /// Starting.
    Starting = 0,
    /// Running.
    Running = 1,
    /// Running, with something wrong.
    Degraded = 2,
    /// Stopping.
    Stopping = 3,
    /// No daemon runs.
    #[default]
    NotRunning = 4,
}

/// Whether and how an obstacle is known, by its number in `…_Existence`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Existence {
    /// There is none in this place.
    #[default]
    None = 0,
    /// Not confirmed yet: it cannot raise the alarm.
    Tentative = 1,
    /// Confirmed and seen in this frame.
    Measured = 2,
    /// Confirmed and not seen in this frame: its values are predicted.
    Predicted = 3,
}

/// An obstacle. Distances are measured from the left camera along its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Object {
    /// Whether and how it is known.
    pub existence: Existence,
    /// Number of its track, from 1.
    pub track: u32,
    /// Distance in metres.
    pub distance_m: Option<f64>,
    /// Standard deviation of the distance, in metres.
    pub distance_sigma_m: Option<f64>,
    /// Lateral position in metres, to the right positive.
    pub lateral_m: Option<f64>,
    /// Closing speed in m/s, positive while the distance decreases; `None` after a single sighting.
    pub closing_m_s: Option<f64>,
    /// Lateral speed in m/s, to the right positive; `None` after a single sighting.
    pub across_m_s: Option<f64>,
    /// Time to collision in seconds; infinite if the distance does not decrease.
    pub time_to_collision_s: Option<f64>,
    /// Width in metres.
    pub width_m: Option<f64>,
    /// Height in metres.
    pub height_m: Option<f64>,
    /// Index into [`super::layout::CLASSES`].
    pub class: Option<u32>,
    /// Whether it is in the vehicle's path.
    pub in_path: Option<bool>,
    /// Index into [`super::layout::MOVING`].
    pub moving: Option<u32>,
}

/// The path ahead.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathAhead {
    /// Whether it follows from the vehicle's motion.
    pub is_known: bool,
    /// Distance from the front of the body to the nearest obstacle in the path, in metres; infinite if none is seen.
    /// `None` while the alarm cannot judge.
    pub free_m: Option<f64>,
    /// Curvature in 1/m, to the left positive.
    pub curvature_per_m: Option<f64>,
    /// Its standard deviation, in 1/m.
    pub curvature_sigma_per_m: Option<f64>,
    /// Half the width of the body, in metres.
    pub half_width_m: Option<f64>,
    /// Number of obstacles.
    pub objects: u32,
    /// Number of confirmed obstacles in the path.
    pub objects_in_path: u32,
}

/// The vehicle's own motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Own {
    /// Whether it is known; without that there are no values.
    pub is_known: bool,
    /// Whether the vehicle stands.
    pub is_standing: bool,
    /// Whether its sources contradict each other.
    pub disagrees: bool,
    /// Speed in m/s, forwards positive.
    pub speed_m_s: Option<f64>,
    /// Its standard deviation, in m/s.
    pub speed_sigma_m_s: Option<f64>,
    /// Yaw rate in rad/s, to the left positive.
    pub yaw_rate_rad_s: Option<f64>,
    /// Its standard deviation, in rad/s.
    pub yaw_rate_sigma_rad_s: Option<f64>,
}

/// The result of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ResultValues {
    /// Index of the frame in its source.
    pub sequence: u64,
    /// When it was captured, in ns of the monotonic clock.
    pub capture_ns: u64,
    /// Index into [`super::layout::LEVELS`].
    pub level: u32,
    /// Index into [`super::layout::RULES`].
    pub rule: u32,
    /// Self-checks that failed, a bit each ([`super::layout::FAULTS`]).
    pub faults: u32,
    /// Whether the road was seen.
    pub is_road_seen: bool,
    /// The path.
    pub path: PathAhead,
    /// The vehicle's own motion.
    pub own: Own,
    /// The nearest obstacle in the path; `None` if there is none, or the alarm cannot judge.
    pub nearest: Option<Object>,
    /// The obstacles.
    pub objects: Vec<Object>,
}

/// What the daemon last said.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    /// State of the daemon; `None` if it does not answer.
    pub daemon: Option<DaemonState>,
    /// Where its frames come from: an index into [`super::layout::SOURCES`]; `None` if it does not say.
    pub source: Option<u32>,
    /// Its last result.
    pub result: Option<ResultValues>,
    /// The result no longer holds, for these failed self-checks; 0 if it holds.
    pub withdrawn: u32,
}

/// What a cycle of frames says of the alarm and the daemon.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    pub level: u32,
    pub rule: u32,
    pub daemon: Option<u32>,
    pub faults: u32,
    pub age_ms: Option<f64>,
    pub sequence: Option<u64>,
    pub source: Option<u32>,
    pub is_road_seen: Option<bool>,
}

/// The values of one cycle of frames, which all come from one result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cycle {
    pub status: Status,
    pub path: Option<PathAhead>,
    pub own: Option<Own>,
    pub nearest: Option<Object>,
    /// The nearest obstacles, nearest first; `None` if nothing is known of them.
    pub objects: Option<Vec<Object>>,
}

impl Values {
    /// The values at `now_ns`. A result that was withdrawn, or was captured more than `stale_ns` ago, does not hold: the
    /// alarm is off then, and all values but the age are absent.
    pub fn cycle(&self, now_ns: u64, stale_ns: u64) -> Cycle {
        let daemon = self.daemon.map(|state| state as u32);
        let is_running = !matches!(self.daemon, Some(DaemonState::NotRunning));
        let age_ns = self.result.as_ref().map(|result| now_ns.saturating_sub(result.capture_ns));
        let fresh = self
            .result
            .as_ref()
            .filter(|_| is_running && self.withdrawn == 0 && age_ns.is_some_and(|age_ns| age_ns <= stale_ns));
        let status = Status {
            daemon,
            age_ms: age_ns.map(|age_ns| age_ns as f64 * 1e-6),
            sequence: self.result.as_ref().map(|result| result.sequence),
            source: self.source.filter(|_| is_running),
            faults: self.withdrawn | if is_running { STALE_FAULT } else { STAGE_FAULT },
            ..Status::default()
        };
        let Some(result) = fresh else { return Cycle { status, ..Cycle::default() } };
        let mut objects = result.objects.clone();
        objects.sort_by(|a, b| {
            let distance = |o: &Object| o.distance_m.unwrap_or(f64::INFINITY);
            distance(a).total_cmp(&distance(b)).then(a.track.cmp(&b.track))
        });
        Cycle {
            status: Status {
                level: result.level,
                rule: result.rule,
                faults: result.faults,
                is_road_seen: Some(result.is_road_seen),
                ..status
            },
            path: Some(result.path),
            own: Some(result.own),
            nearest: Some(result.nearest.unwrap_or_default()),
            objects: Some(objects),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STALE_NS: u64 = 500_000_000;

    fn values() -> Values {
        let object = |track, distance_m| Object {
            track,
            distance_m: Some(distance_m),
            existence: Existence::Measured,
            ..Object::default()
        };
        let result = ResultValues {
            sequence: 7,
            capture_ns: 1_000_000_000,
            level: 2,
            rule: 1,
            objects: vec![object(1, 30.0), object(2, 10.0), object(3, 20.0), object(4, 10.0)],
            nearest: Some(object(2, 10.0)),
            ..ResultValues::default()
        };
        Values { daemon: Some(DaemonState::Running), source: Some(1), result: Some(result), withdrawn: 0 }
    }

    #[test]
    fn a_fresh_result_is_told_nearest_first() {
        let cycle = values().cycle(1_500_000_000, STALE_NS);
        assert_eq!((cycle.status.level, cycle.status.rule, cycle.status.faults), (2, 1, 0));
        assert_eq!((cycle.status.age_ms, cycle.status.sequence), (Some(500.0), Some(7)));
        let tracks: Vec<u32> = cycle.objects.unwrap().iter().map(|o| o.track).collect();
        assert_eq!(tracks, [2, 4, 3, 1]);
        assert_eq!(cycle.nearest.unwrap().track, 2);
    }

    #[test]
    fn a_stale_result_leaves_its_age_only() {
        let cycle = values().cycle(1_500_000_001, STALE_NS);
        assert_eq!((cycle.status.level, cycle.status.rule, cycle.status.faults), (0, 0, STALE_FAULT));
        assert_eq!((cycle.status.age_ms.unwrap().round(), cycle.status.sequence), (500.0, Some(7)));
        assert_eq!((cycle.path, cycle.own, cycle.nearest), (None, None, None));
        assert_eq!((cycle.objects, cycle.status.is_road_seen), (None, None));
        // A capture time of the future, which no daemon sends, is no reason to panic.
        assert_eq!(values().cycle(0, STALE_NS).status.age_ms, Some(0.0));
    }

    #[test]
    fn a_withdrawn_result_and_an_absent_daemon_say_why() {
        let withdrawn = Values { withdrawn: STAGE_FAULT, ..values() };
        let status = withdrawn.cycle(1_100_000_000, STALE_NS).status;
        assert_eq!((status.level, status.faults), (0, STAGE_FAULT | STALE_FAULT));
        for daemon in [Some(DaemonState::NotRunning), None] {
            let cycle = Values { daemon, ..Values::default() }.cycle(5, STALE_NS);
            let fault = if daemon.is_some() { STAGE_FAULT } else { STALE_FAULT };
            assert_eq!((cycle.status.level, cycle.status.faults), (0, fault));
            assert_eq!((cycle.status.daemon, cycle.status.age_ms), (daemon.map(|_| 4), None));
        }
        let ended = Values { daemon: Some(DaemonState::NotRunning), ..values() };
        let status = ended.cycle(1_100_000_000, STALE_NS).status;
        assert_eq!((status.level, status.source), (0, None), "its last result no longer holds");
        assert_eq!(values().cycle(1_100_000_000, STALE_NS).status.source, Some(1));
    }
}
