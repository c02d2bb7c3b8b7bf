//! Kalman filter of one obstacle's place and speed on the ground plane, by one model of its motion.
//!
//! Where the vehicle's own motion is known, the speeds are over ground, along axes that turn with the camera: a standing
//! thing has none, and what the own motion adds is known ([`super::ground`]). Else they are relative to the camera.
//!
//! What is measured are disparity, bearing, and the change of the bearing and the scale; motion is uniform in metres. The state is
//! therefore in metres, where a constant speed is linear, and each measurement is linearised at the predicted state. To the
//! right and forward are one state with one covariance: along an oblique line of sight the distance is known less well than
//! the bearing, so that the errors of both axes are those of one ellipse, and a change of the bearing tells of both speeds.
//!
//! The place that a thing had when its image was stored is a state, too (a cloned state, Roumeliotis and Burdick, 2002): the
//! scale of the image since then tells how many times as far away it was, and its shift by how much the bearing has changed, in
//! each frame, and with what is known of both places.

use super::innovations::{Innovations, Judgement};
use crate::motion::planar::Planar;
use crate::tracking::parameters::{
    BIASED_PROCESS_NOISE, INITIAL_CLOSING_SIGMA_M_S, INITIAL_LATERAL_SIGMA_M_S, LATERAL_PROCESS_NOISE,
    MANOEUVRE_SIGMA_M_S2, MAX_BRAKING_M_S2, OUTLIER_SIGMAS, PROCESS_NOISE,
};
use nalgebra::{SMatrix, SVector};

/// Smallest distance, in metres.
pub const MIN_DISTANCE_M: f64 = 0.3;

/// Largest speed of a vehicle, in m/s.
const MAX_SPEED_M_S: f64 = 90.0;
/// Smallest variances of a place or a speed, in m² or m²/s², and of an acceleration, in m²/s⁴.
const MIN_VARIANCE: f64 = 1e-9;
const MIN_ACCELERATION_VARIANCE: f64 = 1e-6;

/// Components of the state: place to the right and forward,
pub(super) const X: usize = 0;
pub(super) const Z: usize = 1;
/// speed to the right and forward,
pub(super) const VX: usize = 2;
pub(super) const VZ: usize = 3;
/// acceleration forward, 0 with variance 0 in the steady model.
pub(super) const AZ: usize = 4;
/// place, in the axes of then, when the image was stored with which later ones are compared.
const STORED_X: usize = 5;
const STORED_Z: usize = 6;
/// Error of the scale of that image, as a share.
const STORED_SCALE: usize = 7;
const STATES: usize = 8;

pub(super) type State = SVector<f64, STATES>;
pub(super) type Covariance = SMatrix<f64, STATES, STATES>;

/// Partial derivatives of a measurement by the state, as pairs of component and slope.
pub(super) fn slopes<const N: usize>(of: [(usize, f64); N]) -> State {
    let mut slopes = State::zeros();
    of.into_iter().for_each(|(component, slope)| slopes[component] = slope);
    slopes
}

/// By how much variances grow, where a measurement contradicts the state by more than outliers do: the square of the error.
fn contradiction(innovation: f64, spread: f64) -> f64 {
    let squared = innovation * innovation;
    if squared > OUTLIER_SIGMAS * OUTLIER_SIGMAS * spread { squared } else { 0.0 }
}

/// Bearing of a thing's image, and of the stored one with which it is compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BearingChange {
    /// Tangents of the bearing: when the image was stored, in the axes of then, and now.
    pub tangents: [f64; 2],
    /// Derivative of the place to the right of what was stored, less that of what is seen now, by the depth behind the near side: 0 if
    /// the camera has only turned.
    pub by_depth: f64,
    /// Time between both, in seconds.
    pub elapsed_s: f64,
    /// Standard deviation of the displacement across that comes of the errors of the images, in metres.
    pub sigma_m: f64,
    /// Standard deviation of the depth of what was measured behind the near side, in metres.
    pub depth_sigma_m: f64,
}

/// How the speed along the axis changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// It does not, but for noise.
    Steady,
    /// By an acceleration, which changes during a manoeuvre only: the Wiener process acceleration model (Bar-Shalom, Li and Kirubarajan,
    /// 2001, section 6.2.3), whose noise is added before a step.
    Accelerating,
}

/// Kalman filter of place and speed by one model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    model: Model,
    /// Focal length × baseline, px·m.
    scale: f64,
    /// Speeds over ground if the own motion is known, else relative to the camera.
    pub(super) state: State,
    pub(super) p: Covariance,
    /// Rates that the own motion adds to the speeds; 0 if these are relative.
    pub(super) own_rate: Planar,
    /// Innovations of bearing and disparity.
    across: Innovations,
    pub(super) along: Innovations,
}

impl Estimate {
    /// Initialises the filter with a measured disparity and the tangent of a bearing. `scale` is focal length (px) × baseline (m);
    /// `across_sigma_m` the standard deviation of the place to the right at a known distance, in metres.
    pub fn new(
        model: Model,
        scale: f64,
        (disparity_px, sigma_px): (f64, f64),
        (bearing, across_sigma_m): (f64, f64),
    ) -> Self {
        let distance_m = scale / disparity_px;
        let sigma_m = distance_m * distance_m * sigma_px / scale;
        let mut p = Covariance::zeros();
        p[(Z, Z)] = sigma_m * sigma_m;
        p[(VX, VX)] = INITIAL_LATERAL_SIGMA_M_S * INITIAL_LATERAL_SIGMA_M_S;
        p[(VZ, VZ)] = INITIAL_CLOSING_SIGMA_M_S * INITIAL_CLOSING_SIGMA_M_S;
        let mut filter = Self {
            model,
            scale,
            state: slopes([(X, bearing * distance_m), (Z, distance_m)]),
            p,
            own_rate: [0.0; 2],
            across: Innovations::default(),
            along: Innovations::default(),
        };
        filter.forget_acceleration();
        filter.forget_stored();
        filter.tie_to_distance(bearing, across_sigma_m * across_sigma_m);
        filter
    }

    /// Sets the covariance of the place to the right: the error of the distance along this bearing, and `noise` in m² across it.
    fn tie_to_distance(&mut self, bearing: f64, noise: f64) {
        for i in 0..STATES {
            let with = bearing * self.p[(Z, i)];
            (self.p[(X, i)], self.p[(i, X)]) = (with, with);
        }
        self.p[(X, X)] = bearing * bearing * self.p[(Z, Z)] + noise;
    }

    /// Predicts the state `elapsed_s` seconds ahead at constant speed relative to the camera.
    pub fn predict(&mut self, elapsed_s: f64) {
        self.advance(elapsed_s);
        self.bound();
    }

    /// Predicts place and speed in axes that stay.
    pub(super) fn advance(&mut self, t: f64) {
        let mut f = Covariance::identity();
        (f[(X, VX)], f[(Z, VZ)]) = (t, t);
        if self.model == Model::Accelerating {
            (f[(Z, AZ)], f[(VZ, AZ)]) = (t * t / 2.0, t);
        }
        self.state = f * self.state;
        self.p = f * self.p * f.transpose();
        let is_steady = self.model == Model::Steady;
        let along = if is_steady && self.along.are_biased() { BIASED_PROCESS_NOISE } else { PROCESS_NOISE };
        for (place, speed, density) in [(X, VX, LATERAL_PROCESS_NOISE), (Z, VZ, along)] {
            self.p[(place, place)] += density * t.powi(3) / 3.0;
            self.p[(speed, speed)] += density * t;
            let both = density * t * t / 2.0;
            self.p[(place, speed)] += both;
            self.p[(speed, place)] += both;
        }
    }

    /// Nothing is known any more of the acceleration.
    pub(super) fn forget_acceleration(&mut self) {
        self.state[AZ] = 0.0;
        let is_steady = self.model == Model::Steady;
        self.forget(AZ, if is_steady { 0.0 } else { MANOEUVRE_SIGMA_M_S2 * MANOEUVRE_SIGMA_M_S2 });
    }

    /// The same by the other model: without its acceleration, or with one of which nothing is known.
    pub(super) fn by(mut self, model: Model) -> Self {
        self.model = model;
        self.forget_acceleration();
        self
    }

    /// Variance of the innovation of a measurement with this noise.
    pub(super) fn spread(&self, slopes: &State, noise: f64) -> f64 {
        slopes.dot(&(self.p * slopes)) + noise
    }

    /// Corrects the state by a linearised measurement.
    pub(super) fn correct(&mut self, slopes: &State, innovation: f64, noise: f64) {
        self.correct_some(slopes, innovation, noise, &[]);
    }

    /// The same, but for components that are only considered (Schmidt, 1966): their errors count, and they are not corrected.
    fn correct_some(&mut self, slopes: &State, innovation: f64, noise: f64, considered: &[usize]) {
        let with = self.p * slopes;
        let spread = slopes.dot(&with) + noise;
        if spread <= 0.0 {
            return;
        }
        let mut gain = with / spread;
        considered.iter().for_each(|&component| gain[component] = 0.0);
        self.state += gain * innovation;
        let both = gain * with.transpose();
        self.p += gain * gain.transpose() * spread - both - both.transpose();
        self.bound();
    }

    /// Keeps the state within what is possible, and variances above 0.
    pub(super) fn bound(&mut self) {
        self.state[Z] = self.state[Z].max(MIN_DISTANCE_M);
        for speed in [VX, VZ] {
            self.state[speed] = self.state[speed].clamp(-MAX_SPEED_M_S, MAX_SPEED_M_S);
        }
        for i in [X, Z, VX, VZ] {
            self.p[(i, i)] = self.p[(i, i)].max(MIN_VARIANCE);
        }
        if self.model == Model::Accelerating {
            self.p[(AZ, AZ)] = self.p[(AZ, AZ)].max(MIN_ACCELERATION_VARIANCE);
            self.state[AZ] = self.state[AZ].clamp(-MAX_BRAKING_M_S2, MAX_BRAKING_M_S2);
        }
    }

    /// Forgets what is known of a component, and gives it a variance.
    fn forget(&mut self, component: usize, variance: f64) {
        self.p.row_mut(component).fill(0.0);
        self.p.column_mut(component).fill(0.0);
        self.p[(component, component)] = variance;
    }

    /// Distance of a measured disparity, and its variance at the predicted distance: at the measured one, outliers that are too near
    /// would get more weight.
    fn measured_distance(&self, (disparity_px, sigma_px): (f64, f64)) -> (f64, f64) {
        let expected_m = self.state[Z];
        let sigma_m = expected_m * expected_m * sigma_px / self.scale;
        ((self.scale / disparity_px).max(MIN_DISTANCE_M), sigma_m * sigma_m)
    }

    /// Judges a measured disparity and its standard deviation, both in px.
    pub(super) fn judge_disparity(&mut self, disparity: (f64, f64)) -> Judgement {
        let (distance_m, noise) = self.measured_distance(disparity);
        self.along.judge(distance_m - self.state[Z], self.p[(Z, Z)], noise)
    }

    /// How much a measured disparity differs from the state that it has corrected: the square of that, plus the variance of the
    /// state, as a share of the variance that is stated. Disparity and its standard deviation in px.
    pub(super) fn squared_residual(&self, disparity: (f64, f64)) -> f64 {
        let (distance_m, noise) = self.measured_distance(disparity);
        ((distance_m - self.state[Z]).powi(2) + self.p[(Z, Z)]) / noise
    }

    /// Updates the state with a measured disparity and its standard deviation, both in px, as it was judged.
    pub(super) fn measure_disparity(&mut self, disparity: (f64, f64), judgement: Judgement) {
        let (distance_m, _) = self.measured_distance(disparity);
        match judgement {
            Judgement::Measurement { noise } => {
                self.correct(&slopes([(Z, 1.0)]), distance_m - self.state[Z], noise);
            }
            Judgement::Step { noise, grows } => {
                // The bearing remains.
                self.state[X] *= distance_m / self.state[Z];
                self.state[Z] = distance_m;
                self.forget(Z, noise);
                self.forget_stored();
                if grows {
                    let unknown = self.unknown_closing_m_s().powi(2);
                    self.p[(VZ, VZ)] = self.p[(VZ, VZ)].max(unknown);
                }
                self.forget_acceleration();
            }
        }
    }

    /// Updates the state with the place of a box, to the right and forward in metres, after its disparity; the standard deviation is
    /// that of the place to the right at a known distance. The middle of a box is not where the near side is: it tells nothing of the
    /// distance.
    ///
    /// `is_followed`: whether the image shows that the boxes are those of one thing. Then the bearing counts, at the distance of the
    /// state. Else each box may be that of another part of a fence: a constant bearing at a distance that seems to decrease would
    /// then look like a collision course, while the measured place to the right is that of the fence.
    pub fn measure_across(&mut self, [right_m, forward_m]: Planar, sigma_m: f64, is_followed: bool) {
        let bearing = if is_followed { right_m / forward_m } else { 0.0 };
        let measured_m = if is_followed { bearing * self.state[Z] } else { right_m };
        let slopes = slopes([(X, 1.0), (Z, -bearing)]);
        let innovation = measured_m - self.state[X];
        // Where both distances contradict each other, either may be that of what the box shows.
        let doubt_m = if self.along.is_outlier() { bearing * (forward_m - self.state[Z]) } else { 0.0 };
        let noise = sigma_m * sigma_m + doubt_m * doubt_m;
        match self.across.judge(innovation, self.spread(&slopes, 0.0), noise) {
            Judgement::Measurement { noise } => {
                self.correct_some(&slopes, innovation, noise, &[Z, VZ, AZ, STORED_Z, STORED_SCALE]);
            }
            Judgement::Step { noise, grows } => {
                self.state[X] = measured_m;
                self.tie_to_distance(bearing, noise);
                self.forget_stored();
                if grows {
                    let unknown = INITIAL_LATERAL_SIGMA_M_S * INITIAL_LATERAL_SIGMA_M_S;
                    self.p[(VX, VX)] = self.p[(VX, VX)].max(unknown);
                }
            }
        }
    }

    /// Updates the state with the change of a bearing since an image was stored.
    pub(super) fn measure_bearing_change(&mut self, change: &BearingChange) {
        // The image is so far beside the followed point, then and now.
        let [then, now] = change.tangents;
        let by_place = slopes([(X, 1.0), (Z, -now), (STORED_X, -1.0), (STORED_Z, then)]);
        let innovation = -by_place.dot(&self.state);
        let noise = change.sigma_m.powi(2) + (change.by_depth * change.depth_sigma_m).powi(2);
        let spread = self.spread(&by_place, noise);
        // Either may be wrong, as the image may be that of another part of a fence: the variances of both grow. A wrong speed has led to a
        // wrong place.
        let doubt = contradiction(innovation, spread);
        let wrong = slopes([(X, 1.0), (VX, 1.0 / change.elapsed_s)]);
        self.p += wrong * wrong.transpose() * doubt;
        self.correct(&by_place, innovation, noise + doubt);
    }

    /// Its image is stored: later ones are compared with it. Standard deviations of the scale, and of the place to the right in metres,
    /// that the errors of this image cause in all of them.
    pub(super) fn store_place(&mut self, scale_sigma: f64, across_sigma_m: f64) {
        for (stored, of) in [(STORED_X, X), (STORED_Z, Z)] {
            self.state[stored] = self.state[of];
            for i in 0..STATES {
                (self.p[(stored, i)], self.p[(i, stored)]) = (self.p[(of, i)], self.p[(of, i)]);
            }
            self.p[(stored, stored)] = self.p[(of, of)];
        }
        self.p[(STORED_X, STORED_X)] += across_sigma_m * across_sigma_m;
        self.state[STORED_SCALE] = 0.0;
        self.forget(STORED_SCALE, scale_sigma * scale_sigma);
    }

    /// Nothing is known any more of the place when its image was stored.
    fn forget_stored(&mut self) {
        let variance = self.state[Z] * self.state[Z];
        for (stored, of) in [(STORED_X, X), (STORED_Z, Z)] {
            self.state[stored] = self.state[of];
            self.forget(stored, variance);
        }
    }

    /// Updates the state with the scale of its image relative to the stored one, and its standard deviation. `depth_sigma_m`:
    /// standard deviation of the depth of what was measured behind the near side. A normalised innovation above `gate` is
    /// rejected.
    pub(super) fn measure_scale(&mut self, scale: f64, sigma: f64, depth_sigma_m: f64, gate: f64) {
        let (z, stored, error) = (self.state[Z], self.state[STORED_Z], self.state[STORED_SCALE]);
        let slopes = slopes([(Z, scale), (STORED_Z, -1.0), (STORED_SCALE, -stored)]);
        let innovation = stored * (1.0 + error) - scale * z;
        let noise = (sigma * z).powi(2) + ((scale - 1.0) * depth_sigma_m).powi(2);
        let spread = self.spread(&slopes, noise);
        if spread <= 0.0 {
            return;
        }
        if innovation * innovation <= gate * gate * spread {
            self.correct(&slopes, innovation, noise);
        }
    }

    /// Squares of the speeds to the right and forward that contradict 0, with these standard deviations in m/s, by more than outliers do.
    fn doubt_of_rest(&self, sigma_m_s: Planar) -> Planar {
        [0, 1].map(|i| {
            let noise = sigma_m_s[i] * sigma_m_s[i];
            contradiction(self.state[VX + i], self.p[(VX + i, VX + i)] + noise)
        })
    }

    /// Whether it moves by what is known so far, while it is measured to stand with these standard deviations, in m/s.
    pub fn contradicts_rest(&self, sigma_m_s: Planar) -> bool {
        self.doubt_of_rest(sigma_m_s) != [0.0; 2]
    }

    /// Measures speeds to the right and forward of 0, with these standard deviations in m/s.
    pub fn zero_velocity_update(&mut self, sigma_m_s: Planar) {
        for (i, sigma) in sigma_m_s.into_iter().enumerate() {
            let speed = VX + i;
            self.p[(speed, speed)] += self.doubt_of_rest(sigma_m_s)[i];
            self.correct(&slopes([(speed, 1.0)]), -self.state[speed], sigma * sigma);
        }
    }

    /// Forgets how the errors of place and speed depend on each other, so that the next measured place changes no speed, and what
    /// the places before told of a change of speed.
    pub(super) fn separate_speed(&mut self) {
        (self.across, self.along) = Default::default();
        self.forget_stored();
        for (place, speed) in [X, Z].into_iter().flat_map(|place| [VX, VZ, AZ].map(|speed| (place, speed))) {
            (self.p[(place, speed)], self.p[(speed, place)]) = (0.0, 0.0);
        }
    }

    /// Takes over speed and acceleration of another filter of the same thing; the place stays.
    pub(super) fn take_motion(&mut self, of: &Self) {
        // Their errors have nothing to do with those of the place.
        self.separate_speed();
        for i in [VX, VZ, AZ] {
            self.state[i] = of.state[i];
            [VX, VZ, AZ].into_iter().for_each(|k| self.p[(i, k)] = of.p[(i, k)]);
        }
        self.bound();
    }

    /// Moves the place to the right: another point of the obstacle is followed.
    pub(super) fn shift(&mut self, by_m: f64) {
        self.state[X] += by_m;
        self.state[STORED_X] += by_m;
    }

    /// Rates of the place to the right and forward, relative to the camera, in m/s.
    pub fn rate(&self) -> Planar {
        [self.state[VX] + self.own_rate[0], self.state[VZ] + self.own_rate[1]]
    }

    /// Place to the right of the camera's axis and forward, in metres; forward above zero.
    pub fn place_m(&self) -> Planar {
        [self.state[X], self.state[Z]]
    }

    /// Standard deviation of the place, in metres.
    pub fn place_sigma_m(&self) -> Planar {
        [X, Z].map(|i| self.sigma(i))
    }

    /// Speed to the right and forward, in m/s: over ground where the own motion is known, else relative to the camera.
    pub fn speed_m_s(&self) -> Planar {
        [self.state[VX], self.state[VZ]]
    }

    /// Standard deviation of the speed, in m/s.
    pub fn speed_sigma_m_s(&self) -> Planar {
        [VX, VZ].map(|i| self.sigma(i))
    }

    /// Distance, in metres, above zero.
    pub fn distance_m(&self) -> f64 {
        self.state[Z]
    }

    /// Disparity at that distance, in px.
    pub fn disparity_px(&self) -> f64 {
        self.scale / self.state[Z]
    }

    /// Standard deviation of the disparity, in px.
    pub fn disparity_sigma_px(&self) -> f64 {
        self.scale / (self.state[Z] * self.state[Z]) * self.sigma(Z)
    }

    /// Closing speed (decrease of the distance), in m/s.
    pub fn closing_m_s(&self) -> f64 {
        -self.rate()[1]
    }

    pub(super) fn sigma(&self, component: usize) -> f64 {
        self.p[(component, component)].max(0.0).sqrt()
    }
}
