//! Keys of the cameras.

use super::Kind::{Choice, Number, Path, Switch, Whole};
use super::{Key, key};

/// `[camera]`.
pub(super) const CAMERA: &[Key] = &[
    key(
        "camera.backend",
        Choice(&["v4l2", "gstreamer"]),
        "How cameras are opened: `v4l2` devices, or `gstreamer` pipelines (in builds with that feature).",
    ),
    key(
        "camera.left",
        Path,
        "Left camera: a device such as /dev/video0 (better its name in /dev/v4l/by-path), or a pipeline.",
    ),
    key("camera.right", Path, "Right camera; not used with camera.side_by_side."),
    key(
        "camera.side_by_side",
        Switch,
        "camera.left gives both images in one frame, the left one on the left.",
    ),
    key("camera.width", Whole(32, 8192), "Width of one image, in pixels."),
    key("camera.height", Whole(32, 8192), "Height of an image, in pixels."),
    key(
        "camera.fps",
        Number(0.5, 500.0),
        "Frames a second that the cameras are asked for; source.fps, if set, takes fewer of them.",
    ),
    key(
        "camera.format",
        Choice(&["", "GREY", "YUYV", "UYVY", "NV12", "YU12", "MJPG"]),
        "Pixel format of a v4l2 device; empty takes the one that makes the least work. MJPG costs decoding.",
    ),
    key(
        "camera.skew_ms",
        Number(0.0, 1000.0),
        "Exposures of a pair may be this far apart, in milliseconds; less than half of the time between frames. More mismatches what moves.",
    ),
    key(
        "camera.exposure",
        Choice(&["automatic", "fixed", "matched"]),
        "`automatic` is each camera's own, `fixed` camera.exposure_us and camera.gain, `matched` the same for both, steered by the images.",
    ),
    key(
        "camera.exposure_us",
        Whole(1, 1_000_000),
        "Exposure time, or with `matched` the longest, in microseconds: more is brighter and blurs what moves.",
    ),
    key(
        "camera.gain",
        Whole(0, 65_535),
        "Gain, or with `matched` the greatest, in the camera's own unit: more is brighter and noisier.",
    ),
    key(
        "camera.silence_ms",
        Whole(50, 60_000),
        "A camera that gives no frame for longer, in milliseconds, counts as lost and is opened again.",
    ),
    key(
        "camera.retry_first_ms",
        Whole(10, 60_000),
        "Wait before a lost camera is opened again, in milliseconds; it doubles with each attempt.",
    ),
    key("camera.retry_longest_ms", Whole(10, 600_000), "The longest such wait, in milliseconds."),
];
