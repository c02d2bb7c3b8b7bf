//! Reads what only shared memory has: the rig, and pictures with disparities where they are wanted. Nothing is copied
//! before somebody wants it.

use messages::bus::{Bus, IpcError};
use messages::depth;
use messages::header::Header;
use messages::instance::Instance;
use messages::port::Subscriber;
use messages::rig::RigRecord;
use messages::wait::{self, Next};
use messages::{service, status};
use perception::rig::Rig;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Period of checking whether a daemon runs, and whether to stop.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Number of requests for a map that may wait.
const MAX_WAITING: usize = 16;

/// A left picture, and its disparity map if that was wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// Number of its frame.
    pub sequence: u64,
    /// When it was captured, in ns of CLOCK_MONOTONIC.
    pub capture_ns: u64,
    /// Width and height, in px.
    pub size: (u32, u32),
    /// Grey levels, row after row.
    pub left: Vec<u8>,
    /// Disparities in 1/256 px, 0 = unknown; empty if only the picture was wanted.
    pub disparity: Vec<u16>,
}

impl Picture {
    fn new(header: &Header, depth: &depth::Depth<'_>, with_map: bool) -> Self {
        Self {
            sequence: header.sequence,
            capture_ns: header.capture_ns,
            size: (header.width, header.height),
            left: depth.left.to_vec(),
            disparity: if with_map { depth.disparity.to_vec() } else { Vec::new() },
        }
    }
}

/// The pictures that events want.
#[derive(Debug)]
struct Album {
    /// The last pictures, the oldest first.
    recent: VecDeque<Picture>,
    /// Number that is kept of them: what an event has from before it.
    keep: usize,
    next: Instant,
    /// Events that want more pictures, and how many.
    wanted: Vec<(u64, usize)>,
}

#[derive(Debug, Default)]
struct State {
    rig: RigRecord,
    requests: Vec<SyncSender<Picture>>,
}

/// A picture that belongs to events.
#[derive(Debug)]
pub struct ForEvents {
    /// The events.
    pub events: Vec<u64>,
    /// The picture.
    pub picture: Picture,
}

/// What the camera's thread shares with others.
#[derive(Debug)]
pub struct Camera {
    state: Mutex<State>,
    album: Mutex<Album>,
    period: Duration,
    pictures: usize,
}

impl Camera {
    /// Gives each event `pictures` pictures, one each `period`.
    pub fn new(pictures: usize, period: Duration) -> Self {
        let album =
            Album { recent: VecDeque::new(), keep: pictures / 2, next: Instant::now(), wanted: Vec::new() };
        Self { state: Mutex::default(), album: Mutex::new(album), period, pictures }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every update leaves the state consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn album(&self) -> MutexGuard<'_, Album> {
        self.album.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The rig, once it is known.
    pub fn rig(&self) -> Option<Rig> {
        let rig = self.state().rig;
        let rig =
            Rig { focal_px: rig.focal_px, baseline_m: rig.baseline_m, cx_px: rig.cx_px, cy_px: rig.cy_px };
        rig.checked().ok()
    }

    /// Number of disparities that are searched.
    pub fn disparities(&self) -> u32 {
        self.state().rig.disparities
    }

    /// Requests the next picture with its map. Returns false if too many wait.
    pub fn request(&self, sender: SyncSender<Picture>) -> bool {
        let requests = &mut self.state().requests;
        let has_place = requests.len() < MAX_WAITING;
        if has_place {
            requests.push(sender);
        }
        has_place
    }

    /// An event has happened: returns the pictures from before it. Those from after it follow.
    pub fn event(&self, event: u64) -> Vec<Picture> {
        let mut album = self.album();
        let before: Vec<_> = album.recent.iter().cloned().collect();
        let after = self.pictures - before.len().min(self.pictures);
        if after > 0 {
            album.wanted.push((event, after));
            album.next = Instant::now();
        }
        before
    }

    /// A picture has come; returns it if events want it.
    fn take(&self, header: &Header, depth: &depth::Depth<'_>) -> Option<ForEvents> {
        let requests = std::mem::take(&mut self.state().requests);
        for request in requests {
            // Who has waited too long is gone.
            let _ = request.try_send(Picture::new(header, depth, true));
        }
        let mut album = self.album();
        if self.pictures == 0 || Instant::now() < album.next {
            return None;
        }
        album.next = Instant::now() + self.period;
        let picture = Picture::new(header, depth, false);
        let events: Vec<u64> = album.wanted.iter().map(|(event, _)| *event).collect();
        album.wanted.retain_mut(|(_, count)| {
            *count -= 1;
            *count > 0
        });
        if album.keep > 0 {
            if album.recent.len() >= album.keep {
                album.recent.pop_front();
            }
            album.recent.push_back(picture.clone());
        }
        (!events.is_empty()).then_some(ForEvents { events, picture })
    }

    /// The daemon has ended: no more pictures, and those that are there belong to no later event.
    fn clear(&self) {
        let mut album = self.album();
        album.recent.clear();
        album.wanted.clear();
        self.state().rig = RigRecord::default();
    }
}

/// Follows an instance until it is stopped.
pub struct Follower {
    /// Name of the instance.
    pub name: String,
    /// Its folder.
    pub directory: PathBuf,
    /// Whether pictures are wanted at all; else only the rig is read.
    pub with_pictures: bool,
    /// Where pictures go.
    pub camera: Arc<Camera>,
    /// Set to stop it.
    pub stop: Arc<AtomicBool>,
}

impl Follower {
    /// Follows run after run; calls `for_events` with each picture that events want.
    pub fn run(&self, mut for_events: impl FnMut(ForEvents)) {
        let mut told = None;
        while !self.stop.load(Ordering::Relaxed) {
            let instance = Instance::find(&self.name, Path::new(&self.directory));
            let is_there = instance.check_owner().is_ok() && instance.is_running();
            if is_there && let Err(error) = self.follow(&instance, &mut for_events) {
                let text = error.to_string();
                // A run may end while it is read.
                if instance.is_running() && told.as_ref() != Some(&text) {
                    tracing::warn!("no pictures: {text}");
                    told = Some(text);
                }
            }
            self.camera.clear();
            std::thread::sleep(CHECK_PERIOD);
        }
    }

    fn follow(&self, instance: &Instance, for_events: &mut impl FnMut(ForEvents)) -> Result<(), IpcError> {
        let prefix = instance.prefix();
        if prefix.is_none() {
            return Ok(());
        }
        let bus = Bus::join(instance)?;
        let statuses = bus.subscriber(&service::STATUS)?;
        let depths = self.with_pictures.then(|| bus.subscriber(&service::DEPTH)).transpose()?;
        let mut checked = Instant::now();
        let subscribers: Vec<&Subscriber> = [&statuses].into_iter().chain(depths.as_ref()).collect();
        wait::run::<IpcError>(&subscribers, || {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Next::Stop);
            }
            if checked.elapsed() >= CHECK_PERIOD {
                checked = Instant::now();
                if !instance.is_running() || instance.prefix() != prefix {
                    return Ok(Next::Stop);
                }
            }
            while let Some(sample) = statuses.receive()? {
                // The other reader of this process counts and tells what is refused.
                if let Ok(status) = status::view(sample.header(), sample.payload()) {
                    self.camera.state().rig = status.rig;
                }
            }
            if let Some(sample) = depths.as_ref().map(Subscriber::receive).transpose()?.flatten()
                && let Ok(depth) = depth::view(sample.header(), sample.payload())
                && let Some(picture) = self.camera.take(sample.header(), &depth)
            {
                // The place in shared memory is given back before anything is encoded.
                drop(sample);
                for_events(picture);
            }
            Ok(Next::Wait(CHECK_PERIOD))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::header::Kind;

    fn shoot(camera: &Camera, sequence: u64) -> Option<ForEvents> {
        let mut header = Header::new(Kind::Depth);
        (header.width, header.height, header.sequence) = (2, 1, sequence);
        let depth = depth::Depth { disparity: &[256, 0], left: &[1, 2], confidence: &[0, 0], right: &[0, 0] };
        camera.take(&header, &depth)
    }

    #[test]
    fn an_event_has_pictures_from_before_and_after_it() {
        let camera = Camera::new(3, Duration::ZERO);
        for sequence in 0..5 {
            assert!(shoot(&camera, sequence).is_none(), "nobody wants it");
        }
        let before: Vec<_> = camera.event(1).into_iter().map(|picture| picture.sequence).collect();
        assert_eq!(before, [4]);
        assert_eq!(shoot(&camera, 5).unwrap().events, [1]);
        camera.event(2);
        assert_eq!(shoot(&camera, 6).unwrap().events, [1, 2]);
        assert_eq!(shoot(&camera, 7).unwrap().events, [2]);
        assert!(shoot(&camera, 8).is_none());
        camera.event(3);
        camera.clear();
        assert!(shoot(&camera, 9).is_none());
    }

    #[test]
    fn requests_get_the_next_map() {
        let camera = Camera::new(0, Duration::ZERO);
        let (sender, receiver) = std::sync::mpsc::sync_channel(1);
        assert!(camera.request(sender.clone()));
        assert!(receiver.try_recv().is_err());
        shoot(&camera, 3);
        let picture = receiver.try_recv().unwrap();
        assert_eq!((picture.sequence, &picture.disparity[..]), (3, &[256, 0][..]));
        shoot(&camera, 4);
        assert!(receiver.try_recv().is_err(), "once");
        assert!((0..MAX_WAITING).all(|_| camera.request(sender.clone())));
        assert!(!camera.request(sender));
    }
}
