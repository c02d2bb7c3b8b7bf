//! The command line: one file per subcommand, with its arguments, its help and its handler.

mod attach;
mod board;
mod bridge;
mod calibrate;
mod can;
mod check_config;
mod compare;
mod completions;
mod config_args;
mod console;
mod demo;
mod detect;
mod disparity;
mod doctor;
mod error;
mod evaluate;
mod fleet;
mod help_text;
mod init;
mod left_out;
mod low_priority;
mod man;
mod number;
mod obstacles;
mod odometry;
mod one_pair;
mod own_motion;
mod point_cloud;
mod progress_lines;
mod record;
mod rectify;
mod replay;
mod restore_clocks;
mod rig;
mod run;
mod scene;
mod soak;
mod stage;
mod status;
mod stream;
mod train;
mod usage;
mod video;
mod view;

pub use error::CommandError;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use perception::simd::Level;

/// Detects and tracks obstacles ahead of a vehicle with a stereo camera.
///
/// A driver assistance prototype, not a safety element: it controls nothing in the vehicle.
#[derive(Debug, Parser)]
#[command(
    name = "lookout",
    version,
    max_term_width = 100,
    after_help = "Examples:
  lookout demo                                    see it work, no hardware needed
  lookout replay RECORDING --out results          run the daemon on recorded pairs
  lookout disparity left.png right.png -o d.png   one pair, dense disparity
  lookout odometry RECORDING -o poses.txt         own motion: poses in KITTI's format
  lookout evaluate stereo KITTI                   disparity errors against ground truth
  lookout evaluate weather                        obstacle detection in sun, rain, night and snow
  lookout calibrate PICTURES --board 9x6 --square-mm 25 -o rig.toml
  lookout train --positives DIR --negatives DIR -o CASCADE.xml
  lookout status --watch                          status of the running daemon
  lookout view                                    the same in a browser, with pictures
  lookout stream | jq .alarm.level                results as lines of JSON
  lookout record -o drive.mcap                    record the running daemon

Environment:
  LOOKOUT_LEVEL=NAME    fastest instruction set to use, of plain, neon, dotprod, avx2 and avx512
                        [default: the fastest here]; results are the same

Exit code: 0 on success, 2 for incorrect usage, 1 for any other error."
)]
pub struct Cli {
    /// Log level: error, warn, info, debug, trace [default: log.level of the configuration; warn
    /// for demo and replay]
    #[arg(long, global = true, display_order = 1000, value_name = "LEVEL", value_parser = ["error", "warn", "info", "debug", "trace"], hide_possible_values = true)]
    pub log: Option<String>,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the whole daemon on a synthetic drive: live table, pictures, plots, summary
    #[command(after_help = demo::HELP)]
    Demo(demo::Demo),
    /// Run the daemon in the foreground, as systemd starts it
    #[command(after_help = run::HELP)]
    Run(run::Run),
    /// Run the daemon on recorded pairs, or on a synthetic scene
    #[command(after_help = replay::HELP)]
    Replay(replay::Replay),
    /// Show the status of a running daemon
    #[command(after_help = status::HELP)]
    Status(status::Status),
    /// Show a running daemon in a browser: pictures, bird's-eye view, metrics over time
    #[command(after_help = view::HELP)]
    View(view::View),
    /// Send a running daemon's results on a CAN bus: alarm, path, obstacles
    #[command(after_help = can::HELP)]
    Can(can::Can),
    /// Send a running daemon's results to a fleet or to ROS 2, over zenoh
    #[command(after_help = bridge::HELP)]
    Bridge(bridge::BridgeCommand),
    /// List the vehicles of a fleet that are connected: state, alarm, version
    #[command(after_help = fleet::HELP)]
    Fleet(fleet::Fleet),
    /// Print a running daemon's results as lines of JSON, or serve them on a Unix socket
    #[command(after_help = stream::HELP)]
    Stream(stream::Stream),
    /// Compute a point cloud from one pair
    #[command(after_help = point_cloud::HELP)]
    PointCloud(point_cloud::PointCloudCommand),
    /// Record a running daemon to MCAP, for replays, Foxglove and Lichtblick
    #[command(after_help = record::HELP)]
    Record(record::Record),
    /// Compare two runs of the same frames: which differ, and by how much
    #[command(after_help = compare::HELP)]
    Compare(compare::Compare),
    /// Compute the dense disparity map of one pair
    #[command(after_help = disparity::HELP)]
    Disparity(disparity::Disparity),
    /// Detect road and obstacles in one pair
    #[command(after_help = obstacles::HELP)]
    Obstacles(obstacles::Obstacles),
    /// Compute the own motion of a recording: poses in KITTI's format
    #[command(after_help = odometry::HELP)]
    Odometry(odometry::Odometry),
    /// Make a calibration board to print: chessboard, ChArUco or AprilGrid
    #[command(after_help = board::HELP)]
    Board(board::PrintBoard),
    /// Calibrate a stereo camera from pictures of a board, and grade the result
    #[command(override_usage = calibrate::USAGE, after_help = calibrate::HELP)]
    Calibrate(calibrate::Calibrate),
    /// Rectify one pair with a rig file
    #[command(after_help = rectify::HELP)]
    Rectify(rectify::Rectify),
    /// Show a calibration, or convert it to another program's format
    #[command(after_help = rig::HELP)]
    Rig(rig::RigCommand),
    /// Print a synthetic scene as a TOML file, to read or change it
    #[command(after_help = scene::HELP)]
    Scene(scene::SceneCommand),
    /// Detect objects in images with a cascade
    #[command(after_help = detect::HELP)]
    Detect(detect::Detect),
    /// Train a cascade
    #[command(after_help = train::HELP)]
    Train(Box<train::Train>),
    /// Evaluate against ground truth: recorded data sets, and synthetic scenes
    #[command(after_help = evaluate::HELP)]
    Evaluate {
        /// The evaluation.
        #[command(subcommand)]
        what: evaluate::Evaluate,
    },
    /// Qualify a board: a long run against budgets of rate, latency, memory, recovery
    #[command(after_help = soak::HELP)]
    Soak(soak::Soak),
    /// Check a configuration: all errors with line and remedy, or what is in effect
    #[command(after_help = check_config::HELP)]
    CheckConfig(check_config::CheckConfig),
    /// Write a commented configuration from options: cameras, board, rig
    #[command(after_help = init::HELP)]
    Init(init::Init),
    /// Check this machine: cores, cameras, GPU, sensors, limits, permissions, and what to do
    #[command(after_help = doctor::HELP)]
    Doctor(doctor::Doctor),
    /// Restore the board's clocks after a daemon that set them was killed
    #[command(after_help = restore_clocks::HELP)]
    RestoreClocks(restore_clocks::RestoreClocks),
    /// Generate a completion script for a shell
    #[command(after_help = completions::HELP)]
    Completions(completions::Completions),
    /// Generate manual pages
    #[command(after_help = man::HELP)]
    Man(man::Man),
    /// Run a stage process; started by the scheduler
    #[command(hide = true)]
    Stage {
        /// Name of the stage, or writer.
        role: String,
    },
}

/// Reads the command line. Errors of usage, and help, end the process.
pub fn parse() -> Cli {
    let matches = match help_text::reflowed(Cli::command()).try_get_matches() {
        Ok(matches) => matches,
        Err(error) => usage::end(error),
    };
    Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// Follows the environment variable of the instruction set.
fn limit_level() -> Result<(), CommandError> {
    const VARIABLE: &str = "LOOKOUT_LEVEL";
    let Some(name) = std::env::var_os(VARIABLE).filter(|name| !name.is_empty()) else { return Ok(()) };
    let name = name.to_string_lossy();
    let Some(level) = Level::named(&name) else {
        let here: Vec<_> = Level::available().into_iter().map(Level::name).collect();
        return Err(CommandError::Other(format!("{VARIABLE}={name}: this machine has {}", here.join(", "))));
    };
    level.limit();
    Ok(())
}

/// Runs a subcommand.
///
/// # Errors
/// With a text for the user.
pub fn run(cli: Cli) -> Result<(), CommandError> {
    limit_level()?;
    let log = cli.log.as_deref();
    match cli.command {
        Command::Demo(args) => demo::run(&args, log),
        Command::Run(args) => run::run(&args, log),
        Command::Replay(args) => replay::run(&args, log),
        Command::Train(args) => train::run(&args, log),
        Command::Status(args) => status::run(&args, log),
        Command::View(args) => view::run(&args, log),
        Command::Can(args) => can::run(&args, log),
        Command::Bridge(args) => bridge::run(&args, log),
        Command::Fleet(args) => fleet::run(&args, log),
        Command::Stream(args) => stream::run(&args, log),
        Command::PointCloud(args) => point_cloud::run(&args, log),
        Command::Record(args) => record::run(&args, log),
        Command::Compare(args) => compare::run(&args),
        Command::Disparity(args) => disparity::run(&args, log),
        Command::Obstacles(args) => obstacles::run(&args, log),
        Command::Odometry(args) => odometry::run(&args, log),
        Command::Board(args) => board::run(&args),
        Command::Calibrate(args) => calibrate::run(&args, log),
        Command::Rectify(args) => rectify::run(&args),
        Command::Rig(args) => rig::run(&args),
        Command::Evaluate { what } => evaluate::run(what, log),
        Command::Scene(args) => scene::run(&args),
        Command::Detect(args) => detect::run(&args, log),
        Command::Soak(args) => soak::run(&args, log),
        Command::CheckConfig(args) => check_config::run(&args),
        Command::Init(args) => init::run(&args),
        Command::Doctor(args) => doctor::run(&args, log),
        Command::RestoreClocks(args) => restore_clocks::run(&args, log),
        Command::Completions(args) => completions::run(&args, Cli::command()),
        Command::Man(args) => man::run(&args, Cli::command()),
        Command::Stage { role } => stage::run(&role),
    }
}
