//! Winner-take-all: selects the disparity of least energy, refines it to sub-pixel precision, and computes its
//! confidence and the left-right consistency check.

use super::energy::EnergyRow;
use super::viterbi::NEAR;
use crate::simd::rounding::truncate;
use crate::simd::{LANES, Lanes, Level, Simd, kernel};

/// Parameters of winner selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WinnerParameters {
    /// Maximum difference between the disparities of the left and the right view, in pixels; 255 disables
    /// the left-right check.
    pub left_right_px: u8,
    /// Minimum confidence of a winner; below it the pixel is unknown.
    pub min_confidence: u8,
    /// Method of sub-pixel refinement.
    pub sub_pixel: SubPixel,
}

/// Method of sub-pixel refinement. The jump costs of the paths pull a surface to the integer disparity that
/// most of it has. The larger their weight, the smaller the noise of an estimate and the larger its
/// pixel-locking bias.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SubPixel {
    /// No refinement: integer disparities.
    None,
    /// Fit to the final energies.
    Energy,
    /// Fit to H where the winner is a minimum of H as well, plus a share of the asymmetry of the six paths'
    /// jump costs; fit to the final energies elsewhere.
    Data,
}

impl Default for WinnerParameters {
    fn default() -> Self {
        Self { left_right_px: 1, min_confidence: 0, sub_pixel: SubPixel::Data }
    }
}

/// The winners of a tile. Of equal energies the smaller disparity wins.
#[derive(Clone, Copy, Debug)]
struct Winners {
    /// Integer disparities.
    place: Lanes,
    /// 2.5 times the energy difference to the best node more than one disparity away; in a truncated window
    /// minus a quarter of the winner's energy. 1 to 255.
    confidence: Lanes,
    /// Disparities in 1/256 px.
    disparity: [u16; LANES],
    /// Sort keys for the right view: the energy in the upper byte, 255 − disparity in the lower byte. Of
    /// equal energies the nearer surface occludes the farther one.
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
    // The neighbours of the winner, where it has both, and the best node further away. In all lanes the
    // winner and its neighbours lie within `near`; in wide windows this saves time.
    let mut near = 0..nodes.len();
    if near.end > NEAR {
        let mut places = Lanes::ZERO;
        s.store(place, &mut places);
        let (first, last) = extent(&places);
        near = usize::from(first).saturating_sub(1)..(usize::from(last) + 2).min(near.end);
    }
    let (left, right) = (s.sub(place, one), s.add(place, one));
    let (mut before, mut after, mut second) = (best, best, none);
    // The same values of H.
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
    // A truncated window excludes competing nodes. A winner of high energy gets less confidence, and a
    // winner at the truncated end the minimum, as nodes beyond it may be better.
    if cuts != [false; 2] {
        confidence = s.sub(confidence, s.mean(s.mean(best, zero), zero));
    }
    for (cut, node) in cuts.into_iter().zip([0, last]) {
        if cut {
            confidence = s.select_equal(place, s.splat(node), one, confidence);
        }
    }
    s.store(s.max(confidence, one), &mut winners.confidence);
    // A winner at either end of the window gets no sub-pixel offset.
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
        // Read all values before selecting: a selection between two load addresses does not vectorise.
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

/// Minimum and maximum over all lanes.
#[inline(always)]
fn extent(values: &Lanes) -> (u8, u8) {
    values.0.iter().fold((u8::MAX, 0), |(least, most), &v| (least.min(v), most.max(v)))
}

/// Sub-pixel offset of the winner in 1/256 px: the intersection of two lines of equal slope through the winner
/// and its neighbours (equiangular fit), at most half a pixel. `lean` is the difference between the paths'
/// jump costs before and after the winner. It is added to one side of the fit only, so that jump costs that
/// are equal on both sides do not flatten the fit.
#[inline(always)]
fn between(before: f32, here: f32, after: f32, lean: f32) -> i32 {
    // No value here is NaN, so one comparison is enough; `f32::max` would also handle NaN.
    let higher = |a: f32, b: f32| if a > b { a } else { b };
    let lower = |a: f32, b: f32| if a < b { a } else { b };
    // At least 1, so that a flat energy gives no offset.
    let slope = higher(higher(before, after) - here, 1.0) + lean.abs();
    truncate(lower(higher(128.0 * (before - after + lean) / slope, -128.0), 128.0))
}

/// Share of the jump costs that [`SubPixel::Data`] uses: a smaller share locks to whole pixels, a larger one to
/// half pixels.
const JUMPS: f32 = 0.125;

/// Confidence that a winner loses when the two views differ.
const DISAGREEMENT: u8 = 30;

/// Border columns left of the right view: x − d never lies before them.
const LEAD: usize = 256;

/// The number of each lane.
const COUNTING: Lanes = {
    let mut lanes = Lanes::ZERO;
    let mut lane = 0;
    while lane < LANES {
        lanes.0[lane] = lane as u8;
        lane += 1;
    }
    lanes
};

/// Selects winners row by row, with memory allocated once.
#[derive(Debug)]
pub struct Winner {
    parameters: WinnerParameters,
    level: Level,
    disparities: usize,
    winners: Vec<Winners>,
    /// The right view with [`LEAD`] border columns: the smallest key of the winners that project to a pixel.
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

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.winners.len() * size_of::<Winners>() + 2 * self.right.len()
    }

    /// Writes the disparities in 1/256 px and the confidences of a row of energies. A disparity is 0
    /// (unknown) if the left-right check failed, or the point lies outside the right view or at infinity.
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
        // The tile's lanes project to column LEAD + x − d.
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
        let mut seen = Lanes::ZERO;
        for lane in 0..LANES {
            seen.0[lane] = u8::MAX - landing[LEAD + lane - usize::from(winners.place.0[lane])] as u8;
        }
        // Saturated: from column 255 on every disparity stays within the image.
        let column = s.add(s.splat(x.min(255) as u8), s.load(&COUNTING));
        let (place, sure) = (s.load(&winners.place), s.load(&winners.confidence));
        let seen = s.load(&seen);
        let difference = s.max(s.sub(seen, place), s.sub(place, seen));
        let unsure = s.max(s.sub(sure, s.splat(DISAGREEMENT)), one);
        let sure = s.select_equal(difference, zero, sure, unsure);
        // Greater than zero where any test rejects the winner.
        let mut doubt = s.sub(difference, most);
        doubt = s.max(doubt, s.sub(place, column));
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

    /// A row whose pixel x has its minimum energy at `truth[x]`, in windows of `n` disparities from `low` on.
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
        // Row 0 of a volume whose blocks have 32 rows each; H equals the energy.
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
        // A near object from column 30 on occludes the background next to its left edge in the right view.
        let truth: Vec<usize> = (0..64).map(|x| if x >= 30 { 12 } else { 2 }).collect();
        let (disparity, _) = run(&truth, 0, 16);
        assert!(disparity[20..30].iter().all(|&d| d == 0), "{disparity:?}");
        assert_eq!(disparity[19], 2 * 256);
        assert_eq!(disparity[40], 12 * 256);
    }

    #[test]
    fn the_sub_pixel_offset_points_to_the_lower_side() {
        assert_eq!(between(20.0, 10.0, 20.0, 0.0), 0);
        assert_eq!(between(30.0, 10.0, 10.0, 0.0), 128);
        assert_eq!(between(15.0, 10.0, 20.0, 0.0), -64);
        assert_eq!(between(10.0, 10.0, 10.0, 0.0), 0);
        assert_eq!(between(20.0, 10.0, 20.0, 10.0), 64);
        assert_eq!(between(10.0, 30.0, 10.0, 100.0), 126);
        // No offset where the window starts or ends at the winner.
        let (disparity, _) = run(&[9; 40], 9, 4);
        assert!(disparity[9..].iter().all(|&d| d == 9 * 256));
    }
}
