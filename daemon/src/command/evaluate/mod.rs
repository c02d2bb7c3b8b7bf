//! `lookout evaluate`: tables against ground truth.

mod detection;
mod distance;
mod lidar;
mod recognition;
mod scene_run;
mod stereo;
mod weather;

use crate::command::error::CommandError;
use clap::Subcommand;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI MIDDLEBURY --out results --json
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate weather                       synthetic scenes, six weathers
  lookout evaluate distance                      approaches, and scenes without danger
  lookout evaluate lidar DIR                     real pictures with LiDAR depth and labels
  lookout evaluate stereo --help";

#[derive(Debug, Subcommand)]
pub enum Evaluate {
    /// Disparity maps, scored as the KITTI devkit does
    #[command(after_help = stereo::HELP)]
    Stereo(stereo::EvaluateStereo),
    /// Obstacles, distances and the road in synthetic scenes, by weather
    #[command(after_help = weather::HELP)]
    Weather(weather::EvaluateWeather),
    /// Approaches to single obstacles, and scenes that must stay silent
    #[command(after_help = distance::HELP)]
    Distance(distance::EvaluateDistance),
    /// Road, regions and labelled cars of real pictures, against LiDAR depth
    #[command(after_help = lidar::HELP)]
    Lidar(lidar::EvaluateLidar),
    /// A cascade on patches with and without objects
    #[command(after_help = detection::HELP)]
    Detection(detection::EvaluateDetection),
    /// Running time of cascades: whole pictures and regions, beside the paper's
    #[command(after_help = recognition::HELP)]
    Recognition(recognition::EvaluateRecognition),
}

/// Runs an evaluation.
///
/// # Errors
/// What the user should read.
pub fn run(what: Evaluate, log: Option<&str>) -> Result<(), CommandError> {
    match what {
        Evaluate::Stereo(args) => stereo::run(&args, log),
        Evaluate::Weather(args) => weather::run(&args, log),
        Evaluate::Distance(args) => distance::run(&args, log),
        Evaluate::Lidar(args) => lidar::run(&args, log),
        Evaluate::Detection(args) => detection::run(&args, log),
        Evaluate::Recognition(args) => recognition::run(&args, log),
    }
}
