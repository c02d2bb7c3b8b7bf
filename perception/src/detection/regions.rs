//! Obstacle regions: stixels of one thing become a box with a distance.

use super::confirmation::Confirmation;
use super::photometric::Verifier;
use super::stixels::{STRIP_COLUMNS, Stixel, Stixels};
use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use crate::road::surface::Surface;

/// What makes a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionParameters {
    /// What reaches less than this above the road is road, in metres.
    pub min_height_m: f64,
    /// What is higher than this above the road is not in the way, in metres.
    pub max_height_m: f64,
    /// Nothing is reported farther away, in metres.
    pub max_distance_m: f64,
    /// Regions narrower than this are noise, in metres.
    pub min_width_m: f64,
    /// Depth that one region may span, in metres: a long hedge is cut into pieces.
    pub depth_span_m: f64,
    /// Regions of fewer pixels are noise.
    pub min_pixels: u32,
    /// At most this many regions are kept, nearest first.
    pub max_count: usize,
    /// Whether a region must come back before it counts; not so for single pictures.
    pub confirm: bool,
}

impl Default for RegionParameters {
    fn default() -> Self {
        Self {
            min_height_m: 0.3,
            max_height_m: 3.0,
            max_distance_m: 60.0,
            min_width_m: 0.2,
            depth_span_m: 4.5,
            min_pixels: 40,
            max_count: 64,
            confirm: true,
        }
    }
}

/// Regions that are measured before the nearest are chosen.
pub(super) const CAPACITY: usize = 512;
/// What rises fewer standard deviations above the road is noise.
const MIN_PROMINENCE: f64 = 1.5;
/// What rises by fewer px of disparity is doubtful: a matcher's steps on a road rise as much.
const DOUBTFUL_RISE_PX: f64 = 1.0;
/// Disparities that differ so much from the fullest place are of one face: the matcher blurs that much. What is
/// farther off, as in rain, tells nothing of it.
const FACE_HALF_WIDTH_PX: f64 = 0.36;
/// What the near side's error is made of: a part of a pixel, which the matcher's steps leave; metres by which
/// things stand out before their face, as the foot of a cone; and the frame's noise, over the stixels of the thing.
/// Fitted to `street` in six weathers and to approaches, so that two standard deviations hold 95 of 100 truths.
const SYSTEMATIC_PX: f64 = 0.062;
const SHAPE_M: f64 = 0.075;
const NOISE_FACTOR: f64 = 1.5;
/// Share of what lies around the depth that most of a thing shows which is nearer than its near side is
/// taken for. None would be the noise's edge, a half the middle of its face: the things of our scenes, seen
/// in six weathers, are on average at neither.
const NEAR_SHARE: f64 = 0.38;
/// A stixel that begins higher than this above the road may hang, in metres.
const MAX_FOOT_HEIGHT_M: f64 = 0.8;
/// Share of a region's strips in which something must begin lower.
const MIN_STANDING_SHARE: f64 = 0.4;
/// The widest is_artefact of an edge, in px.
const MAX_ARTEFACT_WIDTH_PX: u32 = 5 * STRIP_COLUMNS as u32;
/// Confidence from which a region is no such is_artefact.
const MIN_SURE_CONFIDENCE: f64 = 0.7;
/// The far end of a long thing: the most columns that it is wide, and metres that it lies behind the near side.
const MAX_TAIL_WIDTH_PX: u32 = 7 * STRIP_COLUMNS as u32;
const TAIL_DEPTH_M: std::ops::Range<f64> = 0.3..6.0;
/// Columns that such an end may be apart from the rest, and that it may lie before it.
const MAX_TAIL_GAP_PX: u32 = STRIP_COLUMNS as u32;
const MAX_TAIL_OVERLAP_PX: u32 = 2 * STRIP_COLUMNS as u32;
/// What is so many rows or columns apart is at the same place.
const ALIGNMENT_PX: u32 = 2;
/// Evidence that a thing must have for others to be its end, and evidence from which these are things themselves.
const TAIL_OWNER_EVIDENCE: f64 = 3.0;
const INDEPENDENT_EVIDENCE: f64 = 5.0;
/// Weights of evidence: constant, log-odds of confidence, logarithms of fill, height (m) and pixels.
const EVIDENCE: [f64; 5] = [-4.0, 1.85, 3.6, 2.1, 1.1];
/// Evidence that no look at the pictures could make up for, and the most that the map's counts beside one: it is
/// great where a surface without texture lies too near, too.
const MIN_MAP_EVIDENCE: f64 = -8.0;
const MAX_MAP_EVIDENCE: f64 = 5.0;
/// Share of the taller of two stixels that lies beside the other, if they are of one thing: a kerb beside
/// a car is not of the car.
const MIN_ROW_OVERLAP: f64 = 0.2;
/// Metres by which the depth of one thing may change from one stixel to the next: the side of a car that is
/// near is seen at a flat angle.
const MAX_DEPTH_STEP_M: f32 = 0.3;
/// Strips over which stixels are linked.
const LINK_STRIPS: usize = 3;
/// Bins of a pixel of disparity in which the near side is sought.
const BINS_PER_PX: usize = 8;

/// Groups stixels, with memory allocated once.
#[derive(Debug)]
pub struct RegionFinder {
    parameters: RegionParameters,
    /// Stixels by disparity, the nearest first.
    order: Vec<u32>,
    visited: Vec<bool>,
    stack: Vec<u32>,
    members: Vec<u32>,
    /// Rows by disparity of the region at hand.
    histogram: Vec<u32>,
    regions: Vec<Region>,
    /// Evidence of each.
    evidence: Vec<f64>,
    confirmation: Confirmation,
}

impl RegionFinder {
    /// A workspace for such stixels with disparities below `disparities` px.
    pub fn new(parameters: RegionParameters, stixels: &Stixels, disparities: usize) -> Self {
        let capacity = stixels.capacity();
        Self {
            parameters,
            order: Vec::with_capacity(capacity),
            visited: Vec::with_capacity(capacity),
            stack: Vec::with_capacity(capacity),
            members: Vec::with_capacity(capacity),
            histogram: vec![0; disparities * BINS_PER_PX + 1],
            regions: Vec::with_capacity(CAPACITY),
            evidence: Vec::with_capacity(CAPACITY),
            confirmation: Confirmation::new(parameters.confirm),
        }
    }

    /// Groups stixels; the regions are sorted, nearest first, and beyond the greatest count the
    /// farthest are left out. `size` is the image's width and height; `verifier` are the pictures, where they
    /// are known.
    pub fn find(
        &mut self,
        stixels: &Stixels,
        surface: &Surface,
        rig: &Rig,
        size: (usize, usize),
        verifier: Option<&Verifier<'_>>,
    ) -> &[Region] {
        let list = stixels.list();
        self.regions.clear();
        self.visited.clear();
        self.visited.resize(list.len(), false);
        self.order.clear();
        self.order.extend(0..list.len() as u32);
        let depth = |i: &u32| list[*i as usize].disparity_px;
        self.order.sort_unstable_by(|a, b| depth(b).total_cmp(&depth(a)).then(a.cmp(b)));
        for i in 0..self.order.len() {
            let seed = self.order[i];
            if self.visited[seed as usize] {
                continue;
            }
            self.grow(stixels, surface, rig, seed);
            if let Some(region) = self.measure(stixels, surface, rig, size)
                && self.regions.len() < CAPACITY
            {
                self.regions.push(region);
            }
        }
        self.remove_occlusion_artefacts();
        self.evidence.clear();
        for region in &mut self.regions {
            let mut sum = evidence(region, surface);
            let verification =
                verifier.filter(|_| sum >= MIN_MAP_EVIDENCE).and_then(|verifier| verifier.verify(region));
            if let Some(verification) = verification {
                sum = sum.min(MAX_MAP_EVIDENCE) + verification.evidence();
                if let Some(sides) = verification.sides {
                    region.set_sides(sides, rig);
                }
            }
            self.evidence.push(sum);
        }
        self.suppress_tails();
        let verify = |region: &Region| verifier.and_then(|v| v.verify(region)).map(|v| v.evidence());
        self.confirmation.filter(&mut self.regions, &self.evidence, size, rig, verify);
        // The seed is the nearest stray stixel; what counts is where the region stands.
        self.regions.sort_unstable_by(|a, b| {
            b.disparity_px.total_cmp(&a.disparity_px).then(a.bounds.x.cmp(&b.bounds.x))
        });
        self.regions.truncate(self.parameters.max_count);
        &self.regions
    }

    /// Collects all stixels that connect to the seed and are not much farther away than it.
    fn grow(&mut self, stixels: &Stixels, surface: &Surface, rig: &Rig, seed: u32) {
        let list = stixels.list();
        let near_m = rig.distance_m(f64::from(list[seed as usize].disparity_px));
        let min_px = rig.disparity_px(near_m + self.parameters.depth_span_m) as f32;
        let px_at_1_m = rig.disparity_px(1.0) as f32;
        self.members.clear();
        self.stack.clear();
        self.visited[seed as usize] = true;
        self.stack.push(seed);
        while let Some(i) = self.stack.pop() {
            self.members.push(i);
            let here = list[i as usize];
            let strip = here.strip as usize;
            for next in strip.saturating_sub(LINK_STRIPS)..(strip + LINK_STRIPS + 1).min(stixels.strips()) {
                for j in stixels.range(next) {
                    let there = &list[j];
                    if !self.visited[j]
                        && there.disparity_px >= min_px
                        && linked(&here, there, surface, px_at_1_m)
                    {
                        self.visited[j] = true;
                        self.stack.push(j as u32);
                    }
                }
            }
        }
    }

    /// Takes out narrow regions that cling to the side of a nearer, larger one: where the background is
    /// hidden from one camera, the matcher fills in depths in between.
    fn remove_occlusion_artefacts(&mut self) {
        let regions = &mut self.regions;
        let mut kept = 0;
        for i in 0..regions.len() {
            let (near, far) = (&regions[..], regions[i]);
            let is_artefact = far.bounds.width <= MAX_ARTEFACT_WIDTH_PX
                && far.confidence < MIN_SURE_CONFIDENCE
                && near.iter().any(|near| {
                    let (a, b) = (&near.bounds, &far.bounds);
                    let (right, bottom) = (a.x + a.width + 2 * STRIP_COLUMNS as u32, a.y + a.height);
                    let touches = b.x <= right && b.x + b.width + 2 * STRIP_COLUMNS as u32 >= a.x;
                    let beside = b.y + b.height <= bottom && b.y + b.height / 2 >= a.y;
                    near.disparity_px > far.disparity_px * 1.05
                        && near.pixels > 2 * far.pixels
                        && touches
                        && beside
                });
            if !is_artefact {
                regions.swap(kept, i);
                kept += 1;
            }
        }
        regions.truncate(kept);
    }

    /// Doubts narrow regions that cling to the far end of a nearer, larger one. The side of a long thing is seen
    /// at a flat angle and its end is smeared over what lies beside it: unless much speaks for it, that is no
    /// thing of its own.
    fn suppress_tails(&mut self) {
        for i in 0..self.regions.len() {
            let mut others = self.regions.iter().zip(&self.evidence);
            if self.evidence[i] < INDEPENDENT_EVIDENCE
                && others.any(|(near, &sum)| sum > TAIL_OWNER_EVIDENCE && is_tail(&self.regions[i], near))
            {
                self.evidence[i] = self.evidence[i].min(0.0);
            }
        }
    }

    fn measure(
        &mut self,
        stixels: &Stixels,
        surface: &Surface,
        rig: &Rig,
        (width, height): (usize, usize),
    ) -> Option<Region> {
        let p = self.parameters;
        let list = stixels.list();
        let members = || self.members.iter().map(|&i| &list[i as usize]);
        let rows: u32 = members().map(|s| u32::from(s.rows)).sum();
        let pixels = rows * STRIP_COLUMNS as u32;
        let confidence: f64 = members().map(|s| f64::from(s.rows) * f64::from(s.confidence)).sum();
        if pixels < p.min_pixels {
            return None;
        }
        let (mut left, mut right, mut top) = (u32::MAX, 0, u16::MAX);
        for stixel in members() {
            left = left.min(stixel.strip);
            right = right.max(stixel.strip);
            top = top.min(stixel.top);
        }
        // What stands begins near the road: a sky without texture can seem to hang at any depth.
        let low = members().filter(|s| f64::from(s.low_m) <= MAX_FOOT_HEIGHT_M).count();
        let stands = low as f64 >= MIN_STANDING_SHARE * f64::from(right + 1 - left);
        let (disparity_px, disparity_sigma_px) = self.near_side(stixels, surface, rig)?;
        let distance_m = rig.distance_m(disparity_px);
        if distance_m > p.max_distance_m {
            return None;
        }
        let x = left * STRIP_COLUMNS as u32;
        let right = ((right + 1) * STRIP_COLUMNS as u32).min(width as u32);
        // The stixels leave out what is low: the box goes down to the road.
        let middle = f64::from(x + right) / 2.0;
        let foot = f64::from(surface.row_at(middle, disparity_px));
        let foot = foot.round().clamp(f64::from(top), (height - 1) as f64) as u32;
        let bounds = PixelBox { x, y: top.into(), width: right - x, height: foot + 1 - u32::from(top) };
        let height_m = surface.height_m(middle, f64::from(top), disparity_px);
        let metres = |px: u32| f64::from(px) * distance_m / rig.focal_px;
        let region = Region {
            bounds,
            disparity_px,
            disparity_sigma_px,
            distance_m,
            lateral_m: rig.lateral_m(f64::from(x) + f64::from(bounds.width) / 2.0, distance_m),
            width_m: metres(bounds.width),
            height_m,
            pixels,
            confidence: confidence / (255.0 * f64::from(rows.max(1))),
        };
        let kept = stands
            && region.height_m >= p.min_height_m
            && prominence(&region, surface) >= MIN_PROMINENCE
            && region.width_m >= p.min_width_m;
        kept.then_some(region)
    }

    /// Disparity of the near side with its standard deviation: the nearest depth at which a good part
    /// of the region stands, so that neither its length nor a few stray rows move it; of that, the near part.
    fn near_side(&mut self, stixels: &Stixels, surface: &Surface, rig: &Rig) -> Option<(f64, f64)> {
        self.histogram.fill(0);
        let list = stixels.list();
        let last = self.histogram.len() - 1;
        let mut total = 0;
        for &i in &self.members {
            let stixel = &list[i as usize];
            let depths = stixels.depths(stixel.strip as usize);
            for &d in &depths[usize::from(stixel.top)..=usize::from(stixel.bottom)] {
                if d > 0 {
                    self.histogram[(usize::from(d) * BINS_PER_PX / 256).min(last)] += 1;
                    total += 1;
                }
            }
        }
        // From the near end on, until a tenth is passed; then to the centre of what lies there.
        let mut rest = total / 10;
        let mut nearest = last;
        for (bin, &count) in self.histogram.iter().enumerate().rev() {
            nearest = bin;
            if count > rest {
                break;
            }
            rest -= count;
        }
        // The fullest place within reach of it: pixels at the edges of a thing lie behind it, never
        // before it, so a mean of all would be too far.
        let reach = (4.0 * surface.noise_px() * BINS_PER_PX as f64 + 0.02 * nearest as f64).ceil() as usize;
        let smooth = |bin: usize| {
            let range = bin.saturating_sub(1)..=(bin + 1).min(last);
            self.histogram[range].iter().sum::<u32>() + self.histogram[bin]
        };
        let candidates = nearest.saturating_sub(reach)..=(nearest + reach / 2).min(last);
        let peak = candidates.max_by_key(|&bin| smooth(bin)).unwrap_or(nearest);
        let mut centre = peak as f64 + 0.5;
        let half = FACE_HALF_WIDTH_PX * BINS_PER_PX as f64 + 0.005 * centre;
        for _ in 0..2 {
            let range = (centre - half).max(0.0) as usize..=((centre + half) as usize).min(last);
            let (mut count, mut sum) = (0.0, 0.0);
            for bin in range {
                let weight = f64::from(self.histogram[bin]);
                count += weight;
                sum += weight * (bin as f64 + 0.5);
            }
            if count == 0.0 {
                return None;
            }
            centre = sum / count;
        }
        // The nearest point is wanted, and most of a thing lies behind it: where a good third is passed.
        let around = (centre - half).max(0.0) as usize..=((centre + half) as usize).min(last);
        let mut rest = NEAR_SHARE * around.clone().map(|bin| f64::from(self.histogram[bin])).sum::<f64>();
        let mut near = centre;
        for bin in around.rev() {
            let count = f64::from(self.histogram[bin]);
            if count > rest {
                near = bin as f64 + 1.0 - rest / count;
                break;
            }
            rest -= count;
        }
        let near_px = near / BINS_PER_PX as f64;
        let shape_px = SHAPE_M * near_px * near_px / rig.disparity_px(1.0);
        let noise_px = NOISE_FACTOR * surface.noise_px() / self.members.len() as f64;
        Some((near_px, SYSTEMATIC_PX.hypot(shape_px).hypot(noise_px)))
    }
}

/// Log-odds that a region of one frame is something: what is surely matched, fills its box, is tall and
/// wide stands out. The weights are a logistic regression over regions of our scenes in six weathers.
fn evidence(region: &Region, surface: &Surface) -> f64 {
    let confidence = region.confidence.clamp(0.3, 0.98);
    let area = f64::from(region.bounds.width) * f64::from(region.bounds.height);
    let fill = (f64::from(region.pixels) / area.max(1.0)).clamp(0.05, 1.0);
    let rise_px = prominence(region, surface) * surface.noise_px();
    EVIDENCE[0]
        + 3.0 * (rise_px / DOUBTFUL_RISE_PX).min(1.0).ln()
        + EVIDENCE[1] * (confidence / (1.0 - confidence)).ln()
        + EVIDENCE[2] * fill.ln()
        + EVIDENCE[3] * region.height_m.max(0.05).ln()
        + EVIDENCE[4] * f64::from(region.pixels.max(1)).ln()
}

/// Whether a region may be the far end of a nearer, larger one: beside it, and neither higher nor lower.
fn is_tail(far: &Region, near: &Region) -> bool {
    let (a, b) = (&near.bounds, &far.bounds);
    let (a_end, b_end) = (a.x + a.width, b.x + b.width);
    let is_left = b.x + b_end < a.x + a_end;
    let (gap, overlap, beyond) = if is_left {
        (a.x.saturating_sub(b_end), b_end.saturating_sub(a.x), a.x.saturating_sub(b.x))
    } else {
        (b.x.saturating_sub(a_end), a_end.saturating_sub(b.x), b_end.saturating_sub(a_end))
    };
    let beside = gap <= MAX_TAIL_GAP_PX && overlap <= MAX_TAIL_OVERLAP_PX && beyond > ALIGNMENT_PX;
    let (a_bottom, b_bottom) = (a.y + a.height, b.y + b.height);
    beside
        && b_bottom <= a_bottom + ALIGNMENT_PX
        && a.y <= b.y + 3 * ALIGNMENT_PX
        && b.width <= MAX_TAIL_WIDTH_PX
        && 2 * a.width * a.height >= 3 * b.width * b.height
        && TAIL_DEPTH_M.contains(&(far.distance_m - near.distance_m))
}

/// Standard deviations of the frame's noise that a region's top is above the road.
fn prominence(region: &Region, surface: &Surface) -> f64 {
    region.height_m / surface.height_noise_m(region.disparity_px)
}

/// Whether two stixels of neighbouring strips belong to one thing: of one depth, and side by side. At a metre
/// the disparity is `px_at_1_m`.
fn linked(a: &Stixel, b: &Stixel, surface: &Surface, px_at_1_m: f32) -> bool {
    let noise = 0.15 + 2.0 * (surface.noise_px() as f32).min(0.15) + 0.015 * a.disparity_px;
    let tolerance = noise.max(MAX_DEPTH_STEP_M * a.disparity_px * b.disparity_px / px_at_1_m);
    let shared = i32::from(a.bottom.min(b.bottom)) + 1 - i32::from(a.top.max(b.top));
    let taller = i32::from((a.bottom - a.top).max(b.bottom - b.top)) + 1;
    let beside = f64::from(shared) >= MIN_ROW_OVERLAP * f64::from(taller);
    beside && (a.disparity_px - b.disparity_px).abs() <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(x: u32, width: u32, distance_m: f64) -> Region {
        Region {
            bounds: PixelBox { x, y: 200, width, height: 40 },
            disparity_px: 100.0 / distance_m,
            disparity_sigma_px: 0.1,
            distance_m,
            lateral_m: 0.0,
            width_m: 1.0,
            height_m: 1.0,
            pixels: 400,
            confidence: 0.9,
        }
    }

    #[test]
    fn the_far_end_of_a_car_is_no_thing_of_its_own() {
        let car = region(300, 80, 18.0);
        for x in [378, 380, 384] {
            assert!(is_tail(&region(x, 16, 22.0), &car), "on its right, from {x}");
            assert!(is_tail(&region(680 - x - 16, 16, 22.0), &car), "on its left");
        }
        assert!(!is_tail(&region(386, 16, 22.0), &car), "apart");
        assert!(!is_tail(&region(366, 16, 22.0), &car), "before it");
        assert!(!is_tail(&region(380, 32, 22.0), &car), "wide");
        assert!(!is_tail(&region(380, 16, 24.5), &car), "far behind");
        assert!(!is_tail(&region(380, 16, 17.0), &car), "nearer");
        assert!(!is_tail(&region(380, 16, 22.0), &region(364, 16, 18.0)), "of a thing as small");
        let mut low = region(380, 16, 22.0);
        low.bounds.y += 3;
        assert!(!is_tail(&low, &car), "its foot is lower: it stands nearer, or on something else");
    }

    #[test]
    fn an_end_is_doubted_unless_much_speaks_for_it() {
        let stixels = Stixels::new(640, 480);
        let mut finder = RegionFinder::new(RegionParameters::default(), &stixels, 64);
        finder.regions.extend([region(300, 80, 18.0), region(380, 16, 22.0), region(284, 16, 22.0)]);
        for (given, kept) in [
            ([9.0, 4.0, 6.0], [9.0, 0.0, 6.0]),
            ([9.0, -3.0, 5.0], [9.0, -3.0, 5.0]),
            // Of what is not there itself, nothing is the end.
            ([2.0, 4.0, 4.0], [2.0, 4.0, 4.0]),
        ] {
            finder.evidence.clear();
            finder.evidence.extend(given);
            finder.suppress_tails();
            assert_eq!(finder.evidence, kept);
        }
    }
}
