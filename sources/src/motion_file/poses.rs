//! KITTI's poses: a line a frame with the twelve numbers of a 3×4 matrix, camera to first camera.

use super::table::{fault, is_blank, number, read};
use super::trajectory::Trajectory;
use crate::SourceError;
use crate::limits::MAX_IMAGES;
use perception::motion::pose::Pose;
use std::path::Path;

/// How far rows of a rotation may be from unit length and from right angles: files carry six digits and more.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Largest magnitude of a position, in metres: the circumference of the earth.
const MAX_POSITION_M: f64 = 4.1e7;

/// Reads KITTI's `poses.txt`; line n is frame n. The poses are made relative to the first.
///
/// # Errors
/// Names the file, the line and the remedy.
pub fn read_poses(path: &Path) -> Result<Trajectory, SourceError> {
    let poses = parse(&read(path)?).map_err(|reason| fault(path, reason))?;
    Ok(Trajectory { poses, ..Trajectory::default() })
}

fn parse(text: &str) -> Result<Vec<Pose>, String> {
    let mut poses = Vec::new();
    for (line, at) in text.lines().zip(1..).filter(|(line, _)| !is_blank(line)) {
        if poses.len() == MAX_IMAGES {
            return Err(format!("line {at}: more than {MAX_IMAGES} poses: divide the recording"));
        }
        poses.push(pose(line).map_err(|reason| format!("line {at}: {reason}"))?);
    }
    let Some(first) = poses.first().map(Pose::inverse) else {
        return Err("no poses: give KITTI's poses.txt, twelve numbers a line".into());
    };
    Ok(poses.iter().map(|pose| first.after(pose)).collect())
}

fn pose(line: &str) -> Result<Pose, String> {
    let numbers = line.split_ascii_whitespace().take(13).map(number).collect::<Result<Vec<f64>, _>>()?;
    let Ok(m) = <[f64; 12]>::try_from(numbers.as_slice()) else {
        return Err(format!("{} numbers, not 12: give a 3x4 matrix, row by row", numbers.len()));
    };
    let rotation: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
    let translation_m = [m[3], m[7], m[11]];
    let is_rotation = (0..3).all(|i| {
        (0..3).all(|j| {
            let product: f64 = (0..3).map(|k| rotation[i][k] * rotation[j][k]).sum();
            (product - f64::from(u8::from(i == j))).abs() <= ROTATION_TOLERANCE
        })
    });
    let [a, b, c] = rotation;
    let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0]);
    if !is_rotation || determinant < 0.0 {
        return Err(
            "the left three columns are no rotation: give camera to world, as KITTI's poses.txt".into()
        );
    }
    if translation_m.iter().any(|v| v.abs() > MAX_POSITION_M) {
        return Err(format!("a position beyond {MAX_POSITION_M} m: give metres"));
    }
    Ok(Pose { rotation, translation_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_relative_to_the_first() {
        // The first looks along x of the world: its z is the world's x.
        let text = "0 0 1 5 0 1 0 6 -1 0 0 7\n0 0 1 8 0 1 0 6 -1 0 0 7\n\n1 0 0 8 0 1 0 6 0 0 1 9\n";
        let poses = parse(text).unwrap();
        assert_eq!(poses[0], Pose::IDENTITY);
        assert_eq!(poses[1], Pose { translation_m: [0.0, 0.0, 3.0], ..Pose::IDENTITY });
        // A quarter turn to the left, seen from the first.
        assert!((poses[2].yaw_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-12, "{:?}", poses[2]);
        assert_eq!(poses[2].translation_m, [-2.0, 0.0, 3.0]);
    }

    #[test]
    fn faults_name_the_line() {
        let one = "1 0 0 0 0 1 0 0 0 0 1 0\n";
        for (text, expected) in [
            (String::new(), "no poses"),
            (format!("{one}1 2 3\n"), "line 2: 3 numbers, not 12"),
            (format!("{one}{} 7\n", one.trim()), "line 2: 13 numbers, not 12"),
            (one.replacen('1', "x", 1), "line 1: \"x\" is not a number"),
            (one.replacen('1', "2", 1), "line 1: the left three columns are no rotation"),
            (one.replacen('1', "-1", 1), "no rotation"),
            (one.replace("0\n", "1e9\n"), "a position beyond"),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
