//! From energies to a disparity: the winner, its sub-pixel place, the left-right check and the
//! confidence.

use super::energy::EnergyRow;
use super::viterbi::NEAR;
use crate::simd::whole::whole;
use crate::simd::{LANES, Lanes, Level, Simd, kernel};

/// How the winner of a pixel is chosen and trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WinnerParameters {
    /// Disparities of the left and the right view may differ by this many pixels; 255 leaves the
    /// check out.
    pub left_right_px: u8,
    /// A winner of less confidence than this is unknown.
    pub min_confidence: u8,
    /// How a winner's place between the nodes is found.
    pub sub_pixel: SubPixel,
}

/// How a winner's place between the nodes is found. Each path's jumps pull a surface to the whole
/// disparity that most of it has: the more they weigh, the less an estimate scatters and the more it
/// keeps to whole pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SubPixel {
    /// Not at all.
    None,
    /// From the final energies.
    Energy,
    /// From H, where the winner is its least, too, and a little of what the six paths' jumps say for
    /// one side; from the final energies elsewhere.
    Data,
}

impl Default for WinnerParameters {
    fn default() -> Self {
        Self { left_right_px: 1, min_confidence: 0, sub_pixel: SubPixel::Data }
    }
}

/// The winners of a tile. On a tie the smaller disparity wins.
#[derive(Clone, Copy, Debug)]
struct Winners {
    /// Whole disparities.
    place: Lanes,
    /// By how much the energy rises to the best node more than one disparity away: 2.5 for each
    /// unit; in a cut window less a quarter of the energy. 1 to 255.
    confidence: Lanes,
    /// Disparities in 1/256 px.
    disparity: [u16; LANES],
    /// What they are in the right view: the energy in the upper byte and 255 less the disparity in
    /// the lower. Of equal energies the nearer surface hides the farther one.
    keys: [u16; LANES],
}

impl Winners {
    const NONE: Winners =
        Winners { place: Lanes::ZERO, confidence: Lanes::ZERO, disparity: [0; LANES], keys: [0; LANES] };
}

#[inline(always)]
fn pick<S: Simd>(
    s: S,
    nodes: &[Lanes],
    data: &[Lanes],
    low: usize,
    cuts: [bool; 2],
    sub_pixel: SubPixel,
    winners: &mut Winners,
) {
    let (zero, one) = (s.splat(0), s.splat(1));
    let none = s.splat(u8::MAX);
    let mut best = none;
    let mut place = zero;
    let mut here = zero;
    for node in nodes {
        let node = s.load(node);
        place = s.select_less(node, best, here, place);
        best = s.min(node, best);
        here = s.add(here, one);
    }
    // The winner's neighbours, where it has both, and the best node further away. No lane has its winner
    // or a neighbour of it outside `near`, which is worth knowing where windows are wide.
    let mut near = 0..nodes.len();
    if near.end > NEAR {
        let mut places = Lanes::ZERO;
        s.store(place, &mut places);
        let (first, last) = extent(&places);
        near = usize::from(first).saturating_sub(1)..(usize::from(last) + 2).min(near.end);
    }
    let (left, right) = (s.sub(place, one), s.add(place, one));
    let (mut before, mut after, mut second) = (best, best, none);
    // The same of H.
    let (mut h_before, mut h_here, mut h_after) = (zero, zero, zero);
    for node in &nodes[..near.start] {
        second = s.min(second, s.load(node));
    }
    for node in &nodes[near.end..] {
        second = s.min(second, s.load(node));
    }
    let mut here = s.splat(near.start as u8);
    for (node, data) in nodes[near.clone()].iter().zip(&data[near]) {
        let (node, data) = (s.load(node), s.load(data));
        before = s.select_equal(here, left, node, before);
        after = s.select_equal(here, right, node, after);
        h_before = s.select_equal(here, left, data, h_before);
        h_here = s.select_equal(here, place, data, h_here);
        h_after = s.select_equal(here, right, data, h_after);
        let far = s.select_equal(here, place, none, node);
        let far = s.select_equal(here, left, none, far);
        second = s.min(second, s.select_equal(here, right, none, far));
        here = s.add(here, one);
    }
    let margin = s.sub(second, best);
    let mut confidence = s.add(s.add(margin, margin), s.mean(margin, zero));
    let last = (nodes.len() - 1) as u8;
    // A cut window hides the winner's rivals: a winner of much energy is doubted, and one at the cut
    // is not believed, as what lies beyond may be better.
    if cuts != [false; 2] {
        confidence = s.sub(confidence, s.mean(s.mean(best, zero), zero));
    }
    for (cut, node) in cuts.into_iter().zip([0, last]) {
        if cut {
            confidence = s.select_equal(place, s.splat(node), one, confidence);
        }
    }
    s.store(s.max(confidence, one), &mut winners.confidence);
    // A winner at either end of the window has no place of its own.
    for at_end in [zero, s.splat(last)] {
        before = s.select_equal(place, at_end, best, before);
        after = s.select_equal(place, at_end, best, after);
        h_before = s.select_equal(place, at_end, h_here, h_before);
        h_after = s.select_equal(place, at_end, h_here, h_after);
    }
    s.store(s.add(place, s.splat(low as u8)), &mut winners.place);
    let mut sums = [Lanes::ZERO; 3];
    s.store(before, &mut sums[0]);
    s.store(best, &mut sums[1]);
    s.store(after, &mut sums[2]);
    let mut data = [Lanes::ZERO; 3];
    s.store(h_before, &mut data[0]);
    s.store(h_here, &mut data[1]);
    s.store(h_after, &mut data[2]);
    for lane in 0..LANES {
        let value = |of: &Lanes| f32::from(of.0[lane]);
        // All are read before one is chosen: a choice between two places to read from is no vector operation.
        let [e_before, e_here, e_after] = [value(&sums[0]), value(&sums[1]), value(&sums[2])];
        let [d_before, d_here, d_after] = [value(&data[0]), value(&data[1]), value(&data[2])];
        let by_data = (sub_pixel == SubPixel::Data) & (d_before > d_here) & (d_after > d_here);
        let lean = JUMPS * ((e_before - d_before) - (e_after - d_after));
        let by = |data: f32, energy: f32| if by_data { data } else { energy };
        let part = between(by(d_before, e_before), by(d_here, e_here), by(d_after, e_after), by(lean, 0.0));
        let part = if sub_pixel == SubPixel::None { 0 } else { part };
        let place = winners.place.0[lane];
        winners.disparity[lane] = (i32::from(place) * 256 + part) as u16;
        winners.keys[lane] = u16::from(sums[1].0[lane]) << 8 | u16::from(u8::MAX - place);
    }
}

/// The smallest and the greatest lane.
#[inline(always)]
fn extent(values: &Lanes) -> (u8, u8) {
    values.0.iter().fold((u8::MAX, 0), |(least, most), &v| (least.min(v), most.max(v)))
}

/// Where the winner truly lies, in 1/256 px from its node: where two lines of equal slope through
/// it and its neighbours meet (equiangular fit), at most half a pixel. `lean` is by how much more the
/// jumps of the paths cost before than after: it counts for one side of the fit, so that jumps that
/// cost the same on both sides do not flatten it.
#[inline(always)]
fn between(before: f32, here: f32, after: f32, lean: f32) -> i32 {
    // No number here is NaN: one comparison each, where `max` takes care of them, too.
    let higher = |a: f32, b: f32| if a > b { a } else { b };
    let lower = |a: f32, b: f32| if a < b { a } else { b };
    // At least 1, so that a flat energy gives no place of its own.
    let slope = higher(higher(before, after) - here, 1.0) + lean.abs();
    whole(lower(higher(128.0 * (before - after + lean) / slope, -128.0), 128.0))
}

/// Share of the jumps that [`SubPixel::Data`] takes: less keeps to whole pixels, more to halves.
const JUMPS: f32 = 0.125;

/// Confidence that a difference of the two views takes.
const DISAGREEMENT: u8 = 30;

/// Columns left of the right view: x − d is never below them.
const LEAD: usize = 256;

/// Picks winners row by row, with memory allocated once.
#[derive(Debug)]
pub struct Winner {
    parameters: WinnerParameters,
    level: Level,
    disparities: usize,
    winners: Vec<Winners>,
    /// The right view, [`LEAD`] columns before it: the least key of the winners that land on a pixel.
    right: Vec<u16>,
}

impl Winner {
    /// A workspace for rows of `width` pixels and windows of disparities below `disparities`.
    pub fn new(parameters: WinnerParameters, level: Level, width: usize, disparities: usize) -> Self {
        let tiles = width.div_ceil(LANES);
        Self {
            parameters,
            level,
            disparities,
            winners: vec![Winners::NONE; tiles],
            right: vec![0; LEAD + tiles * LANES],
        }
    }

    /// Bytes that the workspace holds.
    pub fn bytes(&self) -> usize {
        self.winners.len() * size_of::<Winners>() + 2 * self.right.len()
    }

    /// Takes a row of energies and writes its disparities in 1/256 px (0 = unknown: left-right check
    /// failed, outside the right view, or at infinity) and confidences.
    pub fn row(&mut self, row: EnergyRow<'_>, disparity: &mut [u16], confidence: &mut [u8]) {
        take_row(self.level, self, row, disparity, confidence);
    }
}

kernel! {
    fn take_row(winner: &mut Winner, row: EnergyRow<'_>, disparity: &mut [u16], confidence: &mut [u8])
        = take
}

#[inline(always)]
fn take<S: Simd>(
    s: S,
    winner: &mut Winner,
    row: EnergyRow<'_>,
    disparity: &mut [u16],
    confidence: &mut [u8],
) {
    let Winner { parameters, disparities, winners, right, .. } = winner;
    let width = disparity.len();
    right.fill(u16::MAX);
    for (tile, (winners, block)) in winners.iter_mut().zip(row.blocks).enumerate() {
        let cuts = [block.low > 0, block.high < *disparities];
        pick(s, row.nodes(tile), row.data(tile), block.low, cuts, parameters.sub_pixel, winners);
        // Where the tile's lanes land: at LEAD + x − d.
        let x = tile * LANES;
        let landing: &mut [u16; LEAD + LANES] = match (&mut right[x..x + LEAD + LANES]).try_into() {
            Ok(landing) => landing,
            Err(_) => continue,
        };
        for lane in 0..LANES.min(width - x) {
            let seen = &mut landing[LEAD + lane - usize::from(winners.place.0[lane])];
            *seen = winners.keys[lane].min(*seen);
        }
    }
    let (zero, one) = (s.splat(0), s.splat(1));
    let most = s.splat(parameters.left_right_px);
    let least = s.splat(parameters.min_confidence);
    let outputs = disparity.chunks_mut(LANES).zip(confidence.chunks_mut(LANES));
    for (tile, (winners, (disparity, confidence))) in winners.iter().zip(outputs).enumerate() {
        let x = tile * LANES;
        let landing: &[u16; LEAD + LANES] = match (&right[x..x + LEAD + LANES]).try_into() {
            Ok(landing) => landing,
            Err(_) => continue,
        };
        let (mut seen, mut column) = (Lanes::ZERO, Lanes::ZERO);
        for lane in 0..LANES {
            seen.0[lane] = u8::MAX - landing[LEAD + lane - usize::from(winners.place.0[lane])] as u8;
            // Beyond 255 no disparity leaves the image.
            column.0[lane] = (x + lane).min(255) as u8;
        }
        let (place, sure) = (s.load(&winners.place), s.load(&winners.confidence));
        let seen = s.load(&seen);
        let difference = s.max(s.sub(seen, place), s.sub(place, seen));
        let unsure = s.max(s.sub(sure, s.splat(DISAGREEMENT)), one);
        let sure = s.select_equal(difference, zero, sure, unsure);
        // Above zero where anything speaks against the winner.
        let mut doubt = s.sub(difference, most);
        doubt = s.max(doubt, s.sub(place, s.load(&column)));
        doubt = s.max(doubt, s.sub(least, sure));
        doubt = s.max(doubt, s.sub(one, place));
        // An estimate has a confidence of at least 1.
        let mut kept = Lanes::ZERO;
        s.store(s.select_equal(doubt, zero, sure, zero), &mut kept);
        for (((disparity, confidence), &of), &kept) in
            disparity.iter_mut().zip(confidence).zip(&winners.disparity).zip(&kept.0)
        {
            *disparity = if kept > 0 { of } else { 0 };
            *confidence = kept;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::blocks::Block;
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
        let block = |tile| Block { low, high: low + n, at: tile * n * LANES, ..Block::default() };
        ((0..tiles).map(block).collect(), nodes)
    }

    fn run(truth: &[usize], low: usize, n: usize) -> (Vec<u16>, Vec<u8>) {
        let (blocks, nodes) = row_for(truth, low, n);
        // Row 0 of a volume whose blocks have 32 rows each; H is the energy itself.
        let mut volume = vec![Lanes::ZERO; nodes.len() * LANES];
        for (block, nodes) in blocks.iter().zip(nodes.chunks(n)) {
            volume[block.at..block.at + n].copy_from_slice(nodes);
        }
        let mut results = Level::available().into_iter().map(|level| {
            let mut winner = Winner::new(WinnerParameters::default(), level, truth.len(), low + n);
            let (mut disparity, mut confidence) = (vec![1; truth.len()], vec![1; truth.len()]);
            winner.row(EnergyRow::new(0, &blocks, &nodes, &volume), &mut disparity, &mut confidence);
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
        assert!(confidence[7..].iter().all(|&c| c == 100));
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
        assert_eq!(between(20.0, 10.0, 20.0, 0.0), 0);
        assert_eq!(between(30.0, 10.0, 10.0, 0.0), 128);
        assert_eq!(between(15.0, 10.0, 20.0, 0.0), -64);
        assert_eq!(between(10.0, 10.0, 10.0, 0.0), 0);
        assert_eq!(between(20.0, 10.0, 20.0, 10.0), 64);
        assert_eq!(between(10.0, 30.0, 10.0, 100.0), 126);
        // A window that starts or ends at the winner says nothing about either side.
        let (disparity, _) = run(&[9; 40], 9, 4);
        assert!(disparity[9..].iter().all(|&d| d == 9 * 256));
    }
}
