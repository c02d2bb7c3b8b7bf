//! Topics of a recording.

use super::schema::{self, Schema};
use sources::recording as names;
use std::fmt;
use std::str::FromStr;

/// Format of recorded images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageForm {
    /// Uncompressed: no computing time, lossless, largest.
    #[default]
    Raw,
    /// PNG: lossless, about half the bytes, much computing time.
    Png,
    /// JPEG: smallest, lossy, for viewing; a replay gives different results.
    Jpeg,
}

impl ImageForm {
    /// Name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Png => "png",
            Self::Jpeg => "jpeg",
        }
    }
}

/// A topic of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Left image.
    LeftImage,
    /// Right image.
    RightImage,
    /// Number, times and size of each stereo pair.
    Pair,
    /// What the vehicle reported at a pair.
    Vehicle,
    /// Calibration of the left images.
    LeftCalibration,
    /// Calibration of the right images.
    RightCalibration,
    /// Transforms between vehicle and cameras.
    Transform,
    /// A line of `obstacles.jsonl` for each frame.
    Obstacles,
    /// Pose of the vehicle since the start, as a transform.
    Odometry,
    /// Obstacles as boxes in space.
    Scene,
    /// Obstacles as boxes in the left image.
    Annotations,
    /// Point cloud.
    Points,
    /// State of the daemon.
    Status,
    /// Counts of messages that could not be recorded.
    Loss,
}

impl Topic {
    /// Name of the topic in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeftImage => names::LEFT_IMAGE,
            Self::RightImage => names::RIGHT_IMAGE,
            Self::Pair => names::PAIR,
            Self::Vehicle => names::VEHICLE,
            Self::LeftCalibration => names::LEFT_CALIBRATION,
            Self::RightCalibration => names::RIGHT_CALIBRATION,
            Self::Transform => names::TRANSFORM,
            Self::Obstacles => names::OBSTACLES,
            Self::Odometry => names::ODOMETRY,
            Self::Scene => names::SCENE,
            Self::Annotations => names::ANNOTATIONS,
            Self::Points => names::POINTS,
            Self::Status => names::STATUS,
            Self::Loss => names::LOSS,
        }
    }

    /// The type of its messages.
    pub fn schema(self, form: ImageForm) -> Schema {
        use sources::recording::foxglove as f;
        match self {
            Self::LeftImage | Self::RightImage if form == ImageForm::Raw => Schema::Protobuf(f::RAW_IMAGE),
            Self::LeftImage | Self::RightImage => Schema::Protobuf(f::COMPRESSED_IMAGE),
            Self::LeftCalibration | Self::RightCalibration => Schema::Protobuf(f::CAMERA_CALIBRATION),
            Self::Transform | Self::Odometry => Schema::Protobuf(f::FRAME_TRANSFORM),
            Self::Scene => Schema::Protobuf(f::SCENE_UPDATE),
            Self::Annotations => Schema::Protobuf(f::IMAGE_ANNOTATIONS),
            Self::Points => Schema::Protobuf(f::POINT_CLOUD),
            Self::Pair => schema::PAIR,
            Self::Vehicle => schema::VEHICLE,
            Self::Obstacles => schema::OBSTACLES,
            Self::Status => schema::STATUS,
            Self::Loss => schema::LOSS,
        }
    }

    /// Whether each file of a split recording begins with the last message of the topic, so that it can be read by
    /// itself.
    pub fn is_latched(self) -> bool {
        matches!(self, Self::LeftCalibration | Self::RightCalibration | Self::Transform)
    }
}

/// An encoded message that is to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Topic of the message.
    pub topic: Topic,
    /// Number of its frame.
    pub sequence: u32,
    /// Time in nanoseconds since 1970.
    pub time_ns: u64,
    /// The message, encoded after the topic's schema.
    pub data: Vec<u8>,
}

/// Groups of topics that the command line selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Images, calibrations, transforms, pairs and the vehicle's values: the input of a replay.
    pub images: bool,
    /// A line for each frame, and boxes in the left image.
    pub obstacles: bool,
    /// Obstacles as boxes in space, and the pose of the vehicle.
    pub scene: bool,
    /// Point cloud.
    pub points: bool,
    /// State of the daemon.
    pub status: bool,
}

impl Default for Choice {
    fn default() -> Self {
        Self { images: true, obstacles: true, scene: true, points: false, status: true }
    }
}

impl FromStr for Choice {
    type Err = String;

    /// Names of groups, separated by commas: `images,obstacles`; or `all`.
    fn from_str(text: &str) -> Result<Self, String> {
        let none = Self { images: false, obstacles: false, scene: false, points: false, status: false };
        text.split(',').try_fold(none, |c, name| {
            Ok(match name.trim() {
                "images" => Self { images: true, ..c },
                "obstacles" => Self { obstacles: true, ..c },
                "scene" => Self { scene: true, ..c },
                "points" => Self { points: true, ..c },
                "status" => Self { status: true, ..c },
                "all" => Self { images: true, obstacles: true, scene: true, points: true, status: true },
                other => {
                    return Err(format!(
                        "\"{other}\" is none of images, obstacles, scene, points, status, all"
                    ));
                }
            })
        })
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (self.images, "images"),
            (self.obstacles, "obstacles"),
            (self.scene, "scene"),
            (self.points, "points"),
            (self.status, "status"),
        ];
        let chosen: Vec<&str> = names.into_iter().filter(|(on, _)| *on).map(|(_, name)| name).collect();
        f.write_str(&chosen.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_selected_by_name() {
        let images: Choice = "images".parse().unwrap();
        assert!(images.images && !images.status);
        assert_eq!("all".parse::<Choice>().unwrap().to_string(), "images,obstacles,scene,points,status");
        assert_eq!(Choice::default().to_string(), "images,obstacles,scene,status");
        assert!("image".parse::<Choice>().unwrap_err().contains("\"image\""));
    }
}
