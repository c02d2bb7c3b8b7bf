//! Own motion against ground truth: drift by KITTI's rule, errors of speed and yaw rate, the path ahead, and whether the
//! given standard deviations are right.
//!
//! Poses are those of the left camera in any fixed frame with its axes (x right, y down, z forward); frame by frame, both
//! lists belong together. Speed is positive forwards, yaw rate to the left.

use super::quantile;
use crate::reporting::record::tidy;
use perception::motion::Motion;
use perception::motion::body::Body;
use perception::motion::curvature::CurvatureFilter;
use perception::motion::pose::Pose;
use serde::Serialize;
use sources::motion_file::Trajectory;

/// Lengths of the parts of a path that drift is measured over, in metres: those of KITTI's odometry benchmark, and shorter
/// ones for shorter drives.
pub const LENGTHS_M: [f64; 12] =
    [10.0, 20.0, 40.0, 80.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0];

/// How far ahead the path is predicted, in seconds: about the reaction time of a driver and half of a full braking.
pub const AHEAD_S: f64 = 1.5;

/// A lateral error of the path up to this, in metres, is good: between two lanes of 3.5 m and a car of 1.8 m more than
/// twice that is free.
pub const GOOD_PATH_M: f64 = 0.3;

/// Ground truth of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TruthFrame {
    /// Time, in seconds.
    pub time_s: f64,
    /// Pose of the camera.
    pub pose: Pose,
    /// Speed, in m/s.
    pub speed_m_s: f64,
    /// Yaw rate, in rad/s.
    pub yaw_rate_rad_s: f64,
    /// Measured speed and yaw rate in the middle between this frame and the next; `None`: they follow from the poses.
    pub to_next: Option<[f64; 2]>,
}

/// Ground truth of a drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// Its frames.
    pub frames: Vec<TruthFrame>,
    /// Whether the poses are planar (OXTS): height is not compared.
    pub is_planar: bool,
}

impl Truth {
    /// The truth of a path of the camera: planar if it comes with what was measured between frames. `times_s` are the
    /// times of the frames where the path has none.
    pub fn new(path: &Trajectory, times_s: &[f64]) -> Self {
        let times_s = if path.times_s.is_empty() { times_s } else { &path.times_s };
        let is_measured = !path.speed_m_s.is_empty() && !path.yaw_rate_rad_s.is_empty();
        let rates: Vec<[f64; 2]> = if is_measured {
            path.speed_m_s.iter().zip(&path.yaw_rate_rad_s).map(|(v, w)| [*v, *w]).collect()
        } else {
            path.differences(times_s)
        };
        let frame = |(i, (&time_s, [speed_m_s, yaw_rate_rad_s])): (usize, (&f64, [f64; 2]))| {
            let to_next = path.between.get(i).copied();
            Some(TruthFrame { time_s, pose: *path.poses.get(i)?, speed_m_s, yaw_rate_rad_s, to_next })
        };
        let frames = times_s.iter().zip(rates).enumerate().map_while(frame).collect();
        Self { frames, is_planar: !path.between.is_empty() }
    }
}

/// Estimate for one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EstimateFrame {
    /// Pose of the camera.
    pub pose: Pose,
    /// Filtered motion at the frame's time; `None` while it is unknown, or if there are only poses.
    pub motion: Option<Motion>,
}

/// Drift over parts of one length; means over the parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Drift {
    /// Length of the parts.
    pub length_m: f64,
    /// Number of parts.
    pub parts: usize,
    /// Error of the position at the end, in percent of the length.
    pub translation_percent: f64,
    /// Error of the orientation at the end, divided by the length.
    pub rotation_deg_per_m: f64,
}

/// Root mean square errors of speed and yaw rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RateErrors {
    /// Number of frames.
    pub frames: usize,
    /// Of the speed.
    pub speed_rms_m_s: f64,
    /// Of the yaw rate.
    pub yaw_rate_rms_rad_s: f64,
}

/// Lateral error of the predicted path at the place that is reached [`AHEAD_S`] later.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PathErrors {
    /// Number of frames.
    pub frames: usize,
    /// Median.
    pub median_m: f64,
    /// 95th percentile.
    pub p95_m: f64,
    /// Share of frames with at most [`GOOD_PATH_M`], in percent.
    pub good_percent: f64,
    /// The same figures of a straight path, for comparison: its median.
    pub straight_median_m: f64,
    /// 95th percentile of a straight path.
    pub straight_p95_m: f64,
    /// Share of frames in which a straight path is good, in percent.
    pub straight_good_percent: f64,
}

/// Whether standard deviations are right: errors divided by them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Consistency {
    /// Number of frames.
    pub frames: usize,
    /// Root mean square of the normalised error of the speed; 1 is right, more is overconfident.
    pub speed: f64,
    /// The same of the yaw rate.
    pub yaw_rate: f64,
    /// Share of frames in which both errors are below two standard deviations, in percent; 91 is right if they are
    /// independent.
    pub within_two_sigma_percent: f64,
}

/// Results of an evaluation; `None` where nothing can be said.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OdometryScore {
    /// Number of frames.
    pub frames: usize,
    /// Length of the true path.
    pub length_m: f64,
    /// Share of the frames after the first without known motion, in percent.
    pub unknown_percent: Option<f64>,
    /// Drift by length, those lengths that fit.
    pub drift: Vec<Drift>,
    /// Mean over all parts of all lengths, as in KITTI's table.
    pub drift_all: Option<Drift>,
    /// Errors of the motion between successive poses.
    pub frame_to_frame: Option<RateErrors>,
    /// Errors of the filtered motion.
    pub filtered: Option<RateErrors>,
    /// Errors of the path ahead.
    pub path: Option<PathErrors>,
    /// Consistency of the filtered motion.
    pub consistency: Option<Consistency>,
}

/// Scores an estimate. `body` is the vehicle, for the path ahead. Both
/// have one entry per frame; what exceeds the shorter one is ignored.
pub fn score(truth: &Truth, estimate: &[EstimateFrame], body: &Body) -> OdometryScore {
    let frames = truth.frames.len().min(estimate.len());
    let both =
        Both { truth: &truth.frames[..frames], estimate: &estimate[..frames], is_planar: truth.is_planar };
    let distances_m = both.distances();
    let parts: Vec<Part> =
        LENGTHS_M.iter().flat_map(|&length_m| both.parts(&distances_m, length_m)).collect();
    let of_length = |length_m: f64| mean_drift(&parts, |part| part.length_m == length_m);
    // Before the first frame is no other.
    let after_first = both.estimate.get(1..).unwrap_or_default();
    let unknown = after_first.iter().filter(|frame| frame.motion.is_none()).count();
    OdometryScore {
        frames,
        length_m: tidy(distances_m.last().copied().unwrap_or_default()),
        unknown_percent: (!after_first.is_empty())
            .then(|| tidy(100.0 * unknown as f64 / after_first.len() as f64)),
        drift: LENGTHS_M.into_iter().filter_map(of_length).collect(),
        drift_all: mean_drift(&parts, |_| true),
        frame_to_frame: rate_errors(both.frame_to_frame()),
        filtered: rate_errors(both.filtered().map(|frame| (frame.speed, frame.yaw_rate))),
        path: both.path_errors(body),
        consistency: both.consistency(),
    }
}

/// The pose `to` in the frame of `from`.
fn relative(from: &Pose, to: &Pose) -> Pose {
    from.inverse().after(to)
}

/// Errors of one part of the path.
struct Part {
    length_m: f64,
    translation: f64,
    rotation_rad_per_m: f64,
}

/// Mean over some parts; its length is their mean length.
fn mean_drift(parts: &[Part], is_meant: impl Fn(&Part) -> bool) -> Option<Drift> {
    let parts: Vec<&Part> = parts.iter().filter(|part| is_meant(part)).collect();
    let mean = |value: fn(&Part) -> f64| parts.iter().map(|p| value(p)).sum::<f64>() / parts.len() as f64;
    (!parts.is_empty()).then(|| Drift {
        length_m: tidy(mean(|p| p.length_m)),
        parts: parts.len(),
        translation_percent: tidy(100.0 * mean(|p| p.translation)),
        rotation_deg_per_m: round(mean(|p| p.rotation_rad_per_m).to_degrees()),
    })
}

/// Six decimals: degrees a metre and rad/s are small numbers.
fn round(value: f64) -> f64 {
    if value.is_finite() { (value * 1e6).round() / 1e6 } else { 0.0 }
}

fn rate_errors(errors: impl Iterator<Item = (f64, f64)>) -> Option<RateErrors> {
    let (mut frames, mut speed, mut yaw_rate) = (0, 0.0, 0.0);
    for (of_speed, of_yaw_rate) in errors {
        frames += 1;
        speed += of_speed * of_speed;
        yaw_rate += of_yaw_rate * of_yaw_rate;
    }
    let rms = |sum: f64| round((sum / frames as f64).sqrt());
    (frames > 0).then(|| RateErrors { frames, speed_rms_m_s: rms(speed), yaw_rate_rms_rad_s: rms(yaw_rate) })
}

/// Speed and yaw rate from one pose to another; `None` if no time passes between them. The speed is that of the whole step,
/// in a plane without its height, with the sign of its forward part.
pub fn step_rates(from: &Pose, to: &Pose, seconds: f64, is_planar: bool) -> Option<(f64, f64)> {
    let step = relative(from, to);
    let metres = size(step.translation_m, is_planar).copysign(step.translation_m[2]);
    (seconds > 0.0).then(|| (metres / seconds, step.yaw_rad() / seconds))
}

/// Length of a translation; in a plane without its height.
fn size([x, y, z]: [f64; 3], is_planar: bool) -> f64 {
    if is_planar { x.hypot(z) } else { x.hypot(y).hypot(z) }
}

/// Distance of a place from the path of the camera, in metres. The vehicle turns about a point beside its rear axle, so
/// that the camera, too, moves on a circle about it. `place` is right and forward of the camera, in the
/// vehicle's axes.
pub fn path_distance_m(curvature_per_m: f64, rear_axle_m: f64, place: [f64; 2]) -> f64 {
    let [right, forward] = place;
    if curvature_per_m.abs() < 1e-9 {
        return right.abs();
    }
    // The centre lies to the left for positive curvature. The difference of both distances to it, without
    // cancellation for large radii.
    let radius = 1.0 / curvature_per_m;
    let own = radius.hypot(rear_axle_m);
    let other = (right + radius).hypot(forward + rear_axle_m);
    let squares = right * (right + 2.0 * radius) + forward * (forward + 2.0 * rear_axle_m);
    (squares / (own + other)).abs()
}

/// Errors of the filtered motion at one frame.
struct MotionError {
    speed: f64,
    yaw_rate: f64,
    motion: Motion,
}

/// Truth and estimate of the same frames.
#[derive(Clone, Copy)]
struct Both<'a> {
    truth: &'a [TruthFrame],
    estimate: &'a [EstimateFrame],
    is_planar: bool,
}

impl<'a> Both<'a> {
    /// Length of the true path up to each frame.
    fn distances(&self) -> Vec<f64> {
        let mut sum_m = 0.0;
        let steps =
            self.truth.windows(2).map(|w| size(relative(&w[0].pose, &w[1].pose).translation_m, false));
        let sums = std::iter::once(0.0).chain(steps).map(|step_m| {
            sum_m += step_m;
            sum_m
        });
        sums.take(self.truth.len()).collect()
    }

    /// The parts of one length: from every frame to the first that is so far away along the path.
    fn parts(&self, distances_m: &[f64], length_m: f64) -> Vec<Part> {
        let part = |first: usize| {
            let end_m = distances_m[first] + length_m;
            let last = distances_m.partition_point(|&distance_m| distance_m < end_m);
            let is = relative(&self.truth[first].pose, &self.truth.get(last)?.pose);
            let found = relative(&self.estimate[first].pose, &self.estimate[last].pose);
            let error = relative(&is, &found);
            let rotation_rad = if self.is_planar { error.yaw_rad().abs() } else { error.angle_rad() };
            Some(Part {
                length_m,
                translation: size(error.translation_m, self.is_planar) / length_m,
                rotation_rad_per_m: rotation_rad / length_m,
            })
        };
        (0..self.truth.len()).map_while(part).collect()
    }

    /// Errors of speed and yaw rate between successive poses.
    fn frame_to_frame(self) -> impl Iterator<Item = (f64, f64)> + 'a {
        self.truth.windows(2).zip(self.estimate.windows(2)).filter_map(move |(truth, estimate)| {
            let seconds = truth[1].time_s - truth[0].time_s;
            let (speed, yaw_rate) =
                step_rates(&estimate[0].pose, &estimate[1].pose, seconds, self.is_planar)?;
            let (true_speed, true_yaw_rate) = match truth[0].to_next {
                Some([speed, yaw_rate]) => (speed, yaw_rate),
                None => step_rates(&truth[0].pose, &truth[1].pose, seconds, self.is_planar)?,
            };
            Some((speed - true_speed, yaw_rate - true_yaw_rate))
        })
    }

    fn filtered(self) -> impl Iterator<Item = MotionError> + 'a {
        self.truth.iter().zip(self.estimate).filter_map(|(truth, estimate)| {
            let motion = estimate.motion?;
            Some(MotionError {
                speed: motion.speed_m_s - truth.speed_m_s,
                yaw_rate: motion.yaw_rate_rad_s - truth.yaw_rate_rad_s,
                motion,
            })
        })
    }

    fn path_errors(&self, body: &Body) -> Option<PathErrors> {
        let (mut arcs, mut straights) = (Vec::new(), Vec::new());
        let (mut curvature, mut before_s) = (CurvatureFilter::default(), None);
        for (frame, start) in self.estimate.iter().zip(self.truth) {
            let elapsed_s = start.time_s - before_s.replace(start.time_s).unwrap_or(start.time_s);
            let path = frame.motion.map(|motion| curvature.update(&motion, elapsed_s, *body, None));
            let place = place_at(self.truth, start.time_s + AHEAD_S);
            let (Some(path), Some(place)) = (path, place) else { continue };
            let [x, _, z] = start.pose.inverse().apply(place);
            let place = path.body.turn_to_vehicle([x, z]);
            arcs.push(path_distance_m(path.curvature_per_m, path.body.rear_axle_m, place));
            straights.push(x.abs());
        }
        let good = |errors: &[f64]| {
            let count = errors.iter().filter(|error| **error <= GOOD_PATH_M).count();
            tidy(100.0 * count as f64 / errors.len() as f64)
        };
        Some(PathErrors {
            frames: arcs.len(),
            good_percent: good(&arcs),
            straight_good_percent: good(&straights),
            median_m: tidy(quantile(&mut arcs, 0.5)?),
            p95_m: tidy(quantile(&mut arcs, 0.95)?),
            straight_median_m: tidy(quantile(&mut straights, 0.5)?),
            straight_p95_m: tidy(quantile(&mut straights, 0.95)?),
        })
    }

    fn consistency(self) -> Option<Consistency> {
        let (mut frames, mut within, mut speed, mut yaw_rate) = (0_usize, 0_usize, 0.0, 0.0);
        for error in self.filtered() {
            let v = error.speed / error.motion.speed_sigma_m_s;
            let w = error.yaw_rate / error.motion.yaw_rate_sigma_rad_s;
            // A standard deviation of zero is not one.
            if v.is_finite() && w.is_finite() {
                frames += 1;
                within += usize::from(v.abs() < 2.0 && w.abs() < 2.0);
                speed += v * v;
                yaw_rate += w * w;
            }
        }
        let count = frames as f64;
        (frames > 0).then(|| Consistency {
            frames,
            speed: tidy((speed / count).sqrt()),
            yaw_rate: tidy((yaw_rate / count).sqrt()),
            within_two_sigma_percent: tidy(100.0 * within as f64 / count),
        })
    }
}

/// The true position at a time, linear between frames; `None` after the last frame.
fn place_at(truth: &[TruthFrame], time_s: f64) -> Option<[f64; 3]> {
    let after = truth.partition_point(|frame| frame.time_s < time_s);
    let (a, b) = (truth.get(after.checked_sub(1)?)?, truth.get(after)?);
    let share = (time_s - a.time_s) / (b.time_s - a.time_s);
    let (from, to) = (a.pose.translation_m, b.pose.translation_m);
    Some(std::array::from_fn(|i| from[i] + share * (to[i] - from[i])))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera above the axle about which the vehicle turns.
    const AT_AXLE: Body =
        Body { width_m: 1.8, front_m: 1.7, camera_right_m: 0.0, rear_axle_m: 0.0, camera_yaw_rad: 0.0 };

    /// A drive with `speed` and `yaw_rate` about a rear axle `axle_m` behind the camera, at 10 frames a second.
    fn drive(speed: f64, yaw_rate: f64, axle_m: f64, frames: usize) -> Trajectory {
        let pose = |i: usize| {
            let turned = yaw_rate * 0.1 * i as f64;
            let (x, z) = if yaw_rate == 0.0 {
                (0.0, speed * 0.1 * i as f64)
            } else {
                let radius = speed / yaw_rate;
                (radius * (turned.cos() - 1.0), radius * turned.sin())
            };
            // The axle is at (x, z − axle); the camera lies before it along the heading.
            let translation_m = [x - axle_m * turned.sin(), 0.0, z + axle_m * (turned.cos() - 1.0)];
            Pose { translation_m, ..Pose::from_rotation_vector([0.0, -turned, 0.0]) }
        };
        Trajectory { poses: (0..frames).map(pose).collect(), ..Trajectory::default() }
    }

    fn times(frames: usize) -> Vec<f64> {
        (0..frames).map(|i| 7.0 + 0.1 * i as f64).collect()
    }

    fn moving(speed: f64, yaw_rate: f64) -> Option<Motion> {
        Some(Motion {
            speed_m_s: speed,
            speed_sigma_m_s: 0.1,
            yaw_rate_rad_s: yaw_rate,
            yaw_rate_sigma_rad_s: 0.01,
            ..Motion::default()
        })
    }

    #[test]
    fn a_perfect_estimate_has_no_error() {
        // At 10 m/s the vehicle turns about a point 0.6 m behind the camera.
        let path = drive(10.0, 0.2, 0.6, 101);
        let truth = Truth::new(&path, &times(101));
        let estimate: Vec<EstimateFrame> =
            path.poses.iter().map(|&pose| EstimateFrame { pose, motion: moving(10.0, 0.2) }).collect();
        let score = score(&truth, &estimate, &Body::default());
        let lengths: Vec<f64> = score.drift.iter().map(|d| d.length_m).collect();
        assert_eq!(lengths, [10.0, 20.0, 40.0, 80.0, 100.0]);
        assert!(score.drift.iter().all(|d| d.translation_percent < 1e-6 && d.rotation_deg_per_m < 1e-5));
        let both = score.frame_to_frame.unwrap();
        assert_eq!((both.frames, both.speed_rms_m_s, both.yaw_rate_rms_rad_s), (100, 0.0, 0.0));
        let path = score.path.unwrap();
        // The path takes a part of the yaw rate for a correction that does not last.
        assert!((path.frames, path.good_percent) == (86, 100.0) && path.median_m < 0.1, "{path:?}");
        // 15 m on a circle of 50 m: 2.2 m beside the straight line, and the camera's own swing.
        assert!((path.straight_median_m - 2.41).abs() < 0.05, "{path:?}");
        assert_eq!(score.unknown_percent, Some(0.0));
        let consistency = score.consistency.unwrap();
        assert!(consistency.speed < 0.5 && consistency.within_two_sigma_percent == 100.0, "{consistency:?}");
    }

    #[test]
    fn a_scale_error_is_a_drift_of_as_many_percent() {
        let truth = Truth::new(&drive(10.0, 0.0, 0.0, 60), &times(60));
        let estimate: Vec<EstimateFrame> = drive(10.2, 0.0, 0.0, 60)
            .poses
            .iter()
            .enumerate()
            .map(|(i, &pose)| EstimateFrame {
                pose,
                motion: (i % 2 == 0).then(|| moving(10.3, 0.02).unwrap()),
            })
            .collect();
        let score = score(&truth, &estimate, &AT_AXLE);
        for drift in score.drift.iter().chain(&score.drift_all) {
            assert!(
                (drift.translation_percent - 2.0).abs() < 1e-3 && drift.rotation_deg_per_m == 0.0,
                "{drift:?}"
            );
        }
        assert!((score.frame_to_frame.unwrap().speed_rms_m_s - 0.2).abs() < 1e-6);
        let filtered = score.filtered.unwrap();
        assert_eq!((filtered.frames, filtered.yaw_rate_rms_rad_s), (30, 0.02));
        assert!((filtered.speed_rms_m_s - 0.3).abs() < 1e-5, "{filtered:?}");
        // 30 of the 59 after the first.
        assert_eq!(score.unknown_percent, Some(50.8475));
        // Three and two standard deviations.
        let consistency = score.consistency.unwrap();
        assert!((consistency.speed - 3.0).abs() < 1e-3 && (consistency.yaw_rate - 2.0).abs() < 1e-3);
        assert_eq!(consistency.within_two_sigma_percent, 0.0);
    }

    #[test]
    fn a_turn_that_is_missed_shows_in_degrees_a_metre() {
        let truth = Truth::new(&drive(10.0, 0.1, 0.0, 50), &times(50));
        let poses = drive(10.0, 0.0, 0.0, 50).poses;
        let estimate: Vec<EstimateFrame> =
            poses.into_iter().map(|pose| EstimateFrame { pose, motion: None }).collect();
        let score = score(&truth, &estimate, &AT_AXLE);
        // 0.01 rad a metre; the last frame of a part lies up to a frame beyond its length.
        let drift = score.drift[2];
        assert!((drift.rotation_deg_per_m - 0.573).abs() < 0.02, "{drift:?}");
        assert!((score.frame_to_frame.unwrap().yaw_rate_rms_rad_s - 0.1).abs() < 1e-6);
        // Poses alone say nothing of the filtered motion.
        assert_eq!(
            (score.unknown_percent, score.filtered, score.path, score.consistency),
            (Some(100.0), None, None, None)
        );
    }

    #[test]
    fn a_place_on_the_circle_of_the_camera_has_no_distance() {
        for curvature in [0.05, -0.05, 1e-6, -1e-12] {
            for turned in [0.1, 0.4] {
                let sign = f64::signum(curvature);
                let (radius, axle) = (1.0 / curvature.abs(), 1.6);
                if radius > 1e9 {
                    continue;
                }
                let radius = radius.min(1e6);
                let turned = turned * 20.0 / radius;
                let place = [
                    -sign * (radius * (1.0 - turned.cos()) + axle * turned.sin()),
                    radius * turned.sin() + axle * (turned.cos() - 1.0),
                ];
                let beside = [place[0] + 0.25, place[1]];
                assert!(path_distance_m(curvature, axle, place) < 1e-6, "{curvature} {turned}");
                assert!((path_distance_m(curvature, axle, beside) - 0.25).abs() < 0.03);
            }
        }
        assert_eq!(path_distance_m(0.0, 1.6, [-0.5, 20.0]), 0.5);
    }

    #[test]
    fn measured_rates_come_first_and_repeated_times_do_no_harm() {
        let mut path = drive(10.0, 0.0, 0.0, 5);
        path.speed_m_s = vec![9.0; 5];
        path.yaw_rate_rad_s = vec![0.1; 5];
        path.times_s = vec![0.0, 0.1, 0.1, 0.2, 0.3];
        path.between = vec![[9.0, 0.3]; 4];
        let truth = Truth::new(&path, &[]);
        assert!(truth.is_planar && truth.frames.len() == 5);
        let estimate = vec![EstimateFrame { pose: Pose::IDENTITY, motion: moving(9.0, 0.1) }; 7];
        let score = score(&truth, &estimate, &AT_AXLE);
        let steps = score.frame_to_frame.unwrap();
        assert_eq!(
            (score.frames, steps.frames, steps.speed_rms_m_s, steps.yaw_rate_rms_rad_s),
            (5, 3, 9.0, 0.3)
        );
        assert_eq!(score.filtered.unwrap().speed_rms_m_s, 0.0);
        assert_eq!((score.drift.len(), score.path), (0, None), "too short");
        // Nothing at all.
        assert_eq!(super::score(&Truth::default(), &[], &AT_AXLE), OdometryScore::default());
    }
}
