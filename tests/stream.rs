//! `lookout stream`: lines of JSON on standard output and on a Unix socket.

use crate::support::stream::{Stream, connect, frames};
use crate::support::{Bench, Daemon, lines, pid_of};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

fn ended(child: Child) -> Output {
    let output = child.wait_with_output().expect("it can be waited for");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn lines_are_those_of_the_results_and_end_with_a_withdrawal() {
    let bench = Bench::new();
    let recording = bench.record("drive", 30);
    // There is no daemon yet.
    let stream = Stream::start(&bench, &["--topics", "all"]);
    std::thread::sleep(Duration::from_millis(300));
    bench.ok(&["replay", &recording, "--fps", "8", "--out", "out"]);
    // Where the first result is late, one is withdrawn before.
    let is_withdrawn = |line: &Value| line["withdrawn"] == true;
    let got = stream.when(|lines| lines.last().is_some_and(is_withdrawn) && frames(lines).len() > 3);
    let results = lines(&bench.path("out"));
    let mut compared = 0;
    for line in got.iter().filter(|line| line["withdrawn"] == false) {
        assert!(line["latency_ms"].as_f64() > Some(0.0) && line["capture_ns"].as_u64() > Some(0), "{line}");
        let Some(result) = results.iter().find(|result| result["sequence"] == line["sequence"]) else {
            continue;
        };
        for (name, value) in result.as_object().expect("an object") {
            assert_eq!(&line[name], value, "{name} of frame {}", line["sequence"]);
        }
        compared += 1;
    }
    assert!(compared > 3, "{compared} of {} lines were written by the replay, too", got.len());
    // The state of the daemon comes about once a second.
    assert!(got.iter().any(|line| line["status"]["state"] == "running"));
    let last = got.last().expect("a line");
    assert_eq!((&last["alarm"]["level"], &last["obstacles"]), (&"off".into(), &serde_json::json!([])));
    let (_, errors) = stream.stop();
    assert!(errors.contains("is running: waits for one") && errors.contains("reads the daemon"), "{errors}");
    bench.assert_clean();
}

#[test]
fn topics_rate_and_limit_choose_the_lines_and_a_closed_pipe_ends_it() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let daemon = bench.replay_endlessly(&recording, "20");
    let out = bench.ok(&["stream", "--topics", "alarm,motion", "--limit", "2"]);
    let got: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(got.len(), 2);
    frames(&got);
    let mut keys: Vec<_> = got[0].as_object().expect("an object").keys().collect();
    keys.sort();
    assert_eq!(
        keys,
        ["alarm", "capture_ns", "latency_ms", "motion", "run", "sequence", "time_s", "withdrawn"]
    );
    assert!(got[0]["alarm"]["level"].is_string());

    let out = bench.ok(&["stream", "--topics", "status", "--limit", "1"]);
    let status: Value = serde_json::from_str(&out).expect("JSON");
    assert!(status["status"]["processes"].is_array() && status["sequence"].is_null(), "{status}");

    let begin = Instant::now();
    let out = bench.ok(&["stream", "--rate", "2", "--limit", "4"]);
    assert!(begin.elapsed() >= Duration::from_millis(1500) && out.lines().count() == 4, "{out}");

    // `| head -1`
    let mut command = bench.command(&["stream"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
    assert!(line.ends_with("}\n"));
    assert_eq!(String::from_utf8_lossy(&ended(child).stderr), "");

    let wrong = bench.run(&["stream", "--topics", "alarms"]);
    let errors = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(wrong.status.code() == Some(2) && errors.contains("obstacles, pose, status, all"), "{errors}");
    let error = bench.fails(&["stream", "--serve"]);
    assert!(error.contains("stream.socket is empty"), "{error}");
    drop(daemon);
}

/// The daemon on a small scene, and a served socket.
fn serve(bench: &Bench) -> (Daemon, String, Daemon) {
    let socket = bench.path("socket").display().to_string();
    bench.configure(&format!(
        "[source]\nkind = \"scene\"\nfps = 10\n[stream]\nsocket = \"{socket}\"\nmode = \"0600\"\n"
    ));
    let daemon = bench.start(&["run"]);
    let server = bench.start(&["stream", "--serve"]);
    (daemon, socket, server)
}

#[test]
fn readers_of_the_socket_that_stall_or_write_keep_nobody_waiting() {
    let bench = Bench::new();
    let (daemon, socket, server) = serve(&bench);
    let before = bench.status_when(|s| s["state"] == "running");
    // They connect and never read.
    let stalled: Vec<_> = (0..4).map(|_| connect(&socket)).collect();
    let metadata = std::fs::symlink_metadata(&socket).expect("a socket");
    assert!(metadata.file_type().is_socket() && metadata.permissions().mode() & 0o777 == 0o600);
    let mut writer = connect(&socket);
    let mut input = BufReader::new(connect(&socket)).lines();
    let mut got: Vec<Value> = Vec::new();
    // More than what the buffers of a stalled reader hold: about 30 lines of 2 kB.
    while got.iter().filter(|line| line["withdrawn"] == false).count() < 60 {
        let line = input.next().expect("a line").expect("text");
        got.push(serde_json::from_str(&line).expect("JSON"));
    }
    frames(&got);
    // Writing is refused, and changes nothing.
    assert!(writer.write_all(b"{\"alarm\":{\"level\":\"off\"}}\n").is_err());
    let after = bench.status_when(|s| s["frames"].as_u64() > before["frames"].as_u64().map(|n| n + 50));
    for role in ["scheduler", "capture", "stereo", "road", "recognition"] {
        assert_eq!(pid_of(&before, role), pid_of(&after, role), "{role}");
    }
    drop((stalled, writer));
    server.signal("TERM");
    assert!(server.wait().status.success());
    assert!(!std::path::Path::new(&socket).exists());
    // What is still in the buffer is whole lines, but for the last: this reader did not read while the server ended.
    let rest: Vec<String> = input.map_while(Result::ok).collect();
    let whole = &rest[..rest.len().saturating_sub(1)];
    assert!(whole.iter().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{whole:?}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn a_reader_of_the_socket_survives_its_server() {
    let bench = Bench::new();
    let (daemon, socket, server) = serve(&bench);
    let stream = Stream::start(&bench, &["--socket", &socket, "--topics", "alarm"]);
    let first = stream.when(|lines| lines.len() > 3).len();
    // Killed: its file stays, and the next server takes its place.
    server.signal("KILL");
    drop(server);
    let withdrawn = stream.when(|lines| lines[first..].iter().any(|line| line["withdrawn"] == true)).len();
    let server = bench.start(&["stream", "--serve"]);
    let lines = stream.when(|lines| lines.len() > withdrawn + 3);
    assert_eq!(frames(&lines).iter().map(|(run, _)| run).collect::<BTreeSet<_>>().len(), 1);
    assert!(lines.iter().all(|line| line["alarm"].is_object() && line["path"].is_null()), "{lines:?}");
    let (_, errors) = stream.stop();
    assert!(errors.contains("waits for"), "{errors}");
    // A second server does not take the place of the first.
    let error = bench.fails(&["stream", "--serve"]);
    assert!(error.contains("another process serves it"), "{error}");
    for process in [server, daemon] {
        process.signal("TERM");
        assert!(process.wait().status.success());
    }
    assert!(UnixStream::connect(&socket).is_err());
    bench.assert_clean();
}
