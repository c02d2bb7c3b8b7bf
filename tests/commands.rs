//! Subcommands on valid input: demo, status, disparity, obstacles.

use crate::support::{Bench, json, lines, shared_data};
use std::io::{BufRead, BufReader};
use std::process::Stdio;

#[test]
fn the_demo_writes_its_pictures_and_summary() {
    let bench = Bench::new();
    let out = bench.ok(&["demo", "--seconds", "4", "--out", "demo"]);
    bench.assert_clean();
    for file in ["left.png", "disparity.png", "v-disparity.png", "latency.png"] {
        let image = image::open(bench.path("demo").join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(image.width() > 100 && out.contains(file), "{file}");
    }
    let summary = json(&bench.path("demo/summary.json"));
    assert!(summary["frames"].as_u64().unwrap() > 0, "{summary}");
    let roles: Vec<&str> =
        summary["processes"].as_array().unwrap().iter().map(|p| p["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["scheduler", "capture", "stereo", "road", "recognition", "writer"]);
    for process in summary["processes"].as_array().unwrap() {
        assert!(process["private_bytes"].as_u64().unwrap() > 1 << 20, "{process}");
        assert!(process["cpu_percent"].as_f64().unwrap() > 0.0, "{process}");
    }
    assert!(!lines(&bench.path("demo")).is_empty());
}

#[test]
fn the_status_shows_every_process() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let daemon = bench.start(&["run"]);
    let status = bench.status_when(|s| s["state"] == "running");
    assert_eq!(status["pid"], daemon.pid());
    let processes = status["processes"].as_array().unwrap();
    assert_eq!(processes.len(), 5);
    for process in processes {
        assert_eq!(process["state"], "running", "{process}");
        assert!(process["pid"].as_u64().unwrap() > 0, "{process}");
        // Pinned to the core of the profile, which exists.
        let allowed = std::fs::read_to_string(format!("/proc/{}/status", process["pid"])).unwrap();
        let list = allowed.lines().find_map(|l| l.strip_prefix("Cpus_allowed_list:")).unwrap();
        assert_eq!(list.trim(), process["core"].to_string(), "{process}");
    }
    // Own motion is told whether it is known or not.
    assert!(status["motion"]["known"].is_boolean() && status["motion"]["sources"].is_array(), "{status}");
    let table = bench.ok(&["status"]);
    for word in ["scheduler", "capture", "stereo", "road", "recognition", "alarm", "own motion"] {
        assert!(table.contains(word), "{table}");
    }
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
}

#[test]
fn watching_prints_a_line_each_second_until_the_daemon_ends() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let daemon = bench.start(&["run"]);
    bench.status_when(|s| s["state"] == "running");
    let watch = bench.command(&["status", "--watch"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut watch = watch.unwrap();
    let mut lines = BufReader::new(watch.stdout.take().unwrap()).lines();
    for _ in 0..2 {
        let line = lines.next().unwrap().unwrap();
        assert!(line.contains(": running") && line.contains(" fps, p50 "), "{line}");
        // No control characters without a terminal.
        let told = ["alarm", "warning", "clear"].iter().any(|word| line.to_lowercase().contains(word));
        assert!(!line.contains('\x1b') && told, "{line}");
    }
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    // The line of a stopping daemon may follow; then the command ends with success.
    assert!(lines.all(|line| !line.unwrap().is_empty()));
    assert!(watch.wait_with_output().unwrap().status.success());
}

#[test]
fn one_pair_gives_disparity_and_obstacles() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let pair = ["drive/left/000000.png", "drive/right/000000.png"];
    let out = bench.ok(&[
        "disparity",
        pair[0],
        pair[1],
        "-o",
        "d.png",
        "--color",
        "c.png",
        "--probability",
        "p.png",
        "--repeat",
        "3",
        "--json",
    ]);
    let figures: serde_json::Value = serde_json::from_str(&out).unwrap();
    for key in [
        "method",
        "width",
        "height",
        "disparities",
        "density",
        "cpu_ms_median",
        "cpu_ms_min",
        "wall_ms_median",
        "workspace_bytes",
    ] {
        assert!(!figures[key].is_null(), "{key} is missing in {figures}");
    }
    assert_eq!((&figures["width"], &figures["disparities"]), (&320.into(), &32.into()));
    let map = image::open(bench.path("d.png")).unwrap().into_luma16();
    // Unknown where the disparity is.
    let probability = image::open(bench.path("p.png")).unwrap().into_luma8();
    assert!(map.pixels().zip(probability.pixels()).all(|(d, p)| (d[0] == 0) == (p[0] == 0)));
    assert!(probability.pixels().any(|p| p[0] > 240));
    // The licence plate of the car ahead is 16 m away: 440 px × 0.12 m ÷ 16 m = 3.3 px.
    let middle = f32::from(map.get_pixel(160, 126)[0]) / 256.0;
    assert!((middle - 3.3).abs() < 0.4, "{middle}");
    let colours = image::open(bench.path("c.png")).unwrap();
    assert_eq!(colours.color(), image::ColorType::Rgb8);
    // With a scale below the map.
    assert_eq!((colours.width(), colours.height()), (320, 240 + 32));

    let out =
        bench.ok(&["obstacles", pair[0], pair[1], "--rig", "drive/rig.toml", "--json", "--overlay", "o.png"]);
    let record: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!((record["road"]["camera_height_m"].as_f64().unwrap() - 1.25).abs() < 0.1, "{record}");
    let car = record["obstacles"].as_array().unwrap().iter().find(|o| {
        // 0.4 px, as above.
        o["lateral_m"].as_f64().unwrap().abs() < 0.5 && (o["distance_m"].as_f64().unwrap() - 16.0).abs() < 2.0
    });
    assert!(car.is_some_and(|c| c["class"] == "vehicle"), "{record}");
    assert!(image::open(bench.path("o.png")).is_ok());
    assert!(
        bench.ok(&["obstacles", pair[0], pair[1], "--rig", "drive/rig.toml"]).contains("\nalarm clear: ")
    );
}

#[test]
fn misaligned_rows_are_corrected_on_request() {
    let bench = Bench::new();
    bench.record("drive", 1);
    // Half a row upwards.
    let right = image::open(bench.path("drive/right/000000.png")).unwrap().into_luma8();
    let shifted = image::GrayImage::from_fn(right.width(), right.height(), |x, y| {
        let [here, below] = [y, (y + 1).min(right.height() - 1)].map(|y| u16::from(right.get_pixel(x, y)[0]));
        image::Luma([((here + below) / 2) as u8])
    });
    shifted.save(bench.path("shifted.png")).unwrap();
    let map_of = |right: &str, options: &[&str]| {
        let args = ["disparity", "drive/left/000000.png", right, "-o", "d.png", "--json"];
        let figures = bench.ok(&[&args, options].concat());
        let figures: serde_json::Value = serde_json::from_str(&figures).expect("the output is JSON");
        (figures, image::open(bench.path("d.png")).unwrap().into_luma16())
    };
    let (_, aligned) = map_of("drive/right/000000.png", &[]);
    let (as_they_are, apart) = map_of("shifted.png", &[]);
    let (corrected, again) = map_of("shifted.png", &["--correct-rows"]);
    let offset_px = corrected["rows_corrected"]["offset_px"].as_f64().expect("the drive has corners");
    assert!((offset_px + 0.5).abs() < 0.1 && as_they_are["rows_corrected"].is_null(), "{corrected}");
    let differs = |map: &image::ImageBuffer<image::Luma<u16>, Vec<u16>>| {
        let pairs = map.pixels().zip(aligned.pixels()).map(|(a, b)| (a[0], b[0]));
        pairs.filter(|(a, b)| a.abs_diff(*b) > 128).count()
    };
    assert!(differs(&again) < differs(&apart), "{} {}", differs(&again), differs(&apart));
}

#[test]
fn methods_threads_and_budgets_of_the_matcher() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let pair = ["drive/left/000000.png", "drive/right/000000.png"];
    let figures = |out: &str, options: &[&str]| -> serde_json::Value {
        let args = [&["disparity", pair[0], pair[1], "-o", out, "--json"], options].concat();
        serde_json::from_str(&bench.ok(&args)).expect("the output is JSON")
    };
    let full = figures("full.png", &["--method", "full"]);
    let fast = figures("fast.png", &[]);
    assert_eq!((&full["method"], &fast["method"]), (&"full".into(), &"fast".into()));
    assert_eq!((&full["scale"], &fast["scale"]), (&1.into(), &1.into()));
    // The full search visits the whole range and the coarser scales; the fast search far less.
    assert!(full["nodes_share"].as_f64().unwrap() > 1.0, "{full}");
    assert!(fast["nodes_share"].as_f64().unwrap() < 0.3281, "{fast}");
    assert!(fast["workspace_bytes"].as_u64() < full["workspace_bytes"].as_u64());

    figures("three.png", &["--set", "stereo.threads=3"]);
    let bytes = |name: &str| std::fs::read(bench.path(name)).unwrap();
    assert!(bytes("three.png") == bytes("fast.png"), "threads change nothing");
    let hurried = figures("hurried.png", &["--budget-ms", "0.000001"]);
    assert_eq!(hurried["scale"], 4, "{hurried}");
    assert!(hurried["density"].as_f64().unwrap() > 0.3, "{hurried}");
    let filled = figures("filled.png", &["--set", "stereo.fill=true"]);
    assert!(filled["density"].as_f64().unwrap() > fast["density"].as_f64().unwrap());
    assert_eq!(filled["density"], 1.0, "{filled}");
}

#[test]
fn a_cascade_labels_what_it_recognises() {
    let Some(kitti) = shared_data("kitti_sequence_1") else { return };
    let bench = Bench::new();
    // The shipped cascade under another name. The road of this rig needs more than the bench's disparities.
    let cascade = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/vehicle.xml");
    bench.configure(&format!(
        "[recognition]\nnetwork = \"\"\ncascade = \"{}\"\nlabel = \"cat\"\nneighbours_min = 1\ndetectors = []\n",
        cascade.display()
    ));
    let path = kitti.display().to_string();
    let wide = ["--set", "stereo.disparities=96"];
    bench.ok(&[&["replay", &path, "--in-process", "--limit", "12", "--out", "a"][..], &wide].concat());
    let lines = lines(&bench.path("a"));
    let obstacles: Vec<_> = lines.iter().flat_map(|l| l["obstacles"].as_array().unwrap()).collect();
    // The score is the probability of the class.
    let is_sure = |o: &serde_json::Value| o["score"].as_f64().is_some_and(|p| p > 0.5 && p < 1.0);
    let cats = obstacles.iter().filter(|o| o["class"] == "cat" && is_sure(o)).count();
    assert!(cats > 0 && cats < obstacles.len(), "{cats} of {}", obstacles.len());
    assert!(
        obstacles.iter().all(|o| o["class"] == "cat" || (o["class"] == "obstacle" && o["score"].is_null()))
    );
}

#[test]
fn help_has_examples() {
    let bench = Bench::new();
    for word in [
        "demo",
        "run",
        "replay",
        "status",
        "view",
        "disparity",
        "point-cloud",
        "obstacles",
        "train",
        "detect",
        "evaluate",
        "check-config",
        "init",
    ] {
        let output = bench.command(&["--log", "warn", word, "--help"]).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && text.contains("Examples:"), "{word}: {text}");
    }
}

#[test]
fn init_writes_a_configuration_that_can_be_used() {
    let bench = Bench::new();
    bench.record("drive", 2);
    let drive = ["--recording", "drive", "--rig", "drive/rig.toml", "--name", "first", "-o", "x.toml"];
    let out = bench.ok(&[&["init"][..], &drive].concat());
    assert!(out.contains("wrote x.toml") && out.contains("lookout run -c x.toml"), "{out}");
    let checked = bench.ok(&["check-config", "x.toml"]);
    assert!(checked.contains("name = \"first\"") && checked.contains("path = \"drive\""), "{checked}");
    let cameras =
        ["init", "--left", "/dev/video0", "--side-by-side", "--size", "1280x720", "--board", "rpi5"];
    let out = bench.ok(&cameras);
    assert!(out.contains("lookout calibrate --live camera -c lookout.toml"), "{out}");
    let checked = bench.ok(&["check-config", "lookout.toml"]);
    assert!(checked.contains("side_by_side = true") && checked.contains("width = 1280"), "{checked}");
    // The paths of a configuration in another folder are relative to that.
    std::fs::create_dir(bench.path("elsewhere")).unwrap();
    let command =
        bench.command(&["check-config", "../x.toml"]).current_dir(bench.path("elsewhere")).output().unwrap();
    assert!(command.status.success(), "{}", String::from_utf8_lossy(&command.stderr));
}

#[test]
fn every_subcommand_has_a_manual_page_and_shell_completions() {
    let bench = Bench::new();
    bench.ok(&["man", "pages"]);
    let help = bench.ok(&["--help"]);
    let subcommands =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    // A subcommand is indented by two spaces, a continued description by more.
    let subcommands =
        subcommands.filter(|line| !line.starts_with("   ")).filter_map(|line| line.split_whitespace().next());
    let subcommands: Vec<&str> = subcommands.filter(|name| *name != "help").collect();
    assert!(
        subcommands.contains(&"run")
            && subcommands.contains(&"restore-clocks")
            && subcommands.contains(&"man"),
        "{subcommands:?}"
    );
    for shell in ["bash", "zsh", "fish"] {
        let script = bench.ok(&["completions", shell]);
        for name in &subcommands {
            assert!(script.contains(name), "{shell} does not know {name}");
        }
    }
    for name in subcommands {
        let page = std::fs::read_to_string(bench.path("pages").join(format!("lookout-{name}.1")));
        assert!(page.expect("a page").contains(".TH lookout"), "{name}");
    }
    assert!(!bench.path("pages/lookout-stage.1").exists(), "stages are started by the scheduler alone");
}
