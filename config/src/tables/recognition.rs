//! Recognition and tracking of obstacles.

use crate::key::Reload;
use crate::table::table;
use perception::recognition::RecogniserParameters as Recogniser;
use perception::recognition::scan::{DEFAULT_MAX_PX, DEFAULT_MIN_PX};
use perception::tracking::TrackerParameters as Tracker;
use perception::tracking::classification_schedule::ScheduleParameters as Schedule;

table! {
    /// Recognition of obstacles, by a network and a boosted cascade; each table `[[recognition.detectors]]` adds a detector.
    pub struct Recognition, reload: Reload::Readers;

    /// Neural network (ONNX) that names the class of a region; `objects` is the one that ships: vehicle, pedestrian, rider
    /// (models/README.md); `objects-free` the one that anyone may use; empty for none.
    network: Path = "objects";

    /// OpenCV cascade file (XML), LBP or Haar; `vehicle` is the cascade that ships (models/README.md); empty for none.
    /// Without network, cascade and further detectors every region is labelled `obstacle`.
    cascade: Path = "";

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

    /// Maximum number of obstacles that the network, and the cascade, classify in a frame, the nearest unclassified ones
    /// first. Larger values classify obstacles sooner and cost time. The others stay `obstacle`.
    looks_max: Whole(1, 64) = Schedule::default().max_per_frame;

    /// A classified obstacle is classified again after this many frames.
    again_frames: Whole(1, 1000) in "frames" = Schedule::default().repeat_frames;

    /// Further detectors, one table `[[recognition.detectors]]` each; `[]` for none. A table without keys finds people. An
    /// obstacle has the class whose evidence is strongest.
    detectors: Detectors(8) = Vec::new();
}

table! {
    @declare [#[serde(deny_unknown_fields, default)]]
    /// A further detector. It looks at the regions whose size fits, the nearest unclassified ones first.
    pub struct RecognitionDetector, reload: Reload::Readers;

    /// What the model is: `hog` is a linear SVM on histograms of oriented gradients, `cascade` an OpenCV cascade, searched
    /// with `growth` and `neighbours_min` of `[recognition]`, `network` a neural network (ONNX).
    kind: Choice(&["hog", "cascade", "network"]) = "hog";

    /// File of the model; `people` is OpenCV's people detector, which ships (models/README.md), `vehicle` the cascade, `objects` the network.
    /// Where a file FILE.calibration stands beside it, that says what a score means.
    model: Path = "people";

    /// Name of the class, as it is printed. Several detectors may have the same. A network names its classes itself.
    label: Name(15) = "pedestrian";

    /// Width of the window at the object. People of 1.75 m fill 96 of the 128 rows of OpenCV's window, which is half as wide
    /// as it is high.
    window_m: Number(0.05, 50.0) in "m" = PEOPLE_WINDOW_M;

    /// Minimum width of a region that is classified.
    width_min_m: Number(0.0, 100.0) in "m" = 0.25;

    /// Maximum width of a region that is classified.
    width_max_m: Number(0.0, 100.0) in "m" = 1.5;

    /// Minimum height of a region that is classified.
    height_min_m: Number(0.0, 100.0) in "m" = 1.1;

    /// Maximum height of a region that is classified.
    height_max_m: Number(0.0, 100.0) in "m" = 2.4;

    /// Lowest score of a window that counts as found. Only for `hog`: the distance from the SVM's plane.
    threshold: Number(-100.0, 100.0) = -1.0;

    /// Maximum number of regions that this detector classifies in a frame. It bounds its share of the stage's time: a count,
    /// not a clock, so that a recording gives the same result on any machine.
    looks_max: Whole(1, 64) = 4;
}

/// Width of the window of OpenCV's people detector at a person of 1.75 m, in metres: 1.75 · 128 / 96 / 2, rounded.
const PEOPLE_WINDOW_M: f64 = 1.17;

table! {
    /// Tracking of obstacles from frame to frame.
    pub struct Tracking, reload: Reload::Readers;

    /// Probability of existence from which a track counts as an obstacle and can raise an alarm. Larger values give fewer
    /// false obstacles and later true ones. What is not urgent, as it is far ahead or beside the way, waits 0.22 s.
    confirm_probability: Number(0.5, 0.999) = Tracker::default().confirm_probability;

    /// A track ends at the latest when nothing has been seen of it for so long. One that should be seen and is not ends
    /// sooner.
    unseen_max_s: Number(0.1, 10.0) in "s" = Tracker::default().max_unseen_s;

    /// Minimum overlap (intersection over union) of a sighting with its track.
    overlap_min: Number(0.01, 0.99) = Tracker::default().min_overlap;
}
