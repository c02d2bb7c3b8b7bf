//! A HOG model as a recogniser of one class in the crops of regions.

use super::{HogModel, HogScanner};
use crate::image::GreyView;
use crate::recognition::{Recogniser, RecogniserParameters, Recognition, clip};

/// Reflected pixels around a crop, scaled: the margin around a figure in the window of OpenCV's people detector.
const PADDING_PX: usize = 16;

/// Maximum number of windows of a crop that are kept.
const MAX_HITS: usize = 4096;

/// A HOG model as a recogniser, with its workspace.
#[derive(Debug)]
pub struct HogRecogniser {
    scanner: HogScanner,
    parameters: RecogniserParameters,
    threshold: f32,
}

impl HogRecogniser {
    /// A recogniser for crops of at most `width` × `height` pixels. A window is found if its distance from the SVM's plane
    /// is at least `threshold`.
    pub fn new(
        model: HogModel,
        parameters: RecogniserParameters,
        threshold: f32,
        width: usize,
        height: usize,
    ) -> Self {
        let scanner = HogScanner::new(model, width, height, PADDING_PX, MAX_HITS);
        Self { scanner, parameters, threshold }
    }
}

impl Recogniser for HogRecogniser {
    fn recognise(&mut self, crop: GreyView<'_>, metre_px: Option<f64>) -> Option<Recognition> {
        let sizes = self.parameters.sizes_at(metre_px);
        let hits = self.scanner.scan(crop, sizes, self.threshold);
        let best = hits.iter().max_by(|a, b| a.score.total_cmp(&b.score))?;
        let window = clip(best.window, crop.width() as i32, crop.height() as i32)?;
        Some(Recognition {
            score: best.score,
            x: window.x as u32,
            y: window.y as u32,
            width: window.width as u32,
            height: window.height as u32,
        })
    }
}
