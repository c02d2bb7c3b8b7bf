//! Speed, acceleration and yaw rate at the time of a frame, from odometry and the vehicle's bus.
//!
//! Two Kalman filters of a value and its rate: speed with acceleration, yaw rate with yaw acceleration. Odometry measures
//! the mean over the time between two frames, which is the value in its middle; the bus measures the value at a time that
//! it gives. While both are there, the factor of the bus's speed (size of the tyres) and the offset of its yaw rate are
//! learned, so that the bus alone stays correct where odometry is blind.
//!
//! No clock: the elapsed time is passed in.

use super::Motion;
use super::odometry::OdometryEstimate;
use super::vehicle::{Aged, VehicleSample};

/// Spectral density of the acceleration's change, in m²/s⁵: within a second it changes by 1.4 m/s² (one standard deviation).
const JERK_DENSITY: f64 = 2.0;
/// Time in which an acceleration decays, in seconds: none lasts for long.
const ACCELERATION_TIME_S: f64 = 3.0;
/// Spectral density of the yaw acceleration's change, in rad²/s⁵: within a second it changes by 0.24 rad/s².
const YAW_JERK_DENSITY: f64 = 0.06;
/// Time in which a yaw acceleration decays, in seconds.
const YAW_ACCELERATION_TIME_S: f64 = 0.5;
/// Added to the standard deviation that odometry states, in m/s and rad/s: the exposure's time is not exact, the body sways.
const ODOMETRY_SPEED_SIGMA_M_S: f64 = 0.06;
const ODOMETRY_YAW_RATE_SIGMA_RAD_S: f64 = 0.003;
/// Standard deviation of the bus's speed, in m/s, and as a share of it, before its factor is learned.
const BUS_SPEED_SIGMA_M_S: f64 = 0.1;
const BUS_SPEED_SIGMA_SHARE: f64 = 0.01;
/// Standard deviation of the bus's yaw rate, in rad/s.
const BUS_YAW_RATE_SIGMA_RAD_S: f64 = 0.01;
/// Time over which the factor and the offset of the bus are learned, in seconds, and their limits.
const LEARNING_TIME_S: f64 = 30.0;
const MAX_FACTOR_ERROR: f64 = 0.06;
const MAX_OFFSET_RAD_S: f64 = 0.05;
/// Yaw rate up to which the vehicle drives straight ahead, in rad/s: at 4 m/s the swing of a camera 1.6 m ahead of the axle
/// is less than half a degree, and as often to the left as to the right.
const MAX_STRAIGHT_RAD_S: f64 = 0.02;
/// Largest yaw of the camera in the vehicle that is taken for its mounting, in rad: 5 degrees.
const MAX_CAMERA_YAW_RAD: f64 = 0.09;
/// Below this speed, in m/s, nothing is learned.
const MIN_LEARNING_SPEED_M_S: f64 = 4.0;
/// Odometry and bus disagree if their speeds differ by more than this, in m/s, and this share, or their yaw rates by more
/// than this, in rad/s, for this time, in seconds.
const DISAGREE_M_S: f64 = 1.0;
const DISAGREE_SHARE: f64 = 0.08;
const DISAGREE_RAD_S: f64 = 0.08;
const DISAGREE_TIME_S: f64 = 0.5;
/// Largest standard deviation of speed (m/s) and yaw rate (rad/s) with which the motion counts as known: at 2 s, 2 m along
/// and at 10 m/s a metre across.
const MAX_SPEED_SIGMA_M_S: f64 = 1.0;
const MAX_YAW_RATE_SIGMA_RAD_S: f64 = 0.05;
/// Speeds below this, in m/s, are a standstill.
const STANDSTILL_M_S: f64 = 0.15;
/// Squared normalised innovation above which a measurement has less weight.
const GATE: f64 = 12.0;

/// What the motion is known from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotionHealth {
    /// Odometry measured it in this frame.
    pub odometry: bool,
    /// The bus's speed was used.
    pub bus_speed: bool,
    /// The bus's yaw rate was used.
    pub bus_yaw_rate: bool,
    /// Odometry and bus disagree; the bus is followed.
    pub disagree: bool,
    /// The vehicle stands still.
    pub standstill: bool,
}

/// Filters the vehicle's own motion.
#[derive(Clone, Debug, Default)]
pub struct MotionFilter {
    speed: Option<RateFilter>,
    yaw_rate: Option<RateFilter>,
    health: MotionHealth,
    /// True speed ÷ speed of the bus.
    factor: Learned,
    /// Yaw rate of the bus − true one.
    offset: Learned,
    disagree_s: f64,
    camera_yaw: Learned,
}

impl MotionFilter {
    /// Forgets the motion; what was learned about the bus stays.
    pub fn reset(&mut self) {
        let Self { factor, offset, camera_yaw, .. } = *self;
        *self = Self { factor, offset, camera_yaw, ..Self::default() };
    }

    /// What the motion is known from.
    pub fn health(&self) -> MotionHealth {
        self.health
    }

    /// The motion at the time of the last frame; `None` while it is not known.
    pub fn motion(&self) -> Option<Motion> {
        let (speed, yaw) = (self.speed?, self.yaw_rate?);
        let motion = Motion {
            speed_m_s: speed.value,
            speed_sigma_m_s: speed.p[0].sqrt(),
            acceleration_m_s2: speed.rate,
            acceleration_sigma_m_s2: speed.p[2].sqrt(),
            yaw_rate_rad_s: yaw.value,
            yaw_rate_sigma_rad_s: yaw.p[0].sqrt(),
            yaw_acceleration_rad_s2: yaw.rate,
            camera_yaw_rad: self.camera_yaw.value,
        };
        let is_known = motion.speed_sigma_m_s <= MAX_SPEED_SIGMA_M_S
            && motion.yaw_rate_sigma_rad_s <= MAX_YAW_RATE_SIGMA_RAD_S;
        is_known.then_some(motion)
    }

    /// Updates the motion to a frame `elapsed_s` after the one before, with what odometry and the vehicle measured.
    pub fn update(
        &mut self,
        elapsed_s: f64,
        odometry: Option<&OdometryEstimate>,
        vehicle: &VehicleSample,
    ) -> Option<Motion> {
        if let Some(speed) = &mut self.speed {
            speed.predict(elapsed_s, JERK_DENSITY, ACCELERATION_TIME_S);
        }
        if let Some(yaw_rate) = &mut self.yaw_rate {
            yaw_rate.predict(elapsed_s, YAW_JERK_DENSITY, YAW_ACCELERATION_TIME_S);
        }
        let is_finite = |aged: &Aged| aged.value.is_finite() && aged.age_s.is_finite();
        let bus_speed = vehicle.speed_m_s.filter(is_finite);
        let bus_yaw_rate = vehicle.yaw_rate_rad_s.filter(is_finite);
        let measured = odometry.map(Measured::of);
        self.compare(elapsed_s, measured, bus_speed, bus_yaw_rate);
        let measured = measured.filter(|_| !self.health.disagree);
        if let Some(m) = measured.filter(Measured::shows_the_direction) {
            self.camera_yaw.learn(elapsed_s, m.direction_rad, MAX_CAMERA_YAW_RAD);
        }
        if let Some(m) = measured {
            let sigma = m.speed_sigma.hypot(ODOMETRY_SPEED_SIGMA_M_S);
            update(&mut self.speed, m.speed_m_s, m.age_s, sigma);
            let sigma = m.yaw_rate_sigma.hypot(ODOMETRY_YAW_RATE_SIGMA_RAD_S);
            if let Some(yaw_rate) = &mut self.yaw_rate {
                yaw_rate.follow_turn(m.yaw_rate_rad_s, m.age_s, sigma);
            }
            update(&mut self.yaw_rate, m.yaw_rate_rad_s, m.age_s, sigma);
        }
        if let Some(bus) = bus_speed {
            let sigma = BUS_SPEED_SIGMA_M_S + BUS_SPEED_SIGMA_SHARE * bus.value.abs();
            update(&mut self.speed, bus.value * (1.0 + self.factor.value), bus.age_s, sigma);
        }
        if let Some(bus) = bus_yaw_rate {
            let value = bus.value - self.offset.value;
            update(&mut self.yaw_rate, value, bus.age_s, BUS_YAW_RATE_SIGMA_RAD_S);
        }
        self.health.odometry = measured.is_some();
        (self.health.bus_speed, self.health.bus_yaw_rate) = (bus_speed.is_some(), bus_yaw_rate.is_some());
        let motion = self.motion();
        self.health.standstill = motion.is_some_and(|m| m.speed_m_s.abs() < STANDSTILL_M_S);
        motion
    }

    /// Compares odometry and bus: learns the errors of the bus, and notices a disagreement.
    fn compare(
        &mut self,
        elapsed_s: f64,
        measured: Option<Measured>,
        bus_speed: Option<Aged>,
        bus_yaw_rate: Option<Aged>,
    ) {
        let Some(m) = measured else { return };
        // The bus's values in the middle of the time that odometry measures.
        let speed_rate = self.speed.map_or(0.0, |s| s.rate);
        let yaw_rate = self.yaw_rate.map_or(0.0, |s| s.rate);
        let speed = bus_speed.map(|bus| bus.value + speed_rate * (bus.age_s - m.age_s));
        let yaw = bus_yaw_rate.map(|bus| bus.value + yaw_rate * (bus.age_s - m.age_s));
        let differs = speed.is_some_and(|v| {
            (v * (1.0 + self.factor.value) - m.speed_m_s).abs() > DISAGREE_M_S + DISAGREE_SHARE * v.abs()
        }) || yaw
            .is_some_and(|w| (w - self.offset.value - m.yaw_rate_rad_s).abs() > DISAGREE_RAD_S);
        self.disagree_s = if differs {
            (self.disagree_s + elapsed_s).min(2.0 * DISAGREE_TIME_S)
        } else {
            (self.disagree_s - elapsed_s).max(0.0)
        };
        self.health.disagree = self.disagree_s >= DISAGREE_TIME_S;
        if differs {
            return;
        }
        if let Some(v) = speed.filter(|v| v.abs() >= MIN_LEARNING_SPEED_M_S) {
            self.factor.learn(elapsed_s, m.speed_m_s / v - 1.0, MAX_FACTOR_ERROR);
        }
        if let Some(w) = yaw {
            self.offset.learn(elapsed_s, w - m.yaw_rate_rad_s, MAX_OFFSET_RAD_S);
        }
    }
}

/// What odometry says of speed and yaw rate.
#[derive(Clone, Copy, Debug)]
struct Measured {
    speed_m_s: f64,
    speed_sigma: f64,
    yaw_rate_rad_s: f64,
    yaw_rate_sigma: f64,
    age_s: f64,
    /// Direction of travel to the right of the camera's axis, in rad.
    direction_rad: f64,
}

impl Measured {
    /// Whether the vehicle drives straight ahead, so that the direction of travel is the vehicle's.
    fn shows_the_direction(&self) -> bool {
        self.speed_m_s >= MIN_LEARNING_SPEED_M_S && self.yaw_rate_rad_s.abs() <= MAX_STRAIGHT_RAD_S
    }

    fn of(estimate: &OdometryEstimate) -> Self {
        let elapsed_s = estimate.elapsed_s.max(1e-3);
        let [right, down, forward] = estimate.motion.translation_m;
        let yaw_rad = -estimate.motion.rotation_vector()[1];
        let sigma = |k: usize| estimate.covariance[(k, k)].max(0.0).sqrt() / elapsed_s;
        Self {
            // The camera may look a little up or down.
            speed_m_s: forward.hypot(down).copysign(forward) / elapsed_s,
            speed_sigma: sigma(2),
            yaw_rate_rad_s: yaw_rad / elapsed_s,
            yaw_rate_sigma: sigma(4),
            age_s: elapsed_s / 2.0,
            // The chord of an arc points half of its angle to the side.
            direction_rad: right.atan2(forward) + yaw_rad / 2.0,
        }
    }
}

/// A slow mean of a systematic error.
#[derive(Clone, Copy, Debug, Default)]
struct Learned {
    value: f64,
    seconds: f64,
}

impl Learned {
    fn learn(&mut self, elapsed_s: f64, error: f64, limit: f64) {
        self.seconds = (self.seconds + elapsed_s).min(LEARNING_TIME_S);
        let share = elapsed_s / (self.seconds + 1.0);
        self.value = (self.value + share * (error - self.value)).clamp(-limit, limit);
    }
}

fn update(filter: &mut Option<RateFilter>, value: f64, age_s: f64, sigma: f64) {
    match filter {
        Some(filter) => filter.update(value, age_s, sigma),
        None => *filter = Some(RateFilter::new(value, sigma)),
    }
}

/// A value and its rate.
#[derive(Clone, Copy, Debug)]
struct RateFilter {
    value: f64,
    rate: f64,
    /// Covariance: value, both, rate.
    p: [f64; 3],
    /// Innovation of the last measurement that was compared, if it was an outlier.
    outlier: Option<f64>,
}

/// Standard deviation of the rate at the start: any acceleration of a vehicle, in m/s² (and more than any in rad/s²).
const INITIAL_RATE_SIGMA: f64 = 3.0;

impl RateFilter {
    fn new(value: f64, sigma: f64) -> Self {
        let p = [sigma * sigma, 0.0, INITIAL_RATE_SIGMA * INITIAL_RATE_SIGMA];
        Self { value, rate: 0.0, p, outlier: None }
    }

    /// Predicts; the rate changes by white noise of `density` and decays with `time_s`.
    fn predict(&mut self, t: f64, density: f64, time_s: f64) {
        let keep = (-t / time_s).exp();
        self.value += self.rate * t;
        self.rate *= keep;
        let [a, b, c] = self.p;
        self.p = [
            a + 2.0 * t * b + t * t * c + density * t * t * t / 3.0,
            keep * (b + t * c) + density * t * t / 2.0,
            keep * keep * c + density * t,
        ];
    }

    /// Two outliers in a row to the same side are no errors: the rate has changed, so that little is known of it and of what it
    /// has made of the value meanwhile.
    fn follow_turn(&mut self, measured: f64, age_s: f64, sigma: f64) {
        let [a, b, c] = self.p;
        let innovation = measured - (self.value - age_s * self.rate);
        let variance = a - 2.0 * age_s * b + age_s * age_s * c + sigma * sigma;
        let is_outlier = innovation * innovation > GATE * variance;
        if is_outlier && self.outlier.is_some_and(|before| before * innovation > 0.0) {
            // The value is measured in the middle of the time since the last one.
            let rate = (innovation / (2.0 * age_s).max(1e-3)).clamp(-INITIAL_RATE_SIGMA, INITIAL_RATE_SIGMA);
            self.p = [a + innovation * innovation, b + innovation * rate, c + rate * rate];
        }
        self.outlier = is_outlier.then_some(innovation);
    }

    /// Updates with the value at `age_s` before now. An outlier has less weight.
    fn update(&mut self, measured: f64, age_s: f64, sigma: f64) {
        let [a, b, c] = self.p;
        // value − age × rate
        let (with_value, with_rate) = (a - age_s * b, b - age_s * c);
        let innovation = measured - (self.value - age_s * self.rate);
        let state_variance = with_value - age_s * with_rate;
        let mut noise = sigma * sigma;
        let ratio = innovation * innovation / (state_variance + noise) / GATE;
        if ratio > 1.0 {
            noise = (state_variance + noise) * ratio - state_variance;
        }
        let spread = state_variance + noise;
        self.value += with_value / spread * innovation;
        self.rate += with_rate / spread * innovation;
        self.p = [
            (a - with_value * with_value / spread).max(1e-12),
            b - with_value * with_rate / spread,
            (c - with_rate * with_rate / spread).max(1e-12),
        ];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::pose::Pose;
    use nalgebra::Matrix6;

    const PERIOD_S: f64 = 0.08;

    fn normal(random: &mut fastrand::Rng) -> f64 {
        (-2.0 * (1.0 - random.f64()).ln()).sqrt() * (std::f64::consts::TAU * random.f64()).cos()
    }

    /// What odometry measures at a speed and a yaw rate.
    fn odometry(speed_m_s: f64, yaw_rate_rad_s: f64, elapsed_s: f64) -> OdometryEstimate {
        let turn = Pose::from_rotation_vector([0.0, -yaw_rate_rad_s * elapsed_s, 0.0]);
        OdometryEstimate {
            motion: Pose { translation_m: [0.0, 0.0, speed_m_s * elapsed_s], ..turn },
            covariance: Matrix6::identity() * 1e-6,
            inliers: 100,
            points: 110,
            elapsed_s,
            disparity_offset_px: (0.0, 0.0),
        }
    }

    fn bus(speed_m_s: f64, yaw_rate_rad_s: f64) -> VehicleSample {
        let aged = |value| Some(Aged { value, age_s: 0.02 });
        VehicleSample {
            speed_m_s: aged(speed_m_s),
            yaw_rate_rad_s: aged(yaw_rate_rad_s),
            ..VehicleSample::default()
        }
    }

    #[test]
    fn the_motion_is_followed_and_its_errors_are_stated() {
        let (mut nees, mut count, mut worst) = (0.0, 0, 0.0_f64);
        for seed in 0..40 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut filter = MotionFilter::default();
            for k in 1..120 {
                let t = f64::from(k) * PERIOD_S;
                let speed = |t: f64| 10.0 + 3.0 * (0.7 * t).sin();
                let yaw = |t: f64| 0.3 * (0.9 * t).sin();
                let middle = t - PERIOD_S / 2.0;
                let noise = [0.04 * normal(&mut random), 0.002 * normal(&mut random)];
                let seen = odometry(speed(middle) + noise[0], yaw(middle) + noise[1], PERIOD_S);
                let motion = filter.update(PERIOD_S, Some(&seen), &VehicleSample::default()).unwrap();
                if k > 12 {
                    let errors = [
                        (motion.speed_m_s - speed(t)) / motion.speed_sigma_m_s,
                        (motion.yaw_rate_rad_s - yaw(t)) / motion.yaw_rate_sigma_rad_s,
                    ];
                    worst = worst.max((motion.speed_m_s - speed(t)).abs());
                    nees += errors.iter().map(|e| e * e).sum::<f64>();
                    count += 2;
                }
            }
        }
        let nees = nees / f64::from(count);
        println!("squared normalised error {nees:.2} (1 expected), worst error of the speed {worst:.2} m/s");
        assert!((0.2..1.5).contains(&nees), "{nees}");
        assert!(worst < 0.4, "{worst}");
    }

    #[test]
    fn a_turn_that_begins_suddenly_is_followed_and_one_outlier_is_not() {
        let mut filter = MotionFilter::default();
        let heading = |filter: &mut MotionFilter, yaw_rate: f64| {
            let seen = odometry(5.6, yaw_rate, PERIOD_S);
            let motion = filter.update(PERIOD_S, Some(&seen), &VehicleSample::default()).unwrap();
            (motion.yaw_rate_rad_s - motion.yaw_acceleration_rad_s2 * PERIOD_S / 2.0 - yaw_rate) * PERIOD_S
        };
        for _ in 0..25 {
            heading(&mut filter, 0.0);
        }
        // 20 km/h into a turn with a radius of 15 m within 0.4 s: metres per second across at 20 m are these errors × 250.
        let (mut error, mut worst) = (0.0, 0.0_f64);
        for k in 0..12 {
            error += heading(&mut filter, (0.08 * (f64::from(k) + 0.5)).min(0.38));
            worst = worst.max(error.abs());
        }
        println!("largest error of the heading {worst:.4} rad, in the end {error:.4} rad");
        assert!(worst < 0.012, "{worst}");
        // A single wrong measurement in a steady turn.
        let steady = filter.motion().unwrap().yaw_rate_rad_s;
        heading(&mut filter, -0.1);
        let after = filter.motion().unwrap().yaw_rate_rad_s;
        assert!((after - steady).abs() < 0.06, "{steady} {after}");
    }

    #[test]
    fn the_bus_is_corrected_and_carries_on_alone() {
        let mut filter = MotionFilter::default();
        // The bus says 3 % too much, and 0.02 rad/s to the left.
        for _ in 0..600 {
            filter.update(PERIOD_S, Some(&odometry(10.0, 0.0, PERIOD_S)), &bus(10.3, 0.02));
        }
        assert!(!filter.health().disagree);
        for _ in 0..50 {
            filter.update(PERIOD_S, None, &bus(10.3, 0.02));
        }
        let motion = filter.motion().unwrap();
        assert!((motion.speed_m_s - 10.0).abs() < 0.06, "{motion:?}");
        assert!(motion.yaw_rate_rad_s.abs() < 0.004, "{motion:?}");
        assert!(!filter.health().odometry && filter.health().bus_speed);
    }

    #[test]
    fn the_yaw_of_the_camera_in_the_vehicle_is_found() {
        let mut filter = MotionFilter::default();
        // A camera that looks 2 degrees to the left sees the vehicle move to the right.
        let camera_yaw = 2.0_f64.to_radians();
        for k in 0..800 {
            let yaw_rate = if k % 50 < 20 { 0.3 } else { 0.0 };
            let mut seen = odometry(9.0, yaw_rate, PERIOD_S);
            let (sine, cosine) = (camera_yaw - yaw_rate * PERIOD_S / 2.0).sin_cos();
            seen.motion.translation_m = [9.0 * PERIOD_S * sine, 0.0, 9.0 * PERIOD_S * cosine];
            filter.update(PERIOD_S, Some(&seen), &VehicleSample::default());
        }
        let found = filter.motion().unwrap().camera_yaw_rad;
        assert!((found - camera_yaw).abs() < 0.002, "{found}");
    }

    #[test]
    fn a_disagreement_is_told_and_the_bus_is_followed() {
        let mut filter = MotionFilter::default();
        // A lorry that covers the view moves: odometry is deceived, while the wheels stand.
        for _ in 0..40 {
            filter.update(PERIOD_S, Some(&odometry(-3.0, 0.0, PERIOD_S)), &bus(0.0, 0.0));
        }
        let motion = filter.motion().unwrap();
        assert!(filter.health().disagree && filter.health().standstill, "{:?}", filter.health());
        assert!(motion.speed_m_s.abs() < 0.1, "{motion:?}");
        for _ in 0..40 {
            filter.update(PERIOD_S, Some(&odometry(0.0, 0.0, PERIOD_S)), &bus(0.0, 0.0));
        }
        assert!(!filter.health().disagree && filter.health().odometry);
    }

    #[test]
    fn without_measurements_the_motion_becomes_unknown() {
        let mut filter = MotionFilter::default();
        assert_eq!(filter.update(PERIOD_S, None, &VehicleSample::default()), None);
        for _ in 0..10 {
            filter.update(PERIOD_S, Some(&odometry(10.0, 0.1, PERIOD_S)), &VehicleSample::default());
        }
        let mut frames = 0;
        while filter.update(PERIOD_S, None, &VehicleSample::default()).is_some() {
            frames += 1;
            assert!(frames < 30);
        }
        println!("the motion stays known for {frames} frames without a measurement");
        assert!(frames >= 2);
        // Values that are no numbers count as none.
        assert_eq!(filter.update(PERIOD_S, None, &bus(f64::NAN, f64::INFINITY)), None);
        assert!(filter.speed.is_some_and(|s| s.value.is_finite()));
    }
}
