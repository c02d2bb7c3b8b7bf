//! Killed stages in lock-step: no frame is lost.

use crate::support::{Bench, json, lines, pid_of, send};

#[test]
fn in_lockstep_no_frame_is_lost_to_a_kill() {
    for role in ["capture", "stereo", "road", "recognition", "writer"] {
        let bench = Bench::new();
        let recording = bench.record("drive", 10);
        let daemon = bench.start(&[
            "replay",
            &recording,
            "--lockstep",
            "--loop",
            "--limit",
            "80",
            "--out",
            "results",
            // Slow enough that the kill comes before the last frame.
            "--set",
            "stereo.method=full",
            "--set",
            "stereo.disparities=255",
        ]);
        let status = bench.status_when(|s| s["frames"].as_u64().unwrap() >= 1);
        send(pid_of(&status, role), "KILL");
        let output = daemon.wait();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{role}: {errors}");
        // The frame in flight is requested again when the stage is back, not after a time-out.
        assert!(!errors.contains("does not move"), "{role}: {errors}");
        bench.assert_clean();
        let sequences: Vec<u64> =
            lines(&bench.path("results")).iter().map(|l| l["sequence"].as_u64().unwrap()).collect();
        assert_eq!(sequences, (0..80).collect::<Vec<_>>(), "{role}");
        for part in ["overlay", "disparity"] {
            let pictures = std::fs::read_dir(bench.path("results").join(part)).unwrap().count();
            assert_eq!(pictures, 80, "{role}: {part}");
        }
        let restarts = &json(&bench.path("results/summary.json"))["restarts"];
        assert_eq!(*restarts, 1, "{role} was killed before its last frame");
    }
}
