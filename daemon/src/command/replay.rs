//! `lookout replay`.

use crate::alarm_tally::{AlarmTally, alarm_times};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::fps;
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
  lookout replay drive.mcap --lockstep --out again
  lookout replay RECORDING --lockstep --record drive.mcap
  lookout replay RECORDING --lockstep --video drive.mp4
  lookout replay scene:street --out results
  lookout replay 'scene:street?weather=night&seed=7' --lockstep --out night
  lookout replay scene:my/road.toml

PATH is a folder with two folders of images with the same names: image_2 and image_3, image_0 and
image_1, image_l and image_r, left and right, image_02/data and image_03/data, or image_00/data and
image_01/data. The calibration is read from rig.toml, calib.txt or calib/NAME.txt beside them.

PATH may also be an MCAP file: a recording of lookout record, or a ROS 2 bag with two image topics
whose names differ by left and right, and their camera_info. A truncated file is read up to its last
complete chunk.

scene:NAME is a synthetic scene with its own rig: a built-in one (drive, street, crest, dip,
slope, bend, roll, overtaken, bridge, lamps, wet, textureless, bus, car-body, car-rear,
green-belt, cone, debris, crest-traffic, dip-traffic), or a TOML file (docs/scenes.md). Settings
may follow: ?weather=sunny, light_rain, heavy_rain, night, snow, backlight or overcast; seed=N;
rig=paper or kitti.

--out writes overlay/NNNNNN.png, disparity/NNNNNN.png (16 bit, disparity x 256), obstacles.jsonl
(one line per frame) and summary.json.

--video makes a video of the overlays when the run has ended. FILE.mp4, .mkv and .webm are encoded by
ffmpeg or GStreamer (gst-launch-1.0) on the PATH. FILE.gif needs neither; it has at most 15 pictures
a second, 600 in all and 800 columns. Without --out the overlays need room beside the video while it
is made.";

#[derive(Args, Debug)]
pub struct Replay {
    /// Folder or MCAP file of the recording, or scene:NAME
    pub path: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Pairs per second [default: the rate of the recording]
    #[arg(long, value_name = "N", value_parser = fps, conflicts_with = "lockstep")]
    pub fps: Option<f64>,
    /// Process every frame, one at a time: results are reproducible byte for byte
    #[arg(long)]
    pub lockstep: bool,
    /// Start over at the end of the recording
    #[arg(long = "loop", requires = "limit")]
    pub repeat: bool,
    /// Stop after this many pairs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub limit: Option<u64>,
    /// Rig TOML or KITTI calib.txt [default: the calibration beside the recording]
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
    set_source(&mut config, &args.path);
    config.source.repeat = args.repeat;
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
        None if outcome.was_stopped => {
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
            let is_file = tools::evaluation::compare::is_recording(path);
            config.source.kind = if is_file { "recording" } else { "folder" }.into();
            config.source.path = path.to_owned();
        }
    }
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
        None => count,
    };
    if let Some(out) = out {
        prepare(out)?;
    }
    let mut writer = out.map(FrameWriter::open).transpose()?;
    let bar = progress(Some(frames), "frames");
    let start = Instant::now();
    let (mut motion, mut alarm) = (MotionTally::default(), AlarmTally::default());
    for sequence in 0..frames {
        let result = pipeline.frame(sequence, sequence % count.max(1))?;
        motion.add(&result.record.motion);
        alarm.add(sequence, result.source_ns, &result.alarm);
        if let Some(writer) = &mut writer {
            writer.write(&result.record, Some(result.images))?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    let rate_hz = frames as f64 / seconds;
    let (motion, alarm_times) = (motion.summary(), alarm_times(&alarm.record()));
    let summary = RunSummary {
        seconds,
        rate_hz,
        offered: frames,
        frames,
        motion,
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
