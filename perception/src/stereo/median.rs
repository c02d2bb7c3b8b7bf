//! A 3 × 3 median filter that removes single outliers and preserves edges and holes.

use crate::simd::{Level, Simd, kernel};

/// Pixels that are filtered together.
const CHUNK: usize = 32;
/// A row of a chunk with one column on each side.
type Padded = [u16; CHUNK + 2];

/// Three values in ascending order.
#[inline(always)]
fn sorted([a, b, c]: [u16; 3]) -> [u16; 3] {
    let (small, large) = (a.min(b), a.max(b));
    [small.min(c), small.max(large.min(c)), large.max(c)]
}

/// Filters a row. `rows` have one border column before the row and reach one column beyond its last chunk;
/// `out` reaches to the end of its last chunk.
///
/// With each column of the window sorted, the median of the nine values is the median of the maximum of
/// the lows, the median of the middles and the minimum of the highs.
#[inline(always)]
fn median_row<S: Simd>(_: S, rows: [&[u16]; 3], out: &mut [u16]) {
    for (n, out) in out.chunks_exact_mut(CHUNK).enumerate() {
        let chunk = |row: usize| rows[row].get(n * CHUNK..).and_then(|row| row.first_chunk());
        let (Some(above), Some(here), Some(below)) = (chunk(0), chunk(1), chunk(2)) else { continue };
        let rows: [&Padded; 3] = [above, here, below];
        for (x, out) in out.iter_mut().enumerate() {
            let centre = here[x + 1];
            // An unknown neighbour counts as the pixel itself.
            let known = |row: usize, x: usize| if rows[row][x] == 0 { centre } else { rows[row][x] };
            let column = |x: usize| sorted([known(0, x), known(1, x), known(2, x)]);
            let (a, b, c) = (column(x), column(x + 1), column(x + 2));
            let low = a[0].max(b[0]).max(c[0]);
            let middle = sorted([a[1], b[1], c[1]])[1];
            let high = a[2].min(b[2]).min(c[2]);
            *out = if centre == 0 { 0 } else { sorted([low, middle, high])[1] };
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
