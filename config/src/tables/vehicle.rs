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

    /// File with the motion of a recording, absolute or from the recording's folder: `motion.csv`, KITTI's poses.txt or
    /// oxts folder, or OXTS as CSV. If empty, a folder's motion.csv or a recording's topic /vehicle is used, where there
    /// is one; `none` uses nothing. Poses and OXTS are usually ground truth: they are used only when they are named here.
    motion: Path = "";

    /// CAN interface that the vehicle's signals are received from, such as can0; needs a build with the feature `can`.
    /// If empty, no bus is read. Where a bus is set, the motion of a recording is not used.
    bus: Text(15) = "";

    /// DBC file with the messages of the bus.
    dbc: Path = "";

    /// Speed: `Message.Signal` of the DBC file, or its place in the frame in DBC's notation (docs/vehicle.md). Units:
    /// m/s, km/h, mph.
    speed_signal: Text(240) = "";

    /// The speed of the bus is multiplied by this, for tyres of another size.
    speed_factor: Number(0.5, 2.0) = 1.0;

    /// Yaw rate. Units: rad/s, deg/s.
    yaw_rate_signal: Text(240) = "";

    /// Direction of a turn in which the yaw rate of the bus is positive.
    yaw_rate_positive: Choice(&["left", "right"]) = "left";

    /// Angle of the steering wheel. Units: rad, deg.
    steering_angle_signal: Text(240) = "";

    /// Direction in which the steering angle of the bus is positive.
    steering_angle_positive: Choice(&["left", "right"]) = "left";

    /// Brake: pressed where the signal is not 0, or has one of the values after `=`, as in `Brake.State=1,2`.
    brake_signal: Text(240) = "";

    /// Left turn indicator; values as for `vehicle.brake_signal`. Both indicators may be values of one signal.
    turn_left_signal: Text(240) = "";

    /// Right turn indicator.
    turn_right_signal: Text(240) = "";

    /// Selected gear. In reverse, a speed signal that has no sign counts as negative.
    gear_signal: Text(240) = "";

    /// Values of `vehicle.gear_signal` for park, separated by commas.
    gear_park: Text(240) = "";

    /// Values for reverse.
    gear_reverse: Text(240) = "";

    /// Values for neutral; all values that are in none of the three lists are forward gears.
    gear_neutral: Text(240) = "";

    /// A value that was received longer than this before the exposure of a frame is not used.
    stale_ms: Whole(10, 10_000) in "ms" = 500;
}
