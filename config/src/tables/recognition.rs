//! Recognition and tracking of obstacles.

use crate::key::Reload;
use crate::table::table;
use perception::recognition::RecogniserParameters as Recogniser;
use perception::recognition::scan::{DEFAULT_MAX_PX, DEFAULT_MIN_PX};
use perception::tracking::TrackerParameters as Tracker;
use perception::tracking::classification_schedule::ScheduleParameters as Schedule;

table! {
    /// Recognition of obstacles by a boosted cascade.
    pub struct Recognition, reload: Reload::Readers;

    /// OpenCV cascade file (XML), LBP or Haar; `vehicle` is the cascade that ships (models/README.md); if empty,
    /// every region is labelled `obstacle`.
    cascade: Path = "vehicle";

    /// Name of the class that the cascade recognises, as it is printed.
    label: Name(15) = "vehicle";

    /// Width of the cascade's window at the object. The distance of a region then gives the two window sizes that
    /// are searched. 0 searches all sizes from `window_min_px` to `window_max_px`.
    window_m: Number(0.0, 50.0) in "m" = Recogniser::default().window_m;

    /// Minimum side of a search window.
    window_min_px: Whole(8, 2000) in "px" = DEFAULT_MIN_PX;

    /// Maximum side of a search window. Larger values find nearer objects and cost time.
    window_max_px: Whole(8, 2000) in "px" = DEFAULT_MAX_PX;

    /// Scale factor from one window size to the next. Smaller values find more and cost time.
    growth: Number(1.01, 4.0) = Recogniser::default().growth;

    /// A detection needs more overlapping windows than this. Larger values give fewer false positives and more
    /// misses.
    neighbours_min: Whole(1, 100) = Recogniser::default().min_neighbours;

    /// Maximum number of obstacles that are classified in a frame, the nearest unclassified ones first. Larger
    /// values classify obstacles sooner and cost time. The others stay `obstacle`.
    looks_max: Whole(1, 64) = Schedule::default().max_per_frame;

    /// A classified obstacle is classified again after this many frames.
    again_frames: Whole(1, 1000) in "frames" = Schedule::default().repeat_frames;
}

table! {
    /// Tracking of obstacles from frame to frame.
    pub struct Tracking, reload: Reload::Readers;

    /// Probability of existence from which a track counts as an obstacle and can raise an alarm. Larger values give fewer
    /// false obstacles and later true ones.
    confirm_probability: Number(0.5, 0.999) = Tracker::default().confirm_probability;

    /// A track ends at the latest when nothing has been seen of it for so long. One that should be seen and is not ends
    /// sooner.
    unseen_max_s: Number(0.1, 10.0) in "s" = Tracker::default().max_unseen_s;

    /// Minimum overlap (intersection over union) of a sighting with its track.
    overlap_min: Number(0.01, 0.99) = Tracker::default().min_overlap;
}
