//! `lookout record`.

use crate::command::attach::{Attached, attach, cannot_join, silent};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::{number, whole};
use crate::recorder::{Feed, Plan};
use clap::Args;
use indicatif::ProgressBar;
use messages::header::Header;
use messages::port::Subscriber;
use messages::rig::RigRecord;
use messages::silence::TIMEOUT;
use messages::wait::{self, Next};
use messages::{depth, obstacles, pair, service, status};
use perception::rig::Rig;
use signal_hook::consts::SIGXFSZ;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::recording::{BYTES_PER_MB, Choice, ImageForm};
use tools::recording::{Limits, Report, RingLimits};

pub const HELP: &str = "Examples:
  lookout record -o drive.mcap
  lookout record -o drive.mcap --jpeg --split-mb 500 --split-s 300
  lookout record -o events.mcap --ring-s 20 --after-s 10     only around alarms
  lookout record -o drive.mcap --topics all --seconds 60 --json
  lookout replay drive.mcap --lockstep --out again           process the recording again
  lookout compare results again

Records a running daemon without slowing it: a separate low-priority process reads shared memory.
Messages that it misses are counted; the counts are also in the file. Foxglove, Lichtblick and the
mcap tools open the file. Stop recording with Ctrl-C or SIGTERM; it also ends with the daemon. After
a power failure or kill -9 the file can be replayed up to its last chunk, about one second earlier.

Images are stored uncompressed (--raw), lossless as PNG (--png; more CPU time) or lossy as JPEG
(--jpeg; smallest, for viewing). --split-mb and --split-s start new files, drive_0001.mcap and so
on, each complete in itself; with --ring-s every alarm starts a new file. --topics: images (with
calibration), obstacles, scene (3D boxes, pose), points (point cloud, twice a second), status; or all.";

#[derive(Args, Debug)]
pub struct Record {
    /// Output file; with --split-mb, --split-s or --ring-s FILE_0001.mcap and so on
    #[arg(short, long, value_name = "FILE.mcap")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Store images uncompressed (default)
    #[arg(long)]
    pub raw: bool,
    /// Store images as PNG
    #[arg(long, conflicts_with = "raw")]
    pub png: bool,
    /// Store images as JPEG
    #[arg(long, conflicts_with_all = ["raw", "png"])]
    pub jpeg: bool,
    /// Topics to record, separated by commas [default: images,obstacles,scene,status]
    #[arg(long, value_name = "LIST", default_value_t = Choice::default(), hide_default_value = true)]
    pub topics: Choice,
    /// Start a new file before one has more than this many MB (1 MB is 1,000,000 bytes)
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1, 1_000_000))]
    pub split_mb: Option<u64>,
    /// Start a new file after this many seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub split_s: Option<f64>,
    /// Keep the last N seconds in memory and write them when an alarm is raised
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub ring_s: Option<f64>,
    /// With --ring-s: seconds to record after the last frame of an alarm
    #[arg(long, value_name = "N", default_value_t = 10.0, value_parser = seconds, requires = "ring_s")]
    pub after_s: f64,
    /// With --ring-s: memory limit, in MB
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = whole::<u64>(1, 65_536), requires = "ring_s")]
    pub ring_mb: u64,
    /// End the recording when less than this many MB are free on the disk
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = whole::<u64>(0, 10_000_000))]
    pub min_free_mb: u64,
    /// End after this many seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub seconds: Option<f64>,
    /// Print the report of the recording as JSON
    #[arg(long)]
    pub json: bool,
}

impl Record {
    /// Format of recorded images.
    pub fn form(&self) -> ImageForm {
        match (self.png, self.jpeg) {
            (true, _) => ImageForm::Png,
            (_, true) => ImageForm::Jpeg,
            _ => ImageForm::Raw,
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.1, 1e6)
}

/// After this time without a status it is checked whether the daemon still runs. A status is sent once a
/// second.
const SILENCE: Duration = Duration::from_millis(1500);

/// Longest wait between two checks of signals and time limits.
const TICK: Duration = Duration::from_millis(200);

pub fn run(args: &Record, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "record", Some("warn"))?;
    // Must not compete with a stage. If the priority cannot be lowered, recording continues at the current one.
    let _ = rustix::process::nice(19);
    // A write beyond the file size limit shall fail with an error instead of killing the process.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))
        .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    let attached = attach(&config, "record")?;
    let statuses = subscriber(&attached, &service::STATUS)?;
    let frames = await_rig(&attached, &statuses)?;
    let rig = Rig {
        focal_px: frames.focal_px,
        baseline_m: frames.baseline_m,
        cx_px: frames.cx_px,
        cy_px: frames.cy_px,
    };
    let plan = Plan {
        form: args.form(),
        topics: args.topics,
        limits: limits(args),
        instance: attached.instance.name().to_owned(),
    };
    let feed = Feed::start(&args.out, plan, rig, (frames.width, frames.height), false)?;
    let (report, reason) = listen(args, &attached, statuses, feed)?;
    print(args, &report, &reason)
}

fn limits(args: &Record) -> Limits {
    let ns = |seconds: f64| (seconds * 1e9) as u64;
    Limits {
        split_bytes: args.split_mb.map(|mb| mb * BYTES_PER_MB),
        split_ns: args.split_s.map(ns),
        min_free_bytes: args.min_free_mb * BYTES_PER_MB,
        ring: args.ring_s.map(|seconds| RingLimits {
            before_ns: ns(seconds),
            after_ns: ns(args.after_s),
            bytes: usize::try_from(args.ring_mb * BYTES_PER_MB).unwrap_or(usize::MAX),
        }),
    }
}

/// Waits for the rig and frame size in the daemon's status, which is sent once a second and on connecting.
fn await_rig(attached: &Attached, statuses: &Subscriber) -> Result<RigRecord, CommandError> {
    let start = Instant::now();
    let mut found = None;
    wait::run::<CommandError>(&[statuses], || {
        while let Some(sample) = statuses.receive()? {
            if let Ok(status) = status::view(sample.header(), sample.payload())
                && status.rig.width > 0
            {
                found = Some(status.rig);
                return Ok(Next::Stop);
            }
        }
        if attached.stop.load(Ordering::Relaxed) || start.elapsed() > TIMEOUT {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(TICK))
    })?;
    found.ok_or_else(|| silent(&attached.instance))
}

fn subscriber(attached: &Attached, spec: &service::ServiceSpec) -> Result<Subscriber, CommandError> {
    attached.bus.subscriber(spec).map_err(|error| cannot_join(&attached.instance, error))
}

/// Records until a signal, the time limit, the end of the daemon, or an error of the disk.
fn listen(
    args: &Record,
    attached: &Attached,
    statuses: Subscriber,
    feed: Feed,
) -> Result<(Report, String), CommandError> {
    let pairs = subscriber(attached, &service::PAIR)?;
    let results = subscriber(attached, &service::OBSTACLES)?;
    let depths = args.topics.points.then(|| subscriber(attached, &service::DEPTH)).transpose()?;
    let mut sources: Vec<&Subscriber> = vec![&pairs, &results, &statuses];
    sources.extend(&depths);
    let start = Instant::now();
    let mut last_status = Instant::now();
    let mut session = Session { feed, bar: progress(None, "frames"), ring_mb: args.ring_mb, is_short: false };
    let mut ended = "asked to stop";
    wait::run::<CommandError>(&sources, || {
        // Pairs first: their places in shared memory are reused first.
        session.take_pair(&pairs)?;
        session.take_result(&results)?;
        if let Some(depths) = &depths {
            session.take_depth(depths)?;
        }
        if session.take_status(&statuses)? {
            last_status = Instant::now();
        }
        if session.feed.is_over() || attached.stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if args.seconds.is_some_and(|seconds| start.elapsed().as_secs_f64() >= seconds) {
            ended = "its time is up";
            return Ok(Next::Stop);
        }
        let silence = last_status.elapsed();
        if silence > TIMEOUT || (silence > SILENCE && !attached.instance.is_running()) {
            ended = if attached.instance.is_running() {
                "the daemon is stopped, or hangs: it has sent no status for 5 s"
            } else {
                "the daemon has ended"
            };
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(TICK))
    })?;
    session.bar.finish_and_clear();
    Ok((session.feed.finish(ended)?, ended.to_owned()))
}

/// A recording in progress. Each message is released as soon as it is encoded.
struct Session {
    feed: Feed,
    bar: ProgressBar,
    ring_mb: u64,
    /// Whether the user was warned that the ring is shorter than requested.
    is_short: bool,
}

impl Session {
    fn take_pair(&mut self, pairs: &Subscriber) -> Result<(), CommandError> {
        if let Some(sample) = pairs.receive()? {
            match pair::view(sample.header(), sample.payload()) {
                Ok(pair) => self
                    .feed
                    .pair(sample.header(), &pair)
                    .map_err(|e| CommandError::Other(format!("cannot compress an image: {e}")))?,
                Err(error) => warn_refused(sample.header(), &error),
            }
        }
        self.feed.missed("pair", pairs.take_missed());
        Ok(())
    }

    fn take_result(&mut self, results: &Subscriber) -> Result<(), CommandError> {
        if let Some(sample) = results.receive()? {
            match obstacles::view(sample.header(), sample.payload()) {
                Ok(message) => self.feed.obstacles(sample.header(), &message),
                Err(error) => warn_refused(sample.header(), &error),
            }
        }
        self.feed.missed("obstacles", results.take_missed());
        Ok(())
    }

    /// Missed depth messages are not counted: clouds are recorded at a lower rate than depth is published.
    fn take_depth(&mut self, depths: &Subscriber) -> Result<(), CommandError> {
        if let Some(sample) = depths.receive()? {
            match depth::view(sample.header(), sample.payload()) {
                Ok(depth) => self.feed.depth(sample.header(), &depth),
                Err(error) => warn_refused(sample.header(), &error),
            }
        }
        Ok(())
    }

    /// Returns whether there was a status.
    fn take_status(&mut self, statuses: &Subscriber) -> Result<bool, CommandError> {
        let Some(sample) = statuses.receive()? else { return Ok(false) };
        if let Ok(status) = status::view(sample.header(), sample.payload()) {
            self.feed.status(&status);
        }
        let report = self.feed.report();
        self.bar.set_position(report.frames);
        let lost = report.lost.values().sum::<u64>();
        self.bar.set_message(format!("{} MB, {lost} lost", report.bytes / BYTES_PER_MB));
        if self.feed.is_short() && !self.is_short {
            self.is_short = true;
            tracing::warn!(
                mb = self.ring_mb,
                "the ring holds less time than requested: raise --ring-mb, or use --jpeg"
            );
        }
        Ok(true)
    }
}

fn warn_refused(header: &Header, error: &dyn std::fmt::Display) {
    tracing::warn!(sequence = header.sequence, %error, "a message was refused");
}

fn print(args: &Record, report: &Report, reason: &str) -> Result<(), CommandError> {
    if args.json {
        let mut document = serde_json::to_value(report)?;
        if let Some(document) = document.as_object_mut() {
            document.insert("ended".into(), reason.into());
        }
        return say(serde_json::to_string_pretty(&document)?);
    }
    let lost: Vec<String> =
        report.lost.iter().map(|(service, count)| format!("{count} of {service}")).collect();
    let lost = if lost.is_empty() { "none".into() } else { lost.join(", ") };
    say(format_args!(
        "{} frames, {:.1} MB; lost messages: {lost}; {reason}",
        report.frames,
        report.bytes as f64 / BYTES_PER_MB as f64
    ))?;
    for file in &report.files {
        say(file.display())?;
    }
    if report.files.is_empty() {
        say("no file was written: there was no alarm")?;
    }
    Ok(())
}
