//! The launch document: the JSON that a stage reads from its standard input when it starts.

use config::Config;
use perception::rig::Rig;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The launch document of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Launch {
    /// The effective configuration.
    pub config: Config,
    /// Core to pin to; `None` = not pinned.
    pub core: Option<usize>,
    /// Process id of the scheduler. A stage exits when the scheduler does.
    pub scheduler_pid: u32,
    /// Size and geometry of the frames.
    pub frames: FrameFormat,
    /// Whether the run is in lock-step.
    pub lockstep: bool,
    /// First pair that capture publishes.
    pub first_sequence: u64,
    /// One past the last pair; `None` = without end.
    pub end_sequence: Option<u64>,
    /// Source time from one pair to the next, in nanoseconds.
    pub source_period_ns: u64,
    /// Folder of the writer's results.
    pub out: Option<PathBuf>,
    /// File of the writer's recording.
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
    /// Frames of `width` × `height` pixels of a rig.
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
