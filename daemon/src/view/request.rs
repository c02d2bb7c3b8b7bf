//! Reads the head of an HTTP request, with limits on size and time.

use std::io::{self, ErrorKind, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};
use thiserror::Error;

/// Maximum size of a head, in bytes.
const MAX_HEAD: usize = 8 * 1024;

/// Maximum number of header lines.
const MAX_HEADERS: usize = 64;

/// Headers that a request may contain once.
const ONCE: [&str; 4] = ["Host", "Origin", "Authorization", "Cookie"];

/// Time limit for the whole head.
const TIMEOUT: Duration = Duration::from_secs(5);

/// The head of a request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// Method, such as `GET`.
    pub method: String,
    /// Path without the query.
    pub path: String,
    query: String,
    /// `Host` header: name and port that the client used.
    pub host: String,
    /// `Origin` header: the page that sent the request.
    pub origin: Option<String>,
    cookies: String,
    /// `Authorization` header.
    pub authorization: Option<String>,
    /// `Sec-WebSocket-Key`, if the request is a valid upgrade to a WebSocket.
    pub socket_key: Option<String>,
    /// Size of the head, in bytes.
    pub length: usize,
}

/// Why a request cannot be read.
#[derive(Debug, Error)]
pub enum RequestError {
    /// The connection failed.
    #[error("connection: {0}")]
    Io(#[from] io::Error),
    /// The client closed the connection.
    #[error("closed before a request arrived")]
    Closed,
    /// The text is not HTTP.
    #[error("not an HTTP request: {0}")]
    Syntax(httparse::Error),
    /// A header that decides about access is there twice: which one counts, another program may judge differently.
    #[error("the header {0} is there more than once")]
    Repeated(&'static str),
    /// The head exceeds a limit.
    #[error("the head is longer than {MAX_HEAD} bytes or {MAX_HEADERS} lines")]
    TooLong,
    /// The head did not arrive in time.
    #[error("no complete request within {} s", TIMEOUT.as_secs())]
    TooSlow,
}

impl Request {
    /// Reads a request. Also returns the bytes that arrived after its head.
    ///
    /// # Errors
    /// If no valid request arrives in time.
    pub fn read(stream: &mut TcpStream) -> Result<(Self, Vec<u8>), RequestError> {
        let until = Instant::now() + TIMEOUT;
        let mut bytes = Vec::with_capacity(1024);
        let mut piece = [0; 1024];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(RequestError::TooSlow);
            }
            stream.set_read_timeout(Some(left))?;
            let count = match stream.read(&mut piece) {
                Ok(0) => return Err(RequestError::Closed),
                Ok(count) => count,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Err(RequestError::TooSlow);
                }
                Err(e) => return Err(e.into()),
            };
            bytes.extend_from_slice(&piece[..count]);
            if let Some(request) = Self::parse(&bytes)? {
                let rest = bytes.split_off(request.length);
                return Ok((request, rest));
            }
        }
    }

    /// Parses the request at the start of `bytes`; `None` while its head is incomplete.
    ///
    /// # Errors
    /// If it is not HTTP, or too long.
    pub fn parse(bytes: &[u8]) -> Result<Option<Self>, RequestError> {
        let mut lines = [httparse::EMPTY_HEADER; MAX_HEADERS];
        let mut head = httparse::Request::new(&mut lines);
        let length = match head.parse(bytes) {
            Ok(httparse::Status::Complete(length)) if length <= MAX_HEAD => length,
            Ok(httparse::Status::Partial) if bytes.len() < MAX_HEAD => return Ok(None),
            Ok(_) | Err(httparse::Error::TooManyHeaders) => return Err(RequestError::TooLong),
            Err(error) => return Err(RequestError::Syntax(error)),
        };
        let target = head.path.unwrap_or("/");
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let mut request = Self {
            method: head.method.unwrap_or_default().to_owned(),
            path: path.to_owned(),
            query: query.to_owned(),
            length,
            ..Self::default()
        };
        let (mut upgrades, mut key, mut version) = (false, None, false);
        for name in ONCE {
            if head.headers.iter().filter(|line| line.name.eq_ignore_ascii_case(name)).count() > 1 {
                return Err(RequestError::Repeated(name));
            }
        }
        for line in head.headers.iter() {
            // Headers that are not UTF-8 are ignored.
            let Ok(value) = std::str::from_utf8(line.value) else { continue };
            match line.name.to_ascii_lowercase().as_str() {
                "host" => request.host = value.to_owned(),
                "origin" => request.origin = Some(value.to_owned()),
                "cookie" => request.cookies = value.to_owned(),
                "authorization" => request.authorization = Some(value.to_owned()),
                "upgrade" => upgrades = value.eq_ignore_ascii_case("websocket"),
                "sec-websocket-key" => key = Some(value.to_owned()),
                "sec-websocket-version" => version = value == "13",
                _ => {}
            }
        }
        request.socket_key = key.filter(|_| upgrades && version);
        Ok(Some(request))
    }

    /// A value in the query, without decoding.
    pub fn query_value(&self, name: &str) -> Option<&str> {
        self.query
            .split('&')
            .find_map(|pair| pair.split_once('=').filter(|(n, _)| *n == name).map(|(_, v)| v))
    }

    /// The value of a cookie.
    pub fn cookie(&self, name: &str) -> Option<&str> {
        self.cookies
            .split(';')
            .find_map(|pair| pair.trim().split_once('=').filter(|(n, _)| *n == name).map(|(_, v)| v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_read_whole_or_not_at_all() {
        let text = b"GET /socket?token=a&b=c HTTP/1.1\r\nHost: x:1\r\nUpgrade: WebSocket\r\n\
                     Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: abc\r\nCookie: q=1; r=2\r\n\r\nrest";
        for end in 0..text.len() - 4 {
            assert!(Request::parse(&text[..end]).unwrap().is_none(), "{end}");
        }
        let request = Request::parse(text).unwrap().unwrap();
        assert_eq!((request.method.as_str(), request.path.as_str()), ("GET", "/socket"));
        assert_eq!((request.host.as_str(), request.socket_key.as_deref()), ("x:1", Some("abc")));
        assert_eq!((request.query_value("b"), request.query_value("d")), (Some("c"), None));
        assert_eq!((request.cookie("r"), request.cookie("2")), (Some("2"), None));
        assert_eq!(&text[request.length..], b"rest");
    }

    #[test]
    fn too_much_is_refused() {
        let long = format!("GET / HTTP/1.1\r\nX: {}", "y".repeat(MAX_HEAD));
        assert!(matches!(Request::parse(long.as_bytes()), Err(RequestError::TooLong)));
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "X: y\r\n".repeat(MAX_HEADERS + 1));
        assert!(matches!(Request::parse(many.as_bytes()), Err(RequestError::TooLong)));
        assert!(matches!(Request::parse(b"\x16\x03\x01\x02\x00\x01"), Err(RequestError::Syntax(_))));
    }

    #[test]
    fn headers_that_decide_about_access_come_once() {
        for name in ONCE {
            let text =
                format!("GET / HTTP/1.1\r\n{name}: a\r\nX: y\r\n{}: \u{e4}\r\n\r\n", name.to_uppercase());
            let error = Request::parse(text.as_bytes()).unwrap_err();
            assert!(matches!(error, RequestError::Repeated(named) if named == name), "{error}");
        }
        assert!(Request::parse(b"GET / HTTP/1.1\r\nHost: a\r\nX: y\r\nX: y\r\n\r\n").unwrap().is_some());
    }

    #[test]
    fn random_bytes_do_no_harm() {
        let seed = 5;
        println!("seed {seed}");
        let mut random = fastrand::Rng::with_seed(seed);
        let good = b"GET /a?b=c HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n\r\n".to_vec();
        for _ in 0..20_000 {
            let mut bytes = good.clone();
            for _ in 0..random.usize(1..5) {
                let at = random.usize(0..bytes.len());
                bytes[at] = random.u8(..);
            }
            if let Ok(Some(request)) = Request::parse(&bytes) {
                assert!(request.length <= bytes.len());
            }
        }
    }
}
