//! The command line of recordings.

use crate::cli::{ConfigArgs, number};
use clap::Args;
use std::path::PathBuf;
use tools::recording::{Choice, ImageForm};

pub const RECORD_HELP: &str = "Examples:
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

pub const COMPARE_HELP: &str = "Examples:
  lookout compare results again
  lookout compare drive.mcap again                  a recording, and its replay with other parameters
  lookout compare a.mcap b.mcap --distance-m 0.1 --box-px 2 --json

A and B are folders of lookout replay --out, their obstacles.jsonl, or recordings with obstacles. Each
frame's obstacles are matched by their boxes; the frames that differ are listed, with the largest
differences. Frames of a recording that is compared with a folder are numbered by the pairs in it.

Exit code: 0 when nothing differs by more than --distance-m and --box-px, 1 otherwise.";

#[derive(Args, Debug)]
pub struct Compare {
    /// The first run
    pub a: PathBuf,
    /// The second run
    pub b: PathBuf,
    /// Distances may differ by this, in metres
    #[arg(long, value_name = "N", default_value_t = 0.0, value_parser = metres)]
    pub distance_m: f64,
    /// Sides of boxes may differ by this, in pixels
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub box_px: u32,
    /// The most frames that are listed
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub list: usize,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.1, 1e6)
}

fn metres(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1e6)
}
