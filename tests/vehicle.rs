//! What the vehicle reports of its motion: files of a recording, recordings, and the check of the bus's signals.

use crate::support::{Bench, shared_data};
use sources::PairSource;
use sources::motion_file::{read_oxts, read_poses};
use sources::recording::RecordingSource;
use sources::vehicle::VehicleReading;
use std::path::Path;

/// What the vehicle reported at each pair of a recording.
fn readings(path: &Path) -> Vec<VehicleReading> {
    let mut source = RecordingSource::open(path).unwrap();
    let (width, height) = source.size();
    let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
    (0..source.count().unwrap())
        .map(|index| {
            source.read(index, &mut left, &mut right).unwrap();
            source.vehicle(index)
        })
        .collect()
}

fn near(value: Option<f64>, expected: f64) -> bool {
    value.is_some_and(|value| (value - expected).abs() < 1e-9)
}

#[test]
fn the_motion_of_a_folder_reaches_recordings_and_their_replay() {
    let bench = Bench::new();
    let folder = bench.record("drive", 4);
    // Times of a clock of their own: pair n was exposed at 100 + n / 8 s.
    let times: String = (0..4).map(|n| format!("{n:06}.png,{}\n", 100.0 + f64::from(n) / 8.0)).collect();
    std::fs::write(bench.path("drive/timestamps.csv"), format!("name,left_s\n{times}")).unwrap();
    // The last pair is 0.6 s from the last sample, which is then stale.
    let motion = "time_s,speed_m_s,yaw_rate_rad_s\n99.75,10,0.1\n99.76,11,0.2\n99.77,12,-0.3\n";
    std::fs::write(bench.path("drive/motion.csv"), motion).unwrap();
    bench.configure("[vehicle]\nstale_ms = 500\n");
    bench.ok(&["replay", &folder, "--lockstep", "--record", "run.mcap"]);
    let first = readings(&bench.path("run.mcap"));
    assert_eq!(first.len(), 4);
    for (n, reading) in first.iter().enumerate() {
        let age_s = 0.23 + n as f64 / 8.0;
        if age_s > 0.5 {
            assert!(reading.faults.stale && reading.sample.speed_m_s.is_none(), "{reading:?}");
            continue;
        }
        let speed = reading.sample.speed_m_s;
        assert!(
            near(speed.map(|v| v.value), 12.0) && near(speed.map(|v| v.age_s), age_s),
            "{n}: {reading:?}"
        );
        assert!(near(reading.sample.yaw_rate_rad_s.map(|v| v.value), -0.3));
    }
    // A replay has the same values, with their ages.
    bench.ok(&["replay", "run.mcap", "--lockstep", "--record", "again.mcap"]);
    assert_eq!(readings(&bench.path("again.mcap")), first);
    // Without them on request.
    bench.configure("[vehicle]\nmotion = \"none\"\n");
    for (source, out) in [(folder.as_str(), "a.mcap"), ("run.mcap", "b.mcap")] {
        bench.ok(&["replay", source, "--lockstep", "--record", out]);
        assert_eq!(readings(&bench.path(out)), [VehicleReading::default(); 4]);
    }
}

#[test]
fn ground_truth_is_input_only_on_request() {
    let bench = Bench::new();
    let folder = bench.record("drive", 3);
    // 1 m a frame, ten frames a second.
    let poses: String = (0..3).map(|n| format!("1 0 0 0 0 1 0 0 0 0 1 {n}\n")).collect();
    std::fs::write(bench.path("drive/poses.txt"), poses).unwrap();
    bench.ok(&["replay", &folder, "--lockstep", "--record", "unasked.mcap"]);
    assert_eq!(readings(&bench.path("unasked.mcap")), [VehicleReading::default(); 3]);
    bench.configure("[vehicle]\nmotion = \"poses.txt\"\n");
    bench.ok(&["replay", &folder, "--lockstep", "--record", "asked.mcap"]);
    for reading in readings(&bench.path("asked.mcap")) {
        assert!(near(reading.sample.speed_m_s.map(|v| v.value), 10.0), "{reading:?}");
    }
    bench.configure("[vehicle]\nmotion = \"lost.csv\"\n");
    let error = bench.fails(&["replay", &folder, "--lockstep"]);
    assert!(error.contains("drive/lost.csv: "), "{error}");
    std::fs::write(bench.path("drive/motion.csv"), "time_s,speed_m_s\n1,2\n").unwrap();
    bench.configure("");
    let error = bench.fails(&["replay", &folder, "--in-process", "--out", "out"]);
    assert!(error.contains("motion.csv: no column yaw_rate_rad_s"), "{error}");
}

#[test]
fn check_config_names_signal_file_and_line() {
    let bench = Bench::new();
    let dbc = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/can/car.dbc");
    let check = |keys: &str| bench.configure(&format!("[vehicle]\ndbc = \"{dbc}\"\n{keys}"));
    check(
        "speed_signal = \"Motion.Speed\"\nyaw_rate_signal = \"Motion.YawRate\"\ngear_signal = \"Levers.Gear\"\n",
    );
    bench.ok(&["check-config", "car.toml"]);
    check("speed_signal = \"Levers.Gear\"\n");
    let error = bench.fails(&["check-config", "car.toml"]);
    assert!(error.contains("vehicle.speed_signal = \"Levers.Gear\": its unit is \"\""), "{error}");
    check("yaw_rate_signal = \"Motion.Yaw\"\n");
    let error = bench.fails(&["check-config", "car.toml"]);
    assert!(error.contains("car.dbc: message Motion has no signal Yaw; it has Speed, YawRate"), "{error}");
    std::fs::write(bench.path("own.dbc"), "\n\nBO_ 1 M: 1 A\n SG_ S : 0|16@1+ (1,0) \"m/s\" A\n").unwrap();
    bench.configure("[vehicle]\ndbc = \"own.dbc\"\nspeed_signal = \"M.S\"\n");
    // The daemon says the same before it starts anything.
    for args in [&["check-config", "car.toml"][..], &["replay", "scene:street", "--lockstep"]] {
        let error = bench.fails(args);
        assert!(
            error.contains("own.dbc: line 4: signal S ends beyond the 1 bytes of its message"),
            "{error}"
        );
    }
}

#[test]
fn the_path_of_a_real_drive_is_that_of_the_peer() {
    let Some(drive) = shared_data("drive_residential") else { return };
    let path = read_oxts(&drive.join("oxts.csv"), &drive.join("timestamps.csv")).unwrap();
    // By numpy with the same projection: frame, right, forward, heading, speed, yaw rate.
    for (frame, expected) in [
        (1, [0.001_038_475_6, 0.652_053_689_5, -0.005_590_390_4, 6.366_543_375_4, -0.055_082_290_7]),
        (50, [-1.474_254_387, 39.601_803_044_8, 0.064_015_895_1, 8.495_314_547, 0.011_007_493_7]),
        (151, [-6.807_252_484_8, 129.577_426_358_7, 0.058_047_688, 8.919_468_732_5, 0.014_935_668_6]),
    ] {
        let [x, y, z] = path.poses[frame].translation_m;
        let found = [x, z, path.poses[frame].yaw_rad(), path.speed_m_s[frame], path.yaw_rate_rad_s[frame]];
        assert!(
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6) && y == 0.0,
            "{frame}: {found:?}"
        );
    }
    let Some(sequence) = shared_data("kitti_sequence_1") else { return };
    let poses = read_poses(&sequence.join("poses.txt")).unwrap();
    // The file has seven digits.
    let [x, y, z] = poses.poses[1].translation_m;
    let apart = [x + 0.014_017_51, y + 0.028_203_21, z - 1.198_998];
    assert!(poses.poses.len() == 51 && apart.iter().all(|v| v.abs() < 1e-6), "{:?}", poses.poses[1]);
}
