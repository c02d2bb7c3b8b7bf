//! The alarm: three rules, four levels, and what keeps it from flickering.
//!
//! - **Distance** (paper, section 4.3): something in the path is nearer than a preset distance.
//! - **Time to collision**: at constant closing speed it would be met within so many seconds.
//! - **Deceleration**: to stop before it, the vehicle would have to brake that hard: v²/(2z).
//!
//! A level must hold in several frames before it is raised. Rules are asked as far lead as confirming
//! takes, so that it costs no time while things move on as they do. A level that is on is left only when
//! its rule is clearly no longer fulfilled, and not before it was held for a while.

pub mod path;

use crate::tracking::Track;
use crate::tracking::filter::TimeToCollision;
use path::LateralMotion;

/// When the alarm sounds. A limit of 0 switches its rule off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlarmParameters {
    /// Alarm: something nearer than this, in metres.
    pub distance_m: f64,
    /// Warning: met in less than this, in seconds.
    pub ttc_warning_s: f64,
    /// Alarm: met in less than this, in seconds.
    pub ttc_alarm_s: f64,
    /// Warning: braking harder than this would be needed, in m/s².
    pub deceleration_warning_m_s2: f64,
    /// Alarm: braking harder than this would be needed, in m/s².
    pub deceleration_alarm_m_s2: f64,
    /// Width of the vehicle's path, in metres; what lies beside it does not count.
    pub path_width_m: f64,
    /// Frames in a row in which a rule must be fulfilled.
    pub confirm_frames: u32,
    /// A level that is on ends when its limit is missed by this share.
    pub clear_share: f64,
    /// Once on, a level stays on for at least this long after its cause is gone.
    pub hold_ns: u64,
}

impl Default for AlarmParameters {
    fn default() -> Self {
        Self {
            distance_m: 10.0,
            ttc_warning_s: 2.8,
            ttc_alarm_s: 1.6,
            deceleration_warning_m_s2: 3.5,
            deceleration_alarm_m_s2: 5.0,
            path_width_m: 2.4,
            confirm_frames: 2,
            clear_share: 0.15,
            hold_ns: 1_000_000_000,
        }
    }
}

/// What the alarm says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum AlarmLevel {
    /// It cannot judge.
    #[default]
    Off = 0,
    /// It judges, and nothing dangerous is known.
    Standby = 1,
    /// Something will become dangerous.
    Warning = 2,
    /// Something is dangerous.
    Alarm = 3,
}

/// Which rule raised a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum AlarmRule {
    /// None.
    #[default]
    None = 0,
    /// The preset distance.
    Distance = 1,
    /// The time to collision.
    TimeToCollision = 2,
    /// The braking that would be needed.
    Deceleration = 3,
}

/// A confirmed obstacle, as the alarm sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Candidate {
    /// Its track.
    pub track: u32,
    /// Frames in which it was seen.
    pub seen: u32,
    /// Frames in a row, up to this one, in which it was; 0 when it is out of sight.
    pub consecutive_frames: u32,
    /// By how much its width changes from frame to frame, as a logarithm.
    pub width_jitter: f64,
    /// Distance, in metres.
    pub distance_m: f64,
    /// Closing speed, in m/s.
    pub closing_m_s: f64,
    /// Time to collision, where it surely comes nearer.
    pub time_to_collision: Option<TimeToCollision>,
    /// Its place across the view.
    pub motion: LateralMotion,
}

impl Candidate {
    /// A track as the alarm sees it.
    pub fn of(track: &Track) -> Self {
        Self {
            track: track.id,
            seen: track.seen,
            consecutive_frames: track.consecutive_frames,
            width_jitter: track.width_jitter,
            distance_m: track.distance_m(),
            closing_m_s: track.closing_m_s(),
            time_to_collision: track.time_to_collision(),
            motion: LateralMotion {
                lateral_m: track.lateral.lateral_m(),
                speed_m_s: track.lateral.speed_m_s(),
                speed_sigma_m_s: track.lateral.speed_sigma_m_s(),
                width_m: track.width_m,
            },
        }
    }

    /// Whether this frame's place of it can be relied on: it was seen, or is known for long and went on as
    /// expected.
    fn is_reliable(&self) -> bool {
        self.consecutive_frames > 0 || self.seen >= MIN_SEEN_FRAMES
    }

    /// Whether the vehicle would meet it in its path.
    pub fn is_in_the_way(&self, path_width_m: f64) -> bool {
        let arrival_s = self.time_to_collision.map(|t| t.seconds);
        self.motion.path_relation(path_width_m, arrival_s).is_in_the_way()
    }

    /// Braking that brings the closing speed to 0 before the distance is, in m/s²; 0 when it does not
    /// surely come nearer.
    pub fn required_deceleration_m_s2(&self) -> f64 {
        let is_closing = self.time_to_collision.is_some();
        if is_closing { self.closing_m_s * self.closing_m_s / (2.0 * self.distance_m.max(0.1)) } else { 0.0 }
    }
}

/// The alarm, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AlarmState {
    /// What it says.
    pub level: AlarmLevel,
    /// Which rule raised that.
    pub rule: AlarmRule,
    /// The track that did.
    pub track: Option<u32>,
    /// Whether the level is another than in the frame before.
    pub changed: bool,
    /// Nearest obstacle in the path, in metres, whether or not it is dangerous.
    pub nearest_m: Option<f64>,
    /// The track's time to collision, while it is there.
    pub time_to_collision: Option<TimeToCollision>,
    /// The braking that it would need, while it is there, in m/s².
    pub required_deceleration_m_s2: f64,
}

/// A closing speed is known well enough for the rules that need it after so many frames,
const MIN_SEEN_FRAMES: u32 = 8;
/// the last of them in a row,
const MIN_CONSECUTIVE_FRAMES: u32 = 4;
/// while the obstacle's width stays the same to this factor's logarithm: what changes more is now one thing,
/// now another,
const MAX_WIDTH_JITTER: f64 = 0.5;
/// when the time to collision is sure to this share,
const MAX_TTC_SIGMA_SHARE: f64 = 0.3;
/// and above this, in m/s: creeping up to a queue is no danger.
const MIN_CLOSING_M_S: f64 = 1.0;

/// Candidates for which memory is set aside.
const CAPACITY: usize = 128;

/// In how many frames in a row a track fulfilled a rule of each level.
#[derive(Clone, Copy, Debug)]
struct RuleCounts {
    track: u32,
    warning: u32,
    alarm: u32,
}

/// What raised a level.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cause {
    level: AlarmLevel,
    rule: AlarmRule,
    candidate: Candidate,
}

/// The alarm as a state machine; time is passed in.
#[derive(Clone, Debug)]
pub struct Alarm {
    parameters: AlarmParameters,
    level: AlarmLevel,
    rule: AlarmRule,
    track: Option<u32>,
    /// The level is held until then.
    until_ns: u64,
    last_ns: u64,
    counts: Vec<RuleCounts>,
    before: Vec<RuleCounts>,
}

impl Alarm {
    /// A silent alarm.
    pub fn new(parameters: AlarmParameters) -> Self {
        Self {
            parameters,
            level: AlarmLevel::Off,
            rule: AlarmRule::None,
            track: None,
            until_ns: 0,
            last_ns: 0,
            counts: Vec::with_capacity(CAPACITY),
            before: Vec::with_capacity(CAPACITY),
        }
    }

    /// Judges one frame. With `can_judge` false the alarm is off, whatever was seen. A time that goes
    /// back is a new recording: nothing is held over.
    pub fn update(
        &mut self,
        time_ns: u64,
        can_judge: bool,
        candidates: impl IntoIterator<Item = Candidate>,
    ) -> AlarmState {
        let before = self.level;
        if time_ns < self.last_ns {
            self.silence(AlarmLevel::Standby);
        }
        let elapsed_s = time_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        self.last_ns = time_ns;
        if !can_judge {
            self.silence(AlarmLevel::Off);
            let changed = before != AlarmLevel::Off;
            return AlarmState { changed, ..AlarmState::default() };
        }
        // As far lead as confirming takes; after a gap nothing is known so far lead.
        let lead = elapsed_s * f64::from(self.parameters.confirm_frames.saturating_sub(1));
        let lead_s = if lead <= 0.5 { lead } else { 0.0 };
        std::mem::swap(&mut self.counts, &mut self.before);
        self.counts.clear();
        let mut nearest_m: Option<f64> = None;
        let mut cause: Option<Cause> = None;
        for candidate in candidates.into_iter().take(CAPACITY) {
            if !candidate.is_in_the_way(self.parameters.path_width_m) {
                continue;
            }
            nearest_m = Some(nearest_m.map_or(candidate.distance_m, |n| n.min(candidate.distance_m)));
            if let Some(of) = self.evaluate(&candidate, lead_s)
                && cause.is_none_or(|c| (of.level, c.candidate.distance_m) > (c.level, candidate.distance_m))
            {
                cause = Some(of);
            }
        }
        self.set_level(time_ns, cause);
        // The cause's figures, when it still is the cause.
        let now = cause.filter(|c| Some(c.candidate.track) == self.track).map(|c| c.candidate);
        AlarmState {
            level: self.level,
            rule: self.rule,
            track: self.track,
            changed: before != self.level,
            nearest_m,
            time_to_collision: now.and_then(|c| c.time_to_collision),
            required_deceleration_m_s2: now.map_or(0.0, |c| c.required_deceleration_m_s2()),
        }
    }

    fn silence(&mut self, level: AlarmLevel) {
        (self.level, self.rule, self.track) = (level, AlarmRule::None, None);
        self.counts.clear();
    }

    /// Raises at once, lowers when the time of holding is over.
    fn set_level(&mut self, time_ns: u64, cause: Option<Cause>) {
        let wanted = cause.map_or(AlarmLevel::Standby, |c| c.level);
        if wanted >= self.level || time_ns >= self.until_ns {
            self.level = wanted;
            self.rule = cause.map_or(AlarmRule::None, |c| c.rule);
            self.track = cause.map(|c| c.candidate.track);
            self.until_ns = time_ns.saturating_add(if cause.is_some() { self.parameters.hold_ns } else { 0 });
        }
    }

    /// The highest level of a candidate that is confirmed, and keeps count.
    fn evaluate(&mut self, candidate: &Candidate, lead_s: f64) -> Option<Cause> {
        let counts = self.before.iter().find(|t| t.track == candidate.track);
        let mut counts =
            counts.copied().unwrap_or(RuleCounts { track: candidate.track, warning: 0, alarm: 0 });
        let is_held = |level| self.track == Some(candidate.track) && self.level >= level;
        let alarm = self.triggered_rule(candidate, AlarmLevel::Alarm, lead_s, is_held(AlarmLevel::Alarm));
        let warning = self
            .triggered_rule(candidate, AlarmLevel::Warning, lead_s, is_held(AlarmLevel::Warning))
            .or(alarm);
        for (count, rule) in [(&mut counts.alarm, alarm), (&mut counts.warning, warning)] {
            *count = match rule {
                // What is out of sight and new confirms nothing, and what was confirmed stays so.
                Some(_) => count.saturating_add(u32::from(candidate.is_reliable())),
                None => 0,
            };
        }
        self.counts.push(counts);
        let needed = self.parameters.confirm_frames;
        let cause = |level, rule: Option<AlarmRule>, count| {
            rule.filter(|_| count >= needed).map(|rule| Cause { level, rule, candidate: *candidate })
        };
        cause(AlarmLevel::Alarm, alarm, counts.alarm)
            .or_else(|| cause(AlarmLevel::Warning, warning, counts.warning))
    }

    /// The rule of a level that a candidate fulfils, looked at `lead_s` from now. Limits are wider for one
    /// that `is_held` the level.
    fn triggered_rule(
        &self,
        c: &Candidate,
        level: AlarmLevel,
        lead_s: f64,
        is_held: bool,
    ) -> Option<AlarmRule> {
        let p = &self.parameters;
        let hysteresis = if is_held { 1.0 + p.clear_share } else { 1.0 };
        let lead_s = if c.is_reliable() && !is_held { lead_s } else { 0.0 };
        let closing = if c.time_to_collision.is_some() { c.closing_m_s } else { 0.0 };
        let distance_m = c.distance_m - closing * lead_s;
        if level == AlarmLevel::Alarm && distance_m < p.distance_m * hysteresis {
            return Some(AlarmRule::Distance);
        }
        let ttc = c.time_to_collision?;
        let is_known = c.seen >= MIN_SEEN_FRAMES
            && c.consecutive_frames >= MIN_CONSECUTIVE_FRAMES
            && c.width_jitter <= MAX_WIDTH_JITTER
            && ttc.sigma_s <= MAX_TTC_SIGMA_SHARE * ttc.seconds
            && c.closing_m_s >= MIN_CLOSING_M_S;
        if !is_known && !is_held {
            return None;
        }
        let (ttc_s, deceleration) = match level {
            AlarmLevel::Alarm => (p.ttc_alarm_s, p.deceleration_alarm_m_s2),
            _ => (p.ttc_warning_s, p.deceleration_warning_m_s2),
        };
        if ttc.seconds - lead_s < ttc_s * hysteresis {
            return Some(AlarmRule::TimeToCollision);
        }
        let needed = c.required_deceleration_m_s2() * c.distance_m / distance_m.max(0.1);
        (deceleration > 0.0 && needed > deceleration / hysteresis).then_some(AlarmRule::Deceleration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 80_000_000;

    /// Something in the path that comes nearer at a known speed.
    fn at(distance_m: f64, closing_m_s: f64) -> Candidate {
        Candidate {
            track: 7,
            seen: 20,
            consecutive_frames: 20,
            width_jitter: 0.1,
            distance_m,
            closing_m_s,
            time_to_collision: (closing_m_s > 0.5)
                .then(|| TimeToCollision { seconds: distance_m / closing_m_s, sigma_s: 0.05 }),
            motion: LateralMotion { speed_sigma_m_s: 0.1, width_m: 1.8, ..LateralMotion::default() },
        }
    }

    fn beside(lateral_m: f64, candidate: Candidate) -> Candidate {
        Candidate { motion: LateralMotion { lateral_m, ..candidate.motion }, ..candidate }
    }

    fn alarm() -> Alarm {
        Alarm::new(AlarmParameters { hold_ns: 5 * PERIOD_NS, ..AlarmParameters::default() })
    }

    /// Drives at something from `from_m` at a consecutive_frames speed; gives the distance and rule of the first
    /// warning and of the first alarm.
    fn drive(from_m: f64, closing: f64, parameters: AlarmParameters) -> [Option<(f64, AlarmRule)>; 2] {
        let mut alarm = Alarm::new(parameters);
        let mut found = [None; 2];
        let mut z = from_m;
        for frame in 0.. {
            z -= closing * 0.08;
            if z < 1.0 {
                break;
            }
            let state = alarm.update(frame * PERIOD_NS, true, [at(z, closing)]);
            for (place, level) in found.iter_mut().zip([AlarmLevel::Warning, AlarmLevel::Alarm]) {
                if state.level == level && place.is_none() {
                    *place = Some((z, state.rule));
                }
            }
        }
        found
    }

    #[test]
    fn each_rule_fires_at_its_limit() {
        let p = AlarmParameters::default();
        // 5 m/s: a warning at 2.8 s, the alarm at 10 m, no later than the first frame inside.
        let [warning, alarm] = drive(40.0, 5.0, p);
        let (z, rule) = warning.unwrap();
        assert!(z / 5.0 <= 2.88 && z / 5.0 > 2.7 && rule == AlarmRule::TimeToCollision, "{z}");
        let (z, rule) = alarm.unwrap();
        assert!(z <= 10.4 && z > 9.6 && rule == AlarmRule::Distance, "{z}");
        // 14 m/s: the time alone.
        let [warning, alarm] = drive(60.0, 14.0, p);
        assert!(warning.unwrap().0 / 14.0 > 2.7, "{warning:?}");
        let (z, rule) = alarm.unwrap();
        assert!((1.5..1.7).contains(&(z / 14.0)) && rule == AlarmRule::TimeToCollision, "{z}");
        // 30 m/s, no limit on the time: 5 m/s² are needed from 90 m on, 3.5 from 129 m.
        let p = AlarmParameters { ttc_warning_s: 0.0, ttc_alarm_s: 0.0, ..p };
        let [warning, alarm] = drive(200.0, 30.0, p);
        assert!((124.0..131.0).contains(&warning.unwrap().0), "{warning:?}");
        let (z, rule) = alarm.unwrap();
        assert!((87.0..92.5).contains(&z) && rule == AlarmRule::Deceleration, "{z}");
    }

    #[test]
    fn one_frame_raises_nothing() {
        let mut alarm = alarm();
        for frame in 0..20 {
            let z = if frame == 10 { 4.0 } else { 30.0 };
            let state = alarm.update(frame * PERIOD_NS, true, [at(z, 0.0)]);
            assert_eq!(state.level, AlarmLevel::Standby, "frame {frame}");
        }
        // Something new and out of sight confirms nothing either.
        let gone = Candidate { consecutive_frames: 0, seen: 4, ..at(4.0, 0.0) };
        for frame in 20..25 {
            assert_eq!(alarm.update(frame * PERIOD_NS, true, [gone]).level, AlarmLevel::Standby);
        }
    }

    #[test]
    fn it_is_held_cleared_late_and_tells_its_changes() {
        let mut alarm = alarm();
        let mut time = 0;
        let mut step = |alarm: &mut Alarm, candidates: &[Candidate]| {
            time += PERIOD_NS;
            alarm.update(time, true, candidates.iter().copied())
        };
        assert!(step(&mut alarm, &[]).changed, "from off to standby");
        step(&mut alarm, &[at(9.0, 0.0)]);
        let state = step(&mut alarm, &[Candidate { track: 8, ..at(30.0, 0.0) }, at(9.0, 0.0)]);
        assert_eq!((state.level, state.track, state.changed), (AlarmLevel::Alarm, Some(7), true));
        assert_eq!((state.rule, state.nearest_m), (AlarmRule::Distance, Some(9.0)));
        // 11 m is beyond the limit, but not clearly.
        for _ in 0..20 {
            let state = step(&mut alarm, &[at(11.0, 0.0)]);
            assert_eq!((state.level, state.changed), (AlarmLevel::Alarm, false));
        }
        // Clearly gone: held for five frames more.
        for _ in 0..4 {
            let state = step(&mut alarm, &[at(12.0, 0.0)]);
            assert_eq!((state.level, state.rule), (AlarmLevel::Alarm, AlarmRule::Distance));
        }
        let state = step(&mut alarm, &[at(12.0, 0.0)]);
        assert_eq!((state.level, state.track, state.changed), (AlarmLevel::Standby, None, true));
        // A recording that starts anew is_held nothing over.
        step(&mut alarm, &[at(5.0, 0.0)]);
        step(&mut alarm, &[at(5.0, 0.0)]);
        assert_eq!(alarm.update(0, true, []).level, AlarmLevel::Standby);
    }

    #[test]
    fn what_is_beside_the_path_does_not_count() {
        let mut alarm = alarm();
        for frame in 0..5 {
            let both = [beside(3.5, at(5.0, 8.0)), beside(-2.2, at(5.0, 8.0))];
            let state = alarm.update(frame * PERIOD_NS, true, both);
            assert_eq!((state.level, state.nearest_m), (AlarmLevel::Standby, None));
        }
    }

    #[test]
    fn an_unsure_speed_raises_nothing_but_the_distance() {
        for wrong in [
            Candidate { seen: 5, ..at(20.0, 14.0) },
            Candidate { consecutive_frames: 2, ..at(20.0, 14.0) },
            Candidate { width_jitter: 0.8, ..at(20.0, 14.0) },
            Candidate {
                time_to_collision: Some(TimeToCollision { seconds: 1.4, sigma_s: 0.6 }),
                ..at(20.0, 14.0)
            },
        ] {
            let mut alarm = alarm();
            for frame in 0..5 {
                assert_eq!(alarm.update(frame * PERIOD_NS, true, [wrong]).level, AlarmLevel::Standby);
            }
        }
    }

    #[test]
    fn it_is_off_when_the_system_cannot_judge() {
        let mut alarm = alarm();
        for frame in 0..3 {
            alarm.update(frame * PERIOD_NS, true, [at(5.0, 0.0)]);
        }
        let state = alarm.update(3 * PERIOD_NS, false, [at(5.0, 0.0)]);
        assert_eq!((state.level, state.nearest_m, state.changed), (AlarmLevel::Off, None, true));
        assert!(!alarm.update(4 * PERIOD_NS, false, []).changed);
        // Afterwards it confirms anew.
        assert_eq!(alarm.update(5 * PERIOD_NS, true, [at(5.0, 0.0)]).level, AlarmLevel::Standby);
        assert_eq!(alarm.update(6 * PERIOD_NS, true, [at(5.0, 0.0)]).level, AlarmLevel::Alarm);
    }
}
