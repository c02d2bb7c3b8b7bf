//! Stixels: in strips of a few columns, vertical runs of similar disparity above the road.

use super::step;
use crate::depth::DepthView;
use crate::road::heights::{BATCH, PixelBatch};
use crate::road::surface::{CandidateFilter, RoadSurface};
use crate::simd::{Level, Simd, kernel};

/// Image columns per strip.
pub const STRIP_COLUMNS: usize = 4;
/// Largest number of stixels in a strip.
const MAX_STIXELS_PER_STRIP: usize = 12;
/// Rows of a strip, or columns of an edge, that are processed as one group.
const GROUP_SIZE: usize = 8;
/// Rows that are transposed as one block.
const TRANSPOSED_ROWS: usize = 16;
/// Columns over which the gradient at a depth edge is measured.
const EDGE_COLUMNS: usize = 4;
/// Smallest disparity that the map can tell from none, in px.
const MIN_DISPARITY_PX: f32 = 1.0 / 256.0;
/// Largest number of consecutive rows without an estimate inside a stixel.
const MAX_GAP_ROWS: usize = 10;

/// A vertical run in one strip with almost constant disparity, above the road.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stixel {
    /// Index of the strip.
    pub strip: u32,
    /// First row, from the top.
    pub top: u16,
    /// Last row.
    pub bottom: u16,
    /// Number of rows with an estimate.
    pub rows: u16,
    /// Mean disparity, in px; refined where there are images.
    pub disparity_px: f32,
    /// Mean confidence, 0 to 255.
    pub confidence: f32,
    /// Height of the first row above the road, in metres, as the map has it.
    pub high_m: f32,
    /// Height of the last row above the road, in metres, as the map has it.
    pub low_m: f32,
}

/// Parameters of stixel extraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StixelParameters {
    /// Smallest height above the road, in metres; the noise of the frame may raise it (`sigmas`).
    pub min_height_m: f64,
    /// Smallest height of a row above the road, in standard deviations of the height noise.
    pub sigmas: f64,
    /// Smallest difference to the disparity of the road in the row, in px.
    pub min_rise_px: f64,
    /// Largest height above the road, in metres; anything higher does not obstruct the vehicle.
    pub max_height_m: f64,
    /// Smallest disparity (largest distance) to search, in px.
    pub min_disparity_px: f64,
    /// Smallest confidence of a pixel, 0 to 255.
    pub min_confidence: u8,
    /// Largest change of disparity per column on one surface, in px.
    pub max_gradient_px: f64,
}

/// Stixels of a frame; memory is allocated once.
#[derive(Debug)]
pub struct Stixels {
    /// Disparity by strip and row, in 1/256 px; 0 = unknown.
    depths: Vec<u16>,
    /// Confidence by strip and row.
    confidence: Vec<u8>,
    /// One row of the map with sharpened depth edges, and padding.
    sharp: Vec<u16>,
    /// Disparities and confidences of a block of rows before transposition.
    rows: (Vec<u16>, Vec<u8>),
    /// Start of depth edges in a row.
    edges: Vec<u8>,
    /// Candidate rows of a strip.
    candidates: Vec<u8>,
    strips: usize,
    height: usize,
    level: Level,
    /// Rows of a stixel under construction, from the bottom up.
    run: Vec<RunRow>,
    list: Vec<Stixel>,
    /// Index of the first stixel of each strip in the list, and the length of the list.
    starts: Vec<u32>,
}

impl Stixels {
    /// A workspace for maps of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        let strips = width.div_ceil(STRIP_COLUMNS);
        Self {
            depths: vec![0; strips * height],
            confidence: vec![0; strips * height],
            sharp: vec![0; width + GROUP_SIZE],
            rows: (vec![0; strips * TRANSPOSED_ROWS], vec![0; strips * TRANSPOSED_ROWS]),
            edges: vec![0; width],
            candidates: vec![0; height],
            strips,
            height,
            level: Level::best(),
            run: Vec::with_capacity(height),
            list: Vec::with_capacity(strips * (MAX_STIXELS_PER_STRIP + 1)),
            starts: vec![0; strips + 1],
        }
    }

    /// Largest possible number of stixels.
    pub fn capacity(&self) -> usize {
        self.strips * (MAX_STIXELS_PER_STRIP + 1)
    }

    /// SIMD level of the kernels.
    pub(super) fn level(&self) -> Level {
        self.level
    }

    /// Number of strips in the image.
    pub fn strips(&self) -> usize {
        self.strips
    }

    /// Number of rows of the image.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All stixels, strip by strip, from the bottom.
    pub fn list(&self) -> &[Stixel] {
        &self.list
    }

    /// Range of the stixels of a strip in [`Stixels::list`].
    pub fn range(&self, strip: usize) -> std::ops::Range<usize> {
        self.starts[strip] as usize..self.starts[strip + 1] as usize
    }

    /// Disparities of a strip, row by row from the top, in 1/256 px, refined in the rows of stixels; 0 = unknown.
    pub fn depths(&self, strip: usize) -> &[u16] {
        &self.depths[strip * self.height..(strip + 1) * self.height]
    }

    /// Centre column of a strip.
    pub fn column(strip: usize) -> f64 {
        (strip * STRIP_COLUMNS) as f64 + 0.5 * (STRIP_COLUMNS - 1) as f64
    }

    /// Extracts the stixels of a map.
    ///
    /// # Panics
    /// When the size of the map differs from that of the workspace.
    pub fn find(&mut self, depth: DepthView<'_>, surface: &RoadSurface, parameters: &StixelParameters) {
        assert_eq!((depth.width().div_ceil(STRIP_COLUMNS), depth.height()), (self.strips, self.height));
        let max_difference =
            (parameters.max_gradient_px * (256 * EDGE_COLUMNS) as f64).clamp(1.0, 65_535.0) as u16;
        for first in (0..self.height).step_by(TRANSPOSED_ROWS) {
            let rows = TRANSPOSED_ROWS.min(self.height - first);
            let (depths, means) = (&mut self.rows.0, &mut self.rows.1);
            let strip_rows = depths.chunks_exact_mut(self.strips).zip(means.chunks_exact_mut(self.strips));
            for (y, (depths, means)) in (first..first + rows).zip(strip_rows) {
                let (d, c) = (depth.disparity(y), depth.confidence(y));
                sharpen_edges(self.level, d, max_difference, &mut self.edges, &mut self.sharp);
                let sharp = &self.sharp[..d.len()];
                strip_medians(self.level, sharp, c, parameters.min_confidence, depths, means);
            }
            // Transpose: strips become contiguous.
            for strip in 0..self.strips {
                let range = strip * self.height + first..strip * self.height + first + rows;
                let (d, c) = (&mut self.depths[range.clone()], &mut self.confidence[range]);
                let below = self.rows.0[strip..].iter().step_by(self.strips);
                d.iter_mut().zip(below).for_each(|(d, from)| *d = *from);
                let below = self.rows.1[strip..].iter().step_by(self.strips);
                c.iter_mut().zip(below).for_each(|(c, from)| *c = *from);
            }
        }
        self.list.clear();
        for strip in 0..self.strips {
            self.starts[strip] = self.list.len() as u32;
            self.find_in(strip, surface, parameters);
        }
        self.starts[self.strips] = self.list.len() as u32;
    }

    /// Changes the disparity of a stixel, by its index in [`Stixels::list`], and those of the rows that belong to it, by so many px; both stay
    /// above 0. Heights stay as the map has them.
    pub(super) fn shift(&mut self, index: usize, by_px: f32, is_of_it: impl Fn(u16) -> bool) {
        let stixel = &mut self.list[index];
        stixel.disparity_px = (stixel.disparity_px + by_px).max(MIN_DISPARITY_PX);
        let by = (256.0 * by_px).round() as i16;
        let first = stixel.strip as usize * self.height;
        let rows = first + usize::from(stixel.top)..=first + usize::from(stixel.bottom);
        let of_it = self.depths[rows].iter_mut().filter(|depth| is_of_it(**depth));
        of_it.for_each(|depth| *depth = depth.saturating_add_signed(by).max(1));
    }

    fn find_in(&mut self, strip: usize, surface: &RoadSurface, parameters: &StixelParameters) {
        let x = Self::column(strip);
        let first = self.list.len();
        let range = strip * self.height..(strip + 1) * self.height;
        let (depths, confidence) = (&self.depths[range.clone()], &self.confidence[range]);
        self.run.clear();
        let mut last_px = 0.0;
        // Fast preselection: most near pixels are road, most far pixels are too high.
        let p = parameters;
        let filter = CandidateFilter {
            min_disparity: (p.min_disparity_px * 256.0).max(1.0) as u16,
            min_rise_px: p.min_rise_px,
            max_height_m: p.max_height_m,
        };
        surface.find_candidates(x, depths, filter, &mut self.candidates);
        let mut pixels = PixelBatch::default();
        let mut heights_m = [0.0; BATCH];
        let mut end = self.height;
        while end > 0 {
            pixels.clear();
            while end > 0 && pixels.count() + GROUP_SIZE <= BATCH {
                let rows = end.saturating_sub(GROUP_SIZE)..end;
                end = rows.start;
                // Most groups contain no candidate and are skipped as a whole.
                if self.candidates[rows.clone()].first_chunk() != Some(&[0; GROUP_SIZE]) {
                    for y in rows.rev() {
                        pixels.push(x as f32, y as f32, depths[y], self.candidates[y] > 0);
                    }
                }
            }
            surface.heights_m(&pixels, &mut heights_m);
            for (i, &height) in heights_m.iter().enumerate().take(pixels.count()) {
                let (y, d) = (pixels.y_px[i] as usize, pixels.disparity[i]);
                // This form of the comparison rejects NaN.
                if !(height >= p.min_height_m && height <= p.max_height_m)
                    || height < p.sigmas * surface.height_noise_m(f64::from(d) / 256.0)
                {
                    continue;
                }
                let px = f32::from(d) / 256.0;
                if !self.run.last().is_some_and(|row| row.leads_to(y, px, last_px, surface.noise_px())) {
                    push_run(&self.run, strip, surface, first, &mut self.list);
                    self.run.clear();
                    last_px = px;
                }
                last_px += (px - last_px) * 0.3;
                self.run.push(RunRow {
                    y: y as u16,
                    depth: d,
                    confidence: confidence[y],
                    height_m: height as f32,
                });
            }
        }
        push_run(&self.run, strip, surface, first, &mut self.list);
    }
}

/// A row of a run.
#[derive(Clone, Copy, Debug)]
struct RunRow {
    y: u16,
    depth: u16,
    confidence: u8,
    height_m: f32,
}

impl RunRow {
    /// Whether row `y` continues the run that has this row at its upper end and the smoothed disparity `last_px`: close to it and at a similar
    /// disparity.
    fn leads_to(&self, y: usize, px: f32, last_px: f32, noise_px: f64) -> bool {
        let tolerance = 0.25 + 2.0 * (noise_px as f32).min(0.12) + 0.01 * px;
        usize::from(self.y) - y <= MAX_GAP_ROWS && (px - last_px).abs() <= tolerance
    }
}

/// Adds the stixels of a run of rows, from the bottom up: one, or those between the steps in depth; of the strip, whose stixels begin at
/// `first` in the list, at most [`MAX_STIXELS_PER_STRIP`].
fn push_run(rows: &[RunRow], strip: usize, surface: &RoadSurface, first: usize, list: &mut Vec<Stixel>) {
    if let Some(at) =
        step::find(rows.iter().map(|row| row.depth), surface.noise_px(), |px| surface.distance_m(px))
    {
        push_run(&rows[..at], strip, surface, first, list);
        push_run(&rows[at..], strip, surface, first, list);
    } else if let [bottom, .., top] = rows
        && list.len() - first < MAX_STIXELS_PER_STRIP
    {
        let sum: u64 = rows.iter().map(|row| u64::from(row.depth)).sum();
        let confidence: u32 = rows.iter().map(|row| u32::from(row.confidence)).sum();
        list.push(Stixel {
            strip: strip as u32,
            top: top.y,
            bottom: bottom.y,
            rows: rows.len() as u16,
            disparity_px: (sum as f64 / rows.len() as f64 / 256.0) as f32,
            confidence: confidence as f32 / rows.len() as f32,
            low_m: bottom.height_m,
            high_m: top.height_m,
        });
    }
}

kernel! {
    /// Sharpens depth edges: assigns each pixel between two surfaces to the one that is closer in disparity.
    /// A matcher smooths a step; over a few columns its disparity changes more than on any surface.
    /// `max_difference` is the largest change on one surface over [`EDGE_COLUMNS`] columns, in 1/256 px;
    /// `out` is longer than the row by [`GROUP_SIZE`].
    fn sharpen_edges(row: &[u16], max_difference: u16, edges: &mut [u8], out: &mut [u16]) = sharpen_edges_row
}

#[inline(always)]
fn sharpen_edges_row<S: Simd>(_: S, row: &[u16], max_difference: u16, edges: &mut [u8], out: &mut [u16]) {
    out[..row.len()].copy_from_slice(row);
    let Some(after) = row.get(EDGE_COLUMNS..) else { return };
    // Marks the start of a rising (1) or falling (2) edge in each column; 0 for none.
    let edges = &mut edges[..after.len()];
    for ((&a, &b), edge) in row.iter().zip(after).zip(edges.iter_mut()) {
        let is_edge = (a > 0) & (b > 0) & (a.abs_diff(b) >= max_difference);
        let direction = if b > a { 1_u16 } else { 2 };
        *edge = (if is_edge { direction } else { 0 }) as u8;
    }
    let bytes = |x: usize| edges[x..].first_chunk().map(|chunk| u64::from_le_bytes(*chunk));
    let zeros = |bytes: u64| (bytes.trailing_zeros() / u8::BITS) as usize;
    let mut x = 0;
    while x < edges.len() {
        // Most columns have no edge; runs of them are skipped.
        if let Some(bytes) = bytes(x)
            && bytes as u8 == 0
        {
            x += zeros(bytes);
            continue;
        }
        if edges[x] == 0 {
            x += 1;
            continue;
        }
        let run = bytes(x).map_or(1, |bytes| zeros(bytes ^ u64::from_ne_bytes([edges[x]; GROUP_SIZE])));
        let more = edges[x + run..].iter().take_while(|step| **step == edges[x]).count();
        let end = x + run + more - 1 + EDGE_COLUMNS;
        let (a, b) = (row[x], row[end]);
        for first in (x + 1..end).step_by(GROUP_SIZE) {
            let group = &mut out[first..][..GROUP_SIZE];
            let inside = (end - first).min(GROUP_SIZE) as u16;
            for (i, d) in group.iter_mut().enumerate() {
                let side = if d.abs_diff(a) <= d.abs_diff(b) { a } else { b };
                *d = if (*d > 0) & ((i as u16) < inside) { side } else { *d };
            }
        }
        x = end;
    }
}

kernel! {
    /// Median disparity and mean confidence of each strip of a row.
    fn strip_medians(
        row: &[u16],
        confidence: &[u8],
        min_confidence: u8,
        depths: &mut [u16],
        means: &mut [u8],
    ) = strip_medians_row
}

#[inline(always)]
fn strip_medians_row<S: Simd>(
    _: S,
    row: &[u16],
    confidence: &[u8],
    min_confidence: u8,
    depths: &mut [u16],
    means: &mut [u8],
) {
    let (whole, rest) = row.as_chunks::<STRIP_COLUMNS>();
    let (whole_confidence, rest_confidence) = confidence.as_chunks::<STRIP_COLUMNS>();
    for (((row, confidence), depth), mean) in
        whole.iter().zip(whole_confidence).zip(depths.iter_mut()).zip(means.iter_mut())
    {
        (*depth, *mean) = strip_median(*row, *confidence, min_confidence);
    }
    if let (false, Some(depth), Some(mean)) = (rest.is_empty(), depths.last_mut(), means.last_mut()) {
        let (mut row, mut confidence) = ([0; STRIP_COLUMNS], [0; STRIP_COLUMNS]);
        row[..rest.len()].copy_from_slice(rest);
        confidence[..rest_confidence.len()].copy_from_slice(rest_confidence);
        (*depth, *mean) = strip_median(row, confidence, min_confidence);
    }
}

/// Median of the known disparities of a strip (at least two; for an even number the mean of the middle two)
/// and their mean confidence. Branch-free, so that it vectorises over strips.
#[inline(always)]
fn strip_median(
    columns: [u16; STRIP_COLUMNS],
    confidence: [u8; STRIP_COLUMNS],
    min_confidence: u8,
) -> (u16, u8) {
    // 16-bit arithmetic, for as many strips per vector as possible.
    let confidence = confidence.map(u16::from);
    let threshold = u16::from(min_confidence);
    let known = |i: usize| if (columns[i] > 0) & (confidence[i] >= threshold) { u16::MAX } else { 0 };
    let known = [known(0), known(1), known(2), known(3)];
    let depth = |i: usize| columns[i] & known[i];
    let known_confidence = |i: usize| confidence[i] & known[i];
    let count = known.iter().fold(0_u16, |count, known| count.wrapping_sub(*known));
    let sum = known_confidence(0) + known_confidence(1) + known_confidence(2) + known_confidence(3);
    // Sorting network; unknown values come first.
    let (a, b) = (depth(0).min(depth(1)), depth(0).max(depth(1)));
    let (c, d) = (depth(2).min(depth(3)), depth(2).max(depth(3)));
    let (first, last) = (a.min(c), b.max(d));
    let (x, y) = (a.max(c), b.min(d));
    let (second, third) = (x.min(y), x.max(y));
    let low = if first > 0 { second } else { third };
    let high = if second == 0 { last } else { third };
    let third_of = (((u32::from(sum) * 43_691) >> 16) as u16) >> 1;
    let mean = if count < 2 { sum } else { sum >> 1 };
    let mean = if count == 3 { third_of } else { mean };
    let mean = if count == 4 { sum >> 2 } else { mean };
    let depth = (low & high) + ((low ^ high) >> 1);
    (if third == 0 { 0 } else { depth }, mean as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    #[test]
    fn a_depth_edge_becomes_a_step_at_its_middle() {
        let sharp = |row: &[u16]| {
            let results = Level::available().into_iter().map(|level| {
                let (mut out, mut edges) = (vec![0; row.len() + GROUP_SIZE], vec![0; row.len()]);
                sharpen_edges(level, row, 200, &mut edges, &mut out);
                out.truncate(row.len());
                out
            });
            let results: Vec<_> = results.collect();
            assert!(results.windows(2).all(|two| two[0] == two[1]), "{results:?}");
            results.into_iter().next().unwrap()
        };
        let ramp = [500, 500, 500, 600, 700, 800, 900, 1000, 1000, 1000, 1000, 1000, 1000];
        let step = [500, 500, 500, 500, 500, 1000, 1000, 1000, 1000, 1000, 1000, 1000, 1000];
        let (out, back) = (sharp(&ramp), sharp(&ramp.map(|d| 1500 - d)));
        // The centre value, 750, lies between two columns.
        assert_eq!(out, step);
        assert_eq!(back, step.map(|d| 1500 - d));
        // A slanted side is unchanged, and so are unknown pixels, at any alignment of the groups.
        let side: Vec<u16> = (0..100).map(|x| 1000 + 40 * x).collect();
        assert_eq!(sharp(&side), side);
        for at in 0..60 {
            let mut row = vec![500; at];
            row.extend_from_slice(&ramp);
            row[at + 4] = 0;
            let mut expected = vec![500; at];
            expected.extend_from_slice(&step);
            expected[at + 4] = 0;
            row.resize(90, 1000);
            expected.resize(90, 1000);
            assert_eq!(sharp(&row), expected, "{at}");
        }
        assert_eq!(sharp(&[7, 900]), [7, 900], "too narrow to tell");
    }

    #[test]
    fn a_stixel_is_shifted_with_those_of_its_rows_that_are_of_it() {
        let mut stixels = Stixels::new(32, 40);
        stixels.depths.fill(666);
        stixels.depths[4 * 40 + 9] = 0;
        stixels.depths[4 * 40 + 12..4 * 40 + 20].fill(300);
        let stixel =
            |strip: u32| Stixel { strip, top: 5, bottom: 34, disparity_px: 2.6, ..Stixel::default() };
        stixels.list.extend([stixel(4), stixel(5)]);
        stixels.shift(0, 0.25, |depth| depth > 600);
        assert_eq!([0, 1].map(|i| stixels.list[i].disparity_px), [2.85, 2.6]);
        let rows = stixels.depths(4);
        assert_eq!([4, 5, 9, 12, 19, 34, 35].map(|y| rows[y]), [666, 730, 0, 300, 300, 730, 666]);
        assert_eq!(stixels.depths(5), &[666; 40][..]);
        // However far it is shifted, it is known.
        stixels.shift(0, -100.0, |depth| depth > 0);
        assert_eq!((stixels.depths(4)[5], stixels.list[0].disparity_px), (1, MIN_DISPARITY_PX));
    }

    #[test]
    fn a_run_is_divided_where_the_wall_behind_a_person_begins() {
        let rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 320.0, cy_px: 240.0 };
        let surface = RoadSurface::new(rig, 640, 480, 64);
        // From the bottom up: a person 1.8 m high, 23 m ahead, before a wall 28 m ahead.
        let row = |i: u16| {
            let depth = if i < 40 { 1664 } else { 1370 };
            RunRow { y: 300 - i, depth, confidence: 200, height_m: 0.046 * f32::from(i) }
        };
        let rows: Vec<RunRow> = (0..65).map(row).collect();
        let mut list = vec![Stixel::default()];
        push_run(&rows, 7, &surface, 1, &mut list);
        let [_, person, wall] = list[..] else { panic!("{list:?}") };
        assert_eq!((person.strip, person.bottom, person.top, person.rows), (7, 300, 261, 40));
        assert_eq!((wall.strip, wall.bottom, wall.top, wall.rows), (7, 260, 236, 25));
        assert_eq!((person.disparity_px, wall.disparity_px), (6.5, 5.3515625));
        assert!((person.high_m - 1.794).abs() < 1e-3 && (wall.low_m - 1.84).abs() < 1e-3);
        push_run(&rows[..1], 7, &surface, 1, &mut list);
        assert_eq!(list.len(), 3, "a row is no stixel");
        push_run(&rows[..20], 7, &surface, 1, &mut list);
        assert_eq!(list.len(), 4, "nor has it a step");
        // A tree 40 m ahead above the wall.
        let tree = |i: u16| RunRow { y: 235 - i, depth: 960, confidence: 200, height_m: 3.0 };
        let rows: Vec<RunRow> = rows.iter().copied().chain((0..200).map(tree)).collect();
        list.truncate(1);
        push_run(&rows, 7, &surface, 1, &mut list);
        assert_eq!(list[1..].iter().map(|stixel| stixel.rows).collect::<Vec<_>>(), [40, 25, 200]);
        list.resize(MAX_STIXELS_PER_STRIP, Stixel::default());
        push_run(&rows, 7, &surface, 1, &mut list);
        assert_eq!(
            (list.len(), list[MAX_STIXELS_PER_STRIP].rows),
            (MAX_STIXELS_PER_STRIP + 1, 40),
            "no more"
        );
    }

    #[test]
    fn a_strip_has_the_median_of_its_known_disparities() {
        let median = |columns: &[u16], confidence: &[u8]| {
            let mut expected = None;
            for level in Level::available() {
                let (mut depth, mut mean) = ([0], [0]);
                let confidence = &confidence[..columns.len()];
                strip_medians(level, columns, confidence, 100, &mut depth, &mut mean);
                assert_eq!(*expected.get_or_insert((depth[0], mean[0])), (depth[0], mean[0]), "{level:?}");
            }
            expected.unwrap()
        };
        let depth = |columns: &[u16]| median(columns, &[200; 4]).0;
        assert_eq!(depth(&[0, 0, 0, 9]), 0);
        assert_eq!(depth(&[4, 0, 0, 8]), 6);
        assert_eq!(depth(&[4, 0, 100, 8]), 8);
        assert_eq!(depth(&[4, 6, 100, 8]), 7);
        assert_eq!(depth(&[4, 6]), 5);
        assert_eq!(depth(&[4]), 0);
        assert_eq!(median(&[4, 6, 100, 8], &[110, 120, 99, 130]), (6, 120), "one has low confidence");
    }

    #[test]
    fn all_levels_give_the_medians_of_the_reference() {
        let mut random = fastrand::Rng::with_seed(3);
        for length in [1, 4, 63, 640, 1242] {
            // Few distinct values, so that unknown and equal ones occur.
            let row: Vec<u16> = (0..length).map(|_| random.u16(..6) * random.u16(..13_107)).collect();
            let confidence: Vec<u8> = (0..length).map(|_| random.u8(..)).collect();
            let strips = row.len().div_ceil(STRIP_COLUMNS);
            let expected: Vec<(u16, u8)> = (row.chunks(STRIP_COLUMNS).zip(confidence.chunks(STRIP_COLUMNS)))
                .map(|(row, confidence)| {
                    let known = || row.iter().zip(confidence).filter(|(d, c)| **d > 0 && **c >= 100);
                    let mut depths: Vec<u16> = known().map(|(d, _)| *d).collect();
                    depths.sort_unstable();
                    let depth = match depths[..] {
                        [a, b] | [_, a, b, _] => a.midpoint(b),
                        [_, b, _] => b,
                        _ => 0,
                    };
                    let sum: u32 = known().map(|(_, c)| u32::from(*c)).sum();
                    (depth, (sum / depths.len().max(1) as u32) as u8)
                })
                .collect();
            for level in Level::available() {
                let (mut depths, mut means) = (vec![0; strips], vec![0; strips]);
                strip_medians(level, &row, &confidence, 100, &mut depths, &mut means);
                let given: Vec<(u16, u8)> = depths.into_iter().zip(means).collect();
                assert_eq!(given, expected, "{level:?}, {length}");
            }
        }
    }
}
