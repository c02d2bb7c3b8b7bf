//! Programs in Rust, C and Python that read the daemon's shared memory through the client libraries.

use crate::support::{Bench, Daemon, Need, WATCHDOG, lines, skip};
use client::{Client, ClientError, Options};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// Frames of the recording of a test, and how many of them a reader has to get.
const FRAMES: u64 = 40;
const WANTED: usize = 5;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Where cargo has put liblookout, on which the tests depend: beside this program.
fn library_folder() -> PathBuf {
    std::env::current_exe().expect("a path").parent().expect("a folder").to_owned()
}

fn options(bench: &Bench, pictures: bool) -> Options {
    Options { instance: bench.instance.clone(), directory: bench.path("run"), pictures }
}

/// The daemon on a recording, with results in `out`.
fn replay(bench: &Bench) -> Daemon {
    let recording = bench.record("drive", FRAMES);
    bench.start(&["replay", &recording, "--fps", "8", "--out", "out"])
}

/// The line of a frame in `obstacles.jsonl`; `None` if the writer did not get it.
fn line(results: &[Value], sequence: u64) -> Option<&Value> {
    results.iter().find(|line| line["sequence"] == sequence)
}

/// The first program in a language that the documentation shows.
fn documented(language: &str) -> String {
    let text = std::fs::read_to_string(root().join("docs/clients.md")).expect("the page is there");
    let rest = text.split_once(&format!("```{language}\n")).expect("a program").1;
    rest.split_once("```").expect("its end").0.to_owned()
}

/// Ends a replay in order. That it did not come to its end is its exit code.
fn end(daemon: Daemon) {
    daemon.signal("TERM");
    daemon.wait();
}

/// What a program printed; it succeeds.
fn ok(mut command: Command) -> String {
    let output = command.output().expect("it runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}:\n{}\n{errors}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn a_rust_client_gets_the_results_that_are_written_with_their_pictures() {
    let bench = Bench::new();
    let mut client = Client::open(options(&bench, true)).expect("a name");
    assert!(client.next(Duration::ZERO).expect("no daemon is no error").is_none());
    assert!(client.waits().contains("is running"), "{}", client.waits());
    let daemon = replay(&bench);
    let mut got: Vec<(u64, String, String, Vec<f64>, f64)> = Vec::new();
    let (run, last) = loop {
        let frame = client.next(WATCHDOG).expect("it can be read").expect("a frame");
        if frame.withdrawn {
            assert_eq!((frame.level(), frame.obstacles.len()), ("off", 0));
            assert!(frame.pictures.is_none() && !frame.reason().is_empty());
            break (frame.run.to_owned(), frame.sequence);
        }
        let pictures = frame.pictures.expect("the pictures of the frame");
        assert_eq!((frame.width, frame.height), (320, 240));
        for length in [pictures.disparity.len(), pictures.left.len(), pictures.right.len()] {
            assert_eq!(length, 320 * 240);
        }
        assert!(frame.result_ns > frame.capture_ns && frame.age() < WATCHDOG);
        let known = pictures.disparity.iter().filter(|&&disparity| disparity > 0).count();
        assert!(known > 320 * 240 / 10, "{known} known disparities");
        assert_eq!(frame.rig.width == 320, frame.rig.focal_px == 440.0);
        let distances = frame.obstacles.iter().map(|o| o.distance_m).collect();
        let height_m = frame.alarm.camera_height_m;
        got.push((frame.sequence, frame.level().into(), frame.reason(), distances, height_m));
    };
    assert!(daemon.wait().status.success());
    assert_eq!((run.len(), last >= got.last().expect("a frame").0), (12, true));
    assert!(got.windows(2).all(|pair| pair[0].0 < pair[1].0), "a frame came twice: {got:?}");
    let results = lines(&bench.path("out"));
    let mut compared = 0;
    for (sequence, level, reason, distances, height_m) in &got {
        let Some(line) = line(&results, *sequence) else { continue };
        assert_eq!(
            (&line["alarm"]["level"], &line["alarm"]["reason"]),
            (&(&level[..]).into(), &(&reason[..]).into())
        );
        let written = line["obstacles"].as_array().expect("a list");
        assert_eq!(written.len(), distances.len());
        for (obstacle, distance) in written.iter().zip(distances) {
            assert!((obstacle["distance_m"].as_f64().expect("a number") - distance).abs() < 1e-3);
        }
        if let Some(written) = line["road"]["camera_height_m"].as_f64() {
            assert!((written - height_m).abs() < 1e-3);
        }
        compared += 1;
    }
    assert!(compared >= WANTED, "{compared} of {} frames were written, too", got.len());
    bench.assert_clean();
}

#[test]
fn a_client_survives_the_daemons_that_it_reads() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\nfps = 20\n");
    let mut client = Client::open(options(&bench, true)).expect("a name");
    let mut frames = BTreeSet::new();
    for start in 0..3 {
        let daemon = bench.start(&["run"]);
        let run = loop {
            let frame = client.next(WATCHDOG).expect("it can be read").expect("a frame");
            assert!(!frame.withdrawn);
            assert!(frames.insert((frame.run.to_owned(), frame.sequence)), "a frame came twice");
            let run = frame.run.to_owned();
            if frames.iter().filter(|(of, _)| *of == run).count() >= WANTED {
                break run;
            }
        };
        // In turns as a crash and in order.
        if start == 0 {
            drop(daemon);
        } else {
            daemon.signal("TERM");
            assert!(daemon.wait().status.success());
        }
        loop {
            let frame = client.next(WATCHDOG).expect("it can be read").expect("a frame");
            assert_eq!(frame.run, run);
            if frame.withdrawn {
                break;
            }
        }
        assert!(client.next(Duration::from_millis(300)).expect("no daemon is no error").is_none());
    }
    assert_eq!(frames.iter().map(|(run, _)| run).collect::<BTreeSet<_>>().len(), 3);
    drop(client);
    bench.assert_clean();
}

#[test]
fn a_client_that_stalls_costs_the_daemon_no_frame_and_goes_on_with_the_newest() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let daemon = bench.replay_endlessly(&recording, "20");
    let mut client = Client::open(options(&bench, true)).expect("a name");
    let first = client.next(WATCHDOG).expect("it can be read").expect("a frame").sequence;
    let restarts = |status: &Value| -> u64 {
        let processes = status["processes"].as_array().expect("a list");
        processes.iter().filter_map(|process| process["restarts"].as_u64()).sum()
    };
    // It holds the pictures of its frame meanwhile.
    let frames = bench.status_when(|status| status["frames"].as_u64() >= Some(first + 40));
    assert_eq!((restarts(&frames), &frames["state"]), (0, &"running".into()));
    let next = client.next(WATCHDOG).expect("it can be read").expect("a frame").sequence;
    // Frames are counted from 1, sequence numbers from 0.
    assert!(next >= first + 39, "{next} follows {first}");
    drop(client);
    end(daemon);
    bench.assert_clean();
}

#[test]
fn names_that_no_daemon_has_are_refused() {
    for instance in ["", "../../etc", "a b", "seventeen-letters"] {
        let options = Options { instance: instance.into(), ..Options::default() };
        assert!(matches!(Client::open(options), Err(ClientError::Name(_))), "{instance}");
    }
}

/// Installs the C library into a folder; `None`, and the test is skipped, without a compiler or pkg-config.
fn install(bench: &Bench) -> Option<PathBuf> {
    let works = |program: &str| {
        let version =
            Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    };
    if !(works("cc") && works("pkg-config")) {
        skip(Need::Cc, "the C library needs cc and pkg-config");
        return None;
    }
    let prefix = bench.path("prefix");
    let mut command = Command::new(root().join("clients/c/install.sh"));
    command.args([&prefix, &library_folder()]);
    ok(command);
    Some(prefix)
}

/// Compiles an example with the flags of pkg-config.
fn compile(prefix: &Path, source: &Path, to: &Path, is_static: bool) {
    let mut flags = Command::new("pkg-config");
    flags.args(["--cflags", "--libs"]).args(is_static.then_some("--static")).arg("lookout");
    flags.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
    let flags = ok(flags);
    let mut flags: Vec<String> = flags.split_whitespace().map(Into::into).collect();
    if is_static {
        // The archive itself, because the linker prefers the shared library.
        let library = flags.iter_mut().find(|flag| *flag == "-llookout").expect("the library");
        *library = prefix.join("lib/liblookout.a").display().to_string();
    }
    let mut cc = Command::new("cc");
    cc.args(["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1"]).arg(source).args(flags);
    ok({
        cc.arg("-o").arg(to);
        cc
    });
}

/// What `nearest` prints for `frames` frames, as an unchecked result.
fn nearest(bench: &Bench, mut program: Command, frames: usize) -> Output {
    program.arg(&bench.instance).arg(bench.path("run")).arg(frames.to_string());
    program.output().expect("it runs")
}

#[test]
fn programs_in_c_read_frames_with_the_shared_and_the_static_library() {
    let bench = Bench::new();
    let Some(prefix) = install(&bench) else { return };
    let source = root().join("clients/c/examples/nearest.c");
    let recording = bench.record("drive", 10);
    let daemon = bench.replay_endlessly(&recording, "10");
    for is_static in [false, true] {
        let program = bench.path(if is_static { "nearest-static" } else { "nearest" });
        compile(&prefix, &source, &program, is_static);
        let mut command = Command::new(&program);
        if !is_static {
            let output = nearest(&bench, Command::new(&program), WANTED);
            assert!(!output.status.success(), "it is linked with the shared library");
            command.env("LD_LIBRARY_PATH", prefix.join("lib"));
        }
        let output = nearest(&bench, command, 20);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && errors.is_empty(), "{errors}");
        let text = String::from_utf8(output.stdout).expect("text");
        assert!(!text.is_empty(), "there is a car in the path");
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [_, level, distance, "m,", known, "disparities"] = words[..] else { panic!("{line}") };
            assert!(["clear", "warning", "alarm", "off"].contains(&level), "{line}");
            let (distance, known): (f64, usize) =
                (distance.parse().expect("a number"), known.parse().expect("a number"));
            assert!((1.0..200.0).contains(&distance) && known > 320 * 240 / 10, "{line}");
        }
    }
    end(daemon);
    let shown = bench.path("shown.c");
    std::fs::write(&shown, documented("c")).expect("own folder");
    compile(&prefix, &shown, &bench.path("shown"), false);
    let checks = bench.path("checks.c");
    std::fs::write(&checks, CHECKS).expect("own folder");
    let program = bench.path("checks");
    compile(&prefix, &checks, &program, true);
    ok(Command::new(&program));
    bench.assert_clean();
}

/// Wrong arguments, as a program in C gives them.
const CHECKS: &str = r#"
#include <assert.h>
#include <lookout.h>
#include <string.h>
int main(void) {
    char error[200], little[8];
    lookout_frame frame;
    lookout_options options = LOOKOUT_OPTIONS;
    assert(lookout_layout() == LOOKOUT_LAYOUT);
    options.layout = LOOKOUT_LAYOUT + 1;
    assert(!lookout_open(&options, error, sizeof error) && strstr(error, "compile it with the header"));
    assert(!lookout_open(&options, little, sizeof little) && strlen(little) == 7);
    assert(!lookout_open(&options, NULL, 0) && !lookout_open(NULL, NULL, 0));
    options.layout = LOOKOUT_LAYOUT;
    options.instance = "\xff";
    assert(!lookout_open(&options, error, sizeof error) && strstr(error, "UTF-8"));
    options.instance = "no/name";
    assert(!lookout_open(&options, error, sizeof error) && strstr(error, "instance.name"));
    options.instance = "nobody-runs-it";
    lookout_client *client = lookout_open(&options, NULL, 0);
    assert(client && lookout_next(client, 0, &frame) == 0 && strstr(lookout_error(client), "nobody-runs-it"));
    assert(lookout_next(client, 0, NULL) == -1 && lookout_next(NULL, 0, &frame) == -1 && *lookout_error(NULL));
    lookout_close(client);
    lookout_close(NULL);
    assert(!strcmp(lookout_level_name(LOOKOUT_LEVEL_ALARM), "alarm") && !strcmp(lookout_level_name(77), "off"));
    return 0;
}
"#;

#[test]
fn a_python_package_is_installed_with_pip_and_shows_pictures_without_a_copy() {
    let Some(python) = crate::support::python("numpy, pip", "numpy and pip") else { return };
    let bench = Bench::new();
    // A copy: building leaves files beside the source.
    let (source, packages) = (bench.path("source"), bench.path("packages"));
    let mut copy = Command::new("cp");
    ok({
        copy.arg("-r").arg(root().join("clients/python")).arg(&source);
        copy
    });
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target"]);
    pip.arg(&packages)
        .arg(&source)
        .env("PIP_DISABLE_PIP_VERSION_CHECK", "1")
        .env("PIP_ROOT_USER_ACTION", "ignore");
    ok(pip);
    let program = |script: PathBuf| {
        let mut command = Command::new(&python);
        command.arg(script).env("PYTHONPATH", &packages);
        command
    };
    let library = library_folder().join("liblookout.so");
    let read = root().join("tests/support/read_shared_memory.py");
    let mut reader = program(read);
    reader.arg(&bench.instance).arg(bench.path("run")).env("LOOKOUT_LIBRARY", &library);
    let reader = reader.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    assert!(replay(&bench).wait().status.success());
    let output = reader.wait_with_output().expect("it ends with the run");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let results = lines(&bench.path("out"));
    let text = String::from_utf8(output.stdout).expect("text");
    let got: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let mut compared = 0;
    for frame in &got {
        let Some(line) = line(&results, frame["sequence"].as_u64().expect("a number")) else { continue };
        for name in ["level", "reason"] {
            assert_eq!(frame[name], line["alarm"][name]);
        }
        let written = line["obstacles"].as_array().expect("a list");
        let read = frame["obstacles"].as_array().expect("a list");
        assert_eq!(read.len(), written.len());
        for (read, written) in read.iter().zip(written) {
            assert_eq!((&read["track"], &read["class"]), (&written["track"], &written["class"]));
            let distances = [read, written].map(|o| o["distance_m"].as_f64().expect("a number"));
            assert!((distances[0] - distances[1]).abs() < 1e-3, "{distances:?}");
        }
        compared += 1;
    }
    assert!(compared >= WANTED, "{compared} of {} frames were written, too", got.len());

    // The page's program and the example, and errors that name the remedy.
    let shown = bench.path("shown.py");
    std::fs::write(&shown, documented("python") + "    if frame.rig[\"width\"]:\n        break\n")
        .expect("own folder");
    let example = root().join("clients/python/examples/nearest.py");
    let daemon = bench.replay_endlessly(&bench.path("drive").display().to_string(), "10");
    let named = format!("Client(\"{}\", \"{}\", ", bench.instance, bench.path("run").display());
    let text = std::fs::read_to_string(&shown).expect("own file").replace("Client(", &named);
    std::fs::write(&shown, text).expect("own folder");
    let mut command = program(shown);
    command.env("LOOKOUT_LIBRARY", &library);
    assert!(ok(command).contains('['));
    let mut command = program(example.clone());
    command.env("LOOKOUT_LIBRARY", &library);
    let output = nearest(&bench, command, 20);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains(" disparities"));
    end(daemon);
    let mut without = program(example);
    let output = without.env("LOOKOUT_LIBRARY", "/no/such.so").output().expect("it runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(errors.contains("cargo build --release -p lookout-client-c"), "{errors}");
    bench.assert_clean();
}
