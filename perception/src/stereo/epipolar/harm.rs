//! What a vertical offset costs: the share of matches that it loses, and the error of disparities.
//!
//! Both are measured on the 18 pairs of kitti2015 (`tests/row_offset_cost.rs` repeats that): the rows of the right
//! image are aligned, then shifted, and the map is compared with the ground truth and with that of the aligned pair.

use super::field::{RowField, place};

/// Share of the matches of an aligned pair (within 3 px of the truth) that an offset in pixels loses or makes wrong.
/// Means; single pairs lie between half and twice these up to 1 px, and closer above.
const LOST: [(f64, f64); 11] = [
    (0.0, 0.0),
    (0.25, 0.013),
    (0.5, 0.025),
    (0.75, 0.05),
    (1.0, 0.103),
    (1.25, 0.235),
    (1.5, 0.421),
    (2.0, 0.697),
    (2.5, 0.798),
    (3.0, 0.838),
    (4.0, 0.88),
];

/// Change of a disparity for each pixel of vertical offset, in px: the median of the magnitudes. An edge that is not
/// vertical is found beside its place when its row is off.
pub const DISPARITY_PX_PER_PX: f64 = 0.36;

/// Share of matches that a vertical offset loses, 0 to 0.88, as expected from its magnitude in pixels.
pub fn lost_share(offset_px: f64) -> f64 {
    let offset_px = offset_px.abs();
    let after = LOST.partition_point(|(px, _)| *px <= offset_px);
    match (LOST[..after].last(), LOST.get(after)) {
        (Some((px, lost)), Some((next_px, next))) => lost + (next - lost) * (offset_px - px) / (next_px - px),
        // Also where the offset is not a number: nothing is known, so nothing is good.
        _ => LOST[LOST.len() - 1].1,
    }
}

/// Cells along the columns and the rows of the image.
pub const CELLS: (usize, usize) = (20, 12);

/// Where in the image pixels are matched: the area that matters. Past frames count less and less.
#[derive(Clone, Debug)]
pub struct MatchedArea {
    weights: [f64; CELLS.0 * CELLS.1],
}

impl Default for MatchedArea {
    fn default() -> Self {
        Self { weights: [0.0; CELLS.0 * CELLS.1] }
    }
}

impl MatchedArea {
    /// Multiplies what past frames contributed by `keep`.
    pub fn fade(&mut self, keep: f64) {
        for weight in &mut self.weights {
            *weight *= keep;
        }
    }

    /// Adds the share of matched pixels in a cell, numbered row by row.
    pub fn add(&mut self, cell: usize, share: f64) {
        if let Some(weight) = self.weights.get_mut(cell) {
            *weight += share;
        }
    }

    /// Weights and offsets of a field in the cells.
    fn cells<'a>(&'a self, field: &'a RowField) -> impl Iterator<Item = (f64, f64)> + 'a {
        self.weights.iter().enumerate().map(|(cell, weight)| {
            let (i, j) = ((cell % CELLS.0) as f64, (cell / CELLS.0) as f64);
            (*weight, field.at(place(i, CELLS.0), place(j, CELLS.1)))
        })
    }

    /// Typical (root mean square) offset of a field over the area, in pixels; 0 if nothing is matched.
    pub fn typical_px(&self, field: &RowField) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for (weight, offset) in self.cells(field) {
            sum += weight;
            squares += weight * offset * offset;
        }
        if sum > 0.0 { (squares / sum).sqrt() } else { 0.0 }
    }

    /// Share of matches that a field loses over the area, 0 to 1. `scatter_px` is what points deviate from the field.
    ///
    /// The area consists of the matches that are left: each stands for 1 / (1 − lost) of an aligned pair.
    pub fn lost(&self, field: &RowField, scatter_px: f64) -> f64 {
        let (mut left, mut all) = (0.0, 0.0);
        for (weight, offset) in self.cells(field) {
            left += weight;
            all += weight / (1.0 - lost_share(offset.hypot(scatter_px)));
        }
        if all > 0.0 { 1.0 - left / all } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_grows_with_the_offset() {
        assert_eq!(lost_share(0.0), 0.0);
        assert_eq!(lost_share(-1.0), 0.103);
        assert!((lost_share(1.75) - 0.559).abs() < 1e-9);
        assert_eq!((lost_share(99.0), lost_share(f64::NAN)), (0.88, 0.88));
        assert!((0..80).all(|i| lost_share(f64::from(i) * 0.05) < lost_share(f64::from(i + 1) * 0.05)));
    }

    #[test]
    fn only_the_area_that_is_matched_counts() {
        // A roll that reaches 3 px at the borders.
        let roll = RowField { across_px: 3.0, ..RowField::ZERO };
        let (mut middle, mut everywhere) = (MatchedArea::default(), MatchedArea::default());
        assert_eq!((middle.lost(&roll, 0.0), middle.typical_px(&roll)), (0.0, 0.0));
        for cell in 0..CELLS.0 * CELLS.1 {
            everywhere.add(cell, 1.0);
            if (8..12).contains(&(cell % CELLS.0)) {
                middle.add(cell, 1.0);
            }
        }
        assert!(middle.lost(&roll, 0.0) < 0.03 && middle.typical_px(&roll) < 0.4);
        assert!(everywhere.lost(&roll, 0.0) > 0.5 && everywhere.typical_px(&roll) > 1.5);
        // One offset for all of the area costs what the table says, however often it was added.
        let offset = RowField { offset_px: 1.0, ..RowField::ZERO };
        everywhere.fade(0.01);
        assert!((everywhere.lost(&offset, 0.0) - 0.103).abs() < 1e-9);
        assert!((everywhere.lost(&offset, 1.0) - lost_share(2_f64.sqrt())).abs() < 1e-9);
    }

    #[test]
    fn what_is_lost_counts_although_it_is_no_longer_matched() {
        // Half of the image is aligned, the other half is 2 px off: of those matches 69.7 % are lost.
        let mut area = MatchedArea::default();
        let step = RowField { offset_px: 1.0, across_px: 1.0, ..RowField::ZERO };
        area.add(0, 1.0);
        area.add(CELLS.0 - 1, 0.303);
        assert!((area.lost(&step, 0.0) - 0.3485).abs() < 1e-9, "{}", area.lost(&step, 0.0));
    }
}
