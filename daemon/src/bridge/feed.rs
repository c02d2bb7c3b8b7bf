//! Turns lines of the stream into messages and events.

use super::camera::{Camera, ForEvents, Picture};
use super::changes::Changes;
use super::keys::Keys;
use super::outbox::{Form, Item, Outbox};
use super::settings::period;
use super::spool::Spool;
use crate::status_json::AlarmChangeJson;
use crate::stream::line::{Fields, close_object, open_object};
use crate::stream::topics::{POSE, Topics};
use config::Bridge;
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Events that are read again at the start, to know which changes were told: as many as a status has, and more.
const REMEMBERED: usize = 64;

/// Age from which a state does not describe the daemon any more: some periods of its messages.
const STALE: Duration = Duration::from_secs(4);

/// The events, shared between threads.
#[derive(Debug)]
pub struct Events(Mutex<Spool>);

impl Events {
    /// The events of a folder.
    pub fn new(spool: Spool) -> Self {
        Self(Mutex::new(spool))
    }

    /// Access to the folder.
    pub fn spool(&self) -> MutexGuard<'_, Spool> {
        // A poisoned lock is usable: every update leaves the list consistent.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a picture to the events that want it.
    pub fn add_picture(&self, taken: &ForEvents) {
        let jpeg = jpeg(&taken.picture);
        for event in &taken.events {
            self.spool().add_picture(*event, taken.picture.sequence, jpeg.clone());
        }
    }
}

fn jpeg(picture: &Picture) -> Vec<u8> {
    let (width, height) = (picture.size.0 as usize, picture.size.1 as usize);
    crate::view::frame::jpeg(&picture.left, width, height, image::ExtendedColorType::L8)
}

/// A topic with its rate.
#[derive(Debug)]
struct Topic {
    name: &'static str,
    fields: Topics,
    period: Option<Duration>,
    due: Instant,
}

impl Topic {
    fn new(name: &'static str, fields: &[&str], hertz: f64) -> Self {
        let fields: Vec<String> = fields.iter().map(ToString::to_string).collect();
        Self { name, fields: Topics::of(&fields), period: period(hertz), due: Instant::now() }
    }

    /// Whether it is sent now.
    fn is_due(&mut self, now: Instant, at_once: bool) -> bool {
        let Some(period) = self.period else { return false };
        let is_due = at_once || now >= self.due;
        if is_due {
            self.due = (self.due + period).clamp(now, now + period);
        }
        is_due
    }
}

/// Turns lines into messages and events.
pub struct Feed {
    keys: Keys,
    topics: [Topic; 3],
    status_period: Option<Duration>,
    status_due: Instant,
    status: Option<(Instant, Value)>,
    changes: Changes,
    events: Arc<Events>,
    outbox: Arc<Outbox>,
    camera: Arc<Camera>,
}

impl Feed {
    /// A feed of the configured topics.
    pub fn new(
        settings: &Bridge,
        keys: Keys,
        events: Arc<Events>,
        outbox: Arc<Outbox>,
        camera: Arc<Camera>,
    ) -> Self {
        let now = Instant::now();
        let changes = remembered(&events.spool());
        Self {
            keys,
            topics: [
                Topic::new("obstacles", &["obstacles"], settings.obstacles_hz),
                Topic::new("alarm", &["alarm"], settings.alarm_hz),
                Topic::new("motion", &["motion", POSE], settings.motion_hz),
            ],
            status_period: period(settings.status_hz),
            status_due: now,
            status: None,
            changes,
            events,
            outbox,
            camera,
        }
    }

    /// Takes the fields of a line, without the status.
    pub fn frame(&mut self, fields: &Fields) {
        let withdrawn = fields.get("withdrawn") == Some(&Value::Bool(true));
        let is_changed = fields.get("alarm").is_some_and(|alarm| alarm["changed"] == true);
        if let (true, Some(run), Some(change)) =
            (is_changed || withdrawn, text(fields, "run"), change(fields))
        {
            self.change(&run, &change, true);
        }
        let now = Instant::now();
        for topic in &mut self.topics {
            let at_once = withdrawn || (topic.name == "alarm" && is_changed);
            if topic.is_due(now, at_once) {
                let payload = close_object(&open_object(fields, &topic.fields), None).into_bytes();
                let key = self.keys.topic(topic.name);
                let form = Form::Json;
                self.outbox.push(Item {
                    topic: topic.name,
                    key,
                    payload,
                    form,
                    attachment: None,
                    keeps: true,
                });
            }
        }
    }

    /// Takes the daemon's state.
    pub fn status(&mut self, run: &str, status: Value) {
        let changes: Vec<AlarmChangeJson> =
            serde_json::from_value(status["alarm_changes"].clone()).unwrap_or_default();
        for change in &changes {
            self.change(run, change, false);
        }
        self.status = Some((Instant::now(), json!({ "run": run, "status": status })));
    }

    /// The newest state, as on the key `status`; also where no daemon is heard.
    pub fn state(&mut self) -> Value {
        self.status.take_if(|(heard, _)| heard.elapsed() > STALE);
        let mut state = self
            .status
            .as_ref()
            .map_or_else(|| json!({ "run": null, "status": null }), |(_, state)| state.clone());
        let (topics, waiting_bytes) = self.outbox.counts();
        let (events, lost, spool_bytes) = self.events.spool().figures();
        state["bridge"] = json!({
            "version": env!("CARGO_PKG_VERSION"),
            "utc_s": utc_s(),
            "events": events,
            "events_lost": lost,
            "spool_bytes": spool_bytes,
            "waiting_bytes": waiting_bytes,
            "topics": topics,
        });
        state
    }

    /// Sends the state if it is due.
    pub fn send_state(&mut self) {
        let Some(period) = self.status_period else { return };
        let now = Instant::now();
        if now < self.status_due {
            return;
        }
        self.status_due = (self.status_due + period).max(now);
        let (key, payload) = (self.keys.topic("status"), self.state().to_string().into_bytes());
        self.outbox.push(Item {
            topic: "status",
            key,
            payload,
            form: Form::Json,
            attachment: None,
            keeps: true,
        });
    }

    /// Makes an event of a change that is new. Only one that is seen in its own frame has pictures.
    fn change(&mut self, run: &str, change: &AlarmChangeJson, in_time: bool) {
        let Some(from) = self.changes.is_new(run, change) else { return };
        let number = self.events.spool().add_event(|number| {
            let event = json!({
                "event": number,
                "run": run,
                "sequence": change.sequence,
                "time_s": change.time_s,
                "utc_s": utc_s(),
                "withdrawn": change.withdrawn,
                "in_time": in_time,
                "from": from,
                "to": change.alarm.level,
                "alarm": change.alarm,
            });
            format!("{event}\n").into_bytes()
        });
        if in_time {
            for picture in self.camera.event(number) {
                self.events.add_picture(&ForEvents { events: vec![number], picture });
            }
        }
        self.outbox.wake();
    }
}

/// The changes that earlier processes have told.
fn remembered(spool: &Spool) -> Changes {
    let of_events: Vec<_> =
        spool.entries().rev().filter(|entry| entry.frame.is_none()).take(REMEMBERED).collect();
    let mut changes = Changes::default();
    for entry in of_events.into_iter().rev() {
        let content = spool.read(entry).unwrap_or_default();
        if let Ok(fields) = serde_json::from_slice::<Fields>(&content)
            && let (Some(run), Some(change)) = (text(&fields, "run"), change(&fields))
        {
            changes.is_new(&run, &change);
        }
    }
    changes
}

/// The change that a frame or an event has.
fn change(fields: &Fields) -> Option<AlarmChangeJson> {
    serde_json::from_value(Value::Object(fields.clone())).ok()
}

fn text(fields: &Fields, name: &str) -> Option<String> {
    fields.get(name)?.as_str().map(ToOwned::to_owned)
}

/// Seconds since 1970, to milliseconds.
pub fn utc_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    (since.as_secs_f64() * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(sequence: u64, level: &str, changed: bool) -> Fields {
        let alarm =
            tools::reporting::record::AlarmLine { level: level.into(), changed, ..Default::default() };
        let line = json!({
            "run": "r", "sequence": sequence, "time_s": 0.5, "withdrawn": false, "alarm": alarm,
            "motion": {}, "obstacles": [],
        });
        match line {
            Value::Object(fields) => fields,
            _ => Fields::new(),
        }
    }

    fn feed(folder: &std::path::Path) -> Feed {
        let settings = Bridge { obstacles_hz: 0.001, motion_hz: 0.0, ..Bridge::default() };
        let events = Arc::new(Events::new(Spool::open(folder, 1_000_000).unwrap()));
        let camera = Arc::new(Camera::new(0, Duration::ZERO));
        Feed::new(&settings, Keys::new("f", "v"), events, Arc::new(Outbox::new(1_000_000)), camera)
    }

    #[test]
    fn rates_limit_topics_but_no_change_of_the_alarm() {
        let folder = tempfile::tempdir().unwrap();
        let mut feed = feed(folder.path());
        for (sequence, level, changed) in [(0, "clear", true), (1, "clear", false), (2, "alarm", true)] {
            feed.frame(&fields(sequence, level, changed));
        }
        let mut sent = Vec::new();
        while let Some(item) = feed.outbox.pop(Duration::ZERO) {
            let line: Value = serde_json::from_slice(&item.payload).unwrap();
            sent.push((item.key, line["sequence"].as_u64().unwrap()));
        }
        let expected = [("obstacles", 0), ("alarm", 0), ("alarm", 2)];
        assert_eq!(sent, expected.map(|(topic, sequence)| (format!("lookout/f/v/{topic}"), sequence)));
    }

    #[test]
    fn each_change_is_an_event_also_over_restarts_and_where_its_frame_was_missed() {
        let folder = tempfile::tempdir().unwrap();
        let change = |sequence: u64, level: &str| json!({ "sequence": sequence, "time_s": 0.1, "withdrawn": false, "alarm": fields(0, level, true)["alarm"] });
        let mut one = feed(folder.path());
        one.frame(&fields(0, "clear", true));
        one.frame(&fields(9, "clear", false));
        drop(one);
        // While no bridge ran, the alarm was raised and ended.
        let mut two = feed(folder.path());
        let changes = [change(0, "clear"), change(12, "alarm"), change(20, "clear")];
        two.status("r", json!({ "alarm_changes": changes }));
        two.frame(&fields(20, "clear", true));
        two.frame(&fields(31, "warning", true));
        two.status("r", json!({ "alarm_changes": changes }));
        let spool = two.events.spool();
        let events: Vec<Value> = spool
            .entries()
            .map(|entry| serde_json::from_slice(&spool.read(entry).unwrap()).unwrap())
            .collect();
        let known: Vec<_> = events
            .iter()
            .map(|e| {
                (
                    e["event"].as_u64().unwrap(),
                    e["sequence"].as_u64().unwrap(),
                    e["to"].as_str().unwrap(),
                    e["in_time"] == true,
                )
            })
            .collect();
        assert_eq!(
            known,
            [
                (1, 0, "clear", true),
                (2, 12, "alarm", false),
                (3, 20, "clear", false),
                (4, 31, "warning", true)
            ]
        );
    }
}
