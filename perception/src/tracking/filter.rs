//! Place and speed of one obstacle on the ground plane, by two models of its motion.
//!
//! A thing keeps its speed, or it brakes or accelerates. Both are followed at the same time (`estimate.rs`), and the one that
//! holds is told (`manoeuvre.rs`).

mod collision;
pub(super) mod estimate;
pub mod ground;
mod innovations;
mod manoeuvre;
mod noise;

pub use collision::{TimeToCollision, braking_seconds};
pub use estimate::{BearingChange, Estimate};

use crate::motion::planar::{OwnRates, Planar, PlanarStep};
use estimate::Model;
use innovations::Judgement;
use noise::MeasurementNoise;
use std::ops::Deref;

/// Filter of place and speed. What is read is the estimate by the model that holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackFilter {
    steady: Estimate,
    accelerating: Estimate,
    /// Whether the thing brakes or accelerates.
    is_manoeuvring: bool,
    /// Time since the track or a manoeuvre that is expected began, in seconds: since then the second model has its acceleration.
    begun_s: f64,
    /// Scatter of its measured distances.
    noise: MeasurementNoise,
}

impl Deref for TrackFilter {
    type Target = Estimate;

    fn deref(&self) -> &Estimate {
        if self.is_manoeuvring { &self.accelerating } else { &self.steady }
    }
}

impl TrackFilter {
    /// See [`Estimate::new`].
    pub fn new(scale: f64, disparity: (f64, f64), bearing: (f64, f64)) -> Self {
        let by = |model| Estimate::new(model, scale, disparity, bearing);
        Self {
            steady: by(Model::Steady),
            accelerating: by(Model::Accelerating),
            is_manoeuvring: false,
            begun_s: 0.0,
            noise: MeasurementNoise::default(),
        }
    }

    fn both(&mut self, change: impl Fn(&mut Estimate)) {
        change(&mut self.steady);
        change(&mut self.accelerating);
    }

    /// So much time passes, in seconds: before both models are predicted.
    #[inline(never)]
    fn pass(&mut self, elapsed_s: f64) {
        self.choose_model();
        self.expect_manoeuvre(elapsed_s);
        self.noise.wait(elapsed_s);
    }

    /// See [`Estimate::predict`].
    pub fn predict(&mut self, elapsed_s: f64) {
        self.pass(elapsed_s);
        self.both(|estimate| estimate.predict(elapsed_s));
    }

    /// See [`Estimate::predict_over_ground`].
    pub fn predict_over_ground(&mut self, step: &PlanarStep, rates: &OwnRates, elapsed_s: f64) {
        self.pass(elapsed_s);
        let before_m_s = self.accelerating.speed_m_s()[1];
        self.both(|estimate| estimate.predict_over_ground(step, rates, elapsed_s));
        self.stop(before_m_s);
    }

    /// See [`Estimate::start_over_ground`].
    pub fn start_over_ground(&mut self, rates: &OwnRates) {
        self.both(|estimate| estimate.start_over_ground(rates));
    }

    /// See [`Estimate::begin_over_ground`].
    pub fn begin_over_ground(&mut self, rates: &OwnRates) {
        self.both(|estimate| estimate.begin_over_ground(rates));
    }

    /// See [`Estimate::end_over_ground`].
    pub fn end_over_ground(&mut self) {
        self.both(Estimate::end_over_ground);
    }

    /// Updates the state with a measured disparity and its standard deviation, both in px. The model that holds tells what is an
    /// outlier.
    pub fn measure_disparity(&mut self, disparity_px: f64, sigma_px: f64) {
        match self.measure((disparity_px, self.noise.sigma(sigma_px))) {
            Judgement::Step { .. } => self.noise = MeasurementNoise::default(),
            // The model that follows a change of speed: braking is no scatter.
            Judgement::Measurement { .. } => {
                self.noise.observe(self.accelerating.squared_residual((disparity_px, sigma_px)));
            }
        }
    }

    /// The same of a thing that the picture cuts, whose errors do not scatter: they count as stated.
    pub(super) fn measure_cut_disparity(&mut self, disparity_px: f64, sigma_px: f64) {
        self.measure((disparity_px, sigma_px));
    }

    fn measure(&mut self, disparity: (f64, f64)) -> Judgement {
        let holding = if self.is_manoeuvring { &mut self.accelerating } else { &mut self.steady };
        let judgement = holding.judge_disparity(disparity);
        let along = holding.along;
        self.both(|estimate| {
            estimate.along = along;
            estimate.measure_disparity(disparity, judgement);
        });
        judgement
    }

    /// See [`Estimate::measure_across`].
    pub fn measure_across(&mut self, place_m: Planar, sigma_m: f64, is_followed: bool) {
        self.both(|estimate| estimate.measure_across(place_m, sigma_m, is_followed));
    }

    /// See [`Estimate::measure_bearing_change`].
    pub(super) fn measure_bearing_change(&mut self, change: &BearingChange) {
        self.both(|estimate| estimate.measure_bearing_change(change));
    }

    /// See [`Estimate::store_place`].
    pub(super) fn store_place(&mut self, scale_sigma: f64, across_sigma_m: f64) {
        self.both(|estimate| estimate.store_place(scale_sigma, across_sigma_m));
    }

    /// See [`Estimate::measure_scale`].
    pub(super) fn measure_scale(&mut self, scale: f64, sigma: f64, depth_sigma_m: f64, gate: f64) {
        self.both(|estimate| estimate.measure_scale(scale, sigma, depth_sigma_m, gate));
    }

    /// See [`Estimate::zero_velocity_update`].
    pub fn zero_velocity_update(&mut self, sigma_m_s: Planar) {
        self.both(|estimate| estimate.zero_velocity_update(sigma_m_s));
    }

    /// See [`Estimate::separate_speed`].
    pub(super) fn separate_speed(&mut self) {
        // It may be another thing.
        self.noise = MeasurementNoise::default();
        self.both(Estimate::separate_speed);
    }

    /// Takes over speed and acceleration of another filter of the same thing; the place stays.
    pub(super) fn take_motion(&mut self, of: &Self) {
        self.steady.take_motion(&of.steady);
        self.accelerating.take_motion(&of.accelerating);
        (self.is_manoeuvring, self.begun_s) = (of.is_manoeuvring, of.begun_s);
    }

    /// See [`Estimate::shift`].
    pub(super) fn shift(&mut self, by_m: f64) {
        self.both(|estimate| estimate.shift(by_m));
    }
}

#[cfg(test)]
mod tests;
