//! What a vehicle reported of its motion, from a file: `motion.csv`, or on request a file of ground truth.

use super::table::{check_times, columns, fault, read};
use super::{kitti_oxts, poses};
use crate::SourceError;
use crate::vehicle::{MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S, VehicleFaults, VehicleReading};
use perception::motion::vehicle::{Aged, VehicleSample};
use std::path::Path;

/// Name of the file in a folder of pairs that is used without being named.
pub const MOTION_CSV: &str = "motion.csv";

/// Speeds and yaw rates over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionTable {
    /// Times, in seconds; they do not decrease.
    times_s: Vec<f64>,
    /// Speed in m/s and yaw rate in rad/s, to the left positive.
    values: Vec<[f64; 2]>,
    /// Whether the times are those of the frames themselves, not of the file's own clock.
    is_of_frames: bool,
}

impl MotionTable {
    /// Reads a file of motion:
    /// - `motion.csv`, with the columns `time_s`, `speed_m_s`, `yaw_rate_rad_s`,
    /// - OXTS as one CSV, with the columns `time_s`, `vf_m_s`, `wu`,
    /// - KITTI's poses (any other file): a line a frame, speed and yaw rate by differences,
    /// - KITTI's folder `oxts`: a file a frame.
    ///
    /// `frame_times_s` are the times of the frames, for the last two.
    ///
    /// # Errors
    /// Names the file, the line or column and the remedy.
    pub fn read(path: &Path, frame_times_s: &[f64]) -> Result<Self, SourceError> {
        if path.is_dir() {
            return Ok(Self::of_frames(frame_times_s, kitti_oxts::read_frames(path)?));
        }
        if path.extension().is_none_or(|ending| ending != "csv") {
            let trajectory = poses::read_poses(path)?;
            return Ok(Self::of_frames(frame_times_s, trajectory.differences(frame_times_s)));
        }
        let text = read(path)?;
        let head = text.lines().find(|line| !super::table::is_blank(line)).unwrap_or("");
        let is_oxts = head.split(',').any(|column| column.trim() == "vf_m_s");
        let names =
            if is_oxts { ["time_s", "vf_m_s", "wu"] } else { ["time_s", "speed_m_s", "yaw_rate_rad_s"] };
        let rows = columns(path, names)?;
        check_times(rows.iter().map(|(at, row)| (*at, row[0])), "time_s").map_err(|e| fault(path, e))?;
        Ok(Self {
            times_s: rows.iter().map(|(_, row)| row[0]).collect(),
            values: rows.iter().map(|(_, row)| [row[1], row[2]]).collect(),
            is_of_frames: false,
        })
    }

    fn of_frames(times_s: &[f64], mut values: Vec<[f64; 2]>) -> Self {
        values.truncate(times_s.len());
        Self { times_s: times_s[..values.len()].to_vec(), values, is_of_frames: true }
    }

    /// Whether the times are those of the frames, from 0 at the first.
    pub fn is_of_frames(&self) -> bool {
        self.is_of_frames
    }

    /// What holds for a frame at `time_s`: the nearest sample, unless it is more than `stale_s` away.
    pub fn at(&self, time_s: f64, stale_s: f64) -> VehicleReading {
        let mut faults = VehicleFaults::default();
        let after = self.times_s.partition_point(|&t| t < time_s);
        let age = |i: usize| self.times_s.get(i).map(|t| time_s - t);
        let before = after.checked_sub(1);
        let nearest = match (before.and_then(age), age(after)) {
            (Some(past), Some(future)) if past > -future => Some(after),
            (Some(_), _) => before,
            (None, Some(_)) => Some(after),
            (None, None) => None,
        };
        let Some((place, age_s)) = nearest.and_then(|i| Some((i, age(i)?))) else {
            faults.missing = true;
            return VehicleReading { faults, ..VehicleReading::default() };
        };
        if age_s.abs() > stale_s {
            faults.stale = true;
            return VehicleReading { faults, ..VehicleReading::default() };
        }
        let [speed, yaw_rate] = self.values[place];
        let mut within = |value: f64, max: f64| {
            faults.out_of_range |= value.abs() > max;
            (value.abs() <= max).then_some(Aged { value, age_s })
        };
        let sample = VehicleSample {
            speed_m_s: within(speed, MAX_SPEED_M_S),
            yaw_rate_rad_s: within(yaw_rate, MAX_YAW_RATE_RAD_S),
            ..VehicleSample::default()
        };
        VehicleReading { sample, faults }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(name: &str, text: &str) -> Result<MotionTable, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        MotionTable::read(&path, &[0.0, 0.1, 0.2]).map_err(|e| e.to_string())
    }

    #[test]
    fn the_nearest_sample_counts() {
        let text = "time_s,gear,speed_m_s,yaw_rate_rad_s\n1.0,3,10,0.1\n1.1,3,11,0.2\n1.2,3,500,0.3\n";
        let table = table("motion.csv", text).unwrap();
        let at = |time_s: f64| {
            let reading = table.at(time_s, 0.5);
            (
                reading.sample.speed_m_s.map(|v| v.value),
                reading.sample.yaw_rate_rad_s.map(|v| v.value),
                reading.faults,
            )
        };
        let none = VehicleFaults::default();
        assert_eq!(at(1.04), (Some(10.0), Some(0.1), none));
        assert_eq!(at(1.06), (Some(11.0), Some(0.2), none));
        assert_eq!(at(0.6), (Some(10.0), Some(0.1), none));
        assert_eq!(at(1.3), (None, Some(0.3), VehicleFaults { out_of_range: true, ..none }));
        assert_eq!(at(0.4), (None, None, VehicleFaults { stale: true, ..none }));
        assert_eq!(at(1.8), (None, None, VehicleFaults { stale: true, ..none }));
        let age_s = table.at(1.06, 0.5).sample.speed_m_s.map_or(0.0, |v| v.age_s);
        assert!((age_s + 0.04).abs() < 1e-9, "measured after the frame: {age_s}");
        assert!(MotionTable::default().at(1.0, 0.5).faults.missing);
    }

    #[test]
    fn formats_are_told_apart() {
        let oxts = table("oxts.csv", "time_s,vf_m_s,vl_m_s,wu\n5,7,0,0.2\n").unwrap();
        assert_eq!(oxts.values, [[7.0, 0.2]]);
        let line = |z: f64| format!("1 0 0 0 0 1 0 0 0 0 1 {z}\n");
        let poses = table("poses.txt", &(line(0.0) + &line(1.0) + &line(2.0) + &line(3.0))).unwrap();
        assert!(poses.is_of_frames() && poses.times_s == [0.0, 0.1, 0.2]);
        assert!(poses.values.iter().all(|[speed, yaw]| (speed - 10.0).abs() < 1e-9 && *yaw == 0.0));
        for (name, text, expected) in [
            ("motion.csv", "time_s,speed_m_s\n", "motion.csv: no column yaw_rate_rad_s"),
            (
                "motion.csv",
                "time_s,speed_m_s,yaw_rate_rad_s\n2,1,0\n1,1,0\n",
                "line 3: time_s = 1 is before 2",
            ),
            ("poses.txt", "1 2 3\n", "poses.txt: line 1: 3 numbers"),
        ] {
            let error = table(name, text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
