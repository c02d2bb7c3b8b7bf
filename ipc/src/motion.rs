//! The vehicle's own motion: part of every header.

use crate::range::{ANY_U32, PADDING, ranges, within};
use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;
use std::fmt;

/// Bits of [`VehicleRecord::present`].
pub mod present {
    /// `speed_m_s` and `speed_age_s`.
    pub const SPEED: u32 = 1;
    /// `yaw_rate_rad_s` and `yaw_rate_age_s`.
    pub const YAW_RATE: u32 = 2;
    /// `steering_angle_rad`.
    pub const STEERING_ANGLE: u32 = 4;
    /// `is_braking`.
    pub const BRAKE: u32 = 8;
    /// `turn_indicator`.
    pub const TURN_INDICATOR: u32 = 16;
    /// `gear`.
    pub const GEAR: u32 = 32;

    /// All bits that have a meaning.
    pub const ALL: u32 = 63;
}

/// Bits of [`VehicleRecord::faults`].
pub mod vehicle_faults {
    /// The bus cannot be opened, or nothing comes from it.
    pub const NO_BUS: u32 = 1;
    /// A configured signal has never been received.
    pub const MISSING: u32 = 2;
    /// A configured signal has not been received for too long.
    pub const STALE: u32 = 4;
    /// A value was out of its range.
    pub const OUT_OF_RANGE: u32 = 8;

    /// All bits that have a meaning.
    pub const ALL: u32 = 15;
}

/// Bits of [`MotionRecord::health`].
pub mod health {
    /// The motion is known. Without it, all other fields mean nothing.
    pub const KNOWN: u32 = 1;
    /// Visual odometry measured the motion since the last frame.
    pub const ODOMETRY: u32 = 2;
    /// The speed of the vehicle's bus was used.
    pub const BUS_SPEED: u32 = 4;
    /// The yaw rate of the vehicle's bus was used.
    pub const BUS_YAW_RATE: u32 = 8;
    /// Odometry and bus disagree.
    pub const DISAGREE: u32 = 16;
    /// The vehicle stands still.
    pub const STANDSTILL: u32 = 32;

    /// All bits that have a meaning.
    pub const ALL: u32 = 63;
}

/// Maximum speed, in m/s: four times that of any car on a public road.
pub const MAX_SPEED_M_S: f64 = 300.0;
/// Maximum acceleration, in m/s²: ten times that of emergency braking.
pub const MAX_ACCELERATION_M_S2: f64 = 100.0;
/// Maximum yaw rate, in rad/s: a vehicle that spins has less.
pub const MAX_YAW_RATE_RAD_S: f64 = 20.0;
/// Maximum yaw acceleration, in rad/s²: the maximum yaw rate within half a second.
pub const MAX_YAW_ACCELERATION_RAD_S2: f64 = 40.0;
/// Maximum age of a value of the bus, in seconds.
pub const MAX_AGE_S: f64 = 60.0;
/// Maximum angle of the steering wheel, in rad: four turns.
pub const MAX_STEERING_ANGLE_RAD: f64 = 26.0;

/// What the vehicle itself reported at the time of a frame. A value that is not `present` means nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
pub struct VehicleRecord {
    /// Speed, in m/s, forwards positive.
    pub speed_m_s: f64,
    /// Time from the measurement of the speed to the frame, in seconds.
    pub speed_age_s: f64,
    /// Yaw rate, in rad/s, to the left positive.
    pub yaw_rate_rad_s: f64,
    /// Time from the measurement of the yaw rate to the frame, in seconds.
    pub yaw_rate_age_s: f64,
    /// Angle of the steering wheel, in rad, to the left positive.
    pub steering_angle_rad: f64,
    /// Which values are present: bits of [`present`].
    pub present: u32,
    /// What is wrong: bits of [`vehicle_faults`].
    pub faults: u32,
    /// 1 while the brake is pressed, else 0.
    pub is_braking: u32,
    /// Turn indicators: 0 off, 1 left, 2 right, 3 both.
    pub turn_indicator: u32,
    /// Gear: 0 park, 1 reverse, 2 neutral, 3 forward.
    pub gear: u32,
    /// Padding; 0.
    pub reserved: u32,
}

ranges! {
    VehicleRecord as "header: vehicle" {
        speed_m_s: within(-MAX_SPEED_M_S, MAX_SPEED_M_S),
        speed_age_s: within(-MAX_AGE_S, MAX_AGE_S),
        yaw_rate_rad_s: within(-MAX_YAW_RATE_RAD_S, MAX_YAW_RATE_RAD_S),
        yaw_rate_age_s: within(-MAX_AGE_S, MAX_AGE_S),
        steering_angle_rad: within(-MAX_STEERING_ANGLE_RAD, MAX_STEERING_ANGLE_RAD),
        present: within(0, present::ALL),
        faults: within(0, vehicle_faults::ALL),
        is_braking: within(0, 1),
        turn_indicator: within(0, 3),
        gear: within(0, 3),
        reserved: PADDING,
    }
}

/// Speed, yaw rate and faults in words; empty if the vehicle reports nothing.
impl fmt::Display for VehicleRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut between = "";
        let mut put = |text: fmt::Arguments<'_>| {
            let written = write!(f, "{between}{text}");
            between = ", ";
            written
        };
        if self.present & present::SPEED != 0 {
            put(format_args!("{:.1} m/s", self.speed_m_s))?;
        }
        if self.present & present::YAW_RATE != 0 {
            put(format_args!("{:.3} rad/s", self.yaw_rate_rad_s))?;
        }
        let names = [
            (vehicle_faults::NO_BUS, "nothing comes from the bus"),
            (vehicle_faults::MISSING, "a signal was never received"),
            (vehicle_faults::STALE, "a signal is stale"),
            (vehicle_faults::OUT_OF_RANGE, "a value is out of range"),
        ];
        names
            .into_iter()
            .filter(|(bit, _)| self.faults & bit != 0)
            .try_for_each(|(_, name)| put(format_args!("{name}")))
    }
}

/// The vehicle's own motion at the time of a frame, from odometry and bus. All zeros where no stage has determined it yet.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable, ZeroCopySend)]
pub struct MotionRecord {
    /// Speed, in m/s, forwards positive.
    pub speed_m_s: f64,
    /// Its standard deviation, in m/s.
    pub speed_sigma_m_s: f64,
    /// Acceleration, in m/s², forwards positive.
    pub acceleration_m_s2: f64,
    /// Its standard deviation, in m/s².
    pub acceleration_sigma_m_s2: f64,
    /// Yaw rate, in rad/s, to the left positive.
    pub yaw_rate_rad_s: f64,
    /// Its standard deviation, in rad/s.
    pub yaw_rate_sigma_rad_s: f64,
    /// Yaw acceleration, in rad/s², to the left positive.
    pub yaw_acceleration_rad_s2: f64,
    /// Yaw of the camera in the vehicle, in rad, to the left positive, as odometry has found it; 0 until then.
    pub camera_yaw_rad: f64,
    /// Position since the start of the run or the last reset, in metres: right, down, forward of the first camera.
    pub position_m: [f64; 3],
    /// Orientation since then as a unit quaternion: x, y, z, w; all zeros until it is determined.
    pub orientation: [f64; 4],
    /// What it is known from: bits of [`health`].
    pub health: u32,
    /// Number of image points that odometry agrees with in this frame.
    pub inliers: u32,
    /// Number of resets of position and orientation.
    pub resets: u32,
    /// Padding; 0.
    pub reserved: u32,
}

ranges! {
    MotionRecord as "header: motion" {
        speed_m_s: within(-MAX_SPEED_M_S, MAX_SPEED_M_S),
        speed_sigma_m_s: within(0.0, MAX_SPEED_M_S),
        acceleration_m_s2: within(-MAX_ACCELERATION_M_S2, MAX_ACCELERATION_M_S2),
        acceleration_sigma_m_s2: within(0.0, MAX_ACCELERATION_M_S2),
        yaw_rate_rad_s: within(-MAX_YAW_RATE_RAD_S, MAX_YAW_RATE_RAD_S),
        yaw_rate_sigma_rad_s: within(0.0, MAX_YAW_RATE_RAD_S),
        yaw_acceleration_rad_s2: within(-MAX_YAW_ACCELERATION_RAD_S2, MAX_YAW_ACCELERATION_RAD_S2),
        camera_yaw_rad: within(-0.1, 0.1),
        position_m: crate::range::Each(within(-1e9, 1e9)),
        orientation: crate::range::Each(within(-1.000_001, 1.000_001)),
        health: within(0, health::ALL),
        inliers: ANY_U32,
        resets: ANY_U32,
        reserved: PADDING,
    }
}

impl MotionRecord {
    /// Whether the motion is known.
    pub fn is_known(&self) -> bool {
        self.health & health::KNOWN != 0
    }

    /// Whether a bit of [`health`] is set.
    pub fn has(&self, bit: u32) -> bool {
        self.health & bit != 0
    }

    /// Names of what it is known from; none while it is unknown.
    pub fn sources(&self) -> impl Iterator<Item = &'static str> {
        let health = if self.is_known() { self.health } else { 0 };
        SOURCES.into_iter().filter(move |(bit, _)| health & bit != 0).map(|(_, name)| name)
    }

    /// Whether position and orientation were determined: they are all zeros before that.
    pub fn has_pose(&self) -> bool {
        let square: f64 = self.orientation.iter().map(|q| q * q).sum();
        (square - 1.0).abs() < 1e-3
    }
}

/// Names of the bits of [`health`] that say what the motion is known from.
pub const SOURCES: [(u32, &str); 3] = [
    (health::ODOMETRY, "odometry"),
    (health::BUS_SPEED, "bus_speed"),
    (health::BUS_YAW_RATE, "bus_yaw_rate"),
];

impl fmt::Display for MotionRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.is_known() {
            return f.write_str("own motion unknown: straight path");
        }
        write!(
            f,
            "own motion: {:.1} ± {:.1} m/s, {:+.1} m/s2, yaw rate {:+.3} ± {:.3} rad/s",
            self.speed_m_s,
            self.speed_sigma_m_s,
            self.acceleration_m_s2,
            self.yaw_rate_rad_s,
            self.yaw_rate_sigma_rad_s
        )?;
        let sources: Vec<String> = self.sources().map(|name| name.replace('_', " ")).collect();
        write!(f, " ({})", if sources.is_empty() { "predicted".into() } else { sources.join(", ") })?;
        if self.has(health::STANDSTILL) {
            f.write_str(", standing still")?;
        }
        if self.has(health::DISAGREE) {
            f.write_str(", odometry and bus disagree")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_names_values_and_sources() {
        assert_eq!(MotionRecord::default().to_string(), "own motion unknown: straight path");
        let mut motion = MotionRecord {
            speed_m_s: 9.96,
            speed_sigma_m_s: 0.1,
            acceleration_m_s2: -0.5,
            yaw_rate_rad_s: 0.1,
            yaw_rate_sigma_rad_s: 0.004,
            health: health::KNOWN | health::ODOMETRY | health::BUS_YAW_RATE,
            ..MotionRecord::default()
        };
        assert_eq!(
            motion.to_string(),
            "own motion: 10.0 ± 0.1 m/s, -0.5 m/s2, yaw rate +0.100 ± 0.004 rad/s (odometry, bus yaw rate)"
        );
        motion.health |= health::DISAGREE | health::STANDSTILL;
        assert!(motion.to_string().ends_with(", standing still, odometry and bus disagree"));
        motion.health = health::KNOWN;
        assert!(motion.to_string().ends_with("(predicted)"));
        // Bits of sources without KNOWN mean nothing.
        motion.health = health::ODOMETRY;
        assert_eq!(motion.sources().count(), 0);
        assert!(!motion.has_pose());
        motion.orientation = [0.0, 0.6, 0.0, 0.8];
        assert!(motion.has_pose());
    }
}
