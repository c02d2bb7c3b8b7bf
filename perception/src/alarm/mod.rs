//! Collision alarm: three rules, four levels, with confirmation and hysteresis.
//!
//! Input: confirmed tracks as [`Candidate`]s (distance in m, closing speed in m/s, time to collision in s,
//! lateral motion) and the time of the frame in ns. Output: an [`AlarmState`] with level, rule, track and
//! reasons.
//!
//! Rules:
//!
//! - **Distance** (paper, section 4.3): an obstacle in the path is nearer than a preset distance.
//! - **Time to collision**: at constant closing speed the collision would occur within a preset time.
//! - **Deceleration**: avoiding the collision would need more than a preset deceleration, v²/(2z).
//!
//! Only an obstacle that is detected in the frame raises a level. One that is not detected keeps a level at most for the
//! hold time, counted from its last detection. A gap or a step back in time ([`crate::frame_clock`]) ends all levels.
//!
//! Where the vehicle's own motion is known ([`Alarm::update_on_path`]), distance, closing speed and time to collision are
//! along the strip that its body sweeps ([`swept`]), and the preset distance counts only for what is in that strip and
//! approached. Else the path is a straight strip ([`path`]).
//!
//! A level must be triggered in several consecutive frames before it is raised. Rules are evaluated ahead in
//! time by the duration of this confirmation, so that it causes no delay while motion continues unchanged. A
//! level is lowered only when its rule is missed by a margin, and not before a hold time has passed.

pub mod candidate;
pub mod path;
pub mod state;
pub mod swept;

use crate::frame_clock::{FrameClock, TimeStep};
use crate::motion::body::Body;
use crate::motion::path::SweptPath;
pub use candidate::Candidate;
pub use state::{AlarmLevel, AlarmRule, AlarmState};

/// Parameters of the alarm. A limit of 0 disables its rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlarmParameters {
    /// Alarm: distance below this, in metres.
    pub distance_m: f64,
    /// Where the own speed is known, the distance is at most the way driven within this time plus
    /// [`DISTANCE_AT_REST_M`], in seconds; 0 if it does not depend on the speed.
    pub distance_s: f64,
    /// Warning: time to collision below this, in seconds.
    pub ttc_warning_s: f64,
    /// Alarm: time to collision below this, in seconds.
    pub ttc_alarm_s: f64,
    /// Warning: required deceleration above this, in m/s².
    pub deceleration_warning_m_s2: f64,
    /// Alarm: required deceleration above this, in m/s².
    pub deceleration_alarm_m_s2: f64,
    /// Width of the vehicle's path, in metres; obstacles outside it are ignored.
    pub path_width_m: f64,
    /// Distance from the camera to the vehicle's front where the path is the straight strip, in metres; the swept path knows it.
    pub front_m: f64,
    /// Consecutive frames in which a rule must be triggered.
    pub confirm_frames: u32,
    /// Hysteresis: a raised level is kept while its limit is missed by less than this share.
    pub clear_share: f64,
    /// Shortest time for which a level is kept after its cause has ended, in ns.
    pub hold_ns: u64,
}

impl Default for AlarmParameters {
    fn default() -> Self {
        Self {
            distance_m: 10.0,
            distance_s: 2.0,
            ttc_warning_s: 2.6,
            ttc_alarm_s: 1.5,
            deceleration_warning_m_s2: 3.5,
            deceleration_alarm_m_s2: 5.0,
            path_width_m: 2.4,
            front_m: Body::default().front_m,
            confirm_frames: 2,
            clear_share: 0.15,
            hold_ns: 1_000_000_000,
        }
    }
}

/// The rules that need a closing speed require detections for this long, in seconds: the filter's first errors are then over
/// (with 0.56 s the silent scene `slope` warns),
const MIN_SEEN_S: f64 = 0.64;
/// and for this long where the gap is smaller than this, in metres: near, the first errors are small, and there is no time.
const MIN_SEEN_NEAR_S: f64 = 0.4;
/// See [`MIN_SEEN_NEAR_S`].
const NEAR_M: f64 = 20.0;
/// and also where the standard deviation of the time to collision is below this share of it,
const PRECISE_TTC_SIGMA_SHARE: f64 = 0.1;
/// and the thing is at least this wide, in metres, as vehicles are: oncoming traffic is seen late, and what is narrow may be another
/// thing in each frame;
const WIDE_M: f64 = 1.2;
/// the last of them consecutive for this long, in seconds, so that what is not always seen raises nothing,
const MIN_CONSECUTIVE_S: f64 = 0.32;
/// both at least this many frames, as a speed needs two, and its error a third,
const MIN_SPEED_FRAMES: f64 = 3.0;
/// a width that varies by less than this mean absolute log ratio (otherwise the region alternates between
/// objects),
const MAX_WIDTH_JITTER: f64 = 0.5;
/// a standard deviation of the time to collision below this share of it,
const MAX_TTC_SIGMA_SHARE: f64 = 0.3;
/// and a closing speed of at least this, in m/s: approaching a queue slowly is not dangerous.
const MIN_CLOSING_M_S: f64 = 1.0;
/// What comes from beside and may pass is warned of from this time before the collision on, in seconds: earlier its place then is hardly
/// known to half a metre, and drivers need 1.7 s.
const UNSURE_WARNING_S: f64 = 1.95;

/// What the preset distance is at rest if it depends on the speed, in metres from the camera: about the front of a car.
pub const DISTANCE_AT_REST_M: f64 = 2.0;

/// Memory of the frame period, in seconds: rates do not change faster, while single frames drop.
const PERIOD_MEMORY_S: f64 = 1.0;
/// Frame period before one is known, in seconds: that of 12.5 frames a second.
const INITIAL_PERIOD_S: f64 = 0.08;

/// Largest number of candidates.
const CAPACITY: usize = 128;

/// Consecutive frames in which a track triggered a rule of each level.
#[derive(Clone, Copy, Debug)]
struct RuleCounts {
    track: u32,
    warning: u32,
    alarm: u32,
    /// Of those of an alarm the last ones in which the distance counted, or the speed was known.
    near: u32,
}

/// What raised a level.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cause {
    level: AlarmLevel,
    rule: AlarmRule,
    candidate: Candidate,
}

/// The alarm as a state machine; the time is an argument.
#[derive(Clone, Debug)]
pub struct Alarm {
    parameters: AlarmParameters,
    level: AlarmLevel,
    rule: AlarmRule,
    track: Option<u32>,
    /// The level is held until this time.
    until_ns: u64,
    clock: FrameClock,
    /// The state of the previous frame.
    last: AlarmState,
    counts: Vec<RuleCounts>,
    before: Vec<RuleCounts>,
    /// The swept path of this frame, if it is known.
    path: Option<SweptPath>,
    /// Mean time from frame to frame, in seconds.
    period_s: f64,
}

impl Alarm {
    /// An alarm that is off.
    pub fn new(parameters: AlarmParameters) -> Self {
        Self {
            parameters,
            level: AlarmLevel::Off,
            rule: AlarmRule::None,
            track: None,
            until_ns: 0,
            clock: FrameClock::default(),
            last: AlarmState::default(),
            counts: Vec::with_capacity(CAPACITY),
            before: Vec::with_capacity(CAPACITY),
            path: None,
            period_s: INITIAL_PERIOD_S,
        }
    }

    /// Starts anew: the numbers of tracks mean others from now on.
    pub fn reset(&mut self) {
        // The level ends with the next frame, which then differs from the last one.
        (self.rule, self.track, self.until_ns) = (AlarmRule::None, None, 0);
        self.counts.clear();
    }

    /// Evaluates one frame on the straight strip. If `can_judge` is false, the alarm is off regardless of the candidates. No level is held
    /// over a gap or a step back in time; a repeated time adds nothing.
    pub fn update(
        &mut self,
        time_ns: u64,
        can_judge: bool,
        candidates: impl IntoIterator<Item = Candidate>,
    ) -> AlarmState {
        self.update_on_path(time_ns, can_judge, None, candidates)
    }

    /// The same on the path that the body sweeps; `None` if it is unknown.
    pub fn update_on_path(
        &mut self,
        time_ns: u64,
        can_judge: bool,
        path: Option<SweptPath>,
        candidates: impl IntoIterator<Item = Candidate>,
    ) -> AlarmState {
        self.path = path;
        let state = self.evaluate_frame(time_ns, can_judge, candidates);
        self.last = state;
        state
    }

    fn evaluate_frame(
        &mut self,
        time_ns: u64,
        can_judge: bool,
        candidates: impl IntoIterator<Item = Candidate>,
    ) -> AlarmState {
        let before = self.level;
        let step = self.clock.step(time_ns);
        if step.is_discontinuity() {
            self.silence(AlarmLevel::Clear);
        }
        if !can_judge {
            self.silence(AlarmLevel::Off);
            let changed = before != AlarmLevel::Off;
            return AlarmState { changed, ..AlarmState::default() };
        }
        if step == TimeStep::Repeated && before != AlarmLevel::Off {
            return AlarmState { changed: false, ..self.last };
        }
        let elapsed_s = step.elapsed_s();
        if elapsed_s > 0.0 {
            let gain = (elapsed_s / PERIOD_MEMORY_S).min(1.0);
            self.period_s += gain * (elapsed_s - self.period_s);
        }
        // Time by which rules are evaluated ahead: the duration of confirmation, or 0 after a gap.
        let lead = elapsed_s * f64::from(self.parameters.confirm_frames.saturating_sub(1));
        // On the swept path also what comes until the next frame, so that no limit is passed unseen.
        let lead = if self.path.is_some() { lead + elapsed_s } else { lead };
        let lead_s = if lead <= 0.5 { lead } else { 0.0 };
        std::mem::swap(&mut self.counts, &mut self.before);
        self.counts.clear();
        let mut nearest: Option<(f64, u32)> = None;
        let mut cause: Option<Cause> = None;
        for candidate in candidates.into_iter().take(CAPACITY) {
            if !candidate.is_finite() {
                continue;
            }
            let is_held = self.track == Some(candidate.track);
            let width_m = self.parameters.path_width_m;
            let Some(candidate) = candidate.in_the_way(self.path.as_ref(), width_m, is_held) else {
                continue;
            };
            let candidate = match self.path {
                Some(_) => candidate,
                None => candidate.seen_at_front(self.parameters.front_m),
            };
            if candidate.is_sure() && nearest.is_none_or(|(distance_m, _)| candidate.distance_m < distance_m)
            {
                nearest = Some((candidate.distance_m, candidate.track));
            }
            if let Some(of) = self.evaluate(&candidate, lead_s)
                && cause.is_none_or(|c| {
                    let sure = [candidate, c.candidate].map(|candidate| candidate.is_sure());
                    (of.level, sure[0], c.candidate.distance_m) > (c.level, sure[1], candidate.distance_m)
                })
            {
                cause = Some(of);
            }
        }
        self.set_level(time_ns, cause);
        // Values of the candidate, if it still is the cause.
        let now = cause.filter(|c| Some(c.candidate.track) == self.track).map(|c| c.candidate);
        AlarmState {
            level: self.level,
            rule: self.rule,
            track: self.track,
            object: self.track.or(nearest.map(|(_, track)| track)),
            is_held: self.track.is_some() && now.is_none(),
            changed: before != self.level,
            nearest_m: nearest.map(|(distance_m, _)| distance_m),
            time_to_collision: now.and_then(|c| c.time_to_collision),
            required_deceleration_m_s2: now.map_or(0.0, |c| c.required_deceleration_m_s2()),
        }
    }

    fn silence(&mut self, level: AlarmLevel) {
        (self.level, self.rule, self.track) = (level, AlarmRule::None, None);
        self.counts.clear();
    }

    /// Raises the level immediately, lowers it after the hold time.
    fn set_level(&mut self, time_ns: u64, cause: Option<Cause>) {
        let wanted = cause.map_or(AlarmLevel::Clear, |c| c.level);
        if wanted >= self.level || time_ns >= self.until_ns {
            self.level = wanted;
            self.rule = cause.map_or(AlarmRule::None, |c| c.rule);
            self.track = cause.map(|c| c.candidate.track);
            self.until_ns = cause.map_or(time_ns, |c| {
                let unseen_ns = (c.candidate.unseen_s * 1e9) as u64;
                time_ns.saturating_add(self.parameters.hold_ns.saturating_sub(unseen_ns))
            });
        }
    }

    /// Highest confirmed level of a candidate; updates its frame counts.
    fn evaluate(&mut self, candidate: &Candidate, lead_s: f64) -> Option<Cause> {
        let counts = self.before.iter().find(|t| t.track == candidate.track);
        let mut counts =
            counts.copied().unwrap_or(RuleCounts { track: candidate.track, warning: 0, alarm: 0, near: 0 });
        let is_held = |level| self.track == Some(candidate.track) && self.level >= level;
        // What keeps a warning because it may still be in the way raises no alarm.
        let may = candidate.is_sure() && (candidate.may_raise || is_held(AlarmLevel::Alarm));
        // A warning looks farther ahead than a turn that begins is known.
        let may_warn = is_held(AlarmLevel::Warning)
            || !self.can_wait(candidate, lead_s) && !self.path.is_some_and(|path| path.is_turning_in);
        let alarm = self
            .triggered_rule(candidate, AlarmLevel::Alarm, lead_s, is_held(AlarmLevel::Alarm))
            .filter(|_| may);
        let warning = self
            .triggered_rule(candidate, AlarmLevel::Warning, lead_s, is_held(AlarmLevel::Warning))
            .filter(|_| may_warn)
            .or(alarm);
        let is_known = self.is_known(candidate);
        // A distance that a speed predicts which is not yet known is confirmed by itself.
        let near =
            alarm.filter(|rule| *rule == AlarmRule::Distance || is_known || is_held(AlarmLevel::Alarm));
        for (count, rule) in
            [(&mut counts.alarm, alarm), (&mut counts.warning, warning), (&mut counts.near, near)]
        {
            *count = match rule {
                // An undetected track does not add to the count, but does not reset it either.
                Some(_) => count.saturating_add(u32::from(candidate.is_detected())),
                None => 0,
            };
        }
        self.counts.push(counts);
        let needed = self.parameters.confirm_frames;
        // Frames that confirm a rule count before the speed is known for long enough: both go on at the same time.
        let cause = |level, rule: Option<AlarmRule>, count: u32| {
            rule.filter(|rule| match rule {
                AlarmRule::Distance => counts.near >= needed,
                _ => count >= needed && (is_known || is_held(level)),
            })
            .map(|rule| Cause { level, rule, candidate: *candidate })
        };
        // What has come within the preset distance meanwhile is as urgent by its speed as before.
        let by_speed = || {
            self.rule_by_speed(candidate, AlarmLevel::Alarm, lead_s, is_held(AlarmLevel::Alarm))
                .filter(|_| may)
        };
        cause(AlarmLevel::Alarm, alarm, counts.alarm)
            .or_else(|| cause(AlarmLevel::Alarm, by_speed(), counts.alarm))
            .or_else(|| cause(AlarmLevel::Warning, warning, counts.warning))
    }

    /// Whether stopping before it needs a higher deceleration than that of a warning.
    fn is_braking_hard(&self, c: &Candidate) -> bool {
        let limit = self.parameters.deceleration_warning_m_s2;
        limit > 0.0 && c.required_deceleration_m_s2() > limit
    }

    /// Whether a warning of what comes from beside can wait until its place at the arrival is known better: while there is time, and the
    /// brakes need not be used hard.
    fn can_wait(&self, c: &Candidate, lead_s: f64) -> bool {
        let seconds = c.time_to_collision.map_or(f64::INFINITY, |ttc| ttc.seconds);
        c.is_unsure && seconds - Self::lead_s(c, lead_s, false) > UNSURE_WARNING_S && !self.is_braking_hard(c)
    }

    /// The preset distance at the own speed, in metres.
    fn distance_limit_m(&self) -> f64 {
        let AlarmParameters { distance_m, distance_s, .. } = self.parameters;
        match self.path {
            Some(path) if distance_s > 0.0 => {
                distance_m.min(path.speed_m_s.max(0.0) * distance_s + DISTANCE_AT_REST_M)
            }
            _ => distance_m,
        }
    }

    /// Whether so many frames are detections for at least these seconds.
    fn lasts(&self, frames: u32, seconds: f64) -> bool {
        // Half a frame less: times of frames jitter.
        f64::from(frames) + 0.5 >= (seconds / self.period_s).max(MIN_SPEED_FRAMES)
    }

    /// Whether a candidate has been seen for so long that its speed is known.
    fn is_known(&self, c: &Candidate) -> bool {
        let is_precise = c.motion.width_m >= WIDE_M
            && c.time_to_collision.is_some_and(|ttc| ttc.sigma_s <= PRECISE_TTC_SIGMA_SHARE * ttc.seconds);
        let seen_s = if c.gap_m < NEAR_M || is_precise { MIN_SEEN_NEAR_S } else { MIN_SEEN_S };
        self.lasts(c.seen, seen_s) && self.lasts(c.consecutive_frames, MIN_CONSECUTIVE_S)
    }

    /// Rule of a level that a candidate triggers, evaluated `lead_s` ahead. `is_held`: the candidate already
    /// holds the level, so the limits include the hysteresis.
    fn triggered_rule(
        &self,
        c: &Candidate,
        level: AlarmLevel,
        lead_s: f64,
        is_held: bool,
    ) -> Option<AlarmRule> {
        let hysteresis = if is_held { 1.0 + self.parameters.clear_share } else { 1.0 };
        let distance_m = c.distance_m - Self::closing_m_s(c) * Self::lead_s(c, lead_s, is_held);
        let limit_m = self.distance_limit_m();
        let is_near = c.is_approached
            && limit_m > 0.0
            && distance_m < limit_m * hysteresis
            && level == AlarmLevel::Alarm;
        if is_near { Some(AlarmRule::Distance) } else { self.rule_by_speed(c, level, lead_s, is_held) }
    }

    /// Closing speed of a candidate, in m/s; 0 if it does not approach significantly.
    fn closing_m_s(c: &Candidate) -> f64 {
        if c.time_to_collision.is_some() { c.closing_m_s } else { 0.0 }
    }

    /// How far ahead a candidate is judged, in seconds: what is not seen, or holds a level, as it is.
    fn lead_s(c: &Candidate, lead_s: f64, is_held: bool) -> f64 {
        if c.is_detected() && !is_held { lead_s } else { 0.0 }
    }

    /// The rule by TTC or deceleration that a candidate triggers; arguments as for [`Self::triggered_rule`].
    fn rule_by_speed(
        &self,
        c: &Candidate,
        level: AlarmLevel,
        lead_s: f64,
        is_held: bool,
    ) -> Option<AlarmRule> {
        let p = &self.parameters;
        let hysteresis = if is_held { 1.0 + p.clear_share } else { 1.0 };
        let (closing, lead_s) = (Self::closing_m_s(c), Self::lead_s(c, lead_s, is_held));
        let ttc = c.time_to_collision?;
        let is_clear = c.width_jitter <= MAX_WIDTH_JITTER
            && ttc.sigma_s <= MAX_TTC_SIGMA_SHARE * ttc.seconds
            && c.closing_m_s >= MIN_CLOSING_M_S;
        if !is_clear && !is_held {
            return None;
        }
        let (ttc_s, deceleration) = match level {
            AlarmLevel::Alarm => (p.ttc_alarm_s, p.deceleration_alarm_m_s2),
            _ => (p.ttc_warning_s, p.deceleration_warning_m_s2),
        };
        if ttc_s > 0.0 && ttc.seconds - lead_s < ttc_s * hysteresis {
            return Some(AlarmRule::TimeToCollision);
        }
        let needed = c.required_deceleration_m_s2() * c.gap_m / (c.gap_m - closing * lead_s).max(0.1);
        (deceleration > 0.0 && needed > deceleration / hysteresis).then_some(AlarmRule::Deceleration)
    }
}

#[cfg(test)]
mod drives;

#[cfg(test)]
mod tests;

#[cfg(test)]
mod waiting_tests;
