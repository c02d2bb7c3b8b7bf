//! `lookout replay --video`.

use crate::support::{Bench, Need, lines, skip};
use std::process::Command;

/// Width and height of a GIF, from its head.
fn size(gif: &[u8]) -> (u16, u16) {
    assert!(gif.starts_with(b"GIF89a") && gif.ends_with(b";"), "a complete GIF");
    (u16::from_le_bytes([gif[6], gif[7]]), u16::from_le_bytes([gif[8], gif[9]]))
}

#[test]
fn a_replay_becomes_a_gif_without_another_program() {
    let bench = Bench::new();
    let recording = bench.record("drive", 5);
    for (mode, name) in [("--in-process", "one.gif"), ("--lockstep", "all.gif")] {
        let mut command = bench.command(&["replay", &recording, mode, "--video", name]);
        let output = command.env("PATH", "/no/such/folder").output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{mode}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(text.contains(&format!("video in {name}: 5 pictures, 0.5 s")), "{mode}: {text}");
        assert_eq!(size(&std::fs::read(bench.path(name)).expect("the video")), (320, 240));
    }
    // The overlays that it was made of are gone, and no other results were asked for.
    let left: Vec<_> = std::fs::read_dir(bench.folder.path()).expect("a folder").flatten().collect();
    assert_eq!(left.len(), 4, "recording, configuration and two videos: {left:?}");
    bench.assert_clean();
}

#[test]
fn a_video_beside_results_leaves_them_and_a_missing_encoder_is_reported_before_the_run() {
    let bench = Bench::new();
    let recording = bench.record("drive", 2);
    bench.ok(&["replay", &recording, "--in-process", "--out", "out", "--video", "run.gif"]);
    assert_eq!(lines(&bench.path("out")).len(), 2);
    assert!(bench.path("out/overlay/000001.png").is_file() && bench.path("run.gif").is_file());
    let mut command =
        bench.command(&["replay", &recording, "--in-process", "--out", "none", "--video", "run.mp4"]);
    let output = command.env("PATH", "/no/such/folder").output().expect("it runs");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && error.contains("apt install ffmpeg"), "{error}");
    assert!(!bench.path("none").exists() && !bench.path("run.mp4").exists(), "nothing ran");
    // The folder for the overlays is never one that was there.
    std::fs::create_dir(bench.path("run.frames")).expect("a folder");
    let error = bench.fails(&["replay", &recording, "--in-process", "--video", "run.gif"]);
    assert!(error.contains("run.frames: ") && bench.path("run.frames").is_dir(), "{error}");
}

/// Whether ffmpeg is here; otherwise the test is skipped.
fn has_ffmpeg() -> bool {
    let is_here = Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success());
    if !is_here {
        skip(Need::Ffmpeg, "ffmpeg is not on the PATH");
    }
    is_here
}

/// Runs ffmpeg in the folder of the bench.
fn ffmpeg(bench: &Bench, line: &str) {
    let mut command = Command::new("ffmpeg");
    command.args(["-v", "error", "-nostdin"]).args(line.split(' ')).current_dir(bench.folder.path());
    let output = command.output().expect("ffmpeg runs");
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn recorded_videos_give_the_results_of_their_pictures() {
    if !has_ffmpeg() {
        return;
    }
    let bench = Bench::new();
    bench.record("drive", 6);
    let pictures = "-framerate 10 -i drive/left/%06d.png -framerate 10 -i drive/right/%06d.png";
    let lossless = "-pix_fmt gray -c:v ffv1";
    ffmpeg(&bench, &format!("{pictures} -filter_complex hstack {lossless} both.mkv"));
    ffmpeg(&bench, &format!("{pictures} -map 0:v {lossless} left.mkv -map 1:v {lossless} right.mkv"));
    let run = |source: &[&str], out: &str| {
        let end = ["--lockstep", "--rig", "drive/rig.toml", "--out", out];
        let output = bench.run(&[&["replay"], source, &end].concat());
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{source:?}: {errors}");
        (lines(&bench.path(out)), errors)
    };
    let (expected, _) = run(&["drive"], "pictures");
    assert_eq!(expected.len(), 6);
    let (one, note) = run(&["both.mkv"], "one");
    assert!(note.contains("both.mkv: a video with both images side by side is expected"), "{note}");
    let (two, _) = run(&["--left", "left.mkv", "--right", "right.mkv"], "two");
    assert!(one == expected && two == expected, "the same pairs at the same times");
    // A video is read again from its start.
    let repeat = ["both.mkv", "--loop", "--limit", "9"];
    assert_eq!(run(&repeat, "again").0.len(), 9);
    // Without ffmpeg the remedy is told.
    let mut command = bench.command(&["replay", "both.mkv", "--in-process"]);
    let output = command.env("PATH", "/no/such/folder").output().expect("it runs");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    if cfg!(feature = "gstreamer") {
        // GStreamer reads it, or tells which of its plugins is missing.
        assert!(output.status.success() || error.contains("apt install gstreamer1.0-libav"), "{error}");
    } else {
        let parts = ["both.mkv: a video", "apt install ffmpeg", "ffmpeg -i both.mkv", "left/%06d.png"];
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
    std::fs::write(bench.path("broken.mp4"), "no video").unwrap();
    let error = bench.fails(&["replay", "broken.mp4"]);
    assert!(error.contains("broken.mp4: ffmpeg cannot read this video"), "{error}");
    let error = bench.fails(&["replay", "--left", "left.mkv", "--right", "both.mkv"]);
    assert!(error.contains("640x240") && error.contains("320x240"), "{error}");
    bench.assert_clean();
}

#[test]
fn ffmpeg_makes_an_mp4_of_every_frame() {
    if !has_ffmpeg() {
        return;
    }
    let bench = Bench::new();
    let recording = bench.record("drive", 5);
    let text = bench.ok(&["replay", &recording, "--in-process", "--video", "run.mp4"]);
    assert!(text.contains("video in run.mp4: 5 pictures, 0.5 s"), "{text}");
    let bytes = std::fs::read(bench.path("run.mp4")).expect("the video");
    assert_eq!(bytes.get(4..8), Some(&b"ftyp"[..]), "the head of an MP4");
}
