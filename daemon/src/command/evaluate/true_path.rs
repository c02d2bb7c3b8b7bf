//! Ground truth of the vehicle's path, for evaluations: files, or a scene.

use crate::command::error::CommandError;
use crate::command::own_motion::frames_used;
use config::Config;
use sources::PairSource;
use sources::motion_file::{Trajectory, read_oxts, read_poses};
use sources::scene::Scene;
use std::path::Path;

/// A true path, and where it is from.
pub type TruePath = (String, Trajectory);

/// The true path of KITTI's poses, or of OXTS with the times of the frames; `None` if neither is given.
///
/// # Errors
/// Names the file, the line and the remedy.
pub fn from_files(
    poses: Option<&Path>,
    oxts: Option<(&Path, &Path)>,
) -> Result<Option<TruePath>, CommandError> {
    Ok(match (poses, oxts) {
        (Some(file), _) => {
            let path = read_poses(file).map_err(|error| CommandError::Other(format!("--poses {error}")))?;
            Some((file.display().to_string(), path))
        }
        (None, Some((oxts, times))) => {
            let path = read_oxts(oxts, times)
                .map_err(|error| CommandError::Other(format!("--oxts, --times: {error}")))?;
            Some((oxts.display().to_string(), path))
        }
        (None, None) => None,
    })
}

/// The true path of the configured scene, with its exact speed and yaw rate; `None` if the source is none.
///
/// # Errors
/// If the scene cannot be opened.
pub fn from_scene(config: &Config, limit: Option<u64>) -> Result<Option<TruePath>, CommandError> {
    if config.source.kind != "scene" {
        return Ok(None);
    }
    let scene = Scene::open(&config.source.path.to_string_lossy())?;
    let mut scene = if config.source.fps > 0.0 { scene.at_rate(config.source.fps) } else { scene };
    let mut path = Trajectory::default();
    for index in 0..frames_used(scene.count(), limit) {
        let motion = scene.truth(index).motion;
        path.poses.push(motion.pose);
        path.times_s.push(scene.time_s(index));
        path.speed_m_s.push(motion.speed_m_s);
        path.yaw_rate_rad_s.push(motion.yaw_rate_rad_s);
    }
    Ok(Some(("the truth of the scene".into(), path)))
}

/// The truth must have a pose for each frame, and without `--limit` no more.
///
/// # Errors
/// Names the truth, both counts and the remedy.
pub fn check_count(
    (from, path): &TruePath,
    frames: usize,
    recording: &Path,
    is_limited: bool,
) -> Result<(), CommandError> {
    let poses = path.poses.len();
    if poses == frames || (is_limited && poses > frames) {
        return Ok(());
    }
    Err(CommandError::Other(format!(
        "{from}: {poses} poses for {frames} frames of {}: give the ground truth of this recording",
        recording.display()
    )))
}

/// Ratio of durations from which on the times of recording and truth do not belong together: 1 % of the speed.
const MAX_TIME_ERROR: f64 = 0.01;

/// Warns if the source time runs faster or slower than the time of the truth: speed and yaw rate are then wrong by as much.
pub fn warn_of_times(own_times_s: &[f64], true_times_s: &[f64]) {
    let duration = |times: &[f64]| times.last().zip(times.first()).map_or(0.0, |(last, first)| last - first);
    let (own_s, true_s) = (duration(own_times_s), duration(true_times_s));
    if (own_s / true_s - 1.0).abs() > MAX_TIME_ERROR {
        tracing::warn!(
            "the recording lasts {own_s:.2} s, its ground truth {true_s:.2} s: speed and yaw rate are wrong by as much: \
             give the recording its times (timestamps.csv)"
        );
    }
}
