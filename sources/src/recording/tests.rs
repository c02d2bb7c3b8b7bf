//! ROS 2 bags, which the tests encode themselves.

use super::*;
use crate::luma::luma;
use crate::picture::Interpretation;
use crate::{Geometry, PairSource, SourceError};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// A recording with so many topics, each of which looks like one camera's images.
fn with_topics(path: &Path, topics: u16) {
    let mut writer = WriteOptions::new().create(File::create(path).unwrap()).unwrap();
    for i in 0..topics {
        let name = format!("/robot{i}/left/image_{}", "x".repeat(100));
        let schema = writer.add_schema("sensor_msgs/msg/Image", "ros2msg", b"").unwrap();
        let id = writer.add_channel(schema, &name, "cdr", &BTreeMap::new()).unwrap();
        let header =
            MessageHeader { channel_id: id, sequence: 0, log_time: START_NS, publish_time: START_NS };
        writer.write_to_known_channel(&header, &[]).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn counts_beyond_the_limits_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("topics.mcap");
    with_topics(&path, 60_000);
    let error = RecordingSource::open(&path).unwrap_err().to_string();
    assert!(
        error.contains(
            "topics.mcap: 4097 topics: a recording has at most 4096: divide it, or keep only the topics"
        ),
        "{error}"
    );
    // An error does not list thousands of topics.
    with_topics(&path, 4000);
    let error = RecordingSource::open(&path).unwrap_err().to_string();
    assert!(error.contains("and 3980 more") && error.len() < 4000, "{error}");
}

#[test]
fn a_record_that_is_too_long_is_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.mcap");
    for (opcode, bytes, limit) in [
        (mcap::records::op::METADATA, 5_u64 << 20, 4_u64 << 20),
        (mcap::records::op::CHUNK, 1 << 40, 142_606_336),
    ] {
        let head = [mcap::MAGIC, &[opcode], &bytes.to_le_bytes()].concat();
        std::fs::write(&path, &head).unwrap();
        // A hole on disk, which is as long as the record says, and a footer behind it.
        let file = File::options().write(true).open(&path).unwrap();
        let footer = [vec![mcap::records::op::FOOTER], 20_u64.to_le_bytes().to_vec(), vec![0; 20]].concat();
        file.write_all_at(&footer, head.len() as u64 + bytes).unwrap();
        let error = Index::open(&path).unwrap_err().to_string();
        let expected = format!("{bytes} bytes in the record at byte 17: a recording has at most {limit}");
        assert!(error.contains(&expected), "{error}");
    }
}

const START_NS: u64 = 1_700_000_000_000_000_000;

/// Writes little-endian CDR.
struct CdrWriter(Vec<u8>);

impl CdrWriter {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(&mut self, to: usize) {
        while !(self.0.len() - 4).is_multiple_of(to) {
            self.0.push(0);
        }
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.align(8);
        self.0.extend(value.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    fn header(&mut self) {
        self.u32(1_700_000_000);
        self.u32(0);
        self.text("camera");
    }

    fn image(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> Vec<u8> {
        let mut cdr = Self::new();
        cdr.header();
        cdr.u32(height);
        cdr.u32(width);
        cdr.text(encoding);
        cdr.0.push(0);
        cdr.u32(step);
        cdr.u32(data.len() as u32);
        cdr.0.extend(data);
        cdr.0
    }

    fn camera_info(p: [f64; 12]) -> Vec<u8> {
        Self::camera_info_with(p, (3, 2), 0.5)
    }

    /// For images of a size; `d` is each coefficient of the distortion.
    fn camera_info_with(p: [f64; 12], (width, height): (u32, u32), d: f64) -> Vec<u8> {
        let mut cdr = Self::new();
        cdr.header();
        cdr.u32(height);
        cdr.u32(width);
        cdr.text("plumb_bob");
        cdr.u32(5);
        (0..5).for_each(|_| cdr.f64(d));
        (0..9).for_each(|_| cdr.f64(0.5));
        (0..9).for_each(|i| cdr.f64(if i % 4 == 0 { 1.0 } else { 0.0 }));
        p.into_iter().for_each(|v| cdr.f64(v));
        cdr.0
    }
}

/// Writes a bag of messages: topic, type, time in ms, bytes.
fn bag(path: &Path, compression: Option<Compression>, messages: &[(&str, &str, u64, Vec<u8>)]) {
    let mut writer: Writer<File> = WriteOptions::new()
        .compression(compression)
        .profile("ros2")
        .create(File::create(path).unwrap())
        .unwrap();
    for (topic, kind, at_ms, data) in messages {
        let schema = writer.add_schema(&format!("sensor_msgs/msg/{kind}"), "ros2msg", b"").unwrap();
        let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        let time = START_NS + at_ms * 1_000_000;
        let header = MessageHeader { channel_id: channel, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
}

const LEFT: &str = "/stereo/left/image_rect";
const RIGHT: &str = "/stereo/right/image_rect";

fn projection(shift: f64) -> [f64; 12] {
    [500.0, 0.0, 1.5, shift, 0.0, 500.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
}

#[test]
fn a_ros_2_bag_is_a_source() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [None, Some(Compression::Lz4), Some(Compression::Zstd)] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let grey = |level: u8| {
            CdrWriter::image("mono8", 3, 2, 4, &[level, level, level, 99, level, level, level, 99])
        };
        // Pure green has the grey level 150.
        let green = CdrWriter::image("rgb8", 3, 2, 9, &[0, 255, 0].repeat(6));
        let mut messages = vec![
            ("/stereo/left/camera_info", "CameraInfo", 0, CdrWriter::camera_info(projection(0.0))),
            ("/stereo/right/camera_info", "CameraInfo", 0, CdrWriter::camera_info(projection(-60.0))),
            ("/stereo/left/image_raw", "Image", 0, grey(1)),
            ("/stereo/right/image_raw", "Image", 0, grey(2)),
        ];
        for n in 0..6_u64 {
            messages.push((LEFT, "Image", 100 * n, grey(10 + n as u8)));
            // Right images are 7 ms later; the third is missing.
            if n != 2 {
                messages.push((
                    RIGHT,
                    "Image",
                    100 * n + 7,
                    if n == 5 { green.clone() } else { grey(20 + n as u8) },
                ));
            }
        }
        bag(&path, compression, &messages);
        let mut source = RecordingSource::open(&path).unwrap();
        assert_eq!((source.size(), source.count(), source.period_ns()), ((3, 2), Some(5), 100_000_000));
        let rig = source.rig().unwrap();
        assert_eq!((rig.focal_px, rig.baseline_m, rig.cx_px, rig.cy_px), (500.0, 0.12, 1.5, 1.0));
        let mut levels = Vec::new();
        let (mut left, mut right) = ([0; 6], [0; 6]);
        for i in 0..5 {
            source.read(i, &mut left, &mut right).unwrap();
            levels.push((left[5], right[5], source.time_ns(i) / 1_000_000));
        }
        // The lost pair leaves a gap in the times.
        assert_eq!(levels, [(10, 20, 0), (11, 21, 100), (13, 23, 300), (14, 24, 400), (15, 150, 500)]);
        assert!(matches!(source.read(5, &mut left, &mut right), Err(SourceError::End { count: 5, .. })));
    }
}

#[test]
fn a_bag_says_whether_its_pictures_are_rectified() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let open = |topic: &str, size: (u32, u32), d: f64| {
        let image = CdrWriter::image("mono8", 3, 2, 3, &[9; 6]);
        let info = |side: &str, shift: f64| {
            let data = CdrWriter::camera_info_with(projection(shift), size, d);
            (format!("/stereo/{side}/camera_info"), "CameraInfo", data)
        };
        let picture = |side: &str| (format!("/stereo/{side}/{topic}"), "Image", image.clone());
        let messages = [info("left", 0.0), info("right", -60.0), picture("left"), picture("right")];
        let messages: Vec<(&str, &str, u64, Vec<u8>)> =
            messages.iter().map(|(topic, kind, data)| (&topic[..], *kind, 0, data.clone())).collect();
        bag(&path, None, &messages);
        RecordingSource::open(&path)
    };
    let geometry = |topic: &str, d: f64| open(topic, (3, 2), d).unwrap().geometry();
    assert_eq!(geometry("image_rect", 0.3), Geometry::Rectified);
    assert_eq!(geometry("image_raw", 0.0), Geometry::Rectified);
    assert_eq!(geometry("image_raw", 0.3), Geometry::Distorted);
    // An older file may not say for which size it is.
    assert_eq!(open("image_rect", (0, 0), 0.0).unwrap().geometry(), Geometry::Rectified);
    let error = open("image_rect", (6, 4), 0.0).unwrap_err().to_string();
    assert!(error.contains("6x4") && error.contains("3x2"), "{error}");
}

#[test]
fn images_of_sixteen_bits_and_of_a_colour_filter_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.mcap");
    let twelve: Vec<u8> = [0_u16, 2048, 4095, 1, 4000, 100].iter().flat_map(|v| v.to_le_bytes()).collect();
    let deep = || CdrWriter::image("mono16", 3, 2, 6, &twelve);
    // One colour behind the filter: red, green, red; green, blue, green.
    let raw = CdrWriter::image("bayer_rggb8", 3, 2, 3, &[200, 120, 200, 120, 30, 120]);
    let mut messages = vec![(LEFT, "Image", 0, deep()), (RIGHT, "Image", 0, deep())];
    messages.extend([(LEFT, "Image", 100, raw.clone()), (RIGHT, "Image", 100, raw)]);
    bag(&path, None, &messages);
    let read = |how: Interpretation| {
        let mut source = RecordingSource::open(&path).unwrap().interpreted(how).unwrap();
        let (mut left, mut right) = ([0; 6], [0; 6]);
        source.read(0, &mut left, &mut right).unwrap();
        assert_eq!(left, right);
        source.read(1, &mut right, &mut [0; 6]).unwrap();
        (left, right, source.notes().join(" "))
    };
    let (left, bayer, notes) = read(Interpretation::default());
    assert_eq!((left, bayer), ([0, 128, 255, 0, 249, 6], [luma(&[200, 120, 30]); 6]));
    assert!(notes.contains("scaled from 12 bits"), "{notes}");
    let (left, _, notes) = read(Interpretation { bits: Some(16), bayer: None });
    assert_eq!((left[2], &notes[..]), (16, ""));
}

#[test]
fn what_is_not_understood_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = |messages: &[(&str, &str, u64, Vec<u8>)]| {
        let path = folder.path().join("a.mcap");
        bag(&path, None, messages);
        let mut source = match RecordingSource::open(&path) {
            Ok(source) => source,
            Err(error) => return error.to_string(),
        };
        let (mut left, mut right) = ([0; 6], [0; 6]);
        let last = source.count().unwrap() - 1;
        source.read(last, &mut left, &mut right).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let image = |encoding: &str, data: usize| CdrWriter::image(encoding, 3, 2, 3, &vec![7; data]);
    let whole = error(&[(LEFT, "Image", 0, image("mono8", 6)), (RIGHT, "Image", 0, image("mono8", 6))]);
    assert_eq!(whole, "");
    let bytes = std::fs::read(folder.path().join("a.mcap")).unwrap();
    let truncated = folder.path().join("truncated.mcap");
    std::fs::write(&truncated, &bytes[..60]).unwrap();
    let truncated = RecordingSource::open(&truncated).map(|_| ()).unwrap_err().to_string();
    assert!(truncated.contains("truncated before the end of its first chunk"), "{truncated}");
    let alone = error(&[(LEFT, "Image", 0, image("mono8", 6))]);
    assert!(alone.contains("a.mcap: no pairs of images") && alone.contains(LEFT), "{alone}");
    let pair = |left: Vec<u8>, right: Vec<u8>| error(&[(LEFT, "Image", 0, left), (RIGHT, "Image", 0, right)]);
    for encoding in ["yuv422", "bayer_rgxx8", "bayer_rggb12", "bayer_é"] {
        let other = pair(image(encoding, 6), image("mono8", 6));
        assert!(other.contains(encoding) && other.contains(LEFT) && other.contains("mono16"), "{other}");
    }
    let short = pair(image("mono16", 6), image("mono16", 6));
    assert!(short.contains("6 bytes are too few for 3x2"), "{short}");
    let short = pair(image("mono8", 5), image("mono8", 6));
    assert!(short.contains("5 bytes are too few for 3x2"), "{short}");
    let cut = pair(image("mono8", 6)[..30].to_vec(), image("mono8", 6));
    assert!(cut.contains("cut off"), "{cut}");
    let other = pair(image("mono8", 6), CdrWriter::image("mono8", 2, 2, 2, &[7; 4]));
    assert!(other.contains("left images have 3x2 pixels, right ones 2x2"), "{other}");
    // A different size later in the file is an error of that frame.
    let later = error(&[
        (LEFT, "Image", 0, image("mono8", 6)),
        (RIGHT, "Image", 0, image("mono8", 6)),
        (LEFT, "Image", 100, CdrWriter::image("mono8", 2, 2, 2, &[7; 4])),
        (RIGHT, "Image", 100, image("mono8", 6)),
    ]);
    assert!(later.contains("2x2 pixels, the first pair has 3x2"), "{later}");
    // Messages with random bytes changed.
    let mut random = fastrand::Rng::with_seed(8);
    for _ in 0..300 {
        let mut message = image("mono8", 6);
        for _ in 0..random.usize(1..5) {
            let at = random.usize(0..message.len());
            message[at] = random.u8(..);
        }
        let said = pair(message, image("mono8", 6));
        assert!(said.is_empty() || said.contains("a.mcap"), "{said}");
    }
}
