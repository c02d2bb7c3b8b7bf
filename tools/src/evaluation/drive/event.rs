//! What has to be looked at in a drive: false alarms, false warnings and false obstacles.

use super::score::{FalseObstacle, Judgement, Onset};
use crate::reporting::record::{AlarmLine, FrameRecord};
use serde::Serialize;

/// Something that should not have happened.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Frame in which it began, from 0.
    pub frame: usize,
    /// `alarm`, `warning` or `false obstacle`.
    pub kind: &'static str,
    /// What it was: object, place, rule.
    pub text: String,
}

/// The events of a drive, in the order of their frames. A rise from clear to alarm is one event; a false obstacle is one
/// for its track, at its first frame.
pub fn events(judgement: &Judgement, records: &[FrameRecord]) -> Vec<Event> {
    let mut found = Vec::new();
    for onset in &judgement.onsets {
        let alarms_too = |o: &&Onset| o.frame == onset.frame && o.level == "alarm";
        if onset.level == "warning" && judgement.onsets.iter().any(|o| alarms_too(&o)) {
            continue;
        }
        let text = records.get(onset.frame).map_or(String::new(), |record| alarm_text(&record.alarm));
        found.push(Event { frame: onset.frame, kind: onset.level, text });
    }
    let mut tracks: Vec<u32> = judgement.false_obstacles.iter().map(|f| f.track).collect();
    tracks.sort_unstable();
    tracks.dedup();
    for track in tracks {
        let all = || judgement.false_obstacles.iter().filter(|f| f.track == track);
        if let Some(first) = all().next() {
            found.push(Event {
                frame: first.frame,
                kind: "false obstacle",
                text: obstacle_text(first, all().count()),
            });
        }
    }
    found.sort_by_key(|event| event.frame);
    found
}

fn alarm_text(alarm: &AlarmLine) -> String {
    let track = alarm.track.map_or(String::new(), |track| format!("track {track}, "));
    format!("{track}{}", alarm.text())
}

fn obstacle_text(first: &FalseObstacle, frames: usize) -> String {
    let FalseObstacle { track, distance_m, lateral_m, width_m, overlap_m, .. } = first;
    let side = if *lateral_m < 0.0 { "left" } else { "right" };
    let s = if frames == 1 { "" } else { "s" };
    format!(
        "track {track} in the driven strip in {frames} frame{s}, at first {distance_m:.1} m ahead, {:.1} m {side}, \
         {width_m:.1} m wide, {overlap_m:.1} m of it in the strip",
        lateral_m.abs()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rise_to_alarm_is_one_event_and_a_false_track_another() {
        let obstacle = |frame, track| FalseObstacle {
            frame,
            track,
            distance_m: 12.0,
            lateral_m: -0.6,
            width_m: 1.0,
            overlap_m: 0.8,
        };
        let judgement = Judgement {
            false_obstacles: vec![obstacle(1, 7), obstacle(2, 7), obstacle(2, 3)],
            onsets: vec![
                Onset { frame: 0, level: "warning" },
                Onset { frame: 3, level: "warning" },
                Onset { frame: 3, level: "alarm" },
            ],
            ..Judgement::default()
        };
        let alarm = AlarmLine {
            level: "alarm".into(),
            rule: Some("distance".into()),
            track: Some(7),
            ..AlarmLine::default()
        };
        let records = vec![FrameRecord { alarm, ..FrameRecord::default() }; 4];
        let found = events(&judgement, &records);
        let kinds: Vec<(usize, &str)> = found.iter().map(|e| (e.frame, e.kind)).collect();
        let expected = [(0, "warning"), (1, "false obstacle"), (2, "false obstacle"), (3, "alarm")];
        assert_eq!(kinds, expected);
        assert!(found[1].text.contains("track 7") && found[1].text.contains("in 2 frames"), "{found:?}");
        assert!(found[1].text.contains("12.0 m ahead, 0.6 m left"), "{found:?}");
        assert!(found[3].text.starts_with("track 7, alarm raised"), "{found:?}");
    }
}
