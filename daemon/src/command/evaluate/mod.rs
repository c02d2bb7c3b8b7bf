//! `lookout evaluate`: tables against ground truth.

mod classes;
mod detection;
mod distance;
mod drive;
mod in_parallel;
mod lidar;
mod ncap;
mod ncap_run;
mod odometry;
mod recognition;
mod scene_run;
mod seed_range;
mod stereo;
mod time;
mod true_path;
mod weather;

use crate::command::error::CommandError;
use clap::Subcommand;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout evaluate stereo ../shared/data/kitti2015
  lookout evaluate stereo KITTI MIDDLEBURY --out results --json
  lookout evaluate detection vehicle.xml --positives vehicles --negatives others
  lookout evaluate weather                       synthetic scenes in six weather conditions
  lookout evaluate distance                      approaches, and scenes without an alarm
  lookout evaluate time                          gaps, jumps and repeats in the source's time
  lookout evaluate odometry DIR --poses FILE     own motion against true poses
  lookout evaluate drive DIR                     your own drive, judged by the way that was driven
  lookout evaluate ncap                          the standard tests: warnings in time, near misses
  lookout evaluate lidar DIR                     recorded images with LiDAR depth and labels
  lookout evaluate stereo --help";

#[derive(Debug, Subcommand)]
pub enum Evaluate {
    /// Evaluate disparity maps, scored as by the KITTI devkit
    #[command(after_help = stereo::HELP)]
    Stereo(stereo::EvaluateStereo),
    /// Evaluate obstacles, distances and the road in synthetic scenes, by weather
    #[command(after_help = weather::HELP)]
    Weather(weather::EvaluateWeather),
    /// Evaluate approaches to single obstacles, and scenes without anything to alarm about
    #[command(after_help = distance::HELP)]
    Distance(distance::EvaluateDistance),
    /// Evaluate alarms under gaps, jumps and repeats in the source's time
    #[command(after_help = time::HELP)]
    Time(time::EvaluateTime),
    /// Evaluate road, regions and labelled cars in recorded images, against LiDAR depth
    #[command(after_help = lidar::HELP)]
    Lidar(lidar::EvaluateLidar),
    /// Evaluate own motion against true poses: drift, speed, yaw rate, the path ahead
    #[command(after_help = odometry::HELP)]
    Odometry(odometry::EvaluateOdometry),
    /// Evaluate drives without labels, by the strip that the vehicle then drove through
    #[command(after_help = drive::HELP)]
    Drive(drive::EvaluateDrive),
    /// Evaluate warnings and alarms by the standard tests of forward-collision systems, and near misses
    #[command(after_help = ncap::HELP)]
    Ncap(ncap::EvaluateNcap),
    /// Evaluate a cascade on pictures with and without objects
    #[command(after_help = detection::HELP)]
    Detection(detection::EvaluateDetection),
    /// Evaluate the classes of obstacles in synthetic scenes, and calibrate the detectors' scores
    #[command(after_help = classes::HELP)]
    Classes(classes::EvaluateClasses),
    /// Measure the running time of cascades on whole images and on regions, beside the paper's
    #[command(after_help = recognition::HELP)]
    Recognition(recognition::EvaluateRecognition),
}

/// Runs an evaluation.
///
/// # Errors
/// With a text for the user.
pub fn run(what: Evaluate, log: Option<&str>) -> Result<(), CommandError> {
    match what {
        Evaluate::Stereo(args) => stereo::run(&args, log),
        Evaluate::Weather(args) => weather::run(&args, log),
        Evaluate::Distance(args) => distance::run(&args, log),
        Evaluate::Time(args) => time::run(&args, log),
        Evaluate::Lidar(args) => lidar::run(&args, log),
        Evaluate::Odometry(args) => odometry::run(&args, log),
        Evaluate::Drive(args) => drive::run(&args, log),
        Evaluate::Ncap(args) => ncap::run(&args, log),
        Evaluate::Detection(args) => detection::run(&args, log),
        Evaluate::Classes(args) => classes::run(&args, log),
        Evaluate::Recognition(args) => recognition::run(&args, log),
    }
}
