//! A path of the camera.

use perception::motion::pose::Pose;

/// Poses of the left camera, frame after frame, with what was measured beside them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// From the camera of each frame to that of the first. Axes: x right, y down, z forward.
    pub poses: Vec<Pose>,
    /// Times of the frames, in seconds; empty if the file has none.
    pub times_s: Vec<f64>,
    /// Measured speed at each frame, in m/s, forwards positive; empty if the file has none.
    pub speed_m_s: Vec<f64>,
    /// Measured yaw rate at each frame, in rad/s, to the left positive; empty if the file has none.
    pub yaw_rate_rad_s: Vec<f64>,
    /// Measured speed and yaw rate in the middle between each frame and the next; empty if the file has none.
    pub between: Vec<[f64; 2]>,
}

impl Trajectory {
    /// Speed in m/s (along the camera's axis) and yaw rate in rad/s at each frame: differences over the two frames
    /// beside it, at the ends over one. `times_s` are the times of the frames; it ends with the shorter of both.
    pub fn differences(&self, times_s: &[f64]) -> Vec<[f64; 2]> {
        let count = self.poses.len().min(times_s.len());
        (0..count)
            .map(|i| {
                let (from, to) = (i.saturating_sub(1), (i + 1).min(count - 1));
                let step_s = times_s[to] - times_s[from];
                if step_s <= 0.0 {
                    return [0.0; 2];
                }
                let motion = self.poses[from].inverse().after(&self.poses[to]);
                // The chord along the heading half-way.
                let half = motion.yaw_rad() / 2.0;
                let [x, _, z] = motion.translation_m;
                [(z * half.cos() - x * half.sin()) / step_s, motion.yaw_rad() / step_s]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_has_its_speed_and_yaw_rate() {
        // To the left at 10 m/s and 0.2 rad/s: radius 50 m.
        let pose = |t: f64| {
            let yaw = 0.2 * t;
            let translation_m = [50.0 * (yaw.cos() - 1.0), 0.0, 50.0 * yaw.sin()];
            Pose { translation_m, ..Pose::from_rotation_vector([0.0, -yaw, 0.0]) }
        };
        let times_s: Vec<f64> = (0..20).map(|i| 0.1 * f64::from(i)).collect();
        let path = Trajectory { poses: times_s.iter().map(|&t| pose(t)).collect(), ..Trajectory::default() };
        let differences = path.differences(&times_s);
        assert_eq!(differences.len(), 20);
        for [speed, yaw_rate] in differences {
            // The chord is shorter than the arc by 1 in 15000.
            assert!((speed - 10.0).abs() < 2e-3 && (yaw_rate - 0.2).abs() < 1e-9, "{speed} {yaw_rate}");
        }
        assert_eq!(path.differences(&[0.0; 20])[3], [0.0; 2]);
        assert!(Trajectory::default().differences(&times_s).is_empty());
    }
}
