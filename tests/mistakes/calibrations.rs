//! Mistakes with calibrations.

use super::{RIG, check, picture, write};
use crate::support::Bench;

#[test]
fn calibrations_that_fit_are_told_nothing() {
    let bench = Bench::new();
    bench.record("drive", 1);
    bench.record("kitti", 1);
    std::fs::remove_file(bench.path("kitti/rig.toml")).unwrap();
    // The principal point of KITTI's drives, as a share of the pictures.
    let kitti = "P0: 440 0 157 0 0 440 110 0 0 0 1 0\nP1: 440 0 157 -52.8 0 440 110 0 0 0 1 0\n";
    write(&bench, "kitti/calib.txt", kitti);
    // Far from the middle, and even outside: the file says that it is for these pictures.
    let off = RIG.replace("160.0", "80.0").replace("110.0", "55.0");
    write(&bench, "off.toml", format!("{off}width = 320\nheight = 240\n"));
    write(&bench, "outside.toml", format!("{}width = 320\nheight = 240\n", RIG.replace("110.0", "-20.0")));
    write(&bench, "beside/rig.toml", format!("{off}width = 320\nheight = 240\n"));
    write(&bench, "raw/calib_cam_to_cam.txt", KITTI_RAW);
    for (folder, size) in [("beside", (640, 480)), ("raw", (640, 480))] {
        for side in ["left", "right"] {
            picture(&bench, &format!("{folder}/{side}/1.png"), size);
        }
    }
    let pair = ["drive/left/000000.png", "drive/right/000000.png"];
    for args in [
        &["replay", "kitti", "--in-process"][..],
        &["replay", "kitti", "--in-process", "--rig", "kitti/calib.txt"],
        &["replay", "drive", "--in-process", "--rig", "off.toml"],
        &["replay", "drive", "--in-process", "--rig", "outside.toml"],
        &["replay", "drive", "--in-process", "--rig", "beside/rig.toml"],
        &["replay", "drive", "--in-process", "--rig", "raw/calib_cam_to_cam.txt"],
        &["obstacles", pair[0], pair[1], "--rig", "kitti/calib.txt"],
        &["obstacles", pair[0], pair[1], "--rig", "off.toml"],
        &["obstacles", pair[0], pair[1], "--rig", "beside/rig.toml"],
        &["replay", "scene:drive", "--in-process", "--limit", "1"],
    ] {
        let output = bench.run(args);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{args:?}: {text}");
        for part in ["principal point", "beside it", "WARN"] {
            assert!(!text.contains(part), "{args:?}: {text}");
        }
    }
    bench.assert_clean();
}

/// A rig that knows its size, with a principal point far from the middle.
const KITTI_RAW: &str = "S_02: 340 260\nS_rect_02: 320 240\nP_rect_02: 440 0 80 0 0 440 55 0 0 0 1 0\n\
                         S_03: 340 260\nS_rect_03: 320 240\nP_rect_03: 440 0 80 -52.8 0 440 55 0 0 0 1 0\n";

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
        ("half.toml", RIG.replace("160.0", "80.0").replace("110.0", "55.0")),
        ("big.toml", RIG.replace("160.0", "330.0").replace("110.0", "220.0")),
        ("sized.toml", format!("{RIG}width = 640\nheight = 480\n")),
        ("beside/calib.txt", kitti.to_owned()),
        ("intrinsics.yml", "M1: [1]\nD1: [0]\nM2: [1]\nD2: [0]\n".to_owned()),
        ("extrinsics.yml", "R: [1]\nT: [0]\n".to_owned()),
    ] {
        write(&bench, name, content);
    }
    for side in ["left", "right"] {
        picture(&bench, &format!("beside/{side}/1.png"), (640, 480));
    }
    bench.record("raw", 1);
    bench.record("bare", 1);
    std::fs::remove_file(bench.path("bare/rig.toml")).unwrap();
    let camera = perception::calibration::Camera {
        distortion: perception::calibration::Distortion::BrownConrady([
            -0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        ]),
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
    write(&bench, "raw/rig.toml", &text);
    write(&bench, "edited.toml", text.replace("fx_px = 440.0", "fx_px = 441.0"));
    check(
        &bench,
        &[
            ("replay bare --in-process", 1, &["bare", "no calibration", "rig.toml", "--rig"]),
            (
                "replay drive --in-process --rig gone.toml",
                1,
                &["--rig", "gone.toml", "no such file", "lookout calibrate"],
            ),
            ("replay drive --in-process --rig mm.toml", 1, &["mm.toml", "baseline", "metres"]),
            ("replay drive --in-process --rig short.toml", 1, &["short.toml", "cy_px"]),
            ("replay drive --in-process --rig typo.toml", 1, &["typo.toml", "focal", "focal_px"]),
            ("replay drive --in-process --rig text.toml", 1, &["text.toml", "line 1", "give focal_px"]),
            ("replay drive --in-process --rig swapped.txt", 1, &["swapped.txt", "swapped"]),
            (
                "replay drive --in-process --rig nine.txt",
                1,
                &["nine.txt", "line 1", "not 12", "give the whole"],
            ),
            ("replay drive --in-process --rig no.txt", 1, &["no.txt", "P0", "calib.txt"]),
            ("replay drive --in-process --rig rig.yaml", 1, &["rig.yaml", "Kalibr", "OpenCV"]),
            (
                "replay drive --in-process --rig other.toml",
                1,
                &["other.toml", "640x480", "320x240", "calibrate at that size"],
            ),
            ("replay drive --in-process --rig edited.toml", 1, &["edited.toml", "checksum"]),
            (
                "replay drive --in-process --rig drive",
                1,
                &["drive: a folder", "give the file in it, drive/rig.toml"],
            ),
            ("replay drive --in-process --rig half.toml", 0, &["half.toml", "far from the middle", "--rig"]),
            (
                "replay drive --in-process --rig big.toml",
                1,
                &["big.toml", "320x240", "another size", "--rig"],
            ),
            (
                "obstacles drive/left/000000.png drive/right/000000.png --rig big.toml",
                1,
                &["big.toml", "320x240", "another size", "--rig"],
            ),
            (
                "obstacles drive/left/000000.png drive/right/000000.png --rig half.toml",
                0,
                &["half.toml", "far from the middle", "--rig"],
            ),
            (
                "replay drive --in-process --rig sized.toml",
                1,
                &["sized.toml", "640x480", "320x240", "calibrate at"],
            ),
            (
                "obstacles drive/left/000000.png drive/right/000000.png --rig sized.toml",
                1,
                &["sized.toml", "640x480", "320x240"],
            ),
            (
                "obstacles drive/left/000000.png drive/right/000000.png --rig beside/calib.txt",
                0,
                &["beside/calib.txt", "640x480", "beside/left/1.png", "--rig"],
            ),
            (
                "replay raw --in-process --rig calib.txt",
                0,
                &["calib.txt", "raw/rig.toml", "leave out --rig", "source.rectify"],
            ),
            (
                "replay drive --in-process --rig intrinsics.yml",
                1,
                &["intrinsics.yml", "lookout rig EXTRINSICS"],
            ),
            (
                "replay drive --in-process --rig extrinsics.yml",
                1,
                &["extrinsics.yml", "lookout rig EXTRINSICS"],
            ),
            ("replay bare --in-process --rig lens.toml", 0, &[]),
            (
                "replay drive --in-process --set source.rectify=true",
                1,
                &["source.rectify is true", "drive/rig.toml", "\"auto\""],
            ),
            (
                "rectify calib.txt drive/left/000000.png drive/right/000000.png -o r",
                1,
                &["calib.txt", "lookout rig FILE --format toml"],
            ),
            ("board --board 9x6 --square-mm 25 -o board.png", 1, &["-o board.png", "end the name in .svg"]),
            ("rig calib.txt --size 640", 2, &["--size", "width and height in pixels"]),
            ("rig gone.toml", 1, &["gone.toml", "no such file", "lookout calibrate"]),
            ("rig calib.txt", 1, &["calib.txt", "image size", "--size"]),
            ("rig drive", 1, &["drive: a folder", "drive/rig.toml"]),
            (
                "calibrate gone --board 9x6 --square-mm 25 -o r.toml",
                1,
                &["gone", "no such folder", "pictures of the board"],
            ),
            ("calibrate drive --board 9 --square-mm 25 -o r.toml", 2, &["--board"]),
            ("calibrate drive --board 9x6 -o r.toml", 2, &["--square-mm"]),
            ("calibrate drive --board 9x6 --square-mm 0.024 -o r.toml", 2, &["--square-mm", "mm"]),
            ("calibrate drive --board 9x6 --square-mm 25 -o r.toml", 1, &["board"]),
        ],
    );
    bench.assert_clean();
}
