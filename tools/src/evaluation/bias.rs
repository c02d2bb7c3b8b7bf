//! Bias and spread of disparities, by range and by kind of surface: upright ones, whose disparity is the same from row to row, and
//! slanted ones such as the road.

use crate::reporting::record::tidy;
use serde::Serialize;
use std::fmt;

/// Lower bounds of the ranges of the true disparity, in px; the last one is the end.
const RANGES_PX: [f32; 7] = [2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 256.0];
/// Larger errors are outliers, of which bad-3 tells.
const LARGEST_PX: f32 = 3.0;
/// Bins of the histogram over ± [`LARGEST_PX`].
const BINS: usize = 768;
/// Rows above and below within which another true value is looked for.
const ROWS: usize = 6;
/// Change of the true disparity from row to row, in px: below the first an upright surface, from the second on a slanted one.
const SLOPES_PX: [f32; 2] = [0.02, 0.05];

/// Kind of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Surface {
    /// Of one distance: fronts, rears, posts.
    Upright,
    /// Nearer from row to row: the road.
    Slanted,
}

/// Histograms of the errors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ErrorsByRange {
    counts: Vec<[Vec<u64>; 2]>,
}

impl Default for ErrorsByRange {
    fn default() -> Self {
        Self { counts: vec![[vec![0; BINS], vec![0; BINS]]; RANGES_PX.len() - 1] }
    }
}

/// Errors in one range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RangeErrors {
    /// Kind of the surface.
    pub surface: Surface,
    /// Least true disparity, in px.
    pub from_px: f32,
    /// Largest true disparity, in px.
    pub to_px: f32,
    /// Estimates that are at most 3 px off.
    pub pixels: u64,
    /// Median of estimate less truth, in px.
    pub bias_px: f64,
    /// Robust standard deviation (1.4826 times the median distance from the median), in px.
    pub spread_px: f64,
}

/// The kind of surface at a pixel; `None` if the truth around it does not tell.
fn surface(truth: &[f32], width: usize, at: usize) -> Option<Surface> {
    let here = truth[at];
    let known = |place: usize| truth.get(place).copied().filter(|&d| d > 0.0);
    let below = (2..=ROWS).find_map(|k| Some((known(at + k * width)?, k as f32)));
    let above = (2..=ROWS).find_map(|k| Some((known(at.checked_sub(k * width)?)?, k as f32)));
    let slopes = [below.map(|(d, k)| (d - here) / k), above.map(|(d, k)| (here - d) / k)];
    let [Some(a), Some(b)] = slopes else { return None };
    if a.abs().max(b.abs()) < SLOPES_PX[0] {
        Some(Surface::Upright)
    } else if a.min(b) >= SLOPES_PX[1] && a.max(b) < 2.0 * a.min(b) {
        // One plane above and below: an edge has one steep side.
        Some(Surface::Slanted)
    } else {
        None
    }
}

impl ErrorsByRange {
    /// Counts the pixels of `mask` that have an estimate. All slices have one value per pixel, disparities in px, truth not positive and
    /// `estimate` negative where unknown.
    pub fn add(&mut self, truth: &[f32], mask: &[bool], estimate: &[f32], width: usize) {
        for (at, ((&g, &d), _)) in truth.iter().zip(estimate).zip(mask).enumerate().filter(|(_, (_, m))| **m)
        {
            let error = d - g;
            let range = RANGES_PX.windows(2).position(|bounds| (bounds[0]..bounds[1]).contains(&g));
            let (Some(range), true) = (range, d >= 0.0 && error.abs() < LARGEST_PX) else { continue };
            if let Some(surface) = surface(truth, width, at) {
                let bin = (error + LARGEST_PX) / (2.0 * LARGEST_PX) * BINS as f32;
                self.counts[range][usize::from(surface == Surface::Slanted)][(bin as usize).min(BINS - 1)] +=
                    1;
            }
        }
    }

    /// The ranges with at least 1,000 estimates.
    pub fn ranges(&self) -> Vec<RangeErrors> {
        let mut all = Vec::new();
        for (k, surface) in [Surface::Upright, Surface::Slanted].into_iter().enumerate() {
            for (bounds, counts) in RANGES_PX.windows(2).zip(&self.counts) {
                let counts = &counts[k];
                let pixels: u64 = counts.iter().sum();
                if pixels < 1000 {
                    continue;
                }
                let of = |bin: f64| (bin / BINS as f64 * 2.0 - 1.0) * f64::from(LARGEST_PX);
                let bias_px =
                    of(middle(counts.iter().enumerate().map(|(bin, &n)| (bin as f64, n)), pixels) + 0.5);
                let mut off: Vec<(f64, u64)> =
                    (0..BINS).map(|bin| ((of(bin as f64 + 0.5) - bias_px).abs(), counts[bin])).collect();
                off.sort_by(|a, b| a.0.total_cmp(&b.0));
                let spread_px = 1.4826 * middle(off.into_iter(), pixels);
                all.push(RangeErrors {
                    surface,
                    from_px: bounds[0],
                    to_px: bounds[1],
                    pixels,
                    bias_px: tidy(bias_px),
                    spread_px: tidy(spread_px),
                });
            }
        }
        all
    }
}

/// The median of values with counts, in increasing order.
fn middle(values: impl Iterator<Item = (f64, u64)>, count: u64) -> f64 {
    let mut before = 0;
    for (value, n) in values {
        before += n;
        if 2 * before >= count {
            return value;
        }
    }
    f64::NAN
}

/// A line of the table.
impl fmt::Display for RangeErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let surface = if self.surface == Surface::Upright { "upright" } else { "slanted" };
        write!(
            f,
            "{surface} surfaces of {:>3} to {:>3} px: bias {:+.3} px, spread {:.3} px, {} estimates",
            self.from_px, self.to_px, self.bias_px, self.spread_px, self.pixels
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bias_and_spread_of_upright_and_slanted_surfaces_are_told_apart() {
        let mut random = fastrand::Rng::with_seed(3);
        let (width, height) = (200, 120);
        // A wall above the horizon, a road below; every estimate of the wall 0.25 px too small, of the road 0.1 px too large.
        let truth: Vec<f32> = (0..width * height)
            .map(|i| match i / width {
                y if y < 60 => 8.0,
                y => 8.0 + (y - 60) as f32 * 0.2,
            })
            .collect();
        let estimate: Vec<f32> = truth
            .iter()
            .enumerate()
            .map(|(i, d)| {
                let noise = (0..12).map(|_| random.f32()).sum::<f32>() - 6.0;
                let wrong = if random.f32() < 0.05 { 20.0 } else { 0.0 };
                d + 0.2 * noise + wrong + if i / width < 60 { -0.25 } else { 0.1 }
            })
            .collect();
        let mut errors = ErrorsByRange::default();
        errors.add(&truth, &vec![true; truth.len()], &estimate, width);
        let ranges = errors.ranges();
        let of = |surface: Surface| ranges.iter().find(|r| r.surface == surface).unwrap();
        let (wall, road) = (of(Surface::Upright), of(Surface::Slanted));
        assert!((wall.bias_px + 0.25).abs() < 0.02 && (wall.spread_px - 0.2).abs() < 0.02, "{wall}");
        assert!((road.bias_px - 0.1).abs() < 0.02 && (road.spread_px - 0.2).abs() < 0.02, "{road}");
        assert_eq!((wall.from_px, wall.to_px), (5.0, 10.0));
        assert!(ErrorsByRange::default().ranges().is_empty());
    }
}
