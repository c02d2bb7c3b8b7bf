//! Report of an evaluation of own motion: text, and plots of path, speed and yaw rate.

use super::odometry::{Drift, EstimateFrame, GOOD_PATH_M, OdometryScore, RateErrors, Truth, step_rates};
use crate::reporting::output::OutputError;
use crate::reporting::svg::{Plot, Series};
use perception::motion::pose::Pose;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Names of the plots below the output folder.
const PLOTS: [&str; 3] = ["path.svg", "speed.svg", "yaw_rate.svg"];

/// Results for one recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OdometryReport {
    /// The recording, or the file with the estimate.
    pub name: String,
    /// Where the ground truth is from.
    pub truth: String,
    /// The figures.
    #[serde(flatten)]
    pub score: OdometryScore,
}

impl fmt::Display for OdometryReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = &self.score;
        writeln!(f, "{}: {} frames, {:.1} m, against {}", self.name, s.frames, s.length_m, self.truth)?;
        if let Some(unknown) = s.unknown_percent {
            writeln!(f, "own motion unknown in {unknown:.1} % of frames")?;
        }
        if s.drift.is_empty() {
            writeln!(f, "drift: the path is shorter than the shortest part of 10 m")?;
        } else {
            writeln!(f, "{:>8} {:>8} {:>10} {:>12}", "length m", "parts", "drift %", "degrees a m")?;
        }
        for Drift { length_m, parts, translation_percent, rotation_deg_per_m } in &s.drift {
            writeln!(f, "{length_m:>8.0} {parts:>8} {translation_percent:>10.2} {rotation_deg_per_m:>12.4}")?;
        }
        for (what, errors) in [("frame to frame", &s.frame_to_frame), ("filtered", &s.filtered)] {
            if let Some(RateErrors { frames, speed_rms_m_s, yaw_rate_rms_rad_s }) = errors {
                writeln!(
                    f,
                    "{what}: speed {speed_rms_m_s:.3} m/s RMS, yaw rate {yaw_rate_rms_rad_s:.4} rad/s RMS ({frames} \
                     frames)"
                )?;
            }
        }
        if let Some(p) = &s.path {
            writeln!(
                f,
                "path 1.5 s ahead: median {:.2} m, 95 % {:.2} m, {:.1} % within {GOOD_PATH_M} m ({} frames); straight: \
                 {:.2} m, {:.2} m, {:.1} %",
                p.median_m,
                p.p95_m,
                p.good_percent,
                p.frames,
                p.straight_median_m,
                p.straight_p95_m,
                p.straight_good_percent
            )?;
        }
        if let Some(c) = &s.consistency {
            writeln!(
                f,
                "consistency: errors over their standard deviations {:.2} (speed), {:.2} (yaw rate) RMS, 1 is right; \
                 {:.1} % within two",
                c.speed, c.yaw_rate, c.within_two_sigma_percent
            )?;
        }
        Ok(())
    }
}

/// Writes the plots of the path from above, of the speed and of the yaw rate.
///
/// # Errors
/// When a file cannot be written.
pub fn save_plots(folder: &Path, truth: &Truth, estimate: &[EstimateFrame]) -> Result<(), OutputError> {
    let [speed, yaw_rate] = rates(truth, estimate);
    for (name, plot) in PLOTS.into_iter().zip([path(truth, estimate), speed, yaw_rate]) {
        let path = folder.join(name);
        std::fs::write(&path, plot.to_svg()).map_err(|source| OutputError::Io { path, source })?;
    }
    Ok(())
}

fn line(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), points, dots: false }
}

/// Both paths from above, seen from the first frame.
fn path(truth: &Truth, estimate: &[EstimateFrame]) -> Plot {
    let from_start = |poses: &mut dyn Iterator<Item = Pose>| {
        let mut start = None;
        poses
            .map(|pose| {
                let [x, _, z] = start.get_or_insert_with(|| pose.inverse()).apply(pose.translation_m);
                (x, z)
            })
            .collect()
    };
    Plot {
        title: "path from above, forward is up".into(),
        x_name: "right of the first camera, m".into(),
        y_name: "forward, m".into(),
        series: vec![
            line("truth", from_start(&mut truth.frames.iter().map(|frame| frame.pose))),
            line("estimate", from_start(&mut estimate.iter().map(|frame| frame.pose))),
        ],
        is_map: true,
        ..Plot::default()
    }
}

/// Speed and yaw rate over time.
fn rates(truth: &Truth, estimate: &[EstimateFrame]) -> [Plot; 2] {
    let start_s = truth.frames.first().map_or(0.0, |frame| frame.time_s);
    let steps: Vec<(f64, f64, f64)> = truth
        .frames
        .windows(2)
        .zip(estimate.windows(2))
        .filter_map(|(t, e)| {
            let (speed, yaw_rate) =
                step_rates(&e[0].pose, &e[1].pose, t[1].time_s - t[0].time_s, truth.is_planar)?;
            Some((0.5 * (t[0].time_s + t[1].time_s) - start_s, speed, yaw_rate))
        })
        .collect();
    let filtered: Vec<(f64, f64, f64)> = truth
        .frames
        .iter()
        .zip(estimate)
        .filter_map(|(t, e)| e.motion.map(|m| (t.time_s - start_s, m.speed_m_s, m.yaw_rate_rad_s)))
        .collect();
    let exact: Vec<(f64, f64, f64)> =
        truth.frames.iter().map(|t| (t.time_s - start_s, t.speed_m_s, t.yaw_rate_rad_s)).collect();
    let plot = |title: &str, unit: &str, value: fn(&(f64, f64, f64)) -> f64| {
        let series = [("truth", &exact), ("frame to frame", &steps), ("filtered", &filtered)];
        let drawn = series.into_iter().filter(|(_, rows)| !rows.is_empty());
        Plot {
            title: title.into(),
            x_name: "time, s".into(),
            y_name: unit.into(),
            series: drawn
                .map(|(name, rows)| line(name, rows.iter().map(|row| (row.0, value(row))).collect()))
                .collect(),
            ..Plot::default()
        }
    };
    [plot("speed", "m/s", |row| row.1), plot("yaw rate, to the left positive", "rad/s", |row| row.2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::motion::Motion;
    use sources::motion_file::Trajectory;

    fn bend() -> (Truth, Vec<EstimateFrame>) {
        let pose = |i: usize, scale: f64| {
            let turned = 0.02 * i as f64;
            let translation_m = [50.0 * scale * (turned.cos() - 1.0), 0.0, 50.0 * scale * turned.sin()];
            Pose { translation_m, ..Pose::from_rotation_vector([0.0, -turned, 0.0]) }
        };
        let path = Trajectory { poses: (0..40).map(|i| pose(i, 1.0)).collect(), ..Trajectory::default() };
        let times_s: Vec<f64> = (0..40).map(|i| 0.1 * f64::from(i)).collect();
        let motion = Some(Motion {
            speed_m_s: 10.1,
            speed_sigma_m_s: 0.1,
            yaw_rate_rad_s: 0.21,
            yaw_rate_sigma_rad_s: 0.01,
            ..Motion::default()
        });
        let estimate = (0..40).map(|i| EstimateFrame { pose: pose(i, 1.02), motion }).collect();
        (Truth::new(&path, &times_s), estimate)
    }

    #[test]
    fn the_report_tells_every_figure_and_the_plots_are_drawings() {
        let (truth, estimate) = bend();
        let score =
            crate::evaluation::odometry::score(&truth, &estimate, &perception::motion::body::Body::default());
        let report = OdometryReport { name: "bend".into(), truth: "poses.txt".into(), score };
        let text = report.to_string();
        for part in [
            "bend: 40 frames, 39.0 m, against poses.txt",
            "own motion unknown in 0.0 %",
            "\n      10       ",
            "frame to frame: speed 0.200 m/s RMS",
            "filtered: speed 0.1",
            "path 1.5 s ahead: median",
            "consistency:",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let folder = tempfile::tempdir().unwrap();
        save_plots(folder.path(), &truth, &estimate).unwrap();
        for name in PLOTS {
            let svg = std::fs::read_to_string(folder.path().join(name)).unwrap();
            roxmltree::Document::parse(&svg).unwrap();
            assert!(svg.contains("truth") && !svg.contains("NaN"), "{svg}");
        }
        assert!(save_plots(&folder.path().join("none"), &truth, &estimate).is_err());
        // Nothing to draw is no reason to fail.
        save_plots(folder.path(), &Truth::default(), &[]).unwrap();
    }
}
