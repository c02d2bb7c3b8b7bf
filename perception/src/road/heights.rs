//! Heights above the road of pixels that were picked here and there, many at once.

use super::surface::Tilt;
use crate::simd::{Simd, kernel};

/// Pixels that are taken at once.
pub const BATCH: usize = 64;
/// A number that has no room for places behind the point.
const WHOLE: f32 = 8_388_608.0;

/// Some pixels of a map.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Column of each.
    pub x_px: [f32; BATCH],
    /// Row of each.
    pub y_px: [f32; BATCH],
    /// Disparity of each, in 1/256 px.
    pub disparity: [u16; BATCH],
    count: usize,
}

impl Default for Pixels {
    fn default() -> Self {
        Self { x_px: [0.0; BATCH], y_px: [0.0; BATCH], disparity: [0; BATCH], count: 0 }
    }
}

impl Pixels {
    /// Takes another one, if it is `wanted`. No branch depends on that.
    ///
    /// # Panics
    /// When there are [`BATCH`] already.
    #[inline(always)]
    pub fn push(&mut self, x_px: f32, y_px: f32, disparity: u16, wanted: bool) {
        let i = self.count;
        (self.x_px[i], self.y_px[i], self.disparity[i]) = (x_px, y_px, disparity);
        self.count += usize::from(wanted);
    }

    /// How many there are.
    #[inline(always)]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Forgets them.
    pub fn clear(&mut self) {
        self.count = 0;
    }
}

/// The road as heights are measured from it.
#[derive(Clone, Copy, Debug)]
pub struct Datum<'a> {
    /// Row of the road for each disparity.
    pub rows: &'a [f32],
    /// Entries of `rows` in a pixel of disparity.
    pub per_px: f64,
    /// How it lies across.
    pub tilt: Tilt,
    /// Distance of the cameras, in metres.
    pub baseline_m: f64,
}

kernel! {
    /// Heights above the road, in metres: baseline·(row of the road there − y)/disparity. NaN without a road;
    /// what lies behind the last pixel means nothing.
    pub fn measure(datum: Datum<'_>, pixels: &Pixels, out: &mut [f64; BATCH]) = measure_each
}

#[inline(always)]
fn measure_each<S: Simd>(_: S, datum: Datum<'_>, pixels: &Pixels, out: &mut [f64; BATCH]) {
    let Datum { rows, per_px, tilt, baseline_m } = datum;
    let Some(last) = rows.len().checked_sub(2) else { return out.fill(f64::NAN) };
    let (mut index, mut share) = ([0_u32; BATCH], [0.0_f32; BATCH]);
    for i in 0..BATCH {
        let px = f64::from(pixels.disparity[i]) / 256.0;
        let level = tilt.level(f64::from(pixels.x_px[i]), px);
        // Written so that NaN is 0.
        let place = (if level > 0.0 { level } else { 0.0 } * per_px) as f32;
        let below = if place < last as f32 { place } else { last as f32 };
        // The whole part; `as` would be a branch for what does not fit.
        let near = below + WHOLE;
        let whole = if near - WHOLE > below { near - WHOLE - 1.0 } else { near - WHOLE };
        index[i] = (whole + WHOLE).to_bits() & 0x7f_ffff;
        share[i] = (place - whole).min(1.0);
    }
    let (mut near, mut next) = ([f32::NAN; BATCH], [f32::NAN; BATCH]);
    for i in 0..pixels.count {
        if let Some([a, b]) = rows.get(index[i] as usize..).and_then(|rows| rows.first_chunk()) {
            (near[i], next[i]) = (*a, *b);
        }
    }
    for i in 0..BATCH {
        let row = near[i] + share[i] * (next[i] - near[i]);
        let px = f64::from(pixels.disparity[i]) / 256.0;
        out[i] = baseline_m * (f64::from(row) - f64::from(pixels.y_px[i])) / px;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Level;

    #[test]
    fn all_levels_measure_what_one_by_one_gives() {
        let mut random = fastrand::Rng::with_seed(4);
        let rows: Vec<f32> = (0..200).map(|i| 100.0 + i as f32 + random.f32()).collect();
        let tilt = Tilt { roll: 0.02, offset_px: 0.4, cx_px: 50.0 };
        let datum = Datum { rows: &rows, per_px: 16.0, tilt, baseline_m: 0.2 };
        let mut pixels = Pixels::default();
        for i in 0..2 * BATCH {
            // Up to beyond the table's end, and down to before its beginning.
            let (x, y, d) = (random.f32() * 100.0, random.f32() * 300.0, random.u16(1..5000));
            pixels.push(x.round(), y.round(), d, i % 2 == 0);
            if pixels.count() == BATCH {
                break;
            }
        }
        assert_eq!(pixels.count(), BATCH);
        for level in Level::available() {
            let mut out = [0.0; BATCH];
            measure(level, datum, &pixels, &mut out);
            for (i, height) in out.iter().enumerate() {
                let px = f64::from(pixels.disparity[i]) / 256.0;
                let place = (tilt.level(f64::from(pixels.x_px[i]), px).max(0.0) * 16.0) as f32;
                let index = (place as usize).min(rows.len() - 2);
                let share = (place - index as f32).min(1.0);
                let row = rows[index] + share * (rows[index + 1] - rows[index]);
                let expected = 0.2 * (f64::from(row) - f64::from(pixels.y_px[i])) / px;
                assert_eq!(height.to_bits(), expected.to_bits(), "{} {i}", level.name());
            }
        }
        pixels.clear();
        assert_eq!(pixels.count(), 0);
    }
}
