//! Every key of the configuration: what it is, its unit, its range and what turning it up does.

/// What a key holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// true or false.
    Switch,
    /// A whole number in a range.
    Whole(i64, i64),
    /// A number in a range.
    Number(f64, f64),
    /// One of a few words.
    Choice(&'static [&'static str]),
    /// Letters, digits, `-` and `_`, at most this many.
    Name(usize),
    /// A path; may be empty.
    Path,
}

/// One key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Table and key, with a dot.
    pub name: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// What it is, in which unit, and what turning it up does.
    pub text: &'static str,
}

const fn key(name: &'static str, kind: Kind, text: &'static str) -> Key {
    Key { name, kind, text }
}

use Kind::{Choice, Name, Number, Path, Switch, Whole};

/// All keys, table by table.
pub const KEYS: &[Key] = &[
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
    key(
        "log.level",
        Choice(&["error", "warn", "info", "debug", "trace"]),
        "The least severe message that is logged.",
    ),
    key(
        "source.kind",
        Choice(&["scene", "folder"]),
        "`scene` is a synthetic scene, `folder` recorded pairs.",
    ),
    key(
        "source.path",
        Path,
        "Folder of recorded pairs, or a scene (`street?weather=night`, a TOML file; empty is the built-in drive). `lookout replay PATH` sets it.",
    ),
    key(
        "source.seed",
        Whole(0, 1 << 53),
        "Seed of the built-in drive; the same seed gives the same pictures. Other scenes have theirs.",
    ),
    key(
        "source.fps",
        Number(0.0, 1000.0),
        "Pairs per second, at least 0.01; 0 takes the recording's own rate.",
    ),
    key("source.repeat", Switch, "Starts a recording again when it ends."),
    key("source.rig", Path, "Rig TOML or KITTI calib.txt; empty takes the calibration beside the recording."),
    key(
        "source.rectify",
        Switch,
        "Rectifies every pair with the cameras of source.rig, a file of `lookout calibrate`: for pairs as the cameras took them.",
    ),
    key(
        "stereo.method",
        Choice(&["fast", "full"]),
        "`fast` searches windows around a coarser map, `full` all disparities of every pixel: a few times slower.",
    ),
    key(
        "stereo.disparities",
        Whole(16, 255),
        "Disparities searched, in px: more sees nearer things, costs time and memory. Nearest distance = focal length × baseline ÷ disparities.",
    ),
    key(
        "stereo.budget_ms",
        Number(0.0, 10_000.0),
        "A frame that takes longer is given at the finest scale reached; looked at every 32 rows, so not to the millisecond. 0 always finishes.",
    ),
    key(
        "stereo.threads",
        Whole(1, 64),
        "Threads of the matcher; the maps are the same for any number. A stage pinned to one core gains nothing from more.",
    ),
    key("stereo.ssim_k2", Number(0.01, 0.5), "SSIM constant K₂: more ignores weak texture."),
    key(
        "stereo.gradient_limit",
        Whole(0, 24),
        "Gradient differences above this many grey levels cost the same; 0 leaves the gradient out of the cost.",
    ),
    key(
        "stereo.lambda_horizontal",
        Whole(1, 100),
        "Price of one px of disparity change along a row, of a greatest cost of about 100: more is smoother.",
    ),
    key("stereo.lambda_vertical", Whole(1, 100), "The same along a column."),
    key("stereo.lambda_diagonal", Whole(1, 100), "The same along a diagonal."),
    key(
        "stereo.truncation_horizontal",
        Whole(1, 75),
        "The most that a jump of disparity along a row costs: less keeps edges sharper.",
    ),
    key("stereo.truncation_other", Whole(1, 75), "The same along columns and diagonals."),
    key(
        "stereo.edge_levels",
        Whole(1, 255),
        "A step of at least this many grey levels is an edge, where changes are cheaper.",
    ),
    key("stereo.edge_percent", Whole(1, 100), "Price of a change at an edge, in percent of the usual."),
    key(
        "stereo.merging",
        Choice(&["min", "mean"]),
        "How rightward and leftward paths become one: `min` keeps edges sharper, `mean` smooths more.",
    ),
    key(
        "stereo.scales",
        Whole(1, 3),
        "Scales of the pyramid; with 1, `fast` has no coarser map to search around and searches everything.",
    ),
    key(
        "stereo.slopes",
        Switch,
        "Lets surfaces slope as the coarser map shows them; without, changes cost the same everywhere.",
    ),
    key(
        "stereo.sub_pixel",
        Choice(&["data", "energy", "none"]),
        "Disparities between whole pixels: `data` from the horizontal layer, `energy` from the final energies (scatters less, keeps to whole pixels), `none` not at all.",
    ),
    key(
        "stereo.left_right_px",
        Whole(0, 16),
        "Most px by which the left and the right view may disagree; a pixel beyond is unknown.",
    ),
    key("stereo.speckle_pixels", Whole(0, 100_000), "Islands of fewer pixels are removed; 0 keeps all."),
    key(
        "stereo.confidence_min",
        Whole(0, 255),
        "Estimates of less confidence are unknown: more leaves fewer errors and more holes.",
    ),
    key(
        "stereo.bridge_px",
        Whole(0, 4096),
        "Holes of at most this many px between two parts of one surface are bridged; 0 leaves them.",
    ),
    key(
        "stereo.fill",
        Switch,
        "Fills all other holes, too, along the edges of the image: nice to look at, not to brake by.",
    ),
    key(
        "calibration.check",
        Switch,
        "Checks while running whether rows of both pictures still match; when they do not, the daemon is degraded.",
    ),
    key(
        "calibration.every_frames",
        Whole(1, 1000),
        "Every how many frames the check looks at one: more costs less time and notices later.",
    ),
    key(
        "calibration.bound_px",
        Number(0.1, 5.0),
        "Vertical offset of matching points anywhere in the picture, in px, above which the calibration counts as degraded.",
    ),
    key(
        "calibration.correct_px",
        Number(0.0, 20.0),
        "Vertical offsets of up to this many px are corrected by shifting the right picture's rows; 0 only reports them.",
    ),
    key(
        "road.camera_height_min_m",
        Number(0.1, 10.0),
        "Least height of the camera above the road, in metres.",
    ),
    key(
        "road.camera_height_max_m",
        Number(0.1, 10.0),
        "Greatest height of the camera above the road, in metres.",
    ),
    key(
        "road.horizon_share",
        Number(0.02, 0.5),
        "How far pitch may move the horizon from the principal row, as a share of the image height.",
    ),
    key(
        "road.least_support",
        Number(0.0, 1.0),
        "A road that is seen in a smaller share of its rows counts as not seen; the alarm is then off.",
    ),
    key(
        "regions.height_min_m",
        Number(0.05, 3.0),
        "What reaches less far above the road, in metres, is road.",
    ),
    key(
        "regions.height_max_m",
        Number(0.5, 20.0),
        "What is higher above the road, in metres, is not in the way.",
    ),
    key("regions.distance_max_m", Number(3.0, 300.0), "Nothing is reported farther away, in metres."),
    key("regions.width_min_m", Number(0.02, 5.0), "Narrower regions, in metres, are noise."),
    key(
        "regions.depth_span_m",
        Number(0.5, 100.0),
        "Depth of one region, in metres: a longer hedge is cut into pieces.",
    ),
    key("regions.pixels_min", Whole(1, 100_000), "Regions of fewer pixels are noise."),
    key("regions.count_max", Whole(1, 64), "Most regions per frame; the nearest are kept."),
    key(
        "recognition.cascade",
        Path,
        "OpenCV cascade XML, LBP or Haar; `vehicle` is the one that ships (models/README.md); empty labels every region `obstacle`.",
    ),
    key("recognition.label", Name(15), "Class that the cascade recognises, as it is printed."),
    key(
        "recognition.window_m",
        Number(0.0, 50.0),
        "Width that the cascade's window has at the object, in metres: a region's distance then gives the two window sizes that are tried. 0 tries all sizes of the range below.",
    ),
    key("recognition.window_min_px", Whole(8, 2000), "Least side of a search window, in px."),
    key(
        "recognition.window_max_px",
        Whole(8, 2000),
        "Greatest side of a search window, in px: more finds nearer objects and costs time.",
    ),
    key(
        "recognition.growth",
        Number(1.01, 4.0),
        "Factor from one window size to the next: less finds more and costs time.",
    ),
    key(
        "recognition.neighbours_min",
        Whole(1, 100),
        "A find needs more overlapping hits than this: more is surer and misses more.",
    ),
    key(
        "tracking.confirm_frames",
        Whole(1, 100),
        "Frames in which an obstacle must be seen before it can raise an alarm.",
    ),
    key(
        "tracking.forget_frames",
        Whole(1, 100),
        "A confirmed obstacle ends after this many frames out of sight.",
    ),
    key(
        "tracking.overlap_min",
        Number(0.01, 0.99),
        "Least overlap (shared ÷ joint area) of a region with its track.",
    ),
    key(
        "alarm.distance_m",
        Number(0.5, 200.0),
        "The alarm sounds when an obstacle in the path is nearer, in metres.",
    ),
    key("alarm.path_width_m", Number(0.5, 20.0), "Width of the vehicle's path, in metres."),
    key(
        "alarm.hold_ms",
        Whole(0, 60_000),
        "The alarm stays on this long after its cause is gone, in milliseconds.",
    ),
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
        "supervision.stop_grace_ms",
        Whole(10, 60_000),
        "A stage that does not end within this of SIGTERM, in milliseconds, is killed.",
    ),
];
