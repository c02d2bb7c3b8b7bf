//! Real-time scheduling of the processes, and the frame rate.

use crate::key::Reload;
use crate::stages::Priority;
use crate::table::table;
use messages::pipeline::Role;

/// How much the daemon insists on a privilege.
const WISH: &[&str] = &["off", "prefer", "require"];

table! {
    #[per_stage]
    /// Real-time privileges of the processes. With `require` a process stops, with the reason, if the system
    /// refuses the privilege; with `prefer` it continues without it and reports that; with `off` it does not ask.
    /// The scheduler has the highest priority, because it must be able to kill a process that spins. Capture has
    /// little work and must not be late. A later stage has a higher priority than an earlier one, so that on a
    /// shared core a frame is finished before the next one is started.
    pub struct Realtime, reload: Reload::Restart;

    /// Schedules the scheduler and the stages with SCHED_FIFO, but never the writer.
    scheduling: Choice(WISH) = "off";

    /// Locks the memory of each process when it is first touched, so that it is never paged out (mlockall).
    memory_lock: Choice(WISH) = "off";

    /// Allocates all message pools before the first frame. This takes their full size at once, and a full
    /// /dev/shm cannot end a stage later.
    prefault: Choice(WISH) = "off";

    /// Whether a process that cannot be pinned to its core continues. `cores.pin` switches pinning itself.
    pinning: Choice(&["prefer", "require"]) = "prefer";

    /// SCHED_FIFO priority of the {stage} process.
    #[serde(flatten)]
    priorities: PerStage(Priority);

    /// Maximum time that a process with a real-time priority may run without sleeping; the kernel ends a process
    /// that exceeds it (RLIMIT_RTTIME). 0 sets no limit. Must be longer than the processing time of the slowest
    /// frame.
    budget_ms: Whole(0, 600_000) in "ms" = 2_000;
}

impl Realtime {
    /// SCHED_FIFO priority of a process; `None` for one that never has one, such as the writer.
    pub fn priority(&self, role: Role) -> Option<i64> {
        self.priorities.get(role)
    }
}

table! {
    /// Frame rate and deadlines.
    pub struct Pacing, reload: Reload::Restart;

    /// Lowers the requested frame rate to what the slowest stage sustains, at most the source's own rate or
    /// `source.fps`. If false, that rate is always requested, and newer frames replace waiting ones.
    follow: Switch = false;

    /// Minimum frame rate that pacing requests.
    min_fps: Number(0.1, 1000.0) in "frames/s" = 5.0;

    /// Maximum frame rate that pacing requests.
    max_fps: Number(0.1, 1000.0) in "frames/s" = 30.0;

    /// Margin of the frame period over the 90th percentile of the slowest stage's processing time. Larger values
    /// are steadier and slower.
    headroom_percent: Number(0.0, 200.0) in "%" = 15.0;

    /// Maximum time from capture to obstacles; a frame that takes longer is counted as late. 0 sets no deadline.
    deadline_ms: Number(0.0, 600_000.0) in "ms" = 0.0;

    /// After this many consecutive late frames the daemon is degraded, until as many consecutive frames are in
    /// time.
    late_frames: Whole(1, 10_000) in "frames" = 10;

    /// If no result arrives for this long (or for three periods of the source, if that is longer), the alarm is
    /// set to `off`.
    stale_ms: Number(50.0, 600_000.0) in "ms" = 1000.0;

    /// A source that is this late with a pair is reported as stalled; the daemon is degraded until the next pair.
    stall_ms: Number(50.0, 600_000.0) in "ms" = 2000.0;
}
