//! Confidence of the neighbourhood: an estimate whose neighbours are uncertain or missing is uncertain too.

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
    /// Copies of the last input rows: one more than the height of the window.
    rows: Vec<u8>,
    sums: Vec<u16>,
    nothing: Vec<u8>,
}

impl ConfidenceFilter {
    /// A workspace for maps of `width` columns.
    pub fn new(level: Level, width: usize) -> Self {
        Self {
            level,
            width,
            rows: vec![0; (SIZE + 1) * width],
            sums: vec![0; width + 2 * RADIUS],
            nothing: vec![0; width],
        }
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.rows.len() + 2 * self.sums.len() + self.nothing.len()
    }

    /// Replaces each confidence by the mean over its 5 × 5 pixels. Pixels without an estimate and pixels
    /// outside the map count as 0.
    pub fn apply(&mut self, confidence: &mut [u8]) {
        let width = self.width;
        let height = confidence.len() / width;
        let place = |y: usize| (y % (SIZE + 1)) * width..(y % (SIZE + 1)) * width + width;
        self.sums.fill(0);
        for y in 0..height + RADIUS {
            // Row y enters the window, row y − 5 leaves it, row y − 2 gets its means.
            if y < height {
                self.rows[place(y)].copy_from_slice(&confidence[y * width..(y + 1) * width]);
            }
            let added = if y < height { &self.rows[place(y)] } else { &self.nothing[..] };
            let removed = match y.checked_sub(SIZE) {
                Some(old) => &self.rows[place(old)],
                None => &self.nothing[..],
            };
            add(self.level, &mut self.sums[RADIUS..RADIUS + width], added, removed);
            if let Some(out) = y.checked_sub(RADIUS) {
                mean(self.level, &self.sums, &mut confidence[out * width..(out + 1) * width]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
                let mut filter = ConfidenceFilter::new(level, width);
                for _ in 0..2 {
                    let mut got = map.clone();
                    filter.apply(&mut got);
                    assert_eq!(got, expected, "{width}x{height} {}", level.name());
                }
            }
        }
    }
}
