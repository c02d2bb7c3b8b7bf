//! Conversion of image messages to grey pixels, and of calibration messages to projection matrices.

use super::cdr::Cdr;
use super::foxglove::{self, CameraCalibration, CompressedImage, RawImage};
use super::index::Channel;
use crate::bayer::Bayer;
use crate::luma::luma;
use crate::picture::{self, Decoded};
use perception::excerpt::{VALUE_CHARS, excerpt};
use prost::bytes::Bytes;

/// The message types that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An uncompressed image.
    Raw,
    /// A PNG or JPEG file.
    Compressed,
    /// Calibration of a camera.
    Calibration,
}

/// The kind of a topic's messages; `None` if they are neither images nor calibrations.
pub fn kind(channel: &Channel) -> Option<Kind> {
    Some(match (channel.encoding.as_str(), channel.schema.as_str()) {
        ("protobuf", "foxglove.RawImage") | ("cdr", "sensor_msgs/msg/Image") => Kind::Raw,
        ("protobuf", "foxglove.CompressedImage") | ("cdr", "sensor_msgs/msg/CompressedImage") => {
            Kind::Compressed
        }
        ("protobuf", "foxglove.CameraCalibration") | ("cdr", "sensor_msgs/msg/CameraInfo") => {
            Kind::Calibration
        }
        _ => return None,
    })
}

/// An uncompressed image: `height` rows of `width` pixels, `step` bytes from one row to the next.
struct Raw<'a> {
    width: usize,
    height: usize,
    encoding: &'a str,
    step: usize,
    /// Words of two bytes have the high one first.
    is_big: bool,
    data: &'a [u8],
}

/// Error of a CDR message that cannot be read.
const NOT_CDR: &str = "the message is cut off or not plain CDR";

/// The image of a message, and the colour filter that its encoding names.
///
/// # Errors
/// If the message or its image cannot be decoded: the reason.
pub fn picture(channel: &Channel, message: &Bytes) -> Result<(Decoded, Option<Bayer>), String> {
    if kind(channel) == Some(Kind::Compressed) {
        if channel.encoding == "cdr" {
            return decode_file(cdr_compressed(message).ok_or(NOT_CDR)?);
        }
        let image: CompressedImage = foxglove::decode(message)?;
        return decode_file(&image.data);
    }
    if channel.encoding == "cdr" {
        return decoded(&cdr_image(message).ok_or(NOT_CDR)?);
    }
    let image: RawImage = foxglove::decode(message)?;
    decoded(&Raw {
        width: image.width as usize,
        height: image.height as usize,
        encoding: &image.encoding,
        step: image.step as usize,
        is_big: false,
        data: &image.data,
    })
}

fn decode_file(file: &[u8]) -> Result<(Decoded, Option<Bayer>), String> {
    if file.is_empty() {
        return Err("the message holds no image".into());
    }
    let reader = picture::in_memory(file).with_guessed_format().map_err(|e| e.to_string())?;
    Ok((Decoded::of(picture::decode(reader).map_err(|e| e.to_string())?), None))
}

fn cdr_image(message: &[u8]) -> Option<Raw<'_>> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    let (height, width) = (cdr.u32()? as usize, cdr.u32()? as usize);
    let encoding = cdr.text()?;
    let is_big = cdr.u8()? != 0;
    let step = cdr.u32()? as usize;
    Some(Raw { width, height, encoding, step, is_big, data: cdr.bytes()? })
}

fn cdr_compressed(message: &[u8]) -> Option<&[u8]> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    cdr.text()?;
    cdr.bytes()
}

/// How the pixels of an encoding lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pixels {
    /// Grey or a colour filter, one byte each.
    Byte,
    /// Grey or a colour filter, two bytes each, the high one first if so.
    Word { is_big: bool },
    /// So many bytes, with the offsets of red, green and blue.
    Colour(usize, [usize; 3]),
}

/// Encodings that can be read, for an error.
const ENCODINGS: &str = "mono8, mono16, rgb8, bgr8, rgba8, bgra8 and bayer_rggb8 (bggr, gbrg, grbg; 8 or 16)";

/// The pixels of an encoding and its colour filter.
fn pixels(encoding: &str, is_big: bool) -> Option<(Pixels, Option<Bayer>)> {
    if let Some(pattern) = encoding.strip_prefix("bayer_") {
        let (pattern, bits) = pattern.split_at_checked(4)?;
        let pixels = match bits {
            "8" => Pixels::Byte,
            "16" => Pixels::Word { is_big },
            _ => return None,
        };
        return Bayer::named(pattern).map(|bayer| (pixels, Some(bayer)));
    }
    let pixels = match encoding {
        "mono8" | "8UC1" => Pixels::Byte,
        "mono16" | "16UC1" => Pixels::Word { is_big },
        "rgb8" => Pixels::Colour(3, [0, 1, 2]),
        "bgr8" | "8UC3" => Pixels::Colour(3, [2, 1, 0]),
        "rgba8" => Pixels::Colour(4, [0, 1, 2]),
        "bgra8" => Pixels::Colour(4, [2, 1, 0]),
        _ => return None,
    };
    Some((pixels, None))
}

fn decoded(raw: &Raw<'_>) -> Result<(Decoded, Option<Bayer>), String> {
    let (pixels, bayer) = pixels(raw.encoding, raw.is_big).ok_or_else(|| {
        format!("pixels are \"{}\"; {ENCODINGS} can be read", excerpt(raw.encoding, VALUE_CHARS))
    })?;
    let bytes = match pixels {
        Pixels::Byte => 1,
        Pixels::Word { .. } => 2,
        Pixels::Colour(bytes, _) => bytes,
    };
    let row = raw.width.checked_mul(bytes).filter(|&row| row > 0 && raw.height > 0);
    let row = row.ok_or_else(|| format!("an image of {}x{} pixels", raw.width, raw.height))?;
    let step = if raw.step == 0 { row } else { raw.step };
    let needed = (raw.height - 1).checked_mul(step).and_then(|n| n.checked_add(row));
    if step < row || needed.is_none_or(|needed| needed > raw.data.len()) {
        return Err(format!("{} bytes are too few for {}x{} pixels", raw.data.len(), raw.width, raw.height));
    }
    let rows = raw.data.chunks(step).take(raw.height).map(|line| &line[..row]);
    let (width, height) = (raw.width, raw.height);
    let decoded = match pixels {
        Pixels::Byte => Decoded::of_bytes(rows.flatten().copied().collect(), width, height),
        Pixels::Colour(bytes, at) => {
            let grey = rows.flat_map(|line| line.chunks_exact(bytes).map(|p| luma(&at.map(|i| p[i]))));
            Decoded::of_bytes(grey.collect(), width, height)
        }
        Pixels::Word { is_big } => {
            let word = |p: &[u8]| {
                if is_big { u16::from_be_bytes([p[0], p[1]]) } else { u16::from_le_bytes([p[0], p[1]]) }
            };
            Decoded::of_words(rows.flat_map(|line| line.chunks_exact(2).map(word)).collect(), width, height)
        }
    };
    Ok((decoded, bayer))
}

/// What a calibration message says of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMessage {
    /// Width and height of its pictures, in pixels; 0 if the message does not say.
    pub size: (u32, u32),
    /// Whether its pictures differ from rectified ones: it has a distortion, or a rectifying rotation.
    pub is_distorted: bool,
    /// The 3 × 4 projection matrix after rectification, in row-major order.
    pub projection: [f64; 12],
}

/// Largest distortion coefficient, and largest difference of a rotation matrix from the identity, of pictures that count
/// as rectified: less than a tenth of a pixel at the border of a picture.
const MAX_RECTIFIED: f64 = 1e-4;

/// The name of the model of fisheye lenses, which bends straight lines with coefficients of 0, too.
const EQUIDISTANT: &str = "equidistant";

/// Reads a calibration message; `None` if it cannot be decoded or has no projection matrix.
pub fn camera_message(channel: &Channel, message: &Bytes) -> Option<CameraMessage> {
    /// The rotation that changes nothing. ROS writes zeros where there is none.
    const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let is_bent = |d: &f64| d.abs() > MAX_RECTIFIED;
    let turns = |r: &[f64]| {
        let is_set = r.iter().any(|v| *v != 0.0);
        is_set && r.iter().zip(IDENTITY).any(|(v, one)| (v - one).abs() > MAX_RECTIFIED)
    };
    if channel.encoding == "cdr" {
        let mut cdr = Cdr::new(message)?;
        cdr.header()?;
        let (height, width) = (cdr.u32()?, cdr.u32()?);
        let mut is_distorted = cdr.text()? == EQUIDISTANT;
        let coefficients = cdr.u32()?;
        for _ in 0..coefficients {
            is_distorted |= is_bent(&cdr.f64()?);
        }
        // K is skipped.
        for _ in 0..9 {
            cdr.f64()?;
        }
        let mut r = [0.0; 9];
        for value in &mut r {
            *value = cdr.f64()?;
        }
        let mut projection = [0.0; 12];
        for value in &mut projection {
            *value = cdr.f64()?;
        }
        let is_distorted = is_distorted || turns(&r);
        return Some(CameraMessage { size: (width, height), is_distorted, projection });
    }
    let calibration: CameraCalibration = foxglove::decode(message).ok()?;
    let is_fisheye = calibration.distortion_model == EQUIDISTANT;
    let is_distorted = is_fisheye || calibration.d.iter().any(is_bent) || turns(&calibration.r);
    let size = (calibration.width, calibration.height);
    Some(CameraMessage { size, is_distorted, projection: calibration.p.try_into().ok()? })
}
