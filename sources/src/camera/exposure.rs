//! Both cameras equally bright: one exposure for both, steered by the brightness of the images. Cameras
//! that each have an automatic of their own differ, and matching suffers.

use super::Exposure;

/// Grey level that is aimed at.
const TARGET: f64 = 105.0;

/// Brightness may differ from it by this factor before anything changes.
const DEAD_ZONE: f64 = 1.15;

/// The most by which brightness is changed at once.
const MAX_STEP: f64 = 1.6;

/// Frames after a change before the images show it.
const SETTLE_FRAMES: u32 = 4;

/// Bounds of what is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExposureParameters {
    /// The longest exposure, in microseconds: longer blurs what moves.
    pub longest_us: u32,
    /// The greatest gain, in the device's unit; gain 0 counts as 1.
    pub max_gain: u32,
}

/// Steers exposure time first, gain when that does not suffice.
#[derive(Clone, Debug)]
pub struct ExposureControl {
    parameters: ExposureParameters,
    time_us: f64,
    gain: f64,
    settle: u32,
}

impl ExposureControl {
    /// Starts in the middle.
    pub fn new(parameters: ExposureParameters) -> Self {
        let time_us = f64::from(parameters.longest_us.max(1)) / 2.0;
        Self { parameters, time_us, gain: 1.0, settle: 0 }
    }

    /// What is set now.
    pub fn exposure(&self) -> Exposure {
        Exposure::Fixed { time_us: self.time_us.round() as u32, gain: self.gain.round() as u32 }
    }

    /// The mean grey level of a pair. Gives what is to be set, when that changes.
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
        let longest = f64::from(self.parameters.longest_us.max(1));
        let total = self.time_us * self.gain * wanted;
        // As little gain as will do: it brings noise.
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

    /// A scene so bright that an exposure of 1 µs at gain 1 gives `light` grey levels.
    fn settle(light: f64, frames: u32) -> (f64, Exposure, u32) {
        let parameters = ExposureParameters { longest_us: 20_000, max_gain: 16 };
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
        // Too dark for anything: the most that is allowed, and no more.
        let (_, exposure, changes) = settle(1e-6, 200);
        assert_eq!(exposure, Exposure::Fixed { time_us: 20_000, gain: 16 });
        assert!(changes <= 12, "{changes}");
        // By daylight without gain.
        assert!(matches!(settle(0.02, 200).1, Exposure::Fixed { gain: 1, .. }));
    }
}
