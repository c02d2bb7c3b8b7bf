//! Downsampling of images and upsampling of maps between the scales of a pyramid (paper, section 3.4).

use crate::image::GreyView;
use crate::simd::{Level, Simd, kernel};

/// Size of an image at half the resolution, rounded up.
pub fn half_size(width: usize, height: usize) -> (usize, usize) {
    (width.div_ceil(2), height.div_ceil(2))
}

#[inline(always)]
fn halve_row<S: Simd>(_: S, above: &[u8], below: &[u8], out: &mut [u8]) {
    let whole = above.len() / 2;
    let pairs = above.chunks_exact(2).zip(below.chunks_exact(2));
    for (out, (a, b)) in out[..whole].iter_mut().zip(pairs) {
        let sum = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
        *out = ((sum + 2) >> 2) as u8;
    }
    if let (Some(out), Some(a), Some(b)) = (out.get_mut(whole), above.last(), below.last()) {
        *out = ((u16::from(*a) + u16::from(*b) + 1) >> 1) as u8;
    }
}

kernel! { fn halve_rows(above: &[u8], below: &[u8], out: &mut [u8]) = halve_row }

/// Writes `image` at half its resolution to `out`: each pixel is the rounded mean of 2 × 2 pixels. For odd
/// sizes the last column and row are replicated.
pub fn halve(level: Level, image: GreyView<'_>, out: &mut [u8]) {
    let (width, _) = half_size(image.width(), image.height());
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let below = (2 * y + 1).min(image.height() - 1);
        halve_rows(level, image.row(2 * y), image.row(below), out);
    }
}

/// A disparity map of a coarser scale, with its confidences.
#[derive(Clone, Copy, Debug)]
pub struct Coarse<'a> {
    /// Disparities in 1/256 px of the coarser scale.
    pub disparity: &'a [u16],
    /// Confidences.
    pub confidence: &'a [u8],
    /// How often the resolution was halved.
    pub times: u32,
}

/// Upsamples a coarse map to one of `width` columns by pixel replication. Disparities are doubled as often as
/// the resolution was halved, and limited to `most`.
pub fn double(coarse: Coarse<'_>, width: usize, most: u16, disparity: &mut [u16], confidence: &mut [u8]) {
    let times = coarse.times;
    let coarse_width = (0..times).fold(width, |w, _| w.div_ceil(2));
    for (y, (disparity, confidence)) in
        disparity.chunks_exact_mut(width).zip(confidence.chunks_exact_mut(width)).enumerate()
    {
        let at = (y >> times) * coarse_width;
        for (x, (d, c)) in disparity.iter_mut().zip(confidence).enumerate() {
            let from = at + (x >> times);
            *d = (u32::from(coarse.disparity[from]) << times).min(u32::from(most)) as u16;
            *c = coarse.confidence[from];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_takes_means_at_every_level() {
        let pixels: Vec<u8> = vec![1, 2, 9, 3, 4, 9, 0, 0, 255];
        let view = GreyView::new(&pixels, 3, 3, 3).unwrap();
        for level in Level::available() {
            let mut out = [0; 4];
            halve(level, view, &mut out);
            assert_eq!(out, [3, 9, 0, 255]);
        }
    }

    #[test]
    fn doubling_repeats_and_scales() {
        let (mut disparity, mut confidence) = (vec![9; 15], vec![9; 15]);
        let coarse =
            Coarse { disparity: &[100, 0, 300, 40_000, 5, 6], confidence: &[1, 0, 3, 4, 5, 6], times: 1 };
        double(coarse, 5, 60_000, &mut disparity, &mut confidence);
        assert_eq!(disparity[..5], [200, 200, 0, 0, 600]);
        assert_eq!(disparity[10..], [60_000, 60_000, 10, 10, 12]);
        assert_eq!(confidence[10..], [4, 4, 5, 5, 6]);
    }
}
