//! Which stage to start, kill or give up: a pure state machine. Time is passed in.
//!
//! ```text
//!          Spawn                 first report              silent, or killed from outside
//! Waiting ───────▶ Starting ──────────────▶ Running ──────────────────────────▶ Waiting
//!    ▲                │ start-up deadline       │ liveness deadline                │
//!    └──── exit ──────┴──────── Kill ───────────┘               too many restarts ─┴─▶ GivenUp
//! ```

use ipc::role::Role;

/// How patient the supervisor is; all times in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupervisorParameters {
    /// A stage must report for the first time within this.
    pub startup_deadline_ns: u64,
    /// A stage that is silent for longer is killed.
    pub liveness_deadline_ns: u64,
    /// Wait before the first restart; it doubles with each restart in the window.
    pub restart_first_ns: u64,
    /// The longest wait.
    pub restart_longest_ns: u64,
    /// More restarts than this in the window give the stage up.
    pub restart_count: usize,
    /// Length of the window.
    pub restart_window_ns: u64,
    /// A stage that was asked to stop is killed after this.
    pub stop_grace_ns: u64,
}

/// What the scheduler has to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Start the stage.
    Spawn(Role),
    /// Ask it to stop (SIGTERM).
    Terminate(Role),
    /// Kill it (SIGKILL); why.
    Kill(Role, &'static str),
    /// It will not be started again; why.
    GiveUp(Role, String),
}

/// What a stage is doing, as far as the supervisor knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageState {
    /// To be started at this time.
    Waiting {
        /// When.
        at_ns: u64,
    },
    /// Started, not yet heard of.
    Starting {
        /// When it must have reported.
        deadline_ns: u64,
    },
    /// Reporting.
    Running {
        /// When it must report again.
        deadline_ns: u64,
    },
    /// Killed, or asked to stop; its exit is awaited.
    Ending {
        /// When it is killed, if it was only asked.
        kill_ns: Option<u64>,
    },
    /// Ended for good.
    Ended,
    /// Failed too often.
    GivenUp,
}

impl StageState {
    /// The word for status displays.
    pub fn word(&self) -> &'static str {
        match self {
            StageState::Waiting { .. } => "waiting to start",
            StageState::Starting { .. } => "starting",
            StageState::Running { .. } => "running",
            StageState::Ending { .. } => "ending",
            StageState::Ended => "ended",
            StageState::GivenUp => "given up",
        }
    }
}

#[derive(Clone, Debug)]
struct Stage {
    role: Role,
    state: StageState,
    /// Times of the restarts within the window.
    recent: Vec<u64>,
    restarts: u32,
    /// Asked to end so that it starts anew: no failure.
    renewing: bool,
}

/// Watches over the stages.
#[derive(Clone, Debug)]
pub struct Supervisor {
    parameters: SupervisorParameters,
    stages: Vec<Stage>,
    stopping: bool,
    last_tick_ns: u64,
}

impl Supervisor {
    /// A supervisor of stages that are to be started at once.
    pub fn new(parameters: SupervisorParameters, roles: &[Role], now_ns: u64) -> Self {
        let stage = |&role| Stage {
            role,
            state: StageState::Waiting { at_ns: now_ns },
            recent: Vec::new(),
            restarts: 0,
            renewing: false,
        };
        Self { parameters, stages: roles.iter().map(stage).collect(), stopping: false, last_tick_ns: now_ns }
    }

    fn stage_mut(&mut self, role: Role) -> Option<&mut Stage> {
        self.stages.iter_mut().find(|s| s.role == role)
    }

    /// What a stage is doing; `None` for a role that is not supervised.
    pub fn state(&self, role: Role) -> Option<StageState> {
        self.stages.iter().find(|s| s.role == role).map(|s| s.state)
    }

    /// How often a stage was restarted.
    pub fn restarts(&self, role: Role) -> u32 {
        self.stages.iter().find(|s| s.role == role).map_or(0, |s| s.restarts)
    }

    /// Whether every stage is reporting.
    pub fn all_running(&self) -> bool {
        self.stages.iter().all(|s| matches!(s.state, StageState::Running { .. }))
    }

    /// Whether every stage has ended for good.
    pub fn all_ended(&self) -> bool {
        self.stages.iter().all(|s| matches!(s.state, StageState::Ended | StageState::GivenUp))
    }

    /// A stage that failed too often, if there is one.
    pub fn given_up(&self) -> Option<Role> {
        self.stages.iter().find(|s| s.state == StageState::GivenUp).map(|s| s.role)
    }

    /// A stage was started, or could not be (then its exit follows).
    pub fn spawned(&mut self, role: Role, now_ns: u64) {
        let deadline_ns = now_ns + self.parameters.startup_deadline_ns;
        if let Some(stage) = self.stage_mut(role) {
            stage.state = StageState::Starting { deadline_ns };
        }
    }

    /// A living stage reported.
    pub fn reported(&mut self, role: Role, now_ns: u64) {
        let deadline_ns = now_ns + self.parameters.liveness_deadline_ns;
        if let Some(stage) = self.stage_mut(role)
            && matches!(stage.state, StageState::Starting { .. } | StageState::Running { .. })
        {
            stage.state = StageState::Running { deadline_ns };
        }
    }

    /// A stage has exited and was reaped; `how` says how.
    pub fn exited(&mut self, role: Role, how: &str, now_ns: u64) -> Option<Action> {
        let (p, stopping) = (self.parameters, self.stopping);
        let stage = self.stage_mut(role)?;
        if matches!(stage.state, StageState::Ended | StageState::GivenUp) {
            return None;
        }
        if stopping {
            stage.state = StageState::Ended;
            return None;
        }
        if std::mem::take(&mut stage.renewing) {
            stage.state = StageState::Waiting { at_ns: now_ns };
            return None;
        }
        stage.recent.retain(|&at| now_ns.saturating_sub(at) < p.restart_window_ns);
        if stage.recent.len() >= p.restart_count {
            stage.state = StageState::GivenUp;
            let reason = format!(
                "{role} failed {} times in {} s, the last time it {how}",
                stage.recent.len() + 1,
                p.restart_window_ns / 1_000_000_000
            );
            return Some(Action::GiveUp(role, reason));
        }
        let doubled = p.restart_first_ns.saturating_mul(1 << stage.recent.len().min(32));
        stage.state = StageState::Waiting { at_ns: now_ns + doubled.min(p.restart_longest_ns) };
        stage.recent.push(now_ns);
        stage.restarts += 1;
        None
    }

    /// Ends a stage and starts it anew at once, for a new launch document. That is no failure; one that was
    /// given up gets another chance.
    pub fn renew(&mut self, role: Role, now_ns: u64) -> Option<Action> {
        let kill_ns = Some(now_ns + self.parameters.stop_grace_ns);
        let stopping = self.stopping;
        let stage = self.stage_mut(role).filter(|_| !stopping)?;
        match stage.state {
            StageState::Starting { .. } | StageState::Running { .. } => {
                stage.state = StageState::Ending { kill_ns };
                stage.renewing = true;
                Some(Action::Terminate(role))
            }
            StageState::GivenUp => {
                stage.recent.clear();
                stage.state = StageState::Waiting { at_ns: now_ns };
                None
            }
            StageState::Waiting { .. } | StageState::Ending { .. } | StageState::Ended => None,
        }
    }

    /// Whether a stage was asked to end so that it starts anew.
    pub fn is_renewing(&self, role: Role) -> bool {
        self.stages.iter().any(|s| s.role == role && s.renewing)
    }

    /// Asks all stages to stop; none is started any more.
    pub fn stop(&mut self, now_ns: u64) -> Vec<Action> {
        if self.stopping {
            return Vec::new();
        }
        self.stopping = true;
        let kill_ns = Some(now_ns + self.parameters.stop_grace_ns);
        let mut actions = Vec::new();
        for stage in &mut self.stages {
            match stage.state {
                StageState::Starting { .. } | StageState::Running { .. } => {
                    stage.state = StageState::Ending { kill_ns };
                    actions.push(Action::Terminate(stage.role));
                }
                StageState::Waiting { .. } => stage.state = StageState::Ended,
                StageState::Ending { .. } | StageState::Ended | StageState::GivenUp => {}
            }
        }
        actions
    }

    /// What is due at `now_ns`; to be called often. After a long gap (the machine was suspended, or
    /// the scheduler starved) the stages get the same time again: they could not report either.
    pub fn tick(&mut self, now_ns: u64) -> Vec<Action> {
        let mut actions = Vec::new();
        let gap = now_ns.saturating_sub(self.last_tick_ns);
        let pause = if gap > self.parameters.liveness_deadline_ns / 2 { gap } else { 0 };
        self.last_tick_ns = now_ns;
        for stage in &mut self.stages {
            let role = stage.role;
            if let StageState::Starting { deadline_ns } | StageState::Running { deadline_ns } =
                &mut stage.state
            {
                *deadline_ns += pause;
            }
            match stage.state {
                StageState::Waiting { at_ns } if now_ns >= at_ns => actions.push(Action::Spawn(role)),
                StageState::Starting { deadline_ns } if now_ns >= deadline_ns => {
                    stage.state = StageState::Ending { kill_ns: None };
                    actions.push(Action::Kill(role, "it did not report within its start-up deadline"));
                }
                StageState::Running { deadline_ns } if now_ns >= deadline_ns => {
                    stage.state = StageState::Ending { kill_ns: None };
                    actions.push(Action::Kill(role, "it was silent beyond its liveness deadline"));
                }
                StageState::Ending { kill_ns: Some(at) } if now_ns >= at => {
                    stage.state = StageState::Ending { kill_ns: None };
                    actions.push(Action::Kill(role, "it did not stop when asked"));
                }
                _ => {}
            }
        }
        actions
    }
}

#[cfg(test)]
pub mod tests {
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
        // A late report of the dying process does not bring it back.
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
    fn a_pause_of_the_whole_machine_is_no_fault_of_the_stages() {
        let mut supervisor = started();
        supervisor.tick(2 * S);
        assert_eq!(supervisor.tick(500 * S), [], "nobody could report");
        // From now on the deadlines hold again.
        for now in 501..504 {
            assert_eq!(supervisor.tick(now * S), []);
        }
        assert_eq!(supervisor.tick(504 * S).len(), 2);
    }

    #[test]
    fn a_stage_that_starts_anew_has_not_failed() {
        let mut supervisor = started();
        for round in 2..20 {
            let now = round * S;
            assert_eq!(supervisor.renew(Role::Road, now), Some(Action::Terminate(Role::Road)));
            assert_eq!(supervisor.renew(Role::Road, now), None, "it is on its way");
            assert!(supervisor.is_renewing(Role::Road));
            assert_eq!(supervisor.exited(Role::Road, "exited with code 0", now), None);
            supervisor.reported(Role::Stereo, now);
            assert_eq!(supervisor.tick(now), [Action::Spawn(Role::Road)]);
            supervisor.spawned(Role::Road, now);
            supervisor.reported(Role::Road, now);
        }
        assert_eq!((supervisor.restarts(Role::Road), supervisor.all_running()), (0, true));
        // One that does not end is killed, and still no failure.
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
    fn stopping_is_polite_first_and_final() {
        let mut supervisor = started();
        supervisor.exited(Role::Road, "was killed", 2 * S);
        assert_eq!(supervisor.stop(2 * S), [Action::Terminate(Role::Stereo)]);
        assert_eq!(supervisor.stop(2 * S), []);
        assert_eq!(
            tick_until(&mut supervisor, 6 * S),
            [],
            "the waiting one is not started, the other has time"
        );
        assert_eq!(
            tick_until(&mut supervisor, 7 * S),
            [Action::Kill(Role::Stereo, "it did not stop when asked")]
        );
        assert!(!supervisor.all_ended());
        assert_eq!(supervisor.exited(Role::Stereo, "was killed", 8 * S), None);
        assert!(supervisor.all_ended());
        assert_eq!(tick_until(&mut supervisor, 100 * S), []);
    }
}
