//! `lookout compare`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::number;
use clap::Args;
use std::path::PathBuf;
use tools::evaluation::compare::{Tolerance, compare, is_recording, read};

pub const HELP: &str = "Examples:
  lookout compare results again
  lookout replay RECORDING --lockstep --record drive.mcap
  lookout replay drive.mcap --lockstep --out again
  lookout compare drive.mcap again                  a recording and its replay
  lookout compare a.mcap b.mcap --distance-m 0.1 --box-px 2 --json

A and B are output folders of lookout replay --out, their obstacles.jsonl, or recordings with
obstacles. The obstacles of each frame are matched by their boxes. Frames that differ are listed
with their largest differences. If a recording is compared with a folder, its frames are numbered
by its pairs, as a replay numbers them. A recording of a daemon that had been running begins with the
tracks and the road of before, which its replay does not have: some obstacles, their numbers and the
alarm then differ, most of all in the first seconds.

Exit code: 0 if nothing differs by more than --distance-m and --box-px, 1 otherwise.";

#[derive(Args, Debug)]
pub struct Compare {
    /// The first run
    pub a: PathBuf,
    /// The second run
    pub b: PathBuf,
    /// Tolerated difference of distances, in m
    #[arg(long, value_name = "N", default_value_t = 0.0, value_parser = metres)]
    pub distance_m: f64,
    /// Tolerated difference of box sides, in px
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub box_px: u32,
    /// List at most this many frames
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub list: usize,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

fn metres(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1e6)
}

pub fn run(args: &Compare) -> Result<(), CommandError> {
    // A replay numbers frames by the pairs of its recording, not by their original sequence.
    let by_pair = is_recording(&args.a) != is_recording(&args.b);
    let (a, b) = (read(&args.a, by_pair)?, read(&args.b, by_pair)?);
    let tolerance = Tolerance { distance_m: args.distance_m, box_px: args.box_px };
    let result = compare(&a, &b, tolerance);
    if args.json {
        say(serde_json::to_string_pretty(&result)?)?;
    } else {
        for difference in result.differences.iter().take(args.list) {
            say(difference)?;
        }
        if result.differences.len() > args.list {
            say(format_args!("and {} more (--list N)", result.differences.len() - args.list))?;
        }
        say(&result)?;
    }
    if result.is_same() {
        return Ok(());
    }
    Err(CommandError::Other(format!("{} and {} differ", args.a.display(), args.b.display())))
}
