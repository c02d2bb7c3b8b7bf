//! `lookout bridge`: results for fleets and for ROS 2, over zenoh. A process of its own that reads the daemon as any other
//! reader does, at the lowest priority.
//!
//! ```text
//! stream::follower ─▶ stream::latest ─▶ feed, ros2 ─▶ outbox ─▶ network ─▶ zenoh
//! camera (rig, pictures) ─────────────────┘ └─▶ spool (events) ─▶┘ └▶ answers
//! ```
//!
//! The outbox is bounded, and the spool is: whatever the network does, nothing but this process waits for it.

mod answers;
mod camera;
mod changes;
mod feed;
pub mod fleet;
mod keys;
mod network;
mod outbox;
mod ros2;
mod settings;
mod spool;

use crate::stages::whole_number::whole;
use crate::stream::follower::Follower;
use crate::stream::latest::{Latest, Seen};
use crate::stream::line::Fields;
use crate::stream::runs::Runs;
use crate::stream::topics::{STATUS, Topics};
use answers::Answers;
use camera::Camera;
use config::Config;
use feed::{Events, Feed};
use network::Network;
use outbox::Outbox;
use ros2::Ros;
use serde_json::Value;
use settings::SettingsError;
use spool::Spool;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use thiserror::Error;

/// Longest wait for a line, after which stopping is checked.
const WAIT: Duration = Duration::from_millis(250);

/// Why the bridge cannot run.
#[derive(Debug, Error)]
pub enum BridgeError {
    /// The configuration cannot be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The folder of events cannot be used.
    #[error("bridge.spool = {}: {source}{}", folder.display(), remedy(source))]
    Spool {
        /// The folder.
        folder: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A thread cannot be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] io::Error),
    /// A thread has failed.
    #[error("a thread of the bridge has failed: see the log")]
    Failed,
}

fn remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::WouldBlock => ": another lookout bridge uses it: end that, or name another vehicle",
        _ => ": name a folder that this user can write",
    }
}

/// Runs until `stop` is set.
///
/// # Errors
/// If the configuration or the folder of events cannot be used.
pub fn run(config: &Config, stop: &Arc<AtomicBool>) -> Result<(), BridgeError> {
    let settings = &config.bridge;
    let (vehicle, keys) = (settings::vehicle(settings)?, settings::keys(settings)?);
    let session = settings::session(config, true)?;
    let folder = settings::spool(settings)?;
    let spool = Spool::open(&folder, settings::spool_bytes(settings))
        .map_err(|source| BridgeError::Spool { folder, source })?;
    let events = Arc::new(Events::new(spool));
    let outbox = Arc::new(Outbox::new(settings::buffer_bytes(settings)));
    let period = Duration::from_millis(whole(settings.picture_period_ms));
    let camera = Arc::new(Camera::new(whole(settings.pictures), period));
    let of_cloud = settings.cloud.then(|| Arc::clone(&camera));
    let (answers, requests) = Answers::new(keys.clone(), Arc::clone(&events), of_cloud);
    let answers = Arc::new(answers);
    let network = Network {
        config: session,
        keys: keys.clone(),
        node: settings.ros2.then(|| ros2::node(settings, &vehicle)),
        outbox: Arc::clone(&outbox),
        events: Arc::clone(&events),
        answers: Arc::clone(&answers),
        stop: Arc::clone(stop),
    };
    let of_ros = || Ros::new(settings, &vehicle, Arc::clone(&outbox), Arc::clone(&camera));
    let (mut ros, mut ros_pictures) = (settings.ros2.then(of_ros), settings.ros2.then(of_ros));
    let images_hz = if settings.ros2 { settings.ros2_images_hz } else { 0.0 };
    let follower = camera::Follower {
        name: config.instance.name.clone(),
        directory: config.instance.directory.clone(),
        with_pictures: settings.pictures > 0 || settings.cloud || images_hz > 0.0,
        camera: Arc::clone(&camera),
        stop: Arc::clone(stop),
    };
    let mut feed = Feed::new(settings, keys, Arc::clone(&events), outbox, camera);
    let latest = Arc::new(Latest::default());
    let runs = Runs::new(Arc::clone(&latest), Topics::all());
    let mut lines = Follower::new(&config.instance.name, &config.instance.directory, runs, Arc::clone(stop));
    thread::scope(|scope| {
        // Also when a thread cannot be started.
        let _stop = StopAtEnd(Arc::clone(stop));
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            let stop = Arc::clone(stop);
            thread::Builder::new().name(name.into()).spawn_scoped(scope, move || {
                let _stop = StopAtEnd(stop);
                work();
            })
        };
        let threads = [
            spawn("network", Box::new(move || network.run()))?,
            spawn(
                "answers",
                Box::new({
                    let answers = Arc::clone(&answers);
                    move || answers.run(requests, stop)
                }),
            )?,
            spawn("camera", Box::new(|| follower.run(|picture| events.add_picture(&picture))))?,
            spawn("lines", Box::new(move || lines.run()))?,
        ];
        let pictures = (images_hz > 0.0).then(|| {
            thread::Builder::new().name("pictures".into()).spawn_scoped(scope, move || {
                if let Some(ros) = &mut ros_pictures {
                    ros.run_pictures(images_hz, stop);
                }
            })
        });
        let pictures = pictures.transpose()?;
        take_lines(&latest, &mut feed, &mut ros, &answers, stop);
        let joined = threads.into_iter().chain(pictures).map(thread::ScopedJoinHandle::join);
        if joined.filter(Result::is_err).count() > 0 { Err(BridgeError::Failed) } else { Ok(()) }
    })
}

/// Stops the process when a thread ends, for whatever reason.
struct StopAtEnd(Arc<AtomicBool>);

impl Drop for StopAtEnd {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Takes line after line until it is stopped.
fn take_lines(latest: &Latest, feed: &mut Feed, ros: &mut Option<Ros>, answers: &Answers, stop: &AtomicBool) {
    let _reader = latest.reader();
    let mut seen = Seen::default();
    let mut told = None;
    while !stop.load(Ordering::Relaxed) {
        if let Some(line) = latest.next(&mut seen, WAIT)
            && let Ok(mut fields) = serde_json::from_str::<Fields>(&line)
        {
            let status = fields.remove(STATUS);
            if fields.contains_key("sequence") {
                feed.frame(&fields);
                if let Some(ros) = ros {
                    ros.frame(&fields);
                }
            }
            if let (Some(status), Some(run)) = (status, fields.get("run").and_then(Value::as_str)) {
                feed.status(run, status);
            }
        }
        if told.is_none_or(|at: Instant| at.elapsed() >= WAIT) {
            told = Some(Instant::now());
            answers.set_state(feed.state());
        }
        feed.send_state();
        if let Some(ros) = ros {
            ros.state(|| feed.state());
        }
    }
}
