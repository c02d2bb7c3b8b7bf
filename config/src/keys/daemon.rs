//! Keys of the processes: who they are, where they run, how they are watched.

use super::Kind::{Choice, Name, Path, Switch, Whole};
use super::{Key, key};

/// `[instance]`.
pub(super) const INSTANCE: &[Key] = &[
    key(
        "instance.name",
        Name(16),
        "Tells daemons on one machine apart; `lookout status` finds a daemon by it.",
    ),
    key(
        "instance.directory",
        Path,
        "Folder of the lock and of the service registry. Empty: $RUNTIME_DIRECTORY under systemd, else /tmp/lookout-<user id>.",
    ),
];

/// `[log]`.
pub(super) const LOG: &[Key] = &[key(
    "log.level",
    Choice(&["error", "warn", "info", "debug", "trace"]),
    "The least severe message that is logged.",
)];

/// `[cores]`.
pub(super) const CORES: &[Key] = &[
    key("cores.pin", Switch, "Pins every process to its core."),
    key(
        "cores.scheduler",
        Whole(0, 1023),
        "Core of the scheduler. A core that the machine lacks is shared: its number modulo the cores there are.",
    ),
    key("cores.capture", Whole(0, 1023), "Core of the capture stage."),
    key("cores.stereo", Whole(0, 1023), "Core of the stereo stage."),
    key("cores.road", Whole(0, 1023), "Core of the road stage."),
    key("cores.recognition", Whole(0, 1023), "Core of the recognition stage."),
];

/// `[supervision]`.
pub(super) const SUPERVISION: &[Key] = &[
    key("supervision.heartbeat_ms", Whole(20, 5_000), "An idle stage reports this often, in milliseconds."),
    key(
        "supervision.startup_deadline_ms",
        Whole(100, 600_000),
        "A stage must report for the first time within this, in milliseconds, or it is restarted.",
    ),
    key(
        "supervision.liveness_deadline_ms",
        Whole(100, 600_000),
        "A stage that is silent for longer, in milliseconds, is killed and restarted; must be longer than the slowest frame.",
    ),
    key(
        "supervision.restart_first_ms",
        Whole(10, 600_000),
        "Wait before the first restart, in milliseconds; it doubles with each.",
    ),
    key(
        "supervision.restart_longest_ms",
        Whole(10, 600_000),
        "Longest wait before a restart, in milliseconds.",
    ),
    key(
        "supervision.restart_count",
        Whole(0, 1000),
        "More restarts than this within the window give the stage up: the daemon is degraded, the alarm off.",
    ),
    key("supervision.restart_window_s", Whole(1, 86_400), "Length of that window, in seconds."),
    key(
        "supervision.retry_s",
        Whole(0, 86_400),
        "A stage that was given up is tried again after this many seconds, once in each such pause; 0 leaves it.",
    ),
    key(
        "supervision.stop_grace_ms",
        Whole(10, 60_000),
        "A stage that does not end within this of SIGTERM, in milliseconds, is killed.",
    ),
];
