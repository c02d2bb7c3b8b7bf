//! Boundaries over frames: moved by the own motion, confirmed and forgotten in seconds.
//!
//! What is seen of a boundary at once may be too short to tell it from a vehicle: between parked cars, at the picture's edge. Such
//! parts are put together on the ground as the vehicle drives; what they make together is a boundary by the same rule. A known point
//! stays while the disparities at its place show it, or something nearer; what is behind it ends it soon.

use super::boundary::{Boundary, BoundaryPoint, MAX_BOUNDARIES, Side};
use super::corridor::Corridor;
use super::limits::{
    CONFIRM_S, FORGET_HIDDEN_S, FORGET_S, FORGET_THROUGH_S, GATE_SIGMAS, HEIGHT_STEP_M, LONGEST_VEHICLE_M,
    LOW_HEIGHT_M, MAX_HIDDEN_M, MIN_LENGTH_M, RAISED_M, ROUGHNESS_M, STEADY_SHARE,
};
use super::look::Look;
use crate::motion::planar::PlanarStep;

/// Nearest distance of a point that is kept, in metres.
const MIN_DISTANCE_M: f64 = 1.0;

/// Maximum number of boundaries, and of what may become one, that are followed.
const MAX_TRACKS: usize = 4 * MAX_BOUNDARIES;

/// Share of a part that lies beside what it is joined with.
const PART_SHARE: f64 = 0.5;

/// A boundary, or what may become one, that is followed.
#[derive(Clone, Copy, Debug)]
struct Track {
    boundary: Boundary,
    /// Whether it is one.
    is_boundary: bool,
    /// Time for which it was seen, in seconds.
    seen_s: f64,
    is_matched: bool,
}

impl Track {
    /// Whether it is a boundary and was seen for long enough, where boundaries are confirmed.
    fn counts(&self, confirm: bool) -> bool {
        self.is_boundary && (!confirm || self.seen_s >= CONFIRM_S - 1e-6)
    }

    /// Looks at its points, `elapsed_s` seconds after the last time; drops those that have not been seen for too long.
    fn look(&mut self, look: impl Fn(&Boundary, &BoundaryPoint) -> Look, elapsed_s: f64) {
        let before = self.boundary;
        self.boundary.clear();
        let mut is_gap = false;
        for point in before.points() {
            let kept_s = match look(&before, point) {
                Look::Seen => f64::INFINITY,
                Look::Hidden => FORGET_HIDDEN_S,
                Look::Unknown => FORGET_S,
                Look::Through => FORGET_THROUGH_S,
            };
            // In the unit of [`FORGET_S`].
            let unseen_s =
                if kept_s.is_finite() { point.unseen_s + elapsed_s * FORGET_S / kept_s } else { 0.0 };
            let is_kept = unseen_s <= FORGET_S;
            if is_kept {
                let solid_m = if is_gap { 0.0 } else { point.solid_m };
                self.boundary.push(BoundaryPoint { unseen_s, solid_m, ..*point });
            }
            is_gap = !is_kept;
        }
    }
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
            boundaries: Vec::with_capacity(MAX_BOUNDARIES),
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

    /// Joins the curves of a frame that are boundaries by themselves, and parts that are not. `look` tells what is seen at a known point.
    pub fn update(
        &mut self,
        [curves, parts]: [&[Boundary]; 2],
        step: Option<PlanarStep>,
        elapsed_s: f64,
        look: impl Fn(&Boundary, &BoundaryPoint) -> Look,
    ) {
        for track in &mut self.tracks {
            track.is_matched = false;
            if let Some(step) = &step {
                shift(&mut track.boundary, step);
            }
            // Where the own motion is unknown, nobody knows that it is the same place.
            let look = |boundary: &Boundary, point: &BoundaryPoint| match look(boundary, point) {
                Look::Seen | Look::Hidden if step.is_none() => Look::Unknown,
                look => look,
            };
            track.look(look, elapsed_s);
        }
        for curve in curves {
            self.join(curve, true, elapsed_s);
        }
        for part in parts.iter().filter(|_| step.is_some()) {
            self.join(part, false, elapsed_s);
        }
        self.merge();
        self.tracks.iter_mut().for_each(|track| keep_longest(&mut track.boundary));
        for track in &mut self.tracks {
            track.is_boundary |= is_extended(&track.boundary);
        }
        self.tracks.retain(|track| track.boundary.points().len() > 1);
    }

    /// Joins a curve with what is known of it, or follows it from now on.
    fn join(&mut self, curve: &Boundary, is_boundary: bool, elapsed_s: f64) {
        let height_m = mean_height_m(curve);
        let is_as_high =
            |track: &Track| (mean_height_m(&track.boundary) - height_m).abs() <= 2.0 * HEIGHT_STEP_M;
        let known = self
            .tracks
            .iter_mut()
            .filter(|track| if is_boundary { !track.is_matched } else { is_as_high(track) });
        // A part tells less than a whole: half of it goes on where it was known.
        let share = if is_boundary { 0.0 } else { PART_SHARE };
        let nearest = known
            .filter_map(|track| Some((separation_m(curve, &track.boundary, share)?, track)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, track)) = nearest {
            // A lorry may stand beyond the end of a wall that is as high: a part of such a wall adds nothing to it.
            if !is_boundary && track.is_boundary && height_m >= LOW_HEIGHT_M - HEIGHT_STEP_M {
                correct(&mut track.boundary, curve);
            } else {
                track.boundary = joined(curve, &track.boundary);
            }
            track.seen_s += if track.is_matched { 0.0 } else { elapsed_s };
            (track.is_matched, track.is_boundary) = (true, track.is_boundary || is_boundary);
        } else if self.tracks.len() < MAX_TRACKS {
            let mut boundary = *curve;
            boundary.id = self.next_id;
            self.next_id = self.next_id.wrapping_add(1).max(1);
            self.tracks.push(Track { boundary, is_boundary, seen_s: 0.0, is_matched: true });
        }
    }

    /// Puts together what has grown together.
    fn merge(&mut self) {
        let mut i = 0;
        while i < self.tracks.len() {
            let mut j = i + 1;
            while j < self.tracks.len() {
                let (kept, other) = (&self.tracks[i], &self.tracks[j]);
                let is_one = kept.is_matched
                    && other.is_matched
                    && (mean_height_m(&kept.boundary) - mean_height_m(&other.boundary)).abs()
                        <= 2.0 * HEIGHT_STEP_M
                    && separation_m(&other.boundary, &kept.boundary, PART_SHARE).is_some();
                if is_one {
                    let other = self.tracks.remove(j);
                    let kept = &mut self.tracks[i];
                    kept.boundary = joined(&other.boundary, &kept.boundary);
                    kept.is_boundary |= other.is_boundary;
                    kept.seen_s = kept.seen_s.max(other.seen_s);
                } else {
                    j += 1;
                }
            }
            i += 1;
        }
    }

    /// Tells [`Self::boundaries`] which of them count, and on which side of the path they are.
    pub fn publish(&mut self, corridor: &Corridor) {
        self.boundaries.clear();
        let counts = |track: &&Track| track.counts(self.confirm);
        for track in self.tracks.iter().filter(counts).take(MAX_BOUNDARIES) {
            let mut boundary = track.boundary;
            boundary.side = side(&boundary, corridor);
            self.boundaries.push(boundary);
        }
        let nearest = |b: &Boundary| b.points().iter().map(|p| p.distance_m).fold(f64::INFINITY, f64::min);
        self.boundaries.sort_unstable_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    }
}

/// Mean height of the points of a boundary, in metres.
fn mean_height_m(boundary: &Boundary) -> f64 {
    let points = boundary.points();
    points.iter().map(|point| point.height_m).sum::<f64>() / points.len().max(1) as f64
}

/// Divides a boundary where more than a parked car of it is not known any more; keeps the part of which more was seen.
fn keep_longest(boundary: &mut Boundary) {
    let whole = *boundary;
    let is_open = |pair: &[BoundaryPoint]| {
        let step_m = (pair[1].lateral_m - pair[0].lateral_m).hypot(pair[1].distance_m - pair[0].distance_m);
        step_m > MAX_HIDDEN_M && pair.iter().any(|point| point.unseen_s > 0.0)
    };
    let parts = whole.points().chunk_by(|a, b| !is_open(&[*a, *b]));
    let solid_m = |part: &[BoundaryPoint]| part.iter().map(|point| point.solid_m).sum::<f64>();
    let Some(longest) = parts.max_by(|a, b| solid_m(a).total_cmp(&solid_m(b))) else { return };
    if longest.len() < whole.points().len() {
        boundary.clear();
        longest.iter().for_each(|point| {
            boundary.push(*point);
        });
    }
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

/// Share of the way to a line by which a point moves; both with their standard deviations, in metres.
fn moved_share(own_sigma_m: f64, line_sigma_m: f64) -> f64 {
    let (own, other) = (own_sigma_m.powi(2), line_sigma_m.powi(2) + (0.3 * ROUGHNESS_M).powi(2));
    own / (own + other).max(1e-9)
}

/// Mean distance of a curve from a boundary where they are side by side, at least over a share of the curve; `None` if they are not one.
fn separation_m(curve: &Boundary, boundary: &Boundary, share: f64) -> Option<f64> {
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

/// Moves the points that have not been seen towards a part that passes them.
fn correct(boundary: &mut Boundary, part: &Boundary) {
    for point in boundary.points_mut().iter_mut().filter(|point| point.unseen_s > 0.0) {
        let Some((across_m, sigma_m, normal)) = beside(part, point) else { continue };
        if across_m.abs() > GATE_SIGMAS * sigma_m.hypot(point.sigma_m).hypot(ROUGHNESS_M) {
            continue;
        }
        let share = moved_share(point.sigma_m, sigma_m);
        point.lateral_m -= share * across_m * normal[0];
        point.distance_m -= share * across_m * normal[1];
        point.unseen_s = 0.0;
    }
}

/// The curve of a frame, joined with what was known: its points moved towards the known ones by their errors, and the known
/// points beyond its ends.
fn joined(curve: &Boundary, known: &Boundary) -> Boundary {
    let mut out = *known;
    out.clear();
    let ray = |p: &BoundaryPoint| p.lateral_m / p.distance_m;
    let ends = [curve.points().first(), curve.points().last()].map(|p| p.map_or(0.0, ray));
    for point in known.points().iter().filter(|p| ray(p) < ends[0] - 0.01) {
        out.push(*point);
    }
    // What was seen between the last point that is kept and the next one goes on to the curve.
    let solid_m = known.points().get(out.points().len()).map_or(0.0, |next| next.solid_m);
    for (i, point) in curve.points().iter().enumerate() {
        let mut point = *point;
        if i == 0
            && let Some(before) = out.points().last()
        {
            let step_m = (point.lateral_m - before.lateral_m).hypot(point.distance_m - before.distance_m);
            point.solid_m = step_m.min(solid_m);
        }
        if let Some((across, sigma_m, normal)) = beside(known, &point) {
            let (own, other) = (point.sigma_m.powi(2), sigma_m.powi(2) + (0.3 * ROUGHNESS_M).powi(2));
            let share = moved_share(point.sigma_m, sigma_m);
            point.lateral_m -= share * across * normal[0];
            point.distance_m -= share * across * normal[1];
            point.sigma_m = (own * other / (own + other).max(1e-9)).sqrt();
        }
        out.push(point);
    }
    for point in known.points().iter().filter(|p| ray(p) > ends[1] + 0.01) {
        out.push(*point);
    }
    out
}
