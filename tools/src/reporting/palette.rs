//! One colour code for overlays, videos, recordings and the viewer's page, whose style sheet has the same values.

use crate::reporting::picture::Colour;
use crate::reporting::record::{FrameRecord, ObstacleLine};

/// What a warning or an alarm is about.
pub const CAUSE: Colour = [255, 64, 64];
/// Confirmed obstacles.
pub const CONFIRMED: Colour = [79, 211, 255];
/// Obstacles that are not yet confirmed; warnings.
pub const UNCONFIRMED: Colour = [255, 176, 46];
/// Edges of the vehicle's path.
pub const PATH: Colour = [79, 120, 255];
/// Boundaries.
pub const BOUNDARY: Colour = [190, 110, 255];
/// Free space.
pub const FREE: Colour = [60, 220, 90];
/// Edges of the road.
pub const ROAD_EDGE: Colour = [250, 230, 60];
/// Text without a meaning of its own.
pub const PLAIN: Colour = [240, 240, 240];

/// The legend: words and their colours. The cause is that of the warning or the alarm.
pub const LEGEND: [(&str, Colour); 7] = [
    ("cause", CAUSE),
    ("confirmed", CONFIRMED),
    ("unconfirmed", UNCONFIRMED),
    ("path", PATH),
    ("boundary", BOUNDARY),
    ("free", FREE),
    ("road edge", ROAD_EDGE),
];

/// Whether a warning or an alarm is about an obstacle.
pub fn is_cause(record: &FrameRecord, obstacle: &ObstacleLine) -> bool {
    record.alarm.track == Some(obstacle.track) && ["warning", "alarm"].contains(&&record.alarm.level[..])
}

/// The colour of an obstacle.
pub fn of_obstacle(record: &FrameRecord, obstacle: &ObstacleLine) -> Colour {
    match (is_cause(record, obstacle), obstacle.confirmed) {
        (true, _) => CAUSE,
        (false, true) => CONFIRMED,
        (false, false) => UNCONFIRMED,
    }
}
