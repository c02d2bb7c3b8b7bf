//! What the process tests share: the binary, recordings of the synthetic drive, instances, turns, skipped tests.

#![allow(dead_code, unused_imports, reason = "each test program uses its own part")]

pub mod browser;
pub mod documented;
pub mod stream;
pub mod turns;
pub mod viewer;

pub use skipped_tests::{Need, skip};

use sources::PairSource;
use sources::scene::Drive;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use turns::Turn;

/// Longest wait for any event. No test asserts that something is fast.
pub const WATCHDOG: Duration = Duration::from_secs(120);

/// A folder, an instance name and a configuration of its own for one test.
pub struct Bench {
    pub folder: tempfile::TempDir,
    pub instance: String,
    _turn: Turn,
}

static COUNT: AtomicU32 = AtomicU32::new(0);

impl Bench {
    /// For a test that runs beside others.
    pub fn new() -> Self {
        Self::with(turns::beside_others())
    }

    /// For a test that measures times or loads the machine: no other test runs as long as this lives.
    pub fn alone() -> Self {
        Self::with(turns::alone())
    }

    fn with(turn: Turn) -> Self {
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        let bench = Self {
            folder: tempfile::tempdir().expect("a temporary folder"),
            instance: format!("t{}-{n}", std::process::id()),
            _turn: turn,
        };
        bench.configure("");
        bench
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes `car.toml`: small, quick to restart, in this folder alone, plus `more`.
    pub fn configure(&self, more: &str) {
        let text = format!(
            "[instance]\nname = \"{}\"\ndirectory = \"{}\"\n[stereo]\ndisparities = 32\n\
             [supervision]\nheartbeat_ms = 50\nrestart_first_ms = 50\nrestart_longest_ms = 200\n\
             restart_count = 100\nstartup_deadline_ms = 60000\nliveness_deadline_ms = 60000\n{more}",
            self.instance,
            self.path("run").display()
        );
        std::fs::write(self.path("car.toml"), text).expect("the configuration is written");
    }

    /// A configuration of cameras by GStreamer.
    pub fn configure_pipelines(&self, left: &str, right: &str, more: &str) {
        let rig = "focal_px = 440.0\nbaseline_m = 0.12\ncx_px = 160.0\ncy_px = 120.0\n";
        std::fs::write(self.path("rig.toml"), rig).unwrap();
        self.configure(&format!(
            "[source]\nkind = \"camera\"\nrig = \"{}\"\n\
             [camera]\nbackend = \"gstreamer\"\nleft = \"{left}\"\nright = \"{right}\"\nwidth = 320\nheight = 240\n\
             fps = 20\nskew_ms = 24.9\n{more}",
            self.path("rig.toml").display()
        ));
    }

    /// `lookout` with arguments; those that take a configuration get this one.
    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lookout"));
        command.args(args).current_dir(self.folder.path());
        if matches!(
            args[0],
            "run"
                | "replay"
                | "demo"
                | "status"
                | "view"
                | "record"
                | "stream"
                | "obstacles"
                | "disparity"
                | "point-cloud"
                | "restore-clocks"
        ) {
            command.arg("-c").arg(self.path("car.toml"));
        }
        command
    }

    pub fn run(&self, args: &[&str]) -> Output {
        self.command(args).output().expect("the binary runs")
    }

    /// Runs and expects success; gives standard output.
    pub fn ok(&self, args: &[&str]) -> String {
        let output = self.run(args);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{args:?} failed:\n{errors}");
        String::from_utf8(output.stdout).expect("output is text")
    }

    /// Runs and expects exit code 1; gives standard error.
    pub fn fails(&self, args: &[&str]) -> String {
        let output = self.run(args);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{args:?}:\n{errors}");
        assert!(!errors.contains("panicked"), "{errors}");
        errors
    }

    /// Starts `lookout` in the background.
    pub fn start(&self, args: &[&str]) -> Daemon {
        self.start_with(args, &[])
    }

    /// The same, with variables of the environment.
    pub fn start_with(&self, args: &[&str], variables: &[(&str, &str)]) -> Daemon {
        let child = self
            .command(args)
            .envs(variables.iter().copied())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary starts");
        Daemon { child: Some(child) }
    }

    /// The same, with standard output in a file of this folder.
    pub fn start_into(&self, file: &str, args: &[&str]) -> Daemon {
        let output = std::fs::File::create(self.path(file)).expect("the file is created");
        let mut command = self.command(args);
        let child = command.stdout(output).stderr(Stdio::piped()).spawn().expect("the binary starts");
        Daemon { child: Some(child) }
    }

    /// The daemon on a recording that is repeated for ever; it runs.
    pub fn replay_endlessly(&self, recording: &str, fps: &str) -> Daemon {
        let daemon =
            self.start(&["replay", recording, "--fps", fps, "--loop", "--limit", "100000", "--log", "error"]);
        self.status_when(|status| status["state"] == "running");
        daemon
    }

    /// A recording of the synthetic drive: `frames` pairs of 320 × 240 with a rig.
    pub fn record(&self, name: &str, frames: u64) -> String {
        let rig = perception::rig::Rig { focal_px: 440.0, baseline_m: 0.12, cx_px: 160.0, cy_px: 110.0 };
        let mut drive = Drive::new(1, rig, (320, 240), 10.0);
        let (mut left, mut right) = (vec![0; 320 * 240], vec![0; 320 * 240]);
        for side in ["left", "right"] {
            std::fs::create_dir_all(self.path(name).join(side)).expect("folders");
        }
        for index in 0..frames {
            // From where the car ahead comes near.
            drive.read(index + 40, &mut left, &mut right).expect("the drive never ends");
            for (side, pixels) in [("left", &left), ("right", &right)] {
                save_grey(&self.path(name).join(side).join(format!("{index:06}.png")), pixels, 320, 240);
            }
        }
        let rig = "focal_px = 440.0\nbaseline_m = 0.12\ncx_px = 160.0\ncy_px = 110.0\n";
        std::fs::write(self.path(name).join("rig.toml"), rig).expect("the rig is written");
        self.path(name).display().to_string()
    }

    /// The drive as the paper's cameras see it, 640 × 480, rendered beforehand, so that only the daemon is measured.
    pub fn record_paper(&self, name: &str, frames: u64) -> String {
        let mut drive = Drive::paper(1);
        let (mut left, mut right) = (vec![0; 640 * 480], vec![0; 640 * 480]);
        for side in ["left", "right"] {
            std::fs::create_dir_all(self.path(name).join(side)).expect("folders");
        }
        for index in 0..frames {
            drive.read(index + 40, &mut left, &mut right).expect("the drive never ends");
            for (side, pixels) in [("left", &left), ("right", &right)] {
                save_grey(&self.path(name).join(side).join(format!("{index:06}.pgm")), pixels, 640, 480);
            }
        }
        let rig = drive.rig().expect("a scene has a rig");
        let text = format!(
            "focal_px = {:?}\nbaseline_m = {:?}\ncx_px = {:?}\ncy_px = {:?}\n",
            rig.focal_px, rig.baseline_m, rig.cx_px, rig.cy_px
        );
        std::fs::write(self.path(name).join("rig.toml"), text).expect("the rig is written");
        self.path(name).display().to_string()
    }

    /// A recording of noise with a rig, for what only needs many pixels.
    pub fn record_noise(&self, name: &str, frames: u64, (width, height): (u32, u32)) -> String {
        let mut state = 1_u32;
        for side in ["left", "right"] {
            std::fs::create_dir_all(self.path(name).join(side)).expect("folders");
            for index in 0..frames {
                let pixels: Vec<u8> = std::iter::repeat_with(|| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 24) as u8
                })
                .take(width as usize * height as usize)
                .collect();
                save_grey(
                    &self.path(name).join(side).join(format!("{index:06}.pgm")),
                    &pixels,
                    width,
                    height,
                );
            }
        }
        let rig = format!(
            "focal_px = {:?}\nbaseline_m = 0.12\ncx_px = {:?}\ncy_px = {:?}\n",
            width as f32,
            width as f32 / 2.0,
            height as f32 / 2.0
        );
        std::fs::write(self.path(name).join("rig.toml"), rig).expect("the rig is written");
        self.path(name).display().to_string()
    }

    /// What `lookout status --json` says, once there is a daemon and `wanted` is true of it.
    pub fn status_when(&self, wanted: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
        let start = Instant::now();
        let mut last = None;
        loop {
            let output = self.run(&["status", "--json"]);
            if output.status.success() {
                let status = serde_json::from_slice(&output.stdout).expect("status is JSON");
                if wanted(&status) {
                    return status;
                }
                last = Some(status);
            }
            let errors = String::from_utf8_lossy(&output.stderr);
            assert!(
                start.elapsed() < WATCHDOG,
                "the wanted status never came; the last, and what the last call printed: {last:?}\n{errors}"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Asserts that this instance has left nothing: no folder, no mark of a run of its name, and
    /// nothing in shared memory without the mark of its run.
    pub fn assert_clean(&self) {
        self.assert_no_memory_left();
        let left = self.left_in_run_folder();
        assert!(!self.path("run").exists(), "left in the run folder: {left:?}");
    }

    /// The files and other things below the run folder that are no folders.
    pub fn left_in_run_folder(&self) -> Vec<PathBuf> {
        let mut folders = vec![self.path("run")];
        let mut left = Vec::new();
        while let Some(folder) = folders.pop() {
            // A folder that is not there has nothing in it.
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
                if is_folder { folders.push(entry.path()) } else { left.push(entry.path()) }
            }
        }
        left
    }

    /// Asserts that no run of this instance is marked, and that nothing is in shared memory without the mark of its run.
    pub fn assert_no_memory_left(&self) {
        assert_eq!(self.run_prefix(), None, "a run of this instance is still marked");
        let names = shared_names();
        for name in &names {
            let run: String = name.splitn(3, '.').take(2).map(|part| format!("{part}.")).collect();
            // Other instances start and end meanwhile.
            let marked = names.contains(&format!("{run}run"));
            assert!(marked || !shared_names().contains(name), "{name} is left without its run");
        }
    }

    /// What the shared memory of this instance's run starts with.
    fn run_prefix(&self) -> Option<String> {
        let mark = shared_names().into_iter().find(|name| {
            let text = std::fs::read_to_string(Path::new("/dev/shm").join(name));
            name.ends_with(".run") && text.is_ok_and(|t| t.trim() == self.instance)
        })?;
        Some(mark.strip_suffix("run")?.to_owned())
    }

    /// Files of this instance in shared memory.
    pub fn shared_files(&self) -> usize {
        self.run_prefix().map_or(0, |prefix| shared_names().iter().filter(|n| n.starts_with(&prefix)).count())
    }
}

/// Names of all our files in shared memory.
fn shared_names() -> Vec<String> {
    let entries = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
    entries.filter_map(|e| e.file_name().into_string().ok()).filter(|n| n.starts_with("lookout.")).collect()
}

/// A process that is killed when its test ends early.
pub struct Daemon {
    child: Option<Child>,
}

impl Daemon {
    pub fn pid(&self) -> u32 {
        self.child.as_ref().expect("it runs").id()
    }

    pub fn signal(&self, signal: &str) {
        send(self.pid(), signal);
    }

    /// Waits for it to end by itself.
    pub fn wait(mut self) -> Output {
        let mut child = self.child.take().expect("it runs");
        let start = Instant::now();
        while child.try_wait().expect("it can be waited for").is_none() {
            if start.elapsed() > WATCHDOG {
                let _ = child.kill();
                panic!("the daemon never ended");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        child.wait_with_output().expect("its output can be read")
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

pub fn send(pid: u32, signal: &str) {
    let status = Command::new("kill").args([&format!("-{signal}"), &pid.to_string()]).status();
    assert!(status.expect("kill runs").success(), "signal {signal} to {pid}");
}

/// The entry of a role in a status or a summary.
pub fn process<'a>(status: &'a serde_json::Value, role: &str) -> &'a serde_json::Value {
    status["processes"].as_array().unwrap().iter().find(|p| p["role"] == role).unwrap()
}

/// Process id of a role in a status.
pub fn pid_of(status: &serde_json::Value, role: &str) -> u32 {
    let processes = status["processes"].as_array().expect("processes");
    let process = processes.iter().find(|p| p["role"] == role).expect("the role");
    process["pid"].as_u64().expect("a pid") as u32
}

pub fn save_grey(path: &Path, pixels: &[u8], width: u32, height: u32) {
    image::GrayImage::from_raw(width, height, pixels.to_vec())
        .expect("the pixels fit")
        .save(path)
        .expect("the image is written");
}

/// Runs a command that prints JSON and must succeed.
pub fn document(bench: &Bench, args: &[&str]) -> serde_json::Value {
    serde_json::from_str(&bench.ok(args)).expect("the output is JSON")
}

/// The Python of `LOOKOUT_PYTHON` or the system's that can import `modules`; without one the test is skipped.
#[track_caller]
pub fn python(modules: &str, packages: &str) -> Option<String> {
    let works = |python: &String| {
        let check = Command::new(python).args(["-c", &format!("import {modules}")]).output();
        check.is_ok_and(|output| output.status.success())
    };
    let candidates = [std::env::var("LOOKOUT_PYTHON").ok(), Some("python3".into())];
    let found = candidates.into_iter().flatten().find(works);
    if found.is_none() {
        skip(Need::Python, &format!("no python3 with the packages {packages} (LOOKOUT_PYTHON may name one)"));
    }
    found
}

/// The shared test data; where it is absent the test is skipped.
#[track_caller]
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(name);
    if path.is_dir() {
        return Some(path);
    }
    skip(
        Need::Data,
        &format!("../shared/data/{name} is not there: the data sets are not part of the project"),
    );
    None
}

/// All files below a folder with their bytes, but those that hold times.
pub fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        for entry in std::fs::read_dir(&path).expect("the folder is there").flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else if !path.ends_with("summary.json") {
                let bytes = std::fs::read(&path).expect("the file can be read");
                found.push((path.strip_prefix(folder).expect("it lies below").to_owned(), bytes));
            }
        }
    }
    found.sort();
    found
}

pub fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("the file is there")).expect("it is JSON")
}

/// The lines of `obstacles.jsonl`.
pub fn lines(folder: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(folder.join("obstacles.jsonl")).expect("obstacles.jsonl");
    text.lines().map(|l| serde_json::from_str(l).expect("a line is JSON")).collect()
}
