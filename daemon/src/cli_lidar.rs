//! The words of `lookout evaluate lidar`.

use crate::cli::ConfigArgs;
use clap::Args;
use std::path::PathBuf;

pub const HELP: &str = "Examples:
  lookout evaluate lidar ../shared/data/kitti_depth ../shared/data/kitti_cars
  lookout evaluate lidar CARS --out results
  lookout evaluate lidar PAIRS --repeat 5

DIR has folders left, calib and gt_depth_map or gt_depth (16-bit PNG, metres x 256), and right or labels
or both; the files of a picture have one name. Without a right picture the disparity is made from the
depth map: what is judged then is the road and the regions, not the matcher.

A line for each picture: the camera's height above the road that was seen, regions within 40 m, and
median and 90 % of their distance error against LiDAR. A line for each label: LiDAR distance of its
near side, the region that overlaps its box most, and that region's distance. A car is due within 40 m,
half of it in the picture and at most partly hidden; it is covered by an overlap of 0.4 (shared area
divided by joint area). What is not due stands in brackets.

A picture has no history, so regions.confirm is off; --repeat shows each picture N times in a row with
regions.confirm as it is configured.

--out writes SET/PICTURE.png (the road green, regions red, labels blue) and evaluation.json.";

#[derive(Args, Debug)]
pub struct EvaluateLidar {
    /// Folders with left pictures and LiDAR depth
    #[arg(required = true, value_name = "DIR")]
    pub sets: Vec<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Looks at each picture this often, one after the other
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub repeat: u64,
    /// Folder for pictures and the tables
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
