//! Messages of ROS 2: made from the same lines, and from pictures.

use super::camera::{Camera, Picture};
use super::outbox::{Form, Item, Outbox};
use super::settings::period;
use crate::stages::whole_number::whole;
use crate::stream::line::Fields;
use crate::stream::topics::POSE;
use config::Bridge;
use messages::clock::monotonic_ns;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tools::reporting::record::FrameRecord;
use tools::ros2::messages::{self as ros, Diagnostic, Level, Pose, Time};
use tools::ros2::names::{Node, TOPICS, attachment};

/// Period of diagnostics, as ROS has them.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// Longest wait for a picture, after which stopping is checked.
const WAIT: Duration = Duration::from_millis(250);

/// What the messages of a topic carry with them.
#[derive(Clone, Debug)]
struct Publisher {
    key: String,
    identity: [u8; 16],
    number: i64,
}

/// Sends messages of ROS 2.
pub struct Ros {
    publishers: BTreeMap<&'static str, Publisher>,
    vehicle: String,
    period: Option<Duration>,
    due: Instant,
    diagnostics_due: Instant,
    outbox: Arc<Outbox>,
    camera: Arc<Camera>,
}

/// The node of a vehicle.
pub fn node(settings: &Bridge, vehicle: &str) -> Node {
    Node::of_vehicle(whole(settings.ros2_domain), &settings.fleet, vehicle)
}

/// Identity of a publisher, the same after a restart: its key, condensed (FNV-1a in two halves).
fn identity(key: &str) -> [u8; 16] {
    const OFFSETS: [u64; 2] = [0xcbf2_9ce4_8422_2325, 0x8422_2325_cbf2_9ce4];
    let mut identity = [0; 16];
    for (half, offset) in identity.chunks_exact_mut(8).zip(OFFSETS) {
        let hash =
            key.bytes().fold(offset, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        half.copy_from_slice(&hash.to_le_bytes());
    }
    identity
}

impl Ros {
    /// A sender for a vehicle.
    pub fn new(settings: &Bridge, vehicle: &str, outbox: Arc<Outbox>, camera: Arc<Camera>) -> Self {
        let node = node(settings, vehicle);
        let publisher = |(last, of): (&'static str, _)| {
            let key = node.key(last, &of);
            (last, Publisher { identity: identity(&key), key, number: 0 })
        };
        let now = Instant::now();
        Self {
            publishers: TOPICS.into_iter().map(publisher).collect(),
            vehicle: vehicle.into(),
            period: period(settings.ros2_hz),
            due: now,
            diagnostics_due: now,
            outbox,
            camera,
        }
    }

    fn push(&mut self, topic: &'static str, payload: Vec<u8>, keeps: bool) {
        let Some(publisher) = self.publishers.get_mut(topic) else { return };
        publisher.number += 1;
        let time_ns = i64::try_from(now_ns()).unwrap_or(i64::MAX);
        let attachment = Some(attachment(publisher.number, time_ns, publisher.identity));
        self.outbox.push(Item {
            topic,
            key: publisher.key.clone(),
            payload,
            form: Form::Cdr,
            attachment,
            keeps,
        });
    }

    /// Takes the fields of a line.
    pub fn frame(&mut self, fields: &Fields) {
        let Some(period) = self.period else { return };
        let now = Instant::now();
        let withdrawn = fields.get("withdrawn") == Some(&Value::Bool(true));
        if now < self.due && !withdrawn {
            return;
        }
        self.due = (self.due + period).clamp(now, now + period);
        let Ok(record) = serde_json::from_value::<FrameRecord>(Value::Object(fields.clone())) else { return };
        let time = time_of(fields.get("capture_ns").and_then(Value::as_u64).unwrap_or(0));
        if let Some(rig) = self.camera.rig() {
            self.push("detections", ros::detections(time, &record, &rig), true);
        }
        if let Some(pose) = fields.get(POSE).and_then(pose)
            && let Some(odometry) = ros::odometry(time, &pose, &record.motion)
        {
            self.push("odometry", odometry, true);
        }
    }

    /// Sends the state (as on the key `status`) once a second.
    pub fn state(&mut self, state: impl FnOnce() -> Value) {
        let now = Instant::now();
        if now < self.diagnostics_due {
            return;
        }
        self.diagnostics_due = (self.diagnostics_due + DIAGNOSTICS_PERIOD).max(now);
        let message = ros::diagnostics(Time(now_ns()), &self.vehicle, &diagnostics(&state()["status"]));
        self.push("diagnostics", message, true);
    }

    /// Sends a picture with its map.
    fn picture(&mut self, picture: &Picture) {
        let time = time_of(picture.capture_ns);
        self.push("image", ros::image(time, picture.size, &picture.left), false);
        if let Some(rig) = self.camera.rig() {
            let disparities = self.camera.disparities();
            let map = ros::disparity(time, picture.size, &picture.disparity, &rig, disparities);
            self.push("disparity", map, false);
        }
    }

    /// Sends pictures at a rate until it is stopped.
    pub fn run_pictures(&mut self, hertz: f64, stop: &AtomicBool) {
        let Some(period) = period(hertz) else { return };
        let mut due = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let early = due.saturating_duration_since(Instant::now());
            if !early.is_zero() {
                std::thread::sleep(early.min(WAIT));
                continue;
            }
            let (sender, receiver) = sync_channel(1);
            if !self.camera.request(sender) {
                std::thread::sleep(WAIT);
                continue;
            }
            while !stop.load(Ordering::Relaxed) {
                if let Ok(picture) = receiver.recv_timeout(WAIT) {
                    self.picture(&picture);
                    due = (due + period).max(Instant::now());
                    break;
                }
            }
        }
    }
}

fn pose(pose: &Value) -> Option<Pose> {
    let position_m = serde_json::from_value(pose["position_m"].clone()).ok()?;
    let orientation = serde_json::from_value(pose["orientation"].clone()).ok()?;
    Some(Pose { position_m, orientation })
}

/// Time since 1970, in ns.
fn now_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64)
}

/// Time since 1970 of a time of CLOCK_MONOTONIC; now for none.
fn time_of(monotonic: u64) -> Time {
    let age = if monotonic == 0 { 0 } else { monotonic_ns().saturating_sub(monotonic) };
    Time(now_ns().saturating_sub(age))
}

/// The daemon's state, and those of its processes.
fn diagnostics(status: &Value) -> Vec<Diagnostic> {
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned);
    let values = |of: &Value, names: &[&str]| {
        names.iter().map(|name| ((*name).to_owned(), text(&of[*name]))).collect::<Vec<_>>()
    };
    if status.is_null() {
        let message = "no daemon is running".into();
        return vec![Diagnostic { level: Level::Stale, name: "lookout".into(), message, values: Vec::new() }];
    }
    let level = match status["state"].as_str() {
        Some("running") => Level::Ok,
        Some("degraded" | "starting") => Level::Warn,
        _ => Level::Error,
    };
    let message = match status["reason"].as_str() {
        None | Some("") => text(&status["state"]),
        Some(reason) => reason.into(),
    };
    let names = ["state", "alarm", "alarm_reason", "frames", "obstacles", "latency_p50_ms", "latency_p99_ms"];
    let mut all = vec![Diagnostic { level, name: "lookout".into(), message, values: values(status, &names) }];
    for process in status["processes"].as_array().into_iter().flatten() {
        let level = if process["state"] == "running" { Level::Ok } else { Level::Error };
        let names = ["restarts", "frames", "skipped", "rate_hz", "p99_ms", "cpu_percent"];
        all.push(Diagnostic {
            level,
            name: format!("lookout: {}", text(&process["role"])),
            message: text(&process["state"]),
            values: values(process, &names),
        });
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_state_becomes_diagnostics() {
        let processes = json!([{ "role": "stereo", "state": "ended" }]);
        let status = json!({ "state": "degraded", "reason": "too hot", "frames": 7, "processes": processes });
        let all = diagnostics(&status);
        assert_eq!((all[0].level, &all[0].message[..]), (Level::Warn, "too hot"));
        assert!(all[0].values.contains(&("frames".into(), "7".into())), "{:?}", all[0].values);
        assert_eq!((all[1].level, &all[1].name[..]), (Level::Error, "lookout: stereo"));
        assert_eq!(diagnostics(&Value::Null)[0].level, Level::Stale);
    }

    #[test]
    fn messages_are_numbered_and_publishers_differ() {
        let outbox = Arc::new(Outbox::new(1_000_000));
        let camera = Arc::new(Camera::new(0, Duration::ZERO));
        let mut ros = Ros::new(&Bridge::default(), "car", Arc::clone(&outbox), camera);
        let fields = json!({ "run": "r", "sequence": 1, "time_s": 0.0, "withdrawn": false, "alarm": {
            "level": "clear", "changed": false }, "obstacles": [], "motion": { "known": true, "sources": [],
            "standstill": false, "disagree": false, "speed_m_s": 1.0, "yaw_rate_rad_s": 0.0 },
            "pose": { "position_m": [0.0, 0.0, 1.0], "orientation": [0.0, 0.0, 0.0, 1.0] } });
        let Value::Object(fields) = fields else { panic!("an object") };
        ros.frame(&fields);
        ros.state(|| json!({ "status": null }));
        let items: Vec<Item> = std::iter::from_fn(|| outbox.pop(Duration::ZERO)).collect();
        // Without a rig there are no boxes.
        assert_eq!(items.iter().map(|item| item.topic).collect::<Vec<_>>(), ["odometry", "diagnostics"]);
        let attachments: Vec<_> = items.iter().filter_map(|item| item.attachment.clone()).collect();
        assert_eq!((attachments[0][0], attachments[0].len()), (1, 33));
        assert_ne!(attachments[0][17..], attachments[1][17..]);
    }
}
