//! Photometric verification of a region in the two images.
//!
//! A disparity map is unreliable for narrow or textureless objects: the windows of the matcher spread a near
//! surface over its surroundings and create ramps between two surfaces. Each row of a region is therefore
//! explained twice from the images: by the surface to its left, the road and the surface to its right, in
//! this order with boundaries at the best columns; and with the disparity of the region inserted between
//! them. The difference of both costs is the **cost reduction**. The sides of a real object fit no other
//! disparity. Where the road or a neighbouring surface fits equally well, the reduction is 0.
//!
//! Costs are differences of horizontal gradients, which makes them independent of brightness, truncated to
//! limit the influence of lamps and reflections.

use super::residual::RoadGeometry;
use super::stixels::{STRIP_COLUMNS, Stixels};
use crate::image::GreyView;
use crate::region::{PixelBox, Region};
use crate::simd::{Level, Simd, kernel};

/// Largest number of rows of a region that are examined.
const MAX_ROWS: usize = 24;
/// Columns examined on either side of a region.
pub(super) const MARGIN_COLUMNS: usize = 6;
/// Wider regions (with margins) are not verified: they are reliable in the disparity map, but for their sides (`contour`).
const MAX_COLUMNS: usize = 96;
/// Fewest columns for a decision.
const MIN_COLUMNS: usize = 4;
/// Columns at the image border without a gradient.
pub(super) const BORDER: usize = 3;
/// Truncation of the gradient difference, in grey levels.
const MAX_COST: f32 = 20.0;
/// A surface closer to the disparity of the region than this, in px, is no alternative explanation.
const MIN_SURFACE_GAP_PX: f32 = 0.35;
/// A stixel within this distance of the region's disparity, in px, belongs to the region.
const REGION_STIXEL_PX: f32 = 0.5;
/// Cost reduction of a row from which its sides are used, in grey levels.
pub(super) const MIN_SIDE_REDUCTION: f32 = 15.0;
/// Weights of the evidence: constant; logarithms of the mean cost reduction of the upper and the lower half
/// (grey levels per row, plus [`CHANCE_REDUCTION`]); logarithm of the width (relative to 12 px). Fitted by
/// logistic regression, together with the evidence of the disparity map, to regions of `street` and another
/// street in six weathers; the constant is less strict, as sightings accumulate.
const EVIDENCE: [f64; 4] = [-27.4, 4.2, 3.7, -2.1];
/// Cost reduction that occurs by chance, in grey levels per row.
const CHANCE_REDUCTION: f64 = 5.0;
/// Upper limit of the evidence.
const MAX_EVIDENCE: f64 = 6.0;
/// Cost of a missing surface; larger than that of any surface.
pub(super) const NO_SURFACE_COST: f32 = 1e6;

/// Left surface, road, right surface, and the surface of the region.
const SURFACES: usize = 4;
/// Possible order of surfaces in a row, without and with the region.
const ORDER_WITHOUT_REGION: [usize; 3] = [0, 1, 2];
const ORDER_WITH_REGION: [usize; 5] = [0, 1, REGION_SURFACE, 1, 2];
/// Index of the region's surface.
const REGION_SURFACE: usize = 3;

type Costs = [[f32; MAX_COLUMNS]; SURFACES];

/// The images, the road and the stixels of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Verifier<'a> {
    /// Rectified pair, left and right.
    pub images: [GreyView<'a>; 2],
    /// The road.
    pub road: RoadGeometry<'a>,
    /// Stixels of the disparity map.
    pub stixels: &'a Stixels,
}

/// Result of the verification of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verification {
    /// Mean cost reduction of the upper and of the lower half of the rows, in grey levels.
    pub cost_reduction: [f64; 2],
    /// First column of the region and the column after its last one, where the sides are well localised.
    pub sides: Option<(u32, u32)>,
    /// Width of the verified box, in px.
    pub width_px: u32,
}

impl Verification {
    /// Log-odds to be added to the evidence of the disparity map; at most 6.
    pub fn evidence(&self) -> f64 {
        let [upper, lower] =
            self.cost_reduction.map(|cost_reduction| (cost_reduction + CHANCE_REDUCTION).ln());
        let width = (f64::from(self.width_px.max(1)) / 12.0).ln();
        let sum = EVIDENCE[0] + EVIDENCE[1] * upper + EVIDENCE[2] * lower + EVIDENCE[3] * width;
        sum.min(MAX_EVIDENCE)
    }
}

/// Candidate disparities of a row, in px, and the range of columns to explain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surfaces {
    pub(super) disparity_px: [Option<f32>; SURFACES],
    /// Whether the region continues to the left and to the right.
    pub(super) is_continuous: [bool; 2],
    from: usize,
    to: usize,
}

impl Verifier<'_> {
    /// Verifies a region. `None` if it is undecidable: too wide, too narrow, too near the image border, or at
    /// the same distance as its surroundings.
    pub fn verify(&self, region: &Region) -> Option<Verification> {
        if self.is_too_wide(region) {
            return None;
        }
        let [left, right] = self.images;
        let b = &region.bounds;
        let step = (b.height as usize).div_ceil(MAX_ROWS).max(1);
        let rows = (b.y as usize..((b.y + b.height) as usize).min(left.height())).step_by(step);
        let mut costs: Costs = [[NO_SURFACE_COST; MAX_COLUMNS]; SURFACES];
        let mut reductions = [0.0_f32; MAX_ROWS];
        let (mut lefts, mut rights) = ([0_u32; MAX_ROWS], [0_u32; MAX_ROWS]);
        let (mut count, mut side_rows) = (0, 0);
        for y in rows.take(MAX_ROWS) {
            let Some(surfaces) = self.surfaces(region, y) else { continue };
            let width = surfaces.to - surfaces.from;
            for (disparity_px, costs) in surfaces.disparity_px.iter().zip(&mut costs) {
                match disparity_px {
                    Some(d) => gradient_costs(
                        self.stixels.level(),
                        left.row(y),
                        right.row(y),
                        *d,
                        surfaces.from,
                        &mut costs[..width],
                    ),
                    None => costs[..width].fill(NO_SURFACE_COST),
                }
            }
            let (without, _) = segment_row(&costs, width, &ORDER_WITHOUT_REGION);
            let (with, region_columns) = segment_row(&costs, width, &ORDER_WITH_REGION);
            reductions[count] = without - with;
            if let (true, Some((first, end))) = (reductions[count] > MIN_SIDE_REDUCTION, region_columns) {
                (lefts[side_rows], rights[side_rows]) =
                    ((surfaces.from + first) as u32, (surfaces.from + end) as u32);
                side_rows += 1;
            }
            count += 1;
        }
        if count < 2 {
            return None;
        }
        let (upper, lower) = reductions[..count].split_at(count.div_ceil(2));
        let mean = |reductions: &[f32]| f64::from(reductions.iter().sum::<f32>()) / reductions.len() as f64;
        // The outer fifth of the rows is ignored, since mirrors or wheels may protrude.
        let sides = (side_rows >= 3 && 2 * side_rows >= count).then(|| {
            lefts[..side_rows].sort_unstable();
            rights[..side_rows].sort_unstable();
            (lefts[side_rows / 5], rights[4 * side_rows / 5])
        });
        let sides = sides.filter(|(first, end)| *end >= first + 3);
        Some(Verification { cost_reduction: [mean(upper), mean(lower)], sides, width_px: b.width })
    }

    /// Columns of a region and its margins in which there are gradients: the first, and that after the last one.
    fn columns(&self, bounds: &PixelBox) -> (usize, usize) {
        let (first, end) = (bounds.x as usize, (bounds.x + bounds.width) as usize);
        let last = self.images[0].width().saturating_sub(BORDER);
        (first.saturating_sub(MARGIN_COLUMNS).max(BORDER), (end + MARGIN_COLUMNS).min(last))
    }

    /// Whether a region is too wide to be verified.
    pub(super) fn is_too_wide(&self, region: &Region) -> bool {
        let (from, to) = self.columns(&region.bounds);
        to > from + MAX_COLUMNS
    }

    /// Candidate surfaces of row `y`; `None` if there is no alternative to the region.
    pub(super) fn surfaces(&self, region: &Region, y: usize) -> Option<Surfaces> {
        let b = &region.bounds;
        let (first, end) = (b.x as usize, (b.x + b.width) as usize);
        let (from, to) = self.columns(b);
        let known = |strip: Option<usize>| {
            let depth = self.stixels.depths(strip.filter(|s| *s < self.stixels.strips())?)[y];
            (depth > 0).then(|| f32::from(depth) / 256.0)
        };
        let strips = first / STRIP_COLUMNS..end / STRIP_COLUMNS;
        let disparity_px = region.disparity_px as f32;
        let (mut sum, mut count) = (0.0, 0.0);
        for d in strips.clone().filter_map(|strip| known(Some(strip))) {
            if (d - disparity_px).abs() < REGION_STIXEL_PX {
                (sum, count) = (sum + d, count + 1.0);
            }
        }
        let region_px = if count > 0.0 { sum / count } else { disparity_px };
        // The adjacent strip may still belong to the region or to a discontinuity.
        let before = |n: usize| known(strips.start.checked_sub(n));
        let after = |n: usize| known(Some(strips.end + n));
        let left = before(2).or_else(|| before(3)).or_else(|| before(1));
        let right = after(1).or_else(|| after(2)).or_else(|| after(0));
        let road_px = self.road.disparity_px(0.5 * (from + to) as f64, y).max(0.0) as f32;
        let other = |d: Option<f32>| d.filter(|d| (d - region_px).abs() > MIN_SURFACE_GAP_PX);
        // Where the surface of the region continues sideways, only the box itself is examined.
        let is_continuous = [left, right].map(|d| d.is_some() && other(d).is_none());
        let from = if is_continuous[0] { from.max(first) } else { from };
        let to = if is_continuous[1] { to.min(end) } else { to };
        let disparity_px = [other(left), other(Some(road_px)), other(right), Some(region_px)];
        let is_decidable = to >= from + MIN_COLUMNS && disparity_px[..3].iter().any(Option::is_some);
        is_decidable.then_some(Surfaces { disparity_px, is_continuous, from, to })
    }
}

/// Gradient differences of both images in a row from column `from` on, at a disparity of 0 px or more.
pub(super) fn gradient_costs(
    level: Level,
    left: &[u8],
    right: &[u8],
    disparity_px: f32,
    from: usize,
    costs: &mut [f32],
) {
    let whole = disparity_px.ceil();
    let share = whole - disparity_px;
    // Columns outside the right image.
    let hidden = (whole as usize).saturating_add(BORDER).saturating_sub(from).min(costs.len());
    costs[..hidden].fill(MAX_COST);
    let costs = &mut costs[hidden..];
    if costs.is_empty() {
        return;
    }
    let from = from + hidden;
    let at = from - whole as usize;
    let (left, right) = (&left[from - 1..], &right[at - 1..]);
    gradient_differences(level, left, right, share, costs);
}

kernel! {
    /// Gradient differences: `left` and `right` start one column before the first result; gradients of
    /// `right` are interpolated by `share` of a column.
    fn gradient_differences(left: &[u8], right: &[u8], share: f32, costs: &mut [f32]) = gradient_differences_each
}

#[inline(always)]
fn gradient_differences_each<S: Simd>(_: S, left: &[u8], right: &[u8], share: f32, costs: &mut [f32]) {
    for ((cost, left), right) in costs.iter_mut().zip(left.windows(3)).zip(right.windows(4)) {
        let [a, _, c] = [left[0], left[1], left[2]].map(f32::from);
        let [e, f, g, h] = [right[0], right[1], right[2], right[3]].map(f32::from);
        let gradient = (g - e) + share * ((h - f) - (g - e));
        *cost = (c - a - gradient).abs().min(MAX_COST);
    }
}

/// Minimum cost of explaining a row by surfaces in a given order, each over any number of columns; and the
/// columns of [`REGION_SURFACE`], if it occurs.
fn segment_row<const N: usize>(
    costs: &Costs,
    width: usize,
    order: &[usize; N],
) -> (f32, Option<(usize, usize)>) {
    let mut sums = [0.0_f32; N];
    // First column of the region's surface and the column after its last, for each state; 0 if it has not
    // occurred.
    let mut extent = [[0_u16; 2]; N];
    for x in 0..width {
        let (mut best, mut known) = (f32::INFINITY, [0; 2]);
        for state in 0..N {
            // The previous surface may end here; at equal costs the earlier surface continues.
            let ends = sums[state] < best;
            best = if ends { sums[state] } else { best };
            known = if ends { extent[state] } else { known };
            sums[state] = best + costs[order[state]][x];
            extent[state] = known;
            if order[state] == REGION_SURFACE {
                let first = if known[1] > 0 { known[0] } else { x as u16 };
                extent[state] = [first, x as u16 + 1];
            }
        }
    }
    let best = (0..N).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(0);
    let [first, end] = extent[best].map(usize::from);
    (sums[best], (end > 0).then_some((first, end)))
}

#[cfg(test)]
mod tests {
    use super::super::fixture::with_region;
    use super::*;

    const SIZE: (usize, usize) = (128, 64);
    /// Disparity of the background.
    const BACKGROUND: usize = 4;

    /// A pair with fine texture at [`BACKGROUND`] and a post in columns `post` in front of it, at
    /// `disparity`.
    fn pair(post: std::ops::Range<usize>, disparity: usize) -> [Vec<u8>; 2] {
        let mut random = fastrand::Rng::with_seed(5);
        let (width, height) = SIZE;
        let mut left = vec![0_u8; width * height];
        let mut right = left.clone();
        for y in 0..height {
            // Texture elements of two pixels, so that gradients over two pixels respond to it.
            let mut background = vec![0_u8; width + 8];
            for two in background.chunks_mut(2) {
                two.fill(random.u8(60..190));
            }
            for x in 0..width {
                left[y * width + x] = background[x];
                right[y * width + x] = background[(x + BACKGROUND).min(width + 7)];
            }
            for x in post.clone() {
                let grey = if x / 2 % 2 == 0 { 20 } else { 240 };
                left[y * width + x] = grey;
                right[y * width + x - disparity] = grey;
            }
        }
        [left, right]
    }

    /// Verifies a box at disparity 8; the map has that disparity inside the box and [`BACKGROUND`] elsewhere.
    fn verify(pair: &[Vec<u8>; 2], bounds: PixelBox) -> Option<Verification> {
        with_region(pair, SIZE, [BACKGROUND, 8], bounds, |verifier, region| verifier.verify(region))
    }

    const BOX: PixelBox = PixelBox { x: 48, y: 8, width: 16, height: 40 };

    #[test]
    fn a_real_object_is_verified_and_its_sides_are_found() {
        let seen = verify(&pair(50..61, 8), BOX).expect("decidable");
        assert!(seen.evidence() > 3.0, "{seen:?}");
        let (first, end) = seen.sides.expect("well localised sides");
        // The four columns left of the post are occluded in the right image and may belong to either surface.
        assert!((45..=51).contains(&first) && end.abs_diff(61) <= 1, "{seen:?}");
    }

    #[test]
    fn a_phantom_of_the_map_is_refuted() {
        let seen = verify(&pair(0..0, 8), BOX).expect("decidable");
        assert!(seen.evidence() < -3.0 && seen.sides.is_none(), "{seen:?}");
        // An object at the distance of the background.
        let seen = verify(&pair(50..61, BACKGROUND), BOX).expect("decidable");
        assert!(seen.evidence() < -3.0, "{seen:?}");
    }

    #[test]
    fn an_object_in_half_of_the_rows_is_not_enough() {
        let (width, _) = SIZE;
        let (mut half, none) = (pair(50..61, 8), pair(0..0, 8));
        for (half, none) in half.iter_mut().zip(&none) {
            half[28 * width..].copy_from_slice(&none[28 * width..]);
        }
        let whole = verify(&pair(50..61, 8), BOX).unwrap().evidence();
        let half = verify(&half, BOX).unwrap();
        assert!(
            half.cost_reduction[0] > 10.0 * half.cost_reduction[1] && half.evidence() < whole - 5.0,
            "{half:?}"
        );
    }

    #[test]
    fn brightness_does_not_matter() {
        let pair = pair(50..61, 8);
        let brighter = [pair[0].clone(), pair[1].iter().map(|grey| grey + 12).collect()];
        assert_eq!(verify(&brighter, BOX), verify(&pair, BOX));
    }

    #[test]
    fn undecidable_regions_are_not_verified() {
        let pair = pair(50..61, 8);
        assert_eq!(verify(&pair, PixelBox { x: 10, width: 100, ..BOX }), None, "too wide");
        assert_eq!(verify(&pair, PixelBox { height: 1, ..BOX }), None, "one row");
        // At the border and where the right image has no data: no panic.
        for x in [0, 4, 120, 124] {
            verify(&pair, PixelBox { x, width: 4, ..BOX });
        }
        verify(&pair, PixelBox { y: 60, height: 40, ..BOX });
    }

    #[test]
    fn columns_outside_the_right_image_have_the_maximum_cost() {
        let (left, right) = ([0, 50, 0, 50, 0, 50, 0, 50, 0, 50, 0, 50], [7; 12]);
        for disparity_px in [0.0, 0.5, 1.0, 3.3, 5.9, 6.0, 7.0, 200.0, f32::MAX, f32::INFINITY, f32::NAN] {
            let mut costs = [-1.0; 6];
            gradient_costs(Level::best(), &left, &right, disparity_px, 3, &mut costs);
            let hidden = if disparity_px.is_nan() { 0 } else { (disparity_px.ceil() as usize).min(6) };
            assert!(costs[..hidden].iter().all(|cost| *cost == MAX_COST), "{disparity_px}: {costs:?}");
            assert!(costs.iter().all(|cost| *cost != -1.0), "{disparity_px}: {costs:?}");
        }
    }

    #[test]
    fn the_segmentation_equals_exhaustive_search() {
        let mut random = fastrand::Rng::with_seed(9);
        for _ in 0..50 {
            let mut costs: Costs = [[NO_SURFACE_COST; MAX_COLUMNS]; SURFACES];
            for costs in &mut costs {
                costs[..7].fill_with(|| random.f32() * 20.0);
            }
            // Every division of seven columns into five segments.
            let mut best = f32::INFINITY;
            let cuts = |from: usize| from..=7;
            for a in cuts(0) {
                for b in cuts(a) {
                    for c in cuts(b) {
                        for d in cuts(c) {
                            let stretches = [0..a, a..b, b..c, c..d, d..7];
                            let sum = |(i, x): (usize, std::ops::Range<usize>)| {
                                costs[ORDER_WITH_REGION[i]][x].iter().sum::<f32>()
                            };
                            best = best.min(stretches.into_iter().enumerate().map(sum).sum());
                        }
                    }
                }
            }
            let (least, own) = segment_row(&costs, 7, &ORDER_WITH_REGION);
            assert!((least - best).abs() < 1e-3, "{least} {best}");
            let (without, none) = segment_row(&costs, 7, &ORDER_WITHOUT_REGION);
            assert!(without >= least - 1e-3 && none.is_none(), "{own:?}");
        }
    }

    #[test]
    fn all_levels_compute_the_gradient_differences_of_the_reference() {
        let mut random = fastrand::Rng::with_seed(1);
        let (left, right): (Vec<u8>, Vec<u8>) = (0..80).map(|_| (random.u8(..), random.u8(..))).unzip();
        for level in Level::available() {
            let mut costs = [0.0; 77];
            gradient_differences(level, &left, &right, 0.3, &mut costs);
            for (x, cost) in costs.iter().enumerate() {
                let [e, f, g, h] = [0, 1, 2, 3].map(|k| f32::from(right[x + k]));
                let gradient = (g - e) + 0.3 * ((h - f) - (g - e));
                let expected = (f32::from(left[x + 2]) - f32::from(left[x]) - gradient).abs().min(MAX_COST);
                assert_eq!(*cost, expected, "{} {x}", level.name());
            }
        }
    }
}
