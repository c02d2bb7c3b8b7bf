//! One client's WebSocket. It asks, is answered once, and asks again when it has shown that: so no more
//! than one answer is ever under way, and a slow client gets fewer frames, each the newest.
//!
//! A question is JSON text, `{"want": ["left", "points"], "frames": true}`. An answer is binary: the length
//! of its JSON (u32, little-endian), the JSON, then the parts that it lists, one after the other.

use super::frame::{FrameLine, Part};
use super::history::Sample;
use super::hub::{Hub, News, Seen};
use crate::status_json::StatusJson;
use messages::pipeline::{PATH, PATH_LENGTH, Role};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tungstenite::protocol::{Role as End, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// The longest question.
const MAX_QUESTION: usize = 1024;

/// An answer comes after this at the latest, news or not.
const PATIENCE: Duration = Duration::from_secs(1);

/// A client that asks nothing for this long is gone. One that pauses asks for states still.
const SILENCE: Duration = Duration::from_secs(30);

/// A client that takes nothing of an answer for this long is let go.
const STALL: Duration = Duration::from_secs(10);

/// What a client asks.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Question {
    /// Names of the parts that it shows.
    want: Vec<String>,
    /// Whether it wants frames, or only states.
    frames: bool,
}

#[derive(Serialize)]
struct Answer<'a> {
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

/// Serves a client until it leaves.
pub fn run(stream: TcpStream, already_read: Vec<u8>, hub: &Hub) {
    let timeouts =
        stream.set_read_timeout(Some(SILENCE)).and_then(|()| stream.set_write_timeout(Some(STALL)));
    if timeouts.and_then(|()| stream.set_nodelay(true)).is_err() {
        return;
    }
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_QUESTION))
        .max_frame_size(Some(MAX_QUESTION))
        .read_buffer_size(4 * 1024)
        .write_buffer_size(0);
    let mut socket = WebSocket::from_partially_read(stream, already_read, End::Server, Some(config));
    let mut seen = Seen::default();
    loop {
        let question = match socket.read() {
            Ok(Message::Text(text)) => serde_json::from_str::<Question>(&text).unwrap_or_default(),
            // Pings are answered by the library.
            Ok(Message::Ping(_) | Message::Pong(_) | Message::Frame(_)) => continue,
            Ok(Message::Binary(_) | Message::Close(_)) | Err(_) => break,
        };
        let news = hub.wait(&mut seen, question.frames, PATIENCE);
        let bytes = answer(&news, &question.want);
        let length = bytes.len() as u64;
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
    }
    let _ = socket.close(None);
    let _ = socket.flush();
}

fn answer(news: &News, want: &[String]) -> Vec<u8> {
    let frame = news.frame.as_deref();
    let wanted = |part: &Part| want.iter().any(|name| name == part.name());
    let parts: Vec<(Part, &[u8])> = frame.map_or_else(Vec::new, |frame| {
        Part::ALL.into_iter().filter(wanted).map(|part| (part, frame.part(part))).collect()
    });
    let (status, history) = match &news.status {
        Some((status, history)) => (Some(StatusJson::new(status)), history.clone()),
        None => (None, Vec::new()),
    };
    let answer = Answer {
        absent: news.absent.as_deref(),
        frame: frame.map(super::frame::Frame::line),
        status,
        history,
        stages: PATH.map(Role::name),
        parts: parts.iter().map(|(p, bytes)| PartLine { name: p.name(), bytes: bytes.len() }).collect(),
    };
    // Nothing in it can fail to be JSON; an empty answer would only be asked for again.
    let json = serde_json::to_vec(&answer).unwrap_or_default();
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
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let hub = Hub::new();
        std::thread::scope(|scope| {
            let served = scope.spawn(|| run(listener.accept().unwrap().0, Vec::new(), &hub));
            let stream = TcpStream::connect(address).unwrap();
            act(&mut WebSocket::from_raw_socket(stream, End::Client, None));
            served.join().unwrap();
        });
    }

    fn ask(socket: &mut WebSocket<TcpStream>, question: &str) -> serde_json::Value {
        socket.send(Message::text(question)).unwrap();
        let bytes = socket.read().unwrap().into_data();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), 4 + length);
        serde_json::from_slice(&bytes[4..]).unwrap()
    }

    #[test]
    fn one_answer_for_each_question() {
        with_client(|socket| {
            let answer = ask(socket, r#"{"want": ["left", "nothing"], "frames": true}"#);
            assert_eq!((&answer["absent"], &answer["frame"]), (&"no daemon yet".into(), &().into()));
            // What is no question is one for nothing.
            assert_eq!(ask(socket, "?")["absent"], "no daemon yet");
            let away: Option<CloseFrame> = None;
            socket.close(away).unwrap();
        });
    }

    #[test]
    fn a_long_question_ends_it() {
        with_client(|socket| {
            let _ = socket.send(Message::text("x".repeat(MAX_QUESTION + 1)));
            assert!(socket.read().is_err() || socket.read().is_err());
        });
    }
}
