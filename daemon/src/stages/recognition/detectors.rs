//! The configured detectors: models, calibrations, sizes of their regions, and what each knows of the tracks.

use super::cascade;
use crate::stages::recognition::parameters::schedule_parameters;
use crate::stages::whole_number::whole;
use config::{Config, RecognitionDetector};
use messages::track::{MAX_TRACKS, TrackRecord};
use perception::image::GreyView;
use perception::recognition::calibration::CalibrationError;
use perception::recognition::hog::{HogModel, HogRecogniser, ModelError};
use perception::recognition::{
    Calibration, CascadeRecogniser, Recogniser, RecogniserParameters, Recognition, Sizes, xml,
};
use perception::tracking::Obstacle;
use perception::tracking::classification_schedule::{ClassificationSchedule, ScheduleParameters};
use sources::bounded_file;
use sources::limits::{HOG_MODEL, SCORE_CALIBRATION};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Minimum width and height of a region that the first detector classifies, as a share of its window. Smaller regions
/// (posts, kerbs) can only be parts of an object.
const MIN_SHARE: f64 = 0.35;

/// The key of the first detector, and that of the others.
pub const FIRST: &str = "recognition.cascade";
const OTHERS: &str = "recognition.detectors";

/// What is wrong with the content of a file.
#[derive(Debug, Error)]
pub enum ContentError {
    /// It is no cascade.
    #[error(transparent)]
    Cascade(#[from] xml::CascadeError),
    /// It is no HOG model.
    #[error("{0}: give a HOG model, as models/people.hog")]
    Hog(#[from] ModelError),
    /// It is no calibration.
    #[error("{0}: remove the file, or write it with lookout evaluate classes --calibrate")]
    Calibration(#[from] CalibrationError),
}

/// Why a configured detector cannot be used.
#[derive(Debug, Error)]
pub enum DetectorError {
    /// The file cannot be read.
    #[error("{key}: {}: {source}: {remedy}", path.display())]
    File {
        /// The key that names it.
        key: &'static str,
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
        /// What to give.
        remedy: &'static str,
    },
    /// The file is not what it should be.
    #[error("{key}: {}: {source}", path.display())]
    Content {
        /// The key that names it.
        key: &'static str,
        /// The file.
        path: PathBuf,
        /// The cause.
        source: ContentError,
    },
}

impl DetectorError {
    /// The key that names the file.
    pub fn key(&self) -> &'static str {
        match self {
            Self::File { key, .. } | Self::Content { key, .. } => key,
        }
    }
}

const CASCADE_REMEDY: &str = "give an OpenCV cascade XML, vehicle for the one that ships (not in a build without the \
                              feature models), or \"\" for none; a HOG model stands in [[recognition.detectors]]";
const HOG_REMEDY: &str = "give a HOG model, or people for the one that ships";

/// Minimum and maximum sides of the regions that a detector looks at, in metres.
#[derive(Clone, Copy, Debug)]
pub struct RegionSizes {
    width_m: (f64, f64),
    height_m: (f64, f64),
}

impl RegionSizes {
    /// Whether a track is of this size.
    pub fn fit(&self, track: &TrackRecord) -> bool {
        let within = |v: f64, (low, high): (f64, f64)| v >= low && v <= high;
        within(track.width_m, self.width_m) && within(track.height_m, self.height_m)
    }
}

/// A recogniser of one class.
pub struct Detector {
    recogniser: Box<dyn Recogniser>,
    /// Name of the class.
    pub label: String,
    /// Its regions.
    pub sizes: RegionSizes,
    calibration: Calibration,
    /// What it knows of the tracks.
    pub schedule: ClassificationSchedule,
}

impl Detector {
    /// Looks at the crop of a track.
    pub fn look(&mut self, crop: GreyView<'_>, metre_px: f64) -> Option<Recognition> {
        self.recogniser.recognise(crop, Some(metre_px))
    }

    /// Looks at some of the obstacles: `crop` gives the crop of one, and the size of a metre there in pixels; `None` for an
    /// obstacle that is not looked at.
    pub fn classify<'a>(
        &mut self,
        obstacles: &[Obstacle],
        crop: impl Fn(usize, &RegionSizes) -> Option<(GreyView<'a>, f64)>,
    ) {
        let Self { recogniser, sizes, calibration, schedule, .. } = self;
        let may = |i: usize| crop(i, sizes).is_some();
        schedule.classify(obstacles, may, |i| {
            let (crop, metre_px) = crop(i, sizes)?;
            Some(calibration.evidence(recogniser.recognise(crop, Some(metre_px))))
        });
    }

    fn new(
        recogniser: Box<dyn Recogniser>,
        label: &str,
        calibration: Calibration,
        schedule: ScheduleParameters,
        sizes: RegionSizes,
    ) -> Self {
        let schedule = ScheduleParameters { prior: calibration.prior, ..schedule };
        Self {
            recogniser,
            label: label.to_owned(),
            sizes,
            calibration,
            schedule: ClassificationSchedule::new(schedule, MAX_TRACKS),
        }
    }
}

/// The configured detectors, for crops of up to `width` × `height` pixels: that of `recognition.cascade`, unless it is
/// empty, then those of `recognition.detectors`.
///
/// # Errors
/// If a file cannot be read.
pub fn detectors(config: &Config, width: usize, height: usize) -> Result<Vec<Detector>, DetectorError> {
    let c = &config.recognition;
    let size = (width, height);
    let mut detectors = Vec::with_capacity(1 + c.detectors.len());
    if !c.cascade.as_os_str().is_empty() {
        let recogniser = cascade_recogniser(config, FIRST, &c.cascade, c.window_m, size)?;
        let calibration = calibration(FIRST, &c.cascade, Calibration::VOTES)?;
        let least = MIN_SHARE * c.window_m;
        let schedule = schedule_parameters(config);
        let sides = (least, f64::INFINITY);
        let sizes = RegionSizes { width_m: sides, height_m: sides };
        detectors.push(Detector::new(recogniser, &c.label, calibration, schedule, sizes));
    }
    for d in &c.detectors {
        detectors.push(further(config, d, size)?);
    }
    Ok(detectors)
}

/// A detector of `recognition.detectors`.
fn further(
    config: &Config,
    d: &RecognitionDetector,
    (width, height): (usize, usize),
) -> Result<Detector, DetectorError> {
    let (recogniser, default): (Box<dyn Recogniser>, _) = if d.kind == "hog" {
        let text = hog_text(&d.model).map_err(|source| DetectorError::File {
            key: OTHERS,
            path: d.model.clone(),
            source,
            remedy: HOG_REMEDY,
        })?;
        let model = HogModel::read(&text).map_err(|e| content(OTHERS, &d.model, e))?;
        let parameters = parameters(config, d.window_m);
        let recogniser = HogRecogniser::new(model, parameters, d.threshold as f32, width, height);
        (Box::new(recogniser), Calibration::SVM)
    } else {
        let recogniser = cascade_recogniser(config, OTHERS, &d.model, d.window_m, (width, height))?;
        (recogniser, Calibration::VOTES)
    };
    let calibration = calibration(OTHERS, &d.model, default)?;
    let schedule = ScheduleParameters { max_per_frame: whole(d.looks_max), ..schedule_parameters(config) };
    let sizes =
        RegionSizes { width_m: (d.width_min_m, d.width_max_m), height_m: (d.height_min_m, d.height_max_m) };
    Ok(Detector::new(recogniser, &d.label, calibration, schedule, sizes))
}

fn content(key: &'static str, path: &Path, source: impl Into<ContentError>) -> DetectorError {
    DetectorError::Content { key, path: path.to_owned(), source: source.into() }
}

/// The search of a window that is `window_m` wide at the object.
fn parameters(config: &Config, window_m: f64) -> RecogniserParameters {
    let c = &config.recognition;
    RecogniserParameters {
        sizes: Sizes::Range {
            min_px: whole(c.window_min_px),
            max_px: whole(c.window_max_px),
            growth: c.growth,
        },
        growth: c.growth,
        window_m,
        min_neighbours: whole(c.neighbours_min),
    }
}

fn cascade_recogniser(
    config: &Config,
    key: &'static str,
    path: &Path,
    window_m: f64,
    (width, height): (usize, usize),
) -> Result<Box<dyn Recogniser>, DetectorError> {
    let text = cascade::text(path).map_err(|source| DetectorError::File {
        key,
        path: path.to_owned(),
        source,
        remedy: CASCADE_REMEDY,
    })?;
    let cascade = xml::read(&text).map_err(|e| content(key, path, e))?;
    Ok(Box::new(CascadeRecogniser::new(&cascade, parameters(config, window_m), width, height)))
}

/// The text of a HOG model: of the one that ships, by its name, or of a file.
///
/// # Errors
/// If the file cannot be read, or is too large.
pub fn hog_text(path: &Path) -> std::io::Result<Cow<'static, str>> {
    if path == Path::new(cascade::PEOPLE) {
        return Ok(Cow::Borrowed(include_str!("../../../../models/people.hog")));
    }
    bounded_file::read_text(path, &HOG_MODEL).map(Cow::Owned)
}

/// What the scores of a model say: from the file beside it, or `default` where there is none.
fn calibration(key: &'static str, model: &Path, default: Calibration) -> Result<Calibration, DetectorError> {
    let mut name = model.as_os_str().to_owned();
    name.push(".calibration");
    let path = PathBuf::from(name);
    match bounded_file::read_text(&path, &SCORE_CALIBRATION) {
        Ok(text) => Calibration::read(&text).map_err(|e| content(key, &path, e)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(default),
        Err(source) => {
            let remedy = "remove the file, or write it with lookout evaluate classes --calibrate";
            Err(DetectorError::File { key, path, source, remedy })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitting(config: &Config, width_m: f64, height_m: f64) -> Vec<String> {
        let track = TrackRecord { width_m, height_m, ..TrackRecord::default() };
        let detectors = detectors(config, 64, 128).unwrap();
        detectors.iter().filter(|d| d.sizes.fit(&track)).map(|d| d.label.clone()).collect()
    }

    fn with_people() -> Config {
        let mut config = Config::default();
        config.recognition.detectors = vec![RecognitionDetector::default()];
        config
    }

    #[cfg(feature = "models")]
    #[test]
    fn detectors_look_at_regions_of_their_size() {
        let config = with_people();
        assert_eq!(fitting(&config, 1.8, 1.5), ["vehicle"]);
        assert_eq!(fitting(&config, 0.55, 1.75), ["pedestrian"]);
        assert_eq!(fitting(&config, 1.0, 1.8), ["vehicle", "pedestrian"]);
        assert!(fitting(&config, 0.1, 1.7).is_empty() && fitting(&config, 0.5, 0.5).is_empty());
    }

    #[test]
    fn without_a_cascade_people_are_found() {
        let mut config = with_people();
        config.recognition.cascade = PathBuf::new();
        assert_eq!(fitting(&config, 1.0, 1.8), ["pedestrian"]);
        config.recognition.detectors.clear();
        assert!(detectors(&config, 64, 128).unwrap().is_empty());
    }

    #[test]
    fn models_and_calibrations_that_cannot_be_used_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("mine.hog");
        let mut config = with_people();
        config.recognition.cascade = PathBuf::new();
        config.recognition.detectors[0].model.clone_from(&model);
        let error = |config: &Config| detectors(config, 64, 128).err().unwrap();
        let missing = error(&config);
        assert_eq!(missing.key(), OTHERS);
        assert!(
            missing.to_string().contains("mine.hog") && missing.to_string().contains("people"),
            "{missing}"
        );
        std::fs::write(&model, "lookout-hog 1\nwindow 64 127\n").unwrap();
        let wrong = error(&config).to_string();
        assert!(wrong.starts_with("recognition.detectors: ") && wrong.contains("line 2"), "{wrong}");
        std::fs::write(&model, hog_text(Path::new("people")).unwrap().as_bytes()).unwrap();
        let uncalibrated = detectors(&config, 64, 128).unwrap();
        assert_eq!(uncalibrated[0].calibration, Calibration::SVM);
        std::fs::write(folder.path().join("mine.hog.calibration"), "prior 1\n").unwrap();
        let wrong = error(&config).to_string();
        assert!(wrong.contains("mine.hog.calibration: line 1"), "{wrong}");
        let own = Calibration { prior: -1.0, miss: -2.0, offset: 0.5, slope: 1.0 };
        std::fs::write(folder.path().join("mine.hog.calibration"), own.to_string()).unwrap();
        assert_eq!(detectors(&config, 64, 128).unwrap()[0].calibration, own);
    }
}
