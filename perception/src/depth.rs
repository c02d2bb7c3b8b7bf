//! Input of road and obstacle detection: a disparity map with confidence and, optionally, the rectified
//! images.

use crate::image::GreyView;
use crate::stereo::DisparityView;

/// A disparity map with its confidence and, optionally, its images.
#[derive(Clone, Copy, Debug)]
pub struct DepthView<'a> {
    disparity: DisparityView<'a>,
    confidence: &'a [u8],
    images: Option<[GreyView<'a>; 2]>,
}

impl<'a> DepthView<'a> {
    /// Combines a map with one confidence per pixel (0 to 255, rows without padding); `None` if their sizes
    /// differ.
    pub fn new(disparity: DisparityView<'a>, confidence: &'a [u8]) -> Option<Self> {
        let fits = confidence.len() == disparity.width() * disparity.height();
        fits.then_some(Self { disparity, confidence, images: None })
    }

    /// Adds the rectified pair, left and right; `None` if the size of an image differs.
    pub fn with_images(self, images: [GreyView<'a>; 2]) -> Option<Self> {
        let size = (self.width(), self.height());
        let fit = images.iter().all(|image| (image.width(), image.height()) == size);
        fit.then_some(Self { images: Some(images), ..self })
    }

    /// Rectified pair, left and right, if available.
    pub fn images(&self) -> Option<[GreyView<'a>; 2]> {
        self.images
    }

    /// Width in px.
    pub fn width(&self) -> usize {
        self.disparity.width()
    }

    /// Height in px.
    pub fn height(&self) -> usize {
        self.disparity.height()
    }

    /// Disparities of row `y`, in 1/256 px; 0 = unknown.
    pub fn disparity(&self, y: usize) -> &'a [u16] {
        self.disparity.row(y)
    }

    /// Confidences of row `y`, 0 to 255.
    pub fn confidence(&self, y: usize) -> &'a [u8] {
        &self.confidence[y * self.width()..(y + 1) * self.width()]
    }
}
