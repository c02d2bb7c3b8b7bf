//! Messages as another process of the same user might write them, through the stages up to the viewer's JSON: nothing
//! panics, and what comes out is in its range.

#[path = "../../../ipc/tests/flipper/mod.rs"]
mod flipper;

use super::frame::{Frame, Images};
use crate::frame_record::frame_record;
use crate::launch::FrameFormat;
use crate::stages::stage::FrameStage;
use crate::stages::{Entry, configure_all, entry};
use bytemuck::{bytes_of, bytes_of_mut, pod_read_unaligned};
use config::Config;
use fastrand::Rng;
use flipper::{Flipper, places};
use messages::bus::Bus;
use messages::header::{Header, Kind};
use messages::instance::{Instance, InstanceLock};
use messages::pipeline::Role;
use messages::regions::{Counts, RegionRecord, RoadRecord};
use messages::track::{MAX_TRACKS, TrackRecord};
use messages::{obstacles, pair, regions};
use perception::rig::Rig;
use sources::PairSource;
use std::time::{Duration, Instant};

/// A message in memory that is aligned as shared memory is.
#[derive(Clone)]
struct Message {
    header: Header,
    memory: Vec<u64>,
    bytes: usize,
}

impl Message {
    fn new(header: Header, bytes: usize) -> Self {
        Self { header, memory: vec![0; bytes.div_ceil(8)], bytes }
    }

    fn payload(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.memory)[..self.bytes]
    }

    fn payload_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.memory)[..self.bytes]
    }
}

/// The header of a frame.
fn header(kind: Kind, format: &FrameFormat) -> Header {
    let mut header = Header::new(kind);
    (header.width, header.height) = (format.width as u32, format.height as u32);
    header
}

/// The output of a stage for a message; `None` if it refuses the message.
fn work(stage: &mut dyn FrameStage, input: &Message) -> Option<Message> {
    let (width, height) = (input.header.width as usize, input.header.height as usize);
    let kind = stage.output();
    let mut output =
        Message::new(input.header.forward(kind), kind.service().max_payload_bytes(width, height));
    let bytes = stage.work(&input.header, 0, input.payload(), output.payload_mut());
    output.bytes = bytes.ok()?;
    Some(output)
}

/// A stage with the default configuration.
fn stage(role: Role, config: &Config, format: &FrameFormat) -> Box<dyn FrameStage> {
    let Entry::Frames { configure, .. } = entry(role) else { panic!("{role} works on frames") };
    configure(config, format).expect("it can be configured")
}

/// The `depth` and `regions` messages of some frames of a drive.
fn drive(config: &Config, format: &FrameFormat, source: &mut dyn PairSource) -> Vec<[Message; 2]> {
    let mut stages = configure_all(config, format).expect("the stages can be configured");
    let mut frames = Vec::new();
    for index in 0..8 {
        let mut header = header(Kind::Pair, format);
        (header.sequence, header.source_ns) = (index, source.time_ns(index));
        let mut message = Message::new(header, pair::payload_bytes(format.width, format.height));
        let (left, right) = pair::split_mut(message.payload_mut());
        source.read(index, left, right).expect("the source gives a pair");
        let mut outputs = Vec::new();
        for (_, stage) in &mut stages {
            message = work(stage.as_mut(), &message).expect("a valid message is accepted");
            outputs.push(message.clone());
        }
        frames.push([outputs[0].clone(), outputs[1].clone()]);
    }
    frames
}

/// Numbers that a check may overlook.
const ODD: [f64; 12] = [
    0.0,
    -0.0,
    -1.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    1e13,
    -1e7,
    1.0 / 256.0,
    10_000.0,
];

/// Changes one of the `count` floating-point numbers from `start` on: most often a little.
fn change_real(random: &mut Rng, bytes: &mut [u8], start: usize, count: usize) {
    let at = start + 8 * random.usize(0..count);
    let value: f64 = pod_read_unaligned(&bytes[at..at + 8]);
    let new = match random.u8(0..8) {
        0 => ODD[random.usize(0..ODD.len())],
        1 => f64::from_bits(random.u64(..)),
        2 => -value,
        _ => value * (0.2 + 2.0 * random.f64()),
    };
    bytes[at..at + 8].copy_from_slice(&new.to_ne_bytes());
}

/// Changes one of the `count` whole numbers from `start` on: most often a little.
fn change_whole(random: &mut Rng, bytes: &mut [u8], start: usize, count: usize) {
    let at = start + 4 * random.usize(0..count);
    let value: u32 = pod_read_unaligned(&bytes[at..at + 4]);
    let new = match random.u8(0..6) {
        0 => random.u32(..),
        1 => [0, 1, u32::MAX, 1 << 31, 8192][random.usize(0..5)],
        _ => value.wrapping_add_signed(random.i32(-3..=3)),
    };
    bytes[at..at + 4].copy_from_slice(&new.to_ne_bytes());
}

/// Changes some fields of a `regions` message.
fn change_regions(random: &mut Rng, message: &mut Message) {
    let fixed = regions::max_payload_bytes(message.header.width as usize, message.header.height as usize)
        - regions::MAX_COUNT * size_of::<RegionRecord>()
        - MAX_TRACKS * size_of::<TrackRecord>()
        - message.header.pixels();
    let payload = message.payload_mut();
    let mut road: RoadRecord = pod_read_unaligned(&payload[..size_of::<RoadRecord>()]);
    let (count, tracks) = (road.regions as usize, road.tracks as usize);
    for _ in 0..random.usize(1..4) {
        match random.u8(0..8) {
            // Slope to height of the camera stand one after the other.
            0 => change_real(random, bytes_of_mut(&mut road), 16, 5),
            1 => change_whole(random, bytes_of_mut(&mut road), 56, 80),
            2 => {
                // A number of the profile or of the free space.
                let numbers = (fixed - size_of::<RoadRecord>()) / 4;
                change_whole(random, payload, size_of::<RoadRecord>(), numbers);
            }
            3..=5 if tracks > 0 => {
                let records = fixed + count * size_of::<RegionRecord>();
                let at = records + random.usize(0..tracks) * size_of::<TrackRecord>();
                // Counts and boxes, and then eighteen measures.
                if random.bool() {
                    change_whole(random, payload, at, 16);
                } else {
                    change_real(random, payload, at + 64, 18);
                }
            }
            _ if count > 0 => {
                let at = fixed + random.usize(0..count) * size_of::<RegionRecord>();
                // Ten measures, and then a box, a count and a track.
                if random.bool() {
                    change_real(random, payload, at, 10);
                } else {
                    change_whole(random, payload, at + 80, 6);
                }
            }
            _ => {}
        }
    }
    payload[..size_of::<RoadRecord>()].copy_from_slice(bytes_of(&road));
}

/// Changes the times of a header: most often as a recording with gaps does.
fn change_times(random: &mut Rng, header: &mut Header, before_ns: u64) {
    header.source_ns = match random.u8(0..40) {
        0 => random.u64(..),
        1 => 1 << 62,
        2 => before_ns.saturating_add(1 << random.u8(20..62)),
        3 => before_ns.saturating_sub(1 << random.u8(20..40)),
        _ => before_ns + random.u64(1..200_000_000),
    };
    if random.u8(0..40) == 0 {
        header.faults = random.u32(..);
    }
}

/// The record and the JSON of a result, which is in its ranges.
fn show(result: &Message, road: &Message, rig: Rig) {
    let message =
        obstacles::view(&result.header, result.payload()).expect("a stage writes what its readers accept");
    let record = frame_record(&result.header, &message);
    let road = regions::view(&road.header, road.payload()).expect("the stage has accepted it");
    let pixels = result.header.pixels();
    let images = Images { left: vec![9; pixels], disparity: vec![700; pixels] };
    let frame = Frame::new(&result.header, record, images, &road, rig, 128);
    let json = serde_json::to_value(frame.line()).expect("it is JSON");
    for o in json["obstacles"].as_array().expect("a list") {
        for name in ["distance_m", "distance_sigma_m", "lateral_m", "width_m", "height_m"] {
            let value = o[name].as_f64().unwrap_or_else(|| panic!("{name} of {o}"));
            assert!(value.abs() <= 10_000.0, "{name} of {o}");
        }
    }
    for list in ["profile", "free_m", "regions"] {
        assert!(!json[list].to_string().contains("null"), "{list}: {json}");
    }
}

#[test]
fn changed_messages_are_refused_or_give_results_in_their_ranges() {
    let config = Config::default();
    let mut source = crate::input::open(&config).expect("the built-in scene");
    let rig = crate::input::rig(&config, source.as_ref()).expect("it has a rig");
    let format = FrameFormat::new(source.size(), rig);
    let frames = drive(&config, &format, source.as_mut());
    assert!(frames.iter().any(|[_, road]| {
        regions::view(&road.header, road.payload()).is_ok_and(|road| !road.regions.is_empty())
    }));

    let mut random = Rng::with_seed(23);
    let mut recognition = stage(Role::Recognition, &config, &format);
    let (mut accepted, mut time_ns, rounds) = (0, 0, 2000);
    for round in 0..rounds {
        let [_, mut message] = frames[round % frames.len()].clone();
        message.header.sequence = round as u64;
        change_times(&mut random, &mut message.header, time_ns);
        if random.u8(0..4) > 0 {
            change_regions(&mut random, &mut message);
        }
        if let Some(result) = work(recognition.as_mut(), &message) {
            accepted += 1;
            time_ns = message.header.source_ns;
            if time_ns > 1 << 60 {
                // A new recording.
                time_ns = 0;
            }
            show(&result, &message, rig);
        }
    }
    println!("regions: {accepted} of {rounds} accepted");
    assert!(accepted * 10 > rounds && accepted < rounds, "{accepted} of {rounds}");

    // Every disparity, confidence and grey value is valid.
    let mut road = stage(Role::Road, &config, &format);
    for round in 0..40 {
        let [mut message, _] = frames[round % frames.len()].clone();
        message.header.sequence = (rounds + round) as u64;
        let payload = message.payload_mut();
        for _ in 0..random.usize(1..40) {
            let (at, length) = (random.usize(0..payload.len()), random.usize(1..3000));
            let end = (at + length).min(payload.len());
            payload[at..end].fill_with(|| random.u8(..));
        }
        let road = work(road.as_mut(), &message).expect("any image is valid");
        let result = work(recognition.as_mut(), &road).expect("what a stage writes is accepted");
        show(&result, &road, rig);
    }
}

#[test]
fn stages_survive_a_process_that_writes_their_messages() {
    let (width, height) = (160, 120);
    let rig = Rig { focal_px: 200.0, baseline_m: 0.3, cx_px: 80.0, cy_px: 50.0 };
    let format = FrameFormat::new((width, height), rig);
    let mut config = Config::default();
    config.stereo.disparities = 48;
    let mut random = Rng::with_seed(29);
    let mut message = Message::new(header(Kind::Pair, &format), pair::payload_bytes(width, height));
    message.payload_mut().fill_with(|| random.u8(..));
    for role in [Role::Stereo, Role::Road, Role::Recognition] {
        // Some regions in the way, whatever the road stage finds in noise.
        if role == Role::Recognition {
            message = regions_message(header(Kind::Regions, &format), &mut random);
        }
        let mut stage = stage(role, &config, &format);
        let next = work(stage.as_mut(), &message).expect("a valid message");
        let (accepted, rounds) = under_fire(stage.as_mut(), &message, &next);
        println!("{role}: {accepted} of {rounds} accepted");
        // How many are refused depends on how the system shares the processor.
        assert!(accepted >= 30, "{role}: {accepted} of {rounds}");
        message = next;
    }
}

/// A `regions` message with several regions.
fn regions_message(header: Header, random: &mut Rng) -> Message {
    let (width, height) = (header.width as usize, header.height as usize);
    let mut message = Message::new(header, regions::max_payload_bytes(width, height));
    let road =
        RoadRecord { seen: 1, slope: 0.25, horizon_px: 50.0, confidence: 0.9, ..RoadRecord::default() };
    let counts = Counts { regions: 8, tracks: 8 };
    let mut writer =
        regions::Writer::new(message.payload_mut(), road, &vec![2.0; height], counts).expect("it fits");
    for i in 0..8_u32 {
        let region = RegionRecord {
            disparity_px: 4.0 + f64::from(i),
            disparity_sigma_px: 0.1,
            distance_m: 60.0 / (4.0 + f64::from(i)),
            width_m: 1.8,
            height_m: 1.5,
            confidence: 0.9,
            bounds: [10 * i, 30, 40, 40],
            pixels: 900,
            track: i + 1,
            ..RegionRecord::default()
        };
        writer.push_region(&region);
        let track = TrackRecord {
            track: i + 1,
            confirmed: 1,
            seen: 10,
            consecutive_frames: 10,
            probability: 0.95,
            disparity_px: region.disparity_px,
            distance_m: region.distance_m,
            width_m: 1.8,
            height_m: 1.5,
            bounds: region.bounds,
            crop: region.bounds,
            ..TrackRecord::default()
        };
        let crop: Vec<u8> = std::iter::repeat_with(|| random.u8(..)).take(1600).collect();
        assert!(writer.push_track(track, crop.chunks(40)));
    }
    let bytes = writer.bytes();
    message.bytes = bytes;
    message
}

/// Processes a message in shared memory for two seconds, while its payload and that of the output are overwritten.
fn under_fire(stage: &mut dyn FrameStage, input: &Message, output: &Message) -> (u32, u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let instance = Instance::new("under-fire", folder.path());
    let _lock = InstanceLock::take(&instance).expect("the instance is free");
    let bus = Bus::join(&instance).expect("shared memory");
    let (width, height) = (input.header.width as usize, input.header.height as usize);
    let (from, to) = (stage.input().service(), stage.output().service());
    let publisher = bus.publisher(from, width, height).expect("a publisher");
    let subscriber = bus.subscriber(from).expect("a subscriber");
    let results = bus.publisher(to, width, height).expect("a publisher");
    let mut loan = publisher.loan(input.bytes).expect("a loan");
    *loan.header_mut() = input.header;
    loan.payload_mut().copy_from_slice(input.payload());
    publisher.send(loan).expect("it is sent");
    let sample = subscriber.receive().expect("shared memory").expect("the message");
    let mut loan = results.loan(to.max_payload_bytes(width, height)).expect("a loan");
    // A mark by which the output is found.
    let mark = *b"the output of a stage under fire";
    loan.payload_mut()[..mark.len()].copy_from_slice(&mark);

    let files = instance.shared_memory();
    let mut all = places(&files, input.payload());
    let mut outputs = places(&files, &mark);
    outputs.iter_mut().for_each(|place| place.set_content(output.payload()));
    all.extend(outputs);
    assert_eq!(all.len(), 2);
    let flipper = Flipper::start(all, 64);
    let until = Instant::now() + Duration::from_secs(2);
    let (mut accepted, mut rounds) = (0, 0);
    let mut header = *sample.header();
    while Instant::now() < until {
        (header.sequence, header.source_ns) = (header.sequence + 1, header.source_ns + 80_000_000);
        accepted += u32::from(stage.work(&header, 0, sample.payload(), loan.payload_mut()).is_ok());
        rounds += 1;
    }
    drop(flipper);
    (accepted, rounds)
}
