//! Boundaries over frames: moved by the own motion, confirmed and forgotten in seconds.

use super::boundary::{Boundary, BoundaryPoint, MAX_BOUNDARIES, Side};
use super::corridor::Corridor;
use super::limits::{CONFIRM_S, FORGET_S, GATE_SIGMAS, HEIGHT_STEP_M, LOW_HEIGHT_M, ROUGHNESS_M};
use crate::motion::planar::PlanarStep;

/// Nearest distance of a point that is kept, in metres.
const MIN_DISTANCE_M: f64 = 1.0;

/// Maximum number of boundaries that are followed.
const MAX_TRACKS: usize = 2 * MAX_BOUNDARIES;

/// A boundary that is followed.
#[derive(Clone, Copy, Debug)]
struct Track {
    boundary: Boundary,
    /// Time for which it was seen, and since when it was not, in seconds.
    seen_s: f64,
    unseen_s: f64,
    is_matched: bool,
}

impl Track {
    /// Whether it was seen for long enough, where boundaries are confirmed.
    fn counts(&self, confirm: bool) -> bool {
        !confirm || self.seen_s >= CONFIRM_S - 1e-6
    }

    /// Adds this time to that for which its points have not been seen; drops those beyond [`FORGET_S`].
    fn age(&mut self, elapsed_s: f64) {
        let before = self.boundary;
        let aged = before.points().iter().map(|p| BoundaryPoint { unseen_s: p.unseen_s + elapsed_s, ..*p });
        self.boundary.clear();
        for point in aged.filter(|point| point.unseen_s <= FORGET_S) {
            self.boundary.push(point);
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

    /// Joins the curves of a frame, and what is still seen of known boundaries.
    pub fn update(
        &mut self,
        curves: &[Boundary],
        parts: &[Boundary],
        step: Option<PlanarStep>,
        elapsed_s: f64,
    ) {
        for track in &mut self.tracks {
            track.is_matched = false;
            if let Some(step) = &step {
                shift(&mut track.boundary, step);
            }
        }
        for curve in curves {
            let distances = self
                .tracks
                .iter()
                .map(|track| if track.is_matched { None } else { separation_m(curve, &track.boundary) });
            let nearest =
                distances.enumerate().filter_map(|(i, d)| Some((i, d?))).min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((i, _)) = nearest {
                let track = &mut self.tracks[i];
                track.boundary = joined(curve, &track.boundary, elapsed_s);
                (track.is_matched, track.unseen_s) = (true, 0.0);
                track.seen_s += elapsed_s;
            } else if self.tracks.len() < MAX_TRACKS {
                let mut boundary = *curve;
                boundary.id = self.next_id;
                self.next_id = self.next_id.wrapping_add(1).max(1);
                self.tracks.push(Track { boundary, seen_s: 0.0, unseen_s: 0.0, is_matched: true });
            }
        }
        // Where the own motion is unknown, nobody knows that it is the same place.
        for part in parts.iter().filter(|_| step.is_some()) {
            self.join_part(part, elapsed_s);
        }
        for track in self.tracks.iter_mut().filter(|track| !track.is_matched) {
            track.unseen_s += elapsed_s;
            track.age(elapsed_s);
        }
        self.tracks.retain(|track| track.unseen_s <= FORGET_S && track.boundary.points().len() > 1);
    }

    /// Takes in what is still seen of a boundary at least as high as [`LOW_HEIGHT_M`]: it stays one though the rest has left the view, or
    /// is hidden. Nothing is added to it. Lower boundaries need not be longer than a lorry, so that their rest is long enough.
    fn join_part(&mut self, part: &Boundary, elapsed_s: f64) {
        let confirm = self.confirm;
        let is_wall = |track: &Track| {
            let height_m = mean_height_m(&track.boundary);
            height_m >= LOW_HEIGHT_M && (height_m - mean_height_m(part)).abs() <= 2.0 * HEIGHT_STEP_M
        };
        let known = self.tracks.iter_mut().filter(|track| track.counts(confirm) && is_wall(track));
        let nearest = known
            .filter_map(|track| Some((separation_m(part, &track.boundary)?, track)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, track)) = nearest else { return };
        if !track.is_matched {
            track.age(elapsed_s);
        }
        (track.is_matched, track.unseen_s) = (true, 0.0);
        for point in track.boundary.points_mut().iter_mut().filter(|point| point.unseen_s > 0.0) {
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

/// Mean distance of a curve from a boundary where they are side by side; `None` if they are not one.
fn separation_m(curve: &Boundary, boundary: &Boundary) -> Option<f64> {
    let (mut sum, mut gate, mut count) = (0.0, 0.0, 0.0);
    for point in curve.points() {
        if let Some((across, sigma_m, _)) = beside(boundary, point) {
            sum += across.abs();
            gate += GATE_SIGMAS * sigma_m.hypot(point.sigma_m).hypot(ROUGHNESS_M);
            count += 1.0;
        }
    }
    (count >= 3.0 && sum <= gate).then(|| sum / count)
}

/// The curve of a frame, joined with what was known: its points moved towards the known ones by their errors, and the known
/// points beyond its ends.
fn joined(curve: &Boundary, known: &Boundary, elapsed_s: f64) -> Boundary {
    let mut out = *known;
    out.clear();
    let ray = |p: &BoundaryPoint| p.lateral_m / p.distance_m;
    let ends = [curve.points().first(), curve.points().last()].map(|p| p.map_or(0.0, ray));
    let kept = |p: &BoundaryPoint| BoundaryPoint { unseen_s: p.unseen_s + elapsed_s, ..*p };
    let lasts = |p: &BoundaryPoint| p.unseen_s <= FORGET_S;
    for point in known.points().iter().filter(|p| ray(p) < ends[0] - 0.01).map(kept).filter(lasts) {
        out.push(point);
    }
    for point in curve.points() {
        let mut point = *point;
        if let Some((across, sigma_m, normal)) = beside(known, &point) {
            let (own, other) = (point.sigma_m.powi(2), sigma_m.powi(2) + (0.3 * ROUGHNESS_M).powi(2));
            let share = moved_share(point.sigma_m, sigma_m);
            point.lateral_m -= share * across * normal[0];
            point.distance_m -= share * across * normal[1];
            point.sigma_m = (own * other / (own + other).max(1e-9)).sqrt();
        }
        out.push(point);
    }
    for point in known.points().iter().filter(|p| ray(p) > ends[1] + 0.01).map(kept).filter(lasts) {
        out.push(point);
    }
    out
}
