//! Hand-set limits of boundaries, raised ground and free space, with unit and reason.

/// Standard deviation of the disparity of a stixel, in px, beside the noise of the frame: what the steps of a matcher and
/// the blur at depth edges leave.
pub const STIXEL_SIGMA_PX: f64 = 0.12;

/// Roughness of a boundary across its direction, in metres, as a standard deviation: the leaves of a hedge, the posts of a
/// guard rail, the windows of a house.
pub const ROUGHNESS_M: f64 = 0.12;

/// Change of a boundary's direction along it, in rad for the square root of a metre: over 10 m it is the bend of a road
/// of 60 m radius.
pub const BENDING_RAD: f64 = 0.05;

/// Gate of all tests of belonging, in standard deviations.
pub const GATE_SIGMAS: f64 = 3.0;

/// Largest gate of the noise across a boundary, in metres, with which a stixel is taken for a part of it: the width of a person.
/// Beyond that noise does not tell who stands before a wall from the wall.
pub const MAX_GATE_M: f64 = 0.5;

/// What stands farther before a boundary than this, in metres, is something else: a person, a bin.
pub const RELIEF_M: f64 = 0.3;

/// And farther than this number of standard deviations of the mean: noise alone does that at one place of fifteen, which then stays
/// an obstacle.
pub const RELIEF_SIGMAS: f64 = 1.5;

/// Strips on each side over which that is averaged: five strips are 20 columns, a person 20 m ahead.
pub const RELIEF_STRIPS: usize = 2;

/// Length in metres along a boundary that may be seen through. Drivers leave more between parked cars, to get out.
pub const MAX_GAP_M: f64 = 0.6;

/// Length in metres along a boundary that something nearer may hide: a parked car.
pub const MAX_HIDDEN_M: f64 = 6.0;

/// Smallest length of a boundary in metres, of the part in which a gap of [`MAX_GAP_M`] would be seen: longer than a car
/// and than a van.
pub const MIN_LENGTH_M: f64 = 8.0;

/// Smallest length of a part of a boundary that is followed, in metres: enough for its direction.
pub const MIN_PART_M: f64 = 2.0;

/// No vehicle that is lower than this (metres) is as long as [`MIN_LENGTH_M`].
pub const LOW_HEIGHT_M: f64 = 2.2;

/// A part of a wall that is higher than [`LOW_HEIGHT_M`], and which is so itself, ends at most this far below its top, in metres;
pub const TOP_STEP_M: f64 = 0.4;
/// and what is farther behind the face of a wall than this, in metres, is something else.
pub const MAX_BEHIND_M: f64 = 0.4;

/// Longest vehicle, in metres (lorry with trailer): what is higher than [`LOW_HEIGHT_M`] has to be longer.
pub const LONGEST_VEHICLE_M: f64 = 19.0;

/// Higher than any vehicle may be, in metres: a house, a tall hedge.
pub const TALL_HEIGHT_M: f64 = 4.3;

/// Share of the rows up to there in which it is seen: windows without texture are not.
pub const TALL_SHARE: f64 = 0.5;

/// Smallest length of what is so high, in metres: wider than a tree's trunk, a sign or a lamp.
pub const TALL_LENGTH_M: f64 = 3.0;

/// Gap between two lorries or buses that stand in a row, in metres.
pub const LORRY_GAP_M: f64 = 1.5;

/// The height of a boundary is steady: in this share of its length it differs from the median by at most
/// [`HEIGHT_STEP_M`]. The roof of a car is half of its length.
pub const STEADY_SHARE: f64 = 0.75;

/// Largest difference from a steady height, in metres: a bonnet is 0.4 m lower than the roof.
pub const HEIGHT_STEP_M: f64 = 0.25;

/// Time for which a boundary is seen before it counts, in seconds: a shadow of the matcher on moving things does not last. Three frames
/// after the first one at 10 and at 12.5 frames a second, also where frames come some milliseconds early.
pub const CONFIRM_S: f64 = 0.22;

/// Time for which a boundary, or a part of it, is kept without being seen, in seconds;
pub const FORGET_S: f64 = 0.5;
/// while something nearer hides it, in seconds: at 4 m/s a parked car and its gap are passed;
pub const FORGET_HIDDEN_S: f64 = 2.0;
/// and where what is behind it is seen, in seconds: at 10 frames a second one wrong frame is forgiven, and what hid a point before is
/// not.
pub const FORGET_THROUGH_S: f64 = 0.15;

/// Share of a part that lies beside what it is joined with: the rest may be the blur of a depth edge.
pub const PART_SHARE: f64 = 0.5;

/// Least distance between known points, in metres.
pub const MIN_SPACING_M: f64 = 0.5;

/// Part of a boundary that tells whether it is still there, as shares of its height: not its foot, where the ground before it is seen.
pub const LOOK_ROWS: std::ops::Range<f64> = 0.25..1.0;
/// Share of the rows in which it is seen: through a fence one sees what is behind it, too;
pub const LOOK_SEEN_SHARE: f64 = 0.3;
/// and in which something else is seen instead.
pub const LOOK_HIDDEN_SHARE: f64 = 0.5;
/// Fewest rows with a disparity that tell, and their share of all rows.
pub const LOOK_MIN_ROWS: u32 = 3;
/// See [`LOOK_MIN_ROWS`].
pub const LOOK_KNOWN_SHARE: f64 = 0.25;

/// Margin of the own path on each side, in metres: what stands so near to the path stays an obstacle.
pub const PATH_MARGIN_M: f64 = 0.4;

/// Heights of raised ground above the road, in metres: from a low kerb on; what is higher than a bank behind a kerb is a
/// bonnet or a wall.
pub const RAISED_M: std::ops::Range<f32> = 0.06..0.5;

/// Pixels farther than this from the height of the road, in metres, are no ground at all: two spreads above the highest.
pub const MAX_GROUND_M: f64 = RAISED_M.end as f64 + 2.0 * MAX_SPREAD_M;

/// Largest standard deviation of the heights of ground in a cell, in metres: grass and camber. The face of a wall of
/// 0.4 m has 0.12.
pub const MAX_SPREAD_M: f64 = 0.07;

/// Least share of a cell's pixels that lie on the ground, where it is known.
pub const MIN_GROUND_SHARE: f32 = 0.3;

/// Fewest pixels (of strips) on which the height of a cell is based.
pub const MIN_CELL_PIXELS: f32 = 3.0;

/// Least depth of raised ground, in metres: more than the top of a wall.
pub const MIN_RAISED_DEPTH_M: f64 = 1.0;

/// Largest slope of raised ground, in metres a metre.
pub const MAX_SLOPE: f64 = 0.15;

/// Largest difference of free ground from the height of the road, in metres: camber and the error of the road's model.
pub const MAX_LEVEL_M: f64 = 0.1;

/// Cells without known ground that free space may bridge: two of them are 16 % of the distance, and what stands in them
/// hides the ground behind, if it is higher than 0.2 m.
pub const MAX_BRIDGED_CELLS: usize = 2;

/// Farthest start of free space, as a multiple of the nearest distance that the image shows: a bonnet.
pub const MAX_START_RATIO: f64 = 2.0;

/// Share of the sectors that show ground where free space starts: cars beside a narrow lane hide the others.
pub const MIN_START_SHARE: f64 = 0.125;

/// Fewest sectors side by side that are free ground: two decimetres at 5 m.
pub const MIN_SECTORS: usize = 3;

/// Columns from the left side of the right image, in px, in which the matcher's windows reach beyond it.
pub const BORDER_PX: f32 = 12.0;

/// Free space ends this number of standard deviations before what stands there, and is within as many of the disparity of
/// the road.
pub const FREE_SIGMAS: f64 = 2.0;

/// Least vertical extent of a stixel that ends free space, in metres; less is noise of the matcher on the road.
pub const MIN_STANDING_M: f64 = 0.15;
