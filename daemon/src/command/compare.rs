//! `lookout compare`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::number;
use clap::Args;
use std::path::PathBuf;
use tools::evaluation::compare::{Tolerance, compare, is_recording, read};

pub const HELP: &str = "Examples:
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

fn metres(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1e6)
}

pub fn run(args: &Compare) -> Result<(), CommandError> {
    // A replay numbers the pairs that it has.
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
