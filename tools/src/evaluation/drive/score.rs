//! Figures of a drive in which nothing was hit.

use super::driven_ground::DrivenGround;
use super::life::{End, Life, median_life};
use super::steadiness::{Steadiness, View, steadiness};
use super::strip::DrivenPath;
use crate::reporting::record::{FrameRecord, tidy};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Levels of the alarm, in the order of [`Levels`].
pub const LEVELS: [&str; 4] = ["off", "clear", "warning", "alarm"];

/// Number of frames in each level of the alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Levels {
    /// It could not judge.
    pub off: usize,
    /// Nothing was dangerous.
    pub clear: usize,
    /// Something would become dangerous.
    pub warning: usize,
    /// Something was dangerous.
    pub alarm: usize,
}

/// A confirmed obstacle that reached into the strip that the vehicle then drove through, and did not move along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FalseObstacle {
    /// Frame, from 0.
    pub frame: usize,
    /// Track.
    pub track: u32,
    /// Distance, in metres.
    pub distance_m: f64,
    /// Lateral position, in metres, to the right positive.
    pub lateral_m: f64,
    /// Width, in metres.
    pub width_m: f64,
    /// How much of the width lay in the strip, in metres.
    pub overlap_m: f64,
}

/// The alarm rose to a level.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Onset {
    /// Frame, from 0.
    pub frame: usize,
    /// `warning` or `alarm`.
    pub level: &'static str,
}

/// What the drive says of the system's results.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judgement {
    /// Counts.
    pub tally: Tally,
    /// Every false obstacle, frame by frame.
    pub false_obstacles: Vec<FalseObstacle>,
    /// Tracks in the driven strip that moved along, so that it cannot tell whether they were false.
    pub moving_tracks: BTreeSet<u32>,
    /// Every onset of a warning and of an alarm; a rise from clear to alarm is both.
    pub onsets: Vec<Onset>,
}

/// Counts of one or several drives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    frames: usize,
    seconds: f64,
    levels: Levels,
    warnings: usize,
    alarms: usize,
    off_reasons: BTreeMap<String, usize>,
    judged: usize,
    false_obstacles: usize,
    false_tracks: usize,
    moving_obstacles: usize,
    moving_tracks: usize,
    ground: DrivenGround,
    steadiness: Steadiness,
}

/// Figures of one or several drives; `None` where there is nothing to take a share or a median of.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DriveScore {
    /// Number of frames.
    pub frames: usize,
    /// Duration, in seconds.
    pub seconds: f64,
    /// Frames by level of the alarm.
    pub levels: Levels,
    /// Number of times that the level rose to warning or beyond.
    pub warnings: usize,
    /// Number of times that the level rose to alarm.
    pub alarms: usize,
    /// Share of frames with the alarm off, in percent.
    pub off_percent: Option<f64>,
    /// Frames with the alarm off by reason; a frame may have several.
    pub off_reasons: BTreeMap<String, usize>,
    /// Frames of which the path ahead is known: those that false obstacles are looked for in.
    pub judged: usize,
    /// Confirmed obstacles in the driven strip that did not move along, counted in each frame.
    pub false_obstacles: usize,
    /// Tracks of them.
    pub false_tracks: usize,
    /// False obstacles in a judged frame.
    pub false_per_frame: f64,
    /// Confirmed obstacles in the driven strip that moved along, counted in each frame: not judged.
    pub moving_obstacles: usize,
    /// Tracks of them.
    pub moving_tracks: usize,
    /// Confirmed obstacles in the driven strip, moving or not: what counted as false before moving ones were told apart.
    pub in_strip_obstacles: usize,
    /// Tracks of them.
    pub in_strip_tracks: usize,
    /// The same obstacles in a judged frame.
    pub in_strip_per_frame: f64,
    /// Metres of the driven strip up to 15 m ahead, summed over the judged frames.
    pub driven_m: f64,
    /// Of them not called free over the whole width of the strip; what drove ahead there counts.
    pub not_free_m: f64,
    /// The same in percent.
    pub not_free_percent: Option<f64>,
    /// Confirmed tracks.
    pub tracks: usize,
    /// Of them lost while their thing was to be seen.
    pub tracks_lost: usize,
    /// Of them ended behind something much nearer.
    pub tracks_hidden: usize,
    /// Of them ended because their thing is now told as a boundary.
    pub tracks_to_boundary: usize,
    /// Time after which half of the tracks are lost while their thing is in view.
    pub life_median_s: Option<f64>,
    /// Whether fewer than half were lost: the median is then the longest life, and the true one is longer.
    pub life_is_lower_limit: bool,
    /// The same where what is hidden, or is now told as a boundary, counts as lost, too.
    pub life_strict_s: Option<f64>,
    /// See [`Self::life_is_lower_limit`].
    pub life_strict_is_lower_limit: bool,
    /// Boxes of confirmed tracks.
    pub boxes: usize,
    /// Share of boxes that are predictions, in percent.
    pub predicted_percent: Option<f64>,
    /// Boxes without width or height.
    pub without_size: usize,
    /// Pairs of measured boxes of a track in consecutive frames, not cut by the picture's sides.
    pub width_pairs: usize,
    /// Share of these pairs whose width in the picture changes by more than 30 %, in percent.
    pub width_jumps_percent: Option<f64>,
}

/// Rank of a level for onsets: off and clear are no warning.
fn rank(level: &str) -> usize {
    LEVELS.iter().position(|name| *name == level).unwrap_or(0).saturating_sub(1)
}

/// Judges the records of a drive by the path that was driven. `off_reasons` are the reasons for which the alarm was off in
/// each frame, none where it was on. Ends with the shorter of records and path.
pub fn judge(
    path: &DrivenPath,
    records: &[FrameRecord],
    off_reasons: &[Vec<String>],
    view: &View,
) -> Judgement {
    let records = &records[..records.len().min(path.frames())];
    let mut found = Judgement::default();
    let tally = &mut found.tally;
    (tally.frames, tally.seconds) = (records.len(), path.seconds());
    let (mut before, mut speeds) = (0, BTreeMap::<u32, Speeds>::new());
    for (frame, record) in records.iter().enumerate() {
        let level = record.alarm.level.as_str();
        tally.levels.add(level);
        if level == LEVELS[0] {
            for reason in off_reasons.get(frame).into_iter().flatten() {
                *tally.off_reasons.entry(reason.clone()).or_default() += 1;
            }
        }
        let now = rank(level);
        for (of, count, level) in [(1, &mut tally.warnings, LEVELS[2]), (2, &mut tally.alarms, LEVELS[3])] {
            if now >= of && of > before {
                *count += 1;
                found.onsets.push(Onset { frame, level });
            }
        }
        before = now;
        let Some(strip) = path.strip(frame) else { continue };
        tally.judged += 1;
        tally.ground.add_frame(record, &strip);
        for obstacle in &record.obstacles {
            if let Some(overlap_m) = strip.false_overlap_m(obstacle) {
                let speeds = speeds.entry(obstacle.track).or_default();
                // The speed of a prediction is no measurement.
                if obstacle.missed == 0 {
                    speeds.add(path.time_s(frame), path.moves_along(frame, obstacle));
                }
                found.false_obstacles.push(FalseObstacle {
                    frame,
                    track: obstacle.track,
                    distance_m: obstacle.distance_m,
                    lateral_m: obstacle.lateral_m,
                    width_m: obstacle.width_m,
                    overlap_m: tidy(overlap_m),
                });
            }
        }
    }
    let moving = speeds.iter().filter(|(_, speeds)| speeds.is_moving()).map(|(track, _)| *track);
    found.moving_tracks = moving.collect();
    let in_strip = found.false_obstacles.len();
    found.false_obstacles.retain(|one| !found.moving_tracks.contains(&one.track));
    tally.false_obstacles = found.false_obstacles.len();
    tally.moving_obstacles = in_strip - tally.false_obstacles;
    tally.moving_tracks = found.moving_tracks.len();
    tally.false_tracks = speeds.len() - tally.moving_tracks;
    tally.steadiness = steadiness(records, view);
    found
}

/// Shortest time, in s, over which a track has to be measured in the strip to count as moving: what drives ahead stays there, and
/// false obstacles come and go.
const MIN_MOVING_S: f64 = 1.0;

/// In how many frames in which it was measured in the strip a track's speed was known, and in how many of them it moved along.
#[derive(Clone, Copy, Debug, Default)]
struct Speeds {
    known: usize,
    along: usize,
    /// Times of the first and the last of them, in s.
    span_s: Option<[f64; 2]>,
}

impl Speeds {
    fn add(&mut self, time_s: f64, moves_along: Option<bool>) {
        let Some(moves_along) = moves_along else { return };
        self.known += 1;
        self.along += usize::from(moves_along);
        let first_s = self.span_s.map_or(time_s, |[first_s, _]| first_s);
        self.span_s = Some([first_s, time_s]);
    }

    /// A track is judged as a whole: at first its speed is not known, and a few frames are no proof.
    fn is_moving(self) -> bool {
        2 * self.along > self.known && self.span_s.is_some_and(|[first, last]| last - first >= MIN_MOVING_S)
    }
}

impl Levels {
    fn add(&mut self, level: &str) {
        let [off, clear, warning, alarm] = LEVELS;
        let count = match level {
            _ if level == alarm => &mut self.alarm,
            _ if level == warning => &mut self.warning,
            _ if level == clear => &mut self.clear,
            // A level that this version does not know says nothing.
            _ => {
                debug_assert_eq!(level, off);
                &mut self.off
            }
        };
        *count += 1;
    }
}

/// A share in percent; `None` of nothing.
fn percent(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| tidy(100.0 * part as f64 / whole as f64))
}

impl Tally {
    /// Adds the counts of another drive.
    pub fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.seconds += other.seconds;
        self.levels.off += other.levels.off;
        self.levels.clear += other.levels.clear;
        self.levels.warning += other.levels.warning;
        self.levels.alarm += other.levels.alarm;
        self.warnings += other.warnings;
        self.alarms += other.alarms;
        for (reason, frames) in &other.off_reasons {
            *self.off_reasons.entry(reason.clone()).or_default() += frames;
        }
        self.judged += other.judged;
        self.false_obstacles += other.false_obstacles;
        self.false_tracks += other.false_tracks;
        self.moving_obstacles += other.moving_obstacles;
        self.moving_tracks += other.moving_tracks;
        self.ground.add(&other.ground);
        self.steadiness.add(&other.steadiness);
    }

    /// The figures.
    pub fn score(&self) -> DriveScore {
        let s = &self.steadiness;
        let life = median_life(&s.lives, Life::is_lost);
        let strict = median_life(&s.lives, Life::is_lost_strictly);
        let ended = |end: End| s.lives.iter().filter(|life| life.end == end).count();
        let per_frame = |count: usize| tidy(count as f64 / self.judged.max(1) as f64);
        let in_strip = self.false_obstacles + self.moving_obstacles;
        DriveScore {
            frames: self.frames,
            seconds: tidy(self.seconds),
            levels: self.levels,
            warnings: self.warnings,
            alarms: self.alarms,
            off_percent: percent(self.levels.off, self.frames),
            off_reasons: self.off_reasons.clone(),
            judged: self.judged,
            false_obstacles: self.false_obstacles,
            false_tracks: self.false_tracks,
            false_per_frame: per_frame(self.false_obstacles),
            moving_obstacles: self.moving_obstacles,
            moving_tracks: self.moving_tracks,
            in_strip_obstacles: in_strip,
            in_strip_tracks: self.false_tracks + self.moving_tracks,
            in_strip_per_frame: per_frame(in_strip),
            driven_m: tidy(self.ground.driven_m),
            not_free_m: tidy(self.ground.not_free_m),
            not_free_percent: self.ground.not_free_percent().map(tidy),
            tracks: s.lives.len(),
            tracks_lost: ended(End::Lost),
            tracks_hidden: ended(End::Hidden),
            tracks_to_boundary: ended(End::Boundary),
            life_median_s: life.map(|(seconds, _)| tidy(seconds)),
            life_is_lower_limit: life.is_some_and(|(_, is_limit)| is_limit),
            life_strict_s: strict.map(|(seconds, _)| tidy(seconds)),
            life_strict_is_lower_limit: strict.is_some_and(|(_, is_limit)| is_limit),
            boxes: s.boxes,
            predicted_percent: percent(s.predicted, s.boxes),
            without_size: s.without_size,
            width_pairs: s.pairs,
            width_jumps_percent: percent(s.jumps, s.pairs),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::strip::tests::{straight, thing};
    use super::*;
    use crate::reporting::record::{AlarmLine, ObstacleLine};
    use perception::range::Range;

    const VIEW: View =
        View { width_px: 640, height_px: 480, px_at_1_m: 200.0, near_m: 2.0, range: Range::fixed(60.0) };

    fn record(i: usize, level: &str, obstacles: Vec<ObstacleLine>) -> FrameRecord {
        FrameRecord {
            sequence: i as u64,
            time_s: 0.1 * i as f64,
            alarm: AlarmLine { level: level.into(), ..AlarmLine::default() },
            obstacles,
            ..FrameRecord::default()
        }
    }

    #[test]
    fn a_thing_in_the_strip_counts_in_every_judged_frame_and_its_track_once() {
        let path = straight(60, 8.0);
        let records: Vec<FrameRecord> = (0..60)
            .map(|i| {
                let track = if i < 10 { 1 } else { 2 };
                let thing = ObstacleLine { track, ..thing(12.0, 0.5, 1.0) };
                record(i, "clear", if !(20..=50).contains(&i) { vec![thing] } else { vec![] })
            })
            .collect();
        let found = judge(&path, &records, &[], &VIEW);
        let score = found.tally.score();
        // Of the last 14 frames too little is known.
        assert_eq!((score.frames, score.judged, score.seconds), (60, 46, 5.9));
        assert_eq!((score.false_obstacles, score.false_tracks), (20, 2));
        assert_eq!(score.false_per_frame, 0.4348);
        let first = found.false_obstacles[0];
        assert_eq!((first.frame, first.track, first.overlap_m), (0, 1, 0.9));
        // Nothing in the strip: nothing is false, and shares of nothing are none.
        let silent: Vec<FrameRecord> = (0..60).map(|i| record(i, "clear", Vec::new())).collect();
        let score = judge(&path, &silent, &[], &VIEW).tally.score();
        assert_eq!((score.false_obstacles, score.false_per_frame, score.levels.clear), (0, 0.0, 60));
        assert_eq!((score.predicted_percent, score.life_median_s), (None, None));
    }

    #[test]
    fn what_drives_ahead_in_the_strip_is_not_judged() {
        let path = straight(60, 8.0);
        let along = |track, closing_m_s| ObstacleLine {
            track,
            closing_m_s,
            closing_sigma_m_s: closing_m_s.map(|_| 0.3),
            ..thing(12.0, 0.0, 1.8)
        };
        // Track 1 drives ahead as fast as the vehicle; its speed is not known at first. Track 2 stands, but once seemed to drive.
        // Track 3 seems to drive for half a second, and is then predicted to go on.
        let records: Vec<FrameRecord> = (0..60)
            .map(|i| {
                let first = along(1, (i > 3).then_some(0.0));
                let second = along(2, Some(if i == 12 { 0.0 } else { 8.0 }));
                let third = ObstacleLine { missed: u32::from(i > 15), ..along(3, Some(0.0)) };
                let here = match i {
                    10..30 => vec![first, second, third],
                    30.. => vec![first, second],
                    _ => vec![first],
                };
                record(i, "clear", here)
            })
            .collect();
        let found = judge(&path, &records, &[], &VIEW);
        let score = found.tally.score();
        assert_eq!((score.judged, score.moving_obstacles, score.moving_tracks), (46, 46, 1));
        assert_eq!((score.false_obstacles, score.false_tracks, score.false_per_frame), (56, 2, 1.2174));
        assert_eq!(
            (score.in_strip_obstacles, score.in_strip_tracks, score.in_strip_per_frame),
            (102, 3, 2.2174)
        );
        assert!(found.false_obstacles.iter().all(|one| one.track != 1) && found.moving_tracks.contains(&1));
    }

    #[test]
    fn levels_onsets_and_reasons_are_counted() {
        let levels =
            ["off", "off", "warning", "warning", "alarm", "warning", "clear", "alarm", "off", "alarm"];
        let records: Vec<FrameRecord> =
            levels.iter().enumerate().map(|(i, level)| record(i, level, Vec::new())).collect();
        let [dark, road] = ["the picture is too dark", "no road seen"].map(String::from);
        let mut reasons = vec![Vec::new(); 10];
        (reasons[0], reasons[1]) = (vec![dark.clone(), road.clone()], vec![road.clone()]);
        (reasons[8], reasons[9]) = (vec![road.clone()], vec![dark.clone()]);
        let mut found = judge(&straight(10, 8.0), &records, &reasons, &VIEW);
        let score = found.tally.score();
        assert_eq!(score.levels, Levels { off: 3, clear: 1, warning: 3, alarm: 3 });
        assert_eq!((score.warnings, score.alarms, score.off_percent), (3, 3, Some(30.0)));
        let onsets: Vec<(usize, &str)> = found.onsets.iter().map(|o| (o.frame, o.level)).collect();
        let expected =
            [(2, "warning"), (4, "alarm"), (7, "warning"), (7, "alarm"), (9, "warning"), (9, "alarm")];
        assert_eq!(onsets, expected);
        // Reasons of a frame in which the alarm was on do not count.
        assert_eq!(score.off_reasons, BTreeMap::from([(dark, 1), (road, 3)]));
        let once = found.tally.clone();
        found.tally.add(&once);
        let both = found.tally.score();
        assert_eq!((both.frames, both.levels.alarm, both.warnings), (20, 6, 6));
        assert_eq!((both.off_percent, both.seconds, both.judged), (Some(30.0), 1.8, 0));
        // The path is shorter than the recording.
        assert_eq!(judge(&straight(4, 8.0), &records, &reasons, &VIEW).tally.score().frames, 4);
    }
}
