//! Pixel-locking bias: preference of a matcher for whole or half pixels, which appears as steps in depth maps.

use super::percent;
use crate::reporting::picture::Picture;
use crate::reporting::plot::{self, Series};
use crate::reporting::record::tidy;
use serde::Serialize;
use std::fmt;

/// Bins per pixel. Bin 0 is centred on the whole pixel: −1/32 to +1/32 px.
pub const BINS: usize = 16;

/// Disparities within this distance of a whole or half pixel count as near it.
const NEAR_PX: f32 = 1.0 / 16.0;

/// Histogram of the fractional parts of disparities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Fractions {
    bins: [u64; BINS],
    near: u64,
    near_half: u64,
}

impl Fractions {
    fn add(&mut self, px: f32) {
        let bin = (px * BINS as f32).round() as usize % BINS;
        self.bins[bin] += 1;
        let from_whole = (px - px.round()).abs();
        self.near += u64::from(from_whole <= NEAR_PX);
        self.near_half += u64::from(from_whole >= 0.5 - NEAR_PX);
    }

    fn merge(&mut self, other: &Self) {
        self.bins.iter_mut().zip(other.bins).for_each(|(sum, n)| *sum += n);
        self.near += other.near;
        self.near_half += other.near_half;
    }

    /// Whether steps of 1/8 px or finer occur.
    fn is_fine(&self) -> bool {
        self.bins.iter().filter(|&&n| n > 0).count() >= BINS / 2
    }
}

/// Counts the fractional parts of estimates with errors of at most 1 px, and of their ground truth, image by
/// image. Images whose ground truth has steps above 1/8 px (8-bit maps) are skipped: it has no fractional
/// parts to compare with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SubpixelHistogram {
    images: u64,
    images_left_out: u64,
    pixels: u64,
    estimate: Fractions,
    truth: Fractions,
}

/// Distribution of the fractional parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Subpixel {
    /// Number of images counted.
    pub images: u64,
    /// Number of skipped images, whose ground truth is too coarse.
    pub images_left_out: u64,
    /// Number of pixels counted.
    pub pixels: u64,
    /// Share of the estimates near a whole pixel ÷ that of the ground truth: 1 without pixel locking. `None` when no
    /// ground truth is near a whole pixel.
    pub locking_index: Option<f64>,
    /// The same for half pixels (1/2, 3/2, …).
    pub half_locking_index: Option<f64>,
    /// Estimates within 1/16 px of a whole pixel, in percent.
    pub estimate_near_percent: f64,
    /// Ground truth within 1/16 px of a whole pixel, in percent.
    pub truth_near_percent: f64,
    /// Estimates within 1/16 px of a half, in percent.
    pub estimate_near_half_percent: f64,
    /// Ground truth within 1/16 px of a half, in percent.
    pub truth_near_half_percent: f64,
    /// Estimates in each of [`BINS`] bins, in percent; the first is centred on the whole pixel.
    pub estimate_percent: Vec<f64>,
    /// The same for the ground truth of these pixels.
    pub truth_percent: Vec<f64>,
}

impl SubpixelHistogram {
    /// Counts the pixels of `mask` of one image. All slices have one value per pixel, disparities in px, negative
    /// where unknown.
    pub fn add(&mut self, truth: &[f32], mask: &[bool], estimate: &[f32]) {
        let mut image = Self::default();
        for ((&g, &d), _) in truth.iter().zip(estimate).zip(mask).filter(|(_, m)| **m) {
            if d >= 0.0 && (d - g).abs() <= 1.0 {
                image.pixels += 1;
                image.estimate.add(d);
                image.truth.add(g);
            }
        }
        if !image.truth.is_fine() {
            self.images_left_out += 1;
            return;
        }
        self.images += 1;
        self.pixels += image.pixels;
        self.estimate.merge(&image.estimate);
        self.truth.merge(&image.truth);
    }

    /// The distribution; `None` when nothing was counted.
    pub fn shares(&self) -> Option<Subpixel> {
        let share = |n: u64| tidy(percent(n, self.pixels));
        let index = |estimate: u64, truth: u64| (truth > 0).then(|| tidy(estimate as f64 / truth as f64));
        (self.pixels > 0).then(|| Subpixel {
            images: self.images,
            images_left_out: self.images_left_out,
            pixels: self.pixels,
            locking_index: index(self.estimate.near, self.truth.near),
            half_locking_index: index(self.estimate.near_half, self.truth.near_half),
            estimate_near_percent: share(self.estimate.near),
            truth_near_percent: share(self.truth.near),
            estimate_near_half_percent: share(self.estimate.near_half),
            truth_near_half_percent: share(self.truth.near_half),
            estimate_percent: self.estimate.bins.map(share).to_vec(),
            truth_percent: self.truth.bins.map(share).to_vec(),
        })
    }
}

impl Subpixel {
    /// Plots the histogram with the whole pixel in the middle.
    pub fn plot(&self) -> Picture {
        let middle_first = |values: &[f64]| -> Vec<(f64, f64)> {
            let half = values.len() as i32 / 2;
            let at = |i: i32| values[i.rem_euclid(values.len() as i32) as usize];
            (-half..half).map(|i| (f64::from(i) / f64::from(2 * half), at(i))).collect()
        };
        let series = |name: &str, values| Series { name: name.into(), points: middle_first(values) };
        let series = [series("estimate", &self.estimate_percent), series("truth", &self.truth_percent)];
        plot::bars("Fraction of the disparity", "px from the whole pixel", "%", &series)
    }
}

/// A one-line summary with a verdict.
impl fmt::Display for Subpixel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whole = self.locking_index.unwrap_or(f64::NAN);
        let half = self.half_locking_index.unwrap_or(f64::NAN);
        let (kind, index) = if half > whole { ("half-pixel", half) } else { ("pixel", whole) };
        let verdict = match index {
            index if index <= 1.15 => "no pixel".to_owned(),
            index if index <= 1.5 => format!("some {kind}"),
            index if index > 1.5 => format!("strong {kind}"),
            _ => "unknown".to_owned(),
        };
        write!(
            f,
            "sub-pixel: {verdict} locking, index {whole:.2} ({:.1} % of the estimates within 1/16 px of a whole pixel, \
             {:.1} % of the ground truth), half-pixel index {half:.2} ({:.1} %, {:.1} %); {} pixels",
            self.estimate_near_percent,
            self.truth_near_percent,
            self.estimate_near_half_percent,
            self.truth_near_half_percent,
            self.pixels
        )?;
        if self.images_left_out > 0 {
            write!(
                f,
                "; {} images skipped, their ground truth has no sub-pixel values",
                self.images_left_out
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_fall_into_centred_bins() {
        let mut f = Fractions::default();
        for (px, bin, near) in [
            (5.0, 0, true),
            (5.03, 0, true),
            (4.97, 0, true),
            (5.0625, 1, true),
            (4.9375, 15, true),
            (5.07, 1, false),
            (5.5, 8, false),
            (5.96, 15, true),
            (0.25, 4, false),
        ] {
            let before = f;
            f.add(px);
            assert_eq!(f.bins[bin], before.bins[bin] + 1, "{px}");
            assert_eq!(f.near > before.near, near, "{px}");
        }
    }

    #[test]
    fn a_matcher_of_whole_pixels_is_found_out() {
        let truth: Vec<f32> = (0..1600).map(|i| 10.0 + i as f32 / 100.0).collect();
        let mask = vec![true; truth.len()];
        let whole: Vec<f32> = truth.iter().map(|d| d.round()).collect();
        let mut histogram = SubpixelHistogram::default();
        assert_eq!(histogram.shares(), None);
        histogram.add(&truth, &mask, &whole);
        let shares = histogram.shares().unwrap();
        assert_eq!(
            (shares.pixels, shares.estimate_near_percent, shares.estimate_percent[0]),
            (1600, 100.0, 100.0)
        );
        assert!(shares.locking_index.unwrap() > 7.0 && shares.to_string().contains("strong pixel locking"));
        assert!(shares.plot().width() > 100);

        let mut fair = SubpixelHistogram::default();
        fair.add(&truth, &mask, &truth);
        // Large errors, unknown or masked pixels do not count.
        let off: Vec<f32> = truth.iter().map(|d| d + 1.1).collect();
        let mut others = fair;
        others.add(&truth, &mask, &off);
        others.add(&truth, &mask, &vec![-1.0; truth.len()]);
        others.add(&truth, &vec![false; truth.len()], &truth);
        // Neither does ground truth in steps of 1/4 px.
        let coarse: Vec<f32> = truth.iter().map(|d| (d * 4.0).round() / 4.0).collect();
        others.add(&coarse, &mask, &truth);
        let shares = others.shares().unwrap();
        assert_eq!((shares.pixels, shares.images, shares.images_left_out), (1600, 1, 4));
        let shares = fair.shares().unwrap();
        assert_eq!((shares.pixels, shares.locking_index), (1600, Some(1.0)));
        assert!(shares.to_string().contains("no pixel locking, index 1.00"), "{shares}");

        let halves: Vec<f32> = truth.iter().map(|d| d.floor() + 0.5).collect();
        let mut half = SubpixelHistogram::default();
        half.add(&truth, &mask, &halves);
        let shares = half.shares().unwrap();
        assert_eq!((shares.locking_index, shares.estimate_near_half_percent), (Some(0.0), 100.0));
        assert!(shares.to_string().contains("strong half-pixel locking, index 0.00"), "{shares}");
    }
}
