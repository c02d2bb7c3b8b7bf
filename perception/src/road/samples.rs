//! Every fourth column of a disparity map: the samples from which the road surface is measured.

use super::tilt::Tilt;
use crate::depth::DepthView;
use crate::simd::rounding::truncate_f64;
use crate::simd::{Level, Simd, kernel};

/// Columns between samples.
const STEP: usize = 4;
/// Parallel accumulators of the sums, and of the histogram counts.
const LANES: usize = 8;
const PARTIAL_COUNTS: usize = 4;

/// Samples of a map; memory is allocated once.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Disparity of each sample, row by row, in 1/256 px; 0 = unknown.
    disparity: Vec<u16>,
    columns: usize,
    /// Bin of each sample of a row.
    bins: Vec<u8>,
    level: Level,
}

/// Bins of the residual of a sample against the road.
#[derive(Clone, Copy, Debug)]
pub struct ResidualBins {
    /// Start of the first bin, in px.
    pub start_px: f64,
    /// Whether the absolute residual is binned instead of the signed one.
    pub absolute: bool,
    /// Bins per px.
    pub bins_per_px: f64,
    /// Number of bins.
    pub count: u8,
}

/// Moments of samples: columns relative to the principal point, residuals relative to the road.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Number of samples.
    pub count: f64,
    /// Σ columns.
    pub across: f64,
    /// Σ columns².
    pub square: f64,
    /// Σ residuals, in px.
    pub residual: f64,
    /// Σ columns · residuals.
    pub product: f64,
}

impl Samples {
    /// Memory for maps of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        // Rows are padded to whole groups; samples beyond the last column are unknown.
        let columns = width.div_ceil(STEP).next_multiple_of(LANES);
        Self { disparity: vec![0; columns * height], columns, bins: vec![0; columns], level: Level::best() }
    }

    /// Reads the rows of a map from `top` on; pixels with less confidence than `min_confidence` are unknown.
    ///
    /// # Panics
    /// When the size of the map differs from that of the workspace.
    pub fn update(&mut self, depth: DepthView<'_>, top: usize, min_confidence: u8) {
        let columns = depth.width().div_ceil(STEP);
        let size = (columns.next_multiple_of(LANES), depth.height() * self.columns);
        assert_eq!(size, (self.columns, self.disparity.len()));
        for (y, row) in self.disparity.chunks_exact_mut(self.columns).enumerate().skip(top) {
            let (row, _) = row.split_at_mut(columns);
            sample(self.level, depth.disparity(y), depth.confidence(y), min_confidence, row);
        }
    }

    /// Moments of the samples of some rows that lie within `tolerance_px` of the road; `road_px` is the
    /// disparity of the road in each row.
    pub fn moments(
        &self,
        rows: impl Iterator<Item = usize>,
        road_px: &[f32],
        tilt: Tilt,
        tolerance_px: f64,
    ) -> Moments {
        let mut sums = [[0.0; LANES]; 5];
        for y in rows {
            add_inliers(self.level, self.row(y), tilt, f64::from(road_px[y]), tolerance_px, &mut sums);
        }
        let [count, across, square, residual, product] = sums.map(|sums| sums.iter().sum());
        Moments { count, across, square, residual, product }
    }

    /// Adds the samples of row `y` to a histogram of their residuals against a road of `road_px`; samples
    /// outside all bins are skipped.
    ///
    /// # Panics
    /// When the length of `counts` differs from the number of bins.
    pub fn count_residuals(
        &mut self,
        y: usize,
        road_px: f64,
        tilt: Tilt,
        bins: ResidualBins,
        counts: &mut [u32],
    ) {
        assert_eq!(counts.len(), usize::from(bins.count));
        let row = &self.disparity[y * self.columns..][..self.columns];
        bin_residuals(self.level, row, tilt, road_px, bins, &mut self.bins);
        // Neighbouring samples mostly share a bin: separate histograms avoid a dependency between increments.
        let mut partial = [[0_u16; 256]; PARTIAL_COUNTS];
        let (four, _) = self.bins.as_chunks::<PARTIAL_COUNTS>();
        for four in four {
            for (counts, &bin) in partial.iter_mut().zip(four) {
                counts[usize::from(bin)] = counts[usize::from(bin)].saturating_add(1);
            }
        }
        for (bin, count) in counts.iter_mut().enumerate() {
            *count += partial.iter().map(|counts| u32::from(counts[bin])).sum::<u32>();
        }
    }

    fn row(&self, y: usize) -> &[u16] {
        &self.disparity[y * self.columns..][..self.columns]
    }
}

kernel! {
    /// Every fourth pixel of a row; 0 if its disparity is unknown or its confidence is too low.
    fn sample(row: &[u16], confidence: &[u8], min_confidence: u8, out: &mut [u16]) = sample_each
}

#[inline(always)]
fn sample_each<S: Simd>(_: S, row: &[u16], confidence: &[u8], min_confidence: u8, out: &mut [u16]) {
    let known = |d: u16, confidence: u8| if confidence >= min_confidence { d } else { 0 };
    let (whole, rest) = row.as_chunks::<STEP>();
    let (whole_confidence, rest_confidence) = confidence.as_chunks::<STEP>();
    for ((row, confidence), out) in whole.iter().zip(whole_confidence).zip(out.iter_mut()) {
        *out = known(row[0], confidence[0]);
    }
    if let (Some(&d), Some(&confidence), Some(out)) = (rest.first(), rest_confidence.first(), out.last_mut())
    {
        *out = known(d, confidence);
    }
}

kernel! {
    /// Adds the samples of a row that are near the road: count, Σ columns, Σ columns², Σ residuals, and Σ
    /// columns · residuals.
    fn add_inliers(
        row: &[u16],
        tilt: Tilt,
        road_px: f64,
        tolerance_px: f64,
        sums: &mut [[f64; LANES]; 5],
    ) = add_inliers_each
}

#[inline(always)]
fn add_inliers_each<S: Simd>(
    _: S,
    row: &[u16],
    tilt: Tilt,
    road_px: f64,
    tolerance_px: f64,
    sums: &mut [[f64; LANES]; 5],
) {
    let [mut count, mut across, mut square, mut residual, mut product] = *sums;
    for (group, eight) in row.as_chunks::<LANES>().0.iter().enumerate() {
        for i in 0..LANES {
            let x = f64::from((STEP * (LANES * group + i)) as i32);
            let px = f64::from(eight[i]) / 256.0;
            let near = eight[i] > 0 && (tilt.levelled_px(x, px) - road_px).abs() < tolerance_px;
            let (column, residual_px) = if near { (x - tilt.cx_px, px - road_px) } else { (0.0, 0.0) };
            count[i] += if near { 1.0 } else { 0.0 };
            across[i] += column;
            square[i] += column * column;
            residual[i] += residual_px;
            product[i] += column * residual_px;
        }
    }
    *sums = [count, across, square, residual, product];
}

kernel! {
    /// Computes the bin of each sample of a row; the number of bins for samples outside all bins.
    fn bin_residuals(row: &[u16], tilt: Tilt, road_px: f64, bins: ResidualBins, out: &mut [u8]) = bin_residuals_each
}

#[inline(always)]
fn bin_residuals_each<S: Simd>(
    _: S,
    row: &[u16],
    tilt: Tilt,
    road_px: f64,
    bins: ResidualBins,
    out: &mut [u8],
) {
    let ResidualBins { start_px, absolute, bins_per_px, count } = bins;
    let bin_count = f64::from(count);
    for (i, (&d, bin)) in row.iter().zip(out).enumerate() {
        let residual_px = tilt.levelled_px(f64::from((STEP * i) as i32), f64::from(d) / 256.0) - road_px;
        let position = (if absolute { residual_px.abs() } else { residual_px } - start_px) * bins_per_px;
        let inside = d > 0 && position >= 0.0 && position < bin_count;
        *bin = truncate_f64(if inside { position } else { bin_count }) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::DisparityView;

    const TILT: Tilt = Tilt { roll: 0.01, offset_px: -0.3, cx_px: 40.0 };

    /// Two rows of 90 columns with disparities around a road of 10 px, some of them unknown.
    fn map() -> (Vec<u16>, Vec<u8>) {
        let mut random = fastrand::Rng::with_seed(5);
        let mut pixel = |_| if random.u8(..) < 40 { 0 } else { random.u16(2200..2950) };
        let map = (0..180).map(&mut pixel).collect();
        (map, (0..180).map(|_| random.u8(..)).collect())
    }

    fn samples(level: Level) -> Samples {
        let (map, confidence) = map();
        let depth = DepthView::new(DisparityView::new(&map, 90, 2).unwrap(), &confidence).unwrap();
        let mut samples = Samples { level, ..Samples::new(90, 2) };
        samples.update(depth, 0, 100);
        samples
    }

    /// Columns and disparities, in px, of the known samples of a row.
    fn known(y: usize) -> Vec<(f64, f64)> {
        let (map, confidence) = map();
        let sure = (0..90).step_by(4).filter(|x| map[90 * y + x] > 0 && confidence[90 * y + x] >= 100);
        sure.map(|x| (x as f64, f64::from(map[90 * y + x]) / 256.0)).collect()
    }

    #[test]
    fn all_levels_sum_the_inliers() {
        let mut expected = Moments::default();
        for (x, px) in (0..2).flat_map(known) {
            if (TILT.levelled_px(x, px) - 10.0).abs() < 1.5 {
                let (off, from) = (x - 40.0, px - 10.0);
                expected.count += 1.0;
                expected.across += off;
                expected.square += off * off;
                expected.residual += from;
                expected.product += off * from;
            }
        }
        assert!(expected.count > 5.0, "{expected:?}");
        let plain = samples(Level::PLAIN).moments(0..2, &[10.0; 2], TILT, 1.5);
        for (a, b) in [
            (plain.count, expected.count),
            (plain.across, expected.across),
            (plain.square, expected.square),
            (plain.residual, expected.residual),
            (plain.product, expected.product),
        ] {
            assert!((a - b).abs() <= 1e-9 * b.abs(), "{plain:?} {expected:?}");
        }
        for level in Level::available() {
            assert_eq!(samples(level).moments(0..2, &[10.0; 2], TILT, 1.5), plain, "{}", level.name());
        }
    }

    #[test]
    fn all_levels_count_residuals_like_the_reference() {
        let signed = ResidualBins { start_px: -1.0, absolute: false, bins_per_px: 10.0, count: 20 };
        let absolute = ResidualBins { start_px: 0.0, absolute: true, bins_per_px: 7.0, count: 9 };
        for bins in [signed, absolute] {
            for y in 0..2 {
                let mut expected = vec![0; usize::from(bins.count)];
                for (x, px) in known(y) {
                    let off = TILT.levelled_px(x, px) - 10.0;
                    let off = if bins.absolute { off.abs() } else { off } - bins.start_px;
                    if off >= 0.0
                        && let Some(count) = expected.get_mut((off * bins.bins_per_px) as usize)
                    {
                        *count += 1;
                    }
                }
                assert!(expected.iter().sum::<u32>() > 3, "{expected:?}");
                for level in Level::available() {
                    let mut counts = vec![0; usize::from(bins.count)];
                    samples(level).count_residuals(y, 10.0, TILT, bins, &mut counts);
                    assert_eq!(counts, expected, "{}", level.name());
                }
            }
        }
    }
}
