//! Time series of unbounded duration in bounded memory, and its robust slope.

/// Maximum number of buckets; when full, neighbours are merged and each spans twice the time.
const CAPACITY: usize = 720;

/// A time interval.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bucket {
    index: u64,
    count: u32,
    time_sum: f64,
    sum: f64,
    least: f64,
    greatest: f64,
}

/// A point of a time series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Mean time of the samples, in seconds.
    pub at_s: f64,
    /// Mean value.
    pub mean: f64,
    /// Minimum value.
    pub least: f64,
    /// Maximum value.
    pub greatest: f64,
}

/// A time series.
#[derive(Clone, Debug)]
pub struct Trend {
    buckets: Vec<Bucket>,
    width_s: f64,
}

/// Slope of a time series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// Change per second: the median of the slopes between all pairs of points (Theil–Sen estimator), robust
    /// against steps and outliers.
    pub per_s: f64,
    /// Lower end of the 95 % confidence interval (Sen's; too narrow for correlated neighbours).
    pub low_per_s: f64,
    /// Upper end of that interval.
    pub high_per_s: f64,
    /// Time between the first and the last point, in seconds.
    pub span_s: f64,
}

impl Trend {
    /// An empty series with points at least `width_s` seconds apart.
    pub fn new(width_s: f64) -> Self {
        Self { buckets: Vec::with_capacity(CAPACITY), width_s }
    }

    /// Adds a sample; times must not decrease. Values that are not finite are skipped.
    pub fn add(&mut self, at_s: f64, value: f64) {
        if !(value.is_finite() && at_s.is_finite()) {
            return;
        }
        let mut index = (at_s.max(0.0) / self.width_s) as u64;
        let is_new = self.buckets.last().is_none_or(|last| last.index < index);
        if is_new && self.buckets.len() >= CAPACITY {
            self.join();
            index = (at_s.max(0.0) / self.width_s) as u64;
        }
        match self.buckets.last_mut() {
            Some(last) if last.index >= index => {
                last.count += 1;
                last.time_sum += at_s;
                last.sum += value;
                last.least = last.least.min(value);
                last.greatest = last.greatest.max(value);
            }
            _ => self.buckets.push(Bucket {
                index,
                count: 1,
                time_sum: at_s,
                sum: value,
                least: value,
                greatest: value,
            }),
        }
    }

    fn join(&mut self) {
        self.width_s *= 2.0;
        let mut joined: Vec<Bucket> = Vec::with_capacity(CAPACITY);
        for bucket in &self.buckets {
            let index = bucket.index / 2;
            match joined.last_mut() {
                Some(last) if last.index == index => {
                    last.count = last.count.saturating_add(bucket.count);
                    last.time_sum += bucket.time_sum;
                    last.sum += bucket.sum;
                    last.least = last.least.min(bucket.least);
                    last.greatest = last.greatest.max(bucket.greatest);
                }
                _ => joined.push(Bucket { index, ..*bucket }),
            }
        }
        self.buckets = joined;
    }

    /// The points in order of time.
    pub fn points(&self) -> impl Iterator<Item = Point> {
        self.buckets.iter().map(|b| Point {
            at_s: b.time_sum / f64::from(b.count),
            mean: b.sum / f64::from(b.count),
            least: b.least,
            greatest: b.greatest,
        })
    }

    /// The maximum from `from_s` on.
    pub fn greatest(&self, from_s: f64) -> Option<f64> {
        self.points().filter(|p| p.at_s >= from_s).map(|p| p.greatest).reduce(f64::max)
    }

    /// Mean of all points between two times.
    pub fn mean(&self, from_s: f64, to_s: f64) -> Option<f64> {
        let (count, sum) = self
            .points()
            .filter(|p| (from_s..to_s).contains(&p.at_s))
            .fold((0.0, 0.0), |(count, sum), p| (count + 1.0, sum + p.mean));
        (count > 0.0).then(|| sum / count)
    }

    /// Rise of the floor: minimum of the last quarter of the time from `from_s` on, minus the minimum of the first
    /// quarter. Temporary rises do not count.
    pub fn floor_rise(&self, from_s: f64) -> Option<f64> {
        let points: Vec<Point> = self.points().filter(|p| p.at_s >= from_s).collect();
        let quarter = points.len() / 4;
        if quarter == 0 {
            return None;
        }
        let least = |part: &[Point]| part.iter().map(|p| p.least).reduce(f64::min);
        Some(least(&points[points.len() - quarter..])? - least(&points[..quarter])?)
    }

    /// The slope from `from_s` on; `None` for fewer than eight points.
    pub fn slope(&self, from_s: f64) -> Option<Slope> {
        let points: Vec<Point> = self.points().filter(|p| p.at_s >= from_s).collect();
        let n = points.len();
        if n < 8 {
            return None;
        }
        let mut slopes = Vec::with_capacity(n * (n - 1) / 2);
        for (i, a) in points.iter().enumerate() {
            slopes.extend(
                points[i + 1..]
                    .iter()
                    .filter(|b| b.at_s > a.at_s)
                    .map(|b| (b.mean - a.mean) / (b.at_s - a.at_s)),
            );
        }
        if slopes.is_empty() {
            return None;
        }
        slopes.sort_unstable_by(f64::total_cmp);
        let count = slopes.len();
        let middle = |i: usize| slopes[i.min(count - 1)];
        let per_s = (middle((count - 1) / 2) + middle(count / 2)) / 2.0;
        // Variance of Kendall's S.
        let m = n as f64;
        let spread = 1.96 * (m * (m - 1.0) * (2.0 * m + 5.0) / 18.0).sqrt();
        let rank = |signed: f64| ((count as f64 + signed) / 2.0).clamp(0.0, (count - 1) as f64) as usize;
        Some(Slope {
            per_s,
            low_per_s: middle(rank(-spread)),
            high_per_s: middle(rank(spread)),
            span_s: points[n - 1].at_s - points[0].at_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_found_in_noise_and_steps_do_not_move_it() {
        println!("seed 7");
        let mut random = fastrand::Rng::with_seed(7);
        let (mut rising, mut flat) = (Trend::new(1.0), Trend::new(1.0));
        for second in 0..600 {
            let noise = random.f64() * 40_000.0;
            rising.add(f64::from(second), 5e7 + 300.0 * f64::from(second) + noise);
            // One allocation half-way, one outlier.
            let step = if second > 300 { 100_000.0 } else { 0.0 };
            let outlier = if second == 200 { 1e9 } else { 0.0 };
            flat.add(f64::from(second), 5e7 + step + outlier);
        }
        let slope = rising.slope(60.0).unwrap();
        assert!((slope.per_s - 300.0).abs() < 30.0, "{slope:?}");
        assert!(slope.low_per_s < 300.0 && slope.high_per_s > 300.0, "{slope:?}");
        assert!((slope.span_s - 539.0).abs() < 1.5);
        assert!(flat.slope(301.0).unwrap().per_s.abs() < 1e-9);
        // With the step in the middle, only a minority of the pairs spans it.
        assert!(flat.slope(60.0).unwrap().per_s < 300.0);
    }

    #[test]
    fn memory_does_not_grow_and_nothing_is_lost() {
        let mut trend = Trend::new(1.0);
        for second in 0..100_000 {
            trend.add(f64::from(second), f64::from(second) * 2.0);
        }
        assert!(trend.buckets.len() <= CAPACITY && trend.buckets.capacity() <= 2 * CAPACITY);
        assert_eq!(trend.buckets.iter().map(|b| u64::from(b.count)).sum::<u64>(), 100_000);
        assert!((trend.slope(0.0).unwrap().per_s - 2.0).abs() < 1e-6);
        assert_eq!(trend.greatest(0.0), Some(199_998.0));
        assert!((trend.mean(0.0, 1e9).unwrap() - 99_999.0).abs() < 600.0);
        trend.add(f64::NAN, 1.0);
        trend.add(1.0, f64::INFINITY);
        assert_eq!(trend.greatest(0.0), Some(199_998.0));
    }

    #[test]
    fn only_a_floor_that_rises_counts_as_growth() {
        let trend = |value: &dyn Fn(u32) -> f64| {
            let mut trend = Trend::new(1.0);
            (0..100).for_each(|s| trend.add(f64::from(s), value(s)));
            trend.floor_rise(0.0)
        };
        assert_eq!(trend(&|s| 40.0 + f64::from(s % 3)), Some(0.0));
        assert_eq!(trend(&|s| 40.0 + f64::from(s / 10)), Some(7.0));
        assert_eq!(Trend::new(1.0).floor_rise(0.0), None);
        assert_eq!(Trend::new(1.0).slope(0.0), None);
    }
}
