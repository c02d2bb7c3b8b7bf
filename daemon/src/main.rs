//! `lookout`: watches the road ahead of a vehicle with two cameras.

mod cameras;
mod cli;
mod cli_cascade;
mod cli_record;
mod cli_rig;
mod command;
mod frame_record;
mod in_process;
mod input;
mod launch;
mod logging;
mod memory;
mod recorder;
mod rooms;
mod scheduler;
mod stage;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    match command::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lookout: {error}");
            ExitCode::FAILURE
        }
    }
}
