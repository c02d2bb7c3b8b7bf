//! Kalman filters of one obstacle: distance and closing speed, and lateral position and speed.
//!
//! Where the vehicle's own motion is known, the speeds are over ground, along axes that turn with the camera: a standing
//! thing has none, and what the own motion adds is known ([`ground`]). Else they are relative to the camera.
//!
//! The measured quantity is the disparity, whose noise is uniform. Motion is uniform in distance. The state
//! is therefore in metres, where a constant closing speed is linear, and the noise of each measurement is the
//! disparity noise converted at the predicted distance.

mod acceleration;
pub mod ground;
mod manoeuvre;

use acceleration::Acceleration;
pub use acceleration::braking_seconds;

use super::parameters::{
    CUSUM_DECAY, CUSUM_THRESHOLD, INITIAL_CLOSING_SIGMA_M_S, INITIAL_LATERAL_SIGMA_M_S,
    LATERAL_MANOEUVRE_NOISE, LATERAL_PROCESS_NOISE, MANOEUVRE_PROCESS_NOISE, OUTLIER_SIGMAS, PROCESS_NOISE,
    STEP_FRAMES,
};

/// Smallest distance, in metres.
pub(super) const MIN_DISTANCE_M: f64 = 0.3;

/// Largest speed of a vehicle, in m/s.
const MAX_SPEED_M_S: f64 = 90.0;

/// Consecutive outliers of the same sign.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct OutlierRun {
    first: f64,
    last: f64,
    frames: u8,
    /// Number of the last outliers that agree with each other.
    similar: u8,
}

impl OutlierRun {
    /// Adds an outlier; two agree if they differ by less than `tolerance`.
    fn with(self, innovation: f64, tolerance: f64) -> Self {
        if self.frames == 0 || self.last * innovation < 0.0 {
            return Self { first: innovation, last: innovation, frames: 1, similar: 1 };
        }
        let is_similar = (innovation - self.last).abs() < tolerance;
        Self {
            first: self.first,
            last: innovation,
            frames: self.frames.saturating_add(1),
            similar: if is_similar { self.similar.saturating_add(1) } else { 1 },
        }
    }
}

/// Constant-velocity Kalman filter in one dimension: position, speed and covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ConstantVelocityFilter {
    position: f64,
    /// Over ground if the own motion is known, else relative to the camera.
    speed: f64,
    /// Rate that the own motion adds to the speed; 0 if the speed is relative.
    own_rate: f64,
    /// Covariance: position², position·speed, speed².
    p: [f64; 3],
    /// Third state while it manoeuvres.
    acceleration: Acceleration,
    /// CUSUM statistic of the normalised innovations, with exponential forgetting.
    cusum: f64,
    outliers: OutlierRun,
    /// Initial variance of the speed.
    unknown_speed: f64,
}

impl ConstantVelocityFilter {
    fn new(position: f64, sigma: f64, speed_sigma: f64) -> Self {
        Self {
            position,
            speed: 0.0,
            own_rate: 0.0,
            p: [sigma * sigma, 0.0, speed_sigma * speed_sigma],
            acceleration: Acceleration::default(),
            cusum: 0.0,
            outliers: OutlierRun::default(),
            unknown_speed: speed_sigma * speed_sigma,
        }
    }

    /// Predicts the state `t` seconds ahead, with process noise of spectral density `q`.
    fn predict(&mut self, t: f64, q: f64) {
        self.predict_acceleration(t);
        self.position += self.speed * t;
        let [a, b, c] = self.p;
        self.p = [a + 2.0 * t * b + t * t * c + q * t.powi(3) / 3.0, b + t * c + q * t * t / 2.0, c + q * t];
    }

    /// Rate of the position, relative to the camera.
    fn rate(&self) -> f64 {
        self.speed + self.own_rate
    }

    /// Updates the state with a measurement. An outlier gets a larger noise, so that a single bad frame has
    /// little effect. Several outliers that agree are a step: the position is reset and the speed is kept.
    /// Several that grow mean another speed, whose variance is reset as well.
    fn update(&mut self, position: f64, sigma: f64) {
        let [a, b, c] = self.p;
        let innovation = position - self.position;
        let mut noise = (sigma * sigma).max(1e-8);
        let sigmas = innovation / (a + noise).sqrt();
        if sigmas.abs() > OUTLIER_SIGMAS {
            self.outliers = self.outliers.with(innovation, 2.0 * (2.0 * noise).sqrt());
            let grows = innovation.abs() - self.outliers.first.abs() > OUTLIER_SIGMAS * noise.sqrt();
            if self.outliers.frames >= STEP_FRAMES && grows || self.outliers.similar >= STEP_FRAMES {
                self.position = position;
                self.p = [noise, 0.0, if grows { c.max(self.unknown_speed) } else { c }];
                (self.cusum, self.outliers) = (0.0, OutlierRun::default());
                self.acceleration = Acceleration::default();
                return;
            }
            noise = (innovation / OUTLIER_SIGMAS).powi(2) * sigmas.abs() / OUTLIER_SIGMAS;
        } else {
            self.outliers = OutlierRun::default();
        }
        let spread = a + noise;
        let (gain, speed_gain) = (a / spread, b / spread);
        self.position += gain * innovation;
        self.speed += speed_gain * innovation;
        self.correct_acceleration(innovation, spread, [a, b], self.acceleration.p[0]);
        self.p = [(1.0 - gain) * a, (1.0 - gain) * b, (c - speed_gain * b).max(1e-9)];
        let bounded = sigmas.clamp(-OUTLIER_SIGMAS, OUTLIER_SIGMAS);
        self.cusum = CUSUM_DECAY * self.cusum + bounded;
    }

    /// Measures the speed with this standard deviation, in m/s. Where the state contradicts that by more than outliers do, its speed
    /// was wrong, and its variance grows by the square of the error first.
    fn measure_speed(&mut self, speed: f64, sigma: f64) {
        let noise = sigma * sigma;
        let innovation = speed - self.speed;
        if innovation * innovation > OUTLIER_SIGMAS * OUTLIER_SIGMAS * (self.p[2] + noise) {
            self.p[2] += innovation * innovation;
        }
        let [a, b, c] = self.p;
        let spread = c + noise;
        self.position += b / spread * innovation;
        self.speed += c / spread * innovation;
        self.correct_acceleration(innovation, spread, [b, c], self.acceleration.p[1]);
        self.p = [(a - b * b / spread).max(1e-9), b * noise / spread, c * noise / spread];
    }

    /// Whether the CUSUM test detects biased innovations.
    fn is_manoeuvring(&self) -> bool {
        self.cusum.abs() > CUSUM_THRESHOLD
    }

    fn sigma(&self) -> f64 {
        self.p[0].max(0.0).sqrt()
    }

    fn speed_sigma(&self) -> f64 {
        self.p[2].max(0.0).sqrt()
    }
}

/// Time to collision with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeToCollision {
    /// Seconds until the distance is 0, at constant closing speed, or as the obstacle goes on braking.
    pub seconds: f64,
    /// Standard deviation, in seconds.
    pub sigma_s: f64,
}

/// Kalman filter of distance and closing speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceFilter {
    /// Focal length × baseline, px·m.
    scale: f64,
    /// Position is the distance; speed is the negative closing speed.
    filter: ConstantVelocityFilter,
}

impl DistanceFilter {
    /// Initialises the filter with a measured disparity. `scale` is focal length (px) × baseline (m).
    pub fn new(scale: f64, disparity_px: f64, sigma_px: f64) -> Self {
        let distance = scale / disparity_px;
        let sigma = distance * distance * sigma_px / scale;
        Self { scale, filter: ConstantVelocityFilter::new(distance, sigma, INITIAL_CLOSING_SIGMA_M_S) }
    }

    /// Process noise of the next prediction; a manoeuvre begins or ends.
    fn process_noise(&mut self) -> f64 {
        self.filter.follow_manoeuvre();
        if self.filter.is_manoeuvring() { MANOEUVRE_PROCESS_NOISE } else { PROCESS_NOISE }
    }

    /// Predicts the state `elapsed_s` seconds ahead at constant closing speed.
    pub fn predict(&mut self, elapsed_s: f64) {
        let noise = self.process_noise();
        self.filter.predict(elapsed_s, noise);
        self.filter.position = self.filter.position.max(MIN_DISTANCE_M);
    }

    /// Updates the state with a measured disparity and its standard deviation, both in px.
    pub fn update(&mut self, disparity_px: f64, sigma_px: f64) {
        // Noise at the predicted distance; at the measured one, outliers that are too near would get more
        // weight.
        let expected = self.filter.position;
        let sigma = expected * expected * sigma_px / self.scale;
        self.filter.update(self.scale / disparity_px, sigma);
        self.filter.position = self.filter.position.max(MIN_DISTANCE_M);
        self.filter.speed = self.filter.speed.clamp(-MAX_SPEED_M_S, MAX_SPEED_M_S);
    }

    /// Distance in metres and its rate in m/s.
    pub(super) fn state(&self) -> (f64, f64) {
        (self.filter.position, self.filter.rate())
    }

    /// Updates the state with a linearised measurement of a function of distance, rate and acceleration, given by its
    /// partial derivatives, the innovation and the standard deviation. A normalised innovation above `gate`
    /// is rejected. Returns whether the measurement was used. `towards`: sign of the measurement when the distance grows
    /// faster; its innovations tell of manoeuvres, too.
    pub(super) fn update_linearised(
        &mut self,
        slopes: [f64; 3],
        innovation: f64,
        sigma: f64,
        gate: f64,
        towards: f64,
    ) -> bool {
        let [a, b, c] = self.filter.p;
        let [d, e, f] = self.filter.acceleration.p;
        // Covariance of the measurement with the state, and variance of the innovation.
        let with = |[p, v, w]: [f64; 3]| slopes[0] * p + slopes[1] * v + slopes[2] * w;
        let (with_position, with_speed) = (with([a, b, d]), with([b, c, e]));
        let with_acceleration = with([d, e, f]);
        let spread = with([with_position, with_speed, with_acceleration]) + sigma * sigma;
        if spread <= 0.0 {
            return false;
        }
        let bounded = (innovation / spread.sqrt()).clamp(-OUTLIER_SIGMAS, OUTLIER_SIGMAS);
        self.filter.cusum += towards * bounded;
        if innovation * innovation > gate * gate * spread {
            return false;
        }
        let state = [with_position, with_speed];
        self.filter.correct_acceleration(innovation, spread, state, with_acceleration);
        self.filter.position =
            (self.filter.position + with_position / spread * innovation).max(MIN_DISTANCE_M);
        self.filter.speed += with_speed / spread * innovation;
        self.filter.p = [
            (a - with_position * with_position / spread).max(1e-9),
            b - with_position * with_speed / spread,
            (c - with_speed * with_speed / spread).max(1e-9),
        ];
        true
    }

    /// Distance, in metres, above zero.
    pub fn distance_m(&self) -> f64 {
        self.filter.position
    }

    /// Standard deviation of the distance, in metres.
    pub fn distance_sigma_m(&self) -> f64 {
        self.filter.sigma()
    }

    /// Disparity at that distance, in px.
    pub fn disparity_px(&self) -> f64 {
        self.scale / self.filter.position
    }

    /// Standard deviation of the disparity, in px.
    pub fn disparity_sigma_px(&self) -> f64 {
        self.scale / (self.filter.position * self.filter.position) * self.filter.sigma()
    }

    /// Closing speed (decrease of the distance), in m/s.
    pub fn closing_m_s(&self) -> f64 {
        -self.filter.rate()
    }

    /// Speed away from the camera, in m/s: over ground where the own motion is known, else relative.
    pub fn speed_m_s(&self) -> f64 {
        self.filter.speed
    }

    /// Standard deviation of the closing speed, in m/s.
    pub fn closing_sigma_m_s(&self) -> f64 {
        self.filter.speed_sigma()
    }

    /// Time to collision; `None` if the obstacle does not approach significantly (two standard deviations). One that is known to
    /// brake goes on braking.
    pub fn time_to_collision(&self) -> Option<TimeToCollision> {
        let seconds = self.seconds_to_collision()?;
        let z = self.filter.position;
        // Mean until then.
        let closing = z / seconds.max(1e-6);
        if closing <= 2.0 * self.closing_sigma_m_s() {
            return None;
        }
        let [a, b, c] = self.filter.p;
        // t = z/w with w = −ż: ∂t/∂z = 1/w, ∂t/∂ż = z/w².
        let (by_position, by_speed) = (1.0 / closing, z / (closing * closing));
        let variance =
            by_position * by_position * a + 2.0 * by_position * by_speed * b + by_speed * by_speed * c;
        Some(TimeToCollision { seconds, sigma_s: variance.max(0.0).sqrt() })
    }
}

/// Kalman filter of lateral position and speed, positive to the right of the camera axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateralFilter {
    filter: ConstantVelocityFilter,
}

impl LateralFilter {
    /// Initialises the filter with a measurement and its standard deviation, in metres.
    pub fn new(lateral_m: f64, sigma_m: f64) -> Self {
        Self { filter: ConstantVelocityFilter::new(lateral_m, sigma_m, INITIAL_LATERAL_SIGMA_M_S) }
    }

    /// Predicts the state `elapsed_s` seconds ahead.
    pub fn predict(&mut self, elapsed_s: f64) {
        self.filter.predict(elapsed_s, self.process_noise());
    }

    /// Process noise of the next prediction.
    fn process_noise(&self) -> f64 {
        if self.filter.is_manoeuvring() { LATERAL_MANOEUVRE_NOISE } else { LATERAL_PROCESS_NOISE }
    }

    /// Updates the state with a measurement and its standard deviation, in metres.
    pub fn update(&mut self, lateral_m: f64, sigma_m: f64) {
        self.filter.update(lateral_m, sigma_m);
        self.filter.speed = self.filter.speed.clamp(-MAX_SPEED_M_S, MAX_SPEED_M_S);
    }

    /// Measures the speed, with its standard deviation, in m/s.
    pub(super) fn measure_speed(&mut self, speed_m_s: f64, sigma_m_s: f64) {
        self.filter.measure_speed(speed_m_s, sigma_m_s);
        self.filter.speed = self.filter.speed.clamp(-MAX_SPEED_M_S, MAX_SPEED_M_S);
    }

    /// Moves the position: another point of the obstacle is followed.
    pub(super) fn shift(&mut self, by_m: f64) {
        self.filter.position += by_m;
    }

    /// Lateral position, in metres right of the camera axis.
    pub fn lateral_m(&self) -> f64 {
        self.filter.position
    }

    /// Standard deviation of the lateral position, in metres.
    pub fn lateral_sigma_m(&self) -> f64 {
        self.filter.sigma()
    }

    /// Lateral speed to the right, in m/s: over ground where the own motion is known, else relative to the camera.
    pub fn speed_m_s(&self) -> f64 {
        self.filter.speed
    }

    /// Standard deviation of the lateral speed, in m/s.
    pub fn speed_sigma_m_s(&self) -> f64 {
        self.filter.speed_sigma()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Focal length × baseline of the paper's rig, px·m.
    const SCALE: f64 = 105.5;
    const PERIOD_S: f64 = 0.08;

    /// Normalised estimation error squared (NEES) of distance and closing speed against the true values; its
    /// expected value is 2 for a consistent filter.
    fn nees_of(filter: &DistanceFilter, distance_m: f64, closing_m_s: f64) -> f64 {
        let [a, b, c] = filter.filter.p;
        let (dz, dv) = (filter.filter.position - distance_m, filter.filter.speed + closing_m_s);
        (c * dz * dz - 2.0 * b * dz * dv + a * dv * dv) / (a * c - b * b)
    }

    /// A normally distributed random number.
    fn normal(random: &mut fastrand::Rng) -> f64 {
        (-2.0 * (1.0 - random.f64()).ln()).sqrt() * (std::f64::consts::TAU * random.f64()).cos()
    }

    /// Simulates an approach. Returns the mean NEES and the largest error of the time to collision from 2.5 s
    /// down, relative and in standard deviations.
    fn approach(seed: u64, from_m: f64, closing: f64, sigma_px: f64) -> (f64, f64, f64) {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut z = from_m;
        let measure = |z: f64, random: &mut fastrand::Rng| SCALE / z + sigma_px * normal(random);
        let mut filter = DistanceFilter::new(SCALE, measure(z, &mut random), sigma_px);
        let (mut nees, mut frames, mut worst, mut most) = (0.0, 0, 0.0_f64, 0.0_f64);
        loop {
            z -= closing * PERIOD_S;
            if z < 3.0 {
                return (nees / f64::from(frames), worst, most);
            }
            filter.predict(PERIOD_S);
            filter.update(measure(z, &mut random), sigma_px);
            nees += nees_of(&filter, z, closing);
            frames += 1;
            let truth = z / closing;
            if let Some(ttc) = filter.time_to_collision().filter(|_| truth <= 2.5) {
                worst = worst.max((ttc.seconds - truth).abs() / truth);
                most = most.max((ttc.seconds - truth).abs() / ttc.sigma_s);
            }
        }
    }

    #[test]
    fn the_filter_is_consistent() {
        for (from_m, closing, sigma_px) in [(60.0, 14.0, 0.12), (30.0, 5.0, 0.12), (60.0, 25.0, 0.15)] {
            let runs = 200;
            let results: Vec<_> = (0..runs).map(|s| approach(s, from_m, closing, sigma_px)).collect();
            let nees = results.iter().map(|r| r.0).sum::<f64>() / runs as f64;
            let sorted = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
                let mut all: Vec<f64> = results.iter().map(of).collect();
                all.sort_unstable_by(f64::total_cmp);
                all
            };
            let (worst, most) = (sorted(&|r| r.1), sorted(&|r| r.2));
            println!(
                "{from_m} m at {closing} m/s, {sigma_px} px, seeds 0 to 199: NEES {nees:.2} (2 expected), worst \
                 TTC error of a run from 2.5 s down: median {:.1} %, 95 % {:.1} %; in stated deviations {:.1}, {:.1}",
                100.0 * worst[100],
                100.0 * worst[190],
                most[100],
                most[190]
            );
            // Below 2, as the process noise allows for accelerations that these runs do not have; above 2 at
            // 25 m/s, which is twice the initial standard deviation.
            assert!((0.8..3.0).contains(&nees), "NEES {nees}");
            assert!(most[190] < 3.5, "{}", most[190]);
        }
    }

    #[test]
    fn a_static_object_has_no_closing_speed() {
        let mut false_times = 0;
        for seed in 0..50 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut filter = DistanceFilter::new(SCALE, 5.0, 0.15);
            for _ in 0..60 {
                filter.predict(PERIOD_S);
                filter.update(5.0 + 0.15 * normal(&mut random), 0.15);
            }
            assert!(filter.closing_m_s().abs() < 1.5, "seed {seed}: {}", filter.closing_m_s());
            false_times += u32::from(filter.time_to_collision().is_some_and(|t| t.seconds < 10.0));
        }
        assert!(false_times <= 3, "{false_times} of 50");
    }

    #[test]
    fn an_outlier_has_little_effect_and_a_lasting_change_is_followed() {
        let mut filter = DistanceFilter::new(SCALE, SCALE / 20.0, 0.12);
        for _ in 0..20 {
            filter.predict(PERIOD_S);
            filter.update(SCALE / 20.0, 0.12);
        }
        let before = filter;
        filter.predict(PERIOD_S);
        filter.update(SCALE / 14.0, 0.12);
        assert!((filter.distance_m() - before.distance_m()).abs() < 0.3, "{filter:?}");
        assert!(filter.closing_m_s() < 1.0, "{filter:?}");
        // From now on the car ahead brakes with 6 m/s².
        let (mut z, mut v) = (20.0, 0.0);
        let mut filter = before;
        for _ in 0..15 {
            v += 6.0 * PERIOD_S;
            z -= v * PERIOD_S;
            filter.predict(PERIOD_S);
            filter.update(SCALE / z, 0.12);
        }
        let lag = v - filter.closing_m_s();
        println!("after 1.2 s of braking at 6 m/s²: {v:.1} m/s, filter {:.1}", filter.closing_m_s());
        assert!(lag.abs() < 0.3 * v, "{lag} of {v}");
    }

    #[test]
    fn a_sudden_stop_does_not_overshoot() {
        let (mut overshot, mut worst_speed) = (Vec::new(), 0.0_f64);
        for (closing, stop_m) in [(4.0, 4.0), (4.0, 8.0), (8.0, 8.0), (8.0, 12.0)] {
            for seed in 0..50 {
                let mut random = fastrand::Rng::with_seed(seed);
                let mut measure = |z: f64| SCALE / z + 0.12 * normal(&mut random);
                let mut z = stop_m + 20.0;
                let mut filter = DistanceFilter::new(SCALE, measure(z), 0.12);
                let (mut frames, mut least) = (0, f64::INFINITY);
                while frames < 12 {
                    if z > stop_m {
                        z -= closing * PERIOD_S;
                    } else {
                        frames += 1;
                    }
                    filter.predict(PERIOD_S);
                    filter.update(measure(z), 0.12);
                    least = least.min(filter.distance_m() - z);
                }
                overshot.push(-least / (closing * PERIOD_S));
                worst_speed = worst_speed.max(filter.closing_m_s().abs());
            }
        }
        overshot.sort_unstable_by(f64::total_cmp);
        println!(
            "a stop in one frame: overshot by {:.1} frames' way (median), {:.1} (most); a second later {worst_speed:.2} m/s at most",
            overshot[100], overshot[199]
        );
        // Two outliers are down-weighted, the third resets the state.
        assert!(overshot[100] < 2.5 && overshot[199] < 5.5, "{overshot:?}");
        assert!(worst_speed < 1.5, "{worst_speed}");
    }

    #[test]
    fn a_sudden_stop_is_followed_within_four_frames() {
        let mut worst = 0.0_f64;
        for seed in 0..50 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut z = 14.0;
            let mut filter = DistanceFilter::new(SCALE, SCALE / z, 0.12);
            let mut errors = Vec::new();
            for _ in 0..40 {
                z = f64::max(z - 4.0 * PERIOD_S, 6.0);
                filter.predict(PERIOD_S);
                filter.update(SCALE / z + 0.06 * normal(&mut random), 0.12);
                errors.push((filter.distance_m() - z).abs());
            }
            // The object stands from frame 25 on; the filter has converged four frames later.
            worst = errors[28..].iter().fold(worst, |worst, &e| worst.max(e));
            assert!(filter.closing_m_s().abs() < 0.7, "seed {seed}: {}", filter.closing_m_s());
        }
        println!("worst error from four frames after the stop on, seeds 0 to 49: {worst:.2} m");
        assert!(worst < 0.3, "{worst}");
    }

    #[test]
    fn uncertainty_grows_without_measurements_and_stays_finite() {
        let mut filter = DistanceFilter::new(SCALE, 5.0, 0.2);
        filter.update(5.0, 0.0);
        let before = filter.distance_sigma_m();
        for _ in 0..1000 {
            filter.predict(0.5);
        }
        assert!(filter.distance_sigma_m() > before && filter.distance_m() > 0.0);
        filter.update(0.01, 0.2);
        filter.update(300.0, 0.2);
        assert!(filter.distance_m().is_finite() && filter.closing_sigma_m_s().is_finite());
    }

    #[test]
    fn the_lateral_speed_of_a_pedestrian_is_estimated() {
        let mut worst = 0.0_f64;
        for seed in 0..50 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut filter = LateralFilter::new(-4.0, 0.1);
            let mut x = -4.0;
            for _ in 0..25 {
                x += 1.4 * PERIOD_S;
                filter.predict(PERIOD_S);
                filter.update(x + 0.1 * normal(&mut random), 0.1);
            }
            worst = worst.max((filter.speed_m_s() - 1.4).abs());
            assert!((filter.lateral_m() - x).abs() < 0.3, "seed {seed}");
        }
        println!("worst error of the speed across after 2 s, seeds 0 to 49: {worst:.2} m/s");
        assert!(worst < 0.8, "{worst}");
    }
}
