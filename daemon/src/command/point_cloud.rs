//! `lookout point-cloud`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::{number, whole};
use crate::command::one_pair;
use clap::{Args, ValueEnum};
use perception::point_cloud::{self, Point, PointCloudParameters};
use perception::rig::Rig;
use perception::stereo::DisparityView;
use serde_json::json;
use std::path::PathBuf;
use tools::reporting::colour::rainbow;
use tools::reporting::picture::Colour;
use tools::reporting::ply;
use tools::reporting::record::{RoadLine, tidy};

pub const HELP: &str = "Examples:
  lookout point-cloud left.png right.png --rig calib.txt -o cloud.ply
  lookout point-cloud left.png right.png --rig rig.toml -o cloud.ply --color height
  lookout point-cloud left.png right.png --rig rig.toml -o sparse.ply --every 4 --distance-max 40

OUT.ply is binary little-endian: x, y, z in metres (x right, y down, z ahead of the left camera)
and red, green, blue. Outliers are removed: a point is kept if at least --neighbours of its 24
neighbours in the image have a similar depth. This drops single errors, and the points between a
near object and its background.";

#[derive(Args, Debug)]
pub struct PointCloudCommand {
    /// Left image (PNG, JPEG, TIFF, BMP, WebP, PGM, PPM; colour is converted to grey)
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    /// Point cloud, as binary PLY
    #[arg(short, long, value_name = "OUT.ply")]
    pub out: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig file (TOML), KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC [default: source.rig]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Meaning of a point's colour
    #[arg(long, value_enum, default_value_t = PointColour::Grey)]
    pub color: PointColour,
    /// Largest distance of a point, in metres
    #[arg(long, default_value_t = 80.0, value_name = "M", value_parser = distance)]
    pub distance_max: f64,
    /// Take every N-th column of every N-th row
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = whole::<u32>(1, 64))]
    pub every: u32,
    /// Neighbours, of 24, that must have a similar depth; 0 keeps every point
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = whole::<u32>(0, 24))]
    pub neighbours: u32,
    /// Print the counts of points as JSON
    #[arg(long)]
    pub json: bool,
}

/// Meaning of a point's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PointColour {
    /// The left image
    Grey,
    /// Height above the road, 0 to 3 m from blue to red; grey if no road was detected
    Height,
    /// Distance, from red (near) to blue
    Distance,
}

fn distance(text: &str) -> Result<f64, String> {
    number(text, 0.1, 10_000.0)
}

/// Range of heights that the colours cover, in metres.
const HEIGHT_SPAN_M: f64 = 3.0;

/// Distance at which the colour saturates at red, in metres.
const NEAREST_M: f64 = 2.0;

pub fn run(args: &PointCloudCommand, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "point-cloud", Some("warn"))?;
    let (mut pipeline, rig) = one_pair::pipeline(&config, args.rig.as_deref(), &args.left, &args.right)?;
    let result = pipeline.frame(0, 0)?;
    let images = result.images;
    let map = DisparityView::new(images.disparity, images.width, images.height)
        .ok_or_else(|| CommandError::Other(format!("{}: no disparity", args.left.display())))?;
    let parameters = PointCloudParameters {
        step: args.every as usize,
        max_distance_m: args.distance_max,
        min_neighbours: args.neighbours as usize,
        ..PointCloudParameters::default()
    };
    let mut points = Vec::new();
    let counts = point_cloud::fill(map, images.left, &rig, &parameters, &mut points);
    if points.is_empty() {
        return Err(CommandError::Other(format!(
            "{}: no points remain: {} pixels without disparity, {} beyond --distance-max {} m, {} outliers",
            args.left.display(),
            counts.unknown,
            counts.far,
            args.distance_max,
            counts.outliers
        )));
    }
    let road = result.record.road;
    let colour = |point: &Point| match args.color {
        PointColour::Grey => [point[3] as u8; 3],
        PointColour::Height => height_colour(point, road, &rig),
        PointColour::Distance => rainbow(((NEAREST_M / f64::from(point[2]).max(NEAREST_M)) as f32).sqrt()),
    };
    ply::save(&args.out, &points, colour).map_err(|e| CommandError::Other(e.to_string()))?;
    if args.json {
        return say(serde_json::to_string_pretty(&json!({
            "points": counts.points,
            "unknown": counts.unknown,
            "far": counts.far,
            "outliers": counts.outliers,
            "road_seen": road.is_some(),
            "camera_height_m": road.map(|r| tidy(r.camera_height_m)),
        }))?);
    }
    let no_road = match (args.color, road) {
        (PointColour::Height, None) => "; no road was detected: heights are unknown, points are grey",
        _ => "",
    };
    say(format_args!(
        "{}: {} points; removed: {} without disparity, {} farther than {} m, {} outliers{no_road}",
        args.out.display(),
        counts.points,
        counts.unknown,
        counts.far,
        args.distance_max,
        counts.outliers
    ))
}

/// Blue on the road, red at [`HEIGHT_SPAN_M`] above it; the grey level without a road.
fn height_colour(point: &Point, road: Option<RoadLine>, rig: &Rig) -> Colour {
    let Some(road) = road else { return [point[3] as u8; 3] };
    rainbow((height_m(point, road, rig) / HEIGHT_SPAN_M) as f32)
}

/// Height of a point above the road plane, in metres.
fn height_m(point: &Point, road: RoadLine, rig: &Rig) -> f64 {
    // The plane passes below the camera and through the horizon.
    let tilt = (road.horizon_px - rig.cy_px) / rig.focal_px;
    road.camera_height_m + tilt * f64::from(point[2]) - f64::from(point[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_above_the_road_wherever_the_horizon_is() {
        let rig = Rig { focal_px: 500.0, baseline_m: 0.2, cx_px: 320.0, cy_px: 240.0 };
        let road = RoadLine { camera_height_m: 1.5, horizon_px: 230.0, confidence: 1.0 };
        // A point of the road at 20 m: 20 px above the principal point's row would be its horizon.
        let on_road = [0.0, 1.5 - 10.0 / 500.0 * 20.0, 20.0, 0.0];
        assert!(height_m(&on_road, road, &rig).abs() < 1e-6);
        assert_eq!(height_colour(&on_road, Some(road), &rig), rainbow(0.0));
        let above = [0.0, on_road[1] - 3.0, 20.0, 0.0];
        assert_eq!(height_colour(&above, Some(road), &rig), rainbow(1.0));
        assert_eq!(height_colour(&[0.0, 0.0, 5.0, 88.0], None, &rig), [88; 3]);
    }
}
