//! Rectified stereo rig: conversion between disparity and distance.

use thiserror::Error;

/// A rectified pair of cameras: optical axes along z, aligned rows, the right camera `baseline_m` to the
/// right. Camera coordinates: x right, y down, z forward, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    /// Focal length of both cameras, in px.
    pub focal_px: f64,
    /// Baseline, the distance between the camera centres, in metres.
    pub baseline_m: f64,
    /// Column of the left principal point, in px.
    pub cx_px: f64,
    /// Row of the principal point, in px.
    pub cy_px: f64,
}

/// Error of an implausible rig parameter.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{what} is {value}: {remedy}")]
pub struct RigError {
    what: &'static str,
    value: f64,
    remedy: &'static str,
}

impl Rig {
    /// Checks the parameters. The limits are wide, but detect swapped cameras and wrong units: focal length
    /// 10 to 100,000 px, baseline 0.005 to 20 m, principal point finite.
    ///
    /// # Errors
    /// Names the parameter that is out of range, and a remedy.
    pub fn checked(self) -> Result<Self, RigError> {
        let error = |what, value, remedy| Err(RigError { what, value, remedy });
        if !(10.0..=100_000.0).contains(&self.focal_px) {
            return error("the focal length", self.focal_px, "give it in pixels, 10 to 100000");
        }
        if !(0.005..=20.0).contains(&self.baseline_m) {
            return error(
                "the baseline",
                self.baseline_m,
                "give it in metres, 0.005 to 20 (a negative one means swapped cameras)",
            );
        }
        for (what, value) in [("cx", self.cx_px), ("cy", self.cy_px)] {
            if !value.is_finite() || value.abs() > 100_000.0 {
                return error(what, value, "give the principal point in pixels");
            }
        }
        Ok(self)
    }

    /// Distance along z, in metres, of a disparity in px; infinite at zero.
    pub fn distance_m(&self, disparity_px: f64) -> f64 {
        if disparity_px <= 0.0 { f64::INFINITY } else { self.focal_px * self.baseline_m / disparity_px }
    }

    /// Disparity in px of a distance along z in metres (above zero).
    pub fn disparity_px(&self, distance_m: f64) -> f64 {
        self.focal_px * self.baseline_m / distance_m
    }

    /// Standard deviation of the distance, in metres, for that of the disparity in px: z²/(f·B)·σ.
    pub fn distance_error_m(&self, distance_m: f64, disparity_sigma_px: f64) -> f64 {
        distance_m * distance_m / (self.focal_px * self.baseline_m) * disparity_sigma_px
    }

    /// Lateral position of a column at a distance, in metres right of the left camera's axis.
    pub fn lateral_m(&self, x_px: f64, distance_m: f64) -> f64 {
        (x_px - self.cx_px) * distance_m / self.focal_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KITTI: Rig = Rig { focal_px: 721.5, baseline_m: 0.533, cx_px: 609.6, cy_px: 172.9 };

    #[test]
    fn distance_and_disparity_are_inverse() {
        for distance in [3.0, 10.0, 42.2, 60.0] {
            let back = KITTI.distance_m(KITTI.disparity_px(distance));
            assert!((back - distance).abs() < 1e-9);
        }
        assert!(KITTI.distance_m(0.0).is_infinite());
    }

    #[test]
    fn wrong_units_are_reported() {
        assert!(KITTI.checked().is_ok());
        let millimetres = Rig { baseline_m: 533.0, ..KITTI }.checked().unwrap_err();
        assert!(millimetres.to_string().contains("metres"), "{millimetres}");
        let swapped = Rig { baseline_m: -0.5, ..KITTI }.checked().unwrap_err();
        assert!(swapped.to_string().contains("swapped"), "{swapped}");
        assert!(Rig { focal_px: f64::NAN, ..KITTI }.checked().is_err());
        assert!(Rig { cx_px: f64::INFINITY, ..KITTI }.checked().is_err());
    }
}
