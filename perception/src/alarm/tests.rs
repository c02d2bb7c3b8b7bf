use super::path::LateralMotion;
use super::*;
use crate::tracking::filter::TimeToCollision;

const PERIOD_NS: u64 = 80_000_000;

/// An obstacle in the path with a known closing speed.
fn at(distance_m: f64, closing_m_s: f64) -> Candidate {
    Candidate {
        track: 7,
        seen: 20,
        consecutive_frames: 20,
        unseen_s: 0.0,
        width_jitter: 0.1,
        distance_m,
        gap_m: distance_m,
        closing_m_s,
        time_to_collision: (closing_m_s > 0.5)
            .then(|| TimeToCollision { seconds: distance_m / closing_m_s, sigma_s: 0.05 }),
        motion: LateralMotion { speed_sigma_m_s: 0.1, width_m: 1.8, ..LateralMotion::default() },
        ground: None,
        ..Candidate::default()
    }
}

fn beside(lateral_m: f64, candidate: Candidate) -> Candidate {
    Candidate { motion: LateralMotion { lateral_m, ..candidate.motion }, ..candidate }
}

fn alarm() -> Alarm {
    Alarm::new(AlarmParameters { hold_ns: 5 * PERIOD_NS, ..AlarmParameters::default() })
}

/// Approaches an obstacle from `from_m` at constant speed. Returns distance and rule of the first warning
/// and of the first alarm.
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
fn a_candidate_with_a_number_that_is_none_is_ignored() {
    let good = at(30.0, 0.0);
    for bad in [
        Candidate { distance_m: f64::NAN, ..good },
        Candidate { closing_m_s: f64::INFINITY, ..good },
        Candidate { motion: LateralMotion { width_m: f64::INFINITY, ..good.motion }, ..good },
        Candidate { time_to_collision: Some(TimeToCollision { seconds: f64::NAN, sigma_s: 0.1 }), ..good },
    ] {
        let mut alarm = alarm();
        for frame in 1..6 {
            let state = alarm.update(frame * PERIOD_NS, true, [bad]);
            assert_eq!((state.level, state.nearest_m), (AlarmLevel::Clear, None), "{bad:?}");
            let state = alarm.update(frame * PERIOD_NS + PERIOD_NS / 2, true, [bad, good]);
            assert_eq!(state.nearest_m, Some(30.0), "{bad:?}");
        }
    }
}

#[test]
fn a_limit_of_0_disables_its_rule_at_any_distance() {
    let none = AlarmParameters {
        distance_m: 0.0,
        ttc_warning_s: 0.0,
        ttc_alarm_s: 0.0,
        deceleration_warning_m_s2: 0.0,
        deceleration_alarm_m_s2: 0.0,
        ..AlarmParameters::default()
    };
    let mut alarm = Alarm::new(none);
    for frame in 0..10 {
        // So near that the predicted distance is negative.
        let state = alarm.update(frame * PERIOD_NS, true, [at(1.0, 20.0)]);
        assert!(state.level < AlarmLevel::Warning, "{state:?}");
    }
}

#[test]
fn each_rule_fires_at_its_limit() {
    let p = AlarmParameters::default();
    // 5 m/s: a warning at 2.6 s from the front, which is 1.7 m ahead of the camera, the alarm at 10 m, no later than the first frame inside.
    let [warning, alarm] = drive(40.0, 5.0, p);
    let (z, rule) = warning.unwrap();
    assert!((z - 1.7) / 5.0 <= 2.68 && (z - 1.7) / 5.0 > 2.5 && rule == AlarmRule::TimeToCollision, "{z}");
    let (z, rule) = alarm.unwrap();
    assert!(z <= 10.4 && z > 9.6 && rule == AlarmRule::Distance, "{z}");
    // 14 m/s: time to collision only.
    let [warning, alarm] = drive(60.0, 14.0, p);
    assert!((warning.unwrap().0 - 1.7) / 14.0 > 2.5, "{warning:?}");
    let (z, rule) = alarm.unwrap();
    assert!((1.3..1.5).contains(&((z - 1.7) / 14.0)) && rule == AlarmRule::TimeToCollision, "{z}");
    // 30 m/s without a limit on the time: 5 m/s² are needed from 92 m on, 3.5 from 130 m.
    let p = AlarmParameters { ttc_warning_s: 0.0, ttc_alarm_s: 0.0, ..p };
    let [warning, alarm] = drive(200.0, 30.0, p);
    assert!((125.0..133.0).contains(&warning.unwrap().0), "{warning:?}");
    let (z, rule) = alarm.unwrap();
    assert!((88.0..94.5).contains(&z) && rule == AlarmRule::Deceleration, "{z}");
}

#[test]
fn a_level_waits_until_the_speed_is_known_and_is_confirmed_meanwhile() {
    // Sightings at a gap below 20 m, or of something wide whose time to collision is precise: 0.4 s; else 0.64 s. The last of them is the
    // second that triggers the rule.
    for (from_m, closing_m_s, sigma_s, width_m, sightings) in [
        (18.0, 8.0, 0.05, 0.6, 5),
        (30.0, 14.0, 0.05, 1.8, 5),
        (30.0, 14.0, 0.3, 1.8, 8),
        (30.0, 14.0, 0.05, 0.6, 8),
    ] {
        let mut alarm = alarm();
        let first = (1..20).find(|&seen| {
            let z = from_m - closing_m_s * 0.08 * f64::from(seen - 1);
            let like = at(z, closing_m_s);
            let new = Candidate {
                seen,
                consecutive_frames: seen,
                motion: LateralMotion { width_m, ..like.motion },
                time_to_collision: like.time_to_collision.map(|ttc| TimeToCollision { sigma_s, ..ttc }),
                ..like
            };
            alarm.update(u64::from(seen) * PERIOD_NS, true, [new]).level > AlarmLevel::Clear
        });
        assert_eq!(first, Some(sightings), "from {from_m} m, {sigma_s} s, {width_m} m wide");
    }
}

#[test]
fn a_distance_is_not_confirmed_by_a_speed_that_is_not_yet_known() {
    let mut alarm = alarm();
    let levels = [(11.5, 2), (9.0, 3), (8.0, 4)].map(|(z, seen)| {
        let new = Candidate { seen, consecutive_frames: seen, ..at(z, 11.0) };
        alarm.update(u64::from(seen) * PERIOD_NS, true, [new]).level
    });
    assert_eq!(levels, [AlarmLevel::Clear, AlarmLevel::Clear, AlarmLevel::Alarm]);
}

#[test]
fn one_frame_raises_nothing() {
    let mut alarm = alarm();
    for frame in 0..20 {
        let z = if frame == 10 { 4.0 } else { 30.0 };
        let state = alarm.update(frame * PERIOD_NS, true, [at(z, 0.0)]);
        assert_eq!(state.level, AlarmLevel::Clear, "frame {frame}");
    }
    // An undetected new track confirms nothing either.
    let gone = Candidate { consecutive_frames: 0, seen: 4, ..at(4.0, 0.0) };
    for frame in 20..25 {
        assert_eq!(alarm.update(frame * PERIOD_NS, true, [gone]).level, AlarmLevel::Clear);
    }
}

#[test]
fn a_level_is_held_cleared_with_hysteresis_and_reports_changes() {
    let mut alarm = alarm();
    let mut time = 0;
    let mut step = |alarm: &mut Alarm, candidates: &[Candidate]| {
        time += PERIOD_NS;
        alarm.update(time, true, candidates.iter().copied())
    };
    assert!(step(&mut alarm, &[]).changed, "from off to clear");
    step(&mut alarm, &[at(9.0, 0.0)]);
    let state = step(&mut alarm, &[Candidate { track: 8, ..at(30.0, 0.0) }, at(9.0, 0.0)]);
    assert_eq!((state.level, state.track, state.changed), (AlarmLevel::Alarm, Some(7), true));
    assert_eq!((state.rule, state.nearest_m, state.object), (AlarmRule::Distance, Some(9.0), Some(7)));
    // 11 m is beyond the limit, but within the hysteresis.
    for _ in 0..20 {
        let state = step(&mut alarm, &[at(11.0, 0.0)]);
        assert_eq!((state.level, state.changed, state.is_held), (AlarmLevel::Alarm, false, false));
    }
    // Beyond the hysteresis: held for five more frames.
    for _ in 0..4 {
        let state = step(&mut alarm, &[at(12.0, 0.0)]);
        assert_eq!((state.level, state.rule, state.is_held), (AlarmLevel::Alarm, AlarmRule::Distance, true));
    }
    let state = step(&mut alarm, &[at(12.0, 0.0)]);
    assert_eq!((state.level, state.track, state.object), (AlarmLevel::Clear, None, Some(7)));
    assert!(state.changed && !state.is_held);
    // New tracks: nothing is held, and that it ended is told.
    step(&mut alarm, &[at(5.0, 0.0)]);
    assert_eq!(step(&mut alarm, &[at(5.0, 0.0)]).level, AlarmLevel::Alarm);
    alarm.reset();
    let state = step(&mut alarm, &[at(5.0, 0.0)]);
    assert_eq!((state.level, state.changed, state.is_held), (AlarmLevel::Clear, true, false));
    // A restarted recording holds nothing over.
    step(&mut alarm, &[at(5.0, 0.0)]);
    step(&mut alarm, &[at(5.0, 0.0)]);
    assert_eq!(alarm.update(0, true, []).level, AlarmLevel::Clear);
}

#[test]
fn obstacles_outside_the_path_are_ignored() {
    let mut alarm = alarm();
    for frame in 0..5 {
        let both = [beside(3.5, at(5.0, 8.0)), beside(-2.2, at(5.0, 8.0))];
        let state = alarm.update(frame * PERIOD_NS, true, both);
        assert_eq!((state.level, state.nearest_m), (AlarmLevel::Clear, None));
    }
}

#[test]
fn an_uncertain_speed_triggers_no_rule_that_needs_it() {
    for wrong in [
        Candidate { seen: 3, ..at(20.0, 14.0) },
        Candidate { consecutive_frames: 2, ..at(20.0, 14.0) },
        Candidate { width_jitter: 0.8, ..at(20.0, 14.0) },
        Candidate {
            time_to_collision: Some(TimeToCollision { seconds: 1.4, sigma_s: 0.6 }),
            ..at(20.0, 14.0)
        },
    ] {
        let mut alarm = alarm();
        for frame in 0..5 {
            assert_eq!(alarm.update(frame * PERIOD_NS, true, [wrong]).level, AlarmLevel::Clear);
        }
    }
}

#[test]
fn the_alarm_is_off_when_the_system_cannot_judge() {
    let mut alarm = alarm();
    for frame in 0..3 {
        alarm.update(frame * PERIOD_NS, true, [at(5.0, 0.0)]);
    }
    let state = alarm.update(3 * PERIOD_NS, false, [at(5.0, 0.0)]);
    assert_eq!((state.level, state.nearest_m, state.changed), (AlarmLevel::Off, None, true));
    assert!(!alarm.update(4 * PERIOD_NS, false, []).changed);
    // Confirmation starts again afterwards.
    assert_eq!(alarm.update(5 * PERIOD_NS, true, [at(5.0, 0.0)]).level, AlarmLevel::Clear);
    assert_eq!(alarm.update(6 * PERIOD_NS, true, [at(5.0, 0.0)]).level, AlarmLevel::Alarm);
}

#[test]
fn what_enters_the_strip_within_the_preset_distance_is_as_urgent_by_its_speed_as_before() {
    // A child from the side, seen from 12.9 m on; in the frame in which its speed is known it is in the strip for the first time.
    let mut alarm = alarm();
    let causes = [1, 2, 3, 4, 5].map(|seen| {
        let z = 12.9 - 11.0 * 0.08 * f64::from(seen - 1);
        let child = Candidate {
            seen,
            consecutive_frames: seen,
            is_approached: seen == 5,
            may_raise: true,
            ..at(z, 11.0)
        };
        let cause = alarm.evaluate(&child, 0.08);
        std::mem::swap(&mut alarm.before, &mut alarm.counts);
        alarm.counts.clear();
        cause.map(|cause| (cause.level, cause.rule))
    });
    assert_eq!(causes[..4], [None; 4]);
    assert_eq!(causes[4], Some((AlarmLevel::Alarm, AlarmRule::TimeToCollision)));
}
