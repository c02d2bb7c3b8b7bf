//! Rules by which a warning and an alarm count, and the braking model behind them.
//!
//! Times are in seconds from the start of a run. "TTC" is the time until the impact that happens if we drive on at the
//! same speed.

use serde::Serialize;

/// A warning at this TTC or more counts in time, in seconds. A protocol's number for the tests of warnings alone, ours for
/// the others.
pub const WARNING_TTC_S: f64 = 1.7;

/// What is reported at a TTC of more than this is false, in seconds: nothing is urgent yet. Ours.
pub const MAX_TTC_S: f64 = 4.0;

/// Deceleration of the braking that an alarm leads to, in m/s². Ours.
pub const BRAKE_M_S2: f64 = 8.0;

/// Time in which that deceleration builds up, evenly, in seconds. Ours.
pub const BUILD_UP_S: f64 = 0.3;

/// Where an alarm cannot avoid the impact, it counts if at least this share of the impact's speed is gone. Ours.
pub const MIN_SPEED_SHARE: f64 = 0.5;

/// Time from when the danger can be known to when a report can be asked for, in seconds: half a dozen pictures. Ours.
pub const SEEING_S: f64 = 0.5;

/// Step of the braking model, in seconds.
const STEP_S: f64 = 2e-3;

/// How long after the planned impact one is looked for, in seconds.
const AFTER_S: f64 = 4.0;

/// The rules in words, with their origin.
pub const TEXT: &str = "\
w1.7*  a warning at a TTC of 1.7 s or more (* protocol: rows that test the warning alone)
w1.7   the same, our rule
avoid  an alarm from which braking at 8 m/s2 with 0.3 s of build-up avoids the impact (ours)
halve  an alarm from which that braking takes half of the impact's speed off, where the target
       can be known too late for more (ours)
-      not asked for: the target can be known less than 0.5 s before the limit (ours)
A warning or an alarm at a TTC of more than 4 s is false (ours). Near misses must be silent (ours).
Speeds, targets and places of impact are those of the protocol's public descriptions; radii of
turns with a pedestrian, distances of parked cars and near misses are ours.";

/// An encounter with a target.
#[derive(Clone, Copy)]
pub struct Encounter<'a> {
    /// Our speed before braking, in m/s.
    pub own_m_s: f64,
    /// Time of the impact if we drive on, in seconds.
    pub impact_s: f64,
    /// Whether both touch when we have driven so far, in metres, at a time.
    pub touches: &'a dyn Fn(f64, f64) -> bool,
    /// The target's speed in our direction, by our way and the time, in m/s.
    pub target_m_s: &'a dyn Fn(f64, f64) -> f64,
}

/// Way that is driven, in metres, and speed, in m/s, after braking for a time.
pub fn braked(own_m_s: f64, braking_s: f64) -> (f64, f64) {
    if braking_s <= 0.0 {
        return (own_m_s * braking_s, own_m_s);
    }
    let jerk = BRAKE_M_S2 / BUILD_UP_S;
    // Slow vehicles stand before the brake has built up.
    let build_up_s = BUILD_UP_S.min((2.0 * own_m_s / jerk).sqrt());
    let ramp_s = braking_s.min(build_up_s);
    let way_m = own_m_s * ramp_s - jerk * ramp_s.powi(3) / 6.0;
    let speed = own_m_s - 0.5 * jerk * ramp_s * ramp_s;
    let rest_s = (braking_s - ramp_s).min(speed.max(0.0) / BRAKE_M_S2);
    (way_m + speed * rest_s - 0.5 * BRAKE_M_S2 * rest_s * rest_s, (speed - BRAKE_M_S2 * rest_s).max(0.0))
}

impl Encounter<'_> {
    /// Speed at which we meet the target, in m/s, if we brake from a time on, or never; 0 if we do not meet it, or if
    /// it meets us while we stand.
    pub fn impact_m_s(&self, brake_s: Option<f64>) -> f64 {
        let from = brake_s.unwrap_or(f64::INFINITY);
        let count = ((self.impact_s + AFTER_S) / STEP_S) as u32;
        for step in 0..=count {
            let time = f64::from(step) * STEP_S;
            let (since_m, speed) =
                if time > from { braked(self.own_m_s, time - from) } else { (0.0, self.own_m_s) };
            if speed <= 0.0 {
                return 0.0;
            }
            let way_m = self.own_m_s * time.min(from) + since_m;
            if (self.touches)(way_m, time) {
                return (speed - (self.target_m_s)(way_m, time)).max(0.0);
            }
        }
        0.0
    }

    /// What can be asked for, if the danger can be known from a time on.
    pub fn due(&self, known_s: f64) -> Due {
        let best_s = (known_s + SEEING_S).max(self.impact_s - MAX_TTC_S);
        let (free, best) = (self.impact_m_s(None), self.impact_m_s(Some(best_s)));
        let alarm = if best <= 0.0 {
            Some(AlarmDue::Avoid)
        } else {
            (best <= (1.0 - MIN_SPEED_SHARE) * free).then_some(AlarmDue::Halve)
        };
        Due { warning: self.impact_s - best_s >= WARNING_TTC_S, alarm }
    }
}

/// What an alarm has to reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AlarmDue {
    /// No impact.
    Avoid,
    /// Half of its speed.
    Halve,
}

/// What can be asked for in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Due {
    /// Whether a warning in time is possible.
    pub warning: bool,
    /// What an alarm can reach; `None` where the target can be known too late even for half.
    pub alarm: Option<AlarmDue>,
}

/// Times at which levels were raised because of the target, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Raised {
    /// Warning, or alarm without one before.
    pub warning_s: Option<f64>,
    /// Alarm.
    pub alarm_s: Option<f64>,
    /// A level because of something else.
    pub other_s: Option<f64>,
}

/// The judgement of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdict {
    /// Whether it passed; `None` where nothing can be asked for.
    pub passed: Option<bool>,
    /// Speed at the impact without braking, in m/s.
    pub free_impact_m_s: f64,
    /// The same with braking from the alarm on.
    pub impact_m_s: f64,
    /// Why it failed, or why it is not judged.
    pub reasons: Vec<String>,
}

/// Judges a run. `is_warning_only`: the alarm is not judged.
pub fn judge(encounter: &Encounter<'_>, due: Due, raised: &Raised, is_warning_only: bool) -> Verdict {
    let free = encounter.impact_m_s(None);
    let impact = raised.alarm_s.map_or(free, |alarm_s| encounter.impact_m_s(Some(alarm_s)));
    let ttc = |time: f64| encounter.impact_s - time;
    let mut reasons = Vec::new();
    for (what, time) in [("warning", raised.warning_s), ("alarm", raised.alarm_s)] {
        if let Some(early) = time.map(ttc).filter(|&ttc| ttc > MAX_TTC_S) {
            reasons.push(format!("{what} too early, TTC {early:.2} s"));
        }
    }
    if let Some(other) = raised.other_s {
        reasons.push(format!("warned of something else, TTC {:.2} s", ttc(other)));
    }
    if due.warning {
        match raised.warning_s.map(ttc) {
            None => reasons.push("no warning".into()),
            Some(ttc) if ttc < WARNING_TTC_S => reasons.push(format!("warning late, TTC {ttc:.2} s")),
            Some(_) => {}
        }
    }
    let alarm_due = due.alarm.filter(|_| !is_warning_only);
    let enough = |due| match due {
        AlarmDue::Avoid => impact <= 0.0,
        AlarmDue::Halve => impact <= (1.0 - MIN_SPEED_SHARE) * free,
    };
    if let Some(wanted) = alarm_due.filter(|&wanted| !enough(wanted)) {
        let what = if wanted == AlarmDue::Avoid { "avoid the impact" } else { "halve its speed" };
        reasons.push(match raised.alarm_s.map(ttc) {
            None => "no alarm".into(),
            Some(ttc) => format!("alarm too late to {what}, TTC {ttc:.2} s"),
        });
    }
    let is_judged = due.warning || alarm_due.is_some() || !reasons.is_empty();
    let passed = is_judged.then_some(reasons.is_empty());
    if !is_judged {
        reasons.push("the target can be known too late for any rule".into());
    }
    Verdict { passed, free_impact_m_s: free, impact_m_s: impact, reasons }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall, met at 20 m/s after 5 s.
    fn wall<R>(with: impl Fn(&Encounter<'_>) -> R) -> R {
        let (touches, target_m_s) = (|way_m: f64, _: f64| way_m >= 100.0, |_: f64, _: f64| 0.0);
        with(&Encounter { own_m_s: 20.0, impact_s: 5.0, touches: &touches, target_m_s: &target_m_s })
    }

    #[test]
    fn braking_is_that_of_the_closed_form() {
        // Built up after 0.3 s: 1.2 m/s slower, 0.12 m behind. Then v²/2a.
        let (way, speed) = braked(20.0, 0.3);
        assert!((way - (6.0 - 0.12)).abs() < 1e-12 && (speed - 18.8).abs() < 1e-12);
        let (way, speed) = braked(20.0, 60.0);
        assert!((way - (5.88 + 18.8 * 18.8 / 16.0)).abs() < 1e-9 && speed == 0.0, "{way}");
        // It never drives back, and a slow one stands before the brake has built up.
        assert_eq!(braked(20.0, 3.0).0, braked(20.0, 2.65).0);
        let (way, speed) = braked(0.5, 10.0);
        assert!(speed < 1e-9 && way > 0.0 && way < 0.5 * 0.3, "{way} {speed}");
        assert_eq!(braked(20.0, -1.0), (-20.0, 20.0));
    }

    #[test]
    fn the_speed_at_impact_is_that_of_the_closed_form() {
        wall(|wall| {
            assert_eq!(wall.impact_m_s(None), 20.0);
            // From 100 m - 27.97 m on it stops in time: 3.6015 s.
            assert_eq!(wall.impact_m_s(Some(3.59)), 0.0);
            let late = wall.impact_m_s(Some(3.62));
            assert!(late > 0.0 && late < 3.0, "{late}");
            // 10 m before: 5.88 m in the build-up, then 18.8² - 2·8·4.12.
            let expected = (18.8_f64 * 18.8 - 16.0 * 4.12).sqrt();
            assert!((wall.impact_m_s(Some(4.5)) - expected).abs() < 0.05, "{}", wall.impact_m_s(Some(4.5)));
        });
    }

    #[test]
    fn who_has_left_the_path_is_not_hit_and_a_leader_is_hit_by_the_difference() {
        // Somebody is in the way from 4.8 s to 5.4 s, 100 m ahead.
        let touches = |way_m: f64, time: f64| way_m >= 100.0 && (4.8..5.4).contains(&time);
        let still = |_: f64, _: f64| 0.0;
        let walker = Encounter { own_m_s: 20.0, impact_s: 5.0, touches: &touches, target_m_s: &still };
        assert_eq!(walker.impact_m_s(None), 20.0);
        // Too late to stop (3.60 s), but the walker has gone when we arrive: 99.6 m at 5.4 s.
        assert_eq!(walker.impact_m_s(Some(3.8)), 0.0);
        assert!(walker.impact_m_s(Some(3.95)) > 5.0);
        assert!(walker.impact_m_s(Some(4.9)) > 18.0);
        let touches = |way_m: f64, time: f64| way_m >= 50.0 + 10.0 * time;
        let leads = |_: f64, _: f64| 10.0;
        let leader = Encounter { own_m_s: 20.0, impact_s: 5.0, touches: &touches, target_m_s: &leads };
        assert_eq!(leader.impact_m_s(None), 10.0);
        // It is as fast as the leader before it is there.
        assert_eq!(leader.impact_m_s(Some(4.1)), 0.0);
    }

    #[test]
    fn what_is_asked_for_depends_on_when_it_can_be_known() {
        wall(|wall| {
            let due = |known_s| wall.due(known_s);
            assert_eq!(due(0.0), Due { warning: true, alarm: Some(AlarmDue::Avoid) });
            // Seen at a TTC of 2.1 s: a warning could come at 1.6 s.
            assert_eq!(due(2.9), Due { warning: false, alarm: Some(AlarmDue::Avoid) });
            assert_eq!(due(3.4), Due { warning: false, alarm: Some(AlarmDue::Halve) });
            assert_eq!(due(4.4), Due { warning: false, alarm: None });
        });
    }

    #[test]
    fn reports_pass_in_time_and_fail_when_late_early_or_missing() {
        wall(|wall| {
            let due = wall.due(0.0);
            let judged = |warning_s: Option<f64>, alarm_s: Option<f64>, only| {
                judge(wall, due, &Raised { warning_s, alarm_s, other_s: None }, only)
            };
            let good = judged(Some(2.5), Some(3.5), false);
            assert_eq!((good.passed, good.impact_m_s, good.reasons.len()), (Some(true), 0.0, 0));
            for (warning, alarm, only, why) in [
                (Some(3.4), Some(3.5), false, "warning late, TTC 1.60 s"),
                (Some(0.9), Some(3.5), false, "warning too early, TTC 4.10 s"),
                (Some(2.5), Some(3.9), false, "alarm too late to avoid the impact, TTC 1.10 s"),
                (Some(2.5), None, false, "no alarm"),
                (None, None, true, "no warning"),
            ] {
                let verdict = judged(warning, alarm, only);
                assert_eq!((verdict.passed, &verdict.reasons[0][..]), (Some(false), why));
            }
            assert_eq!(judged(Some(2.5), None, true).passed, Some(true), "the alarm is not judged");
            let other = Raised { warning_s: Some(2.5), alarm_s: Some(3.5), other_s: Some(1.5) };
            let verdict = judge(wall, due, &other, false);
            assert_eq!(verdict.reasons, ["warned of something else, TTC 3.50 s"]);
            // Half of the speed is enough where more is impossible, and nothing where nothing is possible.
            let late = wall.due(3.4);
            let alarm = |alarm_s| Raised { warning_s: Some(alarm_s), alarm_s: Some(alarm_s), other_s: None };
            assert_eq!(judge(wall, late, &alarm(3.9), false).passed, Some(true));
            assert_eq!(judge(wall, late, &alarm(4.5), false).passed, Some(false));
            assert_eq!(judge(wall, wall.due(4.4), &Raised::default(), false).passed, None);
        });
    }
}
