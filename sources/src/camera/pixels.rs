//! Conversion of camera pixel formats to grey.

use crate::picture::{grey_of, in_memory};
use image::{DynamicImage, ImageDecoder, ImageFormat};

/// Pixel format of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFormat {
    /// One grey byte per pixel.
    Grey,
    /// Two bytes per pixel, luma first: YUYV (YUY2).
    Yuyv,
    /// Two bytes per pixel, luma second: UYVY.
    Uyvy,
    /// Luma plane first, chroma after it: NV12, I420.
    Planar,
    /// One JPEG per frame. Decoding allocates for each frame: only for cameras that offer nothing else.
    Mjpeg,
}

impl PixelFormat {
    /// Bytes per row without padding.
    pub fn row_bytes(self, width: usize) -> usize {
        match self {
            Self::Grey | Self::Planar => width,
            Self::Yuyv | Self::Uyvy => 2 * width,
            Self::Mjpeg => 0,
        }
    }
}

/// Writes the grey pixels of a frame with `width` pixels per row. `stride` is the row pitch in bytes, 0 for
/// no padding. The height follows from the length of `grey`. Allocates only for [`PixelFormat::Mjpeg`].
///
/// # Errors
/// A message when the frame is too short or not an image.
pub fn to_grey(
    format: PixelFormat,
    frame: &[u8],
    width: usize,
    stride: usize,
    grey: &mut [u8],
) -> Result<(), String> {
    if format == PixelFormat::Mjpeg {
        return jpeg(frame, width, grey);
    }
    let row = format.row_bytes(width);
    let stride = if stride == 0 { row } else { stride };
    let rows = grey.len() / width.max(1);
    if width == 0 || stride < row || frame.len() < rows.saturating_sub(1) * stride + row {
        return Err(format!("a frame of {} bytes is too short for {width}x{rows} pixels", frame.len()));
    }
    for (line, target) in frame.chunks(stride).zip(grey.chunks_exact_mut(width)) {
        match format {
            PixelFormat::Yuyv => target.iter_mut().zip(line.iter().step_by(2)).for_each(|(t, &v)| *t = v),
            PixelFormat::Uyvy => {
                target.iter_mut().zip(line.iter().skip(1).step_by(2)).for_each(|(t, &v)| *t = v);
            }
            _ => target.copy_from_slice(&line[..width]),
        }
    }
    Ok(())
}

fn jpeg(frame: &[u8], width: usize, grey: &mut [u8]) -> Result<(), String> {
    let mut reader = in_memory(frame);
    reader.set_format(ImageFormat::Jpeg);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (w, h) = decoder.dimensions();
    if w as usize != width || w as usize * h as usize != grey.len() {
        return Err(format!("a JPEG of {w}x{h} pixels, expected {width}x{}", grey.len() / width.max(1)));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    grey.copy_from_slice(&grey_of(image).0);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn all_formats_give_the_same_grey() {
        let wanted: Vec<u8> = (0..12).collect();
        let grey = |format, frame: &[u8], stride| {
            let mut out = vec![99; 12];
            to_grey(format, frame, 4, stride, &mut out).map(|()| out)
        };
        assert_eq!(grey(PixelFormat::Grey, &wanted, 0).unwrap(), wanted);
        let yuyv: Vec<u8> = wanted.iter().flat_map(|&y| [y, 128]).collect();
        assert_eq!(grey(PixelFormat::Yuyv, &yuyv, 8).unwrap(), wanted);
        let uyvy: Vec<u8> = wanted.iter().flat_map(|&y| [128, y]).collect();
        assert_eq!(grey(PixelFormat::Uyvy, &uyvy, 0).unwrap(), wanted);
        // Padded rows (the last one may end early), then a chroma plane.
        let gaps: Vec<u8> = wanted.chunks(4).flat_map(|row| [row, &[77, 77, 77]].concat()).collect();
        assert_eq!(grey(PixelFormat::Grey, &gaps[..18], 7).unwrap(), wanted);
        let planar = [&wanted[..], &[128; 6]].concat();
        assert_eq!(grey(PixelFormat::Planar, &planar, 0).unwrap(), wanted);
        assert!(grey(PixelFormat::Yuyv, &yuyv[..20], 0).unwrap_err().contains("too short"));
        assert!(grey(PixelFormat::Grey, &wanted, 3).is_err());
    }

    #[test]
    fn jpegs_are_decoded_and_anything_else_refused() {
        let image = image::GrayImage::from_pixel(16, 8, [90].into());
        let mut file = Vec::new();
        image.write_to(&mut Cursor::new(&mut file), image::ImageFormat::Jpeg).unwrap();
        let mut grey = vec![0; 128];
        to_grey(PixelFormat::Mjpeg, &file, 16, 0, &mut grey).unwrap();
        assert!(grey.iter().all(|v| v.abs_diff(90) <= 2));
        assert!(to_grey(PixelFormat::Mjpeg, &file, 8, 0, &mut grey).unwrap_err().contains("16x8"));
        assert!(to_grey(PixelFormat::Mjpeg, &file[..50], 16, 0, &mut grey).is_err());
    }
}
