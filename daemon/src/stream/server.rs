//! Serves the socket: a limited number of clients, each with a thread that sends it the newest line. Clients can read
//! and nothing else: what they send is never read.

use super::latest::Latest;
use super::sender::{self, Terms};
use rustix::net::sockopt::{set_socket_send_buffer_size, socket_peercred};
use serde_json::json;
use std::io::{self, Write};
use std::net::Shutdown;
use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of clients. Each has a thread.
const MAX_CLIENTS: usize = 16;

/// Maximum number of clients of one user: half of all, so that one user cannot keep out another.
const MAX_CLIENTS_OF_USER: usize = 8;

/// A client that takes no byte of a line for this long loses its place.
const STALL: Duration = Duration::from_secs(10);

/// A client that has not taken a whole line after this time loses its place.
const MAX_SENDING: Duration = Duration::from_secs(60);

/// Send buffer of a client in bytes: what a slow client may have before it of frames that are no longer the newest.
const BUFFER: usize = 32 << 10;

/// Stack of a client's thread in bytes.
const STACK: usize = 256 << 10;

/// Pause after a connection could not be accepted, possibly for lack of file descriptors.
const RETRY: Duration = Duration::from_millis(200);

/// Longest wait for clients to get the end of their line.
const GOODBYE: Duration = Duration::from_secs(1);

/// Users of the connected clients.
#[derive(Debug, Default)]
struct Places(Mutex<Vec<u32>>);

impl Places {
    fn users(&self) -> std::sync::MutexGuard<'_, Vec<u32>> {
        // A poisoned lock is usable: every update leaves the list consistent.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a place for a user.
    ///
    /// # Errors
    /// Why there is none.
    fn enter(self: &Arc<Self>, user: u32) -> Result<Place, String> {
        let mut users = self.users();
        if users.len() >= MAX_CLIENTS {
            return Err(format!("there are {MAX_CLIENTS} readers already"));
        }
        if users.iter().filter(|u| **u == user).count() >= MAX_CLIENTS_OF_USER {
            return Err(format!("this user has {MAX_CLIENTS_OF_USER} readers already"));
        }
        users.push(user);
        Ok(Place { places: Arc::clone(self), user })
    }
}

/// The place of a client; given back when dropped.
#[derive(Debug)]
struct Place {
    places: Arc<Places>,
    user: u32,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut users = self.places.users();
        if let Some(at) = users.iter().position(|u| *u == self.user) {
            users.swap_remove(at);
        }
    }
}

/// Serves a socket.
#[derive(Debug)]
pub struct Server {
    latest: Arc<Latest>,
    stop: Arc<AtomicBool>,
    places: Arc<Places>,
}

impl Server {
    /// A server of the lines in `latest`.
    pub fn new(latest: Arc<Latest>, stop: Arc<AtomicBool>) -> Self {
        Self { latest, stop, places: Arc::default() }
    }

    /// Accepts clients on a thread of its own, as long as the process lives.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(self: Arc<Self>, listener: UnixListener) -> io::Result<()> {
        let accept = move || {
            loop {
                let accepted = listener.accept().and_then(|(client, _)| self.admit(client));
                if let Err(error) = accepted {
                    tracing::warn!(%error, "cannot serve a reader");
                    std::thread::sleep(RETRY);
                }
            }
        };
        std::thread::Builder::new().name("server".into()).stack_size(STACK).spawn(accept).map(|_| ())
    }

    /// Waits until all clients have got the end of their line, for a while.
    pub fn say_goodbye(&self) {
        let begin = Instant::now();
        while !self.places.users().is_empty() && begin.elapsed() < GOODBYE {
            std::thread::sleep(GOODBYE / 50);
        }
    }

    /// Serves a client on a thread of its own, if there is room.
    fn admit(&self, mut client: UnixStream) -> io::Result<()> {
        client.set_nonblocking(true)?;
        let peer = socket_peercred(&client)?;
        let place = match self.places.enter(peer.uid.as_raw()) {
            Ok(place) => place,
            Err(why) => {
                // An empty send buffer takes a short line at once.
                let _ = writeln!(client, "{}", json!({ "refused": why }));
                return Ok(());
            }
        };
        // What a client writes fails at once, and is never read.
        client.shutdown(Shutdown::Read)?;
        set_socket_send_buffer_size(&client, BUFFER)?;
        let (latest, stop) = (Arc::clone(&self.latest), Arc::clone(&self.stop));
        let terms = Terms { patience: Some((STALL, MAX_SENDING)), ..Terms::default() };
        let serve = move || {
            let end = sender::run(client.as_fd(), &latest, &terms, &stop);
            tracing::debug!(user = place.user, ?end, "a reader has left");
            drop(client);
            drop(place);
        };
        std::thread::Builder::new().name("client".into()).stack_size(STACK).spawn(serve).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader, Read};

    const LONG: Duration = Duration::from_secs(120);

    #[test]
    fn places_are_limited_for_each_user_and_for_all() {
        let places = Arc::new(Places::default());
        let of_one: Vec<_> = (0..MAX_CLIENTS_OF_USER).map(|_| places.enter(1).unwrap()).collect();
        assert!(places.enter(1).unwrap_err().contains("this user has 8"));
        let of_two: Vec<_> = (0..MAX_CLIENTS - of_one.len()).map(|_| places.enter(2).unwrap()).collect();
        assert!(places.enter(3).unwrap_err().contains("16 readers"));
        drop(of_one);
        assert!(places.enter(3).is_ok());
        drop(of_two);
        assert!(places.users().is_empty());
    }

    #[test]
    fn readers_get_the_newest_line_and_can_do_nothing_but_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let (latest, stop) = (Arc::new(Latest::default()), Arc::new(AtomicBool::new(false)));
        let server = Arc::new(Server::new(Arc::clone(&latest), Arc::clone(&stop)));
        Arc::clone(&server).start(UnixListener::bind(&path).unwrap()).unwrap();
        let connect = || {
            let client = UnixStream::connect(&path).unwrap();
            client.set_read_timeout(Some(LONG)).unwrap();
            client
        };
        let wait_for = |count: usize| {
            let begin = Instant::now();
            while server.places.users().len() != count {
                assert!(begin.elapsed() < LONG, "{count} readers");
                std::thread::yield_now();
            }
        };
        let mut clients: Vec<_> = (0..MAX_CLIENTS_OF_USER).map(|_| connect()).collect();
        wait_for(MAX_CLIENTS_OF_USER);
        let mut refused = String::new();
        connect().read_to_string(&mut refused).unwrap();
        assert_eq!(refused, "{\"refused\":\"this user has 8 readers already\"}\n");
        // The sender of the first may not have begun to read.
        let begin = Instant::now();
        let mut writer = clients.remove(0);
        while writer.write_all(b"{\"alarm\":\"off\"}\n").is_ok() {
            assert!(begin.elapsed() < LONG, "a client could write");
        }
        let readers: Vec<_> = clients.into_iter().map(BufReader::new).collect();
        let mut line = String::new();
        let mut number = 0;
        for mut reader in readers {
            // A reader that has just come may have missed the line of the one before.
            reader.get_ref().set_read_timeout(Some(Duration::from_millis(100))).unwrap();
            line.clear();
            while !line.ends_with('\n') {
                assert!(begin.elapsed() < LONG, "no line came");
                number += 1;
                latest.frame(format!("{{\"a\":{number}"));
                let _ = reader.read_line(&mut line);
            }
            let value: serde_json::Value = serde_json::from_str(&line).unwrap();
            assert!(value["a"].as_u64() <= Some(number), "{line}");
        }
        drop(writer);
        wait_for(0);
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        server.say_goodbye();
    }
}
