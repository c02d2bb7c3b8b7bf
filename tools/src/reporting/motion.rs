//! The vehicle's own motion: in the record of a frame, and over a run.

use crate::reporting::tidy::tidy;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Own motion at the time of a frame. Speed is positive forwards, yaw rate positive to the left; values are `null`
/// while the motion is unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionLine {
    /// Whether the motion is known.
    pub known: bool,
    /// What it is known from: `odometry`, `bus_speed`, `bus_yaw_rate`; empty while it is predicted, or unknown.
    pub sources: Vec<String>,
    /// Whether the vehicle stands still.
    pub standstill: bool,
    /// Whether odometry and the vehicle's bus disagree.
    pub disagree: bool,
    /// Speed.
    pub speed_m_s: Option<f64>,
    /// Standard deviation of the speed.
    pub speed_sigma_m_s: Option<f64>,
    /// Acceleration.
    pub acceleration_m_s2: Option<f64>,
    /// Standard deviation of the acceleration.
    pub acceleration_sigma_m_s2: Option<f64>,
    /// Yaw rate.
    pub yaw_rate_rad_s: Option<f64>,
    /// Standard deviation of the yaw rate.
    pub yaw_rate_sigma_rad_s: Option<f64>,
}

impl MotionLine {
    /// Speed and yaw rate in a few words for a picture; that the motion is unknown, otherwise.
    pub fn text(&self) -> String {
        match (self.speed_m_s, self.yaw_rate_rad_s) {
            (Some(speed), Some(yaw_rate)) => {
                let side = match yaw_rate {
                    r if r.abs() < 0.005 => "",
                    r if r > 0.0 => " left",
                    _ => " right",
                };
                format!("{speed:.1} m/s, {:.2} rad/s{side}", yaw_rate.abs())
            }
            _ => "own motion unknown".into(),
        }
    }
}

/// Own motion over a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionSummary {
    /// Frames.
    pub frames: u64,
    /// Frames with known motion.
    pub known: u64,
    /// Share of frames with known motion, 0 to 1.
    pub known_share: f64,
    /// Frames whose motion odometry measured.
    pub odometry: u64,
    /// Frames whose motion the vehicle's bus measured.
    pub bus: u64,
    /// Frames in which odometry and bus disagree.
    pub disagree: u64,
    /// Frames in which the vehicle stands still.
    pub standstill: u64,
    /// Mean speed over the frames with known motion.
    pub speed_mean_m_s: Option<f64>,
    /// Largest speed, of either direction.
    pub speed_max_m_s: Option<f64>,
    /// Root of the mean square of the yaw rate.
    pub yaw_rate_rms_rad_s: Option<f64>,
}

impl fmt::Display for MotionSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.known == 0 {
            return f.write_str("own motion unknown: straight path");
        }
        write!(
            f,
            "own motion known in {:.1} % of frames; {:.1} m/s on average, at most {:.1}; yaw rate {:.3} rad/s RMS",
            100.0 * self.known_share,
            self.speed_mean_m_s.unwrap_or_default(),
            self.speed_max_m_s.unwrap_or_default(),
            self.yaw_rate_rms_rad_s.unwrap_or_default()
        )?;
        if self.disagree > 0 {
            let s = if self.disagree == 1 { "" } else { "s" };
            write!(f, "; odometry and bus disagree in {} frame{s}", self.disagree)?;
        }
        Ok(())
    }
}

/// Adds up the motion of frames, in constant memory.
#[derive(Clone, Debug, Default)]
pub struct MotionTally {
    counts: MotionSummary,
    speed_m_s: f64,
    speed_max_m_s: f64,
    yaw_rate_square: f64,
}

impl MotionTally {
    /// Adds a frame.
    pub fn add(&mut self, motion: &MotionLine) {
        let is_from = |prefix: &str| u64::from(motion.sources.iter().any(|name| name.starts_with(prefix)));
        self.counts.frames += 1;
        self.counts.known += u64::from(motion.known);
        self.counts.odometry += is_from("odometry");
        self.counts.bus += is_from("bus");
        self.counts.disagree += u64::from(motion.disagree);
        self.counts.standstill += u64::from(motion.standstill);
        let (speed, yaw_rate) =
            (motion.speed_m_s.unwrap_or_default(), motion.yaw_rate_rad_s.unwrap_or_default());
        self.speed_m_s += speed;
        self.speed_max_m_s = self.speed_max_m_s.max(speed.abs());
        self.yaw_rate_square += yaw_rate * yaw_rate;
    }

    /// What has been added so far.
    pub fn summary(&self) -> MotionSummary {
        let known = self.counts.known as f64;
        let some = |value: f64| (self.counts.known > 0).then(|| tidy(value));
        MotionSummary {
            known_share: tidy(known / self.counts.frames.max(1) as f64),
            speed_mean_m_s: some(self.speed_m_s / known),
            speed_max_m_s: some(self.speed_max_m_s),
            yaw_rate_rms_rad_s: some((self.yaw_rate_square / known).sqrt()),
            ..self.counts.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_without_motion_do_not_lower_the_means() {
        let mut tally = MotionTally::default();
        assert_eq!(tally.summary(), MotionSummary::default());
        assert_eq!(tally.summary().to_string(), "own motion unknown: straight path");
        tally.add(&MotionLine::default());
        for (speed, yaw_rate) in [(10.0, 0.3), (-12.0, -0.4)] {
            tally.add(&MotionLine {
                known: true,
                sources: vec!["odometry".into(), "bus_speed".into(), "bus_yaw_rate".into()],
                speed_m_s: Some(speed),
                yaw_rate_rad_s: Some(yaw_rate),
                ..MotionLine::default()
            });
        }
        let summary = tally.summary();
        assert_eq!((summary.frames, summary.known, summary.odometry, summary.bus), (3, 2, 2, 2));
        assert_eq!((summary.known_share, summary.speed_mean_m_s), (0.6667, Some(-1.0)));
        assert_eq!((summary.speed_max_m_s, summary.yaw_rate_rms_rad_s), (Some(12.0), Some(0.3536)));
        assert!(summary.to_string().starts_with("own motion known in 66.7 % of frames"), "{summary}");
    }

    #[test]
    fn the_text_names_the_side() {
        let motion = |yaw_rate| MotionLine {
            known: true,
            speed_m_s: Some(9.04),
            yaw_rate_rad_s: Some(yaw_rate),
            ..MotionLine::default()
        };
        assert_eq!(motion(0.1).text(), "9.0 m/s, 0.10 rad/s left");
        assert_eq!(motion(-0.1).text(), "9.0 m/s, 0.10 rad/s right");
        assert_eq!(motion(0.001).text(), "9.0 m/s, 0.00 rad/s");
        assert_eq!(MotionLine::default().text(), "own motion unknown");
    }
}
