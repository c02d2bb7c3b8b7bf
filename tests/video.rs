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

#[test]
fn ffmpeg_makes_an_mp4_of_every_frame() {
    if !Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success()) {
        skip(Need::Ffmpeg, "ffmpeg is not on the PATH");
        return;
    }
    let bench = Bench::new();
    let recording = bench.record("drive", 5);
    let text = bench.ok(&["replay", &recording, "--in-process", "--video", "run.mp4"]);
    assert!(text.contains("video in run.mp4: 5 pictures, 0.5 s"), "{text}");
    let bytes = std::fs::read(bench.path("run.mp4")).expect("the video");
    assert_eq!(bytes.get(4..8), Some(&b"ftyp"[..]), "the head of an MP4");
}
