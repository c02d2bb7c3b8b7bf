//! `lookout compare`.

use super::{CommandError, say};
use crate::cli_record::Compare;
use tools::evaluation::compare::{Tolerance, compare, is_recording, read};

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
