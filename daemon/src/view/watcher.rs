//! Reads a daemon's messages, joins those of a frame, and waits for the next daemon after its end.

use super::board::Board;
use super::frame::{Frame, Images};
use super::hub::Hub;
use crate::frame_record::frame_record;
use messages::bus::{Bus, IpcError};
use messages::header::Header;
use messages::instance::Instance;
use messages::port::Subscriber;
use messages::rig::RigRecord;
use messages::silence;
use messages::wait::{self, Next};
use messages::{depth, obstacles, regions, service, status};
use perception::rig::Rig;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

/// Period of checking whether a daemon runs.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Number of frames whose images are kept until their obstacles arrive.
const KEPT: usize = 3;

/// The messages of one frame so far.
#[derive(Default)]
struct Kept {
    images_of: Option<u64>,
    images: Images,
    road_of: Option<u64>,
    /// A copy of the message, aligned to 8 bytes as in shared memory.
    road: Vec<u64>,
    road_bytes: usize,
    road_header: Header,
}

/// Follows an instance across its runs until `stop` is set.
pub struct Watcher {
    instance: Instance,
    hub: Arc<Hub>,
    stop: Arc<AtomicBool>,
    board: Board,
    rig: RigRecord,
    /// Time of the last status.
    heard: Instant,
    kept: [Kept; KEPT],
}

impl Watcher {
    /// A watcher of an instance; temperatures and clocks are read below `sysfs`.
    pub fn new(instance: Instance, sysfs: &Path, hub: Arc<Hub>, stop: Arc<AtomicBool>) -> Self {
        Self {
            instance,
            hub,
            stop,
            board: Board::find(sysfs),
            rig: RigRecord::default(),
            heard: Instant::now(),
            kept: std::array::from_fn(|_| Kept::default()),
        }
    }

    /// Watches until it is stopped. Errors are reported to the clients, and the connection is retried.
    pub fn run(&mut self) {
        let mut last_error = None;
        while !self.stop.load(Ordering::Relaxed) {
            if let Some(why) = self.why_absent() {
                self.hub.absent(&why);
            } else if let Err(error) = self.follow() {
                let text = error.to_string();
                self.hub.absent(&text);
                // Logged once per change: a daemon that is just starting has no services for a while.
                if last_error.as_ref() != Some(&text) {
                    tracing::warn!("{text}");
                    last_error = Some(text);
                }
            } else {
                last_error = None;
            }
            std::thread::sleep(CHECK_PERIOD);
        }
    }

    fn why_absent(&self) -> Option<String> {
        // The daemon that is waited for may be another user's.
        if let Err(error) = self.instance.check_owner() {
            return Some(error.to_string());
        }
        let name = self.instance.name();
        if !self.instance.is_running() || self.instance.prefix().is_none() {
            return Some(format!("no daemon named \"{name}\" is running: waiting for one"));
        }
        None
    }

    /// Follows one run to its end.
    fn follow(&mut self) -> Result<(), IpcError> {
        let prefix = self.instance.prefix();
        let bus = Bus::join(&self.instance)?;
        let depths = bus.subscriber(&service::DEPTH)?;
        let roads = bus.subscriber(&service::REGIONS)?;
        let results = bus.subscriber(&service::OBSTACLES)?;
        let statuses = bus.subscriber(&service::STATUS)?;
        self.kept = std::array::from_fn(|_| Kept::default());
        let mut checked = Instant::now();
        self.heard = Instant::now();
        tracing::info!("connected to the daemon {}", self.instance.name());
        wait::run::<IpcError>(&[&depths, &roads, &results, &statuses], || {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Next::Stop);
            }
            if checked.elapsed() >= CHECK_PERIOD {
                checked = Instant::now();
                if !self.instance.is_running() || self.instance.prefix() != prefix {
                    tracing::info!("the daemon has ended");
                    return Ok(Next::Stop);
                }
                if self.heard.elapsed() > silence::TIMEOUT
                    && let Some(reason) = silence::reason(&self.instance)
                {
                    self.hub.absent(&reason);
                }
            }
            self.take_status(&statuses)?;
            // Obstacles first: the depth and regions that they were computed from were sent earlier.
            let result = results.receive()?;
            self.take_depth(&depths)?;
            self.take_road(&roads)?;
            if let Some(sample) = result {
                self.take_result(sample.header(), sample.payload());
            }
            Ok(Next::Wait(CHECK_PERIOD))
        })
    }

    fn refused(&self, service: &str, error: &dyn std::fmt::Display) {
        if self.hub.counters.refused.fetch_add(1, Ordering::Relaxed) == 0 {
            tracing::warn!(service, %error, "message refused; further ones are only counted");
        }
    }

    fn take_status(&mut self, statuses: &Subscriber) -> Result<(), IpcError> {
        while let Some(sample) = statuses.receive()? {
            match status::view(sample.header(), sample.payload()) {
                Ok(status) => {
                    self.rig = status.rig;
                    self.heard = Instant::now();
                    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
                    let time_s = now.map_or(0.0, |t| t.as_secs_f64());
                    self.hub.status(status, self.board.read(), time_s);
                }
                Err(error) => self.refused("status", &error),
            }
        }
        Ok(())
    }

    fn take_depth(&mut self, depths: &Subscriber) -> Result<(), IpcError> {
        while let Some(sample) = depths.receive()? {
            let header = sample.header();
            if self.hub.clients() == 0 {
                continue;
            }
            match depth::view(header, sample.payload()) {
                Ok(message) => {
                    let slot = &mut self.kept[(header.sequence % KEPT as u64) as usize];
                    slot.images_of = Some(header.sequence);
                    slot.images.left.clear();
                    slot.images.left.extend_from_slice(message.left);
                    slot.images.disparity.clear();
                    slot.images.disparity.extend_from_slice(message.disparity);
                }
                Err(error) => self.refused("depth", &error),
            }
        }
        Ok(())
    }

    fn take_road(&mut self, roads: &Subscriber) -> Result<(), IpcError> {
        while let Some(sample) = roads.receive()? {
            let (header, payload) = (sample.header(), sample.payload());
            if self.hub.clients() == 0 {
                continue;
            }
            match regions::view(header, payload) {
                Ok(_) => {
                    let slot = &mut self.kept[(header.sequence % KEPT as u64) as usize];
                    slot.road_of = Some(header.sequence);
                    slot.road_header = *header;
                    slot.road.resize(payload.len().div_ceil(8), 0);
                    slot.road_bytes = payload.len();
                    bytemuck::cast_slice_mut(&mut slot.road)[..payload.len()].copy_from_slice(payload);
                }
                Err(error) => self.refused("regions", &error),
            }
        }
        Ok(())
    }

    fn take_result(&mut self, header: &Header, payload: &[u8]) {
        if header.withdraws == 1 {
            // A withdrawn alarm has no frame; the status reports that the alarm is off, and why.
            return;
        }
        let message = match obstacles::view(header, payload) {
            Ok(message) => message,
            Err(error) => return self.refused("obstacles", &error),
        };
        self.hub.result(header);
        if self.hub.clients() == 0 {
            return;
        }
        let of = Some(header.sequence);
        let slot = &mut self.kept[(header.sequence % KEPT as u64) as usize];
        let pixels = header.pixels();
        let is_whole = slot.images_of == of && slot.road_of == of && slot.images.left.len() == pixels;
        let rig = Rig {
            focal_px: self.rig.focal_px,
            baseline_m: self.rig.baseline_m,
            cx_px: self.rig.cx_px,
            cy_px: self.rig.cy_px,
        };
        let bytes: &[u8] = bytemuck::cast_slice(&slot.road);
        let road = regions::view(&slot.road_header, &bytes[..slot.road_bytes]);
        match (is_whole, rig.checked(), road) {
            (true, Ok(rig), Ok(road)) => {
                slot.images_of = None;
                let record = frame_record(header, &message);
                let images = std::mem::take(&mut slot.images);
                let disparities = self.rig.disparities.min(1024) as usize;
                self.hub.frame(Frame::new(header, record, images, &road, rig, disparities));
            }
            _ => {
                self.hub.counters.incomplete.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}
