//! What two viewers and a recorder cost the daemon: the same run with and without them, in turns.
//!
//! `LOOKOUT_COST_SECONDS=30 LOOKOUT_COST_ROUNDS=6 cargo test --release --test slow viewer_cost -- --nocapture`
//! gives the figures of docs/results.md; by default the test is short, and asserts what must hold on
//! any machine.

use crate::support::viewer::Viewer;
use crate::support::{Bench, pid_of, send};
use messages::bus::Bus;
use messages::instance::Instance;
use messages::wait::{self, Next};
use messages::{obstacles, service};
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The rate of the paper.
const FPS: f64 = 12.5;

/// Pairs of the recording, which is repeated.
const RECORDED: u64 = 40;

/// The beginning of a turn that is not counted: viewers start, or their memory is released.
const SETTLE: Duration = Duration::from_secs(1);

/// Results of the turns of one kind.
#[derive(Default)]
struct Figures {
    latency_ms: Vec<f64>,
    seconds: f64,
    missed: u64,
    skipped: u64,
    shared_bytes: u64,
}

impl Figures {
    fn percentile(&self, share: f64) -> f64 {
        let mut sorted = self.latency_ms.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[((sorted.len() - 1) as f64 * share).round() as usize]
    }
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}

/// Frames that stages have dropped so far.
fn skipped(status: &serde_json::Value) -> u64 {
    status["processes"]
        .as_array()
        .expect("processes")
        .iter()
        .map(|p| p["skipped"].as_u64().expect("a count"))
        .sum()
}

/// Processor time in milliseconds (clock ticks of 10 ms) and resident memory of its own in MiB of a process.
fn spent(pid: u32) -> (f64, f64) {
    let read = |name: &str| std::fs::read_to_string(format!("/proc/{pid}/{name}")).expect("it runs");
    let stat = read("stat");
    let fields: Vec<&str> = stat.rsplit_once(')').expect("a name").1.split_whitespace().collect();
    let ticks: f64 = fields[11..13].iter().map(|f| f.parse::<f64>().expect("ticks")).sum();
    let status = read("status");
    let own = status.lines().find_map(|l| l.strip_prefix("RssAnon:")).expect("its memory");
    let kib: f64 = own.trim().trim_end_matches(" kB").parse().expect("KiB");
    (10.0 * ticks, kib / 1024.0)
}

/// Starts a recorder of its default topics.
fn record_daemon(bench: &Bench) -> Child {
    let mut command = bench.command(&["record", "-o", "cost.mcap", "--json"]);
    command.stdout(Stdio::piped()).spawn().expect("the binary starts")
}

/// Ends it, and gives the frames that it has recorded and the messages that it has missed.
fn recorded(bench: &Bench, recorder: Child) -> [u64; 2] {
    send(recorder.id(), "TERM");
    let output = recorder.wait_with_output().expect("it can be waited for");
    assert!(output.status.success(), "the recorder ended with {}", output.status);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a report");
    std::fs::remove_file(bench.path("cost.mcap")).expect("a recording");
    let lost = report["lost"].as_object().expect("counts");
    let lost = lost.values().map(|count| count.as_u64().expect("a count")).sum();
    [report["frames"].as_u64().expect("a count"), lost]
}

/// Listens to the results for a while.
fn listen(instance: &Instance, time: Duration, figures: &mut Figures) {
    let bus = Bus::join(instance).expect("the daemon is there");
    let results = bus.subscriber(&service::OBSTACLES).expect("a place");
    let start = Instant::now();
    let mut last = None;
    wait::run::<messages::bus::IpcError>(&[&results], || {
        while let Some(sample) = results.receive()? {
            let header = *sample.header();
            assert!(obstacles::view(&header, sample.payload()).is_ok());
            if start.elapsed() > SETTLE {
                let gap = last.map_or(0, |before: u64| header.sequence.saturating_sub(before + 1));
                figures.missed += gap;
                let ns = header.latency_ns();
                figures.latency_ms.push(ns as f64 * 1e-6);
            }
            last = Some(header.sequence);
        }
        let left = (SETTLE + time).saturating_sub(start.elapsed());
        Ok(if left.is_zero() { Next::Stop } else { Next::Wait(left) })
    })
    .expect("the bus works");
    figures.seconds += time.as_secs_f64();
    figures.shared_bytes = figures.shared_bytes.max(instance.shared_bytes());
}

#[test]
fn two_viewers_and_a_recorder_do_not_disturb_the_stages() {
    let seconds = number("LOOKOUT_COST_SECONDS", 3);
    let rounds = number("LOOKOUT_COST_ROUNDS", 2);
    let bench = Bench::alone();
    let source = bench.record_paper("drive", RECORDED);
    bench.configure(&format!(
        "[source]\nkind = \"folder\"\npath = \"{source}\"\nrepeat = true\nfps = {FPS}\n"
    ));
    let daemon = bench.start(&["run"]);
    let before = bench.status_when(|s| s["state"] == "running" && s["frames"].as_u64() > Some(5));
    let instance = Instance::new(&bench.instance, &bench.path("run"));
    let (mut off, mut on) = (Figures::default(), Figures::default());
    let shown = [AtomicU64::new(0), AtomicU64::new(0)];
    let mut viewer_ms = 0.0;
    let mut viewer_mib: f64 = 0.0;
    let mut kept = [0, 0];
    for round in 0..2 * rounds {
        let with_viewers = round % 2 == 1;
        let figures = if with_viewers { &mut on } else { &mut off };
        let skipped_before = skipped(&bench.status_when(|_| true));
        if with_viewers {
            let viewers = [Viewer::start(&bench, &[]), Viewer::start(&bench, &[])];
            let recorder = record_daemon(&bench);
            let stop = AtomicBool::new(false);
            std::thread::scope(|scope| {
                for (viewer, count) in viewers.iter().zip(&shown) {
                    let stop = &stop;
                    // Requests without a pause: no page requests more.
                    scope.spawn(move || {
                        let mut page = viewer.socket();
                        while !stop.load(Ordering::Relaxed) {
                            let (answer, _) = page.ask();
                            count.fetch_add(u64::from(!answer["frame"].is_null()), Ordering::Relaxed);
                        }
                    });
                }
                listen(&instance, Duration::from_secs(seconds), figures);
                stop.store(true, Ordering::Relaxed);
            });
            for viewer in &viewers {
                let (ms, mib) = spent(viewer.pid());
                viewer_ms += ms;
                viewer_mib = viewer_mib.max(mib);
            }
            for (sum, count) in kept.iter_mut().zip(recorded(&bench, recorder)) {
                *sum += count;
            }
            let [first, second] = viewers;
            first.stop();
            second.stop();
        } else {
            listen(&instance, Duration::from_secs(seconds), figures);
        }
        figures.skipped += skipped(&bench.status_when(|_| true)) - skipped_before;
    }
    let after = bench.status_when(|_| true);
    for (name, f) in [("nobody looks", &off), ("two viewers and a recorder", &on)] {
        println!(
            "{name:<26} {:>6} frames in {:>4.0} s, p50 {:>6.1} ms, p90 {:>6.1} ms, p99 {:>6.1} ms, \
             {} missing, {} skipped by stages, {:.1} MiB of shared memory",
            f.latency_ms.len(),
            f.seconds,
            f.percentile(0.5),
            f.percentile(0.9),
            f.percentile(0.99),
            f.missed,
            f.skipped,
            f.shared_bytes as f64 / (1 << 20) as f64
        );
    }
    let ratio = |share| on.percentile(share) / off.percentile(share);
    println!("ratio: p50 {:.2}, p90 {:.2}, p99 {:.2}", ratio(0.5), ratio(0.9), ratio(0.99));
    let count: u64 = shown.iter().map(|count| count.load(Ordering::Relaxed)).sum();
    println!(
        "frames shown: {shown:?}; a viewer takes {:.1} ms of processor a frame with all parts, {viewer_mib:.1} MiB of its own",
        viewer_ms / count.max(1) as f64
    );

    println!("recorded: {} frames, {} messages missed", kept[0], kept[1]);

    // However busy the machine is: frames come out, pages show them, no process dies and no message is refused.
    for f in [&off, &on] {
        assert!(f.latency_ms.len() as u64 > rounds, "no frames came out");
    }
    assert!(shown.iter().all(|count| count.load(Ordering::Relaxed) > rounds), "{shown:?}");
    assert!(kept[0] > rounds, "nothing was recorded");
    for role in ["capture", "stereo", "road", "recognition"] {
        assert_eq!(pid_of(&before, role), pid_of(&after, role), "the {role} stage was replaced");
    }
    let refused = |p: &serde_json::Value| p["refused"].as_u64().expect("a count");
    assert!(after["processes"].as_array().expect("processes").iter().all(|p| refused(p) == 0), "{after}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}
