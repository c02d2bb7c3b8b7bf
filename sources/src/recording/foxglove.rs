//! Foxglove's message types, as far as recordings hold them. Names, numbers and kinds are those of
//! the published schemas, whole: viewers read fields that nobody here writes, too.

use super::protobuf::FieldKind::{Bool, Bytes, Double, Enum, Fixed32, Int32, Int64, Message, Text};
use super::protobuf::{Encoder, EnumType, Field, MessageType, many, one};

const fn message(name: &'static str, fields: &'static [Field]) -> MessageType {
    MessageType { name, fields, nested: None }
}

const fn with_enum(name: &'static str, fields: &'static [Field], nested: &'static EnumType) -> MessageType {
    MessageType { name, fields, nested: Some(nested) }
}

static TIMESTAMP: MessageType =
    message("google.protobuf.Timestamp", &[one(1, "seconds", Int64), one(2, "nanos", Int32)]);
static DURATION: MessageType =
    message("google.protobuf.Duration", &[one(1, "seconds", Int64), one(2, "nanos", Int32)]);
static VECTOR3: MessageType =
    message("foxglove.Vector3", &[one(1, "x", Double), one(2, "y", Double), one(3, "z", Double)]);
static POINT3: MessageType =
    message("foxglove.Point3", &[one(1, "x", Double), one(2, "y", Double), one(3, "z", Double)]);
static POINT2: MessageType = message("foxglove.Point2", &[one(1, "x", Double), one(2, "y", Double)]);
static QUATERNION: MessageType = message(
    "foxglove.Quaternion",
    &[one(1, "x", Double), one(2, "y", Double), one(3, "z", Double), one(4, "w", Double)],
);
static POSE: MessageType = message(
    "foxglove.Pose",
    &[one(1, "position", Message(&VECTOR3)), one(2, "orientation", Message(&QUATERNION))],
);
static COLOR: MessageType = message(
    "foxglove.Color",
    &[one(1, "r", Double), one(2, "g", Double), one(3, "b", Double), one(4, "a", Double)],
);
static KEY_VALUE: MessageType =
    message("foxglove.KeyValuePair", &[one(1, "key", Text), one(2, "value", Text)]);

/// `foxglove.RawImage`.
pub static RAW_IMAGE: MessageType = message(
    "foxglove.RawImage",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(7, "frame_id", Text),
        one(2, "width", Fixed32),
        one(3, "height", Fixed32),
        one(4, "encoding", Text),
        one(5, "step", Fixed32),
        one(6, "data", Bytes),
    ],
);

/// `foxglove.CompressedImage`.
pub static COMPRESSED_IMAGE: MessageType = message(
    "foxglove.CompressedImage",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(4, "frame_id", Text),
        one(2, "data", Bytes),
        one(3, "format", Text),
    ],
);

/// `foxglove.CameraCalibration`.
pub static CAMERA_CALIBRATION: MessageType = message(
    "foxglove.CameraCalibration",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(9, "frame_id", Text),
        one(2, "width", Fixed32),
        one(3, "height", Fixed32),
        one(4, "distortion_model", Text),
        many(5, "D", Double),
        many(6, "K", Double),
        many(7, "R", Double),
        many(8, "P", Double),
    ],
);

/// `foxglove.FrameTransform`.
pub static FRAME_TRANSFORM: MessageType = message(
    "foxglove.FrameTransform",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(2, "parent_frame_id", Text),
        one(3, "child_frame_id", Text),
        one(4, "translation", Message(&VECTOR3)),
        one(5, "rotation", Message(&QUATERNION)),
    ],
);

static ARROW: MessageType = message(
    "foxglove.ArrowPrimitive",
    &[
        one(1, "pose", Message(&POSE)),
        one(2, "shaft_length", Double),
        one(3, "shaft_diameter", Double),
        one(4, "head_length", Double),
        one(5, "head_diameter", Double),
        one(6, "color", Message(&COLOR)),
    ],
);
static CUBE: MessageType = message(
    "foxglove.CubePrimitive",
    &[one(1, "pose", Message(&POSE)), one(2, "size", Message(&VECTOR3)), one(3, "color", Message(&COLOR))],
);
static SPHERE: MessageType = message(
    "foxglove.SpherePrimitive",
    &[one(1, "pose", Message(&POSE)), one(2, "size", Message(&VECTOR3)), one(3, "color", Message(&COLOR))],
);
static CYLINDER: MessageType = message(
    "foxglove.CylinderPrimitive",
    &[
        one(1, "pose", Message(&POSE)),
        one(2, "size", Message(&VECTOR3)),
        one(3, "bottom_scale", Double),
        one(4, "top_scale", Double),
        one(5, "color", Message(&COLOR)),
    ],
);
static LINE: MessageType = with_enum(
    "foxglove.LinePrimitive",
    &[
        one(1, "type", Enum),
        one(2, "pose", Message(&POSE)),
        one(3, "thickness", Double),
        one(4, "scale_invariant", Bool),
        many(5, "points", Message(&POINT3)),
        one(6, "color", Message(&COLOR)),
        many(7, "colors", Message(&COLOR)),
        many(8, "indices", Fixed32),
    ],
    &EnumType { name: "Type", values: &["LINE_STRIP", "LINE_LOOP", "LINE_LIST"] },
);
static TRIANGLES: MessageType = message(
    "foxglove.TriangleListPrimitive",
    &[
        one(1, "pose", Message(&POSE)),
        many(2, "points", Message(&POINT3)),
        one(3, "color", Message(&COLOR)),
        many(4, "colors", Message(&COLOR)),
        many(5, "indices", Fixed32),
    ],
);
static TEXT: MessageType = message(
    "foxglove.TextPrimitive",
    &[
        one(1, "pose", Message(&POSE)),
        one(2, "billboard", Bool),
        one(3, "font_size", Double),
        one(4, "scale_invariant", Bool),
        one(5, "color", Message(&COLOR)),
        one(6, "text", Text),
    ],
);
static MODEL: MessageType = message(
    "foxglove.ModelPrimitive",
    &[
        one(1, "pose", Message(&POSE)),
        one(2, "scale", Message(&VECTOR3)),
        one(3, "color", Message(&COLOR)),
        one(4, "override_color", Bool),
        one(5, "url", Text),
        one(6, "media_type", Text),
        one(7, "data", Bytes),
    ],
);
static ENTITY: MessageType = message(
    "foxglove.SceneEntity",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(2, "frame_id", Text),
        one(3, "id", Text),
        one(4, "lifetime", Message(&DURATION)),
        one(5, "frame_locked", Bool),
        many(6, "metadata", Message(&KEY_VALUE)),
        many(7, "arrows", Message(&ARROW)),
        many(8, "cubes", Message(&CUBE)),
        many(9, "spheres", Message(&SPHERE)),
        many(10, "cylinders", Message(&CYLINDER)),
        many(11, "lines", Message(&LINE)),
        many(12, "triangles", Message(&TRIANGLES)),
        many(13, "texts", Message(&TEXT)),
        many(14, "models", Message(&MODEL)),
    ],
);
static DELETION: MessageType = with_enum(
    "foxglove.SceneEntityDeletion",
    &[one(1, "timestamp", Message(&TIMESTAMP)), one(2, "type", Enum), one(3, "id", Text)],
    &EnumType { name: "Type", values: &["MATCHING_ID", "ALL"] },
);

/// `foxglove.SceneUpdate`.
pub static SCENE_UPDATE: MessageType = message(
    "foxglove.SceneUpdate",
    &[many(1, "deletions", Message(&DELETION)), many(2, "entities", Message(&ENTITY))],
);

static CIRCLE_ANNOTATION: MessageType = message(
    "foxglove.CircleAnnotation",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(2, "position", Message(&POINT2)),
        one(3, "diameter", Double),
        one(4, "thickness", Double),
        one(5, "fill_color", Message(&COLOR)),
        one(6, "outline_color", Message(&COLOR)),
        many(7, "metadata", Message(&KEY_VALUE)),
    ],
);
static POINTS_ANNOTATION: MessageType = with_enum(
    "foxglove.PointsAnnotation",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(2, "type", Enum),
        many(3, "points", Message(&POINT2)),
        one(4, "outline_color", Message(&COLOR)),
        many(5, "outline_colors", Message(&COLOR)),
        one(6, "fill_color", Message(&COLOR)),
        one(7, "thickness", Double),
        many(8, "metadata", Message(&KEY_VALUE)),
    ],
    &EnumType { name: "Type", values: &["UNKNOWN", "POINTS", "LINE_LOOP", "LINE_STRIP", "LINE_LIST"] },
);
static TEXT_ANNOTATION: MessageType = message(
    "foxglove.TextAnnotation",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(2, "position", Message(&POINT2)),
        one(3, "text", Text),
        one(4, "font_size", Double),
        one(5, "text_color", Message(&COLOR)),
        one(6, "background_color", Message(&COLOR)),
        many(7, "metadata", Message(&KEY_VALUE)),
    ],
);

/// `foxglove.ImageAnnotations`.
pub static IMAGE_ANNOTATIONS: MessageType = message(
    "foxglove.ImageAnnotations",
    &[
        one(5, "timestamp", Message(&TIMESTAMP)),
        many(1, "circles", Message(&CIRCLE_ANNOTATION)),
        many(2, "points", Message(&POINTS_ANNOTATION)),
        many(3, "texts", Message(&TEXT_ANNOTATION)),
        many(4, "metadata", Message(&KEY_VALUE)),
    ],
);

static PACKED_FIELD: MessageType = with_enum(
    "foxglove.PackedElementField",
    &[one(1, "name", Text), one(2, "offset", Fixed32), one(3, "type", Enum)],
    &EnumType {
        name: "NumericType",
        values: &["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"],
    },
);

/// `foxglove.PointCloud`.
pub static POINT_CLOUD: MessageType = message(
    "foxglove.PointCloud",
    &[
        one(1, "timestamp", Message(&TIMESTAMP)),
        one(2, "frame_id", Text),
        one(3, "pose", Message(&POSE)),
        one(4, "point_stride", Fixed32),
        many(5, "fields", Message(&PACKED_FIELD)),
        one(6, "data", Bytes),
    ],
);

/// Writes a `Timestamp` or `Duration` of nanoseconds.
pub fn time(encoder: &mut Encoder, field: u32, ns: u64) {
    encoder.message(field, |t| {
        t.number(1, ns / 1_000_000_000).number(2, ns % 1_000_000_000);
    });
}

/// Writes three doubles from field 1 on: `Vector3`, `Point3`.
pub fn vector(encoder: &mut Encoder, field: u32, values: [f64; 3]) {
    encoder.message(field, |v| {
        v.double(1, values[0]).double(2, values[1]).double(3, values[2]);
    });
}

/// Writes four doubles from field 1 on: `Color`, `Quaternion`.
pub fn four(encoder: &mut Encoder, field: u32, values: [f64; 4]) {
    encoder.message(field, |v| {
        v.double(1, values[0]).double(2, values[1]).double(3, values[2]).double(4, values[3]);
    });
}

/// Writes a pose without rotation.
pub fn place(encoder: &mut Encoder, field: u32, position: [f64; 3]) {
    encoder.message(field, |p| {
        vector(p, 1, position);
        four(p, 2, [0.0, 0.0, 0.0, 1.0]);
    });
}
