//! Search windows: the disparity range of each block of 32 × 32 pixels and the expected slope of its surface
//! (paper, section 3.4).
//!
//! At the coarsest scale, and for the full-range matcher, every window is the whole range. At finer
//! scales the window of a block spans the disparities of the coarser map in and around the block. A block
//! that contains two surfaces therefore searches both, and a block on a single surface has a small window.

use super::crew::both_if;
use super::disparity::DisparityView;
use crate::simd::{LANES, Level, Simd, kernel};

/// Edge length of a block in pixels.
pub const BLOCK: usize = LANES;
/// Granularity of window sizes, in disparities.
const GRAIN: usize = 2;
/// Margin of a window on each side of the disparities of the coarser map.
const MARGIN: usize = 2;
/// Border around a block that contributes to its window, in pixels of its own scale.
const AROUND: usize = 6;
/// Distance over which slopes are measured, in pixels of the coarser map.
const SLOPE_BASE: usize = 4;
/// Maximum step of a slope; larger steps are depth edges: 0.6 px per pixel, in 1/256 px over [`SLOPE_BASE`].
const EDGE: i32 = 614;
/// Gain, in tenths, that compensates for the flattening of slopes by smoothing.
const GAIN: i32 = 11;
/// Edge length of the cells over which slopes are summed first, in pixels of the coarser map.
const CELL: usize = 8;
/// Minimum number of measurements for a slope.
const MIN_MEASURES: i32 = 32;

/// The search window of one block and the slope of its surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Block {
    /// The window's first disparity.
    pub low: usize,
    /// One after its last.
    pub high: usize,
    /// Index of its first vector in the volume; its rows are [`Self::pitch`] vectors apart.
    pub at: usize,
    /// Expected change of disparity per pixel to the right, in 1/256 px.
    pub slope_x: i32,
    /// Expected change of disparity per pixel downwards, in 1/256 px.
    pub slope_y: i32,
}

impl Block {
    /// Number of disparities in the window.
    pub fn span(&self) -> usize {
        self.high - self.low
    }

    /// Vectors between consecutive rows of the block in the volume. Multiples of 1024 bytes are avoided, because
    /// they would map to few cache sets.
    pub fn pitch(&self) -> usize {
        pitch(self.span())
    }

    /// Vectors that the block takes in the volume.
    pub fn vectors(&self) -> usize {
        self.pitch() * BLOCK
    }

    /// The window as (first disparity, one after the last).
    pub fn window(&self) -> (usize, usize) {
        (self.low, self.high)
    }
}

/// See [`Block::pitch`].
pub(super) fn pitch(span: usize) -> usize {
    if span.is_multiple_of(32) { span + 2 } else { span }
}

/// What a pixel costs whatever its window, in nodes: its row is prepared for the cost, for one.
const PIXEL_WORK: usize = 8;

/// Pixels of the coarser map that are converted together.
const CHUNK: usize = 32;

/// Slope sums of a cell: (sum, count) rightwards and downwards.
type Cell = [(i32, i32); 2];

/// The blocks of an image.
#[derive(Debug)]
pub struct Blocks {
    width: usize,
    height: usize,
    tiles: usize,
    strips: usize,
    disparities: usize,
    list: Vec<Block>,
    nodes: usize,
    /// Pixels with each disparity of an area, for the upper and the lower half of the strips.
    histograms: [Vec<u32>; 2],
    /// The coarser map in integer disparities of this scale, with holes filled from the farther side.
    seeds: Vec<u8>,
    cells: Vec<Cell>,
}

impl Blocks {
    /// Blocks for `width` × `height` pixels that all search the full range of `disparities`.
    pub fn new(width: usize, height: usize, disparities: usize) -> Self {
        let (tiles, strips) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        let mut blocks = Self {
            width,
            height,
            tiles,
            strips,
            disparities,
            list: vec![Block::default(); tiles * strips],
            nodes: 0,
            histograms: [vec![0; 256], vec![0; 256]],
            seeds: Vec::new(),
            cells: Vec::new(),
        };
        blocks.list.iter_mut().for_each(|b| b.high = disparities);
        blocks.lay_out();
        blocks
    }

    /// Allocates memory for planning from coarser maps of `width` × `height`, so that planning does not allocate.
    pub fn reserve(&mut self, width: usize, height: usize) {
        self.seeds = vec![0; width * height];
        self.cells = vec![Cell::default(); width.div_ceil(CELL) * height.div_ceil(CELL)];
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.list.len() * size_of::<Block>() + self.seeds.len() + self.cells.len() * size_of::<Cell>() + 2048
    }

    /// Width and height of the image in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Columns of blocks.
    pub fn tiles(&self) -> usize {
        self.tiles
    }

    /// Rows of blocks.
    pub fn strips(&self) -> usize {
        self.strips
    }

    /// Number of disparities of the scale, searched or not.
    pub fn disparities(&self) -> usize {
        self.disparities
    }

    /// The blocks of a strip, from left to right.
    pub fn strip(&self, strip: usize) -> &[Block] {
        &self.list[strip * self.tiles..(strip + 1) * self.tiles]
    }

    /// First vector of a strip in the volume; of the strip after the last one, the end of the volume.
    pub(super) fn start(&self, strip: usize) -> usize {
        self.list.get(strip * self.tiles).map_or(self.vectors(), |block| block.at)
    }

    /// The strip above which about half of the work lies.
    pub(super) fn middle(&self) -> usize {
        let work = |strip: usize| self.start(strip) + strip * self.tiles * BLOCK * PIXEL_WORK;
        let half = work(self.strips) / 2;
        (0..=self.strips).min_by_key(|&strip| work(strip).abs_diff(half)).unwrap_or(0)
    }

    /// Size of the volume of all blocks, in vectors.
    pub fn vectors(&self) -> usize {
        self.list.last().map_or(0, |b| b.at + b.vectors())
    }

    /// Number of nodes of the image's pixels: the paper's m·n·d.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Minimum size of the volume of planned blocks, in vectors: every window has its minimum size.
    pub fn min_vectors(&self) -> usize {
        self.tiles * self.strips * BLOCK * pitch(GRAIN.min(self.disparities))
    }

    /// Sets windows and slopes directly.
    #[cfg(test)]
    pub fn set_all(&mut self, set: impl FnMut(&mut Block)) {
        self.list.iter_mut().for_each(set);
        self.lay_out();
    }

    /// Assigns the blocks their positions in the volume.
    fn lay_out(&mut self) {
        let mut at = 0;
        self.nodes = 0;
        for (i, block) in self.list.iter_mut().enumerate() {
            block.at = at;
            at += block.vectors();
            let columns = BLOCK.min(self.width - i % self.tiles * BLOCK);
            let rows = BLOCK.min(self.height - i / self.tiles * BLOCK);
            self.nodes += columns * rows * block.span();
        }
    }

    /// Sets slopes and windows from the map of the next coarser scale (half the size). `windows` gives the
    /// maximum number of disparities of a window and the budget of vectors for all windows, which must be at
    /// least [`Self::min_vectors`]; with `None` the windows are kept. With `share`, the calling thread belongs to a
    /// [`Crew`](super::crew::Crew), and another thread takes a part of the work.
    pub fn plan(
        &mut self,
        level: Level,
        coarse: DisparityView<'_>,
        slopes: bool,
        windows: Option<(usize, usize)>,
        share: bool,
    ) {
        let (seeds, most) = (&mut self.seeds, self.disparities.saturating_sub(1).min(255) as u32);
        let seed = || {
            if windows.is_some() {
                fill_seeds(seeds, most, coarse);
            }
        };
        let (cells, list, tiles) = (&mut self.cells, &mut self.list, self.tiles);
        let measure = || {
            if slopes {
                measure_slopes(cells, list, tiles, level, coarse);
            }
        };
        both_if(share, seed, measure);
        if let Some((widest, vectors)) = windows {
            let mut widest = widest.next_multiple_of(GRAIN);
            self.set_windows(level, coarse.width(), coarse.height(), widest, share);
            self.lay_out();
            if self.vectors() > vectors {
                // Over budget: limit the widest windows further, and place them where most disparities lie.
                while widest > GRAIN && self.vectors_within(widest) > vectors {
                    widest -= GRAIN;
                }
                self.set_windows(level, coarse.width(), coarse.height(), widest, share);
                self.lay_out();
            }
        }
    }

    /// Size of the volume in vectors if windows had at most `widest` disparities.
    fn vectors_within(&self, widest: usize) -> usize {
        self.list.iter().map(|block| pitch(block.span().min(widest)) * BLOCK).sum()
    }

    fn set_windows(
        &mut self,
        level: Level,
        coarse_width: usize,
        coarse_height: usize,
        widest: usize,
        share: bool,
    ) {
        let Self { disparities, tiles, seeds, list, histograms: [above, below], .. } = self;
        let (disparities, tiles, seeds) = (*disparities, *tiles, &seeds[..]);
        let set = |first: usize, list: &mut [Block], histogram: &mut [u32]| {
            for (i, block) in list.iter_mut().enumerate() {
                let (strip, tile) = (first + i / tiles, i % tiles);
                let top = (strip * BLOCK).saturating_sub(AROUND) / 2;
                let bottom = (((strip + 1) * BLOCK + AROUND) / 2).min(coarse_height);
                let left = (tile * BLOCK).saturating_sub(AROUND) / 2;
                let right = (((tile + 1) * BLOCK + AROUND) / 2).min(coarse_width);
                let rows = top..bottom.max(top + 1).min(coarse_height);
                let rows = rows.map(|y| &seeds[y * coarse_width + left..y * coarse_width + right]);
                let mut ends = Ends::NONE;
                rows.clone().for_each(|row| find_ends(level, row, &mut ends));
                let mut most = |from: usize, to: usize, inner: usize| {
                    histogram.fill(0);
                    rows.clone().flatten().for_each(|&seed| histogram[usize::from(seed)] += 1);
                    fullest(histogram, from, to, inner)
                };
                (block.low, block.high) = window(ends, widest, disparities, &mut most);
            }
        };
        let half = list.len() / tiles / 2;
        let (upper, lower) = list.split_at_mut(half * tiles);
        both_if(share, || set(0, upper, above), || set(half, lower, below));
    }
}

/// The coarser map in integer disparities of this scale, at most `most`. Holes get the smaller disparity of their two
/// neighbours in the row, because occluded points lie on the farther surface. Rows without any estimate
/// stay 0.
fn fill_seeds(seeds: &mut Vec<u8>, most: u32, coarse: DisparityView<'_>) {
    let width = coarse.width();
    seeds.resize(width * coarse.height(), 0);
    let whole = |d: u16| ((u32::from(d) + 64) >> 7).min(most).max(1) as u8;
    for (y, seeds) in seeds.chunks_exact_mut(width).enumerate() {
        let row = coarse.row(y);
        let mut x = 0;
        let mut before = 0_u8;
        while x < width {
            // Most pixels lie in no hole: whole chunks of such pixels are converted together.
            if let (Some(known), Some(seeds)) = (row.get(x..x + CHUNK), seeds.get_mut(x..x + CHUNK))
                && known.iter().fold(true, |all, &d| all & (d > 0))
            {
                seeds.iter_mut().zip(known).for_each(|(seed, &d)| *seed = whole(d));
                before = seeds[CHUNK - 1];
                x += CHUNK;
                continue;
            }
            if row[x] > 0 {
                before = whole(row[x]);
                seeds[x] = before;
                x += 1;
                continue;
            }
            let hole = x;
            while x < width && row[x] == 0 {
                x += 1;
            }
            let after = if x < width { whole(row[x]) } else { before };
            let farther = if before == 0 { after } else { before.min(after) };
            seeds[hole..x].fill(farther);
        }
    }
}

fn measure_slopes(
    cells: &mut Vec<Cell>,
    list: &mut [Block],
    tiles: usize,
    level: Level,
    coarse: DisparityView<'_>,
) {
    let (width, height) = (coarse.width(), coarse.height());
    let across = width.div_ceil(CELL);
    cells.clear();
    cells.resize(across * height.div_ceil(CELL), Cell::default());
    // Every other row is enough.
    for y in (0..height).step_by(2) {
        let cells = &mut cells[y / CELL * across..][..across];
        let row = coarse.row(y);
        if width > SLOPE_BASE {
            sum_steps(level, &row[..width - SLOPE_BASE], &row[SLOPE_BASE..], 0, cells);
        }
        if y + SLOPE_BASE < height {
            sum_steps(level, row, coarse.row(y + SLOPE_BASE), 1, cells);
        }
    }
    let beside = |first: usize, cells_there: usize| {
        // The cells of the block and one more on each side.
        let start = (first * BLOCK / 2 / CELL).saturating_sub(1);
        start..(((first + 1) * BLOCK / 2).div_ceil(CELL) + 1).min(cells_there)
    };
    for (i, block) in list.iter_mut().enumerate() {
        let mut total = Cell::default();
        for y in beside(i / tiles, height.div_ceil(CELL)) {
            for cell in &cells[y * across..][beside(i % tiles, across)] {
                for way in 0..2 {
                    total[way] = (total[way].0 + cell[way].0, total[way].1 + cell[way].1);
                }
            }
        }
        let slope = |(sum, count): (i32, i32)| {
            if count < MIN_MEASURES {
                return 0;
            }
            (sum * GAIN / (SLOPE_BASE as i32 * count * 10)).clamp(-128, 128)
        };
        (block.slope_x, block.slope_y) = (slope(total[0]), slope(total[1]));
    }
}

/// Sums up the steps between two rows of disparities in cells of [`CELL`] columns. Depth edges and steps next to
/// a hole are excluded.
#[inline(always)]
fn sum_of_steps<S: Simd>(_: S, from: &[u16], to: &[u16], way: usize, cells: &mut [Cell]) {
    for ((from, to), cell) in from.chunks(CELL).zip(to.chunks(CELL)).zip(cells) {
        let (mut sum, mut count) = (0, 0);
        for (&from, &to) in from.iter().zip(to) {
            let step = i32::from(to) - i32::from(from);
            let counts = from > 0 && to > 0 && step.abs() < EDGE;
            sum += if counts { step } else { 0 };
            count += i32::from(counts);
        }
        cell[way] = (cell[way].0 + sum, cell[way].1 + count);
    }
}

/// Minimum and maximum disparity of an area; `min_less_one` > `most` where the area has no estimate.
#[derive(Clone, Copy, Debug)]
struct Ends {
    /// Minimum minus one, wrapping, so that 0 (unknown) becomes the maximum of the type.
    min_less_one: u8,
    most: u8,
}

impl Ends {
    const NONE: Ends = Ends { min_less_one: u8::MAX, most: 0 };
}

#[inline(always)]
fn ends_of<S: Simd>(_: S, row: &[u8], ends: &mut Ends) {
    for &seed in row {
        ends.min_less_one = ends.min_less_one.min(seed.wrapping_sub(1));
        ends.most = ends.most.max(seed);
    }
}

kernel! { fn sum_steps(from: &[u16], to: &[u16], way: usize, cells: &mut [Cell]) = sum_of_steps }
kernel! { fn find_ends(row: &[u8], ends: &mut Ends) = ends_of }

/// Start of the range of `inner` disparities that contains most pixels; the start lies from `from` to `to`.
fn fullest(histogram: &[u32], from: usize, to: usize, inner: usize) -> usize {
    let count = |start: usize| -> u32 { histogram[start..(start + inner).min(histogram.len())].iter().sum() };
    (from..=to).rev().max_by_key(|&start| count(start)).unwrap_or(from)
}

/// The window that spans the disparities of an area with a margin, limited to `widest`. If the limit applies,
/// the window is placed where most disparities lie: `most(first, last, length)` returns the start of the
/// range of `length` disparities that contains most pixels. Without any estimate the window starts at 0.
fn window(
    ends: Ends,
    widest: usize,
    disparities: usize,
    most: &mut dyn FnMut(usize, usize, usize) -> usize,
) -> (usize, usize) {
    if ends.most == 0 {
        return (0, disparities.min(widest));
    }
    let (first, last) = (usize::from(ends.min_less_one) + 1, usize::from(ends.most));
    let need = (last - first + 2 * MARGIN + 1).next_multiple_of(GRAIN);
    let span = need.min(widest).min(disparities);
    let inner = span.saturating_sub(2 * MARGIN).max(1);
    let middle_twice =
        if last - first < inner { first + last } else { 2 * most(first, last, inner) + inner - 1 };
    let low = ((middle_twice + 1).saturating_sub(span) / 2).min(disparities - span);
    (low, low + span)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::Crew;

    #[test]
    fn a_window_spans_the_observed_disparities() {
        let window_of = |seen: &[(usize, u32)], widest, disparities| {
            let mut histogram = [0; 256];
            seen.iter().for_each(|&(d, n)| histogram[d] = n);
            let row: Vec<u8> = seen.iter().map(|&(d, _)| d as u8).collect();
            let mut ends = Ends::NONE;
            find_ends(Level::best(), &row, &mut ends);
            window(ends, widest, disparities, &mut |from, to, inner| fullest(&histogram, from, to, inner))
        };
        let surfaces = [(0, 7), (40, 100), (50, 100)];
        let (low, high) = window_of(&surfaces, 64, 128);
        assert!(low <= 38 && high > 52, "{low}..{high} misses a surface");
        assert_eq!(high - low, 16);
        let narrow = window_of(&surfaces, 8, 128);
        assert_eq!(narrow.1 - narrow.0, 8);
        assert_eq!(window_of(&[(0, 9)], 64, 32), (0, 32));
        let (low, high) = window_of(&[(1, 1000), (40, 100), (50, 100)], 16, 128);
        assert!(low == 0 && high == 16, "{low}..{high}: most pixels are at 1");
        for disparities in 2..20 {
            let last = disparities - 1;
            let (low, high) = window_of(&[(1, 1000), (last, 100)], 64, disparities);
            assert!(low <= 1 && last < high && high <= disparities);
        }
    }

    #[test]
    fn planned_blocks_follow_the_coarser_map_within_their_budget() {
        let (width, height) = (150, 90);
        let (w, h) = (75, 45);
        // A slope of half a pixel rightwards and a quarter downwards, in 1/256 px.
        let map: Vec<u16> = (0..w * h).map(|i| (5 * 256 + (i % w) * 100 + (i / w) * 64) as u16).collect();
        let coarse = DisparityView::new(&map, w, h).unwrap();
        let mut blocks = Blocks::new(width, height, 128);
        blocks.reserve(w, h);
        assert_eq!(blocks.nodes(), width * height * 128);
        blocks.plan(Level::best(), coarse, true, Some((64, usize::MAX)), false);
        let mut next = 0;
        for strip in 0..blocks.strips() {
            for (tile, block) in blocks.strip(strip).iter().enumerate() {
                assert_eq!(block.at, next);
                next += block.vectors();
                let right = (tile * 32 + 31).min(width - 1);
                let bottom = (strip * 32 + 31).min(height - 1);
                for (x, y) in [(tile * 32, strip * 32), (right, bottom)] {
                    let d = 2 * usize::from(map[y / 2 * w + x / 2]) / 256;
                    assert!(block.low <= d && d < block.high, "{d} not in {block:?}");
                }
                assert!((block.slope_x - 110).abs() <= 1, "{block:?}");
                assert!((block.slope_y - 70).abs() <= 1, "{block:?}");
            }
        }
        assert_eq!(next, blocks.vectors());
        // Two threads plan the same.
        let alone = blocks.list.clone();
        let crew = Crew::new(2, |_| ()).unwrap();
        blocks.set_all(|block| *block = Block { high: 128, ..Block::default() });
        crew.lead(|| blocks.plan(Level::best(), coarse, true, Some((64, usize::MAX)), true));
        assert_eq!(blocks.list, alone);
        let budget = blocks.min_vectors() * 2;
        blocks.plan(Level::best(), coarse, true, Some((64, budget)), false);
        assert!(blocks.vectors() <= budget);
        // Planning of slopes alone keeps the windows.
        let mut full = Blocks::new(width, height, 128);
        full.plan(Level::best(), coarse, true, None, false);
        assert!(full.strip(0).iter().all(|b| b.window() == (0, 128) && b.slope_x == 110));
        // A map without any estimate: windows have the maximum size.
        let nothing = vec![0; w * h];
        full.plan(
            Level::best(),
            DisparityView::new(&nothing, w, h).unwrap(),
            true,
            Some((64, usize::MAX)),
            false,
        );
        assert!(full.strip(0).iter().all(|b| b.window() == (0, 64) && b.slope_x == 0));
    }
}
