//! Slides the cascade's window over an image at several scales, as OpenCV's detector does.

use super::cascade::{Cascade, Integral};
use super::resize::Resizer;
use crate::image::GreyView;

/// A window that passed all stages, in pixels of the scanned image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Left column.
    pub x: i32,
    /// Top row.
    pub y: i32,
    /// Width.
    pub width: i32,
    /// Height.
    pub height: i32,
}

/// Which windows are tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanParameters {
    /// Least width and height of a window, in pixels.
    pub least_px: u32,
    /// Greatest width and height, in pixels.
    pub greatest_px: u32,
    /// From one size to the next, above 1.
    pub growth: f64,
}

impl Default for ScanParameters {
    /// The paper's: 30 to 90 px, growing by 1.3.
    fn default() -> Self {
        Self { least_px: 30, greatest_px: 90, growth: 1.3 }
    }
}

/// Scans images of up to one size, with memory allocated once.
#[derive(Debug)]
pub struct Scanner {
    cascade: Cascade,
    parameters: ScanParameters,
    resizer: Resizer,
    integral: Integral,
    scales: Vec<f32>,
    hits: Vec<Window>,
}

/// Hits kept per scan: more than this in one crop is no find, and grouping is quadratic.
pub const MOST_HITS: usize = 1024;

/// Rounds like OpenCV: half to even.
fn round(value: f64) -> i32 {
    value.round_ties_even() as i32
}

/// A length times a scale in single precision, as OpenCV computes it.
fn scaled(length: i32, scale: f32) -> i32 {
    round(f64::from(length as f32 * scale))
}

impl Scanner {
    /// A scanner for images of up to `width` × `height` pixels. A growth of 1.01 or less is taken
    /// as 1.01.
    pub fn new(cascade: Cascade, parameters: ScanParameters, width: usize, height: usize) -> Self {
        let parameters = ScanParameters { growth: parameters.growth.max(1.01), ..parameters };
        Self {
            resizer: Resizer::new(width, height),
            integral: Integral::new(width, height),
            scales: Vec::with_capacity(1024),
            hits: Vec::with_capacity(MOST_HITS),
            cascade,
            parameters,
        }
    }

    /// Scales whose window lies between the least and the greatest size and in the image; if
    /// there are none, the one that comes nearest to the least size.
    fn choose_scales(&mut self, width: i32, height: i32) {
        self.scales.clear();
        let (least, greatest) = (self.parameters.least_px as i32, self.parameters.greatest_px as i32);
        let mut nearest: Option<(i64, f32)> = None;
        let mut factor = 1.0_f64;
        loop {
            let w = scaled(i32::from(self.cascade.width), factor as f32);
            let h = scaled(i32::from(self.cascade.height), factor as f32);
            if w > width || h > height {
                break;
            }
            if w >= least && h >= least && w <= greatest && h <= greatest {
                self.scales.push(factor as f32);
            }
            let away = i64::from(w - least).pow(2) + i64::from(h - least).pow(2);
            if nearest.is_none_or(|(d, _)| away < d) {
                nearest = Some((away, factor as f32));
            }
            factor *= self.parameters.growth;
        }
        if self.scales.is_empty()
            && let Some((_, scale)) = nearest
        {
            self.scales.push(scale);
        }
    }

    /// All windows of `image` that pass every stage, smallest windows first.
    ///
    /// # Panics
    /// When the image is larger than the scanner was made for.
    pub fn scan(&mut self, image: GreyView<'_>) -> &[Window] {
        self.hits.clear();
        self.choose_scales(image.width() as i32, image.height() as i32);
        let window = (i32::from(self.cascade.width), i32::from(self.cascade.height));
        for &scale in &self.scales {
            let width = round((image.width() as f32 / scale).into()).max(1);
            let height = round((image.height() as f32 / scale).into()).max(1);
            if width < window.0 || height < window.1 {
                continue;
            }
            let pixels = self.resizer.scale(image, width as usize, height as usize);
            self.integral.fill(pixels, width as usize);
            let step = if scale >= 2.0 { 1 } else { 2 };
            let size = (scaled(window.0, scale), scaled(window.1, scale));
            for y in (0..height - window.1 + 1).step_by(step) {
                let mut x = 0;
                while x < width - window.0 + 1 {
                    let passed = self.cascade.stages_passed(&self.integral, x as usize, y as usize);
                    if passed == self.cascade.stages.len() {
                        if self.hits.len() == MOST_HITS {
                            return &self.hits;
                        }
                        self.hits.push(Window {
                            x: scaled(x, scale),
                            y: scaled(y, scale),
                            width: size.0,
                            height: size.1,
                        });
                    } else if passed == 0 {
                        // A window that fails the first stage has a poor neighbour too.
                        x += step as i32;
                    }
                    x += step as i32;
                }
            }
        }
        &self.hits
    }
}

#[cfg(test)]
mod tests {
    use super::super::cascade::{Branch, LbpFeature, Node, Stage};
    use super::*;
    use crate::image::GreyImage;

    /// Passes windows whose upper left block is darker than the centre.
    fn dark_corner() -> Cascade {
        let mut subset = [0; 8];
        for code in (0..=255_u8).filter(|code| code & 128 == 0) {
            subset[usize::from(code >> 5)] |= 1_u32 << (code & 31);
        }
        let node = Node { feature: 0, subset, left: Branch::Leaf(1.0), right: Branch::Leaf(-1.0) };
        Cascade {
            width: 24,
            height: 24,
            features: vec![LbpFeature { x: 0, y: 0, width: 8, height: 8 }],
            stages: vec![Stage { threshold: 0.0, trees: vec![vec![node]] }],
        }
    }

    fn scanner(width: usize, height: usize) -> Scanner {
        Scanner::new(dark_corner(), ScanParameters::default(), width, height)
    }

    #[test]
    fn the_papers_range_gives_five_sizes_of_a_24_pixel_window() {
        let mut scanner = scanner(640, 480);
        scanner.choose_scales(640, 480);
        let sizes: Vec<i32> = scanner.scales.iter().map(|&s| round(24.0 * f64::from(s))).collect();
        assert_eq!(sizes, [31, 41, 53, 69, 89]);
        // A crop too small for the least size gets the nearest one, a tiny one none.
        scanner.choose_scales(28, 28);
        assert_eq!(scanner.scales, [1.0]);
        scanner.choose_scales(23, 50);
        assert!(scanner.scales.is_empty());
    }

    #[test]
    fn hits_are_where_the_pattern_is() {
        let (width, height) = (60, 50);
        let mut image = GreyImage::new(width, height);
        // One bright 10×10 patch on black.
        for y in 20..30 {
            for x in 30..40 {
                image.as_mut_slice()[y * width + x] = 200;
            }
        }
        let mut scanner = scanner(width, height);
        let hits = scanner.scan(image.view()).to_vec();
        assert!(!hits.is_empty());
        for hit in &hits {
            // The patch touches the centre block of each hit.
            let (third_x, third_y) = (hit.width / 3 + 2, hit.height / 3 + 2);
            assert!(hit.x + third_x - 2 < 42 && hit.x + 2 * third_x > 28, "{hit:?}");
            assert!(hit.y + third_y - 2 < 32 && hit.y + 2 * third_y > 18, "{hit:?}");
        }
        // A black image: no centre is brighter than its corner.
        assert!(scanner.scan(GreyImage::new(width, height).view()).is_empty());
        // Too small for any window.
        assert!(scanner.scan(GreyImage::new(5, 5).view()).is_empty());
    }
}
