//! What the road is found in: a disparity map, how far each of its pixels is to be believed, and the
//! images that it was made from.

use crate::image::GreyView;
use crate::stereo::DisparityView;

/// A disparity map with its confidence.
#[derive(Clone, Copy, Debug)]
pub struct DepthView<'a> {
    disparity: DisparityView<'a>,
    confidence: &'a [u8],
    images: Option<[GreyView<'a>; 2]>,
}

impl<'a> DepthView<'a> {
    /// A map with one confidence a pixel, 0 to 255, in rows without gaps; `None` when there are not as
    /// many.
    pub fn new(disparity: DisparityView<'a>, confidence: &'a [u8]) -> Option<Self> {
        let fits = confidence.len() == disparity.width() * disparity.height();
        fits.then_some(Self { disparity, confidence, images: None })
    }

    /// The same with the rectified pair, left and right; `None` when a image has another size.
    pub fn with_images(self, images: [GreyView<'a>; 2]) -> Option<Self> {
        let size = (self.width(), self.height());
        let fit = images.iter().all(|image| (image.width(), image.height()) == size);
        fit.then_some(Self { images: Some(images), ..self })
    }

    /// The rectified pair, left and right, if it is there.
    pub fn images(&self) -> Option<[GreyView<'a>; 2]> {
        self.images
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
