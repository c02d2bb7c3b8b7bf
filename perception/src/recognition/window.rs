//! What the sums over one window are taken of: weighted rectangles, and the contrast that normalises them.

/// A rectangle of a Haar feature.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WeightedRect {
    /// Left column; the column of the apex when tilted.
    pub x: u16,
    /// Top row; the row of the apex when tilted.
    pub y: u16,
    /// Width; the length of the arm that runs down to the right when tilted.
    pub width: u16,
    /// Height; the length of the arm that runs down to the left when tilted.
    pub height: u16,
    /// Factor of the sum of its pixels.
    pub weight: f32,
}

/// The contrast of a window, by which Haar values are divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contrast {
    /// One over its area × standard deviation, over the window less one pixel on each side.
    pub inverse: f32,
    /// False when the window is too flat to be judged: standard deviation of 10 grey levels or less.
    pub sound: bool,
}

impl Contrast {
    /// From the sum and the sum of squares of `area` pixels; squares wrap as OpenCV's do.
    #[inline]
    pub fn new(sum: u32, squares: u32, area: f64) -> Self {
        let sum = f64::from(sum as i32);
        let spread = area * f64::from(squares) - sum * sum;
        if spread > 0.0 {
            let inverse = (1.0 / spread.sqrt()) as f32;
            Self { inverse, sound: area * f64::from(inverse) < 0.1 }
        } else {
            Self { inverse: 1.0, sound: false }
        }
    }
}
