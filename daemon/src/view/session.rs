//! The WebSocket of one client. The client sends a request, gets one response, and sends the next request
//! after displaying it. At most one response is in flight, so a slow client gets fewer frames, each the newest.
//!
//! A request is JSON text, `{"want": ["left", "points"], "frames": true}`. A response is binary: the length
//! of its JSON (u32, little-endian), the JSON, then the parts that the JSON lists, one after the other.

use super::frame::{FrameLine, Part};
use super::history::Sample;
use super::hub::{Hub, News, Seen};
use crate::status_json::StatusJson;
use messages::pipeline::{PATH, PATH_LENGTH, Role};
use serde::{Deserialize, Serialize};
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role as End, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// Maximum length of a request, in bytes.
const MAX_REQUEST: usize = 1024;

/// A response is sent after this time at the latest, even if nothing is new.
const MAX_WAIT: Duration = Duration::from_secs(1);

/// A client that sends no request for this long is disconnected; pings and parts of a request do not count. A paused
/// page still requests statuses.
const SILENCE: Duration = Duration::from_secs(30);

/// A client that reads nothing of a response for this long is disconnected.
const STALL: Duration = Duration::from_secs(10);

/// A client that has not read a whole response after this time is disconnected: 1 MB at 17 kB/s.
const MAX_SENDING: Duration = Duration::from_secs(60);

/// A connection with time limits that single bytes do not prolong.
struct Limited {
    stream: TcpStream,
    /// Until when a request has to be complete.
    asked_until: Instant,
    /// Until when a response has to be taken.
    taken_until: Instant,
}

impl Limited {
    /// A limit for one system call: until `until`, at most `most`.
    fn left(until: Instant, most: Duration) -> io::Result<Option<Duration>> {
        let left = until.saturating_duration_since(Instant::now()).min(most);
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(Some(left)) }
    }
}

impl Read for Limited {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Self::left(self.asked_until, Duration::MAX)?)?;
        self.stream.read(bytes)
    }
}

impl Write for Limited {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Self::left(self.taken_until, STALL)?)?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// A request of a client.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Request {
    /// Names of the parts that the page shows.
    want: Vec<String>,
    /// Whether frames are requested, or only statuses.
    frames: bool,
}

#[derive(Serialize)]
struct Response<'a> {
    absent: Option<&'a str>,
    frame: Option<&'a FrameLine>,
    status: Option<StatusJson>,
    history: Vec<Sample>,
    /// Names of the stages, in the order of their times.
    stages: [&'static str; PATH_LENGTH],
    parts: Vec<PartLine>,
}

#[derive(Serialize)]
struct PartLine {
    name: &'static str,
    bytes: usize,
}

/// Serves a client until it leaves, or is silent for too long.
pub fn run(stream: TcpStream, already_read: Vec<u8>, hub: &Hub) {
    run_with(stream, already_read, hub, SILENCE);
}

fn run_with(stream: TcpStream, already_read: Vec<u8>, hub: &Hub, silence: Duration) {
    if stream.set_nodelay(true).is_err() {
        return;
    }
    let now = Instant::now();
    let stream = Limited { stream, asked_until: now + silence, taken_until: now + MAX_SENDING };
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_REQUEST))
        .max_frame_size(Some(MAX_REQUEST))
        .read_buffer_size(4 * 1024)
        .write_buffer_size(0);
    let mut socket = WebSocket::from_partially_read(stream, already_read, End::Server, Some(config));
    let mut seen = Seen::default();
    loop {
        // Answers to pings count as a response, too.
        socket.get_mut().taken_until = Instant::now() + MAX_SENDING;
        let request = match socket.read() {
            Ok(Message::Text(text)) => serde_json::from_str::<Request>(&text).unwrap_or_default(),
            // Pings are answered by the library.
            Ok(Message::Ping(_) | Message::Pong(_) | Message::Frame(_)) => continue,
            Ok(Message::Binary(_) | Message::Close(_)) | Err(_) => break,
        };
        let news = hub.wait(&mut seen, request.frames, MAX_WAIT);
        let bytes = response(&news, &request.want);
        let length = bytes.len() as u64;
        socket.get_mut().taken_until = Instant::now() + MAX_SENDING;
        match socket.send(Message::binary(bytes)) {
            Ok(()) => {
                hub.counters.sent.fetch_add(1, Ordering::Relaxed);
                hub.counters.sent_bytes.fetch_add(length, Ordering::Relaxed);
            }
            Err(Error::Io(e)) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                hub.counters.too_slow.fetch_add(1, Ordering::Relaxed);
                return;
            }
            Err(_) => return,
        }
        socket.get_mut().asked_until = Instant::now() + silence;
    }
    let _ = socket.close(None);
    let _ = socket.flush();
}

fn response(news: &News, want: &[String]) -> Vec<u8> {
    let frame = news.frame.as_deref();
    let wanted = |part: &Part| want.iter().any(|name| name == part.name());
    let parts: Vec<(Part, &[u8])> = frame.map_or_else(Vec::new, |frame| {
        Part::ALL.into_iter().filter(wanted).map(|part| (part, frame.part(part))).collect()
    });
    let (status, history) = match &news.status {
        Some((status, history)) => (Some(StatusJson::new(status)), history.clone()),
        None => (None, Vec::new()),
    };
    let response = Response {
        absent: news.absent.as_deref(),
        frame: frame.map(super::frame::Frame::line),
        status,
        history,
        stages: PATH.map(Role::name),
        parts: parts.iter().map(|(p, bytes)| PartLine { name: p.name(), bytes: bytes.len() }).collect(),
    };
    // Serialisation cannot fail for these types; a client would just request again after an empty response.
    let json = serde_json::to_vec(&response).unwrap_or_default();
    let length: usize = parts.iter().map(|(_, bytes)| bytes.len()).sum();
    let mut bytes = Vec::with_capacity(4 + json.len() + length);
    bytes.extend_from_slice(&(json.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&json);
    for (_, part) in parts {
        bytes.extend_from_slice(part);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use tungstenite::protocol::CloseFrame;

    /// A server for one client, and the client.
    fn with_client(act: impl FnOnce(&mut WebSocket<TcpStream>)) {
        with_client_and(SILENCE, act);
    }

    fn with_client_and(silence: Duration, act: impl FnOnce(&mut WebSocket<TcpStream>)) {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let hub = Hub::new();
        std::thread::scope(|scope| {
            let served = scope.spawn(|| run_with(listener.accept().unwrap().0, Vec::new(), &hub, silence));
            let stream = TcpStream::connect(address).unwrap();
            act(&mut WebSocket::from_raw_socket(stream, End::Client, None));
            served.join().unwrap();
        });
    }

    fn request(socket: &mut WebSocket<TcpStream>, text: &str) -> serde_json::Value {
        socket.send(Message::text(text)).unwrap();
        let bytes = socket.read().unwrap().into_data();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), 4 + length);
        serde_json::from_slice(&bytes[4..]).unwrap()
    }

    #[test]
    fn one_response_for_each_request() {
        with_client(|socket| {
            let response = request(socket, r#"{"want": ["left", "nothing"], "frames": true}"#);
            assert_eq!((&response["absent"], &response["frame"]), (&"no daemon yet".into(), &().into()));
            // Text that is not a valid request counts as an empty one.
            assert_eq!(request(socket, "?")["absent"], "no daemon yet");
            let away: Option<CloseFrame> = None;
            socket.close(away).unwrap();
        });
    }

    #[test]
    fn a_long_request_closes_the_connection() {
        with_client(|socket| {
            let _ = socket.send(Message::text("x".repeat(MAX_REQUEST + 1)));
            assert!(socket.read().is_err() || socket.read().is_err());
        });
    }

    #[test]
    fn only_requests_prolong_a_connection() {
        let silence = Duration::from_millis(400);
        // Longer than the limit, in parts that are shorter.
        let parts = || (0..10).map(|_| std::thread::sleep(silence / 5));
        with_client_and(silence, |socket| {
            for () in parts().take(3) {
                assert_eq!(request(socket, "{}")["absent"], "no daemon yet");
            }
            parts().for_each(|()| {
                // Fails once the server has gone.
                let _ = socket.send(Message::Ping(Vec::new().into()));
            });
            while socket.read().is_ok() {}
        });
        with_client_and(silence, |socket| {
            // The head of a text of 100 bytes, then one byte at a time.
            let _ = socket.get_mut().write_all(&[0x81, 0x80 | 100, 0, 0, 0, 0]);
            parts().for_each(|()| {
                let _ = socket.get_mut().write_all(b"x");
            });
            while socket.read().is_ok() {}
        });
    }
}
