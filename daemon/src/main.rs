//! `lookout`: watches the road ahead of a vehicle with two cameras.

mod cameras;
mod cli;
mod cli_board;
mod cli_cascade;
mod cli_record;
mod cli_rig;
mod cli_soak;
mod cli_view;
mod command;
mod frame_record;
mod in_process;
mod input;
mod journal;
mod launch;
mod logging;
mod memory;
mod recorder;
mod rooms;
mod scheduler;
mod soak;
mod stage;
mod view;

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
