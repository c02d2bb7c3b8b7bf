//! The road profile: a Viterbi path through v-disparity, near the Radon line (paper, e(i, j)).
//!
//! From the bottom row up, every row takes the bin j that maximises
//! `e(y, j) = H(y, j) + max { e(y+1, j′) : 0 ≤ j′ − j ≤ η }`: the road's disparity never grows with
//! distance, and η bounds how fast it may fall. So crests, dips and slopes are followed where the
//! road is not a plane.

use super::histogram::{BINS_PER_PX, VDisparity};
use super::radon::RoadLine;

/// The road's disparity in every row.
#[derive(Clone, Debug)]
pub struct RoadProfile {
    disparity_px: Vec<f32>,
    /// First row (from above) that belongs to the road.
    top: usize,
    support: f64,
    /// Row of the road for each bin, the inverse of `disparity_px`.
    row_of_bin: Vec<f32>,
    /// Slope of the straight start, for what lies beyond either end.
    near_slope: f32,
}

impl RoadProfile {
    /// A profile without a road, for `height` rows and `bins` bins.
    fn new(height: usize, bins: usize) -> Self {
        Self {
            disparity_px: vec![0.0; height],
            top: height,
            support: 0.0,
            row_of_bin: vec![f32::NAN; bins],
            near_slope: 0.0,
        }
    }

    /// Disparity of the road in each row, in pixels; 0 above the road.
    pub fn disparity_px(&self) -> &[f32] {
        &self.disparity_px
    }

    /// First row, from above, that belongs to the road.
    pub fn top(&self) -> usize {
        self.top
    }

    /// Share of road rows in which the path runs through counted pixels, 0 to 1.
    pub fn support(&self) -> f64 {
        self.support
    }

    /// The row where the road has a disparity (in px), to a bin of 1/4 px; below the image and
    /// beyond the far end it is extrapolated. `None` when there is no road.
    pub fn row_at(&self, disparity_px: f32) -> Option<f32> {
        let last = self.row_of_bin.len().checked_sub(1)?;
        let bin = disparity_px * BINS_PER_PX as f32;
        let row = self.row_of_bin[(bin as usize).min(last)];
        // Nearer than the last bin: on along the line.
        let beyond = (bin - (last + 1) as f32).max(0.0) / BINS_PER_PX as f32;
        let row = row + beyond / self.near_slope.max(1e-3);
        row.is_finite().then_some(row)
    }
}

/// Finds profiles, with memory allocated once.
#[derive(Debug)]
pub struct ProfileFinder {
    profile: RoadProfile,
    bins: usize,
    /// Best sum up to each cell, and how many bins the path moved to get there.
    energy: [Vec<f32>; 2],
    moved: Vec<u8>,
    path: Vec<f32>,
    weight: Vec<f32>,
}

impl ProfileFinder {
    /// A workspace for histograms of `bins` × `height` cells.
    pub fn new(bins: usize, height: usize) -> Self {
        Self {
            profile: RoadProfile::new(height, bins),
            bins,
            energy: [vec![0.0; bins], vec![0.0; bins]],
            moved: vec![0; bins * height],
            path: vec![0.0; height],
            weight: vec![0.0; height],
        }
    }

    /// The profile that was found last.
    pub fn profile(&self) -> &RoadProfile {
        &self.profile
    }

    /// Marks the profile as "no road".
    pub fn clear(&mut self) {
        self.profile.disparity_px.fill(0.0);
        self.profile.row_of_bin.fill(f32::NAN);
        self.profile.top = self.profile.disparity_px.len();
        self.profile.support = 0.0;
    }

    /// Follows the road from the bottom row to the horizon of `line`. One cell counts at most
    /// `cap`.
    pub fn find(&mut self, histogram: &VDisparity, line: RoadLine, cap: u16) -> &RoadProfile {
        let height = histogram.height();
        let top = (line.horizon_px + 0.5 / line.slope).ceil().clamp(0.0, height as f64) as usize;
        if top + 8 > height {
            self.clear();
            return &self.profile;
        }
        self.follow(histogram, line, cap, top);
        self.smooth(line, top);
        self.invert(line, top);
        &self.profile
    }

    /// The bins in which the road of row `y` may lie.
    fn band(&self, line: RoadLine, y: usize) -> (usize, usize) {
        let per_px = BINS_PER_PX as f64;
        let centre = line.at(y as f64);
        let half = 1.5 + 0.08 * centre.max(0.0);
        let low = ((centre - half) * per_px).max(0.0) as usize;
        let high = ((centre + half) * per_px).max(0.0) as usize;
        (low.min(self.bins - 1), high.min(self.bins - 1))
    }

    fn follow(&mut self, histogram: &VDisparity, line: RoadLine, cap: u16, top: usize) {
        let height = histogram.height();
        let per_px = BINS_PER_PX as f64;
        let reach = ((2.0 * line.slope * per_px).ceil() as usize + 1).min(usize::from(u8::MAX));
        // Where nothing was counted the path keeps to the line.
        let pull = f32::from(cap) * 0.004;
        let score = |row: &[u16], bin: usize, centre: f64| {
            let near = |b: usize| row.get(b).map_or(0.0, |&c| f32::from(c.min(cap)));
            let sum = 0.5 * near(bin.wrapping_sub(1)) + near(bin) + 0.5 * near(bin + 1);
            sum - pull * (bin as f64 + 0.5 - centre * per_px).abs() as f32
        };
        let mut current = 0;
        for y in (top..height).rev() {
            let (low, high) = self.band(line, y);
            let (a, b) = self.energy.split_at_mut(1);
            let (old, new) = if current == 0 { (&a[0], &mut b[0]) } else { (&b[0], &mut a[0]) };
            new.fill(f32::NEG_INFINITY);
            let row = histogram.row(y);
            for bin in low..=high {
                let (mut best, mut moved) = (0.0, 0);
                if y + 1 < height {
                    best = f32::NEG_INFINITY;
                    for step in 0..=reach.min(self.bins - 1 - bin) {
                        if old[bin + step] > best {
                            (best, moved) = (old[bin + step], step);
                        }
                    }
                }
                new[bin] = best + score(row, bin, line.at(y as f64));
                self.moved[y * self.bins + bin] = moved as u8;
            }
            current = 1 - current;
        }
        // Back from the best end in the top row.
        let ends = &self.energy[current];
        let mut bin = (0..self.bins).fold(0, |best, b| if ends[b] > ends[best] { b } else { best });
        let mut supported = 0;
        for y in top..height {
            let row = histogram.row(y);
            let (mut sum, mut moment) = (0.0, 0.0);
            for b in bin.saturating_sub(2)..(bin + 3).min(self.bins) {
                let count = f32::from(row[b].min(cap));
                sum += count;
                moment += count * (b as f32 + 0.5);
            }
            supported += usize::from(sum >= f32::from(cap) * 0.5);
            self.weight[y] = sum;
            let place = if sum > 0.0 { moment / sum } else { bin as f32 + 0.5 };
            self.path[y] = place / BINS_PER_PX as f32;
            bin = (bin + usize::from(self.moved[y * self.bins + bin])).min(self.bins - 1);
        }
        self.profile.support = supported as f64 / (height - top) as f64;
    }

    /// A straight line fitted to the rows around each row, weighted by their counts, so that the
    /// profile is finer than a bin; rows without counts follow their neighbours.
    fn smooth(&mut self, line: RoadLine, top: usize) {
        let height = self.path.len();
        let reach = (height / 24).max(6);
        self.profile.disparity_px[..top].fill(0.0);
        let mut nearest = f32::INFINITY;
        for y in (top..height).rev() {
            let (mut s, mut sx, mut sy, mut sxx, mut sxy) = (0.0_f64, 0.0, 0.0, 0.0, 0.0);
            for row in y.saturating_sub(reach).max(top)..(y + reach + 1).min(height) {
                // A small weight on the line keeps empty stretches defined.
                for (weight, value) in
                    [(f64::from(self.weight[row]), f64::from(self.path[row])), (0.05, line.at(row as f64))]
                {
                    let x = row as f64 - y as f64;
                    s += weight;
                    sx += weight * x;
                    sy += weight * value;
                    sxx += weight * x * x;
                    sxy += weight * x * value;
                }
            }
            let determinant = s * sxx - sx * sx;
            let value =
                if determinant > 1e-9 { (sy * sxx - sx * sxy) / determinant } else { line.at(y as f64) };
            // Never growing with distance.
            nearest = (value.max(0.0) as f32).min(nearest);
            self.profile.disparity_px[y] = nearest;
        }
        self.profile.top = top;
    }

    fn invert(&mut self, line: RoadLine, top: usize) {
        let height = self.path.len();
        let profile = &mut self.profile;
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
                // Beyond the far end of the road.
                profile.row_of_bin[bin] = (top as f32 - (a - d) / profile.near_slope).max(0.0);
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
    use crate::stereo::DisparityView;

    fn find(road: impl Fn(f64) -> f64, line: RoadLine) -> RoadProfile {
        let (width, height) = (120, 240);
        let mut random = fastrand::Rng::with_seed(4);
        let mut map = vec![0_u16; width * height];
        for y in 0..height {
            for x in 0..width {
                // A third is unknown, the rest has ±0.2 px of noise; a car hides part of it.
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
        let mut histogram = VDisparity::new(height, 64);
        histogram.fill(DisparityView::new(&map, width, height).unwrap());
        ProfileFinder::new(histogram.bins(), height).find(&histogram, line, 12).clone()
    }

    #[test]
    fn a_plane_is_found_to_a_fraction_of_a_bin() {
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let profile = find(|y| 0.2 * (y - 100.0), line);
        for y in 110..240 {
            let truth = 0.2 * (y as f32 - 100.0);
            assert!((profile.disparity_px()[y] - truth).abs() < 0.15, "row {y}");
            assert!((profile.row_at(truth).unwrap() - y as f32).abs() < 2.0, "row {y}");
        }
        assert!(profile.support() > 0.9);
        assert!(profile.disparity_px()[..100].iter().all(|&d| d == 0.0));
        // Nearer than the lowest row: extrapolated below the image.
        assert!((profile.row_at(30.0).unwrap() - 250.0).abs() < 2.0);
    }

    #[test]
    fn a_crest_is_followed_away_from_the_line() {
        // The far road falls away: its disparity is lower than the near plane's.
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
    fn the_path_never_grows_with_distance() {
        let line = RoadLine { slope: 0.2, horizon_px: 100.0, support: 1.0 };
        let profile = find(|y| 0.2 * (y - 100.0) + (y * 0.7).sin(), line);
        assert!(profile.disparity_px().windows(2).all(|w| w[0] <= w[1]));
    }

    #[test]
    fn a_horizon_at_the_bottom_is_no_road() {
        let line = RoadLine { slope: 0.2, horizon_px: 236.0, support: 0.1 };
        let profile = find(|y| 0.2 * (y - 100.0), line);
        assert_eq!(profile.top(), 240);
        assert_eq!(profile.row_at(5.0), None);
    }
}
