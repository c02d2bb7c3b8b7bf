//! The stage road: `depth` to `regions`: road, sightings of obstacles, and their tracks.

pub mod own_motion;
pub mod parameters;
pub mod space;

use super::motion::body;
use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::FrameFormat;
use crate::stages::track_record;
use config::Config;
use messages::alarm::Faults;
use messages::depth::{Depth, DepthMessage};
use messages::header::MessageError;
use messages::motion::MotionRecord;
use messages::regions;
use messages::regions::{Counts, EdgeRecord, RegionRecord, RegionsMessage, RoadRecord};
use messages::source_time::SourceTimeRecord;
use messages::track::TrackRecord;
use messages::typed::{Output, Written};
use own_motion::OwnMotion;
use perception::depth::DepthView;
use perception::frame_clock::{FrameClock, TimeStep};
use perception::frozen_picture::FrozenPicture;
use perception::image::GreyView;
use perception::image_quality::{TextureMonitor, road_texture};
use perception::motion::body::Body;
use perception::motion::planar::PlanarStep;
use perception::range::Range;
use perception::region::{PixelBox, Region};
use perception::rig::Rig;
use perception::road::edges::Edge;
use perception::scene::SceneDetector;
use perception::stereo::DisparityView;
use perception::tracking::image_motion::ImageMotionMeter;
use perception::tracking::{Frame, Track, Tracker};

// The message holds the arrays of the algorithm as they are.
const _: () = assert!(perception::road::edges::SEGMENTS == regions::SEGMENTS);

/// Margin of a crop on each side of its obstacle, as a share of the obstacle's size: room for the search windows of the
/// cascade.
const CROP_MARGIN: f64 = 0.2;

/// Minimum width and height of a crop, in pixels.
const MIN_CROP: u32 = 32;

/// Adapter of the scene detector (road model and sightings) and of the tracker.
pub struct RoadStage {
    detector: SceneDetector,
    tracker: Tracker,
    image_motion: ImageMotionMeter,
    /// Sequence of the first frame whose tracks have these numbers.
    tracks_since: Option<u32>,
    own_motion: OwnMotion,
    body: Body,
    clock: FrameClock,
    frozen: FrozenPicture,
    rig: Rig,
    range: Range,
    path_width_m: f64,
    /// Self-check whether the road has enough texture for matching; `None` without `alarm.self_check`.
    texture: Option<TextureMonitor>,
    is_sparse: bool,
    width: usize,
    height: usize,
}

impl Stage for RoadStage {
    type In = DepthMessage;
    type Out = RegionsMessage;

    fn new(config: &Config, format: &FrameFormat) -> Result<Self, SetupError> {
        let (width, height) = (format.width, format.height);
        let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
        let detector = SceneDetector::new(
            parameters::scene_parameters(config, &format.rig()),
            format.rig(),
            width,
            height,
            disparities,
        );
        Ok(Self {
            detector,
            tracker: Tracker::new(
                parameters::tracker_parameters(config, &format.rig()),
                format.rig(),
                (width, height),
            )
            .with_body(body(config)),
            image_motion: ImageMotionMeter::new(width, height),
            tracks_since: None,
            body: body(config),
            own_motion: OwnMotion::new(config.motion.odometry, format.rig(), (width, height)),
            clock: FrameClock::default(),
            frozen: FrozenPicture::default(),
            rig: format.rig(),
            range: parameters::range(config, &format.rig()),
            path_width_m: config.alarm.path_width_m,
            texture: config.alarm.self_check.then(TextureMonitor::default),
            is_sparse: false,
            width,
            height,
        })
    }

    fn process(
        &mut self,
        frame: &FrameContext,
        depth: Depth<'_>,
        output: Output<'_, RegionsMessage>,
    ) -> Result<Written, FrameError> {
        let picture = |data| GreyView::new(data, self.width, self.height, self.width);
        let (left, right) = (picture(depth.left)?, picture(depth.right)?);
        let disparity = DisparityView::new(depth.disparity, self.width, self.height)
            .ok_or(MessageError::Length { given: depth.disparity.len(), needed: self.width * self.height })?;
        let depth_view = DepthView::new(disparity, depth.confidence)
            .and_then(|view| view.with_images([left, right]))
            .ok_or(MessageError::Length {
                given: depth.confidence.len(),
                needed: self.width * self.height,
            })?;
        let step = self.clock.step(frame.source_ns);
        let since_s = self.frozen.update([left, right], self.own_motion.motion().as_ref(), step);
        let is_frozen = since_s.is_none();
        let motion = self.own_motion.update(frame, step, (!is_frozen).then_some((left, disparity)));
        let sequence = frame.sequence as u32;
        if step.is_discontinuity() {
            self.detector.reset();
            self.image_motion.reset();
            self.tracks_since = Some(sequence);
        }
        let tracks_since = *self.tracks_since.get_or_insert(sequence);
        // A frozen picture is of the time of the one before; the next new one, of all the time since then.
        let elapsed_s = since_s.unwrap_or(0.0);
        let moved = motion.map(|motion| PlanarStep::of(&motion, &self.body, elapsed_s));
        self.detector.set_own_motion(moved.filter(|_| elapsed_s > 0.0 || is_frozen));
        self.detector.set_elapsed_s(elapsed_s);
        // While the speed is unknown the range stays.
        if let Some(motion) = motion {
            let range_m = self.range.at_m(motion.speed_m_s);
            self.detector.set_range_m(range_m);
            self.tracker.set_range_m(range_m);
        }
        let scene = self.detector.detect(depth_view);
        let verifier = scene.verifier;
        // In a frozen picture everything is where it was: sightings there would stop what stands, and let it jump in the next picture.
        let regions = if is_frozen { &[] } else { scene.regions };
        if is_frozen {
            self.tracker.coast(frame.source_ns, motion);
        } else {
            self.tracker.follow(&Frame {
                time_ns: frame.source_ns,
                sightings: regions,
                motion,
                points: self.own_motion.scene_points(),
                could_detect: scene.road.is_some(),
                verify: &|region| Some(verifier?.verify(region)?.evidence()),
                before_wall: &|points_m, height_m| scene.before_wall(points_m, height_m),
            });
        }
        if step != TimeStep::Repeated && !is_frozen {
            let size = (self.width as u32, self.height as u32);
            let crop = |track: &Track| {
                let [x, y, width, height] = crop_box(track.bounds, size);
                let crop = left.crop(x as usize, y as usize, width as usize, height as usize)?;
                Some((crop, (x, y)))
            };
            self.tracker.measure_image_motion(&mut self.image_motion, frame.source_ns, crop);
        }
        if let Some(check) = &mut self.texture {
            let texture = road_texture(left, scene.profile_px, &self.rig, self.path_width_m);
            self.is_sparse = check.update(texture);
        }
        let road = scene.road.map_or_else(RoadRecord::default, |road| {
            RoadRecord {
                seen: 1,
                slope: road.line.slope,
                horizon_px: road.line.horizon_px,
                roll: road.roll,
                confidence: road.confidence,
                camera_height_m: road.camera_height_m,
                space: space::space_record(scene.free, scene.boundaries),
                edges: scene.edges.map(|sides| sides.map(|edge| edge.map(edge_record).unwrap_or_default())),
                ..RoadRecord::default()
            }
            .limited()
        });
        let road = RoadRecord { tracks_since, ..road };
        let tracks = self.tracker.tracks().iter().filter(|track| !track.is_part_of_boundary());
        let counts = Counts { regions: regions.len(), tracks: tracks.clone().count() };
        let mut writer = output.begin(road, scene.profile_px, counts)?;
        for (i, region) in regions.iter().enumerate() {
            writer.push_region(&record(region, self.tracker.track_of(i)));
        }
        for track in tracks {
            let (record, rows) = self.track_record(track, left);
            writer.push_track(record, rows);
        }
        Ok(writer.finish())
    }

    fn motion(&self) -> Option<MotionRecord> {
        Some(self.own_motion.record())
    }

    fn source_time(&self) -> SourceTimeRecord {
        // The last stage counts the steps of the time.
        SourceTimeRecord { dropped_obstacles: self.tracker.dropped(), ..SourceTimeRecord::default() }
    }

    fn faults(&self) -> Faults {
        let is_checked = self.texture.is_some();
        Faults::SPARSE.when(self.is_sparse).and(Faults::FROZEN.when(is_checked && self.frozen.lasts()))
    }
}

impl RoadStage {
    /// The record of a track, and the rows of its crop. What is only predicted has none: the recogniser would see something
    /// else there.
    fn track_record<'l>(
        &self,
        track: &Track,
        left: GreyView<'l>,
    ) -> (TrackRecord, impl Iterator<Item = &'l [u8]> + use<'l>) {
        let is_seen = track.missed == 0;
        // The whole thing, and what was seen of it in this frame.
        let all = track.bounds.joined(&track.region.bounds);
        let place = crop_box(all, (self.width as u32, self.height as u32));
        let [x, y, width, height] = place.map(|v| v as usize);
        let crop = left.crop(x, y, width, height).filter(|_| is_seen);
        let record = TrackRecord {
            crop: if crop.is_some() { place } else { [0; 4] },
            ..track_record::record(&track.state(), &self.rig)
        };
        (record, (0..height).filter_map(move |row| crop.map(|c| c.row(row))))
    }
}

/// The record of an edge.
fn edge_record(edge: Edge) -> EdgeRecord {
    let Edge { lateral_m, step_m, distance_m, x_px, y_px } = edge;
    EdgeRecord { step_m, lateral_m, distance_m, x_px, y_px }
}

/// The record of a region, which belongs to this track (0: to none).
fn record(region: &Region, track: u32) -> RegionRecord {
    let b = region.bounds;
    RegionRecord {
        disparity_px: region.disparity_px,
        disparity_sigma_px: region.disparity_sigma_px,
        distance_m: region.distance_m,
        lateral_m: region.lateral_m,
        width_m: region.width_m,
        height_m: region.height_m,
        confidence: region.confidence,
        evidence: region.evidence,
        inset_m: region.inset_m,
        bounds: [b.x, b.y, b.width, b.height],
        pixels: region.pixels,
        track,
    }
    .limited()
}

/// The crop of a box in an image of `size` (width, height): left, top, width, height.
pub fn crop_box(b: PixelBox, (width, height): (u32, u32)) -> [u32; 4] {
    let grow = |start: u32, side: u32, limit: u32| {
        let margin = ((f64::from(side) * CROP_MARGIN) as u32).max(MIN_CROP.saturating_sub(side).div_ceil(2));
        let from = start.saturating_sub(margin);
        let to = (start + side + margin).min(limit);
        (from, to - from)
    };
    let (x, crop_width) = grow(b.x, b.width, width);
    let (y, crop_height) = grow(b.y, b.height, height);
    [x, y, crop_width, crop_height]
}
