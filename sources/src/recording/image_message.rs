//! From an image message to grey pixels, and from a calibration to its projection.

use super::cdr::Cdr;
use super::index::Channel;
use super::protobuf::Decoder;
use crate::folder;
use image::ImageReader;
use std::io::Cursor;

/// What a message type means here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An image as it is.
    Raw,
    /// A PNG or JPEG file.
    Compressed,
    /// A camera's projection.
    Calibration,
}

/// What the messages of a topic are; `None` for all that is no image or calibration.
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

/// An image as it lies in its message.
#[derive(Default)]
struct Raw<'a> {
    width: usize,
    height: usize,
    encoding: &'a str,
    step: usize,
    data: &'a [u8],
}

/// Grey pixels, width and height of an image message.
///
/// # Errors
/// In words, what is wrong with it.
pub fn grey(channel: &Channel, message: &[u8]) -> Result<(Vec<u8>, usize, usize), String> {
    if kind(channel) == Some(Kind::Compressed) {
        let file = if channel.encoding == "cdr" {
            cdr_compressed(message).ok_or("the message is cut off or no plain CDR")?
        } else {
            protobuf_field(message, 2)?
        };
        let reader = ImageReader::new(Cursor::new(file)).with_guessed_format().map_err(|e| e.to_string())?;
        return Ok(folder::grey_of(folder::decode(reader).map_err(|e| e.to_string())?));
    }
    let raw = if channel.encoding == "cdr" {
        cdr_image(message).ok_or("the message is cut off or no plain CDR")?
    } else {
        protobuf_image(message)?
    };
    to_grey(&raw)
}

fn protobuf_field(message: &[u8], wanted: u32) -> Result<&[u8], String> {
    for field in Decoder::new(message) {
        let (number, value) = field.map_err(|e| e.to_string())?;
        if number == wanted {
            return Ok(value.as_bytes());
        }
    }
    Err("the message holds no image".into())
}

fn protobuf_image(message: &[u8]) -> Result<Raw<'_>, String> {
    let mut raw = Raw::default();
    for field in Decoder::new(message) {
        let (number, value) = field.map_err(|e| e.to_string())?;
        match number {
            2 => raw.width = value.as_number() as usize,
            3 => raw.height = value.as_number() as usize,
            4 => raw.encoding = value.as_text(),
            5 => raw.step = value.as_number() as usize,
            6 => raw.data = value.as_bytes(),
            _ => {}
        }
    }
    Ok(raw)
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
    // Places of red, green and blue in a pixel.
    let (bytes, rgb) = match raw.encoding {
        "mono8" | "8UC1" => (1, None),
        "rgb8" => (3, Some([0, 1, 2])),
        "bgr8" | "8UC3" => (3, Some([2, 1, 0])),
        "rgba8" => (4, Some([0, 1, 2])),
        "bgra8" => (4, Some([2, 1, 0])),
        other => {
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

/// The 3 × 4 projection of a calibration message, row after row.
pub fn projection(channel: &Channel, message: &[u8]) -> Option<[f64; 12]> {
    if channel.encoding == "cdr" {
        let mut cdr = Cdr::new(message)?;
        cdr.header()?;
        // Height and width.
        cdr.u32()?;
        cdr.u32()?;
        cdr.text()?;
        let coefficients = cdr.u32()?;
        for _ in 0..coefficients {
            cdr.f64()?;
        }
        for _ in 0..18 {
            cdr.f64()?;
        }
        let mut p = [0.0; 12];
        for value in &mut p {
            *value = cdr.f64()?;
        }
        return Some(p);
    }
    let fields = Decoder::new(message).flatten();
    fields.filter(|(number, _)| *number == 8).find_map(|(_, value)| value.as_doubles().try_into().ok())
}
