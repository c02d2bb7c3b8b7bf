//! Decodes image files to 8-bit grey: colour, 16-bit pictures of any depth, and Bayer patterns.
//!
//! 16-bit files often hold the 10, 12 or 14 bits of a sensor in the low bits. Their depth is the smallest of
//! [`DEPTHS`] that holds the largest value found; the whole depth is then scaled to 8 bits.

use crate::SourceError;
use crate::bayer::Bayer;
use crate::limits::{MAX_PICTURE_BYTES, MAX_SIDE_PX, PICTURE};
use crate::luma::{luma, luma16};
use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageReader, Limits};
use perception::excerpt::{REASON_CHARS, excerpt};
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

/// Endings of the files that are taken for pictures, in lower case.
pub const ENDINGS: [&str; 12] =
    ["png", "pgm", "ppm", "pnm", "pbm", "pam", "jpg", "jpeg", "tif", "tiff", "bmp", "webp"];

/// Depths of sensors, in bits.
pub const DEPTHS: [u8; 5] = [8, 10, 12, 14, 16];

/// How the values of a picture become grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interpretation {
    /// Bits that 16-bit pictures use, one of 8 to 16; `None` finds it in the picture.
    pub bits: Option<u8>,
    /// Colour filter over the pixels; `None` for grey and colour pictures.
    pub bayer: Option<Bayer>,
}

/// Grey values of a picture as its file has them.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Samples {
    Byte(Vec<u8>),
    Word(Vec<u16>),
}

/// A decoded picture, before its values are scaled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decoded {
    samples: Samples,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

impl Decoded {
    /// Decodes a file.
    ///
    /// # Errors
    /// When the file cannot be read or decoded.
    pub fn read(path: &Path) -> Result<Self, SourceError> {
        Ok(Self::of(read(path)?))
    }

    /// Grey values of an image.
    pub(crate) fn of(image: DynamicImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let samples = match image {
            DynamicImage::ImageLuma8(grey) => Samples::Byte(grey.into_raw()),
            DynamicImage::ImageLuma16(grey) => Samples::Word(grey.into_raw()),
            other if is_deep(other.color()) && other.color().has_color() => {
                Samples::Word(other.into_rgb16().as_raw().chunks_exact(3).map(luma16).collect())
            }
            other if is_deep(other.color()) => Samples::Word(other.into_luma16().into_raw()),
            other if !other.color().has_color() => Samples::Byte(other.into_luma8().into_raw()),
            colour => Samples::Byte(colour.into_rgb8().as_raw().chunks_exact(3).map(luma).collect()),
        };
        Self { samples, width, height }
    }

    /// 16-bit grey values, row-major.
    pub(crate) fn of_words(words: Vec<u16>, width: usize, height: usize) -> Self {
        Self { samples: Samples::Word(words), width, height }
    }

    /// 8-bit grey values, row-major.
    pub(crate) fn of_bytes(bytes: Vec<u8>, width: usize, height: usize) -> Self {
        Self { samples: Samples::Byte(bytes), width, height }
    }

    /// Bits that the values need, one of [`DEPTHS`]; `None` for an 8-bit picture.
    ///
    /// Values that were moved up, so that their low bits are zero, and bytes that were doubled have all 16 bits.
    pub fn bits(&self) -> Option<u8> {
        /// Zero bits at the low end of all values from which they count as moved up: a sensor's own values have none.
        const MOVED_BITS: u32 = 2;
        /// What a byte is multiplied by if 255 shall become 65535.
        const DOUBLED: u16 = 257;
        let Samples::Word(words) = &self.samples else { return None };
        let (largest, any) = words.iter().fold((0, 0), |(largest, any), &v| (v.max(largest), any | v));
        let is_moved = largest > 255 && any.trailing_zeros() >= MOVED_BITS;
        if is_moved || largest > 0 && words.iter().all(|v| v % DOUBLED == 0) {
            return Some(16);
        }
        DEPTHS.into_iter().find(|bits| u32::from(largest) < 1 << bits)
    }

    /// 8-bit grey levels, row-major.
    pub fn grey(self, how: Interpretation) -> Vec<u8> {
        let bits = how.bits.or(self.bits()).unwrap_or(8);
        let bytes = match self.samples {
            Samples::Byte(bytes) => bytes,
            Samples::Word(words) => {
                let full = (1_u32 << bits) - 1;
                words.into_iter().map(|v| ((u32::from(v).min(full) * 255 + full / 2) / full) as u8).collect()
            }
        };
        match how.bayer {
            Some(bayer) => bayer.grey(&bytes, self.width, self.height),
            None => bytes,
        }
    }
}

/// What the user should know of 16-bit pictures whose depth was found.
pub fn scaled_note(path: &Path, bits: u8) -> String {
    format!(
        "{}: 16-bit pictures are scaled from {bits} bits to 8; source.bits sets another depth",
        path.display()
    )
}

/// Whether an image has more than 8 integer bits a channel.
fn is_deep(colour: ColorType) -> bool {
    matches!(colour, ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16)
}

/// Decodes an image to grey. Returns its pixels, width and height.
///
/// # Errors
/// When the file cannot be read or decoded.
pub fn read_grey(path: &Path) -> Result<(Vec<u8>, usize, usize), SourceError> {
    let decoded = Decoded::read(path)?;
    let (width, height) = (decoded.width, decoded.height);
    Ok((decoded.grey(Interpretation::default()), width, height))
}

/// Reads an image file as it is stored.
///
/// # Errors
/// When the file cannot be read or decoded.
pub fn read(path: &Path) -> Result<DynamicImage, SourceError> {
    let io = |source| SourceError::Io { path: path.to_owned(), source };
    decode(open(path).map_err(io)?).map_err(|e| undecoded(path, &e))
}

/// Where the bytes of an image come from. One type for all: the decoders are compiled for each type that they read.
pub(crate) trait Stream: BufRead + Seek {}
impl<T: BufRead + Seek> Stream for T {}

/// A decoder of an image that is being read.
pub(crate) type Reader<'a> = ImageReader<Box<dyn Stream + 'a>>;

/// Reads an image in memory.
pub(crate) fn in_memory(file: &[u8]) -> Reader<'_> {
    ImageReader::new(Box::new(Cursor::new(file)))
}

/// Opens an image file within the limit of its size: some decoders read the whole file into memory.
fn open(path: &Path) -> std::io::Result<Reader<'static>> {
    let file = File::open(path)?;
    let about = file.metadata()?;
    if !about.is_file() {
        return Err(std::io::Error::other("not a regular file; give an image file"));
    }
    PICTURE.check(about.len())?;
    Reader::new(Box::new(BufReader::new(file))).with_guessed_format()
}

/// Decodes with limits above any camera's image size: a damaged header must not exhaust the memory.
pub(crate) fn decode(mut reader: Reader) -> Result<DynamicImage, ImageError> {
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE_PX), Some(MAX_SIDE_PX));
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let image = reader.decode()?;
    some_pixels(image.width(), image.height())?;
    Ok(image)
}

/// A PNM may have a side of 0.
fn some_pixels(width: u32, height: u32) -> Result<(), ImageError> {
    if width > 0 && height > 0 {
        return Ok(());
    }
    let reason = format!("an image of {width}x{height} pixels");
    Err(ImageError::Decoding(DecodingError::new(ImageFormatHint::Unknown, reason)))
}

/// Grey pixels, width and height of an image.
pub(crate) fn grey_of(image: DynamicImage) -> (Vec<u8>, usize, usize) {
    let decoded = Decoded::of(image);
    let (width, height) = (decoded.width, decoded.height);
    (decoded.grey(Interpretation::default()), width, height)
}

/// The error of a file that is no picture, or a damaged one.
fn undecoded(path: &Path, error: &ImageError) -> SourceError {
    // A decoder may repeat what it found in a header.
    let reason = excerpt(&error.to_string(), REASON_CHARS).into_owned();
    SourceError::Decode { path: path.to_owned(), reason }
}

/// What the header of a picture says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// More than 8 bits a channel.
    pub is_deep: bool,
    /// Several channels of colour.
    pub has_colour: bool,
}

/// Reads the header of a picture.
pub(crate) fn header(path: &Path) -> Result<Header, SourceError> {
    let io = |source| SourceError::Io { path: path.to_owned(), source };
    let decoder = open(path).map_err(io)?.into_decoder().map_err(|e| undecoded(path, &e))?;
    let ((width, height), colour) = (decoder.dimensions(), decoder.color_type());
    some_pixels(width, height).map_err(|e| undecoded(path, &e))?;
    let size = (width as usize, height as usize);
    Ok(Header { size, is_deep: is_deep(colour), has_colour: colour.has_color() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, Luma, RgbImage};
    use std::path::PathBuf;

    fn saved(folder: &tempfile::TempDir, name: &str, image: DynamicImage) -> PathBuf {
        let path = folder.path().join(name);
        image.save(&path).unwrap();
        path
    }

    fn deep(values: &[u16], width: u32) -> DynamicImage {
        let height = values.len() as u32 / width;
        ImageBuffer::<Luma<u16>, _>::from_raw(width, height, values.to_vec()).unwrap().into()
    }

    #[test]
    fn colour_becomes_grey_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["c.png", "c.tif", "c.bmp", "c.webp"] {
            let path = saved(&folder, name, RgbImage::from_pixel(3, 2, [10, 200, 30].into()).into());
            assert_eq!(read_grey(&path).unwrap(), (vec![124; 6], 3, 2), "{name}");
        }
    }

    #[test]
    fn grey_pictures_of_each_format_keep_their_values() {
        let folder = tempfile::tempdir().unwrap();
        let grey = GrayImage::from_fn(5, 4, |x, y| [(40 * x + y) as u8].into());
        for name in ["g.png", "g.pgm", "g.tiff", "g.bmp"] {
            let path = saved(&folder, name, grey.clone().into());
            assert_eq!(read_grey(&path).unwrap(), (grey.as_raw().clone(), 5, 4), "{name}");
        }
    }

    #[test]
    fn sixteen_bit_files_are_scaled_by_the_depth_that_they_use() {
        let folder = tempfile::tempdir().unwrap();
        for (largest, bits) in
            [(0, 8), (255, 8), (257, 10), (1023, 10), (4095, 12), (4097, 14), (16_383, 14), (65_535, 16)]
        {
            let image = deep(&[0, largest / 3, largest, 0], 2);
            for name in ["d.png", "d.tif"] {
                let decoded = Decoded::read(&saved(&folder, name, image.clone())).unwrap();
                assert_eq!(decoded.bits(), Some(bits), "{largest}");
                let full = (1_u32 << bits) - 1;
                let expected = ((u32::from(largest) * 255) as f64 / f64::from(full)).round() as u8;
                assert_eq!(decoded.grey(Interpretation::default())[2], expected, "{largest} in {bits} bits");
            }
        }
        // Twelve bits moved up, and bytes doubled, both of a dark picture.
        for values in [[0, 16, 4080, 320], [0, 257, 5140, 514]] {
            assert_eq!(Decoded::of(deep(&values, 2)).bits(), Some(16), "{values:?}");
        }
        // A depth that is set: what is beyond it saturates.
        let decoded = Decoded::of(deep(&[0, 2048, 4095, 60_000], 2));
        let how = Interpretation { bits: Some(12), bayer: None };
        assert_eq!(decoded.grey(how), [0, 128, 255, 255]);
    }

    #[test]
    fn damaged_files_of_every_format_are_refused_or_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut random = fastrand::Rng::with_seed(1);
        let grey: DynamicImage = GrayImage::from_fn(23, 17, |x, y| [(x * y) as u8].into()).into();
        for (name, image) in [
            ("g.tif", grey.clone()),
            ("d.tif", deep(&[7; 12], 4)),
            ("c.tif", grey.to_rgb8().into()),
            ("g.bmp", grey.clone()),
            ("c.bmp", grey.to_rgb8().into()),
            ("c.webp", grey.to_rgb8().into()),
            ("g.pgm", grey.clone()),
        ] {
            let path = saved(&folder, name, image);
            let whole = std::fs::read(&path).unwrap();
            for round in 0..400 {
                let mut bytes = whole.clone();
                for _ in 0..=random.usize(0..4) {
                    let at = random.usize(0..bytes.len());
                    bytes[at] = if random.bool() {
                        random.u8(..)
                    } else {
                        [0, 1, 0x7f, 0x80, 0xff][random.usize(0..5)]
                    };
                }
                if round % 4 == 0 {
                    bytes.truncate(random.usize(0..whole.len()));
                }
                std::fs::write(&path, &bytes).unwrap();
                let (head, read) = (header(&path), read_grey(&path));
                if let (Ok(head), Ok((pixels, width, height))) = (head, read) {
                    assert_eq!((pixels.len(), head.size), (width * height, (width, height)), "{name}");
                }
            }
        }
    }

    #[test]
    fn a_header_says_what_a_picture_holds() {
        let folder = tempfile::tempdir().unwrap();
        let path = saved(&folder, "d.png", deep(&[1; 6], 3));
        assert_eq!(header(&path).unwrap(), Header { size: (3, 2), is_deep: true, has_colour: false });
        let path = saved(&folder, "c.bmp", RgbImage::new(4, 1).into());
        assert_eq!(header(&path).unwrap(), Header { size: (4, 1), is_deep: false, has_colour: true });
    }
}
