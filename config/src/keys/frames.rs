//! Keys of what brings frames and matches them: source, stereo, calibration.

use super::Kind::{Choice, Number, Path, Switch, Text, Whole};
use super::{Key, key};

/// `[source]`.
pub(super) const SOURCE: &[Key] = &[
    key(
        "source.kind",
        Choice(&["scene", "folder", "recording", "camera"]),
        "`scene` is a synthetic scene, `folder` recorded pairs, `recording` an MCAP file of `lookout record` or of ROS 2, `camera` what [camera] describes.",
    ),
    key(
        "source.path",
        Path,
        "Folder or MCAP file of recorded pairs, or a scene (`street?weather=night`, a TOML file; empty is the built-in drive). `lookout replay PATH` sets it.",
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
];

/// `[stereo]`.
pub(super) const STEREO: &[Key] = &[
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
        "Threads of the matcher on the CPU; the maps are the same for any number. A stage pinned to one core gains nothing from more.",
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
        "stereo.backend",
        Choice(&["auto", "cpu", "gpu"]),
        "What matches: `auto` takes a GPU where there is one and the build knows it (feature gpu), else the CPU; the maps are the same.",
    ),
    key(
        "stereo.adapter",
        Text(64),
        "Part of the name of the GPU that is taken, in any case, as `vulkaninfo --summary` shows it; empty takes the fastest kind, and no driver that computes on the CPU.",
    ),
    key(
        "stereo.gpu_timeout_ms",
        Number(10.0, 60_000.0),
        "A frame that the GPU has not finished in this time means that it hangs: the CPU takes over, with this frame. At most half of supervision.liveness_deadline_ms.",
    ),
];

/// `[calibration]`.
pub(super) const CALIBRATION: &[Key] = &[
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
];
