//! The board: its temperature, its clocks, its power.

use crate::key::Reload;
use crate::table::table;

table! {
    /// Load shedding as the temperature rises, in steps: lower frame rate, lower clocks, no recognition, stop,
    /// power off.
    pub struct Heat, reload: Reload::Scheduler;

    /// Monitors the chip's temperature and sheds load. `require` does not start without a sensor; `prefer` runs
    /// without one and reports that.
    watch: Choice(&["off", "prefer", "require"]) = "off";

    /// Thermal zones that are monitored: comma-separated types as in /sys/class/thermal, where `*` matches any
    /// text. Leave out zones that are no chip: on some boards a zone always reads 100 °C.
    zones: Text(200) = "*";

    /// Time between two samples.
    period_ms: Whole(100, 5_000) in "ms" = 500;

    /// Time constant of the filter of each zone; 0 disables it.
    filter_s: Number(0.0, 60.0) in "s" = 5.0;

    /// The daemon does not start while a zone is at or above this temperature, because it would shed load at once.
    start_below_c: Number(20.0, 150.0) in "°C" = 85.0;

    /// Temperature above which the frame rate is lowered.
    frame_rate_above_c: Number(20.0, 150.0) in "°C" = 90.0;

    /// Remaining fraction of the frame rate above `frame_rate_above_c`.
    frame_rate_share: Number(0.05, 1.0) = 0.5;

    /// Temperature above which the clocks that `[clocks]` sets are lowered, too.
    clocks_above_c: Number(20.0, 150.0) in "°C" = 92.0;

    /// Remaining fraction of the clocks above `clocks_above_c`.
    clocks_share: Number(0.05, 1.0) = 0.6;

    /// Temperature above which obstacles are tracked and raise alarms, but are not recognised.
    recognition_above_c: Number(20.0, 150.0) in "°C" = 93.0;

    /// Temperature above which no pairs are processed: the stages wait.
    stop_above_c: Number(20.0, 150.0) in "°C" = 94.0;

    /// Temperature above which, in three consecutive samples, the board is switched off as `board.power_off` says.
    power_off_above_c: Number(20.0, 150.0) in "°C" = 95.0;

    /// A step ends this far below the temperature at which it begins.
    hysteresis_c: Number(5.0, 50.0) in "°C" = 5.0;

    /// Minimum time from one change of the step to the next; switching off does not wait.
    dwell_s: Number(0.1, 600.0) in "s" = 30.0;

    /// Maximum rate at which the chip can warm up. A sensor that can no longer be read is assumed to rise at this
    /// rate.
    slew_c_per_s: Number(0.01, 100.0) in "°C/s" = 1.0;

    /// Highest step that a sensor which can no longer be read may lead to.
    missing: Choice(&["stop", "power_off"]) = "stop";
}

table! {
    /// Fixed clocks.
    pub struct Clocks, reload: Reload::Scheduler;

    /// Fixes the clocks below while the daemon runs, and restores them afterwards. `require` does not start if the
    /// system refuses; `prefer` goes on and is degraded: a clock that the board lacks leaves the others set, a refusal
    /// leaves all as they were.
    set: Choice(&["off", "prefer", "require"]) = "off";

    /// Clock of all cores: the highest available step at or below this; 0 leaves it unchanged.
    cpu_mhz: Number(0.0, 10_000.0) in "MHz" = 0.0;

    /// Clock of the GPU: the highest available step at or below this; 0 leaves it unchanged.
    gpu_mhz: Number(0.0, 10_000.0) in "MHz" = 0.0;

    /// Interval at which the clocks are read back. A clock that is too low three times makes the daemon degraded.
    check_ms: Whole(100, 60_000) in "ms" = 1_000;
}

table! {
    /// Access to the board's hardware.
    pub struct Board, reload: Reload::Scheduler;

    /// Root of sysfs; tests use another directory.
    sysfs: Path = "/sys";

    /// How the clock of the GPU is set: `devfreq`, or `tk1` for debugfs as on the Jetson TK1 (Linux for Tegra
    /// R21).
    gpu: Choice(&["devfreq", "tk1"]) = "devfreq";

    /// Name of the GPU in devfreq; patterns as in `heat.zones`.
    gpu_device: Text(200) = "*gpu*,*.ga10b,*.gv11b";

    /// How the board is switched off: `none`; `systemctl` runs `systemctl poweroff`; `request` creates a file
    /// power-off beside the instance's directory, which lookout-poweroff.path waits for; `command` runs
    /// `power_off_command`. With `none` the last step of load shedding is stop.
    power_off: Choice(&["none", "systemctl", "request", "command"]) = "none";

    /// Program that is run without arguments, for `command`.
    power_off_command: Path = "";
}
