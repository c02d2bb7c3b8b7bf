//! Pair to depth.

use super::matcher::Method;
use super::{FrameError, Room, RoomError, check_size};
use crate::launch::FrameFormat;
use config::Config;
use ipc::header::Header;
use ipc::{depth, pair};
use perception::image::GreyView;
use perception::stereo::{MatchOutput, Matcher};

/// The matcher between its messages.
pub struct StereoRoom {
    matcher: Box<dyn Matcher>,
    width: usize,
    height: usize,
}

impl StereoRoom {
    /// A matcher for the run's frames.
    ///
    /// # Errors
    /// When the frames are too small or there are too many disparities.
    pub fn new(config: &Config, format: &FrameFormat) -> Result<Self, RoomError> {
        let (width, height) = (format.width, format.height);
        let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
        let matcher = Method::configured(config).matcher(config, width, height, disparities)?;
        Ok(Self { matcher, width, height })
    }
}

impl Room for StereoRoom {
    fn output_bytes(&self) -> usize {
        depth::payload_bytes(self.width, self.height)
    }

    fn process(&mut self, header: &Header, payload: &[u8], output: &mut [u8]) -> Result<usize, FrameError> {
        let pair = pair::view(header, payload)?;
        check_size(header, self.width, self.height)?;
        let bytes = self.output_bytes().min(output.len());
        let out = depth::split_mut(&mut output[..bytes], header.pixels())?;
        out.left.copy_from_slice(pair.left);
        let view = |data| GreyView::new(data, self.width, self.height, self.width);
        let (left, right) = (view(pair.left)?, view(pair.right)?);
        let output = MatchOutput { disparity: out.disparity, confidence: out.confidence };
        self.matcher.compute(left, right, output)?;
        Ok(self.output_bytes())
    }
}
