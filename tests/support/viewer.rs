//! A viewer for a test, and a client without a browser.

use crate::support::{Bench, WATCHDOG, send};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// `lookout view` in the background.
pub struct Viewer {
    child: Child,
    /// Address and port.
    pub address: String,
    /// The link that it printed.
    pub link: String,
}

impl Viewer {
    /// Starts it on a free port, or where `more` says.
    pub fn start(bench: &Bench, more: &[&str]) -> Self {
        let mut args = vec!["view"];
        if !more.contains(&"--bind") {
            args.extend(["--bind", "127.0.0.1:0"]);
        }
        args.extend(more);
        Self::spawn(&mut bench.command(&args))
    }

    /// Starts it with a command of its own.
    pub fn spawn(command: &mut std::process::Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the binary starts");
        let mut line = String::new();
        let out = child.stdout.take().expect("its output is piped");
        BufReader::new(out).read_line(&mut line).expect("it says where it is");
        let link = line.split_whitespace().last().expect("a link").to_owned();
        let address = link.trim_start_matches("http://").split('/').next().expect("an address").to_owned();
        Self { child, address, link }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends bytes, gives all that comes back until the connection is closed.
    pub fn raw(&self, request: &[u8]) -> String {
        let mut stream = TcpStream::connect(&self.address).expect("it listens");
        stream.set_read_timeout(Some(WATCHDOG)).expect("a time limit");
        // A server that does not read to the end may close before all is written.
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// Gets a path as a browser would, with more header lines.
    pub fn get(&self, path: &str, more: &str) -> String {
        self.raw(format!("GET {path} HTTP/1.1\r\nHost: {}\r\n{more}\r\n", self.address).as_bytes())
    }

    /// Opens a WebSocket.
    pub fn socket(&self) -> Client {
        let stream = TcpStream::connect(&self.address).expect("it listens");
        stream.set_read_timeout(Some(WATCHDOG)).expect("a time limit");
        let request = format!("ws://{}/socket", self.address).into_client_request().expect("a request");
        Client { socket: tungstenite::client::client(request, stream).expect("a WebSocket").0 }
    }

    /// Asks it to end, and expects that it does well.
    pub fn stop(mut self) {
        send(self.pid(), "TERM");
        assert!(self.child.wait().expect("it can be waited for").success());
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A page without a browser.
pub struct Client {
    socket: WebSocket<TcpStream>,
}

impl Client {
    /// Sends a ping, if the connection is still there.
    pub fn ping(&mut self) {
        let _ = self.socket.send(Message::Ping(Vec::new().into()));
    }

    /// Asks for everything, and leaves the answer where it is.
    pub fn ask_only(&mut self) {
        let question = r#"{"want":["left","disparity","v_disparity","points"],"frames":true}"#;
        self.socket.send(Message::text(question)).expect("it takes a question");
    }

    /// Asks for everything; gives the figures and the bytes of each part.
    pub fn ask(&mut self) -> (Value, Vec<Vec<u8>>) {
        self.ask_only();
        let bytes = loop {
            match self.socket.read().expect("it answers") {
                Message::Binary(bytes) => break bytes,
                _ => continue,
            }
        };
        let length = u32::from_le_bytes(bytes[..4].try_into().expect("four bytes")) as usize;
        let answer: Value = serde_json::from_slice(&bytes[4..4 + length]).expect("it is JSON");
        let mut at = 4 + length;
        let parts = answer["parts"].as_array().expect("parts").iter().map(|part| {
            let end = at + part["bytes"].as_u64().expect("a length") as usize;
            let part = bytes[at..end].to_vec();
            at = end;
            part
        });
        let parts = parts.collect();
        assert_eq!(at, bytes.len());
        (answer, parts)
    }

    /// Asks until a frame comes.
    pub fn frame(&mut self) -> (Value, Vec<Vec<u8>>) {
        let start = std::time::Instant::now();
        loop {
            let (mut answer, parts) = self.ask();
            if !answer["frame"].is_null() {
                return (answer["frame"].take(), parts);
            }
            assert!(start.elapsed() < WATCHDOG, "no frame ever came: {answer}");
        }
    }
}
