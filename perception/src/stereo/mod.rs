//! Dense stereo: from a rectified pair to a disparity map with confidence.

pub mod blocks;
pub mod confidence;
pub mod cost;
pub mod device;
pub mod energy;
pub mod epipolar;
pub mod fill;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod median;
pub mod mpv;
pub mod pyramid;
pub mod scale;
pub mod speckle;
pub mod viterbi;
pub mod winner;
mod worker;

use crate::image::GreyView;
use device::{DeviceState, Loss};
use thiserror::Error;

pub use mpv::{Mpv, MpvParameters, Search};

/// Steps of disparity per pixel in a [`DisparityView`]: 1/256 px.
pub const DISPARITY_SCALE: f32 = 256.0;

/// A borrowed disparity map: `width` × `height`, in 1/256 px, 0 = unknown.
#[derive(Clone, Copy, Debug)]
pub struct DisparityView<'a> {
    data: &'a [u16],
    width: usize,
    height: usize,
}

impl<'a> DisparityView<'a> {
    /// Sees `data` as rows of `width` values; `None` when it is not exactly `height` of them.
    pub fn new(data: &'a [u16], width: usize, height: usize) -> Option<Self> {
        (width > 0 && height > 0 && Some(data.len()) == width.checked_mul(height)).then_some(Self {
            data,
            width,
            height,
        })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &'a [u16] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// All values, row after row.
    pub fn as_slice(&self) -> &'a [u16] {
        self.data
    }

    /// Share of pixels with a known disparity, 0 to 1.
    pub fn density(&self) -> f64 {
        self.data.iter().filter(|&&d| d > 0).count() as f64 / self.data.len() as f64
    }
}

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
