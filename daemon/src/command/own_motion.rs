//! Own motion of a recording, frame by frame: the stages up to the road, in this process.

use crate::command::error::CommandError;
use crate::command::left_out::LeftOut;
use crate::command::replay::set_source;
use crate::in_process::Pipeline;
use crate::stages::motion::motion;
use config::Config;
use indicatif::ProgressBar;
use messages::motion::MotionRecord;
use std::path::Path;
use tools::evaluation::odometry::EstimateFrame;
use tools::reporting::poses::{PathJoiner, Reading, pose_of};

/// Maximum number of frames of an endless source, such as a scene.
const MAX_ENDLESS: u64 = 1000;

/// Own motion of a recording.
#[derive(Debug, Default)]
pub struct OwnMotion {
    /// Times of the frames, in seconds of source time.
    pub times_s: Vec<f64>,
    /// Pose and filtered motion of each frame.
    pub frames: Vec<EstimateFrame>,
    /// Number of frames after the first whose motion is unknown: their poses are predicted.
    pub unknown: u64,
}

/// Sets the source and its rig in a configuration.
pub fn set_recording(config: &mut Config, path: &Path, rig: Option<&Path>) {
    set_source(config, path);
    if let Some(rig) = rig {
        config.source.rig = rig.to_owned();
    }
}

/// Number of frames of a source that are used.
pub fn frames_used(count: Option<u64>, limit: Option<u64>) -> u64 {
    match (count, limit) {
        (Some(count), limit) => count.min(limit.unwrap_or(u64::MAX)),
        (None, limit) => limit.unwrap_or(MAX_ENDLESS),
    }
}

/// Processes the first `frames` pairs. The motion of a pair that cannot be read is unknown, so that frame numbers stay
/// those of the recording; `is_strict` ends with its error.
///
/// # Errors
/// If no pair can be read, or a stage cannot use one.
pub fn process(
    pipeline: &mut Pipeline,
    frames: u64,
    is_strict: bool,
    bar: &ProgressBar,
) -> Result<(OwnMotion, LeftOut), CommandError> {
    let (mut records, mut left_out) = (Vec::new(), LeftOut::default());
    for index in 0..frames {
        let result = pipeline.motion(index);
        let record = left_out.unless_broken(index, is_strict, result)?;
        records.push(record.unwrap_or_else(|| (pipeline.time_ns(index), MotionRecord::default())));
        bar.inc(1);
    }
    left_out.check(frames)?;
    Ok((join(&records), left_out))
}

/// Joins the motion of frames, with their source times in ns, to one path.
pub fn join(records: &[(u64, MotionRecord)]) -> OwnMotion {
    let mut joiner = PathJoiner::default();
    let frames = records.iter().map(|(_, record)| {
        let pose = joiner.next(reading(record));
        EstimateFrame { pose, motion: motion(record) }
    });
    let frames = frames.collect();
    OwnMotion {
        times_s: records.iter().map(|(source_ns, _)| *source_ns as f64 * 1e-9).collect(),
        frames,
        // Before the first frame is no other.
        unknown: records.iter().skip(1).filter(|(_, record)| !record.is_known()).count() as u64,
    }
}

fn reading(record: &MotionRecord) -> Option<Reading> {
    let pose = pose_of(record.orientation, record.position_m)?;
    Some(Reading { pose, resets: record.resets })
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::motion::health;
    use perception::motion::pose::Pose;

    #[test]
    fn frames_without_a_pose_repeat_the_motion_before_them() {
        let record = |i: u64| MotionRecord {
            speed_m_s: 10.0,
            position_m: [0.0, 0.0, i as f64],
            orientation: if i % 4 == 3 { [0.0; 4] } else { [0.0, 0.0, 0.0, 1.0] },
            health: if i == 0 || i % 4 == 3 { 0 } else { health::KNOWN | health::ODOMETRY },
            ..MotionRecord::default()
        };
        let records: Vec<(u64, MotionRecord)> = (0..10).map(|i| (100_000_000 * i, record(i))).collect();
        let motion = join(&records);
        assert_eq!((motion.frames.len(), motion.unknown), (10, 2));
        assert!(motion.frames[3].motion.is_none() && motion.frames[4].motion.is_some());
        for (i, (frame, time_s)) in motion.frames.iter().zip(&motion.times_s).enumerate() {
            let expected = i as f64;
            assert!((frame.pose.translation_m[2] - expected).abs() < 1e-9, "{i}: {frame:?}");
            assert!((time_s - 0.1 * expected).abs() < 1e-9);
        }
        // Nothing determines the motion: no pose at all.
        let none = join(&[(0, MotionRecord::default()), (1, MotionRecord::default())]);
        assert_eq!((none.unknown, none.frames[1].pose), (1, Pose::IDENTITY));
    }

    #[test]
    fn endless_sources_end() {
        assert_eq!((frames_used(Some(5), None), frames_used(Some(5), Some(9))), (5, 5));
        assert_eq!((frames_used(None, None), frames_used(None, Some(9))), (MAX_ENDLESS, 9));
    }
}
