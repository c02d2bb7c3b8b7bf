//! The launch document: the TOML that a stage reads from its standard input when it starts.

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
    /// Cores of its further threads; empty if they are not pinned.
    pub helper_cores: Vec<usize>,
    /// Process id of the scheduler. A stage exits when the scheduler does.
    pub scheduler_pid: u32,
    /// Size and geometry of the frames.
    pub frames: FrameFormat,
    /// Whether the run is in lock-step.
    pub lockstep: bool,
    /// First pair that capture publishes.
    pub first_sequence: u64,
    /// One past the last pair, at most `i64::MAX` as TOML has it; `None` = without end.
    pub end_sequence: Option<u64>,
    /// Source time from one pair to the next, in nanoseconds.
    pub source_period_ns: u64,
    /// Folder of the writer's results.
    pub out: Option<PathBuf>,
    /// File of the writer's recording.
    pub record: Option<PathBuf>,
}

impl Launch {
    /// The document as TOML, the format of the configuration in it.
    ///
    /// # Errors
    /// If a path is not UTF-8, or a number is beyond the integers of TOML.
    pub fn text(&self) -> Result<String, toml::ser::Error> {
        Ok(toml::Table::try_from(self)?.to_string())
    }

    /// Reads what [`Launch::text`] wrote.
    ///
    /// # Errors
    /// If it is anything else.
    pub fn parse(text: &str) -> Result<Self, toml::de::Error> {
        // By way of a table, as the configuration's own files: one deserialiser fewer in the program.
        text.parse::<toml::Table>()?.try_into()
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_reads_what_the_scheduler_wrote() {
        let rig =
            Rig { focal_px: 721.537_7, baseline_m: 0.1 + 0.2, cx_px: 1.0 / 3.0, cy_px: f64::MIN_POSITIVE };
        let mut config = Config::default();
        config.recognition.detectors.push(Default::default());
        config.source.path = "a \"b\"\n\\c = [d]".into();
        let launch = Launch {
            config,
            core: Some(3),
            helper_cores: vec![1, 2],
            scheduler_pid: u32::MAX,
            frames: FrameFormat::new((1242, 375), rig),
            lockstep: true,
            first_sequence: 1 << 40,
            end_sequence: None,
            source_period_ns: 100_000_000,
            out: Some("/tmp/a b".into()),
            record: None,
        };
        assert_eq!(Launch::parse(&launch.text().unwrap()).unwrap(), launch);
        assert!(Launch::parse("core = 1").is_err());
        let beyond = Launch { first_sequence: u64::MAX, ..launch };
        assert!(beyond.text().is_err());
    }
}
