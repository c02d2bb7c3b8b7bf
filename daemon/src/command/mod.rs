//! The command line: a file for each subcommand, with its arguments, its help and its handler.

mod attach;
mod calibrate;
mod check_config;
mod compare;
mod completions;
mod config_args;
mod console;
mod demo;
mod detect;
mod disparity;
mod error;
mod evaluate;
mod man;
mod number;
mod obstacles;
mod one_pair;
mod point_cloud;
mod record;
mod rectify;
mod replay;
mod restore_clocks;
mod rig;
mod run;
mod soak;
mod stage;
mod status;
mod train;
mod view;

pub use error::CommandError;

use clap::{CommandFactory, Parser, Subcommand};

/// Watches the road ahead of a vehicle with two cameras.
///
/// An aid, no safety element: it actuates nothing.
#[derive(Debug, Parser)]
#[command(
    name = "lookout",
    version,
    max_term_width = 100,
    after_help = "Examples:
  lookout demo                                    see it work, no hardware needed
  lookout replay RECORDING --out results          recorded pairs through the daemon
  lookout disparity left.png right.png -o d.png   one pair, dense disparity
  lookout evaluate stereo KITTI                   its errors against ground truth
  lookout evaluate weather                        obstacles found in six weathers
  lookout calibrate PICTURES --board 9x6 --square-mm 25 -o rig.toml
  lookout train --positives DIR --negatives DIR -o CASCADE.xml
  lookout status --watch                          what the running daemon is doing
  lookout view                                    the same in a browser, with pictures
  lookout record -o drive.mcap                    record it

Exit code: 0 on success, 2 for bad usage, 1 for everything else."
)]
pub struct Cli {
    /// Least severe message logged: error, warn, info, debug, trace [default: log.level of the
    /// configuration; warn for demo and replay]
    #[arg(long, global = true, value_name = "LEVEL", value_parser = ["error", "warn", "info", "debug", "trace"])]
    pub log: Option<String>,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// The whole daemon on a built-in synthetic drive: live table, pictures, plots, summary
    #[command(after_help = demo::HELP)]
    Demo(demo::Demo),
    /// The daemon in the foreground: what systemd starts
    #[command(after_help = run::HELP)]
    Run(run::Run),
    /// The daemon on recorded pairs, or on a synthetic scene
    #[command(after_help = replay::HELP)]
    Replay(replay::Replay),
    /// What a running daemon is doing
    #[command(after_help = status::HELP)]
    Status(status::Status),
    /// A running daemon in a browser: pictures, bird's-eye view, figures over time
    #[command(after_help = view::HELP)]
    View(view::View),
    /// One pair to a cloud of points
    #[command(after_help = point_cloud::HELP)]
    PointCloud(point_cloud::PointCloudCommand),
    /// Records a running daemon to MCAP, for replays, Foxglove and Lichtblick
    #[command(after_help = record::HELP)]
    Record(record::Record),
    /// Two runs of the same frames: which differ, and by how much
    #[command(after_help = compare::HELP)]
    Compare(compare::Compare),
    /// Dense disparity of one pair
    #[command(after_help = disparity::HELP)]
    Disparity(disparity::Disparity),
    /// One pair through road and recognition
    #[command(after_help = obstacles::HELP)]
    Obstacles(obstacles::Obstacles),
    /// Pictures of a chessboard to a rig file, with a verdict
    #[command(after_help = calibrate::HELP)]
    Calibrate(calibrate::Calibrate),
    /// One pair rectified: see a rig at work
    #[command(after_help = rectify::HELP)]
    Rectify(rectify::Rectify),
    /// Shows a calibration, or turns it into another program's format
    #[command(after_help = rig::HELP)]
    Rig(rig::RigCommand),
    /// Objects in pictures, by a cascade
    #[command(after_help = detect::HELP)]
    Detect(detect::Detect),
    /// Trains a cascade
    #[command(after_help = train::HELP)]
    Train(Box<train::Train>),
    /// Tables against ground truth: recorded data sets, and synthetic scenes
    #[command(after_help = evaluate::HELP)]
    Evaluate {
        /// What is evaluated.
        #[command(subcommand)]
        what: evaluate::Evaluate,
    },
    /// The board's qualification: rates, latencies, memory, processor time and faults survived, judged
    #[command(after_help = soak::HELP)]
    Soak(soak::Soak),
    /// Every error of a configuration with line and remedy; the effective configuration
    #[command(after_help = check_config::HELP)]
    CheckConfig(check_config::CheckConfig),
    /// Puts the board's clocks back as they were before a daemon that was killed had set them
    #[command(after_help = restore_clocks::HELP)]
    RestoreClocks(restore_clocks::RestoreClocks),
    /// Words of the command line for a shell
    #[command(after_help = completions::HELP)]
    Completions(completions::Completions),
    /// Manual pages; for packages
    #[command(hide = true)]
    Man(man::Man),
    /// A stage process; started by the scheduler
    #[command(hide = true)]
    Stage {
        /// Which.
        role: String,
    },
}

/// Runs a command.
///
/// # Errors
/// What the user should read.
pub fn run(cli: Cli) -> Result<(), CommandError> {
    let log = cli.log.as_deref();
    match cli.command {
        Command::Demo(args) => demo::run(&args, log),
        Command::Run(args) => run::run(&args, log),
        Command::Replay(args) => replay::run(&args, log),
        Command::Train(args) => train::run(&args, log),
        Command::Status(args) => status::run(&args, log),
        Command::View(args) => view::run(&args, log),
        Command::PointCloud(args) => point_cloud::run(&args, log),
        Command::Record(args) => record::run(&args, log),
        Command::Compare(args) => compare::run(&args),
        Command::Disparity(args) => disparity::run(&args, log),
        Command::Obstacles(args) => obstacles::run(&args, log),
        Command::Calibrate(args) => calibrate::run(&args, log),
        Command::Rectify(args) => rectify::run(&args),
        Command::Rig(args) => rig::run(&args),
        Command::Evaluate { what } => evaluate::run(what, log),
        Command::Detect(args) => detect::run(&args, log),
        Command::Soak(args) => soak::run(&args, log),
        Command::CheckConfig(args) => check_config::run(&args),
        Command::RestoreClocks(args) => restore_clocks::run(&args, log),
        Command::Completions(args) => completions::run(&args, Cli::command()),
        Command::Man(args) => man::run(&args, Cli::command()),
        Command::Stage { role } => stage::run(&role),
    }
}
