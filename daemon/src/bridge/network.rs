//! The network: a session with liveliness tokens, answers to requests, and the sender. Only this thread waits for it.

use super::answers::Answers;
use super::feed::Events;
use super::keys::Keys;
use super::outbox::{Form, Item, Outbox};
use super::settings::reason;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::ros2::names::{Node, TOPICS};
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

/// Time between two attempts to reach the network.
const RETRY: Duration = Duration::from_secs(2);

/// Longest wait for a message, after which connection and stopping are checked.
const WAIT: Duration = Duration::from_millis(100);

/// An event counts as sent when the connection has lasted for so long after it: as long as zenoh takes to notice a
/// connection that is dead (the default lease of a link).
const SETTLE: Duration = Duration::from_secs(10);

/// Connects, and sends.
pub struct Network {
    /// The session's configuration.
    pub config: zenoh::Config,
    /// The keys of the vehicle.
    pub keys: Keys,
    /// The node, where messages of ROS 2 are sent.
    pub node: Option<Node>,
    /// What is sent.
    pub outbox: Arc<Outbox>,
    /// Events, which are sent from the disk.
    pub events: Arc<Events>,
    /// Answers requests.
    pub answers: Arc<Answers>,
    /// Set to stop it.
    pub stop: Arc<AtomicBool>,
}

/// What is known of the events that were handed to the network.
#[derive(Debug)]
struct Progress {
    /// The last entry that was handed over.
    handed: u64,
    /// Entries that were handed over, and when.
    unsettled: VecDeque<(Instant, u64)>,
}

impl Progress {
    fn new(sent: u64) -> Self {
        Self { handed: sent, unsettled: VecDeque::new() }
    }

    fn hand(&mut self, number: u64, now: Instant) {
        self.handed = number;
        self.unsettled.push_back((now, number));
    }

    /// The last entry that the connection has outlived.
    fn settled(&mut self, now: Instant) -> Option<u64> {
        let mut settled = None;
        while let Some((at, number)) = self.unsettled.front() {
            if now.duration_since(*at) < SETTLE {
                break;
            }
            settled = Some(*number);
            self.unsettled.pop_front();
        }
        settled
    }
}

impl Network {
    /// Connects and sends until it is stopped.
    pub fn run(&self) {
        let mut told = None;
        while !self.stop.load(Ordering::Relaxed) {
            match zenoh::open(self.config.clone()).wait() {
                Ok(session) => {
                    told = None;
                    if let Err(error) = self.serve(&session) {
                        tracing::error!("zenoh: {}", reason(&error));
                    }
                    let _ = session.close().wait();
                }
                Err(error) => {
                    let text = reason(&error);
                    if told.as_ref() != Some(&text) {
                        tracing::warn!("no network: {text}");
                        told = Some(text);
                    }
                }
            }
            let begin = Instant::now();
            while begin.elapsed() < RETRY && !self.stop.load(Ordering::Relaxed) {
                std::thread::sleep(WAIT);
            }
        }
    }

    /// Sends until it is stopped, or the session is closed.
    fn serve(&self, session: &Session) -> zenoh::Result<()> {
        let _queryables = self.answers.declare(session, &self.keys)?;
        let _tokens = self.tokens(session)?;
        let mut progress = Progress::new(self.events.spool().sent());
        let mut was_connected = false;
        while !self.stop.load(Ordering::Relaxed) && !session.is_closed() {
            let is_connected = is_connected(session);
            self.outbox.connected(is_connected);
            if is_connected != was_connected {
                was_connected = is_connected;
                let what = if is_connected { "connected" } else { "the connection has ended" };
                tracing::info!("zenoh: {what}");
                // What the dead connection took may be lost: once more from the last that has settled.
                progress = Progress::new(self.events.spool().sent());
            }
            if !is_connected {
                std::thread::sleep(WAIT);
                continue;
            }
            self.send_events(session, &mut progress);
            if let Some(settled) = progress.settled(Instant::now()) {
                self.events.spool().set_sent(settled);
            }
            if let Some(item) = self.outbox.pop(WAIT) {
                let is_sent = put(session, &item).is_ok();
                self.outbox.count(item.topic, is_sent);
            }
        }
        self.outbox.connected(false);
        Ok(())
    }

    fn send_events(&self, session: &Session, progress: &mut Progress) {
        while !self.stop.load(Ordering::Relaxed) {
            let spool = self.events.spool();
            let Some(entry) = spool.after(progress.handed) else { return };
            let content = spool.read(&entry);
            drop(spool);
            let (topic, key, encoding) = match entry.frame {
                None => ("events", self.keys.event(entry.event), Encoding::APPLICATION_JSON),
                Some(frame) => ("pictures", self.keys.picture(entry.event, frame), Encoding::IMAGE_JPEG),
            };
            let is_sent = content.is_ok_and(|content| {
                let put = session.put(key, content).encoding(encoding).priority(Priority::DataHigh);
                put.congestion_control(CongestionControl::Block).wait().is_ok()
            });
            if !is_sent && session.is_closed() {
                return;
            }
            progress.hand(entry.number, Instant::now());
            self.outbox.count(topic, is_sent);
        }
    }

    /// The tokens by which others see that the vehicle is there.
    fn tokens(&self, session: &Session) -> zenoh::Result<Vec<LivelinessToken>> {
        let mut keys = vec![self.keys.alive()];
        if let Some(node) = &self.node {
            let id = session.zid().to_string();
            keys.push(node.token(&id));
            let publishers = TOPICS.iter().enumerate();
            keys.extend(publishers.map(|(i, (last, of))| node.publisher_token(&id, i + 1, last, of)));
        }
        keys.into_iter().map(|key| session.liveliness().declare_token(key).wait()).collect()
    }
}

/// Whether anybody is connected.
pub fn is_connected(session: &Session) -> bool {
    let info = session.info();
    info.routers_zid().wait().next().is_some() || info.peers_zid().wait().next().is_some()
}

fn put(session: &Session, item: &Item) -> zenoh::Result<()> {
    let encoding = match item.form {
        Form::Json => Encoding::APPLICATION_JSON,
        Form::Cdr => Encoding::APPLICATION_CDR,
    };
    // What does not pass blocks this thread alone; the outbox drops and counts meanwhile.
    let put = session.put(&item.key, &item.payload).encoding(encoding);
    put.congestion_control(CongestionControl::Block).attachment(item.attachment.as_ref()).wait()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_count_as_sent_when_the_connection_has_outlived_them() {
        let begin = Instant::now();
        let mut progress = Progress::new(3);
        progress.hand(4, begin);
        progress.hand(5, begin + SETTLE / 2);
        assert_eq!((progress.handed, progress.settled(begin + SETTLE / 2)), (5, None));
        assert_eq!(progress.settled(begin + SETTLE), Some(4));
        assert_eq!(progress.settled(begin + 2 * SETTLE), Some(5));
        assert_eq!(progress.settled(begin + 3 * SETTLE), None);
    }
}
