//! A 3 × 3 median filter that removes single outliers and preserves edges and holes.

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
    /// Three rows of the unfiltered map, with one border column before and at least one behind.
    rows: [Vec<u16>; 3],
    /// A filtered row, up to the end of its last chunk.
    filtered: Vec<u16>,
}

impl Median {
    /// A filter for maps of `width` columns.
    pub fn new(level: Level, width: usize) -> Self {
        let padded = width.next_multiple_of(CHUNK);
        Self { level, width, rows: std::array::from_fn(|_| vec![0; padded + 2]), filtered: vec![0; padded] }
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        8 * self.filtered.len() + 12
    }

    /// Replaces each known disparity by the median of its 3 × 3 pixels; 0 (unknown) is kept.
    pub fn apply(&mut self, disparity: &mut [u16]) {
        let width = self.width;
        let height = disparity.len() / width;
        let [above, here, below] = &mut self.rows;
        above.fill(0);
        here[1..=width].copy_from_slice(&disparity[..width]);
        for y in 0..height {
            match disparity.get((y + 1) * width..(y + 2) * width) {
                Some(next) => below[1..=width].copy_from_slice(next),
                None => below.fill(0),
            }
            filter_row(self.level, [above, here, below], &mut self.filtered);
            disparity[y * width..(y + 1) * width].copy_from_slice(&self.filtered[..width]);
            std::mem::swap(above, here);
            std::mem::swap(here, below);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
                let mut filtered = map.clone();
                Median::new(level, width).apply(&mut filtered);
                assert_eq!(filtered, expected, "{width}x{height} {}", level.name());
            }
        }
    }
}
