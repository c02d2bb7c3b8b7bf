//! Tests of sinks and recorders, on the real disk and on one with limited space; truncated and damaged files.

use super::encode::{self, PairLine, Side, Stamp};
use super::storage::{Disk, Medium, Storage};
use super::*;
use perception::rig::Rig;
use sources::PairSource;
use sources::recording::{Index, RecordingSource};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const SIZE: (u32, u32) = (40, 30);
const RIG: Rig = Rig { focal_px: 440.3, baseline_m: 0.1234567, cx_px: 20.1, cy_px: 15.9 };
const START_NS: u64 = 1_700_000_000_000_000_000;

/// The real disk with limited space, in bytes.
struct SmallDisk {
    room: Arc<AtomicU64>,
}

struct SmallFile {
    file: Box<dyn Medium>,
    room: Arc<AtomicU64>,
}

impl Write for SmallFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = self.room.load(Ordering::Relaxed);
        if room == 0 {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        let written = self.file.write(&bytes[..bytes.len().min(room as usize)])?;
        self.room.fetch_sub(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for SmallFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Storage for SmallDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>> {
        Ok(Box::new(SmallFile { file: Disk.create(path)?, room: Arc::clone(&self.room) }))
    }

    fn exists(&self, path: &Path) -> bool {
        path.exists()
    }

    fn free_bytes(&self, _path: &Path) -> io::Result<u64> {
        Ok(self.room.load(Ordering::Relaxed))
    }
}

fn pixels(frame: u64, side: u8) -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(2 * frame + u64::from(side));
    (0..SIZE.0 * SIZE.1).map(|_| random.u8(..)).collect()
}

/// The messages of one frame, 100 ms after the previous one.
fn frame(n: u64, form: ImageForm) -> Vec<Message> {
    let stamp = Stamp { sequence: n, time_ns: START_NS + n * 100_000_000 };
    let (width, height) = SIZE;
    let line = PairLine { sequence: n, source_ns: n * 100_000_000, capture_ns: n, width, height };
    let mut messages = encode::geometry(stamp, &RIG, SIZE).to_vec();
    messages.extend([
        encode::image(stamp, Side::Left, form, &pixels(n, 0), SIZE).unwrap(),
        encode::image(stamp, Side::Right, form, &pixels(n, 1), SIZE).unwrap(),
        encode::json(stamp, Topic::Pair, &line),
    ]);
    messages
}

fn about() -> About {
    let numbers = [
        ("focal_px", RIG.focal_px),
        ("baseline_m", RIG.baseline_m),
        ("cx_px", RIG.cx_px),
        ("cy_px", RIG.cy_px),
    ];
    numbers.into_iter().map(|(key, value)| (key.to_owned(), value.to_string())).collect()
}

fn sink(path: &Path, form: ImageForm, limits: Limits) -> Sink {
    Sink::new(Box::new(Disk), path, form, limits, about()).unwrap()
}

fn put(sink: &mut Sink, frames: std::ops::Range<u64>, form: ImageForm) -> Result<(), RecordError> {
    frames.flat_map(|n| frame(n, form)).try_for_each(|m| sink.take(Item::Message(m)))
}

/// Asserts that the pairs of a file are those of `frames`.
fn assert_pairs(path: &Path, frames: std::ops::Range<u64>) {
    let mut source = RecordingSource::open(path).unwrap();
    assert_eq!(source.count(), Some(frames.end - frames.start), "{}", path.display());
    assert_eq!((source.size(), source.rig(), source.period_ns()), ((40, 30), Some(RIG), 100_000_000));
    let (mut left, mut right) = (vec![0; 1200], vec![0; 1200]);
    for (i, n) in frames.enumerate() {
        source.read(i as u64, &mut left, &mut right).unwrap();
        assert!(left == pixels(n, 0) && right == pixels(n, 1), "frame {n}");
        assert_eq!(source.time_ns(i as u64), i as u64 * 100_000_000);
    }
}

#[test]
fn pairs_come_back_as_they_were_and_the_rig_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    for form in [ImageForm::Raw, ImageForm::Png] {
        let path = folder.path().join(format!("{}.mcap", form.name()));
        let mut sink = sink(&path, form, Limits::default());
        put(&mut sink, 0..25, form).unwrap();
        sink.lost("pair", 3, START_NS).unwrap();
        let report = sink.finish("the test is over").unwrap();
        assert_eq!((report.frames, report.lost["pair"], report.files.len()), (25, 3, 1));
        assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
        assert_pairs(&path, 0..25);
        let mut index = Index::open(&path).unwrap();
        assert_eq!(index.cut, None);
        let summary = index.metadata(sources::recording::SUMMARY).unwrap();
        assert_eq!((&summary["lost pair"][..], &summary["ended because"][..]), ("3", "the test is over"));
        let losses = index.all_of(sources::recording::LOSS).unwrap();
        let loss: serde_json::Value = serde_json::from_slice(&losses[0].data).unwrap();
        assert_eq!((loss["service"].as_str(), loss["count"].as_u64()), (Some("pair"), Some(3)));
        // A second recording does not overwrite the first.
        let again = Sink::new(Box::new(Disk), &path, form, Limits::default(), about());
        assert!(matches!(again, Err(RecordError::Exists { .. })));
    }
}

#[test]
fn jpeg_is_near() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut sink = sink(&path, ImageForm::Jpeg, Limits::default());
    let stamp = Stamp { sequence: 0, time_ns: START_NS };
    let ramp: Vec<u8> = (0..1200).map(|i| (i % 40 * 5) as u8).collect();
    for side in [Side::Left, Side::Right] {
        sink.take(Item::Message(encode::image(stamp, side, ImageForm::Jpeg, &ramp, SIZE).unwrap())).unwrap();
    }
    sink.finish("over").unwrap();
    let mut source = RecordingSource::open(&path).unwrap();
    let (mut left, mut right) = (vec![0; 1200], vec![0; 1200]);
    source.read(0, &mut left, &mut right).unwrap();
    assert!(left.iter().zip(&ramp).all(|(a, b)| a.abs_diff(*b) <= 12));
}

#[test]
fn files_are_split_by_time_and_by_size_and_each_stands_alone() {
    let folder = tempfile::tempdir().unwrap();
    let name = |stem: &str, n: usize| folder.path().join(format!("{stem}_{n:04}.mcap"));
    let limits = Limits { split_ns: Some(1_000_000_000), ..Limits::default() };
    let mut by_time = sink(&folder.path().join("t.mcap"), ImageForm::Raw, limits);
    put(&mut by_time, 0..35, ImageForm::Raw).unwrap();
    let report = by_time.finish("over").unwrap();
    assert_eq!(report.files, (1..=4).map(|n| name("t", n)).collect::<Vec<PathBuf>>());
    for (file, first) in report.files.iter().zip([0, 10, 20, 30]) {
        assert_pairs(file, first..(first + 10).min(35));
    }
    // Numbers continue after those of existing files.
    let mut more = sink(&folder.path().join("t.mcap"), ImageForm::Raw, limits);
    put(&mut more, 0..2, ImageForm::Raw).unwrap();
    assert_eq!(more.finish("over").unwrap().files, [name("t", 5)]);

    let limits = Limits { split_bytes: Some(60_000), ..Limits::default() };
    let mut by_size = sink(&folder.path().join("s.mcap"), ImageForm::Raw, limits);
    put(&mut by_size, 0..100, ImageForm::Raw).unwrap();
    let report = by_size.finish("over").unwrap();
    assert!(report.files.len() > 3, "{report:?}");
    for (i, file) in report.files.iter().enumerate() {
        let bytes = std::fs::metadata(file).unwrap().len();
        assert!(bytes <= 60_000, "{}: {bytes} bytes", file.display());
        assert!(bytes > 40_000 || i + 1 == report.files.len(), "{}: {bytes} bytes", file.display());
    }
    let total: u64 = report.files.iter().map(|f| RecordingSource::open(f).unwrap().count().unwrap()).sum();
    assert_eq!(total, 100);
    // A limit that is smaller than a frame gives files of one frame.
    let limits = Limits { split_bytes: Some(1), ..Limits::default() };
    let mut by_frame = sink(&folder.path().join("f.mcap"), ImageForm::Raw, limits);
    put(&mut by_frame, 0..4, ImageForm::Raw).unwrap();
    let report = by_frame.finish("over").unwrap();
    assert_eq!(report.frames, 4, "{report:?}");
}

#[test]
fn the_ring_is_written_when_an_alarm_comes_and_only_then() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.mcap");
    let ring = RingLimits { before_ns: 2_000_000_000, after_ns: 1_000_000_000, bytes: 1 << 20 };
    let limits = Limits { ring: Some(ring), ..Limits::default() };
    let mut quiet = sink(&path, ImageForm::Raw, limits);
    put(&mut quiet, 0..60, ImageForm::Raw).unwrap();
    assert_eq!(quiet.finish("over").unwrap().files.len(), 0);
    let mut sink = sink(&path, ImageForm::Raw, limits);
    for alarms in [50..55_u64, 120..121] {
        let start = if alarms.start == 50 { 0 } else { 80 };
        for n in start..alarms.end + 25 {
            put(&mut sink, n..n + 1, ImageForm::Raw).unwrap();
            if alarms.contains(&n) {
                sink.take(Item::Alarm { time_ns: START_NS + n * 100_000_000 }).unwrap();
            }
        }
    }
    let report = sink.finish("over").unwrap();
    assert_eq!(report.files.len(), 2, "a file for each of the two alarms");
    // Two seconds before the first frame of the alarm, one second after the last.
    assert_pairs(&report.files[0], 30..65);
    assert_pairs(&report.files[1], 100..131);
}

#[test]
fn a_full_disk_ends_the_recording_with_a_reason_and_what_was_written_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    // Full in the middle of a chunk: the write fails.
    let path = folder.path().join("full.mcap");
    let disk = SmallDisk { room: Arc::new(AtomicU64::new(60_000)) };
    let mut sink = Sink::new(Box::new(disk), &path, ImageForm::Png, Limits::default(), about()).unwrap();
    let error = put(&mut sink, 0..1000, ImageForm::Png).unwrap_err();
    assert!(matches!(error, RecordError::Write { .. }), "{error}");
    assert!(
        error.to_string().contains("full.mcap") && error.to_string().contains("can be replayed"),
        "{error}"
    );
    assert!(sink.finish("the disk is full").is_err());
    let source = RecordingSource::open(&path).unwrap();
    assert!(source.cut().is_some() && source.count() >= Some(5), "{:?}", source.count());
    assert_pairs(&path, 0..source.count().unwrap());

    // Nearly full: the recording ends before the disk is full, and the file is complete.
    let path = folder.path().join("near.mcap");
    let disk = SmallDisk { room: Arc::new(AtomicU64::new(200_000)) };
    let limits = Limits { min_free_bytes: 100_000, ..Limits::default() };
    let mut sink = Sink::new(Box::new(disk), &path, ImageForm::Raw, limits, about()).unwrap();
    let error = put(&mut sink, 0..1000, ImageForm::Raw).unwrap_err();
    assert!(matches!(error, RecordError::Space { .. }), "{error}");
    sink.finish("no room").unwrap();
    let source = RecordingSource::open(&path).unwrap();
    assert!(source.cut().is_none() && source.count() > Some(10));

    // Too little space from the start: no file is created.
    let disk = SmallDisk { room: Arc::new(AtomicU64::new(50_000)) };
    let refused = Sink::new(Box::new(disk), &folder.path().join("no.mcap"), ImageForm::Raw, limits, about());
    assert!(matches!(refused, Err(RecordError::Space { .. })));
    assert!(!folder.path().join("no.mcap").exists());
}

#[test]
fn a_file_that_is_deleted_or_moved_ends_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    type Act = fn(&Path);
    let acts: [Act; 4] = [
        |folder| std::fs::remove_dir_all(folder).unwrap(),
        |folder| std::fs::rename(folder, folder.with_extension("moved")).unwrap(),
        |folder| std::fs::remove_file(folder.join("a.mcap")).unwrap(),
        |folder| {
            std::fs::remove_file(folder.join("a.mcap")).unwrap();
            std::fs::write(folder.join("a.mcap"), "another").unwrap();
        },
    ];
    for (n, act) in acts.into_iter().enumerate() {
        let inner = folder.path().join(n.to_string());
        std::fs::create_dir(&inner).unwrap();
        let mut sink = sink(&inner.join("a.mcap"), ImageForm::Raw, Limits::default());
        put(&mut sink, 0..5, ImageForm::Raw).unwrap();
        act(&inner);
        // At its end, or with the next chunk.
        let error = match n % 2 {
            0 => sink.finish("over").unwrap_err(),
            _ => put(&mut sink, 5..100, ImageForm::Raw).unwrap_err(),
        };
        assert!(matches!(error, RecordError::Gone { .. }), "{n}: {error}");
        assert!(error.to_string().contains("a.mcap"), "{error}");
    }
}

#[test]
fn a_file_that_cannot_be_created_is_told_before_anything_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing/a.mcap");
    std::fs::write(folder.path().join("file"), "").unwrap();
    let in_file = folder.path().join("file/a.mcap");
    let ring = RingLimits { before_ns: 1, after_ns: 1, bytes: 1 };
    for (path, limits) in [
        (&missing, Limits::default()),
        (&missing, Limits { ring: Some(ring), ..Limits::default() }),
        (&in_file, Limits::default()),
    ] {
        let refused = Sink::new(Box::new(Disk), path, ImageForm::Raw, limits, about());
        let Err(error) = refused else { panic!("{} was accepted", path.display()) };
        let text = error.to_string();
        assert!(text.contains("cannot be created") && !text.contains("can be replayed"), "{text}");
    }
    // The folder vanishes before the first message.
    std::fs::create_dir(folder.path().join("missing")).unwrap();
    let mut sink = sink(&missing, ImageForm::Raw, Limits::default());
    std::fs::remove_dir(folder.path().join("missing")).unwrap();
    let error = put(&mut sink, 0..1, ImageForm::Raw).unwrap_err();
    assert!(matches!(error, RecordError::Create { .. }), "{error}");
    assert!(sink.finish("over").unwrap().files.is_empty());
}

#[test]
fn a_file_cut_anywhere_is_read_to_its_last_whole_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut sink = sink(&path, ImageForm::Raw, Limits::default());
    put(&mut sink, 0..60, ImageForm::Raw).unwrap();
    sink.finish("over").unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let cut = folder.path().join("cut.mcap");
    let mut random = fastrand::Rng::with_seed(21);
    let mut most = 0;
    for _ in 0..150 {
        let length = random.usize(8..bytes.len());
        std::fs::write(&cut, &bytes[..length]).unwrap();
        match RecordingSource::open(&cut) {
            Ok(source) => {
                let count = source.count().unwrap();
                most = most.max(count);
                // One chunk a second, ten frames in each: only the last chunk is lost.
                let share = length as f64 / bytes.len() as f64;
                assert!(count as f64 >= (60.0 * share - 14.0).floor(), "{count} frames of {share:.2}");
                assert_pairs(&cut, 0..count);
            }
            Err(error) => {
                assert!(length < 20_000 + bytes.len() / 5, "{length} of {}: {error}", bytes.len());
                assert!(error.to_string().contains("cut.mcap"), "{error}");
            }
        }
    }
    assert!(most > 40);
}

#[test]
fn damaged_bytes_are_an_error_and_never_other_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut sink = sink(&path, ImageForm::Raw, Limits::default());
    put(&mut sink, 0..20, ImageForm::Raw).unwrap();
    sink.finish("over").unwrap();
    let good = std::fs::read(&path).unwrap();
    let bad = folder.path().join("bad.mcap");
    let mut random = fastrand::Rng::with_seed(4);
    let (mut left, mut right) = (vec![0; 1200], vec![0; 1200]);
    let mut errors = 0;
    for _ in 0..200 {
        let mut bytes = good.clone();
        for _ in 0..random.usize(1..4) {
            let at = random.usize(8..bytes.len());
            bytes[at] ^= 1 << random.u8(0..8);
        }
        std::fs::write(&bad, &bytes).unwrap();
        let mut source = match RecordingSource::open(&bad) {
            Ok(source) => source,
            Err(error) => {
                assert!(error.to_string().contains("bad.mcap"), "{error}");
                errors += 1;
                continue;
            }
        };
        for i in 0..source.count().unwrap().min(20) {
            match source.read(i, &mut left, &mut right) {
                // A changed time or index can lose a frame, but a chunk with changed bytes is rejected.
                Ok(()) => assert!((0..20).any(|n| left == pixels(n, 0))),
                Err(error) => {
                    assert!(error.to_string().contains("bad.mcap"), "{error}");
                    errors += 1;
                    break;
                }
            }
        }
    }
    assert!(errors > 100, "{errors}");
}

#[test]
fn a_recorder_counts_what_its_disk_cannot_take() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut recorder = Recorder::start(sink(&path, ImageForm::Raw, Limits::default()), path.clone());
    for message in (0..30).flat_map(|n| frame(n, ImageForm::Raw)) {
        assert_eq!(recorder.offer(Item::Message(message), 0), Offer::Taken);
    }
    recorder.lost("pair", 2, START_NS);
    let report = recorder.finish("over").unwrap();
    assert_eq!((report.frames, report.lost["pair"]), (30, 2));
    assert_pairs(&path, 0..30);
    // A disk that fails ends the recording; the recorder reports it.
    let path = folder.path().join("b.mcap");
    let disk = SmallDisk { room: Arc::new(AtomicU64::new(20_000)) };
    let sink = Sink::new(Box::new(disk), &path, ImageForm::Raw, Limits::default(), about()).unwrap();
    let mut recorder = Recorder::start(sink, path);
    let start = std::time::Instant::now();
    let mut n = 0;
    while !recorder.is_over() {
        assert!(start.elapsed().as_secs() < 120, "the recording never ended");
        frame(n, ImageForm::Raw).into_iter().for_each(|m| {
            recorder.offer(Item::Message(m), n);
        });
        n += 1;
    }
    let error = recorder.finish("over").unwrap_err();
    assert!(matches!(error, RecordError::Write { .. }), "{error}");
}

#[test]
fn the_pose_is_a_transform_in_the_axes_of_the_vehicle() {
    use prost::Message as _;
    use sources::recording::foxglove::FrameTransform;
    let stamp = Stamp { sequence: 3, time_ns: START_NS };
    // 2 m to the right, 0.5 m down, 30 m forward; turned to the left by 0.4 rad: about the camera's y, which points down.
    let half = 0.2_f64;
    let message = encode::odometry(stamp, [2.0, 0.5, 30.0], [0.0, -half.sin(), 0.0, half.cos()]);
    assert_eq!((message.topic.name(), message.sequence), ("/odometry", 3));
    assert!(!message.topic.is_latched(), "a file begins with the pose of its first frame");
    let transform = FrameTransform::decode(&message.data[..]).unwrap();
    assert_eq!((&*transform.parent_frame_id, &*transform.child_frame_id), ("start", "vehicle"));
    let (at, turn) = (transform.translation.unwrap(), transform.rotation.unwrap());
    // x forward, y left, z up: the turn is about z, positive.
    assert_eq!([at.x, at.y, at.z], [30.0, -2.0, -0.5]);
    assert_eq!([turn.x, turn.y, turn.z, turn.w], [0.0, 0.0, half.sin(), half.cos()]);
}

#[test]
fn free_space_and_boundaries_are_lines_on_the_road_in_the_scene() {
    use crate::reporting::record::{FrameRecord, RoadLine};
    use crate::reporting::space::BoundaryLine;
    use prost::Message;
    use sources::recording::foxglove::SceneUpdate;

    let boundary = BoundaryLine {
        id: 7,
        side: "right".into(),
        points_m: vec![[4.0, 20.0], [5.0, 10.0]],
        height_m: vec![1.5, 1.0],
        sigma_m: vec![0.1, 0.05],
    };
    // The road falls: its horizon is 22 px (5 cm a metre) below the principal point.
    let road =
        RoadLine { camera_height_m: 1.2, horizon_px: RIG.cy_px + 0.05 * RIG.focal_px, confidence: 0.9 };
    let record = FrameRecord {
        road: Some(road),
        free_space_m: vec![vec![[-2.0, 30.0], [2.0, 30.0], [1.0, 5.0], [-1.0, 5.0]]],
        boundaries: vec![boundary],
        ..FrameRecord::default()
    };
    let message = encode::scene(Stamp { sequence: 1, time_ns: START_NS }, &record, &RIG);
    let update = SceneUpdate::decode(&message.data[..]).unwrap();
    let lines = |id: &str| &update.entities.iter().find(|entity| entity.id == id).unwrap().lines;
    let corner = lines("free space 0")[0].points[1];
    assert_eq!((corner.x, corner.z), (2.0, 30.0));
    assert!((corner.y - (1.2 + 0.05 * 30.0)).abs() < 1e-9, "on the road: {corner:?}");
    let [foot, top, posts] = &lines("boundary 7")[..] else { panic!("foot, top and posts") };
    assert_eq!((foot.points.len(), top.points.len(), posts.points.len()), (2, 2, 4));
    assert!((foot.points[1].y - top.points[1].y - 1.0).abs() < 1e-9, "as high as it is");
}
