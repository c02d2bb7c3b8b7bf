//! `lookout obstacles`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::one_pair;
use clap::Args;
use perception::detection::SINGLE_PICTURE_EVIDENCE;
use perception::tracking::existence::Existence;
use std::path::PathBuf;
use tools::reporting::picture::check_ending;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout obstacles left.png right.png --rig calib.txt --overlay found.png
  lookout obstacles left.png right.png --rig rig.toml --json

The rig is what lookout calibrate writes, another TOML file with focal_px, baseline_m, cx_px and cy_px,
a KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC.

track: the number in the sentence of the alarm and in --json. lateral: of its middle, in metres to the
right of the left camera. unconfirmed: one pair tells too little of it; it raises no alarm.";

#[derive(Args, Debug)]
pub struct Obstacles {
    /// Left image
    pub left: PathBuf,
    /// Right image, rectified like the left
    pub right: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Rig file (TOML), KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC [default: source.rig]
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Write the left image with road and obstacles drawn
    #[arg(long, value_name = "FILE")]
    pub overlay: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &Obstacles, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "obstacles", None)?;
    args.overlay.as_deref().map(|path| check_ending(path, false)).transpose()?;
    // There is only one frame, so nothing can be confirmed over time.
    config.tracking.confirm_probability = Existence::new(SINGLE_PICTURE_EVIDENCE).probability();
    config.alarm.confirm_frames = 1;
    config.recognition.looks_max = 64;
    let (mut pipeline, _) = one_pair::pipeline(&config, args.rig.as_deref(), &args.left, &args.right)?;
    let result = pipeline.frame(0, 0)?;
    if let Some(path) = &args.overlay {
        tools::reporting::overlay::draw(result.images, &result.record).save(path)?;
    }
    let record = &result.record;
    if args.json {
        return say(serde_json::to_string_pretty(record)?);
    }
    match &record.road {
        Some(road) => say(format_args!(
            "road: camera height {:.2} m, horizon in row {:.0}, detected in {:.0} % of its rows",
            road.camera_height_m,
            road.horizon_px,
            road.confidence * 100.0
        ))?,
        None => say("no road detected: obstacles cannot be separated from it")?,
    }
    say(format_args!(
        "{:>5}  {:<12} {:>16} {:>9} {:>15} {:>22}",
        "track", "class", "distance", "lateral", "width x height", "box in px"
    ))?;
    for o in &record.obstacles {
        say(format_args!(
            "{:>5}  {:<12} {:>16} {:>7.1} m {:>15} {:>22}{}",
            o.track,
            o.class,
            format!("{:.2} ± {:.2} m", o.distance_m, o.distance_sigma_m),
            o.lateral_m,
            format!("{:.1} x {:.1} m", o.width_m, o.height_m),
            format!("{}x{} at {},{}", o.width_px, o.height_px, o.x_px, o.y_px),
            if o.confirmed { "" } else { "  unconfirmed" }
        ))?;
    }
    say(record.alarm.text())
}
