//! Poses of a drive: joined over gaps and resets, and as lines of KITTI's `poses.txt`.

use perception::motion::pose::Pose;
use std::fmt::Write;

/// The pose of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Pose since the start, or since the last reset.
    pub pose: Pose,
    /// Number of resets so far.
    pub resets: u32,
}

/// Joins poses to one path from the first frame. A frame without a pose repeats the motion before it, and so does one with
/// a reset.
#[derive(Clone, Debug, Default)]
pub struct PathJoiner {
    last: Option<Pose>,
    /// The last motion from one frame to the next.
    step: Pose,
    /// From the frame of the readings to that of the path.
    base: Pose,
    resets: Option<u32>,
}

impl PathJoiner {
    /// The pose of the next frame.
    pub fn next(&mut self, reading: Option<Reading>) -> Pose {
        // The path begins at the first frame.
        let predicted = self.last.map_or(Pose::IDENTITY, |last| last.after(&self.step));
        let pose = match reading {
            Some(reading) if self.resets == Some(reading.resets) => self.base.after(&reading.pose),
            Some(reading) => {
                self.resets = Some(reading.resets);
                self.base = predicted.after(&reading.pose.inverse());
                predicted
            }
            None => predicted,
        };
        if let Some(last) = self.last {
            self.step = last.inverse().after(&pose);
        }
        self.last = Some(pose);
        pose
    }
}

/// A pose as a line of KITTI's `poses.txt`, camera to first camera: the 3×4 matrix, row by row.
pub fn pose_line(pose: &Pose) -> String {
    let mut line = String::with_capacity(200);
    for (row, at) in pose.rotation.iter().zip(pose.translation_m) {
        for value in row.iter().chain([&at]) {
            if !line.is_empty() {
                line.push(' ');
            }
            // Ten digits: a rotation that is read back is one, and a position at a kilometre keeps its micrometre.
            let _ = write!(line, "{value:.9e}");
        }
    }
    line
}

/// How far the length of a quaternion may be from 1.
const MAX_QUATERNION_ERROR: f64 = 1e-3;

/// The pose of a unit quaternion x, y, z, w and a position in metres; `None` if they are none.
pub fn pose_of(orientation: [f64; 4], position_m: [f64; 3]) -> Option<Pose> {
    let norm = orientation.iter().map(|q| q * q).sum::<f64>().sqrt();
    if !((norm - 1.0).abs() <= MAX_QUATERNION_ERROR && position_m.iter().all(|v| v.is_finite())) {
        return None;
    }
    let [x, y, z, w] = orientation.map(|q| q / norm);
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    Some(Pose { rotation, translation_m: position_m })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sources::motion_file::read_poses;

    fn bend(i: usize) -> Pose {
        let turned = 0.02 * i as f64;
        let translation_m = [50.0 * (turned.cos() - 1.0), 0.0, 50.0 * turned.sin()];
        Pose { translation_m, ..Pose::from_rotation_vector([0.0, -turned, 0.0]) }
    }

    fn apart(a: &Pose, b: &Pose) -> f64 {
        let error = a.inverse().after(b);
        error.angle_rad() + error.translation_m.iter().map(|v| v.abs()).sum::<f64>()
    }

    #[test]
    fn written_poses_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("poses.txt");
        let text: String = (0..40).map(|i| pose_line(&bend(i)) + "\n").collect();
        std::fs::write(&file, text).unwrap();
        let read = read_poses(&file).unwrap().poses;
        assert_eq!(read.len(), 40);
        assert!(read.iter().enumerate().all(|(i, pose)| apart(pose, &bend(i)) < 1e-6));
    }

    #[test]
    fn gaps_and_resets_continue_the_motion() {
        let mut joiner = PathJoiner::default();
        let elsewhere =
            Pose { translation_m: [3.0, 1.0, -7.0], ..Pose::from_rotation_vector([0.1, 0.5, 0.0]) };
        for i in 0..30 {
            let reading = match i {
                // Without a pose.
                10..=12 => None,
                0..=19 => Some(Reading { pose: bend(i), resets: 0 }),
                // A reset: the poses start anew at frame 20, somewhere else.
                _ => Some(Reading { pose: elsewhere.after(&bend(20).inverse().after(&bend(i))), resets: 1 }),
            };
            let pose = joiner.next(reading);
            assert!(apart(&pose, &bend(i)) < 1e-9, "frame {i}: {pose:?}, {:?}", bend(i));
        }
        // The path begins with the first frame, wherever the readings do.
        let mut joiner = PathJoiner::default();
        for i in 5..9 {
            let pose = joiner.next(Some(Reading { pose: bend(i), resets: 3 }));
            assert!(apart(&pose, &bend(5).inverse().after(&bend(i))) < 1e-9);
        }
    }

    #[test]
    fn a_quaternion_is_its_rotation() {
        let half = 0.15_f64;
        let pose = pose_of([0.0, -half.sin(), 0.0, half.cos()], [1.0, 2.0, 3.0]).unwrap();
        let expected =
            Pose { translation_m: [1.0, 2.0, 3.0], ..Pose::from_rotation_vector([0.0, -0.3, 0.0]) };
        assert!(apart(&pose, &expected) < 1e-12);
        assert_eq!(pose_of([0.0; 4], [0.0; 3]), None);
        assert_eq!(pose_of([f64::NAN, 0.0, 0.0, 1.0], [0.0; 3]), None);
        assert_eq!(pose_of([0.0, 0.0, 0.0, 1.0], [f64::NAN, 0.0, 0.0]), None);
    }
}
