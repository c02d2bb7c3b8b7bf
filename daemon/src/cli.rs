//! The command line. Its words are stable.

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

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
  lookout status --watch                          what the running daemon is doing

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
    #[command(after_help = "Examples:
  lookout demo
  lookout demo --seconds 30 --out /tmp/demo")]
    Demo(Demo),
    /// The daemon in the foreground: what systemd starts
    #[command(after_help = "Examples:
  lookout run -c /etc/lookout/car.toml
  lookout run -c tk1

Stop it with SIGTERM or Ctrl-C: frames in flight come out first.")]
    Run(Run),
    /// The daemon on recorded pairs
    #[command(after_help = "Examples:
  lookout replay ../shared/data/kitti_sequence_1 --lockstep --out results
  lookout replay RECORDING --fps 12.5 --loop --limit 1000
  lookout replay RECORDING --in-process --out reference

PATH holds two folders with images of the same names: image_2 and image_3, image_0 and image_1,
image_l and image_r, left and right, image_02/data and image_03/data, or image_00/data and
image_01/data. The calibration is taken from rig.toml, calib.txt or calib/NAME.txt beside them.

--out writes overlay/NNNNNN.png, disparity/NNNNNN.png (16 bit, disparity x 256), obstacles.jsonl
(a line per frame) and summary.json.")]
    Replay(Replay),
    /// What a running daemon is doing
    #[command(after_help = "Examples:
  lookout status
  lookout status --watch
  lookout status --json")]
    Status(Status),
    /// Dense disparity of one pair
    #[command(after_help = "Examples:
  lookout disparity left.png right.png -o disparity.png
  lookout disparity left.png right.png -o d.png --max-disparity 64 --color d-color.png
  lookout disparity left.png right.png -o d.png --repeat 10 --json")]
    Disparity(Disparity),
    /// One pair through road and recognition
    #[command(after_help = "Examples:
  lookout obstacles left.png right.png --rig calib.txt --overlay found.png
  lookout obstacles left.png right.png --rig rig.toml --json

A rig is a KITTI calib.txt, or a TOML file with focal_px, baseline_m, cx_px and cy_px.")]
    Obstacles(Obstacles),
    /// Every error of a configuration with line and remedy; the effective configuration
    #[command(after_help = "Examples:
  lookout check-config car.toml
  lookout check-config rpi5
  lookout check-config --reference > docs/configuration.md")]
    CheckConfig(CheckConfig),
    /// A stage process; started by the scheduler
    #[command(hide = true)]
    Stage {
        /// Which.
        role: String,
    },
}

/// Which configuration.
#[derive(Args, Debug, Clone)]
pub struct ConfigArgs {
    /// Configuration file, or one of the profiles replay, tk1, orin-nano, rpi5
    #[arg(short, long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Name of this daemon among those on the machine [default: instance.name]
    #[arg(long, value_name = "NAME")]
    pub instance: Option<String>,
}

#[derive(Args, Debug)]
pub struct Demo {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Seconds to drive
    #[arg(long, default_value_t = 10.0, value_name = "N", value_parser = seconds)]
    pub seconds: f64,
    /// Folder for pictures, plots and the summary
    #[arg(long, default_value = "out/demo", value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Args, Debug)]
pub struct Run {
    #[command(flatten)]
    pub config: ConfigArgs,
}

#[derive(Args, Debug)]
pub struct Replay {
    /// Folder of the recording
    pub path: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Pairs per second [default: the recording's own rate]
    #[arg(long, value_name = "N", value_parser = fps, conflicts_with = "lockstep")]
    pub fps: Option<f64>,
    /// Every frame, one at a time: the same result every time
    #[arg(long)]
    pub lockstep: bool,
    /// Start again at the end
    #[arg(long = "loop", requires = "limit")]
    pub repeat: bool,
    /// Stop after this many pairs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub limit: Option<u64>,
    /// Rig TOML or KITTI calib.txt [default: the calibration beside the recording]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Folder for overlays, disparity maps, obstacles.jsonl and summary.json
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The same algorithms in this process, without shared memory
    #[arg(long, conflicts_with_all = ["fps", "lockstep", "instance"])]
    pub in_process: bool,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Status {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Print again every second until Ctrl-C, or until the daemon ends
    #[arg(long)]
    pub watch: bool,
    /// Print as JSON, one document (with --watch: one a line)
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Disparity {
    /// Left image (PNG, PGM, PPM; colour is turned to grey)
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    /// 16-bit PNG, disparity x 256, 0 = unknown
    #[arg(short, long, value_name = "OUT.png")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Disparities searched, in px [default: stereo.disparities]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=255))]
    pub max_disparity: Option<u16>,
    /// Matcher: full = full-range Multi-Path-Viterbi
    #[arg(long, default_value = "full", value_parser = ["full"])]
    pub method: String,
    /// Times the matcher alone this often
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Also writes the map in colour
    #[arg(long, value_name = "FILE")]
    pub color: Option<PathBuf>,
    /// Print figures as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Obstacles {
    /// Left image
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig TOML or KITTI calib.txt [default: source.rig]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Writes the left image with what was found
    #[arg(long, value_name = "FILE")]
    pub overlay: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct CheckConfig {
    /// Configuration file or profile
    #[arg(required_unless_present = "reference")]
    pub file: Option<PathBuf>,
    /// Print the reference of all keys instead
    #[arg(long, conflicts_with = "file")]
    pub reference: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.5, 86_400.0)
}

fn fps(text: &str) -> Result<f64, String> {
    number(text, 0.01, 1000.0)
}

fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("give a number from {low} to {high}")),
    }
}
