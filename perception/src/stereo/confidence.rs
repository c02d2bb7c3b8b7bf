//! Confidence of the neighbourhood: an estimate whose neighbours are uncertain or missing is uncertain too.

use super::crew::{first_row, in_bands};
use crate::simd::{Level, Simd, kernel};

/// Radius of the window: 5 × 5 pixels.
const RADIUS: usize = 2;
const SIZE: usize = 2 * RADIUS + 1;
const AREA: u16 = (SIZE * SIZE) as u16;

#[inline(always)]
fn add_row<S: Simd>(_: S, sums: &mut [u16], added: &[u8], removed: &[u8]) {
    for ((sum, &a), &r) in sums.iter_mut().zip(added).zip(removed) {
        *sum = *sum + u16::from(a) - u16::from(r);
    }
}

/// Means over five neighbouring column sums; `sums` has a border of two columns on both sides.
#[inline(always)]
fn mean_row<S: Simd>(_: S, sums: &[u16], out: &mut [u8]) {
    let sums = &sums[..out.len() + 2 * RADIUS];
    for (x, out) in out.iter_mut().enumerate() {
        let total = sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3] + sums[x + 4];
        *out = (total / AREA) as u8;
    }
}

kernel! { fn add(sums: &mut [u16], added: &[u8], removed: &[u8]) = add_row }
kernel! { fn mean(sums: &[u16], out: &mut [u8]) = mean_row }

/// Box filter of confidences over 5 × 5 pixels, with memory allocated once.
#[derive(Debug)]
pub struct ConfidenceFilter {
    level: Level,
    width: usize,
    /// One for each thread.
    parts: Vec<Part>,
}

/// The workspace for a part of the rows.
#[derive(Debug)]
struct Part {
    /// Copies of the last input rows: one more than the height of the window.
    rows: Vec<u8>,
    sums: Vec<u16>,
    /// The rows above and below the part that its windows reach; 0 outside the map.
    above: Vec<u8>,
    below: Vec<u8>,
    nothing: Vec<u8>,
}

impl ConfidenceFilter {
    /// A workspace for maps of `width` columns whose rows are divided among `threads` threads; several need a
    /// [`Crew`](super::crew::Crew).
    pub fn new(level: Level, width: usize, threads: usize) -> Self {
        let part = || Part {
            rows: vec![0; (SIZE + 1) * width],
            sums: vec![0; width + 2 * RADIUS],
            above: vec![0; RADIUS * width],
            below: vec![0; RADIUS * width],
            nothing: vec![0; width],
        };
        Self { level, width, parts: (0..threads.max(1)).map(|_| part()).collect() }
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.parts.len() * (2 * (self.width + 2 * RADIUS) + (SIZE + 2 + 2 * RADIUS) * self.width)
    }

    /// Replaces each confidence by the mean over its 5 × 5 pixels. Pixels without an estimate and pixels
    /// outside the map count as 0.
    pub fn apply(&mut self, confidence: &mut [u8]) {
        let Self { level, width, parts } = self;
        let (level, width, count) = (*level, *width, parts.len());
        let height = confidence.len() / width;
        for (i, part) in parts.iter_mut().enumerate() {
            let (start, end) = (first_row(height, i, count), first_row(height, i + 1, count));
            for row in 0..RADIUS {
                let into = row * width..(row + 1) * width;
                let above = (start + row).checked_sub(RADIUS);
                for (y, halo) in [(above, &mut part.above), (Some(end + row), &mut part.below)] {
                    match y.and_then(|y| confidence.get(y * width..(y + 1) * width)) {
                        Some(row) => halo[into.clone()].copy_from_slice(row),
                        None => halo[into.clone()].fill(0),
                    }
                }
            }
        }
        in_bands(parts, confidence, width, &|part, band| part.filter(level, width, band));
    }
}

impl Part {
    /// Filters the rows of the part.
    fn filter(&mut self, level: Level, width: usize, band: &mut [u8]) {
        let Self { rows, sums, above, below, nothing } = self;
        let height = band.len() / width;
        let place = |y: usize| (y % (SIZE + 1)) * width..(y % (SIZE + 1)) * width + width;
        sums.fill(0);
        // Row y, counted from the first above the part, enters the window, row y − 5 leaves it, row y − 2 gets its means.
        for y in 0..height + 2 * RADIUS {
            let from = match y.checked_sub(RADIUS) {
                None => &above[y * width..(y + 1) * width],
                Some(inside) if inside < height => &band[inside * width..(inside + 1) * width],
                Some(beyond) => &below[(beyond - height) * width..(beyond - height + 1) * width],
            };
            rows[place(y)].copy_from_slice(from);
            let removed = match y.checked_sub(SIZE) {
                Some(old) => &rows[place(old)],
                None => &nothing[..],
            };
            add(level, &mut sums[RADIUS..RADIUS + width], &rows[place(y)], removed);
            if let Some(out) = y.checked_sub(2 * RADIUS) {
                mean(level, sums, &mut band[out * width..(out + 1) * width]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::Crew;

    #[test]
    fn means_equal_the_reference_at_every_level() {
        let mut random = fastrand::Rng::with_seed(8);
        for (width, height) in [(1, 1), (3, 9), (40, 3), (70, 20)] {
            let map: Vec<u8> = (0..width * height).map(|_| random.u8(..)).collect();
            let at = |x: i64, y: i64| {
                let inside = x >= 0 && y >= 0 && x < width as i64 && y < height as i64;
                if inside { u32::from(map[y as usize * width + x as usize]) } else { 0 }
            };
            let expected: Vec<u8> = (0..(width * height) as i64)
                .map(|i| {
                    let (x, y) = (i % width as i64, i / width as i64);
                    let total: u32 = (-2..=2)
                        .flat_map(|dy| (-2..=2).map(move |dx| (dx, dy)))
                        .map(|(dx, dy)| at(x + dx, y + dy))
                        .sum();
                    (total / 25) as u8
                })
                .collect();
            for level in Level::available() {
                for threads in [1, 2, 7] {
                    let crew = Crew::new(threads, |_| ()).unwrap();
                    let mut filter = ConfidenceFilter::new(level, width, threads);
                    for _ in 0..2 {
                        let mut got = map.clone();
                        crew.lead(|| filter.apply(&mut got));
                        assert_eq!(got, expected, "{width}x{height} {} on {threads}", level.name());
                    }
                }
            }
        }
    }
}
