//! `lookout obstacles`.

use super::disparity::read_pair;
use super::{CommandError, load, say};
use crate::cli::Obstacles;
use crate::in_process::Pipeline;
use perception::rig::Rig;
use sources::{PairSource, SourceError, calibration_file};

/// One pair that is already in memory.
pub(super) struct OnePair {
    pub left: Vec<u8>,
    pub right: Vec<u8>,
    pub size: (usize, usize),
    pub rig: Rig,
}

impl PairSource for OnePair {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn rig(&self) -> Option<Rig> {
        Some(self.rig)
    }

    fn count(&self) -> Option<u64> {
        Some(1)
    }

    fn period_ns(&self) -> u64 {
        100_000_000
    }

    fn read(&mut self, _index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        left.copy_from_slice(&self.left);
        right.copy_from_slice(&self.right);
        Ok(())
    }
}

pub fn run(args: &Obstacles, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "obstacles", None)?;
    // One frame is all there is: what is seen in it counts.
    config.tracking.confirm_frames = 1;
    config.regions.confirm = false;
    config.alarm.confirm_frames = 1;
    config.recognition.looks_max = 64;
    let rig_path = args.rig.as_ref().unwrap_or(&config.source.rig);
    if rig_path.as_os_str().is_empty() {
        return Err(CommandError::Other(
            "distances need a rig: give --rig with a KITTI calib.txt or a TOML file with focal_px, \
             baseline_m, cx_px and cy_px"
                .into(),
        ));
    }
    let rig = calibration_file::read(rig_path, true)?;
    let (left, right, width, height) = read_pair(&args.left, &args.right)?;
    let source = OnePair { left, right, size: (width, height), rig };
    let mut pipeline = Pipeline::new(&config, Box::new(source), rig)
        .map_err(|error| CommandError::Other(format!("{}: {error}", args.left.display())))?;
    let result = pipeline.frame(0, 0)?;
    if let Some(path) = &args.overlay {
        tools::overlay::draw(result.images, &result.record).save(path)?;
    }
    let record = &result.record;
    if args.json {
        return say(serde_json::to_string_pretty(record)?);
    }
    match &record.road {
        Some(road) => say(format_args!(
            "road: camera {:.2} m above it, horizon in row {:.0}, seen in {:.0} % of its rows",
            road.camera_height_m,
            road.horizon_px,
            road.confidence * 100.0
        ))?,
        None => say("no road seen: no obstacles can be told from it")?,
    }
    say(format_args!(
        "{:<12} {:>16} {:>9} {:>15} {:>22}",
        "class", "distance", "lateral", "width x height", "box in px"
    ))?;
    for o in &record.obstacles {
        say(format_args!(
            "{:<12} {:>16} {:>7.1} m {:>15} {:>22}",
            o.class,
            format!("{:.2} ± {:.2} m", o.distance_m, o.distance_sigma_m),
            o.lateral_m,
            format!("{:.1} x {:.1} m", o.width_m, o.height_m),
            format!("{}x{} at {},{}", o.width_px, o.height_px, o.x_px, o.y_px)
        ))?;
    }
    say(format_args!("alarm: {}", record.alarm.text()))
}
