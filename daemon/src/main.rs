//! `lookout`: watches the road ahead of a vehicle with two cameras.

mod cameras;
mod cli;
mod cli_board;
mod cli_cascade;
mod cli_lidar;
mod cli_record;
mod cli_rig;
mod cli_soak;
mod cli_view;
mod command;
mod frame_record;
mod host;
mod in_process;
mod input;
mod journal;
mod launch;
mod logging;
mod memory;
mod realtime;
mod recorder;
mod scheduler;
mod soak;
mod stages;
mod view;

use clap::Parser;
use std::process::ExitCode;

/// Counts what each thread allocates: a stage reports it with every frame.
#[global_allocator]
static ALLOCATOR: messages::allocation::CountingAllocator = messages::allocation::CountingAllocator;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    let result = command::run(cli);
    logging::finish();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lookout: {error}");
            ExitCode::FAILURE
        }
    }
}
