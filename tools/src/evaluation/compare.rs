//! Frame-by-frame comparison of two runs: which frames differ, and by how much.

use crate::reporting::record::{FrameRecord, ObstacleLine};
use serde::Serialize;
use sources::limits::RESULTS;
use sources::recording::{Index, OBSTACLES, RecordingError, RecordingSource};
use sources::{SourceError, bounded_file};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Boxes with a smaller overlap (intersection over union) are different obstacles.
const MIN_OVERLAP: f64 = 0.3;

/// Why a run cannot be read.
#[derive(Debug, Error)]
pub enum CompareError {
    /// A file cannot be read.
    #[error(
        "{}: {source}: give a folder of lookout replay --out, its obstacles.jsonl, or a recording with obstacles",
        path.display()
    )]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// A line or message is not a frame.
    #[error("{}: {place}: {reason}", path.display())]
    Line {
        /// Path of the file.
        path: PathBuf,
        /// Line or message.
        place: String,
        /// The fault.
        reason: String,
    },
    /// An invalid recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The pairs of a recording cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// No frames.
    #[error(
        "{}: no frames here: give a folder of lookout replay --out, its obstacles.jsonl, or a recording with obstacles",
        path.display()
    )]
    Empty {
        /// Folder or file.
        path: PathBuf,
    },
}

/// Frames of a run by sequence number.
pub type Frames = BTreeMap<u64, FrameRecord>;

/// Differences up to these values are ignored.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerance {
    /// For distances, in metres.
    pub distance_m: f64,
    /// For the sides of boxes, in pixels.
    pub box_px: u32,
}

/// Reads the frames of a run: a folder of `replay --out`, a `.jsonl` file, or a recording. With `by_pair` the
/// frames of a recording are numbered by the pairs in it, as a replay numbers them.
///
/// # Errors
/// Names the file and the line.
pub fn read(path: &Path, by_pair: bool) -> Result<Frames, CompareError> {
    let frames = if is_recording(path) { recorded(path, by_pair)? } else { lines(path)? };
    if frames.is_empty() { Err(CompareError::Empty { path: path.to_owned() }) } else { Ok(frames) }
}

/// Whether a path is a recording, by its ending or its first bytes.
pub fn is_recording(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == sources::recording::ENDING) || sources::recording::has_magic(path)
}

fn lines(path: &Path) -> Result<Frames, CompareError> {
    let path = if path.is_dir() { path.join("obstacles.jsonl") } else { path.to_owned() };
    let text = bounded_file::read_text(&path, &RESULTS)
        .map_err(|source| CompareError::Io { path: path.clone(), source })?;
    let mut frames = Frames::new();
    for (i, line) in text.lines().enumerate() {
        let record: FrameRecord = serde_json::from_str(line).map_err(|e| CompareError::Line {
            path: path.clone(),
            place: format!("line {}", i + 1),
            reason: e.to_string(),
        })?;
        frames.insert(record.sequence, record);
    }
    Ok(frames)
}

fn recorded(path: &Path, by_pair: bool) -> Result<Frames, CompareError> {
    let mut index = Index::open(path)?;
    let times = if by_pair { RecordingSource::open(path)?.times_ns() } else { Vec::new() };
    let mut frames = Frames::new();
    for message in index.all_of(OBSTACLES)? {
        let mut record: FrameRecord =
            serde_json::from_slice(&message.data).map_err(|e| CompareError::Line {
                path: path.to_owned(),
                place: format!("message at {} ns", message.time_ns),
                reason: e.to_string(),
            })?;
        if by_pair {
            // A frame whose pair was not recorded appears in no replay.
            let Ok(number) = times.binary_search(&message.time_ns) else { continue };
            record.sequence = number as u64;
        }
        frames.insert(record.sequence, record);
    }
    Ok(frames)
}

/// Differences of one frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameDifference {
    /// Sequence number.
    pub sequence: u64,
    /// Tracks of unmatched obstacles of the first run.
    pub only_in_a: Vec<u32>,
    /// Tracks of unmatched obstacles of the second run.
    pub only_in_b: Vec<u32>,
    /// Largest difference of a distance, in metres.
    pub distance_m: f64,
    /// Largest difference of a side of a box, in pixels.
    pub box_px: u32,
    /// Obstacles with another track, class or state.
    pub identities: u32,
    /// Alarm levels of both runs, where they differ.
    pub alarm: Option<[String; 2]>,
    /// Whether the nearest distance or the road differs.
    pub road_or_nearest: bool,
    /// Whether the vehicle's own motion or its path differs; only without a tolerance.
    pub motion: bool,
}

/// Differences of two runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// Frames in both runs.
    pub frames: usize,
    /// Number of these that differ.
    pub differing: usize,
    /// Frames in the first run only.
    pub only_in_a: Vec<u64>,
    /// Frames in the second run only.
    pub only_in_b: Vec<u64>,
    /// Frames whose alarm differs.
    pub alarms: usize,
    /// Unmatched obstacles of both runs.
    pub unmatched: usize,
    /// Obstacles with another track, class or state.
    pub identities: usize,
    /// Largest difference of a distance, in metres.
    pub distance_m_max: f64,
    /// Mean difference of distances over all matched obstacles, in metres.
    pub distance_m_mean: f64,
    /// Largest difference of a side of a box, in pixels.
    pub box_px_max: u32,
    /// The frames that differ.
    pub differences: Vec<FrameDifference>,
}

impl Comparison {
    /// Whether nothing differs.
    pub fn is_same(&self) -> bool {
        self.differing == 0 && self.only_in_a.is_empty() && self.only_in_b.is_empty()
    }
}

/// Compares two runs frame by frame.
pub fn compare(a: &Frames, b: &Frames, tolerance: Tolerance) -> Comparison {
    let mut result = Comparison {
        only_in_a: a.keys().filter(|s| !b.contains_key(s)).copied().collect(),
        only_in_b: b.keys().filter(|s| !a.contains_key(s)).copied().collect(),
        ..Comparison::default()
    };
    let (mut sum_m, mut pairs) = (0.0, 0_usize);
    for (sequence, first) in a {
        let Some(second) = b.get(sequence) else { continue };
        result.frames += 1;
        let matches = match_up(&first.obstacles, &second.obstacles);
        let mut d = FrameDifference { sequence: *sequence, ..FrameDifference::default() };
        for (x, y) in &matches {
            let apart = (x.distance_m - y.distance_m).abs();
            sum_m += apart;
            pairs += 1;
            d.distance_m = d.distance_m.max(apart);
            d.box_px = d.box_px.max(box_apart(x, y));
            d.identities += u32::from((x.track, &x.class, x.confirmed) != (y.track, &y.class, y.confirmed));
        }
        let alone = |own: &[ObstacleLine], matched: &dyn Fn(&ObstacleLine) -> bool| -> Vec<u32> {
            own.iter().filter(|o| !matched(o)).map(|o| o.track).collect()
        };
        d.only_in_a = alone(&first.obstacles, &|o| matches.iter().any(|(x, _)| std::ptr::eq(*x, o)));
        d.only_in_b = alone(&second.obstacles, &|o| matches.iter().any(|(_, y)| std::ptr::eq(*y, o)));
        if first.alarm.level != second.alarm.level {
            d.alarm = Some([first.alarm.level.clone(), second.alarm.level.clone()]);
        }
        let nearest = match (first.alarm.nearest_m, second.alarm.nearest_m) {
            (Some(x), Some(y)) => (x - y).abs() > tolerance.distance_m,
            (x, y) => x.is_some() != y.is_some(),
        };
        // With a tolerance, only quantities that affect the vehicle count.
        let is_exact = tolerance == Tolerance::default();
        d.road_or_nearest = nearest || (is_exact && first.road != second.road);
        d.motion = is_exact && (first.motion != second.motion || first.path != second.path);
        result.distance_m_max = result.distance_m_max.max(d.distance_m);
        result.box_px_max = result.box_px_max.max(d.box_px);
        let differs = d.distance_m > tolerance.distance_m
            || d.box_px > tolerance.box_px
            || !d.only_in_a.is_empty()
            || !d.only_in_b.is_empty()
            || d.identities > 0
            || d.alarm.is_some()
            || d.road_or_nearest
            || (is_exact && first != second);
        if differs {
            result.differing += 1;
            result.alarms += usize::from(d.alarm.is_some());
            result.unmatched += d.only_in_a.len() + d.only_in_b.len();
            result.identities += d.identities as usize;
            result.differences.push(d);
        }
    }
    result.distance_m_mean = if pairs > 0 { sum_m / pairs as f64 } else { 0.0 };
    result
}

/// Largest difference of the four sides.
fn box_apart(a: &ObstacleLine, b: &ObstacleLine) -> u32 {
    let sides = |o: &ObstacleLine| [o.x_px, o.y_px, o.x_px + o.width_px, o.y_px + o.height_px];
    sides(a).iter().zip(sides(b)).map(|(x, y)| x.abs_diff(y)).max().unwrap_or(0)
}

fn overlap(a: &ObstacleLine, b: &ObstacleLine) -> f64 {
    // A box at the image border may have no area.
    if box_apart(a, b) == 0 {
        return 1.0;
    }
    let along = |a0: u32, a_len: u32, b0: u32, b_len: u32| {
        f64::from((a0 + a_len).min(b0 + b_len)) - f64::from(a0.max(b0))
    };
    let width = along(a.x_px, a.width_px, b.x_px, b.width_px).max(0.0);
    let height = along(a.y_px, a.height_px, b.y_px, b.height_px).max(0.0);
    let area = |o: &ObstacleLine| f64::from(o.width_px) * f64::from(o.height_px);
    let both = width * height;
    both / (area(a) + area(b) - both).max(1.0)
}

/// Matches obstacles of both runs by decreasing overlap; ties prefer equal tracks.
fn match_up<'a>(a: &'a [ObstacleLine], b: &'a [ObstacleLine]) -> Vec<(&'a ObstacleLine, &'a ObstacleLine)> {
    let mut candidates: Vec<(f64, bool, usize, usize)> = Vec::new();
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            let shared = overlap(x, y);
            if shared >= MIN_OVERLAP {
                candidates.push((shared, x.track == y.track, i, j));
            }
        }
    }
    candidates.sort_by(|p, q| q.0.total_cmp(&p.0).then(q.1.cmp(&p.1)));
    let (mut taken_a, mut taken_b) = (vec![false; a.len()], vec![false; b.len()]);
    let mut matches = Vec::new();
    for (_, _, i, j) in candidates {
        if !taken_a[i] && !taken_b[j] {
            (taken_a[i], taken_b[j]) = (true, true);
            matches.push((&a[i], &b[j]));
        }
    }
    matches
}

impl fmt::Display for FrameDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tracks = |tracks: &[u32]| tracks.iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
        write!(f, "frame {}:", self.sequence)?;
        let mut parts = Vec::new();
        if let Some([a, b]) = &self.alarm {
            parts.push(format!("alarm {a} / {b}"));
        }
        if !self.only_in_a.is_empty() {
            parts.push(format!("only in the first: track {}", tracks(&self.only_in_a)));
        }
        if !self.only_in_b.is_empty() {
            parts.push(format!("only in the second: track {}", tracks(&self.only_in_b)));
        }
        if self.distance_m > 0.0 {
            parts.push(format!("distance by {:.3} m", self.distance_m));
        }
        if self.box_px > 0 {
            parts.push(format!("box by {} px", self.box_px));
        }
        if self.identities > 0 {
            parts.push(format!("{} with another track, class or state", self.identities));
        }
        if self.road_or_nearest {
            parts.push("road or nearest distance".into());
        }
        if self.motion {
            parts.push("own motion or path".into());
        }
        if parts.is_empty() {
            parts.push("other obstacle values".into());
        }
        write!(f, " {}", parts.join("; "))
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} frames in both, {} differ; {} only in the first, {} only in the second\n\
             alarms differ in {} frames; {} unmatched obstacles, {} with another track, class or state\n\
             distances differ by {:.3} m at most, {:.4} m on average; boxes by {} px at most",
            self.frames,
            self.differing,
            self.only_in_a.len(),
            self.only_in_b.len(),
            self.alarms,
            self.unmatched,
            self.identities,
            self.distance_m_max,
            self.distance_m_mean,
            self.box_px_max
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reporting::record::AlarmLine;

    fn obstacle(track: u32, x_px: u32, distance_m: f64) -> ObstacleLine {
        let (y_px, width_px, height_px) = (50, 40, 30);
        ObstacleLine { track, x_px, y_px, width_px, height_px, distance_m, ..ObstacleLine::default() }
    }

    fn run(frames: &[(u64, &str, Vec<ObstacleLine>)]) -> Frames {
        let record = |(sequence, level, obstacles): &(u64, &str, Vec<ObstacleLine>)| FrameRecord {
            sequence: *sequence,
            alarm: AlarmLine { level: (*level).into(), ..AlarmLine::default() },
            obstacles: obstacles.clone(),
            ..FrameRecord::default()
        };
        frames.iter().map(|f| (f.0, record(f))).collect()
    }

    #[test]
    fn a_run_is_like_itself() {
        let a =
            run(&[(0, "clear", vec![obstacle(1, 10, 12.0), obstacle(2, 80, 20.0)]), (1, "alarm", vec![])]);
        let same = compare(&a, &a, Tolerance::default());
        assert!(same.is_same() && same.frames == 2, "{same:?}");
    }

    #[test]
    fn differences_are_measured_and_named() {
        let a = run(&[
            (0, "clear", vec![obstacle(1, 10, 12.0), obstacle(2, 80, 20.0)]),
            (1, "clear", vec![obstacle(1, 10, 12.0)]),
            (2, "clear", vec![]),
            (9, "clear", vec![]),
        ]);
        let b = run(&[
            (0, "clear", vec![obstacle(2, 80, 20.0), obstacle(1, 13, 12.5)]),
            (1, "alarm", vec![obstacle(7, 10, 12.0), obstacle(8, 200, 5.0)]),
            (2, "clear", vec![]),
            (10, "clear", vec![]),
        ]);
        let c = compare(&a, &b, Tolerance::default());
        assert_eq!((c.frames, c.differing, &c.only_in_a[..], &c.only_in_b[..]), (3, 2, &[9][..], &[10][..]));
        assert_eq!((c.box_px_max, c.distance_m_max, c.alarms, c.unmatched), (3, 0.5, 1, 1));
        assert_eq!(c.differences[1].only_in_b, [8]);
        assert_eq!(c.identities, 1, "track 1 became track 7");
        assert!(c.differences[1].to_string().contains("alarm clear / alarm"), "{}", c.differences[1]);
        let tolerant = compare(&a, &b, Tolerance { distance_m: 0.5, box_px: 3 });
        assert_eq!(tolerant.differing, 1);
        assert!(!tolerant.is_same(), "frames in only one run always differ");
        // Another motion is a difference, unless a tolerance is given.
        let mut moving = a.clone();
        moving.values_mut().for_each(|frame| frame.motion.known = frame.sequence == 2);
        let c = compare(&a, &moving, Tolerance::default());
        assert_eq!((c.differing, c.differences[0].sequence, c.differences[0].motion), (1, 2, true));
        assert!(c.differences[0].to_string().ends_with(": own motion or path"), "{}", c.differences[0]);
        assert!(compare(&a, &moving, Tolerance { distance_m: 0.1, box_px: 0 }).is_same());
    }

    #[test]
    fn unreadable_runs_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = |path: &Path| read(path, false).unwrap_err().to_string();
        assert!(error(folder.path()).contains("obstacles.jsonl"));
        std::fs::write(folder.path().join("obstacles.jsonl"), "").unwrap();
        assert!(error(folder.path()).contains("no frames here"));
        std::fs::write(folder.path().join("obstacles.jsonl"), "{\"sequence\": 1").unwrap();
        assert!(error(folder.path()).contains("line 1"));
        let file = folder.path().join("a.mcap");
        std::fs::write(&file, "not an mcap file").unwrap();
        assert!(error(&file).contains("no MCAP file"), "{}", error(&file));
    }
}
