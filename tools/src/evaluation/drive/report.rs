//! Result of an evaluation of drives: a row for each recording and the total, as text and as JSON.

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

/// Columns of the table after the name.
pub const COLUMNS: [&str; 19] = [
    "frames", "s", "off %", "clear", "warning", "alarm", "warnings", "alarms", "judged", "false", "tracks",
    "a frame", "moving", "in strip", "life s", "strict s", "jumps %", "pred %", "unfree %",
];

/// The cells of a row below [`COLUMNS`]; a dash where there is no figure.
pub fn cells(score: &DriveScore) -> [String; COLUMNS.len()] {
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

fn row(f: &mut fmt::Formatter<'_>, name: &str, width: usize, cells: &[String]) -> fmt::Result {
    write!(f, "{name:<width$}")?;
    for cell in cells {
        write!(f, " {cell:>8}")?;
    }
    writeln!(f)
}

impl fmt::Display for DriveReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.recordings.iter().map(|r| r.name.chars().count());
        let width = names.max().unwrap_or(0).max("recording".len());
        row(f, "recording", width, &COLUMNS.map(String::from))?;
        for recording in &self.recordings {
            row(f, &recording.name, width, &cells(&recording.score))?;
        }
        if self.recordings.len() > 1 {
            row(f, "total", width, &cells(&self.total))?;
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
    fn every_recording_has_a_row_and_all_have_one_together() {
        let event = Event { frame: 7, kind: "warning", text: "track 3".into() };
        let named =
            |name: &str, n| (name.to_owned(), "poses.txt".to_owned(), tally(n), vec![event.clone(); 31]);
        let report = DriveReport::new([named("a", 0), named("longer/name", 4)]);
        let text = report.to_string();
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split_whitespace().collect()).collect();
        assert_eq!((lines[1][0], lines[2][0], lines[3][0]), ("a", "longer/name", "total"), "{text}");
        assert_eq!(lines[1][9..15], ["46", "0", "0", "0.000", "0", "0"][..], "{text}");
        assert_eq!(lines[3][1..4], ["120", "11.8", "100.0"][..], "{text}");
        assert_eq!(lines[3][9..15], ["92", "4", "1", "0.043", "0", "4"][..], "{text}");
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
