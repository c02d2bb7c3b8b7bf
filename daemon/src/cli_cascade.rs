//! The command line of cascades: training, detection and its evaluation.

use crate::cli::number;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

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

pub const RECOGNITION_HELP: &str = "Examples:
  lookout evaluate recognition lbp.xml models/vehicle.xml
  lookout evaluate recognition lbp.xml --scene drive --frames 50 --json

A scene goes through stereo and road; each cascade then searches each picture, in turns: the whole of it
and the crops of its regions, with windows of 30 to 90 px that grow by 1.3, and the crops with the
two sizes that each region's distance makes likely (recognition.window_m, recognition.growth).
Medians of the pictures' processor time. The paper's table beside it is of its own board.";

/// Running time of cascades.
#[derive(Args, Debug)]
pub struct EvaluateRecognition {
    /// Cascades
    #[arg(required = true, value_name = "CASCADE")]
    pub cascades: Vec<PathBuf>,
    #[command(flatten)]
    pub config: crate::cli::ConfigArgs,
    /// What is searched: a scene as in lookout replay scene:NAME
    #[arg(long, default_value = "street", value_name = "SCENE")]
    pub scene: String,
    /// Pictures
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub frames: u64,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Defaults are those of `tools::training::TrainParameters::usual`.
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
    /// Share of the judging objects that the last stage lets pass; the stages before are then set to refuse hardly
    /// any of those (--refused-early)
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    pub final_hit_rate: Option<f64>,
    /// Share of the judging patches without objects that the last stage takes for objects; the stages before are
    /// then set to refuse hardly any object that it would find
    #[arg(long, value_name = "SHARE", value_parser = rate, conflicts_with = "final_hit_rate")]
    pub final_false_alarm_rate: Option<f64>,
    /// With either: share of the objects that the last stage would find that the first may refuse, later ones less;
    /// more makes detection faster
    #[arg(long, default_value_t = 0.0, value_name = "SHARE", value_parser = rate)]
    pub refused_early: f64,
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
    #[arg(long = "least-leaf", value_name = "SHARE", value_parser = rate)]
    pub min_leaf: Option<f64>,
    /// A leaf's mean is drawn to 0 as by this many samples
    #[arg(long, value_name = "SAMPLES", value_parser = prior)]
    pub leaf_prior: Option<f64>,
    /// An LBP code's mean is drawn to its node's as by this many samples
    #[arg(long, value_name = "SAMPLES", value_parser = prior)]
    pub category_prior: Option<f64>,
    /// Cascades that are trained and joined to one, each with random numbers of its own: fewer mistakes, but as
    /// many times the work and the trees
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=50), conflicts_with = "unchained")]
    pub bags: u16,
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
    /// Prints what each measure of the trainer is worth, judged by the last 30 % of each folder, instead of
    /// writing a cascade
    #[arg(long, conflicts_with_all = ["restart", "report", "sweep"])]
    pub ablation: bool,
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
