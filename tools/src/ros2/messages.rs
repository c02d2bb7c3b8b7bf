//! Frames as standard messages of ROS 2, serialised.
//!
//! Obstacles and images are in the left camera's optical frame (`camera_left`: x to the right, y down, z forward), as in
//! recordings; the pose is that of the camera in axes of REP 103 (x forward, y to the left, z up).

use super::cdr::Cdr;
use crate::recording::encode::{BOX_DEPTH_M, Side};
use crate::reporting::motion::MotionLine;
use crate::reporting::record::{FrameRecord, ObstacleLine};
use perception::rig::Rig;

/// Steps of a disparity in messages, per px.
const STEPS_PER_PX: f32 = 256.0;

/// What an unknown disparity becomes: below the minimum of the message, which is 0.
const UNKNOWN_PX: f32 = -1.0;

/// Frame in which the pose is, and that of the pose.
const POSE_FRAMES: [&str; 2] = ["lookout_odom", "lookout_camera"];

/// Numbers of a covariance matrix of a pose or twist, row after row.
const COVARIANCE: usize = 36;

/// Time of a message, in ns since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Time(pub u64);

fn header(cdr: &mut Cdr, Time(ns): Time, frame: &str) {
    cdr.i32(i32::try_from(ns / 1_000_000_000).unwrap_or(i32::MAX));
    cdr.u32((ns % 1_000_000_000) as u32);
    cdr.text(frame);
}

/// `vision_msgs/Detection3DArray`: the confirmed obstacles as boxes. The score is the probability that the obstacle exists,
/// `id` the number of its track; of the covariance the variance of the distance is set.
pub fn detections(time: Time, record: &FrameRecord, rig: &Rig) -> Vec<u8> {
    let frame = Side::Left.frame();
    let confirmed = || record.obstacles.iter().filter(|o| o.confirmed);
    let mut cdr = Cdr::default();
    header(&mut cdr, time, frame);
    cdr.length(confirmed().count());
    for obstacle in confirmed() {
        let centre = centre(obstacle, rig);
        header(&mut cdr, time, frame);
        cdr.length(1);
        cdr.text(&obstacle.class);
        cdr.f64(&[obstacle.probability]);
        pose(&mut cdr, centre, [0.0, 0.0, 0.0, 1.0]);
        let mut covariance = [0.0; COVARIANCE];
        covariance[14] = obstacle.distance_sigma_m * obstacle.distance_sigma_m;
        cdr.f64(&covariance);
        pose(&mut cdr, centre, [0.0, 0.0, 0.0, 1.0]);
        cdr.f64(&[obstacle.width_m, obstacle.height_m, BOX_DEPTH_M]);
        cdr.text(&obstacle.track.to_string());
    }
    cdr.finish()
}

/// Centre of an obstacle's box, in the optical frame; its depth is not measured.
fn centre(o: &ObstacleLine, rig: &Rig) -> [f64; 3] {
    let middle_row = f64::from(o.y_px) + 0.5 * f64::from(o.height_px);
    let down = (middle_row - rig.cy_px) * o.distance_m / rig.focal_px;
    [o.lateral_m, down, o.distance_m + 0.5 * BOX_DEPTH_M]
}

fn pose(cdr: &mut Cdr, position: [f64; 3], orientation: [f64; 4]) {
    cdr.f64(&position);
    cdr.f64(&orientation);
}

/// `sensor_msgs/Image`: the left picture (`mono8`), rectified.
pub fn image(time: Time, (width, height): (u32, u32), grey: &[u8]) -> Vec<u8> {
    let mut cdr = Cdr::default();
    let step = width as usize;
    picture(&mut cdr, time, (width, height), ("mono8", step), grey.iter().copied());
    cdr.finish()
}

fn picture(
    cdr: &mut Cdr,
    time: Time,
    (width, height): (u32, u32),
    (encoding, step): (&str, usize),
    data: impl IntoIterator<Item = u8>,
) {
    header(cdr, time, Side::Left.frame());
    cdr.u32(height);
    cdr.u32(width);
    cdr.text(encoding);
    cdr.u8(0);
    cdr.length(step);
    cdr.bytes(step * height as usize, data);
}

/// `stereo_msgs/DisparityImage`: the map (`32FC1`, px; −1 where it is unknown), focal length and baseline.
/// `disparities` is the number that are searched.
pub fn disparity(
    time: Time,
    (width, height): (u32, u32),
    map: &[u16],
    rig: &Rig,
    disparities: u32,
) -> Vec<u8> {
    let mut cdr = Cdr::default();
    header(&mut cdr, time, Side::Left.frame());
    let px = |steps: u16| if steps == 0 { UNKNOWN_PX } else { f32::from(steps) / STEPS_PER_PX };
    let data = map.iter().flat_map(|&steps| px(steps).to_le_bytes());
    picture(&mut cdr, time, (width, height), ("32FC1", 4 * width as usize), data);
    cdr.f32(rig.focal_px as f32);
    cdr.f32(rig.baseline_m as f32);
    // The region in which disparities can be: the whole image.
    for value in [0, 0, height, width] {
        cdr.u32(value);
    }
    cdr.u8(0);
    cdr.f32(0.0);
    cdr.f32(disparities as f32);
    cdr.f32(1.0 / STEPS_PER_PX);
    cdr.finish()
}

/// State of a part in `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// It works.
    Ok = 0,
    /// It works, but not well.
    Warn = 1,
    /// It does not work.
    Error = 2,
    /// Nothing is heard of it.
    Stale = 3,
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Its state.
    pub level: Level,
    /// Its name.
    pub name: String,
    /// The state in words.
    pub message: String,
    /// Names and values.
    pub values: Vec<(String, String)>,
}

/// `diagnostic_msgs/DiagnosticArray`; `hardware` is the vehicle.
pub fn diagnostics(time: Time, hardware: &str, diagnostics: &[Diagnostic]) -> Vec<u8> {
    let mut cdr = Cdr::default();
    header(&mut cdr, time, "");
    cdr.length(diagnostics.len());
    for diagnostic in diagnostics {
        cdr.u8(diagnostic.level as u8);
        cdr.text(&diagnostic.name);
        cdr.text(&diagnostic.message);
        cdr.text(hardware);
        cdr.length(diagnostic.values.len());
        for (key, value) in &diagnostic.values {
            cdr.text(key);
            cdr.text(value);
        }
    }
    cdr.finish()
}

/// Pose of the left camera since the start of the run, in optical axes: position in metres, orientation as a quaternion
/// x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Right, down, forward of the first camera.
    pub position_m: [f64; 3],
    /// Orientation.
    pub orientation: [f64; 4],
}

/// `nav_msgs/Odometry`; `None` while the motion is unknown. Only the variances of speed and yaw rate are set.
pub fn odometry(time: Time, pose_now: &Pose, motion: &MotionLine) -> Option<Vec<u8>> {
    let (speed, yaw_rate) = (motion.speed_m_s?, motion.yaw_rate_rad_s?);
    let [right, down, forward] = pose_now.position_m;
    let [x, y, z, w] = pose_now.orientation;
    let mut cdr = Cdr::default();
    header(&mut cdr, time, POSE_FRAMES[0]);
    cdr.text(POSE_FRAMES[1]);
    // Optical axes to those of REP 103: forward, left, up.
    pose(&mut cdr, [forward, -right, -down], [z, -x, -y, w]);
    cdr.f64(&[0.0; COVARIANCE]);
    cdr.f64(&[speed, 0.0, 0.0, 0.0, 0.0, yaw_rate]);
    let variance = |sigma: Option<f64>| sigma.map_or(0.0, |s| s * s);
    let mut covariance = [0.0; COVARIANCE];
    (covariance[0], covariance[35]) =
        (variance(motion.speed_sigma_m_s), variance(motion.yaw_rate_sigma_rad_s));
    cdr.f64(&covariance);
    Some(cdr.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 400.0, baseline_m: 0.2, cx_px: 32.0, cy_px: 24.0 };

    #[test]
    fn confirmed_obstacles_become_boxes() {
        let obstacle = |confirmed| ObstacleLine {
            track: 12,
            class: "vehicle".into(),
            confirmed,
            distance_m: 10.0,
            y_px: 24,
            height_px: 8,
            ..ObstacleLine::default()
        };
        let record =
            FrameRecord { obstacles: vec![obstacle(true), obstacle(false)], ..FrameRecord::default() };
        let one = detections(Time(1_500_000_000), &record, &RIG);
        assert_eq!(centre(&record.obstacles[0], &RIG), [0.0, 0.1, 10.2]);
        // Seconds, nanoseconds, and the name of the frame with its length and zero.
        assert_eq!(one[4..12], [1, 0, 0, 0, 0x00, 0x65, 0xcd, 0x1d]);
        assert_eq!((one[12], &one[16..28]), (12, &b"camera_left\0"[..]));
        assert_eq!(one[28..32], [1, 0, 0, 0], "one of two is confirmed");
        assert!(one.windows(8).any(|bytes| bytes == b"vehicle\0"));
    }

    #[test]
    fn images_have_their_size() {
        let plain = image(Time(0), (3, 2), &[1, 2, 3, 4, 5, 6]);
        assert_eq!(plain[plain.len() - 10..], [6, 0, 0, 0, 1, 2, 3, 4, 5, 6]);
        // A picture that is too short is filled up: the message stays readable.
        assert_eq!(image(Time(0), (3, 2), &[1]).len(), plain.len());
        let map = disparity(Time(0), (2, 1), &[512, 0], &RIG, 64);
        let floats: Vec<u8> = [2.0_f32, -1.0, 400.0, 0.2].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert!(map.windows(16).any(|bytes| bytes == floats));
    }

    #[test]
    fn odometry_needs_a_known_motion() {
        let pose = Pose { position_m: [1.0, 2.0, 3.0], orientation: [0.0, 0.6, 0.0, 0.8] };
        assert_eq!(odometry(Time(0), &pose, &MotionLine::default()), None);
        let motion = MotionLine { speed_m_s: Some(5.0), yaw_rate_rad_s: Some(0.1), ..MotionLine::default() };
        let message = odometry(Time(0), &pose, &motion).unwrap();
        // Yaw to the left is positive: about down in optical axes it is negative, about up positive.
        let numbers: Vec<u8> =
            [3.0, -1.0, -2.0, 0.0, -0.0, -0.6, 0.8].iter().flat_map(|v: &f64| v.to_le_bytes()).collect();
        assert!(message.windows(numbers.len()).any(|bytes| bytes == numbers));
    }
}
