//! From energies to a disparity: the winner, its sub-pixel place, the left-right check and the
//! confidence.

use super::blocks::Block;
use crate::simd::{LANES, Lanes, Level, Simd, kernel};

/// How the winner of a pixel is chosen and trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WinnerParameters {
    /// Disparities of the left and the right view may differ by this many pixels; 255 leaves the
    /// check out.
    pub left_right_px: u8,
    /// A winner whose energy lies this far below the best other node has confidence 255.
    pub clear_margin: u8,
    /// A winner of less confidence than this is unknown.
    pub least_confidence: u8,
}

impl Default for WinnerParameters {
    fn default() -> Self {
        Self { left_right_px: 2, clear_margin: 100, least_confidence: 0 }
    }
}

/// The winners of a tile: where in the window (0 to `nodes.len()` − 1), their energies, and the
/// least energy more than one disparity away. On a tie the smaller disparity wins.
#[derive(Clone, Copy, Debug)]
pub struct Winners {
    place: Lanes,
    best: Lanes,
    second: Lanes,
}

#[inline(always)]
fn pick<S: Simd>(s: S, nodes: &[Lanes], winners: &mut Winners) {
    let mut best = s.splat(u8::MAX);
    let mut place = s.splat(0);
    for (k, node) in nodes.iter().enumerate() {
        let node = s.load(node);
        place = s.select_less(node, best, s.splat(k as u8), place);
        best = s.min(node, best);
    }
    let mut second = s.splat(u8::MAX);
    let one = s.splat(1);
    for (k, node) in nodes.iter().enumerate() {
        let here = s.splat(k as u8);
        let away = s.max(s.sub(here, place), s.sub(place, here));
        // Near the winner the node counts as 255.
        let rival = s.select_less(one, away, s.load(node), s.splat(u8::MAX));
        second = s.min(second, rival);
    }
    s.store(place, &mut winners.place);
    s.store(best, &mut winners.best);
    s.store(second, &mut winners.second);
}

kernel! { fn pick_winners(nodes: &[Lanes], winners: &mut Winners) = pick }

/// Picks winners row by row, with memory allocated once.
#[derive(Debug)]
pub struct Winner {
    parameters: WinnerParameters,
    level: Level,
    width: usize,
    /// Whole disparity and energy of each pixel's winner.
    place: Vec<u8>,
    best: Vec<u8>,
    /// The right view: energy and disparity of the winner that lands on a pixel.
    right: Vec<(u8, u8)>,
    /// 128·2¹⁶ ÷ each slope, so that no pixel divides.
    reciprocal: [i32; 256],
    /// The confidence of each margin.
    trust: [u8; 256],
}

impl Winner {
    /// A workspace for rows of `width` pixels.
    pub fn new(parameters: WinnerParameters, level: Level, width: usize) -> Self {
        let clear = usize::from(parameters.clear_margin.max(1));
        Self {
            reciprocal: std::array::from_fn(|slope| ((128 << 16) / slope.max(1)) as i32),
            trust: std::array::from_fn(|margin| (margin * 255 / clear).clamp(1, 255) as u8),
            parameters,
            level,
            width,
            place: vec![0; width],
            best: vec![0; width],
            right: vec![(0, 0); width],
        }
    }

    /// Bytes that the workspace holds.
    pub fn bytes(&self) -> usize {
        4 * self.place.len()
    }

    /// Takes row `row` of the `blocks` and writes its disparities in 1/256 px (0 = unknown:
    /// left-right check failed, outside the right view, or at infinity) and confidences.
    pub fn row(
        &mut self,
        blocks: &[Block],
        row: usize,
        energies: &[Lanes],
        disparity: &mut [u16],
        confidence: &mut [u8],
    ) {
        self.right.fill((u8::MAX, 0));
        let mut winners = Winners { place: Lanes::ZERO, best: Lanes::ZERO, second: Lanes::ZERO };
        for (tile, block) in blocks.iter().enumerate() {
            let at = block.at + row * block.pitch();
            let nodes = &energies[at..at + block.span()];
            pick_winners(self.level, nodes, &mut winners);
            let x = tile * LANES;
            for lane in 0..LANES.min(self.width - x) {
                let k = usize::from(winners.place.0[lane]);
                let best = winners.best.0[lane];
                let whole = block.low + k;
                let x = x + lane;
                self.place[x] = whole as u8;
                self.best[x] = best;
                disparity[x] = sub_pixel(nodes, lane, k, whole, &self.reciprocal);
                let margin = winners.second.0[lane].saturating_sub(best);
                confidence[x] = self.trust[usize::from(margin)];
                if let Some(seen) = x.checked_sub(whole) {
                    // On a tie the nearer surface, that comes later, hides the farther one.
                    if best <= self.right[seen].0 {
                        self.right[seen] = (best, whole as u8);
                    }
                }
            }
        }
        for x in 0..self.width {
            let whole = self.place[x];
            let kept = x
                .checked_sub(usize::from(whole))
                .is_some_and(|seen| self.right[seen].1.abs_diff(whole) <= self.parameters.left_right_px);
            if !kept || confidence[x] < self.parameters.least_confidence {
                (disparity[x], confidence[x]) = (0, 0);
            }
        }
    }
}

/// The disparity in 1/256 px: the winner, moved by where two lines of equal slope through it and
/// its neighbours meet (equiangular fit), at most half a pixel.
#[inline]
fn sub_pixel(nodes: &[Lanes], lane: usize, k: usize, whole: usize, reciprocal: &[i32; 256]) -> u16 {
    let whole = (whole * 256) as i32;
    if k == 0 || k + 1 == nodes.len() {
        return whole as u16;
    }
    let at = |k: usize| i32::from(nodes[k].0[lane]);
    let (before, here, after) = (at(k - 1), at(k), at(k + 1));
    let slope = (before - here).max(after - here);
    if slope <= 0 {
        return whole as u16;
    }
    (whole + (((before - after) * reciprocal[slope as usize] + (1 << 15)) >> 16)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row whose pixel x has its least energy at `truth[x]`, in windows of `n` from `low` on.
    fn row_for(truth: &[usize], low: usize, n: usize) -> (Vec<Block>, Vec<Lanes>) {
        let tiles = truth.len().div_ceil(LANES);
        let mut nodes = vec![Lanes::splat(200); tiles * n];
        for (x, &t) in truth.iter().enumerate() {
            for k in 0..n {
                nodes[x / LANES * n + k].0[x % LANES] = (20 * (low + k).abs_diff(t)).min(100) as u8;
            }
        }
        let block = |tile| Block { low, high: low + n, at: tile * n, ..Block::default() };
        ((0..tiles).map(block).collect(), nodes)
    }

    fn run(truth: &[usize], low: usize, n: usize) -> (Vec<u16>, Vec<u8>) {
        let (blocks, nodes) = row_for(truth, low, n);
        let mut results = Level::available().into_iter().map(|level| {
            let mut winner = Winner::new(WinnerParameters::default(), level, truth.len());
            let (mut disparity, mut confidence) = (vec![1; truth.len()], vec![1; truth.len()]);
            winner.row(&blocks, 0, &nodes, &mut disparity, &mut confidence);
            (disparity, confidence)
        });
        let plain = results.next().unwrap();
        assert!(results.all(|r| r == plain), "all levels agree");
        plain
    }

    #[test]
    fn a_constant_disparity_is_found_where_both_views_see_it() {
        let (disparity, confidence) = run(&[7; 50], 2, 14);
        assert!(disparity[..7].iter().all(|&d| d == 0), "outside the right view");
        assert!(disparity[7..].iter().all(|&d| d == 7 * 256));
        assert!(confidence[7..].iter().all(|&c| c == (40 * 255 / 100) as u8));
        assert!(confidence[..7].iter().all(|&c| c == 0));
    }

    #[test]
    fn an_occluded_strip_fails_the_check() {
        // A near object from 30 on hides what lies right of its left edge in the right view.
        let truth: Vec<usize> = (0..64).map(|x| if x >= 30 { 12 } else { 2 }).collect();
        let (disparity, _) = run(&truth, 0, 16);
        assert!(disparity[20..30].iter().all(|&d| d == 0), "{disparity:?}");
        assert_eq!(disparity[19], 2 * 256);
        assert_eq!(disparity[40], 12 * 256);
    }

    #[test]
    fn the_sub_pixel_place_follows_the_lower_side() {
        let nodes = |e: [u8; 3]| e.map(Lanes::splat);
        let winner = Winner::new(WinnerParameters::default(), Level::PLAIN, 1);
        let sub_pixel =
            |nodes: &[Lanes], lane, k, whole| sub_pixel(nodes, lane, k, whole, &winner.reciprocal);
        assert_eq!(sub_pixel(&nodes([20, 10, 20]), 0, 1, 1), 256);
        assert_eq!(sub_pixel(&nodes([30, 10, 10]), 0, 1, 1), 256 + 128);
        assert_eq!(sub_pixel(&nodes([15, 10, 20]), 0, 1, 1), 256 - 64);
        assert_eq!(sub_pixel(&nodes([10, 10, 10]), 0, 1, 1), 256);
        assert_eq!(sub_pixel(&nodes([5, 10, 20]), 0, 0, 9), 9 * 256);
    }
}
