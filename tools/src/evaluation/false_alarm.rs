//! Alarms without a cause in synthetic scenes, each with what is needed to look at it.

use super::time_score::Undisturbed;
use crate::reporting::record::{FrameRecord, tidy};
use serde::Serialize;
use std::fmt;

/// A run of frames with an alarm that has no cause.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FalseAlarm {
    /// The scene, as in `lookout replay scene:NAME`, without the weather.
    pub scene: String,
    /// Its weather.
    pub weather: String,
    /// First frame, from 0.
    pub frame: u64,
    /// Number of frames.
    pub frames: usize,
    /// Frame in which the level rose to alarm: before `frame` if it had a cause and outlasted it.
    pub rose: u64,
    /// What the alarm said then.
    pub text: String,
    /// The track that raised it, as it was then.
    pub track: Option<AlarmingTrack>,
}

/// A track that raised an alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AlarmingTrack {
    /// Its number.
    pub track: u32,
    /// Distance of the near side, in metres.
    pub distance_m: f64,
    /// Place right of the camera's axis, in metres.
    pub lateral_m: f64,
    /// Width, in metres.
    pub width_m: f64,
    /// Speed to the right, in m/s, and closing speed; `None` where they are unknown.
    pub across_m_s: Option<f64>,
    /// See `across_m_s`.
    pub closing_m_s: Option<f64>,
}

impl AlarmingTrack {
    fn of(record: &FrameRecord) -> Option<Self> {
        let track = record.alarm.track?;
        let o = record.obstacles.iter().find(|o| o.track == track)?;
        Some(Self {
            track,
            distance_m: tidy(o.distance_m),
            lateral_m: tidy(o.lateral_m),
            width_m: tidy(o.width_m),
            across_m_s: o.across_m_s.map(tidy),
            closing_m_s: o.closing_m_s.map(tidy),
        })
    }
}

/// The false alarms of a scene whose first frame in `alarms` was frame `first`. `records`: of the frames in which the level rose to
/// alarm, with their numbers.
pub fn false_alarms(
    (scene, weather): (&str, &str),
    alarms: &Undisturbed,
    hold_s: f64,
    first: u64,
    records: &[(u64, FrameRecord)],
) -> Vec<FalseAlarm> {
    let of = |run: std::ops::Range<usize>| {
        let frame = first + run.start as u64;
        // It may have risen with a cause, and have outlasted it.
        let rise = records.iter().rev().find(|(rise, _)| *rise <= frame);
        FalseAlarm {
            scene: scene.into(),
            weather: weather.into(),
            frame,
            frames: run.len(),
            rose: rise.map_or(frame, |(rose, _)| *rose),
            text: rise.map_or(String::new(), |(_, record)| record.alarm.text()),
            track: rise.and_then(|(_, record)| AlarmingTrack::of(record)),
        }
    };
    alarms.false_runs(hold_s).into_iter().map(of).collect()
}

/// One line.
impl fmt::Display for FalseAlarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, weather, frame, frames, text, track, .. } = self;
        write!(f, "{scene} {weather}, frame {frame}, for {frames}: {text}")?;
        let Some(t) = track else { return Ok(()) };
        let side = if t.lateral_m < 0.0 { "left" } else { "right" };
        let (at_m, wide_m) = (t.lateral_m.abs(), t.width_m);
        write!(f, "; {:.1} m ahead, {at_m:.1} m {side}, {wide_m:.1} m wide", t.distance_m)?;
        match t.across_m_s.zip(t.closing_m_s) {
            Some((across, closing)) => {
                write!(f, ", {across:+.1} m/s to the right, {closing:+.1} m/s closing")
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::time_score::FrameDuty;
    use super::*;
    use crate::reporting::record::{AlarmLine, ObstacleLine};

    #[test]
    fn each_run_without_a_cause_is_one_false_alarm_with_its_track() {
        let is_alarm = |k: usize| (4..7).contains(&k) || k == 30;
        let cause = |k: usize| FrameDuty { may: k == 31, must: false };
        let alarms = Undisturbed {
            period_s: 0.1,
            duties: (0..40).map(cause).collect(),
            alarms: (0..40).map(is_alarm).collect(),
        };
        let alarm = AlarmLine { level: "alarm".into(), track: Some(7), ..AlarmLine::default() };
        let obstacle = ObstacleLine {
            track: 7,
            distance_m: 12.0,
            lateral_m: -1.26,
            across_m_s: Some(2.0),
            ..ObstacleLine::default()
        };
        let record = FrameRecord { alarm, obstacles: vec![obstacle], ..FrameRecord::default() };
        let records = [(104, record), (130, FrameRecord::default())];
        let found = false_alarms(("random?seed=3", "night"), &alarms, 0.5, 100, &records);
        // The one at 30 has a cause shortly after.
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].frame, found[0].frames), (104, 3));
        let line = found[0].to_string();
        assert!(line.starts_with("random?seed=3 night, frame 104, for 3: alarm raised"), "{line}");
        assert!(line.contains("12.0 m ahead, 1.3 m left"), "{line}");
        // One that has a cause at first, and outlasts it.
        let long = Undisturbed {
            duties: (0..40).map(|k| FrameDuty { may: k == 4, must: false }).collect(),
            alarms: (0..40).map(|k| (4..30).contains(&k)).collect(),
            ..alarms
        };
        let found = false_alarms(("street", "night"), &long, 0.5, 100, &records);
        assert_eq!((found.len(), found[0].rose, found[0].frame, found[0].frames), (1, 104, 115, 15));
    }
}
