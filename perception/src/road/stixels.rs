//! What stands in each narrow strip of columns: runs of rows of one depth above the road (stixels).

use super::depth::DepthView;
use super::surface::Surface;
use crate::simd::{Level, Simd, kernel};

/// Image columns of a strip.
pub const STRIP_COLUMNS: usize = 4;
/// The most runs of a strip.
const RUNS: usize = 12;
/// Columns over which the steepness of a seam is told.
const SEAM_COLUMNS: usize = 4;
/// Rows without an estimate that a run may span.
const GAP: usize = 10;

/// A run of rows in one strip whose disparity hardly changes, above the road.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stixel {
    /// The strip.
    pub strip: u32,
    /// First row, from above.
    pub top: u16,
    /// Last row.
    pub bottom: u16,
    /// Rows with an estimate.
    pub rows: u16,
    /// Mean disparity, in px.
    pub disparity_px: f32,
    /// Mean confidence, 0 to 255.
    pub confidence: f32,
    /// Height of the first row above the road, in metres.
    pub high_m: f32,
    /// Height of the last row above the road, in metres.
    pub low_m: f32,
}

/// What makes a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StixelParameters {
    /// What reaches less than this above the road is road, in metres; more where the noise of the
    /// frame asks for it.
    pub least_height_m: f64,
    /// Standard deviations of the noise that a row must be above the road.
    pub sigmas: f64,
    /// Disparity by which a row must be nearer than the road that the row shows, in px.
    pub least_rise_px: f64,
    /// What begins higher than this above the road is not in the way, in metres.
    pub greatest_height_m: f64,
    /// Nothing is looked for farther away, in px of disparity.
    pub least_disparity_px: f64,
    /// Pixels of less confidence are left out.
    pub least_confidence: u8,
    /// The most that the disparity of a surface changes from column to column, in px.
    pub steepest_px: f64,
}

/// The stixels of a frame, with memory allocated once.
#[derive(Debug)]
pub struct Stixels {
    /// Disparity by strip and row, in 1/256 px; 0 = unknown.
    depths: Vec<u16>,
    /// Confidence of each.
    confidence: Vec<u8>,
    /// One row of the map with sharp seams.
    sharp: Vec<u16>,
    /// One row of both.
    row: (Vec<u16>, Vec<u8>),
    strips: usize,
    height: usize,
    level: Level,
    list: Vec<Stixel>,
    /// Where the stixels of each strip begin in the list; one more for the end.
    starts: Vec<u32>,
}

impl Stixels {
    /// A workspace for maps of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        let strips = width.div_ceil(STRIP_COLUMNS);
        Self {
            depths: vec![0; strips * height],
            confidence: vec![0; strips * height],
            sharp: vec![0; width],
            row: (vec![0; strips], vec![0; strips]),
            strips,
            height,
            level: Level::best(),
            list: Vec::with_capacity(strips * (RUNS + 1)),
            starts: vec![0; strips + 1],
        }
    }

    /// The most stixels that there may be.
    pub fn capacity(&self) -> usize {
        self.strips * (RUNS + 1)
    }

    /// Strips of the image.
    pub fn strips(&self) -> usize {
        self.strips
    }

    /// All stixels, strip by strip, from below.
    pub fn list(&self) -> &[Stixel] {
        &self.list
    }

    /// Where those of a strip lie in the list.
    pub fn of(&self, strip: usize) -> std::ops::Range<usize> {
        self.starts[strip] as usize..self.starts[strip + 1] as usize
    }

    /// Disparities of a strip, row by row from above, in 1/256 px; 0 = unknown.
    pub fn depths(&self, strip: usize) -> &[u16] {
        &self.depths[strip * self.height..(strip + 1) * self.height]
    }

    /// Middle column of a strip.
    pub fn column(strip: usize) -> f64 {
        (strip * STRIP_COLUMNS) as f64 + 0.5 * (STRIP_COLUMNS - 1) as f64
    }

    /// Finds what stands on the road.
    ///
    /// # Panics
    /// When the map has another size than the workspace.
    pub fn find(&mut self, depth: DepthView<'_>, surface: &Surface, parameters: &StixelParameters) {
        assert_eq!((depth.width().div_ceil(STRIP_COLUMNS), depth.height()), (self.strips, self.height));
        let steepest = (parameters.steepest_px * (256 * SEAM_COLUMNS) as f64).clamp(1.0, 65_535.0) as u16;
        for y in 0..self.height {
            let (depths, confidence) = (&mut self.row.0, &mut self.row.1);
            let (d, c) = (depth.disparity(y), depth.confidence(y));
            sharpen(d, steepest, &mut self.sharp);
            middles(self.level, &self.sharp, c, parameters.least_confidence, depths, confidence);
            let places = (y..).step_by(self.height);
            for (place, (&d, &c)) in places.zip(depths.iter().zip(confidence.iter())) {
                (self.depths[place], self.confidence[place]) = (d, c);
            }
        }
        self.list.clear();
        for strip in 0..self.strips {
            self.starts[strip] = self.list.len() as u32;
            self.find_in(strip, surface, parameters);
        }
        self.starts[self.strips] = self.list.len() as u32;
    }

    fn find_in(&mut self, strip: usize, surface: &Surface, parameters: &StixelParameters) {
        let x = Self::column(strip);
        let places = strip * self.height..(strip + 1) * self.height;
        let (depths, confidence) = (&self.depths[places.clone()], &self.confidence[places]);
        let least = (parameters.least_disparity_px * 256.0).max(1.0) as u16;
        let mut run = Run::default();
        let mut found = 0;
        for (y, &d) in depths.iter().enumerate().rev() {
            if d < least {
                continue;
            }
            let px = f64::from(d) / 256.0;
            // The quickest test first: most of what is near is road.
            if surface.rise_px(x, y, px) < parameters.least_rise_px {
                continue;
            }
            let height = surface.height_m(x, y as f64, px);
            // Written so that NaN is left out.
            if !(height >= parameters.least_height_m && height <= parameters.greatest_height_m)
                || height < parameters.sigmas * surface.height_noise_m(px)
            {
                continue;
            }
            if !run.takes(y, d, surface.noise_px()) {
                if let Some(stixel) = run.end(strip)
                    && found < RUNS
                {
                    self.list.push(stixel);
                    found += 1;
                }
                run = Run::default();
            }
            run.add(y, d, confidence[y], height as f32);
        }
        if let Some(stixel) = run.end(strip)
            && found < RUNS
        {
            self.list.push(stixel);
        }
    }
}

/// A run that grows upwards.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    top: usize,
    bottom: usize,
    rows: u32,
    sum: u64,
    confidence: u32,
    /// Smoothed disparity of the last rows, in px.
    last_px: f32,
    low_m: f32,
    high_m: f32,
}

impl Run {
    /// Whether row `y` goes on with the run: near it, and of its depth.
    fn takes(&self, y: usize, d: u16, noise_px: f64) -> bool {
        let px = f32::from(d) / 256.0;
        let tolerance = 0.25 + 2.0 * (noise_px as f32).min(0.12) + 0.01 * px;
        self.rows == 0 || (self.top - y <= GAP && (px - self.last_px).abs() <= tolerance)
    }

    fn add(&mut self, y: usize, d: u16, confidence: u8, height_m: f32) {
        let px = f32::from(d) / 256.0;
        if self.rows == 0 {
            *self = Run { bottom: y, last_px: px, low_m: height_m, ..Run::default() };
        }
        self.top = y;
        self.rows += 1;
        self.sum += u64::from(d);
        self.confidence += u32::from(confidence);
        self.last_px += (px - self.last_px) * 0.3;
        self.high_m = height_m;
    }

    fn end(&self, strip: usize) -> Option<Stixel> {
        (self.rows >= 2).then(|| Stixel {
            strip: strip as u32,
            top: self.top as u16,
            bottom: self.bottom as u16,
            rows: self.rows as u16,
            disparity_px: (self.sum as f64 / f64::from(self.rows) / 256.0) as f32,
            confidence: self.confidence as f32 / self.rows as f32,
            low_m: self.low_m,
            high_m: self.high_m,
        })
    }
}

/// Gives each pixel of a seam between two surfaces to the one that is nearer in disparity. A matcher smooths
/// what is a step: over a few columns, its map rises more steeply than any surface does. `steepest` is the most
/// that a surface rises over [`SEAM_COLUMNS`], in 1/256 px.
fn sharpen(row: &[u16], steepest: u16, out: &mut [u16]) {
    out.copy_from_slice(row);
    let after = row.get(SEAM_COLUMNS..).unwrap_or_default();
    let steep = |x: usize| row[x] > 0 && after[x] > 0 && row[x].abs_diff(after[x]) >= steepest;
    let mut x = 0;
    while x < after.len() {
        // Most chunks have no seam, and a whole one is told at once.
        let chunk = row[x..].iter().zip(&after[x..]).take(32);
        if chunk.fold(false, |any, (a, b)| any | (a.abs_diff(*b) >= steepest)) {
            let end = (x + 32).min(after.len());
            while x < end {
                if !steep(x) {
                    x += 1;
                    continue;
                }
                let rises = after[x] > row[x];
                let mut last = x;
                while last + 1 < after.len() && steep(last + 1) && (after[last + 1] > row[last + 1]) == rises
                {
                    last += 1;
                }
                let (first, end) = (x, last + SEAM_COLUMNS);
                let (a, b) = (row[first], row[end]);
                for d in out[first + 1..end].iter_mut().filter(|d| **d > 0) {
                    *d = if d.abs_diff(a) <= d.abs_diff(b) { a } else { b };
                }
                x = end;
            }
        } else {
            x += 32;
        }
    }
}

kernel! {
    /// The middle of each strip of a row of disparities and confidences.
    fn middles(
        row: &[u16],
        confidence: &[u8],
        least_confidence: u8,
        depths: &mut [u16],
        means: &mut [u8],
    ) = every_middle
}

#[inline(always)]
fn every_middle<S: Simd>(
    _: S,
    row: &[u16],
    confidence: &[u8],
    least_confidence: u8,
    depths: &mut [u16],
    means: &mut [u8],
) {
    let (whole, rest) = row.as_chunks::<STRIP_COLUMNS>();
    let (sure, doubt) = confidence.as_chunks::<STRIP_COLUMNS>();
    for (((row, sure), depth), mean) in whole.iter().zip(sure).zip(depths.iter_mut()).zip(means.iter_mut()) {
        (*depth, *mean) = middle(*row, *sure, least_confidence);
    }
    if let (false, Some(depth), Some(mean)) = (rest.is_empty(), depths.last_mut(), means.last_mut()) {
        let (mut row, mut sure) = ([0; STRIP_COLUMNS], [0; STRIP_COLUMNS]);
        row[..rest.len()].copy_from_slice(rest);
        sure[..doubt.len()].copy_from_slice(doubt);
        (*depth, *mean) = middle(row, sure, least_confidence);
    }
}

/// What the columns of a strip agree on: the median of those that are known well enough, two at least;
/// of an even number the mean of the middle two. With it, their mean confidence. Without branches, so
/// that it is done for many strips at once.
#[inline(always)]
fn middle(columns: [u16; STRIP_COLUMNS], confidence: [u8; STRIP_COLUMNS], least_confidence: u8) -> (u16, u8) {
    let known = |i: usize| columns[i] > 0 && confidence[i] >= least_confidence;
    let depth = |i: usize| if known(i) { columns[i] } else { 0 };
    let sure = |i: usize| if known(i) { u16::from(confidence[i]) } else { 0 };
    let count = u16::from(known(0)) + u16::from(known(1)) + u16::from(known(2)) + u16::from(known(3));
    let sum = sure(0) + sure(1) + sure(2) + sure(3);
    // Sorted; unknown ones come first.
    let (a, b) = (depth(0).min(depth(1)), depth(0).max(depth(1)));
    let (c, d) = (depth(2).min(depth(3)), depth(2).max(depth(3)));
    let (first, last) = (a.min(c), b.max(d));
    let (x, y) = (a.max(c), b.min(d));
    let (second, third) = (x.min(y), x.max(y));
    let low = if first > 0 { second } else { third };
    let high = if second == 0 { last } else { third };
    let mean = match count {
        0 | 1 => sum,
        2 => sum / 2,
        3 => ((u32::from(sum) * 43_691) >> 17) as u16,
        _ => sum / 4,
    };
    let depth = (low & high) + ((low ^ high) >> 1);
    (if third == 0 { 0 } else { depth }, mean as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seam_is_a_step_at_its_middle() {
        let sharp = |row: &[u16]| {
            let mut out = vec![0; row.len()];
            sharpen(row, 200, &mut out);
            out
        };
        let ramp = [500, 500, 500, 600, 700, 800, 900, 1000, 1000, 1000, 1000, 1000, 1000];
        let step = [500, 500, 500, 500, 500, 1000, 1000, 1000, 1000, 1000, 1000, 1000, 1000];
        let (out, back) = (sharp(&ramp), sharp(&ramp.map(|d| 1500 - d)));
        // The middle itself, 750, lies between two columns.
        assert_eq!(out, step);
        assert_eq!(back, step.map(|d| 1500 - d));
        // A side that is seen at an angle stays, and so does what is unknown, wherever chunks begin.
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
    fn a_strip_is_the_median_of_what_is_known() {
        let middle = |columns: &[u16], confidence: &[u8]| {
            let mut expected = None;
            for level in Level::available() {
                let (mut depth, mut mean) = ([0], [0]);
                let confidence = &confidence[..columns.len()];
                middles(level, columns, confidence, 100, &mut depth, &mut mean);
                assert_eq!(*expected.get_or_insert((depth[0], mean[0])), (depth[0], mean[0]), "{level:?}");
            }
            expected.unwrap()
        };
        let depth = |columns: &[u16]| middle(columns, &[200; 4]).0;
        assert_eq!(depth(&[0, 0, 0, 9]), 0);
        assert_eq!(depth(&[4, 0, 0, 8]), 6);
        assert_eq!(depth(&[4, 0, 100, 8]), 8);
        assert_eq!(depth(&[4, 6, 100, 8]), 7);
        assert_eq!(depth(&[4, 6]), 5);
        assert_eq!(depth(&[4]), 0);
        assert_eq!(middle(&[4, 6, 100, 8], &[110, 120, 99, 130]), (6, 120), "one is not believed");
    }

    #[test]
    fn all_levels_give_the_middles_that_sorting_gives() {
        let mut random = fastrand::Rng::with_seed(3);
        for length in [1, 4, 63, 640, 1242] {
            // Few values, so that unknown and equal ones occur.
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
                middles(level, &row, &confidence, 100, &mut depths, &mut means);
                let given: Vec<(u16, u8)> = depths.into_iter().zip(means).collect();
                assert_eq!(given, expected, "{level:?}, {length}");
            }
        }
    }
}
