//! Cameras by GStreamer under the daemon, on GStreamer's own test images. Built with the feature `gstreamer` alone;
//! `features.rs` tests what a build without it says.

mod support;

use support::Bench;

/// A configuration of cameras by GStreamer.
fn bench(left: &str, right: &str, more: &str) -> Bench {
    let bench = Bench::new();
    bench.configure_pipelines(left, right, more);
    bench
}

/// A live test image; `more` are properties of its source.
fn pipeline(width: u32, more: &str) -> String {
    format!("videotestsrc is-live=true pattern=ball {more} ! video/x-raw,width={width},framerate=20/1")
}

#[test]
fn two_pipelines_or_one_with_both_images_feed_the_daemon() {
    for bench in [
        bench(&pipeline(320, ""), &pipeline(320, ""), ""),
        bench(&pipeline(640, ""), "", "side_by_side = true\n"),
    ] {
        let daemon = bench.start(&["run"]);
        bench.status_when(|s| s["frames"].as_u64() > Some(5));
        daemon.signal("TERM");
        assert!(daemon.wait().status.success());
        bench.assert_clean();
    }
}

#[test]
fn a_pipeline_that_ends_is_reported_and_reopened() {
    // A second of images each time.
    let camera = pipeline(640, "num-buffers=20");
    let bench = bench(&camera, "", "side_by_side = true\nretry_first_ms = 1500\nretry_longest_ms = 1500\n");
    let daemon = bench.start(&["run"]);
    let status = bench.status_when(|s| s["reason"].as_str().is_some_and(|r| r.contains("has ended")));
    assert_eq!(status["state"], "degraded", "{status}");
    let frames = status["frames"].as_u64();
    bench.status_when(|s| s["frames"].as_u64() > frames.map(|f| f + 5));
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}
