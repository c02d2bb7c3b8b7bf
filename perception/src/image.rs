//! Borrowed and owned 8-bit grey images.

use thiserror::Error;

/// A borrowed 8-bit grey image: `height` rows of `width` pixels, `stride` bytes apart.
#[derive(Clone, Copy, Debug)]
pub struct GreyView<'a> {
    data: &'a [u8],
    width: usize,
    height: usize,
    stride: usize,
}

/// Errors of interpreting bytes as an image.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum ImageError {
    /// Width or height is zero.
    #[error("the image is empty ({width}x{height})")]
    Empty {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
    },
    /// The stride is smaller than a row.
    #[error("the stride of {stride} bytes is smaller than the width of {width} pixels")]
    Stride {
        /// Bytes from one row to the next.
        stride: usize,
        /// Width in pixels.
        width: usize,
    },
    /// The slice ends before the last row does.
    #[error("the image needs {needed} bytes, but the buffer has only {given}")]
    TooShort {
        /// Bytes that the image needs.
        needed: usize,
        /// Bytes that the slice has.
        given: usize,
    },
}

impl<'a> GreyView<'a> {
    /// Interprets `data` as an image of `width` × `height` pixels with rows `stride` bytes apart.
    ///
    /// # Errors
    /// If the image is empty, the stride is smaller than the width, or `data` is too short.
    pub fn new(data: &'a [u8], width: usize, height: usize, stride: usize) -> Result<Self, ImageError> {
        if width == 0 || height == 0 {
            return Err(ImageError::Empty { width, height });
        }
        if stride < width {
            return Err(ImageError::Stride { stride, width });
        }
        let needed = (height - 1).saturating_mul(stride).saturating_add(width);
        if data.len() < needed {
            return Err(ImageError::TooShort { needed, given: data.len() });
        }
        Ok(Self { data, width, height, stride })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Bytes from one row to the next.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// The bytes from the first pixel on, including the padding between rows; the last row may end with its
    /// last pixel.
    pub fn bytes(&self) -> &'a [u8] {
        self.data
    }

    /// Row `y`, exactly `width` pixels.
    pub fn row(&self, y: usize) -> &'a [u8] {
        let start = y * self.stride;
        &self.data[start..start + self.width]
    }

    /// The pixel at column `x` of row `y`.
    pub fn at(&self, x: usize, y: usize) -> u8 {
        self.data[y * self.stride + x]
    }

    /// The crop of `width` × `height` pixels at (`x`, `y`); `None` if it is empty or reaches outside the
    /// image.
    pub fn crop(&self, x: usize, y: usize, width: usize, height: usize) -> Option<GreyView<'a>> {
        if width == 0
            || height == 0
            || x.checked_add(width)? > self.width
            || y.checked_add(height)? > self.height
        {
            return None;
        }
        GreyView::new(&self.data[y * self.stride + x..], width, height, self.stride).ok()
    }
}

/// An owned 8-bit grey image without padding between rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    data: Vec<u8>,
    width: usize,
    height: usize,
}

impl GreyImage {
    /// A black image.
    ///
    /// # Panics
    /// If width or height is zero.
    pub fn new(width: usize, height: usize) -> Self {
        assert!(width > 0 && height > 0, "an image has at least one pixel");
        Self { data: vec![0; width * height], width, height }
    }

    /// Takes ownership of `data` as `height` rows of `width` pixels.
    ///
    /// # Errors
    /// If the image is empty or `data` is too short.
    pub fn from_vec(mut data: Vec<u8>, width: usize, height: usize) -> Result<Self, ImageError> {
        GreyView::new(&data, width, height, width)?;
        data.truncate(width * height);
        Ok(Self { data, width, height })
    }

    /// The image as a view.
    pub fn view(&self) -> GreyView<'_> {
        GreyView { data: &self.data, width: self.width, height: self.height, stride: self.width }
    }

    /// All pixels, row by row.
    pub fn as_slice(&self) -> &[u8] {
        &self.data
    }

    /// All pixels, row by row, mutable.
    pub fn as_mut_slice(&mut self) -> &mut [u8] {
        &mut self.data
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_views_are_refused() {
        let data = [0_u8; 10];
        assert_eq!(GreyView::new(&data, 0, 3, 3).unwrap_err(), ImageError::Empty { width: 0, height: 3 });
        assert!(matches!(GreyView::new(&data, 4, 2, 3), Err(ImageError::Stride { .. })));
        assert!(matches!(GreyView::new(&data, 4, 3, 4), Err(ImageError::TooShort { .. })));
        // The last row needs no padding behind it.
        assert!(GreyView::new(&data, 4, 2, 6).is_ok());
        assert!(matches!(
            GreyView::new(&data, usize::MAX, usize::MAX, usize::MAX),
            Err(ImageError::TooShort { .. })
        ));
    }

    #[test]
    fn a_crop_sees_the_same_pixels() {
        let data: Vec<u8> = (0..20).collect();
        let image = GreyView::new(&data, 4, 4, 5).unwrap();
        let crop = image.crop(1, 2, 3, 2).unwrap();
        assert_eq!(crop.row(0), &[11, 12, 13]);
        assert_eq!(crop.at(2, 1), 18);
        assert!(image.crop(2, 0, 3, 1).is_none());
        assert!(image.crop(usize::MAX, 0, 2, 1).is_none());
    }
}
