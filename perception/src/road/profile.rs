//! Road profile: disparity of the road in each row, and row of the road for each disparity.
//!
//! The path of the road through v-disparity ([`PathSearch`]) is straightened where it is nearly straight
//! ([`NearLine`]) and smoothed.

use super::far_road::NearLine;
use super::histogram::{BINS_PER_PX, Corridor, MIN_CONFIDENCE, VDisparity};
use super::line_fit::LineFit;
use super::path_search::{BLOCK, PathSearch, block_centre_row};
use super::plane;
use super::radon::RoadLine;
use crate::depth::DepthView;

/// A block is supported if its weight reaches this share of the largest possible weight.
const MIN_BLOCK_SUPPORT: f32 = 0.2;
/// The road ends after more than this many consecutive blocks without support.
const MAX_UNSUPPORTED_BLOCKS: usize = 3;
/// Range above the line's horizon in which a rising road is followed, as a share of the image height.
const MAX_RISE_SHARE: f64 = 0.15;
/// A rising road fills at least this share of the unoccluded part of the corridor, in at least this many
/// blocks.
const MIN_VISIBLE_SHARE: f32 = 0.5;
const MIN_RISING_BLOCKS: usize = 3;
/// Pixels within this distance of the path, in px of disparity, belong to it.
const ON_PATH_PX: f32 = 0.4;
/// Smallest unoccluded share of the corridor for a decision.
const MIN_UNOCCLUDED_SHARE: f64 = 0.15;

/// Model of the road profile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shape {
    /// The path found by dynamic programming: crests, dips and slopes.
    #[default]
    Profile,
    /// A single plane, for comparison.
    Plane,
}

/// Disparity of the road in each row.
#[derive(Clone, Debug)]
pub struct RoadProfile {
    disparity_px: Vec<f32>,
    /// First row, from the top, that belongs to the road.
    top: usize,
    support: f64,
    /// Row of the road for each bin; the inverse of `disparity_px`.
    row_of_bin: Vec<f32>,
    /// Slope of the Radon line, in px per row, for extrapolation.
    near_slope: f32,
}

impl RoadProfile {
    /// An empty profile for `height` rows and `bins` bins.
    fn new(height: usize, bins: usize) -> Self {
        Self {
            disparity_px: vec![0.0; height],
            top: height,
            support: 0.0,
            row_of_bin: vec![f32::NAN; bins],
            near_slope: 0.0,
        }
    }

    /// Disparity of the road in each row, in px; 0 above the road.
    pub fn disparity_px(&self) -> &[f32] {
        &self.disparity_px
    }

    /// First row, from the top, that belongs to the road.
    pub fn top(&self) -> usize {
        self.top
    }

    /// Share of road rows in which the path is supported by the histogram, 0 to 1.
    pub fn support(&self) -> f64 {
        self.support
    }

    /// Row in which the road has a disparity (in px), quantised to bins of 1/4 px. Extrapolated below the
    /// image and beyond the far end of the road. `None` without a road.
    pub fn row_at(&self, disparity_px: f32) -> Option<f32> {
        let last = self.row_of_bin.len().checked_sub(1)?;
        let bin = disparity_px * BINS_PER_PX as f32;
        let row = self.row_of_bin[(bin as usize).min(last)];
        // Larger disparities than that of the last bin are extrapolated along the line.
        let beyond = (bin - (last + 1) as f32).max(0.0) / BINS_PER_PX as f32;
        let row = row + beyond / self.near_slope.max(1e-3);
        row.is_finite().then_some(row)
    }
}

/// Estimates profiles; memory is allocated once.
#[derive(Debug)]
pub struct ProfileFinder {
    profile: RoadProfile,
    shape: Shape,
    bins: usize,
    search: PathSearch,
    /// Disparity and weight of each block, from the bottom.
    path: Vec<(f32, f32)>,
    /// Visible share of the path within the corridor, for each block.
    visibility: Vec<f32>,
}

impl ProfileFinder {
    /// A workspace for histograms of `bins` × `height` cells.
    pub fn new(bins: usize, height: usize) -> Self {
        let blocks = height / BLOCK;
        Self {
            profile: RoadProfile::new(height, bins),
            shape: Shape::default(),
            bins,
            search: PathSearch::new(bins, height),
            path: Vec::with_capacity(blocks),
            visibility: Vec::with_capacity(blocks),
        }
    }

    /// The same with another model.
    pub fn with_shape(self, shape: Shape) -> Self {
        Self { shape, ..self }
    }

    /// The last profile.
    pub fn profile(&self) -> &RoadProfile {
        &self.profile
    }

    /// Resets the profile to "no road".
    pub fn clear(&mut self) {
        self.profile.disparity_px.fill(0.0);
        self.profile.row_of_bin.fill(f32::NAN);
        self.profile.top = self.profile.disparity_px.len();
        self.profile.support = 0.0;
    }

    /// Follows the road from the bottom row, starting along `line`. A single cell counts at most `cap`.
    pub fn find(
        &mut self,
        histogram: &VDisparity,
        depth: DepthView<'_>,
        line: RoadLine,
        cap: u16,
        corridor: Corridor,
    ) -> &RoadProfile {
        let height = histogram.height();
        let horizon = line.horizon_px.clamp(0.0, height as f64);
        let blocks_above = |row: f64| ((height as f64 - row).max(0.0) / BLOCK as f64) as usize;
        let below = blocks_above(horizon + 0.5 / line.slope);
        if below < 2 {
            self.clear();
            return &self.profile;
        }
        // A rising road continues above the horizon of its near part and is then clearly visible there.
        let level = blocks_above(horizon).min(height / BLOCK);
        let rising = blocks_above((horizon - MAX_RISE_SHARE * height as f64).max(0.0)).min(height / BLOCK);
        if self.shape == Shape::Plane {
            self.fit_plane_path(histogram, line, cap, level);
        } else {
            self.search.search(histogram, line, cap, rising, true, &mut self.path);
            self.measure_visibility(depth, corridor, below);
            let hidden = |share: &f32| share.is_nan();
            let mut risen =
                self.visibility.iter().take_while(|s| hidden(s) || **s >= MIN_VISIBLE_SHARE).count();
            while risen > 0 && hidden(&self.visibility[risen - 1]) {
                risen -= 1;
            }
            if self.visibility[..risen].iter().filter(|s| !hidden(s)).count() >= MIN_RISING_BLOCKS {
                self.path.truncate(below + risen);
            } else {
                self.search.search(histogram, line, cap, level, false, &mut self.path);
            }
        }
        let supported =
            |&&(_, weight): &&(f32, f32)| weight >= MIN_BLOCK_SUPPORT * (usize::from(cap) * BLOCK) as f32;
        self.profile.support =
            self.path[..below.min(self.path.len())].iter().filter(supported).count() as f64 / below as f64;
        // The road ends after several consecutive blocks without support.
        let (mut end, mut unsupported) = (0, 0);
        for (block, place) in self.path.iter().enumerate() {
            if supported(&place) {
                (end, unsupported) = (block + 1, 0);
            } else if end > 0 {
                // Below the first supported block the image may show the bonnet, or a range that is too near
                // to be matched.
                unsupported += 1;
                if unsupported > MAX_UNSUPPORTED_BLOCKS {
                    break;
                }
            }
        }
        self.path.truncate(end);
        if end < 2 {
            self.clear();
            return &self.profile;
        }
        let near = self.straighten_far_part(histogram, line);
        let slope = self.smooth(line);
        self.invert_profile(line, near.unwrap_or(slope));
        &self.profile
    }

    /// Centre row of a block, counted from the bottom.
    fn centre_row(&self, block: usize) -> f64 {
        block_centre_row(self.profile.disparity_px.len(), block)
    }

    /// For each block from `from` on, the share of the unoccluded corridor that lies on the path; NaN if
    /// hardly anything is unoccluded.
    fn measure_visibility(&mut self, depth: DepthView<'_>, corridor: Corridor, from: usize) {
        self.visibility.clear();
        for (block, &(place, _)) in self.path.iter().enumerate().skip(from) {
            let (mut on_path, mut unoccluded, mut all) = (0_u32, 0_u32, 0_u32);
            let half = corridor.columns_per_px * place.max(0.25);
            let first = (corridor.centre_px - half).max(0.0) as usize;
            let end = ((corridor.centre_px + half).max(0.0) as usize).min(depth.width());
            for up in (0..BLOCK).step_by(2) {
                let y = depth.height() - 1 - BLOCK * block - up;
                let (row, confidence) = (depth.disparity(y), depth.confidence(y));
                for x in (first..end).step_by(2) {
                    let known = row[x] > 0 && confidence[x] >= MIN_CONFIDENCE;
                    let nearer = f32::from(row[x]) / 256.0 - place;
                    all += 1;
                    unoccluded += u32::from(!known || nearer <= ON_PATH_PX);
                    on_path += u32::from(known && nearer.abs() <= ON_PATH_PX);
                }
            }
            let enough = f64::from(unoccluded) >= MIN_UNOCCLUDED_SHARE * f64::from(all) && unoccluded > 0;
            self.visibility.push(if enough { on_path as f32 / unoccluded as f32 } else { f32::NAN });
        }
    }

    /// Plane model: replaces the path by one straight line through all blocks.
    fn fit_plane_path(&mut self, histogram: &VDisparity, line: RoadLine, cap: u16, blocks: usize) {
        let height = histogram.height();
        let plane = plane::fit_plane(histogram, line, cap);
        self.path.clear();
        for block in 0..blocks {
            let rows = height - BLOCK * (block + 1)..height - BLOCK * block;
            let counts = rows.flat_map(|y| plane::counts_near_line(histogram, plane, cap, y));
            let weight: f64 = counts.map(|(_, count)| count).sum();
            // A minimum weight keeps the line straight across empty blocks.
            self.path.push((plane.at(self.centre_row(block)).max(0.0) as f32, weight.max(1.0) as f32));
        }
    }

    /// Snaps the path to the line of its near part where the departure is small. Returns the slope of that
    /// line if the far end lies on it.
    fn straighten_far_part(&mut self, histogram: &VDisparity, line: RoadLine) -> Option<f64> {
        if self.shape == Shape::Plane {
            return None;
        }
        let centre_row = |block| self.centre_row(block);
        let blocks =
            self.path.iter().enumerate().map(|(b, &(px, w))| (centre_row(b), f64::from(px), f64::from(w)));
        let near = NearLine::fit(blocks, line.at((histogram.height() - 1) as f64), histogram)?;
        let mut on_line = false;
        for block in 0..self.path.len() {
            let row = self.centre_row(block);
            let place = &mut self.path[block].0;
            on_line = near.is_consistent(row, f64::from(*place));
            *place = near.snap(row, f64::from(*place)) as f32;
        }
        on_line.then_some(near.slope)
    }

    /// Smooths the path to sub-bin resolution: a weighted line fit over the blocks around each row. Returns
    /// the slope at the far end.
    fn smooth(&mut self, line: RoadLine) -> f64 {
        let height = self.profile.disparity_px.len();
        let top = height - BLOCK * self.path.len();
        let reach = (height as f64 / 24.0).max(1.5 * BLOCK as f64);
        self.profile.disparity_px[..top].fill(0.0);
        let mut nearest = f32::INFINITY;
        let mut slope = line.slope;
        for y in (top..height).rev() {
            let here = (height - 1 - y) / BLOCK;
            let span = (reach / BLOCK as f64).ceil() as usize + 1;
            let mut fit = LineFit::default();
            for block in here.saturating_sub(span)..(here + span + 1).min(self.path.len()) {
                let x = self.centre_row(block) - y as f64;
                let (value, weight) = self.path[block];
                let weight = f64::from(weight) * (1.0 - (x / (reach + BLOCK as f64)).abs()).max(0.0);
                fit.add(x, f64::from(value), weight);
            }
            let value = match fit.line() {
                Some((tangent, value)) => {
                    slope = tangent;
                    value
                }
                None => f64::from(self.path[here.min(self.path.len() - 1)].0),
            };
            // Disparity must not increase with distance.
            nearest = (value.max(0.0) as f32).min(nearest);
            self.profile.disparity_px[y] = nearest;
        }
        self.profile.top = top;
        slope.clamp(0.8 * line.slope, 1.2 * line.slope)
    }

    fn invert_profile(&mut self, line: RoadLine, far_slope: f64) {
        let profile = &mut self.profile;
        let (top, height) = (profile.top, profile.disparity_px.len());
        profile.near_slope = line.slope as f32;
        profile.row_of_bin.fill(f32::NAN);
        let mut y = top;
        let lowest = profile.disparity_px[height - 1];
        for bin in 0..self.bins {
            let d = (bin as f32 + 0.5) / BINS_PER_PX as f32;
            if d > lowest {
                profile.row_of_bin[bin] = (height - 1) as f32 + (d - lowest) / profile.near_slope;
                continue;
            }
            while y + 1 < height && profile.disparity_px[y + 1] < d {
                y += 1;
            }
            let (a, b) = (profile.disparity_px[y], profile.disparity_px[(y + 1).min(height - 1)]);
            if a > d {
                // Beyond the far end the road is extrapolated with its slope there.
                profile.row_of_bin[bin] = (top as f32 - (a - d) / far_slope as f32).max(0.0);
            } else {
                let share = if b > a { (d - a) / (b - a) } else { 0.0 };
                profile.row_of_bin[bin] = y as f32 + share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::DepthView;
    use crate::stereo::DisparityView;

    fn find(road: impl Fn(f64) -> f64, line: RoadLine) -> RoadProfile {
        find_as(Shape::Profile, road, line)
    }

    fn find_as(shape: Shape, road: impl Fn(f64) -> f64, line: RoadLine) -> RoadProfile {
        let (width, height) = (120, 240);
        let mut random = fastrand::Rng::with_seed(4);
        let mut map = vec![0_u16; width * height];
        for y in 0..height {
            for x in 0..width {
                // One third of the pixels is unknown, the others have ±0.2 px of noise; a car occludes a
                // part.
                let noise = f64::from(random.f32()) * 0.4 - 0.2;
                let d = if (40..90).contains(&x) && (120..170).contains(&y) {
                    14.0
                } else {
                    road(y as f64) + noise
                };
                if random.u8(..3) > 0 && d > 0.0 {
                    map[y * width + x] = (d * 256.0) as u16;
                }
            }
        }
        let mut histogram = VDisparity::new(width, height, 64);
        let confidence = vec![255; width * height];
        let depth = DepthView::new(DisparityView::new(&map, width, height).unwrap(), &confidence).unwrap();
        histogram.fill(depth, 1, Corridor::UNBOUNDED);
        let corridor = Corridor { centre_px: 60.0, columns_per_px: 10.0 };
        ProfileFinder::new(histogram.bins(), height)
            .with_shape(shape)
            .find(&histogram, depth, line, 12, corridor)
            .clone()
    }

    #[test]
    fn a_plane_is_estimated_with_sub_bin_accuracy() {
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let profile = find(|y| 0.2 * (y - 100.0), line);
        for y in 110..240 {
            let truth = 0.2 * (y as f32 - 100.0);
            assert!((profile.disparity_px()[y] - truth).abs() < 0.15, "row {y}");
            assert!((profile.row_at(truth).unwrap() - y as f32).abs() < 2.0, "row {y}");
        }
        assert!(profile.support() > 0.9);
        assert!(profile.disparity_px()[..100].iter().all(|&d| d == 0.0));
        // Disparities larger than in the lowest row are extrapolated below the image.
        assert!((profile.row_at(30.0).unwrap() - 250.0).abs() < 2.0);
    }

    #[test]
    fn a_crest_is_followed_away_from_the_line() {
        // The far road drops: its disparity is smaller than that of the near plane.
        let road = |y: f64| if y > 170.0 { 0.2 * (y - 100.0) } else { 14.0 - 0.16 * (170.0 - y) };
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let profile = find(road, line);
        for y in [125, 140, 155, 180, 220] {
            let truth = road(y as f64) as f32;
            assert!(
                (profile.disparity_px()[y] - truth).abs() < 0.4,
                "row {y}: {} for {truth}",
                profile.disparity_px()[y]
            );
        }
    }

    #[test]
    fn a_plane_stays_straight_where_the_path_follows_a_crest() {
        let road = |y: f64| if y > 170.0 { 0.2 * (y - 100.0) } else { 14.0 - 0.16 * (170.0 - y) };
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let plane = find_as(Shape::Plane, |y| 0.2 * (y - 100.3), line);
        for y in 110..240 {
            let truth = 0.2 * (y as f32 - 100.3);
            assert!((plane.disparity_px()[y] - truth).abs() < 0.05, "row {y}: {}", plane.disparity_px()[y]);
        }
        let (plane, path) = (find_as(Shape::Plane, road, line), find(road, line));
        let error =
            |profile: &RoadProfile, y: usize| (profile.disparity_px()[y] - road(y as f64) as f32).abs();
        let seen = || (plane.top()..240).filter(|&y| plane.disparity_px()[y] > 0.0);
        let steps = seen().skip(1).map(|y| plane.disparity_px()[y] - plane.disparity_px()[y - 1]);
        let (least, most) = steps.fold((f32::MAX, 0.0_f32), |(a, b), v| (a.min(v), b.max(v)));
        assert!(most - least < 1e-3, "straight: {least} to {most}");
        assert!(error(&plane, 130) > 2.0 * error(&path, 130), "{} {}", error(&plane, 130), error(&path, 130));
    }

    #[test]
    fn disparity_never_increases_with_distance() {
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let profile = find(|y| 0.2 * (y - 100.0) + (y * 0.7).sin(), line);
        assert!(profile.disparity_px().windows(2).all(|w| w[0] <= w[1]));
    }

    #[test]
    fn a_road_without_visible_near_part_is_found_farther_off() {
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let profile = find(|y| if y < 190.0 { 0.2 * (y - 100.0) } else { -1.0 }, line);
        for y in [120, 140, 160, 180] {
            let truth = 0.2 * (y as f32 - 100.0);
            assert!((profile.disparity_px()[y] - truth).abs() < 0.2, "row {y}");
        }
    }

    #[test]
    fn a_horizon_at_the_bottom_of_the_image_means_no_road() {
        let line = RoadLine { slope: 0.2, horizon_px: 236.0, support: 0.1 };
        let profile = find(|y| 0.2 * (y - 100.0), line);
        assert_eq!(profile.top(), 240);
        assert_eq!(profile.row_at(5.0), None);
    }
}
