//! What a recording may hold.

use super::schema::{self, Schema};
use sources::recording as names;
use std::fmt;
use std::str::FromStr;

/// How images are recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageForm {
    /// As they are: no work, no loss, the most bytes.
    #[default]
    Raw,
    /// PNG: no loss, about half the bytes, much work.
    Png,
    /// JPEG: fewest bytes, for looking at; a replay gives other results.
    Jpeg,
}

impl ImageForm {
    /// The word for it.
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
    /// What ties them together.
    Pair,
    /// Calibration of the left images.
    LeftCalibration,
    /// Calibration of the right images.
    RightCalibration,
    /// Where the cameras look.
    Transform,
    /// A line per frame.
    Obstacles,
    /// Boxes in space.
    Scene,
    /// Boxes in the left image.
    Annotations,
    /// Point cloud.
    Points,
    /// The daemon.
    Status,
    /// What could not be recorded.
    Loss,
}

impl Topic {
    /// Its name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeftImage => names::LEFT_IMAGE,
            Self::RightImage => names::RIGHT_IMAGE,
            Self::Pair => names::PAIR,
            Self::LeftCalibration => names::LEFT_CALIBRATION,
            Self::RightCalibration => names::RIGHT_CALIBRATION,
            Self::Transform => names::TRANSFORM,
            Self::Obstacles => names::OBSTACLES,
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
            Self::LeftImage | Self::RightImage if form == ImageForm::Raw => Schema::Protobuf(&f::RAW_IMAGE),
            Self::LeftImage | Self::RightImage => Schema::Protobuf(&f::COMPRESSED_IMAGE),
            Self::LeftCalibration | Self::RightCalibration => Schema::Protobuf(&f::CAMERA_CALIBRATION),
            Self::Transform => Schema::Protobuf(&f::FRAME_TRANSFORM),
            Self::Scene => Schema::Protobuf(&f::SCENE_UPDATE),
            Self::Annotations => Schema::Protobuf(&f::IMAGE_ANNOTATIONS),
            Self::Points => Schema::Protobuf(&f::POINT_CLOUD),
            Self::Pair => schema::PAIR,
            Self::Obstacles => schema::OBSTACLES,
            Self::Status => schema::STATUS,
            Self::Loss => schema::LOSS,
        }
    }

    /// Whether each file begins with its last message, so that it stands alone.
    pub fn is_latched(self) -> bool {
        matches!(self, Self::LeftCalibration | Self::RightCalibration | Self::Transform)
    }
}

/// A message on its way into a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Its topic.
    pub topic: Topic,
    /// Number of the frame that it belongs to.
    pub sequence: u32,
    /// When it was: nanoseconds since 1970.
    pub time_ns: u64,
    /// Encoded as the topic's schema says.
    pub data: Vec<u8>,
}

/// Groups of topics, as they are chosen on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Images, calibration and what ties them together: what a replay needs.
    pub images: bool,
    /// A line per frame, and the boxes in the image.
    pub obstacles: bool,
    /// Boxes in space.
    pub scene: bool,
    /// Point cloud.
    pub points: bool,
    /// The daemon's state.
    pub status: bool,
}

impl Default for Choice {
    fn default() -> Self {
        Self { images: true, obstacles: true, scene: true, points: false, status: true }
    }
}

impl FromStr for Choice {
    type Err = String;

    /// Words with commas: `images,obstacles`, or `all`.
    fn from_str(text: &str) -> Result<Self, String> {
        let none = Self { images: false, obstacles: false, scene: false, points: false, status: false };
        text.split(',').try_fold(none, |c, word| {
            Ok(match word.trim() {
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
        let words = [
            (self.images, "images"),
            (self.obstacles, "obstacles"),
            (self.scene, "scene"),
            (self.points, "points"),
            (self.status, "status"),
        ];
        let chosen: Vec<&str> = words.into_iter().filter(|(on, _)| *on).map(|(_, word)| word).collect();
        f.write_str(&chosen.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_chosen_by_words() {
        let images: Choice = "images".parse().unwrap();
        assert!(images.images && !images.status);
        assert_eq!("all".parse::<Choice>().unwrap().to_string(), "images,obstacles,scene,points,status");
        assert_eq!(Choice::default().to_string(), "images,obstacles,scene,status");
        assert!("image".parse::<Choice>().unwrap_err().contains("\"image\""));
    }
}
