//! What a build without a feature says where the feature is asked for. The features' own tests are `gpu.rs`,
//! `camera.rs` and `bridge.rs`.

#[cfg(not(all(feature = "gpu", feature = "gstreamer", feature = "zenoh")))]
use crate::support::Bench;

#[cfg(not(feature = "gpu"))]
#[test]
fn a_build_without_the_feature_refuses_a_gpu_and_says_how_to_get_one() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let pair = ["drive/left/000000.png", "drive/right/000000.png"];
    let error = bench.fails(&["disparity", pair[0], pair[1], "-o", "d.png", "--backend", "gpu"]);
    assert!(error.contains("--features gpu") && error.contains("\"cpu\""), "{error}");
    let error = bench.fails(&["run", "--set", "stereo.backend=gpu"]);
    assert!(error.contains("--features gpu"), "{error}");
    // Nobody asked for one: the CPU will do.
    bench.ok(&["disparity", pair[0], pair[1], "-o", "d.png", "--backend", "auto"]);
}

#[cfg(not(feature = "gstreamer"))]
#[test]
fn a_build_without_the_feature_refuses_pipelines_and_says_how_to_get_them() {
    let bench = Bench::new();
    bench.configure_pipelines("videotestsrc", "videotestsrc", "");
    let error = bench.fails(&["run"]);
    assert!(error.contains("--features gstreamer"), "{error}");
    bench.assert_clean();
}

#[cfg(not(feature = "zenoh"))]
#[test]
fn a_build_without_the_feature_has_no_network_and_says_how_to_get_it() {
    let bench = Bench::new();
    for command in ["bridge", "fleet"] {
        let error = bench.fails(&[command]);
        assert!(error.contains("--features zenoh"), "{error}");
    }
}
