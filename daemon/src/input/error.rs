//! Errors of opening the source.

use perception::rig::Rig;
use sources::SourceError;
use std::path::PathBuf;
use thiserror::Error;

/// Why the source cannot be opened.
#[derive(Debug, Error)]
pub enum InputError {
    /// The source reports an error.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A folder or recording is configured without a path.
    #[error("source.kind is \"folder\" or \"recording\", but source.path is empty: name the folder or file")]
    NoPath,
    /// Pictures of one camera are named by a pattern, those of the other are not.
    #[error(
        "one of source.left and source.right is empty: name the pictures of both cameras (--left and --right)"
    )]
    OnePattern,
    /// A camera is configured without a device.
    #[error(
        "source.kind is \"camera\", but camera.left or camera.right is empty: name both devices, or set \
         camera.side_by_side"
    )]
    NoCamera,
    /// One camera as left and right.
    #[error(
        "camera.left = {left:?} and camera.right = {right:?} are one device: name the device of each camera, or set \
         camera.side_by_side if one device delivers both images"
    )]
    OneCamera {
        /// The left device.
        left: PathBuf,
        /// The right one.
        right: PathBuf,
    },
    /// This build lacks the camera backend.
    #[error("camera.backend = \"{0}\" is not in this build: build it with --features {0}")]
    NoBackend(String),
    /// Rectification without a rig file.
    #[error("source.rectify is true, but source.rig is empty: name a file of `lookout calibrate`")]
    NoCameras,
    /// Rectification with the rig of a pair that is rectified.
    #[error(
        "source.rectify is true, but {} describes rectified pictures: name a file of `lookout calibrate`, or set \
         source.rectify to \"auto\"", .0.display()
    )]
    NoDistortion(PathBuf),
    /// Pictures with lens distortion, and nothing to rectify them with.
    #[error(
        "{0}: its calibration says that the pictures are not rectified: name the rig of the cameras with --rig or \
         source.rig (a file of `lookout calibrate` or `lookout rig`), record rectified pictures, or take them as they \
         are with source.rectify = false"
    )]
    Distorted(String),
    /// Cameras with a file of motion.
    #[error(
        "vehicle.motion = \"{0}\", but source.kind is \"camera\": give the vehicle's bus with vehicle.bus, or leave it empty"
    )]
    MotionOfCameras(String),
    /// There is no calibration to convert disparities to metres.
    #[error(
        "{0}: no calibration: put calib.txt or rig.toml beside the images, or name one with --rig or source.rig"
    )]
    NoRig(String),
    /// Cameras without a rig file.
    #[error(
        "source.kind is \"camera\", but source.rig is empty: calibrate the cameras with lookout calibrate --live camera, and \
         name its rig file"
    )]
    NoRigOfCameras,
    /// The rig cannot be that of the pictures.
    #[error(
        "{name}: its principal point, column {:.0} of row {:.0}, lies outside of the pictures of {}x{} pixels: it is for pictures \
         of another size; give the rig of these with --rig or source.rig", rig.cx_px, rig.cy_px, size.0, size.1
    )]
    OtherSize {
        /// The file.
        name: String,
        /// What it says.
        rig: Rig,
        /// Width and height of the pictures.
        size: (usize, usize),
    },
    /// The configured rig file cannot be read.
    #[error("source.rig (--rig): {0}")]
    Rig(SourceError),
}
