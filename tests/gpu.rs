//! Matching on a GPU from the command line and in the daemon: with the feature `gpu` on whatever adapter there
//! is, without it the refusal.

mod support;

use support::Bench;

/// What tests take: any adapter, as slow as it may be.
#[cfg(feature = "gpu")]
const PATIENT: &str = "stereo.gpu_timeout_ms=60000";

#[cfg(feature = "gpu")]
fn adapter() -> Option<perception::stereo::gpu::AdapterDescription> {
    let found = perception::stereo::gpu::adapters().into_iter().next();
    if found.is_none() {
        assert!(std::env::var_os("LOOKOUT_REQUIRE_GPU").is_none(), "a Vulkan adapter was asked for");
        println!("skipped: no Vulkan adapter (apt-get install mesa-vulkan-drivers brings one in software)");
    }
    found
}

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

#[cfg(feature = "gpu")]
#[test]
fn one_pair_is_the_same_on_both_and_the_figures_name_the_device() {
    let Some(adapter) = adapter() else { return };
    let bench = Bench::new();
    bench.record("drive", 1);
    let pair = ["drive/left/000000.png", "drive/right/000000.png"];
    let run = |out: &str, backend: &str| {
        bench.ok(&[
            "disparity",
            pair[0],
            pair[1],
            "-o",
            out,
            "--backend",
            backend,
            "--max-disparity",
            "32",
            "--set",
            PATIENT,
            "--json",
        ])
    };
    let (cpu, gpu) = (run("cpu.png", "cpu"), run("gpu.png", "gpu"));
    let picture = |file: &str| image::open(bench.path(file)).unwrap().into_luma16();
    assert!(picture("cpu.png") == picture("gpu.png"));
    let gpu: serde_json::Value = serde_json::from_str(&gpu).unwrap();
    assert_eq!(gpu["device"]["adapter"], adapter.name);
    assert!(gpu["device"]["fps"].as_f64().unwrap() > 0.0 && gpu["device"]["loss"].is_null(), "{gpu}");
    let cpu: serde_json::Value = serde_json::from_str(&cpu).unwrap();
    assert!(cpu["device"].is_null());
    assert_eq!(cpu["nodes_share"], gpu["nodes_share"]);
}

#[cfg(feature = "gpu")]
#[test]
fn the_daemon_matches_on_it_and_goes_on_when_it_hangs() {
    let Some(adapter) = adapter() else { return };
    let name = &adapter.name;
    let bench = Bench::new();
    let drive = bench.record("drive", 4);
    bench.configure(&format!("[source]\nkind = \"folder\"\npath = \"{drive}\"\nrepeat = true\nfps = 2.0\n"));
    let start = |timeout: &str| {
        let (backend, timeout) = ("stereo.backend=gpu", format!("stereo.gpu_timeout_ms={timeout}"));
        bench.start(&["run", "--set", backend, "--set", &timeout, "--set", "stereo.disparities=16"])
    };
    let daemon = start("60000");
    let status = bench.status_when(|s| s["device"]["adapter"] == name.as_str());
    assert_eq!(status["device"]["lost"], false, "{status}");
    assert!(bench.ok(&["status"]).contains(name));
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    if adapter.kind != "software" {
        println!(
            "skipped: {name} may be done in the shortest time that can be set, so it cannot be made to hang"
        );
        return;
    }
    // No software adapter is done in 10 ms: it counts as hanging, and the CPU takes over.
    let daemon = start("10");
    let status = bench.status_when(|s| s["device"]["lost"] == true && s["frames"].as_u64() > Some(2));
    assert_eq!(status["state"], "degraded", "{status}");
    let reason = status["reason"].as_str().unwrap();
    assert!(reason.contains(name) && reason.contains("the CPU matches"), "{reason}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
}
