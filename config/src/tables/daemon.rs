//! Identity, logging, CPU affinity and supervision of the processes.

use crate::key::Reload;
use crate::stages::Core;
use crate::table::table;
use messages::pipeline::{self, Role};

table! {
    /// Identity of the daemon on its machine.
    pub struct Instance, reload: Reload::Restart;

    /// Name of the daemon, unique on the machine; `lookout status` finds a daemon by it.
    name: Name(16) = "lookout";

    /// Directory of the lock file and of the service registry. If empty: `$RUNTIME_DIRECTORY` under systemd,
    /// otherwise `/tmp/lookout-<user id>`.
    directory: Path = "";
}

table! {
    /// Logging.
    pub struct Log, reload: Reload::AllStages;

    /// Minimum severity of the messages that are logged.
    level: Choice(&["error", "warn", "info", "debug", "trace"]) = "info";
}

table! {
    #[per_stage]
    /// CPU affinity of the processes. The writer runs on the scheduler's core.
    pub struct Cores, reload: Reload::Restart;

    /// Pins each process to its core.
    pin: Switch = true;

    /// Core of the {stage} process. A number that the machine does not have is taken modulo the number of cores.
    #[serde(flatten)]
    stages: PerStage(Core);
}

impl Cores {
    /// Core of a process: its own, or that of the process with which it shares one.
    pub fn of(&self, role: Role) -> i64 {
        match role.spec().core {
            pipeline::Core::With(other) if other != role => self.of(other),
            _ => self.stages.get(role).unwrap_or(0),
        }
    }
}

table! {
    /// Supervision of the stages: reports, restarts and shutdown.
    pub struct Supervision, reload: Reload::Restart;

    /// Interval at which an idle stage reports to the scheduler.
    heartbeat_ms: Whole(20, 5_000) in "ms" = 200;

    /// A stage that has not sent its first report within this time is restarted.
    startup_deadline_ms: Whole(100, 600_000) in "ms" = 10_000;

    /// A stage that has not reported for longer than this is killed and restarted. Must be longer than the
    /// processing time of the slowest frame.
    liveness_deadline_ms: Whole(100, 600_000) in "ms" = 5_000;

    /// Delay before the first restart of a stage. It doubles with each further restart.
    restart_first_ms: Whole(10, 600_000) in "ms" = 1_000;

    /// Maximum delay before a restart.
    restart_longest_ms: Whole(10, 600_000) in "ms" = 30_000;

    /// Maximum number of restarts of a stage within `restart_window_s`. A stage that exceeds it is given up: the
    /// daemon is degraded and the alarm is off.
    restart_count: Whole(0, 1000) = 5;

    /// Length of the time window in which restarts are counted.
    restart_window_s: Whole(1, 86_400) in "s" = 300;

    /// A stage that was given up is started again after this time, once per such interval; 0 never starts it again.
    retry_s: Whole(0, 86_400) in "s" = 600;

    /// A stage that has not ended within this time after SIGTERM is killed.
    stop_grace_ms: Whole(10, 60_000) in "ms" = 5_000;
}
