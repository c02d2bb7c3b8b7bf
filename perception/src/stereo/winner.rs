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
pub(crate) struct Winners {
    place: Lanes,
    best: Lanes,
    second: Lanes,
    /// Disparities in 1/256 px.
    disparity: [u16; LANES],
}

#[inline(always)]
fn pick<S: Simd>(s: S, nodes: &[Lanes], low: usize, winners: &mut Winners) {
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

    let (mut before, mut after) = (Lanes::ZERO, Lanes::ZERO);
    let last = nodes.len() - 1;
    for lane in 0..LANES {
        let k = usize::from(winners.place.0[lane]);
        before.0[lane] = nodes[k.saturating_sub(1)].0[lane];
        after.0[lane] = nodes[(k + 1).min(last)].0[lane];
    }
    for lane in 0..LANES {
        let k = usize::from(winners.place.0[lane]);
        let part = sub_pixel(before.0[lane], winners.best.0[lane], after.0[lane]);
        let part = if k == 0 || k == last { 0 } else { part };
        winners.disparity[lane] = (((low + k) * 256) as i32 + part) as u16;
    }
}

/// Where the winner truly lies, in 1/256 px from its node: where two lines of equal slope through
/// it and its neighbours meet (equiangular fit), at most half a pixel.
#[inline(always)]
fn sub_pixel(before: u8, here: u8, after: u8) -> i32 {
    let (before, here, after) = (f32::from(before), f32::from(here), f32::from(after));
    // At least 1, so that a flat energy gives no place of its own.
    let slope = (before - here).max(after - here).max(1.0);
    (128.0 * (before - after) / slope) as i32
}

kernel! { fn pick_winners(nodes: &[Lanes], low: usize, winners: &mut Winners) = pick }

/// Columns left of the right view: x − d is never below them.
const LEAD: usize = 256;

/// Picks winners row by row, with memory allocated once.
#[derive(Debug)]
pub struct Winner {
    parameters: WinnerParameters,
    level: Level,
    width: usize,
    /// Whole disparity of each pixel's winner.
    place: Vec<u8>,
    /// The right view, [`LEAD`] columns before it: of the winner that lands on a pixel, its energy
    /// in the upper byte and 255 less its disparity in the lower.
    right: Vec<u16>,
    /// The confidence of each margin.
    trust: [u8; 256],
}

impl Winner {
    /// A workspace for rows of `width` pixels.
    pub fn new(parameters: WinnerParameters, level: Level, width: usize) -> Self {
        let clear = usize::from(parameters.clear_margin.max(1));
        Self {
            trust: std::array::from_fn(|margin| (margin * 255 / clear).clamp(1, 255) as u8),
            parameters,
            level,
            width,
            place: vec![0; width],
            right: vec![0; LEAD + width],
        }
    }

    /// Bytes that the workspace holds.
    pub fn bytes(&self) -> usize {
        self.place.len() + 2 * self.right.len()
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
        let zero = Lanes::ZERO;
        let mut winners = Winners { place: zero, best: zero, second: zero, disparity: [0; LANES] };
        self.right.fill(u16::MAX);
        for (tile, block) in blocks.iter().enumerate() {
            let at = block.at + row * block.pitch();
            let nodes = &energies[at..at + block.span()];
            pick_winners(self.level, nodes, block.low, &mut winners);
            let x = tile * LANES;
            let inside = LANES.min(self.width - x);
            disparity[x..x + inside].copy_from_slice(&winners.disparity[..inside]);
            let places = &mut self.place[x..x + inside];
            let confidences = &mut confidence[x..x + inside];
            for (lane, (place, confidence)) in places.iter_mut().zip(confidences).enumerate() {
                let (best, second) = (winners.best.0[lane], winners.second.0[lane]);
                *confidence = self.trust[usize::from(second.saturating_sub(best))];
                *place = winners.place.0[lane] + block.low as u8;
                // Of equal energies the nearer surface hides the farther one.
                let key = u16::from(best) << 8 | u16::from(u8::MAX - *place);
                let seen = &mut self.right[LEAD + x + lane - usize::from(*place)];
                *seen = key.min(*seen);
            }
        }
        let most = self.parameters.left_right_px;
        let least = self.parameters.least_confidence;
        let pixels = disparity.iter_mut().zip(confidence).zip(&self.place).enumerate();
        for (x, ((disparity, confidence), &place)) in pixels {
            let seen = u8::MAX - self.right[LEAD + x - usize::from(place)] as u8;
            let kept = usize::from(place) <= x && seen.abs_diff(place) <= most && *confidence >= least;
            *disparity = if kept { *disparity } else { 0 };
            *confidence = if kept { *confidence } else { 0 };
        }
    }
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
        assert_eq!(sub_pixel(20, 10, 20), 0);
        assert_eq!(sub_pixel(30, 10, 10), 128);
        assert_eq!(sub_pixel(15, 10, 20), -64);
        assert_eq!(sub_pixel(10, 10, 10), 0);
        // A window that starts or ends at the winner says nothing about either side.
        let (disparity, _) = run(&[9; 40], 9, 4);
        assert!(disparity[9..].iter().all(|&d| d == 9 * 256));
    }
}
