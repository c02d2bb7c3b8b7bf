//! Weighted rectangles of Haar features, and the contrast of a window that normalises their sums.

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
    /// Factor of the sum over its pixels.
    pub weight: f32,
}

/// The contrast of a window, which normalises Haar values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contrast {
    /// 1 / (area × standard deviation) of the window without a border of one pixel.
    pub inverse: f32,
    /// False if the contrast is too low: a standard deviation of 10 grey levels or less.
    pub sound: bool,
}

impl Contrast {
    /// Contrast from the sum and the sum of squares over `area` pixels; squares wrap as in OpenCV.
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
