//! Small obstacles on the road ahead that are too low and too narrow for the disparity map (paper: height
//! above the road between 0 and S_h).
//!
//! An obstacle of 10 cm at 20 m covers four rows; the disparity at its top is 0.4 px above that of the road.
//! The map has as much noise there, and blurs it. Detection therefore works on the images: it searches for
//! patches whose [`Residual`] departs from the road by more than the noise, towards the camera, and by the
//! amount of an object some centimetres high. Such a patch is then fitted twice: as a part of the road, and
//! as an upright plane facing the camera, with the same disparity in all rows. It is reported if the plane
//! explains the right image much better, has a plausible height and stands on the road.

use super::regions::MIN_EVIDENCE;
use super::residual::{Band, Residual, RoadGeometry, Sums, Window, sample};
use crate::image::GreyView;
use crate::outline::Outline;
use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use crate::road::surface::RoadSurface;
use std::ops::Range;

/// Search area: metres on each side of the camera, and metres ahead.
const CORRIDOR_HALF_WIDTH_M: f64 = 1.8;
const MAX_DISTANCE_M: f64 = 23.0;
/// Margin beside the search area for estimating the background, in metres.
const MARGIN_M: f64 = 0.8;
/// Size of the search windows in metres, and its bounds in px.
const WINDOW_M: f64 = 0.1;
const WINDOW_PX: (f64, f64) = (3.0, 24.0);
/// Range of reported heights, in metres; taller obstacles are visible in the disparity map.
const HEIGHT_M: (f64, f64) = (0.05, 0.35);
/// Range of the mean height of a window above the road, in metres.
const MEAN_M: (f64, f64) = (0.025, 0.3);
/// Smallest prominence of a window, in standard deviations.
const MIN_PROMINENCE: f64 = 5.0;
/// Bounds of the noise of the image difference, in grey levels. Above the upper bound the road is reflecting
/// or is no road, and nothing is reported.
const NOISE_LEVELS: (f64, f64) = (2.0, 6.0);
/// Prior standard deviation of the road model's local offset, and of an obstacle's offset from the road, in
/// px.
const ROAD_PRIOR_PX: f64 = 0.05;
const OBSTACLE_PRIOR_PX: f64 = 0.3;
/// An obstacle must be this many times as prominent as the strongest patch below the road, which is caused by
/// noise, a reflection or the road model.
const MIN_RATIO_TO_BELOW: f64 = 1.25;
/// Prominence beside a patch, in standard deviations and relative to its own offset, from which it is part of
/// a longer structure such as a kerb.
const CONTINUATION: (f64, f64) = (3.0, 0.25);
/// Largest number of patches that are fitted, and of candidates from which they are selected.
const MAX_PATCHES: usize = 12;
const MAX_CANDIDATES: usize = 4096;
/// Largest number of regions of a frame.
pub(super) const CAPACITY: usize = MAX_PATCHES;
/// Largest squared difference of the plane model, as a share of that of the road model.
const MAX_RESIDUAL_RATIO: f64 = 0.8;
/// Largest gap between the patch and the road, as a share of the obstacle's height.
const MAX_FOOT_GAP_SHARE: f64 = 0.5;
/// Log-likelihood ratio (half the decrease of the squared difference over the noise variance) with neutral
/// evidence, and evidence per unit above it.
const NEUTRAL_LOG_LIKELIHOOD: f64 = 25.0;
const EVIDENCE_PER_UNIT: f64 = 0.05;
/// Systematic error of the disparity: constant in px, and as a share of the disparity.
const SYSTEMATIC_PX: f64 = 0.08;
const SYSTEMATIC_SHARE: f64 = 0.005;
/// Smallest log-likelihood gain of a column or row that belongs to the obstacle.
const MIN_LINE_GAIN: f64 = 1.0;
/// Margin around known regions without a search, in metres.
const REGION_MARGIN_M: f64 = 0.3;

/// A window that departs from the road.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    window: Window,
    /// Prominence in standard deviations; negative if it appears below the road.
    prominence: f64,
    /// Noise of the images around the window, in grey levels.
    sigma: f64,
    /// Local offset of the road model, in px.
    offset_px: f64,
}

impl Candidate {
    fn score(&self, sums: Sums) -> f64 {
        sums.with_offset(self.offset_px).prominence(self.sigma)
    }
}

/// Finds small obstacles; memory is allocated once.
#[derive(Debug)]
pub struct SmallObstacleFinder {
    residual: Residual,
    candidates: Vec<Candidate>,
    regions: Vec<Region>,
}

impl SmallObstacleFinder {
    /// A workspace for images of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            residual: Residual::new(width, height),
            candidates: Vec::with_capacity(MAX_CANDIDATES),
            regions: Vec::with_capacity(CAPACITY),
        }
    }

    /// Finds small obstacles in a rectified pair, except where `regions` probably are obstacles, in no order.
    pub fn find(
        &mut self,
        images: [GreyView<'_>; 2],
        road: &RoadGeometry<'_>,
        surface: &RoadSurface,
        regions: &[Region],
    ) -> &[Region] {
        let (profile_px, rig) = (road.profile_px, &road.rig);
        let min_px = rig.disparity_px(MAX_DISTANCE_M) as f32;
        let first = profile_px.iter().position(|&d| d >= min_px).unwrap_or(profile_px.len());
        self.residual.fill(images, road, first, CORRIDOR_HALF_WIDTH_M + MARGIN_M);
        self.search(road, first, regions);
        self.regions.clear();
        for i in 0..self.candidates.len() {
            let candidate = self.candidates[i];
            if self.regions.len() == MAX_PATCHES {
                break;
            }
            let Some(region) = self.explain(images, road, surface, first, candidate) else { continue };
            if self.regions.iter().all(|r| r.bounds.overlap(&region.bounds) == 0.0) {
                self.regions.push(region);
            }
        }
        self.regions.retain(|region| region.evidence >= MIN_EVIDENCE);
        &self.regions
    }

    /// Collects the most prominent candidates that do not overlap each other or a known region.
    fn search(&mut self, road: &RoadGeometry<'_>, first: usize, regions: &[Region]) {
        self.candidates.clear();
        let mut below = 0.0_f64;
        let mut next = first;
        while next < road.profile_px.len() {
            let y = next;
            let road_px = f64::from(road.profile_px[y]);
            let side =
                (WINDOW_M * road_px / road.rig.baseline_m).clamp(WINDOW_PX.0, WINDOW_PX.1).round() as i32;
            let step = (side / 4).max(1) as usize;
            next += step;
            let top = y as i32 + 1 - side;
            if top < first as i32 {
                continue;
            }
            let per_metre = road.slope(y).max(1e-4) * road_px / road.rig.baseline_m;
            let half = CORRIDOR_HALF_WIDTH_M * road_px / road.rig.baseline_m;
            let columns =
                (road.rig.cx_px - half).max(0.0) as usize..(road.rig.cx_px + half).max(0.0) as usize;
            let bottom = y as i32 + 1;
            // Rows of the window, of the gap around it, and of the surroundings it is compared with.
            let bands = [0, 1, 2].map(|along| self.residual.band(top - along * side, bottom + along * side));
            for x in columns.step_by(step) {
                let left = x as i32 - side / 2;
                let window = [left, top, left + side, bottom];
                let Some(candidate) = candidate(&bands, window, per_metre) else { continue };
                let mut known = regions.iter().filter(|region| region.evidence > 0.0);
                if known.any(|region| is_near(window, road_px, region, &road.rig)) {
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

    /// Moves the sides of a window to maximise its score: the extent of the obstacle.
    fn fit_window(&self, candidate: &Candidate, first: usize, (width, height): (usize, usize)) -> Window {
        let mut window = candidate.window;
        let side = window[2] - window[0];
        let min_size = (3 * side / 5).max(3);
        let mut best = candidate.score(self.residual.sums(window));
        for _ in 0..40 {
            let before = best;
            for edge in 0..4 {
                for step in [-1, 1, -2, 2] {
                    let mut next = window;
                    next[edge] += step;
                    let [left, top, right, bottom] = next;
                    let fits = (min_size..=10 * side).contains(&(right - left))
                        && (min_size..=4 * side).contains(&(bottom - top))
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

    /// Whether the structure in a window continues beside it.
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

    /// Fits a patch as road and as an upright plane; returns the region if it is an obstacle.
    fn explain(
        &self,
        images: [GreyView<'_>; 2],
        road: &RoadGeometry<'_>,
        surface: &RoadSurface,
        first: usize,
        candidate: Candidate,
    ) -> Option<Region> {
        let size = (images[0].width(), images[0].height());
        let window = self.fit_window(&candidate, first, size);
        if self.continues_sideways(&candidate, window) {
            return None;
        }
        let side = (candidate.window[2] - candidate.window[0]) as usize;
        let [from, top, to, bottom] = window.map(|v| v.max(0) as usize);
        let middle = 0.5 * (from + to) as f64;
        // One more column on each side: the sides of an object are the most distinctive.
        let (from, to) = (from.saturating_sub(1), (to + 1).min(size.0));
        let patch = Patch { images, gain: self.residual.gain(), columns: from..to, rows: top..bottom };
        let start_px = road.disparity_px(middle, bottom - 1) + candidate.offset_px;
        let (plane_px, information) = patch.fit_plane(start_px);
        // Squared differences of the road model and of the plane model.
        let squares = |x: usize, y: usize| {
            let road_px = road.disparity_px(x as f64, y) + candidate.offset_px;
            [road_px, plane_px].map(|d| patch.difference(x, y, d).powi(2))
        };
        let [as_road, as_plane] =
            patch.pixels().map(|(x, y)| squares(x, y)).fold([0.0, 0.0], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let noise = 2.0 * candidate.sigma.powi(2);
        let log_likelihood = (as_road - as_plane) / noise;
        if log_likelihood < NEUTRAL_LOG_LIKELIHOOD
            || as_plane > MAX_RESIDUAL_RATIO * as_road
            || plane_px < 1.0
        {
            return None;
        }
        let foot = f64::from(surface.row_at(middle, plane_px - candidate.offset_px)) + 1.0;
        // Extent of the obstacle: the columns, then the rows, which the plane explains better.
        let gain_at = |x: usize, y: usize| {
            let [as_road, as_plane] = squares(x, y);
            (as_road - as_plane) / noise
        };
        let beside = from.saturating_sub(side)..(to + side).min(size.0);
        let columns = best_run(beside, |x| (top..bottom).map(|y| gain_at(x, y)).sum::<f64>() - MIN_LINE_GAIN);
        let last = (foot.max(0.0).ceil() as usize).clamp(bottom, size.1);
        let above = top.saturating_sub(side).max(first)..last;
        let rows = best_run(above, |y| columns.clone().map(|x| gain_at(x, y)).sum::<f64>() - MIN_LINE_GAIN);
        let (height_px, gap_px) = (foot - rows.start as f64, foot - rows.end as f64);
        let rig = &road.rig;
        let height_m = rig.baseline_m * height_px / plane_px;
        // This form of the comparison rejects NaN.
        if !((HEIGHT_M.0..=HEIGHT_M.1).contains(&height_m) && gap_px <= MAX_FOOT_GAP_SHARE * height_px) {
            return None;
        }
        let distance_m = rig.distance_m(plane_px);
        let bounds = PixelBox {
            x: columns.start as u32,
            y: rows.start as u32,
            width: columns.len().max(1) as u32,
            height: (foot.round() as usize).min(size.1).saturating_sub(rows.start).max(1) as u32,
        };
        let middle = columns.start as f64 + 0.5 * (columns.len() as f64 - 1.0);
        let noise_px = candidate.sigma / information.max(1.0).sqrt();
        let variance = noise_px.powi(2) + SYSTEMATIC_PX.powi(2) + (SYSTEMATIC_SHARE * plane_px).powi(2);
        Some(Region {
            bounds,
            disparity_px: plane_px,
            disparity_sigma_px: variance.sqrt(),
            distance_m,
            lateral_m: rig.lateral_m(middle, distance_m),
            width_m: f64::from(bounds.width) * distance_m / rig.focal_px,
            height_m,
            inset_m: [0.0; 2],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            pixels: bounds.width * bounds.height,
            confidence: log_likelihood / (log_likelihood + NEUTRAL_LOG_LIKELIHOOD),
            evidence: evidence(log_likelihood),
        })
    }
}

/// A patch of both images whose disparity is fitted.
#[derive(Clone, Debug)]
struct Patch<'a> {
    images: [GreyView<'a>; 2],
    /// Gain of the right image.
    gain: f32,
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Patch<'_> {
    /// Columns and rows of the pixels, row by row.
    fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.rows.clone().flat_map(move |y| self.columns.clone().map(move |x| (x, y)))
    }

    /// Right image minus left image at a pixel of the left one and a disparity, in grey levels.
    fn difference(&self, x: usize, y: usize, disparity_px: f64) -> f64 {
        let [left, right] = self.images;
        let moved = self.gain * sample(right.row(y), (x as f64 - disparity_px) as f32);
        f64::from(moved - f32::from(left.row(y)[x]))
    }

    /// Disparity of an upright plane in the patch by Gauss-Newton iterations from `start_px`, in px, and the
    /// sum of the squared gradients (information).
    fn fit_plane(&self, start_px: f64) -> (f64, f64) {
        let mut plane_px = start_px;
        let mut information = 0.0;
        for _ in 0..4 {
            let (mut squares, mut product) = (0.0_f64, 0.0);
            for (x, y) in self.pixels() {
                let gradient =
                    0.5 * (self.difference(x, y, plane_px - 1.0) - self.difference(x, y, plane_px + 1.0));
                squares += gradient * gradient;
                product += gradient * self.difference(x, y, plane_px);
            }
            information = squares;
            plane_px += (product / (squares + 1e-3)).clamp(-0.5, 0.5);
        }
        (plane_px, information)
    }
}

/// Returns a candidate if a window is prominent against its surroundings and above the road by a plausible
/// height. `bands` are the rows of the window, and those extended by one and two window sizes.
fn candidate(bands: &[Band<'_>; 3], window: Window, per_metre: f64) -> Option<Candidate> {
    let [left, _, right, _] = window;
    // Fast test first: nearly all windows are road.
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
    // Test of the squares with a margin for rounding first, since most remaining windows are noise.
    let variance = (around.difference / around.count.max(1.0)).max(NOISE_LEVELS.0.powi(2));
    let offset = around.product / (around.gradient + variance / ROAD_PRIOR_PX.powi(2));
    let product = own.with_offset(offset).product;
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

/// Sub-range with the largest sum (maximum subarray).
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

/// Log-odds that a patch of one frame is an obstacle, from the log-likelihood ratio of plane and road.
fn evidence(log_likelihood: f64) -> f64 {
    EVIDENCE_PER_UNIT * (log_likelihood - NEUTRAL_LOG_LIKELIHOOD)
}

/// Whether a window on the road overlaps a region or is occluded by it in one camera.
fn is_near([left, top, right, bottom]: Window, road_px: f64, region: &Region, rig: &Rig) -> bool {
    let b = region.bounds;
    let margin_px = REGION_MARGIN_M * region.disparity_px / rig.baseline_m;
    let hidden = (region.disparity_px - road_px).max(0.0);
    f64::from(right) >= f64::from(b.x) - margin_px.max(hidden)
        && f64::from(left) <= f64::from(b.x + b.width) + margin_px
        && f64::from(top) <= f64::from(b.y + b.height) + margin_px
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

    /// An upright or painted object: lateral centre, size and distance in metres, and the offset of its
    /// disparity, in px, from that of an object standing there.
    #[derive(Clone, Copy)]
    struct Object {
        lateral_m: f64,
        width_m: f64,
        height_m: f64,
        distance_m: f64,
        painted: bool,
        off_px: f64,
    }

    const BOX: Object =
        Object { lateral_m: 0.0, width_m: 0.1, height_m: 0.1, distance_m: 12.0, painted: false, off_px: 0.0 };

    fn road_px(y: f64) -> f64 {
        RIG.baseline_m / CAMERA_HEIGHT_M * (y - RIG.cy_px)
    }

    /// Grey value of asphalt and of an object's surface, at a position in metres.
    fn grain(across: f64, along: f64) -> f64 {
        100.0 + 6.0 * (31.0 * across + 3.0 * along).sin() + 5.0 * (47.0 * across - 2.0 * along).cos()
    }

    /// Image of a camera in which points are shifted left by `share` × disparity.
    fn picture(objects: &[Object], share: f64, seed: u64) -> Vec<u8> {
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
                for object in objects {
                    let stands = RIG.disparity_px(object.distance_m);
                    let up = CAMERA_HEIGHT_M - (y as f64 - RIG.cy_px) * object.distance_m / RIG.focal_px;
                    let d = if object.painted { road } else { stands } + object.off_px;
                    let across = RIG.lateral_m(x as f64 + share * d, object.distance_m) - object.lateral_m;
                    // A sharp edge, blurred over one pixel as by a lens.
                    let px = object.distance_m / RIG.focal_px;
                    let cover = ((0.5 * object.width_m - across.abs()) / px + 0.5).clamp(0.0, 1.0);
                    if (0.0..=object.height_m).contains(&up) {
                        grey += cover * (160.0 + 15.0 * (90.0 * across).sin() - grey);
                    }
                }
                out.push((grey + 3.0 * f64::from(random.f32()) - 1.5) as u8);
            }
        }
        out
    }

    /// Regions found in the last of several frames of a scene whose disparity map shows the road only.
    fn found(objects: &[Object]) -> Vec<Region> {
        let mut detector = SceneDetector::new(SceneParameters::default(), RIG, SIZE.0, SIZE.1, 64);
        let map: Vec<u16> = (0..SIZE.0 * SIZE.1)
            .map(|i| (256.0 * road_px((i / SIZE.0) as f64).max(0.0)).round() as u16)
            .collect();
        let sure = vec![255; map.len()];
        let mut regions = Vec::new();
        for frame in 0..4 {
            let pair = [picture(objects, 0.0, 2 * frame), picture(objects, 1.0, 2 * frame + 1)];
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
            let regions = found(&[Object { distance_m, lateral_m, ..BOX }]);
            let [region] = regions[..] else { panic!("{distance_m} m: {regions:?}") };
            assert!((region.distance_m - distance_m).abs() < 0.02 * distance_m, "{region:?}");
            assert!((region.lateral_m - lateral_m).abs() < 0.05, "{region:?}");
            assert!((0.07..=0.17).contains(&region.height_m), "{region:?}");
            assert!(region.disparity_sigma_px < 0.2, "{region:?}");
        }
    }

    #[test]
    fn markings_reflections_and_noise_are_not_reported() {
        assert_eq!(found(&[]), []);
        let paint = Object { painted: true, height_m: 0.2, ..BOX };
        assert_eq!(found(&[paint, Object { lateral_m: 1.0, distance_m: 18.0, ..paint }]), []);
        // A reflection on a wet road appears below it.
        assert_eq!(found(&[Object { off_px: -1.5, ..BOX }]), []);
    }

    #[test]
    fn the_best_run_has_the_largest_sum() {
        let values = [-1.0, 2.0, -0.5, 3.0, -4.0, 5.0, -9.0];
        assert_eq!(best_run(0..7, |i| values[i]), 1..6);
        assert_eq!(best_run(0..5, |i| values[i]), 1..4);
        assert_eq!(best_run(2..3, |i| values[i]).len(), 0, "an empty range beats a negative sum");
    }

    #[test]
    fn a_kerb_is_not_a_small_obstacle() {
        let kerb = Object { width_m: 1.6, ..BOX };
        assert_eq!(found(&[kerb]).iter().filter(|r| r.width_m < 1.0).count(), 0);
    }
}
