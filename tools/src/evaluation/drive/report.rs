//! Result of an evaluation of drives: a column for each recording and for all together, as text and as JSON.

use super::event::Event;
use super::score::{DriveScore, Tally};
use serde::Serialize;
use std::fmt;

/// Results for one recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecordingReport {
    /// The recording.
    pub name: String,
    /// Where the path is from that it was judged by.
    pub truth: String,
    /// The figures.
    #[serde(flatten)]
    pub score: DriveScore,
    /// What should not have happened, in the order of the frames.
    pub events: Vec<Event>,
}

/// Events of a recording that are printed; the rest is counted.
const MAX_PRINTED: usize = 30;

/// Results of an evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DriveReport {
    /// Each recording.
    pub recordings: Vec<RecordingReport>,
    /// All of them together.
    pub total: DriveScore,
}

impl DriveReport {
    /// A report of recordings with their names, truths, counts and events.
    pub fn new(recordings: impl IntoIterator<Item = (String, String, Tally, Vec<Event>)>) -> Self {
        let mut all = Tally::default();
        let mut report = Self::default();
        for (name, truth, tally, events) in recordings {
            all.add(&tally);
            report.recordings.push(RecordingReport { name, truth, score: tally.score(), events });
        }
        report.total = all.score();
        report
    }
}

/// The figures of the table, each a row; a column for each recording.
pub const FIGURES: [&str; 19] = [
    "frames",
    "time, s",
    "alarm off, % of the frames",
    "frames with the level clear",
    "frames with the level warning",
    "frames with the level alarm",
    "rises to warning or beyond",
    "rises to alarm",
    "frames judged: the path ahead is known",
    "false obstacles in the driven strip",
    "tracks of false obstacles",
    "false obstacles a judged frame",
    "obstacles in the strip that move along",
    "obstacles in the strip, false or moving",
    "life of tracks in view, median, s",
    "life, strict: hidden or boundary is lost, s",
    "jumps of width above 30 %, % of pairs",
    "predicted boxes, %",
    "driven strip not called free, %",
];

/// The values of [`FIGURES`]; a dash where there is none.
pub fn cells(score: &DriveScore) -> [String; FIGURES.len()] {
    let share = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.1}"));
    let life = |seconds: Option<f64>, is_limit: bool| {
        let more = if is_limit { ">" } else { "" };
        seconds.map_or("-".into(), |s| format!("{more}{s:.1}"))
    };
    [
        score.frames.to_string(),
        format!("{:.1}", score.seconds),
        share(score.off_percent),
        score.levels.clear.to_string(),
        score.levels.warning.to_string(),
        score.levels.alarm.to_string(),
        score.warnings.to_string(),
        score.alarms.to_string(),
        score.judged.to_string(),
        score.false_obstacles.to_string(),
        score.false_tracks.to_string(),
        format!("{:.3}", score.false_per_frame),
        score.moving_obstacles.to_string(),
        score.in_strip_obstacles.to_string(),
        life(score.life_median_s, score.life_is_lower_limit),
        life(score.life_strict_s, score.life_strict_is_lower_limit),
        share(score.width_jumps_percent),
        share(score.predicted_percent),
        share(score.not_free_percent),
    ]
}

impl DriveReport {
    /// Name and values of each column of the table: each recording, and all of several together.
    pub fn columns(&self) -> Vec<(&str, [String; FIGURES.len()])> {
        let total = (self.recordings.len() > 1).then(|| ("total", cells(&self.total)));
        let one = |recording: &'_ RecordingReport| cells(&recording.score);
        self.recordings.iter().map(|recording| (&recording.name[..], one(recording))).chain(total).collect()
    }
}

/// Smallest width of a column, in characters.
const MIN_WIDTH: usize = 8;

impl fmt::Display for DriveReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let columns = self.columns();
        let label = FIGURES.iter().map(|figure| figure.chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> =
            columns.iter().map(|(name, _)| name.chars().count().max(MIN_WIDTH)).collect();
        write!(f, "{:label$}", "")?;
        for ((name, _), width) in columns.iter().zip(&widths) {
            write!(f, "  {name:>width$}")?;
        }
        writeln!(f)?;
        for (i, figure) in FIGURES.iter().enumerate() {
            write!(f, "{figure:label$}")?;
            for ((_, values), width) in columns.iter().zip(&widths) {
                write!(f, "  {:>width$}", values[i])?;
            }
            writeln!(f)?;
        }
        for (reason, frames) in &self.total.off_reasons {
            writeln!(f, "alarm off in {frames} frames: {reason}")?;
        }
        let score = &self.total;
        if score.without_size > 0 {
            writeln!(f, "{} of {} boxes have no size", score.without_size, score.boxes)?;
        }
        if score.moving_obstacles > 0 {
            let (boxes, tracks) = (score.moving_obstacles, score.moving_tracks);
            writeln!(f, "{boxes} boxes of {tracks} tracks in the driven strip moved along: not judged")?;
        }
        let (lost, tracks) = (score.tracks_lost, score.tracks);
        let (hidden, to_boundary) = (score.tracks_hidden, score.tracks_to_boundary);
        write!(
            f,
            "{lost} of {tracks} confirmed tracks were lost in view; {hidden} went behind nearer things, "
        )?;
        writeln!(f, "{to_boundary} became parts of boundaries")?;
        for recording in &self.recordings {
            writeln!(f, "{}: judged by {}", recording.name, recording.truth)?;
            for event in recording.events.iter().take(MAX_PRINTED) {
                writeln!(f, "  frame {}: {}: {}", event.frame, event.kind, event.text)?;
            }
            let more = recording.events.len().saturating_sub(MAX_PRINTED);
            if more > 0 {
                writeln!(f, "  and {more} more: --json and --out have all")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::score::judge;
    use super::super::steadiness::View;
    use super::super::strip::tests::{straight, thing};
    use super::*;
    use crate::reporting::record::{AlarmLine, FrameRecord};
    use perception::range::Range;

    fn tally(obstacles: usize) -> Tally {
        let record = |i: usize| FrameRecord {
            time_s: 0.1 * i as f64,
            alarm: AlarmLine { level: "off".into(), ..AlarmLine::default() },
            obstacles: (i < obstacles).then(|| thing(12.0, 0.0, 1.0)).into_iter().collect(),
            ..FrameRecord::default()
        };
        let records: Vec<FrameRecord> = (0..60).map(record).collect();
        let reasons = vec![vec!["no road seen".to_owned()]; 60];
        let view =
            View { width_px: 640, height_px: 480, px_at_1_m: 200.0, near_m: 2.0, range: Range::fixed(60.0) };
        judge(&straight(60, 8.0), &records, &reasons, &view).tally
    }

    #[test]
    fn every_recording_has_a_column_and_all_have_one_together() {
        let event = Event { frame: 7, kind: "warning", text: "track 3".into() };
        let named =
            |name: &str, n| (name.to_owned(), "poses.txt".to_owned(), tally(n), vec![event.clone(); 31]);
        let report = DriveReport::new([named("a", 0), named("longer/name", 4)]);
        let text = report.to_string();
        assert_eq!(
            text.lines().next().map(|l| l.split_whitespace().collect()),
            Some(vec!["a", "longer/name", "total"])
        );
        let row = |figure: &str| -> Vec<&str> {
            let line = text.lines().find(|line| line.starts_with(figure)).unwrap();
            line[figure.len()..].split_whitespace().collect()
        };
        for (figure, values) in [
            ("frames  ", ["60", "60", "120"]),
            ("time, s", ["5.9", "5.9", "11.8"]),
            ("alarm off, % of the frames", ["100.0", "100.0", "100.0"]),
            ("frames judged: the path ahead is known", ["46", "46", "92"]),
            ("false obstacles in the driven strip", ["0", "4", "4"]),
            ("tracks of false obstacles", ["0", "1", "1"]),
            ("false obstacles a judged frame", ["0.000", "0.087", "0.043"]),
            ("obstacles in the strip that move along", ["0", "0", "0"]),
            ("obstacles in the strip, false or moving", ["0", "4", "4"]),
        ] {
            assert_eq!(row(figure), values, "{text}");
        }
        assert!(text.contains("alarm off in 120 frames: no road seen"), "{text}");
        assert!(text.contains("longer/name: judged by poses.txt\n  frame 7: warning: track 3\n"), "{text}");
        assert_eq!(text.matches("and 1 more").count(), 2, "{text}");
        let json = serde_json::to_value(&report).unwrap();
        let last = &json["recordings"][1];
        assert_eq!((&last["false_obstacles"], &last["in_strip_obstacles"]), (&4.into(), &4.into()));
        assert_eq!((&json["total"]["levels"]["off"], &json["total"]["judged"]), (&120.into(), &92.into()));
        assert_eq!(json["recordings"][0]["off_reasons"]["no road seen"], 60);
        // One recording alone needs no total.
        assert!(!DriveReport::new([named("a", 0)]).to_string().contains("total"));
    }
}
