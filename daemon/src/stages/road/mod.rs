//! The stage road: `depth` to `regions`.

pub mod own_motion;
pub mod parameters;

use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::FrameFormat;
use config::Config;
use messages::alarm::Faults;
use messages::depth::{Depth, DepthMessage};
use messages::header::MessageError;
use messages::motion::MotionRecord;
use messages::regions;
use messages::regions::{EdgeRecord, RegionRecord, RegionsMessage, RoadRecord};
use messages::typed::{Output, Written};
use own_motion::OwnMotion;
use perception::depth::DepthView;
use perception::frame_clock::FrameClock;
use perception::image::GreyView;
use perception::image_quality::{TextureMonitor, road_texture};
use perception::region::Region;
use perception::rig::Rig;
use perception::road::edges::Edge;
use perception::scene::SceneDetector;
use perception::stereo::DisparityView;

// The message holds the arrays of the algorithm as they are.
const _: () = assert!(perception::road::free_space::COLUMNS == regions::FREE_COLUMNS);
const _: () = assert!(perception::road::edges::SEGMENTS == regions::SEGMENTS);

/// Margin of a crop on each side of its region, as a share of the region's size: room for the search windows of the
/// cascade.
const CROP_MARGIN: f64 = 0.2;

/// Minimum width and height of a crop, in pixels.
const MIN_CROP: u32 = 32;

/// Adapter of the scene detector (road model and regions).
pub struct RoadStage {
    detector: SceneDetector,
    own_motion: OwnMotion,
    clock: FrameClock,
    rig: Rig,
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
            parameters::scene_parameters(config),
            format.rig(),
            width,
            height,
            disparities,
        );
        Ok(Self {
            detector,
            own_motion: OwnMotion::new(config.motion.odometry, format.rig(), (width, height)),
            clock: FrameClock::default(),
            rig: format.rig(),
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
        self.own_motion.update(frame, step, left, disparity);
        let scene = self.detector.detect(depth_view);
        if let Some(check) = &mut self.texture {
            let texture = road_texture(left, scene.profile_px, &self.rig, self.path_width_m);
            self.is_sparse = check.update(texture);
        }
        let road = scene.road.map_or_else(RoadRecord::default, |road| {
            RoadRecord {
                seen: 1,
                regions: 0,
                slope: road.line.slope,
                horizon_px: road.line.horizon_px,
                roll: road.roll,
                confidence: road.confidence,
                camera_height_m: road.camera_height_m,
                edges: scene.edges.map(|sides| sides.map(|edge| edge.map(edge_record).unwrap_or_default())),
            }
            .limited()
        });
        let mut writer = output.begin(road, scene.profile_px, scene.free_m, scene.regions.len())?;
        for region in scene.regions {
            let record = record(region, self.width as u32, self.height as u32);
            let [x, y, width, height] = record.crop.map(|v| v as usize);
            let crop = left.crop(x, y, width, height);
            let rows = (0..height).filter_map(|row| crop.map(|c| c.row(row)));
            writer.push(record, rows);
        }
        Ok(writer.finish())
    }

    fn motion(&self) -> Option<MotionRecord> {
        Some(self.own_motion.record())
    }

    fn faults(&self) -> Faults {
        Faults::SPARSE.when(self.is_sparse)
    }
}

/// The record of an edge.
fn edge_record(edge: Edge) -> EdgeRecord {
    let Edge { lateral_m, step_m, distance_m, x_px, y_px } = edge;
    EdgeRecord { step_m, lateral_m, distance_m, x_px, y_px }
}

/// The record of a region, with the box of its crop.
fn record(region: &Region, width: u32, height: u32) -> RegionRecord {
    let b = region.bounds;
    let grow = |start: u32, side: u32, limit: u32| {
        let margin = ((f64::from(side) * CROP_MARGIN) as u32).max(MIN_CROP.saturating_sub(side).div_ceil(2));
        let from = start.saturating_sub(margin);
        let to = (start + side + margin).min(limit);
        (from, to - from)
    };
    let (crop_x, crop_width) = grow(b.x, b.width, width);
    let (crop_y, crop_height) = grow(b.y, b.height, height);
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
        crop: [crop_x, crop_y, crop_width, crop_height],
        crop_offset: 0,
        pixels: region.pixels,
    }
    .limited()
}
