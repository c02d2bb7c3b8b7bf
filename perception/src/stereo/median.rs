//! A median filter that takes single wrong estimates out and leaves edges and holes alone.

use crate::simd::{Level, Simd, kernel};

/// The median of nine by a network of exchanges.
#[inline(always)]
fn median_of_nine(mut v: [u16; 9]) -> u16 {
    const EXCHANGES: [(usize, usize); 19] = [
        (1, 2), (4, 5), (7, 8), (0, 1), (3, 4), (6, 7), (1, 2), (4, 5), (7, 8), (0, 3),
        (5, 8), (4, 7), (3, 6), (1, 4), (2, 5), (4, 7), (4, 2), (6, 4), (4, 2),
    ];
    for (a, b) in EXCHANGES {
        (v[a], v[b]) = (v[a].min(v[b]), v[a].max(v[b]));
    }
    v[4]
}

#[inline(always)]
fn median_row<S: Simd>(_: S, rows: [&[u16]; 3], out: &mut [u16]) {
    let n = out.len();
    let rows = rows.map(|row| &row[..n + 2]);
    for x in 0..n {
        let centre = rows[1][x + 1];
        let at = |row: usize, column: usize| {
            let v = rows[row][x + column];
            // An unknown neighbour votes as the pixel itself.
            if v == 0 { centre } else { v }
        };
        let median = median_of_nine([
            at(0, 0), at(0, 1), at(0, 2), at(1, 0), at(1, 1), at(1, 2), at(2, 0), at(2, 1), at(2, 2),
        ]);
        out[x] = if centre == 0 { 0 } else { median };
    }
}

kernel! { fn filter_row(rows: [&[u16]; 3], out: &mut [u16]) = median_row }

/// The filter with its memory.
#[derive(Debug)]
pub struct Median {
    level: Level,
    width: usize,
    /// Three rows of the unfiltered map with a column of border on both sides.
    rows: [Vec<u16>; 3],
}

impl Median {
    /// A filter for maps of `width` columns.
    pub fn new(level: Level, width: usize) -> Self {
        Self { level, width, rows: std::array::from_fn(|_| vec![0; width + 2]) }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        6 * (self.width + 2)
    }

    /// Replaces each known disparity by the median of its 3 × 3 pixels; 0 (unknown) stays.
    pub fn apply(&mut self, disparity: &mut [u16]) {
        let width = self.width;
        let height = disparity.len() / width;
        let load = |target: &mut Vec<u16>, source: &[u16]| {
            target[1..=width].copy_from_slice(source);
            (target[0], target[width + 1]) = (0, 0);
        };
        let [above, here, below] = &mut self.rows;
        above.fill(0);
        load(here, &disparity[..width]);
        for y in 0..height {
            match disparity.get((y + 1) * width..(y + 2) * width) {
                Some(next) => load(below, next),
                None => below.fill(0),
            }
            filter_row(self.level, [above, here, below], &mut disparity[y * width..(y + 1) * width]);
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
        for (width, height) in [(1, 1), (1, 7), (9, 1), (40, 12), (67, 9)] {
            let map: Vec<u16> =
                (0..width * height).map(|_| if random.u8(..5) == 0 { 0 } else { random.u16(..) }).collect();
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
