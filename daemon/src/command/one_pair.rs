//! Runs the stages in this process on a single pair of image files.

use crate::command::disparity::read_pair_as;
use crate::command::error::CommandError;
use crate::in_process::Pipeline;
use crate::input;
use crate::scheduler::RunError;
use config::Config;
use perception::rig::Rig;
use sources::{PairSource, SourceError};
use std::path::Path;

/// A source with one pair, which is already in memory.
struct OnePair {
    left: Vec<u8>,
    right: Vec<u8>,
    size: (usize, usize),
    rig: Rig,
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

/// A pipeline for one pair, and its rig: that of `--rig`, otherwise of the configuration.
///
/// # Errors
/// If there is no rig, a file cannot be read, or the images cannot be matched.
pub(super) fn pipeline(
    config: &Config,
    rig: Option<&Path>,
    left: &Path,
    right: &Path,
) -> Result<(Pipeline, Rig), CommandError> {
    let rig_path = rig.unwrap_or(&config.source.rig);
    if rig_path.as_os_str().is_empty() {
        return Err(CommandError::Other(
            "distances need a rig: give --rig with a rig file of lookout calibrate, a KITTI calib.txt, or a TOML file with \
             focal_px, baseline_m, cx_px and cy_px"
                .into(),
        ));
    }
    let (left_pixels, right_pixels, width, height) =
        read_pair_as(left, right, input::interpretation(config))?;
    let mut config = config.clone();
    config.source.rig = rig_path.to_owned();
    let rig = input::named_rig(rig_path, true, (width, height)).map_err(RunError::from)?;
    let source = OnePair { left: left_pixels, right: right_pixels, size: (width, height), rig };
    let source = input::rectified(&config, Box::new(source)).map_err(RunError::from)?;
    let pipeline = Pipeline::new(&config, source, rig)
        .map_err(|error| CommandError::Other(format!("{}: {error}", left.display())))?;
    Ok((pipeline, rig))
}
