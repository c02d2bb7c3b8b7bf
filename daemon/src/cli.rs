//! The command line. Its words are stable.

use crate::rooms::matcher::Method;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use tools::evaluate::disturb::Disturbance;

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
  lookout train --positives DIR --negatives DIR -o CASCADE.xml
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
  lookout disparity left.png right.png -o d.png --method full
  lookout disparity left.png right.png -o d.png --budget-ms 5
  lookout disparity left.png right.png -o d.png --repeat 10 --json")]
    Disparity(Disparity),
    /// One pair through road and recognition
    #[command(after_help = "Examples:
  lookout obstacles left.png right.png --rig calib.txt --overlay found.png
  lookout obstacles left.png right.png --rig rig.toml --json

A rig is a KITTI calib.txt, or a TOML file with focal_px, baseline_m, cx_px and cy_px.")]
    Obstacles(Obstacles),
    /// Objects in pictures, by a cascade
    #[command(after_help = "Examples:
  lookout detect haarcascade_frontalface_default.xml people.jpg
  lookout detect vehicle.xml road.png --growth 1.3 --min-px 30 --max-px 90 --json
  lookout detect cascade.xml a.png b.png --neighbours 0     every window that passes
  lookout detect vehicle.xml road.png --overlay found.png

CASCADE is an OpenCV cascade XML, boosted LBP or Haar, of the current or the older format. The
boxes are those of OpenCV's detectMultiScale with the same image and options; so are the defaults.")]
    Detect(Detect),
    /// Trains a cascade
    #[command(after_help = "Examples:
  lookout train --positives vehicles --negatives others -o vehicle.xml
  lookout train --positives vehicles --negatives others -o v.xml --report out/training --threads 4
  lookout train --positives vehicles --negatives others -o v.xml --features haar --window 24x20
  lookout train --positives vehicles --negatives others -o v.xml --sweep

Each picture of --positives holds one object that fills it; those of --negatives hold none and may
have any size from the window's on: windows are cut out of them. Of every folder below, the last
part judges and is not learned from (--validation): keep pictures of one drive in one folder, in
order. The same pictures and options give the same cascade, on any number of threads.

A run that is stopped goes on where it was when it is started again; its stages are kept in
CASCADE.part. The cascade is OpenCV's XML.")]
    Train(Box<Train>),
    /// Tables against ground truth
    #[command(after_help = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI MIDDLEBURY --out results --json
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate stereo --help")]
    Evaluate {
        /// What is evaluated.
        #[command(subcommand)]
        what: Evaluate,
    },
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
    /// Sets one key of the configuration, as in stereo.lambda_vertical=8; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
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
    /// How many disparities are searched, from 0 px on [default: stereo.disparities]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=255))]
    pub max_disparity: Option<u16>,
    /// Milliseconds after which the finest scale reached is given [default: stereo.budget_ms]
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    pub budget_ms: Option<f64>,
    /// Matcher [default: stereo.method]
    #[arg(long, value_enum)]
    pub method: Option<Method>,
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

#[derive(Debug, Subcommand)]
pub enum Evaluate {
    /// Disparity maps, scored as the KITTI devkit does
    #[command(after_help = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI --pairs odd        choose parameters on these, report --pairs even
  lookout evaluate stereo KITTI --out results      error pictures, maps, plots
  lookout evaluate stereo KITTI --maps results     score maps instead of matching
  lookout evaluate stereo KITTI --disturb noise --save-pairs noisy

DIR and what lies below it is searched for KITTI 2012 (image_0, image_1, disp_noc, disp_occ),
KITTI 2015 (image_2, image_3, disp_noc_0, disp_occ_0), KITTI depth (left, right, gt_depth_map,
calib) and Middlebury scenes (a folder each, such as im0.png, im1.png, disp0GT.pfm).

A line for each image and region: all pixels with truth, and noc, those that the right camera sees
too. In percent: dens, pixels with an estimate; bad1, bad2, bad3, errors above 1, 2, 3 px; D1,
above 3 px and 5 % of the truth; all of them and epe, the mean error in px, after holes are filled
with the background of their row as KITTI does; hole3, a hole counts as wrong; val3, holes are
left out. ms is processor time. mean is that of the images' figures.

--out writes SET/errors/PAIR.png (blue is right, yellow to red is wrong by the rule of D1, occluded
pixels darker), SET/disparity/PAIR.png (16 bit, disparity x 256), SET/colour/PAIR.png, subpixel.png,
roc.png and evaluation.json. --save-pairs writes image_2, image_3, disp_noc_0 and disp_occ_0; with
several sets, below a folder for each.")]
    Stereo(EvaluateStereo),
    /// A cascade on patches with and without objects
    #[command(after_help = "Examples:
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others --roc roc.png --json

Every picture in and below the folders is brought to the size of the cascade's window, each pixel
the mean of what it covers, and classified. Use pictures that the cascade was not trained on. The
ROC is that of moving all stages' thresholds together.")]
    Detection(EvaluateDetection),
}

#[derive(Args, Debug)]
pub struct EvaluateDetection {
    /// Cascade
    pub cascade: PathBuf,
    /// Pictures of one object each
    #[arg(long, value_name = "DIR")]
    pub positives: PathBuf,
    /// Pictures without objects
    #[arg(long, value_name = "DIR")]
    pub negatives: PathBuf,
    /// Threads
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: u16,
    /// Writes the ROC as a plot
    #[arg(long, value_name = "FILE.png")]
    pub roc: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Defaults are those of `tools::train::TrainParameters::usual`.
#[derive(Args, Debug)]
pub struct Train {
    /// Pictures of one object each
    #[arg(long, value_name = "DIR")]
    pub positives: PathBuf,
    /// Pictures without objects; may be repeated
    #[arg(long, value_name = "DIR", required = true)]
    pub negatives: Vec<PathBuf>,
    /// Where the cascade is written
    #[arg(short, long, value_name = "CASCADE.xml")]
    pub out: PathBuf,
    /// What trees look at
    #[arg(long, value_enum, default_value_t = FeatureChoice::Lbp)]
    pub features: FeatureChoice,
    /// Stages, at most
    #[arg(long, default_value_t = 17, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=100))]
    pub stages: u16,
    /// Decisions from the root of a tree to a leaf, at most
    #[arg(long, default_value_t = 2, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=6))]
    pub max_depth: u32,
    /// Window, in pixels
    #[arg(long, default_value = "24x24", value_name = "WxH", value_parser = window)]
    pub window: (u16, u16),
    /// Share of the objects that each stage lets pass
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub hit_rate: Option<f64>,
    /// A stage is done when no more than this share of the rest passes
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub false_alarm_rate: Option<f64>,
    /// Or when it has this many trees of its own
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=5000))]
    pub max_trees: Option<u16>,
    /// Share of the judging objects that the whole cascade lets pass, all thresholds moved together
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub final_hit_rate: Option<f64>,
    /// Share of each folder, its last pictures, that judges stages instead of being learned from;
    /// 0 judges by what was learned
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub validation: Option<f64>,
    /// Varied windows made of each object, besides the object as it is
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub variants: Option<u16>,
    /// How much objects are varied: 0 not at all, 1 as usual, 2 twice as much
    #[arg(long, default_value_t = 1.0, value_name = "F", value_parser = strength)]
    pub variation: f64,
    /// Windows without objects that each stage learns from
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=1_000_000))]
    pub negative_windows: Option<u32>,
    /// Features that a stage chooses from, drawn anew for each
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub pool: Option<u32>,
    /// How much of a tree's values is added
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub learning_rate: Option<f64>,
    /// Least share of the weight in a leaf
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub least_leaf: Option<f64>,
    /// A leaf's mean is drawn to 0 as by this many samples
    #[arg(long, value_name = "SAMPLES", value_parser = prior)]
    pub leaf_prior: Option<f64>,
    /// An LBP code's mean is drawn to its node's as by this many samples
    #[arg(long, value_name = "SAMPLES", value_parser = prior)]
    pub category_prior: Option<f64>,
    /// Each stage begins from nothing instead of with the trees of the one before
    #[arg(long)]
    pub unchained: bool,
    /// Random numbers come from this
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub seed: u64,
    /// Threads [default: those of the machine]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: Option<u16>,
    /// Folder for figures and plots: stages, ROC, features on the mean object
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Forgets the stages of a run that was stopped
    #[arg(long)]
    pub restart: bool,
    /// Prints the paper's tables, stages x depth and growth x window, instead of writing a cascade
    #[arg(long, conflicts_with_all = ["restart", "report"])]
    pub sweep: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Which features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FeatureChoice {
    /// Multi-block local binary patterns: fast
    Lbp,
    /// Upright Haar features
    Haar,
    /// Haar features, tilted ones too
    HaarTilted,
}

#[derive(Args, Debug)]
pub struct EvaluateStereo {
    /// Data sets with ground truth
    #[arg(required = true, value_name = "DIR")]
    pub sets: Vec<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Matcher [default: stereo.method]
    #[arg(long, value_enum, conflicts_with = "maps")]
    pub method: Option<Method>,
    /// Disparities searched, in px
    #[arg(long, default_value_t = 128, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=255), conflicts_with = "maps")]
    pub max_disparity: u16,
    /// Which pairs of each set, by their position in the table, from 1
    #[arg(long, value_enum, default_value_t = PairChoice::All)]
    pub pairs: PairChoice,
    /// Scores maps of this folder instead of matching: SET/PAIR.png, SET/disparity/PAIR.png or
    /// PAIR.png, 16 bit, disparity x 256, 0 = unknown; pairs without one are left out
    #[arg(long, value_name = "DIR")]
    pub maps: Option<PathBuf>,
    /// Disturbs the right image: values x 0.7, gamma of 0.6, noise of 5 grey levels, Gaussian blur of
    /// 1 px, or half a row upwards
    #[arg(long, value_name = "WHAT", conflicts_with = "maps",
        value_parser = PossibleValuesParser::new(Disturbance::NAMES).try_map(|name| name.parse::<Disturbance>()))]
    pub disturb: Option<Disturbance>,
    /// Writes the grey pairs, as they are matched, and their truth in the layout of KITTI 2015
    #[arg(long, value_name = "DIR")]
    pub save_pairs: Option<PathBuf>,
    /// Folder for error pictures, maps and plots
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Matches each pair this often; ms is the median
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000), conflicts_with = "maps")]
    pub repeat: u32,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Detect {
    /// Cascade
    pub cascade: PathBuf,
    /// Images (PNG, JPEG, PGM, PPM; colour is turned to grey)
    #[arg(required = true, value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// Factor from one window size to the next
    #[arg(long, default_value_t = 1.1, value_name = "F", value_parser = growth)]
    pub growth: f64,
    /// Least side of a window, in pixels; 0 for no limit
    #[arg(long, default_value_t = 0, value_name = "PX")]
    pub min_px: u32,
    /// Greatest side of a window, in pixels; 0 for no limit
    #[arg(long, default_value_t = 0, value_name = "PX")]
    pub max_px: u32,
    /// A find needs more overlapping hits than this, as OpenCV's minNeighbors; 0 gives every hit
    #[arg(long, default_value_t = 3, value_name = "N")]
    pub neighbours: u32,
    /// Times the detector alone this often on each image
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Writes the image with the boxes; for one image
    #[arg(long, value_name = "FILE")]
    pub overlay: Option<PathBuf>,
    /// Print as JSON: a list of image, x, y, width, height, score
    #[arg(long)]
    pub json: bool,
}

/// Pairs of a set by position: parameters are chosen on one half, figures reported of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PairChoice {
    /// Every pair
    All,
    /// The first, third, …
    Odd,
    /// The second, fourth, …
    Even,
}

impl PairChoice {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Odd => "odd",
            Self::Even => "even",
        }
    }
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

fn milliseconds(text: &str) -> Result<f64, String> {
    number(text, 0.0, 10_000.0)
}

fn fps(text: &str) -> Result<f64, String> {
    number(text, 0.01, 1000.0)
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1.0)
}

fn strength(text: &str) -> Result<f64, String> {
    number(text, 0.0, 4.0)
}

fn prior(text: &str) -> Result<f64, String> {
    number(text, 0.0, 1e6)
}

fn window(text: &str) -> Result<(u16, u16), String> {
    let sides =
        text.split_once('x').and_then(|(w, h)| Some((w.parse::<u16>().ok()?, h.parse::<u16>().ok()?)));
    match sides {
        Some((w, h)) if (8..=64).contains(&w) && (8..=64).contains(&h) => Ok((w, h)),
        _ => Err("give WIDTHxHEIGHT, each from 8 to 64, as in 24x24".into()),
    }
}

fn growth(text: &str) -> Result<f64, String> {
    number(text, 1.01, 100.0)
}

fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("give a number from {low} to {high}")),
    }
}
