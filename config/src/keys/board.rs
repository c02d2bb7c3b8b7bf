//! Keys of the board: heat, clocks, what switches it off.

use super::Kind::{Choice, Number, Path, Text, Whole};
use super::{Key, key};

/// `[heat]`.
pub(super) const HEAT: &[Key] = &[
    key(
        "heat.watch",
        Choice(&["off", "prefer", "require"]),
        "Watches the chip's temperature and takes work away when it gets hot. `require` does not start without a sensor; `prefer` runs without and says so.",
    ),
    key(
        "heat.zones",
        Text(200),
        "Thermal zones that are watched, by type, as /sys/class/thermal names them; several parted by commas, `*` stands for any text. Leave out what is no chip: some boards have zones that always show 100 °C.",
    ),
    key("heat.period_ms", Whole(100, 5_000), "Time between two samples, in milliseconds."),
    key(
        "heat.filter_s",
        Number(0.0, 60.0),
        "Time constant of the filter of each zone, in seconds; 0 = none.",
    ),
    key(
        "heat.start_below_c",
        Number(20.0, 150.0),
        "With a zone at or above this, in °C, the daemon does not start: it would only run on a rung.",
    ),
    key("heat.frame_rate_above_c", Number(20.0, 150.0), "Above this, in °C, the frame rate is lowered."),
    key("heat.frame_rate_share", Number(0.05, 1.0), "What is left of the frame rate then."),
    key(
        "heat.clocks_above_c",
        Number(20.0, 150.0),
        "Above this, in °C, the clocks that [clocks] sets are lowered, too.",
    ),
    key("heat.clocks_share", Number(0.05, 1.0), "What is left of the clocks then."),
    key(
        "heat.recognition_above_c",
        Number(20.0, 150.0),
        "Above this, in °C, obstacles are tracked and raise alarms, but are not recognised.",
    ),
    key("heat.stop_above_c", Number(20.0, 150.0), "Above this, in °C, no pairs are taken: the stages wait."),
    key(
        "heat.power_off_above_c",
        Number(20.0, 150.0),
        "Above this in three samples in a row, in °C, the board is switched off as board.power_off says.",
    ),
    key(
        "heat.hysteresis_c",
        Number(5.0, 50.0),
        "A rung is left this many degrees below the temperature at which it is entered.",
    ),
    key(
        "heat.dwell_s",
        Number(0.1, 600.0),
        "Least time from one change to the next, in seconds; switching off does not wait.",
    ),
    key(
        "heat.slew_c_per_s",
        Number(0.01, 100.0),
        "How fast the chip can warm up at worst, in °C a second: a sensor that cannot be read any more is taken to do so.",
    ),
    key(
        "heat.missing",
        Choice(&["stop", "power_off"]),
        "How far up a sensor that cannot be read any more may lead.",
    ),
];

/// `[clocks]`.
pub(super) const CLOCKS: &[Key] = &[
    key(
        "clocks.set",
        Choice(&["off", "prefer", "require"]),
        "Fixes the clocks below while the daemon runs, and puts them back. `require` does not start when the system refuses; `prefer` runs on and is degraded.",
    ),
    key(
        "clocks.cpu_mhz",
        Number(0.0, 10_000.0),
        "Clock of all cores, in MHz: the next step that they have at or below; 0 leaves it alone.",
    ),
    key("clocks.gpu_mhz", Number(0.0, 10_000.0), "Clock of the GPU, in MHz, likewise."),
    key(
        "clocks.check_ms",
        Whole(100, 60_000),
        "How often the clocks are read back, in milliseconds; a clock that is too low three times makes the daemon degraded.",
    ),
];

/// `[board]`.
pub(super) const BOARD: &[Key] = &[
    key("board.sysfs", Path, "Root of the kernel's files about the board; another tree for tests."),
    key(
        "board.gpu",
        Choice(&["devfreq", "tk1"]),
        "How the GPU's clock is set: `devfreq`, or debugfs as on the Jetson TK1 (Linux for Tegra R21).",
    ),
    key("board.gpu_device", Text(200), "Name of the GPU in devfreq; patterns as in heat.zones."),
    key(
        "board.power_off",
        Choice(&["none", "systemctl", "request", "command"]),
        "What switches the board off: nothing; `systemctl poweroff`; a file power-off beside the folder of the instance, which lookout-poweroff.path waits for; or a command. With none, the ladder ends at stop.",
    ),
    key("board.power_off_command", Path, "Program that is run without arguments, for `command`."),
];
