//! `lookout odometry`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use crate::command::number::whole;
use crate::command::own_motion::{OwnMotion, frames_used, process, set_recording};
use crate::in_process::Pipeline;
use clap::Args;
use std::io::Write;
use std::path::{Path, PathBuf};
use tools::reporting::poses::pose_line;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout odometry ../shared/data/kitti_sequence_1 -o poses.txt
  lookout odometry drive.mcap -o poses.txt --limit 500
  lookout odometry DIR --rig rig.toml -o poses.txt
  lookout odometry scene:bend -o - | head -3
  lookout evaluate odometry DIR --poses truth.txt --estimate poses.txt

RECORDING is a folder, an MCAP file or scene:NAME, as for lookout replay.

The output has a line for each frame: the 3x4 matrix from the left camera of the frame to that of the
first, row by row (KITTI's format; x right, y down, z forward; metres). Where the motion is unknown, a
line is a prediction, also for a pair that cannot be read; how many these are is told at the end (with -o - on standard error).";

#[derive(Args, Debug)]
pub struct Odometry {
    /// Folder or MCAP file of the recording, or scene:NAME
    pub recording: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig file (TOML), KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC [default: the calibration
    /// beside the recording]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Stop after this many pairs [default: all; 1000 of an endless scene]
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1, u64::MAX))]
    pub limit: Option<u64>,
    /// Stop at a pair that cannot be read, instead of leaving it out
    #[arg(long)]
    pub strict: bool,
    /// Poses, in KITTI's format; - for standard output
    #[arg(short, long, value_name = "POSES.txt")]
    pub out: PathBuf,
}

pub fn run(args: &Odometry, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "odometry", Some("warn"))?;
    set_recording(&mut config, &args.recording, args.rig.as_deref());
    let mut pipeline = Pipeline::open(&config)?;
    let frames = frames_used(pipeline.count(), args.limit);
    let bar = progress(Some(frames), "frames");
    let strict = args.strict || config.source.strict;
    let (motion, left_out) = process(&mut pipeline, frames, strict, &bar)?;
    bar.finish_and_clear();
    let to_stdout = args.out == Path::new("-");
    if to_stdout {
        for frame in &motion.frames {
            say(pose_line(&frame.pose))?;
        }
    } else {
        let text: String = motion.frames.iter().map(|frame| pose_line(&frame.pose) + "\n").collect();
        let cannot =
            |e| CommandError::Other(format!("{}: {e}: give another file with -o", args.out.display()));
        std::fs::write(&args.out, text).map_err(cannot)?;
    }
    let told = summary(&motion) + &left_out.told();
    if to_stdout {
        // A closed terminal is no error.
        let _ = writeln!(std::io::stderr(), "{told}");
        return Ok(());
    }
    say(format_args!("{}: {told}", args.out.display()))
}

fn summary(motion: &OwnMotion) -> String {
    let frames = motion.frames.len();
    let length_m: f64 = motion
        .frames
        .windows(2)
        .map(|w| {
            let [a, b] = [w[0].pose.translation_m, w[1].pose.translation_m];
            a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
        })
        .sum();
    match motion.unknown {
        0 => format!("{frames} poses, {length_m:.1} m"),
        1 => format!("{frames} poses, {length_m:.1} m; motion unknown in 1 frame: predicted"),
        unknown => format!("{frames} poses, {length_m:.1} m; motion unknown in {unknown} frames: predicted"),
    }
}
