//! `lookout evaluate lidar`.

use super::stereo::{check_size, keep_out_of, set_name};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::progress;
use crate::command::console::say;
use crate::command::disparity::read_pair;
use crate::command::error::CommandError;
use crate::command::left_out::LeftOut;
use crate::stages::recognition::detectors::{Detector, RegionView, detectors};
use crate::stages::road::crop_box;
use crate::stages::road::parameters::{scene_parameters, tracker_parameters};
use crate::stages::stage::SetupError;
use crate::stages::stereo::matcher::{Backend, Method};
use clap::Args;
use config::Config;
use perception::depth::DepthView;
use perception::detection::SINGLE_PICTURE_EVIDENCE;
use perception::image::GreyView;
use perception::region::{PixelBox, Region};
use perception::rig::Rig;
use perception::scene::SceneDetector;
use perception::stereo::{DisparityView, MatchOutput};
use perception::tracking::Tracker;
use sources::calibration_file;
use sources::folder::read_grey;
use sources::truth::label::{self, Label};
use sources::truth::lidar::{LidarFrame, frames};
use sources::truth::map_file::DisparityMap;
use std::path::PathBuf;
use tools::evaluation::files::{prepare, write_report};
use tools::evaluation::label_classes::Told;
use tools::evaluation::lidar::{Disparity, LidarReport, PictureRow, judge, label_box, label_distance_m};
use tools::reporting::overlay::{self, OverlayInput};
use tools::reporting::picture::{Colour, Picture};
use tools::reporting::record::{FrameRecord, ObstacleLine, tidy};

pub const HELP: &str = "Examples:
  lookout evaluate lidar ../shared/data/kitti_depth ../shared/data/kitti_cars
  lookout evaluate lidar CARS --out results
  lookout evaluate lidar PAIRS --repeat 5

DIR has folders left, calib and gt_depth_map or gt_depth (16-bit PNG, metres x 256), and right or
labels or both; all files of a picture have the same name. Without a right picture the disparity is
computed from the depth map: this evaluates the road and the regions, not the matcher.

One line per picture: the estimated camera height above the road, regions within 40 m, and median
and 90th percentile of their distance error against LiDAR. One line per label: LiDAR distance of
its near side, the region that overlaps its box most, and that region's distance. A car is
evaluable within 40 m, with half of it in the picture and at most partly occluded; it is covered
by a region with an overlap (intersection over union) of 0.4. Its boxes are the regions that lie
mostly in its box, at a depth that it has: more than one are fragments. Labels that are not
evaluable are in brackets. told: the class that the configured detectors give the label's box after
one look, and its probability; the lines below count them by class and distance, and what was told
of regions that share no pixel with a label.

A single picture has no history: sightings with strong evidence count. --repeat N shows each picture
N times in a row, and what tracking then confirms counts.

--out writes SET/PICTURE.png (the road green, regions red, labels blue) and evaluation.json.";

#[derive(Args, Debug)]
pub struct EvaluateLidar {
    /// Folders with left pictures and LiDAR depth
    #[arg(required = true, value_name = "DIR")]
    pub sets: Vec<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Process each picture this often in a row
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub repeat: u64,
    /// Folder for pictures and the tables
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Stop at a picture that cannot be read, instead of leaving it out
    #[arg(long)]
    pub strict: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Time between repeats of a picture, in ns: that of KITTI's cameras.
const REPEAT_PERIOD_NS: u64 = 100_000_000;

const BLUE: Colour = [90, 160, 255];

/// A picture in memory, with its disparity.
struct FramePicture {
    left: Vec<u8>,
    disparity: Vec<u16>,
    confidence: Vec<u8>,
    width: usize,
    height: usize,
}

pub fn run(args: &EvaluateLidar, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "evaluate", Some("warn"))?;
    let mut named: Vec<(String, LidarFrame)> = Vec::new();
    let mut sets: Vec<String> = Vec::new();
    for root in &args.sets {
        let set = set_name(root, |name| sets.iter().any(|set| set == name));
        named.extend(frames(root)?.into_iter().map(|frame| (format!("{set}/{}", frame.name), frame)));
        sets.push(set);
    }
    let picture_file = |name: &str| PathBuf::from(format!("{name}.png"));
    if let Some(out) = &args.out {
        keep_out_of(out, args.sets.iter().map(PathBuf::as_path), "--out")?;
        prepare(out, &named.iter().map(|(name, _)| picture_file(name)).collect::<Vec<_>>())?;
    }
    let bar = progress(Some(named.len() as u64), "pictures");
    let (mut pictures, mut rows) = (Vec::new(), Vec::new());
    let (is_strict, mut unreadable) = (args.strict || config.source.strict, LeftOut::default());
    for (name, frame) in &named {
        bar.set_message(name.clone());
        let rig = calibration_file::read(&frame.calibration, true)?;
        let labels = frame.labels.as_deref().map(label::read).transpose()?.unwrap_or_default();
        let read = FramePicture::read(&config, frame, &rig);
        let Some((depth_m, seen)) = unreadable.unless_broken(name, is_strict, read)? else {
            bar.inc(1);
            continue;
        };
        let mut parameters = scene_parameters(&config, &rig);
        // A single picture confirms no boundary over time.
        parameters.regions.confirm = args.repeat > 1;
        let mut detector = SceneDetector::new(parameters, rig, seen.width, seen.height, disparities(&config));
        let scene = detector.detect(seen.depth(frame)?);
        let regions = if args.repeat == 1 {
            // A single picture has no history: strong evidence decides.
            scene.regions.iter().filter(|r| r.evidence >= SINGLE_PICTURE_EVIDENCE).copied().collect()
        } else {
            let tracker = Tracker::new(tracker_parameters(&config, &rig), rig, (seen.width, seen.height));
            confirmed(tracker, scene.regions, args.repeat)
        };
        let from = if frame.right.is_some() { Disparity::Matched } else { Disparity::DepthMap };
        let camera_m = scene.road.map(|road| road.camera_height_m);
        let mut known = Classes::new(&config, &seen)?;
        let boxes: Vec<PixelBox> =
            labels.iter().map(|label| label_box(label, seen.width, seen.height)).collect();
        let away = regions.iter().filter(|r| boxes.iter().all(|b| r.bounds.shared_area(b) == 0.0));
        let unlabelled = match frame.labels {
            Some(_) => away
                .map(|r| known.tell(r.bounds, rig.focal_px / r.distance_m, r.width_m, r.height_m))
                .collect(),
            None => Vec::new(),
        };
        pictures.push(PictureRow::new(name, from, camera_m, &depth_m, &regions, unlabelled));
        for (label, bounds) in labels.iter().zip(boxes) {
            // The box of a car that stands across is as wide as the car is long.
            let metre_px = rig.focal_px / label.distance_m;
            let told = known.tell(bounds, metre_px, f64::from(bounds.width) / metre_px, label.height_m);
            rows.push(judge(name, label, &depth_m, &regions, told));
        }
        if let Some(out) = &args.out {
            let mut picture = seen.overlay(scene.profile_px, &regions, &rig);
            for label in &labels {
                draw(&mut picture, label, label_distance_m(&depth_m, label));
            }
            picture.save(&out.join(picture_file(name)))?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    unreadable.check(named.len() as u64)?;
    let method = Method::configured(&config).name();
    let report = LidarReport::new(method, args.repeat, unreadable.count, pictures, rows);
    if let Some(out) = &args.out {
        write_report(out, &report)?;
    }
    if args.json { say(serde_json::to_string_pretty(&report)?) } else { say(&report) }
}

/// The configured detectors on one picture.
struct Classes<'a> {
    detectors: Vec<Detector>,
    image: GreyView<'a>,
}

impl<'a> Classes<'a> {
    fn new(config: &Config, seen: &'a FramePicture) -> Result<Self, CommandError> {
        let detectors = detectors(config, seen.width, seen.height).map_err(SetupError::from)?;
        Ok(Self { detectors, image: GreyView::new(&seen.left, seen.width, seen.height, seen.width)? })
    }

    /// What a look tells of a box in which a metre has so many pixels.
    fn tell(&mut self, bounds: PixelBox, metre_px: f64, width_m: f64, height_m: f64) -> Option<Told> {
        let place = crop_box(bounds, (self.image.width() as u32, self.image.height() as u32));
        let [x, y, width, height] = place.map(|v| v as usize);
        let crop = self.image.crop(x, y, width, height)?;
        let view = RegionView::of([bounds.x, bounds.y, bounds.width, bounds.height], place, crop, metre_px);
        let looks = self.detectors.iter_mut().filter(|d| d.sizes.fit(width_m, height_m));
        let told = looks.filter_map(|d| d.tell(&view)).max_by(|a, b| a.1.total_cmp(&b.1));
        told.map(|(class, probability)| Told { class: class.to_owned(), probability: tidy(probability) })
    }
}

/// The obstacles that a tracker confirms after the same sightings in so many frames.
fn confirmed(mut tracker: Tracker, sightings: &[Region], repeats: u64) -> Vec<Region> {
    for repeat in 0..repeats {
        tracker.update(repeat * REPEAT_PERIOD_NS, sightings);
    }
    tracker.confirmed().map(|track| Region { bounds: track.bounds, ..track.region }).collect()
}

fn disparities(config: &Config) -> usize {
    usize::try_from(config.stereo.disparities).unwrap_or(0)
}

impl FramePicture {
    /// The depth map of a picture, and the picture with its disparity.
    fn read(config: &Config, frame: &LidarFrame, rig: &Rig) -> Result<(DisparityMap, Self), CommandError> {
        let depth_m = frame.depth_m()?;
        let seen = Self::new(config, frame, rig, &depth_m)?;
        Ok((depth_m, seen))
    }

    /// Matches the pair, or computes the disparity from the depth map if there is no right picture.
    fn new(
        config: &Config,
        frame: &LidarFrame,
        rig: &Rig,
        depth_m: &DisparityMap,
    ) -> Result<Self, CommandError> {
        let check = |size| check_size(&frame.left, size, &frame.depth, (depth_m.width, depth_m.height));
        let Some(right) = &frame.right else {
            let (left, width, height) = read_grey(&frame.left)?;
            check((width, height))?;
            // Disparities beyond the search range of the matcher are unknown here, too.
            let limit_px = disparities(config) as f64;
            let steps = |&z: &f32| match rig.disparity_px(f64::from(z)) {
                px if z > 0.0 && px < limit_px => (px * 256.0).round() as u16,
                _ => 0,
            };
            let disparity: Vec<u16> = depth_m.px.iter().map(steps).collect();
            let confidence = vec![u8::MAX; disparity.len()];
            return Ok(Self { left, disparity, confidence, width, height });
        };
        let (left, right, width, height) = read_pair(&frame.left, right)?;
        check((width, height))?;
        let mut matcher = Method::configured(config)
            .matcher(Backend::configured(config), config, width, height, disparities(config))
            .map_err(|error| CommandError::Other(format!("{}: {error}", frame.left.display())))?;
        let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
        let view = |pixels| GreyView::new(pixels, width, height, width);
        matcher.compute(view(&left)?, view(&right)?, output)?;
        Ok(Self { left, disparity, confidence, width, height })
    }

    fn depth(&self, frame: &LidarFrame) -> Result<DepthView<'_>, CommandError> {
        DisparityView::new(&self.disparity, self.width, self.height)
            .and_then(|map| DepthView::new(map, &self.confidence))
            .ok_or_else(|| {
                let (path, width, height) = (frame.depth.display(), self.width, self.height);
                CommandError::Other(format!("{path}: its size is not {width}x{height}, that of its picture"))
            })
    }

    fn overlay(&self, profile_px: &[f32], regions: &[Region], rig: &Rig) -> Picture {
        let line = |region: &Region| ObstacleLine {
            class: "obstacle".into(),
            confirmed: true,
            x_px: region.bounds.x,
            y_px: region.bounds.y,
            width_px: region.bounds.width,
            height_px: region.bounds.height,
            distance_m: region.distance_m,
            distance_sigma_m: rig.distance_error_m(region.distance_m, region.disparity_sigma_px),
            ..ObstacleLine::default()
        };
        let record = FrameRecord { obstacles: regions.iter().map(line).collect(), ..FrameRecord::default() };
        let input = OverlayInput {
            left: &self.left,
            disparity: &self.disparity,
            profile_px,
            edges: Default::default(),
            width: self.width,
            height: self.height,
            rig: *rig,
        };
        overlay::draw(input, &record)
    }
}

/// Draws the box of a label, with its LiDAR distance below.
fn draw(picture: &mut Picture, label: &Label, lidar_m: Option<f64>) {
    let bounds = label_box(label, picture.width(), picture.height());
    picture.frame([bounds.x, bounds.y, bounds.width, bounds.height], BLUE, 1);
    let text = format!("{} {}", label.class, lidar_m.map_or("-".into(), |m| format!("{m:.1}m")));
    let below = (bounds.y + bounds.height).min(picture.height() as u32 - 14);
    picture.text(&text, bounds.x as i32, below as i32, BLUE);
}
