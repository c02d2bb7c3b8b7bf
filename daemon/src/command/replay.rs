//! `lookout replay`.

use crate::alarm_log::AlarmLog;
use crate::alarm_tally::{AlarmTally, alarm_times};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::left_out::LeftOut;
use crate::command::number::{fps, whole};
use crate::command::video::Film;
use crate::in_process::Pipeline;
use crate::scheduler::{self, Ends, RunOptions};
use clap::Args;
use config::Config;
use std::path::Path;
use std::path::PathBuf;
use std::time::Instant;
use tools::reporting::motion::MotionTally;
use tools::reporting::output::{FrameWriter, prepare, write_summary};
use tools::reporting::summary::RunSummary;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout replay ../shared/data/kitti_sequence_1 --lockstep --out results
  lookout replay RECORDING --fps 12.5 --loop --limit 1000
  lookout replay RECORDING --in-process --out reference
  lookout replay --left 'cam0/*.png' --right 'cam1/*.png' --rig rig.toml
  lookout replay both.mp4 --rig rig.toml
  lookout replay drive.mcap --lockstep --out again
  lookout replay RECORDING --lockstep --record drive.mcap
  lookout replay RECORDING --lockstep --video drive.mp4
  lookout replay scene:street --out results
  lookout replay 'scene:street?weather=night&seed=7' --lockstep --out night
  lookout replay scene:my/road.toml

PATH is a folder with two folders of pictures with the same names: left and right, image_2 and image_3,
image_0 and image_1, image_l and image_r, cam0 and cam1, a drive of KITTI's raw data, or a sequence of
EuRoC (mav0); or a folder with pictures such as left_1.png and right_1.png. Any other pictures are
named by --left and --right. The calibration is read from rig.toml, calib.txt, calib/NAME.txt,
calib_cam_to_cam.txt or sensor.yaml beside them. Pictures are PNG, JPEG, TIFF, BMP, WebP, PGM or PPM,
grey or coloured; 16-bit ones are scaled by the bits that they use (source.bits), raw ones of a colour
sensor need source.bayer. A pair with a picture that cannot be read is left out and counted.

PATH may also be an MCAP file: a recording of lookout record, or a ROS 2 bag with two image topics
whose names differ by left and right, and their camera_info. A truncated file is read up to its last
complete chunk.

PATH may also be a video with both images side by side; --left and --right may name two. They are
decoded by ffmpeg on the PATH, or by GStreamer where that is built in.

scene:NAME is a synthetic scene with its own rig: a built-in one (drive, street, crest, dip, slope,
bend, roll, overtaken, bridge, lamps, wet, textureless, bus, car-body, car-rear, green-belt, cone,
debris, stopped-car, next-lane, crest-traffic, dip-traffic, motion, junction-parked, bend-parked,
bend-parked-left, bend-stopped, bend-overtaking, bend-overtaken, bend-oncoming), random, which a seed
generates, or a TOML file (docs/scenes.md). drive has no end: --limit N, or Ctrl-C. Settings may
follow: ?weather=sunny, light_rain, heavy_rain, night, snow, backlight or overcast; seed=N; rig=paper,
kitti or board.

--out writes overlay/NNNNNN.png, disparity/NNNNNN.png (16 bit, disparity x 256), obstacles.jsonl
(one line per frame) and summary.json.

--video makes a video of the overlays when the run has ended. FILE.mp4, .mkv and .webm are encoded by
ffmpeg or GStreamer (gst-launch-1.0) on the PATH. FILE.gif needs neither; it has at most 15 pictures
a second, 600 in all and 800 columns. Without --out the overlays need disk space beside the video while it
is made.";

#[derive(Args, Debug)]
pub struct Replay {
    /// Folder, MCAP file or video of the recording, or scene:NAME
    #[arg(required_unless_present_any = ["left", "right"])]
    pub path: Option<PathBuf>,
    /// Left pictures, instead of PATH: a folder, or a pattern such as 'cam0/*.png', in quotes
    #[arg(long, value_name = "PATTERN", requires = "right", conflicts_with = "path")]
    pub left: Option<PathBuf>,
    /// Right pictures; they belong to left ones for which the stars stand for the same text
    #[arg(long, value_name = "PATTERN", requires = "left", conflicts_with = "path")]
    pub right: Option<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Pairs per second [default: the rate of the recording]
    #[arg(long, value_name = "N", value_parser = fps, conflicts_with = "lockstep")]
    pub fps: Option<f64>,
    /// Process every frame, one at a time: results are reproducible byte for byte
    #[arg(long)]
    pub lockstep: bool,
    /// Start over at the end of the recording; without --limit until Ctrl-C
    #[arg(long = "loop")]
    pub repeat: bool,
    /// Stop at a pair that cannot be read, instead of leaving it out
    #[arg(long)]
    pub strict: bool,
    /// Stop after this many pairs
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1, u64::MAX))]
    pub limit: Option<u64>,
    /// Rig file (TOML), KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC [default: the calibration beside the recording]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Folder for overlays, disparity maps, obstacles.jsonl and summary.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Video of the overlays, made when the run has ended: FILE.gif, or FILE.mp4, .mkv, .webm by ffmpeg or GStreamer
    #[arg(long, value_name = "FILE")]
    pub video: Option<PathBuf>,
    /// Also record the run to an MCAP file; with --lockstep without loss
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "in_process")]
    pub record: Option<PathBuf>,
    /// Run the same stages in this process, without shared memory
    #[arg(long, conflicts_with_all = ["fps", "lockstep", "instance"])]
    pub in_process: bool,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

/// Prefix of a path that names a scene.
const SCENE: &str = "scene:";

pub fn run(args: &Replay, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "scheduler", Some("warn"))?;
    match (&args.path, &args.left, &args.right) {
        (Some(path), ..) => set_source(&mut config, path),
        (None, Some(left), Some(right)) => set_patterns(&mut config, left, right),
        // Refused by the parser.
        _ => {}
    }
    config.source.repeat = args.repeat;
    config.source.strict |= args.strict;
    if let Some(fps) = args.fps {
        config.source.fps = fps;
    }
    if let Some(rig) = &args.rig {
        config.source.rig.clone_from(rig);
    }
    let film = Film::prepare(args.video.as_deref(), args.out.as_deref())?;
    if args.in_process {
        in_process(args, &config, film.folder())?;
        return film.finish(args.json);
    }
    let options = RunOptions {
        lockstep: args.lockstep,
        limit: args.limit,
        out: film.folder().map(Path::to_owned),
        record: args.record.clone(),
        ends: Ends::WithSource,
    };
    let bar = progress(args.limit, "frames");
    let outcome = scheduler::run(&config, &options, &mut |status| {
        bar.set_position(status.frames);
        bar.set_message(format!("{:.0} ms end to end", status.latency_p50_ms));
    })?;
    bar.finish_and_clear();
    finish(args, &outcome.summary)?;
    match outcome.failure {
        Some(failure) => Err(CommandError::Other(failure)),
        // Without --limit a repeated recording has no other end.
        None if outcome.was_stopped && !(args.repeat && args.limit.is_none()) => {
            let frames = outcome.summary.frames;
            Err(CommandError::Other(format!(
                "stopped by a signal after {frames} frames: results are incomplete"
            )))
        }
        None => film.finish(args.json),
    }
}

/// Configures the source from a folder, an MCAP file or `scene:NAME`.
pub fn set_source(config: &mut Config, path: &Path) {
    match path.to_str().and_then(|path| path.strip_prefix(SCENE)) {
        Some(scene) => {
            config.source.kind = "scene".into();
            config.source.path = scene.into();
        }
        None => {
            config.source.left = PathBuf::new();
            config.source.right = PathBuf::new();
            let is_file = tools::evaluation::compare::is_recording(path);
            config.source.kind = if is_file { "recording" } else { "folder" }.into();
            config.source.path = path.to_owned();
        }
    }
}

/// Configures the source from two patterns.
fn set_patterns(config: &mut Config, left: &Path, right: &Path) {
    config.source.kind = "folder".into();
    config.source.path = PathBuf::new();
    config.source.left = left.to_owned();
    config.source.right = right.to_owned();
}

fn finish(args: &Replay, summary: &RunSummary) -> Result<(), CommandError> {
    if let Some(out) = &args.out {
        write_summary(out, summary)?;
    }
    if args.json {
        return say(serde_json::to_string_pretty(summary)?);
    }
    say(summary)?;
    match &args.out {
        Some(out) => say(format_args!("results in {}", out.display())),
        None => Ok(()),
    }
}

/// Runs the same stages as the daemon in this process, frame by frame.
fn in_process(args: &Replay, config: &Config, out: Option<&Path>) -> Result<(), CommandError> {
    let mut pipeline = Pipeline::open(config)?;
    let count = pipeline.count().unwrap_or(u64::MAX);
    let frames = match args.limit {
        Some(limit) if args.repeat => limit,
        Some(limit) => limit.min(count),
        None if args.repeat => {
            return Err(CommandError::Other(
                "--loop with --in-process has no end: give --limit, or leave out --in-process and end with Ctrl-C".into(),
            ));
        }
        None => count,
    };
    if let Some(out) = out {
        prepare(out)?;
    }
    let mut writer = out.map(FrameWriter::open).transpose()?;
    let bar = progress(Some(frames), "frames");
    let start = Instant::now();
    let mut left_out = LeftOut::default();
    let (mut motion, mut alarm) = (MotionTally::default(), AlarmTally::default());
    let mut alarm_log = AlarmLog::default();
    for sequence in 0..frames {
        let result = pipeline.frame(sequence, sequence % count.max(1));
        let Some(result) = left_out.unless_broken(sequence, config.source.strict, result)? else {
            bar.inc(1);
            continue;
        };
        motion.add(&result.record.motion);
        alarm.add(sequence, result.source_ns, &result.alarm);
        alarm_log.add(sequence, &result.alarm);
        if let Some(writer) = &mut writer {
            writer.write(&result.record, Some(result.images))?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    left_out.check(frames)?;
    let unreadable = left_out.count;
    let frames = frames - unreadable;
    let rate_hz = frames as f64 / seconds;
    let (motion, alarm_times) = (motion.summary(), alarm_times(&alarm.record()));
    let summary = RunSummary {
        seconds,
        rate_hz,
        offered: frames,
        frames,
        unreadable,
        motion,
        alarms: alarm_log.alarms(),
        alarm_changes: alarm_log.changes().to_vec(),
        alarm_times,
        ..RunSummary::default()
    };
    if let Some(out) = &args.out {
        write_summary(out, &summary)?;
    }
    if args.json {
        return say(serde_json::to_string_pretty(&summary)?);
    }
    match &args.out {
        Some(out) => {
            say(format_args!("{frames} frames, results in {}\n{}", out.display(), summary.alarm_times))
        }
        None => say(format_args!("{frames} frames\n{}", summary.alarm_times)),
    }
}

#[cfg(test)]
mod tests {
    use super::HELP;
    use sources::scene::file::Weather;
    use sources::scene::library::{RANDOM, SCENES};

    #[test]
    fn the_help_names_every_scene_and_every_weather() {
        let words: Vec<&str> = HELP.split(|c: char| !(c.is_alphanumeric() || "-_".contains(c))).collect();
        let names =
            SCENES.iter().map(|(name, _)| *name).chain([RANDOM]).chain(Weather::ALL.map(Weather::name));
        for name in names {
            assert!(words.contains(&name), "{name}");
        }
    }
}
