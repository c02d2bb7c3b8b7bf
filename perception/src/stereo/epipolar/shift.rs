//! Shifting the rows of an image by a fraction of a pixel that changes over the image.
//!
//! There is no table: a plane needs one row and one fraction for each block of [`BLOCK`] pixels, so a correction may
//! change in every frame at no cost, and nothing is allocated.

use super::field::{RowField, place};
use crate::image::GreyView;
use crate::simd::{Level, Simd, kernel};

/// Steps of a pixel to which positions are rounded.
const STEPS: i32 = 32;
/// Pixels that share a row and a fraction. A roll of 2 px at the border of 640 px is then at most 1/10 px off.
const BLOCK: usize = 32;
/// Scale of the taps: 64 × 255, and the negative taps beside it, fit into 16 bits.
const SCALE: i32 = 64;

/// Taps of cubic interpolation (Catmull–Rom) at each step. Linear interpolation blurs: it loses 3 of 1000 matches
/// more on kitti2015 after a correction of 0.3 to 0.5 px.
const TAPS: [[i16; 4]; STEPS as usize] = taps();

const fn taps() -> [[i16; 4]; STEPS as usize] {
    let mut taps = [[0; 4]; STEPS as usize];
    let mut step = 0;
    while step < STEPS {
        let (f, n) = (step, STEPS);
        // Twice the polynomials in f / n, times n³.
        let scaled = [
            -f * n * n + 2 * f * f * n - f * f * f,
            2 * n * n * n - 5 * f * f * n + 3 * f * f * f,
            f * n * n + 4 * f * f * n - 3 * f * f * f,
            -f * f * n + f * f * f,
        ];
        let unit = 2 * n * n * n / SCALE;
        let mut tap = 0;
        while tap < 4 {
            taps[step as usize][tap] = ((scaled[tap] + unit * SCALE + unit / 2) / unit - SCALE) as i16;
            tap += 1;
        }
        // Their sum is exact: brightness does not change.
        let rest = SCALE as i16
            - (taps[step as usize][0]
                + taps[step as usize][1]
                + taps[step as usize][2]
                + taps[step as usize][3]);
        taps[step as usize][if 2 * step < STEPS { 1 } else { 2 }] += rest;
        step += 1;
    }
    taps
}

/// Blends four rows by their taps.
#[inline(always)]
fn blend<S: Simd>(_: S, rows: [&[u8]; 4], taps: [i16; 4], out: &mut [u8]) {
    let [a, b, c, d] = rows;
    for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        let [a, b, c, d] = [*a, *b, *c, *d].map(i16::from);
        let sum = a * taps[0] + b * taps[1] + c * taps[2] + d * taps[3] + SCALE as i16 / 2;
        *out = (sum / SCALE as i16).clamp(0, 255) as u8;
    }
}

kernel! { fn run_blend(rows: [&[u8]; 4], taps: [i16; 4], out: &mut [u8]) = blend }

/// Writes an image whose pixel (x, y) shows the source at row y + `field`; beyond the borders the outermost row is
/// repeated. Interpolation is cubic along the columns, so a field of zero copies the image.
///
/// `out` has the pixels of the image, row by row; of one with another size nothing is written.
pub fn shift_rows(level: Level, source: GreyView<'_>, field: &RowField, out: &mut [u8]) {
    let (width, height) = (source.width(), source.height());
    if out.len() != width * height || out.is_empty() {
        return;
    }
    let last = height as i32 - 1;
    for (y, row) in out.chunks_exact_mut(width).enumerate() {
        for (block, out) in row.chunks_mut(BLOCK).enumerate() {
            let first = block * BLOCK;
            let middle = first as f64 + 0.5 * (out.len() - 1) as f64;
            let offset = field.at(place(middle, width), place(y as f64, height));
            // Positions beyond the image show its border.
            let steps = (offset * f64::from(STEPS)).round().clamp(-1e6, 1e6) as i32;
            let (whole, step) = (y as i32 + steps.div_euclid(STEPS), steps.rem_euclid(STEPS));
            let span = first..first + out.len();
            let at = |k: i32| &source.row((whole + k).clamp(0, last) as usize)[span.clone()];
            if step == 0 {
                out.copy_from_slice(at(0));
            } else {
                run_blend(level, [at(-1), at(0), at(1), at(2)], TAPS[step as usize], out);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    #[test]
    fn the_taps_keep_brightness_and_fit_into_16_bits() {
        for (step, taps) in TAPS.iter().enumerate() {
            assert_eq!(taps.iter().sum::<i16>(), SCALE as i16, "step {step}");
            let high: i32 = taps.iter().map(|t| i32::from(*t).max(0) * 255).sum();
            let low: i32 = taps.iter().map(|t| i32::from(*t).min(0) * 255).sum();
            assert!(high + SCALE / 2 <= i32::from(i16::MAX) && low >= i32::from(i16::MIN), "step {step}");
        }
        assert_eq!((TAPS[0], TAPS[16]), ([0, 64, 0, 0], [-4, 36, 36, -4]));
    }

    #[test]
    fn rows_are_shifted_by_the_field() {
        let (width, height) = (150, 60);
        // A wave down the rows, on which cubic interpolation is good to a grey level.
        let wave = |y: f64| 128.0 + 100.0 * (y * 0.35).sin();
        let source = GreyImage::from_vec(
            (0..width * height).map(|i| wave((i / width) as f64).round() as u8).collect(),
            width,
            height,
        )
        .unwrap();
        let mut out = vec![0; width * height];
        let field = RowField { offset_px: -1.3, across_px: 0.8, down_px: 0.4 };
        shift_rows(Level::best(), source.view(), &field, &mut out);
        for y in 4..height - 4 {
            for x in 0..width {
                let truth = wave(y as f64 + field.at(place(x as f64, width), place(y as f64, height)));
                let shown = f64::from(out[y * width + x]);
                // Within half a block the field changes by 0.17 px, and the wave by 35 a pixel.
                assert!((shown - truth).abs() < 8.0, "{x}, {y}: {shown}, {truth}");
            }
        }
        // Nothing to shift, whole rows, and rows beyond the image.
        shift_rows(Level::best(), source.view(), &RowField::ZERO, &mut out);
        assert_eq!(out, source.as_slice());
        shift_rows(Level::best(), source.view(), &RowField { offset_px: 3.0, ..RowField::ZERO }, &mut out);
        assert_eq!(out[..width * (height - 3)], source.as_slice()[3 * width..]);
        assert_eq!(out[width * (height - 1)..], source.as_slice()[width * (height - 1)..]);
        for far in [1e9, f64::NAN] {
            shift_rows(
                Level::best(),
                source.view(),
                &RowField { offset_px: far, ..RowField::ZERO },
                &mut out,
            );
        }
        shift_rows(Level::best(), source.view(), &field, &mut out[1..]);
    }

    #[test]
    fn every_level_gives_the_same_bytes() {
        let mut random = fastrand::Rng::with_seed(2);
        let (width, height) = (97, 23);
        let source =
            GreyImage::from_vec((0..width * height).map(|_| random.u8(..)).collect(), width, height).unwrap();
        let field = RowField { offset_px: 0.7, across_px: -1.9, down_px: 0.6 };
        let shown = Level::available().into_iter().map(|level| {
            let mut out = vec![0; width * height];
            shift_rows(level, source.view(), &field, &mut out);
            out
        });
        let shown: Vec<_> = shown.collect();
        assert!(shown.windows(2).all(|two| two[0] == two[1]));
    }
}
