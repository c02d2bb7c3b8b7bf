//! `lookout record`.

use crate::command::attach::{Attached, attach};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::number;
use crate::recorder::{Feed, Plan};
use clap::Args;
use messages::header::Header;
use messages::port::Subscriber;
use messages::rig::RigRecord;
use messages::wait::{self, Next};
use messages::{depth, obstacles, pair, service, status};
use perception::rig::Rig;
use signal_hook::consts::SIGXFSZ;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::recording::{Choice, ImageForm};
use tools::recording::{Limits, Report, RingLimits};

pub const HELP: &str = "Examples:
  lookout record -o drive.mcap
  lookout record -o drive.mcap --jpeg --split-mb 500 --split-s 300
  lookout record -o events.mcap --ring-s 20 --after-s 10     only what is around alarms
  lookout record -o drive.mcap --topics all --seconds 60 --json
  lookout replay drive.mcap --lockstep --out again           what was recorded, once more
  lookout compare results again

Records a running daemon without slowing it: its own process of low priority reads shared memory; what
it misses is counted, in the file, too. Foxglove, Lichtblick and the mcap tools open the file. Stop it
with Ctrl-C or SIGTERM; it ends with the daemon. After a loss of power, or kill -9, the file can be
replayed up to its last chunk, about a second before.

Images are recorded as they are (--raw), without loss as PNG (--png; more work), or as JPEG (--jpeg;
least bytes, for looking at). --split-mb and --split-s begin new files, drive_0001.mcap and so on,
each of which stands alone; so does every alarm with --ring-s. --topics: images (and calibration),
obstacles, scene (boxes in space), points (point cloud, twice a second), status; or all.";

#[derive(Args, Debug)]
pub struct Record {
    /// The file, FILE.mcap; with --split-mb, --split-s or --ring-s FILE_0001.mcap and so on
    #[arg(short, long, value_name = "FILE.mcap")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Images as they are: the default
    #[arg(long)]
    pub raw: bool,
    /// Images as PNG
    #[arg(long, conflicts_with = "raw")]
    pub png: bool,
    /// Images as JPEG
    #[arg(long, conflicts_with_all = ["raw", "png"])]
    pub jpeg: bool,
    /// What is recorded: words with commas
    #[arg(long, value_name = "LIST", default_value_t = Choice::default())]
    pub topics: Choice,
    /// A new file after this many MB
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub split_mb: Option<u64>,
    /// A new file after this many seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub split_s: Option<f64>,
    /// Keeps the last N seconds in memory and records them when an alarm comes
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub ring_s: Option<f64>,
    /// With --ring-s: how long is recorded after the last frame of an alarm
    #[arg(long, value_name = "N", default_value_t = 10.0, value_parser = seconds, requires = "ring_s")]
    pub after_s: f64,
    /// With --ring-s: the most memory, in MB
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u64).range(1..=65_536), requires = "ring_s")]
    pub ring_mb: u64,
    /// The recording ends when fewer MB are free on the disk
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u64).range(0..=10_000_000))]
    pub min_free_mb: u64,
    /// Ends after this many seconds
    #[arg(long, value_name = "N", value_parser = seconds)]
    pub seconds: Option<f64>,
    /// Print what was recorded as JSON
    #[arg(long)]
    pub json: bool,
}

impl Record {
    /// How images are recorded.
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

/// How long the daemon may take to say what its frames are, or be silent.
const PATIENCE: Duration = Duration::from_secs(5);

/// After this silence the recorder looks whether the daemon is still there; its status comes once a second.
const SILENCE: Duration = Duration::from_millis(1500);

/// How often the recorder looks around when nothing comes.
const TICK: Duration = Duration::from_millis(200);

pub fn run(args: &Record, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "record", Some("warn"))?;
    // Never in the way of a stage: without the right to a lower priority it goes on with this one.
    let _ = rustix::process::nice(19);
    // A file that reaches the process's limit is an error of its write, not the end of the process.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))
        .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    let attached = attach(&config, "record")?;
    let statuses = attached.bus.subscriber(&service::STATUS)?;
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
    tell(args, &report, &reason)
}

fn limits(args: &Record) -> Limits {
    let ns = |seconds: f64| (seconds * 1e9) as u64;
    Limits {
        split_bytes: args.split_mb.map(|mb| mb << 20),
        split_ns: args.split_s.map(ns),
        min_free_bytes: args.min_free_mb << 20,
        ring: args.ring_s.map(|seconds| RingLimits {
            before_ns: ns(seconds),
            after_ns: ns(args.after_s),
            bytes: usize::try_from(args.ring_mb << 20).unwrap_or(usize::MAX),
        }),
    }
}

/// What the daemon's frames are; it says so once a second, and at once to who comes late.
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
        if attached.stop.load(Ordering::Relaxed) || start.elapsed() > PATIENCE {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(TICK))
    })?;
    let silent =
        || CommandError::Other("the daemon does not say what its frames are: is it starting?".into());
    found.ok_or_else(silent)
}

/// Records until a signal, the time given, the daemon's end, or the disk's.
fn listen(
    args: &Record,
    attached: &Attached,
    statuses: Subscriber,
    mut feed: Feed,
) -> Result<(Report, String), CommandError> {
    let pairs = attached.bus.subscriber(&service::PAIR)?;
    let results = attached.bus.subscriber(&service::OBSTACLES)?;
    let depths = args.topics.points.then(|| attached.bus.subscriber(&service::DEPTH)).transpose()?;
    let mut sources: Vec<&Subscriber> = vec![&pairs, &results, &statuses];
    sources.extend(&depths);
    let bar = progress(None, "frames");
    let start = Instant::now();
    let mut heard = Instant::now();
    let mut is_short = false;
    let mut ended = "asked to stop";
    let refuse = |header: &Header, error: &dyn std::fmt::Display| {
        tracing::warn!(sequence = header.sequence, %error, "a message was refused");
    };
    wait::run::<CommandError>(&sources, || {
        // Pairs first: they are overtaken first. Each is let go of as soon as it is encoded.
        if let Some(sample) = pairs.receive()? {
            match pair::view(sample.header(), sample.payload()) {
                Ok(pair) => feed
                    .pair(sample.header(), &pair)
                    .map_err(|e| CommandError::Other(format!("an image cannot be compressed: {e}")))?,
                Err(error) => refuse(sample.header(), &error),
            }
        }
        feed.missed("pair", pairs.take_missed());
        if let Some(sample) = results.receive()? {
            match obstacles::view(sample.header(), sample.payload()) {
                Ok(message) => feed.obstacles(sample.header(), &message),
                Err(error) => refuse(sample.header(), &error),
            }
        }
        feed.missed("obstacles", results.take_missed());
        if let Some(depths) = &depths {
            // Clouds are taken now and then: what is overtaken in between is no loss.
            if let Some(sample) = depths.receive()? {
                match depth::view(sample.header(), sample.payload()) {
                    Ok(depth) => feed.depth(sample.header(), &depth),
                    Err(error) => refuse(sample.header(), &error),
                }
            }
        }
        if let Some(sample) = statuses.receive()? {
            heard = Instant::now();
            if let Ok(status) = status::view(sample.header(), sample.payload()) {
                feed.status(&status);
            }
            let report = feed.report();
            bar.set_position(report.frames);
            bar.set_message(format!("{} MB, {} lost", report.bytes >> 20, report.lost.values().sum::<u64>()));
            if feed.is_short() && !is_short {
                is_short = true;
                tracing::warn!(
                    mb = args.ring_mb,
                    "the ring is shorter than asked: raise --ring-mb, or take --jpeg"
                );
            }
        }
        if feed.is_over() {
            return Ok(Next::Stop);
        }
        if attached.stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if args.seconds.is_some_and(|seconds| start.elapsed().as_secs_f64() >= seconds) {
            ended = "its time is up";
            return Ok(Next::Stop);
        }
        let silence = heard.elapsed();
        if silence > PATIENCE || (silence > SILENCE && !attached.instance.is_running()) {
            ended = "the daemon has ended";
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(TICK))
    })?;
    bar.finish_and_clear();
    Ok((feed.finish(ended)?, ended.to_owned()))
}

fn tell(args: &Record, report: &Report, reason: &str) -> Result<(), CommandError> {
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
        report.bytes as f64 / f64::from(1 << 20)
    ))?;
    for file in &report.files {
        say(file.display())?;
    }
    if report.files.is_empty() {
        say("no file was written: there was no alarm")?;
    }
    Ok(())
}
