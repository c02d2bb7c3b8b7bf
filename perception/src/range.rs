//! How far ahead things are looked for, in metres: as far as the rig tells them from the road, and as far as the speed needs.
//!
//! What is looked for farther away costs clutter and is of use only where it can be met soon: twice the own speed is that of traffic
//! that comes towards us as fast.

use crate::rig::Rig;

/// Smallest disparity at which things are told from the road at any speed, in px: an error of 0.06 px there, as the matcher's steps
/// cause, is 3.5 % of the distance;
const SLOW_DISPARITY_PX: f64 = 1.75;
/// and at which it is 4 % once both images have refined it to 0.05 px, where the speed asks for that;
const FAST_DISPARITY_PX: f64 = 1.25;
/// and the fewest columns that a car shows there, 1.8 m wide: three strips.
const CAR_M: f64 = 1.8;
/// See [`CAR_M`].
const MIN_CAR_PX: f64 = 12.0;
/// However coarse the disparities are, things are looked for this far, in metres: 3.6 s at 60 km/h.
const MIN_RANGE_M: f64 = 60.0;
/// As far as the rig allows, things are looked for this far at any speed, in metres;
const SLOW_RANGE_M: f64 = 100.0;
/// and at higher speeds as far as traffic is that comes as fast as we drive, this time before both meet, in seconds: 2.6 s for a warning,
/// and at most 0.6 s in which its speed becomes known.
const MEETING_S: f64 = 3.2;

/// The range of a rig.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Range {
    /// At low speed, in metres.
    pub slow_m: f64,
    /// At the highest speed, in metres.
    pub fast_m: f64,
}

impl Range {
    /// The range of a rig: at least 60 m, which is that of the paper's focal length × baseline of 105 px·m at low speed.
    pub fn of(rig: &Rig) -> Self {
        let car_m = rig.focal_px * CAR_M / MIN_CAR_PX;
        let range_m = |disparity_px: f64| rig.distance_m(disparity_px).min(car_m).max(MIN_RANGE_M);
        Self { slow_m: range_m(SLOW_DISPARITY_PX).min(SLOW_RANGE_M), fast_m: range_m(FAST_DISPARITY_PX) }
    }

    /// The same distance at any speed, in metres.
    pub const fn fixed(metres: f64) -> Self {
        Self { slow_m: metres, fast_m: metres }
    }

    /// How far things are looked for at a speed in m/s, in metres.
    pub fn at_m(&self, speed_m_s: f64) -> f64 {
        Self::needed_m(speed_m_s).max(self.slow_m).min(self.fast_m)
    }

    /// Distance within which traffic that comes towards us as fast as we drive is met within 3.2 s, at a speed in m/s, in metres.
    pub fn needed_m(speed_m_s: f64) -> f64 {
        2.0 * speed_m_s * MEETING_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(focal_px: f64, baseline_m: f64) -> Range {
        Range::of(&Rig { focal_px, baseline_m, cx_px: 320.0, cy_px: 240.0 })
    }

    #[test]
    fn the_range_is_that_of_the_rig() {
        let paper = rig(879.0, 0.12);
        assert!((paper.slow_m - 60.3).abs() < 0.1 && (paper.fast_m - 84.4).abs() < 0.1, "{paper:?}");
        assert_eq!(rig(500.0, 0.03), Range::fixed(60.0));
        let kitti = rig(721.0, 0.54);
        assert!(kitti.slow_m == 100.0 && (kitti.fast_m - 108.2).abs() < 0.1, "{kitti:?}");
    }

    #[test]
    fn the_faster_the_farther() {
        let range = rig(1060.0, 0.3);
        assert_eq!([f64::NAN, -5.0, 0.0, 50.0 / 3.6].map(|speed| range.at_m(speed)), [100.0; 4]);
        assert!((range.at_m(80.0 / 3.6) - 142.2).abs() < 0.1);
        assert!((range.at_m(130.0 / 3.6) - 159.0).abs() < 0.1);
        assert_eq!(Range::fixed(80.0).at_m(40.0), 80.0);
    }
}
