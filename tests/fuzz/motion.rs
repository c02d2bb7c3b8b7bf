//! Files of the vehicle's motion, DBC files and signals.

use super::harness::{Format, fuzz_format, written};
use super::{structure, text};
use fastrand::Rng;
use sources::motion_file::{MotionTable, read_oxts, read_poses, read_timestamps};
use sources::vehicle::{BusSettings, Dbc, Decoder, Frame};
use std::fmt::Write;

/// A table of motion: `motion.csv` or OXTS.
fn some_table(random: &mut Rng) -> Vec<u8> {
    let head =
        ["time_s,speed_m_s,yaw_rate_rad_s", "time_s,lat_deg,lon_deg,yaw_rad,vf_m_s,wu"][random.usize(0..2)];
    let mut out = format!("{head}\n");
    let mut time_s = 1.0;
    for _ in 0..random.usize(1..12) {
        time_s += 0.1 * random.f64();
        let _ = write!(out, "{time_s:.3}");
        for _ in 0..head.matches(',').count() {
            let _ = write!(out, ",{:.3}", 10.0 * random.f64());
        }
        out.push('\n');
    }
    out.into_bytes()
}

#[test]
fn tables() {
    let mut generate = some_table;
    let format =
        Format { name: "motion::tables", longest: 8192, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, path| {
        let file = written(path, "csv", input);
        let table = MotionTable::read(&file, &[0.0, 0.1]).map_err(|e| e.to_string())?;
        let found = [0.9, 1.3, 5.0].map(|time_s| table.at(time_s, 0.5));
        for reading in &found {
            assert!(reading.sample.speed_m_s.is_none_or(|v| v.value.abs() <= 120.0 && v.age_s.abs() <= 0.5));
        }
        // The same file as a path, at the times of two frames.
        let times = path.with_extension("times");
        std::fs::write(&times, "name,left_s\na,1.1\nb,1.2\n").map_err(|e| e.to_string())?;
        let path = read_oxts(&file, &times).map_err(|e| e.to_string());
        if let Ok(path) = &path {
            assert!(path.poses.iter().flat_map(|p| p.translation_m).all(f64::is_finite));
        }
        Ok(format!("ok {:?} {}", found.map(|r| r.faults), path.is_ok()))
    });
}

#[test]
fn poses_and_times() {
    let mut generate = |random: &mut Rng| {
        let mut out = String::new();
        for i in 0..random.usize(1..6) {
            let _ = match random.bool() {
                true => writeln!(out, "1 0 0 {:.2} 0 1 0 0 0 0 1 {i}", random.f64()),
                false => writeln!(out, "0 0 -1 {:.2} 0 1 0 0 1 0 0 {i}", random.f64()),
            };
        }
        out.into_bytes()
    };
    let name = "motion::poses_and_times";
    let format = Format { name, longest: 8192, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, path| {
        let file = written(path, "txt", input);
        // The same bytes as times of frames.
        let _ = read_timestamps(&file).map(|times| times.of(["a", "b"].into_iter()));
        let poses = read_poses(&file).map_err(|e| e.to_string())?;
        let differences = poses.differences(&[0.0, 0.1, 0.2, 0.2, 0.5]);
        assert!(differences.iter().flatten().all(|v| v.is_finite()));
        Ok(format!("ok {}", differences.len()))
    });
}

/// A DBC file with some messages.
fn some_dbc(random: &mut Rng) -> Vec<u8> {
    let mut out = String::from("VERSION \"\"\n\nBU_: A B\n\n");
    for message in 0..random.usize(1..4) {
        let id = random.u32(0..0x900) | if random.bool() { 1 << 31 } else { 0 };
        let _ = writeln!(out, "BO_ {id} M{message}: {} A", random.u8(6..9));
        for signal in 0..random.usize(1..4) {
            let (start, length) = (random.usize(0..24), random.usize(1..17));
            let (order, sign) = (random.u8(0..2), ['+', '-'][random.usize(0..2)]);
            let unit = ["km/h", "m/s", "mph", "m/s"][random.usize(0..4)];
            let _ = writeln!(
                out,
                " SG_ S{signal} : {start}|{length}@{order}{sign} (0.{:02},{}) [0|{}] \"{unit}\" B",
                random.u8(1..99),
                random.i8(..),
                random.u8(..)
            );
        }
    }
    let _ = writeln!(out, "CM_ SG_ 1 S0 \"a comment\n of two lines\";");
    out.into_bytes()
}

#[test]
fn dbc_file() {
    let mut generate = some_dbc;
    let format =
        Format { name: "motion::dbc_file", longest: 8192, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, path| {
        let file = written(path, "dbc", input);
        let dbc = Dbc::read(&file).map_err(|e| e.to_string())?;
        let _ = dbc.signal("M1.S1");
        let settings = BusSettings {
            dbc: file,
            speed_signal: "M0.S0".into(),
            brake_signal: "M0.S0=1,2".into(),
            ..BusSettings::default()
        };
        let decoder = Decoder::new(&settings).map_err(|e| e.to_string())?;
        let mut state = decoder.state();
        let mut refused = 0;
        for id in decoder.ids() {
            for data in [&[0xff; 8][..], &[0; 64], &[1, 2, 3]] {
                refused += u32::from(
                    decoder.decode(&Frame::new(id.number, id.is_extended, data), 5, &mut state).is_some(),
                );
            }
        }
        let reading = state.reading(6, 10);
        assert!(reading.sample.speed_m_s.is_none_or(|v| v.value.abs() <= 120.0));
        Ok(format!("ok {refused} refused, {:?}", reading.faults))
    });
}

/// A signal in DBC's notation.
#[test]
fn signal() {
    let mut generate = |random: &mut Rng| {
        let (start, length) = (random.usize(0..500), random.usize(1..65));
        let text = format!(
            "{:#x}:{start}|{length}@{}{} ({},{}) [{}|{}] km/h",
            random.u32(0..0x2000_0000),
            random.u8(0..2),
            ['+', '-'][random.usize(0..2)],
            0.01 + random.f64(),
            random.i8(..),
            random.i8(..),
            random.i16(..)
        );
        text.into_bytes()
    };
    let format =
        Format { name: "motion::signal", longest: 512, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, _| {
        let signal = sources::vehicle::Signal::parse(&text(input))?;
        let bytes = signal.bytes().expect("it fits a frame");
        assert!(signal.decode(&vec![0xa5; bytes]).is_some() && signal.decode(&vec![0; bytes - 1]).is_none());
        Ok(format!("ok {:?} {}", signal.order, signal.is_signed))
    });
}
