//! Regions to tracked obstacles and the alarm.

use super::{FrameError, Room, RoomError, alarm_parameters, check_size, recogniser, tracker_parameters};
use crate::launch::FrameFormat;
use config::Config;
use ipc::header::{Header, modes, put_text};
use ipc::obstacles::{self, AlarmRecord, GREATEST_COUNT, ObstacleRecord};
use ipc::regions::{self, RegionRecord};
use perception::image::GreyView;
use perception::recognition::Recogniser;
use perception::rig::Rig;
use perception::road::{PixelBox, Region};
use perception::tracking::alarm::{Alarm, AlarmLevel, Candidate};
use perception::tracking::{Detection, Track, Tracker};

/// The word for what no class recognised.
pub const UNRECOGNISED: &str = "obstacle";

/// Regions narrower or lower than this share of the recogniser's window are parts at most and are
/// not looked at: posts, kerbs.
const LEAST_SHARE: f64 = 0.35;

/// Recogniser, tracker and alarm between their messages.
pub struct RecognitionRoom {
    recogniser: Option<Box<dyn Recogniser>>,
    label: String,
    /// Least width and height of a region that is looked at, in metres.
    least_m: f64,
    tracker: Tracker,
    alarm: Alarm,
    rig: Rig,
    width: usize,
    height: usize,
    detections: Vec<Detection>,
    records: Vec<ObstacleRecord>,
    /// Sequence and alarm of the last frame: a frame that comes again gets the same answer.
    last: Option<(u64, AlarmRecord)>,
}

impl RecognitionRoom {
    /// A room for the run's frames.
    ///
    /// # Errors
    /// When the cascade cannot be used.
    pub fn new(config: &Config, format: &FrameFormat) -> Result<Self, RoomError> {
        let recogniser = recogniser(config, format.width, format.height)?;
        Ok(Self {
            recogniser: recogniser.map(|r| Box::new(r) as Box<dyn Recogniser>),
            label: config.recognition.label.clone(),
            least_m: LEAST_SHARE * config.recognition.window_m,
            tracker: Tracker::new(tracker_parameters(config)),
            alarm: Alarm::new(alarm_parameters(config)),
            rig: format.rig(),
            width: format.width,
            height: format.height,
            detections: Vec::with_capacity(regions::GREATEST_COUNT),
            records: Vec::with_capacity(GREATEST_COUNT),
            last: None,
        })
    }

    /// Recognises and tracks the regions of a message, to `records`; gives the alarm.
    fn judge(&mut self, header: &Header, payload: &[u8]) -> Result<AlarmRecord, FrameError> {
        let message = regions::view(header, payload)?;
        check_size(header, self.width, self.height)?;
        if let Some((sequence, alarm)) = self.last
            && sequence == header.sequence
        {
            return Ok(alarm);
        }
        self.detections.clear();
        let recognises = header.modes & modes::RECOGNITION_OFF == 0;
        for record in message.regions {
            let score = match (&mut self.recogniser, message.crop(record)) {
                (Some(recogniser), Some(pixels))
                    if recognises && record.width_m.min(record.height_m) >= self.least_m =>
                {
                    let [_, _, width, height] = record.crop.map(|v| v as usize);
                    let crop = GreyView::new(pixels, width, height, width)?;
                    let metre_px = record.disparity_px / self.rig.baseline_m;
                    recogniser.recognise(crop, Some(metre_px)).map(|found| found.score)
                }
                _ => None,
            };
            self.detections.push(Detection { region: region(record), score });
        }
        self.tracker.update(header.source_ns, &self.detections);
        let (tracker, rig) = (&self.tracker, &self.rig);
        let candidates = tracker.tracks().iter().filter(|t| tracker.is_confirmed(t)).map(|t| Candidate {
            track: t.id,
            distance_m: t.distance_m(rig),
            lateral_m: t.region.lateral_m,
            width_m: t.region.width_m,
        });
        let road = &message.road;
        let state = self.alarm.update(header.source_ns, road.seen == 1, candidates);
        let alarm = AlarmRecord {
            level: match state.level {
                AlarmLevel::Off => 0,
                AlarmLevel::Clear => 1,
                AlarmLevel::Alarm => 2,
            },
            track: state.track.unwrap_or(0),
            nearest_m: state.nearest_m.unwrap_or(f64::INFINITY),
            road_seen: road.seen,
            obstacles: 0,
            slope: road.slope,
            horizon_px: road.horizon_px,
            confidence: road.confidence,
            camera_height_m: road.camera_height_m,
        };
        self.records.clear();
        for track in tracker.tracks().iter().take(GREATEST_COUNT) {
            let confirmed = tracker.is_confirmed(track);
            self.records.push(obstacle(track, confirmed, rig, &self.label));
        }
        self.last = Some((header.sequence, alarm));
        Ok(alarm)
    }
}

impl Room for RecognitionRoom {
    fn output_bytes(&self) -> usize {
        obstacles::payload_bytes(GREATEST_COUNT)
    }

    fn process(&mut self, header: &Header, payload: &[u8], output: &mut [u8]) -> Result<usize, FrameError> {
        let alarm = self.judge(header, payload)?;
        Ok(obstacles::write(output, alarm, &self.records)?)
    }
}

fn region(record: &RegionRecord) -> Region {
    let [x, y, width, height] = record.bounds;
    Region {
        bounds: PixelBox { x, y, width, height },
        disparity_px: record.disparity_px,
        disparity_sigma_px: record.disparity_sigma_px,
        distance_m: record.distance_m,
        lateral_m: record.lateral_m,
        width_m: record.width_m,
        height_m: record.height_m,
        confidence: record.confidence,
        pixels: record.pixels,
    }
}

fn obstacle(track: &Track, confirmed: bool, rig: &Rig, label: &str) -> ObstacleRecord {
    let b = track.region.bounds;
    let mut class = [0; 16];
    put_text(&mut class, if track.score.is_some() { label } else { UNRECOGNISED });
    ObstacleRecord {
        track: track.id,
        confirmed: u32::from(confirmed),
        seen: track.seen,
        missed: track.missed,
        bounds: [b.x, b.y, b.width, b.height],
        distance_m: track.distance_m(rig),
        distance_sigma_m: track.distance_sigma_m(rig),
        lateral_m: track.region.lateral_m,
        width_m: track.region.width_m,
        height_m: track.region.height_m,
        closing_m_s: track.closing_m_s(rig),
        time_to_collision_s: track.time_to_collision_s().unwrap_or(f64::INFINITY),
        score: track.score.map_or(0.0, f64::from),
        class,
    }
}
