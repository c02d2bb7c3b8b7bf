//! What the road is found in: a disparity map and how far each of its pixels is to be believed.

use crate::stereo::DisparityView;

/// A disparity map with its confidence.
#[derive(Clone, Copy, Debug)]
pub struct DepthView<'a> {
    disparity: DisparityView<'a>,
    confidence: &'a [u8],
}

impl<'a> DepthView<'a> {
    /// A map with one confidence a pixel, 0 to 255, in rows without gaps; `None` when there are not as
    /// many.
    pub fn new(disparity: DisparityView<'a>, confidence: &'a [u8]) -> Option<Self> {
        (confidence.len() == disparity.width() * disparity.height()).then_some(Self { disparity, confidence })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.disparity.width()
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.disparity.height()
    }

    /// Disparities of row `y`, in 1/256 px; 0 = unknown.
    pub fn disparity(&self, y: usize) -> &'a [u16] {
        self.disparity.row(y)
    }

    /// Confidences of row `y`.
    pub fn confidence(&self, y: usize) -> &'a [u8] {
        &self.confidence[y * self.width()..(y + 1) * self.width()]
    }
}
