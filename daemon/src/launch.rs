//! What a stage is told when it starts: one JSON document on its standard input.

use config::Config;
use perception::rig::Rig;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Everything that a stage needs to know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Launch {
    /// The effective configuration.
    pub config: Config,
    /// Core to pin to.
    pub core: Option<usize>,
    /// Process id of the scheduler: a stage ends with it.
    pub scheduler_pid: u32,
    /// The frames that will come.
    pub frames: FrameFormat,
    /// Whether pairs wait for credit.
    pub lockstep: bool,
    /// First pair that capture publishes.
    pub first_sequence: u64,
    /// One past the last pair; `None` = without end.
    pub end_sequence: Option<u64>,
    /// Time in the scene from one pair to the next, in nanoseconds.
    pub source_period_ns: u64,
    /// Where the writer writes.
    pub out: Option<PathBuf>,
    /// Where the writer records.
    pub record: Option<PathBuf>,
}

/// Size and geometry of all frames of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameFormat {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// See [`Rig`].
    pub focal_px: f64,
    /// See [`Rig`].
    pub baseline_m: f64,
    /// See [`Rig`].
    pub cx_px: f64,
    /// See [`Rig`].
    pub cy_px: f64,
}

impl FrameFormat {
    /// Frames of one size, seen by one rig.
    pub fn new((width, height): (usize, usize), rig: Rig) -> Self {
        let Rig { focal_px, baseline_m, cx_px, cy_px } = rig;
        Self { width, height, focal_px, baseline_m, cx_px, cy_px }
    }

    /// Whether a frame has the run's size.
    pub fn has_size(&self, header: &messages::header::Header) -> bool {
        (header.width as usize, header.height as usize) == (self.width, self.height)
    }

    /// The rig.
    pub fn rig(&self) -> Rig {
        let Self { focal_px, baseline_m, cx_px, cy_px, .. } = *self;
        Rig { focal_px, baseline_m, cx_px, cy_px }
    }
}
