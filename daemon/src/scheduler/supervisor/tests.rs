//! Tests of the supervisor by example; `properties` has random tests.

mod properties;

use super::*;

const S: u64 = 1_000_000_000;
/// The defaults of the configuration.
pub const PARAMETERS: SupervisorParameters = SupervisorParameters {
    startup_deadline_ns: 10 * S,
    liveness_deadline_ns: 5 * S,
    restart_first_ns: S,
    restart_longest_ns: 30 * S,
    restart_count: 5,
    restart_window_ns: 300 * S,
    retry_ns: 600 * S,
    stop_grace_ns: 5 * S,
};

/// Ticks every half second up to `to`; the last answer counts, the others must be empty.
fn tick_until(supervisor: &mut Supervisor, to: u64) -> Vec<Action> {
    while supervisor.last_tick_ns + S / 2 < to {
        let at = supervisor.last_tick_ns + S / 2;
        assert_eq!(supervisor.tick(at), [], "at {at}");
    }
    supervisor.tick(to)
}

fn started() -> Supervisor {
    let mut supervisor = Supervisor::new(PARAMETERS, &[Role::Stereo, Role::Road], 0);
    assert_eq!(supervisor.tick(0), [Action::Spawn(Role::Stereo), Action::Spawn(Role::Road)]);
    for role in [Role::Stereo, Role::Road] {
        supervisor.spawned(role, 0);
        supervisor.reported(role, S);
    }
    assert!(supervisor.all_running());
    supervisor
}

#[test]
fn a_deadline_of_the_pipeline_table_replaces_the_configured_one() {
    assert_eq!(deadline_ns(None, 5 * S), 5 * S);
    assert_eq!(deadline_ns(Some(1500), 5 * S), S + S / 2);
}

#[test]
fn a_killed_stage_is_restarted_after_a_wait_that_doubles() {
    let mut supervisor = started();
    let mut now = 2 * S;
    for wait in [1, 2, 4, 8, 16] {
        assert_eq!(supervisor.exited(Role::Stereo, "was killed", now), None);
        supervisor.reported(Role::Road, now + wait * S - 1);
        assert_eq!(tick_until(&mut supervisor, now + wait * S - 1), [], "{wait}");
        now += wait * S;
        supervisor.reported(Role::Road, now);
        assert_eq!(tick_until(&mut supervisor, now), [Action::Spawn(Role::Stereo)]);
        supervisor.spawned(Role::Stereo, now);
        supervisor.reported(Role::Stereo, now);
    }
    assert_eq!(supervisor.restarts(Role::Stereo), 5);
    // The sixth failure within the window is one too many.
    let Some(Action::GiveUp(Role::Stereo, reason)) = supervisor.exited(Role::Stereo, "was killed", now)
    else {
        panic!("not given up")
    };
    assert!(reason.contains("stereo failed 6 times in 300 s"), "{reason}");
    assert_eq!(supervisor.given_up(), Some(Role::Stereo));
    supervisor.reported(Role::Road, now + 3 * S);
    assert_eq!(tick_until(&mut supervisor, now + 3 * S), []);
}

#[test]
fn old_failures_are_forgotten_after_the_window() {
    let mut supervisor = started();
    for round in 0..20_u64 {
        let now = round * 100 * S;
        assert_eq!(supervisor.exited(Role::Stereo, "exited", now), None, "round {round}");
        supervisor.spawned(Role::Stereo, now + 31 * S);
    }
}

#[test]
fn a_silent_stage_is_killed_once_and_then_restarted() {
    let mut supervisor = started();
    supervisor.reported(Role::Road, 6 * S);
    let kill = Action::Kill(Role::Stereo, "it was silent beyond its liveness deadline");
    assert_eq!(tick_until(&mut supervisor, 6 * S), [kill]);
    assert_eq!(tick_until(&mut supervisor, 7 * S), []);
    // A late report of the dying process has no effect.
    supervisor.reported(Role::Stereo, 7 * S);
    assert!(!supervisor.all_running());
    supervisor.exited(Role::Stereo, "was killed", 8 * S);
    supervisor.reported(Role::Road, 9 * S);
    assert_eq!(tick_until(&mut supervisor, 9 * S), [Action::Spawn(Role::Stereo)]);
    // One that never reports has the longer start-up deadline.
    supervisor.spawned(Role::Stereo, 9 * S);
    supervisor.reported(Role::Road, 18 * S);
    assert_eq!(tick_until(&mut supervisor, 18 * S), []);
    let kill = Action::Kill(Role::Stereo, "it did not report within its start-up deadline");
    assert_eq!(tick_until(&mut supervisor, 19 * S), [kill]);
}

#[test]
fn a_pause_of_the_whole_machine_extends_the_deadlines() {
    let mut supervisor = started();
    supervisor.tick(2 * S);
    assert_eq!(supervisor.tick(500 * S), [], "no stage could report");
    // After that the deadlines apply again.
    for now in 501..504 {
        assert_eq!(supervisor.tick(now * S), []);
    }
    assert_eq!(supervisor.tick(504 * S).len(), 2);
}

#[test]
fn an_intentional_restart_is_not_a_failure() {
    let mut supervisor = started();
    for round in 2..20 {
        let now = round * S;
        assert_eq!(supervisor.renew(Role::Road, now), Some(Action::Terminate(Role::Road)));
        assert_eq!(supervisor.renew(Role::Road, now), None, "already restarting");
        assert!(supervisor.is_renewing(Role::Road));
        assert_eq!(supervisor.exited(Role::Road, "exited with code 0", now), None);
        supervisor.reported(Role::Stereo, now);
        assert_eq!(supervisor.tick(now), [Action::Spawn(Role::Road)]);
        supervisor.spawned(Role::Road, now);
        supervisor.reported(Role::Road, now);
    }
    assert_eq!((supervisor.restarts(Role::Road), supervisor.all_running()), (0, true));
    // A stage that does not end is killed, which is not a failure, either.
    supervisor.renew(Role::Road, 20 * S);
    supervisor.reported(Role::Stereo, 25 * S);
    let kill = Action::Kill(Role::Road, "it did not stop when asked");
    assert_eq!(tick_until(&mut supervisor, 25 * S), [kill]);
    supervisor.exited(Role::Road, "was killed", 25 * S);
    assert_eq!(supervisor.restarts(Role::Road), 0);
    supervisor.stop(25 * S);
    assert_eq!(supervisor.renew(Role::Stereo, 25 * S), None);
}

#[test]
fn stopping_terminates_first_then_kills_and_restarts_nothing() {
    let mut supervisor = started();
    supervisor.exited(Role::Road, "was killed", 2 * S);
    assert_eq!(supervisor.stop(2 * S), [Action::Terminate(Role::Stereo)]);
    assert_eq!(supervisor.stop(2 * S), []);
    assert_eq!(tick_until(&mut supervisor, 6 * S), [], "the waiting one is not started, the other has time");
    assert_eq!(
        tick_until(&mut supervisor, 7 * S),
        [Action::Kill(Role::Stereo, "it did not stop when asked")]
    );
    assert!(!supervisor.all_ended());
    assert_eq!(supervisor.exited(Role::Stereo, "was killed", 8 * S), None);
    assert!(supervisor.all_ended());
    assert_eq!(tick_until(&mut supervisor, 100 * S), []);
}

#[test]
fn a_stage_that_was_given_up_is_tried_again_once_in_each_pause() {
    let mut supervisor = started();
    let mut now = 2 * S;
    for _ in 0..5 {
        supervisor.exited(Role::Stereo, "was killed", now);
        now += 31 * S;
        supervisor.spawned(Role::Stereo, now);
    }
    assert!(matches!(supervisor.exited(Role::Stereo, "was killed", now), Some(Action::GiveUp(..))));
    assert!(supervisor.given_up_reason().is_some_and(|r| r.contains("stereo failed 6 times")));
    let spawns = |supervisor: &mut Supervisor, now: u64| {
        supervisor.reported(Role::Road, now);
        supervisor.tick(now).contains(&Action::Spawn(Role::Stereo))
    };
    assert!(!spawns(&mut supervisor, now + 599 * S));
    now += 600 * S;
    assert!(spawns(&mut supervisor, now));
    // Its next failure gives it up at once.
    supervisor.spawned(Role::Stereo, now);
    let Some(Action::GiveUp(_, reason)) = supervisor.exited(Role::Stereo, "exited with code 1", now + S)
    else {
        panic!("it was on probation")
    };
    assert!(reason.contains("failed again") && reason.contains("code 1"), "{reason}");
    // On request it is retried without waiting.
    supervisor.retry(now + 2 * S);
    assert!(spawns(&mut supervisor, now + 2 * S));
    supervisor.spawned(Role::Stereo, now + 2 * S);
    assert!(supervisor.given_up_reason().is_some(), "the reason is kept until it runs");
    supervisor.reported(Role::Stereo, now + 3 * S);
    assert_eq!((supervisor.given_up_reason(), supervisor.given_up()), (None, None));
    // It has run for the length of the window: its failures are forgotten.
    assert_eq!(supervisor.exited(Role::Stereo, "was killed", now + 303 * S), None);
    // Without a configured pause there is no retry.
    let mut supervisor = Supervisor::new(
        SupervisorParameters { retry_ns: 0, restart_count: 0, ..PARAMETERS },
        &[Role::Road],
        0,
    );
    supervisor.spawned(Role::Road, 0);
    assert!(supervisor.exited(Role::Road, "exited", S).is_some());
    assert_eq!(supervisor.tick(1_000_000 * S), []);
}

#[test]
fn a_kill_without_effect_is_repeated() {
    let mut supervisor = started();
    supervisor.reported(Role::Road, 6 * S);
    assert_eq!(tick_until(&mut supervisor, 6 * S).len(), 1);
    supervisor.reported(Role::Road, 10 * S);
    let again = Action::Kill(Role::Stereo, "it did not stop when asked");
    assert_eq!(tick_until(&mut supervisor, 11 * S), [again]);
}
