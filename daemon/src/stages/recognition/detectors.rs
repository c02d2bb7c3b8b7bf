//! The configured detectors: models, calibrations, sizes of their regions, and what each knows of the tracks.

use super::cascade;
use crate::stages::recognition::parameters::schedule_parameters;
use crate::stages::whole_number::whole;
use config::{Config, RecognitionDetector};
use messages::track::{MAX_TRACKS, TrackRecord};
use perception::image::GreyView;
use perception::recognition::calibration::CalibrationError;
use perception::recognition::hog::{HogModel, HogRecogniser, ModelError};
use perception::recognition::network::properties::OTHER;
use perception::recognition::network::sample::Rectangle;
use perception::recognition::network::{Network, NetworkError, NetworkRecogniser};
use perception::recognition::{
    Calibration, CascadeRecogniser, MAX_CLASSES, Recogniser, RecogniserParameters, Recognition, Sizes, xml,
};
use perception::tracking::Obstacle;
use perception::tracking::classification_schedule::{ClassificationSchedule, ScheduleParameters};
use sources::bounded_file;
use sources::limits::{HOG_MODEL, NETWORK, SCORE_CALIBRATION};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Minimum width and height of a region that the first detector classifies, as a share of its window. Smaller regions
/// (posts, kerbs) can only be parts of an object.
const MIN_SHARE: f64 = 0.35;

/// Minimum width and height of a region that the network classifies, in metres: a child, seen from the side.
const MIN_NETWORK_M: (f64, f64) = (0.2, 0.6);

/// Log-odds of a class, at most, of what does not have its size: a house front is no vehicle, whatever it looks like.
const NO_SIZE_LOG_ODDS: f32 = -3.0;

/// The keys of the network, of the first cascade, and of the other detectors.
pub const FIRST: &str = "recognition.network";
const CASCADE: &str = "recognition.cascade";
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
    /// It is no network.
    #[error("{0}: give an ONNX file, as models/objects.onnx (docs/recognition.md)")]
    Network(#[from] NetworkError),
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
const NETWORK_REMEDY: &str = "give an ONNX file, objects for the network that ships, or \"\" for none";
const HOG_REMEDY: &str = "give a HOG model, or people for the one that ships";

/// Minimum and maximum sides of the regions that a detector looks at, in metres.
#[derive(Clone, Copy, Debug)]
pub struct RegionSizes {
    width_m: (f64, f64),
    height_m: (f64, f64),
}

impl RegionSizes {
    /// Whether a region of this width and height is looked at.
    pub fn fit(&self, width_m: f64, height_m: f64) -> bool {
        let within = |v: f64, (low, high): (f64, f64)| v >= low && v <= high;
        within(width_m, self.width_m) && within(height_m, self.height_m)
    }
}

/// What a detector looks at.
#[derive(Clone, Copy, Debug)]
pub struct RegionView<'a> {
    /// The region with a margin.
    pub crop: GreyView<'a>,
    /// The region, in pixels of the crop.
    pub region: Rectangle,
    /// A metre there, in pixels.
    pub metre_px: f64,
}

impl<'a> RegionView<'a> {
    /// The view of a track, given its crop.
    pub fn new(record: &TrackRecord, crop: GreyView<'a>, baseline_m: f64) -> Self {
        Self::of(record.bounds, record.crop, crop, record.disparity_px / baseline_m)
    }

    /// The view of a box (left, top, width, height) whose crop has this place.
    pub fn of(bounds: [u32; 4], place: [u32; 4], crop: GreyView<'a>, metre_px: f64) -> Self {
        let [left, top, ..] = place.map(f64::from);
        let [x, y, width, height] = bounds.map(f64::from);
        let region = Rectangle {
            x: (x - left) as f32,
            y: (y - top) as f32,
            width: width.max(1.0) as f32,
            height: height.max(1.0) as f32,
        };
        Self { crop, region, metre_px }
    }
}

/// How a detector recognises.
enum Model {
    /// It searches windows for one class; the calibration says what a score means.
    Windows(Box<dyn Recogniser>, Calibration),
    /// It tells several classes; for each, its number in the output.
    Network(Box<NetworkRecogniser>, [Option<usize>; MAX_CLASSES]),
}

impl Model {
    /// What is found of each class.
    fn look(&mut self, view: &RegionView<'_>) -> [Option<Recognition>; MAX_CLASSES] {
        let mut found = [None; MAX_CLASSES];
        match self {
            Self::Windows(recogniser, _) => found[0] = recogniser.recognise(view.crop, Some(view.metre_px)),
            Self::Network(recogniser, outputs) => {
                let [width_m, height_m] =
                    [view.region.width, view.region.height].map(|px| f64::from(px) / view.metre_px);
                let may_be = |output: usize, recogniser: &NetworkRecogniser| {
                    recogniser.sizes().get(output).is_some_and(|size| size.fits(width_m, height_m))
                };
                let fits = outputs.map(|output| output.is_some_and(|output| may_be(output, recogniser)));
                let log_odds = recogniser.classify(view.crop, view.region);
                for ((found, output), fits) in found.iter_mut().zip(outputs.iter()).zip(fits) {
                    let Some(output) = *output else { continue };
                    let told = log_odds.get(output).copied().unwrap_or(0.0);
                    let score = if fits { told } else { told.min(NO_SIZE_LOG_ODDS) };
                    let [width, height] = [view.crop.width(), view.crop.height()].map(|side| side as u32);
                    *found = Some(Recognition { score, x: 0, y: 0, width, height });
                }
            }
        }
        found
    }

    /// What a look adds to the log-odds of each class.
    fn evidence(&mut self, view: &RegionView<'_>) -> [f64; MAX_CLASSES] {
        let found = self.look(view);
        match self {
            Self::Windows(_, calibration) => found.map(|found| calibration.evidence(found)),
            Self::Network(..) => found.map(|found| Calibration::LOG_ODDS.evidence(found)),
        }
    }
}

/// A recogniser of one class or several.
pub struct Detector {
    model: Model,
    /// Names of the classes.
    pub labels: Vec<String>,
    /// Its regions.
    pub sizes: RegionSizes,
    /// What it knows of the tracks.
    pub schedule: ClassificationSchedule,
}

impl Detector {
    /// What it finds of each of its classes in a region. The score of a network is the log-odds of the class, below zero
    /// where it is less likely than not.
    pub fn look(&mut self, view: &RegionView<'_>) -> [Option<Recognition>; MAX_CLASSES] {
        self.model.look(view)
    }

    /// Whether its scores are log-odds, which need no calibration.
    pub fn is_network(&self) -> bool {
        matches!(self.model, Model::Network(..))
    }

    /// Looks at some of the obstacles: `view` gives the view of one; `None` for an obstacle that is not looked at.
    pub fn classify<'a>(
        &mut self,
        obstacles: &[Obstacle],
        view: impl Fn(usize, &RegionSizes) -> Option<RegionView<'a>>,
    ) {
        let Self { model, sizes, schedule, .. } = self;
        let may = |i: usize| view(i, sizes).is_some();
        schedule.classify(obstacles, may, |i| Some(model.evidence(&view(i, sizes)?)));
    }

    /// The class that one look makes more likely than not, with its probability.
    pub fn tell(&mut self, view: &RegionView<'_>) -> Option<(&str, f64)> {
        let evidence = self.model.evidence(view);
        let classes = self.labels.iter().zip(evidence).filter(|(_, log_odds)| *log_odds > 0.0);
        let (label, log_odds) = classes.max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((label, 1.0 / (1.0 + (-log_odds).exp())))
    }

    fn new(model: Model, labels: Vec<String>, schedule: ScheduleParameters, sizes: RegionSizes) -> Self {
        let prior = match &model {
            Model::Windows(_, calibration) => calibration.prior,
            Model::Network(..) => 0.0,
        };
        let schedule = ScheduleParameters { prior, ..schedule };
        Self { model, labels, sizes, schedule: ClassificationSchedule::new(schedule, MAX_TRACKS) }
    }
}

/// The configured detectors, for crops of up to `width` × `height` pixels: the network, the cascade, unless their keys are
/// empty, then those of `recognition.detectors`.
///
/// # Errors
/// If a file cannot be read.
pub fn detectors(config: &Config, width: usize, height: usize) -> Result<Vec<Detector>, DetectorError> {
    let c = &config.recognition;
    let size = (width, height);
    let mut detectors = Vec::with_capacity(2 + c.detectors.len());
    if !c.network.as_os_str().is_empty() {
        let (model, labels) = network(FIRST, &c.network, size)?;
        let (width_m, height_m) = MIN_NETWORK_M;
        let sizes = RegionSizes { width_m: (width_m, f64::INFINITY), height_m: (height_m, f64::INFINITY) };
        detectors.push(Detector::new(model, labels, schedule_parameters(config), sizes));
    }
    if !c.cascade.as_os_str().is_empty() {
        let recogniser = cascade_recogniser(config, CASCADE, &c.cascade, c.window_m, size)?;
        let calibration = calibration(CASCADE, &c.cascade, Calibration::VOTES)?;
        let least = MIN_SHARE * c.window_m;
        let schedule = schedule_parameters(config);
        let sides = (least, f64::INFINITY);
        let sizes = RegionSizes { width_m: sides, height_m: sides };
        let model = Model::Windows(recogniser, calibration);
        detectors.push(Detector::new(model, vec![c.label.clone()], schedule, sizes));
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
    let (model, labels) = match &d.kind[..] {
        "network" => network(OTHERS, &d.model, (width, height))?,
        "hog" => {
            let text = hog_text(&d.model).map_err(|source| DetectorError::File {
                key: OTHERS,
                path: d.model.clone(),
                source,
                remedy: HOG_REMEDY,
            })?;
            let model = HogModel::read(&text).map_err(|e| content(OTHERS, &d.model, e))?;
            let parameters = parameters(config, d.window_m);
            let recogniser = HogRecogniser::new(model, parameters, d.threshold as f32, width, height);
            let calibration = calibration(OTHERS, &d.model, Calibration::SVM)?;
            (Model::Windows(Box::new(recogniser), calibration), vec![d.label.clone()])
        }
        _ => {
            let recogniser = cascade_recogniser(config, OTHERS, &d.model, d.window_m, (width, height))?;
            let calibration = calibration(OTHERS, &d.model, Calibration::VOTES)?;
            (Model::Windows(recogniser, calibration), vec![d.label.clone()])
        }
    };
    let schedule = ScheduleParameters { max_per_frame: whole(d.looks_max), ..schedule_parameters(config) };
    let sizes =
        RegionSizes { width_m: (d.width_min_m, d.width_max_m), height_m: (d.height_min_m, d.height_max_m) };
    Ok(Detector::new(model, labels, schedule, sizes))
}

/// A network, and the names of its classes.
fn network(
    key: &'static str,
    path: &Path,
    (width, height): (usize, usize),
) -> Result<(Model, Vec<String>), DetectorError> {
    let bytes = network_bytes(path).map_err(|source| DetectorError::File {
        key,
        path: path.to_owned(),
        source,
        remedy: NETWORK_REMEDY,
    })?;
    let network = Network::read(&bytes).map_err(|e| content(key, path, e))?;
    let known = network.labels().iter().enumerate().filter(|(_, label)| *label != OTHER);
    let (mut outputs, mut labels) = ([None; MAX_CLASSES], Vec::new());
    for (place, (output, label)) in outputs.iter_mut().zip(known) {
        *place = Some(output);
        labels.push(label.clone());
    }
    Ok((Model::Network(Box::new(NetworkRecogniser::new(network, width, height)), outputs), labels))
}

/// The bytes of a network: of one that ships, by its name, or of a file.
///
/// # Errors
/// If the file cannot be read, or is too large.
pub fn network_bytes(path: &Path) -> std::io::Result<Cow<'static, [u8]>> {
    const FREE: &[u8] = include_bytes!("../../../../models/objects-free.onnx");
    #[cfg(feature = "models")]
    const OBJECTS: &[u8] = include_bytes!("../../../../models/objects.onnx");
    #[cfg(not(feature = "models"))]
    const OBJECTS: &[u8] = FREE;
    match path.to_str() {
        Some("objects") => Ok(Cow::Borrowed(OBJECTS)),
        Some("objects-free") => Ok(Cow::Borrowed(FREE)),
        _ => bounded_file::read(path, &NETWORK).map(Cow::Owned),
    }
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
        let detectors = detectors(config, 64, 128).unwrap();
        detectors.iter().filter(|d| d.sizes.fit(width_m, height_m)).flat_map(|d| d.labels.clone()).collect()
    }

    fn with_people() -> Config {
        let mut config = Config::default();
        config.recognition.network = PathBuf::new();
        config.recognition.detectors = vec![RecognitionDetector::default()];
        config
    }

    fn calibration_of(detector: &Detector) -> Calibration {
        match detector.model {
            Model::Windows(_, calibration) => calibration,
            Model::Network(..) => unreachable!("a network has none"),
        }
    }

    #[test]
    fn the_network_that_ships_tells_its_classes() {
        for name in ["objects", "objects-free"] {
            let mut config = Config::default();
            config.recognition.network = name.into();
            assert_eq!(fitting(&config, 1.8, 1.5), ["vehicle", "pedestrian", "rider"]);
            assert_eq!(fitting(&config, 0.3, 1.0), ["vehicle", "pedestrian", "rider"]);
            assert!(fitting(&config, 1.8, 0.4).is_empty());
            // A flat picture is nothing that it knows.
            let pixels = [90; 64 * 64];
            let crop = GreyView::new(&pixels, 64, 64, 64).unwrap();
            let region = Rectangle { x: 12.0, y: 12.0, width: 40.0, height: 40.0 };
            let mut detectors = detectors(&config, 64, 64).unwrap();
            let found = detectors[0].look(&RegionView { crop, region, metre_px: 20.0 });
            let scores: Vec<f32> = found.iter().flatten().map(|f| f.score).collect();
            assert!(scores.len() == 3 && scores.iter().all(|score| score.abs() < 20.0), "{scores:?}");
        }
    }

    #[test]
    fn the_region_of_a_view_lies_in_its_crop() {
        let record = TrackRecord {
            bounds: [100, 50, 40, 30],
            crop: [92, 44, 56, 42],
            disparity_px: 12.0,
            ..TrackRecord::default()
        };
        let pixels = [0; 56 * 42];
        let view = RegionView::new(&record, GreyView::new(&pixels, 56, 42, 56).unwrap(), 0.5);
        assert_eq!(view.region, Rectangle { x: 8.0, y: 6.0, width: 40.0, height: 30.0 });
        assert_eq!(view.metre_px, 24.0);
    }

    #[cfg(feature = "models")]
    #[test]
    fn detectors_look_at_regions_of_their_size() {
        let mut config = with_people();
        config.recognition.cascade = "vehicle".into();
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
        assert_eq!(calibration_of(&uncalibrated[0]), Calibration::SVM);
        std::fs::write(folder.path().join("mine.hog.calibration"), "prior 1\n").unwrap();
        let wrong = error(&config).to_string();
        assert!(wrong.contains("mine.hog.calibration: line 1"), "{wrong}");
        let own = Calibration { prior: -1.0, miss: -2.0, offset: 0.5, slope: 1.0 };
        std::fs::write(folder.path().join("mine.hog.calibration"), own.to_string()).unwrap();
        assert_eq!(calibration_of(&detectors(&config, 64, 128).unwrap()[0]), own);
        // The same file is no network.
        config.recognition.detectors[0].kind = "network".into();
        let wrong = error(&config).to_string();
        assert!(wrong.contains("mine.hog: no ONNX file") && wrong.contains("objects.onnx"), "{wrong}");
        config.recognition.network = folder.path().join("gone.onnx");
        let missing = error(&config);
        assert_eq!(missing.key(), FIRST);
        assert!(missing.to_string().contains("gone.onnx"), "{missing}");
    }
}
