//! Groups stixels into obstacle regions: pixel boxes with a distance.

use super::concavity::Profile;
use super::evidence::{evidence, prominence};
use super::footprint::footprint;
use super::occlusion::hidden_sides;
use super::photometric::Verifier;
use super::refinement::{MAX_PARTS, Part, refine};
use super::sides::join_sides;
use super::stixel_use::StixelUse;
use super::stixels::{STRIP_COLUMNS, Stixel, Stixels};
use crate::outline::Outline;
use crate::region::{DEPTH_BLUR_PX, PixelBox, Region, SHAPE_M};
use crate::rig::Rig;
use crate::road::surface::RoadSurface;

/// Parameters of region detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionParameters {
    /// Smallest height above the road, in metres; anything lower is road.
    pub min_height_m: f64,
    /// Largest height above the road, in metres; anything higher does not obstruct the vehicle.
    pub max_height_m: f64,
    /// Largest reported distance, in metres.
    pub max_distance_m: f64,
    /// Smallest width of a region, in metres.
    pub min_width_m: f64,
    /// Largest extent of a region in depth, in metres, or what noise does not tell apart; a long hedge is split.
    pub depth_span_m: f64,
    /// Fewest pixels of a region.
    pub min_pixels: u32,
    /// Largest number of regions; those with most evidence are kept.
    pub max_count: usize,
    /// Whether boundaries are confirmed over several frames; `false` for single images.
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

/// Sightings with less evidence are not reported: they tell less of an obstacle than a frame without a sighting does, as
/// detection misses a third of what is there (ln 0.37).
pub const MIN_EVIDENCE: f64 = -1.0;

/// Largest number of regions before the nearest are selected.
pub(super) const CAPACITY: usize = 512;
/// Smallest height of a region, in standard deviations of the height noise.
const MIN_PROMINENCE: f64 = 1.5;
/// Half-width of the disparity range of one face, in px: the blur of the matcher. Values farther away, as in
/// rain, carry no information about the face.
const FACE_HALF_WIDTH_PX: f64 = DEPTH_BLUR_PX;
/// Error model of the near side: an error in px caused by the steps of the matcher; protrusion in front of
/// the face ([`SHAPE_M`]); and the noise of the frame divided by the number of
/// stixels. Fitted to `street` in six weathers and to approaches, such that two standard deviations contain
/// 95 % of the true values.
const SYSTEMATIC_PX: f64 = 0.062;
const NOISE_FACTOR: f64 = 1.5;
/// Share of the pixels around the dominant depth that lies in front of the reported near side. 0 would be the
/// edge of the noise, 0.5 the centre of the face; on average over the objects of the synthetic scenes in six
/// weathers, the near side is at neither.
const NEAR_SHARE: f64 = 0.38;
/// A stixel that starts higher above the road than this may be a hanging object, in metres.
const MAX_FOOT_HEIGHT_M: f64 = 0.8;
/// Share of the strips of a region in which a stixel must start lower.
const MIN_STANDING_SHARE: f64 = 0.4;
/// Raised ground that is at least this many times as wide or deep as high is no obstacle; it makes up at least this share of the
/// stixels of a region.
const FLAT_ASPECT: f64 = 3.0;
const RAISED_SHARE: f64 = 0.6;
/// Largest width of an occlusion artefact, in px.
const MAX_ARTEFACT_WIDTH_PX: u32 = 5 * STRIP_COLUMNS as u32;
/// Confidence from which a narrow region is not an occlusion artefact.
const MIN_SURE_CONFIDENCE: f64 = 0.7;
/// Below the first value photometric verification is skipped. The second limits the evidence of the disparity
/// map where verification is available, as it is also large where a textureless surface is measured too near.
const MIN_MAP_EVIDENCE: f64 = -8.0;
const MAX_MAP_EVIDENCE: f64 = 5.0;
/// Smallest overlap of the rows of two linked stixels, as a share of the taller one; separates a kerb from
/// the car beside it.
const MIN_ROW_OVERLAP: f64 = 0.2;
/// Largest change of depth between neighbouring stixels of one object, in metres; allows for the side of a
/// near car, which is seen at a shallow angle.
const MAX_DEPTH_STEP_M: f32 = 0.3;
/// Largest distance of linked stixels, in strips.
const LINK_STRIPS: usize = 3;
/// A region is split where its outline is concave by more than this, in metres: wheel arches, and the gap between bonnet and windscreen,
/// are less;
const MIN_CONCAVITY_M: f64 = 0.4;
/// by more than this many standard deviations of the noise;
const CONCAVITY_SIGMAS: f64 = 3.0;
/// and by more than this, in px: twice the blur of the matcher.
const MIN_CONCAVITY_PX: f64 = 2.0 * DEPTH_BLUR_PX;
/// Histogram bins per px of disparity for the near side.
const BINS_PER_PX: usize = 8;

/// Groups stixels into regions; memory is allocated once.
#[derive(Debug)]
pub struct RegionFinder {
    parameters: RegionParameters,
    /// Stixel indices by decreasing disparity.
    order: Vec<u32>,
    visited: Vec<bool>,
    stack: Vec<u32>,
    members: Vec<u32>,
    /// Stixels of a region that are grown once more.
    rest: Vec<u32>,
    /// Stixels of the region that is split, from left to right, the ranges of its parts among them, and the outline of a part.
    whole: Vec<u32>,
    parts: Vec<[usize; 2]>,
    profile: Profile,
    /// Row counts by disparity of the current region.
    histogram: Vec<u32>,
    /// Parts of rows of the current region that are compared in both images.
    compared: Vec<Part>,
    regions: Vec<Region>,
}

impl RegionFinder {
    /// A workspace for the given stixels with disparities below `disparities` px.
    pub fn new(parameters: RegionParameters, stixels: &Stixels, disparities: usize) -> Self {
        let capacity = stixels.capacity();
        Self {
            parameters,
            order: Vec::with_capacity(capacity),
            visited: Vec::with_capacity(capacity),
            stack: Vec::with_capacity(capacity),
            members: Vec::with_capacity(capacity),
            rest: Vec::with_capacity(capacity),
            whole: Vec::with_capacity(capacity),
            parts: Vec::with_capacity(stixels.strips()),
            profile: Profile::with_capacity(stixels.strips()),
            histogram: vec![0; disparities * BINS_PER_PX + 1],
            compared: Vec::with_capacity(MAX_PARTS),
            regions: Vec::with_capacity(CAPACITY),
        }
    }

    /// Sets the largest reported distance, in metres.
    pub(super) fn set_range_m(&mut self, max_distance_m: f64) {
        self.parameters.max_distance_m = max_distance_m;
    }

    /// Groups stixels into regions with evidence of at least [`MIN_EVIDENCE`], in no order. `size` is the width and height of
    /// the image; `verifier` is `None` if the images are not available. By `uses`, boundaries and flat raised
    /// ground are left out.
    pub fn find(
        &mut self,
        stixels: &Stixels,
        uses: &[StixelUse],
        surface: &RoadSurface,
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
            self.grow(stixels, uses, surface, rig, seed, |a, b| {
                (a == StixelUse::Boundary) == (b == StixelUse::Boundary)
            });
            if !self.is_raised_ground(stixels, uses, rig) {
                if use_of(uses, seed) != StixelUse::Boundary {
                    self.take(stixels, surface, rig, size, verifier);
                }
                continue;
            }
            // What stands on the ground was linked with it: it is grown once more by itself.
            self.rest.clear();
            let others = self.members.iter().filter(|i| use_of(uses, **i) != StixelUse::RaisedGround);
            self.rest.extend(others);
            self.rest.iter().for_each(|i| self.visited[*i as usize] = false);
            for i in 0..self.rest.len() {
                let seed = self.rest[i];
                if !self.visited[seed as usize] {
                    self.grow(stixels, uses, surface, rig, seed, |a, b| a == b);
                    self.take(stixels, surface, rig, size, verifier);
                }
            }
        }
        self.remove_occlusion_artefacts();
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
            region.evidence = sum;
        }
        join_sides(&mut self.regions, rig);
        self.regions.retain(|region| region.evidence >= MIN_EVIDENCE);
        if let Some(verifier) = verifier {
            for region in self.regions.iter_mut().filter(|region| verifier.is_too_wide(region)) {
                let sides = verifier.sides(region);
                region.set_sides(sides, rig);
            }
        }
        &self.regions
    }

    /// Adds the region that was grown last, split where its outline on the ground turns inwards.
    fn take(
        &mut self,
        stixels: &Stixels,
        surface: &RoadSurface,
        rig: &Rig,
        size: (usize, usize),
        verifier: Option<&Verifier<'_>>,
    ) {
        let list = stixels.list();
        self.whole.clear();
        self.whole.append(&mut self.members);
        // From left to right, the nearest first.
        self.whole.sort_unstable_by(|a, b| {
            let (a, b) = (&list[*a as usize], &list[*b as usize]);
            a.strip.cmp(&b.strip).then(b.disparity_px.total_cmp(&a.disparity_px)).then(a.top.cmp(&b.top))
        });
        self.parts.clear();
        self.parts.push([0, self.whole.len()]);
        let limit_px = MIN_CONCAVITY_PX.max(CONCAVITY_SIGMAS * surface.noise_px());
        let limit_m =
            |distance_m: f64| MIN_CONCAVITY_M.max(limit_px * distance_m * distance_m / rig.disparity_px(1.0));
        while let Some([from, to]) = self.parts.pop() {
            self.profile.trace(self.whole[from..to].iter().map(|i| &list[*i as usize]), rig);
            let corner = self.profile.corner(limit_m).map(|strip| {
                from + self.whole[from..to].partition_point(|i| list[*i as usize].strip < strip)
            });
            // It is split only if both parts may be obstacles, so that nothing is lost.
            let mut region_of = |part: std::ops::Range<usize>, verifier: Option<&Verifier<'_>>| {
                self.members.clear();
                self.members.extend_from_slice(&self.whole[part]);
                self.measure(stixels, surface, rig, size, verifier)
            };
            match corner {
                Some(at) if region_of(from..at, None).is_some() && region_of(at..to, None).is_some() => {
                    self.parts.push([from, at]);
                    self.parts.push([at, to]);
                }
                _ => {
                    // What has been found to be one without the images remains one.
                    let region = region_of(from..to, verifier).or_else(|| region_of(from..to, None));
                    self.add(region);
                }
            }
        }
    }

    /// Adds a region, if it may be an obstacle.
    fn add(&mut self, region: Option<Region>) {
        if let Some(region) = region.filter(|_| self.regions.len() < CAPACITY) {
            self.regions.push(region);
        }
    }

    /// Region growing: collects all stixels that connect to the seed, whose uses may be linked, and that are not much farther away.
    fn grow(
        &mut self,
        stixels: &Stixels,
        uses: &[StixelUse],
        surface: &RoadSurface,
        rig: &Rig,
        seed: u32,
        may_link: impl Fn(StixelUse, StixelUse) -> bool,
    ) {
        let list = stixels.list();
        let near_px = list[seed as usize].disparity_px;
        let near_m = rig.distance_m(f64::from(near_px));
        // Far away the noise spans more than a thing is deep.
        let span_px = near_px - rig.disparity_px(near_m + self.parameters.depth_span_m) as f32;
        let min_px = near_px - span_px.max(link_noise_px(near_px, surface));
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
                    let other = &list[j];
                    if !self.visited[j]
                        && may_link(use_of(uses, i), use_of(uses, j as u32))
                        && other.disparity_px >= min_px
                        && linked(&here, other, surface, px_at_1_m)
                    {
                        self.visited[j] = true;
                        self.stack.push(j as u32);
                    }
                }
            }
        }
    }

    /// Whether most of the region that was grown last belongs to raised ground, a pavement or a lawn behind a kerb, and that
    /// part is flat: several times as wide, or as deep, as high. A cone or a person on the pavement is not.
    fn is_raised_ground(&self, stixels: &Stixels, uses: &[StixelUse], rig: &Rig) -> bool {
        let (mut left, mut right, mut high_m) = (u32::MAX, 0, 0.0_f32);
        let (mut near_px, mut far_px, mut raised) = (0.0_f32, f32::INFINITY, 0);
        for &i in self.members.iter().filter(|i| use_of(uses, **i) == StixelUse::RaisedGround) {
            let stixel = &stixels.list()[i as usize];
            (left, right, high_m) =
                (left.min(stixel.strip), right.max(stixel.strip), high_m.max(stixel.high_m));
            (near_px, far_px) = (near_px.max(stixel.disparity_px), far_px.min(stixel.disparity_px));
            raised += 1;
        }
        if raised == 0 || f64::from(raised) < RAISED_SHARE * self.members.len() as f64 {
            return false;
        }
        let [near_px, far_px] = [near_px, far_px].map(f64::from);
        let columns = f64::from((right + 1 - left) * STRIP_COLUMNS as u32);
        let near_m = rig.distance_m(near_px);
        let depth_m = (rig.distance_m(far_px + FACE_HALF_WIDTH_PX) - near_m).max(0.0);
        let width_m = columns * near_m / rig.focal_px;
        width_m.hypot(depth_m) >= FLAT_ASPECT * f64::from(high_m)
    }

    /// Removes narrow regions adjacent to a nearer, larger one: where the background is occluded in one
    /// camera, the matcher interpolates between both depths.
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
                    let adjacent = b.y + b.height <= bottom && b.y + b.height / 2 >= a.y;
                    near.disparity_px > far.disparity_px * 1.05
                        && near.pixels > 2 * far.pixels
                        && touches
                        && adjacent
                });
            if !is_artefact {
                regions.swap(kept, i);
                kept += 1;
            }
        }
        regions.truncate(kept);
    }

    fn measure(
        &mut self,
        stixels: &Stixels,
        surface: &RoadSurface,
        rig: &Rig,
        (width, height): (usize, usize),
        verifier: Option<&Verifier<'_>>,
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
        // An obstacle starts near the road; a textureless sky can be matched at any depth.
        let low = members().filter(|s| f64::from(s.low_m) <= MAX_FOOT_HEIGHT_M).count();
        if (low as f64) < MIN_STANDING_SHARE * f64::from(right + 1 - left) {
            return None;
        }
        let near_side = self.near_side(stixels, surface, rig)?;
        let images = verifier.map(|verifier| verifier.images);
        let members = self.members.iter().map(|&i| &list[i as usize]);
        let refined =
            images.and_then(|images| refine(&mut self.compared, stixels, members, images, near_side.0, rig));
        let (disparity_px, disparity_sigma_px) = refined.unwrap_or(near_side);
        let distance_m = rig.distance_m(disparity_px);
        if distance_m > p.max_distance_m {
            return None;
        }
        let x = left * STRIP_COLUMNS as u32;
        let right = ((right + 1) * STRIP_COLUMNS as u32).min(width as u32);
        // Low parts are not in the stixels: the box is extended down to the road.
        let middle = f64::from(x + right) / 2.0;
        let foot = f64::from(surface.row_at(middle, disparity_px));
        let foot = foot.round().clamp(f64::from(top), (height - 1) as f64) as u32;
        let bounds = PixelBox { x, y: top.into(), width: right - x, height: foot + 1 - u32::from(top) };
        let height_m = surface.height_m(middle, f64::from(top), disparity_px);
        let metres = |px: u32| f64::from(px) * distance_m / rig.focal_px;
        let mut region = Region {
            bounds,
            disparity_px,
            disparity_sigma_px,
            distance_m,
            lateral_m: rig.lateral_m(f64::from(x) + f64::from(bounds.width) / 2.0, distance_m),
            width_m: metres(bounds.width),
            height_m,
            inset_m: [0.0; 2],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            pixels,
            confidence: confidence / (255.0 * f64::from(rows.max(1))),
            evidence: 0.0,
        };
        // Before the region is refined, as the stixels around it are.
        let near_px = near_side.0 as f32;
        let tolerance_px = link_tolerance_px([near_px; 2], surface, rig.disparity_px(1.0) as f32);
        let strips = (stixels.strips(), |strip| &list[stixels.range(strip)]);
        region.is_hidden = hidden_sides(strips, &region.bounds, near_px, tolerance_px);
        region.goes_on = self.continued_sides(stixels, surface, rig);
        let members = self.members.iter().map(|&i| &list[i as usize]);
        region.set_footprint(&footprint(members, disparity_px, disparity_px - near_side.0, rig));
        let kept = region.height_m >= p.min_height_m
            && prominence(&region, surface) >= MIN_PROMINENCE
            && region.width_m >= p.min_width_m;
        kept.then_some(region)
    }

    /// Whether stixels of other regions go on beyond the left and the right side of the region that was grown last: it was divided there.
    fn continued_sides(&self, stixels: &Stixels, surface: &RoadSurface, rig: &Rig) -> [bool; 2] {
        let list = stixels.list();
        let px_at_1_m = rig.disparity_px(1.0) as f32;
        let members = || self.members.iter().map(|&i| &list[i as usize]);
        let strip = |member: &Stixel| member.strip as usize;
        let (first, last) = members().map(strip).fold((usize::MAX, 0), |(a, b), s| (a.min(s), b.max(s)));
        let goes_on = |side: usize, beside: std::ops::Range<usize>| {
            let ends = members().filter(|member| strip(member) == side);
            let mut others = beside.flat_map(|strip| &list[stixels.range(strip)]);
            others.any(|other| ends.clone().any(|end| linked(end, other, surface, px_at_1_m)))
        };
        [
            goes_on(first, first.saturating_sub(LINK_STRIPS)..first),
            goes_on(last, last + 1..(last + 1 + LINK_STRIPS).min(stixels.strips())),
        ]
    }

    /// Disparity of the near side and its standard deviation: the nearest depth that contains a substantial
    /// part of the region, which makes it independent of the region's length and of single outlier rows.
    fn near_side(&mut self, stixels: &Stixels, surface: &RoadSurface, rig: &Rig) -> Option<(f64, f64)> {
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
        // Skip the nearest tenth of the rows.
        let mut rest = total / 10;
        let mut nearest = last;
        for (bin, &count) in self.histogram.iter().enumerate().rev() {
            nearest = bin;
            if count > rest {
                break;
            }
            rest -= count;
        }
        // The mode near that bin: pixels at the edges of an object are too far, never too near, so the mean
        // would be biased.
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
        // The nearest point is in front of the centre: the quantile [`NEAR_SHARE`] of the face.
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

/// The use of a stixel; free where none is told.
fn use_of(uses: &[StixelUse], i: u32) -> StixelUse {
    uses.get(i as usize).copied().unwrap_or_default()
}

/// By how much the disparities of two stixels of one face may differ, in px.
fn link_noise_px(disparity_px: f32, surface: &RoadSurface) -> f32 {
    0.15 + 2.0 * (surface.noise_px() as f32).min(0.15) + 0.015 * disparity_px
}

/// By how much these disparities of neighbouring stixels of one object may differ, in px.
fn link_tolerance_px([a_px, b_px]: [f32; 2], surface: &RoadSurface, px_at_1_m: f32) -> f32 {
    link_noise_px(a_px, surface).max(MAX_DEPTH_STEP_M * a_px * b_px / px_at_1_m)
}

/// Whether two stixels of neighbouring strips belong to one object: similar depth and overlapping rows.
/// `px_at_1_m` is the disparity at a distance of 1 m.
fn linked(a: &Stixel, b: &Stixel, surface: &RoadSurface, px_at_1_m: f32) -> bool {
    let tolerance = link_tolerance_px([a.disparity_px, b.disparity_px], surface, px_at_1_m);
    let shared = i32::from(a.bottom.min(b.bottom)) + 1 - i32::from(a.top.max(b.top));
    let taller = i32::from((a.bottom - a.top).max(b.bottom - b.top)) + 1;
    let adjacent = f64::from(shared) >= MIN_ROW_OVERLAP * f64::from(taller);
    adjacent && (a.disparity_px - b.disparity_px).abs() <= tolerance
}
