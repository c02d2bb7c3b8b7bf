//! A borrowed disparity map.

/// A borrowed disparity map of `width` × `height` values in 1/256 px; 0 = unknown.
#[derive(Clone, Copy, Debug)]
pub struct DisparityView<'a> {
    data: &'a [u16],
    width: usize,
    height: usize,
}

impl<'a> DisparityView<'a> {
    /// Interprets `data` as `height` rows of `width` values; `None` if its length differs or the map is empty.
    pub fn new(data: &'a [u16], width: usize, height: usize) -> Option<Self> {
        (width > 0 && height > 0 && Some(data.len()) == width.checked_mul(height)).then_some(Self {
            data,
            width,
            height,
        })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &'a [u16] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// All values, row after row.
    pub fn as_slice(&self) -> &'a [u16] {
        self.data
    }

    /// Share of pixels with a known disparity, 0 to 1.
    pub fn density(&self) -> f64 {
        self.data.iter().filter(|&&d| d > 0).count() as f64 / self.data.len() as f64
    }
}
