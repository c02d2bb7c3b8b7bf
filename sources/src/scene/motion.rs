//! Piecewise linear functions of position or time.

use crate::limits::MAX_WAYPOINTS;
use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};
use std::fmt;

/// Values at increasing positions; constant before the first and after the last. In a file a single number,
/// or a list of `[position, value]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoints {
    points: Vec<(f64, f64)>,
}

impl Waypoints {
    /// A constant function.
    pub fn constant(value: f64) -> Self {
        Self { points: vec![(0.0, value)] }
    }

    /// `None` when there are no points, positions do not increase or a value is not finite.
    pub fn new(points: Vec<(f64, f64)>) -> Option<Self> {
        let is_valid = !points.is_empty()
            && points.iter().all(|p| p.0.abs() < 1e6 && p.1.abs() < 1e6)
            && points.windows(2).all(|w| w[0].0 < w[1].0);
        is_valid.then_some(Self { points })
    }

    /// Whether it is constantly `value`.
    pub fn is_always(&self, value: f64) -> bool {
        self.points.iter().all(|p| p.1 == value)
    }

    /// Value at a position.
    pub fn value(&self, at: f64) -> f64 {
        self.taylor(at)[0]
    }

    /// Value and slope at a position of the line with rounded corners (smoothstep from each point to the next).
    pub fn smooth(&self, at: f64) -> (f64, f64) {
        let after = self.points.partition_point(|p| p.0 <= at);
        match (after.checked_sub(1).and_then(|k| self.points.get(k)), self.points.get(after)) {
            (Some(a), Some(b)) => {
                let way = b.0 - a.0;
                let share = (at - a.0) / way;
                let rise = b.1 - a.1;
                (a.1 + rise * share * share * (3.0 - 2.0 * share), 6.0 * rise * share * (1.0 - share) / way)
            }
            _ => (self.value(at), 0.0),
        }
    }

    /// Integral from the first position on.
    pub fn integral(&self, at: f64) -> f64 {
        self.taylor(at)[1]
    }

    /// Double integral from the first position on.
    pub fn double_integral(&self, at: f64) -> f64 {
        self.taylor(at)[2]
    }

    /// Largest absolute value.
    pub fn max_abs(&self) -> f64 {
        self.points.iter().fold(0.0, |most, p| most.max(p.1.abs()))
    }

    /// Value, integral and double integral, exact.
    fn taylor(&self, at: f64) -> [f64; 3] {
        let (mut once, mut twice) = (0.0, 0.0);
        for k in 0..self.points.len() {
            let (start, value) = self.points[k];
            let next = self.points.get(k + 1);
            let before = k == 0 && at < start;
            let slope = match next {
                Some(next) if !before => (next.1 - value) / (next.0 - start),
                _ => 0.0,
            };
            let last = before || next.is_none_or(|next| at < next.0);
            let way = if last { at - start } else { next.map_or(at, |next| next.0) - start };
            let end = value + slope * way;
            twice += once * way + value * way * way / 2.0 + slope * way * way * way / 6.0;
            once += value * way + slope * way * way / 2.0;
            if last {
                return [end, once, twice];
            }
        }
        [0.0, once, twice]
    }
}

/// The points of a list, up to the limit.
fn points<'de, T: Deserialize<'de>, A: SeqAccess<'de>>(seq: &mut A) -> Result<Vec<T>, A::Error> {
    let mut points = Vec::new();
    while let Some(point) = seq.next_element()? {
        if points.len() == MAX_WAYPOINTS {
            return Err(A::Error::custom(format!(
                "more than {MAX_WAYPOINTS} points: values between two points are interpolated; give fewer"
            )));
        }
        points.push(point);
    }
    Ok(points)
}

impl<'de> Deserialize<'de> for Waypoints {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Waypoints;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, or a list of [place, value] with increasing places")
            }
            fn visit_f64<E: Error>(self, v: f64) -> Result<Waypoints, E> {
                Waypoints::new(vec![(0.0, v)])
                    .ok_or_else(|| E::custom(format!("{v} is out of range: give a number below 1e6")))
            }
            fn visit_i64<E: Error>(self, v: i64) -> Result<Waypoints, E> {
                self.visit_f64(v as f64)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Waypoints, A::Error> {
                let points = points::<(f64, f64), A>(&mut seq)?;
                Waypoints::new(points).ok_or_else(|| {
                    A::Error::custom("give a list of [place, value] with increasing places, all below 1e6")
                })
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// A planar trajectory, linear between increasing times: `[seconds, along, lateral]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    along: Waypoints,
    lateral: Waypoints,
}

impl Path {
    /// Position at a time: along, lateral.
    pub fn at(&self, time_s: f64) -> (f64, f64) {
        (self.along.value(time_s), self.lateral.value(time_s))
    }

    /// Uniform motion from a position.
    pub fn even(along: f64, lateral: f64, speed_m_s: f64, across_m_s: f64, seconds: f64) -> Self {
        let line = |from: f64, speed: f64| Waypoints {
            points: vec![(0.0, from), (seconds.max(1.0), from + speed * seconds.max(1.0))],
        };
        Self { along: line(along, speed_m_s), lateral: line(lateral, across_m_s) }
    }
}

impl<'de> Deserialize<'de> for Path {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Points;
        impl<'de> Visitor<'de> for Points {
            type Value = Vec<(f64, f64, f64)>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of [seconds, along_m, lateral_m] with increasing seconds")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
                points(&mut seq)
            }
        }
        let points = deserializer.deserialize_seq(Points)?;
        let along = Waypoints::new(points.iter().map(|p| (p.0, p.1)).collect());
        let lateral = Waypoints::new(points.iter().map(|p| (p.0, p.2)).collect());
        match (along, lateral) {
            (Some(along), Some(lateral)) => Ok(Self { along, lateral }),
            _ => {
                Err(D::Error::custom("give a list of [seconds, along_m, lateral_m] with increasing seconds"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_are_those_of_the_line() {
        let line = Waypoints::new(vec![(1.0, 2.0), (3.0, 6.0), (4.0, 0.0)]).unwrap();
        assert_eq!([0.0, 1.0, 2.0, 3.5, 9.0].map(|t| line.value(t)), [2.0, 2.0, 4.0, 3.0, 0.0]);
        let (mut once, mut twice) = (0.0, 0.0);
        let step = 1e-4;
        for k in 0..60_000 {
            let t = 1.0 + (f64::from(k) + 0.5) * step;
            twice += (once + 0.5 * step * line.value(t)) * step;
            once += line.value(t) * step;
            if k % 9_999 == 0 {
                let at = t + 0.5 * step;
                assert!((line.integral(at) - once).abs() < 1e-3, "{at}");
                assert!((line.double_integral(at) - twice).abs() < 1e-3, "{at}");
            }
        }
        // Before the first position the value continues.
        assert_eq!(line.integral(-1.0), -4.0);
        assert_eq!(line.double_integral(-1.0), 4.0);
    }

    #[test]
    fn a_smooth_line_meets_its_points_and_has_its_own_slope() {
        let line = Waypoints::new(vec![(1.0, 2.0), (3.0, 6.0), (4.0, 0.0)]).unwrap();
        for (at, value) in [(0.0, 2.0), (1.0, 2.0), (2.0, 4.0), (3.0, 6.0), (3.5, 3.0), (9.0, 0.0)] {
            let (found, slope) = line.smooth(at);
            assert!((found - value).abs() < 1e-12, "{at}");
            let around = (line.smooth(at + 1e-6).0 - line.smooth(at - 1e-6).0) / 2e-6;
            assert!((around - slope).abs() < 1e-4, "{at}: {around} {slope}");
        }
    }

    #[test]
    fn places_must_rise() {
        assert!(Waypoints::new(vec![(0.0, 1.0), (0.0, 2.0)]).is_none());
        assert!(Waypoints::new(vec![(0.0, f64::NAN)]).is_none());
        assert!(Waypoints::new(vec![]).is_none());
    }

    #[test]
    fn an_even_path_is_even() {
        assert_eq!(Path::even(10.0, -1.0, 2.0, 0.5, 4.0).at(2.0), (14.0, 0.0));
    }
}
