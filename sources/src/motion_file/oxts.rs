//! OXTS (inertial and satellite navigation) as one CSV file, and the path of the camera that follows from it.

use super::table::{check_times, columns, fault};
use super::timestamps::read_timestamps;
use super::trajectory::Trajectory;
use crate::SourceError;
use perception::motion::pose::Pose;
use std::path::Path;

/// Radius of the earth in KITTI's Mercator projection, in metres.
const EARTH_M: f64 = 6_378_137.0;

/// Distance from the inertial unit forward to the left camera in KITTI's vehicle, in metres.
pub const OXTS_LEVER_ARM_M: f64 = 1.1;

/// Largest latitude that the projection is used for, in degrees: beyond it is no road.
const MAX_LATITUDE_DEG: f64 = 85.0;

/// Largest time from a frame to the nearest sample, in seconds: ten samples of OXTS at 10 Hz.
const MAX_GAP_S: f64 = 1.0;

/// A sample of the navigation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, in seconds.
    pub time_s: f64,
    /// Speed forward, in m/s.
    pub speed_m_s: f64,
    /// Yaw rate, in rad/s, to the left positive.
    pub yaw_rate_rad_s: f64,
    /// Latitude, in degrees.
    pub latitude_deg: f64,
    /// Longitude, in degrees.
    pub longitude_deg: f64,
    /// Heading, in rad: 0 = east, to the left positive.
    pub yaw_rad: f64,
}

/// Reads a path from an OXTS table (`time_s`, `vf_m_s`, `wu`, `lat_deg`, `lon_deg`, `yaw_rad`) at the times of the
/// frames in `timestamps.csv` (`name`, `left_s`), whose clock is the same. Values between two samples are interpolated.
///
/// The path is planar, as the peer of this project's evaluation computes it: position by KITTI's Mercator projection,
/// 1.1 m forward from the unit to the camera, rotation by the heading alone.
///
/// # Errors
/// Names the file, the line and the remedy.
pub fn read_oxts(oxts_csv: &Path, times_csv: &Path) -> Result<Trajectory, SourceError> {
    let samples = read_samples(oxts_csv)?;
    let times = read_timestamps(times_csv)?;
    if times.times_s.is_empty() {
        return Err(fault(times_csv, "no frames: give a line for each image".into()));
    }
    path(&samples, &times.times_s).map_err(|reason| fault(oxts_csv, reason))
}

/// Reads the samples of an OXTS table.
pub fn read_samples(path: &Path) -> Result<Vec<Sample>, SourceError> {
    let names = ["time_s", "vf_m_s", "wu", "lat_deg", "lon_deg", "yaw_rad"];
    let rows = columns(path, names)?;
    if rows.is_empty() {
        return Err(fault(path, "no samples: give a line for each measurement".into()));
    }
    check_times(rows.iter().map(|(at, row)| (*at, row[0])), "time_s").map_err(|e| fault(path, e))?;
    for (at, row) in &rows {
        if row[3].abs() > MAX_LATITUDE_DEG || row[4].abs() > 360.0 {
            let reason =
                format!("line {at}: no place on the earth's roads: give latitude and longitude in degrees");
            return Err(fault(path, reason));
        }
    }
    let sample = |(_, row): (usize, [f64; 6])| {
        let [time_s, speed_m_s, yaw_rate_rad_s, latitude_deg, longitude_deg, yaw_rad] = row;
        Sample { time_s, speed_m_s, yaw_rate_rad_s, latitude_deg, longitude_deg, yaw_rad }
    };
    Ok(rows.into_iter().map(sample).collect())
}

fn path(samples: &[Sample], times_s: &[f64]) -> Result<Trajectory, String> {
    let Some(first) = samples.first() else { return Err("no samples".into()) };
    // All positions with the scale of the first latitude, as KITTI's devkit.
    let scale = first.latitude_deg.to_radians().cos() * EARTH_M;
    let mut planar = Vec::with_capacity(samples.len());
    let mut heading = first.yaw_rad;
    for sample in samples {
        heading += wrapped(sample.yaw_rad - heading);
        let east_m = scale * sample.longitude_deg.to_radians();
        let north_m = scale * ((90.0 + sample.latitude_deg).to_radians() / 2.0).tan().ln();
        planar.push([east_m, north_m, heading, sample.speed_m_s, sample.yaw_rate_rad_s]);
    }
    let mut found = Trajectory { times_s: times_s.to_vec(), ..Trajectory::default() };
    let mut origin = None;
    for &time_s in times_s {
        let [east_m, north_m, heading, speed_m_s, yaw_rate_rad_s] = between(samples, &planar, time_s)?;
        let (sine, cosine) = heading.sin_cos();
        let camera = [east_m + OXTS_LEVER_ARM_M * cosine, north_m + OXTS_LEVER_ARM_M * sine, heading];
        let start = *origin.get_or_insert(camera);
        let (sine, cosine) = start[2].sin_cos();
        let (east_m, north_m) = (camera[0] - start[0], camera[1] - start[1]);
        let translation_m = [sine * east_m - cosine * north_m, 0.0, cosine * east_m + sine * north_m];
        found
            .poses
            .push(Pose { translation_m, ..Pose::from_rotation_vector([0.0, start[2] - heading, 0.0]) });
        found.speed_m_s.push(speed_m_s);
        found.yaw_rate_rad_s.push(yaw_rate_rad_s);
    }
    for pair in times_s.windows(2) {
        let [.., speed_m_s, yaw_rate_rad_s] = between(samples, &planar, 0.5 * (pair[0] + pair[1]))?;
        found.between.push([speed_m_s, yaw_rate_rad_s]);
    }
    Ok(found)
}

/// The values at a time, interpolated; at most [`MAX_GAP_S`] from a sample.
fn between(samples: &[Sample], planar: &[[f64; 5]], time_s: f64) -> Result<[f64; 5], String> {
    let after = samples.partition_point(|sample| sample.time_s < time_s).min(samples.len() - 1);
    let before = if samples[after].time_s <= time_s { after } else { after.saturating_sub(1) };
    let (from_s, to_s) = (samples[before].time_s, samples[after].time_s);
    if (time_s - from_s).abs().min((to_s - time_s).abs()) > MAX_GAP_S {
        return Err(format!(
            "no sample within {MAX_GAP_S} s of the frame at {time_s} s: give both times in one clock"
        ));
    }
    let step_s = to_s - from_s;
    let share = if step_s > 0.0 { ((time_s - from_s) / step_s).clamp(0.0, 1.0) } else { 0.0 };
    Ok(std::array::from_fn(|i| planar[before][i] + share * (planar[after][i] - planar[before][i])))
}

/// An angle between −π and π, in rad.
fn wrapped(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle_rad - turn * (angle_rad / turn).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive on a circle to the left around a place in Karlsruhe at 8 m/s and 0.2 rad/s, with heading wrapped.
    fn circle() -> Vec<Sample> {
        let (latitude_deg, longitude_deg) = (49.0_f64, 8.4_f64);
        (0..400)
            .map(|i| {
                let time_s = 100.0 + 0.1 * f64::from(i);
                let yaw = 0.5 + 0.2 * (time_s - 100.0);
                let (east, north) = (40.0 * yaw.sin(), -40.0 * yaw.cos());
                let north_deg = (north / EARTH_M).to_degrees();
                Sample {
                    time_s,
                    speed_m_s: 8.0,
                    yaw_rate_rad_s: 0.2,
                    latitude_deg: latitude_deg + north_deg,
                    longitude_deg: longitude_deg
                        + (east / EARTH_M / latitude_deg.to_radians().cos()).to_degrees(),
                    yaw_rad: wrapped(yaw),
                }
            })
            .collect()
    }

    #[test]
    fn the_camera_is_forward_of_the_unit() {
        let times: Vec<f64> = (0..300).map(|i| 101.0 + 0.13 * f64::from(i)).collect();
        let found = path(&circle(), &times).unwrap();
        assert_eq!(found.poses[0], Pose::IDENTITY);
        assert_eq!((found.poses.len(), found.times_s.len()), (300, 300));
        assert!(found.speed_m_s.iter().all(|v| (v - 8.0).abs() < 1e-9));
        assert!(found.yaw_rate_rad_s.iter().all(|v| (v - 0.2).abs() < 1e-9));
        for (pose, time_s) in found.poses.iter().zip(&times) {
            // The unit moves on the circle, the camera 1.1 m before it.
            let turned = 0.2 * (time_s - times[0]);
            let unit = [40.0 * (turned.cos() - 1.0), 40.0 * turned.sin()];
            let expected = [unit[0] - 1.1 * turned.sin(), unit[1] + 1.1 * (turned.cos() - 1.0)];
            let [x, y, z] = pose.translation_m;
            // The scale of the first latitude and the chords between samples.
            assert!((x - expected[0]).hypot(z - expected[1]) < 0.01 && y == 0.0, "{pose:?}, {expected:?}");
            assert!(wrapped(pose.yaw_rad() - turned).abs() < 1e-9);
        }
    }

    #[test]
    fn frames_without_samples_are_refused() {
        let samples = circle();
        assert!(path(&samples, &[99.5]).is_ok());
        let error = path(&samples, &[98.5]).unwrap_err();
        assert!(error.contains("no sample within 1 s of the frame at 98.5 s"), "{error}");
        assert!(path(&samples, &[150.0]).is_err());
        // A gap in the middle.
        let holed: Vec<Sample> = samples.iter().filter(|s| (s.time_s - 110.0).abs() > 2.0).copied().collect();
        assert!(path(&holed, &[110.0]).is_err() && path(&holed, &[112.5]).is_ok());
    }

    #[test]
    fn files_are_read_and_faults_named() {
        let folder = tempfile::tempdir().unwrap();
        let (oxts, times) = (folder.path().join("oxts.csv"), folder.path().join("timestamps.csv"));
        std::fs::write(&times, "name,left_s,right_s\n0,1.0,1.0\n1,1.1,1.1\n").unwrap();
        let head = "time_s,lat_deg,lon_deg,yaw_rad,vf_m_s,wu\n";
        std::fs::write(&oxts, format!("{head}1.0,49,8.4,0,5,0.1\n1.1,49,8.4,0,6,0.2\n")).unwrap();
        let found = read_oxts(&oxts, &times).unwrap();
        assert_eq!((found.speed_m_s, found.yaw_rate_rad_s), (vec![5.0, 6.0], vec![0.1, 0.2]));
        let [speed, yaw_rate] = found.between[0];
        assert!((speed - 5.5).abs() < 1e-9 && (yaw_rate - 0.15).abs() < 1e-9 && found.between.len() == 1);
        for (text, expected) in [
            (head.to_owned(), "oxts.csv: no samples"),
            (head.replace("wu", "wz"), "oxts.csv: no column wu"),
            (format!("{head}1,99,8,0,5,0\n"), "line 2: no place"),
            (format!("{head}2,49,8,0,5,0\n1,49,8,0,5,0\n"), "line 3: time_s = 1 is before 2"),
        ] {
            std::fs::write(&oxts, text).unwrap();
            let error = read_oxts(&oxts, &times).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
