//! Converts the daemon's messages to those of a recording.

use crate::frame_record::frame_record;
use crate::stages::vehicle_record::reading;
use crate::status_json::StatusJson;
use messages::depth::Depth;
use messages::header::Header;
use messages::motion::VehicleRecord;
use messages::obstacles::Obstacles;
use messages::pair::Pair;
use messages::status::StatusRecord;
use perception::point_cloud::{self, Point, PointCloudParameters};
use perception::rig::Rig;
use perception::stereo::DisparityView;
use sources::recording::VehicleLine;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use tools::recording::encode::{self, PairLine, Side, Stamp};
use tools::recording::storage::Disk;
use tools::recording::{
    About, Choice, ImageForm, Item, Limits, Message, Offer, RecordError, Recorder, Report, Sink, Topic,
};

/// Period of calibrations and camera poses in the recording, in nanoseconds.
const GEOMETRY_PERIOD_NS: u64 = 1_000_000_000;

/// Period of point clouds, in nanoseconds; they are the largest messages.
const CLOUD_PERIOD_NS: u64 = 500_000_000;

/// Step in columns and rows between two points of a cloud.
const CLOUD_EVERY: usize = 2;

/// Parameters of a recording.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Format of images: raw, PNG or JPEG.
    pub form: ImageForm,
    /// Topics to record.
    pub topics: Choice,
    /// Limits of files, disk and ring.
    pub limits: Limits,
    /// Name of the daemon instance, for the metadata.
    pub instance: String,
}

/// Destination of encoded messages.
enum Output {
    /// A writer thread: the caller never waits for the disk; messages that it cannot take are lost and counted.
    Thread(Recorder),
    /// The file itself: nothing is lost, but the caller waits for the disk.
    Direct(Box<Sink>),
}

/// Encodes messages and passes them to the recording.
pub struct Feed {
    output: Output,
    plan: Plan,
    rig: Rig,
    size: (u32, u32),
    /// Time since 1970 at which the source time was 0; set by the first frame.
    base_ns: Option<u64>,
    /// Time of the last frame.
    now_ns: u64,
    last_pair: Option<u64>,
    last_result: Option<u64>,
    geometry_due_ns: u64,
    cloud_due_ns: u64,
    cloud: Vec<Point>,
    error: Option<RecordError>,
}

impl Feed {
    /// Starts a recording to `path`. With `waits` nothing is lost, and every call may wait for the disk.
    ///
    /// # Errors
    /// If the recording cannot be started.
    pub fn start(
        path: &Path,
        plan: Plan,
        rig: Rig,
        size: (u32, u32),
        waits: bool,
    ) -> Result<Self, RecordError> {
        let mut about = About::new();
        for (key, value) in [
            ("focal_px", rig.focal_px.to_string()),
            ("baseline_m", rig.baseline_m.to_string()),
            ("cx_px", rig.cx_px.to_string()),
            ("cy_px", rig.cy_px.to_string()),
            ("instance", plan.instance.clone()),
            ("images", plan.form.name().to_owned()),
            ("topics", plan.topics.to_string()),
        ] {
            about.insert(key.to_owned(), value);
        }
        let sink = Sink::new(Box::new(Disk), path, plan.form, plan.limits, about)?;
        let output = if waits {
            Output::Direct(Box::new(sink))
        } else {
            Output::Thread(Recorder::start(sink, path.to_owned()))
        };
        Ok(Self {
            output,
            plan,
            rig,
            size,
            base_ns: None,
            now_ns: since_1970_ns(),
            last_pair: None,
            last_result: None,
            geometry_due_ns: 0,
            cloud_due_ns: 0,
            cloud: Vec::new(),
            error: None,
        })
    }

    /// Sequence and time of a frame. Times follow the source time, so that a replay reproduces them.
    fn stamp(&mut self, header: &Header) -> Stamp {
        let base_ns = *self.base_ns.get_or_insert_with(|| since_1970_ns().saturating_sub(header.source_ns));
        let time_ns = base_ns.saturating_add(header.source_ns);
        self.now_ns = self.now_ns.max(time_ns);
        Stamp { sequence: header.sequence, time_ns }
    }

    fn put(&mut self, item: Item) {
        match &mut self.output {
            Output::Thread(recorder) => {
                if recorder.offer(item, messages::clock::monotonic_ns()) == Offer::Refused {
                    recorder.lost("disk", 1, self.now_ns);
                }
            }
            Output::Direct(sink) => {
                if self.error.is_none() {
                    self.error = sink.take(item).err();
                }
            }
        }
    }

    fn put_message(&mut self, message: Message) {
        self.put(Item::Message(message));
    }

    /// Records a pair. A pair that is published again after a stage died is recorded once.
    ///
    /// # Errors
    /// If an image cannot be compressed.
    pub fn pair(&mut self, header: &Header, pair: &Pair<'_>) -> Result<(), image::ImageError> {
        if self.last_pair == Some(header.sequence) {
            return Ok(());
        }
        self.last_pair = Some(header.sequence);
        let stamp = self.stamp(header);
        if stamp.time_ns >= self.geometry_due_ns {
            self.geometry_due_ns = stamp.time_ns + GEOMETRY_PERIOD_NS;
            for message in encode::geometry(stamp, &self.rig, self.size) {
                self.put_message(message);
            }
        }
        if !self.plan.topics.images {
            return Ok(());
        }
        let (form, size) = (self.plan.form, (header.width, header.height));
        let left = encode::image(stamp, Side::Left, form, pair.left, size)?;
        let right = encode::image(stamp, Side::Right, form, pair.right, size)?;
        let line = PairLine {
            sequence: header.sequence,
            source_ns: header.source_ns,
            capture_ns: header.capture_ns,
            width: header.width,
            height: header.height,
        };
        self.put_message(left);
        self.put_message(right);
        if header.vehicle != VehicleRecord::default() {
            let line = VehicleLine::from(reading(&header.vehicle));
            self.put_message(encode::json(stamp, Topic::Vehicle, &line));
        }
        self.put_message(encode::json(stamp, Topic::Pair, &line));
        Ok(())
    }

    /// Records the results of a frame.
    pub fn obstacles(&mut self, header: &Header, message: &Obstacles) {
        // A withdrawal is not a result; the status contains its reason.
        if header.withdraws == 1 || self.last_result == Some(header.sequence) {
            return;
        }
        self.last_result = Some(header.sequence);
        let stamp = self.stamp(header);
        let record = frame_record(header, message);
        if self.plan.topics.obstacles {
            self.put_message(encode::json(stamp, Topic::Obstacles, &record));
            self.put_message(encode::annotations(stamp, &record));
        }
        if self.plan.topics.scene {
            self.put_message(encode::scene(stamp, &record, &self.rig));
            if header.motion.has_pose() {
                let motion = &header.motion;
                self.put_message(encode::odometry(stamp, motion.position_m, motion.orientation));
            }
        }
        if message.alarm.level == messages::alarm::ALARM {
            self.put(Item::Alarm { time_ns: stamp.time_ns });
        }
    }

    /// Records a point cloud, every [`CLOUD_PERIOD_NS`].
    pub fn depth(&mut self, header: &Header, depth: &Depth<'_>) {
        let stamp = self.stamp(header);
        if !self.plan.topics.points || stamp.time_ns < self.cloud_due_ns {
            return;
        }
        let (width, height) = (header.width as usize, header.height as usize);
        let Some(disparity) = DisparityView::new(depth.disparity, width, height) else { return };
        self.cloud_due_ns = stamp.time_ns + CLOUD_PERIOD_NS;
        let parameters = PointCloudParameters { step: CLOUD_EVERY, ..PointCloudParameters::default() };
        point_cloud::fill(disparity, depth.left, &self.rig, &parameters, &mut self.cloud);
        let message = encode::points(stamp, &self.cloud);
        self.put_message(message);
    }

    /// Records the status of the daemon.
    pub fn status(&mut self, status: &StatusRecord) {
        if self.plan.topics.status && self.base_ns.is_some() {
            let stamp = Stamp { sequence: 0, time_ns: self.now_ns };
            self.put_message(encode::json(stamp, Topic::Status, &StatusJson::new(status)));
        }
    }

    /// Counts messages that were replaced by newer ones before they were read.
    pub fn missed(&mut self, service: &'static str, count: u64) {
        if count == 0 {
            return;
        }
        match &mut self.output {
            Output::Thread(recorder) => {
                recorder.lost(service, count, self.now_ns);
            }
            Output::Direct(sink) => {
                if self.error.is_none() {
                    self.error = sink.lost(service, count, self.now_ns).err();
                }
            }
        }
    }

    /// Whether the recording has ended by itself, or the disk has stopped accepting data.
    pub fn is_over(&self) -> bool {
        match &self.output {
            Output::Thread(recorder) => {
                recorder.is_over() || recorder.is_stuck(messages::clock::monotonic_ns())
            }
            Output::Direct(_) => self.error.is_some(),
        }
    }

    /// Sequence of the last recorded pair.
    pub fn last_pair(&self) -> Option<u64> {
        self.last_pair
    }

    /// Counts of what has been recorded so far.
    pub fn report(&self) -> Report {
        match &self.output {
            Output::Thread(recorder) => recorder.report(),
            Output::Direct(sink) => sink.report(),
        }
    }

    /// Whether the memory limit makes the ring shorter than requested.
    pub fn is_short(&self) -> bool {
        matches!(&self.output, Output::Thread(recorder) if recorder.is_short())
    }

    /// Ends the recording and writes its metadata.
    ///
    /// # Errors
    /// The error that ended the recording early.
    pub fn finish(self, reason: &str) -> Result<Report, RecordError> {
        match (self.output, self.error) {
            (Output::Thread(recorder), _) => recorder.finish(reason),
            (Output::Direct(mut sink), Some(error)) => {
                // Closes the file if possible; the first error is the one to report.
                let _ = sink.finish(&error.to_string());
                Err(error)
            }
            (Output::Direct(mut sink), None) => sink.finish(reason),
        }
    }
}

fn since_1970_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::header::Kind;
    use messages::motion::health;
    use messages::obstacles::{self, AlarmRecord};
    use sources::recording::{Index, OBSTACLES, ODOMETRY};

    #[test]
    fn a_frame_with_a_pose_has_a_transform() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let rig = Rig { focal_px: 400.0, baseline_m: 0.2, cx_px: 32.0, cy_px: 24.0 };
        let plan = Plan {
            form: ImageForm::Raw,
            topics: Choice::default(),
            limits: Limits::default(),
            instance: "test".into(),
        };
        let mut feed = Feed::start(&path, plan, rig, (64, 48), true).unwrap();
        let mut memory = vec![0_u64; 4096];
        let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let alarm = AlarmRecord {
            nearest_m: f64::INFINITY,
            time_to_collision_s: f64::INFINITY,
            ..AlarmRecord::default()
        };
        let bytes = obstacles::write(payload, alarm, &[]).unwrap();
        for sequence in 0..4 {
            let mut header = Header::new(Kind::Obstacles);
            (header.width, header.height, header.sequence) = (64, 48, sequence);
            header.set_source_time(100_000_000 * sequence);
            if sequence > 0 {
                header.motion.orientation = [0.0, 0.0, 0.0, 1.0];
                (header.motion.health, header.motion.speed_m_s) = (health::KNOWN, 7.5);
            }
            feed.obstacles(&header, &obstacles::view(&header, &payload[..bytes]).unwrap());
        }
        feed.finish("the test has ended").unwrap();
        let mut index = Index::open(&path).unwrap();
        let lines = index.all_of(OBSTACLES).unwrap();
        let speeds: Vec<serde_json::Value> = lines
            .iter()
            .map(|line| {
                let line: serde_json::Value = serde_json::from_slice(&line.data).unwrap();
                line["motion"]["speed_m_s"].clone()
            })
            .collect();
        assert_eq!(speeds, [serde_json::Value::Null, 7.5.into(), 7.5.into(), 7.5.into()]);
        assert_eq!(index.all_of(ODOMETRY).unwrap().len(), 3);
    }
}
