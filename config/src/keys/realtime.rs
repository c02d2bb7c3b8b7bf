//! Keys of real time and pacing.

use super::Kind::{Choice, Number, Switch, Whole};
use super::{Key, key};

const WISH: &[&str] = &["off", "prefer", "require"];

/// `[realtime]`.
pub(super) const REALTIME: &[Key] = &[
    key(
        "realtime.scheduling",
        Choice(WISH),
        "SCHED_FIFO for scheduler and stages, never for the writer: `require` stops with a reason when the system refuses, `prefer` goes on without and says so, `off` does not ask.",
    ),
    key(
        "realtime.memory_lock",
        Choice(WISH),
        "Locks the memory of every process, as it is touched, so that nothing is paged out (mlockall).",
    ),
    key(
        "realtime.prefault",
        Choice(WISH),
        "Makes all message pools real before frames flow: costs their full size, keeps a full /dev/shm from ending a stage.",
    ),
    key(
        "realtime.pinning",
        Choice(&["prefer", "require"]),
        "What to do when a process cannot be pinned to its core; cores.pin asks for it at all.",
    ),
    key(
        "realtime.priority_scheduler",
        Whole(10, 55),
        "SCHED_FIFO priority of the scheduler, which must be able to kill whatever spins.",
    ),
    key(
        "realtime.priority_capture",
        Whole(10, 55),
        "Priority of the capture stage, which has little to do and must not be late.",
    ),
    key(
        "realtime.priority_stereo",
        Whole(10, 55),
        "Priority of the stereo stage. Lower than what follows it: on a shared core a frame is finished before the next is begun.",
    ),
    key("realtime.priority_road", Whole(10, 55), "Priority of the road stage."),
    key("realtime.priority_recognition", Whole(10, 55), "Priority of the recognition stage."),
    key(
        "realtime.budget_ms",
        Whole(0, 600_000),
        "A process with a real-time priority that runs this long without once sleeping, in milliseconds, is ended by the kernel (RLIMIT_RTTIME); 0 sets no limit. Must be longer than the slowest frame.",
    ),
];

/// `[pacing]`.
pub(super) const PACING: &[Key] = &[
    key(
        "pacing.follow",
        Switch,
        "The source is asked for what the slowest stage sustains, at most for its own rate or source.fps; without, for that rate whatever happens, and newer frames overtake older ones.",
    ),
    key("pacing.min_fps", Number(0.1, 1000.0), "Frames a second below which pacing does not go."),
    key("pacing.max_fps", Number(0.1, 1000.0), "Frames a second above which pacing does not go."),
    key(
        "pacing.headroom_percent",
        Number(0.0, 200.0),
        "Time between frames beyond what the slowest stage takes for 9 of 10, in percent: more is steadier and slower.",
    ),
    key(
        "pacing.deadline_ms",
        Number(0.0, 600_000.0),
        "Time that a frame may take from capture to obstacles, in milliseconds; a longer one is counted as late. 0 sets none.",
    ),
    key(
        "pacing.late_frames",
        Whole(1, 10_000),
        "So many late frames in a row make the daemon degraded, as many in time make it whole again.",
    ),
    key(
        "pacing.stale_ms",
        Number(50.0, 600_000.0),
        "When no result has come for this long, in milliseconds (or for three periods of the source, if that is longer), the alarm is taken back: off.",
    ),
    key(
        "pacing.stall_ms",
        Number(50.0, 600_000.0),
        "A source that is this late with a pair, in milliseconds, is said to have stalled; the daemon is degraded until it goes on.",
    ),
];
