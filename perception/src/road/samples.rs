//! Every fourth column of a map: what the road's surface is measured at.

use super::tilt::Tilt;
use crate::depth::DepthView;
use crate::simd::rounding::truncate_f64;
use crate::simd::{Level, Simd, kernel};

/// Columns between samples.
const STEP: usize = 4;
/// Sums that are kept beside each other, and classes that are counted so.
const FOLD: usize = 8;
const BESIDE: usize = 4;

/// The samples of a map, with memory allocated once.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Disparity of each, row by row, in 1/256 px; 0 = unknown.
    disparity: Vec<u16>,
    columns: usize,
    /// Class of each sample of a row.
    classes: Vec<u8>,
    level: Level,
}

/// Classes of how far a sample is off the road.
#[derive(Clone, Copy, Debug)]
pub struct Classes {
    /// Where the first one begins, in px.
    pub from_px: f64,
    /// Whether what lies beyond the road is as far off as what lies before it.
    pub folded: bool,
    /// Classes in a pixel.
    pub per_px: f64,
    /// How many.
    pub count: u8,
}

/// Sums over samples: of their columns off the principal one, and of their disparities off the road.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Samples.
    pub count: f64,
    /// Σ columns.
    pub across: f64,
    /// Σ columns².
    pub square: f64,
    /// Σ disparities, in px.
    pub residual: f64,
    /// Σ columns·disparities.
    pub product: f64,
}

impl Samples {
    /// Room for maps of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        // Whole groups: what lies behind the last column is unknown.
        let columns = width.div_ceil(STEP).next_multiple_of(FOLD);
        Self {
            disparity: vec![0; columns * height],
            columns,
            classes: vec![0; columns],
            level: Level::best(),
        }
    }

    /// Takes the rows of a map from `top` on; those of less confidence are unknown.
    ///
    /// # Panics
    /// When the map has another size.
    pub fn take(&mut self, depth: DepthView<'_>, top: usize, min_confidence: u8) {
        let columns = depth.width().div_ceil(STEP);
        let size = (columns.next_multiple_of(FOLD), depth.height() * self.columns);
        assert_eq!(size, (self.columns, self.disparity.len()));
        for (y, row) in self.disparity.chunks_exact_mut(self.columns).enumerate().skip(top) {
            let (row, _) = row.split_at_mut(columns);
            sample(self.level, depth.disparity(y), depth.confidence(y), min_confidence, row);
        }
    }

    /// Sums over the samples of some rows that are within `tolerance_px` of the road; `road_px` is its
    /// disparity in every row.
    pub fn moments(
        &self,
        rows: impl Iterator<Item = usize>,
        road_px: &[f32],
        tilt: Tilt,
        tolerance_px: f64,
    ) -> Moments {
        let mut sums = [[0.0; FOLD]; 5];
        for y in rows {
            add_near(self.level, self.row(y), tilt, f64::from(road_px[y]), tolerance_px, &mut sums);
        }
        let [count, across, square, residual, product] = sums.map(|sums| sums.iter().sum());
        Moments { count, across, square, residual, product }
    }

    /// Counts the samples of row `y` by how far they are off a road of `road_px`; what belongs to no class is
    /// left out.
    ///
    /// # Panics
    /// When there is not one count a class.
    pub fn count(&mut self, y: usize, road_px: f64, tilt: Tilt, classes: Classes, counts: &mut [u32]) {
        assert_eq!(counts.len(), usize::from(classes.count));
        let row = &self.disparity[y * self.columns..][..self.columns];
        classify(self.level, row, tilt, road_px, classes, &mut self.classes);
        // Neighbours are of one class mostly: one count would wait for the other.
        let mut beside = [[0_u16; 256]; BESIDE];
        let (four, _) = self.classes.as_chunks::<BESIDE>();
        for four in four {
            for (counts, &class) in beside.iter_mut().zip(four) {
                counts[usize::from(class)] = counts[usize::from(class)].saturating_add(1);
            }
        }
        for (class, count) in counts.iter_mut().enumerate() {
            *count += beside.iter().map(|counts| u32::from(counts[class])).sum::<u32>();
        }
    }

    fn row(&self, y: usize) -> &[u16] {
        &self.disparity[y * self.columns..][..self.columns]
    }
}

kernel! {
    /// Every fourth pixel of a row that is known well enough; 0 for the others.
    fn sample(row: &[u16], confidence: &[u8], min_confidence: u8, out: &mut [u16]) = every_fourth
}

#[inline(always)]
fn every_fourth<S: Simd>(_: S, row: &[u16], confidence: &[u8], min_confidence: u8, out: &mut [u16]) {
    let known = |d: u16, confidence: u8| if confidence >= min_confidence { d } else { 0 };
    let (whole, rest) = row.as_chunks::<STEP>();
    let (sure, doubt) = confidence.as_chunks::<STEP>();
    for ((row, sure), out) in whole.iter().zip(sure).zip(out.iter_mut()) {
        *out = known(row[0], sure[0]);
    }
    if let (Some(&d), Some(&confidence), Some(out)) = (rest.first(), doubt.first(), out.last_mut()) {
        *out = known(d, confidence);
    }
}

kernel! {
    /// Adds the samples of a row that are near the road: count, Σ columns, Σ columns², Σ residuals, and
    /// Σ columns·residuals.
    fn add_near(
        row: &[u16],
        tilt: Tilt,
        road_px: f64,
        tolerance_px: f64,
        sums: &mut [[f64; FOLD]; 5],
    ) = add_each
}

#[inline(always)]
fn add_each<S: Simd>(
    _: S,
    row: &[u16],
    tilt: Tilt,
    road_px: f64,
    tolerance_px: f64,
    sums: &mut [[f64; FOLD]; 5],
) {
    let [mut count, mut across, mut square, mut residual, mut product] = *sums;
    for (group, eight) in row.as_chunks::<FOLD>().0.iter().enumerate() {
        for i in 0..FOLD {
            let x = f64::from((STEP * (FOLD * group + i)) as i32);
            let px = f64::from(eight[i]) / 256.0;
            let near = eight[i] > 0 && (tilt.level(x, px) - road_px).abs() < tolerance_px;
            let (off, from) = if near { (x - tilt.cx_px, px - road_px) } else { (0.0, 0.0) };
            count[i] += if near { 1.0 } else { 0.0 };
            across[i] += off;
            square[i] += off * off;
            residual[i] += from;
            product[i] += off * from;
        }
    }
    *sums = [count, across, square, residual, product];
}

kernel! {
    /// The class of each sample of a row; the number of classes for what belongs to none.
    fn classify(row: &[u16], tilt: Tilt, road_px: f64, classes: Classes, out: &mut [u8]) = classify_each
}

#[inline(always)]
fn classify_each<S: Simd>(_: S, row: &[u16], tilt: Tilt, road_px: f64, classes: Classes, out: &mut [u8]) {
    let Classes { from_px, folded, per_px, count } = classes;
    let most = f64::from(count);
    for (i, (&d, class)) in row.iter().zip(out).enumerate() {
        let off = tilt.level(f64::from((STEP * i) as i32), f64::from(d) / 256.0) - road_px;
        let place = (if folded { off.abs() } else { off } - from_px) * per_px;
        let inside = d > 0 && place >= 0.0 && place < most;
        *class = truncate_f64(if inside { place } else { most }) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::DisparityView;

    const TILT: Tilt = Tilt { roll: 0.01, offset_px: -0.3, cx_px: 40.0 };

    /// Disparities about a road of 10 px and 90 columns, some of them unknown, in two rows.
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
        samples.take(depth, 0, 100);
        samples
    }

    /// Columns and disparities, in px, of what is known in a row.
    fn known(y: usize) -> Vec<(f64, f64)> {
        let (map, confidence) = map();
        let sure = (0..90).step_by(4).filter(|x| map[90 * y + x] > 0 && confidence[90 * y + x] >= 100);
        sure.map(|x| (x as f64, f64::from(map[90 * y + x]) / 256.0)).collect()
    }

    #[test]
    fn all_levels_sum_what_is_near_the_road() {
        let mut expected = Moments::default();
        for (x, px) in (0..2).flat_map(known) {
            if (TILT.level(x, px) - 10.0).abs() < 1.5 {
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
    fn all_levels_count_the_classes_that_one_by_one_gives() {
        let signed = Classes { from_px: -1.0, folded: false, per_px: 10.0, count: 20 };
        let folded = Classes { from_px: 0.0, folded: true, per_px: 7.0, count: 9 };
        for classes in [signed, folded] {
            for y in 0..2 {
                let mut expected = vec![0; usize::from(classes.count)];
                for (x, px) in known(y) {
                    let off = TILT.level(x, px) - 10.0;
                    let off = if classes.folded { off.abs() } else { off } - classes.from_px;
                    if off >= 0.0
                        && let Some(count) = expected.get_mut((off * classes.per_px) as usize)
                    {
                        *count += 1;
                    }
                }
                assert!(expected.iter().sum::<u32>() > 3, "{expected:?}");
                for level in Level::available() {
                    let mut counts = vec![0; usize::from(classes.count)];
                    samples(level).count(y, 10.0, TILT, classes, &mut counts);
                    assert_eq!(counts, expected, "{}", level.name());
                }
            }
        }
    }
}
