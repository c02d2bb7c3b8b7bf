//! Encodes the messages of a recording.
//!
//! Frames of reference: `camera_left` and `camera_right` are optical frames (x right, y down, z forward, in
//! metres); `vehicle` has x forward, y left, z up, as in ROS, with its origin in the left camera; `start` is where
//! `vehicle` was at the start of the run, or at the last reset of odometry.

use super::topic::{ImageForm, Message, Topic};
use crate::reporting::palette;
use crate::reporting::record::{FrameRecord, ObstacleLine};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};
use perception::rig::Rig;
use prost::bytes::Bytes;
use serde::Serialize;
use sources::recording::foxglove::{
    CameraCalibration, Color, CompressedImage, CubePrimitive, FrameTransform, ImageAnnotations, KeyValuePair,
    LinePrimitive, PackedElementField, Point2, Point3, PointCloud, PointsAnnotation, Pose, RawImage,
    SceneEntity, SceneEntityDeletion, SceneUpdate, TextAnnotation, TextPrimitive, Timestamp, line_primitive,
    packed_element_field, points_annotation, scene_entity_deletion,
};

/// Quality of JPEG images, 1 to 100.
const JPEG_QUALITY: u8 = 80;

/// Length of the dashes of a prediction, in px, and their largest number on a side.
const DASH_PX: f64 = 5.0;
const MAX_DASHES: usize = 100;

/// Depth of the boxes in metres: the extent of obstacles along the view is not measured.
pub const BOX_DEPTH_M: f64 = 0.4;

/// Rotation from the axes of a camera to those of the vehicle, as a quaternion x, y, z, w.
const CAMERA_TO_VEHICLE: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];

/// A camera of the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

impl Side {
    /// Name of its frame of reference.
    pub fn frame(self) -> &'static str {
        match self {
            Self::Left => "camera_left",
            Self::Right => "camera_right",
        }
    }
}

/// Number and time of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Number of the frame.
    pub sequence: u64,
    /// Nanoseconds since 1970.
    pub time_ns: u64,
}

impl Stamp {
    fn timestamp(self) -> Option<Timestamp> {
        Some(Timestamp::from_ns(self.time_ns))
    }

    fn message(self, topic: Topic, message: &impl prost::Message) -> Message {
        self.encoded(topic, message.encode_to_vec())
    }

    fn encoded(self, topic: Topic, data: Vec<u8>) -> Message {
        Message { topic, sequence: self.sequence as u32, time_ns: self.time_ns, data }
    }
}

/// An image of `width` × `height` grey pixels.
///
/// # Errors
/// If it cannot be compressed.
pub fn image(
    stamp: Stamp,
    side: Side,
    form: ImageForm,
    pixels: &[u8],
    (width, height): (u32, u32),
) -> Result<Message, ImageError> {
    let topic = if side == Side::Left { Topic::LeftImage } else { Topic::RightImage };
    let (timestamp, frame_id) = (stamp.timestamp(), side.frame().to_owned());
    if form == ImageForm::Raw {
        let data = Bytes::copy_from_slice(pixels);
        let encoding = "mono8".to_owned();
        let image = RawImage { timestamp, frame_id, width, height, encoding, step: width, data };
        return Ok(stamp.message(topic, &image));
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
    let image = CompressedImage { timestamp, frame_id, data: file.into(), format: form.name().to_owned() };
    Ok(stamp.message(topic, &image))
}

/// Calibrations of both cameras, and the transforms between them and the vehicle.
pub fn geometry(stamp: Stamp, rig: &Rig, (width, height): (u32, u32)) -> [Message; 4] {
    let f = rig.focal_px;
    let camera = |side: Side| {
        let shift = if side == Side::Left { 0.0 } else { -f * rig.baseline_m };
        let calibration = CameraCalibration {
            timestamp: stamp.timestamp(),
            frame_id: side.frame().to_owned(),
            width,
            height,
            distortion_model: "plumb_bob".to_owned(),
            // The images are rectified.
            d: vec![0.0; 5],
            k: vec![f, 0.0, rig.cx_px, 0.0, f, rig.cy_px, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![f, 0.0, rig.cx_px, shift, 0.0, f, rig.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0],
        };
        let topic = if side == Side::Left { Topic::LeftCalibration } else { Topic::RightCalibration };
        stamp.message(topic, &calibration)
    };
    let transform = |parent: &str, side: Side, translation: [f64; 3], rotation: [f64; 4]| {
        let transform = FrameTransform {
            timestamp: stamp.timestamp(),
            parent_frame_id: parent.to_owned(),
            child_frame_id: side.frame().to_owned(),
            translation: Some(translation.into()),
            rotation: Some(rotation.into()),
        };
        stamp.message(Topic::Transform, &transform)
    };
    [
        camera(Side::Left),
        camera(Side::Right),
        transform("camera_left", Side::Right, [rig.baseline_m, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]),
        transform("vehicle", Side::Left, [0.0; 3], CAMERA_TO_VEHICLE),
    ]
}

/// The pose of the left camera since the start (axes x right, y down, z forward; orientation as a unit quaternion x, y, z,
/// w) as the transform from `vehicle` to `start`.
pub fn odometry(stamp: Stamp, position_m: [f64; 3], orientation: [f64; 4]) -> Message {
    let [right, down, forward] = position_m;
    let [x, y, z, w] = orientation;
    let transform = FrameTransform {
        timestamp: stamp.timestamp(),
        parent_frame_id: "start".to_owned(),
        child_frame_id: "vehicle".to_owned(),
        translation: Some([forward, -right, -down].into()),
        rotation: Some([z, -x, -y, w].into()),
    };
    stamp.message(Topic::Odometry, &transform)
}

/// Colour of an obstacle, as in overlays.
fn colour(record: &FrameRecord, o: &ObstacleLine, opacity: f64) -> Color {
    let [r, g, b] = palette::of_obstacle(record, o).map(|part| f64::from(part) / 255.0);
    [r, g, b, opacity].into()
}

fn label(o: &ObstacleLine) -> String {
    match o.time_to_collision_s {
        Some(ttc) if o.confirmed => format!("{} {} {:.1} m {ttc:.1} s", o.class, o.track, o.distance_m),
        _ => format!("{} {} {:.1} m", o.class, o.track, o.distance_m),
    }
}

/// The sides of a box as dashes: start and end of each.
fn dashes(corners: [[f64; 2]; 4]) -> Vec<Point2> {
    let mut points = Vec::new();
    for side in 0..4 {
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        let length_px = (to[0] - from[0]).hypot(to[1] - from[1]);
        let count = ((length_px / (2.0 * DASH_PX)).ceil() as usize).clamp(1, MAX_DASHES);
        let at = |share: f64| [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])];
        for dash in 0..count {
            let start = dash as f64 / count as f64;
            points.extend([start, start + 0.5 / count as f64].map(|share| Point2::from(at(share))));
        }
    }
    points
}

/// The obstacles as boxes in the left image; predicted ones are dashed.
pub fn annotations(stamp: Stamp, record: &FrameRecord) -> Message {
    let timestamp = stamp.timestamp();
    let mut message = ImageAnnotations { timestamp, ..Default::default() };
    for o in record.obstacles.iter().filter(|o| o.is_shown()) {
        let (x, y) = (f64::from(o.x_px), f64::from(o.y_px));
        let (right, bottom) = (x + f64::from(o.width_px), y + f64::from(o.height_px));
        let corners = [[x, y], [right, y], [right, bottom], [x, bottom]];
        // A list of lines, each a dash, is the only way to draw a dashed box.
        let (kind, points) = if o.predicted {
            (points_annotation::Type::LineList, dashes(corners))
        } else {
            (points_annotation::Type::LineLoop, corners.map(Point2::from).to_vec())
        };
        message.points.push(PointsAnnotation {
            timestamp,
            r#type: kind.into(),
            points,
            outline_color: Some(colour(record, o, 1.0)),
            thickness: if o.confirmed { 2.0 } else { 1.0 },
            ..Default::default()
        });
        if o.confirmed {
            message.texts.push(TextAnnotation {
                timestamp,
                position: Some([x, y].into()),
                text: label(o),
                font_size: 12.0,
                text_color: Some([1.0; 4].into()),
                background_color: Some([0.0, 0.0, 0.0, 0.6].into()),
                ..Default::default()
            });
        }
    }
    stamp.message(Topic::Annotations, &message)
}

/// Colour of the outline of free space.
const FREE: [f64; 4] = [0.2, 0.8, 0.4, 0.9];
/// Colour of boundaries.
const BOUNDARY: [f64; 4] = [0.7, 0.4, 1.0, 0.9];
/// Thickness of lines, in px of the screen.
const LINE_PX: f64 = 2.0;

/// The plane of the road, in the left camera's frame of reference.
struct Ground {
    /// Height of the camera above it, in metres; 0 without a road.
    camera_height_m: f64,
    /// Metres down a metre ahead.
    tilt: f64,
}

impl Ground {
    fn of(record: &FrameRecord, rig: &Rig) -> Self {
        let tilt = |horizon_px: f64| (horizon_px - rig.cy_px) / rig.focal_px;
        Self {
            camera_height_m: record.road.map_or(0.0, |road| road.camera_height_m),
            tilt: record.road.map_or(0.0, |road| tilt(road.horizon_px)),
        }
    }

    /// A point above a place on the road (right, forward).
    fn point(&self, [right, forward]: [f64; 2], up_m: f64) -> Point3 {
        Point3 { x: right, y: self.camera_height_m + self.tilt * forward - up_m, z: forward }
    }
}

fn line(kind: line_primitive::Type, points: Vec<Point3>, colour: [f64; 4]) -> LinePrimitive {
    LinePrimitive {
        r#type: kind.into(),
        pose: Some(Pose::at([0.0; 3])),
        thickness: LINE_PX,
        scale_invariant: true,
        points,
        color: Some(colour.into()),
        ..Default::default()
    }
}

fn entity(timestamp: Option<Timestamp>, id: String, lines: Vec<LinePrimitive>) -> SceneEntity {
    let frame_id = Side::Left.frame().to_owned();
    SceneEntity { timestamp, frame_id, id, lines, ..Default::default() }
}

/// The obstacles as boxes in space, free space and boundaries as lines, in place of those of the previous frame.
pub fn scene(stamp: Stamp, record: &FrameRecord, rig: &Rig) -> Message {
    let timestamp = stamp.timestamp();
    let all = scene_entity_deletion::Type::All.into();
    let deletion = SceneEntityDeletion { timestamp, r#type: all, ..Default::default() };
    let entities = record.obstacles.iter().filter(|o| o.is_shown()).map(|o| {
        let middle_row = f64::from(o.y_px) + 0.5 * f64::from(o.height_px);
        let y = (middle_row - rig.cy_px) * o.distance_m / rig.focal_px;
        let centre = [o.lateral_m, y, o.distance_m + 0.5 * BOX_DEPTH_M];
        let metadata = [("class", o.class.clone()), ("distance_m", format!("{:.2}", o.distance_m))];
        let cube = CubePrimitive {
            pose: Some(Pose::at(centre)),
            size: Some([o.width_m, o.height_m, BOX_DEPTH_M].into()),
            color: Some(colour(record, o, if o.predicted { 0.2 } else { 0.5 })),
        };
        let text = o.confirmed.then(|| TextPrimitive {
            pose: Some(Pose::at([centre[0], centre[1] - 0.5 * o.height_m - 0.3, centre[2]])),
            billboard: true,
            font_size: 0.4,
            color: Some([1.0; 4].into()),
            text: label(o),
            ..Default::default()
        });
        SceneEntity {
            timestamp,
            frame_id: Side::Left.frame().to_owned(),
            id: o.track.to_string(),
            metadata: metadata.map(|(key, value)| KeyValuePair { key: key.to_owned(), value }).to_vec(),
            cubes: vec![cube],
            texts: text.into_iter().collect(),
            ..Default::default()
        }
    });
    let ground = Ground::of(record, rig);
    let free = record.free_space_m.iter().enumerate().map(|(i, corners)| {
        let points = corners.iter().map(|&place| ground.point(place, 0.0)).collect();
        entity(timestamp, format!("free space {i}"), vec![line(line_primitive::Type::LineLoop, points, FREE)])
    });
    let boundaries = record.boundaries.iter().map(|boundary| {
        let places = || boundary.points_m.iter().zip(&boundary.height_m);
        let foot = places().map(|(place, _)| ground.point(*place, 0.0)).collect();
        let top = places().map(|(place, height_m)| ground.point(*place, *height_m)).collect();
        let posts =
            places().flat_map(|(place, height_m)| [0.0, *height_m].map(|up| ground.point(*place, up)));
        let lines = [
            line(line_primitive::Type::LineStrip, foot, BOUNDARY),
            line(line_primitive::Type::LineStrip, top, BOUNDARY),
            line(line_primitive::Type::LineList, posts.collect(), BOUNDARY),
        ];
        entity(timestamp, format!("boundary {}", boundary.id), lines.to_vec())
    });
    let entities = entities.chain(free).chain(boundaries).collect();
    let update = SceneUpdate { deletions: vec![deletion], entities };
    stamp.message(Topic::Scene, &update)
}

/// A point cloud: x, y, z in the left camera's frame of reference, in metres, and the grey level of each point.
pub fn points(stamp: Stamp, cloud: &[[f32; 4]]) -> Message {
    let data: Vec<u8> = cloud.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let float = packed_element_field::NumericType::Float32.into();
    let fields = [("x", 0), ("y", 4), ("z", 8), ("intensity", 12)];
    let message = PointCloud {
        timestamp: stamp.timestamp(),
        frame_id: Side::Left.frame().to_owned(),
        pose: Some(Pose::at([0.0; 3])),
        point_stride: 16,
        fields: fields
            .map(|(name, offset)| PackedElementField { name: name.to_owned(), offset, r#type: float })
            .to_vec(),
        data: data.into(),
    };
    stamp.message(Topic::Points, &message)
}

/// A stereo pair: number, times and size.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PairLine {
    /// Number of the pair in its source.
    pub sequence: u64,
    /// Time in the source, in nanoseconds.
    pub source_ns: u64,
    /// Time of capture on the monotonic clock, in nanoseconds.
    pub capture_ns: u64,
    /// Width of both images.
    pub width: u32,
    /// Height of both images.
    pub height: u32,
}

/// A document in JSON.
pub fn json(stamp: Stamp, topic: Topic, document: &impl Serialize) -> Message {
    // Serialisation of plain structs of numbers and strings cannot fail.
    stamp.encoded(topic, serde_json::to_vec(document).unwrap_or_default())
}

/// Lost messages of a service: `count` since the last such message, `total` since the recording began.
pub(super) fn loss(service: &str, count: u64, total: u64, time_ns: u64) -> Message {
    let document = serde_json::json!({ "service": service, "count": count, "total": total });
    json(Stamp { sequence: 0, time_ns }, Topic::Loss, &document)
}
