//! An RGB image with drawing functions and PNG output.

use embedded_graphics::mono_font::{MonoTextStyle, ascii};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Line, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Baseline, Text};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::convert::Infallible;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Width of a character and height of a line of text, in px.
pub const TEXT_PX: (i32, i32) = (7, 13);

/// Length of a dash and of the gap after it, in px.
const DASH_PX: u32 = 5;

/// An image cannot be written.
#[derive(Debug, Error)]
#[error("{}: cannot be written: {reason}", path.display())]
pub struct PictureError {
    /// Path of the file.
    pub path: PathBuf,
    /// Cause.
    pub reason: String,
}

/// Red, green, blue.
pub type Colour = [u8; 3];

/// An image with 24 bits per pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    data: Vec<u8>,
    width: usize,
    height: usize,
}

impl Picture {
    /// An image of one colour.
    ///
    /// # Panics
    /// When it is empty.
    pub fn new(width: usize, height: usize, colour: Colour) -> Self {
        assert!(width > 0 && height > 0, "an image has at least one pixel");
        Self { data: colour.repeat(width * height), width, height }
    }

    /// An image from one colour per pixel, row-major.
    ///
    /// # Panics
    /// When there are not exactly `width` × `height` pixels.
    pub fn from_pixels(pixels: impl Iterator<Item = Colour>, width: usize, height: usize) -> Self {
        let data: Vec<u8> = pixels.flatten().collect();
        assert_eq!(data.len(), 3 * width * height);
        Self { data, width, height }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Red, green and blue of every pixel, row-major.
    pub fn as_bytes(&self) -> &[u8] {
        &self.data
    }

    /// Colour of a pixel inside the image.
    pub fn at(&self, x: usize, y: usize) -> Colour {
        let i = 3 * (y * self.width + x);
        [self.data[i], self.data[i + 1], self.data[i + 2]]
    }

    /// Adds another one of the same width below; of another width it is left out.
    pub fn append_below(&mut self, other: &Self) {
        if other.width == self.width {
            self.data.extend_from_slice(&other.data);
            self.height += other.height;
        }
    }

    /// Blends `colour` into a pixel with weight `share` ÷ 256; ignored outside the image.
    pub fn tint(&mut self, x: usize, y: usize, colour: Colour, share: u16) {
        if x >= self.width || y >= self.height {
            return;
        }
        let i = 3 * (y * self.width + x);
        for (target, c) in self.data[i..i + 3].iter_mut().zip(colour) {
            *target = ((u16::from(*target) * (256 - share) + u16::from(c) * share) >> 8) as u8;
        }
    }

    /// Draws a rectangle outline `thickness` pixels wide, inside the given box.
    pub fn frame(&mut self, bounds: [u32; 4], colour: Colour, thickness: u32) {
        let [x, y, width, height] = bounds;
        let style = embedded_graphics::primitives::PrimitiveStyleBuilder::new()
            .stroke_color(rgb(colour))
            .stroke_width(thickness)
            .stroke_alignment(embedded_graphics::primitives::StrokeAlignment::Inside)
            .build();
        let top_left = Point::new(x as i32, y as i32);
        never_fails(Rectangle::new(top_left, Size::new(width, height)).into_styled(style).draw(self));
    }

    /// Draws the edge of a rectangle (left, top, width, height) with dashes, inside of it.
    pub fn dashed_frame(&mut self, bounds: [u32; 4], colour: Colour, thickness: u32) {
        let [x, y, width, height] = bounds;
        let (right, bottom) = (x.saturating_add(width), y.saturating_add(height));
        let mut paint = |x: u32, y: u32| {
            if (x as usize) < self.width && (y as usize) < self.height {
                let i = 3 * (y as usize * self.width + x as usize);
                self.data[i..i + 3].copy_from_slice(&colour);
            }
        };
        // Beyond the picture nothing is painted.
        let (end_x, end_y) = (right.min(8192), bottom.min(8192));
        for depth in 0..thickness.min(width.div_ceil(2)).min(height.div_ceil(2)) {
            for along in (x..end_x).filter(|along| ((along - x) / DASH_PX).is_multiple_of(2)) {
                paint(along, y + depth);
                paint(along, bottom - 1 - depth);
            }
            for along in (y..end_y).filter(|along| ((along - y) / DASH_PX).is_multiple_of(2)) {
                paint(x + depth, along);
                paint(right - 1 - depth, along);
            }
        }
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, bounds: [i32; 4], colour: Colour) {
        let [x, y, width, height] = bounds;
        let size = Size::new(width.max(0) as u32, height.max(0) as u32);
        let style = PrimitiveStyle::with_fill(rgb(colour));
        never_fails(Rectangle::new(Point::new(x, y), size).into_styled(style).draw(self));
    }

    /// Draws a line.
    pub fn line(&mut self, from: (i32, i32), to: (i32, i32), colour: Colour, thickness: u32) {
        let style = PrimitiveStyle::with_stroke(rgb(colour), thickness);
        never_fails(Line::new(from.into(), to.into()).into_styled(style).draw(self));
    }

    /// Draws text with its upper left corner at (`x`, `y`), on a dark background for readability. The font has
    /// ASCII only; "±" is written as "+-".
    pub fn text(&mut self, text: &str, x: i32, y: i32, colour: Colour) {
        let text = text.replace('±', "+-");
        let font = &ascii::FONT_7X13_BOLD;
        let width = text.chars().count() as i32 * font.character_size.width as i32;
        self.fill([x - 1, y, width + 2, font.character_size.height as i32], [0, 0, 0]);
        let style = MonoTextStyle::new(font, rgb(colour));
        never_fails(Text::with_baseline(&text, Point::new(x, y), style, Baseline::Top).draw(self));
    }

    /// Saves the image as PNG with fast compression.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), PictureError> {
        save_png(path, &self.data, self.width, self.height, ExtendedColorType::Rgb8)
    }
}

/// Quality of JPEG files, in percent.
const JPEG_QUALITY: u8 = 90;

/// The format of a picture, by the ending of its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// `.png`, or none.
    Png,
    /// `.jpg` or `.jpeg`.
    Jpeg,
}

/// The format in which a picture is written; `is_map` if it has 16 bits. Commands check it before they work.
///
/// # Errors
/// If it is neither PNG nor JPEG, or a JPEG of a map.
pub fn check_ending(path: &Path, is_map: bool) -> Result<Ending, PictureError> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let fail = |reason: &str| Err(PictureError { path: path.to_owned(), reason: reason.to_owned() });
    match (&ending[..], is_map) {
        ("png" | "", _) => Ok(Ending::Png),
        ("jpg" | "jpeg", false) => Ok(Ending::Jpeg),
        ("jpg" | "jpeg", true) => {
            fail("a disparity map has 16 bits, which JPEG does not hold: name a .png file")
        }
        (_, true) => fail("disparity maps are written as PNG: name a .png file"),
        (_, false) => fail("pictures are written as PNG or JPEG: name a .png or .jpg file"),
    }
}

fn save_png(
    path: &Path,
    data: &[u8],
    width: usize,
    height: usize,
    colour: ExtendedColorType,
) -> Result<(), PictureError> {
    let fail = |reason: String| PictureError { path: path.to_owned(), reason };
    let is_jpeg = check_ending(path, colour == ExtendedColorType::L16)? == Ending::Jpeg;
    // Written to a temporary file and renamed: the process may be killed while writing.
    let part = path.with_extension("part");
    let file = BufWriter::new(File::create(&part).map_err(|e| fail(e.to_string()))?);
    let (w, h) = (width as u32, height as u32);
    let written = if is_jpeg {
        JpegEncoder::new_with_quality(file, JPEG_QUALITY).write_image(data, w, h, colour)
    } else {
        PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Up)
            .write_image(data, w, h, colour)
    };
    written.map_err(|e| fail(e.to_string()))?;
    std::fs::rename(&part, path).map_err(|e| fail(e.to_string()))
}

/// Saves a disparity map (1/256 px, 0 = unknown) as 16-bit PNG in KITTI's format.
///
/// # Errors
/// When the file cannot be written.
pub fn save_disparity(
    path: &Path,
    disparity: &[u16],
    width: usize,
    height: usize,
) -> Result<(), PictureError> {
    // The encoder expects native byte order.
    let bytes: Vec<u8> = disparity.iter().flat_map(|d| d.to_ne_bytes()).collect();
    save_png(path, &bytes, width, height, ExtendedColorType::L16)
}

/// Saves an 8-bit grey image as PNG.
///
/// # Errors
/// When the file cannot be written.
pub fn save_grey(path: &Path, grey: &[u8], width: usize, height: usize) -> Result<(), PictureError> {
    save_png(path, grey, width, height, ExtendedColorType::L8)
}

fn rgb([r, g, b]: Colour) -> Rgb888 {
    Rgb888::new(r, g, b)
}

fn never_fails<T>(result: Result<T, Infallible>) {
    match result {
        Ok(_) => {}
        Err(never) => match never {},
    }
}

impl OriginDimensions for Picture {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Picture {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, colour) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) {
                self.tint(x, y, [colour.r(), colour.g(), colour.b()], 256);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawing_is_clipped_to_the_picture() {
        let mut picture = Picture::new(20, 10, [10, 10, 10]);
        picture.frame([15, 5, 50, 50], [255, 0, 0], 2);
        assert_eq!(picture.at(15, 7), [255, 0, 0]);
        assert_eq!(picture.at(16, 9), [255, 0, 0]);
        assert_eq!(picture.at(14, 7), [10, 10, 10]);
        picture.text("far outside ±", -30, -5, [0, 255, 0]);
        picture.line((-5, -5), (40, 40), [0, 0, 255], 1);
        picture.tint(0, 0, [110, 110, 110], 128);
        assert_eq!(picture.at(9, 9), [0, 0, 255]);
    }

    #[test]
    fn a_saved_disparity_map_is_read_back_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.png");
        let map: Vec<u16> = (0..12).map(|i| i * 5001).collect();
        save_disparity(&path, &map, 4, 3).unwrap();
        let image = image::open(&path).unwrap();
        assert_eq!(image.color(), image::ColorType::L16);
        assert_eq!(image.into_luma16().into_raw(), map);
        let error = save_disparity(&folder.path().join("no/such/d.png"), &map, 4, 3).unwrap_err();
        assert!(error.to_string().contains("no/such/d.png"));
    }
}
