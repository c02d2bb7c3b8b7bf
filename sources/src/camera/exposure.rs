//! Common exposure control: one exposure for both cameras, controlled by the mean brightness of the images.
//! Independent automatic exposures make the two images differ, which degrades matching.

use super::Exposure;

/// Target grey level.
const TARGET: f64 = 105.0;

/// Ratio of brightness to target within which the exposure is left alone.
const DEAD_ZONE: f64 = 1.15;

/// Largest change of brightness in one step, as a factor.
const MAX_STEP: f64 = 1.6;

/// Frames until a new setting shows in the images.
const SETTLE_FRAMES: u32 = 4;

/// Limits of the settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExposureParameters {
    /// Longest exposure, in microseconds; longer exposures blur moving objects.
    pub max_exposure_us: u32,
    /// Highest gain, in the device's unit; gain 0 counts as 1.
    pub max_gain: u32,
}

/// Adjusts the exposure time first, and the gain once the exposure time is at its limit.
#[derive(Clone, Debug)]
pub struct ExposureControl {
    parameters: ExposureParameters,
    time_us: f64,
    gain: f64,
    settle: u32,
}

impl ExposureControl {
    /// Starts in the middle of the range.
    pub fn new(parameters: ExposureParameters) -> Self {
        let time_us = f64::from(parameters.max_exposure_us.max(1)) / 2.0;
        Self { parameters, time_us, gain: 1.0, settle: 0 }
    }

    /// The current setting.
    pub fn exposure(&self) -> Exposure {
        Exposure::Fixed { time_us: self.time_us.round() as u32, gain: self.gain.round() as u32 }
    }

    /// Processes the mean grey level of a pair. Returns the new setting when it changes.
    pub fn pair(&mut self, mean: f64) -> Option<Exposure> {
        if self.settle > 0 {
            self.settle -= 1;
            return None;
        }
        let wanted = (TARGET / mean.max(1.0)).clamp(1.0 / MAX_STEP, MAX_STEP);
        if (1.0 / DEAD_ZONE..=DEAD_ZONE).contains(&wanted) {
            return None;
        }
        let before = self.exposure();
        let longest = f64::from(self.parameters.max_exposure_us.max(1));
        let total = self.time_us * self.gain * wanted;
        // As little gain as possible: gain amplifies noise.
        self.time_us = total.clamp(1.0, longest);
        self.gain = (total / self.time_us).clamp(1.0, f64::from(self.parameters.max_gain.max(1)));
        let after = self.exposure();
        (after != before).then(|| {
            self.settle = SETTLE_FRAMES;
            after
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene in which an exposure of 1 µs at gain 1 gives `light` grey levels.
    fn settle(light: f64, frames: u32) -> (f64, Exposure, u32) {
        let parameters = ExposureParameters { max_exposure_us: 20_000, max_gain: 16 };
        let mut control = ExposureControl::new(parameters);
        let mut changes = 0;
        let mut mean = 0.0;
        for _ in 0..frames {
            let Exposure::Fixed { time_us, gain } = control.exposure() else { unreachable!() };
            mean = (light * f64::from(time_us) * f64::from(gain)).min(255.0);
            changes += u32::from(control.pair(mean).is_some());
        }
        (mean, control.exposure(), changes)
    }

    #[test]
    fn any_light_comes_to_the_target_and_rests_there() {
        for light in [0.001, 0.005, 0.02, 0.3, 2.0] {
            let (mean, exposure, changes) = settle(light, 200);
            assert!((TARGET / 1.3..TARGET * 1.3).contains(&mean), "light {light}: {mean}, {exposure:?}");
            assert!(changes <= 25, "light {light}: {changes} changes");
        }
        // Too dark for any setting: stays at the limits.
        let (_, exposure, changes) = settle(1e-6, 200);
        assert_eq!(exposure, Exposure::Fixed { time_us: 20_000, gain: 16 });
        assert!(changes <= 12, "{changes}");
        // No gain in daylight.
        assert!(matches!(settle(0.02, 200).1, Exposure::Fixed { gain: 1, .. }));
    }
}
