use super::gif::MAX_PICTURES;
use super::*;
use crate::reporting::output::{FrameWriter, prepare};
use crate::reporting::overlay::OverlayInput;
use crate::reporting::record::FrameRecord;
use perception::rig::Rig;
use std::ffi::{OsStr, OsString};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// A results folder with frames at these times.
fn results(folder: &Path, times_s: &[f64], (width, height): (usize, usize)) -> PathBuf {
    let out = folder.join("results");
    prepare(&out).unwrap();
    let mut writer = FrameWriter::open(&out).unwrap();
    for (sequence, &time_s) in times_s.iter().enumerate() {
        let left: Vec<u8> = (0..width * height).map(|i| (i + 7 * sequence) as u8).collect();
        let (disparity, profile) = (vec![0; width * height], vec![0.0; height]);
        let images = OverlayInput {
            left: &left,
            disparity: &disparity,
            profile_px: &profile,
            edges: Default::default(),
            width,
            height,
            rig: Rig { focal_px: 30.0, baseline_m: 0.2, cx_px: 15.0, cy_px: 10.0 },
        };
        let record = FrameRecord { sequence: sequence as u64, time_s, ..FrameRecord::default() };
        writer.write(&record, Some(images)).unwrap();
    }
    out
}

/// A folder with a program, as the value of PATH.
fn program(folder: &Path, name: &str, script: &str) -> OsString {
    let bin = folder.join("bin");
    std::fs::create_dir_all(&bin).unwrap();
    std::fs::write(bin.join(name), format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(bin.join(name), std::fs::Permissions::from_mode(0o755)).unwrap();
    bin.into_os_string()
}

#[test]
fn a_gif_has_the_pictures_and_times_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    // 20 a second, then a gap of 0.4 s.
    let mut times: Vec<f64> = (0..21).map(|i| f64::from(i) * 0.05).collect();
    times.extend([1.4, 1.5]);
    let out = results(folder.path(), &times, (60, 40));
    let path = folder.path().join("run.gif");
    let mut last = 0;
    let video = Plan::new(&path, OsStr::new("")).unwrap().write(&out, &mut |n| last = n).unwrap();
    assert_eq!((video.pictures, video.left_out), (13, 0));
    assert!((video.seconds - 1.55).abs() < 0.011 && last > 20, "{video:?}, {last}");
    let decoder = ::gif::Decoder::new(std::fs::File::open(&path).unwrap()).unwrap();
    assert_eq!((decoder.width(), decoder.height()), (60, 40));
    assert_eq!(decoder.into_iter().map(Result::unwrap).count(), 13);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no incomplete file is left");
}

#[test]
fn wide_pictures_are_reduced_and_long_runs_cut() {
    let folder = tempfile::tempdir().unwrap();
    let times: Vec<f64> = (0..MAX_PICTURES + 5).map(|i| i as f64 * 0.1).collect();
    let out = results(folder.path(), &times, (2, 2));
    let path = folder.path().join("long.GIF");
    let video = Plan::new(&path, OsStr::new("")).unwrap().write(&out, &mut |_| ()).unwrap();
    assert_eq!((video.pictures, video.left_out), (MAX_PICTURES, 5));
    let out = results(folder.path(), &[0.0], (1242, 4));
    Plan::new(&path, OsStr::new("")).unwrap().write(&out, &mut |_| ()).unwrap();
    let decoder = ::gif::Decoder::new(std::fs::File::open(&path).unwrap()).unwrap();
    assert_eq!((decoder.width(), decoder.height()), (621, 2));
}

#[test]
fn an_encoder_gets_every_picture_as_often_as_its_time_requires() {
    let folder = tempfile::tempdir().unwrap();
    let search = program(
        folder.path(),
        "ffmpeg",
        "echo \"$@\" > \"$0.args\"; for f; do :; done; exec cat > \"${f#file:}\"",
    );
    let mut search = search;
    search.push(":/bin:/usr/bin");
    // One frame is missing between the last two.
    let out = results(folder.path(), &[0.0, 0.1, 0.2, 0.4], (5, 4));
    let path = folder.path().join("run.mp4");
    let video = Plan::new(&path, &search).unwrap().write(&out, &mut |_| ()).unwrap();
    assert_eq!((video.pictures, (video.seconds * 10.0).round()), (5, 5.0));
    // Even sizes only.
    assert_eq!(std::fs::read(&path).unwrap().len(), 5 * 4 * 4 * 3);
    let args = std::fs::read_to_string(folder.path().join("bin/ffmpeg.args")).unwrap();
    for part in ["rgb24", "-video_size 4x4 ", "-framerate 1000000/100000 ", "yuv420p file:/"] {
        assert!(args.contains(part), "{part}: {args}");
    }
}

#[test]
fn a_result_without_an_overlay_is_bridged() {
    let folder = tempfile::tempdir().unwrap();
    let out = results(folder.path(), &[0.0, 0.1, 0.2, 0.3, 0.4], (4, 4));
    std::fs::remove_file(out.join("overlay/000001.png")).unwrap();
    let path = folder.path().join("run.gif");
    let video = Plan::new(&path, OsStr::new("")).unwrap().write(&out, &mut |_| ()).unwrap();
    assert_eq!((video.pictures, (video.seconds * 10.0).round()), (4, 5.0));
}

#[test]
fn gstreamer_is_used_where_there_is_no_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let script = "for f; do :; done; exec cat > \"${f#location=}\"";
    // Nothing else is on the PATH: a machine may have an ffmpeg.
    let search = program(folder.path(), "gst-launch-1.0", script);
    // It has one encoder only.
    program(folder.path(), "gst-inspect-1.0", "case $2 in x264enc) exit 1;; esac");
    let out = results(folder.path(), &[0.0, 0.1], (6, 4));
    let path = folder.path().join("run.mkv");
    let plan = Plan::new(&path, &search).unwrap();
    assert!(format!("{plan:?}").contains("openh264enc"), "{plan:?}");
    plan.write(&out, &mut |_| ()).unwrap();
    // Four bytes a pixel: a row of 6 pixels of three bytes would be padded.
    assert_eq!(std::fs::read(&path).unwrap().len(), 2 * 6 * 4 * 4);
    program(folder.path(), "gst-inspect-1.0", "case $2 in *enc) exit 1;; esac");
    let error = Plan::new(&path, &search).unwrap_err().to_string();
    assert!(error.contains("GStreamer has none of x264enc, openh264enc"), "{error}");
}

#[test]
fn errors_name_the_remedy_and_leave_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mp4");
    let error = Plan::new(&path, OsStr::new("/no/such/folder")).unwrap_err().to_string();
    assert!(error.contains("neither ffmpeg nor GStreamer") && error.contains("ends in .gif"), "{error}");
    let error = Plan::new(Path::new("run.avi"), OsStr::new("")).unwrap_err().to_string();
    assert!(error.contains("run.avi: give a file that ends in .gif"), "{error}");
    let mut search = program(folder.path(), "ffmpeg", "echo no encoder >&2; echo here >&2; exit 3");
    search.push(":/bin");
    let out = results(folder.path(), &[0.0, 0.1], (400, 400));
    let error = Plan::new(&path, &search).unwrap().write(&out, &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("ffmpeg: no encoder; here: the video was not written"), "{error}");
    std::fs::write(out.join("overlay/000001.png"), b"damaged").unwrap();
    let gif = Plan::new(&folder.path().join("run.gif"), OsStr::new("")).unwrap();
    let error = gif.write(&out, &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("overlay/000001.png"), "{error}");
    assert!(error.ends_with(": run the replay again") && !error.contains("replace"), "{error}");
    std::fs::write(out.join("obstacles.jsonl"), b"").unwrap();
    assert!(matches!(gif.write(&out, &mut |_| ()), Err(VideoError::Empty(_))));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "bin and results");
}
