//! Where image pairs come from.

use crate::automatic::Automatic;
use crate::key::Reload;
use crate::table::table;

table! {
    /// Source of image pairs.
    pub struct Source, reload: Reload::Restart;

    /// Type of source: `scene` is a synthetic scene, `folder` recorded pairs, `recording` an MCAP file of
    /// `lookout record` or of ROS 2, `camera` the cameras of `[camera]`.
    kind: Choice(&["scene", "folder", "recording", "camera"]) = "scene";

    /// Folder, MCAP file or video of recorded pairs, or a scene (`street?weather=night`, or a TOML file; empty is the
    /// built-in drive). `lookout replay PATH` sets it.
    path: Path = "";

    /// Pattern of the left pictures, instead of `source.path`: a folder, or names with `*` and `?`, such as
    /// `cam0/*.png`. `source.right` names the right ones; pictures belong together whose stars stand for the same text.
    left: Path = "";

    /// Pattern of the right pictures.
    right: Path = "";

    /// Bits that 16-bit pictures use, with or without quotes. `auto` takes the fewest of 8, 10, 12, 14 and 16 that hold
    /// the values of some pictures, and says which.
    bits: Choice(&["auto", "8", "10", "12", "14", "16"]) = "auto";

    /// Colour filter of pictures that hold the raw pixels of a sensor: the colours of the first two pixels of the first and
    /// of the second row. The missing colours are interpolated bilinearly and become grey. Images of a recording whose
    /// encoding names the filter need no setting.
    bayer: Choice(&["none", "rggb", "bggr", "grbg", "gbrg"]) = "none";

    /// Stops at a pair with a picture that is missing or cannot be decoded. Otherwise the pair is left out, counted and told.
    strict: Switch = false;

    /// Random seed of the built-in drive; the same seed gives the same images. Other scenes define their own.
    seed: Whole(0, 1 << 53) = 1;

    /// Rate of pairs, at least 0.01; 0 takes the recording's own rate.
    fps: Number(0.0, 1000.0) in "pairs/s" = 0.0;

    /// Starts a recording again when it ends.
    repeat: Switch = false;

    /// Calibration: a rig file (TOML), a KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC. If empty, the calibration
    /// beside the recording is used.
    rig: Path = "";

    /// Rectifies each pair with the camera models of `source.rig` or of `rig.toml` beside the recording, a file of
    /// `lookout calibrate`. `auto` does so whenever there is such a file, unless the source says that its pairs are
    /// rectified (scenes, recordings of `lookout record`, a KITTI calib.txt beside the pictures); `false` takes pairs
    /// as they are.
    rectify: Automatic = Automatic::Auto;
}

table! {
    /// Cameras, for `source.kind = "camera"`.
    pub struct Camera, reload: Reload::Restart;

    /// Camera interface: `v4l2` devices, or `gstreamer` pipelines (in builds with that feature).
    backend: Choice(&["v4l2", "gstreamer"]) = "v4l2";

    /// Left camera: a device such as /dev/video0 (preferably by its name in /dev/v4l/by-path), or a pipeline.
    left: Path = "/dev/video0";

    /// Right camera; not used with `camera.side_by_side`.
    right: Path = "/dev/video2";

    /// `camera.left` delivers both images in one frame, with the left image in the left half.
    side_by_side: Switch = false;

    /// Width of one image.
    width: Whole(32, 8192) in "px" = 640;

    /// Height of one image.
    height: Whole(32, 8192) in "px" = 480;

    /// Frame rate that is requested from the cameras. `source.fps`, if set, takes fewer of these frames.
    fps: Number(0.5, 500.0) in "frames/s" = 30.0;

    /// Pixel format of a V4L2 device; empty selects the format that needs the least conversion. MJPG must be
    /// decoded.
    format: Choice(&["", "GREY", "YUYV", "UYVY", "NV12", "YU12", "MJPG"]) = "";

    /// Maximum time between the exposures of the left and the right image of a pair; less than half of the frame
    /// period. Larger values cause more mismatches on moving objects.
    skew_ms: Number(0.0, 1000.0) in "ms" = 5.0;

    /// Exposure control: `automatic` is each camera's own; `fixed` sets `camera.exposure_us` and `camera.gain`;
    /// `matched` sets both cameras to the same values, controlled from the images.
    exposure: Choice(&["automatic", "fixed", "matched"]) = "automatic";

    /// Exposure time, or with `matched` its maximum. Longer exposures are brighter and have more motion blur.
    exposure_us: Whole(1, 1_000_000) in "µs" = 10_000;

    /// Gain in the camera's own unit, or with `matched` its maximum. Higher gain is brighter and noisier.
    gain: Whole(0, 65_535) = 16;

    /// A camera that delivers no frame for longer than this is treated as lost and opened again.
    silence_ms: Whole(50, 60_000) in "ms" = 1_000;

    /// Delay before a lost camera is opened again. It doubles with each attempt.
    retry_first_ms: Whole(10, 60_000) in "ms" = 500;

    /// Maximum delay before a lost camera is opened again.
    retry_longest_ms: Whole(10, 600_000) in "ms" = 10_000;
}
