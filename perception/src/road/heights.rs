//! Heights above the road of pixels that were picked here and there, many at once.

use super::tilt::Tilt;
use crate::simd::rounding::truncate;
use crate::simd::{Simd, kernel};

/// Pixels that are taken at once.
pub const BATCH: usize = 64;

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
    let (mut index, mut share) = ([0_i32; BATCH], [0.0_f32; BATCH]);
    for i in 0..BATCH {
        let px = f64::from(pixels.disparity[i]) / 256.0;
        let level = tilt.level(f64::from(pixels.x_px[i]), px);
        // Written so that NaN is 0.
        let level = if level > 0.0 { level } else { 0.0 };
        let place = (level * per_px) as f32;
        index[i] = truncate(if place < last as f32 { place } else { last as f32 });
        share[i] = (place - index[i] as f32).min(1.0);
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
