//! Conversion of image messages to grey pixels, and of calibration messages to projection matrices.

use super::cdr::Cdr;
use super::foxglove::{self, CameraCalibration, CompressedImage, RawImage};
use super::index::Channel;
use crate::folder;
use image::ImageReader;
use perception::excerpt::{VALUE_CHARS, excerpt};
use prost::bytes::Bytes;
use std::io::Cursor;

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
    data: &'a [u8],
}

/// Error of a CDR message that cannot be read.
const NOT_CDR: &str = "the message is cut off or not plain CDR";

/// Grey pixels, width and height of an image message.
///
/// # Errors
/// If the message or its image cannot be decoded: the reason.
pub fn grey(channel: &Channel, message: &Bytes) -> Result<(Vec<u8>, usize, usize), String> {
    if kind(channel) == Some(Kind::Compressed) {
        if channel.encoding == "cdr" {
            return decode_file(cdr_compressed(message).ok_or(NOT_CDR)?);
        }
        let image: CompressedImage = foxglove::decode(message)?;
        return decode_file(&image.data);
    }
    if channel.encoding == "cdr" {
        return to_grey(&cdr_image(message).ok_or(NOT_CDR)?);
    }
    let image: RawImage = foxglove::decode(message)?;
    to_grey(&Raw {
        width: image.width as usize,
        height: image.height as usize,
        encoding: &image.encoding,
        step: image.step as usize,
        data: &image.data,
    })
}

fn decode_file(file: &[u8]) -> Result<(Vec<u8>, usize, usize), String> {
    if file.is_empty() {
        return Err("the message holds no image".into());
    }
    let reader = ImageReader::new(Cursor::new(file)).with_guessed_format().map_err(|e| e.to_string())?;
    Ok(folder::grey_of(folder::decode(reader).map_err(|e| e.to_string())?))
}

fn cdr_image(message: &[u8]) -> Option<Raw<'_>> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    let (height, width) = (cdr.u32()? as usize, cdr.u32()? as usize);
    let encoding = cdr.text()?;
    cdr.u8()?;
    let step = cdr.u32()? as usize;
    Some(Raw { width, height, encoding, step, data: cdr.bytes()? })
}

fn cdr_compressed(message: &[u8]) -> Option<&[u8]> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    cdr.text()?;
    cdr.bytes()
}

fn to_grey(raw: &Raw<'_>) -> Result<(Vec<u8>, usize, usize), String> {
    // Bytes of a pixel, and the offsets of red, green and blue in it.
    let (bytes, rgb) = match raw.encoding {
        "mono8" | "8UC1" => (1, None),
        "rgb8" => (3, Some([0, 1, 2])),
        "bgr8" | "8UC3" => (3, Some([2, 1, 0])),
        "rgba8" => (4, Some([0, 1, 2])),
        "bgra8" => (4, Some([2, 1, 0])),
        other => {
            let other = excerpt(other, VALUE_CHARS);
            return Err(format!("pixels are \"{other}\"; mono8, rgb8, bgr8, rgba8 and bgra8 can be read"));
        }
    };
    let row = raw.width.checked_mul(bytes).filter(|&row| row > 0 && raw.height > 0);
    let row = row.ok_or_else(|| format!("an image of {}x{} pixels", raw.width, raw.height))?;
    let step = if raw.step == 0 { row } else { raw.step };
    let needed = (raw.height - 1).checked_mul(step).and_then(|n| n.checked_add(row));
    if step < row || needed.is_none_or(|needed| needed > raw.data.len()) {
        return Err(format!("{} bytes are too few for {}x{} pixels", raw.data.len(), raw.width, raw.height));
    }
    let mut grey = Vec::with_capacity(raw.width * raw.height);
    for line in raw.data.chunks(step).take(raw.height) {
        match rgb {
            None => grey.extend_from_slice(&line[..row]),
            Some(at) => {
                grey.extend(line[..row].chunks_exact(bytes).map(|p| folder::luma(&at.map(|i| p[i]))));
            }
        }
    }
    Ok((grey, raw.width, raw.height))
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
        // The distortion model.
        cdr.text()?;
        let coefficients = cdr.u32()?;
        let mut is_distorted = false;
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
    let is_distorted = calibration.d.iter().any(is_bent) || turns(&calibration.r);
    let size = (calibration.width, calibration.height);
    Some(CameraMessage { size, is_distorted, projection: calibration.p.try_into().ok()? })
}
