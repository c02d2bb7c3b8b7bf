//! Sides of wide regions, found in the two images.
//!
//! Where there is no texture beside a thing, as at the horizon or before a plain wall, the matcher continues the thing's disparity into
//! it: the region is wider than the thing, and an image patch of it shows what is behind. Around each side of a region a row is
//! therefore divided into the surface beside it, the road and the surface of the region, in this order, where the gradients of both
//! images fit best ([`super::photometric`] does the same with the whole of a narrow region). Columns without texture fit every
//! surface; they are assigned to what is outside, up to the first edge that fits the region alone.

use super::photometric::{
    BORDER, MARGIN_COLUMNS, MIN_SIDE_REDUCTION, NO_SURFACE_COST, Verifier, gradient_costs,
};
use super::stixels::STRIP_COLUMNS;
use crate::region::{DEPTH_BLUR_PX, Region};
use std::ops::Range;

/// Largest number of rows of a region that are examined.
const MAX_ROWS: usize = 12;
/// Fewest rows that show a side,
const MIN_ROWS: usize = 3;
/// and the part of those that are examined, as its denominator: no more of a car's side reach to its bumper.
const MIN_PART: usize = 3;
/// Largest number of columns that are examined at each side, [`MARGIN_COLUMNS`] of them outside: three times as many as the matcher
/// smears over asphalt.
const COLUMNS: usize = 54;
/// A side is examined if its end is less than this behind the near face, in px: the side of a near car, which is seen, runs farther away.
const MAX_BEHIND_PX: f64 = 2.0;
/// Cost of a column of the region's surface, in grey levels.
const COLUMN_COST: f32 = 0.3;
/// Surfaces in their order from the outside: beside the region, the road, the region.
const SURFACES: usize = 3;
/// The last of them.
const OWN: usize = 2;

type Costs = [[f32; COLUMNS]; SURFACES];

impl Verifier<'_> {
    /// First column of a region and the column after its last one, in px, within its box, as the images show them. A side that they do not
    /// show, that runs farther away from the camera than one that only seems to, or that the border of an image cuts, is that of the box.
    pub fn sides(&self, region: &Region) -> (u32, u32) {
        let b = &region.bounds;
        let (first, end) = (b.x as usize, (b.x + b.width) as usize);
        let (width, height) = (self.images[0].width(), self.images[0].height());
        // The right image shows nothing farther left.
        let hidden = region.disparity_px.ceil().max(0.0) as usize;
        let is_cut = [first < hidden + MARGIN_COLUMNS + BORDER, end + MARGIN_COLUMNS + BORDER > width];
        let rig = &self.road.rig;
        // Exactly 0 where the side does not run away.
        let behind_px = region.outline.end_depth_m.map(|depth_m| {
            if depth_m > 0.0 {
                region.disparity_px - rig.disparity_px(region.distance_m + depth_m)
            } else {
                0.0
            }
        });
        let is_shown = |side: &usize| !is_cut[*side] && behind_px[*side] < MAX_BEHIND_PX;
        let count = ((end - first) / 2 + MARGIN_COLUMNS).min(COLUMNS);
        let step = (b.height as usize).div_ceil(MAX_ROWS).max(1);
        let (mut beside, mut counts, mut rows) = ([[0; MAX_ROWS]; 2], [0; 2], 0);
        for y in (b.y as usize..((b.y + b.height) as usize).min(height)).step_by(step).take(MAX_ROWS) {
            rows += 1;
            let Some(surfaces) = self.surfaces(region, y) else { continue };
            let [left_px, road_px, right_px, own_px] = surfaces.disparity_px;
            for side in (0..2).filter(is_shown) {
                let columns = if side == 0 {
                    first - MARGIN_COLUMNS..first - MARGIN_COLUMNS + count
                } else {
                    end + MARGIN_COLUMNS - count..end + MARGIN_COLUMNS
                };
                let surfaces_px = [[left_px, right_px][side], road_px, own_px];
                let found = if surfaces.is_continuous[side] {
                    // At the foot of a thing the road is as near, and tells nothing of its side.
                    road_px.map(|_| 0)
                } else {
                    self.columns_beside(y, surfaces_px, behind_px[side] as f32, columns, side == 1)
                };
                if let Some(columns) = found {
                    beside[side][counts[side]] = columns.saturating_sub(MARGIN_COLUMNS);
                    counts[side] += 1;
                }
            }
        }
        let [left, right] = [0, 1].map(|side| {
            let beside = &mut beside[side][..counts[side]];
            beside.sort_unstable();
            let is_found = beside.len() >= MIN_ROWS && MIN_PART * beside.len() >= rows;
            // The outer fifth of the rows is ignored, since mirrors or wheels may protrude.
            if is_found { beside[beside.len() / 5] as u32 } else { 0 }
        });
        (b.x + left, b.x + b.width - right)
    }

    /// How many of these columns around a side of a region are outside it in row `y`, by the disparities of the surface beside it, the road
    /// and itself, in px, its own up to `behind_px` less at the side. `is_right`: the outermost one is the last one. `None` without another
    /// surface, or if that of the region explains the row too little better.
    fn columns_beside(
        &self,
        y: usize,
        surfaces_px: [Option<f32>; SURFACES],
        behind_px: f32,
        columns: Range<usize>,
        is_right: bool,
    ) -> Option<usize> {
        if surfaces_px[..OWN].iter().all(Option::is_none) {
            return None;
        }
        let [left, right] = self.images.map(|image| image.row(y));
        let mut costs: Costs = [[NO_SURFACE_COST; COLUMNS]; SURFACES];
        for (surface, costs) in costs.iter_mut().enumerate() {
            let Some(surface_px) = surfaces_px[surface] else { continue };
            let costs = &mut costs[..columns.len()];
            // A side that runs away is where the map has it, strip by strip.
            let is_oblique = surface == OWN && behind_px > 0.0;
            let mut from = columns.start;
            while from < columns.end {
                let strip = from / STRIP_COLUMNS;
                let to =
                    if is_oblique { ((strip + 1) * STRIP_COLUMNS).min(columns.end) } else { columns.end };
                let own_px = || f32::from(self.stixels.depths(strip)[y]) / 256.0;
                let range_px = surface_px - behind_px - DEPTH_BLUR_PX as f32..surface_px;
                let disparity_px =
                    if is_oblique && strip < self.stixels.strips() && range_px.contains(&own_px()) {
                        own_px()
                    } else {
                        surface_px
                    };
                let part = &mut costs[from - columns.start..to - columns.start];
                gradient_costs(self.stixels.level(), left, right, disparity_px, from, part);
                from = to;
            }
            if is_right {
                costs.reverse();
            }
        }
        columns_before(&costs, columns.len())
    }
}

/// Columns before those of the last surface, where a row is divided into surfaces in their order and ends with the last one at the least
/// cost. `None` if the others explain it nearly as well.
fn columns_before(costs: &Costs, count: usize) -> Option<usize> {
    // In sums, the cost of each surface if it is the one that the row has reached.
    let (mut sums, mut before) = ([0.0_f32; SURFACES], 0);
    for x in 0..count {
        for surface in (0..SURFACES).rev() {
            // The surface before may end here; at equal costs this one begins later.
            let ends = sums[..surface].iter().copied().fold(f32::INFINITY, f32::min);
            if ends <= sums[surface] {
                sums[surface] = ends;
                before = if surface == OWN { x } else { before };
            }
            let column_cost = if surface == OWN { COLUMN_COST } else { 0.0 };
            sums[surface] += costs[surface][x] + column_cost;
        }
    }
    let others = sums[..OWN].iter().copied().fold(f32::INFINITY, f32::min);
    (others - sums[OWN] > MIN_SIDE_REDUCTION).then_some(before)
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{with_left_side, with_region};
    use super::*;
    use crate::region::PixelBox;

    const SIZE: (usize, usize) = (256, 64);
    /// Disparities of the background and of the thing.
    const BACKGROUND: usize = 2;
    const THING: usize = 8;

    /// A pair with a textured thing in some columns; what is behind it has a texture of so many grey levels.
    fn pair(thing: Range<usize>, behind: u8) -> [Vec<u8>; 2] {
        let mut random = fastrand::Rng::with_seed(5);
        let (width, height) = SIZE;
        let mut pair = [vec![0_u8; width * height], vec![0_u8; width * height]];
        for y in 0..height {
            let mut texture = |grey: std::ops::RangeInclusive<u8>| {
                let mut row = vec![0_u8; width + 16];
                row.chunks_mut(2).for_each(|two| two.fill(random.u8(grey.clone())));
                row
            };
            let (far, near) = (texture(150..=150 + behind), texture(20..=140));
            for (image, [far_px, near_px]) in pair.iter_mut().zip([[0, 0], [BACKGROUND, THING]]) {
                let row = &mut image[y * width..][..width];
                row.copy_from_slice(&far[far_px..][..width]);
                row[thing.start - near_px..thing.end - near_px].copy_from_slice(&near[thing.clone()]);
            }
        }
        pair
    }

    /// The sides of a box with the disparity of the thing; the map has that inside the box, and that of the background elsewhere.
    fn sides(pair: &[Vec<u8>; 2], bounds: PixelBox) -> (u32, u32) {
        with_region(pair, SIZE, [BACKGROUND, THING], bounds, |verifier, region| verifier.sides(region))
    }

    const BOX: PixelBox = PixelBox { x: 60, y: 8, width: 128, height: 40 };

    #[test]
    fn what_has_no_texture_beside_a_thing_is_not_of_it() {
        let (first, end) = sides(&pair(92..170, 0), BOX);
        // The columns left of the thing that the right image does not show may belong to either.
        assert!((84..=94).contains(&first) && end.abs_diff(170) <= 2, "{first} {end}");
    }

    #[test]
    fn texture_at_another_distance_is_not_of_it_either() {
        let (first, end) = sides(&pair(92..170, 60), BOX);
        assert!((84..=94).contains(&first) && end.abs_diff(170) <= 2, "{first} {end}");
    }

    #[test]
    fn a_box_that_fits_remains_as_it_is() {
        for behind in [0, 60] {
            let (first, end) = sides(&pair(60..188, behind), BOX);
            assert!(first <= 62 && end >= 186, "{first} {end}");
        }
    }

    #[test]
    fn what_is_plain_itself_ends_at_its_edges() {
        for bounds in [BOX, PixelBox { x: 80, width: 100, ..BOX }, PixelBox { x: 92, width: 78, ..BOX }] {
            let mut pair = pair(92..170, 0);
            // A plain thing with one line in the middle.
            for row in pair[0].chunks_exact_mut(SIZE.0) {
                row[92..170].fill(60);
                row[128..130].fill(120);
            }
            for row in pair[1].chunks_exact_mut(SIZE.0) {
                row[92 - THING..170 - THING].fill(60);
                row[128 - THING..130 - THING].fill(120);
            }
            let (first, end) = sides(&pair, bounds);
            assert!((84..=94).contains(&first) && end.abs_diff(170) <= 2, "{first} {end}");
        }
    }

    /// The same with a left side of 32 columns that ends so many px behind the rest.
    fn first_of_side(pair: &[Vec<u8>; 2], behind_px: usize) -> u32 {
        let of = |verifier: &Verifier<'_>, region: &Region| verifier.sides(region);
        with_left_side(pair, SIZE, [BACKGROUND, THING], BOX, (32, behind_px), of).0
    }

    #[test]
    fn what_only_seems_to_be_its_side_is_not_of_it() {
        for behind in [0, 60] {
            let first = first_of_side(&pair(92..170, behind), 1);
            assert!((84..=94).contains(&first), "{first}");
        }
        // The side of what is near is not examined: the map has it.
        assert_eq!(first_of_side(&pair(92..170, 60), 3), BOX.x);
    }

    #[test]
    fn a_side_that_runs_away_is_of_it() {
        let mut pair = pair(60..170, 60);
        let [left, right] = &mut pair;
        for (left, right) in left.chunks_exact(SIZE.0).zip(right.chunks_exact_mut(SIZE.0)) {
            right[61 - THING..93 - THING].copy_from_slice(&left[60..92]);
        }
        let first = first_of_side(&pair, 1);
        assert!(first <= 62, "{first}");
    }

    #[test]
    fn where_nothing_is_seen_nothing_is_cut() {
        let (width, height) = SIZE;
        let flat = [vec![90; width * height], vec![90; width * height]];
        assert_eq!(sides(&flat, BOX), (60, 188));
        // Too few rows, and too few columns.
        assert_eq!(sides(&pair(92..170, 0), PixelBox { height: 2, ..BOX }), (60, 188));
        assert_eq!(sides(&pair(92..170, 0), PixelBox { width: 1, ..BOX }), (60, 61));
    }

    #[test]
    fn a_side_at_the_border_of_the_image_remains_there() {
        let pair = pair(92..170, 0);
        let (first, end) = sides(&pair, PixelBox { x: 0, width: 190, ..BOX });
        assert!(first == 0 && end.abs_diff(170) <= 2, "{first} {end}");
        let (first, end) = sides(&pair, PixelBox { x: 80, width: 176, ..BOX });
        assert!((84..=94).contains(&first) && end == 256, "{first} {end}");
        sides(&pair, PixelBox { y: 60, ..BOX });
    }

    #[test]
    fn the_division_of_a_row_equals_exhaustive_search() {
        let mut random = fastrand::Rng::with_seed(9);
        let count = 7;
        let mut found = 0;
        for _ in 0..200 {
            let mut costs: Costs = [[NO_SURFACE_COST; COLUMNS]; SURFACES];
            for costs in &mut costs {
                costs[..count].fill_with(|| random.f32() * 20.0);
            }
            // Every end of the outer surface and every begin of the region's.
            let sum = |outer: usize, own: usize| {
                let part =
                    |surface: usize, columns: Range<usize>| costs[surface][columns].iter().sum::<f32>();
                let own_cost = COLUMN_COST * (count - own) as f32;
                part(0, 0..outer) + part(1, outer..own) + part(OWN, own..count) + own_cost
            };
            let all = (0..=count).flat_map(|own| (0..=own).map(move |outer| (outer, own)));
            let with_own = all.clone().filter(|(_, own)| *own < count);
            let best = with_own.map(|(a, b)| (sum(a, b), b)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
            let others =
                all.filter(|(_, own)| *own == count).map(|(a, b)| sum(a, b)).reduce(f32::min).unwrap();
            let expected = (others - best.0 > MIN_SIDE_REDUCTION).then_some(best.1);
            assert_eq!(columns_before(&costs, count), expected, "{costs:?}");
            found += u32::from(expected.is_some());
        }
        assert!((20..180).contains(&found), "{found}");
    }
}
