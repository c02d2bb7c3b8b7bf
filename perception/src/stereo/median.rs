//! A median filter that takes single wrong estimates out and leaves edges and holes alone.

use crate::simd::{Level, Simd, kernel};

/// Pixels that are sorted side by side.
const CHUNK: usize = 32;
type Chunk = [u16; CHUNK];

/// The median of nine by a network of exchanges, pixel by pixel of a chunk.
#[inline(always)]
fn median_of_nine(v: &mut [Chunk; 9]) {
    const EXCHANGES: [(usize, usize); 19] = [
        (1, 2),
        (4, 5),
        (7, 8),
        (0, 1),
        (3, 4),
        (6, 7),
        (1, 2),
        (4, 5),
        (7, 8),
        (0, 3),
        (5, 8),
        (4, 7),
        (3, 6),
        (1, 4),
        (2, 5),
        (4, 7),
        (4, 2),
        (6, 4),
        (4, 2),
    ];
    for (a, b) in EXCHANGES {
        let (mut low, mut high) = ([0; CHUNK], [0; CHUNK]);
        for i in 0..CHUNK {
            low[i] = v[a][i].min(v[b][i]);
            high[i] = v[a][i].max(v[b][i]);
        }
        (v[a], v[b]) = (low, high);
    }
}

/// The same where all pixels are known: columns are sorted once for the three windows they are in;
/// the median is that of the greatest low, the median middle and the least high.
#[inline(always)]
fn median_of_known(rows: &[&[u16]; 3], out: &mut [u16]) {
    const WIDE: usize = CHUNK + 2;
    let (mut low, mut middle, mut high) = ([0; WIDE], [0; WIDE], [0; WIDE]);
    for x in 0..WIDE {
        let (a, b, c) = (rows[0][x], rows[1][x], rows[2][x]);
        let (small, large) = (a.min(b), a.max(b));
        low[x] = small.min(c);
        middle[x] = small.max(large.min(c));
        high[x] = large.max(c);
    }
    let of_three = |a: u16, b: u16, c: u16| a.min(b).max(a.max(b).min(c));
    for x in 0..CHUNK {
        let low = low[x].max(low[x + 1]).max(low[x + 2]);
        let middle = of_three(middle[x], middle[x + 1], middle[x + 2]);
        let high = high[x].min(high[x + 1]).min(high[x + 2]);
        out[x] = of_three(low, middle, high);
    }
}

/// Filters a row; `rows` have a column of border before it and reach to the end of its last chunk
/// and one column further, as `out` does to the end of its last chunk.
#[inline(always)]
fn median_row<S: Simd>(_: S, rows: [&[u16]; 3], out: &mut [u16]) {
    for (n, out) in out.chunks_exact_mut(CHUNK).enumerate() {
        let at = n * CHUNK;
        let mut values = [[0; CHUNK]; 9];
        let mut centre = [0; CHUNK];
        centre.copy_from_slice(&rows[1][at + 1..at + 1 + CHUNK]);
        let whole =
            rows.iter().all(|row| row[at..at + CHUNK + 2].iter().fold(true, |whole, &v| whole & (v != 0)));
        if whole {
            median_of_known(&rows.map(|row| &row[at..at + CHUNK + 2]), out);
            continue;
        }
        for (row, values) in rows.iter().zip(values.chunks_exact_mut(3)) {
            for (column, values) in values.iter_mut().enumerate() {
                let pixels = &row[at + column..at + column + CHUNK];
                for i in 0..CHUNK {
                    // An unknown neighbour votes as the pixel itself.
                    values[i] = if pixels[i] == 0 { centre[i] } else { pixels[i] };
                }
            }
        }
        median_of_nine(&mut values);
        for i in 0..CHUNK {
            out[i] = if centre[i] == 0 { 0 } else { values[4][i] };
        }
    }
}

kernel! { fn filter_row(rows: [&[u16]; 3], out: &mut [u16]) = median_row }

/// The filter with its memory.
#[derive(Debug)]
pub struct Median {
    level: Level,
    width: usize,
    /// Three rows of the unfiltered map with a column of border before and more behind.
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

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        8 * self.filtered.len() + 12
    }

    /// Replaces each known disparity by the median of its 3 × 3 pixels; 0 (unknown) stays.
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
