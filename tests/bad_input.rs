//! Unusable input: each kind gives an error that names the fault, and leaves nothing behind.

use crate::support::{self, Bench, save_grey};

/// Runs a replay that must fail, and checks what it says.
fn refused(bench: &Bench, recording: &str, expected: &[&str]) {
    for mode in ["--lockstep", "--in-process"] {
        let error = bench.fails(&["replay", recording, mode, "--strict"]);
        for part in expected {
            assert!(error.contains(part), "{mode}: \"{part}\" is not in: {error}");
        }
    }
    bench.assert_clean();
}

#[test]
fn recordings_that_cannot_be_used() {
    let bench = Bench::new();
    let recording = bench.record("drive", 3);
    let path = |name: &str| bench.path("drive").join(name);

    std::fs::rename(path("right/000001.png"), bench.path("kept.png")).unwrap();
    refused(&bench, &recording, &["right/000001.png", "missing"]);

    save_grey(&path("right/000001.png"), &[0; 100], 10, 10);
    refused(&bench, &recording, &["right/000001.png", "10x10", "320x240"]);

    std::fs::rename(bench.path("kept.png"), path("right/000001.png")).unwrap();
    std::fs::remove_file(path("rig.toml")).unwrap();
    refused(&bench, &recording, &["no calibration", "--rig"]);
    std::fs::write(path("rig.toml"), "focal_px = 440\nbaseline_m = 120.0\ncx_px = 160\ncy_px = 110\n")
        .unwrap();
    refused(&bench, &recording, &["rig.toml", "baseline", "metres"]);

    for name in ["000000.png", "000001.png", "000002.png"] {
        std::fs::remove_file(path("left").join(name)).unwrap();
        std::fs::remove_file(path("right").join(name)).unwrap();
    }
    refused(&bench, &recording, &["drive/left", "empty"]);
    refused(&bench, "nowhere", &["nowhere"]);
    std::fs::create_dir(bench.path("nothing")).unwrap();
    refused(&bench, "nothing", &["no stereo pairs", "image_2 and image_3"]);
}

#[test]
fn a_truncated_png_stops_a_strict_replay_at_its_frame_and_keeps_the_others() {
    let bench = Bench::new();
    let recording = bench.record("drive", 4);
    let path = bench.path("drive/right/000002.png");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let error = bench.fails(&["replay", &recording, "--lockstep", "--strict", "--out", "results"]);
    assert!(error.contains("right/000002.png: cannot be decoded"), "{error}");
    assert_eq!(support::lines(&bench.path("results")).len(), 2);
    bench.assert_clean();
}

#[test]
fn images_that_are_too_small() {
    let bench = Bench::new();
    for side in ["left", "right"] {
        std::fs::create_dir_all(bench.path("tiny").join(side)).unwrap();
        save_grey(&bench.path("tiny").join(side).join("1.png"), &[7], 1, 1);
    }
    let rig = "focal_px = 440.0\nbaseline_m = 0.12\ncx_px = 0.5\ncy_px = 0.5\n";
    std::fs::write(bench.path("tiny/rig.toml"), rig).unwrap();
    refused(&bench, "tiny", &["1x1", "8x8"]);
    let pair = ["tiny/left/1.png", "tiny/right/1.png"];
    let error = bench.fails(&["disparity", pair[0], pair[1], "-o", "d.png"]);
    assert!(error.contains("1x1") && error.contains("tiny/left/1.png"), "{error}");
    let error = bench.fails(&["obstacles", pair[0], pair[1], "--rig", "tiny/rig.toml"]);
    assert!(error.contains("1x1"), "{error}");
    assert!(!bench.path("d.png").exists());
}

#[test]
fn single_pairs_that_cannot_be_used() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let left = "drive/left/000000.png";
    save_grey(&bench.path("other.png"), &[0; 400], 20, 20);
    std::fs::write(bench.path("text.png"), "no image").unwrap();
    for (right, expected) in
        [("other.png", "20x20"), ("text.png", "text.png: cannot be decoded"), ("gone.png", "gone.png")]
    {
        let error = bench.fails(&["disparity", left, right, "-o", "d.png"]);
        assert!(error.contains(expected), "{error}");
        let error = bench.fails(&["obstacles", left, right, "--rig", "drive/rig.toml"]);
        assert!(error.contains(expected), "{error}");
    }
    let right = "drive/right/000000.png";
    let error = bench.fails(&["disparity", left, right, "-o", "no/such/folder/d.png"]);
    assert!(error.contains("no/such/folder/d.png"), "{error}");
    assert!(bench.fails(&["obstacles", left, right]).contains("--rig"));
}

#[test]
fn configurations_that_cannot_be_used() {
    let bench = Bench::new();
    bench.record("drive", 1);
    for (more, expected) in [
        ("[alarm]\ndistance_m = nan\n", "alarm.distance_m = nan: give a number from 0.5 to 200"),
        ("[alarm]\ndistance_m = \"10 m\"\n", "alarm.distance_m = \"10 m\": give a number"),
        ("[alarm]\ndistance_m = 10000\n", "alarm.distance_m = 10000"),
        ("[alarm]\ndistence_m = 10\n", "unknown key alarm.distence_m; did you mean alarm.distance_m?"),
        ("[alarms]\n", "unknown table [alarms]; did you mean alarm?"),
        ("[alarm\n", "car.toml:"),
    ] {
        bench.configure(more);
        let error = bench.fails(&["replay", "drive", "--lockstep"]);
        assert!(error.contains(expected) && error.contains("car.toml:"), "{error}");
        let error = bench.fails(&["check-config", "car.toml"]);
        assert!(error.contains(expected), "{error}");
    }
    assert!(bench.ok(&["check-config", "rpi5"]).contains("fps = 10.0"));
}

#[test]
fn cascades_that_cannot_be_used() {
    let bench = Bench::new();
    let recording = bench.record("drive", 1);
    for (text, expected) in [
        (None, "broken.xml"),
        (Some("<opencv_storage><cascade>"), "broken.xml: not well-formed XML"),
        (Some("<opencv_storage><cascade/></opencv_storage>"), "<stageType> is missing"),
    ] {
        if let Some(text) = text {
            std::fs::write(bench.path("broken.xml"), text).unwrap();
        }
        bench.configure("[recognition]\ncascade = \"broken.xml\"\n");
        refused(&bench, &recording, &["recognition.cascade", expected]);
    }
}

#[test]
fn usage_errors_have_code_2() {
    let bench = Bench::new();
    for args in [
        &["replay"][..],
        &["replay", "x", "--fps", "0"],
        &["replay", "x", "--fps", "10", "--lockstep"],
        &["disparity", "a", "b", "-o", "c", "--max-disparity", "1000"],
        &["disparity", "a", "b", "-o", "c", "--budget-ms", "nan"],
        &["disparity", "a", "b", "-o", "c", "--budget-ms=-1"],
        &["no-such-word"],
    ] {
        assert_eq!(bench.run(args).status.code(), Some(2), "{args:?}");
    }
    // Keys set on the command line are checked like those of a file.
    for (setting, expected) in [
        ("stereo.lamda_vertical=3", "did you mean stereo.lambda_vertical?"),
        ("stereo.threads=0", "give a whole number from 1 to 64"),
        ("threads", "give TABLE.KEY=VALUE"),
    ] {
        let error = bench.fails(&["disparity", "a", "b", "-o", "c", "--set", setting]);
        assert!(error.contains(expected), "{error}");
    }
    assert_eq!(bench.run(&["stage", "stereo"]).status.code(), Some(1));
}
