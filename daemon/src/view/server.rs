//! The HTTP server: a limited number of connections ([`Connections`]), each with its own thread and one request.

use super::access::{Access, Verdict};
use super::connections::{Connections, Place};
use super::hub::Hub;
use super::request::{Request, RequestError};
use super::{metrics, prometheus, session};
use crate::status_json::StatusJson;
use std::io::{self, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tungstenite::handshake::derive_accept_key;

/// Maximum number of simultaneous WebSocket clients.
const MAX_CLIENTS: usize = 8;

/// Time limit for a client to read a response.
const STALL: Duration = Duration::from_secs(10);

/// Stack of a connection's thread.
const STACK_BYTES: usize = 512 * 1024;

/// The files of the page: path, content type, contents.
const FILES: [(&str, &str, &str); 5] = [
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/style.css", "text/css; charset=utf-8", include_str!("page/style.css")),
    ("/app.js", "text/javascript; charset=utf-8", include_str!("page/app.js")),
    ("/draw.js", "text/javascript; charset=utf-8", include_str!("page/draw.js")),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

/// Security headers: only scripts and styles of this server are allowed, and no embedding in other pages.
const POLICY: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
     img-src 'self' blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
     X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n\
     Cross-Origin-Resource-Policy: same-origin\r\n";

/// Serves the page.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    access: Access,
    hub: Arc<Hub>,
    connections: Connections,
}

impl Server {
    /// Binds the address; [`Self::run`] accepts connections.
    ///
    /// # Errors
    /// If the address cannot be bound.
    pub fn bind(
        address: SocketAddr,
        access: impl FnOnce(SocketAddr) -> Access,
        hub: Arc<Hub>,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let access = access(listener.local_addr()?);
        Ok(Self { listener, access, hub, connections: Connections::default() })
    }

    /// The bound address, with the port that the system chose for port 0.
    ///
    /// # Errors
    /// If the system does not report it.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts connections forever.
    pub fn run(self: Arc<Self>) {
        loop {
            let (stream, client) = match self.listener.accept() {
                Ok(accepted) => accepted,
                Err(error) => {
                    // Possibly too many open files: retried after a pause.
                    tracing::warn!(%error, "cannot accept a connection");
                    std::thread::sleep(Duration::from_millis(200));
                    continue;
                }
            };
            let (number, instead) = match self.connections.admit(&stream, client.ip()) {
                Ok(admitted) => admitted,
                Err(error) => {
                    tracing::warn!(%error, "cannot serve a connection");
                    continue;
                }
            };
            if instead {
                self.turned_away();
            }
            let server = Arc::clone(&self);
            let thread = std::thread::Builder::new().name("client".into()).stack_size(STACK_BYTES);
            let spawned = thread.spawn(move || {
                let place = server.connections.place(number);
                server.serve(stream, &place);
            });
            if let Err(error) = spawned {
                drop(self.connections.place(number));
                tracing::warn!(%error, "cannot start a thread for a connection");
            }
        }
    }

    fn turned_away(&self) {
        self.hub.counters.turned_away.fetch_add(1, Ordering::Relaxed);
    }

    /// Serves one connection. Errors concern only this client and are not logged.
    fn serve(&self, mut stream: TcpStream, place: &Place<'_>) {
        if stream.set_write_timeout(Some(STALL)).is_err() {
            return;
        }
        let (request, rest) = match Request::read(&mut stream) {
            Ok(read) => read,
            Err(RequestError::Io(_) | RequestError::Closed) => return,
            Err(error) => {
                let status = match error {
                    RequestError::TooSlow => "408 Request Timeout",
                    RequestError::TooLong => "431 Request Header Fields Too Large",
                    _ => "400 Bad Request",
                };
                let _ = answer(&stream, status, TEXT, "", &format!("{error}\n"), true);
                // Closing with unread input would reset the connection before the client reads the response.
                let _ = stream.shutdown(Shutdown::Write);
                return;
            }
        };
        if request.path == "/socket" {
            self.socket(stream, &request, rest, place);
        } else {
            let _ = self.page(&stream, &request, place);
        }
    }

    fn page(&self, stream: &TcpStream, request: &Request, place: &Place<'_>) -> io::Result<()> {
        let with_body = request.method != "HEAD";
        if !matches!(request.method.as_str(), "GET" | "HEAD") {
            return answer(
                stream,
                "405 Method Not Allowed",
                TEXT,
                "Allow: GET, HEAD\r\n",
                "only GET\n",
                true,
            );
        }
        let verdict = self.access.judge(request);
        if matches!(verdict, Verdict::Welcome | Verdict::WelcomeByLink) && !place.proven() {
            return Ok(());
        }
        match verdict {
            Verdict::Welcome => {}
            Verdict::WelcomeByLink if request.path == "/" => {
                let cookie = self.access.set_cookie().unwrap_or_default();
                let more = format!("Location: /\r\nSet-Cookie: {cookie}\r\n");
                return answer(stream, "303 See Other", TEXT, &more, "", with_body);
            }
            Verdict::WelcomeByLink => {}
            Verdict::NoToken => {
                self.turned_away();
                let text = "open the link that lookout view has printed: it contains the token\n";
                return answer(
                    stream,
                    "401 Unauthorized",
                    TEXT,
                    "WWW-Authenticate: Bearer\r\n",
                    text,
                    with_body,
                );
            }
            Verdict::Foreign => {
                self.turned_away();
                let text = "the request names a host, or comes from a page, that is not this viewer's own: open \
                            http://127.0.0.1 with its port, or start lookout view with --token\n";
                return answer(stream, "403 Forbidden", TEXT, "", text, with_body);
            }
        }
        if let Some((_, kind, text)) = FILES.iter().find(|(path, ..)| *path == request.path) {
            return answer(stream, "200 OK", kind, "", text, with_body);
        }
        match request.path.as_str() {
            "/metrics" => {
                let (status, second) = self.hub.now();
                let text = metrics::text(status.as_ref(), second.as_ref(), &self.hub);
                answer(stream, "200 OK", prometheus::CONTENT_TYPE, "", &text, with_body)
            }
            "/status.json" => match self.hub.now().0 {
                Some(status) => {
                    let text = serde_json::to_string(&StatusJson::new(&status)).unwrap_or_default();
                    answer(stream, "200 OK", "application/json", "", &text, with_body)
                }
                None => answer(stream, "503 Service Unavailable", TEXT, "", "no daemon\n", with_body),
            },
            _ => answer(stream, "404 Not Found", TEXT, "", "not found: try / or /metrics\n", with_body),
        }
    }

    fn socket(&self, stream: TcpStream, request: &Request, rest: Vec<u8>, place: &Place<'_>) {
        let refuse = |status: &str, text: &str| {
            self.turned_away();
            let _ = answer(&stream, status, TEXT, "", text, true);
        };
        let Some(key) = &request.socket_key else {
            return refuse("426 Upgrade Required", "this is a WebSocket, version 13\n");
        };
        if !matches!(self.access.judge(request), Verdict::Welcome | Verdict::WelcomeByLink) {
            return refuse("403 Forbidden", "request from another page, or without the token\n");
        }
        let Some(_client) = self.hub.enter(MAX_CLIENTS) else {
            return refuse("503 Service Unavailable", "too many clients\n");
        };
        if !place.page() {
            return refuse("503 Service Unavailable", "too many clients of this address\n");
        }
        let accept = derive_accept_key(key.as_bytes());
        let head = format!(
            "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Accept: {accept}\r\n\r\n"
        );
        if (&stream).write_all(head.as_bytes()).is_ok() {
            session::run(stream, rest, &self.hub);
        }
    }
}

const TEXT: &str = "text/plain; charset=utf-8";

fn answer(
    mut stream: &TcpStream,
    status: &str,
    kind: &str,
    more: &str,
    body: &str,
    with_body: bool,
) -> io::Result<()> {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n\
         Connection: close\r\n{POLICY}{more}\r\n"
    );
    stream.write_all(head.as_bytes())?;
    if with_body {
        stream.write_all(body.as_bytes())?;
    }
    stream.flush()
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_page_has_the_colours_of_overlays() {
        use tools::reporting::palette::{BOUNDARY, CAUSE, CONFIRMED, FREE, PATH, UNCONFIRMED};
        let style = include_str!("page/style.css");
        let rules = [
            (".box.cause rect { stroke: ", CAUSE),
            (".box.confirmed rect { stroke: ", CONFIRMED),
            (".box rect { fill: none; stroke: ", UNCONFIRMED),
            (".way { fill: none; stroke: ", PATH),
            ("#boxes .boundary polygon { fill: ", BOUNDARY),
            ("#boxes .free { fill: ", FREE),
            (".legend .l-cause::before { background: ", CAUSE),
            (".legend .l-confirmed::before { background: ", CONFIRMED),
            (".legend .l-unconfirmed::before { background: ", UNCONFIRMED),
            (".legend .l-path::before { background: ", PATH),
            (".legend .l-boundary::before { background: ", BOUNDARY),
            (".legend .l-free::before { background: ", FREE),
        ];
        for (rule, [r, g, b]) in rules {
            let whole = format!("{rule}#{r:02x}{g:02x}{b:02x}");
            assert!(style.contains(&whole), "{whole}");
        }
    }
}
