//! What a client makes of messages, sent by a daemon that this test plays.

use lookout_client::{AlarmRecord, Client, Faults, ObstacleRecord, Options};
use messages::bus::Bus;
use messages::clock::monotonic_ns;
use messages::header::{Header, Kind};
use messages::instance::{Instance, InstanceLock};
use messages::port::Publisher;
use messages::service::{DEPTH, OBSTACLES};
use messages::{depth, obstacles};
use std::time::Duration;

const SIZE: (u32, u32) = (8, 4);
const PIXELS: usize = 32;

/// A daemon without processes.
struct Fake {
    depths: Publisher,
    results: Publisher,
    _bus: Bus,
    _lock: InstanceLock,
}

impl Fake {
    fn start(instance: &Instance) -> Self {
        let lock = InstanceLock::take(instance).expect("nobody else runs it");
        let bus = Bus::join(instance).expect("it runs");
        let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
        let depths = bus.publisher(&DEPTH, width, height).expect("a place");
        let results = bus.publisher(&OBSTACLES, width, height).expect("a place");
        Self { depths, results, _bus: bus, _lock: lock }
    }

    fn header(kind: Kind, sequence: u64) -> Header {
        let mut header = Header::new(kind);
        (header.width, header.height) = SIZE;
        (header.sequence, header.capture_ns) = (sequence, monotonic_ns());
        header
    }

    /// Pictures whose every value is the number of the frame.
    fn depth(&self, sequence: u64) {
        let bytes = depth::payload_bytes(SIZE.0 as usize, SIZE.1 as usize);
        let mut loan = self.depths.loan(bytes).expect("a sample");
        *loan.header_mut() = Self::header(Kind::Depth, sequence);
        let maps = depth::split_mut(loan.payload_mut(), PIXELS).expect("its length");
        maps.disparity.fill(sequence as u16 * 256);
        [maps.left, maps.confidence, maps.right].into_iter().for_each(|map| map.fill(sequence as u8));
        self.depths.send(loan).expect("it is sent");
    }

    fn message(&self, sequence: u64, withdraws: u32, alarm: AlarmRecord) {
        let obstacle = ObstacleRecord { track: 7, distance_m: sequence as f64, ..ObstacleRecord::default() };
        let list = if withdraws == 1 { &[][..] } else { &[obstacle][..] };
        let mut loan = self.results.loan(obstacles::payload_bytes(list.len())).expect("a sample");
        *loan.header_mut() = Self::header(Kind::Obstacles, sequence);
        loan.header_mut().withdraws = withdraws;
        obstacles::write(loan.payload_mut(), alarm, list).expect("its length");
        self.results.send(loan).expect("it is sent");
    }

    fn result(&self, sequence: u64) {
        self.message(sequence, 0, AlarmRecord { level: 1, ..AlarmRecord::default() });
    }

    fn withdraw(&self, sequence: u64) {
        self.message(sequence, 1, AlarmRecord::off(Faults::STAGE));
    }

    fn frame(&self, sequence: u64) {
        self.depth(sequence);
        self.result(sequence);
    }
}

fn client(folder: &tempfile::TempDir, pictures: bool) -> (Instance, Client) {
    let instance = Instance::new("fake", folder.path());
    let options = Options { instance: "fake".into(), directory: folder.path().into(), pictures };
    (instance, Client::open(options).expect("a name"))
}

/// The number of the next frame, if there is one, and the value of its pictures.
fn next(client: &mut Client) -> Option<(u64, Option<u16>)> {
    let frame = client.next(Duration::ZERO).expect("it can be read")?;
    let value = frame.pictures.map(|pictures| {
        assert!(pictures.left.iter().all(|&left| u16::from(left) == pictures.disparity[0] / 256));
        pictures.disparity[PIXELS - 1] / 256
    });
    assert_eq!(frame.disparity_px(0, 0), value.map(f64::from));
    assert_eq!(frame.disparity_px(SIZE.0, 0), None);
    Some((frame.sequence, value))
}

#[test]
fn frames_come_once_and_only_with_their_own_pictures() {
    let folder = tempfile::tempdir().expect("a folder");
    let (instance, mut client) = client(&folder, true);
    let daemon = Fake::start(&instance);
    assert_eq!(next(&mut client), None);
    daemon.frame(1);
    assert_eq!(next(&mut client), Some((1, Some(1))));
    assert_eq!(next(&mut client), None);
    // The stages overlap: pictures are a frame ahead of the results, and wait for theirs.
    daemon.depth(2);
    daemon.depth(3);
    daemon.result(2);
    assert_eq!(next(&mut client), None);
    // However often it is asked, and although newer ones come.
    daemon.depth(4);
    assert_eq!(next(&mut client), None);
    daemon.result(3);
    assert_eq!(next(&mut client), Some((3, Some(3))));
    // The result of the pictures that are held is overtaken.
    assert_eq!(next(&mut client), None);
    daemon.result(5);
    assert_eq!(next(&mut client), None);
    daemon.depth(5);
    assert_eq!(next(&mut client), Some((5, Some(5))));
    daemon.frame(200);
    assert_eq!(next(&mut client), Some((200, Some(200))));
    // A frame that is repeated because a stage has died comes once.
    daemon.frame(200);
    assert_eq!(next(&mut client), None);
    daemon.frame(201);
    assert_eq!(next(&mut client), Some((201, Some(201))));
    assert_eq!(client.refused(), 0);
}

#[test]
fn results_are_withdrawn_once_by_the_daemon_or_for_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (instance, mut client) = client(&folder, false);
    let daemon = Fake::start(&instance);
    assert_eq!(next(&mut client), None);
    daemon.withdraw(1);
    assert_eq!(next(&mut client), None, "nobody was given what it withdraws");
    daemon.frame(2);
    assert_eq!(next(&mut client), Some((2, None)));
    daemon.withdraw(2);
    let withdrawn = client.next(Duration::ZERO).expect("it can be read").expect("a frame");
    assert!(withdrawn.withdrawn && withdrawn.level() == "off" && withdrawn.obstacles.is_empty());
    daemon.withdraw(2);
    assert_eq!(next(&mut client), None);
    daemon.frame(3);
    assert_eq!(next(&mut client), Some((3, None)));
    drop(daemon);
    let end = client.next(Duration::from_secs(60)).expect("it can be read").expect("a frame");
    assert!(end.withdrawn && end.sequence == 3 && end.capture_ns == 0 && end.obstacles.is_empty());
    assert_eq!((end.level(), &end.reason()[..]), ("off", "the daemon has ended"));
    assert_eq!(next(&mut client), None);
    // Another run begins at 0 again.
    let daemon = Fake::start(&instance);
    assert_eq!(next(&mut client), None);
    daemon.frame(0);
    let frame = client.next(Duration::from_secs(60)).expect("it can be read").expect("a frame");
    assert_eq!((frame.sequence, frame.withdrawn, frame.obstacles[0].track), (0, false, 7));
}

#[test]
fn what_fails_its_check_is_counted_and_never_given() {
    let folder = tempfile::tempdir().expect("a folder");
    let (instance, mut client) = client(&folder, false);
    let daemon = Fake::start(&instance);
    assert_eq!(next(&mut client), None);
    daemon.message(1, 0, AlarmRecord { level: 9, ..AlarmRecord::default() });
    assert_eq!((next(&mut client), client.refused()), (None, 1));
    daemon.message(2, 0, AlarmRecord { nearest_m: f64::NAN, ..AlarmRecord::default() });
    assert_eq!((next(&mut client), client.refused()), (None, 2));
    daemon.frame(3);
    assert_eq!((next(&mut client), client.refused()), (Some((3, None)), 2));
}

#[test]
fn a_folder_that_others_can_change_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let (instance, mut client) = client(&folder, false);
    let _daemon = Fake::start(&instance);
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    std::fs::set_permissions(instance.directory(), mode).expect("own folder");
    let error = client.next(Duration::ZERO).expect_err("others could have changed it").to_string();
    assert!(error.contains("writable by others") && error.contains("lookout stream"), "{error}");
}
