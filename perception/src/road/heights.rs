//! Heights above the road for batches of scattered pixels.

use super::tilt::Tilt;
use crate::simd::rounding::truncate;
use crate::simd::{Simd, kernel};

/// Pixels in one batch.
pub const BATCH: usize = 64;

/// A batch of pixels of a disparity map.
#[derive(Clone, Debug)]
pub struct PixelBatch {
    /// Column of each pixel.
    pub x_px: [f32; BATCH],
    /// Row of each pixel.
    pub y_px: [f32; BATCH],
    /// Disparity of each pixel, in 1/256 px.
    pub disparity: [u16; BATCH],
    count: usize,
}

impl Default for PixelBatch {
    fn default() -> Self {
        Self { x_px: [0.0; BATCH], y_px: [0.0; BATCH], disparity: [0; BATCH], count: 0 }
    }
}

impl PixelBatch {
    /// Appends a pixel if it is `selected`, without a branch.
    ///
    /// # Panics
    /// When the batch already holds [`BATCH`] pixels.
    #[inline(always)]
    pub fn push(&mut self, x_px: f32, y_px: f32, disparity: u16, selected: bool) {
        let i = self.count;
        (self.x_px[i], self.y_px[i], self.disparity[i]) = (x_px, y_px, disparity);
        self.count += usize::from(selected);
    }

    /// Number of pixels in the batch.
    #[inline(always)]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Removes all pixels.
    pub fn clear(&mut self) {
        self.count = 0;
    }
}

/// The road surface relative to which heights are measured.
#[derive(Clone, Copy, Debug)]
pub struct HeightReference<'a> {
    /// Image row of the road for each disparity.
    pub rows: &'a [f32],
    /// Entries of `rows` per pixel of disparity.
    pub entries_per_px: f64,
    /// Lateral tilt of the road.
    pub tilt: Tilt,
    /// Baseline of the cameras, in metres.
    pub baseline_m: f64,
}

kernel! {
    /// Heights above the road, in metres: baseline · (row of the road at the disparity − y) / disparity. NaN
    /// without a road; values beyond the last pixel of the batch are meaningless.
    pub fn measure_heights(reference: HeightReference<'_>, pixels: &PixelBatch, out: &mut [f64; BATCH]) = measure_heights_each
}

#[inline(always)]
fn measure_heights_each<S: Simd>(
    _: S,
    reference: HeightReference<'_>,
    pixels: &PixelBatch,
    out: &mut [f64; BATCH],
) {
    let HeightReference { rows, entries_per_px, tilt, baseline_m } = reference;
    let Some(last) = rows.len().checked_sub(2) else { return out.fill(f64::NAN) };
    let (mut index, mut share) = ([0_i32; BATCH], [0.0_f32; BATCH]);
    for i in 0..BATCH {
        let px = f64::from(pixels.disparity[i]) / 256.0;
        let level = tilt.levelled_px(f64::from(pixels.x_px[i]), px);
        // This form of the comparison maps NaN to 0.
        let level = if level > 0.0 { level } else { 0.0 };
        let position = (level * entries_per_px) as f32;
        index[i] = truncate(if position < last as f32 { position } else { last as f32 });
        share[i] = (position - index[i] as f32).min(1.0);
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
