//! Recognition: a boosted cascade over multi-block LBP features says what a region is
//! (paper, section 3.6).

pub mod cascade;
pub mod group;
pub mod resize;
pub mod scan;
pub mod xml;

use crate::image::GreyView;
pub use cascade::Cascade;
use group::{Group, Grouper};
pub use scan::{ScanParameters, Scanner};

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
    /// The most certain object of the class in `crop`; `None` when there is none. The result
    /// depends on the crop alone.
    fn recognise(&mut self, crop: GreyView<'_>) -> Option<Recognition>;
}

/// The cascade as a recogniser, with its workspace.
#[derive(Debug)]
pub struct CascadeRecogniser {
    scanner: Scanner,
    grouper: Grouper,
    least_neighbours: u32,
}

impl CascadeRecogniser {
    /// A recogniser for crops of at most `width` × `height` pixels. A find needs more than
    /// `least_neighbours` overlapping hits.
    pub fn new(
        cascade: Cascade,
        parameters: ScanParameters,
        least_neighbours: u32,
        width: usize,
        height: usize,
    ) -> Self {
        Self {
            scanner: Scanner::new(cascade, parameters, width, height),
            grouper: Grouper::new(),
            least_neighbours,
        }
    }

    /// All groups of hits in an image, in the order of their first hit.
    pub fn detect(&mut self, image: GreyView<'_>) -> &[Group] {
        let hits = self.scanner.scan(image);
        self.grouper.group(hits, self.least_neighbours)
    }
}

impl Recogniser for CascadeRecogniser {
    fn recognise(&mut self, crop: GreyView<'_>) -> Option<Recognition> {
        let (width, height) = (crop.width() as i32, crop.height() as i32);
        let best = self.detect(crop).iter().max_by_key(|group| group.hits)?;
        let (x, y) = (best.window.x.clamp(0, width - 1), best.window.y.clamp(0, height - 1));
        Some(Recognition {
            score: best.hits as f32,
            x: x as u32,
            y: y as u32,
            width: best.window.width.min(width - x) as u32,
            height: best.window.height.min(height - y) as u32,
        })
    }
}
