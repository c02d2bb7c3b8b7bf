//! The places of connections. Whoever has not proven that it may ask can neither exhaust them nor keep others out: a
//! new connection always gets a place, if need be that of the connection that has failed to finish its request for
//! longest. Those that have proven it have places of their own.

use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, Ipv6Addr, Shutdown, TcpStream};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Maximum number of connections whose request is not complete, or not authorised. Each has a thread.
const MAX_UNPROVEN: usize = 32;

/// Maximum number of connections with an authorised request that is being answered. Each has a thread.
const MAX_PROVEN: usize = 32;

/// Maximum number of pages of one remote address: half of all, so that one device cannot keep out another. Addresses of
/// this machine have no such limit, because all that comes through ssh has the same.
const MAX_PAGES_OF_ADDRESS: usize = 4;

/// Longest wait for a connection that was shut down to be gone, before it is checked again.
const RECHECK: Duration = Duration::from_millis(100);

/// What a connection has achieved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    /// It has not sent a complete, authorised request.
    Unproven,
    /// Its authorised request is being answered.
    Proven,
    /// It is a page, which stays.
    Page,
}

impl Class {
    fn limit(self) -> usize {
        match self {
            Self::Unproven => MAX_UNPROVEN,
            Self::Proven => MAX_PROVEN,
            // The hub limits the pages.
            Self::Page => usize::MAX,
        }
    }
}

#[derive(Debug)]
struct Connection {
    number: u64,
    address: IpAddr,
    class: Class,
    stream: TcpStream,
    /// It was shut down, and its thread is about to end.
    is_evicted: bool,
}

#[derive(Debug, Default)]
struct State {
    next: u64,
    /// Oldest first.
    connections: Vec<Connection>,
}

impl State {
    fn count(&self, class: Class) -> usize {
        self.connections.iter().filter(|c| c.class == class).count()
    }

    /// Shuts down the oldest connection of the address that has most in a class, unless one is about to end already.
    fn make_room(&mut self, class: Class) {
        let of_class = || self.connections.iter().filter(|c| c.class == class);
        if of_class().any(|c| c.is_evicted) {
            return;
        }
        let mut counts = HashMap::<IpAddr, usize>::new();
        of_class().for_each(|c| *counts.entry(c.address).or_default() += 1);
        let most = counts.values().max().copied();
        let victim =
            self.connections.iter_mut().find(|c| c.class == class && counts.get(&c.address).copied() == most);
        if let Some(victim) = victim {
            victim.is_evicted = true;
            // Its thread waits for the client alone, and is woken by this.
            let _ = victim.stream.shutdown(Shutdown::Both);
        }
    }
}

/// All connections of a server.
#[derive(Debug, Default)]
pub struct Connections {
    state: Mutex<State>,
    changed: Condvar,
}

/// The place of one connection; given back when it is dropped.
#[derive(Debug)]
pub struct Place<'a> {
    connections: &'a Connections,
    number: u64,
}

/// Devices with one IPv6 network of 64 bits can use any of its addresses.
fn group(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64)),
        v4 => v4,
    }
}

impl Connections {
    fn state(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every update leaves the state consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until there is a place in a class, and makes one.
    fn with_room(&self, class: Class) -> MutexGuard<'_, State> {
        let mut state = self.state();
        while state.count(class) >= class.limit() {
            state.make_room(class);
            state = self.changed.wait_timeout(state, RECHECK).unwrap_or_else(PoisonError::into_inner).0;
        }
        state
    }

    /// Admits a new connection; returns its number for [`Self::place`], and whether another one had to leave.
    ///
    /// # Errors
    /// If its socket cannot be shared, for lack of file descriptors.
    pub fn admit(&self, stream: &TcpStream, address: IpAddr) -> io::Result<(u64, bool)> {
        let stream = stream.try_clone()?;
        let is_full = self.state().count(Class::Unproven) >= MAX_UNPROVEN;
        let mut state = self.with_room(Class::Unproven);
        let number = state.next;
        state.next += 1;
        let (address, class) = (group(address), Class::Unproven);
        state.connections.push(Connection { number, address, class, stream, is_evicted: false });
        Ok((number, is_full))
    }

    /// The place of an admitted connection.
    pub fn place(&self, number: u64) -> Place<'_> {
        Place { connections: self, number }
    }
}

impl Place<'_> {
    /// The request was authorised. Returns false if the connection had to leave meanwhile.
    pub fn proven(&self) -> bool {
        let mut state = self.connections.with_room(Class::Proven);
        let own = state.connections.iter_mut().find(|c| c.number == self.number && !c.is_evicted);
        let is_here = own.map(|c| c.class = Class::Proven).is_some();
        drop(state);
        self.connections.changed.notify_all();
        is_here
    }

    /// The connection becomes a page, and stays as long as it asks. Returns false if its address has too many.
    pub fn page(&self) -> bool {
        let mut state = self.connections.state();
        let Some(at) = state.connections.iter().position(|c| c.number == self.number && !c.is_evicted) else {
            return false;
        };
        let address = state.connections[at].address;
        let pages =
            state.connections.iter().filter(|c| c.class == Class::Page && c.address == address).count();
        // The group of ::1 is ::.
        let is_own = address.is_loopback() || address.is_unspecified();
        if !is_own && pages >= MAX_PAGES_OF_ADDRESS {
            return false;
        }
        state.connections[at].class = Class::Page;
        drop(state);
        self.connections.changed.notify_all();
        true
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.connections.state().connections.retain(|c| c.number != self.number);
        self.connections.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::net::TcpListener;

    fn pair() -> (TcpStream, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        (listener.accept().unwrap().0, client)
    }

    /// A connection whose thread waits for its client, as those of the server do; returns whether it was authorised.
    fn serve<'scope>(
        scope: &'scope std::thread::Scope<'scope, '_>,
        connections: &'scope Connections,
        address: &str,
    ) -> (TcpStream, std::thread::ScopedJoinHandle<'scope, bool>) {
        let (mut server, client) = pair();
        let (number, _) = connections.admit(&server, address.parse().unwrap()).unwrap();
        let waiting = scope.spawn(move || {
            let place = connections.place(number);
            server.read(&mut [0]).unwrap_or(0) == 1 && place.proven()
        });
        (client, waiting)
    }

    #[test]
    fn the_oldest_of_the_busiest_address_leaves() {
        use std::io::Write;
        let connections = Connections::default();
        std::thread::scope(|scope| {
            let (mut old, old_served) = serve(scope, &connections, "192.0.2.1");
            let slow: Vec<_> =
                (0..3 * MAX_UNPROVEN).map(|_| serve(scope, &connections, "192.0.2.2")).collect();
            assert_eq!(connections.state().count(Class::Unproven), MAX_UNPROVEN);
            // It is the oldest of all, but its address has only this one.
            old.write_all(b"x").unwrap();
            assert!(old_served.join().unwrap());
            // From the same address: the newest stays longest.
            let (mut last, last_served) = serve(scope, &connections, "192.0.2.2");
            last.write_all(b"x").unwrap();
            assert!(last_served.join().unwrap());
            drop((slow, last));
        });
        assert!(connections.state().connections.is_empty());
    }

    #[test]
    fn pages_are_limited_for_each_remote_address() {
        let connections = Connections::default();
        let (server, _client) = pair();
        let admit = |address: &str| {
            let (number, _) = connections.admit(&server, address.parse().unwrap()).unwrap();
            connections.place(number)
        };
        let phone: Vec<_> = (0..MAX_PAGES_OF_ADDRESS).map(|i| admit(&format!("2001:db8::{i}"))).collect();
        assert!(phone.iter().all(Place::page));
        let more = admit("2001:db8::99");
        assert!(!more.page(), "the same network");
        assert!(admit("2001:db8:0:1::").page() && admit("::ffff:192.0.2.1").page());
        drop(phone);
        assert!(more.page());
        for own in ["127.0.0.1", "::1"] {
            let pages: Vec<_> = (0..2 * MAX_PAGES_OF_ADDRESS).map(|_| admit(own)).collect();
            assert!(pages.iter().all(Place::page), "{own}");
        }
    }
}
