//! Small things on the road ahead: what is too low and too narrow for the disparity map (paper: height
//! above the road between 0 and S_h).
//!
//! 10 cm at 20 m are four rows of a picture; the disparity at their top is 0.4 px above the road's. The map
//! has as much noise there, and smears it. So the images themselves are asked: where does one patch of them
//! ([`Residual`]) disagree with the road by more than its noise, nearer than it, by what a thing of some
//! centimetres comes to? Such a patch is then explained in two ways, as a piece of the road and as a piece
//! of a wall across the view, whose disparity is the same in all its rows. It is something when the wall
//! explains the right picture much gain, has the right height, and stands on the road.

use super::confirmation::Confirmation;
use super::residual::{Band, Residual, RoadGeometry, Sums, Window, sample};
use crate::image::GreyView;
use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use crate::road::surface::Surface;
use std::ops::Range;

/// The way that is searched: metres to either side of the camera, and ahead.
const CORRIDOR_HALF_WIDTH_M: f64 = 1.8;
const MAX_DISTANCE_M: f64 = 23.0;
/// What lies beside the way is looked at, to compare with.
const MARGIN_M: f64 = 0.8;
/// Side of the windows that are searched, in metres, and its bounds in px.
const WINDOW_M: f64 = 0.1;
const WINDOW_PX: (f64, f64) = (3.0, 24.0);
/// Heights that are reported, in metres; what is taller is seen by the map.
const HEIGHT_M: (f64, f64) = (0.05, 0.35);
/// Heights of a window's mean above the road that are looked into, in metres.
const MEAN_M: (f64, f64) = (0.025, 0.3);
/// Standard deviations from the road that are looked into.
const MIN_PROMINENCE: f64 = 5.0;
/// Noise of the difference of both images in grey levels: it is never less, and where it is more the
/// road mirrors, or is none.
const NOISE_LEVELS: (f64, f64) = (2.0, 6.0);
/// How far the road's model may be off at one candidate, and what a thing may be off it, in px.
const ROAD_PRIOR_PX: f64 = 0.05;
const OBSTACLE_PRIOR_PX: f64 = 0.3;
/// A thing stands out so many times as much as whatever seems to lie below the road: that is noise, a
/// mirror picture, or the road's model.
const MIN_RATIO_TO_BELOW: f64 = 1.25;
/// What stands out beside a thing by so many standard deviations, and by this share of what it does, is of
/// one piece with it: a kerb.
const CONTINUATION: (f64, f64) = (3.0, 0.25);
/// Patches that are looked into, and candidates they are regions from.
const MAX_PATCHES: usize = 12;
const MAX_CANDIDATES: usize = 4096;
/// The most regions of a frame: as many as are seen may be reported unseen.
pub(super) const CAPACITY: usize = 2 * MAX_PATCHES;
/// The wall leaves at most this share of the squared difference that the road leaves.
const MAX_RESIDUAL_RATIO: f64 = 0.8;
/// At most this share of a thing's height, from the road up, may be missing in its patch.
const MAX_FOOT_GAP_SHARE: f64 = 0.5;
/// Half the fall of the squared difference, over the noise, that speaks neither for nor against a thing;
/// and what each unit more counts as evidence.
const NEUTRAL_LOG_LIKELIHOOD: f64 = 25.0;
const EVIDENCE_PER_UNIT: f64 = 0.05;
/// What a disparity may be off beside its noise, in px and as a share.
const SYSTEMATIC_PX: f64 = 0.08;
const SYSTEMATIC_SHARE: f64 = 0.005;
/// What a column or row must be gain explained by to belong to a thing, likewise.
const MIN_LINE_GAIN: f64 = 1.0;
/// Metres around other regions in which nothing small is sought.
const REGION_MARGIN_M: f64 = 0.3;

/// A candidate that disagrees with the road.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    window: Window,
    /// Standard deviations; below zero what seems to lie below the road.
    prominence: f64,
    /// Noise of the images around it.
    sigma: f64,
    /// What the road is off there, in px.
    offset_px: f64,
}

impl Candidate {
    fn score(&self, sums: Sums) -> f64 {
        sums.with_offset(self.offset_px).prominence(self.sigma)
    }
}

/// Finds small things, with memory allocated once.
#[derive(Debug)]
pub struct SmallObstacleFinder {
    residual: Residual,
    candidates: Vec<Candidate>,
    regions: Vec<Region>,
    evidence: Vec<f64>,
    confirmation: Confirmation,
}

impl SmallObstacleFinder {
    /// A workspace for images of `width` × `height`. Things must come back to be reported if `confirm`.
    pub fn new(width: usize, height: usize, confirm: bool) -> Self {
        Self {
            residual: Residual::new(width, height),
            candidates: Vec::with_capacity(MAX_CANDIDATES),
            regions: Vec::with_capacity(CAPACITY),
            evidence: Vec::with_capacity(CAPACITY),
            confirmation: Confirmation::for_small_obstacles(confirm),
        }
    }

    /// Finds what is small on the road of a rectified pair, but for what stands where regions are already.
    pub fn find(
        &mut self,
        images: [GreyView<'_>; 2],
        ground: &RoadGeometry<'_>,
        surface: &Surface,
        regions: &[Region],
    ) -> &[Region] {
        let (profile_px, rig) = (ground.profile_px, &ground.rig);
        let min_px = rig.disparity_px(MAX_DISTANCE_M) as f32;
        let first = profile_px.iter().position(|&d| d >= min_px).unwrap_or(profile_px.len());
        self.residual.fill(images, ground, first, CORRIDOR_HALF_WIDTH_M + MARGIN_M);
        self.search(ground, first, regions);
        self.regions.clear();
        for i in 0..self.candidates.len() {
            let candidate = self.candidates[i];
            if self.regions.len() == MAX_PATCHES {
                break;
            }
            let Some(region) = self.explain(images, ground, surface, first, candidate) else { continue };
            if self.regions.iter().all(|r| r.bounds.overlap(&region.bounds) == 0.0) {
                self.regions.push(region);
            }
        }
        let size = (images[0].width(), images[0].height());
        self.regions.sort_unstable_by(|a, b| b.disparity_px.total_cmp(&a.disparity_px));
        self.evidence.clear();
        self.evidence.extend(self.regions.iter().map(evidence));
        self.confirmation.filter(&mut self.regions, &self.evidence, size, rig, |_| None);
        &self.regions
    }

    /// Fills the candidates: windows that disagree most with the road, that lie is_separate from each other and from
    /// what is known.
    fn search(&mut self, ground: &RoadGeometry<'_>, first: usize, regions: &[Region]) {
        self.candidates.clear();
        let mut below = 0.0_f64;
        let mut next = first;
        while next < ground.profile_px.len() {
            let y = next;
            let road = f64::from(ground.profile_px[y]);
            let side =
                (WINDOW_M * road / ground.rig.baseline_m).clamp(WINDOW_PX.0, WINDOW_PX.1).round() as i32;
            let step = (side / 4).max(1) as usize;
            next += step;
            let top = y as i32 + 1 - side;
            if top < first as i32 {
                continue;
            }
            let per_metre = ground.slope(y).max(1e-4) * road / ground.rig.baseline_m;
            let half = CORRIDOR_HALF_WIDTH_M * road / ground.rig.baseline_m;
            let columns =
                (ground.rig.cx_px - half).max(0.0) as usize..(ground.rig.cx_px + half).max(0.0) as usize;
            let bottom = y as i32 + 1;
            // Of the windows themselves, and of what is left out and regions around them.
            let bands = [0, 1, 2].map(|along| self.residual.band(top - along * side, bottom + along * side));
            for x in columns.step_by(step) {
                let left = x as i32 - side / 2;
                let window = [left, top, left + side, bottom];
                let Some(candidate) = candidate(&bands, window, per_metre) else { continue };
                if regions.iter().any(|region| is_near(window, road, region, &ground.rig)) {
                    continue;
                }
                below = below.max(-candidate.prominence);
                if candidate.prominence > 0.0 && self.candidates.len() < MAX_CANDIDATES {
                    self.candidates.push(candidate);
                }
            }
        }
        self.candidates.retain(|candidate| candidate.prominence >= MIN_RATIO_TO_BELOW * below);
        self.candidates.sort_unstable_by(|a, b| b.prominence.total_cmp(&a.prominence));
        let mut kept = 0;
        for i in 0..self.candidates.len() {
            let [left, _, right, bottom] = self.candidates[i].window;
            let is_separate = self.candidates[..kept].iter().all(|other| {
                let reach = 3 * (other.window[2] - other.window[0]);
                let across = (left + right - other.window[0] - other.window[2]).abs() / 2;
                across >= reach || (bottom - other.window[3]).abs() >= reach
            });
            if is_separate {
                self.candidates.swap(kept, i);
                kept += 1;
                if kept == MAX_PATCHES {
                    break;
                }
            }
        }
        self.candidates.truncate(kept);
    }

    /// Moves the edges of a window to where it stands out most: around the thing.
    fn fit_window(&self, candidate: &Candidate, first: usize, (width, height): (usize, usize)) -> Window {
        let mut window = candidate.window;
        let side = window[2] - window[0];
        let least = (3 * side / 5).max(3);
        let mut best = candidate.score(self.residual.sums(window));
        for _ in 0..40 {
            let before = best;
            for edge in 0..4 {
                for step in [-1, 1, -2, 2] {
                    let mut next = window;
                    next[edge] += step;
                    let [left, top, right, bottom] = next;
                    let fits = (least..=10 * side).contains(&(right - left))
                        && (least..=4 * side).contains(&(bottom - top))
                        && left >= 1
                        && top >= first as i32
                        && right < width as i32
                        && bottom <= height as i32;
                    if fits {
                        let score = candidate.score(self.residual.sums(next));
                        if score > best + 0.02 {
                            (best, window) = (score, next);
                        }
                    }
                }
            }
            if best == before {
                break;
            }
        }
        window
    }

    /// Whether what stands out in a window does so beside it, too.
    fn continues_sideways(&self, candidate: &Candidate, window: Window) -> bool {
        let [left, top, right, bottom] = window;
        let side = candidate.window[2] - candidate.window[0];
        let gap = (7 * side + 5) / 10;
        let sums = |window| self.residual.sums(window).with_offset(candidate.offset_px);
        let own = sums(window).offset_px(candidate.sigma, OBSTACLE_PRIOR_PX);
        [[left - gap - side, top, left - gap, bottom], [right + gap, top, right + gap + side, bottom]]
            .map(sums)
            .iter()
            .any(|beside| {
                beside.prominence(candidate.sigma) >= CONTINUATION.0
                    && beside.offset_px(candidate.sigma, OBSTACLE_PRIOR_PX) >= CONTINUATION.1 * own
            })
    }

    /// Explains a patch as road and as a wall; the region, if it is one.
    fn explain(
        &self,
        [left, right]: [GreyView<'_>; 2],
        ground: &RoadGeometry<'_>,
        surface: &Surface,
        first: usize,
        candidate: Candidate,
    ) -> Option<Region> {
        let size = (left.width(), left.height());
        let window = self.fit_window(&candidate, first, size);
        if self.continues_sideways(&candidate, window) {
            return None;
        }
        let side = (candidate.window[2] - candidate.window[0]) as usize;
        let [from, top, to, bottom] = window.map(|v| v.max(0) as usize);
        let middle = 0.5 * (from + to) as f64;
        let gain = self.residual.gain();
        // A column more on both sides: where a thing ends tells most.
        let (from, to) = (from.saturating_sub(1), (to + 1).min(size.0));
        let pixels = || (top..bottom).flat_map(move |y| (from..to).map(move |x| (x, y)));
        let difference = |x: usize, y: usize, disparity_px: f64| {
            let moved = gain * sample(right.row(y), (x as f64 - disparity_px) as f32);
            f64::from(moved - f32::from(left.row(y)[x]))
        };
        // Gauss and Newton's steps to the wall's disparity, from where it would stand.
        let mut wall_px = ground.disparity_px(middle, bottom - 1) + candidate.offset_px;
        let mut information = 0.0;
        for _ in 0..4 {
            let (mut squares, mut product) = (0.0_f64, 0.0);
            for (x, y) in pixels() {
                let gradient = 0.5 * (difference(x, y, wall_px - 1.0) - difference(x, y, wall_px + 1.0));
                squares += gradient * gradient;
                product += gradient * difference(x, y, wall_px);
            }
            information = squares;
            wall_px += (product / (squares + 1e-3)).clamp(-0.5, 0.5);
        }
        // Squared differences that the road and the wall leave.
        let squares = |x: usize, y: usize| {
            let road_px = ground.disparity_px(x as f64, y) + candidate.offset_px;
            [road_px, wall_px].map(|d| difference(x, y, d).powi(2))
        };
        let [as_road, as_wall] =
            pixels().map(|(x, y)| squares(x, y)).fold([0.0, 0.0], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let noise = 2.0 * candidate.sigma.powi(2);
        let gain = (as_road - as_wall) / noise;
        if gain < NEUTRAL_LOG_LIKELIHOOD || as_wall > MAX_RESIDUAL_RATIO * as_road || wall_px < 1.0 {
            return None;
        }
        let foot = f64::from(surface.row_at(middle, wall_px - candidate.offset_px)) + 1.0;
        // The thing goes as far as it is gain explained as a wall, to the sides, then up and down.
        let gain_at = |x: usize, y: usize| {
            let [road, wall] = squares(x, y);
            (road - wall) / noise
        };
        let beside = from.saturating_sub(side)..(to + side).min(size.0);
        let columns = best_run(beside, |x| (top..bottom).map(|y| gain_at(x, y)).sum::<f64>() - MIN_LINE_GAIN);
        let last = (foot.max(0.0).ceil() as usize).clamp(bottom, size.1);
        let above = top.saturating_sub(side).max(first)..last;
        let rows = best_run(above, |y| columns.clone().map(|x| gain_at(x, y)).sum::<f64>() - MIN_LINE_GAIN);
        let (tall, missing) = (foot - rows.start as f64, foot - rows.end as f64);
        let rig = &ground.rig;
        let height_m = rig.baseline_m * tall / wall_px;
        // Written so that NaN is left out.
        if !((HEIGHT_M.0..=HEIGHT_M.1).contains(&height_m) && missing <= MAX_FOOT_GAP_SHARE * tall) {
            return None;
        }
        let distance_m = rig.distance_m(wall_px);
        let bounds = PixelBox {
            x: columns.start as u32,
            y: rows.start as u32,
            width: columns.len().max(1) as u32,
            height: (foot.round() as usize).min(size.1).saturating_sub(rows.start).max(1) as u32,
        };
        let middle = columns.start as f64 + 0.5 * (columns.len() as f64 - 1.0);
        let noise_px = candidate.sigma / information.max(1.0).sqrt();
        let variance = noise_px.powi(2) + SYSTEMATIC_PX.powi(2) + (SYSTEMATIC_SHARE * wall_px).powi(2);
        Some(Region {
            bounds,
            disparity_px: wall_px,
            disparity_sigma_px: variance.sqrt(),
            distance_m,
            lateral_m: rig.lateral_m(middle, distance_m),
            width_m: f64::from(bounds.width) * distance_m / rig.focal_px,
            height_m,
            pixels: bounds.width * bounds.height,
            confidence: gain / (gain + NEUTRAL_LOG_LIKELIHOOD),
        })
    }
}

/// A window, when it stands out of what is around it, upwards by what a thing would. `bands` are its rows, and
/// those with one and two sides more above and below.
fn candidate(bands: &[Band<'_>; 3], window: Window, per_metre: f64) -> Option<Candidate> {
    let [left, _, right, _] = window;
    // The quickest test first: nearly everything is road.
    if !bands[0].may_be_prominent(left, right, MIN_PROMINENCE * NOISE_LEVELS.0) {
        return None;
    }
    let own = bands[0].sums(left, right);
    if own.prominence(NOISE_LEVELS.0).abs() < MIN_PROMINENCE {
        return None;
    }
    let side = right - left;
    let wide = bands[2].sums(left - 4 * side, right + 4 * side);
    let around = wide.minus(bands[1].sums(left - side, right + side));
    // Squares first, with room for what rounds: most of what is left is noise.
    let variance = (around.difference / around.count.max(1.0)).max(NOISE_LEVELS.0.powi(2));
    let off = around.product / (around.gradient + variance / ROAD_PRIOR_PX.powi(2));
    let product = own.with_offset(off).product;
    if variance > 1.001 * NOISE_LEVELS.1.powi(2)
        || product * product < 0.999 * MIN_PROMINENCE.powi(2) * variance * own.gradient
    {
        return None;
    }
    let sigma = (around.difference / around.count.max(1.0)).sqrt().max(NOISE_LEVELS.0);
    let offset_px = around.offset_px(sigma, ROAD_PRIOR_PX);
    let own = own.with_offset(offset_px);
    let mean_m = own.offset_px(sigma, OBSTACLE_PRIOR_PX) / per_metre;
    let prominence = own.prominence(sigma);
    let is_obstacle = prominence >= MIN_PROMINENCE && (MEAN_M.0..=MEAN_M.1).contains(&mean_m);
    (sigma <= NOISE_LEVELS.1 && (is_obstacle || prominence <= -MIN_PROMINENCE)).then_some(Candidate {
        window,
        prominence,
        sigma,
        offset_px,
    })
}

/// The part of a range over which a sum is greatest.
fn best_run(range: Range<usize>, value: impl Fn(usize) -> f64) -> Range<usize> {
    let (mut best, mut most) = (range.start..range.start, 0.0);
    let (mut start, mut sum) = (range.start, 0.0);
    for i in range {
        if sum <= 0.0 {
            (start, sum) = (i, 0.0);
        }
        sum += value(i);
        if sum > most {
            (best, most) = (start..i + 1, sum);
        }
    }
    best
}

/// Log-odds that one frame's patch is a thing.
fn evidence(region: &Region) -> f64 {
    let gain = NEUTRAL_LOG_LIKELIHOOD * region.confidence / (1.0 - region.confidence).max(1e-6);
    EVIDENCE_PER_UNIT * (gain - NEUTRAL_LOG_LIKELIHOOD)
}

/// Whether a window on the road is a part of a region, or hidden from one camera by it.
fn is_near([left, top, right, bottom]: Window, road_px: f64, region: &Region, rig: &Rig) -> bool {
    let b = region.bounds;
    let is_separate = REGION_MARGIN_M * region.disparity_px / rig.baseline_m;
    let hidden = (region.disparity_px - road_px).max(0.0);
    f64::from(right) >= f64::from(b.x) - is_separate.max(hidden)
        && f64::from(left) <= f64::from(b.x + b.width) + is_separate
        && f64::from(top) <= f64::from(b.y + b.height) + is_separate
        && bottom >= b.y as i32
}

#[cfg(test)]
mod tests {
    use super::best_run;
    use crate::depth::DepthView;
    use crate::image::GreyView;
    use crate::region::Region;
    use crate::rig::Rig;
    use crate::scene::{SceneDetector, SceneParameters};
    use crate::stereo::DisparityView;

    const SIZE: (usize, usize) = (640, 480);
    const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 220.0 };
    const CAMERA_HEIGHT_M: f64 = 1.25;

    /// Something upright, or painted on the road: its middle and width across, its height, its distance, and
    /// by how many px its disparity is off that of a thing that stands there.
    #[derive(Clone, Copy)]
    struct Thing {
        lateral_m: f64,
        width_m: f64,
        height_m: f64,
        distance_m: f64,
        painted: bool,
        off_px: f64,
    }

    const BOX: Thing =
        Thing { lateral_m: 0.0, width_m: 0.1, height_m: 0.1, distance_m: 12.0, painted: false, off_px: 0.0 };

    fn road_px(y: f64) -> f64 {
        RIG.baseline_m / CAMERA_HEIGHT_M * (y - RIG.cy_px)
    }

    /// The grey of asphalt and of a thing's surface, in metres.
    fn grain(across: f64, along: f64) -> f64 {
        100.0 + 6.0 * (31.0 * across + 3.0 * along).sin() + 5.0 * (47.0 * across - 2.0 * along).cos()
    }

    /// What a camera sees, whose points have moved left by their disparity times `share`.
    fn picture(things: &[Thing], share: f64, seed: u64) -> Vec<u8> {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut out = Vec::with_capacity(SIZE.0 * SIZE.1);
        for y in 0..SIZE.1 {
            let road = road_px(y as f64);
            for x in 0..SIZE.0 {
                let mut grey = 180.0;
                if road > 0.5 {
                    let across = (x as f64 + share * road - RIG.cx_px) * RIG.baseline_m / road;
                    grey = grain(across, RIG.distance_m(road));
                }
                for thing in things {
                    let stands = RIG.disparity_px(thing.distance_m);
                    let up = CAMERA_HEIGHT_M - (y as f64 - RIG.cy_px) * thing.distance_m / RIG.focal_px;
                    let d = if thing.painted { road } else { stands } + thing.off_px;
                    let across = RIG.lateral_m(x as f64 + share * d, thing.distance_m) - thing.lateral_m;
                    // A sharp edge that is blurred over a pixel, as a lens does.
                    let px = thing.distance_m / RIG.focal_px;
                    let cover = ((0.5 * thing.width_m - across.abs()) / px + 0.5).clamp(0.0, 1.0);
                    if (0.0..=thing.height_m).contains(&up) {
                        grey += cover * (160.0 + 15.0 * (90.0 * across).sin() - grey);
                    }
                }
                out.push((grey + 3.0 * f64::from(random.f32()) - 1.5) as u8);
            }
        }
        out
    }

    /// What is reported after some frames of a scene whose disparity map shows the road alone.
    fn found(things: &[Thing]) -> Vec<Region> {
        let mut detector = SceneDetector::new(SceneParameters::default(), RIG, SIZE.0, SIZE.1, 64);
        let map: Vec<u16> = (0..SIZE.0 * SIZE.1)
            .map(|i| (256.0 * road_px((i / SIZE.0) as f64).max(0.0)).round() as u16)
            .collect();
        let sure = vec![255; map.len()];
        let mut regions = Vec::new();
        for frame in 0..4 {
            let pair = [picture(things, 0.0, 2 * frame), picture(things, 1.0, 2 * frame + 1)];
            let [left, right] =
                [&pair[0], &pair[1]].map(|p| GreyView::new(p, SIZE.0, SIZE.1, SIZE.0).unwrap());
            let depth = DepthView::new(DisparityView::new(&map, SIZE.0, SIZE.1).unwrap(), &sure).unwrap();
            regions = detector.detect(depth.with_images([left, right]).unwrap()).regions.to_vec();
        }
        regions
    }

    #[test]
    fn a_box_of_ten_centimetres_is_found_and_measured() {
        for (distance_m, lateral_m) in [(6.0, 0.4), (12.0, -0.7), (20.0, 0.2)] {
            let regions = found(&[Thing { distance_m, lateral_m, ..BOX }]);
            let [region] = regions[..] else { panic!("{distance_m} m: {regions:?}") };
            assert!((region.distance_m - distance_m).abs() < 0.02 * distance_m, "{region:?}");
            assert!((region.lateral_m - lateral_m).abs() < 0.05, "{region:?}");
            assert!((0.07..=0.17).contains(&region.height_m), "{region:?}");
            assert!(region.disparity_sigma_px < 0.2, "{region:?}");
        }
    }

    #[test]
    fn paint_mirror_pictures_and_noise_are_not() {
        assert_eq!(found(&[]), []);
        let paint = Thing { painted: true, height_m: 0.2, ..BOX };
        assert_eq!(found(&[paint, Thing { lateral_m: 1.0, distance_m: 18.0, ..paint }]), []);
        // What a wet road shows lies below it.
        assert_eq!(found(&[Thing { off_px: -1.5, ..BOX }]), []);
    }

    #[test]
    fn the_best_run_is_the_one_with_the_greatest_sum() {
        let values = [-1.0, 2.0, -0.5, 3.0, -4.0, 5.0, -9.0];
        assert_eq!(best_run(0..7, |i| values[i]), 1..6);
        assert_eq!(best_run(0..5, |i| values[i]), 1..4);
        assert_eq!(best_run(2..3, |i| values[i]).len(), 0, "nothing is gain than what costs");
    }

    #[test]
    fn a_kerb_is_no_small_thing() {
        let kerb = Thing { width_m: 1.6, ..BOX };
        assert_eq!(found(&[kerb]).iter().filter(|r| r.width_m < 1.0).count(), 0);
    }
}
