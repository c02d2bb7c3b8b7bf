//! The numbers of the tracker that somebody chose, with unit and reason; those of image motion are in [`super::image_motion`].

use crate::free_space::limits::CONFIRM_S;

/// Parameters of the tracker that the configuration sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerParameters {
    /// Probability of existence from which a track is confirmed as an obstacle; what is not urgent waits ([`UNHURRIED_S`]).
    pub confirm_probability: f64,
    /// Longest time for which a track is predicted without a sighting, in seconds.
    pub max_unseen_s: f64,
    /// Smallest box overlap for an assignment, 0 to 1.
    pub min_overlap: f64,
    /// Distance beyond which nothing is detected, in metres.
    pub max_distance_m: f64,
    /// Largest disparity that is searched, in px: nearer things are not detected.
    pub max_disparity_px: f64,
    /// Largest number of tracks.
    pub max_count: usize,
}

impl Default for TrackerParameters {
    fn default() -> Self {
        Self {
            confirm_probability: 0.9,
            max_unseen_s: 1.0,
            min_overlap: 0.2,
            max_distance_m: 60.0,
            max_disparity_px: 128.0,
            max_count: 128,
        }
    }
}

// Existence.

/// Probability that a sighting that belongs to no track is a real thing, before its evidence counts; and the probability
/// below which a track ends, as less is then known of it than before it was seen.
pub const BIRTH_PROBABILITY: f64 = 0.2;
/// A thing is urgent if it is at most this far beside the straight way of the vehicle, in metres, and within the distance that the speed
/// asks for ([`crate::range::Range::needed_m`]).
pub const BESIDE_M: f64 = 2.5;
/// Least value of that distance, in metres.
pub const MIN_URGENT_M: f64 = 30.0;
/// What is not urgent is confirmed this time after its first sighting at the earliest, in seconds: as long as boundaries need
/// ([`crate::free_space::limits::CONFIRM_S`]). Pieces of fences, hedges and far rows of cars often have two or three distinct sightings and no more.
pub const UNHURRIED_S: f64 = CONFIRM_S;
/// A confirmed track remains confirmed down to this probability, so that one missed sighting changes nothing.
pub const KEEP_PROBABILITY: f64 = 0.8;
/// Largest evidence of one sighting, as suffices in a single picture ([`crate::detection::SINGLE_PICTURE_EVIDENCE`]). However
/// distinct a snowflake in front of the lens is, it is one for one frame.
pub const MAX_EVIDENCE: f64 = 3.5;
/// Probability that what is there and visible is seen, before it is measured: two of three.
pub const DETECTION_PROBABILITY: f64 = 0.63;
/// Number of looks that this first value counts as.
pub const DETECTION_PROBABILITY_LOOKS: f64 = 20.0;
/// Time over which it is measured, in seconds: weather changes slowly, tunnels do not.
pub const DETECTION_PROBABILITY_TIME_S: f64 = 5.0;
/// Its bounds: what a few tracks tell is no certainty.
pub const DETECTION_PROBABILITY_BOUNDS: (f64, f64) = (0.3, 0.88);
/// Correlation time of the errors of successive sightings, in seconds: looks at shorter intervals see the same noise and
/// count by the time between them. Two frames at 12.5 frames a second.
pub const CORRELATION_S: f64 = 0.15;
/// Number of independent looks that are remembered. The evidence of one structure errs to the same side in each frame, so that
/// it must not add up without limit.
pub const MEMORY_LOOKS: f64 = 5.0;
/// Mean time for which a thing remains where it is expected while nobody can see it there, in seconds.
pub const LEAVING_TIME_S: f64 = 4.0;

/// From this share of the range on, things are detected less and less; at the range not at all.
pub const FADING_SHARE: f64 = 0.75;

// Association.

/// Gate of the disparity difference: this many standard deviations of prediction and measurement,
pub const GATE_SIGMAS: f64 = 4.0;
/// plus this many px, plus this share of the disparity: the near side jumps when parts are merged.
pub const GATE_PX: f64 = 0.5;
/// See [`GATE_PX`].
pub const GATE_SHARE: f64 = 0.08;
/// Weight of containment: if one box contains the other, the overlap is at least this share of the contained area, since
/// sightings split and merge.
pub const CONTAINMENT_WEIGHT: f64 = 0.6;
/// Cost of boxes without overlap, in the unit of a squared normalised innovation.
pub const OVERLAP_COST: f64 = 12.0;
/// Cost of widths that differ by a factor of e, in the same unit.
pub const SIZE_COST: f64 = 3.0;
/// Cost of a sighting without a track, in the same unit.
pub const UNMATCHED_COST: f64 = 24.0;
/// Agreement of the sighting of a real thing with its prediction in the mean, as the logarithm of a likelihood: boxes that
/// overlap by 0.7, and half of a squared normalised innovation. Only what agrees less counts against a sighting.
pub const TYPICAL_AGREEMENT: f64 = 0.75;
/// Share of a box that lies within the body of a track if it is a part of that thing.
pub const BODY_SHARE: f64 = 0.7;

// Parts of boundaries.

/// What is as high as a wall and reaches out of it by less, in metres, is a part of it: a drainpipe, a door case, a bay window.
pub const FLUSH_M: f64 = 0.25;
/// A part that reaches out by this much, in metres, is a thing of its own.
pub const STANDS_BEFORE_M: f64 = 0.4;
/// Time over which that is averaged, in seconds: some frames, as the face of a wall has errors of a decimetre at 20 m.
pub const FLUSH_TIME_S: f64 = 0.3;

// Things that are passed.

/// Things nearer than this, in metres, are about to be passed: parts of a side that is seen at a shallow angle come apart.
pub const PASSING_M: f64 = 8.0;
/// Smallest width of a thing that may be as long as a car, in metres.
pub const PASSING_WIDTH_M: f64 = 1.2;
/// Parts of it are seen from so far behind its near side on and so far, in metres: hardly any car is shorter, and who steps out
/// behind it is somebody else.
pub const PASSED_DEPTH_M: [f64; 2] = [0.5, 3.5];
/// A part may reach beyond the thing by this much, in metres: a mirror,
pub const PASSED_MARGIN_M: f64 = 0.15;
/// and this share of its width lies on the thing.
pub const PASSED_SHARE: f64 = 0.7;
/// Time for which the ground of a thing is remembered that is not tracked any more, in seconds: at 4 m/s the vehicle passes a car.
pub const MAX_PASSED_S: f64 = 2.0;
/// In a sharper bend things that are passed may lie in the own way, in 1/m: 8 m ahead it leaves the straight line by a metre.
pub const MAX_PASSED_CURVATURE_PER_M: f64 = 0.03;

// Extent.

/// Time constant of the sides of a thing, in seconds: faster, and each fragment changes its size; slower, and it lags behind
/// what comes into view as the vehicle passes.
pub const EXTENT_TIME_S: f64 = 0.3;
/// A single sighting changes a side as if the thing were at most this many times as large, or small, as before.
pub const MAX_RATIO: f64 = 2.0;
/// Standard deviation of the middle of a box, in px: sides are found in strips of four columns, and one of them may gain or lose
/// a strip;
pub const CENTRE_SIGMA_PX: f64 = 2.0;
/// and as a share of the width.
pub const CENTRE_SIGMA_SHARE: f64 = 0.04;
/// The same where both sides are open: cut or hidden;
pub const CUT_SIGMA_SHARE: f64 = 0.5;
/// and where the surface goes on at one of them: it was divided in nearly the same column in each frame, so that the errors do not average
/// out: after the ten frames of a second the middle is known to no more than the width.
pub const DIVIDED_SIGMA_SHARE: f64 = 3.0;
/// Standard deviation of the depth of the side that is seen where the picture cuts the other one, as a share of the width: things
/// are about as deep as wide, their corners round, and which part of them is seen changes with the angle. 0.5 m of a car.
pub const SIDE_DEPTH_SHARE: f64 = 0.3;
/// Standard deviation of the depth of what is seen of a thing that the picture cuts, in metres: its side comes into view, or leaves
/// it, part by part.
pub const CUT_DEPTH_SIGMA_M: f64 = 0.5;
/// A box closer to the border of the picture than this, in px, is cut by it: two strips.
pub const BORDER_PX: f64 = 8.0;

// Disparity.

/// Inflation of the disparity's standard deviation before it is known how much of it scatters: its errors are correlated over
/// frames, while the filter assumes independence.
pub const NOISE_INFLATION: f64 = 1.5;
/// Smallest share of the stated variance of a distance that is taken for what scatters from frame to frame;
pub const MIN_NOISE_SHARE: f64 = 0.16;
/// and the time over which that share is estimated, in seconds: some ten frames tell a variance.
pub const NOISE_SHARE_TIME_S: f64 = 0.8;
/// Part of the disparity's error that remains the same from frame to frame, in px, and is not averaged out: pixel locking, and
/// which part of a thing its near side is.
pub const SYSTEMATIC_PX: f64 = 0.05;
/// Smallest standard deviation of a disparity measurement, in px: parts of an object move within its region.
pub const MIN_SIGMA_PX: f64 = 0.04;

// Motion.

/// Initial standard deviation of the closing speed, in m/s; covers standing, preceding and oncoming objects. If we drive faster, it is
/// our speed for what is ahead,
pub const INITIAL_CLOSING_SIGMA_M_S: f64 = 12.0;
/// at most at this tangent of the angle from the axis: traffic in a lane beside ours 20 m away.
pub const MAX_TRAFFIC_TANGENT: f64 = 0.2;
/// Initial standard deviation of the lateral speed, in m/s.
pub const INITIAL_LATERAL_SIGMA_M_S: f64 = 4.0;
/// Process noise of the closing speed: spectral density of the acceleration, in m²/s³. Corresponds to a
/// standard deviation of 0.5 m/s after one second.
pub const PROCESS_NOISE: f64 = 0.25;
/// The same in the model of constant speed while the CUSUM test finds that its innovations are biased, as by braking, in m²/s³.
pub const BIASED_PROCESS_NOISE: f64 = 5.0;
/// Process noise of the lateral speed, in m²/s³, in the filter and in what the alarm predicts: 0.8 m/s after one second, what a walker or
/// a rider changes.
pub const LATERAL_PROCESS_NOISE: f64 = 0.6;
/// Standard deviation of a manoeuvre's acceleration before it is measured, in m/s²: drivers brake with 3, in an emergency with 8.
pub const MANOEUVRE_SIGMA_M_S2: f64 = 3.0;
/// Spectral density of the jerk, which is white noise during a manoeuvre, in m²/s⁵: 1.7 m/s² after a second, as who brakes may brake more, or no longer.
pub const JERK_NOISE: f64 = 3.0;
/// Time after which a manoeuvre is expected anew, if nothing tells of one yet, in seconds: a shorter time tells no acceleration.
pub const EXPECTED_AGAIN_S: f64 = 0.45;
/// An acceleration that differs from 0 by this many standard deviations is one.
pub const MANOEUVRE_SIGMAS: f64 = 2.0;
/// Nothing is said of the acceleration of a thing whose speed is known less well than this, in m/s.
pub const MAX_MANOEUVRE_SPEED_SIGMA_M_S: f64 = 1.5;
/// Share of what noise adds to an acceleration that is taken off it: its square exceeds that of the true one by the variance, but the
/// filter begins at 0. With half of it, times to collision are right in the mean of simulated braking.
pub const BRAKING_NOISE_SHARE: f64 = 0.5;
/// An acceleration that is less with its standard deviation is over, in m/s²: lifting the foot is no braking.
pub const STEADY_M_S2: f64 = 1.5;
/// Largest braking, in m/s²: dry asphalt.
pub const MAX_BRAKING_M_S2: f64 = 9.0;
/// Time after which a prediction forgets a change of the speed across, in seconds. The change is then at most √(0.6 · 1.5 / 2) =
/// 0.7 m/s (standard deviation): a walker who turns off by 30° has 0.7 m/s across, a lane change 1 m/s at its fastest, and a
/// driver, a rider or a walker who keeps his way sways by 0.2 m/s.
pub const WANDER_TIME_S: f64 = 1.5;
/// What is found again after a longer time without a sighting, in seconds, may be another thing, so that its place tells nothing of
/// the speed: two missed frames at 12.5 frames a second, or at 10.
pub const FOUND_AGAIN_S: f64 = 0.22;
/// Share of the CUSUM statistic that is kept from frame to frame.
pub const CUSUM_DECAY: f64 = 0.8;
/// CUSUM statistic above which the innovations are biased: 3.6 standard deviations of the statistic under
/// noise.
pub const CUSUM_THRESHOLD: f64 = 6.0;
/// A normalised innovation above this counts as an outlier; its weight decreases with its size.
pub const OUTLIER_SIGMAS: f64 = 3.0;
/// This many consecutive outliers that agree are a step of the measurement (another side of the object is
/// measured). If they grow, the speed has changed.
pub const STEP_FRAMES: u8 = 3;

// Standing or moving.

/// Speeds that a standing thing seems to have, in m/s, as its visible part changes and the own motion errs.
pub const STANDING_SPEED_M_S: f64 = 0.4;
/// Of that across, in m/s: what the own motion errs,
pub const STANDING_ACROSS_M_S: f64 = 0.1;
/// and what the visible part changes, as a share of the width in a second: that of a person cannot change much.
pub const STANDING_SIDES_PER_S: f64 = 0.2;
/// Speed across beyond the seeming one from which a thing may be somebody who walks, in m/s: a third of a walker's.
pub const WALKING_M_S: f64 = 0.5;
/// Speed of a walker along the axis, in m/s (standard deviation).
pub const WALKER_SIGMA_M_S: f64 = 1.5;
/// Nobody who walks or runs is said to be faster, in m/s: what may be is not taken for a walker.
pub const MAX_WALKER_M_S: f64 = 5.0;
/// Largest width and height of a walker's box, in metres.
pub const WALKER_M: [f64; 2] = [1.0, 2.3];
/// Squared normalised speeds (two degrees of freedom) below which a thing may stand, and above which it moves: 86 % and
/// 1 % of standing ones.
pub const STANDING_CHI2: f64 = 4.0;
/// See [`STANDING_CHI2`].
pub const MOVING_CHI2: f64 = 9.0;
/// A thing is said to stand once its speeds are known better than this, in m/s,
pub const MAX_STANDING_SIGMA_M_S: f64 = 1.0;
/// along the axis of a fast vehicle better than this share of its speed.
pub const MAX_STANDING_SIGMA_SHARE: f64 = 0.1;

// Static points of odometry on a thing.

/// Fewest static points on a thing that tell that it is static, and largest number of others beside them, as a share of theirs.
pub const STATIC_MIN_POINTS: u32 = 3;
/// See [`STATIC_MIN_POINTS`].
pub const STATIC_MOVING_SHARE: f64 = 0.25;
/// A point lies on a thing if its disparity differs by at most this, in px, plus this share of the disparity.
pub const STATIC_GATE_PX: f64 = 0.4;
/// See [`STATIC_GATE_PX`].
pub const STATIC_GATE_SHARE: f64 = 0.04;
/// Largest depth of that gate, in metres: what stands behind a walker is farther away.
pub const STATIC_MAX_DEPTH_M: f64 = 1.0;
/// Shares of width and height of a box at its sides and at its foot in which points may be those of the background and of the
/// ground.
pub const STATIC_MARGINS: [f64; 2] = [0.1, 0.15];
/// A point that has moved by more than this, in px, does not agree with the own motion any more.
pub const STATIC_TOLERANCE_PX: f64 = 1.0;
