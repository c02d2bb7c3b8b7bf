//! When to start, kill or give up a stage: a pure state machine. Time is passed in.
//!
//! ```text
//!          Spawn                 first report              silent, or killed from outside
//! Waiting ───────▶ Starting ──────────────▶ Running ──────────────────────────▶ Waiting
//!    ▲                │ start-up deadline       │ liveness deadline                │
//!    ├──── exit ──────┴──────── Kill ───────────┘               too many restarts ─┴─▶ GivenUp
//!    └───────────────────── long pause, or on request ─────────────────────────────────┘
//! ```
//!
//! A stage that was given up is retried once after a long pause. If it fails before it has run for the length of the
//! restart window, it is given up again. So the daemon recovers from temporary faults (short memory, an unplugged
//! device) without a user, and a permanent fault costs one start per pause.

use messages::pipeline::Role;

/// Deadlines and limits of the supervisor; all times in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupervisorParameters {
    /// Deadline of the first report of a stage.
    pub startup_deadline_ns: u64,
    /// A stage without a report for this long is killed.
    pub liveness_deadline_ns: u64,
    /// Delay of the first restart; it doubles with each restart in the window.
    pub restart_first_ns: u64,
    /// Maximum delay of a restart.
    pub restart_longest_ns: u64,
    /// Maximum number of restarts in the window; after more failures the stage is given up.
    pub restart_count: usize,
    /// Length of the restart window.
    pub restart_window_ns: u64,
    /// Pause after which a stage that was given up is retried; 0 = only on request.
    pub retry_ns: u64,
    /// Time from the request to stop until a stage is killed.
    pub stop_grace_ns: u64,
}

/// An action of the scheduler.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Start the stage.
    Spawn(Role),
    /// Ask it to stop (SIGTERM).
    Terminate(Role),
    /// Kill it (SIGKILL), for this reason.
    Kill(Role, &'static str),
    /// Do not start it before the long pause is over, for this reason.
    GiveUp(Role, String),
}

/// State of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageState {
    /// Waiting for its start.
    Waiting {
        /// Time of the start.
        at_ns: u64,
    },
    /// Started, without a report so far.
    Starting {
        /// Deadline of the first report.
        deadline_ns: u64,
    },
    /// Reporting.
    Running {
        /// Deadline of the next report.
        deadline_ns: u64,
    },
    /// Killed, or asked to stop, and not yet exited.
    Ending {
        /// When it is killed (again).
        kill_ns: u64,
    },
    /// Stopped, and not restarted.
    Ended,
    /// Failed too often.
    GivenUp {
        /// Time of the retry; `None` = only on request.
        retry_ns: Option<u64>,
    },
}

impl StageState {
    /// Name for status displays.
    pub fn name(&self) -> &'static str {
        match self {
            StageState::Waiting { .. } => "waiting to start",
            StageState::Starting { .. } => "starting",
            StageState::Running { .. } => "running",
            StageState::Ending { .. } => "ending",
            StageState::Ended => "ended",
            StageState::GivenUp { .. } => "given up",
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
    /// Stopped for an intentional restart, which is not a failure.
    renewing: bool,
    /// Retried after it was given up: its next failure within the window gives it up again.
    probation: bool,
    /// When it was last started.
    started_ns: u64,
    /// Why it was given up; empty once it runs again.
    reason: String,
}

impl Stage {
    fn try_again(&mut self, now_ns: u64) {
        self.probation = true;
        self.recent.clear();
        self.restarts += 1;
        self.state = StageState::Waiting { at_ns: now_ns };
    }
}

/// The supervisor of all stages.
#[derive(Clone, Debug)]
pub struct Supervisor {
    parameters: SupervisorParameters,
    stages: Vec<Stage>,
    stopping: bool,
    last_tick_ns: u64,
}

impl Supervisor {
    /// A supervisor whose stages are started at the first [`Self::tick`].
    pub fn new(parameters: SupervisorParameters, roles: &[Role], now_ns: u64) -> Self {
        let stage = |&role| Stage {
            role,
            state: StageState::Waiting { at_ns: now_ns },
            recent: Vec::new(),
            restarts: 0,
            renewing: false,
            probation: false,
            started_ns: now_ns,
            reason: String::new(),
        };
        Self { parameters, stages: roles.iter().map(stage).collect(), stopping: false, last_tick_ns: now_ns }
    }

    fn stage_mut(&mut self, role: Role) -> Option<&mut Stage> {
        self.stages.iter_mut().find(|s| s.role == role)
    }

    /// State of a stage; `None` for a role that is not supervised.
    pub fn state(&self, role: Role) -> Option<StageState> {
        self.stages.iter().find(|s| s.role == role).map(|s| s.state)
    }

    /// Number of restarts of a stage.
    pub fn restarts(&self, role: Role) -> u32 {
        self.stages.iter().find(|s| s.role == role).map_or(0, |s| s.restarts)
    }

    /// Whether every stage is reporting.
    pub fn all_running(&self) -> bool {
        self.stages.iter().all(|s| matches!(s.state, StageState::Running { .. }))
    }

    /// Whether every stage of [`Role::STAGES`] is reporting; the writer may be down.
    pub fn frames_pass(&self) -> bool {
        let running = |s: &Stage| matches!(s.state, StageState::Running { .. });
        self.stages.iter().filter(|s| Role::STAGES.contains(&s.role)).all(running)
    }

    /// Whether every stage has ended or was given up.
    pub fn all_ended(&self) -> bool {
        self.stages.iter().all(|s| matches!(s.state, StageState::Ended | StageState::GivenUp { .. }))
    }

    /// The first stage that was given up, if there is one.
    pub fn given_up(&self) -> Option<Role> {
        self.stages.iter().find(|s| matches!(s.state, StageState::GivenUp { .. })).map(|s| s.role)
    }

    /// Why stages were given up that are not running again; `None` if there are none.
    pub fn given_up_reason(&self) -> Option<String> {
        let reasons: Vec<&str> =
            self.stages.iter().map(|s| &s.reason[..]).filter(|r| !r.is_empty()).collect();
        (!reasons.is_empty()).then(|| reasons.join("; "))
    }

    /// Retries all stages that were given up now, without waiting for the end of their pause.
    pub fn retry(&mut self, now_ns: u64) {
        if self.stopping {
            return;
        }
        for stage in &mut self.stages {
            if matches!(stage.state, StageState::GivenUp { .. }) {
                stage.try_again(now_ns);
            }
        }
    }

    /// A stage was started. Must also be called if its start failed; [`Self::exited`] then follows.
    pub fn spawned(&mut self, role: Role, now_ns: u64) {
        let own = role.spec().startup_deadline_ms;
        let deadline_ns = now_ns + deadline_ns(own, self.parameters.startup_deadline_ns);
        if let Some(stage) = self.stage_mut(role) {
            stage.state = StageState::Starting { deadline_ns };
            stage.started_ns = now_ns;
        }
    }

    /// A stage has sent a report.
    pub fn reported(&mut self, role: Role, now_ns: u64) {
        let own = role.spec().liveness_deadline_ms;
        let deadline_ns = now_ns + deadline_ns(own, self.parameters.liveness_deadline_ns);
        if let Some(stage) = self.stage_mut(role)
            && matches!(stage.state, StageState::Starting { .. } | StageState::Running { .. })
        {
            stage.state = StageState::Running { deadline_ns };
            stage.reason.clear();
        }
    }

    /// A stage has exited and was reaped; `how` describes its exit.
    pub fn exited(&mut self, role: Role, how: &str, now_ns: u64) -> Option<Action> {
        let (p, stopping) = (self.parameters, self.stopping);
        let stage = self.stage_mut(role)?;
        // In all other states it has no process.
        if !matches!(
            stage.state,
            StageState::Starting { .. } | StageState::Running { .. } | StageState::Ending { .. }
        ) {
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
        stage.probation &= now_ns.saturating_sub(stage.started_ns) < p.restart_window_ns;
        if stage.probation || stage.recent.len() >= p.restart_count {
            let retry_ns = (p.retry_ns > 0).then(|| now_ns.saturating_add(p.retry_ns));
            stage.state = StageState::GivenUp { retry_ns };
            stage.reason = if stage.probation {
                format!("{role} was given up, and failed again when it was retried: it {how}")
            } else {
                format!(
                    "{role} failed {} times in {} s, the last time it {how}",
                    stage.recent.len() + 1,
                    p.restart_window_ns / 1_000_000_000
                )
            };
            return Some(Action::GiveUp(role, stage.reason.clone()));
        }
        let doubled = p.restart_first_ns.saturating_mul(1 << stage.recent.len().min(32));
        stage.state = StageState::Waiting { at_ns: now_ns + doubled.min(p.restart_longest_ns) };
        stage.recent.push(now_ns);
        stage.restarts += 1;
        None
    }

    /// Restarts a stage at once, for a new launch document. This does not count as a failure. A stage that was given up
    /// is started, too, with a new window.
    pub fn renew(&mut self, role: Role, now_ns: u64) -> Option<Action> {
        let kill_ns = now_ns + self.parameters.stop_grace_ns;
        let stopping = self.stopping;
        let stage = self.stage_mut(role).filter(|_| !stopping)?;
        match stage.state {
            StageState::Starting { .. } | StageState::Running { .. } => {
                stage.state = StageState::Ending { kill_ns };
                stage.renewing = true;
                Some(Action::Terminate(role))
            }
            StageState::GivenUp { .. } => {
                stage.recent.clear();
                stage.probation = false;
                stage.state = StageState::Waiting { at_ns: now_ns };
                None
            }
            StageState::Waiting { .. } | StageState::Ending { .. } | StageState::Ended => None,
        }
    }

    /// Whether a stage is being restarted by [`Self::renew`].
    pub fn is_renewing(&self, role: Role) -> bool {
        self.stages.iter().any(|s| s.role == role && s.renewing)
    }

    /// Stops all stages. None is started afterwards.
    pub fn stop(&mut self, now_ns: u64) -> Vec<Action> {
        if self.stopping {
            return Vec::new();
        }
        self.stopping = true;
        let kill_ns = now_ns + self.parameters.stop_grace_ns;
        let mut actions = Vec::new();
        for stage in &mut self.stages {
            match stage.state {
                StageState::Starting { .. } | StageState::Running { .. } => {
                    stage.state = StageState::Ending { kill_ns };
                    actions.push(Action::Terminate(stage.role));
                }
                StageState::Waiting { .. } => stage.state = StageState::Ended,
                StageState::Ending { .. } | StageState::Ended | StageState::GivenUp { .. } => {}
            }
        }
        actions
    }

    /// The actions that are due at `now_ns`; has to be called often. After a long gap between calls (the machine was
    /// suspended, or the scheduler did not run) the deadlines are extended by the gap, because the stages could not
    /// report either.
    pub fn tick(&mut self, now_ns: u64) -> Vec<Action> {
        let mut actions = Vec::new();
        let gap = now_ns.saturating_sub(self.last_tick_ns);
        let pause = if gap > self.parameters.liveness_deadline_ns / 2 { gap } else { 0 };
        self.last_tick_ns = now_ns;
        // A process that is blocked in the kernel does not end when it is killed; the kill is repeated.
        let ending = StageState::Ending { kill_ns: now_ns + self.parameters.stop_grace_ns };
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
                    stage.state = ending;
                    actions.push(Action::Kill(role, "it did not report within its start-up deadline"));
                }
                StageState::Running { deadline_ns } if now_ns >= deadline_ns => {
                    stage.state = ending;
                    actions.push(Action::Kill(role, "it was silent beyond its liveness deadline"));
                }
                StageState::GivenUp { retry_ns: Some(at) } if now_ns >= at && !self.stopping => {
                    stage.try_again(now_ns);
                    actions.push(Action::Spawn(role));
                }
                StageState::Ending { kill_ns } if now_ns >= kill_ns => {
                    stage.state = ending;
                    actions.push(Action::Kill(role, "it did not stop when asked"));
                }
                _ => {}
            }
        }
        actions
    }
}

/// A deadline of a stage: its own in the table of the pipeline, else the configured one.
fn deadline_ns(own_ms: Option<u32>, configured_ns: u64) -> u64 {
    own_ms.map_or(configured_ns, |ms| u64::from(ms) * 1_000_000)
}

#[cfg(test)]
pub mod tests;
