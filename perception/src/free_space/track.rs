//! Boundaries over frames: moved by the own motion, confirmed and forgotten in seconds.
//!
//! What is seen of a boundary at once may be too short to tell it from a vehicle: between parked cars, at the picture's edge. Such
//! parts are put together on the ground as the vehicle drives; what they make together is a boundary by the same rule. A known point
//! stays while the disparities at its place show it, or something nearer; what is behind it ends it soon.

use super::boundary::{Boundary, BoundaryPoint, MAX_BOUNDARIES, MAX_POINTS, Side};
use super::corridor::Corridor;
use super::limits::{
    CONFIRM_S, FORGET_HIDDEN_S, FORGET_S, FORGET_THROUGH_S, GATE_SIGMAS, HEIGHT_STEP_M, LONGEST_VEHICLE_M,
    LOW_HEIGHT_M, MAX_HIDDEN_M, MIN_LENGTH_M, MIN_SPACING_M, PART_SHARE, RAISED_M, ROUGHNESS_M, STEADY_SHARE,
};
use super::look::Look;
use crate::motion::planar::PlanarStep;

/// Nearest distance of a point that is kept, in metres.
const MIN_DISTANCE_M: f64 = 1.0;

/// Maximum number of boundaries, and of what may become one, that are followed.
const MAX_TRACKS: usize = 4 * MAX_BOUNDARIES;

/// A boundary, or what may become one, that is followed.
#[derive(Clone, Copy, Debug)]
struct Track {
    boundary: Boundary,
    /// Whether it is one.
    is_boundary: bool,
    /// Time for which it was measured, in seconds.
    seen_s: f64,
    /// Whether it was measured in this frame.
    is_matched: bool,
}

impl Track {
    /// Whether it is a boundary and was seen for long enough, where boundaries are confirmed.
    fn counts(&self, confirm: bool) -> bool {
        self.is_boundary && (!confirm || self.seen_s >= CONFIRM_S)
    }

    /// Looks at its points, `elapsed_s` seconds after the last time: drops those that have not been seen for too long, and divides it where
    /// one sees through it.
    fn look_at_points(&mut self, look: impl Fn(&Boundary, usize) -> Look, elapsed_s: f64) {
        let before = self.boundary;
        let mut run = before;
        run.clear();
        let mut longest = run;
        let mut is_gap = false;
        for (i, point) in before.points().iter().enumerate() {
            let look = look(&before, i);
            let kept_s = match look {
                Look::Seen => None,
                Look::Hidden => Some(FORGET_HIDDEN_S),
                Look::Unknown => Some(FORGET_S),
                Look::Through => Some(FORGET_THROUGH_S),
            };
            let unseen_s = kept_s.map_or(0.0, |kept_s| point.unseen_s + elapsed_s * FORGET_S / kept_s);
            if unseen_s <= FORGET_S {
                run.push(BoundaryPoint {
                    unseen_s,
                    solid_m: if is_gap { 0.0 } else { point.solid_m },
                    ..*point
                });
                is_gap = false;
            } else if look == Look::Through {
                longest = longer(longest, run);
                run.clear();
            } else {
                is_gap = true;
            }
        }
        self.boundary = longer(longest, run);
    }
}

/// The one of two parts of a boundary of which more was seen.
fn longer(a: Boundary, b: Boundary) -> Boundary {
    let length_m = |part: &Boundary| [part.solid_m(), part.length_m()];
    if length_m(&a) >= length_m(&b) { a } else { b }
}

/// The boundaries that are followed; memory is allocated once.
#[derive(Debug)]
pub struct TrackList {
    confirm: bool,
    tracks: Vec<Track>,
    boundaries: Vec<Boundary>,
    next_id: u32,
}

impl TrackList {
    /// An empty list. With `confirm` a boundary counts after [`CONFIRM_S`].
    pub fn new(confirm: bool) -> Self {
        Self {
            confirm,
            tracks: Vec::with_capacity(MAX_TRACKS),
            boundaries: Vec::with_capacity(MAX_TRACKS),
            next_id: 1,
        }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.tracks.clear();
        self.boundaries.clear();
    }

    /// The boundaries that count, nearest first.
    pub fn boundaries(&self) -> &[Boundary] {
        &self.boundaries
    }

    /// Takes in a frame, `elapsed_s` seconds after the last one, since when the camera has moved by `step`: moves what is known, looks at its
    /// points, and joins the curves of the frame that are boundaries by themselves, and the parts that are not. `look` tells
    /// what is seen at a known point, by its index.
    pub(super) fn update(
        &mut self,
        [curves, parts]: [&[Boundary]; 2],
        step: Option<PlanarStep>,
        elapsed_s: f64,
        look: impl Fn(&Boundary, usize) -> Look,
    ) {
        for track in &mut self.tracks {
            track.is_matched = false;
            if let Some(step) = &step {
                shift(&mut track.boundary, step);
                track.boundary.put_in_order();
                track.look_at_points(&look, elapsed_s);
            } else {
                // Nobody knows that it is the same place.
                track.look_at_points(|_, _| Look::Unknown, elapsed_s);
            }
        }
        curves.iter().for_each(|curve| self.join(curve, true, elapsed_s));
        for part in parts.iter().filter(|_| step.is_some()) {
            self.join(part, false, elapsed_s);
        }
        self.merge();
        for track in &mut self.tracks {
            track.boundary.put_in_order();
            divide(&mut track.boundary);
            track.is_boundary |= is_extended(&track.boundary);
        }
        self.tracks.retain(|track| track.boundary.points().len() > 1);
    }

    /// Joins a curve with what is known of it, or follows it from now on. When the list is full, a whole boundary replaces a part.
    fn join(&mut self, curve: &Boundary, is_whole: bool, elapsed_s: f64) {
        // A part tells less than a whole: half of it goes on where it was known, as high.
        let share = if is_whole { 0.0 } else { PART_SHARE };
        let may_join = |track: &&mut Track| {
            if is_whole { !track.is_matched } else { is_as_high(curve, &track.boundary) }
        };
        let nearest = self
            .tracks
            .iter_mut()
            .filter(may_join)
            .filter_map(|track| Some((separation_m(curve, &track.boundary, share)?, track)))
            .min_by(|a, b| (!a.1.is_boundary).cmp(&!b.1.is_boundary).then(a.0.total_cmp(&b.0)));
        if let Some((_, track)) = nearest {
            // A lorry may stand beyond the end of a wall that is as high: a part of such a wall adds nothing to it.
            if !is_whole && track.is_boundary && mean_height_m(curve) >= LOW_HEIGHT_M - HEIGHT_STEP_M {
                correct(&mut track.boundary, curve);
            } else {
                track.boundary = joined(curve, &track.boundary);
            }
            track.seen_s += if track.is_matched { 0.0 } else { elapsed_s };
            (track.is_matched, track.is_boundary) = (true, track.is_boundary || is_whole);
            return;
        }
        if self.tracks.len() == MAX_TRACKS && is_whole {
            let parts = self.tracks.iter().enumerate().filter(|(_, track)| !track.is_boundary);
            let shortest = parts.min_by(|a, b| a.1.seen_s.total_cmp(&b.1.seen_s)).map(|(i, _)| i);
            shortest.map(|i| self.tracks.swap_remove(i));
        }
        if self.tracks.len() < MAX_TRACKS {
            let mut boundary = *curve;
            boundary.id = self.next_id;
            self.next_id = self.next_id.wrapping_add(1).max(1);
            self.tracks.push(Track { boundary, is_boundary: is_whole, seen_s: 0.0, is_matched: true });
        }
    }

    /// Puts together what has grown together.
    fn merge(&mut self) {
        let mut i = 0;
        while i < self.tracks.len() {
            let mut j = i + 1;
            while j < self.tracks.len() {
                if !is_one(&self.tracks[i], &self.tracks[j]) {
                    j += 1;
                    continue;
                }
                let (a, b) = (self.tracks[i], self.tracks.remove(j));
                // The number is that of the boundary, of two boundaries that of the older one; the place that of what was measured.
                let id = match (a.is_boundary, b.is_boundary) {
                    (true, false) => a.boundary.id,
                    (false, true) => b.boundary.id,
                    _ => a.boundary.id.min(b.boundary.id),
                };
                let [measured, known] = if a.is_matched { [a, b] } else { [b, a] };
                let mut boundary = joined(&measured.boundary, &known.boundary);
                boundary.id = id;
                self.tracks[i] = Track {
                    boundary,
                    is_boundary: a.is_boundary || b.is_boundary,
                    seen_s: a.seen_s.max(b.seen_s),
                    is_matched: true,
                };
            }
            i += 1;
        }
    }

    /// Tells [`Self::boundaries`] which of them count, and on which side of the path they are.
    pub fn publish(&mut self, corridor: &Corridor) {
        self.boundaries.clear();
        for track in self.tracks.iter().filter(|track| track.counts(self.confirm)) {
            let mut boundary = track.boundary;
            boundary.side = side(&boundary, corridor);
            self.boundaries.push(boundary);
        }
        let nearest = |b: &Boundary| b.points().iter().map(|p| p.distance_m).fold(f64::INFINITY, f64::min);
        self.boundaries.sort_unstable_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        self.boundaries.truncate(MAX_BOUNDARIES);
    }
}

/// Mean height of the points of a boundary, in metres.
fn mean_height_m(boundary: &Boundary) -> f64 {
    let points = boundary.points();
    points.iter().map(|point| point.height_m).sum::<f64>() / points.len().max(1) as f64
}

/// Whether the heights of two agree.
fn is_as_high(a: &Boundary, b: &Boundary) -> bool {
    (mean_height_m(a) - mean_height_m(b)).abs() <= 2.0 * HEIGHT_STEP_M
}

/// Whether two tracks are one, of which at least one was measured in this frame.
fn is_one(a: &Track, b: &Track) -> bool {
    let lies_beside = |a: &Track, b: &Track| separation_m(&a.boundary, &b.boundary, PART_SHARE).is_some();
    (a.is_matched || b.is_matched)
        && is_as_high(&a.boundary, &b.boundary)
        && (lies_beside(a, b) || lies_beside(b, a))
}

/// Divides a boundary where more than a parked car of it is not known; keeps the part of which more was seen.
fn divide(boundary: &mut Boundary) {
    let mut run = *boundary;
    run.clear();
    let mut longest = run;
    for (i, point) in boundary.points().iter().enumerate() {
        let step_m = i.checked_sub(1).map_or(0.0, |before| point.apart_m(&boundary.points()[before]));
        if step_m - point.solid_m > MAX_HIDDEN_M {
            longest = longer(longest, run);
            run.clear();
        }
        run.push(*point);
    }
    *boundary = longer(longest, run);
}

/// Whether what was seen of it is longer than a vehicle as high, and has a steady height.
fn is_extended(boundary: &Boundary) -> bool {
    let points = boundary.points();
    let solid_m: f64 = points.iter().map(|point| point.solid_m).sum();
    if solid_m < MIN_LENGTH_M {
        return false;
    }
    let share_below = |height_m: f64| {
        let below = points.iter().filter(|point| point.height_m <= height_m);
        below.map(|point| point.solid_m).sum::<f64>() / solid_m
    };
    let median = points.iter().map(|point| point.height_m).filter(|height_m| share_below(*height_m) >= 0.5);
    let median_m = median.fold(f64::INFINITY, f64::min);
    let steady = share_below(median_m + HEIGHT_STEP_M) - share_below(median_m - HEIGHT_STEP_M);
    let longest_m = if median_m < LOW_HEIGHT_M { MIN_LENGTH_M } else { LONGEST_VEHICLE_M };
    median_m >= f64::from(RAISED_M.end) && steady >= STEADY_SHARE && solid_m >= longest_m
}

/// On which side of the path a boundary stands.
fn side(boundary: &Boundary, corridor: &Corridor) -> Side {
    if boundary.points().iter().any(|p| corridor.contains([p.lateral_m, p.distance_m])) {
        return Side::Across;
    }
    let nearest = boundary.points().iter().min_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    if nearest.is_some_and(|p| p.lateral_m > 0.0) { Side::Right } else { Side::Left }
}

/// Moves a boundary with the camera; what is then behind it is dropped.
fn shift(boundary: &mut Boundary, step: &PlanarStep) {
    let before = *boundary;
    boundary.clear();
    for point in before.points() {
        let place = [point.lateral_m, point.distance_m];
        let [lateral_m, distance_m] = step.place(place);
        let [across, _, along] = step.covariance_m2(place);
        let sigma_m = (point.sigma_m * point.sigma_m + across.max(along)).sqrt();
        if distance_m >= MIN_DISTANCE_M {
            boundary.push(BoundaryPoint { lateral_m, distance_m, sigma_m, ..*point });
        }
    }
}

/// Place on a boundary next to a point: signed distance across it, and standard deviation there.
fn beside(boundary: &Boundary, point: &BoundaryPoint) -> Option<(f64, f64, [f64; 2])> {
    let mut best: Option<(f64, f64, [f64; 2])> = None;
    for pair in boundary.points().windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        let [right, ahead] = [b.lateral_m - a.lateral_m, b.distance_m - a.distance_m];
        let length_m = right.hypot(ahead);
        if length_m < 1e-6 {
            continue;
        }
        let [x, z] = [point.lateral_m - a.lateral_m, point.distance_m - a.distance_m];
        let along = (x * right + z * ahead) / length_m;
        if along < -0.5 || along > length_m + 0.5 {
            continue;
        }
        let normal = [ahead / length_m, -right / length_m];
        let across = x * normal[0] + z * normal[1];
        let share = (along / length_m).clamp(0.0, 1.0);
        if best.is_none_or(|(old, _, _)| across.abs() < old.abs()) {
            best = Some((across, a.sigma_m + share * (b.sigma_m - a.sigma_m), normal));
        }
    }
    best
}

/// A point with what a line beside it tells, which is `across_m` away along `normal`, with that standard deviation.
fn fused(point: &BoundaryPoint, (across_m, sigma_m, normal): (f64, f64, [f64; 2])) -> BoundaryPoint {
    let (own, other) = (point.sigma_m.powi(2), sigma_m.powi(2) + (0.3 * ROUGHNESS_M).powi(2));
    let total = (own + other).max(1e-9);
    let moved_m = own / total * across_m;
    BoundaryPoint {
        lateral_m: point.lateral_m - moved_m * normal[0],
        distance_m: point.distance_m - moved_m * normal[1],
        sigma_m: (own * other / total).sqrt(),
        ..*point
    }
}

/// Boundaries farther from each other than this, in metres, are not compared: wider than any gate where they are used.
const MAX_APART_M: f64 = 3.0;

/// Mean distance of a curve from a boundary where they are side by side, at least over a share of the curve; `None` if they are not one.
fn separation_m(curve: &Boundary, boundary: &Boundary, share: f64) -> Option<f64> {
    let is_apart = |value: fn(&BoundaryPoint) -> f64| {
        let range = |boundary: &Boundary| {
            let values = boundary.points().iter().map(value);
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
        };
        let ((a, b), (c, d)) = (range(curve), range(boundary));
        a > d + MAX_APART_M || c > b + MAX_APART_M
    };
    if is_apart(|point| point.distance_m) || is_apart(|point| point.lateral_m) {
        return None;
    }
    let (mut sum, mut gate, mut count) = (0.0, 0.0, 0.0);
    for point in curve.points() {
        if let Some((across, sigma_m, _)) = beside(boundary, point) {
            sum += across.abs();
            gate += GATE_SIGMAS * sigma_m.hypot(point.sigma_m).hypot(ROUGHNESS_M);
            count += 1.0;
        }
    }
    let is_enough = count >= 3.0 && count >= share * curve.points().len() as f64;
    (is_enough && sum <= gate).then(|| sum / count)
}

/// Joins the points of a boundary with a part that passes them.
fn correct(boundary: &mut Boundary, part: &Boundary) {
    for point in boundary.points_mut() {
        let Some(line) = beside(part, point) else { continue };
        if line.0.abs() <= GATE_SIGMAS * line.1.hypot(point.sigma_m).hypot(ROUGHNESS_M) {
            *point = BoundaryPoint { unseen_s: 0.0, ..fused(point, line) };
        }
    }
}

/// The curve of a frame, joined with what was known: its points moved towards the known ones by their errors, and the known
/// points beyond its ends.
fn joined(curve: &Boundary, known: &Boundary) -> Boundary {
    let [Some(first), Some(last)] = [curve.points().first(), curve.points().last()] else { return *known };
    let ray = |p: &BoundaryPoint| p.lateral_m / p.distance_m;
    let known_points = known.points();
    let left = known_points.iter().take_while(|p| ray(p) < ray(first)).count();
    let right = left + known_points[left..].iter().take_while(|p| ray(p) <= ray(last)).count();
    let mut all = Joint::default();
    known_points[..left].iter().for_each(|point| all.push(*point));
    // What was seen between the last point that is kept and the next one goes on to the curve, and from the curve to what comes after it.
    let seam_m = |next: usize, from: &BoundaryPoint, to: &BoundaryPoint| {
        known_points.get(next).map_or(0.0, |point| point.solid_m.min(from.apart_m(to)))
    };
    for (i, point) in curve.points().iter().enumerate() {
        let solid_m = match left.checked_sub(1) {
            Some(before) if i == 0 => seam_m(left, &known_points[before], first),
            _ => point.solid_m,
        };
        let point = BoundaryPoint { solid_m, ..*point };
        all.push(beside(known, &point).map_or(point, |line| fused(&point, line)));
    }
    for (i, point) in known_points.iter().enumerate().skip(right) {
        let solid_m = if i == right { seam_m(i, last, point) } else { point.solid_m };
        all.push(BoundaryPoint { solid_m, ..*point });
    }
    all.thinned(known)
}

/// The points of a curve and of what was known on both sides of it.
struct Joint {
    points: [BoundaryPoint; 2 * MAX_POINTS],
    count: usize,
}

impl Default for Joint {
    fn default() -> Self {
        Self { points: [BoundaryPoint::default(); 2 * MAX_POINTS], count: 0 }
    }
}

impl Joint {
    fn push(&mut self, point: BoundaryPoint) {
        if let Some(free) = self.points.get_mut(self.count) {
            *free = point;
            self.count += 1;
        }
    }

    /// The boundary `known` with these points, at most [`MAX_POINTS`]: both ends, and others at equal distances.
    fn thinned(&self, known: &Boundary) -> Boundary {
        let points = &self.points[..self.count];
        let length_m: f64 = points.windows(2).map(|pair| pair[1].apart_m(&pair[0])).sum();
        let spacing_m = MIN_SPACING_M.max(length_m / (MAX_POINTS - 2) as f64);
        let mut out = *known;
        out.clear();
        let (mut since_m, mut solid_m) = (f64::INFINITY, 0.0);
        for (i, point) in points.iter().enumerate() {
            since_m += i.checked_sub(1).map_or(0.0, |before| point.apart_m(&points[before]));
            solid_m += point.solid_m;
            if since_m >= spacing_m || i + 1 == points.len() {
                out.push(BoundaryPoint { solid_m, ..*point });
                (since_m, solid_m) = (0.0, 0.0);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests;
