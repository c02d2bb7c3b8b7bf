//! Stereo matching, and the monitoring of the calibration.

use crate::key::Reload;
use crate::table::table;
use perception::stereo::MpvParameters as Mpv;
use perception::stereo::cost::DEFAULT_K2;
use perception::stereo::device::DEFAULT_TIMEOUT;
use perception::stereo::epipolar::EpipolarParameters;
use perception::stereo::epipolar::correction::DEFAULT_LIMIT_PX;
use perception::stereo::viterbi::Merge;
use perception::stereo::winner::SubPixel;

table! {
    /// Stereo matching by Multi-Path Viterbi.
    pub struct Stereo, reload: Reload::Readers;

    /// Search strategy: `fast` searches windows around the disparities of a coarser map; `full` searches all
    /// disparities of every pixel and is a few times slower.
    method: Choice(&["fast", "full"]) = "fast";

    /// Number of disparities that are searched. More disparities show nearer objects and cost time and memory:
    /// nearest distance = focal length × baseline ÷ disparities.
    disparities: Whole(16, 255) in "px" = 128, reload: Reload::Restart;

    /// Time limit per frame: a frame that takes longer gets the map of the finest completed scale. The time is
    /// checked every 32 rows, so it is not exact to the millisecond. 0 always completes the map.
    budget_ms: Number(0.0, 10_000.0) in "ms" = 0.0;

    /// Number of CPU threads of the matcher; the map is the same for any number. With `cores.pin` each is pinned: the first to the
    /// core of the stereo process, others to cores of the same speed, those without a process first, then those of other
    /// processes, the last stage first; to the scheduler's core and core 0 at last. Fewer than the board has cores, so
    /// that real-time threads leave one to others.
    threads: Whole(1, 64) = 1;

    /// Constant K₂ of SSIM. Larger values reduce the influence of weak texture.
    ssim_k2: Number(0.01, 0.5) = DEFAULT_K2;

    /// Truncation of the gradient term of the matching cost: larger gradient differences cost the same. 0 omits the
    /// gradient term.
    gradient_limit: Whole(0, 24) in "grey levels" = Mpv::default().cost.gradient_limit;

    /// Smoothness penalty λ of one px of disparity change along a row; the maximum matching cost is about 100.
    /// Larger values give a smoother map.
    lambda_horizontal: Whole(1, 100) = Mpv::default().paths.lambda_horizontal;

    /// Smoothness penalty λ of one px of disparity change along a column.
    lambda_vertical: Whole(1, 100) = Mpv::default().paths.lambda_vertical;

    /// Smoothness penalty λ of one px of disparity change along a diagonal.
    lambda_diagonal: Whole(1, 100) = Mpv::default().paths.lambda_diagonal;

    /// Truncation of the smoothness penalty along a row: the maximum cost of a disparity jump. Smaller values keep
    /// edges sharper.
    truncation_horizontal: Whole(1, 75) = Mpv::default().paths.truncation_horizontal;

    /// Truncation of the smoothness penalty along columns and diagonals.
    truncation_other: Whole(1, 75) = Mpv::default().paths.truncation_other;

    /// Minimum grey-level step that counts as an image edge. Disparity changes cost less there.
    edge_levels: Whole(1, 255) in "grey levels" = Mpv::default().paths.edge_levels;

    /// Smoothness penalty at an image edge, relative to the penalty elsewhere.
    edge_percent: Whole(1, 100) in "%" = Mpv::default().paths.edge_percent;

    /// How rightward and leftward paths are combined: `min` keeps edges sharper, `mean` smooths more.
    merging: Choice(&["min", "mean"]) = merging();

    /// Number of scales of the image pyramid. With 1, `fast` has no coarser map and searches all disparities.
    scales: Whole(1, 3) = Mpv::default().scales;

    /// Penalises disparity changes relative to the slope of the coarser map. If false, changes cost the same
    /// everywhere.
    slopes: Switch = Mpv::default().slopes;

    /// Sub-pixel interpolation: `data` from the horizontal layer; `energy` from the final energies (less scatter,
    /// more pixel locking); `none` gives whole disparities.
    sub_pixel: Choice(&["data", "energy", "none"]) = sub_pixel();

    /// Maximum difference between the left and the right view in the consistency check. Pixels that exceed it
    /// have no disparity.
    left_right_px: Whole(0, 16) in "px" = Mpv::default().winner.left_right_px;

    /// Speckle filter: connected regions of fewer pixels are removed; 0 keeps all.
    speckle_pixels: Whole(0, 100_000) in "px" = Mpv::default().speckle.min_pixels;

    /// Minimum confidence of a disparity. Larger values give fewer errors and more holes.
    confidence_min: Whole(0, 255) = Mpv::default().min_confidence;

    /// Maximum width of a hole between two parts of one surface that is interpolated; 0 interpolates none.
    bridge_px: Whole(0, 4096) in "px" = Mpv::default().bridge.widest_px;

    /// Also fills all other holes, along the edges of the image. For visualisation; not for braking decisions.
    fill: Switch = Mpv::default().complete;

    /// Device of the matcher: `auto` uses a GPU if there is one and the build supports it (feature gpu), otherwise
    /// the CPU. The map is the same.
    backend: Choice(&["auto", "cpu", "gpu"]) = "auto";

    /// Part of the GPU's name, in upper or lower case, as `vulkaninfo --summary` shows it. If empty, the fastest
    /// type of GPU is used, and no driver that computes on the CPU.
    adapter: Text(64) = "";

    /// A GPU that has not finished a frame within this time is treated as hanging: the CPU takes over, from this
    /// frame on. At most half of `supervision.liveness_deadline_ms` where a GPU may be used.
    gpu_timeout_ms: Number(10.0, 60_000.0) in "ms" = DEFAULT_TIMEOUT.as_millis() as f64;
}

fn merging() -> &'static str {
    match Mpv::default().paths.merging {
        Merge::Mean => "mean",
        Merge::First | Merge::Min => "min",
    }
}

fn sub_pixel() -> &'static str {
    match Mpv::default().winner.sub_pixel {
        SubPixel::None => "none",
        SubPixel::Energy => "energy",
        SubPixel::Data => "data",
    }
}

table! {
    /// Monitoring of the epipolar alignment.
    pub struct Calibration, reload: Reload::Readers;

    /// Monitors whether matching points lie in the same row of both images, and whether the images are a pair; if too
    /// many matches are lost, the daemon is degraded.
    check: Switch = true;

    /// Number of frames from one check to the next. Larger values cost less time and detect changes later.
    every_frames: Whole(1, 1000) in "frames" = 3;

    /// Vertical offset of matching points whose cost makes the calibration degraded: what an offset of this size would
    /// lose in matches is the limit, 10 % at 1 px. What counts is the loss after correction, where pixels are matched.
    bound_px: Number(0.1, 5.0) in "px" = EpipolarParameters::default().bound_px;

    /// Vertical offsets up to this value are corrected, smoothly, by shifting the rows of the right image; above it the
    /// calibration is degraded. 0 only reports them.
    correct_px: Number(0.0, 20.0) in "px" = DEFAULT_LIMIT_PX;
}
