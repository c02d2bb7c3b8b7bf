//! Messages that another process changes while they are read: what was checked is what is used.

mod flipper;

use flipper::{Flipper, places};
use lookout_ipc::bus::Bus;
use lookout_ipc::header::{Header, Kind};
use lookout_ipc::instance::{Instance, InstanceLock};
use lookout_ipc::obstacles::{self, AlarmRecord, ObstacleRecord};
use lookout_ipc::port::Sample;
use lookout_ipc::regions::{self, Counts, RegionRecord, RoadRecord, Writer};
use lookout_ipc::service::{OBSTACLES, REGIONS, ServiceSpec};
use lookout_ipc::track::TrackRecord;
use std::hint::black_box;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;

/// Smallest number of accepted messages. How many are refused depends on how the system shares the processor.
const MIN_ACCEPTED: u32 = 30;

/// Looks at a value that was checked, for as long as a stage does.
const LOOKS: usize = 300;

/// One test at a time: on two cores, two readers that never sleep would leave each writer the core of its own reader, so
/// that nothing changes while it is read.
static ALONE: Mutex<()> = Mutex::new(());

/// Sends a message, and reads it for two seconds while its header and its payload are overwritten. `read` returns whether
/// it was accepted.
fn read_while_written(
    name: &str,
    spec: &ServiceSpec,
    payload: &[u8],
    mut read: impl FnMut(&Header, &[u8]) -> bool,
) {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new(name, folder.path());
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let publisher = bus.publisher(spec, WIDTH as usize, HEIGHT as usize).unwrap();
    let subscriber = bus.subscriber(spec).unwrap();
    let mut loan = publisher.loan(payload.len()).unwrap();
    let (sequence, source_ns) = (0x12_3456_789a_bcde_u64, 0x0bad_cafe_f00d_u64);
    let mut header = Header::new(spec.kind);
    (header.sequence, header.source_ns) = (sequence, source_ns);
    (header.width, header.height) = (WIDTH, HEIGHT);
    *loan.header_mut() = header;
    loan.payload_mut().copy_from_slice(payload);
    publisher.send(loan).unwrap();
    let sample: Sample = subscriber.receive().unwrap().unwrap();
    let header = *sample.header();

    // The header from its sequence on, and the payload.
    let start = [sequence.to_ne_bytes(), source_ns.to_ne_bytes()].concat();
    let files = instance.shared_memory();
    let mut all = places(&files, &start);
    all.extend(places(&files, payload));
    assert_eq!(all.len(), 2);
    let flipper = Flipper::start(all, 8);
    let until = Instant::now() + Duration::from_secs(2);
    let (mut accepted, mut rounds) = (0_u32, 0_u32);
    while Instant::now() < until {
        accepted += u32::from(read(sample.header(), sample.payload()));
        rounds += 1;
        assert_eq!(*sample.header(), header, "the header is a copy");
        assert_eq!(sample.payload().len(), payload.len(), "the length is a copy");
    }
    drop(flipper);
    println!("{name}: {accepted} of {rounds} accepted");
    assert!(accepted >= MIN_ACCEPTED && accepted < rounds, "{accepted} of {rounds}");
    drop((sample, subscriber, publisher, bus));
}

#[test]
fn regions_that_were_checked_do_not_change() {
    let mut memory = vec![0_u64; regions::max_payload_bytes(WIDTH as usize, HEIGHT as usize).div_ceil(8)];
    let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
    let road = RoadRecord { seen: 1, slope: 0.123_456, camera_height_m: 1.25, ..RoadRecord::default() };
    let mut writer =
        Writer::new(payload, road, &[1.5; HEIGHT as usize], Counts { regions: 6, tracks: 6 }).unwrap();
    for _ in 0..6 {
        writer.push_region(&RegionRecord {
            disparity_px: 4.0,
            distance_m: 20.0,
            bounds: [8, 8, 20, 16],
            ..RegionRecord::default()
        });
        let track = TrackRecord {
            disparity_px: 4.0,
            distance_m: 20.0,
            bounds: [8, 8, 20, 16],
            crop: [4, 4, 28, 24],
            ..TrackRecord::default()
        };
        writer.push_track(track, [[77_u8; 28]; 24].iter().map(|row| &row[..]));
    }
    let length = writer.bytes();
    let payload = bytemuck::cast_slice::<u64, u8>(&memory)[..length].to_vec();
    read_while_written("torn-regions", &REGIONS, &payload, |header, payload| {
        assert_eq!(header.check(Kind::Regions), Ok(()));
        let Ok(message) = regions::view(header, payload) else { return false };
        for _ in 0..LOOKS {
            assert!(black_box(message.road.slope).abs() <= 1000.0);
            for region in &message.regions {
                let region = black_box(region);
                assert!((1.0 / 256.0..=8192.0).contains(&region.disparity_px), "{region:?}");
                assert!((0.0..=10_000.0).contains(&region.distance_m), "{region:?}");
                assert!(region.bounds[0] + region.bounds[2] <= WIDTH, "{region:?}");
            }
            for track in &message.tracks {
                let track = black_box(track);
                assert!((0.0..=10_000.0).contains(&track.distance_m), "{track:?}");
                assert!(track.bounds[0] + track.bounds[2] <= WIDTH, "{track:?}");
                let Some(crop) = message.crop(track) else { continue };
                assert_eq!(crop.len(), (track.crop[2] * track.crop[3]) as usize);
                black_box(crop.iter().map(|&v| u32::from(v)).sum::<u32>());
            }
            black_box(message.profile_px.iter().sum::<f32>());
        }
        true
    });
}

#[test]
fn obstacles_that_were_checked_do_not_change() {
    let obstacle =
        ObstacleRecord { track: 3, bounds: [8, 8, 20, 16], distance_m: 12.5, ..Default::default() };
    let alarm = AlarmRecord { level: 2, rule: 1, track: 3, nearest_m: 12.5, ..AlarmRecord::default() };
    let mut memory = vec![0_u64; obstacles::payload_bytes(9) / 8];
    obstacles::write(bytemuck::cast_slice_mut(&mut memory), alarm, &[obstacle; 9]).unwrap();
    read_while_written("torn-obstacles", &OBSTACLES, bytemuck::cast_slice(&memory), |header, payload| {
        let Ok(message) = obstacles::view(header, payload) else { return false };
        for _ in 0..LOOKS {
            assert!(black_box(message.alarm.level) <= 3 && black_box(message.obstacles.len()) == 9);
            for obstacle in &message.obstacles {
                let obstacle = black_box(obstacle);
                assert!((0.0..=10_000.0).contains(&obstacle.distance_m), "{obstacle:?}");
                assert!(obstacle.bounds[0] + obstacle.bounds[2] <= WIDTH, "{obstacle:?}");
            }
        }
        true
    });
}
