//! The frames of one run of the daemon after the other: each is published once, and withdrawn when it no longer holds.

use super::latest::Latest;
use super::line::{Fields, open_object};
use super::topics::Topics;
use messages::alarm::{OFF, level_name};
use serde_json::Value;
use std::sync::Arc;
use tools::reporting::record::{AlarmLine, FrameRecord};

/// A frame, or the withdrawal of one.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The run: random characters, other ones at each start of the daemon.
    pub run: String,
    /// Number of the frame in its run.
    pub sequence: u64,
    /// Source time in seconds.
    pub time_s: f64,
    /// Whether it withdraws the results of this and all earlier frames.
    pub withdrawn: bool,
    /// All fields of the line.
    pub fields: Fields,
}

impl Entry {
    /// The entry of a record. Further fields of the head may follow.
    ///
    /// # Errors
    /// If the record cannot be serialised.
    pub fn new(run: &str, record: &FrameRecord, withdrawn: bool) -> Result<Self, serde_json::Error> {
        let mut fields = match serde_json::to_value(record)? {
            Value::Object(fields) => fields,
            _ => Fields::new(),
        };
        fields.insert("run".into(), run.into());
        fields.insert("withdrawn".into(), withdrawn.into());
        Ok(Self { run: run.into(), sequence: record.sequence, time_s: record.time_s, withdrawn, fields })
    }

    /// The entry of a line that another process has made; `None` if it is no line of a frame.
    pub fn parse(fields: Fields) -> Option<Self> {
        Some(Self {
            run: fields.get("run")?.as_str()?.into(),
            sequence: fields.get("sequence")?.as_u64()?,
            time_s: fields.get("time_s")?.as_f64()?,
            withdrawn: fields.get("withdrawn")?.as_bool()?,
            fields,
        })
    }
}

/// The newest frame that was published.
#[derive(Clone, Debug)]
struct Last {
    run: String,
    sequence: u64,
    time_s: f64,
    /// Whether it has not been withdrawn.
    holds: bool,
}

/// Publishes frames.
#[derive(Debug)]
pub struct Runs {
    latest: Arc<Latest>,
    topics: Topics,
    last: Option<Last>,
}

impl Runs {
    /// Publishes the topics to `latest`.
    pub fn new(latest: Arc<Latest>, topics: Topics) -> Self {
        Self { latest, topics, last: None }
    }

    /// Whether anybody reads; otherwise nothing needs to be converted.
    pub fn is_read(&self) -> bool {
        self.latest.is_read()
    }

    /// Whether frames are published, and so have to be read.
    pub fn has_frames(&self) -> bool {
        self.topics.has_frames()
    }

    /// Whether states are published.
    pub fn has_status(&self) -> bool {
        self.topics.has_status()
    }

    /// Publishes a frame, unless it was published before; a withdrawal, unless there is nothing to withdraw. Returns
    /// whether it was published.
    pub fn publish(&mut self, entry: &Entry) -> bool {
        let of_run = self.last.as_ref().filter(|last| last.run == entry.run);
        let is_new = match of_run {
            // A frame is repeated where a stage has died.
            Some(last) if !entry.withdrawn => entry.sequence > last.sequence,
            Some(last) => last.holds,
            None => true,
        };
        if !is_new {
            return false;
        }
        let sequence = of_run.map_or(entry.sequence, |last| last.sequence.max(entry.sequence));
        let (run, time_s, holds) = (entry.run.clone(), entry.time_s, !entry.withdrawn);
        self.last = Some(Last { run, sequence, time_s, holds });
        if self.topics.has_frames() {
            self.latest.frame(open_object(&entry.fields, &self.topics));
        }
        true
    }

    /// There is a new frame, but nobody reads: whoever comes next gets no old one.
    pub fn skip(&mut self, run: &str, sequence: u64, time_s: f64) {
        self.last = Some(Last { run: run.into(), sequence, time_s, holds: true });
        self.latest.clear_frame();
    }

    /// There is a new state, but nobody reads.
    pub fn skip_status(&self) {
        self.latest.clear_status();
    }

    /// Publishes the daemon's state, a JSON object.
    pub fn status(&self, run: &str, json: &str) {
        if self.topics.has_status() {
            self.latest.status(run, json);
        }
    }

    /// Results have ended: withdraws the last frame, with the reason why the alarm is off.
    pub fn end(&mut self, reason: &str) {
        self.latest.clear_status();
        let Some(last) = self.last.clone().filter(|last| last.holds) else { return };
        let alarm = AlarmLine {
            level: level_name(OFF).into(),
            changed: true,
            reason: Some(reason.into()),
            ..AlarmLine::default()
        };
        let (sequence, time_s) = (last.sequence, last.time_s);
        let record = FrameRecord { sequence, time_s, alarm, ..FrameRecord::default() };
        match Entry::new(&last.run, &record, true) {
            Ok(entry) => {
                self.publish(&entry);
            }
            Err(error) => tracing::error!(%error, "a line cannot be written"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::latest::Seen;
    use super::*;
    use std::time::Duration;

    fn entry(run: &str, sequence: u64) -> Entry {
        let record = FrameRecord { sequence, time_s: sequence as f64 * 0.1, ..FrameRecord::default() };
        Entry::new(run, &record, false).unwrap()
    }

    #[test]
    fn each_frame_of_each_run_comes_once() {
        let mut runs = Runs::new(Arc::default(), Topics::all());
        let published = [("a", 0), ("a", 1), ("a", 1), ("a", 0), ("a", 3), ("b", 0), ("b", 3)]
            .map(|(run, sequence)| runs.publish(&entry(run, sequence)));
        assert_eq!(published, [true, true, false, false, true, true, true]);
    }

    #[test]
    fn a_run_that_ends_withdraws_its_last_frame_once() {
        let latest = Arc::new(Latest::default());
        let mut runs = Runs::new(Arc::clone(&latest), Topics::of(&[]));
        let mut seen = Seen::default();
        let mut line = move || -> Option<Value> {
            let text = latest.next(&mut seen, Duration::ZERO)?;
            Some(serde_json::from_str(&text).unwrap())
        };
        runs.end("nothing to withdraw");
        assert_eq!(line(), None);
        runs.publish(&entry("a", 7));
        assert_eq!(line().unwrap()["withdrawn"], false);
        runs.end("the daemon has ended");
        let end = line().unwrap();
        assert_eq!(
            (&end["run"], &end["sequence"], &end["withdrawn"]),
            (&"a".into(), &7.into(), &true.into())
        );
        assert_eq!(
            (&end["alarm"]["level"], &end["alarm"]["reason"]),
            (&"off".into(), &"the daemon has ended".into())
        );
        assert_eq!(end["obstacles"], serde_json::json!([]));
        runs.end("the daemon has ended");
        assert_eq!(line(), None);
        assert!(!runs.publish(&entry("a", 7)), "it was withdrawn");
        assert!(runs.publish(&entry("a", 8)));
    }

    #[test]
    fn who_comes_late_gets_no_old_frame_but_learns_that_results_have_ended() {
        let latest = Arc::new(Latest::default());
        let mut runs = Runs::new(Arc::clone(&latest), Topics::all());
        let newcomer = || latest.next(&mut Seen::default(), Duration::ZERO);
        runs.publish(&entry("a", 1));
        assert!(newcomer().is_some());
        runs.skip("a", 2, 0.2);
        assert_eq!(newcomer(), None);
        runs.end("the daemon has ended");
        let line = newcomer().unwrap();
        assert!(line.contains("\"sequence\":2") && line.contains("\"withdrawn\":true"), "{line}");
    }

    #[test]
    fn a_line_of_another_process_is_read_back() {
        let sent = entry("a", 5);
        let line = format!("{}}}", open_object(&sent.fields, &Topics::all()));
        let parsed = Entry::parse(serde_json::from_str(&line).unwrap()).unwrap();
        assert_eq!((parsed.run, parsed.sequence, parsed.withdrawn), ("a".into(), 5, false));
        assert_eq!(parsed.fields, sent.fields);
        assert!(Entry::parse(Fields::new()).is_none());
    }
}
