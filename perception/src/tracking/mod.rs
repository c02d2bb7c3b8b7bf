//! Obstacles over time: which region continues which track, where it is, how fast it comes, and what
//! follows from that for the vehicle.

pub mod assign;
pub mod class;
pub mod classification_schedule;
pub mod filter;
pub mod scale_change;

use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use assign::Assignment;
use class::Classification;
use filter::{DistanceFilter, LateralFilter, TimeToCollision};

/// An obstacle that is followed from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Unique as long as the tracker lives, from 1.
    pub id: u32,
    /// The region as last seen; its box moves on as expected while it is out of sight.
    pub region: Region,
    /// Which of this frame's regions it is; `None` when none is.
    pub detection: Option<usize>,
    /// Distance and closing speed.
    pub longitudinal: DistanceFilter,
    /// Place and speed lateral the view.
    pub lateral: LateralFilter,
    /// Width, in metres, smoothed.
    pub width_m: f64,
    /// Height above the road, in metres, smoothed.
    pub height_m: f64,
    /// Frames in which it was seen.
    pub seen: u32,
    /// Frames in a row in which it was not.
    pub missed: u32,
    /// Frames in a row, up to this one, in which it was.
    pub consecutive_frames: u32,
    /// By how much its width changes from frame to frame, as a logarithm, of late.
    pub width_jitter: f64,
    /// What the recogniser says of it.
    pub classification: Classification,
    /// Box and distance when it was last seen.
    last: (PixelBox, f64),
    /// Whether the rim of what both cameras see contact that box.
    is_truncated: bool,
}

impl Track {
    /// Distance, in metres.
    pub fn distance_m(&self) -> f64 {
        self.longitudinal.distance_m()
    }

    /// Speed at which the distance shrinks, in m/s.
    pub fn closing_m_s(&self) -> f64 {
        self.longitudinal.closing_m_s()
    }

    /// Time to collision at constant closing speed; `None` when it does not close in, or so slowly
    /// that noise decides.
    pub fn time_to_collision(&self) -> Option<TimeToCollision> {
        self.longitudinal.time_to_collision()
    }

    /// Where its box is expected, as left, top, right, bottom in px: the last one brought to the distance
    /// and the place lateral that are expected.
    fn expected(&self, rig: &Rig, size: (u32, u32)) -> [f64; 4] {
        let (bounds, distance_m) = &self.last;
        let z = self.longitudinal.distance_m();
        let scale = distance_m / z;
        let centre = rig.cx_px + rig.focal_px * self.lateral.lateral_m() / z;
        // Of what is contact only a part is seen: its whole width reaches beyond the rim.
        let half = if self.is_truncated {
            rig.focal_px * self.width_m / z / 2.0
        } else {
            f64::from(bounds.width) * scale / 2.0
        };
        let row = |y: u32| rig.cy_px + (f64::from(y) - rig.cy_px) * scale;
        let (left, right) = ((centre - half).max(0.0), (centre + half).min(f64::from(size.0)));
        [left, row(bounds.y), right.max(left), row(bounds.y + bounds.height)]
    }
}

/// How tracks live and die.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerParameters {
    /// A track counts as an obstacle once it was seen in this many frames.
    pub confirm_frames: u32,
    /// A confirmed one ends after this many frames without a region; any other at its first miss.
    pub forget_frames: u32,
    /// Least overlap of boxes, 0 to 1, that continues a track.
    pub min_overlap: f64,
    /// At most this many tracks live at once.
    pub max_count: usize,
}

impl Default for TrackerParameters {
    fn default() -> Self {
        Self { confirm_frames: 3, forget_frames: 5, min_overlap: 0.2, max_count: 128 }
    }
}

/// Detections of a frame for which memory is set aside; the nearest are used.
const MAX_DETECTIONS: usize = 64;
/// A region may differ from what is expected by so many standard deviations of both,
const GATE_SIGMAS: f64 = 4.0;
/// and by this much more, in px and as a share of the disparity: its near side jumps when parts join it.
const GATE_PX: f64 = 0.5;
const GATE_SHARE: f64 = 0.08;
/// A region that lies in the expected box, or the other way round, overlaps it as much as this share
/// of what lies inside: regions split and merge.
const CONTAINMENT_WEIGHT: f64 = 0.6;
/// What a track costs that gets no region, against a squared number of standard deviations.
const UNMATCHED_COST: f64 = 24.0;
/// What boxes that do not overlap at all, and sizes that differ by a factor of e, cost.
const OVERLAP_COST: f64 = 12.0;
const SIZE_COST: f64 = 3.0;
/// Error of a box's middle: in px (strips of four), and as a share of the width.
const CENTRE_SIGMA_PX: f64 = 3.0;
const CENTRE_SIGMA_SHARE: f64 = 0.04;
/// A box that ends so near the rim is contact, in px.
const BORDER_PX: f64 = 8.0;
/// How much the width is matched to change before it is known.
const INITIAL_WIDTH_JITTER: f64 = 0.3;
/// How much a frame's width counts, and its height.
const WIDTH_GAIN: f64 = 0.25;
const HEIGHT_GAIN_UP: f64 = 0.15;
const HEIGHT_GAIN_DOWN: f64 = 0.5;
/// Errors of a region's disparity last for some frames, the filter thinks that they do not.
const NOISE_INFLATION: f64 = 1.5;
/// and a measurement is hardly better than this, in px, whatever it says: a thing's parts move within its region.
const MIN_SIGMA_PX: f64 = 0.08;

/// Follows obstacles, with memory allocated once.
#[derive(Debug)]
pub struct Tracker {
    parameters: TrackerParameters,
    rig: Rig,
    /// Width and height of the image, in px.
    size: (u32, u32),
    tracks: Vec<Track>,
    assignment: Assignment,
    matched: Vec<bool>,
    order: Vec<(f64, u32)>,
    next_id: u32,
    last_ns: Option<u64>,
}

impl Tracker {
    /// A tracker without tracks, for regions of images of `size` (width, height) that the rig sees.
    pub fn new(parameters: TrackerParameters, rig: Rig, size: (usize, usize)) -> Self {
        Self {
            tracks: Vec::with_capacity(parameters.max_count),
            assignment: Assignment::new(MAX_DETECTIONS, parameters.max_count),
            matched: Vec::with_capacity(MAX_DETECTIONS),
            order: Vec::with_capacity(parameters.max_count),
            parameters,
            rig,
            size: (size.0 as u32, size.1 as u32),
            next_id: 1,
            last_ns: None,
        }
    }

    /// All tracks, oldest first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Whether a track counts as an obstacle.
    pub fn is_confirmed(&self, track: &Track) -> bool {
        track.seen >= self.parameters.confirm_frames
    }

    /// Takes in the regions of the frame at `time_ns` and gives all tracks, oldest first. A time
    /// that does not grow starts anew.
    pub fn update(&mut self, time_ns: u64, regions: &[Region]) -> &[Track] {
        let elapsed_s = match self.last_ns {
            Some(last) if time_ns > last => (time_ns - last) as f64 * 1e-9,
            Some(_) => {
                self.tracks.clear();
                0.0
            }
            None => 0.0,
        };
        self.last_ns = Some(time_ns);
        let regions = &regions[..regions.len().min(MAX_DETECTIONS)];
        for track in &mut self.tracks {
            track.longitudinal.predict(elapsed_s);
            track.lateral.predict(elapsed_s);
            track.missed += 1;
            track.detection = None;
        }
        self.set_costs(regions);
        self.matched.clear();
        self.matched.resize(regions.len(), false);
        let assigned = self.assignment.solve(UNMATCHED_COST);
        for (d, track) in assigned.iter().enumerate() {
            let Some(t) = *track else { continue };
            self.matched[d] = true;
            let edges = (self.rig, self.size);
            update_track(&mut self.tracks[t as usize], d, &regions[d], edges);
        }
        let (forget, confirm) = (self.parameters.forget_frames, self.parameters.confirm_frames);
        self.tracks.retain(|t| t.missed == 0 || (t.seen >= confirm && t.missed < forget));
        for track in self.tracks.iter_mut().filter(|t| t.missed > 0) {
            track.consecutive_frames = 0;
            track.region.bounds = clip(track.expected(&self.rig, self.size), self.size);
        }
        for (d, region) in regions.iter().enumerate() {
            if !self.matched[d] && self.tracks.len() < self.parameters.max_count {
                let track = self.begin(d, region);
                self.tracks.push(track);
            }
        }
        &self.tracks
    }

    /// What it costs to continue each track with each region.
    fn set_costs(&mut self, regions: &[Region]) {
        self.assignment.begin(regions.len(), self.tracks.len());
        for (t, track) in self.tracks.iter().enumerate() {
            let expected = track.expected(&self.rig, self.size);
            let disparity = track.longitudinal.disparity_px();
            let spread_px = track.longitudinal.disparity_sigma_px();
            for (d, region) in regions.iter().enumerate() {
                let spread = spread_px.hypot(region.disparity_sigma_px);
                let innovation = (region.disparity_px - disparity).abs();
                if innovation > GATE_SIGMAS * spread + GATE_PX + GATE_SHARE * disparity {
                    continue;
                }
                let overlap = overlap(&expected, &region.bounds);
                if overlap < self.parameters.min_overlap {
                    continue;
                }
                let sigmas = (innovation / spread.max(1e-3)).min(GATE_SIGMAS);
                let size = (region.width_m / track.width_m.max(0.05)).max(0.05).ln().abs();
                let cost = sigmas * sigmas + OVERLAP_COST * (1.0 - overlap) + SIZE_COST * size.min(1.0);
                self.assignment.set(d, t, cost);
            }
        }
    }

    fn begin(&mut self, detection: usize, region: &Region) -> Track {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1).max(1);
        let scale = self.rig.focal_px * self.rig.baseline_m;
        let is_truncated = border_contact(region, self.size) != (false, false);
        Track {
            id,
            region: *region,
            detection: Some(detection),
            longitudinal: DistanceFilter::new(scale, region.disparity_px, noise_px(region)),
            lateral: LateralFilter::new(region.lateral_m, centre_sigma_m(region, &self.rig, is_truncated)),
            width_m: region.width_m,
            height_m: region.height_m,
            consecutive_frames: 1,
            width_jitter: INITIAL_WIDTH_JITTER,
            is_truncated,
            seen: 1,
            missed: 0,
            classification: Classification::default(),
            last: (region.bounds, region.distance_m),
        }
    }
}

/// One standard deviation of a region's disparity, as the filter takes it.
fn noise_px(region: &Region) -> f64 {
    NOISE_INFLATION * region.disparity_sigma_px.max(MIN_SIGMA_PX)
}

/// A track goes on with region `d`.
fn update_track(track: &mut Track, d: usize, region: &Region, (rig, size): (Rig, (u32, u32))) {
    track.longitudinal.update(region.disparity_px, noise_px(region));
    let contact = border_contact(region, size);
    let is_truncated = contact != (false, false);
    let change = (region.width_m / track.width_m.max(0.05)).max(0.05).ln().abs();
    if is_truncated {
        track.width_m = track.width_m.max(region.width_m);
    }
    let other = region.width_m - track.width_m;
    // Where one side is contact off, the other one tells where the middle is.
    let (lateral_m, sigma_m) = match contact {
        (true, false) => (region.lateral_m + other / 2.0, centre_sigma_m(region, &rig, false)),
        (false, true) => (region.lateral_m - other / 2.0, centre_sigma_m(region, &rig, false)),
        // A box that is wider or narrower than before may have gained or lost a side.
        _ => (region.lateral_m, centre_sigma_m(region, &rig, is_truncated).hypot(other / 2.0)),
    };
    track.lateral.update(lateral_m, sigma_m);
    track.is_truncated = is_truncated;
    if !is_truncated {
        track.width_jitter += WIDTH_GAIN * (change - track.width_jitter);
        track.width_m += WIDTH_GAIN * other;
    }
    // Boxes more often reach into what is behind than they are too low.
    let taller = region.height_m - track.height_m;
    track.height_m += if taller > 0.0 { HEIGHT_GAIN_UP } else { HEIGHT_GAIN_DOWN } * taller;
    track.region = *region;
    track.detection = Some(d);
    track.last = (region.bounds, region.distance_m);
    track.seen = track.seen.saturating_add(1);
    track.consecutive_frames = track.consecutive_frames.saturating_add(1);
    track.missed = 0;
}

/// Whether a box ends on the left and on the right where the pictures do. The right camera does not see as
/// many columns of the left picture's left rim as the disparity is.
fn border_contact(region: &Region, (width, _): (u32, u32)) -> (bool, bool) {
    let (left, right) = (f64::from(region.bounds.x), region.bounds.x + region.bounds.width);
    (left <= region.disparity_px + BORDER_PX, f64::from(right) >= f64::from(width) - BORDER_PX)
}

/// One standard deviation of a box's middle, in metres. Of a box that is contact it may be anywhere.
fn centre_sigma_m(region: &Region, rig: &Rig, is_truncated: bool) -> f64 {
    let strips = CENTRE_SIGMA_PX * region.distance_m / rig.focal_px;
    strips.hypot(if is_truncated { 0.5 } else { CENTRE_SIGMA_SHARE } * region.width_m)
}

/// Shared ÷ joint area, or a good part of the share of the smaller one that lies in the larger.
fn overlap(expected: &[f64; 4], bounds: &PixelBox) -> f64 {
    let [left, top, right, bottom] = *expected;
    let (x, y) = (f64::from(bounds.x), f64::from(bounds.y));
    let (w, h) = (f64::from(bounds.width), f64::from(bounds.height));
    let wide = (right.min(x + w) - left.max(x)).max(0.0);
    let high = (bottom.min(y + h) - top.max(y)).max(0.0);
    let shared = wide * high;
    let areas = ((right - left) * (bottom - top), w * h);
    let (joint, smaller) = (areas.0 + areas.1 - shared, areas.0.min(areas.1));
    if smaller <= 0.0 { 0.0 } else { (shared / joint).max(CONTAINMENT_WEIGHT * shared / smaller) }
}

/// The part of a box that lies in the image.
fn clip(edges: [f64; 4], (width, height): (u32, u32)) -> PixelBox {
    let place = |v: f64, most: u32| v.round().clamp(0.0, f64::from(most)) as u32;
    let (x, y) = (place(edges[0], width), place(edges[1], height));
    let (right, bottom) = (place(edges[2], width), place(edges[3], height));
    PixelBox { x, y, width: right.saturating_sub(x), height: bottom.saturating_sub(y) }
}

#[cfg(test)]
mod tests;
