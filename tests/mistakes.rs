//! The mistakes of a new user: each gets an exit code and a text that names what is wrong and what to do.
//!
//! A case is a command line, its exit code, and what standard error has to say. `cargo test --test quick mistakes -- --nocapture`
//! prints all texts.

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
            ("replay uneven", 1, &["no left picture has a partner", "a.png", "c.png", "--left, --right"]),
            ("replay one/left/* --left a", 2, &["--left"]),
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
            ("replay scene:nowhere.toml", 1, &["nowhere.toml"]),
        ],
    );
    bench.assert_clean();
}

#[test]
fn damaged_pictures_cost_their_pair_and_are_told() {
    let bench = Bench::new();
    bench.record("drive", 3);
    let half = |name: &str| {
        let bytes = std::fs::read(bench.path(name)).unwrap();
        std::fs::write(bench.path(name), &bytes[..bytes.len() / 2]).unwrap();
    };
    half("drive/right/000001.png");
    bench.record("gap", 3);
    std::fs::remove_file(bench.path("gap/right/000002.png")).unwrap();
    write(&bench, "gap/left/000000.png", "no picture");
    bench.record("sizes", 2);
    picture(&bench, "sizes/right/000001.png", (10, 10));
    for i in 0..2 {
        for side in ["left", "right"] {
            deep_picture(&bench, &format!("deep/{side}/{i}.png"));
            write(&bench, &format!("none/{side}/{i}.png"), "no picture");
            picture(&bench, &format!("tiny/{side}/{i}.png"), (4, 4));
        }
    }
    write(&bench, "deep/rig.toml", RIG);
    write(&bench, "none/rig.toml", RIG);
    write(&bench, "tiny/rig.toml", RIG);
    check(
        &bench,
        &[
            (
                "replay drive --in-process",
                0,
                &["pair left out", "right/000001.png", "cannot be decoded", "replace or remove it"],
            ),
            (
                "replay drive --in-process --strict",
                1,
                &["right/000001.png", "cannot be decoded", "replace or remove it"],
            ),
            ("replay gap --in-process", 0, &["2 of 3 pairs cannot be read", "left/000000.png", "--strict"]),
            ("replay gap --in-process --strict", 1, &["left/000000.png", "cannot be decoded"]),
            ("replay none --in-process", 1, &["none/left/0.png", "cannot be decoded"]),
            ("replay sizes --in-process", 1, &["sizes/right/000001.png", "10x10", "320x240", "one size"]),
            ("replay tiny --in-process", 1, &["4x4", "8x8"]),
            (
                "replay deep --in-process --limit 1",
                0,
                &["16-bit pictures are scaled from 12 bits", "source.bits"],
            ),
            ("replay drive --in-process --loop", 1, &["--loop", "--limit", "Ctrl-C"]),
            ("odometry drive -o poses.txt", 0, &["pair left out", "right/000001.png", "cannot be decoded"]),
            ("odometry drive -o poses.txt --strict", 1, &["right/000001.png", "cannot be decoded"]),
            ("odometry none -o poses.txt", 1, &["none/left/0.png", "cannot be decoded"]),
            (
                "evaluate drive drive",
                0,
                &["right/000001.png", "drive: 1 pair left out, because it cannot be read", "--strict"],
            ),
            ("evaluate drive drive --strict", 1, &["right/000001.png", "cannot be decoded"]),
            ("evaluate drive none", 1, &["none/left/0.png", "cannot be decoded"]),
            ("disparity drive/left/000000.png gone.png -o d.png", 1, &["gone.png", "No such file"]),
            (
                "disparity drive/left/000000.png tiny/left/0.png -o d.png",
                1,
                &["320x240", "4x4", "both images of a rectified pair"],
            ),
            (
                "disparity drive/left/000000.png drive/right/000000.png -o d.jpg",
                1,
                &["d.jpg", "16 bits", ".png"],
            ),
            ("disparity drive/left/000000.png drive/right/000000.png -o d.tif", 1, &["d.tif", "PNG"]),
            (
                "disparity drive/left/000000.png drive/right/000000.png -o no/such/d.png",
                1,
                &["no/such/d.png", "cannot be written"],
            ),
            ("disparity drive drive -o d.png", 1, &["drive", "not a regular file", "image file"]),
            ("disparity drive/left/000000.png", 2, &["<RIGHT>", "--out"]),
            ("obstacles drive/left/000000.png drive/right/000000.png", 1, &["--rig", "focal_px"]),
            (
                "obstacles drive/left/000000.png drive/right/000000.png --rig drive/rig.toml --overlay o.gif",
                1,
                &["o.gif", "PNG or JPEG"],
            ),
            ("detect vehicle none/left/0.png", 1, &["none/left/0.png", "cannot be decoded"]),
            (
                "detect vehicel drive/left/000000.png",
                1,
                &["vehicel", "OpenCV cascade XML", "vehicle for the one that ships"],
            ),
            (
                "detect drive/rig.toml drive/left/000000.png",
                1,
                &["drive/rig.toml", "give an OpenCV cascade XML"],
            ),
        ],
    );
    let args = [
        "obstacles",
        "drive/left/000000.png",
        "drive/right/000000.png",
        "--rig",
        "drive/rig.toml",
        "--overlay",
        "o.jpg",
    ];
    bench.ok(&args);
    assert!(std::fs::read(bench.path("o.jpg")).unwrap().starts_with(&[0xff, 0xd8]), "a JPEG");
    // A line for each frame, so that numbers stay those of the recording.
    let told = bench.ok(&["odometry", "drive", "-o", "poses.txt"]);
    assert!(told.contains("3 poses") && told.contains("1 pair left out"), "{told}");
    assert_eq!(std::fs::read_to_string(bench.path("poses.txt")).unwrap().lines().count(), 3);
    let summary = bench.ok(&["replay", "drive", "--lockstep", "--out", "out"]);
    assert!(summary.contains("1 pairs left out, because they cannot be read"), "{summary}");
    assert_eq!(crate::support::lines(&bench.path("out")).len(), 2);
    bench.assert_clean();
}

#[test]
fn calibrations_that_do_not_fit_are_told() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let kitti = "P0: 440 0 160 0 0 440 110 0 0 0 1 0\nP1: 440 0 160 -52.8 0 440 110 0 0 0 1 0\n";
    for (name, content) in [
        ("mm.toml", RIG.replace("0.12", "120.0")),
        ("short.toml", RIG.replace("cy_px = 110.0\n", "")),
        ("typo.toml", RIG.replace("focal_px", "focal")),
        ("text.toml", "hello".to_owned()),
        ("calib.txt", kitti.to_owned()),
        ("swapped.txt", kitti.replace("-52.8", "52.8")),
        ("nine.txt", kitti.replace(" 0 0 0 1 0\nP1", "\nP1")),
        ("no.txt", "nothing here\n".to_owned()),
        ("rig.yaml", "nothing: 1\n".to_owned()),
    ] {
        write(&bench, name, content);
    }
    bench.record("bare", 1);
    std::fs::remove_file(bench.path("bare/rig.toml")).unwrap();
    let camera = perception::calibration::Camera {
        distortion: [-0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ..perception::calibration::Camera::pinhole(440.0, 440.0, 160.0, 110.0)
    };
    let between = perception::calibration::Pose {
        rotation: nalgebra::Rotation3::identity(),
        translation_m: nalgebra::Vector3::new(-0.12, 0.0, 0.0),
    };
    for (name, size) in [("other.toml", (640, 480)), ("lens.toml", (320, 240))] {
        let (cx_px, cy_px) = (size.0 as f64 / 2.0, size.1 as f64 / 2.0);
        let camera = perception::calibration::Camera { cx_px, cy_px, ..camera };
        let crop = perception::calibration::Crop::Valid;
        let rig = sources::rig_file::RigFile::from_cameras([camera; 2], between, size, crop).unwrap();
        rig.write(&bench.path(name)).unwrap();
    }
    let text = std::fs::read_to_string(bench.path("lens.toml")).unwrap();
    write(&bench, "edited.toml", text.replace("fx_px = 440.0", "fx_px = 441.0"));
    check(
        &bench,
        &[
            ("replay bare --in-process", 1, &["bare", "no calibration", "rig.toml", "--rig"]),
            ("replay drive --in-process --rig gone.toml", 1, &["--rig", "gone.toml", "No such file"]),
            ("replay drive --in-process --rig mm.toml", 1, &["mm.toml", "baseline", "metres"]),
            ("replay drive --in-process --rig short.toml", 1, &["short.toml", "cy_px"]),
            ("replay drive --in-process --rig typo.toml", 1, &["typo.toml", "focal", "focal_px"]),
            ("replay drive --in-process --rig text.toml", 1, &["text.toml"]),
            ("replay drive --in-process --rig swapped.txt", 1, &["swapped.txt", "swapped"]),
            ("replay drive --in-process --rig nine.txt", 1, &["nine.txt", "line 1", "not 12"]),
            ("replay drive --in-process --rig no.txt", 1, &["no.txt", "P0", "calib.txt"]),
            ("replay drive --in-process --rig rig.yaml", 1, &["rig.yaml", "Kalibr", "OpenCV"]),
            (
                "replay drive --in-process --rig other.toml",
                1,
                &["other.toml", "640x480", "320x240", "calibrate at that size"],
            ),
            ("replay drive --in-process --rig edited.toml", 1, &["edited.toml", "checksum"]),
            ("replay drive --in-process --rig drive", 1, &["drive"]),
            ("replay bare --in-process --rig lens.toml", 0, &[]),
            (
                "replay drive --in-process --set source.rectify=true",
                1,
                &["source.rectify is true", "drive/rig.toml", "\"auto\""],
            ),
            ("rectify calib.txt drive/left/000000.png drive/right/000000.png -o r", 1, &["calib.txt"]),
            ("rig gone.toml", 1, &["gone.toml"]),
            ("rig calib.txt", 1, &["calib.txt", "image size"]),
            ("calibrate empty --board 9x6 --square-mm 25 -o r.toml", 1, &["empty"]),
            ("calibrate drive --board 9 --square-mm 25 -o r.toml", 2, &["--board"]),
            ("calibrate drive --board 9x6 -o r.toml", 2, &["--square-mm"]),
            ("calibrate drive --board 9x6 --square-mm 0.024 -o r.toml", 2, &["--square-mm", "mm"]),
            ("calibrate drive --board 9x6 --square-mm 25 -o r.toml", 1, &["board"]),
        ],
    );
    bench.assert_clean();
}

#[test]
fn mistakes_in_a_configuration_have_file_line_and_remedy() {
    let bench = Bench::new();
    bench.record("drive", 1);
    for (name, content) in [
        ("key.toml", "[alarm]\ndistence_m = 10\n"),
        ("table.toml", "\n[alarms]\n"),
        ("other_table.toml", "[steroe]\ndisparities = 64\n"),
        ("range.toml", "[alarm]\ndistance_m = 10000\n"),
        ("type.toml", "[alarm]\ndistance_m = \"10 m\"\n"),
        ("choice.toml", "[source]\nkind = \"camara\"\n"),
        ("syntax.toml", "[alarm\n"),
        ("twice.toml", "[alarm]\nhold_ms = 1\nhold_ms = 2\n"),
        ("profile.toml", "profile = \"pi\"\n"),
        ("no_path.toml", "[source]\nkind = \"folder\"\n"),
        ("path.toml", "[source]\nkind = \"folder\"\npath = \"gone\"\n"),
        ("rig.toml", "[source]\nrig = \"gone.toml\"\n"),
        ("cascade.toml", "\n[recognition]\ncascade = \"gone.xml\"\n"),
        ("motion.toml", "\n[vehicle]\nmotion = \"gone.csv\"\n"),
        ("dbc.toml", "[vehicle]\nbus = \"can0\"\n\ndbc = \"gone.dbc\"\n"),
        (
            "patterns.toml",
            "[source]\nkind = \"folder\"\nleft = \"drive/left/*.png\"\nright = \"gone/*.png\"\n",
        ),
        ("scene.toml", "[source]\npath = \"gone.toml\"\n"),
        (
            "two.toml",
            "[source]\nkind = \"folder\"\npath = \"gone\"\nrig = \"gone.toml\"\n[vehicle]\nmotion = \"gone.csv\"\n",
        ),
        (
            "camera.toml",
            "[source]\nkind = \"camera\"\n[camera]\nleft = \"/dev/video97\"\nright = \"/dev/video98\"\n",
        ),
        ("one.toml", "[source]\nkind = \"folder\"\nleft = \"drive/left\"\n"),
        ("bayer.toml", "[source]\nbayer = \"rgbg\"\n"),
        ("crossed.toml", "[road]\ncamera_height_min_m = 3\ncamera_height_max_m = 2\n"),
    ] {
        write(&bench, name, content);
    }
    check(
        &bench,
        &[
            ("check-config", 2, &["<FILE>"]),
            ("check-config gone.toml", 1, &["gone.toml", "profiles", "rpi5"]),
            ("check-config key.toml", 1, &["key.toml:2", "alarm.distence_m", "did you mean distance_m?"]),
            ("check-config table.toml", 1, &["table.toml:2", "[alarms]", "did you mean alarm?"]),
            ("check-config other_table.toml", 1, &["other_table.toml:1", "did you mean stereo?"]),
            ("check-config range.toml", 1, &["range.toml:2", "alarm.distance_m = 10000", "from 0.5 to 200"]),
            ("check-config type.toml", 1, &["type.toml:2", "give a number"]),
            ("check-config choice.toml", 1, &["choice.toml:2", "source.kind", "\"camera\""]),
            ("check-config syntax.toml", 1, &["syntax.toml:1"]),
            ("check-config twice.toml", 1, &["twice.toml:3", "duplicate"]),
            ("check-config profile.toml", 1, &["profile.toml:1", "rpi5"]),
            ("check-config rig.toml", 1, &["rig.toml:2: source.rig", "gone.toml"]),
            ("check-config cascade.toml", 1, &["cascade.toml:3: recognition.cascade", "gone.xml", "vehicle"]),
            ("check-config path.toml", 1, &["path.toml:3: source.path", "gone", "no such file or folder"]),
            ("check-config motion.toml", 1, &["motion.toml:3: vehicle.motion", "gone.csv", "no such file"]),
            ("check-config dbc.toml", 1, &["dbc.toml:4: vehicle.dbc", "gone.dbc"]),
            (
                "check-config patterns.toml",
                1,
                &["patterns.toml:4: source.right", "gone/*.png", "matches no picture"],
            ),
            ("check-config scene.toml", 1, &["scene.toml:2: source.path", "gone.toml"]),
            (
                "check-config two.toml",
                1,
                &["two.toml:3: source.path", "two.toml:4: source.rig", "two.toml:6: vehicle.motion"],
            ),
            (
                "check-config camera.toml",
                0,
                &[
                    "camera.toml:4: camera.left",
                    "/dev/video97",
                    "camera.toml:5: camera.right",
                    "on this machine",
                ],
            ),
            ("doctor -c camera.toml", 1, &["problems", "say what to do"]),
            ("doctor -c gone.toml", 1, &["gone.toml", "profiles"]),
            ("doctor --jsn", 2, &["--jsn", "--json"]),
            ("run -c camera.toml", 1, &["source.rig is empty", "lookout calibrate --live camera"]),
            ("check-config bayer.toml", 1, &["bayer.toml:2", "source.bayer", "\"rggb\""]),
            ("check-config crossed.toml", 1, &["crossed.toml:2", "road.camera_height_min_m", "at most 2"]),
            ("run -c no_path.toml", 1, &["source.path is empty"]),
            ("run -c one.toml", 1, &["source.left and source.right", "--right"]),
            ("replay drive -c gone.toml", 1, &["gone.toml"]),
            (
                "replay drive --set alarm.distance=10",
                1,
                &["--set: unknown key alarm.distance", "did you mean distance_m?"],
            ),
            (
                "replay drive --set alrm.distance_m=10",
                1,
                &["--set: unknown table [alrm]", "did you mean alarm?"],
            ),
            ("replay drive --set stereo.threads=0", 1, &["--set: stereo.threads = 0", "from 1 to 64"]),
            ("replay drive --set distance_m=10", 1, &["--set distance_m=10", "TABLE.KEY=VALUE"]),
            ("replay drive --set", 2, &["--set"]),
            ("replay drive --instance 'a b'", 1, &["--instance: instance.name", "letters, digits"]),
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
            ("replay drive --record there.mcap", 1, &["there.mcap", "is there already"]),
            (
                "replay drive --in-process --out drive/rig.toml",
                1,
                &["drive/rig.toml", "a file is where a folder is needed", "--out"],
            ),
            ("status --instance nobody", 1, &["no daemon named \"nobody\"", "lookout run", "--instance"]),
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
            ("init", 2, &["--left", "--help"]),
            ("init --left /dev/video0 -o i.toml", 1, &["--right", "--side-by-side"]),
            ("init --left a --right b --board pi4", 2, &["pi4", "rpi5"]),
            ("init --left a --right b --size 640 -o i.toml", 2, &["--size", "two whole numbers"]),
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
    let text =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/mistakes.rs")).unwrap();
    let cases = text
        .lines()
        .filter(|line| line.trim_start().starts_with("(\"") && line.contains("\", ") && line.contains(", &["))
        .count();
    assert!(cases >= 60, "{cases}");
}
