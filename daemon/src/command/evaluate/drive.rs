//! `lookout evaluate drive`.

use super::true_path::{TruePath, check_count, from_files, from_scene, warn_of_times};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use crate::command::left_out::LeftOut;
use crate::command::own_motion::{frames_used, join, set_recording};
use crate::in_process::Pipeline;
use crate::stages::road::parameters::range;
use clap::Args;
use config::Config;
use indicatif::ProgressBar;
use messages::alarm::{Faults, OFF, level_name};
use messages::motion::MotionRecord;
use perception::range::Range;
use perception::rig::Rig;
use sources::motion_file::Trajectory;
use std::path::{Path, PathBuf};
use tools::evaluation::drive::event::{Event, events};
use tools::evaluation::drive::filmstrip::{self, RoadLines, Still};
use tools::evaluation::drive::page::{Film, to_html};
use tools::evaluation::drive::report::DriveReport;
use tools::evaluation::drive::score::{Judgement, Tally, judge};
use tools::evaluation::drive::steadiness::View;
use tools::evaluation::drive::strip::DrivenPath;
use tools::evaluation::files::{prepare, write_report};
use tools::reporting::html::picture_source;
use tools::reporting::output::OutputError;
use tools::reporting::record::{AlarmLine, FrameRecord};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate drive my/drive.mcap
  lookout evaluate drive my/drive.mcap --out report           then open report/index.html
  lookout evaluate drive ../shared/data/kitti_sequence_1 --poses ../shared/data/kitti_sequence_1/poses.txt
  lookout evaluate drive DIR --rig DIR/rig.toml --set source.rectify=true \\
    --oxts DIR/oxts.csv --times DIR/timestamps.csv --json
  lookout evaluate drive mo.mcap tu.mcap --poses mo.txt --poses tu.txt

RECORDING is a folder, an MCAP file or scene:NAME, as for lookout replay. It is played in lock-step
through all stages. No labels are needed: nothing was hit on the drive, so

- a confirmed obstacle is false if more than 0.2 m of its width lie in the strip, 1.8 m wide, that the
  vehicle drove through within the next 3 s, unless it moves along: what drives ahead has left when the
  vehicle is there, and is not judged;
- each warning and each alarm is false, unless something crossed ahead and left in time: look at it.

Where the vehicle drove is known from KITTI's poses (a 3x4 matrix a line, camera to first camera), from
OXTS (columns time_s, vf_m_s, wu, lat_deg, lon_deg, yaw_rad) with the times of the frames (columns name,
left_s), or, without either, from this program's own odometry; a scene knows it. The path only judges:
the stages never see it. The options --poses, --oxts, --times and --rig are given once for each
recording, in their order; --rig may be given once for all.

The table has a row for each figure. judged: frames of which the path ahead is known. move along:
obstacles in the strip that are not judged; false or moving: both, which is what false counted before.
life: time after which half of the confirmed tracks were lost in view (Kaplan and Meier; what left what
both cameras see or the range, went behind something much nearer, is told as a boundary now, or is there
at the end tells only that it lived so long; > is a lower limit); strict: what is hidden or told as a
boundary counts as lost. jumps of width: of pairs of consecutive measured boxes. not called free: of the
driven strip up to 15 m ahead; what drove there counts. docs/drives.md has more.

--out writes index.html, one file with time lines and pictures before, at and after each false warning,
alarm and obstacle (the driven strip pink), and evaluation.json.";

#[derive(Args, Debug)]
pub struct EvaluateDrive {
    /// Folder or MCAP file of a recording, or scene:NAME
    #[arg(required = true, value_name = "RECORDING")]
    pub recordings: Vec<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig file (TOML), KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC [default: the calibration
    /// beside the recording]
    #[arg(long, value_name = "FILE")]
    pub rig: Vec<PathBuf>,
    /// Path that was driven: KITTI's poses.txt
    #[arg(long, value_name = "FILE", conflicts_with = "oxts")]
    pub poses: Vec<PathBuf>,
    /// Path that was driven: OXTS as one CSV
    #[arg(long, value_name = "CSV", requires = "times")]
    pub oxts: Vec<PathBuf>,
    /// Times of the frames, for --oxts
    #[arg(long, value_name = "CSV", requires = "oxts")]
    pub times: Vec<PathBuf>,
    /// Stop after this many pairs of each recording [default: all; 1000 of an endless scene]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub limit: Option<u64>,
    /// Stop at a pair that cannot be read, instead of leaving it out
    #[arg(long)]
    pub strict: bool,
    /// Folder for the report with pictures, and for evaluation.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the figures as JSON
    #[arg(long)]
    pub json: bool,
}

/// Events of a recording that get pictures: each takes about a third of a megabyte.
const MAX_FILMED: usize = 40;

/// Width of the pictures in the report, in px: three side by side fill a screen, and their text can be read.
const PICTURE_WIDTH: usize = 900;

/// A recording that will be played, with the path that it is judged by; `None`: by own odometry.
struct Drive<'a> {
    recording: &'a Path,
    config: Config,
    truth: Option<TruePath>,
}

/// What the stages said of a recording.
#[derive(Default)]
struct Played {
    records: Vec<FrameRecord>,
    /// Why the alarm was off in each frame.
    off_reasons: Vec<Vec<String>>,
    /// Source time in ns, and own motion, of each frame.
    motions: Vec<(u64, MotionRecord)>,
    /// The road of each frame, if pictures are wanted.
    roads: Vec<RoadLines>,
    size: (usize, usize),
    rig: Option<Rig>,
}

/// Why the alarm was off in a frame whose pair cannot be read.
const UNREADABLE: &str = "the pair cannot be read";

impl Played {
    /// Adds a frame whose pair cannot be read: nothing was seen, and no alarm could come. So frame numbers stay those of
    /// the recording.
    fn add_unreadable(&mut self, index: u64, source_ns: u64, with_roads: bool) {
        let reason = Some(UNREADABLE.to_owned());
        let alarm = AlarmLine { level: level_name(OFF).into(), reason, ..AlarmLine::default() };
        let time_s = source_ns as f64 * 1e-9;
        self.records.push(FrameRecord { sequence: index, time_s, alarm, ..FrameRecord::default() });
        self.off_reasons.push(vec![UNREADABLE.into()]);
        self.motions.push((source_ns, MotionRecord::default()));
        if with_roads {
            self.roads.push(RoadLines::default());
        }
    }
}

pub fn run(args: &EvaluateDrive, log: Option<&str>) -> Result<(), CommandError> {
    // Files are read first: a mistake in them shall not cost a run.
    let drives = drives(args, &load(&args.config, log, "evaluate", Some("warn"))?)?;
    if let Some(out) = &args.out {
        prepare(out, &[])?;
    }
    let (mut results, mut films) = (Vec::new(), Vec::new());
    for drive in &drives {
        let (truth, tally, events, film) = evaluate(args, drive)?;
        results.push((drive.recording.display().to_string(), truth, tally, events));
        films.push(film);
    }
    let report = DriveReport::new(results);
    if let Some(out) = &args.out {
        write_report(out, &report)?;
        let path = out.join("index.html");
        std::fs::write(&path, to_html(&report, &films)).map_err(|source| OutputError::Io { path, source })?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(report.to_string().trim_end()) }
}

/// The files of an option for the recordings: none, one for each, or, if `may_share`, one for all.
fn one_each<'a>(
    option: &str,
    files: &'a [PathBuf],
    recordings: usize,
    may_share: bool,
) -> Result<Vec<Option<&'a Path>>, CommandError> {
    match files {
        [] => Ok(vec![None; recordings]),
        [one] if may_share => Ok(vec![Some(one); recordings]),
        files if files.len() == recordings => Ok(files.iter().map(|file| Some(file.as_path())).collect()),
        files => Err(CommandError::Other(format!(
            "{option}: {} files for {recordings} recordings: give {option} once for each, in their order, or evaluate \
             the recordings one by one",
            files.len()
        ))),
    }
}

/// The recordings with their configurations and their paths.
fn drives<'a>(args: &'a EvaluateDrive, config: &Config) -> Result<Vec<Drive<'a>>, CommandError> {
    let count = args.recordings.len();
    let rigs = one_each("--rig", &args.rig, count, true)?;
    let poses = one_each("--poses", &args.poses, count, false)?;
    let oxts = one_each("--oxts", &args.oxts, count, false)?;
    let times = one_each("--times", &args.times, count, false)?;
    let drive = |(i, recording): (usize, &'a PathBuf)| {
        let mut config = config.clone();
        set_recording(&mut config, recording, rigs[i]);
        let truth = match from_files(poses[i], oxts[i].zip(times[i]))? {
            Some(truth) => Some(truth),
            None => from_scene(&config, args.limit)?,
        };
        Ok(Drive { recording, config, truth })
    };
    args.recordings.iter().enumerate().map(drive).collect()
}

/// Plays a recording and judges it. Gives where its path is from, counts, events, and their pictures if those are wanted.
fn evaluate(
    args: &EvaluateDrive,
    drive: &Drive<'_>,
) -> Result<(String, Tally, Vec<Event>, Film), CommandError> {
    let mut pipeline = Pipeline::open(&drive.config)?;
    let frames = frames_used(pipeline.count(), args.limit);
    let check = |truth, frames: usize| check_count(truth, frames, drive.recording, args.limit.is_some());
    if let Some(truth) = &drive.truth {
        check(truth, usize::try_from(frames).unwrap_or(usize::MAX))?;
    }
    let bar = progress(Some(frames), "frames");
    bar.set_message(drive.recording.display().to_string());
    let strict = args.strict || drive.config.source.strict;
    let (played, left_out) = play(&mut pipeline, frames, args.out.is_some(), strict, &bar)?;
    bar.finish_and_clear();
    left_out.warn(drive.recording);
    let own = join(&played.motions);
    let (from, path) = match &drive.truth {
        Some((from, path)) => {
            if !path.times_s.is_empty() {
                let used = path.times_s.len().min(own.times_s.len());
                warn_of_times(&own.times_s, &path.times_s[..used]);
            }
            (from.clone(), path.clone())
        }
        None => {
            let poses = own.frames.iter().map(|frame| frame.pose).collect();
            let unknown = match own.unknown {
                0 => String::new(),
                frames => format!(", predicted in {frames} frames"),
            };
            (format!("own odometry{unknown}"), Trajectory { poses, ..Trajectory::default() })
        }
    };
    // The times that are written beside the obstacles.
    let times_s: Vec<f64> = played.records.iter().map(|record| record.time_s).collect();
    let path = DrivenPath::new(&path, &times_s, played.records.len());
    let judgement = judge(&path, &played.records, &played.off_reasons, &view(&drive.config, &played));
    let events = events(&judgement, &played.records);
    let film = match args.out {
        Some(_) => film(&mut pipeline, &played, &path, &judgement, &events)?,
        None => Film::default(),
    };
    Ok((from, judgement.tally, events, film))
}

/// Processes the first `frames` pairs. `with_roads` keeps what pictures need.
fn play(
    pipeline: &mut Pipeline,
    frames: u64,
    with_roads: bool,
    is_strict: bool,
    bar: &ProgressBar,
) -> Result<(Played, LeftOut), CommandError> {
    let (mut played, mut left_out) = (Played::default(), LeftOut::default());
    for index in 0..frames {
        bar.inc(1);
        let source_ns = pipeline.time_ns(index);
        let result = pipeline.frame(index, index);
        let Some(result) = left_out.unless_broken(index, is_strict, result)? else {
            played.add_unreadable(index, source_ns, with_roads);
            continue;
        };
        let images = result.images;
        if with_roads {
            let profile_px = images.profile_px.to_vec();
            played.roads.push(RoadLines { profile_px, edges: images.edges });
        }
        (played.size, played.rig) = ((images.width, images.height), Some(images.rig));
        played.motions.push((result.source_ns, result.motion));
        let faults = Faults(result.alarm.faults);
        played.off_reasons.push(faults.descriptions().map(Into::into).collect());
        played.records.push(result.record);
    }
    left_out.check(frames)?;
    Ok((played, left_out))
}

/// What the cameras see: picture and range.
fn view(config: &Config, played: &Played) -> View {
    let side = |px: usize| u32::try_from(px).unwrap_or(u32::MAX);
    let disparities = config.stereo.disparities as f64;
    let px_at_1_m = played.rig.map_or(0.0, |rig| rig.disparity_px(1.0));
    View {
        width_px: side(played.size.0),
        height_px: side(played.size.1),
        px_at_1_m,
        near_m: px_at_1_m / disparities,
        range: played.rig.map_or(Range::fixed(0.0), |rig| range(config, &rig)),
    }
}

/// The alarm over time, and the events with their pictures.
fn film(
    pipeline: &mut Pipeline,
    played: &Played,
    path: &DrivenPath,
    judgement: &Judgement,
    events: &[Event],
) -> Result<Film, CommandError> {
    let mut film = Film {
        levels: (0..path.frames())
            .map(|frame| (path.time_s(frame), played.records[frame].alarm.level.clone()))
            .collect(),
        false_s: judgement.false_obstacles.iter().map(|f| path.time_s(f.frame)).collect(),
        events: Vec::new(),
    };
    let bar = progress(Some(events.len().min(MAX_FILMED) as u64), "events");
    for (i, event) in events.iter().enumerate() {
        let mut stills = Vec::new();
        if i < MAX_FILMED {
            for frame in filmstrip::frames(path, event.frame) {
                stills.push(still(pipeline, played, path, frame)?);
            }
            bar.inc(1);
        }
        film.events.push((event.clone(), stills));
    }
    bar.finish_and_clear();
    Ok(film)
}

/// One picture.
fn still(
    pipeline: &mut Pipeline,
    played: &Played,
    path: &DrivenPath,
    frame: usize,
) -> Result<Still, CommandError> {
    let (Some(record), Some(road), Some(rig)) =
        (played.records.get(frame), played.roads.get(frame), played.rig)
    else {
        return Ok(Still::default());
    };
    if record.alarm.reason.as_deref() == Some(UNREADABLE) {
        return Ok(Still::default());
    }
    let left = pipeline.left(frame as u64)?;
    let picture = filmstrip::still(left, played.size, rig, road, record, path.strip(frame).as_ref());
    let caption = format!("frame {frame}, {:.1} s: {}", path.time_s(frame), record.alarm.text());
    Ok(Still { caption, source: picture_source(&picture, PICTURE_WIDTH) })
}
