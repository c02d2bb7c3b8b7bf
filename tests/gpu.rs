//! Matching on a GPU from the command line and in the daemon, on whatever adapter there is. Built with the feature
//! `gpu` alone; `features.rs` tests what a build without it says.

mod support;

use support::documented::Pages;
use support::{Bench, Need, skip};

/// Tests accept any adapter, however slow.
const PATIENT: &str = "stereo.gpu_timeout_ms=30000";

#[track_caller]
fn adapter() -> Option<perception::stereo::gpu::AdapterDescription> {
    let found = perception::stereo::gpu::adapters().into_iter().next();
    if found.is_none() {
        skip(
            Need::Gpu,
            "no Vulkan adapter (Debian: apt-get install mesa-vulkan-drivers installs one in software)",
        );
    }
    found
}

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

#[test]
fn the_daemon_matches_on_it_and_falls_back_to_the_cpu_when_it_hangs() {
    let Some(adapter) = adapter() else { return };
    let name = &adapter.name;
    let bench = Bench::new();
    let drive = bench.record("drive", 4);
    bench.configure(&format!("[source]\nkind = \"folder\"\npath = \"{drive}\"\nrepeat = true\nfps = 2.0\n"));
    let start = |timeout: &str| {
        let (backend, timeout) = ("stereo.backend=gpu", format!("stereo.gpu_timeout_ms={timeout}"));
        bench.start(&["run", "--set", backend, "--set", &timeout, "--set", "stereo.disparities=16"])
    };
    let daemon = start("30000");
    let status = bench.status_when(|s| s["device"]["adapter"] == name.as_str());
    assert_eq!(status["device"]["lost"], false, "{status}");
    let missing = Pages::read(&["outputs.md"]).missing(&serde_json::json!({ "device": status["device"] }));
    assert!(missing.is_empty(), "docs/outputs.md does not name {missing:?} of the status");
    assert!(bench.ok(&["status"]).contains(name));
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    if adapter.kind != "software" {
        let why = "may be done in the shortest time-out that can be set, so it cannot be made to hang";
        skip(Need::SoftwareGpu, &format!("{name} {why}"));
        return;
    }
    // No software adapter finishes in 10 ms: it counts as hanging, and the CPU takes over.
    let daemon = start("10");
    let status = bench.status_when(|s| s["device"]["lost"] == true && s["frames"].as_u64() > Some(2));
    assert_eq!(status["state"], "degraded", "{status}");
    let reason = status["reason"].as_str().unwrap();
    assert!(reason.contains(name) && reason.contains("the CPU matches"), "{reason}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
}

/// Frames that the stereo stage has done, and the processor time in ns of its own thread and of all its threads.
fn spent(bench: &Bench, more_than: u64) -> (u64, [u64; 2]) {
    let stereo = |status: &serde_json::Value| {
        let processes = status["processes"].as_array().expect("processes").clone();
        processes.into_iter().find(|p| p["role"] == "stereo").expect("the stage is there")
    };
    let status = bench.status_when(|s| stereo(s)["frames"].as_u64() > Some(more_than));
    let stage = stereo(&status);
    let pid = stage["pid"].as_u64().expect("a number");
    let on_cpu_ns = |thread: &std::path::Path| -> Option<u64> {
        let text = std::fs::read_to_string(thread.join("schedstat")).ok()?;
        text.split(' ').next()?.parse().ok()
    };
    let threads = std::path::PathBuf::from(format!("/proc/{pid}/task"));
    let own = on_cpu_ns(&threads.join(pid.to_string())).expect("it runs");
    let all =
        std::fs::read_dir(&threads).expect("it runs").flatten().filter_map(|t| on_cpu_ns(&t.path())).sum();
    (stage["frames"].as_u64().expect("a count"), [own, all])
}

/// What the stereo stage computes itself when a GPU matches, at the paper's size: `cargo test --release -p lookout
/// --features gpu --test gpu stage -- --nocapture` gives the figures of docs/results.md, `LOOKOUT_GPU_FRAMES` more frames
/// of them. Threads beside the stage's own belong to the driver; a software driver computes there. That takes seconds,
/// so there are few disparities; the work of the stage itself does not depend on their number.
#[test]
fn a_stage_that_matches_on_it_leaves_the_work_to_it() {
    let Some(adapter) = adapter() else { return };
    let bench = Bench::alone();
    let drive = bench.record_paper("drive", 20);
    bench.configure(&format!("[source]\nkind = \"folder\"\npath = \"{drive}\"\nrepeat = true\nfps = 12.5\n"));
    let frames: u64 = std::env::var("LOOKOUT_GPU_FRAMES").ok().and_then(|v| v.parse().ok()).unwrap_or(4);
    let [cpu_ms, gpu_ms] = ["cpu", "gpu"].map(|backend| {
        let set = format!("stereo.backend={backend}");
        let daemon = bench.start(&["run", "--set", &set, "--set", PATIENT, "--set", "stereo.disparities=16"]);
        let (first, [own, all]) = spent(&bench, 1);
        let (last, [own_end, all_end]) = spent(&bench, first + frames);
        daemon.signal("TERM");
        assert!(daemon.wait().status.success());
        let ms = |ns: u64| ns as f64 * 1e-6 / (last - first) as f64;
        let (own_ms, all_ms) = (ms(own_end - own), ms(all_end - all));
        println!(
            "{backend}: {} frames, {own_ms:.2} ms of processor a frame in the stage's thread ({:.1} % of a core at \
             12.5 fps), {:.2} ms in its other threads",
            last - first,
            own_ms * 12.5 / 10.0,
            all_ms - own_ms
        );
        own_ms
    });
    println!(
        "{}: {:.3} of what the stage's thread takes where the CPU matches",
        adapter.name,
        gpu_ms / cpu_ms
    );
    assert!(gpu_ms < cpu_ms, "the stage itself takes {gpu_ms:.2} ms a frame, with the CPU {cpu_ms:.2} ms");
}

#[test]
fn the_clock_table_has_a_row_for_each_clock_and_restores_them() {
    if adapter().is_none() {
        return;
    }
    let bench = Bench::new();
    let drive = bench.record("drive", 4);
    let gpu = bench.path("sys/class/devfreq/17000000.gpu");
    std::fs::create_dir_all(&gpu).unwrap();
    for (file, text) in [
        ("min_freq", "306000000"),
        ("max_freq", "624750000"),
        // Only at the fastest step is it slower than it was set to be.
        ("cur_freq", "510000000"),
        ("available_frequencies", "306000000 408000000 510000000 624750000"),
    ] {
        std::fs::write(gpu.join(file), text).unwrap();
    }
    bench.configure(&format!(
        "[soak]\nwarm_up_s = 3.0\n[clocks]\ncheck_ms = 100\n[board]\nsysfs = \"{}\"\n",
        bench.path("sys").display()
    ));
    let soak = |minutes| {
        let args = ["soak", &drive, "--gpu-table", "--minutes", minutes, "--out", "seen", "--json"];
        let mut soak = bench.command(&args);
        soak.args(["--set", PATIENT, "--set", "stereo.disparities=16", "-c"])
            .arg(bench.path("car.toml"))
            .output()
            .unwrap()
    };
    let mut output = soak("0.1");
    // A software driver compiles for longer than that on a busy machine.
    if String::from_utf8_lossy(&output.stderr).contains("no results with the GPU") {
        output = soak("0.4");
    }
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let table: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let runs = table["runs"].as_array().unwrap();
    let clocks: Vec<_> = runs.iter().map(|run| run["set_mhz"].as_f64()).collect();
    assert_eq!(clocks, [Some(306.0), Some(510.0), Some(624.75), Some(306.0), None], "{table}");
    assert_eq!(
        (&runs[2]["read_mhz"], &runs[4]["read_mhz"]),
        (&serde_json::json!([510.0, 510.0]), &().into())
    );
    for run in runs {
        assert!(run["run"]["work_p50_ms"][1].as_f64() > Some(0.0), "{run}");
    }
    let text = std::fs::read_to_string(bench.path("seen/gpu-table.md")).unwrap();
    assert!(text.contains("here, GPU 625 MHz (read 510)") && text.contains("paper, GPU 852 MHz"), "{text}");
    let read = |file: &str| std::fs::read_to_string(gpu.join(file)).unwrap().trim().to_owned();
    assert_eq!((read("min_freq"), read("max_freq")), ("306000000".into(), "624750000".into()));
    bench.assert_clean();
}
