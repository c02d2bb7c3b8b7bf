//! Scores of one disparity map, and their mean over maps.

use super::percent;
use serde::ser::{Serialize, SerializeMap, Serializer};

/// Names of the scores, in table order.
pub const COLUMNS: [&str; 8] = ["dens", "bad1", "bad2", "bad3", "D1", "epe", "hole3", "val3"];

/// Scores over the pixels of one region. All but `epe` are in percent of those pixels. The error scores, except
/// `hole3` and `val3`, refer to the map with filled holes ([`super::fill::interpolate_background`]), as in
/// KITTI. NaN where no pixel counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scores {
    /// Pixels with an estimate before filling.
    pub dens: f64,
    /// Errors above 1 px.
    pub bad1: f64,
    /// Errors above 2 px.
    pub bad2: f64,
    /// Errors above 3 px: KITTI 2012's main metric.
    pub bad3: f64,
    /// Errors above 3 px and 5 % of the true disparity: KITTI 2015's main metric.
    pub d1: f64,
    /// Mean absolute error in px.
    pub epe: f64,
    /// Holes and errors above 3 px, without filling.
    pub hole3: f64,
    /// Errors above 3 px, in percent of the pixels with an estimate.
    pub val3: f64,
}

impl Scores {
    /// The values in the order of [`COLUMNS`].
    pub fn values(&self) -> [f64; 8] {
        let Self { dens, bad1, bad2, bad3, d1, epe, hole3, val3 } = *self;
        [dens, bad1, bad2, bad3, d1, epe, hole3, val3]
    }

    fn from_values([dens, bad1, bad2, bad3, d1, epe, hole3, val3]: [f64; 8]) -> Self {
        Self { dens, bad1, bad2, bad3, d1, epe, hole3, val3 }
    }
}

/// Serialised under the names of [`COLUMNS`] with four decimals; `null` for NaN.
impl Serialize for Scores {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(COLUMNS.len()))?;
        for (name, value) in COLUMNS.iter().zip(self.values()) {
            map.serialize_entry(name, &crate::reporting::record::tidy_finite(value))?;
        }
        map.end()
    }
}

/// Scores an estimate over the pixels of `mask`. All slices have one value per pixel, disparities in px: `truth`
/// positive inside the mask, `estimate` negative where unknown, `filled` the same map without holes.
///
/// # Panics
/// When the slices have different lengths.
pub fn score(truth: &[f32], mask: &[bool], estimate: &[f32], filled: &[f32]) -> Scores {
    let pixels = truth.len();
    assert!([mask.len(), estimate.len(), filled.len()].iter().all(|&n| n == pixels));
    let (mut count, mut known, mut sum) = (0, 0, 0.0);
    let (mut above, mut d1, mut wrong) = ([0; 3], 0, 0);
    for i in (0..pixels).filter(|&i| mask[i]) {
        let error = (filled[i] - truth[i]).abs();
        count += 1;
        sum += f64::from(error);
        for (n, limit) in above.iter_mut().zip([1.0, 2.0, 3.0]) {
            *n += u64::from(error > limit);
        }
        d1 += u64::from(error > 3.0 && error > 0.05 * truth[i]);
        if estimate[i] >= 0.0 {
            known += 1;
            wrong += u64::from((estimate[i] - truth[i]).abs() > 3.0);
        }
    }
    Scores {
        dens: percent(known, count),
        bad1: percent(above[0], count),
        bad2: percent(above[1], count),
        bad3: percent(above[2], count),
        d1: percent(d1, count),
        epe: sum / count as f64,
        hole3: percent(count - known + wrong, count),
        val3: percent(wrong, known),
    }
}

/// Mean of each score over the maps that have it.
pub fn mean<'a>(scores: impl IntoIterator<Item = &'a Scores>) -> Scores {
    let (mut sums, mut counts) = ([0.0; 8], [0_u32; 8]);
    for score in scores {
        for (i, value) in score.values().into_iter().enumerate().filter(|(_, v)| v.is_finite()) {
            sums[i] += value;
            counts[i] += 1;
        }
    }
    Scores::from_values(std::array::from_fn(|i| sums[i] / f64::from(counts[i])))
}

#[cfg(test)]
mod tests {
    use super::super::fill::interpolate_background;
    use super::*;

    #[test]
    fn a_row_is_scored_as_worked_out_by_hand() {
        // Unknown ground truth, exact, 1.5 off, a hole that its neighbours fill with 10.5 (0.5 off), 4 off at 100 px
        // (within 5 %), 4 off at 40 px, a hole filled with 44 (24 off), 3 off.
        let truth = [-1.0, 10.0, 12.0, 10.0, 100.0, 40.0, 20.0, 47.0];
        let estimate = [7.0, 10.0, 10.5, -1.0, 104.0, 44.0, -1.0, 44.0];
        let mask = truth.map(|d| d > 0.0);
        let mut filled = estimate;
        interpolate_background(&mut filled, 8, 1);
        assert_eq!((filled[3], filled[6]), (10.5, 44.0));
        let s = score(&truth, &mask, &estimate, &filled);
        let share = |n: u32| 100.0 * f64::from(n) / 7.0;
        assert_eq!(s.dens, share(5));
        assert_eq!((s.bad1, s.bad2, s.bad3), (share(5), share(4), share(3)));
        assert_eq!(s.d1, share(2));
        assert_eq!(s.epe, (0.0 + 1.5 + 0.5 + 4.0 + 4.0 + 24.0 + 3.0) / 7.0);
        assert_eq!((s.hole3, s.val3), (share(4), 40.0));
    }

    #[test]
    fn what_has_no_value_stays_out_of_the_mean() {
        let none = score(&[5.0], &[false], &[5.0], &[5.0]);
        assert!(none.values().iter().all(|v| v.is_nan()));
        let holes = score(&[5.0], &[true], &[-1.0], &[0.0]);
        assert!(holes.val3.is_nan() && holes.hole3 == 100.0 && holes.epe == 5.0);
        let good = score(&[5.0, 6.0], &[true, true], &[5.0, 6.5], &[5.0, 6.5]);
        let m = mean([&none, &holes, &good]);
        assert_eq!((m.dens, m.epe, m.val3, m.bad3), (50.0, 2.625, 0.0, 50.0));
        let json = serde_json::to_value(mean([&none])).unwrap();
        assert!(json["D1"].is_null() && json.as_object().unwrap().len() == COLUMNS.len());
    }
}
