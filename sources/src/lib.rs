//! Sources of stereo pairs: recordings, live cameras, synthetic scenes and data sets with ground truth.
//!
//! All sources implement [`PairSource`]: pairs of grey images, read by index. The other crates of the workspace
//! import this one as `sources`.
//!
//! | module | content |
//! |---|---|
//! | [`folder`] | image folders, including the layouts of KITTI |
//! | [`recording`] | MCAP files of `lookout record`, and ROS 2 bags |
//! | [`camera`] | live cameras: V4L2, GStreamer; pairing, reconnection, exposure control |
//! | [`scene`] | synthetic scenes with exact ground truth |
//! | [`chessboard`] | synthetic chessboard images, to test calibration |
//! | [`truth`] | data sets with ground truth: KITTI, Middlebury, LiDAR depth, labels |
//! | [`rectified`] | rectification of another source's pairs |
//! | [`rig_file`], [`calibration_file`] | calibration files: the rig file, OpenCV, ROS, Kalibr, KITTI |
//! | [`motion_file`] | files of the vehicle's motion: `motion.csv`, KITTI's poses, OXTS |
//! | [`vehicle`] | the signals of the vehicle's CAN bus: DBC, decoding, state |
//! | [`limits`], [`bounded_file`] | what each reader takes at most, and how a file is read within it |
//!
//! ```
//! use lookout_sources::PairSource;
//! use lookout_sources::scene::Scene;
//!
//! let mut scene = Scene::open("street?weather=night&seed=7")?;
//! let (width, height) = scene.size();
//! let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
//! scene.read(0, &mut left, &mut right)?;
//!
//! let truth = scene.truth(0);
//! assert_eq!(truth.disparity_px.len(), width * height);
//! # Ok::<(), lookout_sources::SourceError>(())
//! ```

pub mod bayer;
pub mod bounded_file;
pub mod calibration_file;
mod calibration_text;
pub mod camera;
pub mod chessboard;
pub mod folder;
mod foreign;
mod glob;
pub mod limits;
mod luma;
pub mod motion_file;
pub mod natural;
pub mod pairs;
pub mod picture;
pub mod recording;
pub mod rectified;
pub mod rig_file;
pub mod scene;
mod source;
mod toml_text;
pub mod truth;
pub mod vehicle;
pub mod video;

pub use source::{Geometry, LiveSource, PairSource, Readiness, SourceError, check_two_files};
