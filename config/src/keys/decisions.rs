//! Keys of what is made of a disparity map: road, regions, recognition, tracking, alarm.

use super::Kind::{Choice, Name, Number, Path, Switch, Whole};
use super::{Key, key};

/// `[road]`.
pub(super) const ROAD: &[Key] = &[
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
        "road.shape",
        Choice(&["profile", "plane"]),
        "`profile` follows crests, dips and slopes; `plane` is a single plane, to see what the profile is worth.",
    ),
];

/// `[regions]`.
pub(super) const REGIONS: &[Key] = &[
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
        "regions.confirm",
        Switch,
        "A region must come back in a second frame before it counts. Off shows what one frame alone shows, and more that is not there.",
    ),
];

/// `[recognition]`.
pub(super) const RECOGNITION: &[Key] = &[
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
        "recognition.looks_max",
        Whole(1, 64),
        "Most obstacles that the cascade looks at in a frame, the nearest unknown ones first: more knows them sooner and costs time. The others stay obstacles.",
    ),
    key(
        "recognition.again_frames",
        Whole(1, 1000),
        "An obstacle that is known is looked at again after this many frames.",
    ),
];

/// `[tracking]`.
pub(super) const TRACKING: &[Key] = &[
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
];

/// `[alarm]`.
pub(super) const ALARM: &[Key] = &[
    key("alarm.distance_m", Number(0.5, 200.0), "Alarm when an obstacle in the path is nearer, in metres."),
    key(
        "alarm.ttc_warning_s",
        Number(0.0, 10.0),
        "Warning when an obstacle in the path would be met within this many seconds at constant closing speed; 0 for never.",
    ),
    key(
        "alarm.ttc_alarm_s",
        Number(0.0, 10.0),
        "Alarm when an obstacle in the path would be met within this many seconds; 0 for never.",
    ),
    key(
        "alarm.deceleration_warning_m_s2",
        Number(0.0, 20.0),
        "Warning when braking harder than this, in m/s², would be needed to stop before an obstacle in the path; 0 for never.",
    ),
    key(
        "alarm.deceleration_alarm_m_s2",
        Number(0.0, 20.0),
        "Alarm when braking harder than this would be needed, in m/s²; 0 for never.",
    ),
    key("alarm.path_width_m", Number(0.5, 20.0), "Width of the vehicle's path, in metres."),
    key(
        "alarm.confirm_frames",
        Whole(1, 100),
        "Frames in a row in which a rule must be fulfilled; rules look as far ahead as that takes.",
    ),
    key(
        "alarm.clear_share",
        Number(0.0, 2.0),
        "A level that is on ends when its limit is missed by this share: more keeps it steadier and longer.",
    ),
    key(
        "alarm.hold_ms",
        Whole(0, 60_000),
        "A level stays on this long after its cause is gone, in milliseconds.",
    ),
    key(
        "alarm.frame_age_max_ms",
        Whole(0, 60_000),
        "The alarm is off for frames that are older than this when a stage takes them up, in milliseconds; 0 for any age. Not in lock-step.",
    ),
    key(
        "alarm.self_check",
        Switch,
        "Turns the alarm off, with the reason, while the pictures are too dark, too bright, covered or too unlike, or the road has too little texture.",
    ),
];
