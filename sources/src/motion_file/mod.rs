//! Files of a vehicle's motion.
//!
//! | file | content |
//! |---|---|
//! | `motion.csv` | what the vehicle reported: columns `time_s`, `speed_m_s`, `yaw_rate_rad_s` |
//! | `poses.txt` | KITTI's poses: a line a frame, camera to first camera |
//! | OXTS as one CSV | inertial and satellite navigation: `time_s`, `vf_m_s`, `wu`, `lat_deg`, `lon_deg`, `yaw_rad` |
//! | `oxts/` | the same as KITTI's raw data has it: a file a frame |
//!
//! The first is what a vehicle has while it drives. The others are ground truth in data sets: they are input only where
//! that is requested.

mod kitti_oxts;
mod motion_source;
mod motion_table;
mod oxts;
mod poses;
mod table;
mod timestamps;
mod trajectory;

pub use motion_source::MotionSource;
pub use motion_table::{MOTION_CSV, MotionTable};
pub use oxts::{OXTS_LEVER_ARM_M, read_oxts};
pub use poses::read_poses;
pub use timestamps::{FrameTimes, TIMESTAMPS, read_timestamps};
pub use trajectory::Trajectory;
