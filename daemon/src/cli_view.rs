//! The command line of what looks at a running daemon, and of clouds of points.

use crate::cli::{ConfigArgs, number};
use clap::{Args, ValueEnum};
use std::net::SocketAddr;
use std::path::PathBuf;

/// Where the page is, unless asked otherwise.
const ADDRESS: &str = "127.0.0.1:8467";

pub const VIEW_HELP: &str = "Examples:
  lookout view                                  then open http://127.0.0.1:8467
  lookout view --instance front --bind 127.0.0.1:0
  lookout view --bind 0.0.0.0:8467              for a phone on the car's network: prints a link with a token
  curl http://127.0.0.1:8467/metrics            figures for Prometheus
  ssh -L 8467:127.0.0.1:8467 board              the page of a board, without opening it to the network

The page shows the left image with boxes, distances and the alarm, disparity, v-disparity with the
road, the bird's-eye view, and latency, rates, drops, CPU, temperatures, clocks and health over time.
The viewer waits for the daemon, outlives its restarts, and runs at the lowest priority: it takes the
newest frame and never holds a stage up. It must run as the daemon's user.

Whoever can reach the address sees the pictures: on an address of the machine itself (127.0.0.1, ::1)
that is every user of it, unless there is a token; on any other a token is always asked for. The
connection is not encrypted.";

pub const POINT_CLOUD_HELP: &str = "Examples:
  lookout point-cloud left.png right.png --rig calib.txt -o cloud.ply
  lookout point-cloud left.png right.png --rig rig.toml -o cloud.ply --color height
  lookout point-cloud left.png right.png --rig rig.toml -o sparse.ply --every 4 --distance-max 40

OUT.ply is binary little-endian: x, y, z in metres (x right, y down, z ahead of the left camera) and
red, green, blue. Points that few of their 24 neighbours in the picture agree with in depth are left
out: single errors, and the veil between a near object and what is behind it.";

#[derive(Args, Debug)]
pub struct View {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Address and port to serve at; port 0 takes a free one
    #[arg(long, default_value = ADDRESS, value_name = "ADDRESS:PORT")]
    pub bind: SocketAddr,
    /// Who knows it may look: 16 characters or more of letters, digits, - and _; @FILE reads it from a
    /// file, which other users of the machine cannot see in the list of processes [default: on an address
    /// other than the machine's own a new one is made and printed]
    #[arg(long, value_name = "TOKEN")]
    pub token: Option<String>,
}

#[derive(Args, Debug)]
pub struct PointCloudCommand {
    /// Left image (PNG, PGM, PPM; colour is turned to grey)
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    /// Binary PLY
    #[arg(short, long, value_name = "OUT.ply")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig TOML or KITTI calib.txt [default: source.rig]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// What the colour of a point tells
    #[arg(long, value_enum, default_value_t = PointColour::Grey)]
    pub color: PointColour,
    /// Points farther than this, in metres, are left out
    #[arg(long, default_value_t = 80.0, value_name = "M", value_parser = distance)]
    pub distance_max: f64,
    /// Every N-th column of every N-th row
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub every: u32,
    /// Neighbours of 24 that have to agree; 0 keeps every point
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=24))]
    pub neighbours: u32,
    /// Print figures as JSON
    #[arg(long)]
    pub json: bool,
}

/// What the colour of a point tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PointColour {
    /// The left image
    Grey,
    /// Height above the road, 0 to 3 m from blue to red; grey where no road was seen
    Height,
    /// Distance, from red (near) to blue
    Distance,
}

fn distance(text: &str) -> Result<f64, String> {
    number(text, 0.1, 10_000.0)
}
