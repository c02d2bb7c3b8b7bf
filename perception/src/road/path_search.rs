//! Path of the road through v-disparity by dynamic programming, starting from the Radon line (e(i, j) in the
//! paper).
//!
//! From the bottom up, each block of rows i takes the bin j that maximises `e(i, j) = H(i, j) + max { e(i+1,
//! j′) − κ·|Δ| : η₀ ≤ j′ − j ≤ η₁ }`. H sums the rows of the block along the slope of the Radon line. Δ is
//! the change of the move j′ − j from one block to the next. The paper restricts moves only; the cost of
//! curvature κ keeps the path off walls. The disparity must decrease with distance by at least η₀ > 0, so
//! that vertical surfaces are not followed, and by at most η₁. Crests, dips and slopes are thus followed on
//! roads that are not planar, up to the last visible part.

use super::histogram::{BINS_PER_PX, VDisparity};
use super::radon::RoadLine;
use crate::simd::{Level, Simd, kernel};

/// Rows per block.
pub(super) const BLOCK: usize = 8;
/// Smallest and largest decrease of disparity per block, as factors of the decrease of the Radon line.
const SLOPE_RANGE: (f64, f64) = (0.5, 2.2);
/// The same for a road that may rise ahead.
const RISING_SLOPE_RANGE: (f64, f64) = (0.3, 2.2);
/// Cost of a change of the move by one bin per block, as a share of the largest score of a block.
const CURVATURE_COST: f32 = 0.02;
/// Cost of a move that differs from the Radon line by one bin per block, in the same unit.
const SLOPE_COST: f32 = 0.15;
/// Largest change of the move between two blocks, in bins per block.
const MAX_CURVATURE: usize = 2;
/// Counts at least this many bins beyond (farther than) a road bin contradict it; the second value is their
/// weight.
const OCCLUSION_MARGIN_BINS: usize = 6;
const BEYOND_WEIGHT: f32 = 0.3;
/// Largest number of different moves.
const MAX_MOVES: usize = 24;
/// Margin of the search band towards larger disparities for a rising road, in px.
const RISING_MARGIN_PX: f64 = 3.0;

/// Dynamic-programming search; memory is allocated once.
#[derive(Debug)]
pub struct PathSearch {
    bins: usize,
    /// Scores of a block, one for each bin.
    scores: Vec<f32>,
    /// Best energy for each last move and bin, for the block below and for the current one.
    energy: [Vec<f32>; 2],
    /// Move before the last one for each state, by block from the bottom.
    back_pointers: Vec<u8>,
    /// The same for the bins of one move.
    best_moves: Vec<i32>,
    level: Level,
}

/// Centre row of a block, counted from the bottom of an image with `height` rows.
pub(super) fn block_centre_row(height: usize, block: usize) -> f64 {
    (height - BLOCK * block) as f64 - 0.5 * (BLOCK + 1) as f64
}

impl PathSearch {
    /// A workspace for histograms of `bins` × `height` cells.
    pub fn new(bins: usize, height: usize) -> Self {
        Self {
            bins,
            scores: vec![0.0; bins],
            energy: [vec![0.0; bins * MAX_MOVES], vec![0.0; bins * MAX_MOVES]],
            back_pointers: vec![0; bins * MAX_MOVES * (height / BLOCK)],
            best_moves: vec![0; bins],
            level: Level::best(),
        }
    }

    /// First and last bin in which the road may lie in row `y`.
    fn band(&self, line: RoadLine, y: f64, rise_px: f64) -> (usize, usize) {
        let per_px = BINS_PER_PX as f64;
        let centre = line.at(y).max(0.0);
        let half = 2.5 + 0.1 * centre;
        let low = ((centre - half).max(0.5) * per_px) as usize;
        let high = ((centre + half + rise_px) * per_px) as usize;
        (low.min(self.bins - 1), high.min(self.bins - 1))
    }

    /// Score of each bin of a band in a block, summed along the slope of the line: counts at the bin minus
    /// weighted counts beyond it, since nothing is visible through the road.
    fn gather_scores(
        histogram: &VDisparity,
        block: usize,
        fall: f64,
        cap: u16,
        (low, high): (usize, usize),
        out: &mut [f32],
    ) {
        out[low..=high].fill(0.0);
        let bottom = histogram.height() - 1 - BLOCK * block;
        for up in 0..BLOCK {
            let row = histogram.row(bottom - up);
            let shift = ((0.5 * (BLOCK - 1) as f64 - up as f64) * fall / BLOCK as f64).round() as isize;
            let count = |b: usize| row.get(b).map_or(0.0, |&c| f32::from(c.min(cap)));
            let first = low.saturating_add_signed(shift);
            let beyond = &row[..first.saturating_sub(OCCLUSION_MARGIN_BINS).min(row.len())];
            let mut beyond = beyond.iter().map(|&c| u32::from(c)).sum::<u32>() as f32;
            for (at, sum) in (first..).zip(&mut out[low..=high]) {
                beyond += count(at.wrapping_sub(OCCLUSION_MARGIN_BINS));
                *sum += 0.5 * count(at.wrapping_sub(1)) + count(at) + 0.5 * count(at + 1);
                *sum -= BEYOND_WEIGHT * beyond.min(f32::from(cap));
            }
        }
    }

    /// Finds the path through `blocks` blocks from the bottom row; `rises` allows a road that rises ahead. A
    /// single cell counts at most `cap`. Writes disparity (px) and weight of each block to `path`, from the
    /// bottom.
    pub fn search(
        &mut self,
        histogram: &VDisparity,
        line: RoadLine,
        cap: u16,
        blocks: usize,
        rises: bool,
        path: &mut Vec<(f32, f32)>,
    ) {
        let height = histogram.height();
        let (bins, states) = (self.bins, self.bins * MAX_MOVES);
        let (slope_range, rise_px) =
            if rises { (RISING_SLOPE_RANGE, RISING_MARGIN_PX) } else { (SLOPE_RANGE, 0.0) };
        let fall = line.slope * (BLOCK * BINS_PER_PX) as f64;
        let min_move = ((slope_range.0 * fall).round() as usize).max(1);
        let moves =
            (((slope_range.1 * fall).ceil() as usize).max(min_move + 1) + 1 - min_move).min(MAX_MOVES);
        let curvature_cost = CURVATURE_COST * (usize::from(cap) * BLOCK) as f32;
        let slope_cost = SLOPE_COST * (usize::from(cap) * BLOCK) as f32;
        let [mut old, mut new] = std::mem::take(&mut self.energy);
        // End of the best path: block, state, energy.
        let mut best_end = (0, 0, f32::NEG_INFINITY);
        for block in 0..blocks {
            let (low, high) = self.band(line, block_centre_row(height, block), rise_px);
            // Range of bins that the next block reads.
            let next = self.band(line, block_centre_row(height, block + 1), rise_px);
            let required = low.min(next.0 + min_move)..(high.max(next.1 + min_move + moves) + 1).min(bins);
            Self::gather_scores(histogram, block, fall, cap, (low, high), &mut self.scores);
            let mut max_energy = f32::NEG_INFINITY;
            for step in 0..moves {
                let slope_difference = ((min_move + step) as f32 - fall as f32).abs();
                let row = &mut new[step * bins..][..bins];
                row[required.clone()].fill(f32::NEG_INFINITY);
                let best_moves = &mut self.best_moves[low..=high];
                best_moves.fill(step as i32);
                if block == 0 {
                    row[low..=high].fill(-curvature_cost * slope_difference);
                } else {
                    let from = (low + min_move + step).min(bins);
                    let count = (high + 1 - low).min(bins - from);
                    for before in step.saturating_sub(MAX_CURVATURE)..(step + MAX_CURVATURE + 1).min(moves) {
                        let cost = curvature_cost * step.abs_diff(before) as f32;
                        let energies = &old[before * bins + from..][..count];
                        let best = &mut row[low..][..count];
                        relax(self.level, energies, before as i32, cost, best, &mut best_moves[..count]);
                    }
                }
                let slope_cost = slope_cost * slope_difference;
                for (energy, count) in row[low..=high].iter_mut().zip(&self.scores[low..=high]) {
                    *energy = *energy + count - slope_cost;
                    max_energy = if *energy > max_energy { *energy } else { max_energy };
                }
                let back_pointers =
                    &mut self.back_pointers[block * states + step * bins + low..][..high + 1 - low];
                back_pointers.iter_mut().zip(best_moves).for_each(|(pointer, best)| *pointer = *best as u8);
            }
            if max_energy > best_end.2 {
                let mut ends = (low..=high).flat_map(|bin| (0..moves).map(move |step| step * bins + bin));
                if let Some(state) = ends.find(|&state| new[state] == max_energy) {
                    best_end = (block, state, max_energy);
                }
            }
            std::mem::swap(&mut old, &mut new);
        }
        self.energy = [old, new];
        let (end, state, _) = best_end;
        path.clear();
        path.resize(blocks.max(end + 1), (0.0, 0.0));
        self.trace_back(histogram, cap, min_move, (end, state), path);
    }

    /// Follows the back pointers down from the best end (block, state), and refines the disparity of each block
    /// to sub-bin resolution. `min_move` is the smallest move, in bins.
    fn trace_back(
        &self,
        histogram: &VDisparity,
        cap: u16,
        min_move: usize,
        (end, mut state): (usize, usize),
        path: &mut [(f32, f32)],
    ) {
        let (bins, states) = (self.bins, self.bins * MAX_MOVES);
        for block in (0..=end).rev() {
            let (step, bin) = (state / bins, state % bins);
            let (mut sum, mut moment) = (0.0, 0.0);
            for up in 0..BLOCK {
                let row = histogram.row(histogram.height() - 1 - BLOCK * block - up);
                let shift = (0.5 * (BLOCK - 1) as f32 - up as f32) * (min_move + step) as f32 / BLOCK as f32;
                let centre = bin as f32 + shift;
                let first = (centre.round() as usize).saturating_sub(2);
                for (b, &count) in row.iter().enumerate().skip(first).take(5) {
                    let count = f32::from(count.min(cap));
                    sum += count;
                    moment += count * (b as f32 + 0.5 - shift);
                }
            }
            let position = if sum > 0.0 { moment / sum } else { bin as f32 + 0.5 };
            path[block] = (position / BINS_PER_PX as f32, sum);
            let from = usize::from(self.back_pointers[block * states + state]);
            state = from * bins + (bin + min_move + step).min(bins - 1);
        }
    }
}

kernel! {
    /// Dynamic-programming relaxation: replaces the best energy and its move where `energies` minus `cost` is
    /// greater.
    fn relax(energies: &[f32], before: i32, cost: f32, best: &mut [f32], last: &mut [i32]) = relax_each
}

#[inline(always)]
fn relax_each<S: Simd>(_: S, energies: &[f32], before: i32, cost: f32, best: &mut [f32], last: &mut [i32]) {
    for ((energy, best), last) in energies.iter().zip(best).zip(last) {
        let energy = energy - cost;
        let better = energy > *best;
        *best = if better { energy } else { *best };
        *last = if better { before } else { *last };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_levels_relax_to_strictly_better_moves_only() {
        let mut random = fastrand::Rng::with_seed(1);
        let mut energies = || -> Vec<f32> { (0..77).map(|_| random.u8(..9).into()).collect() };
        let (first, second) = (energies(), energies());
        for level in Level::available() {
            let (mut best, mut last) = (first.clone(), vec![3; 77]);
            relax(level, &second, 5, 2.0, &mut best, &mut last);
            for i in 0..77 {
                let better = second[i] - 2.0 > first[i];
                let expected = if better { (second[i] - 2.0, 5) } else { (first[i], 3) };
                assert_eq!((best[i], last[i]), expected, "{}", level.name());
            }
        }
    }
}
