//! What stands in each narrow strip of columns: runs of rows of one depth above the road (stixels).

use super::depth::DepthView;
use super::surface::Surface;

/// Image columns of a strip.
pub const STRIP_COLUMNS: usize = 4;
/// The most runs of a strip.
const RUNS: usize = 12;
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
}

/// The stixels of a frame, with memory allocated once.
#[derive(Debug)]
pub struct Stixels {
    /// Disparity by strip and row, in 1/256 px; 0 = unknown.
    depths: Vec<u16>,
    /// Confidence of each.
    confidence: Vec<u8>,
    strips: usize,
    height: usize,
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
            strips,
            height,
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
        for y in 0..self.height {
            let columns = depth.disparity(y).chunks(STRIP_COLUMNS);
            for (strip, (columns, confidence)) in
                columns.zip(depth.confidence(y).chunks(STRIP_COLUMNS)).enumerate()
            {
                let place = strip * self.height + y;
                (self.depths[place], self.confidence[place]) =
                    middle(columns, confidence, parameters.least_confidence);
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
            let height = surface.height_m(x, y as f64, px);
            let standing = parameters.least_height_m.max(parameters.sigmas * surface.height_noise_m(px));
            // Written so that NaN is left out.
            if !(height >= standing && height <= parameters.greatest_height_m)
                || surface.rise_px(x, y, px) < parameters.least_rise_px
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
        let tolerance = 0.25 + 3.0 * (noise_px as f32).min(0.12) + 0.01 * px;
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
        self.last_px += (px - self.last_px) * 0.4;
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

/// What the columns of a strip agree on: the median of those that are known well enough, two at least;
/// of an even number the mean of the middle two. With it, their mean confidence.
#[inline]
fn middle(columns: &[u16], confidence: &[u8], least_confidence: u8) -> (u16, u8) {
    let mut sorted = [0; STRIP_COLUMNS];
    let (mut count, mut sum) = (0, 0);
    for ((place, &d), &c) in sorted.iter_mut().zip(columns).zip(confidence) {
        let known = d > 0 && c >= least_confidence;
        *place = if known { d } else { 0 };
        count += u16::from(known);
        sum += if known { u16::from(c) } else { 0 };
    }
    // Unknown ones come first.
    sorted.sort_unstable();
    let depth = match sorted {
        [0, 0, 0, _] => 0,
        [0, 0, a, b] | [_, a, b, _] if sorted[0] > 0 || sorted[1] == 0 => a.midpoint(b),
        [_, _, median, _] => median,
    };
    (depth, (sum / count.max(1)) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strip_is_the_median_of_what_is_known() {
        let depth = |columns: &[u16]| middle(columns, &[200; 4], 100).0;
        assert_eq!(depth(&[0, 0, 0, 9]), 0);
        assert_eq!(depth(&[4, 0, 0, 8]), 6);
        assert_eq!(depth(&[4, 0, 100, 8]), 8);
        assert_eq!(depth(&[4, 6, 100, 8]), 7);
        assert_eq!(depth(&[4, 6]), 5);
        assert_eq!(depth(&[4]), 0);
        assert_eq!(middle(&[4, 6, 100, 8], &[110, 120, 99, 130], 100), (6, 120), "one is not believed");
    }
}
