//! Messages of a recording, encoded.
//!
//! Frames of reference: `camera_left` and `camera_right` as cameras have them (x right, y down, z along
//! the view, in metres), `vehicle` with x forward, y left, z up.

use super::topic::{ImageForm, Message, Topic};
use crate::reporting::record::{FrameRecord, ObstacleLine};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};
use perception::rig::Rig;
use serde::Serialize;
use sources::recording::foxglove::{four, place, time, vector};
use sources::recording::protobuf::Encoder;

/// Quality of JPEG images, of 100.
const JPEG_QUALITY: u8 = 80;

/// Boxes have no depth of their own: this much, in metres.
const BOX_DEPTH_M: f64 = 0.4;

/// Turns the axes of a camera into those of a vehicle: x, y, z, w.
const CAMERA_TO_VEHICLE: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];

/// Which camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

impl Side {
    fn frame(self) -> &'static str {
        match self {
            Self::Left => "camera_left",
            Self::Right => "camera_right",
        }
    }
}

/// A frame's number and its time since 1970, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Number.
    pub sequence: u64,
    /// Time.
    pub time_ns: u64,
}

impl Stamp {
    fn message(self, topic: Topic, data: Vec<u8>) -> Message {
        Message { topic, sequence: self.sequence as u32, time_ns: self.time_ns, data }
    }
}

/// An image of `width` × `height` grey bytes.
///
/// # Errors
/// When it cannot be compressed.
pub fn image(
    stamp: Stamp,
    side: Side,
    form: ImageForm,
    pixels: &[u8],
    (width, height): (u32, u32),
) -> Result<Message, ImageError> {
    let topic = if side == Side::Left { Topic::LeftImage } else { Topic::RightImage };
    let mut e = Encoder::with_capacity(pixels.len() + 96);
    time(&mut e, 1, stamp.time_ns);
    if form == ImageForm::Raw {
        e.text(7, side.frame()).fixed32(2, width).fixed32(3, height);
        e.text(4, "mono8").fixed32(5, width).bytes(6, pixels);
        return Ok(stamp.message(topic, e.into_bytes()));
    }
    let mut file = Vec::with_capacity(pixels.len() / 2);
    if form == ImageForm::Png {
        PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Up).write_image(
            pixels,
            width,
            height,
            ExtendedColorType::L8,
        )?;
    } else {
        JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY).write_image(
            pixels,
            width,
            height,
            ExtendedColorType::L8,
        )?;
    }
    e.text(4, side.frame()).bytes(2, &file).text(3, form.name());
    Ok(stamp.message(topic, e.into_bytes()))
}

/// Calibrations of both cameras, and where they are.
pub fn geometry(stamp: Stamp, rig: &Rig, (width, height): (u32, u32)) -> [Message; 4] {
    let f = rig.focal_px;
    let camera = |side: Side| {
        let shift = if side == Side::Left { 0.0 } else { -f * rig.baseline_m };
        let mut e = Encoder::default();
        time(&mut e, 1, stamp.time_ns);
        e.text(9, side.frame()).fixed32(2, width).fixed32(3, height).text(4, "plumb_bob");
        // The images are rectified.
        e.doubles(5, &[0.0; 5]);
        e.doubles(6, &[f, 0.0, rig.cx_px, 0.0, f, rig.cy_px, 0.0, 0.0, 1.0]);
        e.doubles(7, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        e.doubles(8, &[f, 0.0, rig.cx_px, shift, 0.0, f, rig.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let topic = if side == Side::Left { Topic::LeftCalibration } else { Topic::RightCalibration };
        stamp.message(topic, e.into_bytes())
    };
    let transform = |parent: &str, side: Side, translation: [f64; 3], rotation: [f64; 4]| {
        let mut e = Encoder::default();
        time(&mut e, 1, stamp.time_ns);
        e.text(2, parent).text(3, side.frame());
        vector(&mut e, 4, translation);
        four(&mut e, 5, rotation);
        stamp.message(Topic::Transform, e.into_bytes())
    };
    [
        camera(Side::Left),
        camera(Side::Right),
        transform("camera_left", Side::Right, [rig.baseline_m, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]),
        transform("vehicle", Side::Left, [0.0; 3], CAMERA_TO_VEHICLE),
    ]
}

/// Colour of an obstacle: red for what raised the alarm, amber for what is confirmed, grey else.
fn colour(record: &FrameRecord, o: &ObstacleLine, opacity: f64) -> [f64; 4] {
    if record.alarm.track == Some(o.track) && record.alarm.level == "alarm" {
        [0.9, 0.1, 0.1, opacity]
    } else if o.confirmed {
        [1.0, 0.7, 0.1, opacity]
    } else {
        [0.6, 0.6, 0.6, opacity]
    }
}

fn label(o: &ObstacleLine) -> String {
    match o.time_to_collision_s {
        Some(ttc) if o.confirmed => format!("{} {} {:.1} m {ttc:.1} s", o.class, o.track, o.distance_m),
        _ => format!("{} {} {:.1} m", o.class, o.track, o.distance_m),
    }
}

/// The obstacles as boxes in the left image.
pub fn annotations(stamp: Stamp, record: &FrameRecord) -> Message {
    let mut e = Encoder::default();
    time(&mut e, 5, stamp.time_ns);
    for o in &record.obstacles {
        let (x, y) = (f64::from(o.x_px), f64::from(o.y_px));
        let (right, bottom) = (x + f64::from(o.width_px), y + f64::from(o.height_px));
        let rgba = colour(record, o, 1.0);
        e.message(2, |p| {
            time(p, 1, stamp.time_ns);
            p.number(2, 2);
            for (x, y) in [(x, y), (right, y), (right, bottom), (x, bottom)] {
                p.message(3, |point| {
                    point.double(1, x).double(2, y);
                });
            }
            four(p, 4, rgba);
            p.double(7, if o.confirmed { 2.0 } else { 1.0 });
        });
        if o.confirmed {
            e.message(3, |t| {
                time(t, 1, stamp.time_ns);
                t.message(2, |point| {
                    point.double(1, x).double(2, y);
                });
                t.text(3, &label(o)).double(4, 12.0);
                four(t, 5, [1.0; 4]);
                four(t, 6, [0.0, 0.0, 0.0, 0.6]);
            });
        }
    }
    stamp.message(Topic::Annotations, e.into_bytes())
}

/// The obstacles as boxes in space; those of the frame before go.
pub fn scene(stamp: Stamp, record: &FrameRecord, rig: &Rig) -> Message {
    let mut e = Encoder::default();
    e.message(1, |d| {
        time(d, 1, stamp.time_ns);
        d.number(2, 1);
    });
    for o in &record.obstacles {
        let middle_row = f64::from(o.y_px) + 0.5 * f64::from(o.height_px);
        let y = (middle_row - rig.cy_px) * o.distance_m / rig.focal_px;
        let centre = [o.lateral_m, y, o.distance_m + 0.5 * BOX_DEPTH_M];
        e.message(2, |entity| {
            time(entity, 1, stamp.time_ns);
            entity.text(2, Side::Left.frame()).text(3, &o.track.to_string());
            for (key, value) in [("class", o.class.clone()), ("distance_m", format!("{:.2}", o.distance_m))] {
                entity.message(6, |pair| {
                    pair.text(1, key).text(2, &value);
                });
            }
            entity.message(8, |cube| {
                place(cube, 1, centre);
                vector(cube, 2, [o.width_m, o.height_m, BOX_DEPTH_M]);
                four(cube, 3, colour(record, o, 0.5));
            });
            if o.confirmed {
                entity.message(13, |text| {
                    place(text, 1, [centre[0], centre[1] - 0.5 * o.height_m - 0.3, centre[2]]);
                    text.number(2, 1).double(3, 0.4);
                    four(text, 5, [1.0; 4]);
                    text.text(6, &label(o));
                });
            }
        });
    }
    stamp.message(Topic::Scene, e.into_bytes())
}

/// A point cloud: x, y, z in the left camera's frame, in metres, and the grey level of each point.
pub fn points(stamp: Stamp, cloud: &[[f32; 4]]) -> Message {
    let data: Vec<u8> = cloud.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let mut e = Encoder::with_capacity(data.len() + 128);
    time(&mut e, 1, stamp.time_ns);
    e.text(2, Side::Left.frame());
    place(&mut e, 3, [0.0; 3]);
    // Four numbers a point, of type FLOAT32.
    e.fixed32(4, 16);
    for (i, name) in ["x", "y", "z", "intensity"].into_iter().enumerate() {
        e.message(5, |field| {
            field.text(1, name).fixed32(2, 4 * i as u32).number(3, 7);
        });
    }
    e.bytes(6, &data);
    stamp.message(Topic::Points, e.into_bytes())
}

/// What ties two images together.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PairLine {
    /// Number of the pair in its source.
    pub sequence: u64,
    /// Time in the scene.
    pub source_ns: u64,
    /// When it was captured, on the monotonic clock.
    pub capture_ns: u64,
    /// Width of both images.
    pub width: u32,
    /// Height of both images.
    pub height: u32,
}

/// A document of ours, as JSON.
pub fn json(stamp: Stamp, topic: Topic, document: &impl Serialize) -> Message {
    // Plain structs of numbers and texts can always be written.
    stamp.message(topic, serde_json::to_vec(document).unwrap_or_default())
}

/// A loss.
pub(super) fn loss(service: &str, count: u64, total: u64, time_ns: u64) -> Message {
    let document = serde_json::json!({ "service": service, "count": count, "total": total });
    json(Stamp { sequence: 0, time_ns }, Topic::Loss, &document)
}
