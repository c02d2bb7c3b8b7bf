//! Follows a daemon through shared memory, run after run.

use super::notice::Notice;
use super::runs::{Entry, Runs};
use super::topics::POSE;
use crate::frame_record::frame_record;
use crate::status_json::StatusJson;
use messages::bus::{Bus, IpcError};
use messages::instance::Instance;
use messages::obstacles::Newest;
use messages::port::{Sample, Subscriber};
use messages::silence;
use messages::wait::{self, Next};
use messages::{obstacles, service, status};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::reporting::record::tidy;

/// Period of checking whether a daemon runs, and whether to stop.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Follows an instance.
pub struct Follower {
    name: String,
    directory: PathBuf,
    runs: Runs,
    stop: Arc<AtomicBool>,
    notice: Notice,
    refused: u64,
}

/// One run that is being followed.
struct Run {
    id: String,
    newest: Newest,
    /// Time of the last status.
    heard: Instant,
    checked: Instant,
}

impl Follower {
    /// A follower of the instance `name` in `directory`, as the configuration has them.
    pub fn new(name: &str, directory: &Path, runs: Runs, stop: Arc<AtomicBool>) -> Self {
        let (name, directory) = (name.to_owned(), directory.to_owned());
        Self { name, directory, runs, stop, notice: Notice::default(), refused: 0 }
    }

    /// Follows until it is stopped. It waits for a daemon that is not there.
    pub fn run(&mut self) {
        while !self.stop.load(Ordering::Relaxed) {
            // Each time, because the folder of a service appears with the daemon.
            let instance = Instance::find(&self.name, &self.directory);
            let result = match why_absent(&instance) {
                Some(why) => Err(why),
                None => self.follow(&instance),
            };
            if self.stop.load(Ordering::Relaxed) {
                break;
            }
            match result {
                Ok(()) => {
                    self.runs.end("the daemon has ended");
                    self.notice.waits(absent(&instance));
                }
                Err(why) => {
                    self.runs.end(&why);
                    self.notice.waits(why);
                }
            }
            std::thread::sleep(CHECK_PERIOD);
        }
    }

    /// Follows one run to its end.
    fn follow(&mut self, instance: &Instance) -> Result<(), String> {
        match self.follow_run(instance) {
            Err(error) if instance.is_running() => Err(error.to_string()),
            // Its memory is removed when it ends, also while it is being read.
            Ok(()) | Err(_) => Ok(()),
        }
    }

    fn follow_run(&mut self, instance: &Instance) -> Result<(), IpcError> {
        let Some(prefix) = instance.prefix() else { return Ok(()) };
        let bus = Bus::join(instance)?;
        let results = bus.subscriber(&service::OBSTACLES)?;
        let statuses = bus.subscriber(&service::STATUS)?;
        self.notice.goes_on(&format!("reads the daemon \"{}\"", instance.name()));
        let now = Instant::now();
        let mut run = Run { id: prefix.id().to_owned(), newest: Newest::default(), heard: now, checked: now };
        wait::run::<IpcError>(&[&results, &statuses], || {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Next::Stop);
            }
            if run.checked.elapsed() >= CHECK_PERIOD {
                run.checked = Instant::now();
                if !instance.is_running() || instance.prefix().as_ref() != Some(&prefix) {
                    return Ok(Next::Stop);
                }
                if run.heard.elapsed() > silence::TIMEOUT
                    && let Some(reason) = silence::reason(instance)
                {
                    self.runs.end(&reason);
                    self.notice.waits(reason);
                }
            }
            self.take_statuses(&statuses, &mut run)?;
            while let Some(sample) = results.receive()? {
                self.take_result(&sample, &mut run);
            }
            Ok(Next::Wait(CHECK_PERIOD))
        })
    }

    fn refuse(&mut self, service: &str, error: &dyn std::fmt::Display) {
        if self.refused == 0 {
            tracing::warn!(service, %error, "message refused; further ones are only counted");
        }
        self.refused += 1;
    }

    fn take_statuses(&mut self, statuses: &Subscriber, run: &mut Run) -> Result<(), IpcError> {
        while let Some(sample) = statuses.receive()? {
            let status = match status::view(sample.header(), sample.payload()) {
                Ok(status) => status,
                Err(error) => {
                    self.refuse("status", &error);
                    continue;
                }
            };
            run.heard = Instant::now();
            self.notice.goes_on(&format!("the daemon \"{}\" answers again", self.name));
            if !self.runs.is_read() {
                self.runs.skip_status();
            } else if self.runs.has_status() {
                match serde_json::to_string(&StatusJson::new(&status)) {
                    Ok(json) => self.runs.status(&run.id, &json),
                    Err(error) => self.refuse("status", &error),
                }
            }
        }
        Ok(())
    }

    fn take_result(&mut self, sample: &Sample, run: &mut Run) {
        let header = sample.header();
        let message = match obstacles::view(header, sample.payload()) {
            Ok(message) => message,
            Err(error) => return self.refuse("obstacles", &error),
        };
        if !run.newest.accepts(header) || !self.runs.has_frames() {
            return;
        }
        let withdrawn = header.withdraws == 1;
        // Without readers nothing is converted.
        if !withdrawn && !self.runs.is_read() {
            return self.runs.skip(&run.id, header.sequence, header.source_ns as f64 * 1e-9);
        }
        match Entry::new(&run.id, &frame_record(header, &message), withdrawn) {
            Ok(mut entry) => {
                entry.fields.insert("capture_ns".into(), header.capture_ns.into());
                if !withdrawn && header.motion.has_pose() {
                    let (position, orientation) = (header.motion.position_m, header.motion.orientation);
                    let pose = serde_json::json!({
                        "position_m": position.map(tidy), "orientation": orientation.map(tidy),
                        "resets": header.motion.resets,
                    });
                    entry.fields.insert(POSE.into(), pose);
                }
                if !withdrawn {
                    let latency_ms = tidy(header.latency_ns() as f64 * 1e-6);
                    entry.fields.insert("latency_ms".into(), latency_ms.into());
                }
                self.runs.publish(&entry);
            }
            Err(error) => self.refuse("obstacles", &error),
        }
    }
}

fn absent(instance: &Instance) -> String {
    format!("no daemon named \"{}\" is running: waits for one", instance.name())
}

/// Why there is no daemon to read.
fn why_absent(instance: &Instance) -> Option<String> {
    // The daemon that is waited for may be another user's.
    if let Err(error) = instance.check_owner() {
        return Some(error.to_string());
    }
    let is_there = instance.is_running() && instance.prefix().is_some();
    (!is_there).then(|| absent(instance))
}
