//! Halved images and doubled maps: the steps between the scales of a pyramid (paper, section 3.4).

use crate::image::GreyView;
use crate::simd::{Level, Simd, kernel};

/// Size of an image at half the scale.
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

/// Writes `image` at half its scale to `out`: each pixel is the rounded mean of four. Odd sizes
/// repeat their last column and row.
pub fn halve(level: Level, image: GreyView<'_>, out: &mut [u8]) {
    let (width, _) = half_size(image.width(), image.height());
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let below = (2 * y + 1).min(image.height() - 1);
        halve_rows(level, image.row(2 * y), image.row(below), out);
    }
}

/// Writes a map of half the scale, `times` halved, to one of `width` columns: each value for all
/// the pixels that it stands for, disparities doubled `times` times.
pub fn double(
    coarse: &[u16],
    coarse_confidence: &[u8],
    times: u32,
    width: usize,
    disparity: &mut [u16],
    confidence: &mut [u8],
) {
    let coarse_width = (0..times).fold(width, |w, _| w.div_ceil(2));
    for (y, (disparity, confidence)) in
        disparity.chunks_exact_mut(width).zip(confidence.chunks_exact_mut(width)).enumerate()
    {
        let at = (y >> times) * coarse_width;
        for (x, (d, c)) in disparity.iter_mut().zip(confidence).enumerate() {
            let from = at + (x >> times);
            *d = (u32::from(coarse[from]) << times).min(u32::from(u16::MAX)) as u16;
            *c = coarse_confidence[from];
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
        double(&[100, 0, 300, 40_000, 5, 6], &[1, 0, 3, 4, 5, 6], 1, 5, &mut disparity, &mut confidence);
        assert_eq!(disparity[..5], [200, 200, 0, 0, 600]);
        assert_eq!(disparity[10..], [u16::MAX, u16::MAX, 10, 10, 12]);
        assert_eq!(confidence[10..], [4, 4, 5, 5, 6]);
    }
}
