//! The interface of a stereo matcher: where it writes its result, its errors and the trait itself.

use super::device::{DeviceState, Loss};
use crate::image::GreyView;
use thiserror::Error;

/// Output buffers of a matcher: `width` × `height` values each, row by row.
#[derive(Debug)]
pub struct MatchOutput<'a> {
    /// Disparity in 1/256 px, 0 = unknown.
    pub disparity: &'a mut [u16],
    /// Confidence, 1 (uncertain) to 255 (no other disparity has a similar energy); 0 where the disparity is
    /// unknown.
    pub confidence: &'a mut [u8],
}

/// Errors of [`Matcher::compute`].
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum MatchError {
    /// The image has another size than the matcher.
    #[error("the {which} image is {width}x{height}, the matcher expects {expected_width}x{expected_height}")]
    Size {
        /// "left" or "right".
        which: &'static str,
        /// Width of the image.
        width: usize,
        /// Height of the image.
        height: usize,
        /// Width that the matcher expects.
        expected_width: usize,
        /// Height that the matcher expects.
        expected_height: usize,
    },
    /// An output slice is not `width` × `height`.
    #[error("the output holds {given} values, the image has {needed} pixels")]
    Output {
        /// Length of the slice.
        given: usize,
        /// Number of pixels of the image.
        needed: usize,
    },
    /// The device that the matcher runs on is lost; every later pair fails as well.
    #[error("the matcher's device is lost: {0}")]
    Lost(Loss),
}

/// Errors of creating a matcher.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum MatcherError {
    /// The image is smaller than a matching window.
    #[error("a {width}x{height} image is too small to match: the minimum is {min}x{min} pixels")]
    TooSmall {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Minimum width and height.
        min: usize,
    },
    /// The image has more nodes than [`MAX_NODES`](super::mpv::MAX_NODES).
    #[error(
        "{width}x{height} pixels with {disparities} disparities are more than a matcher supports: scale the images down"
    )]
    TooLarge {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Number of disparities.
        disparities: usize,
    },
    /// The number of disparities is out of range: 16-bit values in 1/256 px hold at most 255.
    #[error("{0} disparities: the range is 2 to 255")]
    Disparities(usize),
}

/// A dense stereo matcher for rectified pairs of one size, on the CPU or on a GPU.
pub trait Matcher {
    /// Matches one pair. The result depends only on the pair.
    ///
    /// # Errors
    /// If an image or an output has another size than the matcher, or the device is lost.
    fn compute(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
    ) -> Result<(), MatchError> {
        self.compute_within(left, right, output, &mut || true).map(|_| ())
    }

    /// As [`Self::compute`], but with a deadline: once `go_on` returns false, the current scale of the
    /// pyramid is abandoned and the result of the previous (coarser) scale is enlarged instead. `go_on` is
    /// called every 32 rows of all but the coarsest scale, which always finishes.
    /// Returns how often the resolution was halved: 0 is the full resolution.
    ///
    /// # Errors
    /// As [`Self::compute`].
    fn compute_within(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        go_on: &mut (dyn FnMut() -> bool + Send),
    ) -> Result<u32, MatchError>;

    /// Nodes of the search space of the last pair, summed over all scales that were started. The paper
    /// counts m·n·d for the full range and at most 0.3281·m·n·d for three scales.
    fn nodes(&self) -> usize;

    /// Bytes of memory that the matcher holds.
    fn workspace_bytes(&self) -> usize;

    /// The device that the matcher runs on; `None` on the CPU.
    fn device(&self) -> Option<DeviceState<'_>> {
        None
    }
}
