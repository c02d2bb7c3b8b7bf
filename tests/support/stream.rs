//! `lookout stream` for a test.

use super::{Bench, WATCHDOG, send};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// `lookout stream` in the background. Every line must be a JSON object, also the last one.
pub struct Stream {
    child: Child,
    lines: Arc<Mutex<Vec<Value>>>,
}

impl Stream {
    pub fn start(bench: &Bench, args: &[&str]) -> Self {
        Self::spawn(&mut bench.command(&[&["stream"], args].concat()))
    }

    /// Starts it with a command of its own.
    pub fn spawn(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        let lines = Arc::new(Mutex::new(Vec::new()));
        let output = child.stdout.take().expect("a pipe");
        let read = Arc::clone(&lines);
        std::thread::spawn(move || {
            let mut input = BufReader::new(output);
            let mut line = String::new();
            while input.read_line(&mut line).expect("text") > 0 {
                let value = match line.strip_suffix('\n').map(serde_json::from_str) {
                    Some(Ok(Value::Object(fields))) => Value::Object(fields),
                    _ => Value::String(format!("a broken line: {line:?}")),
                };
                read.lock().expect("a list").push(value);
                line.clear();
            }
        });
        Self { child, lines }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    pub fn lines(&self) -> Vec<Value> {
        let lines = self.lines.lock().expect("a list").clone();
        assert!(lines.iter().all(Value::is_object), "{:?}", lines.iter().find(|line| !line.is_object()));
        lines
    }

    /// The lines, once `wanted` is true of them.
    pub fn when(&self, wanted: impl Fn(&[Value]) -> bool) -> Vec<Value> {
        let begin = Instant::now();
        loop {
            let lines = self.lines();
            if wanted(&lines) {
                return lines;
            }
            assert!(begin.elapsed() < WATCHDOG, "the wanted lines never came: {:?}", lines.last());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Asks it to end, which succeeds; gives standard error.
    pub fn stop(self) -> (Vec<Value>, String) {
        send(self.pid(), "TERM");
        let output = self.child.wait_with_output().expect("it can be waited for");
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{errors}");
        let lines = self.lines.lock().expect("a list").clone();
        (lines, errors)
    }
}

/// Frames in lines: run and sequence of those that withdraw nothing. None comes twice, and those of a run in order.
pub fn frames(lines: &[Value]) -> Vec<(String, u64)> {
    let of_frames = lines.iter().filter(|line| line["withdrawn"] == false);
    let frames: Vec<_> = of_frames
        .map(|line| {
            (line["run"].as_str().expect("a run").to_owned(), line["sequence"].as_u64().expect("a number"))
        })
        .collect();
    let unique: BTreeSet<_> = frames.iter().collect();
    assert_eq!(unique.len(), frames.len(), "a frame came twice: {frames:?}");
    for pair in frames.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        assert!(pair[1].1 > pair[0].1, "{pair:?}");
    }
    frames
}

/// Connects to a socket, once it is there.
pub fn connect(socket: &str) -> UnixStream {
    let begin = Instant::now();
    loop {
        if let Ok(client) = UnixStream::connect(socket) {
            client.set_read_timeout(Some(WATCHDOG)).expect("a time");
            return client;
        }
        assert!(begin.elapsed() < WATCHDOG, "the socket never came");
        std::thread::sleep(Duration::from_millis(20));
    }
}
