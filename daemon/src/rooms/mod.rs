//! The work of each stage, from message to message: the same code in the daemon's processes and
//! in one process.

pub mod calibration;
pub mod matcher;
pub mod recognition;
pub mod road;
pub mod stereo;

use config::Config;
use messages::alarm::Faults;
use messages::calibration::CalibrationRecord;
use messages::device::DeviceRecord;
use messages::header::{Header, MessageError};
use perception::alarm::AlarmParameters;
use perception::detection::RegionParameters;
use perception::recognition::xml::CascadeError;
use perception::recognition::{CascadeRecogniser, RecogniserParameters, Sizes};
use perception::road::{RoadParameters, Shape};
use perception::scene::SceneParameters;
use perception::stereo::cost::CostParameters;
use perception::stereo::fill::BridgeParameters;
use perception::stereo::scale::PathParameters;
use perception::stereo::speckle::SpeckleParameters;
use perception::stereo::viterbi::Merge;
use perception::stereo::winner::{SubPixel, WinnerParameters};
use perception::stereo::{MatchError, MpvParameters};
use perception::tracking::TrackerParameters;
use perception::tracking::classification_schedule::ScheduleParameters;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The work of one stage: a message in, a message out.
pub trait Room {
    /// The most bytes that [`Self::process`] writes.
    fn output_bytes(&self) -> usize;

    /// Works on one message and writes the payload of the next to the start of `output`. Gives how
    /// many bytes it took.
    ///
    /// # Errors
    /// When the message is not sound.
    fn process(&mut self, header: &Header, payload: &[u8], output: &mut [u8]) -> Result<usize, FrameError>;

    /// What the frames so far say of the calibration; zeros where it is not checked.
    fn calibration(&self) -> CalibrationRecord {
        CalibrationRecord::default()
    }

    /// Self-checks that failed on the last frame; they travel on in its header.
    fn faults(&self) -> Faults {
        Faults::NONE
    }

    /// The device that it works on; zeros for the CPU.
    fn device(&self) -> DeviceRecord {
        DeviceRecord::default()
    }
}

/// Why a room cannot be furnished. The text names the key or file and the remedy.
#[derive(Debug, Error)]
pub enum RoomError {
    /// The matcher refuses the size or the disparities, or its backend cannot be used.
    #[error(transparent)]
    Matcher(#[from] matcher::BackendError),
    /// The cascade cannot be read.
    #[error(
        "recognition.cascade: {}: {source}: give an OpenCV cascade XML, vehicle for the one that ships \
         (not in a build without the feature models), or \"\" for none",
        path.display()
    )]
    CascadeFile {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The cascade cannot be used.
    #[error("recognition.cascade: {}: {source}", path.display())]
    Cascade {
        /// The file.
        path: PathBuf,
        /// Why.
        source: CascadeError,
    },
}

/// Why a frame cannot be worked on. The frame is skipped and counted.
#[derive(Debug, Error)]
pub enum FrameError {
    /// The message is not sound.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// The frame has another size than the run.
    #[error("the frame is {width}x{height}, this run has {expected_width}x{expected_height}")]
    Size {
        /// Width of the frame.
        width: u32,
        /// Height of the frame.
        height: u32,
        /// Width of the run.
        expected_width: usize,
        /// Height of the run.
        expected_height: usize,
    },
    /// The matcher refuses the images.
    #[error(transparent)]
    Match(#[from] MatchError),
    /// The right image cannot be shifted.
    #[error(transparent)]
    Remap(#[from] perception::rectify::RemapError),
    /// The bytes are no image.
    #[error(transparent)]
    Image(#[from] perception::image::ImageError),
}

/// Whole numbers of the configuration are checked to fit when it is read.
fn whole<T: TryFrom<i64> + Default>(value: i64) -> T {
    T::try_from(value).unwrap_or_default()
}

/// The matcher's parameters.
pub fn mpv_parameters(config: &Config) -> MpvParameters {
    let c = &config.stereo;
    let default = MpvParameters::default();
    MpvParameters {
        cost: CostParameters { k2: c.ssim_k2 as f32, gradient_limit: whole(c.gradient_limit) },
        paths: PathParameters {
            lambda_horizontal: whole(c.lambda_horizontal),
            lambda_vertical: whole(c.lambda_vertical),
            lambda_diagonal: whole(c.lambda_diagonal),
            truncation_horizontal: whole(c.truncation_horizontal),
            truncation_other: whole(c.truncation_other),
            edge_levels: whole(c.edge_levels),
            edge_percent: whole(c.edge_percent),
            merging: if c.merging == "mean" { Merge::Mean } else { Merge::Min },
        },
        scales: whole(c.scales),
        slopes: c.slopes,
        winner: WinnerParameters {
            left_right_px: whole(c.left_right_px),
            sub_pixel: match &c.sub_pixel[..] {
                "none" => SubPixel::None,
                "energy" => SubPixel::Energy,
                _ => SubPixel::Data,
            },
            ..default.winner
        },
        min_confidence: whole(c.confidence_min),
        speckle: SpeckleParameters { min_pixels: whole(c.speckle_pixels), ..default.speckle },
        bridge: BridgeParameters { widest_px: whole(c.bridge_px), ..default.bridge },
        complete: c.fill,
        threads: whole(c.threads),
    }
}

/// The parameters of the road model and of the regions.
pub fn scene_parameters(config: &Config) -> SceneParameters {
    let (c, r) = (&config.road, &config.regions);
    SceneParameters {
        road: RoadParameters {
            camera_height_m: (c.camera_height_min_m, c.camera_height_max_m),
            horizon_share: c.horizon_share,
            min_support: c.least_support,
            shape: if c.shape == "plane" { Shape::Plane } else { Shape::Profile },
        },
        regions: RegionParameters {
            min_height_m: r.height_min_m,
            max_height_m: r.height_max_m,
            max_distance_m: r.distance_max_m,
            min_width_m: r.width_min_m,
            depth_span_m: r.depth_span_m,
            min_pixels: whole(r.pixels_min),
            max_count: whole(r.count_max),
            confirm: r.confirm,
        },
    }
}

/// The tracker's parameters.
pub fn tracker_parameters(config: &Config) -> TrackerParameters {
    let c = &config.tracking;
    TrackerParameters {
        confirm_frames: whole(c.confirm_frames),
        forget_frames: whole(c.forget_frames),
        min_overlap: c.overlap_min,
        max_count: messages::obstacles::MAX_COUNT,
    }
}

/// The alarm's parameters.
pub fn alarm_parameters(config: &Config) -> AlarmParameters {
    let c = &config.alarm;
    AlarmParameters {
        distance_m: c.distance_m,
        ttc_warning_s: c.ttc_warning_s,
        ttc_alarm_s: c.ttc_alarm_s,
        deceleration_warning_m_s2: c.deceleration_warning_m_s2,
        deceleration_alarm_m_s2: c.deceleration_alarm_m_s2,
        path_width_m: c.path_width_m,
        confirm_frames: whole(c.confirm_frames),
        clear_share: c.clear_share,
        hold_ns: whole::<u64>(c.hold_ms) * 1_000_000,
    }
}

/// How often the recogniser looks at tracks.
pub fn look_parameters(config: &Config) -> ScheduleParameters {
    let c = &config.recognition;
    ScheduleParameters { max_per_frame: whole(c.looks_max), repeat_frames: whole(c.again_frames) }
}

/// The text of a cascade that ships with the daemon, by its name. It is no part of the program and
/// has its own terms: see models/README.md.
fn shipped(name: &Path) -> Option<&'static str> {
    #[cfg(feature = "models")]
    if name == Path::new("vehicle") {
        return Some(include_str!("../../../models/vehicle.xml"));
    }
    let _ = name;
    None
}

/// The recogniser that the configuration names, for crops of up to `width` × `height`; `None`
/// when it names none.
///
/// # Errors
/// When the cascade cannot be read.
pub fn recogniser(
    config: &Config,
    width: usize,
    height: usize,
) -> Result<Option<CascadeRecogniser>, RoomError> {
    let c = &config.recognition;
    if c.cascade.as_os_str().is_empty() {
        return Ok(None);
    }
    let path = || c.cascade.clone();
    let text = match shipped(&c.cascade) {
        Some(text) => Cow::Borrowed(text),
        None => std::fs::read_to_string(&c.cascade)
            .map_err(|source| RoomError::CascadeFile { path: path(), source })?
            .into(),
    };
    let cascade = perception::recognition::xml::read(&text)
        .map_err(|source| RoomError::Cascade { path: path(), source })?;
    let parameters = RecogniserParameters {
        sizes: Sizes::Range {
            min_px: whole(c.window_min_px),
            max_px: whole(c.window_max_px),
            growth: c.growth,
        },
        growth: c.growth,
        window_m: c.window_m,
        min_neighbours: whole(c.neighbours_min),
    };
    Ok(Some(CascadeRecogniser::new(&cascade, parameters, width, height)))
}

/// Refuses a frame of another size than the run's.
fn check_size(header: &Header, width: usize, height: usize) -> Result<(), FrameError> {
    if (header.width as usize, header.height as usize) == (width, height) {
        return Ok(());
    }
    Err(FrameError::Size {
        width: header.width,
        height: header.height,
        expected_width: width,
        expected_height: height,
    })
}
