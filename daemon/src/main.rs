//! `lookout`: stereo obstacle detection ahead of a vehicle. The daemon, its stages and all subcommands.

mod alarm_log;
mod alarm_tally;
#[cfg(feature = "zenoh")]
mod bridge;
mod can_out;
mod command;
mod frame_record;
mod host;
mod in_process;
mod input;
mod launch;
mod logging;
mod memory;
mod printable;
mod realtime;
mod recorder;
mod scheduler;
mod soak;
mod stages;
mod status_json;
mod stream;
mod view;

use printable::{Printable, PrintableLines};
use std::process::ExitCode;

/// Counts the heap allocations of each thread; a stage reports its count with every frame.
#[global_allocator]
static ALLOCATOR: messages::allocation::CountingAllocator = messages::allocation::CountingAllocator;

fn main() -> ExitCode {
    let cli = command::parse();
    let result = command::run(cli);
    logging::finish();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Errors name files and values from outside.
            if error.has_lines() {
                eprintln!("lookout: {}", PrintableLines(error));
            } else {
                eprintln!("lookout: {}", Printable(error));
            }
            ExitCode::FAILURE
        }
    }
}
