//! How steady tracks and their boxes are: lives, jumps of the width, predictions, boxes without size. Only confirmed
//! obstacles count: they are what drivers and alarm see.

use super::life::{End, Life};
use crate::reporting::record::{FrameRecord, ObstacleLine};
use perception::outline::BODY_LENGTH_M;
use perception::range::Range;
use std::collections::BTreeMap;

/// What the cameras see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct View {
    /// Width of the picture, in px.
    pub width_px: u32,
    /// Height of the picture, in px.
    pub height_px: u32,
    /// Disparity at a distance of 1 m, in px: on the left, the right camera misses as many columns as the disparity.
    pub px_at_1_m: f64,
    /// Nearest distance that can be measured, in metres: that of the largest disparity.
    pub near_m: f64,
    /// How far things are reported.
    pub range: Range,
}

/// A box this near to the picture's edge is cut by it, in px: stixels are this wide.
const EDGE_PX: f64 = 4.0;

/// Share of the range by which a track may end before its limit: the error of a distance.
const RANGE_SHARE: f64 = 0.1;

/// What is nearer than a thing by more than [`BODY_LENGTH_M`] may hide it; nearer still is a part of it, or it a part of that. It is
/// hidden if the box of one such thing covers at least this share of its own.
const HIDDEN_SHARE: f64 = 0.5;

/// A thing is told as a boundary if a new one passes its near side at most this far beside an end or the middle of it, in metres,
const BOUNDARY_M: f64 = 0.5;
/// at most this time after its last sighting, in seconds: boundaries are confirmed in less.
const BOUNDARY_S: f64 = 0.5;

/// A width jumps if it grows or shrinks by more than this factor from one frame to the next.
pub const MAX_WIDTH_RATIO: f64 = 1.3;

/// Counts over the confirmed boxes of a drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steadiness {
    /// Lives of the tracks.
    pub lives: Vec<Life>,
    /// Number of boxes.
    pub boxes: usize,
    /// Of them predictions: not detected in that frame.
    pub predicted: usize,
    /// Of them without width or height, in px or in metres.
    pub without_size: usize,
    /// Number of pairs of measured boxes of a track in consecutive frames, neither cut by the picture's left or right edge.
    pub pairs: usize,
    /// Of them with a jump of the width in the picture by more than [`MAX_WIDTH_RATIO`].
    pub jumps: usize,
}

/// The sightings of one track.
struct Seen<'a> {
    first: usize,
    /// Frame and box of the last two sightings, the last one first.
    last: [Option<(usize, &'a ObstacleLine)>; 2],
}

/// Where a thing is to be seen in a frame: left, top, right and bottom of its box, in px, and its distance, in metres.
#[derive(Clone, Copy, Debug)]
struct Place {
    edges: [f64; 4],
    distance_m: f64,
}

impl Place {
    fn of(obstacle: &ObstacleLine) -> Self {
        let [x, y] = [obstacle.x_px, obstacle.y_px].map(f64::from);
        let edges = [x, y, x + f64::from(obstacle.width_px), y + f64::from(obstacle.height_px)];
        Self { edges, distance_m: obstacle.distance_m }
    }

    /// The place one step further on, as from `before` to this one in `frames` frames.
    fn moved_on(&self, before: &Self, frames: f64) -> Self {
        let on = |now: f64, before: f64| now + (now - before) / frames;
        Self {
            edges: std::array::from_fn(|i| on(self.edges[i], before.edges[i])),
            distance_m: on(self.distance_m, before.distance_m),
        }
    }

    /// Largest share of the box that lies within the box of one much nearer thing.
    fn hidden_share(&self, obstacles: &[ObstacleLine]) -> f64 {
        let [left, top, right, bottom] = self.edges;
        let is_nearer = |o: &&ObstacleLine| o.confirmed && o.distance_m < self.distance_m - BODY_LENGTH_M;
        let shared_px2 = |o: &ObstacleLine| {
            let [l, t, r, b] = Self::of(o).edges;
            (right.min(r) - left.max(l)).max(0.0) * (bottom.min(b) - top.max(t)).max(0.0)
        };
        let area_px2 = ((right - left) * (bottom - top)).max(1.0);
        obstacles.iter().filter(is_nearer).map(shared_px2).fold(0.0, f64::max) / area_px2
    }
}

impl View {
    fn is_cut_sideways(&self, left_px: f64, right_px: f64) -> bool {
        left_px <= EDGE_PX || right_px >= f64::from(self.width_px) - EDGE_PX
    }

    /// Whether something at a place is cut by what both cameras see, or is farther away than the range `far_m`, in metres.
    fn has_left(&self, far_m: f64, place: &Place) -> bool {
        let [left, _, right, bottom] = place.edges;
        let distance_m = place.distance_m;
        self.is_cut_sideways(left - self.px_at_1_m / distance_m.max(self.near_m), right)
            || bottom >= f64::from(self.height_px) - EDGE_PX
            || distance_m <= self.near_m * (1.0 + RANGE_SHARE)
            || distance_m >= far_m * (1.0 - RANGE_SHARE)
    }

    /// Why nothing more was seen of a track.
    fn end(&self, seen: &Seen<'_>, records: &[FrameRecord]) -> End {
        let [Some((at, last_line)), before] = seen.last else { return End::Lost };
        let far_m = self.range.at_m(records[at].motion.speed_m_s.unwrap_or(0.0));
        let last = Place::of(last_line);
        let next = before.map_or(last, |(before_at, before)| {
            last.moved_on(&Place::of(before), (at - before_at).max(1) as f64)
        });
        if [last, next].iter().any(|place| self.has_left(far_m, place)) {
            End::Left
        } else if records.get(at + 1).is_some_and(|r| next.hidden_share(&r.obstacles) >= HIDDEN_SHARE) {
            End::Hidden
        } else if becomes_boundary(last_line, records, at) {
            End::Boundary
        } else {
            End::Lost
        }
    }
}

/// Whether a boundary is told at the place of what was seen in frame `at`, and stands, soon after, and none was told there before.
fn becomes_boundary(thing: &ObstacleLine, records: &[FrameRecord], at: usize) -> bool {
    let start_s = records[at].time_s;
    let speed_m_s = records[at].motion.speed_m_s.unwrap_or(0.0);
    let is_told = |record: &FrameRecord| {
        let ahead_m = thing.distance_m - speed_m_s * (record.time_s - start_s);
        // Its near side: both ends and the middle.
        let places = [-0.5, 0.0, 0.5].map(|share| [thing.lateral_m + share * thing.width_m, ahead_m]);
        let is_beside = |pair: &[[f64; 2]]| {
            places.iter().any(|place| from_line_m(*place, pair[0], pair[1]) <= BOUNDARY_M)
        };
        record.boundaries.iter().any(|boundary| boundary.points_m.windows(2).any(is_beside))
    };
    let mut after = records[at + 1..].iter().take_while(|record| record.time_s - start_s <= BOUNDARY_S);
    !is_told(&records[at]) && after.any(is_told)
}

/// Distance of a point from a line between two others, in metres.
fn from_line_m(point: [f64; 2], from: [f64; 2], to: [f64; 2]) -> f64 {
    let minus = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
    let (line, own) = (minus(to, from), minus(point, from));
    let share = (own[0] * line[0] + own[1] * line[1]) / (line[0].powi(2) + line[1].powi(2)).max(1e-9);
    let share = share.clamp(0.0, 1.0);
    (own[0] - share * line[0]).hypot(own[1] - share * line[1])
}

/// Whether a box has no size.
fn is_without_size(obstacle: &ObstacleLine) -> bool {
    obstacle.width_px == 0 || obstacle.height_px == 0 || obstacle.width_m <= 0.0 || obstacle.height_m <= 0.0
}

/// Counts over the frames of a drive, whose times are `time_s`.
///
/// A track's life ends with its last sighting. It is lost if its thing should still be seen then: its box touches neither
/// the sides of what both cameras see nor the lower edge of the picture, its distance is within the range, the same holds for the box
/// moved on to the next frame by its last step, nothing that is much nearer covers that, it is not told as a boundary instead, and the
/// recording goes on after the track's end.
pub fn steadiness(records: &[FrameRecord], view: &View) -> Steadiness {
    let mut found = Steadiness::default();
    let mut tracks: BTreeMap<u32, Seen<'_>> = BTreeMap::new();
    for (frame, record) in records.iter().enumerate() {
        for obstacle in record.obstacles.iter().filter(|o| o.confirmed) {
            found.boxes += 1;
            found.without_size += usize::from(is_without_size(obstacle));
            found.predicted += usize::from(obstacle.missed > 0);
            let seen = tracks.entry(obstacle.track).or_insert(Seen { first: frame, last: [None; 2] });
            if obstacle.missed > 0 {
                continue;
            }
            if let Some((before, last)) = seen.last[0]
                && before + 1 == frame
            {
                found.add_pair(last, obstacle, view);
            }
            seen.last = [Some((frame, obstacle)), seen.last[0]];
        }
    }
    let alive: Vec<u32> =
        records.last().iter().flat_map(|record| &record.obstacles).map(|obstacle| obstacle.track).collect();
    let period_s = period_s(records);
    for (track, seen) in &tracks {
        // A track that was only predicted while confirmed lives for its first frame.
        let last = seen.last[0].map_or(seen.first, |(frame, _)| frame);
        let end = if alive.contains(track) { End::Left } else { view.end(seen, records) };
        let seconds = records[last].time_s - records[seen.first].time_s + period_s;
        found.lives.push(Life { seconds, end });
    }
    found
}

/// Median time from one frame to the next, in seconds.
fn period_s(records: &[FrameRecord]) -> f64 {
    let mut steps: Vec<f64> = records.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
    crate::evaluation::quantile(&mut steps, 0.5).unwrap_or(0.0).max(0.0)
}

impl Steadiness {
    fn add_pair(&mut self, before: &ObstacleLine, now: &ObstacleLine, view: &View) {
        let is_cut = |o: &ObstacleLine| view.is_cut_sideways(o.x_px.into(), f64::from(o.x_px + o.width_px));
        if is_cut(before) || is_cut(now) {
            return;
        }
        self.pairs += 1;
        let [less, more] = [before.width_px.min(now.width_px), before.width_px.max(now.width_px)];
        self.jumps += usize::from(f64::from(more) > MAX_WIDTH_RATIO * f64::from(less));
    }

    /// Adds the counts of another drive.
    pub fn add(&mut self, other: &Self) {
        self.lives.extend(&other.lives);
        self.boxes += other.boxes;
        self.predicted += other.predicted;
        self.without_size += other.without_size;
        self.pairs += other.pairs;
        self.jumps += other.jumps;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reporting::space::BoundaryLine;

    const VIEW: View =
        View { width_px: 640, height_px: 480, px_at_1_m: 200.0, near_m: 2.0, range: Range::fixed(60.0) };

    fn line(track: u32, x_px: u32, width_px: u32, missed: u32) -> ObstacleLine {
        ObstacleLine {
            track,
            confirmed: true,
            missed,
            x_px,
            y_px: 200,
            width_px,
            height_px: 40,
            distance_m: 20.0,
            width_m: 1.0,
            height_m: 1.0,
            ..ObstacleLine::default()
        }
    }

    fn drive(frames: Vec<Vec<ObstacleLine>>) -> Vec<FrameRecord> {
        let record = |(i, obstacles): (usize, Vec<ObstacleLine>)| FrameRecord {
            sequence: i as u64,
            time_s: 0.1 * i as f64,
            obstacles,
            ..FrameRecord::default()
        };
        frames.into_iter().enumerate().map(record).collect()
    }

    fn lives(frames: Vec<Vec<ObstacleLine>>) -> Vec<(i32, bool)> {
        let found = steadiness(&drive(frames), &VIEW);
        found.lives.iter().map(|life| ((life.seconds * 10.0).round() as i32, life.is_lost())).collect()
    }

    #[test]
    fn a_track_is_lost_unless_its_thing_has_left() {
        let in_view = |track| line(track, 300, 50, 0);
        // Two sightings and a prediction; the recording goes on.
        let lost = vec![vec![in_view(1)], vec![in_view(1)], vec![line(1, 300, 50, 1)], vec![], vec![]];
        assert_eq!(lives(lost), [(2, true)]);
        // It is still there at the end, be it predicted.
        assert_eq!(lives(vec![vec![in_view(1)], vec![line(1, 300, 50, 1)]]), [(1, false)]);
        // At the left edge, and on its way out at the right one.
        assert_eq!(lives(vec![vec![line(1, 2, 50, 0)], vec![], vec![]]), [(1, false)]);
        let out = vec![vec![line(1, 500, 50, 0)], vec![line(1, 545, 50, 0)], vec![], vec![]];
        assert_eq!(lives(out), [(2, false)]);
        // What lies left of it only the left camera sees: at 20 m 10 columns.
        for (x_px, is_lost) in [(13, false), (15, true)] {
            assert_eq!(lives(vec![vec![line(1, x_px, 50, 0)], vec![], vec![]]), [(1, is_lost)], "{x_px}");
        }
        // Too near, too far.
        for (distance_m, is_lost) in [(2.1, false), (3.0, true), (53.0, true), (55.0, false)] {
            let thing = ObstacleLine { distance_m, ..in_view(1) };
            assert_eq!(lives(vec![vec![thing], vec![], vec![]]), [(1, is_lost)], "{distance_m}");
        }
        // The faster, the farther things are reported.
        let view = View { range: Range { slow_m: 60.0, fast_m: 120.0 }, ..VIEW };
        for (speed_m_s, is_lost) in [(None, false), (Some(5.0), false), (Some(25.0), true)] {
            let thing = ObstacleLine { distance_m: 55.0, ..in_view(1) };
            let mut records = drive(vec![vec![thing], vec![], vec![]]);
            records.iter_mut().for_each(|record| record.motion.speed_m_s = speed_m_s);
            assert_eq!(steadiness(&records, &view).lives[0].is_lost(), is_lost, "{speed_m_s:?}");
        }
        // One that is not confirmed is no track yet.
        let not_yet = ObstacleLine { confirmed: false, ..in_view(1) };
        assert_eq!(lives(vec![vec![not_yet], vec![in_view(1)], vec![], vec![]]), [(1, true)]);
    }

    #[test]
    fn what_something_much_nearer_covers_is_hidden() {
        // A thing at 20 m, and in the next frames one before it that covers this share of its box.
        let end = |distance_m: f64, share: f64, confirmed: bool| {
            let width_px = (50.0 * share) as u32;
            let near = ObstacleLine { distance_m, confirmed, ..line(2, 300, width_px, 0) };
            let frames = vec![vec![line(1, 300, 50, 0)], vec![near.clone()], vec![near.clone()], vec![near]];
            steadiness(&drive(frames), &VIEW).lives[0].end
        };
        assert_eq!(end(10.0, 0.6, true), End::Hidden);
        assert_eq!(end(10.0, 0.4, true), End::Lost);
        assert_eq!(end(16.0, 1.0, true), End::Lost, "its own side, or that of the other");
        assert_eq!(end(10.0, 1.0, false), End::Lost);
    }

    #[test]
    fn what_is_told_as_a_boundary_from_then_on_is_not_lost() {
        // A piece of a fence 20 m ahead and 3 m to the left; we drive 10 m/s. In a later frame a fence is told there, or elsewhere.
        let end = |frames: &[usize], lateral_m: f64| {
            let piece = ObstacleLine { lateral_m: -3.0, ..line(1, 300, 50, 0) };
            let mut records =
                drive((0..9).map(|i| if i == 0 { vec![piece.clone()] } else { vec![] }).collect());
            records[0].motion.speed_m_s = Some(10.0);
            let points_m = vec![[lateral_m, 10.0], [lateral_m, 22.0]];
            for frame in frames {
                let points_m = points_m.clone();
                records[*frame].boundaries = vec![BoundaryLine { points_m, ..BoundaryLine::default() }];
            }
            steadiness(&records, &VIEW).lives[0].end
        };
        assert_eq!(end(&[3], -3.8), End::Boundary);
        assert_eq!(end(&[3], -4.2), End::Lost, "beside it");
        assert_eq!(end(&[7], -3.8), End::Lost, "too late");
        assert_eq!(end(&[0, 1, 2, 3], -3.8), End::Lost, "it was there before");
    }

    #[test]
    fn boxes_are_counted() {
        let frames = vec![
            vec![line(1, 300, 50, 0), line(2, 100, 40, 0), line(3, 1, 40, 0)],
            // A jump; no jump; cut by the edge.
            vec![line(1, 300, 66, 0), line(2, 100, 52, 0), line(3, 1, 80, 0)],
            vec![line(1, 300, 66, 1), line(2, 100, 0, 0)],
            // The sighting before was two frames ago.
            vec![line(1, 300, 20, 0), ObstacleLine { confirmed: false, ..line(4, 300, 0, 0) }],
        ];
        let mut found = steadiness(&drive(frames), &VIEW);
        assert_eq!((found.boxes, found.predicted, found.without_size), (9, 1, 1));
        // Of the second thing the width fell to nothing.
        assert_eq!((found.pairs, found.jumps), (3, 2));
        let once = found.clone();
        found.add(&once);
        assert_eq!((found.boxes, found.jumps, found.lives.len()), (18, 4, 6));
        assert_eq!(steadiness(&[], &VIEW), Steadiness::default());
    }
}
