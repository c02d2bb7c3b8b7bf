//! Fills holes of a disparity map: small holes within one surface by interpolation, and on request all
//! remaining holes, with seams along the edges of the image.

use super::crew::both;
use crate::image::GreyView;
use std::ops::Range;

/// Parameters of hole interpolation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeParameters {
    /// Maximum width of an interpolated hole along a row or a column, in pixels; 0 leaves all holes.
    pub widest_px: u16,
    /// Maximum difference of the disparities on both sides, in 1/256 px.
    pub step: u16,
}

impl Default for BridgeParameters {
    fn default() -> Self {
        Self { widest_px: 24, step: 5 * 256 }
    }
}

/// Fills holes in maps of one width.
#[derive(Clone, Copy, Debug)]
pub struct Fill {
    parameters: BridgeParameters,
    width: usize,
    threads: usize,
}

impl Fill {
    /// A filler for maps of `width` columns. More than one thread needs a [`Crew`](super::crew::Crew).
    pub fn new(parameters: BridgeParameters, width: usize, threads: usize) -> Self {
        Self { parameters, width, threads: threads.max(1) }
    }

    /// Interpolates holes linearly between both sides, along rows first, then along columns. Filled pixels
    /// get a quarter of the lower confidence of both sides, at least 1.
    pub fn bridge(&self, disparity: &mut [u16], confidence: &mut [u8]) {
        let (width, height) = (self.width, disparity.len() / self.width);
        let widest = usize::from(self.parameters.widest_px);
        if widest == 0 {
            return;
        }
        if self.threads == 1 {
            self.bridge_rows(disparity, confidence);
            self.bridge_columns(disparity, confidence, 1..height);
            return;
        }
        let cut = height / 2;
        let (upper, lower) = disparity.split_at_mut(cut * width);
        let (upper_confidence, lower_confidence) = confidence.split_at_mut(cut * width);
        let half = |disparity: &mut [u16], confidence: &mut [u8]| {
            self.bridge_rows(disparity, confidence);
            let rows = disparity.len() / width;
            self.bridge_columns(disparity, confidence, 1..rows);
        };
        both(|| half(upper, upper_confidence), || half(lower, lower_confidence));
        // Holes that cross the cut, which neither half has filled.
        self.bridge_columns(disparity, confidence, cut.saturating_sub(widest).max(1)..(cut + 1).min(height));
    }

    fn bridge_rows(&self, disparity: &mut [u16], confidence: &mut [u8]) {
        let (width, step) = (self.width, self.parameters.step);
        let widest = usize::from(self.parameters.widest_px);
        for (disparity, confidence) in
            disparity.chunks_exact_mut(width).zip(confidence.chunks_exact_mut(width))
        {
            for_holes(disparity, |disparity, start, end| {
                if start == 0 || end == width || end - start > widest {
                    return;
                }
                let (a, b) = (disparity[start - 1], disparity[end]);
                if a.abs_diff(b) <= step {
                    let lower = confidence[start - 1].min(confidence[end]) / 4;
                    for x in start..end {
                        disparity[x] = between(a, b, x + 1 - start, end + 1 - start);
                        confidence[x] = lower.max(1);
                    }
                }
            });
        }
    }

    /// Interpolates the holes that begin in one of `rows`. Each hole depends only on the pixels at both ends of it.
    fn bridge_columns(&self, disparity: &mut [u16], confidence: &mut [u8], rows: Range<usize>) {
        let (width, step) = (self.width, self.parameters.step);
        let widest = usize::from(self.parameters.widest_px);
        let height = disparity.len() / width;
        for y in rows {
            let mut x = 0;
            while let Some(start) = next_below(&disparity[(y - 1) * width..(y + 1) * width], x) {
                x = start;
                let above = (y - 1) * width + x;
                let a = disparity[above];
                let below = (y + 1..height.min(y + widest + 1)).find(|row| disparity[row * width + x] > 0);
                if let Some(below) = below.filter(|row| disparity[row * width + x].abs_diff(a) <= step) {
                    let b = disparity[below * width + x];
                    let lower = confidence[above].min(confidence[below * width + x]) / 4;
                    for row in y..below {
                        disparity[row * width + x] = between(a, b, row + 1 - y, below + 1 - y);
                        confidence[row * width + x] = lower.max(1);
                    }
                }
                x += 1;
                if x == width {
                    break;
                }
            }
        }
    }

    /// Fills every hole, so that all pixels have a disparity if at least one is known. Between two
    /// surfaces the seam follows the strongest edge of the image. At the border and in rows without any
    /// estimate the nearest known value is replicated. Filled pixels get the confidence 1.
    pub fn complete(&self, image: GreyView<'_>, disparity: &mut [u16], confidence: &mut [u8]) {
        let width = self.width;
        for (y, (disparity, confidence)) in
            disparity.chunks_exact_mut(width).zip(confidence.chunks_exact_mut(width)).enumerate()
        {
            let grey = image.row(y);
            for_holes(disparity, |disparity, start, end| {
                confidence[start..end].fill(1);
                match (start, end) {
                    (0, end) if end == width => confidence.fill(0),
                    (0, end) => {
                        let nearest = disparity[end];
                        disparity[..end].fill(nearest);
                    }
                    (start, end) if end == width => {
                        let nearest = disparity[start - 1];
                        disparity[start..].fill(nearest);
                    }
                    (start, end) => {
                        // The seam lies before the pixel with the largest grey-level step. Among equal
                        // steps it is the one closest to the nearer surface, which occludes the other.
                        let step = |x: usize| grey[x].abs_diff(grey[x - 1]);
                        let (a, b) = (disparity[start - 1], disparity[end]);
                        let seam = if a > b {
                            (start..=end).rev().max_by_key(|&x| step(x))
                        } else {
                            (start..=end).max_by_key(|&x| step(x))
                        };
                        let seam = seam.unwrap_or(end);
                        disparity[start..seam].fill(a);
                        disparity[seam..end].fill(b);
                    }
                }
            });
        }
        // Rows without any estimate copy the next row that has one: the row above, at the top the row below.
        let rows = disparity.len() / width;
        let empty = |disparity: &[u16], y: usize| disparity[y * width] == 0;
        for y in 1..rows {
            if empty(disparity, y) && !empty(disparity, y - 1) {
                disparity.copy_within((y - 1) * width..y * width, y * width);
                confidence[y * width..(y + 1) * width].fill(1);
            }
        }
        for y in (0..rows.saturating_sub(1)).rev() {
            if empty(disparity, y) && !empty(disparity, y + 1) {
                disparity.copy_within((y + 1) * width..(y + 2) * width, y * width);
                confidence[y * width..(y + 1) * width].fill(1);
            }
        }
    }
}

/// Linear interpolation from `a` to `b` after `part` of `whole` steps; at least 1.
fn between(a: u16, b: u16, part: usize, whole: usize) -> u16 {
    let (a, b) = (i64::from(a), i64::from(b));
    (a + (b - a) * part as i64 / whole as i64).max(1) as u16
}

/// The first zero of a row from `from` on. Most chunks have none, so each chunk is tested as a whole first.
fn next_zero(row: &[u16], from: usize) -> Option<usize> {
    let mut start = from;
    for chunk in row[from..].chunks(32) {
        if chunk.iter().fold(false, |any, &d| any | (d == 0)) {
            return chunk.iter().position(|&d| d == 0).map(|i| start + i);
        }
        start += chunk.len();
    }
    None
}

/// The first column, from `from` on, in which the lower of two rows has a zero and the upper one has none: where a hole begins.
fn next_below(rows: &[u16], from: usize) -> Option<usize> {
    let (above, here) = rows.split_at(rows.len() / 2);
    let begins = |(&above, &here): (&u16, &u16)| (above > 0) & (here == 0);
    let mut start = from;
    for (above, here) in above[from..].chunks(32).zip(here[from..].chunks(32)) {
        if above.iter().zip(here).fold(false, |any, pair| any | begins(pair)) {
            return above.iter().zip(here).position(begins).map(|i| start + i);
        }
        start += here.len();
    }
    None
}

/// Calls `hole` with start and end of each run of zeros in a row.
fn for_holes(row: &mut [u16], mut hole: impl FnMut(&mut [u16], usize, usize)) {
    let mut x = 0;
    while let Some(start) = next_zero(row, x) {
        let end = row[start..].iter().position(|&d| d > 0).map_or(row.len(), |i| start + i);
        hole(row, start, end);
        // Past the start even if the map, which lies in shared memory, has changed since and the run seems empty.
        x = end.max(start + 1);
        if x >= row.len() {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::Crew;

    #[test]
    fn holes_within_a_surface_are_interpolated_and_others_stay() {
        let width = 9;
        let fill = Fill::new(BridgeParameters { widest_px: 3, step: 512 }, width, 1);
        // A hole in a slope, a hole at an edge, a hole that is too wide, a hole at the border.
        let mut map = vec![
            1000, 0, 0, 1300, 1300, 0, 9000, 0, 0, //
            1000, 0, 0, 0, 0, 1300, 9000, 9000, 9000,
        ];
        let mut confidence: Vec<u8> = map.iter().map(|&d| if d > 0 { 200 } else { 0 }).collect();
        fill.bridge(&mut map, &mut confidence);
        assert_eq!(map[..9], [1000, 1100, 1200, 1300, 1300, 0, 9000, 0, 0]);
        assert_eq!(map[9..14], [1000, 0, 0, 0, 0]);
        assert_eq!(confidence[..6], [200, 50, 50, 200, 200, 0]);
        // Along a column.
        let fill = Fill::new(BridgeParameters { widest_px: 3, step: 512 }, 1, 1);
        let mut map = vec![0, 400, 0, 0, 700, 0];
        let mut confidence = vec![0, 8, 0, 0, 2, 0];
        fill.bridge(&mut map, &mut confidence);
        assert_eq!(map, [0, 400, 500, 600, 700, 0]);
        assert_eq!(confidence, [0, 8, 1, 1, 2, 0]);
    }

    #[test]
    fn two_threads_fill_the_same_holes_as_one() {
        let mut random = fastrand::Rng::with_seed(13);
        let crew = Crew::new(2, |_| ()).unwrap();
        for _ in 0..40 {
            let (width, height) = (random.usize(1..70), random.usize(1..60));
            let parameters = BridgeParameters { widest_px: random.u16(0..30), step: 300 };
            let mut map: Vec<u16> = (0..width * height).map(|_| random.u16(500..900)).collect();
            for _ in 0..random.usize(0..30) {
                let (x, y) = (random.usize(..width), random.usize(..height));
                for y in y..height.min(y + random.usize(1..40)) {
                    map[y * width..][x..width.min(x + random.usize(1..20))].fill(0);
                }
            }
            let confidence: Vec<u8> = map.iter().map(|&d| if d > 0 { random.u8(1..) } else { 0 }).collect();
            let fill = |threads: usize| {
                let (mut map, mut confidence) = (map.clone(), confidence.clone());
                let fill = Fill::new(parameters, width, threads);
                crew.lead(|| fill.bridge(&mut map, &mut confidence));
                (map, confidence)
            };
            assert!(fill(1) == fill(2), "{width}x{height}, {parameters:?}");
        }
    }

    #[test]
    fn a_completed_map_has_no_hole_and_its_seams_follow_edges() {
        let grey = vec![
            10, 10, 10, 10, 90, 90, //
            10, 10, 10, 10, 10, 10, //
            10, 10, 10, 10, 10, 10,
        ];
        let image = GreyView::new(&grey, 6, 3, 6).unwrap();
        let mut map = vec![
            0, 512, 0, 0, 0, 2560, //
            0, 0, 0, 0, 0, 0, //
            7, 0, 0, 0, 0, 0,
        ];
        let mut confidence: Vec<u8> = map.iter().map(|&d| if d > 0 { 200 } else { 0 }).collect();
        Fill::new(BridgeParameters::default(), 6, 1).complete(image, &mut map, &mut confidence);
        assert_eq!(map[..6], [512, 512, 512, 512, 2560, 2560]);
        assert_eq!(map[6..12], map[..6]);
        assert_eq!(map[12..], [7; 6]);
        assert_eq!(confidence[..6], [1, 200, 1, 1, 1, 200]);
        assert!(confidence.iter().all(|&c| c > 0));
        // No estimate at all: the map stays empty.
        let mut nothing = vec![0; 18];
        let mut confidence = vec![0; 18];
        Fill::new(BridgeParameters::default(), 6, 1).complete(image, &mut nothing, &mut confidence);
        assert!(nothing.iter().all(|&d| d == 0) && confidence.iter().all(|&c| c == 0));
    }
}
