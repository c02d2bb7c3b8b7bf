//! Recordings read by other programs: the mcap package for Python with Foxglove's own message types.

use crate::support::{Bench, Need, lines, python, skip};
use std::path::Path;
use std::process::Command;

#[test]
fn the_mcap_package_and_foxgloves_own_types_decode_a_recording() {
    let modules = "mcap.reader, mcap_protobuf.decoder";
    let Some(python) = python(modules, "mcap and mcap-protobuf-support") else { return };
    let bench = Bench::new();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/support/read_recording.py");
    let read = |file: &str| -> serde_json::Value {
        let output = Command::new(&python).arg(&script).arg(bench.path(file)).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let recording = bench.record("drive", 14);
    bench.ok(&["replay", &recording, "--lockstep", "--out", "a", "--record", "run.mcap"]);
    let said = read("run.mcap");
    if said["published"] != true {
        let why =
            "the package foxglove-schemas-protobuf is not there: decoded by the file's own descriptors alone";
        skip(Need::Python, why);
    }
    for topic in
        ["/left/image", "/right/image", "/pair", "/obstacles", "/obstacles/scene", "/left/annotations"]
    {
        assert_eq!(said["topics"][topic], 14, "{topic}: {said}");
    }
    assert_eq!(said["schemas"]["/left/image"], "foxglove.RawImage protobuf");
    assert_eq!(said["schemas"]["/obstacles"], "lookout.Obstacles jsonschema");
    // Every frame has a pose, known or predicted.
    assert_eq!(said["topics"]["/odometry"], 14, "{said}");
    assert_eq!(said["schemas"]["/odometry"], "foxglove.FrameTransform protobuf");
    let first = &said["first"];
    assert_eq!(
        (&first["/left/image"]["width"], &first["/left/image"]["bytes"]),
        (&320.into(), &76_800.into())
    );
    let (pixels, ..) = sources::folder::read_grey(&Path::new(&recording).join("left/000000.png")).unwrap();
    assert_eq!(first["/left/image"]["data"], serde_json::json!(pixels[..16]));
    let p: Vec<f64> = serde_json::from_value(first["/right/calibration"]["P"].clone()).unwrap();
    assert_eq!((p[0], p[3]), (440.0, -440.0 * 0.12));
    // As many boxes as the frame with the most obstacles has, without those that pictures leave out.
    let shown = |o: &&serde_json::Value| o["confirmed"] == true || o["predicted"] == false;
    let count = |line: &serde_json::Value| line["obstacles"].as_array().unwrap().iter().filter(shown).count();
    let most = lines(&bench.path("a")).iter().map(count).max().unwrap();
    assert!(most > 0);
    assert_eq!(
        (&first["/obstacles/scene"]["entities"], &first["/left/annotations"]["boxes"]),
        (&most.into(), &most.into())
    );
    assert_eq!(said["first"]["/obstacles"], lines(&bench.path("a"))[0]);
    assert_eq!(said["metadata"]["lookout.summary"]["ended because"], "the run has ended");
    assert_eq!(said["metadata"]["lookout.recording"]["baseline_m"], "0.12");
    // A live recording with all topics.
    let daemon = bench.replay_endlessly(&recording, "10");
    bench.ok(&["record", "-o", "all.mcap", "--topics", "all", "--png", "--seconds", "3"]);
    bench.ok(&["record", "-o", "cloud.mcap", "--topics", "images,points", "--seconds", "3"]);
    bench.ok(&["record", "-o", "none.mcap", "--seconds", "1"]);
    daemon.signal("TERM");
    daemon.wait();
    let said = read("all.mcap");
    assert_eq!(said["schemas"]["/left/image"], "foxglove.CompressedImage protobuf");
    assert_eq!(said["first"]["/left/image"]["format"], "png");
    assert_eq!(
        (&said["first"]["/points"]["point_stride"], &said["schemas"]["/points"]),
        (&16.into(), &"foxglove.PointCloud protobuf".into())
    );
    assert!(said["first"]["/points"]["bytes"].as_u64().unwrap() > 16 * 500, "{said}");
    assert_eq!(said["first"]["/status"]["state"], "running");
    // A point of every second column and row, at its pixel and with its grey level; only if requested.
    let clouds = &read("cloud.mcap")["clouds"];
    let points = clouds["points"].as_u64().unwrap();
    assert!(clouds["clouds"].as_u64() > Some(1) && points > 1000, "{clouds}");
    assert_eq!((&clouds["on_pixels"], &clouds["grey"]), (&points.into(), &points.into()), "{clouds}");
    assert_eq!(clouds["columns"], serde_json::json!([0]));
    let fields = serde_json::json!([["x", 0, 7], ["y", 4, 7], ["z", 8, 7], ["intensity", 12, 7]]);
    assert_eq!(clouds["fields"], fields);
    assert!(read("none.mcap")["topics"]["/points"].is_null());
    assert_eq!(said["schemas"]["/tf"], "foxglove.FrameTransform protobuf");
}
