//! For how many frames, and for how long, the alarm was in each level, and why it was off.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Frames and source time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelTime {
    /// Number of frames.
    pub frames: u64,
    /// Source time, in seconds.
    pub seconds: f64,
}

/// Frames and source time for which a self-check kept the alarm off.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OffReason {
    /// The reason.
    pub reason: String,
    /// Its frames and time; a frame may have several reasons.
    #[serde(flatten)]
    pub time: LevelTime,
}

/// Frames and source time by level, since the start of the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmTimes {
    /// It could not judge.
    pub off: LevelTime,
    /// It judged, and nothing was dangerous.
    pub clear: LevelTime,
    /// Something would become dangerous.
    pub warning: LevelTime,
    /// Something was dangerous.
    pub alarm: LevelTime,
    /// Why it was off.
    pub off_reasons: Vec<OffReason>,
}

impl fmt::Display for LevelTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = if self.frames == 1 { "" } else { "s" };
        write!(f, "{} frame{s} ({:.1} s)", self.frames, self.seconds)
    }
}

impl fmt::Display for AlarmTimes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { off, clear, warning, alarm, off_reasons } = self;
        write!(f, "alarm off in {off}, clear in {clear}, warning in {warning}, alarm in {alarm}")?;
        for OffReason { reason, time } in off_reasons {
            write!(f, "\nalarm off in {time}: {reason}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_and_reasons_are_told() {
        let time = |frames, seconds| LevelTime { frames, seconds };
        let times = AlarmTimes {
            off: time(48, 4.8),
            clear: time(3, 0.3),
            off_reasons: vec![OffReason { reason: "no road seen".into(), time: time(48, 4.8) }],
            ..AlarmTimes::default()
        };
        assert_eq!(
            times.to_string(),
            "alarm off in 48 frames (4.8 s), clear in 3 frames (0.3 s), warning in 0 frames (0.0 s), alarm in 0 frames \
             (0.0 s)\nalarm off in 48 frames (4.8 s): no road seen"
        );
        let json = serde_json::to_value(&times).unwrap();
        assert_eq!((&json["off"]["frames"], &json["off_reasons"][0]["seconds"]), (&48.into(), &4.8.into()));
        assert_eq!(serde_json::from_value::<AlarmTimes>(json).unwrap(), times);
    }
}
