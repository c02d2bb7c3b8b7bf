//! The mistakes of a new user: each gets an exit code and a text that names what is wrong and what to do.
//!
//! A case is a command line, its exit code, and what standard error has to say. `cargo test --test quick mistakes -- --nocapture`
//! prints all texts.

mod calibrations;
mod configuration;
mod pictures;

use crate::support::{Bench, save_grey, send};
use image::{ImageBuffer, Luma};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// A command line, its exit code, and what its text has to contain.
type Case<'a> = (&'a str, i32, &'a [&'a str]);

/// What no text for a user may contain.
const NEVER: [&str; 5] = ["os error 20", "panicked", "unwrap", "RUST_BACKTRACE", "Err("];

/// Size of the pictures.
const SIZE: (u32, u32) = (320, 240);

/// Runs the cases in a folder. An argument with spaces stands between single quotes.
fn check(bench: &Bench, cases: &[Case<'_>]) {
    let mut wrong = Vec::new();
    for (line, code, parts) in cases {
        let mut arguments: Vec<String> = Vec::new();
        for (i, piece) in line.split('\'').enumerate() {
            if i % 2 == 1 {
                arguments.push(piece.to_owned());
            } else {
                arguments.extend(piece.split_whitespace().map(str::to_owned));
            }
        }
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_lookout"))
            .args(&arguments)
            .current_dir(bench.folder.path())
            .env_remove("RUST_BACKTRACE")
            .output()
            .expect("the binary runs");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        println!("$ lookout {line}\n[{:?}] {text}", output.status.code());
        let missing: Vec<_> = parts.iter().filter(|part| !text.contains(**part)).collect();
        let never: Vec<_> = NEVER.iter().filter(|part| text.contains(**part)).collect();
        if output.status.code() != Some(*code) || !missing.is_empty() || !never.is_empty() {
            wrong.push(format!(
                "lookout {line}: exit code {:?}, not {code}; without {missing:?}, with {never:?}:\n{text}",
                output.status.code()
            ));
        }
    }
    assert!(wrong.is_empty(), "{} of {} cases:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
}

fn write(bench: &Bench, name: &str, content: impl AsRef<[u8]>) {
    let path = bench.path(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("folders");
    std::fs::write(path, content).expect("the file is written");
}

/// A picture with texture.
fn picture(bench: &Bench, name: &str, (width, height): (u32, u32)) {
    let path = bench.path(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("folders");
    let pixels: Vec<u8> = (0..width * height).map(|i| ((i * 7919) >> 5) as u8).collect();
    save_grey(&path, &pixels, width, height);
}

/// A 16-bit picture with 12 bits.
fn deep_picture(bench: &Bench, name: &str) {
    let path = bench.path(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("folders");
    let of = |x: u32, y: u32| Luma([((x * 37 + y * 91) % 4096) as u16]);
    ImageBuffer::from_fn(SIZE.0, SIZE.1, of).save(path).expect("the image is written");
}

const RIG: &str = "focal_px = 440.0\nbaseline_m = 0.12\ncx_px = 160.0\ncy_px = 110.0\n";

#[test]
fn what_is_no_recording_is_named_with_the_remedy() {
    let bench = Bench::new();
    for (name, content) in [
        ("drive.bag", "#ROSBAG V2.0\n"),
        ("drive.db3", "SQLite format 3\0"),
        ("drive.mp4", ""),
        ("videos/left.mp4", ""),
        ("videos/right.mp4", ""),
        ("notes.txt", "hello"),
        ("drive.zip", "PK"),
        ("broken.mcap", "not an mcap file"),
        ("bag/bag_0.db3", "SQLite format 3\0"),
        ("bag/metadata.yaml", ""),
        ("bag2/bag_0.mcap", ""),
        ("text/left/a.txt", ""),
        ("text/right/a.txt", ""),
        ("day/drive/left/x.txt", ""),
        ("day/drive/right/x.txt", ""),
    ] {
        write(&bench, name, content);
    }
    std::fs::create_dir(bench.path("empty")).unwrap();
    for name in [
        "one/left/1.png",
        "flat/left_1.png",
        "mixed/a.png",
        "uneven/left/a.png",
        "uneven/left/b.png",
        "uneven/right/c.png",
    ] {
        picture(&bench, name, SIZE);
    }
    check(
        &bench,
        &[
            ("replay", 2, &["PATH", "--help"]),
            ("replay nowhere", 1, &["nowhere", "no such file or folder", "scene:NAME"]),
            ("replay nowhere.mcap", 1, &["nowhere.mcap", "No such file", "lookout record"]),
            ("replay drive.bag", 1, &["drive.bag", "ROS 1 bag", "mcap convert drive.bag"]),
            ("replay drive.db3", 1, &["drive.db3", "ROS 2 bag in SQLite", "mcap convert drive.db3"]),
            ("replay bag", 1, &["bag", "bag_0.db3", "ROS 2 bag in SQLite", "mcap convert"]),
            ("replay bag2", 1, &["bag2", "bag_0.mcap", "give that file"]),
            ("replay drive.mp4", 1, &["drive.mp4", "video", "ffmpeg"]),
            ("replay gone.mp4", 1, &["gone.mp4", "no such file", "give the path of a video"]),
            (
                "replay videos",
                1,
                &["a video of each camera", "--left videos/left.mp4", "--right videos/right.mp4"],
            ),
            (
                "replay --left drive.mp4 --right drive.mp4",
                1,
                &["drive.mp4", "left and right are the same file", "of each camera"],
            ),
            ("replay drive.zip", 1, &["drive.zip", "an archive", "unpack"]),
            ("replay notes.txt", 1, &["notes.txt", "no recording", "folder of pictures"]),
            ("replay broken.mcap", 1, &["broken.mcap", "no MCAP file", "lookout record"]),
            ("replay one/left/1.png", 1, &["1.png", "a single picture", "lookout disparity LEFT RIGHT"]),
            ("replay car.toml", 1, &["car.toml", "scene:car.toml", "-c"]),
            ("replay empty", 1, &["empty", "no stereo pairs", "it is empty", "left and right"]),
            ("replay text", 1, &["text/left", "no pictures here", "a.txt", "TIFF"]),
            ("replay day", 1, &["day", "its folder drive has pairs: give day/drive"]),
            ("replay one", 1, &["it has a folder left, but none named right"]),
            ("replay flat", 1, &["1 picture of the left camera, none of the right", "right_1.png"]),
            ("replay mixed", 1, &["a.png", "without left or right in their names", "--left and --right"]),
            (
                "replay uneven",
                1,
                &["no left picture has a partner", "a.png", "c.png", "--left, --right", "the same names"],
            ),
            ("replay one/left/* --left a", 2, &["--left"]),
            (
                "replay one/left/1.png flat/left_1.png",
                2,
                &["flat/left_1.png", "put it in quotes", "'cam0/*.png'"],
            ),
            ("replay --left one/left/1.png flat/left_1.png --right mixed", 2, &["put it in quotes"]),
            ("replay one car.toml", 2, &["car.toml", "-c car.toml"]),
            ("run car.toml", 2, &["car.toml", "a configuration is given with -c: -c car.toml"]),
            ("odometry one -o p.txt", 1, &["none named right", "lookout replay also takes"]),
            (
                "calibrate empty --board 9x6 --square-mm 25 -o r.toml",
                1,
                &["empty", "no images of a stereo pair", "left and right"],
            ),
            ("replay --left one/left/*.png", 2, &["--right"]),
            (
                "replay --left one/left/*.jpg --right mixed",
                1,
                &["one/left/*.jpg", "matches no picture", "quotes"],
            ),
            (
                "replay --left nowhere --right mixed",
                1,
                &["nowhere", "no such file or folder", "'cam0/*.png'"],
            ),
            ("replay --left 'a*b*c*' --right mixed", 1, &["a*b*c*", "use fewer"]),
            ("replay scene:stret", 1, &["stret", "street"]),
            ("replay 'scene:street?weather=foggy'", 1, &["foggy", "heavy_rain"]),
            ("replay scene:nowhere.toml", 1, &["nowhere.toml", "give a TOML file", "built-in scene"]),
        ],
    );
    bench.assert_clean();
}

#[test]
fn wrong_command_lines_name_the_argument() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let is_stream = cfg!(feature = "gstreamer");
    write(&bench, "there.mcap", "");
    check(
        &bench,
        &[
            ("", 2, &["Usage"]),
            ("replya drive", 2, &["unrecognized subcommand", "replay"]),
            ("replay drive --lokstep", 2, &["--lokstep", "--lockstep"]),
            ("replay drive --fps 0", 2, &["--fps", "0"]),
            ("replay drive --fps 10 --lockstep", 2, &["--fps", "--lockstep"]),
            ("replay drive --limit 0", 2, &["--limit", "give a whole number, at least 1"]),
            ("replay drive --limit ten", 2, &["--limit", "ten", "give a whole number"]),
            ("replay drive extra", 2, &["extra"]),
            ("replay drive --video drive.xyz", 1, &["drive.xyz", ".mp4"]),
            ("replay drive --record there.mcap --instance mistakes", 1, &["there.mcap", "is there already"]),
            (
                "replay drive --in-process --out drive/rig.toml",
                1,
                &["drive/rig.toml", "a file is where a folder is needed", "--out"],
            ),
            ("status --instance nobody", 1, &["no daemon named \"nobody\"", "lookout run", "--instance"]),
            (
                "calibrate --live --instance nobody --board 9x6 --square-mm 25 -o r.toml",
                1,
                &["nobody", "--live camera"],
            ),
            ("view --instance nobody --bind nowhere", 2, &["--bind", "nowhere", "127.0.0.1:8467"]),
            (
                "record -o x.mcap --instance nobody",
                1,
                &["no daemon named \"nobody\"", "lookout run", "--instance"],
            ),
            ("record", 2, &["--out"]),
            ("record -o x.mcap --topics pictures", 2, &["--topics", "images"]),
            ("record -o x.mcap --split-mb 0", 2, &["--split-mb", "from 1 to 1000000"]),
            ("compare drive nowhere", 1, &["drive/obstacles.jsonl", "lookout replay --out"]),
            ("scene nowhere", 1, &["nowhere", "street"]),
            ("odometry nowhere", 2, &["--out <POSES.txt>"]),
            ("odometry nowhere -o p.txt", 1, &["nowhere", "no such file or folder"]),
            ("evaluate stereo nowhere", 1, &["nowhere", "give a folder of the data set"]),
            ("evaluate drives drive", 2, &["drives", "drive"]),
            ("completions basj", 2, &["basj", "bash"]),
            ("init", 1, &["--left and --right", "--side-by-side", "--recording", "--help"]),
            ("init --left /dev/v --right /dev/v -o i.toml", 1, &["/dev/v are one device", "--side-by-side"]),
            ("init --recording gone -o gone.toml", 0, &["--recording", "there is no gone now"]),
            (
                "init --left a --right b --rig gone.toml.x -o c.toml",
                0,
                &["--rig", "there is no gone.toml.x now"],
            ),
            ("detect people drive/left/000000.png", 1, &["people", "a HOG model, no cascade", "vehicle"]),
            ("evaluate recognition people --negatives drive/left", 2, &["'--negatives'", "CASCADE"]),
            ("train --negatives drive/left -o c.xml", 2, &["not provided", "--positives"]),
            ("init --left /dev/video0 -o i.toml", 1, &["--right", "--side-by-side"]),
            ("init --left a --right b --board pi4", 2, &["pi4", "rpi5"]),
            ("init --left a --right b --size 640 -o i.toml", 2, &["--size", "width and height in pixels"]),
            ("init --left a --right b --size 9x9 -o i.toml", 1, &["i.toml", "camera.width = 9", "from 32"]),
            (
                "init --left a --right b -o drive/rig.toml",
                1,
                &["drive/rig.toml", "is there already", "--force"],
            ),
            ("replay drive --log loud", 2, &["loud", "debug"]),
        ],
    );
    if !is_stream {
        write(&bench, "camera.toml", "[source]\nkind = \"camera\"\n[camera]\nbackend = \"gstreamer\"\n");
        check(
            &bench,
            &[("run -c camera.toml", 1, &["gstreamer", "not in this build", "--features gstreamer"])],
        );
    }
    bench.assert_clean();
}

#[test]
fn a_repeated_recording_ends_with_a_signal_and_other_instances_are_named() {
    let bench = Bench::new();
    let recording = bench.record("drive", 2);
    let daemon = bench.start(&["replay", &recording, "--fps", "20", "--loop", "--log", "error"]);
    // More than once through the recording.
    bench.status_when(|status| status["frames"].as_u64() > Some(4));
    let error = bench.fails(&["status", "--instance", "nobody"]);
    let parts = ["no daemon named \"nobody\"", &format!("running: {}", bench.instance)[..], "--instance"];
    assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    daemon.signal("INT");
    let output = daemon.wait();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    bench.assert_clean();
}

#[test]
fn cameras_that_do_not_answer_are_told_first_and_leave_nothing() {
    let bench = Bench::new();
    let camera = "[source]\nkind = \"camera\"\n[camera]\nleft = \"/dev/video97\"\nright = \"/dev/video98\"\n";
    bench.configure(camera);
    let config = bench.path("car.toml").display().to_string();
    let args = ["calibrate", "--live", "camera", "-c", &config, "--board", "9x6", "--square-mm", "25"];
    let mut calibration = bench
        .command(&[&args[..], &["-o", "rig.toml"]].concat())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the binary runs");
    let mut said = BufReader::new(calibration.stderr.take().expect("a pipe"));
    let mut first = String::new();
    said.read_line(&mut first).expect("text");
    send(calibration.id(), "INT");
    let mut rest = String::new();
    said.read_to_string(&mut rest).expect("text");
    assert_eq!(calibration.wait().expect("it ends").code(), Some(1));
    if cfg!(feature = "v4l2") {
        assert!(
            first.contains("no pair yet from the cameras (/dev/video97, /dev/video98): /dev/video97"),
            "{first}"
        );
        assert!(rest.contains("ended before the first pair"), "{rest}");
    }
    assert!(!bench.path("rig.pictures").exists(), "no folder without pictures");

    let report = bench.run(&["doctor", "--json", "-c", &config]);
    let report: serde_json::Value = serde_json::from_slice(&report.stdout).expect("JSON");
    let findings = report["findings"].as_array().expect("findings");
    let of = |text: &str| findings.iter().find(|f| f["text"].as_str().is_some_and(|t| t.contains(text)));
    let camera = of("camera.left = \"/dev/video97\" is not there").expect("the camera is missed");
    assert_eq!(camera["level"], "problem");
    assert!(camera["remedy"].as_str().is_some_and(|remedy| !remedy.is_empty()), "{camera}");
    let areas = ["processor", "memory", "gpu", "heat", "clocks", "limits", "permissions", "time", "daemon"];
    for area in areas {
        assert!(findings.iter().any(|f| f["area"] == area), "{area} is missing: {report}");
    }
    // Whatever is not good says what to do.
    assert!(findings.iter().all(|f| f["level"] == "good" || f["remedy"].is_string()), "{report}");
}

/// The size of the table: each case is a mistake of its own.
#[test]
fn there_are_enough_cases() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests");
    let files =
        ["mistakes.rs", "mistakes/pictures.rs", "mistakes/calibrations.rs", "mistakes/configuration.rs"];
    let count = |name: &str| {
        let text = std::fs::read_to_string(folder.join(name)).expect("the file is there");
        // The exit code, in a case of one line and of several.
        let in_line =
            |line: &str| ["0", "1", "2"].iter().any(|code| line.contains(&format!("\", {code}, &[")));
        let alone = |line: &str| ["0,", "1,", "2,"].contains(&line.trim());
        text.lines().filter(|line| in_line(line) || alone(line)).count()
    };
    let cases: usize = files.into_iter().map(count).sum();
    println!("{cases} cases");
    assert!(cases >= 150, "{cases}");
}
