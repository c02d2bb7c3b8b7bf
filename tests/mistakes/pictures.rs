//! Mistakes with pictures: damaged ones, and pairs that are none.

use super::{RIG, check, deep_picture, picture, write};
use crate::support::Bench;

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
    write(&bench, "tiny/rig.toml", RIG.replace("160.0", "2.0").replace("110.0", "2.0"));
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
            (
                "replay sizes --in-process",
                1,
                &["sizes/right/000001.png", "10x10", "320x240", "one size", "remove or replace"],
            ),
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
            (
                "disparity drive/left/000000.png gone.png -o d.png",
                1,
                &["gone.png", "there is no such file", "give an image file"],
            ),
            (
                "disparity deep/left/0.png deep/right/1.png -o d.png",
                0,
                &["16-bit pictures are scaled from 12 bits", "source.bits"],
            ),
            (
                "replay deep --in-process --limit 1 --set source.bits=11",
                1,
                &["source.bits = 11", "give one of \"auto\", \"8\", \"10\", \"12\""],
            ),
            ("replay deep --in-process --limit 1 --set source.bits=12", 0, &[]),
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
    assert!(summary.contains("1 pair left out, because it cannot be read"), "{summary}");
    assert_eq!(crate::support::lines(&bench.path("out")).len(), 2);
    // The reason of the end is told once.
    let error = bench.fails(&["replay", "drive", "--lockstep", "--strict"]);
    assert_eq!(error.matches("right/000001.png: cannot be decoded").count(), 1, "{error}");
    bench.assert_clean();
}

#[test]
fn pictures_that_are_no_pair_are_told_with_what_to_do() {
    let bench = Bench::new();
    bench.record("drive", 9);
    let (left, right) = (bench.path("drive/left"), bench.path("drive/right"));
    for (name, [first, second]) in [("swapped", [&right, &left]), ("twins", [&left, &left])] {
        for (side, from) in [("left", first), ("right", second)] {
            let to = bench.path(name).join(side);
            std::fs::create_dir_all(&to).expect("folders");
            for entry in std::fs::read_dir(from).expect("pictures") {
                let from = entry.expect("a picture").path();
                std::fs::copy(&from, to.join(from.file_name().expect("a name"))).expect("a copy");
            }
        }
        write(&bench, &format!("{name}/rig.toml"), RIG);
    }
    std::fs::create_dir(bench.path("linked")).unwrap();
    std::os::unix::fs::symlink(&left, bench.path("linked/left")).unwrap();
    std::os::unix::fs::symlink(&left, bench.path("linked/right")).unwrap();
    let swapped = &["the left and the right picture are swapped", "exchange left and right"];
    let twins = &["both pictures are the same", "give each camera its own"];
    let same = &["left/000000.png", "are the same file", "give the pictures of each camera"];
    check(
        &bench,
        &[
            ("replay swapped --in-process", 0, swapped),
            ("replay swapped --in-process --limit 3", 0, swapped),
            ("replay swapped --lockstep --limit 4", 0, swapped),
            ("odometry swapped -o poses.txt", 0, swapped),
            ("evaluate drive swapped", 0, swapped),
            ("disparity swapped/left/000000.png swapped/right/000000.png -o d.png", 0, swapped),
            ("obstacles swapped/left/000000.png swapped/right/000000.png --rig drive/rig.toml", 0, swapped),
            ("replay twins --in-process", 0, twins),
            ("replay twins --lockstep", 0, twins),
            ("odometry twins -o poses.txt", 0, twins),
            ("disparity twins/left/000000.png twins/right/000000.png -o d.png", 0, twins),
            ("obstacles twins/left/000000.png twins/right/000000.png --rig drive/rig.toml", 0, twins),
            ("disparity drive/left/000000.png drive/left/000000.png -o d.png", 1, same),
            ("disparity drive/left/000000.png linked/right/000000.png -o d.png", 1, same),
            ("obstacles drive/left/000000.png drive/left/000000.png --rig drive/rig.toml", 1, same),
            (
                "point-cloud drive/left/000000.png drive/left/000000.png --rig drive/rig.toml -o c.ply",
                1,
                same,
            ),
            ("replay --left drive/left --right drive/left --rig drive/rig.toml", 1, same),
            ("replay --left drive/left/*.png --right linked/left --rig drive/rig.toml", 1, same),
            ("replay linked --rig drive/rig.toml --in-process", 1, same),
        ],
    );
    // A pair is told nothing.
    let output = bench.run(&["disparity", "drive/left/000000.png", "drive/right/000000.png", "-o", "d.png"]);
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    bench.assert_clean();
}
