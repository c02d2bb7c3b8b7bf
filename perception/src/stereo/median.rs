//! A 3 × 3 median filter that removes single outliers and preserves edges and holes.

use super::crew::{first_row, in_bands};
use crate::simd::{Level, Simd, kernel};

/// Pixels that are filtered together: a vector of AVX2.
const CHUNK: usize = 16;
/// Values of the pixels of a chunk.
type Chunk = [u16; CHUNK];

/// `of` of each pixel.
#[inline(always)]
fn each(a: &Chunk, b: &Chunk, of: impl Fn(u16, u16) -> u16) -> Chunk {
    let mut out = [0; CHUNK];
    for x in 0..CHUNK {
        out[x] = of(a[x], b[x]);
    }
    out
}

#[inline(always)]
fn least(a: &Chunk, b: &Chunk) -> Chunk {
    each(a, b, u16::min)
}

#[inline(always)]
fn most(a: &Chunk, b: &Chunk) -> Chunk {
    each(a, b, u16::max)
}

/// `there`, and `otherwise` where `there` is unknown.
#[inline(always)]
fn known(there: &Chunk, otherwise: &Chunk) -> Chunk {
    each(there, otherwise, |there, otherwise| if there == 0 { otherwise } else { there })
}

/// Three values in ascending order.
#[inline(always)]
fn sorted(a: &Chunk, b: &Chunk, c: &Chunk) -> [Chunk; 3] {
    let (small, large) = (least(a, b), most(a, b));
    [least(&small, c), most(&small, &least(&large, c)), most(&large, c)]
}

/// Filters a row. `rows` have one border column before the row and reach one column beyond its last chunk;
/// `out` reaches to the end of its last chunk.
///
/// With each column of the window sorted, the median of the nine values is the median of the maximum of
/// the lows, the median of the middles and the minimum of the highs. Every step runs over a whole chunk: a loop over
/// pixels with all steps inside is not vectorised.
#[inline(always)]
fn median_row<S: Simd>(_: S, rows: [&[u16]; 3], out: &mut [u16]) {
    let width = out.len() + 2;
    let rows = [&rows[0][..width], &rows[1][..width], &rows[2][..width]];
    for (n, out) in out.chunks_exact_mut(CHUNK).enumerate() {
        let mut window = [[[0; CHUNK]; 3]; 3];
        for row in 0..3 {
            for column in 0..3 {
                window[row][column].copy_from_slice(&rows[row][n * CHUNK + column..][..CHUNK]);
            }
        }
        let centre = window[1][1];
        let mut columns = [[[0; CHUNK]; 3]; 3];
        for column in 0..3 {
            // An unknown neighbour counts as the pixel itself.
            let [above, here, below] = [
                known(&window[0][column], &centre),
                known(&window[1][column], &centre),
                known(&window[2][column], &centre),
            ];
            columns[column] = sorted(&above, &here, &below);
        }
        let [a, b, c] = &columns;
        let low = most(&most(&a[0], &b[0]), &c[0]);
        let middle = &sorted(&a[1], &b[1], &c[1])[1];
        let high = least(&least(&a[2], &b[2]), &c[2]);
        let median = &sorted(&low, middle, &high)[1];
        for x in 0..CHUNK {
            out[x] = if centre[x] == 0 { 0 } else { median[x] };
        }
    }
}

kernel! { fn filter_row(rows: [&[u16]; 3], out: &mut [u16]) = median_row }

/// The filter with its workspace.
#[derive(Debug)]
pub struct Median {
    level: Level,
    width: usize,
    /// One for each thread.
    parts: Vec<Part>,
}

/// The workspace for a part of the rows. All rows have one border column before and at least one behind.
#[derive(Debug)]
struct Part {
    /// Three rows of the unfiltered map.
    rows: [Vec<u16>; 3],
    /// The unfiltered row below the part.
    beyond: Vec<u16>,
    /// A filtered row, up to the end of its last chunk.
    filtered: Vec<u16>,
}

/// Copies a row of the map between its borders; a row outside the map is unknown.
fn take(row: Option<&[u16]>, into: &mut [u16]) {
    match row {
        Some(row) => into[1..=row.len()].copy_from_slice(row),
        None => into.fill(0),
    }
}

impl Median {
    /// A filter for maps of `width` columns that divides their rows among `threads` threads; several need a
    /// [`Crew`](super::crew::Crew).
    pub fn new(level: Level, width: usize, threads: usize) -> Self {
        let padded = width.next_multiple_of(CHUNK);
        let part = || Part {
            rows: std::array::from_fn(|_| vec![0; padded + 2]),
            beyond: vec![0; padded + 2],
            filtered: vec![0; padded],
        };
        Self { level, width, parts: (0..threads.max(1)).map(|_| part()).collect() }
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.parts.iter().map(|part| 10 * part.filtered.len() + 16).sum()
    }

    /// Replaces each known disparity by the median of its 3 × 3 pixels; 0 (unknown) is kept.
    pub fn apply(&mut self, disparity: &mut [u16]) {
        let Self { level, width, parts } = self;
        let (level, width, count) = (*level, *width, parts.len());
        let height = disparity.len() / width;
        let row = |y: usize| disparity.get(y * width..(y + 1) * width);
        for (i, part) in parts.iter_mut().enumerate() {
            take(first_row(height, i, count).checked_sub(1).and_then(row), &mut part.rows[0]);
            take(row(first_row(height, i + 1, count)), &mut part.beyond);
        }
        in_bands(parts, disparity, width, &|part, band| part.filter(level, width, band));
    }
}

impl Part {
    /// Filters the rows of the part; `rows[0]` and `beyond` are those beside it.
    fn filter(&mut self, level: Level, width: usize, band: &mut [u16]) {
        let height = band.len() / width;
        let Self { rows: [above, here, below], beyond, filtered } = self;
        if height > 0 {
            take(Some(&band[..width]), here);
        }
        for y in 0..height {
            match band.get((y + 1) * width..(y + 2) * width) {
                Some(next) => take(Some(next), below),
                None => below.copy_from_slice(beyond),
            }
            filter_row(level, [above, here, below], filtered);
            band[y * width..(y + 1) * width].copy_from_slice(&filtered[..width]);
            std::mem::swap(above, here);
            std::mem::swap(here, below);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::Crew;

    #[test]
    fn the_filter_equals_sorting_at_every_level() {
        let mut random = fastrand::Rng::with_seed(5);
        for (width, height, holes) in
            [(1, 1, 5), (1, 7, 5), (9, 1, 5), (40, 12, 5), (67, 9, 5), (130, 20, 255), (99, 30, 200)]
        {
            let map: Vec<u16> = (0..width * height)
                .map(|_| if random.u8(..holes) == 0 { 0 } else { random.u16(1..) })
                .collect();
            let expected: Vec<u16> = (0..width * height)
                .map(|i| {
                    let (x, y) = ((i % width) as i64, (i / width) as i64);
                    let mut values = Vec::new();
                    for dy in -1..=1 {
                        for dx in -1..=1 {
                            let (x, y) = (x + dx, y + dy);
                            let inside = x >= 0 && y >= 0 && x < width as i64 && y < height as i64;
                            let v = if inside { map[y as usize * width + x as usize] } else { 0 };
                            values.push(if v == 0 { map[i] } else { v });
                        }
                    }
                    values.sort_unstable();
                    if map[i] == 0 { 0 } else { values[4] }
                })
                .collect();
            for level in Level::available() {
                for threads in [1, 2, 5] {
                    let crew = Crew::new(threads, |_| ()).unwrap();
                    let mut filtered = map.clone();
                    crew.lead(|| Median::new(level, width, threads).apply(&mut filtered));
                    assert_eq!(filtered, expected, "{width}x{height} {} on {threads}", level.name());
                }
            }
        }
    }
}
