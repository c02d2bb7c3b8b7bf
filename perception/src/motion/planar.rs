//! What the vehicle's own motion does to a point on the road, seen from the camera.
//!
//! Input: [`Motion`] and [`Body`]. Output: the displacement of the camera over a time ([`PlanarStep`]), and the rate at
//! which a standing point moves in the camera's axes ([`OwnRates`]). The vehicle moves along an arc about its rear axle,
//! or at speed about a point ahead of it ([`Body::during`]); the camera, ahead of the axle, swings sideways with the yaw.

use super::Motion;
use super::body::Body;
pub use super::body::Planar;

/// Displacement of the camera over a time, in its axes at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarStep {
    /// Sine and cosine of the yaw, to the left positive.
    sine: f64,
    cosine: f64,
    /// Translation, in metres.
    shift_m: Planar,
    /// Standard deviation of the yaw, in rad.
    yaw_sigma_rad: f64,
    /// Standard deviation of the way, in metres.
    way_sigma_m: f64,
}

impl PlanarStep {
    /// The displacement within the `elapsed_s` seconds at whose end the vehicle has this motion.
    pub fn of(motion: &Motion, body: &Body, elapsed_s: f64) -> Self {
        let body = body.during(motion);
        // The mean is that of the middle: as a turn begins, the yaw rate grows within one frame by more than its error.
        let half_s = elapsed_s / 2.0;
        let yaw = (motion.yaw_rate_rad_s - motion.yaw_acceleration_rad_s2 * half_s) * elapsed_s;
        let speed_m_s = motion.speed_m_s - motion.acceleration_m_s2 * half_s;
        let (sine, cosine) = yaw.sin_cos();
        // The rear axle moves along the chord of its arc.
        let half = yaw / 2.0;
        let chord = speed_m_s * elapsed_s * if half.abs() < 1e-6 { 1.0 } else { half.sin() / half };
        let (right, ahead) = (body.camera_right_m, body.rear_axle_m);
        Self {
            sine,
            cosine,
            shift_m: body.turn_to_camera([
                -chord * half.sin() + right * cosine - ahead * sine - right,
                chord * half.cos() + right * sine + ahead * cosine - ahead,
            ]),
            yaw_sigma_rad: motion.yaw_rate_sigma_rad_s * elapsed_s,
            way_sigma_m: motion.speed_sigma_m_s * elapsed_s,
        }
    }

    /// Yaw, in rad, to the left positive.
    pub fn yaw_rad(&self) -> f64 {
        self.sine.atan2(self.cosine)
    }

    /// A standing point in the axes of the camera at the end.
    pub fn place(&self, [right, ahead]: Planar) -> Planar {
        self.direction([right - self.shift_m[0], ahead - self.shift_m[1]])
    }

    /// A velocity over ground in the axes of the camera at the end.
    pub fn direction(&self, [right, ahead]: Planar) -> Planar {
        [self.cosine * right + self.sine * ahead, self.cosine * ahead - self.sine * right]
    }

    /// Cosine and sine of the yaw.
    pub fn turn(&self) -> (f64, f64) {
        (self.cosine, self.sine)
    }

    /// Covariance that the error of the motion adds to the place of a point, in m²: right², right · ahead, ahead².
    pub fn covariance_m2(&self, [right, ahead]: Planar) -> [f64; 3] {
        let yaw2 = self.yaw_sigma_rad * self.yaw_sigma_rad;
        let way2 = self.way_sigma_m * self.way_sigma_m;
        [ahead * ahead * yaw2, -right * ahead * yaw2, right * right * yaw2 + way2]
    }
}

/// Rates at which the own motion moves standing points in the camera's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnRates {
    yaw_rate_rad_s: f64,
    yaw_rate_sigma_rad_s: f64,
    /// Velocity of the camera, in m/s.
    camera_m_s: Planar,
    speed_sigma_m_s: f64,
}

impl OwnRates {
    /// The rates during this motion.
    pub fn of(motion: &Motion, body: &Body) -> Self {
        let body = body.during(motion);
        let yaw_rate = motion.yaw_rate_rad_s;
        Self {
            yaw_rate_rad_s: yaw_rate,
            yaw_rate_sigma_rad_s: motion.yaw_rate_sigma_rad_s,
            camera_m_s: body.turn_to_camera([
                -yaw_rate * body.rear_axle_m,
                motion.speed_m_s + yaw_rate * body.camera_right_m,
            ]),
            speed_sigma_m_s: motion.speed_sigma_m_s,
        }
    }

    /// Magnitude of the yaw rate, in rad/s.
    pub fn turning_rad_s(&self) -> f64 {
        self.yaw_rate_rad_s.abs()
    }

    /// Rate of a standing point at this place, in m/s.
    pub fn at(&self, [right, ahead]: Planar) -> Planar {
        [self.yaw_rate_rad_s * ahead - self.camera_m_s[0], -self.yaw_rate_rad_s * right - self.camera_m_s[1]]
    }

    /// Standard deviation of that rate, in m/s.
    pub fn sigma_at(&self, [right, ahead]: Planar) -> Planar {
        let yaw = self.yaw_rate_sigma_rad_s;
        [(yaw * ahead).abs(), (yaw * right).hypot(self.speed_sigma_m_s)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: Body =
        Body { width_m: 1.8, front_m: 1.7, camera_right_m: 0.3, rear_axle_m: 1.6, camera_yaw_rad: 0.0 };

    fn motion(speed_m_s: f64, yaw_rate_rad_s: f64) -> Motion {
        Motion { speed_m_s, yaw_rate_rad_s, ..Motion::default() }
    }

    #[test]
    fn a_step_is_the_way_along_an_arc_about_the_rear_axle() {
        // A quarter turn to the left with a radius of 10 m: the rear axle ends 10 m ahead and 10 m to the left.
        let quarter = std::f64::consts::FRAC_PI_2;
        let step = PlanarStep::of(&motion(10.0 * quarter, quarter), &BODY, 1.0);
        assert!((step.yaw_rad() - quarter).abs() < 1e-12);
        // In the axes of the axle: the place where it ends, seen from the camera at the start.
        let body = BODY.during(&motion(10.0 * quarter, quarter));
        let axle_end = [-10.0 - body.camera_right_m, 10.0 - body.rear_axle_m];
        let seen = step.place(axle_end);
        assert!((seen[0] + body.camera_right_m).abs() < 1e-9 && (seen[1] + body.rear_axle_m).abs() < 1e-9);
        // What moved ahead at the start moves to the right at the end.
        let turned = step.direction([0.0, 5.0]);
        assert!((turned[0] - 5.0).abs() < 1e-9 && turned[1].abs() < 1e-9, "{turned:?}");
    }

    #[test]
    fn many_small_steps_are_one_large_one() {
        let motion = motion(9.0, -0.4);
        let whole = PlanarStep::of(&motion, &BODY, 1.0);
        let part = PlanarStep::of(&motion, &BODY, 0.01);
        let point = [3.0, 25.0];
        let small = (0..100).fold(point, |point, _| part.place(point));
        let large = whole.place(point);
        assert!((small[0] - large[0]).hypot(small[1] - large[1]) < 1e-9, "{small:?} {large:?}");
    }

    #[test]
    fn the_rate_is_the_derivative_of_the_step() {
        let motion = motion(9.0, 0.4);
        let (step, rates) = (PlanarStep::of(&motion, &BODY, 1e-6), OwnRates::of(&motion, &BODY));
        for point in [[3.0, 25.0], [-6.0, 4.0], [0.0, 1.0]] {
            let (moved, rate) = (step.place(point), rates.at(point));
            for axis in 0..2 {
                assert!(((moved[axis] - point[axis]) * 1e6 - rate[axis]).abs() < 1e-3, "{point:?}");
            }
        }
    }
}
