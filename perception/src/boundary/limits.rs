//! Hand-set limits of boundaries and of raised ground, with unit and reason.

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

/// Length in metres along a boundary that may be seen through. Drivers leave more between parked cars, to get out.
pub const MAX_GAP_M: f64 = 0.6;

/// Length in metres along a boundary that something nearer may hide: a parked car.
pub const MAX_HIDDEN_M: f64 = 6.0;

/// Smallest length of a boundary in metres, of the part in which a gap of [`MAX_GAP_M`] would be seen: longer than a car
/// and than a van.
pub const MIN_LENGTH_M: f64 = 8.0;

/// No vehicle that is lower than this (metres) is as long as [`MIN_LENGTH_M`].
pub const LOW_HEIGHT_M: f64 = 2.2;

/// Longest vehicle, in metres (lorry with trailer): what is higher than [`LOW_HEIGHT_M`] has to be longer.
pub const LONGEST_VEHICLE_M: f64 = 19.0;

/// Gap between two lorries or buses that stand in a row, in metres.
pub const LORRY_GAP_M: f64 = 1.5;

/// The height of a boundary is steady: in this share of its length it differs from the median by at most
/// [`HEIGHT_STEP_M`]. The roof of a car is half of its length.
pub const STEADY_SHARE: f64 = 0.75;

/// Largest difference from a steady height, in metres: a bonnet is 0.4 m lower than the roof.
pub const HEIGHT_STEP_M: f64 = 0.25;

/// Time for which a boundary is seen before it counts, in seconds: a shadow of the matcher on moving things does not last.
pub const CONFIRM_S: f64 = 0.3;

/// Time for which a boundary, or a part of it, is kept without being seen, in seconds.
pub const FORGET_S: f64 = 0.5;

/// Margin of the own path on each side, in metres: what stands so near to the path stays an obstacle.
pub const PATH_MARGIN_M: f64 = 0.4;
