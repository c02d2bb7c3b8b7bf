//! Which stage to start, kill or give up: a pure state machine. Time is passed in.
//!
//! ```text
//!          Spawn                 first report              silent, or killed from outside
//! Waiting ───────▶ Starting ──────────────▶ Running ──────────────────────────▶ Waiting
//!    ▲                │ start-up deadline       │ liveness deadline                │
//!    ├──── exit ──────┴──────── Kill ───────────┘               too many restarts ─┴─▶ GivenUp
//!    └───────────────────── long pause, or asked for ──────────────────────────────────┘
//! ```
//!
//! A stage that was given up is tried again after a long pause, once: until it has lived as long as
//! the window of restarts, its next failure gives it up again. So a fault that goes away by itself
//! (memory that was short, a device that was unplugged) needs nobody, and one that stays costs one
//! start in each pause.

use messages::pipeline::Role;

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
    /// A stage that was given up is tried again after this; 0 = never by itself.
    pub retry_ns: u64,
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
    /// It is not started again until the long pause is over; why.
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
        /// When it is killed (once more).
        kill_ns: u64,
    },
    /// Ended for good.
    Ended,
    /// Failed too often.
    GivenUp {
        /// When it is tried again, if it is.
        retry_ns: Option<u64>,
    },
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
    /// Asked to end so that it starts anew: no failure.
    renewing: bool,
    /// Tried again after it was given up: its next failure within the window gives it up again.
    probation: bool,
    /// When it was last started.
    started_ns: u64,
    /// Why it was given up; kept until it runs again.
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
            probation: false,
            started_ns: now_ns,
            reason: String::new(),
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

    /// Whether every stage that frames pass is reporting; files may be written or not.
    pub fn frames_pass(&self) -> bool {
        let running = |s: &Stage| matches!(s.state, StageState::Running { .. });
        self.stages.iter().filter(|s| Role::STAGES.contains(&s.role)).all(running)
    }

    /// Whether every stage has ended for good.
    pub fn all_ended(&self) -> bool {
        self.stages.iter().all(|s| matches!(s.state, StageState::Ended | StageState::GivenUp { .. }))
    }

    /// A stage that failed too often, if there is one.
    pub fn given_up(&self) -> Option<Role> {
        self.stages.iter().find(|s| matches!(s.state, StageState::GivenUp { .. })).map(|s| s.role)
    }

    /// Why stages were given up that do not run yet again, in words; `None` when there are none.
    pub fn given_up_reason(&self) -> Option<String> {
        let reasons: Vec<&str> =
            self.stages.iter().map(|s| &s.reason[..]).filter(|r| !r.is_empty()).collect();
        (!reasons.is_empty()).then(|| reasons.join("; "))
    }

    /// Tries the stages that were given up now, not after their pause.
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

    /// A stage was started, or could not be (then its exit follows).
    pub fn spawned(&mut self, role: Role, now_ns: u64) {
        let own = role.spec().startup_deadline_ms;
        let deadline_ns = now_ns + deadline_ns(own, self.parameters.startup_deadline_ns);
        if let Some(stage) = self.stage_mut(role) {
            stage.state = StageState::Starting { deadline_ns };
            stage.started_ns = now_ns;
        }
    }

    /// A living stage reported.
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

    /// A stage has exited and was reaped; `how` says how.
    pub fn exited(&mut self, role: Role, how: &str, now_ns: u64) -> Option<Action> {
        let (p, stopping) = (self.parameters, self.stopping);
        let stage = self.stage_mut(role)?;
        // Of a stage that has no process there is nothing to hear.
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
                format!("{role} was given up, and failed again when it was tried once more: it {how}")
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

    /// Ends a stage and starts it anew at once, for a new launch document. That is no failure; one that was
    /// given up gets another chance.
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

    /// What is due at `now_ns`; to be called often. After a long gap (the machine was suspended, or
    /// the scheduler starved) the stages get the same time again: they could not report either.
    pub fn tick(&mut self, now_ns: u64) -> Vec<Action> {
        let mut actions = Vec::new();
        let gap = now_ns.saturating_sub(self.last_tick_ns);
        let pause = if gap > self.parameters.liveness_deadline_ns / 2 { gap } else { 0 };
        self.last_tick_ns = now_ns;
        // A kill may be in vain, should the process be stuck in the kernel: it is repeated.
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
