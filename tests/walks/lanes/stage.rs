//! Depth to nothing: the stage of the walk in CONTRIBUTING.md.

use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::FrameFormat;
use config::Config;
use messages::depth::{Depth, DepthMessage};
use messages::lanes::LanesMessage;
use messages::typed::{Output, Written};

/// Does nothing.
pub struct LanesStage;

impl Stage for LanesStage {
    type In = DepthMessage;
    type Out = LanesMessage;

    fn new(_: &Config, _: &FrameFormat) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn process(
        &mut self,
        _: &FrameContext,
        _: Depth<'_>,
        output: Output<'_, LanesMessage>,
    ) -> Result<Written, FrameError> {
        Ok(output.write())
    }
}
