//! Recognition: a boosted cascade over multi-block LBP or Haar features says what a region is
//! (paper, section 3.6).

pub mod cascade;
pub mod group;
pub mod integral;
mod program;
pub mod resize;
pub mod scan;
pub mod window;
pub mod xml;

use crate::image::GreyView;
pub use cascade::Cascade;
use group::{Group, Grouper};
pub use scan::{Scanner, Sizes, Window};

/// What a recogniser says of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recognition {
    /// Overlapping hits behind it; more is surer.
    pub score: f32,
    /// Left column of the recognised part, in pixels of the crop.
    pub x: u32,
    /// Its top row.
    pub y: u32,
    /// Its width.
    pub width: u32,
    /// Its height.
    pub height: u32,
}

/// Something that recognises one class of object in the crop of a region.
pub trait Recogniser {
    /// The most certain object of the class in `crop`; `None` when there is none. `metre_px` is how
    /// many pixels a metre has at the region's distance, where that is known. The result depends on
    /// the arguments alone.
    fn recognise(&mut self, crop: GreyView<'_>, metre_px: Option<f64>) -> Option<Recognition>;
}

/// How a cascade is applied to regions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecogniserParameters {
    /// Sizes of window when the distance of a region is not known or `window_m` is 0.
    pub sizes: Sizes,
    /// From one size to the next about the expected one.
    pub growth: f64,
    /// Width of the cascade's window at the object, in metres; 0 tries all `sizes`.
    pub window_m: f64,
    /// A find needs more overlapping hits than this.
    pub min_neighbours: u32,
}

impl Default for RecogniserParameters {
    fn default() -> Self {
        Self { sizes: Sizes::default(), growth: scan::DEFAULT_GROWTH, window_m: 2.0, min_neighbours: 3 }
    }
}

/// Hits kept per crop: more than this is no find.
const MAX_HITS: usize = 4096;

/// The cascade as a recogniser, with its workspace.
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
        let sizes = match metre_px {
            Some(metre_px) if p.window_m > 0.0 => {
                Sizes::Around { width_px: p.window_m * metre_px, growth: p.growth }
            }
            _ => p.sizes,
        };
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

/// The part of a window that lies in an image; `None` when none does.
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

    /// Groups of more than `min_neighbours` overlapping hits, clipped to the image; with 0 every
    /// hit is one.
    ///
    /// # Panics
    /// When the image is larger than the detector was made for.
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
