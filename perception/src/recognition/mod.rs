//! Object recognition by boosted cascades of multi-block LBP or Haar features (paper, section 3.6), and by histograms of
//! oriented gradients ([`hog`]).
//!
//! Input is an 8-bit grey image: the crop of an obstacle region for [`CascadeRecogniser`], a whole image for
//! [`Detector`]. Output are windows in pixels of that image with the number of overlapping hits as score. A
//! cascade recognises one class; it is read from OpenCV's XML format by [`xml::read`], or trained by
//! `lookout train`. Scan positions, scales, arithmetic and grouping are those of OpenCV's
//! `CascadeClassifier::detectMultiScale`, so that the hits are the same.
//!
//! | module | contents |
//! |---|---|
//! | [`calibration`] | what a score says: log-odds of the class |
//! | [`cascade`] | the model, and the reference implementation for single windows |
//! | `program` | the same cascade in the memory layout of the vectorised scan |
//! | [`integral`] | integral images: upright, squared and tilted |
//! | [`scan`] | sliding window over scales |
//! | [`hog`] | histograms of oriented gradients with a linear SVM |
//! | [`network`] | small neural networks from ONNX files |
//! | [`group`] | grouping of overlapping hits |
//! | [`resize`] | bilinear scaling in fixed point |
//! | [`xml`] | OpenCV's cascade files |

pub mod calibration;
pub mod cascade;
pub mod group;
pub mod hog;
pub mod integral;
pub mod network;
mod program;
pub mod resize;
pub mod scan;
pub mod window;
pub mod xml;

use crate::image::GreyView;
pub use calibration::Calibration;
pub use cascade::Cascade;
use group::{Group, Grouper};
pub use scan::{Scanner, Sizes, Window};

/// An object recognised in a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recognition {
    /// Number of overlapping hits of a cascade, or distance from the plane of an SVM; more means higher confidence.
    pub score: f32,
    /// Left column of the object's window, in pixels of the crop.
    pub x: u32,
    /// Top row of the window.
    pub y: u32,
    /// Width of the window.
    pub width: u32,
    /// Height of the window.
    pub height: u32,
}

/// Recognises one class of objects in the crop of a region.
pub trait Recogniser {
    /// The object of the class with the highest score in `crop`; `None` if there is none. `metre_px` is the
    /// size of a metre at the region's distance in pixels, if known. The result depends only on the arguments.
    fn recognise(&mut self, crop: GreyView<'_>, metre_px: Option<f64>) -> Option<Recognition>;
}

/// Most classes of one detector.
pub const MAX_CLASSES: usize = 8;

/// Parameters of recognition in regions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecogniserParameters {
    /// Window sizes if the distance of a region is unknown or `window_m` is 0.
    pub sizes: Sizes,
    /// Ratio of the two window sizes around the expected one.
    pub growth: f64,
    /// Width of the cascade's window at the object, in metres; 0 scans all `sizes`.
    pub window_m: f64,
    /// An object needs more overlapping hits than this.
    pub min_neighbours: u32,
}

impl Default for RecogniserParameters {
    fn default() -> Self {
        Self { sizes: Sizes::default(), growth: scan::DEFAULT_GROWTH, window_m: 2.0, min_neighbours: 3 }
    }
}

impl RecogniserParameters {
    /// Window sizes where a metre at the object is `metre_px` pixels; `None` if that is unknown.
    fn sizes_at(&self, metre_px: Option<f64>) -> Sizes {
        match metre_px {
            Some(metre_px) if self.window_m > 0.0 => {
                Sizes::Around { width_px: self.window_m * metre_px, growth: self.growth }
            }
            _ => self.sizes,
        }
    }
}

/// Maximum number of hits per crop.
const MAX_HITS: usize = 4096;

/// A cascade as a recogniser, with its workspace.
#[derive(Debug)]
pub struct CascadeRecogniser {
    scanner: Scanner,
    grouper: Grouper,
    parameters: RecogniserParameters,
}

impl CascadeRecogniser {
    /// A recogniser for crops of at most `width` × `height` pixels.
    pub fn new(cascade: &Cascade, parameters: RecogniserParameters, width: usize, height: usize) -> Self {
        Self {
            scanner: Scanner::new(cascade, width, height, MAX_HITS),
            grouper: Grouper::new(MAX_HITS),
            parameters,
        }
    }
}

impl Recogniser for CascadeRecogniser {
    fn recognise(&mut self, crop: GreyView<'_>, metre_px: Option<f64>) -> Option<Recognition> {
        let p = &self.parameters;
        let sizes = p.sizes_at(metre_px);
        let groups = self.grouper.group(self.scanner.scan(crop, sizes), p.min_neighbours);
        let best = groups.iter().max_by_key(|group| group.hits)?;
        let (width, height) = (crop.width() as i32, crop.height() as i32);
        let window = clip(best.window, width, height)?;
        Some(Recognition {
            score: best.hits as f32,
            x: window.x as u32,
            y: window.y as u32,
            width: window.width as u32,
            height: window.height as u32,
        })
    }
}

/// The part of a window within the image; `None` if they do not overlap.
fn clip(window: Window, width: i32, height: i32) -> Option<Window> {
    let (x, y) = (window.x.max(0), window.y.max(0));
    let (right, bottom) = ((window.x + window.width).min(width), (window.y + window.height).min(height));
    (right > x && bottom > y).then_some(Window { x, y, width: right - x, height: bottom - y })
}

/// Finds all objects in whole images, as OpenCV's `detectMultiScale` does.
#[derive(Debug)]
pub struct Detector {
    scanner: Scanner,
    grouper: Grouper,
    found: Vec<Group>,
}

impl Detector {
    /// A detector for images of up to `width` × `height` pixels.
    pub fn new(cascade: &Cascade, width: usize, height: usize) -> Self {
        Self {
            scanner: Scanner::new(cascade, width, height, usize::MAX),
            grouper: Grouper::default(),
            found: Vec::new(),
        }
    }

    /// Groups of more than `min_neighbours` overlapping hits, clipped to the image; with 0 every hit is a
    /// group.
    ///
    /// # Panics
    /// If the image is larger than the detector's maximum size.
    pub fn detect(&mut self, image: GreyView<'_>, sizes: Sizes, min_neighbours: u32) -> &[Group] {
        let groups = self.grouper.group(self.scanner.scan(image, sizes), min_neighbours);
        let (width, height) = (image.width() as i32, image.height() as i32);
        self.found.clear();
        self.found.extend(
            groups
                .iter()
                .filter_map(|g| clip(g.window, width, height).map(|window| Group { window, hits: g.hits })),
        );
        &self.found
    }
}
