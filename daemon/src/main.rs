//! `lookout`: watches the road ahead of a vehicle with two cameras.

mod cli;
mod cli_cascade;
mod cli_rig;
mod command;
mod frame_record;
mod in_process;
mod input;
mod launch;
mod logging;
mod memory;
mod realtime;
mod rooms;
mod scheduler;
mod stage;

use clap::Parser;
use std::process::ExitCode;

/// Counts what each thread allocates: a stage reports it with every frame.
#[global_allocator]
static ALLOCATOR: ipc::allocation::CountingAllocator = ipc::allocation::CountingAllocator;

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
