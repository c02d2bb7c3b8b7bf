//! `lookout evaluate odometry`.

use super::true_path::{TruePath, check_count, from_files, from_scene, warn_of_times};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use crate::command::own_motion::{OwnMotion, frames_used, process, set_recording};
use crate::in_process::{Pipeline, PipelineError};
use crate::input;
use crate::stages::motion::body;
use clap::Args;
use config::Config;
use sources::motion_file::read_poses;
use std::path::PathBuf;
use tools::evaluation::files::{prepare, write_report};
use tools::evaluation::odometry::{EstimateFrame, Truth, score};
use tools::evaluation::odometry_report::{OdometryReport, save_plots};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate odometry ../shared/data/kitti_sequence_1 --poses ../shared/data/kitti_sequence_1/poses.txt
  lookout evaluate odometry DIR --rig DIR/rig.toml --set source.rectify=true \\
    --oxts DIR/oxts.csv --times DIR/timestamps.csv --out results
  lookout evaluate odometry DIR --poses truth.txt --estimate poses.txt --json
  lookout evaluate odometry 'scene:bend?weather=light_rain'

RECORDING is a folder, an MCAP file or scene:NAME, as for lookout replay. Ground truth: KITTI's poses (a
3x4 matrix a line, camera to first camera), or OXTS (columns time_s, vf_m_s, wu, lat_deg, lon_deg,
yaw_rad) with the times of the frames (columns name, left_s); height is then not compared; a scene has
its own. --estimate
evaluates poses of a file (lookout odometry, or another program) instead of running the stages.

drift: from every frame over 10, 20, 40, 80, 100 ... 800 m of the true path, as far as they fit: error
of the position at the end in percent of the length, error of the orientation in degrees a metre.
frame to frame: RMS error of speed and yaw rate between successive poses. filtered: the same of what
the alarm uses, at the time of each frame. path 1.5 s ahead: distance of the place where the camera is
1.5 s later from the arc that speed and yaw rate predict; straight is the same without the yaw rate.
consistency: errors divided by the standard deviations given with them; 1 is right.

--out writes path.svg (from above), speed.svg, yaw_rate.svg and evaluation.json.";

#[derive(Args, Debug)]
pub struct EvaluateOdometry {
    /// Folder or MCAP file of the recording, or scene:NAME
    pub recording: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig file (TOML), KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC [default: the calibration
    /// beside the recording]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Ground truth: KITTI's poses.txt
    #[arg(long, value_name = "FILE", conflicts_with = "oxts")]
    pub poses: Option<PathBuf>,
    /// Ground truth: OXTS as one CSV
    #[arg(long, value_name = "CSV", requires = "times")]
    pub oxts: Option<PathBuf>,
    /// Times of the frames, for --oxts
    #[arg(long, value_name = "CSV", requires = "oxts")]
    pub times: Option<PathBuf>,
    /// Evaluate these poses instead of running the stages
    #[arg(long, value_name = "POSES.txt")]
    pub estimate: Option<PathBuf>,
    /// Stop after this many pairs [default: all; 1000 of an endless scene]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub limit: Option<u64>,
    /// Stop at a pair that cannot be read, instead of leaving it out
    #[arg(long)]
    pub strict: bool,
    /// Folder for plots and evaluation.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the figures as JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &EvaluateOdometry, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "evaluate", Some("warn"))?;
    set_recording(&mut config, &args.recording, args.rig.as_deref());
    // Files are read first: a mistake in them shall not cost a run.
    let truth = true_path(args, &config)?;
    let is_limited = args.limit.is_some();
    let motion = match &args.estimate {
        Some(file) => from_file(args, &config, file)?,
        None => {
            let mut pipeline = Pipeline::open(&config)?;
            let frames = frames_used(pipeline.count(), args.limit);
            check_count(&truth, frames as usize, &args.recording, is_limited)?;
            let bar = progress(Some(frames), "frames");
            let strict = args.strict || config.source.strict;
            let (motion, left_out) = process(&mut pipeline, frames, strict, &bar)?;
            bar.finish_and_clear();
            left_out.warn(&args.recording);
            motion
        }
    };
    check_count(&truth, motion.frames.len(), &args.recording, is_limited)?;
    let (from, path) = truth;
    let truth = Truth::new(&path, &motion.times_s);
    let true_times: Vec<f64> = truth.frames.iter().map(|frame| frame.time_s).collect();
    warn_of_times(&motion.times_s, &true_times);
    let mut score = score(&truth, &motion.frames, &body(&config));
    if args.estimate.is_some() {
        // Poses alone do not tell it.
        score.unknown_percent = None;
    }
    let report = OdometryReport { name: args.recording.display().to_string(), truth: from, score };
    if let Some(out) = &args.out {
        prepare(out, &[])?;
        save_plots(out, &truth, &motion.frames)?;
        write_report(out, &report)?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(report.to_string().trim_end()) }
}

/// The true path, and where it is from.
fn true_path(args: &EvaluateOdometry, config: &Config) -> Result<TruePath, CommandError> {
    let oxts = args.oxts.as_deref().zip(args.times.as_deref());
    let given = from_files(args.poses.as_deref(), oxts)?;
    let found = given.map_or_else(|| from_scene(config, args.limit), |truth| Ok(Some(truth)))?;
    found.ok_or_else(|| {
        CommandError::Other(format!(
            "{}: no ground truth: give --poses FILE, or --oxts CSV with --times CSV",
            args.recording.display()
        ))
    })
}

/// Poses of a file, with the times of the recording's frames.
fn from_file(
    args: &EvaluateOdometry,
    config: &Config,
    file: &std::path::Path,
) -> Result<OwnMotion, CommandError> {
    let mut poses = read_poses(file)?.poses;
    poses.truncate(args.limit.map_or(usize::MAX, |limit| usize::try_from(limit).unwrap_or(usize::MAX)));
    let source = input::open(config).map_err(PipelineError::from)?;
    if source.count().is_some_and(|count| count < poses.len() as u64) {
        return Err(CommandError::Other(format!(
            "{}: {} poses, but {} has {} frames: give the poses of this recording",
            file.display(),
            poses.len(),
            args.recording.display(),
            source.count().unwrap_or_default()
        )));
    }
    Ok(OwnMotion {
        times_s: (0..poses.len() as u64).map(|index| source.time_ns(index) as f64 * 1e-9).collect(),
        frames: poses.into_iter().map(|pose| EstimateFrame { pose, motion: None }).collect(),
        unknown: 0,
    })
}
