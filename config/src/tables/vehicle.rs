//! The vehicle: its body, and what its bus reports.

use crate::key::Reload;
use crate::table::table;

table! {
    /// How the vehicle's own motion is measured.
    pub struct Motion, reload: Reload::Readers;

    /// Visual odometry: own motion from the left images and their disparity. Without it and without the vehicle's bus the
    /// path ahead is a straight strip.
    odometry: Switch = true;
}

table! {
    /// The vehicle that carries the cameras.
    pub struct Vehicle, reload: Reload::Restart;

    /// Width of the body with mirrors.
    width_m: Number(0.3, 5.0) in "m" = 1.8;

    /// Distance from the left camera forward to the front of the body; a distance in the alarm is measured from the
    /// camera.
    front_m: Number(-2.0, 10.0) in "m" = 1.7;

    /// Position of the left camera to the right of the vehicle's centre line.
    camera_right_m: Number(-3.0, 3.0) in "m" = 0.0;

    /// Distance from the left camera back to the rear axle, about which the vehicle turns.
    rear_axle_m: Number(-5.0, 15.0) in "m" = 1.6;
}
