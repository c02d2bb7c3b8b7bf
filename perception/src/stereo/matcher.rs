//! The interface of a stereo matcher: where it writes its result, its errors and the trait itself.

use super::device::{DeviceState, Loss};
use crate::image::GreyView;
use thiserror::Error;

/// Where a matcher writes its result: both slices `width` × `height`, row after row.
#[derive(Debug)]
pub struct MatchOutput<'a> {
    /// Disparity in 1/256 px, 0 = unknown.
    pub disparity: &'a mut [u16],
    /// 0 (a guess) to 255 (no other disparity comes near); 0 where the disparity is unknown.
    pub confidence: &'a mut [u8],
}

/// Why a pair cannot be matched.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum MatchError {
    /// The matcher was made for another size.
    #[error(
        "the {which} image is {width}x{height}, the matcher was made for {expected_width}x{expected_height}"
    )]
    Size {
        /// "left" or "right".
        which: &'static str,
        /// Width of the image.
        width: usize,
        /// Height of the image.
        height: usize,
        /// Width of the matcher.
        expected_width: usize,
        /// Height of the matcher.
        expected_height: usize,
    },
    /// An output slice is not `width` × `height`.
    #[error("the output holds {given} values, the image has {needed} pixels")]
    Output {
        /// Values in the slice.
        given: usize,
        /// Pixels of the image.
        needed: usize,
    },
    /// The device that the matcher runs on is gone; another pair will fare no better.
    #[error("the matcher's device is lost: {0}")]
    Lost(Loss),
}

/// Why a matcher cannot be made.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum MatcherError {
    /// Below the least size that a window needs.
    #[error("a {width}x{height} image is too small to match: {least}x{least} pixels is the least")]
    TooSmall {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Least width and height.
        least: usize,
    },
    /// More nodes than a matcher is meant to hold.
    #[error(
        "{width}x{height} pixels with {disparities} disparities are more than a matcher holds: scale the images down"
    )]
    TooLarge {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Disparities.
        disparities: usize,
    },
    /// Beyond what 16-bit disparities in 1/256 px hold.
    #[error("{0} disparities: give 2 to 255")]
    Disparities(usize),
}

/// Something that matches rectified pairs of one size, on the CPU or on a GPU.
pub trait Matcher {
    /// Matches one pair. The result depends on the pair alone.
    ///
    /// # Errors
    /// When an image or an output has another size than the matcher was made for.
    fn compute(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
    ) -> Result<(), MatchError> {
        self.compute_within(left, right, output, &mut || true).map(|_| ())
    }

    /// As [`Self::compute`], but gives up the scale it works on once `go_on` says no (it is asked
    /// every 32 rows of all but the coarsest scale) and returns the one before, enlarged. The coarsest scale is always finished.
    /// Returns how often the result was halved: 0 is the full resolution.
    ///
    /// # Errors
    /// As [`Self::compute`].
    fn compute_within(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<u32, MatchError>;

    /// Nodes that the last pair took, over all scales that were begun; the paper counts m·n·d for the
    /// full range and at most 0.3281·m·n·d for three scales.
    fn nodes(&self) -> usize;

    /// Bytes of scratch memory that the matcher holds.
    fn workspace_bytes(&self) -> usize;

    /// The device that it runs on; None on the CPU.
    fn device(&self) -> Option<DeviceState<'_>> {
        None
    }
}
